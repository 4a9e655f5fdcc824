//! [`Session`]: a session of the runtime, and the course of a frame: locate, advance, draw, compose, record.

#![allow(unsafe_code, reason = "handles of Vulkan are handed over")]

pub(super) mod state;

use std::sync::Arc;
use std::time::Instant;

use glam::UVec2;
use openxr as xr;
use program::Fault;

use crate::gpu::{Coverage, Foveation, Gpu, Level, LinearLight, RuntimeFormat, VulkanHandles};
use crate::headset::interaction::{Haptics, Pose};
use crate::headset::show::quality::Pace;
use crate::headset::show::{Moved, Show, Viewer};
use crate::xr::layers::canvas::{Canvas, DrawnClip};
use crate::xr::layers::panel_layer::PanelLayer;
use crate::xr::layers::passthrough::PassthroughMode;
use crate::xr::layers::ray_layer::RayLayer;
use crate::xr::layers::swapchain::{ImageLayout, TargetSwapchain, choose_format};
use crate::xr::report::{Drawn, EyeImages, Report, Work};
use crate::xr::runtime::calls::{DisplayClock, DisplayRate, SessionFrames, Stopwatch};
use crate::xr::runtime::error::{During, Halt, sessions_dropped};
use crate::xr::runtime::extensions::performance::Heats;
use crate::xr::runtime::extensions::refresh_rate::Rates;
use crate::xr::runtime::extensions::{performance, refresh_rate};
use crate::xr::runtime::frame::Frames;
use crate::xr::runtime::{EYES, Runtime, raw};
use crate::xr::tracking::input::Input;
use crate::xr::tracking::space::Stage;
use crate::xr::tracking::{Tracking, eye};
use state::{Event, State};

/// A session with a headset.
pub(in crate::xr) struct Session {
    // Everything goes before the session, which holds the device.
    canvas: Canvas,
    tracking: Tracking,
    frames: Frames<SessionFrames>,
    session: xr::Session<xr::Vulkan>,
    format: RuntimeFormat,
    events: xr::EventDataBuffer,
    stopwatch: Stopwatch,
    rate: DisplayRate,
    /// What the display offers, and what was asked of it.
    rates: Option<Rates>,
    pace: Pace,
    heats: Heats,
}

/// What a frame asks of the program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::xr) enum Request {
    Nothing,
    /// To end the session.
    Exit,
}

impl Session {
    /// Opens a session. Its images can be read back if `readable`.
    ///
    /// # Errors
    /// [`Fault::Device`] if the runtime refuses, or has no images that can be drawn into.
    pub(in crate::xr) fn open(
        runtime: &Runtime,
        gpu: &Arc<Gpu>,
        handles: &VulkanHandles,
        readable: bool,
    ) -> Result<Session, Fault> {
        Session::try_open(runtime, gpu, handles, readable).map_err(|halt| match halt {
            Halt::Fault(fault) => fault,
            Halt::SessionLost => sessions_dropped(),
        })
    }

    fn try_open(
        runtime: &Runtime,
        gpu: &Arc<Gpu>,
        handles: &VulkanHandles,
        readable: bool,
    ) -> Result<Session, Halt> {
        let (session, waiter, stream) = create(runtime, gpu, handles)?;
        let format = choose_format(&session)?;
        let size = runtime.eye_size.min(UVec2::splat(gpu.caps.max_image_side));

        performance::request(&session);
        #[cfg(target_os = "android")]
        crate::xr::runtime::extensions::threads::assign(&session);
        let rate = DisplayRate::default();
        let rates =
            runtime.extensions.fb_display_refresh_rate.then(|| refresh_rate::rates(&session)).flatten();
        if let Some(hz) = rates.and_then(|rates| refresh_rate::request(&session, rates.full)) {
            log::info!("{hz} Hz");
            rate.set(hz);
        }
        let stopwatch = Stopwatch::default();
        let eyes = ImageLayout { format, size, layers: 2, readable };
        let passthrough = PassthroughMode::open(runtime, &session);
        let (foveation, linear) = eye_images(gpu, format, size, passthrough.is_possible());
        Ok(Session {
            canvas: Canvas {
                panel: PanelLayer::open(&session, gpu, format, readable, stopwatch.clone())?,
                rays: RayLayer::open(&session, gpu, format)?,
                eyes: TargetSwapchain::open(&session, gpu, eyes, stopwatch.clone())?,
                foveation,
                passthrough,
                linear,
                size,
                stopwatch: stopwatch.clone(),
                gpu: gpu.clone(),
            },
            tracking: Tracking {
                input: Input::attach(&session, &runtime.extensions)?,
                stage: Stage::open(&session)?,
                stopwatch: stopwatch.clone(),
            },
            frames: Frames::new(SessionFrames {
                waiter,
                stream,
                blends: runtime.blends,
                passthrough: false,
                stopwatch: stopwatch.clone(),
                rate: rate.clone(),
                clock: DisplayClock::default(),
            }),
            events: xr::EventDataBuffer::new(),
            session,
            format,
            stopwatch,
            rate,
            rates,
            pace: Pace::Full,
            heats: Heats::default(),
        })
    }

    /// The next event of the runtime.
    ///
    /// # Errors
    /// See [`Halt`].
    pub(in crate::xr) fn poll(&mut self, runtime: &Runtime) -> Result<Option<Event>, Halt> {
        let ours = self.session.as_raw();
        while let Some(event) = runtime.instance.poll_event(&mut self.events).halt("telling its events")? {
            match event {
                xr::Event::SessionStateChanged(change) if change.session() == ours => {
                    let state = match change.state() {
                        xr::SessionState::READY => State::Ready,
                        xr::SessionState::SYNCHRONIZED => State::Synchronized,
                        xr::SessionState::VISIBLE => State::Visible,
                        xr::SessionState::FOCUSED => State::Focused,
                        xr::SessionState::STOPPING => State::Stopping,
                        xr::SessionState::LOSS_PENDING => State::LossPending,
                        xr::SessionState::EXITING => State::Exiting,
                        _ => State::Idle,
                    };
                    log::info!("session {state:?}");
                    return Ok(Some(Event::State(state)));
                }
                xr::Event::ReferenceSpaceChangePending(change) if change.session() == ours => {
                    let origin = change
                        .pose_valid()
                        .then(|| eye::pose(change.pose_in_previous_space()))
                        .filter(Pose::is_valid);
                    let at_ns = change.change_time().as_nanos();
                    let kind = change.reference_space_type();
                    log::info!("reference space {kind:?} changes, origin {origin:?}");
                    if let Some(change) = self.tracking.stage.change(kind, origin) {
                        return Ok(Some(Event::SpaceChanges { at_ns, change }));
                    }
                }
                xr::Event::InstanceLossPending(_) => return Ok(Some(Event::InstanceLossPending)),
                xr::Event::DisplayRefreshRateChangedFB(change) => {
                    log::info!("{} Hz", change.to_display_refresh_rate());
                    self.rate.set(change.to_display_refresh_rate());
                }
                xr::Event::PerfSettingsEXT(change) => {
                    let (domain, sub_domain, level) =
                        (change.domain(), change.sub_domain(), change.to_level());
                    log::info!("performance of {domain:?}, {sub_domain:?}: {level:?}");
                    if let Some(heat) = self.heats.on(domain, sub_domain, level) {
                        return Ok(Some(Event::Heat(heat)));
                    }
                }
                xr::Event::PassthroughStateChangedFB(change) => {
                    log::info!("passthrough {:?}", change.flags());
                    self.canvas.passthrough.on_change(change.flags());
                }
                xr::Event::EventsLost(lost) => log::warn!("{} events lost", lost.lost_event_count()),
                _ => {}
            }
        }
        Ok(None)
    }

    /// Begins the session: frames run from now on.
    ///
    /// # Errors
    /// See [`Halt`].
    pub(in crate::xr) fn begin(&self) -> Result<(), Halt> {
        self.session.begin(EYES).halt("beginning the session").map(drop)
    }

    /// Ends the session: no frames until it begins again.
    ///
    /// # Errors
    /// See [`Halt`].
    pub(in crate::xr) fn end(&self) -> Result<(), Halt> {
        self.session.end().halt("ending the session").map(drop)
    }

    /// Asks the runtime to end the session, which it does by events.
    ///
    /// # Errors
    /// See [`Halt`].
    pub(in crate::xr) fn request_exit(&self) -> Result<(), Halt> {
        self.session.request_exit().halt("leaving")
    }

    /// Whether the headset can show the room behind the clip.
    pub(in crate::xr) fn has_passthrough(&self) -> bool {
        self.canvas.linear.is_some()
    }

    /// Whether the display has a slower rate.
    pub(in crate::xr) fn can_slow(&self) -> bool {
        self.rates.is_some_and(|rates| rates.slow.is_some())
    }

    /// Whether there is memory for an inset.
    pub(in crate::xr) fn can_foveate(&self) -> bool {
        self.canvas.foveation.is_some()
    }

    /// Asks the display for another rate if `pace` is one. The runtime tells when it has it.
    fn keep(&mut self, pace: Pace) {
        let Some(rates) = self.rates.filter(|_| pace != self.pace) else { return };
        self.pace = pace;
        refresh_rate::request(
            &self.session,
            if pace == Pace::Slow { rates.slow.unwrap_or(rates.full) } else { rates.full },
        );
    }

    /// The format that eyes are drawn in.
    pub(in crate::xr) fn format(&self) -> RuntimeFormat {
        self.format
    }

    /// Runs a frame: waits for its time, moves the clip on, draws it for both eyes and shows it.
    /// `has_focus` is whether hands are for this program.
    ///
    /// # Errors
    /// See [`Halt`].
    pub(in crate::xr) fn frame(
        &mut self,
        show: &mut Show,
        report: &mut Report,
        has_focus: bool,
    ) -> Result<Request, Halt> {
        let mut frame = self.frames.begin().halt("beginning a frame")?;
        let (start, timing) = (Instant::now(), frame.timing());
        self.stopwatch.take();
        show.receive()?;

        let tracked = self.tracking.locate(&self.session, timing.display_ns, has_focus)?;
        let viewer = Viewer {
            attends: has_focus && tracked.head.is_some(),
            head: tracked.head.as_ref(),
            hands: &tracked.hands,
        };
        let mut haptics = Haptics::default();
        let Moved { leaves, rays } = show.advance(timing.display_ns, &viewer, &mut haptics);
        frame.calls().passthrough = show.shows_passthrough();
        self.tracking.feel(&self.session, &haptics);

        let request = if leaves || report.is_complete() { Request::Exit } else { Request::Nothing };
        let Some(eyes) = tracked.eyes.filter(|_| timing.visible) else {
            report.on_unseen_frame();
            self.canvas.compose_room(frame, show.shows_passthrough())?;
            return Ok(request);
        };

        let size = show.quality().size(self.canvas.size);
        let is_captured = report.is_last();
        let drawn = self.canvas.draw(&eyes, size, show, is_captured)?;
        let painting = show.paint_panel(timing.display_ns);
        self.canvas.paint_panel(show, painting)?;
        let stage = &self.tracking.stage.space;
        self.canvas.compose(frame, stage, &eyes, size, rays, show)?;

        let work = Work {
            cpu_s: (start.elapsed().saturating_sub(self.stopwatch.take())).as_secs_f64(),
            display_ns: timing.display_ns,
            period_ns: timing.period_ns,
            loading: show.is_loading(),
        };
        self.record(show, report, work, drawn, size, is_captured)?;
        self.keep(show.quality().pace());
        Ok(if report.is_complete() { Request::Exit } else { request })
    }

    /// Records a frame that was shown.
    fn record(
        &self,
        show: &mut Show,
        report: &mut Report,
        work: Work,
        drawn: Option<DrawnClip>,
        size: UVec2,
        is_captured: bool,
    ) -> Result<(), Halt> {
        let Some(DrawnClip { views, counts }) = drawn else {
            report.on_empty_frame(work);
            return Ok(());
        };
        let (level, settings) = (show.quality().level(), show.quality().settings());
        let period_ns = work.period_ns;
        let missed = report.on_frame(work, Drawn { level, size, settings, counts }) > 0;
        let gpu_ms = show.measure(counts, size, period_ns, missed);
        report.on_measured(gpu_ms);
        if is_captured {
            let (pixels, panel) = self.canvas.read(size)?;
            let position_s = show.clock().position_s();
            let coverage =
                show.renderer().map_or(Ok(Coverage::default()), |drawn| drawn.count(&self.canvas.gpu))?;
            report.capture(EyeImages { views, position_s, coverage, pixels, panel });
        }
        Ok(())
    }
}

/// Images for foveated frames and, if the runtime `shows_room`, for frames over the room, of eyes with `size` pixels;
/// `None` where there is no memory.
fn eye_images(
    gpu: &Gpu,
    format: RuntimeFormat,
    size: UVec2,
    shows_room: bool,
) -> (Option<Foveation>, Option<LinearLight>) {
    let foveation = Foveation::new(gpu, format.drawn(), 2, size, Level::INSET_MAX)
        .and_then(|foveation| if shows_room { foveation.for_linear_light(gpu) } else { Ok(foveation) });
    let linear = shows_room.then(|| LinearLight::new(gpu, format.drawn(), 2, size)).transpose();
    (
        foveation.inspect_err(|fault| log::warn!("{fault}: no inset")).ok(),
        linear.inspect_err(|fault| log::warn!("{fault}: no passthrough")).ok().flatten(),
    )
}

/// Creates the runtime's session on `gpu`.
fn create(
    runtime: &Runtime,
    gpu: &Arc<Gpu>,
    handles: &VulkanHandles,
) -> Result<(xr::Session<xr::Vulkan>, xr::FrameWaiter, xr::FrameStream<xr::Vulkan>), Halt> {
    let info = xr::vulkan::SessionCreateInfo {
        instance: raw(handles.instance),
        physical_device: raw(handles.physical),
        device: raw(handles.device),
        queue_family_index: handles.queue_family,
        queue_index: handles.queue,
    };
    // SAFETY: the runtime made the handles, and the session keeps `gpu`, which owns them; only this thread uses
    // the queue, outside the calls of the session.
    unsafe {
        let guard = Box::new(gpu.clone());
        runtime.instance.create_session_with_guard::<xr::Vulkan>(runtime.system, &info, guard)
    }
    .halt("opening a session")
}
