//! The headset's loop: sessions of a runtime, one after the other, and the frames of each.

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::System;
use super::report::Report;
use super::runtime::Runtime;
use super::runtime::error::{self, Halt};
use super::session::state::{Action, Renewals, SessionLifecycle};
use super::session::{Request, Session};
use crate::args::Args;
use crate::audio::Speaker;
use crate::clips::LoadOptions;
use crate::content::SourceOptions;
use crate::gpu::{ChannelDepth, DEVICE_REPLACED, Failures, Gpu, VulkanHandles, choose_f16};
use crate::headset::notify;
use crate::headset::show::Show;
use crate::headset::show::place::Place;
use crate::headset::show::quality::Quality;
use crate::pipeline_folder::PipelineFolder;
use program::Fault;
use program::output;

/// How often to look for events while the runtime wants no frames.
const IDLE_POLL: Duration = Duration::from_millis(10);

/// Plays the clip that `args` name in a headset, until the runtime or the viewer ends it.
///
/// # Errors
/// [`Fault::Device`] if there is no runtime or headset, or it goes away; as [`crate::content::open`].
#[cfg(not(target_os = "android"))]
pub fn run(args: &Args) -> Result<(), Fault> {
    play(args, &mut System)
}

/// [`run`] on a given system.
pub(super) fn play(args: &Args, system: &mut System) -> Result<(), Fault> {
    if args.out.is_some() && args.frames.is_none() {
        return Err(Fault::Usage("--xr --out writes the last of the frames: give --frames A..B".into()));
    }
    args.out.as_ref().map_or(Ok(()), |folder| output::check_folder(folder))?;
    args.stats.as_ref().map_or(Ok(()), |path| output::check(path))?;
    let started = Instant::now();
    let runtime = Runtime::open(system)?;
    // A run with an end measures: it remembers nothing and shows complete clips. Only one with a number of frames keeps
    // one quality, so that its counts can be repeated.
    let (measures, standpoint) = (args.frames.is_some() || args.seconds.is_some(), args.standpoint());
    let quality = Quality::new(args.settings(), args.quality, args.frames.is_none());
    let store = if measures || standpoint.is_some() { None } else { system.store() };
    let options = LoadOptions {
        source: SourceOptions { limits: system.limits(), ..args.source(system.cache_dir()) },
        min_layers: args.layer.map_or(1, |layers| layers as usize),
        is_complete: measures,
    };
    let speaker = if measures { Speaker::silent() } else { Speaker::new(system.state_dir()) };
    let place = Place::new(store, standpoint);
    let mut show = Show::new(args.clips.clone(), options, quality, place, speaker, !measures)?;
    let mut report = Report::new(args, started);
    let ended = run_devices(args, system, &runtime, &mut show, &mut report);
    report.write(args, &runtime, &ended?.gpu, &mut show)?;
    show.outcome()
}

/// Runs sessions on one device after the other, until one ends that was not lost; returns its device.
fn run_devices(
    args: &Args,
    system: &mut System,
    runtime: &Runtime,
    show: &mut Show,
    report: &mut Report,
) -> Result<Device, Fault> {
    loop {
        let device = Device::open(runtime, system)?;
        let drawn_before = report.frames_drawn();
        match device.run_sessions(system, runtime, args, show, report) {
            Ok(()) => return Ok(device),
            Err(fault) => {
                let fault = device.cause(fault);
                if !device.gpu.is_worth_replacing(report.frames_drawn() - drawn_before) {
                    return Err(fault);
                }
                notify(DEVICE_REPLACED);
                report.lose_session();
                show.lose_device();
            }
        }
    }
}

/// A graphics device that the runtime has opened.
struct Device {
    gpu: Arc<Gpu>,
    handles: VulkanHandles,
    failures: Failures,
}

impl Device {
    fn open(runtime: &Runtime, system: &System) -> Result<Device, Fault> {
        let (mut gpu, handles) = Gpu::from_vulkan(runtime)?;
        if let Some(folder) = system.pipelines() {
            gpu.keep_pipelines(Arc::new(PipelineFolder::new(folder)));
        }
        choose_f16(&mut gpu, ChannelDepth::Eight)?;
        let failures = Failures::collect(&gpu);
        Ok(Device { gpu: Arc::new(gpu), handles, failures })
    }

    /// The cause of `fault`: the loss of this device, if it is lost. The runtime, which uses the same queue, may
    /// fail before the renderer notices.
    fn cause(&self, fault: Fault) -> Fault {
        self.gpu.wait().err().unwrap_or(fault)
    }

    /// Runs sessions until one ends that was not lost.
    fn run_sessions(
        &self,
        system: &mut System,
        runtime: &Runtime,
        args: &Args,
        show: &mut Show,
        report: &mut Report,
    ) -> Result<(), Fault> {
        let mut renewals = Renewals::default();
        loop {
            let frames_before = report.frames();
            let mut session = Session::open(runtime, &self.gpu, &self.handles, args.out.is_some())?;
            show.prepare(
                &self.gpu,
                session.format(),
                session.has_passthrough(),
                [session.can_slow(), session.can_foveate()],
            );
            match self.run_session(system, runtime, &mut session, show, report) {
                Ok(()) => return Ok(()),
                Err(Halt::SessionLost) => {
                    if !renewals.follows(report.frames() - frames_before) {
                        return Err(error::sessions_dropped());
                    }
                    notify("the headset's session was lost: starting another");
                    report.lose_session();
                    drop(session);
                    runtime.wait_for_headset(system)?;
                }
                Err(Halt::Fault(fault)) => return Err(fault),
            }
        }
    }

    /// Runs a session to its end.
    fn run_session(
        &self,
        system: &mut System,
        runtime: &Runtime,
        session: &mut Session,
        show: &mut Show,
        report: &mut Report,
    ) -> Result<(), Halt> {
        let mut lifecycle = SessionLifecycle::default();
        loop {
            // A frame waits for its own time.
            if system.wait(if lifecycle.wants_frames() { Duration::ZERO } else { IDLE_POLL }) {
                return Ok(());
            }
            while let Some(event) = session.poll(runtime)? {
                let (next, action) = lifecycle.on(event);
                lifecycle = next;
                match action {
                    None => {}
                    Some(Action::Begin) => session.begin()?,
                    Some(Action::End) => {
                        session.end()?;
                        show.save();
                    }
                    Some(Action::Leave) => return Ok(()),
                    Some(Action::Renew) => return Err(Halt::SessionLost),
                    Some(Action::ChangeSpace { at_ns, change }) => show.change_space_at(at_ns, change),
                    Some(Action::ChangeHeat(heat)) => show.change_heat(heat),
                    Some(Action::Fail) => return Err(Halt::Fault(error::instance_lost())),
                }
            }
            self.failures.check(&self.gpu).map_err(Halt::Fault)?;
            if !lifecycle.wants_frames() {
                continue;
            }
            let request = session.frame(show, report, lifecycle.has_focus())?;
            if request == Request::Exit && lifecycle.ask_exit() {
                session.request_exit()?;
            }
        }
    }
}
