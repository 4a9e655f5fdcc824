//! The rules that the sources keep, checked by reading them.

use std::fs;
use std::path::{Path, PathBuf};

use xtask::workspace::root;

/// Every file of the repository with one of the extensions, its path relative to the root.
fn files(extensions: &[&str]) -> Vec<(String, String)> {
    let mut found = Vec::new();
    let mut folders: Vec<PathBuf> = vec![root().to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_string_lossy().into_owned();
            if path.is_dir() {
                let ours = !matches!(name.as_str(), "target" | "out" | ".git" | "node_modules");
                folders.extend(ours.then_some(path));
            } else if path.extension().is_some_and(|end| extensions.iter().any(|e| end == *e))
                || extensions.contains(&name.as_str())
            {
                let relative = path.strip_prefix(root()).unwrap().to_str().unwrap().replace('\\', "/");
                found.push((relative, fs::read_to_string(&path).unwrap()));
            }
        }
    }
    assert!(!found.is_empty(), "no files with extensions {extensions:?}");
    found.sort();
    found
}

/// The lines of a source file that are code: without comments, with their numbers from 1.
fn code(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.lines().enumerate().map(|(i, line)| (i + 1, line.split("//").next().unwrap_or_default()))
}

fn names(line: &str, word: &str) -> bool {
    line.split(|c: char| !c.is_alphanumeric() && c != '_').any(|token| token == word)
}

/// The line without what stands between quotes, such as names of packages of a system.
fn without_strings(line: &str) -> String {
    line.split('"').step_by(2).collect()
}

/// Fails with the list, if there is anything in it.
fn assert_none(rule: &str, offences: &[String]) {
    assert!(offences.is_empty(), "{rule}:\n  {}", offences.join("\n  "));
}

#[test]
fn only_their_folders_name_the_graphics_and_headset_interfaces() {
    let mut offences = Vec::new();
    for (path, text) in files(&["rs"]) {
        // Of the peers, the one that is a library of it is handed a device.
        let graphics = ["client/src/gpu/", "codec/refine/src/fit/gpu/", "tests/peers/src/native/viewer.rs"];
        let homes: [(&str, &[&str]); 2] = [("wgpu", &graphics), ("openxr", &["client/src/xr/"])];
        for (word, homes) in homes {
            // This file has to name them to look for them.
            if homes.iter().any(|home| path.starts_with(home)) || path == "tests/tests/tidy.rs" {
                continue;
            }
            let may = homes.join(" and ");
            offences.extend(
                code(&text)
                    .filter(|(_, line)| names(&without_strings(line), word))
                    .map(|(number, _)| format!("{path}:{number} names {word}, which only {may} may")),
            );
        }
    }
    // The clock of a playing clip serves any display.
    let path = "client/src/player.rs";
    let text = fs::read_to_string(root().join(path)).unwrap();
    for word in ["gpu", "window", "winit", "egui", "xr"] {
        offences.extend(
            code(&text)
                .filter(|(_, line)| names(line, word))
                .map(|(number, _)| format!("{path}:{number} names {word}")),
        );
    }
    assert_none("interfaces stay behind one folder each", &offences);
}

#[test]
fn unsafe_code_stays_in_its_places_and_gives_its_reason() {
    let mut offences = Vec::new();
    for (path, text) in files(&["rs"]) {
        if path == "tests/tests/tidy.rs" {
            continue;
        }
        // The example is a Vulkan layer, which speaks the loader's C interface; no program contains it.
        let allowed = path.starts_with("client/src/gpu/device")
            || path.starts_with("client/src/xr/")
            || path == "tests/examples/lossy_driver.rs";
        let lines: Vec<&str> = text.lines().collect();
        for (number, _) in code(&text).filter(|(_, line)| names(line, "unsafe")) {
            let before = &lines[number.saturating_sub(6)..number];
            if !allowed {
                offences.push(format!("{path}:{number}: unsafe outside gpu/device and xr"));
            } else if !before.iter().any(|line| line.contains("SAFETY:") || line.contains("# Safety")) {
                offences.push(format!("{path}:{number}: unsafe without a reason"));
            }
        }
    }
    assert_none("unsafe is confined and explained", &offences);
    for library in ["codec/src/lib.rs", "codec/refine/src/lib.rs"] {
        let text = fs::read_to_string(root().join(library)).unwrap();
        assert!(text.contains("#![forbid(unsafe_code)]"), "{library} does not forbid unsafe code");
    }
}

#[test]
fn one_version_of_rust_is_the_oldest() {
    let version = env!("CARGO_PKG_RUST_VERSION");
    let mut stated = 0;
    let mut offences = Vec::new();
    for (path, text) in files(&["toml"]) {
        for line in text.lines().filter_map(|line| line.strip_prefix("rust-version = ")) {
            stated += 1;
            if line.trim_matches('"') != version {
                offences.push(format!("{path}: {line}"));
            }
        }
    }
    assert_none(&format!("packages need Rust {version}"), &offences);
    assert!(stated > 3, "the workspaces say what they need");
    let readme = fs::read_to_string(root().join("README.md")).unwrap();
    assert!(readme.contains(&format!("Rust {version} or newer")), "README: not Rust {version}");
}

#[test]
fn the_clock_on_the_wall_decides_nothing_of_what_plays() {
    // The ages of files, and dates that servers name.
    let homes = ["client/src/net/cache.rs", "client/src/net/head.rs"];
    let mut offences = Vec::new();
    for (path, text) in files(&["rs"]) {
        if path.starts_with("client/src/") && !homes.contains(&path.as_str()) {
            let lines = code(&text).filter(|(_, line)| names(line, "SystemTime"));
            offences.extend(lines.map(|(number, _)| format!("{path}:{number}")));
        }
    }
    assert_none("what plays goes by a clock that is never set", &offences);
}

#[test]
fn every_source_file_begins_with_what_it_does() {
    let mut offences = Vec::new();
    for (path, text) in files(&["rs", "wgsl"]) {
        let opening = if path.ends_with(".rs") { "//! " } else { "// " };
        if !text.starts_with(opening) {
            offences.push(path);
        }
    }
    assert_none("a file opens with what it does", &offences);
}

#[test]
fn nothing_names_the_machine_it_was_written_on() {
    // Put together here, so that this file passes its own test.
    let marks =
        ["/wo rk/", "/ro ot/", "/us rs/", "deb.deb ian.org", "local host:"].map(|mark| mark.replace(' ', ""));
    let mut offences = Vec::new();
    for (path, text) in files(&["rs", "wgsl", "md", "toml", "sh", "run", "json", "yml"]) {
        for (i, line) in text.lines().enumerate() {
            offences.extend(
                marks
                    .iter()
                    .filter(|mark| line.contains(*mark))
                    .map(|mark| format!("{path}:{}: {mark}", i + 1)),
            );
        }
    }
    assert_none("no paths and hosts of one machine", &offences);
}

#[test]
fn the_rules_catch_what_they_forbid() {
    assert!(names("let x: wgpu::Device;", "wgpu") && !names("use egui_wgpu::Renderer;", "wgpu"));
    assert_eq!(without_strings("get(\"wgpu\", wgpu::A)"), "get(, wgpu::A)");
    assert_eq!(code("a // unsafe\n// b").collect::<Vec<_>>(), [(1, "a "), (2, "")]);
    assert!(Path::new(root()).join("tests/tests/tidy.rs").is_file());
}
