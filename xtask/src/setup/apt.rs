//! Installs Debian and Ubuntu packages, with the machine's own sources, and never removes one.
//!
//! Mesa's software driver before version 25 draws clipped triangles of a multiview pass into the first
//! layer only. Debian 12 has version 22 and, among its backports, version 25: there the set-up installs
//! the newer one. The backports come from the machine's own mirror, through a list of sources and
//! preferences in the project's build folder; the machine's lists stay unchanged. Nothing but Mesa and the
//! library that it needs comes from there, as a machine without that list gets no updates of it.

use std::ffi::OsStr;
use std::fs;
use std::io::{self, BufRead, IsTerminal, Write};
use std::path::Path;
use std::process::{Command, Stdio};

use xtask::workspace;

/// The package of Mesa's Vulkan drivers.
pub(super) const MESA: &str = "mesa-vulkan-drivers";

/// Keys with which Debian signs its releases, future ones included.
pub(super) const KEYRING: &str = "/usr/share/keyrings/debian-archive-keyring.gpg";

/// The release of Debian whose own Mesa is too old.
const OLD_MESA: &str = "bookworm";

/// What comes from the backports: the packages of Mesa's source, and of its kernel interface's.
const FROM_BACKPORTS: &str = "src:mesa src:libdrm";

/// The machine's list of sources and its preferences, which the files with backports repeat.
const SOURCES: &str = "/etc/apt/sources.list";
const PREFERENCES: &str = "/etc/apt/preferences";

/// Installs the packages. Prints the commands first; runs none in a dry run, nor where this process may not.
pub(super) fn install(packages: &[&str], is_dry_run: bool) {
    let backports = if packages.contains(&MESA) { backports() } else { Vec::new() };
    let privilege = privilege();
    let is_needed = privilege.is_none() && !is_dry_run;
    eprintln!("set-up: {}\n", if is_needed { "to install it, run" } else { "to be run:" });
    for line in command_lines(packages, &backports) {
        eprintln!("    {}", workspace::shell_line(&[privilege.unwrap_or(&["sudo"]), &line].concat()));
    }
    eprintln!();
    let Some(privilege) = privilege.filter(|_| !is_dry_run) else { return };
    if !privilege.is_empty() && !is_agreed() {
        eprintln!("set-up: nothing was installed");
        return;
    }
    // Without the backports if they cannot be had: an older Mesa is better than none.
    let installs = |mesa: &[String]| {
        let [update, install] = command_lines(packages, mesa);
        if !run(&[privilege, &update].concat()) {
            eprintln!("set-up: the package lists could not be updated; continuing with the current ones");
        }
        run(&[privilege, &install].concat())
    };
    if !installs(&backports) && (backports.is_empty() || !installs(&[])) {
        eprintln!("set-up: the packages could not be installed");
    }
}

/// The commands that install packages, given apt's options that choose Mesa.
fn command_lines<'a>(packages: &[&'a str], mesa: &'a [String]) -> [Vec<&'a str>; 2] {
    let fixed = ["env", "DEBIAN_FRONTEND=noninteractive", "apt-get", "-qq", "-o", "DPkg::Lock::Timeout=120"];
    let apt_get: Vec<&str> = fixed.into_iter().chain(mesa.iter().map(String::as_str)).collect();
    // What a conflict would remove may be what the machine is for.
    let install = ["install", "-y", "--no-install-recommends", "--no-remove"];
    [[&apt_get[..], &["update"]].concat(), [&apt_get[..], &install, packages].concat()]
}

/// What to put before a command to run it as root; `None` if a password would be asked for.
fn privilege() -> Option<&'static [&'static str]> {
    if output_of("id", ["-u"]).trim() == "0" {
        return Some(&[]);
    }
    let mut sudo = Command::new("sudo");
    let sudo = sudo.args(["-n", "true"]).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    sudo.status().is_ok_and(|status| status.success()).then_some(&["sudo", "-n"])
}

/// Asks the person at the terminal, if there is one, whether to run the commands that were printed.
fn is_agreed() -> bool {
    let (input, mut output) = (io::stdin(), io::stderr());
    if !input.is_terminal() || !output.is_terminal() {
        return true;
    }
    let _ = write!(output, "set-up: run these commands? [y/N] ").and_then(|()| output.flush());
    let mut answer = String::new();
    input.lock().read_line(&mut answer).is_ok() && is_yes(&answer)
}

fn is_yes(answer: &str) -> bool {
    matches!(answer.trim().to_ascii_lowercase().as_str(), "y" | "yes")
}

/// Runs a command with its output on standard error: standard output is reserved for a command's result.
fn run(line: &[&str]) -> bool {
    let mut command = Command::new(line[0]);
    command.args(&line[1..]).stdin(Stdio::null()).stdout(io::stderr());
    command.status().is_ok_and(|status| status.success())
}

/// apt's options that choose Mesa from the backports; none where they are not needed.
fn backports() -> Vec<String> {
    let Some(codename) = codename().filter(|codename| codename == OLD_MESA) else { return Vec::new() };
    let Some(mirror) = mirror() else { return Vec::new() };
    let release = format!("{codename}-backports");
    let folder = workspace::target_folder().join("setup");
    let files = [
        ("SourceList", "sources.list", SOURCES, source(&mirror, &release)),
        ("Preferences", "preferences", PREFERENCES, preference(&release)),
    ];
    let mut options = Vec::new();
    for (option, name, own, more) in files {
        let path = folder.join(name);
        let own = fs::read_to_string(own).unwrap_or_default();
        let text = format!("{own}\n{more}");
        if let Err(error) = fs::create_dir_all(&folder).and_then(|()| fs::write(&path, text)) {
            eprintln!("set-up: cannot write {}: {error}", path.display());
            return Vec::new();
        }
        options.extend(["-o".into(), format!("Dir::Etc::{option}={}", path.display())]);
    }
    options
}

/// The entry of apt's preferences that prefers a release for [`FROM_BACKPORTS`].
fn preference(release: &str) -> String {
    format!("Package: {FROM_BACKPORTS}\nPin: release n={release}\nPin-Priority: 990\n")
}

/// The line of a list of sources for a release of Debian.
pub(super) fn source(mirror: &str, release: &str) -> String {
    // Newer releases trust a key only for sources that name it.
    let option = if Path::new(KEYRING).is_file() { format!("[signed-by={KEYRING}] ") } else { String::new() };
    format!("deb {option}{mirror} {release} main\n")
}

/// The mirror of this machine's Debian; `None` on other systems.
pub(super) fn mirror() -> Option<String> {
    let codename = format!("Codename: {}", codename()?);
    let selection = ["--format", "$(REPO_URI)", &codename, "Component: main", "Created-By: Packages"];
    output_of("apt-get", ["indextargets"].iter().chain(&selection)).lines().next().map(str::to_owned)
}

/// Codename of this machine's Debian; `None` on other systems.
fn codename() -> Option<String> {
    codename_in(&fs::read_to_string("/etc/os-release").unwrap_or_default())
}

fn codename_in(os_release: &str) -> Option<String> {
    let value = |key: &str| {
        let mut lines = os_release.lines().filter_map(|line| line.strip_prefix(key)?.strip_prefix('='));
        lines.next().map(|value| value.trim_matches('"').to_owned())
    };
    value("ID").filter(|id| id == "debian").and_then(|_| value("VERSION_CODENAME"))
}

/// Standard output of a program; empty if it cannot run.
fn output_of<S: AsRef<OsStr>>(program: &str, args: impl IntoIterator<Item = S>) -> String {
    let output = Command::new(program).args(args).stdin(Stdio::null()).stderr(Stdio::null()).output();
    output.map(|output| String::from_utf8_lossy(&output.stdout).into_owned()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_removed_and_only_mesa_comes_from_where_it_is_new() {
        let options = ["-o".to_owned(), "Dir::Etc::Preferences=/two words/preferences".to_owned()];
        let [update, install] = command_lines(&["xvfb", MESA], &options);
        for line in [&update, &install] {
            assert!(line.windows(2).any(|pair| pair == options), "{line:?}");
            // It would be the release of everything that is installed.
            assert!(!line.contains(&"-t"), "{line:?}");
        }
        assert!(install.contains(&"--no-remove") && install.ends_with(&["xvfb", MESA]), "{install:?}");
        let preference = preference("bookworm-backports");
        assert!(preference.starts_with("Package: src:mesa src:libdrm\nPin: release n=bookworm-backports\n"));
    }

    #[test]
    fn only_yes_is_yes() {
        assert!(["y\n", " Yes\n"].into_iter().all(is_yes));
        assert!(!["", "\n", "n\n", "yo\n"].into_iter().any(is_yes));
    }

    #[test]
    fn the_codename_is_read_from_os_release() {
        let text = "PRETTY_NAME=\"Debian GNU/Linux 12 (bookworm)\"\nVERSION_CODENAME=bookworm\nID=debian\n";
        assert_eq!(codename_in(text).as_deref(), Some("bookworm"));
        assert_eq!(codename_in("ID=ubuntu\nVERSION_CODENAME=noble\n"), None);
        assert_eq!(codename_in("ID=\"arch\"\n"), None);
    }

    #[test]
    fn a_source_names_the_mirror_and_the_release() {
        let line = source("http://mirror.test/debian/", "bookworm-backports");
        assert!(
            line.starts_with("deb ")
                && line.ends_with("http://mirror.test/debian/ bookworm-backports main\n")
        );
    }
}
