//! `cargo xtask headset` from end to end, with a script in place of `adb` and a folder in place of the headset.

use std::env;
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::process::Command;

use aarc_tests::outcome::{DATA, DEVICE, Outcome};
use aarc_tests::programs::{Folder, run};
use libtest_mimic::{Failed, Trial};
use xtask::workspace;

/// The tests of this file.
pub(crate) fn trials() -> Vec<Trial> {
    let trial = |name: &str, test: fn() -> Result<(), String>| {
        Trial::test(name, move || test().map_err(Failed::from))
    };
    vec![
        trial("a headset is measured from end to end", end_to_end),
        trial("finished rows survive a headset that goes away", lost),
        trial("a headset that cannot be measured is one sentence", refusals),
    ]
}

/// The headset is the folder `$FAKE`; the player in it ends at once. `$FAIL` chooses a failure.
const ADB: &str = r#"#!/bin/sh
echo "$*" >> "$FAKE/log"
files="$FAKE/files"
if [ "$1" = devices ]; then
  echo "List of devices attached"
  [ -e "$FAKE/gone" ] || printf "$DEVICES"
  exit 0
fi
shift 2
if [ -e "$FAKE/gone" ]; then echo "adb: device 'quest' not found" >&2; exit 1; fi
case "$1 $2" in
  install*)
    if [ "$FAIL" = install ]; then echo "adb: failed to install: INSTALL_FAILED_UPDATE_INCOMPATIBLE" >&2; exit 1; fi ;;
  push*) cp "$2" "$files/${3##*/}" ;;
  pull*) cp "$files/${2##*/}" "$3" ;;
  "shell [ -e "*"/files ]"*) [ -e "$files" ] && echo yes || echo no ;;
  "shell [ -e "*measured.json*) [ -e "$files/measured.json" ] && echo yes || echo no ;;
  "shell date +%s") echo 1700000000 ;;
  "shell rm -f "*) rm -f "$files/measured.json" ;;
  "shell am force-stop"*"rm -f"*) rm -f "$files/measured.json" "$files/measured.aarc" ;;
  "shell am force-stop"*) ;;
  "shell am start"*"--es clip measured.aarc --es args"*)
    if [ "$FAIL" = gone ] && [ "$(grep -c 'es args' "$FAKE/log")" = 3 ]; then touch "$FAKE/gone"; exit 1; fi
    if [ "$FAIL" = player ]; then echo "the intent's args: only for development builds" > "$FAKE/errors"; exit 0; fi
    [ -e "$files/measured.aarc" ] && cp "$FAKE/stats.json" "$files/measured.json" ;;
  "shell am start"*) mkdir -p "$files" ;;
  "shell logcat -d -v raw -T 1700000000.000 -s aarc:E")
    echo "--------- beginning of main"; cat "$FAKE/errors" 2> /dev/null || true ;;
  "shell logcat -d -v raw -T 1700000000.000 -s VrApi")
    echo "FPS=72/72,Prd=38ms,CPU4/GPU=2/4,1651/670MHz,OC=FF" ;;
  *) echo "unknown: $*" >&2; exit 9 ;;
esac
"#;

const STATS: &str = r#"{"runtime": "Oculus 1.2", "headset": "Quest 9", "adapter": "Adreno", "driver": "1.0",
"f16": true, "width": 1680, "height": 1760, "gaussians": 42978, "display_hz": 90.0, "frames_missed": 54,
"measured": {"frames": 5346, "seconds": 60.0}, "quality": {"frames": [10, 90, 0, 0, 0, 0]},
"cpu_ms": {"median": 1.5, "p95": 2.25}, "gpu_ms": {"median": 8.0, "p95": 9.125}}"#;

const ROW: &str =
    "42978 | DISTANCE | 89.1 | 90 | 54 (1.0 %) | 1.50 / 2.25 | 8.00 / 9.12 | Fine (90 %) | 1651 / 670 |";

/// A folder with the script, two clips and an APK.
fn desk() -> Result<Folder, String> {
    let folder = Folder::default();
    for (name, text) in
        [("adb", ADB), ("a.aarc", "a"), ("b.aarc", "b"), ("aarc.apk", "apk"), ("stats.json", STATS)]
    {
        folder.write(name, text.as_bytes());
    }
    let mode = fs::Permissions::from_mode(0o755);
    fs::set_permissions(folder.path("adb"), mode).map_err(|error| error.to_string())?;
    Ok(folder)
}

/// Measures in a folder with this list of devices and this failure.
fn headset(folder: &Folder, line: &str, devices: &str, failure: &str) -> Result<Outcome, String> {
    Ok(run(measurement(folder, line)?.env("DEVICES", devices).env("FAIL", failure)))
}

/// A measurement that finds the script first.
fn measurement(folder: &Folder, line: &str) -> Result<Command, String> {
    let xtask = workspace::build("xtask", "dev").map_err(|fault| fault.to_string())?;
    let programs = env::var_os("PATH").unwrap_or_default();
    let programs = env::join_paths([folder.path("")].into_iter().chain(env::split_paths(&programs)));
    let mut command = folder.command(&xtask, &format!("headset -o out {line}"));
    command
        .env("PATH", programs.map_err(|error| error.to_string())?)
        .env("FAKE", folder.path(""))
        .env_remove("ANDROID_SERIAL");
    Ok(command)
}

const READY: &str = "quest\\tdevice\\n";

/// The rows of these clips at all distances.
fn rows(clips: &[&str]) -> Vec<String> {
    let row = |clip: &str, distance: &str| format!("| {clip} | {}", ROW.replace("DISTANCE", distance));
    clips.iter().flat_map(|clip| ["near", "standing", "inside"].map(|distance| row(clip, distance))).collect()
}

fn end_to_end() -> Result<(), String> {
    let folder = desk()?;
    let outcome = headset(&folder, "a.aarc b.aarc", READY, "")?.success();
    let table = String::from_utf8_lossy(&folder.read("out/table.md")?).into_owned();
    if outcome.stdout != table {
        return Err(format!("{table}was written and printed was\n{}", outcome.stdout));
    }
    let lines: Vec<&str> = table.lines().collect();
    let about = "Quest 9, Oculus 1.2, 1680x1760 pixels an eye, Adreno, 1.0, fragments in f16; ";
    if !lines[0].starts_with(about) || lines[4..] != rows(&["a", "b"]) {
        return Err(table);
    }
    for name in ["out/1-a-near.json", "out/2-b-inside.json"] {
        if folder.read(name)? != STATS.as_bytes() {
            return Err(format!("{name} is not what the player wrote"));
        }
    }
    let log = String::from_utf8_lossy(&folder.read("log")?).into_owned();
    let starts = log.matches("--es args '--inside --seconds 60 --stats measured.json'").count();
    let left = fs::read_dir(folder.path("files")).map_err(|error| error.to_string())?.count();
    if starts != 2 || left != 0 || !log.contains("install -r aarc.apk") {
        return Err(format!("{left} files are left on the headset after\n{log}"));
    }
    Ok(())
}

fn lost() -> Result<(), String> {
    let folder = desk()?;
    let outcome = headset(&folder, "a.aarc b.aarc", READY, "gone")?;
    let table = String::from_utf8_lossy(&folder.read("out/table.md")?).into_owned();
    let error = outcome.stderr.lines().last().unwrap_or_default();
    let names_both =
        error.starts_with("error: the headset quest is gone") && error.contains("2 finished rows");
    if outcome.code != Some(DEVICE) || !names_both || table.lines().skip(4).ne(rows(&["a"])[..2].iter()) {
        return Err(format!("{outcome:?}\n{table}"));
    }
    Ok(())
}

fn refusals() -> Result<(), String> {
    let cases = [
        ("a.aarc", "", "", DEVICE, "no headset is attached"),
        ("a.aarc", "a\\tdevice\\nb\\tdevice\\n", "", DEVICE, "2 devices are attached"),
        ("a.aarc", "quest\\tunauthorized\\n", "", DEVICE, "does not allow debugging"),
        ("a.aarc", READY, "install", DEVICE, "INSTALL_FAILED_UPDATE_INCOMPATIBLE"),
        (
            "a.aarc",
            READY,
            "player",
            DEVICE,
            "the player ended: the intent's args: only for development builds",
        ),
        ("none.aarc", READY, "", DATA, "none.aarc"),
    ];
    for (line, devices, failure, code, what) in cases {
        let folder = desk()?;
        let outcome = headset(&folder, line, devices, failure)?;
        let error = outcome.stderr.lines().last().unwrap_or_default();
        let is_one = outcome.stderr.lines().filter(|line| line.starts_with("error: ")).count() == 1;
        if outcome.code != Some(code)
            || !error.contains(what)
            || !is_one
            || folder.path("out/table.md").exists()
        {
            return Err(format!("{what:?} was expected: {outcome:?}"));
        }
    }
    let folder = desk()?;
    let mut alone = measurement(&folder, "a.aarc")?;
    run(alone.env("PATH", folder.path("files"))).refuses(DEVICE, "adb devices", "platform tools")?;
    fs::remove_file(folder.path("aarc.apk")).map_err(|error| error.to_string())?;
    headset(&folder, "a.aarc", READY, "")?.refuses(DATA, "aarc.apk", "client/HEADSET.md")
}
