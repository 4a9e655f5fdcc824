//! The player's dependencies: it never compiles what only making a clip needs.

use xtask::workspace;

/// The dependencies of the player, alone, as `cargo tree` prints them.
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

/// Whether the tree has a package of this name.
fn depends_on(tree: &str, package: &str) -> bool {
    tree.lines().any(|line| line.split(' ').next() == Some(package))
}

#[test]
fn the_player_does_not_depend_on_the_maker() {
    for features in FEATURE_SETS {
        let tree = tree(&[&["--edges", "normal,build"], features].concat());
        assert!(depends_on(&tree, "codec"), "the tree was not understood:\n{tree}");
        for package in ["refine", "measure", "studio", "xtask", "aarc-tests", "rayon"] {
            assert!(!depends_on(&tree, package), "client {features:?} depends on {package}");
        }
    }
}

#[test]
fn the_player_does_not_compile_the_encoder() {
    for features in FEATURE_SETS {
        let tree = tree(&[&["--edges", "normal", "--format", "{p} features:{f};"], features].concat());
        let codec = tree.lines().find(|line| line.starts_with("codec ")).expect("client decodes");
        let enabled = codec.split("features:").nth(1).expect("the format names features");
        assert!(enabled.contains("serde"), "the tree was not understood: {codec}");
        assert!(!enabled.contains("encode"), "client {features:?} turns the encoder on: {codec}");
    }
}

#[test]
fn on_android_the_player_compiles_what_it_runs_there() {
    let features = ["--no-default-features", "--features", "net,xr", "--target", "aarch64-linux-android"];
    let tree = tree(&[&["--edges", "normal"][..], &features].concat());
    for package in ["android-activity", "android_logger", "egui", "ureq"] {
        assert!(depends_on(&tree, package), "the player for Android depends on {package}");
    }
    for package in ["winit", "egui-winit", "env_logger", "clap_complete", "clap_mangen", "sigpipe"] {
        assert!(!depends_on(&tree, package), "the player for Android depends on {package}");
    }
}

#[test]
fn a_player_without_window_and_network_has_no_libraries_for_them() {
    let with = tree(&["--edges", "normal"]);
    let without = tree(&["--edges", "normal", "--no-default-features"]);
    for package in ["winit", "egui", "ureq"] {
        assert!(depends_on(&with, package), "the default player depends on {package}");
        assert!(!depends_on(&without, package), "the bare player depends on {package}");
    }
}
