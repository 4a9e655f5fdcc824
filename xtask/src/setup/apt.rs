//! Installs Debian and Ubuntu packages, and chooses the Mesa to install.
//!
//! Mesa's software driver before version 25 draws clipped triangles of a multiview pass into the
//! first layer only. If the release's own Mesa is older and its backports have a newer one, the set-up
//! installs the newer one. The backports come from the machine's own mirror, through a separate list of
//! sources; the machine's lists stay unchanged.

use std::ffi::OsStr;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// The package of Mesa's Vulkan drivers.
pub(super) const MESA: &str = "mesa-vulkan-drivers";

/// Keys with which Debian signs its releases, future ones included.
pub(super) const KEYRING: &str = "/usr/share/keyrings/debian-archive-keyring.gpg";

/// First major version of Mesa whose software driver renders multiview correctly.
const MESA_MAJOR_MIN: u32 = 25;

/// How this process may install packages.
pub(super) enum Privilege {
    Root,
    Sudo,
}

impl Privilege {
    /// The privilege of this process; `None` if installing would ask for a password.
    pub(super) fn find() -> Option<Privilege> {
        if output_of("id", ["-u"]).trim() == "0" {
            return Some(Privilege::Root);
        }
        let sudo = Command::new("sudo")
            .args(["-n", "true"])
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .status();
        sudo.is_ok_and(|status| status.success()).then_some(Privilege::Sudo)
    }

    /// Prints and runs `apt-get` with the arguments; whether it succeeded.
    fn apt_get(&self, args: &[&str]) -> bool {
        let prefix: &[&str] = match self {
            Privilege::Root => &["env"],
            Privilege::Sudo => &["sudo", "-n", "env"],
        };
        let fixed = ["DEBIAN_FRONTEND=noninteractive", "apt-get", "-qq"];
        let fixed = fixed.iter().chain(&["-o", "DPkg::Lock::Timeout=120", "-o", "Dpkg::Use-Pty=0"]);
        let line: Vec<&str> = prefix.iter().chain(fixed).chain(args).copied().collect();
        eprintln!("set-up: apt-get {}", args.join(" "));
        // Standard output is reserved for a command's result.
        Command::new(line[0])
            .args(&line[1..])
            .stdin(Stdio::null())
            .stdout(io::stderr())
            .status()
            .is_ok_and(|status| status.success())
    }
}

/// The command for the user to run instead.
pub(super) fn manual_command(packages: &[&str]) -> String {
    format!("sudo apt-get update && sudo apt-get install -y --no-install-recommends {}", packages.join(" "))
}

/// Installs the packages, printing each command before it runs.
pub(super) fn install(privilege: &Privilege, packages: &[&str]) {
    if !privilege.apt_get(&["update"]) {
        eprintln!("set-up: the package lists could not be updated; continuing with the current ones");
    }
    let mut options: Vec<String> = Vec::new();
    if packages.contains(&MESA) {
        options = mesa_options(privilege);
    }
    let mut args: Vec<&str> = options.iter().map(String::as_str).collect();
    args.extend(["install", "-y", "--no-install-recommends"]);
    args.extend(packages);
    if !privilege.apt_get(&args) {
        eprintln!("set-up: the packages could not be installed");
    }
}

/// The `apt-get` options that select the best available Mesa.
fn mesa_options(privilege: &Privilege) -> Vec<String> {
    let offers = |options: &[String]| {
        let args = options.iter().map(String::as_str).chain(["madison", MESA]);
        parse_madison(&output_of("apt-cache", args))
    };
    let target = |suite: &str| vec!["-t".to_owned(), suite.to_owned()];
    match choose(&offers(&[])) {
        Choice::Plain => return Vec::new(),
        Choice::From(suite) => return target(&suite),
        Choice::TooOld => {}
    }
    let sources = debian().map(|(codename, mirror)| backports_line(&codename, &mirror)).and_then(|line| {
        match write_sources(&line) {
            Ok(folder) => {
                eprintln!("set-up: looking for Mesa {MESA_MAJOR_MIN} or newer, with this additional source:");
                eprintln!("set-up:     {line}");
                Some(vec!["-o".to_owned(), format!("Dir::Etc::SourceParts={}", folder.display())])
            }
            Err(error) => {
                eprintln!("set-up: cannot write a list of sources: {error}");
                None
            }
        }
    });
    if let Some(options) = sources {
        let mut update: Vec<&str> = options.iter().map(String::as_str).collect();
        update.push("update");
        if privilege.apt_get(&update)
            && let Choice::From(suite) = choose(&offers(&options))
        {
            return [options, target(&suite)].concat();
        }
    }
    eprintln!(
        "set-up: no Mesa {MESA_MAJOR_MIN} or newer is available; with an older one, stereo images take one pass per eye"
    );
    Vec::new()
}

/// The mirror of this machine's Debian; `None` on other systems.
pub(super) fn mirror() -> Option<String> {
    debian().map(|(_, mirror)| mirror)
}

/// Codename and mirror of this machine's Debian.
fn debian() -> Option<(String, String)> {
    let system = parse_os_release(&fs::read_to_string("/etc/os-release").unwrap_or_default())
        .filter(|system| system.id == "debian")?;
    let targets = output_of("apt-get", ["indextargets", "--format", TARGET_FORMAT]);
    let mirror = mirror_of(&parse_targets(&targets), &system.codename)?;
    Some((system.codename, mirror))
}

/// An available version of a package.
#[derive(Debug, PartialEq)]
struct Offer {
    major: u32,
    suite: String,
}

/// Parses `apt-cache madison`: lines `package | version | URI suite/component architecture Packages`.
fn parse_madison(text: &str) -> Vec<Offer> {
    text.lines()
        .filter_map(|line| {
            let mut columns = line.split('|').map(str::trim).skip(1);
            let (version, source) = (columns.next()?, columns.next()?);
            // A Debian version is [epoch:]upstream[-revision].
            let upstream = version.rsplit(':').next()?;
            let major = upstream.split(|c: char| !c.is_ascii_digit()).next()?.parse().ok()?;
            let (suite, _) = source.split_whitespace().nth(1)?.split_once('/')?;
            Some(Offer { major, suite: suite.to_owned() })
        })
        .collect()
}

/// The offer to install.
#[derive(Debug, PartialEq)]
enum Choice {
    /// The one that apt installs by default.
    Plain,
    /// The one of this suite, which apt must be told with `-t`.
    From(String),
    /// Every offer is too old.
    TooOld,
}

fn choose(offers: &[Offer]) -> Choice {
    let mut good = offers.iter().filter(|offer| offer.major >= MESA_MAJOR_MIN).peekable();
    if good.peek().is_none() {
        return Choice::TooOld;
    }
    // apt installs from backports only with `-t`.
    match good.clone().find(|offer| !offer.suite.ends_with("-backports")) {
        Some(_) => Choice::Plain,
        None => Choice::From(good.next().expect("peeked").suite.clone()),
    }
}

/// Fields of /etc/os-release.
#[derive(Debug, PartialEq)]
struct System {
    id: String,
    codename: String,
}

fn parse_os_release(text: &str) -> Option<System> {
    let value = |key: &str| {
        text.lines()
            .find_map(|line| line.strip_prefix(key)?.strip_prefix('='))
            .map(|value| value.trim_matches('"').to_owned())
    };
    Some(System { id: value("ID")?, codename: value("VERSION_CODENAME")? })
}

/// A list of packages that apt is configured to use.
#[derive(Debug, PartialEq)]
struct Target {
    uri: String,
    codename: String,
    component: String,
}

const TARGET_FORMAT: &str = "$(REPO_URI)|$(CODENAME)|$(COMPONENT)|$(CREATED_BY)";

/// Parses `apt-get indextargets` with [`TARGET_FORMAT`].
fn parse_targets(text: &str) -> Vec<Target> {
    text.lines()
        .filter_map(|line| {
            let [uri, codename, component, "Packages"] = line.split('|').collect::<Vec<_>>()[..] else {
                return None;
            };
            Some(Target { uri: uri.into(), codename: codename.into(), component: component.into() })
        })
        .collect()
}

/// The mirror of the release itself, without its updates.
fn mirror_of(targets: &[Target], codename: &str) -> Option<String> {
    let target = targets.iter().find(|target| target.codename == codename && target.component == "main")?;
    Some(target.uri.clone())
}

/// The source line that adds the release's backports.
fn backports_line(codename: &str, mirror: &str) -> String {
    // Newer releases trust a key only for sources that name it.
    let option = if Path::new(KEYRING).is_file() { format!("[signed-by={KEYRING}] ") } else { String::new() };
    format!("deb {option}{mirror} {codename}-backports main")
}

/// Writes a folder of source lists, the machine's own and `line`, and returns its path.
fn write_sources(line: &str) -> io::Result<PathBuf> {
    let folder = xtask::workspace::target_folder().join("setup/sources.list.d");
    if folder.exists() {
        fs::remove_dir_all(&folder)?;
    }
    fs::create_dir_all(&folder)?;
    for entry in Path::new("/etc/apt/sources.list.d").read_dir().into_iter().flatten() {
        let path = entry?.path();
        if path.extension().is_some_and(|end| end == "list" || end == "sources") {
            fs::copy(&path, folder.join(path.file_name().expect("an entry of a folder has a name")))?;
        }
    }
    fs::write(folder.join("aarc-backports.list"), format!("{line}\n"))?;
    Ok(folder)
}

/// Standard output of a program; empty if it cannot run.
fn output_of<S: AsRef<OsStr>>(program: &str, args: impl IntoIterator<Item = S>) -> String {
    Command::new(program)
        .args(args)
        .stdin(Stdio::null())
        .stderr(Stdio::null())
        .output()
        .map(|output| String::from_utf8_lossy(&output.stdout).into_owned())
        .unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn offer(major: u32, suite: &str) -> Offer {
        Offer { major, suite: suite.into() }
    }

    #[test]
    fn madison_rows_are_read() {
        let text = "\
mesa-vulkan-drivers | 25.0.7-2~bpo12+1 | http://mirror.test/debian bookworm-backports/main amd64 Packages
mesa-vulkan-drivers | 22.3.6-1+deb12u2 | http://mirror.test/debian bookworm/main amd64 Packages
mesa-vulkan-drivers | 1:7.1-2 | http://mirror.test/debian old/main amd64 Packages
N: nothing more
";
        assert_eq!(
            parse_madison(text),
            [offer(25, "bookworm-backports"), offer(22, "bookworm"), offer(7, "old")]
        );
    }

    #[test]
    fn backports_are_chosen_only_if_the_release_s_mesa_is_too_old() {
        assert_eq!(choose(&[]), Choice::TooOld);
        assert_eq!(choose(&[offer(22, "bookworm")]), Choice::TooOld);
        assert_eq!(
            choose(&[offer(25, "bookworm-backports"), offer(22, "bookworm")]),
            Choice::From("bookworm-backports".into())
        );
        assert_eq!(choose(&[offer(26, "trixie-backports"), offer(25, "trixie")]), Choice::Plain);
        assert_eq!(choose(&[offer(25, "noble-updates"), offer(24, "noble")]), Choice::Plain);
    }

    #[test]
    fn the_system_is_read_from_os_release() {
        let text = "PRETTY_NAME=\"Debian GNU/Linux 12 (bookworm)\"\nVERSION_CODENAME=bookworm\nID=debian\n";
        assert_eq!(parse_os_release(text), Some(System { id: "debian".into(), codename: "bookworm".into() }));
        assert_eq!(parse_os_release("ID=\"arch\"\n"), None);
    }

    #[test]
    fn backports_use_the_mirror_of_the_release() {
        let text = "\
http://security.test/debian/|bookworm-security|main|Packages
http://mirror.test/debian/|bookworm|main|DEP-11
http://other.test/debian/|bookworm|contrib|Packages
http://mirror.test/debian/|bookworm|main|Packages
";
        let mirror = mirror_of(&parse_targets(text), "bookworm").unwrap();
        assert_eq!(mirror, "http://mirror.test/debian/");
        let line = backports_line("bookworm", &mirror);
        assert!(
            line.starts_with("deb ") && line.ends_with("http://mirror.test/debian/ bookworm-backports main")
        );
        assert_eq!(mirror_of(&parse_targets(text), "trixie"), None);
    }
}
