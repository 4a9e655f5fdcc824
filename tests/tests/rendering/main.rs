//! What the renderer draws on this machine's device, held against equations, the reference renderer,
//! golden images and other people's data.

use std::process::ExitCode;

use aarc_tests::gpu;

mod equations;
mod f16;
mod foveation;
mod golden;
mod gpu_vs_reference;
mod left_out;
mod linear_light;
#[path = "../../../codec/refine/src/raster/naive.rs"]
mod naive;
mod pipelines;
mod prefixes;
mod real_data;
mod takes;

fn main() -> ExitCode {
    gpu::run([
        ("equations", equations::trials()),
        ("f16", f16::trials()),
        ("foveation", foveation::trials()),
        ("golden", golden::trials()),
        ("gpu_vs_reference", gpu_vs_reference::trials()),
        ("left_out", left_out::trials()),
        ("linear_light", linear_light::trials()),
        ("pipelines", pipelines::trials()),
        ("prefixes", prefixes::trials()),
        ("real_data", real_data::trials()),
        ("takes", takes::trials()),
    ])
}
