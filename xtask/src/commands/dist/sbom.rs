//! [`of_selection`]: what the programs contain, as a CycloneDX 1.5 document.
//!
//! `cargo tree` and `cargo metadata` say which packages become part of the programs and under which licences, and
//! `Cargo.lock` has their checksums. The document has no time and no random number, so equal programs have equal ones.

use std::collections::BTreeMap;
use std::fs;

use anyhow::Context;
use serde_json::{Value, json};
use xtask::workspace;

use crate::commands::notices::{HOST, packages};

/// The document of the packages and features that Cargo selects.
///
/// # Errors
/// Where Cargo fails.
pub(super) fn of_selection(selection: &[&str]) -> anyhow::Result<String> {
    let lock = fs::read_to_string(workspace::root().join("Cargo.lock")).context("Cargo.lock")?;
    let checksums = checksums(&lock);
    let mut components = Vec::new();
    for package in packages(selection, HOST)? {
        let (name, version) = package.name.split_once(" v").context("a package has a version")?;
        let checksum = checksums.get(&(name, version));
        components.push(component(name, version, &package.licence, checksum.copied()));
    }
    let version = env!("CARGO_PKG_VERSION");
    let document = json!({
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "version": 1,
        "metadata": {"component": {"type": "application", "name": "aarc", "version": version}},
        "components": components,
    });
    Ok(format!("{document:#}\n"))
}

/// The entry of a package. Those of this repository have no checksum.
fn component(name: &str, version: &str, licence: &str, checksum: Option<&str>) -> Value {
    // Old manifests write `MIT/Apache-2.0`, which is no SPDX expression.
    let licence = licence.replace('/', " OR ");
    let mut component = json!({
        "type": "library",
        "name": name,
        "version": version,
        "licenses": [{"expression": licence}],
    });
    if let Some(checksum) = checksum {
        component["purl"] = json!(format!("pkg:cargo/{name}@{version}"));
        component["hashes"] = json!([{"alg": "SHA-256", "content": checksum}]);
    }
    component
}

/// The checksums of a lock file, by name and version.
fn checksums(lock: &str) -> BTreeMap<(&str, &str), &str> {
    let entries = lock.split("[[package]]").skip(1);
    let value = |entry: &'_ str, key: &str| -> Option<(usize, usize)> {
        let start = entry.find(&format!("\n{key} = \""))? + key.len() + 5;
        Some((start, start + entry[start..].find('"')?))
    };
    let found = entries.filter_map(|entry| {
        let text = |key| value(entry, key).map(|(start, end)| &entry[start..end]);
        Some(((text("name")?, text("version")?), text("checksum")?))
    });
    found.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn components_have_a_licence_and_those_of_the_registry_a_checksum() {
        let document = of_selection(&["--package", "codec"]).unwrap();
        let document: Value = serde_json::from_str(&document).unwrap();
        let components = document["components"].as_array().unwrap();
        let component =
            |name: &str| components.iter().find(|component| component["name"] == name).expect(name);
        assert!(component("codec").get("purl").is_none(), "not of a registry");
        let crc = component("crc32fast");
        assert!(crc["purl"].as_str().unwrap().starts_with("pkg:cargo/crc32fast@"), "{crc}");
        assert_eq!(crc["hashes"][0]["content"].as_str().unwrap().len(), 64);
        for component in components {
            let licence = component["licenses"][0]["expression"].as_str().unwrap();
            assert!(!licence.is_empty() && !licence.contains('/'), "{component}");
        }
    }
}
