//! Tests that measure the memory and the times of this process, and so run one after the other.

use std::process::ExitCode;

use aarc_tests::gpu;
use peak_alloc::PeakAlloc;

mod footprint;
mod frame_loop;
mod playing;
mod soak;
mod stability;
mod takes;

#[global_allocator]
static HEAP: PeakAlloc = PeakAlloc;

fn main() -> ExitCode {
    gpu::run_in_turn([
        ("footprint", footprint::trials()),
        ("frame_loop", frame_loop::trials()),
        ("takes", takes::trials()),
        // Before most others: what drivers keep of them looks like growth, or hides it.
        ("soak", soak::trials()),
        ("playing", playing::trials()),
        ("stability", stability::trials()),
    ])
}
