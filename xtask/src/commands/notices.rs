//! `cargo xtask notices`: names, licences and licence texts of all packages that the programs contain.
//!
//! The data of others that a program contains is named with the package that uses it.
//!
//! `cargo tree` lists the packages, `cargo metadata` locates their sources. Licence texts are the
//! files of a source that are named like one; texts that differ in white space only are printed once.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, bail, ensure};
use serde_json::Value;
use xtask::workspace;

/// Print the licences of everything that the player and the host tool contain.
#[derive(clap::Args)]
pub(crate) struct Args {}

/// Parts of lower-case names of files that hold a licence.
const NAMES: [&str; 6] = ["licen", "copying", "notice", "copyright", "ofl", "ufl"];

/// Endings of names that contain such a part and hold something else.
const OTHER_ENDINGS: [&str; 7] = [".rs", ".toml", ".html", ".py", ".sh", ".c", ".h"];

/// Packages and features of the programs that users install, for Cargo.
pub(super) const PROGRAMS: [&str; 6] =
    ["--package", "client", "--package", "studio", "--features", "studio/full"];

/// Cargo's name of this machine's target.
pub(super) const HOST: &str = "host-tuple";

/// Licence of the text that stands in for packages that ship none; all of these allow it.
const DEFAULT_LICENCE: &str = "Apache-2.0";

pub(crate) fn run(_args: &Args) -> anyhow::Result<()> {
    print!("{}", notices(&PROGRAMS, HOST)?);
    Ok(())
}

/// Start of the name of the package that the player has for the responses of a head, and the file of their licence.
const HEAD: [&str; 2] = ["sofar v", "assets/LICENSE-HEAD"];

/// A package of a program.
pub(super) struct Package {
    /// Name and version: `name v1.2.3`.
    pub(super) name: String,
    pub(super) licence: String,
    /// Names of its authors, where the manifest has them.
    authors: Vec<String>,
    folder: PathBuf,
    /// Whether it is one of this repository.
    is_ours: bool,
}

/// The notices of the programs that Cargo builds from a selection of packages and features.
pub(super) fn notices(selection: &[&str], target: &str) -> anyhow::Result<String> {
    let packages = packages(selection, target)?;
    let apache = fs::read_to_string(workspace::root().join("LICENSE-APACHE"))?;
    let mut text = format!("{}\n", fs::read_to_string(workspace::root().join("LICENSE-MIT"))?);
    text.push_str("These programs contain the following packages. Their licences follow.\n\n");
    text.push_str("Rust's standard library: MIT OR Apache-2.0, The Rust Project Contributors\n");
    // Key: the text without white space. Value: the text and the packages that it belongs to.
    let mut texts: BTreeMap<String, (String, BTreeSet<&str>)> = BTreeMap::new();
    let mut add = |text: &str, package| {
        let key = text.split_whitespace().collect();
        texts.entry(key).or_insert_with(|| (text.trim().to_owned(), BTreeSet::new())).1.insert(package);
    };
    add(&apache, "Rust's standard library");
    for package in packages.iter().filter(|package| !package.is_ours) {
        text.push_str(&format!("{}: {}\n", package.name, package.licence));
        let mut found = Vec::new();
        licence_texts(&package.folder, &mut found)
            .with_context(|| format!("cannot read {}", package.folder.display()))?;
        if found.is_empty() {
            found.push(standard_text(package, &apache)?);
        }
        found.iter().for_each(|text| add(text, package.name.as_str()));
    }
    if packages.iter().any(|package| package.name.starts_with(HEAD[0])) {
        let licence = fs::read_to_string(workspace::root().join(HEAD[1]))?;
        texts.entry(String::new()).or_insert((licence.trim().to_owned(), BTreeSet::from(["head.bin"])));
    }
    for (licence, packages) in texts.values() {
        let packages: Vec<&str> = packages.iter().copied().collect();
        text.push_str(&format!("\n\n==== {} ====\n\n{licence}\n", packages.join(", ")));
    }
    Ok(text)
}

/// The packages that become part of the selected programs, sorted by name.
pub(super) fn packages(selection: &[&str], target: &str) -> anyhow::Result<Vec<Package>> {
    let tree = output_of(
        workspace::cargo()
            .args(["tree", "--locked", "--edges", "normal,no-proc-macro", "--prefix", "none"])
            .args(["--format", "{p}", "--target", target])
            .args(selection),
    )?;
    // "name v1.2.3", followed by the folder of a package of this repository, and by marks.
    let name = |line: &str| line.split(' ').take(2).collect::<Vec<_>>().join(" ");
    let names: BTreeSet<String> = tree.lines().filter(|line| !line.is_empty()).map(name).collect();
    let metadata = output_of(
        workspace::cargo()
            .args(["metadata", "--locked", "--format-version", "1", "--all-features"])
            .args(["--filter-platform", target]),
    )?;
    let metadata: Value = serde_json::from_str(&metadata)?;
    let text = |package: &Value, key: &str| package[key].as_str().unwrap_or_default().to_owned();
    let mut packages: Vec<Package> = metadata["packages"]
        .as_array()
        .context("cargo metadata lists no packages")?
        .iter()
        .map(|package| Package {
            name: format!("{} v{}", text(package, "name"), text(package, "version")),
            licence: text(package, "license"),
            authors: serde_json::from_value(package["authors"].clone()).unwrap_or_default(),
            folder: Path::new(&text(package, "manifest_path"))
                .parent()
                .map(Path::to_owned)
                .unwrap_or_default(),
            is_ours: package["source"].is_null(),
        })
        .filter(|package| names.contains(&package.name))
        .collect();
    packages.sort_by(|a, b| a.name.cmp(&b.name));
    ensure!(packages.len() == names.len(), "cargo tree and cargo metadata name different packages");
    Ok(packages)
}

/// The text of the licence of a package that ships none: Apache-2.0 where it allows that, else MIT in the name of its
/// authors.
fn standard_text(package: &Package, apache: &str) -> anyhow::Result<String> {
    if package.licence.contains(DEFAULT_LICENCE) {
        return Ok(apache.to_owned());
    }
    let is_mit = package.licence == "MIT" && !package.authors.is_empty();
    ensure!(is_mit, "{} ships no text of its licence {}", package.name, package.licence);
    let ours = fs::read_to_string(workspace::root().join("LICENSE-MIT"))?;
    let holders = format!("Copyright (c) {}", package.authors.join(", "));
    let line = |line: &str| if line.starts_with("Copyright") { holders.clone() } else { line.to_owned() };
    Ok(ours.lines().map(line).collect::<Vec<_>>().join("\n"))
}

/// Standard output of a command that must succeed.
fn output_of(command: &mut Command) -> anyhow::Result<String> {
    let output = command.output().context("cannot run cargo")?;
    if !output.status.success() {
        bail!("{}", String::from_utf8_lossy(&output.stderr).trim());
    }
    Ok(String::from_utf8(output.stdout)?)
}

/// Appends the licence texts of a source and its subfolders. Fonts have theirs in text files beside them.
fn licence_texts(folder: &Path, texts: &mut Vec<String>) -> anyhow::Result<()> {
    let mut entries = folder.read_dir()?.collect::<Result<Vec<_>, _>>()?;
    entries.sort_by_key(|entry| entry.file_name());
    let is_of_fonts = folder.ends_with("fonts");
    for entry in entries {
        let path = entry.path();
        let name = entry.file_name().to_string_lossy().to_lowercase();
        if path.is_dir() {
            licence_texts(&path, texts)?;
        } else if is_of_fonts && name.ends_with(".txt")
            || NAMES.iter().any(|part| name.contains(part))
                && !OTHER_ENDINGS.iter().any(|end| name.ends_with(end))
        {
            let text = String::from_utf8_lossy(&fs::read(&path)?).into_owned();
            // zstd offers the GPL as an alternative to BSD, which is the licence used here.
            if !text.trim_start().starts_with("GNU GENERAL PUBLIC LICENSE") {
                texts.push(text);
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_player_s_notices_have_the_texts_of_crates_c_libraries_and_fonts() {
        let text = notices(&["--package", "client"], HOST).unwrap();
        for expected in [
            "\nwgpu ",
            "\nzstd-sys ",
            "Meta Platforms",
            "SIL OPEN FONT LICENSE",
            "UBUNTU FONT LICENCE",
            "Apache License",
            "Copyright (c) 2026 the aarc authors",
            "\nsofar ",
            "==== head.bin ====\n\nThe responses in head.bin",
            "MIT Media Laboratory",
        ] {
            assert!(text.contains(expected), "{expected:?} is not in the notices");
        }
        assert!(!text.contains("GNU GENERAL PUBLIC LICENSE\n") && !text.contains("\ncodec "));
    }

    #[test]
    fn the_notices_of_both_programs_are_of_the_whole_host_tool() {
        let text = notices(&PROGRAMS, HOST).unwrap();
        for expected in ["\nwgpu v", "\nort v", "\nort-sys v"] {
            assert!(text.contains(expected), "{expected:?} is not in the notices");
        }
    }

    #[test]
    fn equal_texts_are_found_in_subfolders() {
        let folder = tempfile::tempdir().unwrap();
        for (name, text) in [
            ("LICENSE-MIT", "a"),
            ("third_party/COPYING", "b"),
            ("fonts/Some.txt", "c"),
            ("src/license.rs", "code"),
            ("notes.txt", "notes"),
        ] {
            let path = folder.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        }
        let mut texts = Vec::new();
        licence_texts(folder.path(), &mut texts).unwrap();
        texts.sort();
        assert_eq!(texts, ["a", "b", "c"]);
    }
}
