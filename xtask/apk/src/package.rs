//! Writes an APK that Android maps as it is, and looks at what was written.
//!
//! Libraries lie uncompressed on boundaries of 16 KiB, the clip uncompressed, so that neither is
//! copied on the device. The same parts and key give the same bytes.

use std::fmt::{self, Write as _};
use std::fs;
use std::path::Path;

use anyhow::{Context, ensure};
use apk::archive::EntryOptions;
use apk::native::{ElfInfo, NATIVE_ACTIVITY_ENTRY};
use apk::prelude::*;

/// What goes into the APK.
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
    /// A clip, which becomes an asset of its name.
    pub clip: &'a Path,
    /// MAJOR.MINOR.PATCH.
    pub version: &'a str,
}

/// Writes the APK, whole or not at all.
///
/// # Errors
/// If a part cannot be read or does not fit, as a library of another machine, one that is not laid
/// out for pages of 16 KiB, lacks the entry point, or needs what neither the APK nor Android has.
pub fn write(parts: &Parts<'_>, identity: SigningIdentity, out: &Path) -> anyhow::Result<()> {
    let manifest = fs::read_to_string(parts.manifest).with_context(|| at(parts.manifest))?;
    let manifest = Manifest::parse(&manifest).with_context(|| at(parts.manifest))?;
    let clip_name = parts.clip.file_name().and_then(|name| name.to_str()).context("the clip has no name")?;
    let clip_path = ArchivePath::try_new(format!("assets/{clip_name}"))?;
    let clip = fs::read(parts.clip).with_context(|| at(parts.clip))?;
    let mut app = ApkBuilder::new(manifest);
    app.version(VersionCode::try_new(version_code(parts.version)?)?, parts.version)
        .icon(Density::XXXHDPI, fs::read(parts.icon).with_context(|| at(parts.icon))?)?
        .file(clip_path, clip, Some(EntryOptions::STORED))?
        .native_library(Abi::Arm64V8a, parts.library)
        .with_context(|| at(parts.library))?
        .native_library(Abi::Arm64V8a, parts.openxr_loader)
        .with_context(|| at(parts.openxr_loader))?
        .sign_with(Signer::new(identity));
    Ok(app.write(out)?)
}

/// A number that grows with the version, which Android compares.
fn version_code(version: &str) -> anyhow::Result<u32> {
    let numbers: Option<Vec<u32>> = version.split('.').map(|number| number.parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[major, minor, patch]) if major < 2000 && minor < 1000 && patch < 1000 => {
            Ok(1 + patch + 1000 * (minor + 1000 * major))
        }
        _ => anyhow::bail!("{version} is no version MAJOR.MINOR.PATCH"),
    }
}

/// What an APK holds, as far as it matters to whoever installs it.
#[derive(Clone, Debug)]
pub struct Contents {
    /// Name of the package, as `adb` takes it.
    pub package: String,
    /// Version for people.
    pub version: String,
    /// Signature schemes that hold.
    pub schemes: Schemes,
    /// Who signed.
    pub signer: String,
    /// Size of the APK in bytes.
    pub bytes: u64,
    /// Names and sizes in bytes of the libraries, and what each needs.
    pub libraries: Vec<(String, usize, Vec<String>)>,
}

/// Reads an APK back: its signature, its manifest, its libraries.
///
/// # Errors
/// If the signature does not hold, or the library that the manifest starts is not there or cannot
/// be started.
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
