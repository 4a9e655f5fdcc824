//! The workspace on disk: where it lies, and building its programs.

use std::env;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use program::Fault;
use serde_json::Value;

/// The root of the repository that this tool was built from.
pub fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the package is a folder of the workspace")
}

/// The folder for what the tool makes for itself; not under version control.
pub fn target_folder() -> PathBuf {
    root().join("target")
}

/// The folder in which the set-up puts an OpenXR runtime for tests. There is none, or a whole one.
pub fn openxr_folder() -> PathBuf {
    target_folder().join("openxr")
}

/// The folder in which the set-up puts a compiler for Android to check with. There is none, or a
/// whole one.
pub fn android_compiler_folder() -> PathBuf {
    target_folder().join("android-compiler")
}

/// The folder in which the set-up puts a scheduler of clusters for a test. There is none, or a whole one.
pub fn slurm_folder() -> PathBuf {
    target_folder().join("slurm")
}

/// Cargo, to be run in the root of the repository: the one that runs this program, if one does.
pub fn cargo() -> Command {
    let program = env::var_os("CARGO").unwrap_or_else(|| OsString::from("cargo"));
    let mut command = Command::new(program);
    command.current_dir(root());
    // Cargo tells the programs that it runs about their package in these. Build scripts below that
    // look at them would run anew for every program that calls this, and what depends on them.
    let is_told = |name: &str| name.starts_with("CARGO_PKG_") || name.starts_with("CARGO_MANIFEST_");
    for (name, _) in env::vars_os().filter(|(name, _)| name.to_str().is_some_and(is_told)) {
        command.env_remove(name);
    }
    command
}

/// Builds a program of the workspace and returns the path of its executable.
///
/// The features are those of a build of the whole workspace, so that building and testing share
/// what they compile. `profile` is `dev` or `release`.
///
/// # Errors
/// [`Fault::Device`] where Cargo cannot run or cannot build the program.
pub fn build(program: &str, profile: &str) -> Result<PathBuf, Fault> {
    build_target("bin", program, profile, &["--workspace"])
}

/// As [`build`], for an example: a program or a library.
///
/// # Errors
/// As [`build`].
pub fn build_example(name: &str, profile: &str) -> Result<PathBuf, Fault> {
    build_target("example", name, profile, &["--workspace"])
}

/// Builds a program of `package` with `features` of it alone, and returns the path of its executable.
///
/// # Errors
/// As [`build`].
pub fn build_with(package: &str, program: &str, features: &str, profile: &str) -> Result<PathBuf, Fault> {
    build_target("bin", program, profile, &["--package", package, "--features", features])
}

fn build_target(kind: &str, name: &str, profile: &str, selection: &[&str]) -> Result<PathBuf, Fault> {
    let output = cargo()
        .arg("build")
        .args(selection)
        .args([&format!("--{kind}"), name, "--profile", profile])
        .arg("--message-format=json-render-diagnostics")
        .stdin(Stdio::null())
        .stderr(Stdio::inherit())
        .output()
        .map_err(|error| Fault::Device(format!("cannot run cargo: {error}")))?;
    let executable = String::from_utf8_lossy(&output.stdout).lines().find_map(|line| {
        let message: Value = serde_json::from_str(line).ok()?;
        let is_target = message["target"]["name"] == name && message["target"]["kind"][0] == kind;
        let path = message["executable"].as_str().or(message["filenames"][0].as_str());
        path.filter(|_| is_target).map(PathBuf::from)
    });
    match executable {
        Some(path) if output.status.success() => Ok(path),
        _ => Err(Fault::Device(format!("cargo could not build {name}; its messages are above"))),
    }
}

#[cfg(test)]
mod tests {
    use std::ffi::OsStr;

    use super::*;

    #[test]
    fn cargo_is_not_told_of_the_package_that_runs_it() {
        // Cargo tells tests of theirs.
        let is_removed =
            |(name, value): (&OsStr, Option<&OsStr>)| name == "CARGO_PKG_NAME" && value.is_none();
        assert!(cargo().get_envs().any(is_removed));
    }

    #[test]
    fn the_root_holds_the_workspace() {
        assert!(root().join("Cargo.lock").is_file() && root().join("codec/Cargo.toml").is_file());
    }
}
