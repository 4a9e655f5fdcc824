//! The workspace on disk: its folders, and building its programs.
//!
//! Programs are built with the features that `cargo xtask test` builds everything with, so that commands and
//! tests share what they compile.

use std::env;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use program::Fault;
use serde_json::Value;

/// Features of a build of the whole workspace: all of the host tool.
pub const FEATURES: &str = "studio/full";

/// The root of the repository that this tool was built from.
pub fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the package is a folder of the workspace")
}

/// Folder for build output and caches; not under version control.
pub fn target_folder() -> PathBuf {
    root().join("target")
}

/// Folder of the OpenXR runtime for tests, which the set-up makes; complete, or absent.
pub fn openxr_folder() -> PathBuf {
    target_folder().join("openxr")
}

/// Folder of the compiler that checks Android code, which the set-up makes; complete, or absent.
pub fn android_compiler_folder() -> PathBuf {
    target_folder().join("android-compiler")
}

/// Folder of the cluster scheduler for a test, which the set-up makes; complete, or absent.
pub fn slurm_folder() -> PathBuf {
    target_folder().join("slurm")
}

/// A Cargo command in the root of the repository: the Cargo that runs this program, or the one on PATH.
pub fn cargo() -> Command {
    let program = env::var_os("CARGO").unwrap_or_else(|| OsString::from("cargo"));
    let mut command = Command::new(program);
    command.current_dir(root());
    // Cargo sets these for the programs it runs. Build scripts that depend on them would run again for
    // every calling program, and rebuild their dependents.
    let is_of_package = |name: &str| name.starts_with("CARGO_PKG_") || name.starts_with("CARGO_MANIFEST_");
    for (name, _) in env::vars_os().filter(|(name, _)| name.to_str().is_some_and(is_of_package)) {
        command.env_remove(name);
    }
    command
}

/// The host tool `aarc-studio`, built if need be: to be run with a command and its arguments.
///
/// # Errors
/// Those of [`build`].
pub fn studio(profile: &str) -> Result<Command, Fault> {
    let folder = if profile == "dev" { "debug" } else { profile };
    if !target_folder().join(folder).join("aarc-studio").exists() {
        eprintln!("building the host tool, which takes minutes the first time");
    }
    build_target("bin", "aarc-studio", profile, true).map(Command::new)
}

/// Builds a program of the workspace with [`FEATURES`] and returns the path of its executable. `profile` is
/// `dev` or `release`.
///
/// # Errors
/// [`Fault::Device`] where Cargo cannot be run or cannot build the program.
pub fn build(program: &str, profile: &str) -> Result<PathBuf, Fault> {
    build_target("bin", program, profile, false)
}

/// As [`build`], for an example: a program or a library to be loaded.
///
/// # Errors
/// As [`build`].
pub fn build_example(name: &str, profile: &str) -> Result<PathBuf, Fault> {
    build_target("example", name, profile, false)
}

fn build_target(kind: &str, program: &str, profile: &str, is_quiet: bool) -> Result<PathBuf, Fault> {
    let output = cargo()
        .args(["build", "--workspace", "--features", FEATURES])
        .args([&format!("--{kind}"), program, "--profile", profile])
        .args(is_quiet.then_some("--quiet"))
        .arg("--message-format=json-render-diagnostics")
        .stdin(Stdio::null())
        .stderr(Stdio::inherit())
        .output()
        .map_err(|error| Fault::Device(format!("cannot run cargo: {error}")))?;
    let executable = String::from_utf8_lossy(&output.stdout).lines().find_map(|line| {
        let message: Value = serde_json::from_str(line).ok()?;
        let is_program = message["target"]["name"] == program && message["target"]["kind"][0] == kind;
        let made = message["executable"].as_str().or(message["filenames"][0].as_str());
        made.filter(|_| is_program).map(PathBuf::from)
    });
    match executable {
        Some(path) if output.status.success() => Ok(path),
        _ => Err(Fault::Device(format!("cargo could not build {program}; its messages are above"))),
    }
}

#[cfg(test)]
mod tests {
    use std::ffi::OsStr;

    use super::*;

    #[test]
    fn cargo_does_not_inherit_the_package_variables() {
        // Cargo sets CARGO_PKG_NAME for tests.
        let is_removed =
            |(name, value): (&OsStr, Option<&OsStr>)| name == "CARGO_PKG_NAME" && value.is_none();
        assert!(cargo().get_envs().any(is_removed));
    }

    #[test]
    fn the_root_holds_the_workspace() {
        assert!(root().join("Cargo.lock").is_file() && root().join("codec/Cargo.toml").is_file());
    }
}
