//! Job arrays on a real Slurm: many takes, and the parts of one take. One take fails, and one part.

use std::fs;
use std::path::Path;
use std::process::Command;

use aarc_tests::outcome::Outcome;
use aarc_tests::programs::{run, studio};
use aarc_tests::scene::{Motion, Recipe, info};
use aarc_tests::slurm::{Cluster, MISSING, quoted};
use formats::write_field_file;
use libtest_mimic::{Completion, Failed, Trial};
use serde_json::Value;

/// The tests of this file.
pub(crate) fn trials() -> Vec<Trial> {
    let trial = |name: &str, test: fn(&Cluster) -> Result<(), String>| {
        Trial::ignorable_test(name, move || match Cluster::start() {
            Some(cluster) => test(&cluster).map(|()| Completion::Completed).map_err(Failed::from),
            None => Ok(Completion::ignored_with(MISSING)),
        })
    };
    vec![
        trial("a job array packages all takes except the broken one", job_array),
        trial("two job arrays fit the even and the odd parts of a take", parts_of_a_take),
    ]
}

const TAKES: [&str; 5] = ["walk", "run", "jump", "turn", "bow"];

/// Number of the broken take, which is also its shard.
const BROKEN: usize = 1;

fn job_array(cluster: &Cluster) -> Result<(), String> {
    let folder = tempfile::tempdir().expect("temporary files can be made");
    let path = |name: &str| folder.path().join(name);
    let write =
        |name: &str, bytes: &[u8]| fs::write(path(name), bytes).expect("temporary files can be written");
    let field = |seed| {
        let recipe = Recipe {
            count: 100,
            sh_degree: 0,
            motion: Motion::Dynamic,
            motion_order: 1,
            turning: false,
            seed,
        };
        write_field_file(&recipe.field(), &info())
    };
    for (seed, take) in TAKES.into_iter().enumerate() {
        write(
            &format!("{take}.ply"),
            &if seed == BROKEN { b"no field".to_vec() } else { field(seed as u64) },
        );
    }
    write("takes.txt", TAKES.map(|take| format!("{take}.ply\n")).concat().as_bytes());

    // The command of xtask/README.md.
    let submit = || {
        let line = "package --list takes.txt --shard $SLURM_ARRAY_TASK_ID/3 --coder fixed -o clips";
        submit(cluster, folder.path(), "0-2", line)
    };
    let summary = |shard: usize| -> Result<Value, String> {
        let name = format!("clips/package-{shard}-of-3.summary.json");
        let log = fs::read_to_string(path(&format!("{shard}.log"))).unwrap_or_default();
        let text = fs::read(path(&name)).map_err(|error| format!("{name}: {error}: {log}"))?;
        serde_json::from_slice(&text).map_err(|error| format!("{name}: {error}"))
    };
    let counts = |summary: &Value| ["done", "skipped", "failed"].map(|key| summary[key].as_u64());

    let outcome = submit();
    let first = [summary(0)?, summary(1)?, summary(2)?];
    if outcome.code != Some(3) {
        return Err(format!("the array ends with the code of bad data: {outcome:?}"));
    }
    let expected = [[2, 0, 0], [1, 0, 1], [1, 0, 0]].map(|shard| shard.map(Some));
    if first.each_ref().map(counts) != expected {
        return Err(format!("{first:#?}"));
    }
    let failed = &first[1]["takes"][0];
    let why = failed["error"].as_str().unwrap_or_default();
    if failed["outcome"] != "failed" || failed["exit_code"] != 3 || !why.contains("run.ply") {
        return Err(format!("the failure is not named: {failed}"));
    }
    for (number, take) in TAKES.into_iter().enumerate() {
        if is_package(&path(&format!("clips/{take}.aarc"))) != (number != BROKEN) {
            return Err(format!("{take}: {:?}", fs::read_dir(path("clips"))));
        }
    }

    // After a repair, the same command packages only the repaired take.
    write("run.ply", &field(9));
    let outcome = submit();
    let again = [summary(0)?, summary(1)?, summary(2)?];
    let expected = [[0, 2, 0], [1, 1, 0], [0, 1, 0]].map(|shard| shard.map(Some));
    if outcome.code != Some(0) || again.each_ref().map(counts) != expected {
        return Err(format!("{outcome:?} {again:#?}"));
    }
    if is_package(&path("clips/run.aarc")) { Ok(()) } else { Err("run.aarc is missing".into()) }
}

/// Runs a command line of this build's program as a job array and waits for it; job N writes `N.log`.
fn submit(cluster: &Cluster, folder: &Path, array: &str, line: &str) -> Outcome {
    run(cluster.command("sbatch").current_dir(folder).args([
        "--wait",
        &format!("--array={array}"),
        "--output=%a.log",
        "--wrap",
        &format!("{} {line}", quoted(studio())),
    ]))
}

/// 1.6 seconds of a stage: four parts of 0.4 s, two of them even and two odd.
fn parts_of_a_take(cluster: &Cluster) -> Result<(), String> {
    let folder = tempfile::tempdir().expect("temporary files can be made");
    let path = |name: &str| folder.path().join(name);
    let log = |job: usize| fs::read_to_string(path(&format!("{job}.log"))).unwrap_or_default();
    let stage = ["synth", "stage", "-o", "stage", "--cameras", "8", "--frames", "49", "--size", "48x48"];
    let stage = run(Command::new(studio()).current_dir(folder.path()).args(stage));
    if stage.code != Some(0) {
        return Err(format!("{stage:?}"));
    }
    // Part 2 alone needs it.
    let photograph = path("stage/images/00/000030.png");
    let whole = fs::read(&photograph).expect("a photograph of the stage");
    fs::write(&photograph, b"no photograph").expect("temporary files can be written");
    // The commands of xtask/README.md.
    let submit = |segments: &str| {
        let options = "--split 0.4 --steps 100 --gaussians 300 --sh-degree 0";
        let shard = "--shard $SLURM_ARRAY_TASK_ID/2";
        let line = format!("fit stage -o field --segments {segments} {shard} {options}");
        submit(cluster, folder.path(), "0-1", &line)
    };

    let even = submit("even");
    if even.code != Some(3) || !log(0).contains("1 of 4 parts fitted") || !log(1).contains("000030.png") {
        return Err(format!("one job of the even parts fails: {even:?}\n{}\n{}", log(0), log(1)));
    }
    let odd = submit("odd");
    for (job, part) in [(0, 1), (1, 3)] {
        let missing = format!("part {part} lies between two others, and part 2 is not fitted");
        if odd.code != Some(2) || !log(job).contains(&missing) {
            return Err(format!("the odd parts beside it say so: {odd:?}\n{}", log(job)));
        }
    }

    // After a repair, the same commands fit what is missing.
    fs::write(&photograph, whole).expect("temporary files can be written");
    for segments in ["even", "odd"] {
        let outcome = submit(segments);
        if outcome.code != Some(0) {
            return Err(format!("{segments}: {outcome:?}\n{}\n{}", log(0), log(1)));
        }
    }
    match is_take(&path("field")) && !path("field/fit").exists() {
        true => Ok(()),
        false => Err(format!("no field folder: {}\n{}", log(0), log(1))),
    }
}

fn is_take(folder: &Path) -> bool {
    let manifest = fs::read(folder.join("field.json")).unwrap_or_default();
    let manifest: Value = serde_json::from_slice(&manifest).unwrap_or_default();
    let segments = manifest["segments"].as_array();
    segments.is_some_and(|segments| {
        let path = |segment: &Value| folder.join(segment["file"].as_str().unwrap_or_default());
        !segments.is_empty() && segments.iter().all(|segment| path(segment).is_file())
    })
}

fn is_package(path: &Path) -> bool {
    fs::read(path).is_ok_and(|bytes| codec::decode(&bytes, &codec::Limits::default()).is_ok())
}
