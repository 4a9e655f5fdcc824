//! `--list` and `--shard`: takes that are done, changed, or fail.

use std::fs;
use std::path::Path;
use std::time::SystemTime;

use crate::small_stage;
use crate::support::{field, info};
use crate::tool::{Outcome, aarc_studio};
use codec::{Field, Limits};
use formats::write_field_file;
use serde_json::Value;
use tempfile::{TempDir, tempdir};

const NAMES: [&str; 3] = ["walk", "run", "jump"];

/// Three takes and their list: two field files and a folder.
fn studio_day() -> TempDir {
    let folder = tempdir().unwrap();
    fs::create_dir(folder.path().join("run")).unwrap();
    for (i, file) in ["walk.ply", "run/field.ply", "jump.ply"].into_iter().enumerate() {
        write_field(&folder.path().join(file), 100 + i);
    }
    fs::write(folder.path().join("takes.txt"), "walk.ply\nrun\n\njump.ply\n").unwrap();
    folder
}

fn write_field(path: &Path, count: usize) {
    let field = Field { log_scales: vec![[-3.0; 3]; count], ..field(count, 0, Some(1), false) };
    fs::write(path, write_field_file(&field, &info())).unwrap();
}

fn package(folder: &Path, more: &[&str]) -> Outcome {
    let args = ["package", "--list", "takes.txt", "-o", "clips", "--coder", "fixed"];
    aarc_studio(folder, &[&args, more].concat())
}

/// What became of the takes, by the summary of a run.
fn outcomes(summary: &Value) -> Vec<&str> {
    let takes = summary["takes"].as_array().unwrap();
    takes.iter().map(|take| take["outcome"].as_str().unwrap()).collect()
}

fn clip_len(path: &Path) -> usize {
    codec::decode(&fs::read(path).unwrap(), &Limits::default()).unwrap().len()
}

#[test]
fn finished_takes_are_skipped_until_an_input_changes() {
    let folder = studio_day();
    let folder = folder.path();
    let run = |more: &[&str]| package(folder, &[&["--json"], more].concat()).json();
    let summary = run(&[]);
    assert_eq!(outcomes(&summary), ["done"; 3], "{summary}");
    assert_eq!(
        (&summary["done"], &summary["failed"], &summary["shard"]),
        (&3.into(), &0.into(), &"0/1".into())
    );
    let kept = fs::read(folder.join("clips/package-0-of-1.summary.json")).unwrap();
    assert_eq!(serde_json::from_slice::<Value>(&kept).unwrap(), summary);
    let playlist: Value =
        serde_json::from_slice(&fs::read(folder.join("clips/playlist.json")).unwrap()).unwrap();
    assert_eq!(playlist["clips"], serde_json::json!(NAMES.map(|name| format!("{name}.aarc"))));
    let record: Value =
        serde_json::from_slice(&fs::read(folder.join("clips/run.aarc.done.json")).unwrap()).unwrap();
    assert_eq!(record["report"]["gaussians_in"], 101, "{record}");

    assert_eq!(outcomes(&run(&[])), ["skipped"; 3]);
    let written = |name: &str| fs::metadata(folder.join(name)).unwrap().modified().unwrap();
    let before = written("clips/walk.aarc");
    // An input.
    write_field(&folder.join("run/field.ply"), 120);
    assert_eq!(outcomes(&run(&[])), ["skipped", "done", "skipped"]);
    let record: Value =
        serde_json::from_slice(&fs::read(folder.join("clips/run.aarc.done.json")).unwrap()).unwrap();
    let len = clip_len(&folder.join("clips/run.aarc"));
    assert_eq!(
        (&record["report"]["gaussians_in"], &record["report"]["gaussians_out"]),
        (&120.into(), &len.into())
    );
    assert_eq!(written("clips/walk.aarc"), before);
    // A new input, by its name.
    fs::write(folder.join("run/scene.json"), r#"{"fps": 12}"#).unwrap();
    assert_eq!(outcomes(&run(&[])), ["skipped", "done", "skipped"]);
    // An option, there and back.
    assert_eq!(outcomes(&run(&["--drop", "sh"])), ["done"; 3]);
    assert_eq!(outcomes(&run(&[])), ["done"; 3]);
    // Outputs that are not what was made.
    let jump = folder.join("clips/jump.aarc");
    let whole = fs::read(&jump).unwrap();
    fs::write(&jump, &whole[..whole.len() / 2]).unwrap();
    fs::remove_file(folder.join("clips/walk.aarc")).unwrap();
    assert_eq!(outcomes(&run(&[])), ["done", "skipped", "done"]);
    assert_eq!(fs::read(&jump).unwrap(), whole);
    // A run that was interrupted before it took note.
    fs::remove_file(folder.join("clips/jump.aarc.done.json")).unwrap();
    assert_eq!(outcomes(&run(&[])), ["skipped", "skipped", "done"]);
}

#[test]
fn a_failed_take_is_named_and_does_not_stop_the_others() {
    let folder = studio_day();
    let folder = folder.path();
    fs::write(folder.join("run/field.ply"), "no field").unwrap();
    let outcome = package(folder, &["--json"]);
    assert_eq!(outcome.code, Some(3), "{}", outcome.stderr);
    assert!(outcome.stderr.contains("1 of 3 takes failed, run first"), "{}", outcome.stderr);
    let summary: Value = serde_json::from_str(&outcome.stdout).unwrap();
    assert_eq!(outcomes(&summary), ["done", "failed", "done"]);
    let failed = &summary["takes"][1];
    assert!(failed["exit_code"] == 3 && failed["error"].as_str().unwrap().contains("field.ply"), "{failed}");
    let there = NAMES.map(|name| folder.join(format!("clips/{name}.aarc")).exists());
    assert_eq!(there, [true, false, true]);

    // For people, a line for each as it comes.
    let words = package(folder, &[]);
    let lines: Vec<&str> = words.stdout.lines().collect();
    assert!(words.code == Some(3) && lines.len() == 3, "{}", words.stdout);
    assert!(lines[0].starts_with("skipped ") && lines[1].starts_with("failed   run: "), "{}", words.stdout);

    write_field(&folder.join("run/field.ply"), 101);
    assert_eq!(outcomes(&package(folder, &["--json"]).json()), ["skipped", "done", "skipped"]);
}

#[test]
fn shards_do_everything_once() {
    let folder = studio_day();
    let folder = folder.path();
    let run = |shard: &str| package(folder, &["--json", "--shard", shard]).json();
    assert_eq!(outcomes(&run("1/2")), ["done"]);
    assert!(folder.join("clips/run.aarc").exists() && !folder.join("clips/walk.aarc").exists());
    assert_eq!(outcomes(&run("0/2")), ["done"; 2]);
    assert_eq!(outcomes(&run("7/8")), [""; 0]);
    assert_eq!(outcomes(&package(folder, &["--json"]).json()), ["skipped"; 3]);
    let summaries = ["0-of-2", "1-of-2", "7-of-8", "0-of-1"];
    assert!(summaries.iter().all(|name| folder.join(format!("clips/package-{name}.summary.json")).exists()));
}

#[test]
fn what_cannot_be_is_said_before_anything_is_done() {
    let folder = studio_day();
    let folder = folder.path();
    let error = |code, args: &[&str]| aarc_studio(folder, args).error(code);
    fs::write(folder.join("twice.txt"), "walk.ply\nold/walk.spz\n").unwrap();
    fs::write(folder.join("tab.txt"), "walk\tone.ply\n").unwrap();
    let list = |name| ["package", "--list", name, "-o", "clips"];
    assert!(error(3, &list("twice.txt")).contains("lines 1 and 2"));
    assert!(error(3, &list("nowhere.txt")).contains("nowhere.txt"));
    assert!(error(3, &list("tab.txt")).contains("no control characters"));
    assert!(
        error(2, &["package", "--list", "takes.txt", "-o", "walk.ply"]).contains("cannot make the folder")
    );
    // The command line's own parser explains itself in several lines.
    for args in [
        &["package", "--list", "takes.txt"][..],
        &["package", "walk.ply", "--list", "takes.txt", "-o", "clips"],
        &["package", "--list", "takes.txt", "-o", "clips", "--shard", "2/2"],
        &["package", "walk.ply", "--shard", "0/2"],
        &["package"],
        &["fit", "--list", "takes.txt", "-o", "fields", "--from", "walk.ply"],
    ] {
        assert_eq!(aarc_studio(folder, args).code, Some(2), "{args:?}");
    }
    assert!(!folder.join("clips").exists());
    // Within a take, an output would change it each time.
    let within = aarc_studio(folder, &["package", "--list", "takes.txt", "-o", "run", "--coder", "fixed"]);
    assert!(within.code == Some(2) && within.stdout.contains("would lie within"), "{}", within.stdout);
    // The folder around such a file is the take.
    fs::create_dir(folder.join("sit")).unwrap();
    fs::write(folder.join("sit/meta.json"), "{}").unwrap();
    fs::write(folder.join("sit.txt"), "sit/meta.json\n").unwrap();
    let within =
        aarc_studio(folder, &["package", "--list", "sit.txt", "-o", "sit/clips", "--coder", "fixed"]);
    assert!(within.code == Some(2) && within.stdout.contains("would lie within sit"), "{}", within.stdout);
}

/// Each capture of a list is fitted, and an interrupted fit resumes.
#[test]
fn interrupted_fits_resume() {
    let folder = small_stage::stage();
    let folder = folder.path();
    fs::write(folder.join("takes.txt"), "stage\nnowhere\n").unwrap();
    let args = |steps| {
        [
            "fit",
            "--list",
            "takes.txt",
            "-o",
            "fields",
            "--steps",
            steps,
            "--gaussians",
            "300",
            "--sh-degree",
            "0",
        ]
    };
    let kill_at_work = |steps| {
        let checkpoint = folder.join("fields/stage.checkpoint");
        let args = [&args(steps)[..], &["--set", "checkpoint-every=0.02"]].concat();
        small_stage::kill_when(folder, &args, || checkpoint.exists());
    };
    kill_at_work("2000");
    let outcome = aarc_studio(folder, &[&args("2000")[..], &["--json"]].concat());
    assert_eq!(outcome.code, Some(3), "{}", outcome.stderr);
    assert_eq!(outcomes(&serde_json::from_str(&outcome.stdout).unwrap()), ["done", "failed"]);
    let record = || -> Value {
        serde_json::from_slice(&fs::read(folder.join("fields/stage.ply.done.json")).unwrap()).unwrap()
    };
    assert!(record()["report"]["resumed_at"].as_u64().unwrap() > 0, "{}", record());

    // With another option, neither the result nor half a work is good any more.
    kill_at_work("1000");
    let outcome = aarc_studio(folder, &[&args("50")[..], &["--json"]].concat());
    assert_eq!(outcomes(&serde_json::from_str(&outcome.stdout).unwrap()), ["done", "failed"]);
    assert_eq!((&record()["report"]["resumed_at"], &record()["report"]["steps"]), (&0.into(), &50.into()));
    assert_eq!(
        outcomes(&{
            let again = aarc_studio(folder, &[&args("50")[..], &["--json"]].concat());
            serde_json::from_str(&again.stdout).unwrap()
        }),
        ["skipped", "failed"]
    );
}

/// The field of a capture is fitted once.
#[test]
fn captures_become_packages() {
    let folder = tempdir().unwrap();
    let folder = folder.path();
    let stage = ["synth", "stage", "-o", "stage", "--cameras", "4", "--frames", "1", "--size", "16x16"];
    assert_eq!(aarc_studio(folder, &stage).code, Some(0));
    fs::write(folder.join("takes.txt"), "stage\n").unwrap();
    let run = || package(folder, &["--json"]);
    assert_eq!(outcomes(&run().json()), ["done"]);
    let fitted =
        || -> SystemTime { fs::metadata(folder.join("clips/stage.ply")).unwrap().modified().unwrap() };
    let first = fitted();
    fs::remove_file(folder.join("clips/stage.aarc")).unwrap();
    assert_eq!((outcomes(&run().json()), fitted()), (vec!["done"], first));
    // A field that someone else put there stays.
    fs::remove_file(folder.join("clips/stage.ply.done.json")).unwrap();
    fs::remove_file(folder.join("clips/stage.aarc")).unwrap();
    let outcome = run();
    assert!(outcome.code == Some(2) && outcome.stdout.contains("is there already"), "{}", outcome.stdout);
    assert_eq!(fitted(), first);
}
