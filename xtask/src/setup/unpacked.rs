//! Debian packages that are unpacked into a folder of this project instead of being installed.
//!
//! They may come from another release than the machine's and so must not affect it. apt downloads them
//! with a configuration of this project and an empty list of installed packages: it checks the archive's
//! signature and each package's hash, resolves dependencies down to the C library, and needs no privilege.
//! Programs from another release run through the folder's own dynamic linker; those of the machine's
//! release only need LD_LIBRARY_PATH.

use std::ffi::OsStr;
use std::fs;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, bail, ensure};
use xtask::workspace;

use super::apt::{self, KEYRING};

/// File in the folder that names the packages it was made from.
const STAMP: &str = "packages";

/// Release that the Debian packages come from.
pub(super) enum Release {
    /// The release of this name.
    Named(&'static str),
    /// The machine's own, from its configured sources, security updates included.
    Machine,
}

/// Packages of a Debian release and the folder into which they are unpacked.
pub(super) struct Unpacked {
    /// The folder; complete, or absent.
    pub(super) folder: PathBuf,
    pub(super) release: Release,
    /// The packages, without their dependencies.
    pub(super) packages: &'static [&'static str],
    /// Files and folders to keep, as paths in the folder. A component `*` matches the only entry of its
    /// folder.
    pub(super) keep: &'static [&'static str],
    /// Download size and unpacked size in MB.
    pub(super) size_mb: (u32, u32),
}

impl Unpacked {
    /// Whether the folder exists and was made from these packages.
    pub(super) fn is_complete(&self) -> bool {
        fs::read_to_string(self.folder.join(STAMP)).is_ok_and(|stamp| stamp == self.stamp())
    }

    fn stamp(&self) -> String {
        format!("{} {}\n", self.release.name(), self.packages.join(" "))
    }

    /// Downloads the packages and makes the folder, replacing one made from other packages.
    pub(super) fn make(&self) -> anyhow::Result<()> {
        let name = self.folder.file_name().and_then(OsStr::to_str).context("the folder has no name")?;
        let work = workspace::target_folder().join("setup").join(name);
        let (fetched_mb, unpacked_mb) = self.size_mb;
        eprintln!(
            "set-up: downloading {} and their dependencies from {}: {fetched_mb} MB, {unpacked_mb} MB unpacked into {}",
            self.packages.join(" "),
            self.release.name(),
            self.folder.display()
        );
        let (unpacked, selected) = (work.join("unpacked"), work.join("selected"));
        remove_all(&unpacked)?;
        remove_all(&selected)?;
        self.fetch(&work)?;
        fs::create_dir_all(&unpacked)?;
        for package in packages_in(&work.join("archives"))? {
            run(Command::new("dpkg-deb").arg("--extract").arg(&package).arg(&unpacked))?;
        }
        for path in self.keep {
            let path = resolve(&unpacked, path).with_context(|| format!("the packages hold no {path}"))?;
            let to = selected.join(&path);
            fs::create_dir_all(to.parent().expect("inside a folder"))?;
            fs::rename(unpacked.join(path), to)?;
        }
        fs::write(selected.join(STAMP), self.stamp())?;
        remove_all(&self.folder)?;
        fs::rename(&selected, &self.folder)?;
        Ok(remove_all(&work)?)
    }

    /// Downloads the packages and their dependencies to `archives` in the folder `work`.
    fn fetch(&self, work: &Path) -> anyhow::Result<()> {
        for folder in ["lists/partial", "archives/partial"] {
            fs::create_dir_all(work.join(folder))?;
        }
        let sources = match self.release {
            Release::Named(release) => {
                let mirror =
                    apt::mirror().context("this system does not get its packages from a Debian mirror")?;
                ensure!(Path::new(KEYRING).is_file(), "{KEYRING} is missing; install debian-archive-keyring");
                let source = format!("deb [signed-by={KEYRING} target=Packages] {mirror} {release} main\n");
                let path = work.join("sources.list");
                fs::write(&path, source)?;
                Some(path)
            }
            Release::Machine => None,
        };
        fs::write(work.join("status"), "")?;
        let configuration = work.join("apt.conf");
        fs::write(&configuration, configuration_text(work, sources.as_deref())?)?;
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

impl Release {
    /// Name in messages.
    fn name(&self) -> &'static str {
        match self {
            Release::Named(name) => name,
            Release::Machine => "this machine's release",
        }
    }
}

/// Resolves the `*` components of a path to keep in the folder `unpacked`.
fn resolve(unpacked: &Path, path: &str) -> anyhow::Result<PathBuf> {
    let mut found = PathBuf::new();
    for part in path.split('/') {
        if part == "*" {
            let mut entries = unpacked.join(&found).read_dir()?;
            let (entry, more) = (entries.next().context("no such entry")??, entries.next());
            ensure!(more.is_none(), "more than one entry matches *");
            found.push(entry.file_name());
        } else {
            found.push(part);
        }
    }
    ensure!(unpacked.join(&found).exists(), "no such entry");
    Ok(found)
}

/// Configuration that apt reads after the machine's own. It keeps the machine's proxy settings, and its
/// sources unless others are given.
fn configuration_text(work: &Path, sources: Option<&Path>) -> anyhow::Result<String> {
    let readable = |path: &Path| {
        let text = path.to_str().filter(|path| !path.contains('"'));
        text.map(String::from).context("apt cannot read this path")
    };
    let work = readable(work)?;
    let sources = match sources {
        Some(sources) => format!(
            r#"Dir::Etc::SourceList "{}";
Dir::Etc::SourceParts "/dev/null";
Dir::Etc::Preferences "/dev/null";
Dir::Etc::PreferencesParts "/dev/null";
APT::Default-Release "";
"#,
            readable(sources)?
        ),
        None => String::new(),
    };
    Ok(format!(
        r#"{sources}// Hooks that the machine runs after its own packages change.
#clear APT::Update::Pre-Invoke;
#clear APT::Update::Post-Invoke;
#clear APT::Update::Post-Invoke-Success;
#clear DPkg::Post-Invoke;
Dir::State "{work}";
Dir::State::Lists "{work}/lists";
Dir::State::status "{work}/status";
Dir::Cache "{work}";
Dir::Cache::Archives "{work}/archives";
Acquire::Languages "none";
Acquire::Retries "3";
APT::Update::Error-Mode "any";
"#
    ))
}

/// The package files in a folder, sorted by name.
fn packages_in(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let mut packages = Vec::new();
    for entry in folder.read_dir()? {
        let path = entry?.path();
        packages.extend(path.extension().is_some_and(|end| end == "deb").then_some(path));
    }
    packages.sort();
    Ok(packages)
}

/// Runs a command with its output on standard error, where the set-up prints its own lines.
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
    fn a_folder_made_from_other_packages_is_incomplete() {
        let folder = tempfile::tempdir().unwrap();
        let unpacked = |packages| Unpacked {
            folder: folder.path().to_owned(),
            release: Release::Named("trixie"),
            packages,
            keep: &["usr/lib"],
            size_mb: (1, 2),
        };
        assert!(!unpacked(&["one"]).is_complete(), "an empty folder");
        fs::write(folder.path().join(STAMP), unpacked(&["one"]).stamp()).unwrap();
        assert!(unpacked(&["one"]).is_complete() && !unpacked(&["one", "two"]).is_complete());
    }

    #[test]
    fn apt_uses_the_folder_and_runs_no_hooks_of_the_machine() {
        let text = |sources| configuration_text(Path::new("/some where"), sources).unwrap();
        let (own_sources, machine_sources) = (text(Some(Path::new("/a list"))), text(None));
        for text in [&own_sources, &machine_sources] {
            assert!(text.contains("Dir::State::status \"/some where/status\";"));
            assert!(text.contains("#clear APT::Update::Post-Invoke;"));
        }
        assert!(own_sources.contains("SourceList \"/a list\";") && !machine_sources.contains("SourceList"));
        assert!(configuration_text(Path::new("/a\"b"), None).is_err());
    }

    #[test]
    fn a_star_matches_the_only_entry() {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir_all(folder.path().join("src/rust-1.2/library")).unwrap();
        let resolve = |path| resolve(folder.path(), path).ok();
        assert_eq!(resolve("src/*/library"), Some("src/rust-1.2/library".into()));
        assert_eq!(resolve("src/rust-1.2"), Some("src/rust-1.2".into()));
        assert_eq!((resolve("src/*/tests"), resolve("usr"), resolve("usr/*")), (None, None, None));
        fs::create_dir(folder.path().join("src/other")).unwrap();
        assert_eq!(resolve("src/*/library"), None, "ambiguous");
    }
}
