//! What the project depends on: every licence is one that `.cargo/deny.toml` allows, everything comes
//! from the one registry, and the README says of every direct dependency why it is there.

use std::collections::BTreeSet;
use std::fs;

use serde_json::Value;
use spdx::Expression;
use xtask::workspace;

/// The registry, as Cargo names it.
const REGISTRY: &str = "registry+https://github.com/rust-lang/crates.io-index";

/// The workspaces, by their manifests.
const WORKSPACES: [&str; 3] = ["Cargo.toml", "codec/fuzz/Cargo.toml", "xtask/apk/Cargo.toml"];

/// What Cargo knows of the packages of a workspace; of the dependencies as well, for all systems.
fn packages(manifest: &str, with_dependencies: bool) -> Vec<Value> {
    let mut cargo = workspace::cargo();
    cargo.args(["metadata", "--locked", "--format-version", "1", "--all-features", "--manifest-path"]);
    cargo.arg(workspace::root().join(manifest));
    if !with_dependencies {
        cargo.arg("--no-deps");
    }
    let output = cargo.output().expect("cargo runs");
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "cargo metadata of {manifest}: {errors}");
    let metadata: Value = serde_json::from_slice(&output.stdout).expect("cargo prints JSON");
    metadata["packages"].as_array().expect("packages").clone()
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

/// Whether one of the ways to license a package is allowed.
fn is_allowed(licence: &str, allowed: &BTreeSet<String>) -> bool {
    let expression = Expression::parse_mode(licence, spdx::ParseMode::LAX);
    expression.is_ok_and(|expression| expression.evaluate(|licence| allowed.contains(&licence.to_string())))
}

#[test]
fn licences_are_allowed_and_sources_known() {
    let allowed = allowed();
    assert!(allowed.contains("MIT"), "{allowed:?}");
    let mut used = BTreeSet::new();
    let mut offences = Vec::new();
    for manifest in WORKSPACES {
        let packages = packages(manifest, true);
        assert!(packages.len() > 20, "{manifest}: {} packages", packages.len());
        for package in packages {
            let (name, licence) = (text(&package, "name"), text(&package, "license"));
            if !is_allowed(licence, &allowed) {
                offences.push(format!("{manifest}: {name} is licensed as \"{licence}\""));
            }
            if !package["source"].is_null() && package["source"] != REGISTRY {
                offences.push(format!("{manifest}: {name} comes from {}", package["source"]));
            }
            used.extend(allowed.iter().filter(|one| licence.contains(one.as_str())).cloned());
        }
    }
    assert!(offences.is_empty(), "see .cargo/deny.toml:\n  {}", offences.join("\n  "));
    let unused: Vec<_> = allowed.difference(&used).collect();
    assert!(unused.is_empty(), ".cargo/deny.toml allows what nothing needs: {unused:?}");
}

/// Names of the packages of the registry that packages of a workspace depend on directly.
fn direct(manifest: &str) -> BTreeSet<String> {
    let packages = packages(manifest, false);
    let dependencies =
        packages.iter().flat_map(|package| package["dependencies"].as_array().expect("a list"));
    let foreign = dependencies.filter(|dependency| dependency["path"].is_null());
    foreign.map(|dependency| text(dependency, "name").to_owned()).collect()
}

/// The names in the first column of the README's table of dependencies.
fn explained() -> BTreeSet<String> {
    let readme = fs::read_to_string(workspace::root().join("README.md")).expect("a README");
    let (_, section) = readme.split_once("### Dependencies").expect("a section about them");
    let section = section.split("\n#").next().expect("the section");
    let cells = section.lines().filter_map(|line| line.strip_prefix('|')?.split('|').next());
    cells.flat_map(|cell| cell.split('`').skip(1).step_by(2)).map(str::to_owned).collect()
}

#[test]
fn every_direct_dependency_is_explained() {
    let direct: BTreeSet<String> = WORKSPACES.iter().flat_map(|manifest| direct(manifest)).collect();
    let explained = explained();
    let missing: Vec<_> = direct.difference(&explained).collect();
    let gone: Vec<_> = explained.difference(&direct).collect();
    assert!(
        missing.is_empty() && gone.is_empty(),
        "README: it lacks {missing:?}, and nothing needs {gone:?}"
    );
}

#[test]
fn licences_are_understood() {
    let allowed = BTreeSet::from(["MIT".to_owned(), "Apache-2.0 WITH LLVM-exception".to_owned()]);
    for licence in ["MIT", "MIT OR GPL-3.0-only", "MIT/Apache-2.0", "(GPL-3.0-only OR MIT) AND MIT"] {
        assert!(is_allowed(licence, &allowed), "{licence}");
    }
    assert!(is_allowed("Apache-2.0 WITH LLVM-exception", &allowed));
    for licence in ["", "GPL-3.0-only", "MIT AND GPL-3.0-only", "Apache-2.0", "proprietary"] {
        assert!(!is_allowed(licence, &allowed), "{licence}");
    }
}
