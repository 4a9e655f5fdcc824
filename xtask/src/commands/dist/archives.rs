//! The archives of a laid-out tree: a .deb by dpkg-deb, a .tar.gz by GNU tar, and the checksums of all files by
//! sha256sum. None of them stores when or by whom it was made.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

use program::Fault;

use super::tree::PROGRAMS;

/// How much time to spend on small archives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Compression {
    /// For users.
    Best,
    /// For a check of the content.
    Fast,
}

/// The version of the packages.
const VERSION: &str = env!("CARGO_PKG_VERSION");

/// Writes `aarc-VERSION-linux-ARCH.tar.gz`: the tree below `usr` in a folder of this name.
///
/// # Errors
/// [`Fault::Device`] where tar or gzip is missing or fails.
pub(super) fn tarball(staging: &Path, out: &Path, compression: Compression, epoch: u64) -> Result<(), Fault> {
    let name = format!("aarc-{VERSION}-linux-{}", std::env::consts::ARCH);
    let level = if compression == Compression::Best { 9 } else { 1 };
    let mut tar = Command::new("tar");
    tar.args(["--format=gnu", "--sort=name", "--owner=0", "--group=0", "--numeric-owner"])
        .arg(format!("--mtime=@{epoch}"))
        .arg(format!("--transform=s,^usr,{name},"))
        .arg(format!("--use-compress-program=gzip -n -{level}"))
        .arg("-cf")
        .arg(out.join(format!("{name}.tar.gz")))
        .arg("-C")
        .arg(staging)
        .arg("usr");
    run(&mut tar, "tar").map(drop)
}

/// Writes `aarc_VERSION_ARCH.deb`.
///
/// # Errors
/// [`Fault::Device`] where dpkg-deb is missing or fails; [`Fault::Usage`] where a file cannot be written.
pub(super) fn deb(staging: &Path, out: &Path, compression: Compression, epoch: u64) -> Result<(), Fault> {
    let architecture = run(Command::new("dpkg").arg("--print-architecture"), "dpkg")?;
    let architecture = architecture.trim();
    let folder = staging.join("DEBIAN");
    let cannot = |error: std::io::Error| Fault::Usage(format!("{}: {error}", folder.display()));
    fs::create_dir_all(&folder).map_err(cannot)?;
    let mut hash = Command::new("sh");
    hash.current_dir(staging).args(["-c", "find usr -type f | LC_ALL=C sort | xargs -d '\\n' md5sum"]);
    fs::write(folder.join("md5sums"), run(&mut hash, "md5sum")?).map_err(cannot)?;
    fs::write(folder.join("control"), control(staging, architecture)?).map_err(cannot)?;
    let (kind, level) = if compression == Compression::Best { ("xz", 6) } else { ("gzip", 1) };
    let mut pack = Command::new("dpkg-deb");
    pack.env("SOURCE_DATE_EPOCH", epoch.to_string())
        // The number of threads changes how xz cuts its input.
        .args(["--root-owner-group", "--threads-max=1"])
        .args([format!("-Z{kind}"), format!("-z{level}"), "--build".into()])
        .arg(staging)
        .arg(out.join(format!("aarc_{VERSION}_{architecture}.deb")));
    run(&mut pack, "dpkg-deb").map(drop)
}

/// Writes `SHA256SUMS` of all files of a folder.
///
/// # Errors
/// [`Fault::Device`] where sha256sum is missing or fails.
pub(super) fn checksums(out: &Path) -> Result<(), Fault> {
    let mut hash = Command::new("sh");
    let sums =
        run(hash.current_dir(out).args(["-c", "LC_ALL=C; export LC_ALL; sha256sum -- *"]), "sha256sum")?;
    program::output::write(&out.join("SHA256SUMS"), sums.as_bytes())
}

/// The description of the package for dpkg.
fn control(staging: &Path, architecture: &str) -> Result<String, Fault> {
    let mut glibc = (0, 0);
    for name in PROGRAMS {
        let path = staging.join("usr/bin").join(name);
        let bytes = fs::read(&path).map_err(|error| Fault::Data(format!("{}: {error}", path.display())))?;
        glibc = glibc.max(glibc_of(&bytes));
    }
    let kilobytes = run(Command::new("du").args(["-k", "-s"]).arg(staging.join("usr")), "du")?;
    let kilobytes = kilobytes.split_whitespace().next().unwrap_or("0");
    // Elsewhere, another linker than LLVM's may make the player need it.
    const SOUND: &str = "libasound2 | libasound2t64";
    let (needed, recommended) = match architecture {
        "amd64" => (String::new(), format!("{SOUND}, ")),
        _ => (format!(", {SOUND}"), String::new()),
    };
    Ok(format!(
        "Package: aarc
Version: {VERSION}
Architecture: {architecture}
Maintainer: the aarc authors <aarc@invalid>
Installed-Size: {kilobytes}
Depends: libc6 (>= {}.{}), libgcc-s1{needed}
Recommends: {recommended}libvulkan1, mesa-vulkan-drivers, libx11-6, libx11-xcb1, libxcursor1, libxi6, libxkbcommon-x11-0, libwayland-client0
Suggests: ffmpeg, libopenxr-loader1
Section: video
Priority: optional
Description: player and maker of clips of 4D Gaussians
 aarc plays filmed people from anywhere, at any instant: in a window, in a
 headset through OpenXR, and to images.
 .
 aarc-studio makes the clips from the images of many cameras, and inspects,
 measures and exports them.
",
        glibc.0, glibc.1
    ))
}

/// The newest version of glibc that a program asks for, by the names of versions in it.
fn glibc_of(program: &[u8]) -> (u32, u32) {
    const PREFIX: &[u8] = b"\0GLIBC_";
    let starts = program.windows(PREFIX.len()).enumerate().filter(|(_, bytes)| *bytes == PREFIX);
    let versions = starts.filter_map(|(at, _)| {
        let name = program[at + PREFIX.len()..].split(|byte| *byte == 0).next()?;
        let mut numbers = std::str::from_utf8(name).ok()?.split('.').map(|number| number.parse().ok());
        Some((numbers.next()??, numbers.next()??))
    });
    versions.max().unwrap_or((2, 17))
}

/// Runs a program and returns what it prints.
///
/// # Errors
/// [`Fault::Device`] where it is missing or fails.
fn run(command: &mut Command, name: &str) -> Result<String, Fault> {
    let output = command.stdin(Stdio::null()).output();
    let output = output.map_err(|error| Fault::Device(format!("{name} cannot run ({error}); install it")))?;
    match output.status.success() {
        true => Ok(String::from_utf8_lossy(&output.stdout).into_owned()),
        false => {
            Err(Fault::Device(format!("{name} failed: {}", String::from_utf8_lossy(&output.stderr).trim())))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_glibc_is_found() {
        let program = b"\x7fELF\0GLIBC_2.2.5\0GLIBC_2.34\0GLIBC_2.9\0GLIBC_PRIVATE\0";
        assert_eq!(glibc_of(program), (2, 34));
        assert_eq!(glibc_of(b""), (2, 17));
    }
}
