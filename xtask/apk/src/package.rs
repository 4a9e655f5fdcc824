//! Writes an APK that Android maps without copying, and checks it.
//!
//! Libraries are stored uncompressed and aligned to 16 KiB, the clip uncompressed, so that the device
//! copies neither. The same parts and key give the same bytes.

use std::fmt::{self, Write as _};
use std::fs;
use std::path::Path;

use anyhow::{Context, ensure};
use apk::archive::EntryOptions;
use apk::native::{ElfInfo, NATIVE_ACTIVITY_ENTRY};
use apk::prelude::*;

/// Contents of an APK.
#[derive(Clone, Copy, Debug)]
pub struct Parts<'a> {
    /// AndroidManifest.xml as text, without versions.
    pub manifest: &'a Path,
    /// The launcher's icon, PNG.
    pub icon: &'a Path,
    /// The player's library for 64-bit ARM.
    pub library: &'a Path,
    /// The OpenXR loader for 64-bit ARM.
    pub openxr_loader: &'a Path,
    /// A clip, an asset of its name.
    pub clip: &'a Path,
    /// Licences of everything in the APK, an asset of its name.
    pub notices: &'a Path,
    /// MAJOR.MINOR.PATCH.
    pub version: &'a str,
}

/// Writes the APK, whole or not at all.
///
/// # Errors
/// If a part cannot be read, or a library is for another machine, is not aligned to 16 KiB, lacks the
/// entry point, or needs a library that neither the APK nor Android has.
pub fn write(parts: &Parts<'_>, identity: SigningIdentity, out: &Path) -> anyhow::Result<()> {
    let manifest = fs::read_to_string(parts.manifest).with_context(|| at(parts.manifest))?;
    let manifest = Manifest::parse(&manifest).with_context(|| at(parts.manifest))?;
    let mut app = ApkBuilder::new(manifest);
    app.version(VersionCode::try_new(version_code(parts.version)?)?, parts.version)
        .icon(Density::XXXHDPI, read(parts.icon)?)?
        .file(asset(parts.clip)?, read(parts.clip)?, Some(EntryOptions::STORED))?
        .file(asset(parts.notices)?, read(parts.notices)?, None)?
        .native_library(Abi::Arm64V8a, parts.library)
        .with_context(|| at(parts.library))?
        .native_library(Abi::Arm64V8a, parts.openxr_loader)
        .with_context(|| at(parts.openxr_loader))?
        .sign_with(Signer::new(identity));
    Ok(app.write(out)?)
}

/// Path in the APK of an asset.
fn asset(file: &Path) -> anyhow::Result<ArchivePath> {
    let name = file.file_name().and_then(|name| name.to_str()).context("the asset has no name")?;
    Ok(ArchivePath::try_new(format!("assets/{name}"))?)
}

fn read(path: &Path) -> anyhow::Result<Vec<u8>> {
    fs::read(path).with_context(|| at(path))
}

/// A number that grows with the version; Android compares it.
fn version_code(version: &str) -> anyhow::Result<u32> {
    let numbers: Option<Vec<u32>> = version.split('.').map(|number| number.parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[major, minor, patch]) if major < 2000 && minor < 1000 && patch < 1000 => {
            Ok(1 + patch + 1000 * (minor + 1000 * major))
        }
        _ => anyhow::bail!("{version} is no version MAJOR.MINOR.PATCH"),
    }
}

/// Contents of an APK that was read back.
#[derive(Clone, Debug)]
pub struct Contents {
    /// Name of the package, for `adb`.
    pub package: String,
    /// Version name.
    pub version: String,
    /// Valid signature schemes.
    pub schemes: Schemes,
    /// Subject of the signing certificate.
    pub signer: String,
    /// Size of the APK in bytes.
    pub bytes: u64,
    /// Libraries: name, size in bytes, needed libraries.
    pub libraries: Vec<(String, usize, Vec<String>)>,
}

/// Reads an APK back: its signature, its manifest, its libraries.
///
/// # Errors
/// If the signature is invalid, or the library that the manifest starts is missing or cannot start.
pub fn check(path: &Path) -> anyhow::Result<Contents> {
    let verified = verify(path).with_context(|| at(path))?;
    let mut apk = Apk::open(path)?;
    let manifest = apk.manifest()?;
    let started = manifest.native_activity_library().and_then(Result::ok).context("it starts no library")?;
    let started = format!("lib/arm64-v8a/lib{started}.so");
    let names: Vec<String> =
        apk.entries().filter(|name| name.starts_with("lib/")).map(str::to_owned).collect();
    ensure!(names.contains(&started), "{started} is missing");
    let mut libraries = Vec::new();
    for name in names {
        let library = apk.read(&name)?;
        let info = ElfInfo::parse(&library).with_context(|| name.clone())?;
        ensure!(
            info.max_page_size() >= PageSize::SixteenKiB.bytes(),
            "{name} is not laid out for 16 KiB pages"
        );
        ensure!(name != started || info.exports(NATIVE_ACTIVITY_ENTRY), "{name} has no entry point");
        libraries.push((name, library.len(), info.needed));
    }
    Ok(Contents {
        package: manifest.package().context("it has no name")?.to_owned(),
        version: manifest.version_name().unwrap_or_default().to_owned(),
        schemes: verified.schemes,
        signer: verified.certificate().subject(),
        bytes: fs::metadata(path)?.len(),
        libraries,
    })
}

impl fmt::Display for Contents {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{} {}, {} bytes, signed by {}", self.package, self.version, self.bytes, self.signer)?;
        for scheme in self.schemes.iter_schemes() {
            writeln!(f, "  {scheme} holds")?;
        }
        for (name, bytes, needed) in &self.libraries {
            let mut line = String::new();
            write!(line, "  {name}: {bytes} bytes, needs {}", needed.join(" "))?;
            writeln!(f, "{}", line.trim_end())?;
        }
        Ok(())
    }
}

fn at(path: &Path) -> String {
    path.display().to_string()
}

#[cfg(test)]
mod tests {
    use super::version_code;

    #[test]
    fn newer_versions_have_higher_codes() {
        let code = |version| version_code(version).ok();
        assert!(
            code("0.1.0") < code("0.1.1") && code("0.1.999") < code("0.2.0") && code("0.9.9") < code("1.0.0")
        );
        assert!(code("0.0.0") > Some(0));
        for version in ["", "1", "1.2", "1.2.3.4", "1.2.x", "1.1000.0"] {
            assert_eq!(code(version), None, "{version}");
        }
    }
}
