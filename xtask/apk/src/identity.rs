//! Signing identities: a debug key, made on first use, or the key of a keystore.

use std::io::Write;
use std::path::Path;

use anyhow::Context;
use apk::sign::{Keystore, SigningIdentity};
use rcgen::{CertificateParams, DistinguishedName, DnType, KeyPair};
use tempfile::NamedTempFile;

/// The key in the file; makes it if there is none.
///
/// Android installs an update only over an app that the same key signed, so keep the file.
///
/// # Errors
/// If the file cannot be read or written, or holds no key.
pub fn for_debugging(path: &Path) -> anyhow::Result<SigningIdentity> {
    let at = || path.display().to_string();
    if !path.exists() {
        make(path).with_context(at)?;
        eprintln!("made a debug key: {}", at());
    }
    SigningIdentity::from_pem_file(path).with_context(at)
}

/// Makes a key and its certificate, readable by the user only.
fn make(path: &Path) -> anyhow::Result<()> {
    let key = KeyPair::generate()?;
    let mut about = CertificateParams::default();
    about.distinguished_name = DistinguishedName::new();
    about.distinguished_name.push(DnType::CommonName, "aarc debug key");
    let certificate = about.self_signed(&key)?;
    // Atomic: a truncated key would break every later run.
    let mut file = NamedTempFile::new_in(path.parent().context("the key needs a folder")?)?;
    write!(file, "{}{}", key.serialize_pem(), certificate.pem())?;
    file.persist(path)?;
    Ok(())
}

/// The only private key of a keystore, PKCS #12 or JKS.
///
/// # Errors
/// If the keystore cannot be opened, or does not hold exactly one private key.
pub fn of_keystore(path: &Path, password: &str) -> anyhow::Result<SigningIdentity> {
    let open = || Ok::<_, apk::Error>(Keystore::open(path, password)?.sole_identity(None)?);
    open().with_context(|| path.display().to_string())
}
