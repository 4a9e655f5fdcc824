//! Debian packages unpacked into a folder of this project and not installed.
//!
//! They may belong to another release than the machine's, so nothing of theirs may reach the
//! machine. apt itself fetches them, under a configuration and an empty list of installed packages
//! of this project's own: it checks the archive's signature and each package's hash, finds
//! everything that the packages need down to the C library, and asks for no privilege. Programs of
//! the folder run through its own dynamic linker.

use std::ffi::OsStr;
use std::fs;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, bail, ensure};
use xtask::workspace;

use super::apt::{self, KEYRING};

/// File in the folder that says which packages it was made of.
const STAMP: &str = "packages";

/// Packages of a Debian release and the folder that they are unpacked into.
pub(super) struct Unpacked {
    /// The folder; there is none, or a whole one.
    pub(super) folder: PathBuf,
    /// Codename of the release.
    pub(super) release: &'static str,
    /// The packages; what they need comes with them.
    pub(super) packages: &'static [&'static str],
    /// The files and folders to keep, as paths in the folder.
    pub(super) keep: &'static [&'static str],
    /// What is fetched and what stays, in MB, for people.
    pub(super) size_mb: (u32, u32),
}

impl Unpacked {
    /// Whether the folder is there, made of these packages.
    pub(super) fn is_there(&self) -> bool {
        fs::read_to_string(self.folder.join(STAMP)).is_ok_and(|stamp| stamp == self.stamp())
    }

    fn stamp(&self) -> String {
        format!("{} {}\n", self.release, self.packages.join(" "))
    }

    /// Fetches the packages and makes the folder, in place of one of other packages.
    pub(super) fn make(&self) -> anyhow::Result<()> {
        let mirror = apt::mirror().context("this system does not get its packages from a Debian mirror")?;
        ensure!(Path::new(KEYRING).is_file(), "{KEYRING} is missing; install debian-archive-keyring");
        let name = self.folder.file_name().and_then(OsStr::to_str).context("the folder has no name")?;
        let work = workspace::target_folder().join("setup").join(name);
        let (fetched_mb, kept_mb) = self.size_mb;
        eprintln!(
            "set-up: fetching {} and what they need from Debian {}: {fetched_mb} MB, {kept_mb} MB once unpacked into {}",
            self.packages.join(" "),
            self.release,
            self.folder.display()
        );
        let (unpacked, kept) = (work.join("unpacked"), work.join("kept"));
        remove_all(&unpacked)?;
        remove_all(&kept)?;
        self.fetch(&work, &mirror)?;
        fs::create_dir_all(&unpacked)?;
        for package in packages_in(&work.join("archives"))? {
            run(Command::new("dpkg-deb").arg("--extract").arg(&package).arg(&unpacked))?;
        }
        for path in self.keep {
            let to = kept.join(path);
            fs::create_dir_all(to.parent().expect("inside a folder"))?;
            fs::rename(unpacked.join(path), to).with_context(|| format!("the packages hold no {path}"))?;
        }
        fs::write(kept.join(STAMP), self.stamp())?;
        remove_all(&self.folder)?;
        fs::rename(&kept, &self.folder)?;
        Ok(remove_all(&work)?)
    }

    /// Downloads the packages and what they need to `archives` in the folder `work`.
    fn fetch(&self, work: &Path, mirror: &str) -> anyhow::Result<()> {
        for folder in ["lists/partial", "archives/partial"] {
            fs::create_dir_all(work.join(folder))?;
        }
        let source = format!("deb [signed-by={KEYRING} target=Packages] {mirror} {} main\n", self.release);
        fs::write(work.join("sources.list"), source)?;
        fs::write(work.join("status"), "")?;
        let configuration = work.join("apt.conf");
        fs::write(&configuration, configuration_text(work)?)?;
        let apt_get = || {
            let mut apt_get = Command::new("apt-get");
            apt_get.arg("-qq").arg("--config-file").arg(&configuration);
            apt_get
        };
        run(apt_get().arg("update"))?;
        let install = ["install", "--download-only", "--yes", "--no-install-recommends"];
        run(apt_get().args(install).args(self.packages))
    }
}

/// What apt reads after the machine's own configuration, of which the way to the mirror stays.
fn configuration_text(work: &Path) -> anyhow::Result<String> {
    let work = work.to_str().filter(|path| !path.contains('"')).context("apt cannot read this path")?;
    Ok(format!(
        r#"// Hooks that a machine runs after its own packages changed.
#clear APT::Update::Pre-Invoke;
#clear APT::Update::Post-Invoke;
#clear APT::Update::Post-Invoke-Success;
#clear DPkg::Post-Invoke;
Dir::Etc::SourceList "{work}/sources.list";
Dir::Etc::SourceParts "/dev/null";
Dir::Etc::Preferences "/dev/null";
Dir::Etc::PreferencesParts "/dev/null";
Dir::State "{work}";
Dir::State::Lists "{work}/lists";
Dir::State::status "{work}/status";
Dir::Cache "{work}";
Dir::Cache::Archives "{work}/archives";
Acquire::Languages "none";
Acquire::Retries "3";
APT::Update::Error-Mode "any";
APT::Default-Release "";
"#
    ))
}

/// The package files in a folder, in the order of their names.
fn packages_in(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let mut packages = Vec::new();
    for entry in folder.read_dir()? {
        let path = entry?.path();
        packages.extend(path.extension().is_some_and(|end| end == "deb").then_some(path));
    }
    packages.sort();
    Ok(packages)
}

/// Runs a command whose chatter belongs with the set-up's own lines.
fn run(command: &mut Command) -> anyhow::Result<()> {
    let program = command.get_program().to_string_lossy().into_owned();
    let status = command
        .env("DEBIAN_FRONTEND", "noninteractive")
        .stdin(Stdio::null())
        .stdout(io::stderr())
        .status()
        .with_context(|| format!("cannot run {program}"))?;
    if !status.success() {
        bail!("{program} ended with {status}");
    }
    Ok(())
}

/// Removes a folder, if there is one.
fn remove_all(folder: &Path) -> io::Result<()> {
    match fs::remove_dir_all(folder) {
        Err(error) if error.kind() != ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_of_other_packages_is_not_the_one() {
        let folder = tempfile::tempdir().unwrap();
        let unpacked = |packages| Unpacked {
            folder: folder.path().to_owned(),
            release: "trixie",
            packages,
            keep: &["usr/lib"],
            size_mb: (1, 2),
        };
        assert!(!unpacked(&["one"]).is_there(), "an empty folder");
        fs::write(folder.path().join(STAMP), unpacked(&["one"]).stamp()).unwrap();
        assert!(unpacked(&["one"]).is_there() && !unpacked(&["one", "two"]).is_there());
    }

    #[test]
    fn apt_is_kept_to_the_folder_and_from_the_hooks_of_the_machine() {
        let text = configuration_text(Path::new("/some where")).unwrap();
        assert!(text.contains("Dir::State::status \"/some where/status\";"));
        assert!(text.contains("#clear APT::Update::Post-Invoke;"));
        assert!(configuration_text(Path::new("/a\"b")).is_err());
    }
}
