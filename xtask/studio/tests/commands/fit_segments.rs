//! `cargo xtask fit --segments`: several processes share the parts of a take.

use std::fs;
use std::path::Path;
use std::process::Command;
use std::thread;
use std::time::Duration;

use crate::small_stage::{field_files, kill_when, measured_take, stage_of, start, wait_for};
use crate::tool;
use crate::tool::aarc_studio;
use serde_json::Value;
use tempfile::TempDir;

/// 1.6 seconds: four parts of about 0.4 s.
const FRAMES: &str = "49";

fn take() -> TempDir {
    stage_of(FRAMES)
}

/// The arguments of a fit to the folder `field`, and more.
fn fit<'a>(more: &[&'a str]) -> Vec<&'a str> {
    let common = ["fit", "stage", "-o", "field", "--split", "0.4", "--steps", "150"];
    [&common[..], &["--gaussians", "300", "--sh-degree", "0", "--json"], more].concat()
}

fn fitted(folder: &Path, more: &[&str]) -> Value {
    aarc_studio(folder, &fit(more)).json()
}

fn refused(folder: &Path, code: i32, more: &[&str]) -> String {
    aarc_studio(folder, &fit(more)).error(code)
}

#[test]
fn even_parts_and_then_odd_ones_become_a_field_folder() {
    let folder = take();
    let folder = folder.path();
    let none = refused(folder, 2, &["--segments", "odd"]);
    assert!(none.contains("field: part 1 lies between two others, and part 0 is not fitted"), "{none}");
    let one = fitted(folder, &["--segments", "even", "--shard", "0/2"]);
    assert_eq!((&one["parts"], &one["fitted"]), (&4.into(), &1.into()), "{one}");
    assert!(one["segments"].is_null() && !folder.join("field/field.json").exists());
    let missing = refused(folder, 2, &["--segments", "odd"]);
    assert!(
        missing.contains("part 1 lies between two others, and part 2 is not fitted (and 1 part more)"),
        "{missing}"
    );
    fitted(folder, &["--segments", "even", "--shard", "1/2"]);
    fitted(folder, &["--segments", "odd", "--shard", "1/2"]);
    let last = fitted(folder, &["--segments", "odd", "--shard", "0/2"]);
    assert_eq!((&last["fitted"], &last["resumed_at"]), (&4.into(), &3.into()), "{last}");
    assert!(last["segments"].as_u64() > Some(2) && !folder.join("field/fit").exists(), "{last}");
    let shared = measured_take(folder);

    // As good as one process that slides along the take.
    let files = field_files(folder);
    fs::remove_dir_all(folder.join("field")).unwrap();
    fitted(folder, &[]);
    let slid = measured_take(folder);
    println!("{shared:.2} dB shared, {slid:.2} dB slid");
    assert!(shared > slid - 0.5 && slid > 12.5, "{shared} {slid}");

    // Machines that begin at the same time make the same, and one of them makes the background.
    fs::remove_dir_all(folder.join("field")).unwrap();
    for segments in ["even", "odd"] {
        let both =
            ["0/2", "1/2"].map(|shard| start(folder, &fit(&["--segments", segments, "--shard", shard])));
        for process in both {
            let output = process.wait_with_output().unwrap();
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        }
    }
    assert!(field_files(folder) == files, "the same files, bit by bit");
}

#[test]
fn a_process_that_comes_late_finds_nothing_to_do() {
    let folder = take();
    let folder = folder.path();
    fitted(folder, &[]);
    let files = field_files(folder);
    // What a process leaves that is killed while it tidies up.
    let work = folder.join("field/fit");
    fs::create_dir(&work).unwrap();
    for left in ["lock", "part-0002", "part-0003.fit.csv", ".writing-abcdef"] {
        fs::write(work.join(left), b"left").unwrap();
    }
    let late = fitted(folder, &["--segments", "even", "--shard", "7/16"]);
    assert_eq!(late["is_finished"], true, "{late}");
    assert!(field_files(folder) == files, "it is tidied up");
    assert!(refused(folder, 2, &[]).contains("field: it is finished already"));
}

#[cfg(target_os = "linux")]
#[test]
fn a_part_that_another_process_fitted_meanwhile_stays() {
    let folder = take();
    let folder = folder.path();
    let mut first = start(folder, &fit(&["--segments", "0..3"]));
    let signal = |name: &str| Command::new("kill").args([name, &first.id().to_string()]).status().unwrap();
    wait_for(&folder.join("field/fit/part-0000.lock"));
    assert!(signal("-STOP").success());
    fitted(folder, &["--segments", "2..4"]);
    let part = fs::read(folder.join("field/fit/part-0002")).unwrap();
    assert!(signal("-CONT").success());
    // The field folder needs all parts; another process holds it open until the first has ended.
    let last = folder.join("field/fit/part-0001");
    while !last.exists() && first.try_wait().unwrap().is_none() {
        let now = fs::read(folder.join("field/fit/part-0002"));
        assert!(now.is_err() || now.unwrap() == part, "it is not fitted again");
        thread::sleep(Duration::from_millis(2));
    }
    assert!(first.wait().unwrap().success());
    let files = field_files(folder);
    fs::remove_dir_all(folder.join("field")).unwrap();
    fitted(folder, &["--segments", "2..4"]);
    fitted(folder, &["--segments", "0..3"]);
    assert!(field_files(folder) == files, "as one after another");
}

#[test]
fn a_damaged_photograph_costs_one_even_part_and_other_photographs_are_refused() {
    let folder = take();
    let folder = folder.path();
    let photograph = folder.join("stage/images/00/000002.png");
    let whole = fs::read(&photograph).unwrap();
    fs::write(&photograph, b"no photograph").unwrap();
    let error = refused(folder, 3, &["--segments", "even"]);
    assert!(error.contains("images/00/000002.png"), "{error}");
    let is_fitted = |part: usize| folder.join(format!("field/fit/part-{part:04}")).exists();
    assert!(!is_fitted(0) && is_fitted(2), "the other even part is fitted");

    // Another take of the same rig.
    fs::rename(folder.join("stage"), folder.join("aside")).unwrap();
    let stage = ["synth", "stage", "-o", "stage", "--cameras", "8", "--frames", FRAMES, "--size", "48x48"];
    aarc_studio(folder, &[&stage[..], &["--props"]].concat()).success();
    let error = refused(folder, 2, &["--segments", "even"]);
    assert!(error.contains("field/fit: a fit of other photographs was begun there"), "{error}");

    fs::remove_dir_all(folder.join("stage")).unwrap();
    fs::rename(folder.join("aside"), folder.join("stage")).unwrap();
    fs::write(&photograph, whole).unwrap();
    let json = fitted(folder, &["--segments", "even"]);
    assert_eq!(json["fitted"], 2, "repaired: {json}");
}

#[test]
fn ranges_meet_where_they_end() {
    let folder = take();
    let folder = folder.path();
    let first = fitted(folder, &["--segments", "2..4"]);
    assert_eq!(first["fitted"], 2, "{first}");
    let second = fitted(folder, &["--segments", "0..2"]);
    assert_eq!((&second["fitted"], second["segments"].is_null()), (&4.into(), false), "{second}");
    assert!(measured_take(folder) > 12.5);
}

#[test]
fn a_part_that_was_begun_alone_begins_anew_between_two_others() {
    let folder = take();
    let folder = folder.path();
    for segments in ["0..1", "2..3", "3..4", "1..2"] {
        fitted(folder, &["--segments", segments]);
    }
    let files = field_files(folder);
    fs::remove_dir_all(folder.join("field")).unwrap();

    let alone = fit(&["--segments", "1..2", "--set", "checkpoint-every=0.01"]);
    let checkpoint = folder.join("field/fit/part-0001.checkpoint");
    kill_when(folder, &alone, || checkpoint.exists());
    for segments in ["0..1", "2..3", "3..4"] {
        fitted(folder, &["--segments", segments]);
    }
    assert!(checkpoint.exists(), "of what saw no part beside it");
    fitted(folder, &["--segments", "1..2"]);
    assert!(field_files(folder) == files);
}

#[test]
fn processes_do_not_fit_parts_beside_each_other_at_once() {
    let folder = take();
    let folder = folder.path();
    // It takes longer than those that are refused.
    fn long<'a>(more: &[&'a str]) -> Vec<&'a str> {
        fit(more).into_iter().map(|word| if word == "150" { "2000" } else { word }).collect()
    }
    let refused = |more: &[&str]| aarc_studio(folder, &long(more)).error(2);
    let mut first = start(folder, &long(&["--segments", "1..2", "--set", "checkpoint-every=0.01"]));
    while !folder.join("field/fit/part-0001.checkpoint").exists() {
        assert!(first.try_wait().unwrap().is_none(), "it fits");
        thread::sleep(Duration::from_millis(5));
    }
    for segments in ["0..1", "1..2", "2..3"] {
        let error = refused(&["--segments", segments]);
        assert!(error.contains("field: another process fits part 1; wait for that"), "{segments}: {error}");
    }
    let error = refused(&[]);
    assert!(error.contains("field: another process fits to it"), "{error}");
    let error = refused(&["--segments", "3..4", "--set", "seed=1"]);
    assert!(error.contains("with other options was begun there"), "{error}");
    let output = first.wait_with_output().unwrap();
    assert!(output.status.success(), "the first goes on: {}", String::from_utf8_lossy(&output.stderr));
    assert!(folder.join("field/fit/part-0001").exists());
}

#[test]
fn what_cannot_be_shared_out_is_refused() {
    let folder = take();
    let folder = folder.path();
    for (more, expected) in [
        (&["--segments", "0..5"][..], "--segments 0..5: the take has 4 parts, 0..4; see --split"),
        (&["--segments", "0..2", "--shard", "0/2"], "leave it out for a range"),
        (&["--segments", "some"], "even, odd, or A..B with A below B"),
        (&["--shard", "0/2"], "--segments"),
    ] {
        let error = refused(folder, 2, more);
        assert!(error.contains(expected), "{more:?}: {error}");
    }
    let one = aarc_studio(folder, &["fit", "stage", "-o", "field.ply", "--segments", "even"]).error(2);
    assert!(one.contains("--segments even: field.ply is one field; name a folder"), "{one}");
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_costs_the_part_that_is_fitted_and_nothing_else() {
    let folder = take();
    let folder = folder.path();
    fitted(folder, &["--segments", "0..1"]);
    let before = field_files(folder);
    let error = tool::with_small_disk(folder, 16, &fit(&["--segments", "1..2"])).error(2);
    assert!(error.contains("cannot write field/fit/part-0001") && !error.contains(".writing-"), "{error}");
    let after = field_files(folder);
    assert!(before.iter().all(|(name, file)| after.get(name) == Some(file)), "the other part is whole");
    assert!(!folder.join("field/fit/part-0001").exists(), "nothing half-written");
    let rest = fitted(folder, &[]);
    assert_eq!((&rest["resumed_at"], &rest["fitted"]), (&1.into(), &4.into()), "{rest}");
    assert!(measured_take(folder) > 12.5);
}
