//! Playing leaves no memory behind. One test after the other: they measure the heap of the process.

use std::process::ExitCode;

use aarc_tests::gpu;
use peak_alloc::PeakAlloc;

mod frame_loop;
mod soak;

#[global_allocator]
static HEAP: PeakAlloc = PeakAlloc;

fn main() -> ExitCode {
    gpu::run_in_turn([frame_loop::trials(), soak::trials()].into_iter().flatten().collect())
}
