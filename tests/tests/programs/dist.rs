//! `cargo xtask dist` with the programs of this build: what the packages hold, that packing twice gives the same bytes,
//! and that dpkg installs and removes the .deb in a folder of its own.

use std::fs;
use std::path::Path;
use std::process::Command;

use aarc_tests::outcome::Outcome;
use aarc_tests::programs::{Folder, client, run, studio};
use libtest_mimic::{Completion, Failed, Trial};
use xtask::workspace;

/// The tests of this file.
pub(crate) fn trials() -> Vec<Trial> {
    let has = |program: &str| Command::new(program).arg("--version").output().is_ok();
    let test = move || match has("dpkg-deb") && has("dpkg") {
        false => Ok(Completion::ignored_with("dpkg is not installed")),
        true => the_packages_hold_what_they_should().map_err(Failed::from),
    };
    vec![Trial::ignorable_test("packages are the same twice, are installed and removed", test)]
}

/// Files that the .deb installs.
const INSTALLED: [&str; 22] = [
    "usr/bin/aarc",
    "usr/bin/aarc-studio",
    "usr/share/applications/aarc.desktop",
    "usr/share/bash-completion/completions/aarc",
    "usr/share/bash-completion/completions/aarc-studio",
    "usr/share/doc/aarc/aarc.cdx.json",
    "usr/share/doc/aarc/changelog.gz",
    "usr/share/doc/aarc/client/README.md",
    "usr/share/doc/aarc/copyright",
    "usr/share/doc/aarc/xtask/CAPTURE.md",
    "usr/share/doc/aarc/xtask/FIELD.md",
    "usr/share/doc/aarc/xtask/PLAYLIST.md",
    "usr/share/doc/aarc/xtask/README.md",
    "usr/share/fish/vendor_completions.d/aarc.fish",
    "usr/share/fish/vendor_completions.d/aarc-studio.fish",
    "usr/share/icons/hicolor/192x192/apps/aarc.png",
    "usr/share/man/man1/aarc.1.gz",
    "usr/share/man/man1/aarc-studio.1.gz",
    "usr/share/mime/packages/aarc.xml",
    "usr/share/thumbnailers/aarc.thumbnailer",
    "usr/share/zsh/vendor-completions/_aarc",
    "usr/share/zsh/vendor-completions/_aarc-studio",
];

fn the_packages_hold_what_they_should() -> Result<Completion, String> {
    let xtask = workspace::build("xtask", "dev").map_err(|fault| fault.to_string())?;
    let programs = client().parent().ok_or("a program lies in a folder")?;
    if studio().parent() != Some(programs) {
        return Err("the programs lie in two folders".into());
    }
    let folder = Folder::default();
    for out in ["first", "second"] {
        let mut dist = folder.command(&xtask, &format!("dist -o {out} --programs"));
        run(dist.arg(programs)).success();
    }
    let names = files_of(&folder.path("first"))?;
    let [deb, tarball] = [".deb", ".tar.gz"].map(|end| names.iter().find(|name| name.ends_with(end)));
    let (deb, tarball) = (deb.ok_or("no .deb")?, tarball.ok_or("no .tar.gz")?);
    for name in &names {
        let read = |out: &str| folder.read(&format!("{out}/{name}"));
        if read("first")? != read("second")? {
            return Err(format!("{name}: two runs give other bytes"));
        }
    }
    let mut check = folder.command(Path::new("sha256sum"), "--check --quiet SHA256SUMS");
    run(check.current_dir(folder.path("first"))).success();

    let listing =
        run(folder.command(Path::new("dpkg-deb"), "--contents").arg(format!("first/{deb}"))).success();
    if !listing.stdout.lines().all(|line| line.contains(" root/root ")) {
        return Err(format!("all files belong to root: {}", listing.stdout));
    }
    let archive = run(folder.command(Path::new("tar"), "-tzf").arg(format!("first/{tarball}"))).success();
    for name in INSTALLED {
        if !listing.stdout.contains(&format!("./{name}\n")) {
            return Err(format!("{deb} lacks {name}: {}", listing.stdout));
        }
        let name = name.trim_start_matches("usr");
        if !archive.stdout.lines().any(|line| line.ends_with(name)) {
            return Err(format!("{tarball} lacks {name}"));
        }
    }
    install(&folder, deb)
}

/// Installs the package in a folder that stands in for the system's, looks at it, and removes it.
fn install(folder: &Folder, deb: &str) -> Result<Completion, String> {
    let root = folder.path("root");
    fs::create_dir_all(root.join("var/lib/dpkg/updates")).map_err(|error| error.to_string())?;
    folder.write("root/var/lib/dpkg/status", b"");
    let dpkg = |action: &str, package: &str| {
        let mut dpkg = folder.command(Path::new("dpkg"), "--force-depends --log=/dev/null");
        dpkg.arg(format!("--root={}", root.display())).arg(action).arg(package);
        run(&mut dpkg)
    };
    let installed = dpkg("--install", &format!("first/{deb}"));
    if installed.stderr.contains("superuser") {
        return Ok(Completion::ignored_with("dpkg installs as root only"));
    }
    installed.success();
    let is_there = |name: &str| root.join(name).is_file();
    if let Some(missing) = INSTALLED.into_iter().find(|name| !is_there(name)) {
        return Err(format!("{missing} was not installed"));
    }
    dpkg("--verify", "aarc").success();
    let aarc = root.join("usr/bin/aarc");
    let version = run(&mut folder.command(&aarc, "--version")).success();
    if !version.stdout.starts_with("aarc ") {
        return Err(format!("the installed player: {version:?}"));
    }
    let Outcome { code, .. } = dpkg("--purge", "aarc");
    match (code, INSTALLED.into_iter().find(|name| is_there(name))) {
        (Some(0), None) => Ok(Completion::Completed),
        (code, left) => Err(format!("removal: exit code {code:?}, {left:?} is left")),
    }
}

/// Names of the files of a folder, sorted.
fn files_of(folder: &Path) -> Result<Vec<String>, String> {
    let entries = folder.read_dir().map_err(|error| error.to_string())?;
    let mut names: Vec<String> =
        entries.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    Ok(names)
}
