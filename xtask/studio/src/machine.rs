//! [`machine`]: describes the machine of a measurement.

use std::fs;
use std::thread;

/// Processor, number of cores and system, in a line.
pub fn machine() -> String {
    let cpu = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = cpu.lines().find_map(|line| line.strip_prefix("model name")?.split_once(": "));
    let model = model.map_or("processor of unknown model", |(_, model)| model);
    let cores = thread::available_parallelism().map_or(1, |cores| cores.get());
    format!("{model}, {cores} cores, {} {}", std::env::consts::OS, std::env::consts::ARCH)
}
