//! `fit` and `package` with `--backend gpu`, on a stage that a ray tracer made. Without a graphics device these
//! tests are ignored.

mod small_rig;
mod small_stage;
mod tool;

use std::fs;
use std::process::ExitCode;

use libtest_mimic::{Arguments, Completion, Failed, Trial};
use refine::fit::gpu::Gpu;
use small_stage::{fit, kill_when, measured, stage};
use tool::{aarc_studio, has_ffmpeg};

fn main() -> ExitCode {
    let trials = vec![
        with_device("a device fits as the CPU does", fits_as_the_cpu),
        with_device("a device fits whole photographs as the CPU does", fits_whole_photographs),
        with_device("a device slides as the CPU does", slides_as_the_cpu),
        with_device("a device packages as the CPU does, and the package says so", packages_as_the_cpu),
        with_device("the CPU goes on where a device was", goes_on_elsewhere),
    ];
    libtest_mimic::run(&Arguments::from_args(), trials).exit_code()
}

fn with_device(name: &str, test: fn()) -> Trial {
    Trial::ignorable_test(name, move || match Gpu::open() {
        Ok(_) => {
            test();
            Ok::<_, Failed>(Completion::Completed)
        }
        Err(error) => Ok(Completion::ignored_with(error.to_string())),
    })
}

fn fits_as_the_cpu() {
    let folder = stage();
    let folder = folder.path();
    let args = ["--steps", "300", "--gaussians", "800", "--anchor", "hull"];
    fit(folder, &[&args[..], &["--backend", "cpu"]].concat());
    let by_cpu = measured(folder, "train");
    let json = fit(folder, &[&args[..], &["--backend", "gpu"]].concat());
    let backend = json["backend"].as_str().unwrap();
    assert!(backend.starts_with("gpu, "), "{backend}");
    assert!(json["peak_device_bytes"].as_u64() > Some(100_000), "{json}");
    let inspected = aarc_studio(folder, &["inspect", "field.ply", "--json"]).json();
    assert_eq!(inspected["device"].as_str(), backend.strip_prefix("gpu, "));
    let by_device = measured(folder, "train");
    println!("{by_cpu:.2} dB by the CPU, {by_device:.2} dB by {backend}");
    assert!((by_cpu - by_device).abs() < 0.5, "{by_cpu} {by_device}");
    let table = fs::read_to_string(folder.join("field.fit.csv")).unwrap();
    assert!(table.lines().last().unwrap().ends_with(&format!("\"{backend}\"")), "{table}");
}

/// A plate and what moves before it, with alpha wanted and colours of cameras learned.
fn fits_whole_photographs() {
    if !has_ffmpeg() {
        return;
    }
    let folder = small_rig::studio();
    let folder = folder.path();
    let measured = |backend: &str| {
        let line = format!("fit studio -o {backend}.ply --steps 100 --gaussians 400 --backend {backend}");
        small_rig::run(folder, &line).success();
        small_rig::eval(folder, &format!("{backend}.ply"))
    };
    let ([cpu, cpu_subject], [device, device_subject]) = (measured("cpu"), measured("gpu"));
    println!(
        "{cpu:.2} and {cpu_subject:.2} dB by the CPU, {device:.2} and {device_subject:.2} dB by the device"
    );
    assert!((cpu - device).abs() < 0.3 && (cpu_subject - device_subject).abs() < 0.5 && device > 20.0);
}

fn slides_as_the_cpu() {
    let folder = stage();
    let folder = folder.path();
    // Three parts.
    let args = [
        "fit",
        "stage",
        "--split",
        "0.05",
        "--steps",
        "60",
        "--gaussians",
        "300",
        "--sh-degree",
        "0",
        "--json",
    ];
    let measured = |out: &str, backend: &str| {
        let json = aarc_studio(folder, &[&args[..], &["-o", out, "--backend", backend]].concat()).json();
        assert_eq!(json["parts"], 3, "{json}");
        let manifest = fs::read(folder.join(out).join("field.json")).unwrap();
        let manifest: serde_json::Value = serde_json::from_slice(&manifest).unwrap();
        let segment = manifest["segments"][0]["file"].as_str().unwrap().to_owned();
        let inspected = aarc_studio(&folder.join(out), &["inspect", &segment, "--json"]).json();
        assert_eq!(inspected["device"].is_string(), backend == "gpu", "{inspected}");
        let eval = aarc_studio(folder, &["eval", out, "--capture", "stage", "--json"]).json();
        eval["splits"]["train"]["psnr_fg"].as_f64().unwrap()
    };
    let (by_cpu, by_device) = (measured("cpu", "cpu"), measured("gpu", "gpu"));
    println!("{by_cpu:.2} dB by the CPU, {by_device:.2} dB by the device");
    assert!((by_cpu - by_device).abs() < 0.5 && by_device > 14.0, "{by_cpu} {by_device}");
}

fn packages_as_the_cpu() {
    let folder = stage();
    let folder = folder.path();
    fit(folder, &["--steps", "300", "--gaussians", "800", "--anchor", "hull", "--backend", "cpu"]);
    let package = |args: &[&str]| {
        let args = [&["package", "field.ply", "-o", "field.aarc", "--json"], args].concat();
        let json = aarc_studio(folder, &args).json();
        let inspected = aarc_studio(folder, &["inspect", "field.aarc", "--json"]).json();
        (json["bytes"].as_u64().unwrap() as f64, inspected["by_device"].as_bool().unwrap())
    };
    let ((alone, _), (by_cpu, is_marked)) =
        (package(&["--joint-rounds", "0"]), package(&["--joint-rounds", "1", "--backend", "cpu"]));
    let (by_device, is_device_marked) = package(&["--joint-rounds", "1", "--backend", "gpu"]);
    println!("{alone} bytes, jointly {by_cpu} by the CPU, {by_device} by the device");
    assert!(by_cpu.max(by_device) < 0.995 * alone, "{alone} {by_cpu} {by_device}");
    assert_eq!([is_marked, is_device_marked], [false, true]);
    let shown = aarc_studio(folder, &["inspect", "field.aarc"]).success().stdout;
    assert!(shown.contains("by a graphics device"), "{shown}");
    let args = ["package", "field.ply", "-o", "field.aarc", "--backend", "gpu", "--joint-rounds", "0"];
    let refused = aarc_studio(folder, &args).error(2);
    assert!(refused.contains("nothing is fitted, refined or rounded jointly"), "{refused}");
}

fn goes_on_elsewhere() {
    let folder = stage();
    let folder = folder.path();
    let args = ["--steps", "1000", "--gaussians", "400", "--anchor", "hull"];
    let on_device =
        ["fit", "stage", "-o", "field.ply", "--sh-degree", "0", "--holdout", "odd", "--backend", "gpu"];
    let on_device = [&on_device[..], &args, &["--set", "checkpoint-every=0.05"]].concat();
    kill_when(folder, &on_device, || folder.join("field.checkpoint").exists());
    let json = fit(folder, &[&args[..], &["--backend", "cpu"]].concat());
    assert_eq!(json["backend"], "cpu");
    assert!(json["resumed_at"].as_u64() > Some(0), "{json}");
    let psnr = measured(folder, "train");
    assert!(psnr > 18.0, "{psnr} dB");
}
