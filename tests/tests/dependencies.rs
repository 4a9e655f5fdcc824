//! What the project depends on: every licence is one that `.cargo/deny.toml` allows, everything comes
//! from the one registry, and DEPENDENCIES.md explains every direct dependency.
//!
//! Nothing is fetched: where Cargo lacks packages that only other systems or other workspaces need,
//! their licences are not looked at.

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
    ];
    libtest_mimic::run(&Arguments::from_args(), tests).exit_code()
}

/// What Cargo knows of the packages of a workspace; of the dependencies as well, for all systems.
///
/// # Errors
/// What Cargo says where it lacks some of them.
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

/// The licences that a package may be had under, if one of the ways is allowed.
fn licences_of(licence: &str, allowed: &BTreeSet<String>) -> Option<BTreeSet<String>> {
    let expression = Expression::parse_mode(licence, spdx::ParseMode::LAX).ok()?;
    let is_allowed = expression.evaluate(|licence| allowed.contains(&licence.to_string()));
    is_allowed.then(|| expression.requirements().map(|licence| licence.req.to_string()).collect())
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

/// Names of the packages of the registry that packages of a workspace depend on directly.
fn direct(manifest: &str) -> BTreeSet<String> {
    let packages = packages(manifest, false).expect("Cargo needs no others for these");
    let dependencies =
        packages.iter().flat_map(|package| package["dependencies"].as_array().expect("a list"));
    let foreign = dependencies.filter(|dependency| dependency["path"].is_null());
    foreign.map(|dependency| text(dependency, "name").to_owned()).collect()
}

/// The names in the first column of the table of dependencies.
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
