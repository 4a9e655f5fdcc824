//! [`lay_out`]: the files that are installed, below `usr`, as Debian's policy and the XDG specifications place them.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context, ensure};
use program::Fault;
use xtask::workspace;

/// The programs.
pub(super) const PROGRAMS: [&str; 2] = ["aarc", "aarc-studio"];

/// Documents that are made for the packages.
pub(super) struct Documents {
    /// Licences of everything in the programs.
    pub(super) notices: String,
    /// The list of what the programs contain.
    pub(super) sbom: String,
}

/// Where the completions of a program go, by shell.
const COMPLETIONS: [(&str, &str, &str, &str); 3] = [
    ("bash", "share/bash-completion/completions", "", ""),
    ("zsh", "share/zsh/vendor-completions", "_", ""),
    ("fish", "share/fish/vendor_completions.d", "", ".fish"),
];

/// Files of the repository, and where they go. Documents keep their folders, so their links to each other hold.
const FILES: [(&str, &str); 9] = [
    ("assets/linux/aarc.desktop", "share/applications/aarc.desktop"),
    ("assets/linux/aarc.xml", "share/mime/packages/aarc.xml"),
    ("assets/linux/aarc.thumbnailer", "share/thumbnailers/aarc.thumbnailer"),
    ("android/icon.png", "share/icons/hicolor/192x192/apps/aarc.png"),
    ("client/README.md", "share/doc/aarc/client/README.md"),
    ("xtask/README.md", "share/doc/aarc/xtask/README.md"),
    ("xtask/CAPTURE.md", "share/doc/aarc/xtask/CAPTURE.md"),
    ("xtask/FIELD.md", "share/doc/aarc/xtask/FIELD.md"),
    ("xtask/PLAYLIST.md", "share/doc/aarc/xtask/PLAYLIST.md"),
];

/// Puts all files into the folder `usr`; the programs come from the folder `programs`.
///
/// # Errors
/// [`Fault::Data`] where a program is missing or does not run.
pub(super) fn lay_out(usr: &Path, programs: &Path, documents: &Documents, epoch: u64) -> anyhow::Result<()> {
    for name in PROGRAMS {
        let program = programs.join(name);
        let bytes = fs::read(&program)
            .map_err(|error| Fault::Data(format!("{}: {error}; build it first", program.display())))?;
        put(&usr.join("bin").join(name), &bytes, 0o755)?;
        let page = generated(&program, "man")?;
        put(&usr.join(format!("share/man/man1/{name}.1.gz")), &gzipped(&page)?, 0o644)?;
        for (shell, folder, before, after) in COMPLETIONS {
            let completions = generated(&program, shell)?;
            put(&usr.join(folder).join(format!("{before}{name}{after}")), &completions, 0o644)?;
        }
    }
    for (from, to) in FILES {
        let bytes = fs::read(workspace::root().join(from)).with_context(|| from.to_owned())?;
        put(&usr.join(to), &bytes, 0o644)?;
    }
    let changes = fs::read(workspace::root().join("CHANGELOG.md")).context("CHANGELOG.md")?;
    for (name, bytes) in [
        ("copyright", documents.notices.as_bytes()),
        ("aarc.cdx.json", documents.sbom.as_bytes()),
        ("changelog.gz", &gzipped(&changes)?),
    ] {
        put(&usr.join("share/doc/aarc").join(name), bytes, 0o644)?;
    }
    date(usr, epoch)
}

/// Writes a file with this mode and the folders that lead to it.
fn put(path: &Path, bytes: &[u8], mode: u32) -> anyhow::Result<()> {
    let folder = path.parent().context("a file lies in a folder")?;
    fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    fs::write(path, bytes).with_context(|| path.display().to_string())?;
    set_mode(path, mode).with_context(|| path.display().to_string())
}

#[cfg(unix)]
fn set_mode(path: &Path, mode: u32) -> std::io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    fs::set_permissions(path, fs::Permissions::from_mode(mode))
}

/// The packages are for Linux; elsewhere the archive has the system's modes.
#[cfg(not(unix))]
fn set_mode(_path: &Path, _mode: u32) -> std::io::Result<()> {
    Ok(())
}

/// What `--generate` of a program prints.
fn generated(program: &Path, document: &str) -> anyhow::Result<Vec<u8>> {
    let output = Command::new(program).args(["--generate", document]).stdin(Stdio::null()).output();
    let output =
        output.map_err(|error| Fault::Data(format!("{}: {error}; build it again", program.display())))?;
    ensure!(
        output.status.success() && !output.stdout.is_empty(),
        "{} --generate {document}: {}",
        program.display(),
        String::from_utf8_lossy(&output.stderr).trim()
    );
    Ok(output.stdout)
}

/// The bytes as gzip, without a name and a time.
fn gzipped(bytes: &[u8]) -> anyhow::Result<Vec<u8>> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("bytes");
    fs::write(&path, bytes)?;
    let output = Command::new("gzip").args(["-n", "-9", "-c"]).arg(&path).output();
    let output = output.map_err(|error| Fault::Device(format!("cannot run gzip: {error}; install it")))?;
    ensure!(output.status.success(), "gzip: {}", String::from_utf8_lossy(&output.stderr).trim());
    Ok(output.stdout)
}

/// Gives all files and folders the time `epoch`, and folders their usual mode.
fn date(path: &Path, epoch: u64) -> anyhow::Result<()> {
    if path.is_dir() {
        set_mode(path, 0o755)?;
        for entry in path.read_dir()? {
            date(&entry?.path(), epoch)?;
        }
    }
    let time = std::time::UNIX_EPOCH + std::time::Duration::from_secs(epoch);
    fs::File::open(path)?.set_modified(time).with_context(|| path.display().to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn manuals_that_a_manual_links_to_are_installed() {
        let mut links = 0;
        for (from, _) in FILES.iter().filter(|(from, _)| from.ends_with(".md")) {
            let (folder, _) = from.split_once('/').expect("a manual lies in a folder");
            let text = fs::read_to_string(workspace::root().join(from)).expect("a manual is readable");
            for link in text.split("](").skip(1).filter_map(|rest| rest.split([')', '#']).next()) {
                let target = link.strip_prefix("../").map_or(format!("{folder}/{link}"), str::to_owned);
                if target.starts_with("xtask/") && target.ends_with(".md") {
                    links += 1;
                    assert!(FILES.iter().any(|(from, _)| *from == target), "{from} links to {target}");
                }
            }
        }
        assert!(links > 5, "{links} links");
    }
}
