//! `cargo xtask package --ladder`: the first layers of a package beside packages of their size.

use std::fs;
use std::path::Path;

use crate::tool::{Outcome, aarc_studio};
use codec::Limits;
use tempfile::tempdir;

/// Packages the figure with thin limbs in two layers, ranked by one ranking and coded quickly.
fn package(folder: &Path, rank: &str, more: &[&str]) -> Outcome {
    assert_eq!(aarc_studio(folder, &["synth", "limbs", "-o", "limbs.ply"]).code, Some(0));
    let args = ["package", "limbs.ply", "--budget", "6000", "--coder", "fixed", "--rank", rank];
    aarc_studio(folder, &[&args[..], &["--ladder"], more].concat())
}

#[test]
fn prefixes_are_as_good_as_a_package_of_their_size() {
    let folder = tempdir().unwrap();
    let nothing = aarc_studio(folder.path(), &["package", "limbs.ply", "--ladder"]);
    assert!(nothing.error(3).contains("limbs.ply"));
    let report = package(folder.path(), "blend-sum", &["--no-floor", "--json"]).json();
    let steps = report["ladder"].as_array().expect("rungs");
    let number = |step: usize, key: &str| steps[step][key].as_f64().expect("a number");
    assert_eq!((steps.len(), number(0, "gaussians"), number(1, "gaussians")), (2, 5000.0, 6000.0));
    assert!(number(0, "loss_db").abs() < 0.1, "the same Gaussians: {report}");
    assert!(number(0, "prefix_psnr_db") < number(1, "prefix_psnr_db"), "{report}");

    let bytes = fs::read(folder.path().join("limbs.aarc")).unwrap();
    assert_eq!(number(1, "prefix_bytes"), bytes.len() as f64);
    let prefix = &bytes[..number(0, "prefix_bytes") as usize];
    assert_eq!(codec::decode(prefix, &Limits::default()).unwrap().len(), 5000);
    assert!(codec::decode(&prefix[..prefix.len() - 1], &Limits::default()).is_err(), "no byte too many");
}

/// Colours and a floor that were made for 6000 Gaussians do not suit 5000.
#[test]
fn a_loss_is_a_failed_check() {
    let folder = tempdir().unwrap();
    let outcome = package(folder.path(), "light-gaussian", &["--recolor"]);
    assert_eq!(outcome.code, Some(1), "{}{}", outcome.stdout, outcome.stderr);
    assert!(outcome.stderr.contains("the first 5000 Gaussians"), "{}", outcome.stderr);
    assert!(outcome.stdout.contains("ladder") && folder.path().join("limbs.aarc").exists());
}
