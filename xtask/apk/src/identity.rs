//! Signing identities: a debug key, made on first use, or the key of a keystore.

use std::io::{ErrorKind, Write};
use std::path::Path;

use anyhow::{Context, ensure};
use apk::sign::{Keystore, SigningIdentity};
use rcgen::{CertificateParams, DistinguishedName, DnType, KeyPair};
use tempfile::NamedTempFile;

/// The key in the file; makes it if there is none, and never replaces what is there.
///
/// Android installs an update only over an app that the same key signed, so keep the file.
///
/// # Errors
/// If the file cannot be read or written, or holds no key, or the path is a link to nothing.
pub fn for_debugging(path: &Path) -> anyhow::Result<SigningIdentity> {
    let at = || path.display().to_string();
    // What a link names may be on a disk that is not mounted now.
    let is_absent = path.symlink_metadata().is_err_and(|error| error.kind() == ErrorKind::NotFound);
    if is_absent && make(path).with_context(at)? {
        eprintln!("made a debug key: {}", at());
    }
    ensure!(path.exists(), "{}: a link to nothing; restore the key that it names, or remove the link", at());
    SigningIdentity::from_pem_file(path).with_context(at)
}

/// Makes a key and its certificate, readable by the user only. Returns `false` if another run made one in the
/// meantime, which stays.
fn make(path: &Path) -> anyhow::Result<bool> {
    let key = KeyPair::generate()?;
    let mut about = CertificateParams::default();
    about.distinguished_name = DistinguishedName::new();
    about.distinguished_name.push(DnType::CommonName, "aarc debug key");
    let certificate = about.self_signed(&key)?;
    // Atomic: a truncated key would break every later run.
    let mut file = NamedTempFile::new_in(path.parent().context("the key needs a folder")?)?;
    write!(file, "{}{}", key.serialize_pem(), certificate.pem())?;
    file.as_file().sync_all()?;
    match file.persist_noclobber(path) {
        Ok(_) => Ok(true),
        Err(error) if error.error.kind() == ErrorKind::AlreadyExists => Ok(false),
        Err(error) => Err(error.error.into()),
    }
}

/// The only private key of a keystore, PKCS #12 or JKS.
///
/// # Errors
/// If the keystore cannot be opened, or does not hold exactly one private key.
pub fn of_keystore(path: &Path, password: &str) -> anyhow::Result<SigningIdentity> {
    let open = || Ok::<_, apk::Error>(Keystore::open(path, password)?.sole_identity(None)?);
    open().with_context(|| path.display().to_string())
}
