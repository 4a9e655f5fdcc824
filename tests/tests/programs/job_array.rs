//! Many takes on a cluster: a job array on a real Slurm, in which one take fails.

use std::fs;
use std::path::Path;

use ::studio::export::field_file;
use aarc_tests::outcome::Outcome;
use aarc_tests::programs::{run, studio};
use aarc_tests::scene::{Motion, Recipe, info};
use aarc_tests::slurm::{Cluster, MISSING, quoted};
use libtest_mimic::{Completion, Failed, Trial};
use serde_json::Value;

/// The tests of this file.
pub(crate) fn trials() -> Vec<Trial> {
    let array =
        Trial::ignorable_test(
            "a job array packages all takes except the broken one",
            || match Cluster::start() {
                Some(cluster) => job_array(&cluster).map(|()| Completion::Completed).map_err(Failed::from),
                None => Ok(Completion::ignored_with(MISSING)),
            },
        );
    vec![array]
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
        field_file(&recipe.field(), &info())
    };
    for (seed, take) in TAKES.into_iter().enumerate() {
        write(
            &format!("{take}.ply"),
            &if seed == BROKEN { b"no field".to_vec() } else { field(seed as u64) },
        );
    }
    write("takes.txt", TAKES.map(|take| format!("{take}.ply\n")).concat().as_bytes());

    // The command of xtask/README.md, with this build's program.
    let submit = || -> Outcome {
        let program = quoted(studio());
        let wrap = format!(
            "{program} package --list takes.txt --shard $SLURM_ARRAY_TASK_ID/3 --coder fixed -o clips"
        );
        run(cluster.command("sbatch").current_dir(folder.path()).args([
            "--wait",
            "--array=0-2",
            "--output=%a.log",
            "--wrap",
            &wrap,
        ]))
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

fn is_package(path: &Path) -> bool {
    fs::read(path).is_ok_and(|bytes| codec::decode(&bytes, &codec::Limits::default()).is_ok())
}
