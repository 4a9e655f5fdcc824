//! `cargo xtask dist`: the player and the host tool as packages to install, with checksums.
//!
//! `tree` lays out what is installed, `sbom` lists the packages that the programs contain, and `archives` packs both.
//! Debian's dpkg-deb and GNU tar do the packing: they honour SOURCE_DATE_EPOCH, so equal programs give equal bytes.

mod archives;
mod sbom;
mod tree;

use std::env;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::Context;
use program::{Fault, output};
use xtask::workspace;

use super::apk;
use super::notices::{HOST, PROGRAMS, notices};
use archives::Compression;
use tree::Documents;

/// Make the packages that users install: a .deb, a .tar.gz, the APK where its toolchain is there, a list of all that
/// they contain, and checksums.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Pack aarc and aarc-studio of this folder instead of building them, with little compression: a check of the packing
    #[arg(long, value_name = "DIR")]
    programs: Option<PathBuf>,

    /// Folder to write
    #[arg(short, long, value_name = "DIR", default_value = "dist")]
    out: PathBuf,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let folder = output::OutputFolder::begin(&args.out)?;
    let (programs, compression) = match &args.programs {
        Some(programs) => (programs.clone(), Compression::Fast),
        None => (build()?, Compression::Best),
    };
    let epoch = epoch()?;
    let documents = Documents { notices: notices(&PROGRAMS, HOST)?, sbom: sbom::of_selection(&PROGRAMS)? };
    let staging = tempfile::tempdir()?;
    tree::lay_out(&staging.path().join("usr"), &programs, &documents, epoch)?;
    output::write(&folder.path().join("aarc.cdx.json"), documents.sbom.as_bytes())?;
    let mut skipped = Vec::new();
    archives::tarball(staging.path(), folder.path(), compression, epoch)?;
    match archives::deb(staging.path(), folder.path(), compression, epoch) {
        Err(Fault::Device(reason)) => skipped.push(format!("no .deb: {reason}")),
        result => result?,
    }
    if args.programs.is_none() {
        match apk::missing(None) {
            Some(reason) => skipped.push(format!("no APK: {reason}")),
            None => apk::run(&apk::Args::release(folder.path().join("aarc.apk")))?,
        }
    }
    archives::checksums(folder.path())?;
    folder.finish()?;
    println!("{}: {}", args.out.display(), names(&args.out)?.join(", "));
    skipped.iter().for_each(|skipped| println!("{skipped}"));
    Ok(())
}

/// Names of the files of a folder, sorted.
fn names(folder: &Path) -> anyhow::Result<Vec<String>> {
    let entries = folder.read_dir().with_context(|| folder.display().to_string())?;
    let mut names = entries
        .map(|entry| Ok(entry?.file_name().to_string_lossy().into_owned()))
        .collect::<std::io::Result<Vec<_>>>()?;
    names.sort();
    Ok(names)
}

/// Builds the programs, optimised and without symbols, and returns their folder. Paths of this machine do not enter
/// them, and the folder is their own: other flags build everything anew.
fn build() -> Result<PathBuf, Fault> {
    let target = workspace::target_folder().join("dist");
    let root = workspace::root().display();
    let cargo_home =
        env::var("CARGO_HOME").or_else(|_| env::var("HOME").map(|home| format!("{home}/.cargo")));
    let cargo_home = cargo_home.unwrap_or_default();
    let mapped = [(root.to_string(), "/aarc"), (cargo_home, "/cargo")];
    let mapped = || mapped.iter().filter(|(from, _)| !from.is_empty());
    let rust: Vec<String> = mapped().map(|(from, to)| format!("--remap-path-prefix={from}={to}")).collect();
    let c: Vec<String> = mapped().map(|(from, to)| format!("-ffile-prefix-map={from}={to}")).collect();
    let status = workspace::cargo()
        .args(["build", "--release", "--locked", "--bins", "--target-dir"])
        .arg(&target)
        .args(PROGRAMS)
        .env("CARGO_ENCODED_RUSTFLAGS", rust.join("\x1f"))
        .env("CFLAGS", workspace::shell_line(&c))
        .env("CC_SHELL_ESCAPED_FLAGS", "1")
        .env("CARGO_PROFILE_RELEASE_STRIP", "symbols")
        .stdin(Stdio::null())
        .status()
        .map_err(|error| Fault::Device(format!("cannot run cargo: {error}")))?;
    match status.success() {
        true => Ok(target.join("release")),
        false => Err(Fault::Device("cargo could not build the programs; its messages are above".into())),
    }
}

/// Seconds since 1970 that all files have as their time: SOURCE_DATE_EPOCH, else the time of the last commit.
fn epoch() -> Result<u64, Fault> {
    let text = match env::var("SOURCE_DATE_EPOCH") {
        Ok(text) => text,
        Err(_) => {
            let git = Command::new("git")
                .args(["log", "-1", "--format=%ct"])
                .current_dir(workspace::root())
                .output();
            git.map(|output| String::from_utf8_lossy(&output.stdout).into_owned()).unwrap_or_default()
        }
    };
    text.trim().parse().map_err(|_| {
        let what = "no time for the files: this is no git checkout, and SOURCE_DATE_EPOCH is not a number";
        Fault::Usage(format!("{what}; set it to seconds since 1970"))
    })
}
