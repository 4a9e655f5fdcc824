//! The workspace on disk: its folders, and building its programs.
//!
//! Programs are built with the features that `cargo xtask test` builds everything with, so that commands and
//! tests share what they compile.

use std::env;
use std::ffi::{OsStr, OsString};
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

/// Folder of the OpenXR runtime for tests, which the set-up makes, like the folders below; complete, or absent.
pub fn openxr_folder() -> PathBuf {
    target_folder().join("openxr")
}

/// Folder of the compiler that checks code for other systems.
pub fn debian_rust_folder() -> PathBuf {
    target_folder().join("debian-rust")
}

/// Folder of the cluster scheduler for a test.
pub fn slurm_folder() -> PathBuf {
    target_folder().join("slurm")
}

/// Folder of a second Vulkan driver.
pub fn swiftshader_folder() -> PathBuf {
    target_folder().join("swiftshader")
}

/// Folder of emulators of other processors, with C compilers for them.
pub fn foreign_folder() -> PathBuf {
    target_folder().join("foreign")
}

/// Folder of ONNX Runtime.
pub fn onnx_folder() -> PathBuf {
    target_folder().join("onnx")
}

/// The library of ONNX Runtime, if the set-up got it.
pub fn onnx_library() -> Option<PathBuf> {
    let mut files = onnx_folder().join("onnxruntime/capi").read_dir().ok()?.flatten().map(|file| file.path());
    files.find(|path| {
        path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("libonnxruntime.so"))
    })
}

/// Variable with the password of the key that signs an APK.
const PASSWORD: &str = "APK_KEYSTORE_PASSWORD";

/// A Cargo command in the root of the repository: the Cargo that runs this program, or the Cargo on PATH.
pub fn cargo() -> Command {
    builder(env::var_os("CARGO").unwrap_or_else(|| OsString::from("cargo")))
}

/// A command in the root of the repository that compiles, with an environment for build scripts.
pub fn builder(program: impl AsRef<OsStr>) -> Command {
    let mut command = Command::new(program);
    // Only the packer, which is run after it was built, may know it.
    command.current_dir(root()).env_remove(PASSWORD);
    // Cargo sets these for the programs it runs. Build scripts that depend on them would run again for
    // every calling program, and rebuild their dependents.
    let is_of_package = |name: &str| name.starts_with("CARGO_PKG_") || name.starts_with("CARGO_MANIFEST_");
    for (name, _) in env::vars_os().filter(|(name, _)| name.to_str().is_some_and(is_of_package)) {
        command.env_remove(name);
    }
    command
}

/// Words as a line that a shell splits into the same words. The package `cc` splits flags so, too, where
/// `CC_SHELL_ESCAPED_FLAGS` is set.
pub fn shell_line<S: AsRef<str>>(words: &[S]) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_=./:,@+%".contains(c);
    let quoted = |word: &S| match word.as_ref() {
        word if !word.is_empty() && word.chars().all(is_plain) => word.to_owned(),
        word => format!("'{}'", word.replace('\'', r"'\''")),
    };
    words.iter().map(quoted).collect::<Vec<_>>().join(" ")
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
    build_target(in_workspace().args(["--bin", "aarc-studio", "--quiet"]), "aarc-studio", profile)
        .map(Command::new)
}

/// Builds a program of the workspace with [`FEATURES`] and returns the path of its executable. `profile` is
/// `dev` or `release`.
///
/// # Errors
/// [`Fault::Device`] where Cargo cannot be run or cannot build the program.
pub fn build(program: &str, profile: &str) -> Result<PathBuf, Fault> {
    build_target(in_workspace().args(["--bin", program]), program, profile)
}

/// As [`build`], for an example: a program or a library to be loaded.
///
/// # Errors
/// As [`build`].
pub fn build_example(name: &str, profile: &str) -> Result<PathBuf, Fault> {
    build_target(in_workspace().args(["--example", name]), name, profile)
}

/// As [`build`], for the packer of APKs, which belongs to a workspace of its own.
///
/// # Errors
/// As [`build`].
pub fn build_packer() -> Result<PathBuf, Fault> {
    let mut build = cargo();
    build.current_dir(root().join("xtask/apk")).args(["build", "--quiet", "--locked"]);
    build_target(&mut build, "apk-packer", "dev")
}

fn in_workspace() -> Command {
    let mut build = cargo();
    build.args(["build", "--workspace", "--features", FEATURES]);
    build
}

/// Runs a build command and returns the path of the program, or library, of the target `name`.
fn build_target(build: &mut Command, name: &str, profile: &str) -> Result<PathBuf, Fault> {
    let output = build
        .args(["--profile", profile, "--message-format=json-render-diagnostics"])
        .stdin(Stdio::null())
        .stderr(Stdio::inherit())
        .output()
        .map_err(|error| Fault::Device(format!("cannot run cargo: {error}")))?;
    let executable = String::from_utf8_lossy(&output.stdout).lines().find_map(|line| {
        let message: Value = serde_json::from_str(line).ok()?;
        let target = &message["target"];
        let is_program =
            target["name"] == name && (target["kind"][0] == "bin" || target["kind"][0] == "example");
        let made = message["executable"].as_str().or(message["filenames"][0].as_str());
        made.filter(|_| is_program).map(PathBuf::from)
    });
    match executable {
        Some(path) if output.status.success() => Ok(path),
        _ => Err(Fault::Device(format!("cargo could not build {name}; its messages are above"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn builds_inherit_neither_the_package_variables_nor_the_password() {
        // Cargo sets CARGO_PKG_NAME for tests.
        for variable in ["CARGO_PKG_NAME", PASSWORD] {
            let command = cargo();
            let mut removed = command.get_envs().filter(|(_, value)| value.is_none());
            assert!(removed.any(|(name, _)| name == variable), "{variable}");
        }
    }

    #[test]
    fn a_shell_splits_a_line_into_its_words() {
        let words = ["env", "A=b", "/two words/it's", "", "$HOME", "-Wl,-z"];
        let mut shell = Command::new("sh");
        shell.arg("-c").arg(format!(r"printf '%s\n' {}", shell_line(&words)));
        let output = shell.output().unwrap();
        assert_eq!(String::from_utf8(output.stdout).unwrap().lines().collect::<Vec<_>>(), words);
        assert_eq!(shell_line(&["-o", "A::B=/c.d"]), "-o A::B=/c.d");
    }

    #[test]
    fn the_root_holds_the_workspace() {
        assert!(root().join("Cargo.lock").is_file() && root().join("codec/Cargo.toml").is_file());
    }
}
