//! What signs: a key for trying out, made on first use, or the one of a keystore.

use std::fs;
use std::path::Path;

use anyhow::Context;
use apk::sign::{Keystore, SigningIdentity};

/// The key in the file, which is made if there is none.
///
/// Android installs an update only over an app that the same key signed, so the file is to be kept.
///
/// # Errors
/// If the file cannot be read or written, or holds no key.
pub fn for_debugging(path: &Path) -> anyhow::Result<SigningIdentity> {
    let at = || path.display().to_string();
    if !path.exists() {
        let made = rcgen::generate_simple_self_signed(["debug".to_owned()])?;
        let pem = format!("{}{}", made.signing_key.serialize_pem(), made.cert.pem());
        // Whole or not at all: half a key would sign nothing ever after.
        let part = path.with_extension("part");
        fs::write(&part, pem).and_then(|()| fs::rename(&part, path)).with_context(at)?;
        eprintln!("made a key for trying out: {}", at());
    }
    SigningIdentity::from_pem_file(path).with_context(at)
}

/// The only private key of a keystore, PKCS #12 or JKS.
///
/// # Errors
/// If the keystore cannot be opened, or does not hold one private key.
pub fn of_keystore(path: &Path, password: &str) -> anyhow::Result<SigningIdentity> {
    let open = || Ok::<_, apk::Error>(Keystore::open(path, password)?.sole_identity(None)?);
    open().with_context(|| path.display().to_string())
}
