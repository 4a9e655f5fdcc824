//! The project's dependencies: `.cargo/deny.toml` allows every licence, everything comes from one
//! registry, DEPENDENCIES.md explains every direct dependency, and the player never compiles what only
//! the host tool needs.
//!
//! Nothing is fetched. If Cargo lacks packages that only other systems or workspaces need, their
//! licences are not checked.

use std::collections::BTreeSet;
use std::fs;
use std::process::ExitCode;

use libtest_mimic::{Arguments, Completion, Trial};
use serde_json::Value;
use spdx::Expression;
use xtask::workspace;

/// The registry, as Cargo names it.
const REGISTRY: &str = "registry+https://github.com/rust-lang/crates.io-index";

/// The workspaces, by their manifests.
const WORKSPACES: [&str; 3] = ["Cargo.toml", "codec/fuzz/Cargo.toml", "xtask/apk/Cargo.toml"];

fn main() -> ExitCode {
    let passes = |name: &str, test: fn()| {
        Trial::test(name, move || {
            test();
            Ok(())
        })
    };
    let tests = vec![
        Trial::ignorable_test("licences are allowed and sources known", || Ok(licences())),
        passes("every direct dependency is explained", every_direct_dependency_is_explained),
        passes("licences are understood", licences_are_understood),
        passes("the player does not depend on the host tool", the_player_does_not_depend_on_the_host_tool),
        passes("the player does not compile the encoder", the_player_does_not_compile_the_encoder),
        passes("on Android the player compiles what it runs", on_android_the_player_compiles_what_it_runs),
        passes(
            "a bare player has no window, no sound and no network",
            a_bare_player_has_no_window_no_sound_and_no_network,
        ),
    ];
    libtest_mimic::run(&Arguments::from_args(), tests).exit_code()
}

/// Cargo's metadata of a workspace's packages, optionally with the metadata of all dependencies on all systems.
///
/// # Errors
/// If Cargo lacks some of the dependencies.
fn packages(manifest: &str, with_dependencies: bool) -> Result<Vec<Value>, String> {
    let mut cargo = workspace::cargo();
    cargo.args(["metadata", "--locked", "--offline", "--format-version", "1", "--all-features"]);
    cargo.arg("--manifest-path").arg(workspace::root().join(manifest));
    if !with_dependencies {
        cargo.arg("--no-deps");
    }
    let output = cargo.output().expect("cargo runs");
    let errors = String::from_utf8_lossy(&output.stderr);
    if !output.status.success() && errors.contains("--offline") {
        return Err(format!("Cargo lacks packages: cargo fetch --locked --manifest-path {manifest}"));
    }
    assert!(output.status.success(), "cargo metadata of {manifest}: {errors}");
    let metadata: Value = serde_json::from_slice(&output.stdout).expect("cargo prints JSON");
    Ok(metadata["packages"].as_array().expect("packages").clone())
}

fn text<'v>(value: &'v Value, key: &str) -> &'v str {
    value[key].as_str().unwrap_or_default()
}

/// The licences that `.cargo/deny.toml` allows.
fn allowed() -> BTreeSet<String> {
    let config = fs::read_to_string(workspace::root().join(".cargo/deny.toml")).expect("a file");
    let (_, list) = config.split_once("allow = [").expect("a list of licences");
    let (list, _) = list.split_once(']').expect("its end");
    list.split('"').skip(1).step_by(2).map(str::to_owned).collect()
}

/// The licences in a licence expression, if the allowed ones satisfy it.
fn licences_of(licence: &str, allowed: &BTreeSet<String>) -> Option<BTreeSet<String>> {
    let expression = Expression::parse_mode(licence, spdx::ParseMode::LAX).ok()?;
    let is_satisfied = expression.evaluate(|licence| allowed.contains(&licence.to_string()));
    is_satisfied.then(|| expression.requirements().map(|licence| licence.req.to_string()).collect())
}

fn licences() -> Completion {
    let allowed = allowed();
    assert!(allowed.contains("MIT"), "{allowed:?}");
    let mut used = BTreeSet::new();
    let mut offences = Vec::new();
    let mut missing = Vec::new();
    for manifest in WORKSPACES {
        let packages = match packages(manifest, true) {
            Ok(packages) => packages,
            Err(reason) => {
                missing.push(reason);
                continue;
            }
        };
        assert!(packages.len() > 20, "{manifest}: {} packages", packages.len());
        for package in packages {
            let (name, licence) = (text(&package, "name"), text(&package, "license"));
            match licences_of(licence, &allowed) {
                Some(licences) => used.extend(licences),
                None => offences.push(format!("{manifest}: {name} is licensed as \"{licence}\"")),
            }
            if !package["source"].is_null() && package["source"] != REGISTRY {
                offences.push(format!("{manifest}: {name} comes from {}", package["source"]));
            }
        }
    }
    assert!(offences.is_empty(), "see .cargo/deny.toml:\n  {}", offences.join("\n  "));
    if !missing.is_empty() {
        return Completion::ignored_with(missing.join("; "));
    }
    let unused: Vec<_> = allowed.difference(&used).collect();
    assert!(unused.is_empty(), ".cargo/deny.toml allows what no package names: {unused:?}");
    Completion::Completed
}

/// Names of the registry packages that a workspace depends on directly.
fn direct(manifest: &str) -> BTreeSet<String> {
    let packages = packages(manifest, false).expect("no dependencies are needed");
    let dependencies =
        packages.iter().flat_map(|package| package["dependencies"].as_array().expect("a list"));
    let foreign = dependencies.filter(|dependency| dependency["path"].is_null());
    foreign.map(|dependency| text(dependency, "name").to_owned()).collect()
}

/// Names in the first column of DEPENDENCIES.md.
fn explained() -> BTreeSet<String> {
    let path = workspace::root().join("tests/DEPENDENCIES.md");
    let document = fs::read_to_string(path).expect("DEPENDENCIES.md is readable");
    let cells = document.lines().filter_map(|line| line.strip_prefix('|')?.split('|').next());
    cells.flat_map(|cell| cell.split('`').skip(1).step_by(2)).map(str::to_owned).collect()
}

fn every_direct_dependency_is_explained() {
    let direct: BTreeSet<String> = WORKSPACES.iter().flat_map(|manifest| direct(manifest)).collect();
    let explained = explained();
    let missing: Vec<_> = direct.difference(&explained).collect();
    let gone: Vec<_> = explained.difference(&direct).collect();
    assert!(
        missing.is_empty() && gone.is_empty(),
        "DEPENDENCIES.md lacks {missing:?}, and nothing needs {gone:?}"
    );
}

fn licences_are_understood() {
    let allowed = BTreeSet::from(["MIT".to_owned(), "Apache-2.0 WITH LLVM-exception".to_owned()]);
    for licence in ["MIT", "MIT OR GPL-3.0-only", "MIT/Apache-2.0", "(GPL-3.0-only OR MIT) AND MIT"] {
        assert!(licences_of(licence, &allowed).is_some(), "{licence}");
    }
    let exception = "Apache-2.0 WITH LLVM-exception";
    assert_eq!(licences_of(exception, &allowed), Some(BTreeSet::from([exception.to_owned()])));
    for licence in ["", "GPL-3.0-only", "MIT AND GPL-3.0-only", "Apache-2.0", "proprietary"] {
        assert_eq!(licences_of(licence, &allowed), None, "{licence}");
    }
}

/// Output of `cargo tree` for the player.
fn tree(arguments: &[&str]) -> String {
    let output = workspace::cargo()
        .args(["tree", "--locked", "--package", "client", "--prefix", "none"])
        .args(arguments)
        .output()
        .expect("cargo runs");
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "cargo tree {arguments:?}: {errors}");
    String::from_utf8(output.stdout).unwrap()
}

const FEATURE_SETS: [&[&str]; 3] = [&[], &["--no-default-features"], &["--all-features"]];

/// Whether the tree contains a package of this name.
fn depends_on(tree: &str, package: &str) -> bool {
    tree.lines().any(|line| line.split(' ').next() == Some(package))
}

fn the_player_does_not_depend_on_the_host_tool() {
    for features in FEATURE_SETS {
        let tree = tree(&[&["--edges", "normal,build"], features].concat());
        assert!(depends_on(&tree, "codec"), "the tree was not understood:\n{tree}");
        for package in ["refine", "measure", "studio", "xtask", "aarc-tests", "rayon"] {
            assert!(!depends_on(&tree, package), "client {features:?} depends on {package}");
        }
    }
}

fn the_player_does_not_compile_the_encoder() {
    for features in FEATURE_SETS {
        let tree = tree(&[&["--edges", "normal", "--format", "{p} features:{f};"], features].concat());
        let codec = tree.lines().find(|line| line.starts_with("codec ")).expect("client decodes");
        let enabled = codec.split("features:").nth(1).expect("the format names features");
        assert!(enabled.contains("serde"), "the tree was not understood: {codec}");
        assert!(!enabled.contains("encode"), "client {features:?} turns the encoder on: {codec}");
    }
}

fn on_android_the_player_compiles_what_it_runs() {
    let features =
        ["--no-default-features", "--features", "audio,net,xr", "--target", "aarch64-linux-android"];
    let tree = tree(&[&["--edges", "normal"][..], &features].concat());
    for package in ["android-activity", "android_logger", "cpal", "egui", "ureq"] {
        assert!(depends_on(&tree, package), "the player for Android depends on {package}");
    }
    for package in ["winit", "egui-winit", "env_logger", "formats"] {
        assert!(!depends_on(&tree, package), "the player for Android depends on {package}");
    }
}

fn a_bare_player_has_no_window_no_sound_and_no_network() {
    let with = tree(&["--edges", "normal"]);
    let without = tree(&["--edges", "normal", "--no-default-features"]);
    for package in ["formats", "cpal", "rusty-opus", "rubato", "winit", "egui", "ureq"] {
        assert!(depends_on(&with, package), "the default player depends on {package}");
        assert!(!depends_on(&without, package), "the bare player depends on {package}");
    }
}
