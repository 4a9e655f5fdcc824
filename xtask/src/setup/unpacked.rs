//! Packages that are unpacked into a folder of this project instead of being installed.
//!
//! They may come from another release than the machine's and so must not affect it. apt downloads
//! Debian's with a configuration of this project and an empty list of installed packages: it checks the
//! archive's signature and each package's hash, resolves dependencies down to the C library, and needs no
//! privilege. Programs from another release run through the folder's own dynamic linker; programs of the machine's
//! release only need LD_LIBRARY_PATH. Python's come by pip, which checks their hashes.

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

/// Where packages come from.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Origin {
    /// The Debian release of this name.
    Debian(&'static str),
    /// The machine's own release, from its configured sources, security updates included.
    Machine,
    /// The same, without dependencies.
    MachineAlone,
    /// Python's package index, without dependencies.
    Python,
}

/// Packages and the folder into which they are unpacked.
pub(super) struct Unpacked {
    /// The folder; complete, or absent.
    pub(super) folder: PathBuf,
    pub(super) origin: Origin,
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
        format!("{} {}\n", self.origin.name(), self.packages.join(" "))
    }

    /// What [`make`](Unpacked::make) does, as a sentence.
    pub(super) fn description(&self) -> String {
        let (fetched_mb, unpacked_mb) = self.size_mb;
        format!(
            "download {} from {}: {fetched_mb} MB, {unpacked_mb} MB unpacked into {}",
            self.packages.join(" "),
            self.origin.name(),
            self.folder.display()
        )
    }

    /// Downloads the packages and makes the folder, replacing one made from other packages.
    pub(super) fn make(&self) -> anyhow::Result<()> {
        let name = self.folder.file_name().and_then(OsStr::to_str).context("the folder has no name")?;
        let work = workspace::target_folder().join("setup").join(name);
        let (unpacked, selected) = (work.join("unpacked"), work.join("selected"));
        remove_all(&unpacked)?;
        remove_all(&selected)?;
        for folder in ["lists/partial", "archives/partial", "unpacked"] {
            fs::create_dir_all(work.join(folder))?;
        }
        match self.origin {
            Origin::Python => self.fetch_with_pip(&work)?,
            _ => self.fetch_with_apt(&work)?,
        }
        for package in packages_in(&work.join("archives"))? {
            let is_wheel = package.extension().is_some_and(|end| end == "whl");
            let program: &[&str] =
                if is_wheel { &["python3", "-m", "zipfile", "-e"] } else { &["dpkg-deb", "--extract"] };
            run(Command::new(program[0]).args(&program[1..]).arg(&package).arg(&unpacked))?;
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

    /// Downloads the packages to `archives` in the folder `work`.
    fn fetch_with_pip(&self, work: &Path) -> anyhow::Result<()> {
        let pip = || {
            let mut pip = Command::new("python3");
            pip.args(["-m", "pip"]);
            pip
        };
        let has_pip = pip().arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status();
        ensure!(has_pip.is_ok_and(|status| status.success()), "pip is missing; install python3-pip");
        let download = ["download", "--quiet", "--no-deps", "--only-binary", ":all:", "--dest"];
        run(pip().args(download).arg(work.join("archives")).args(self.packages))
    }

    /// Downloads the packages and, unless they are to come alone, their dependencies to `archives` in the
    /// folder `work`.
    fn fetch_with_apt(&self, work: &Path) -> anyhow::Result<()> {
        let sources = match self.origin {
            Origin::Debian(release) => {
                let mirror =
                    apt::mirror().context("this system does not get its packages from a Debian mirror")?;
                ensure!(Path::new(KEYRING).is_file(), "{KEYRING} is missing; install debian-archive-keyring");
                let path = work.join("sources.list");
                fs::write(&path, apt::source(&mirror, release))?;
                Some(path)
            }
            _ => None,
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
        let fetch: &[&str] = match self.origin {
            Origin::MachineAlone => &["download"],
            _ => &["install", "--download-only", "--yes", "--no-install-recommends"],
        };
        run(apt_get().current_dir(work.join("archives")).args(fetch).args(self.packages))
    }
}

impl Origin {
    /// Name in messages.
    fn name(self) -> &'static str {
        match self {
            Origin::Debian(name) => name,
            Origin::Machine | Origin::MachineAlone => "this machine's release",
            Origin::Python => "Python's package index",
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
        packages.extend(path.extension().is_some_and(|end| end == "deb" || end == "whl").then_some(path));
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
            origin: Origin::Debian("trixie"),
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
