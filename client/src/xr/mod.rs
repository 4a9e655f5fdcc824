//! The headset: plays a clip on any OpenXR runtime. The only part that names that interface.
//!
//! `runtime` finds runtime and headset and has them open the graphics device; `session` is what is
//! drawn into and where hands come from; `show` is the clip, its clock, the panel and what hands do;
//! this file runs the frames. What follows from the runtime's events is decided in `state`, where an
//! eye looks in `eye`, in what order frames and images are handled in `frame`, all without a runtime.
//! Operating systems differ in `desktop` and `android` alone.
//!
//! One thread does all that is seen: it alone submits to the GPU, because a runtime uses the same
//! queue within the calls it is given ([`Gpu::submit`] checks it). Clips are loaded on another, up
//! to buffers and pipelines, which takes no submission; frames go on meanwhile.

#[cfg(target_os = "android")]
mod android;
mod beam_layer;
mod calls;
#[cfg(not(target_os = "android"))]
mod desktop;
mod error;
mod extensions;
mod eye;
mod frame;
mod input;
pub mod interaction;
mod loading;
mod pacing;
pub mod panel;
mod panel_layer;
mod quad;
mod quality;
mod report;
#[cfg(any(target_os = "android", test))]
mod request;
mod runtime;
mod see_through;
mod session;
mod show;
mod space;
mod state;
mod swapchain;

use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::args::Args;
use crate::gpu::{Failures, Gpu};
#[cfg(target_os = "android")]
use android::System;
#[cfg(not(target_os = "android"))]
use desktop::System;
use error::Halt;
use loading::Request;
use program::{Fault, output};
use quality::Quality;
use report::Report;
use runtime::Runtime;
use session::{Asked, Session};
use show::Show;
use state::{Action, Life};

/// How often to look for events while the runtime wants no frames.
const IDLE_POLL: Duration = Duration::from_millis(10);

/// Plays the clip that `args` name in a headset, until the runtime or the viewer ends it.
///
/// # Errors
/// [`Fault::Device`] if there is no runtime or headset, or it goes away; as [`crate::clips::open`].
#[cfg(not(target_os = "android"))]
pub fn run(args: &Args) -> Result<(), Fault> {
    play(args, &mut System)
}

/// The same on a given system.
fn play(args: &Args, system: &mut System) -> Result<(), Fault> {
    if args.out.is_some() && args.frames.is_none() {
        return Err(Fault::Usage("--xr --out writes the last of the frames: give --frames A..B".into()));
    }
    args.out.as_ref().map_or(Ok(()), |folder| output::check_folder(folder))?;
    args.stats.as_ref().map_or(Ok(()), |path| output::check(path))?;
    let started = Instant::now();
    let runtime = Runtime::open(system)?;
    let (gpu, handles) = Gpu::from_vulkan(&runtime)?;
    let gpu = Arc::new(gpu);
    let failures = Failures::collect(&gpu);
    // A run of a number of frames is for measuring: it neither adapts nor remembers.
    let (adapts, store) = match args.frames {
        None => (true, system.store()),
        Some(_) => (false, None),
    };
    let quality = Quality::new(args.settings(), args.quality, adapts);
    let request = Request {
        name: args.clip.clone(),
        kept: system.cache_dir(),
        // What is measured is the whole clip.
        layers: adapts.then(|| args.layer.map_or(1, |layers| layers as usize)),
    };
    let mut show = Show::new(gpu.clone(), request, quality, store, adapts);
    let mut report = Report::new(args, started);
    loop {
        let mut session = Session::open(&runtime, &gpu, &handles, args.out.is_some())?;
        show.prepare(session.format(), session.can_see_through())?;
        match watch(system, &runtime, &mut session, &mut show, &mut report, &failures) {
            Ok(()) => break,
            Err(Halt::SessionLost) => {
                log::warn!("the headset's session was lost: starting another");
                report.lose_session();
                drop(session);
                runtime.wait_for_headset(system)?;
            }
            Err(Halt::Fault(fault)) => return Err(fault),
        }
    }
    show.save();
    report.write(args, &runtime, &gpu, &mut show)?;
    show.outcome()
}

/// Runs a session to its end.
fn watch(
    system: &mut System,
    runtime: &Runtime,
    session: &mut Session,
    show: &mut Show,
    report: &mut Report,
    failures: &Failures,
) -> Result<(), Halt> {
    let mut life = Life::default();
    loop {
        // A frame has its own time to wait for.
        if system.wait(if life.wants_frames() { Duration::ZERO } else { IDLE_POLL }) {
            return Ok(());
        }
        while let Some(event) = session.poll(runtime)? {
            let (next, action) = life.on(event);
            life = next;
            match action {
                None => {}
                Some(Action::Begin) => session.begin()?,
                Some(Action::End) => {
                    session.end()?;
                    show.save();
                }
                Some(Action::Leave) => return Ok(()),
                Some(Action::Renew) => return Err(Halt::SessionLost),
                Some(Action::Replace { at_ns }) => show.replace_at(at_ns),
                Some(Action::Fail) => return Err(Halt::Fault(error::instance_lost())),
            }
        }
        failures.check(show.gpu()).map_err(Halt::Fault)?;
        if !life.wants_frames() {
            continue;
        }
        let asked = session.frame(show, report, life.has_focus())?;
        if asked == Asked::Exit && life.ask_exit() {
            session.request_exit()?;
        }
    }
}
