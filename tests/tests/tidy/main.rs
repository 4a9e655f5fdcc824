//! The rules that the sources keep, checked by reading them.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

mod modules;
mod tokens;

use tokens::Kind;

/// The root of the repository.
fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap()
}

/// The folder of these tests, which names what it looks for.
const TIDY: &str = "tests/tests/tidy/";

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
        // One peer is a wgpu library and takes a device.
        let graphics =
            ["client/src/gpu/", "codec/refine/src/fit/backend/gpu/", "tests/peers/src/native/viewer.rs"];
        let homes: [(&str, &[&str]); 2] = [("wgpu", &graphics), ("openxr", &["client/src/xr/"])];
        for (word, homes) in homes {
            if homes.iter().any(|home| path.starts_with(home)) || path.starts_with(TIDY) {
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
    let path = "client/src/clock.rs";
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
        if path.starts_with(TIDY) {
            continue;
        }
        // The example is a Vulkan layer, which speaks the loader's C interface; no program contains it.
        let allowed = path.starts_with("client/src/gpu/device")
            || path == "client/src/audio/alsa.rs"
            || path.starts_with("client/src/xr/")
            || path == "tests/examples/lossy_driver.rs";
        let lines: Vec<&str> = text.lines().collect();
        for (number, _) in code(&text).filter(|(_, line)| names(line, "unsafe")) {
            let before = &lines[number.saturating_sub(6)..number];
            if !allowed {
                offences.push(format!("{path}:{number}: unsafe outside gpu/device, audio/alsa and xr"));
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
fn files_and_folders_use_each_other_one_way() {
    let mut offences = Vec::new();
    let mut packages = 0;
    for (manifest, _) in files(&["Cargo.toml"]) {
        let package = manifest.trim_end_matches("/Cargo.toml");
        packages += 1;
        let src = root().join(package).join("src");
        for crate_root in modules::roots(&src) {
            let name = |path: &PathBuf| path.strip_prefix(&src).unwrap_or(path).display().to_string();
            let files = modules::edges(&crate_root);
            for edges in modules::rooms(&files).iter().chain([&files]) {
                for (group, example) in modules::cycles(edges) {
                    let uses = |pair: &[PathBuf]| {
                        let names: Vec<&str> =
                            edges[&pair[0]][&pair[1]].iter().take(5).map(String::as_str).collect();
                        format!("{} uses {} ({})", name(&pair[0]), name(&pair[1]), names.join(", "))
                    };
                    let way: Vec<String> = example.windows(2).map(uses).collect();
                    offences.push(format!("{package}: {} of {}", group.len(), way.join(", ")));
                }
            }
        }
    }
    assert!(packages > 5, "packages have a Cargo.toml");
    assert_none("files and folders use each other one way", &offences);
}

/// Type names with one definition. `Part`, `Scene`, `Settings` and `View` have several.
const SINGULAR: [&str; 7] = ["Fault", "Part", "Scene", "Settings", "Shot", "Step", "View"];

#[test]
fn a_type_name_has_one_meaning() {
    let mut places: BTreeMap<&str, Vec<String>> = BTreeMap::new();
    let sources = files(&["rs"]);
    for (path, text) in sources.iter().filter(|(path, _)| path.contains("src/")) {
        let tokens = tokens::without_tests(&tokens::tokens(text));
        for pair in tokens.windows(2) {
            let defines = matches!(pair[0].text, "struct" | "enum" | "union" | "trait");
            let is_one = SINGULAR.contains(&pair[1].text);
            if defines && is_one {
                places.entry(pair[1].text).or_default().push(format!("{path}:{}", pair[1].line));
            }
        }
    }
    places.retain(|_, places| places.len() > 1);
    let offences: Vec<String> =
        places.iter().map(|(name, places)| format!("{name}: {}", places.join(", "))).collect();
    assert_none("a type name has one meaning", &offences);
}

/// Longest function that needs no reason for its length, in lines.
const LINES_MAX: usize = 60;

#[test]
fn a_long_function_says_why() {
    let mut offences = Vec::new();
    for (path, text) in files(&["rs"]) {
        if path.contains("tests/") && !path.contains("src/") || path.ends_with("/tests.rs") {
            continue;
        }
        let lines: Vec<&str> = text.lines().collect();
        let tokens = tokens::without_tests(&tokens::tokens(&text));
        for (i, pair) in tokens.windows(2).enumerate() {
            if pair[0].text != "fn" || pair[1].kind != Kind::Word {
                continue;
            }
            let first = pair[0].line;
            let length = tokens[tokens::item_end(&tokens, i) - 1].line + 1 - first;
            // Above it, or at the start of its body.
            let is_note = |line: &&&str| line.trim_start().starts_with(['/', '#']);
            let above = lines[..first - 1].iter().rev().take_while(is_note);
            let body = tokens[i..].iter().find(|token| token.text == "{").map_or(first, |token| token.line);
            let mut notes = above.chain(lines[body..].iter().take_while(is_note));
            if length > LINES_MAX && !notes.any(|line| line.contains("// Long: ")) {
                offences.push(format!("{path}:{first}: {} has {length} lines", pair[1].text));
            }
        }
    }
    assert_none(&format!("a function above {LINES_MAX} lines has a comment `// Long: reason`"), &offences);
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
    let homes = ["client/src/content/transfer/cache.rs", "client/src/content/transfer/head.rs"];
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
    assert!(root().join(TIDY).join("main.rs").is_file());
    let source = "/* a */ let r = b\"\\\"\"; // c\nfn f<'a>(x: &'a T) -> [u8; 2] { x.0..1.5 }";
    let texts: Vec<&str> = tokens::tokens(source).iter().map(|token| token.text).collect();
    assert_eq!(texts[..5], ["let", "r", "=", "b\"\\\"\"", ";"]);
    assert_eq!(texts[texts.len() - 7..], ["x", ".", "0", ".", ".", "1.5", "}"]);
}
