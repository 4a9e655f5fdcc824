//! [`Session`]: what is drawn into and where hands come from, and the course of a frame.

#![allow(unsafe_code, reason = "handles of Vulkan are handed over, and images of the runtime wrapped")]

use std::sync::Arc;
use std::time::Instant;

use glam::UVec2;
use openxr as xr;
use program::Fault;

use super::beam_layer::BeamLayer;
use super::calls::{Layers, Rate, SessionFrames, SwapchainImages, Watch};
use super::error::{During, Halt};
use super::extensions::{performance, refresh_rate};
use super::eye;
use super::frame::{Frames, Images};
use super::input::Input;
use super::interaction::{Hands, Haptics};
use super::panel_layer::PanelLayer;
use super::report::{Drawn, Report, Shown, Work};
use super::runtime::{EYES, Runtime, raw};
use super::see_through::SeeThrough;
use super::show::{Moved, Show, Viewer};
use super::state::{Event, State};
use super::{space, swapchain};
use crate::gpu::{Gpu, RuntimeFormat, RuntimeTargets, VulkanHandles};

/// Colour of the emptiness while there is no clip yet: dark, and not the black of something broken.
const EMPTY: [f64; 4] = [0.06, 0.06, 0.07, 1.0];

/// Most layers of a frame: the room, the eyes, the panel and two beams. Every runtime takes 16.
const LAYERS: usize = 5;

/// A session with a headset.
pub(super) struct Session {
    // In the order in which they must go: textures before the images that they wrap, everything
    // before the session, which holds the device.
    panel: PanelLayer,
    beams: BeamLayer,
    eyes: RuntimeTargets,
    images: Images<SwapchainImages>,
    see_through: SeeThrough,
    input: Input,
    stage: xr::Space,
    frames: Frames<SessionFrames>,
    session: xr::Session<xr::Vulkan>,
    format: RuntimeFormat,
    /// Of an eye's image; less of it may be drawn.
    size: UVec2,
    events: xr::EventDataBuffer,
    watch: Watch,
    rate: Rate,
    gpu: Arc<Gpu>,
}

/// What a frame asks of the program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Asked {
    Nothing,
    /// To leave.
    Exit,
}

impl Session {
    /// Opens a session, with images that can be read back if `readable`.
    ///
    /// # Errors
    /// [`Fault::Device`] if the runtime refuses, or has no images that can be drawn into.
    pub(super) fn open(
        runtime: &Runtime,
        gpu: &Arc<Gpu>,
        handles: &VulkanHandles,
        readable: bool,
    ) -> Result<Session, Fault> {
        Session::try_open(runtime, gpu, handles, readable).map_err(|halt| match halt {
            Halt::Fault(fault) => fault,
            Halt::SessionLost => {
                Fault::Device("the OpenXR runtime drops its session at once: restart the runtime".into())
            }
        })
    }

    fn try_open(
        runtime: &Runtime,
        gpu: &Arc<Gpu>,
        handles: &VulkanHandles,
        readable: bool,
    ) -> Result<Session, Halt> {
        let info = xr::vulkan::SessionCreateInfo {
            instance: raw(handles.instance),
            physical_device: raw(handles.physical),
            device: raw(handles.device),
            queue_family_index: handles.queue_family,
            queue_index: handles.queue,
        };
        // SAFETY: the handles are those of `gpu`, which the session keeps, made by this runtime; the
        // queue is used by this thread only, outside the calls of the session.
        let (session, waiter, stream) = unsafe {
            let guard = Box::new(gpu.clone());
            runtime.instance.create_session_with_guard::<xr::Vulkan>(runtime.system, &info, guard)
        }
        .halt("opening a session")?;

        let format = swapchain::choose_format(&session)?;
        let size = runtime.eye_size.min(UVec2::splat(gpu.caps.max_image_side));
        let swapchain = swapchain::make(&session, format, size, 2, readable)?;
        // SAFETY: `eyes` goes before `images`, which owns them, and is drawn into and read only
        // between acquiring and releasing.
        let images = unsafe { swapchain::wrap(&swapchain, size, 2, format, readable) }?;

        performance::request(&session);
        let rate = Rate::default();
        let asked = runtime.extensions.fb_display_refresh_rate.then(|| refresh_rate::request(&session));
        if let Some(hz) = asked.flatten() {
            log::info!("{hz} Hz");
            rate.set(hz);
        }
        let watch = Watch::default();
        Ok(Session {
            panel: PanelLayer::open(&session, gpu, format, readable, watch.clone())?,
            beams: BeamLayer::open(&session, gpu, format)?,
            eyes: RuntimeTargets::new(gpu, &images)?,
            input: Input::attach(&session, &runtime.extensions)?,
            stage: space::open(&session)?,
            frames: Frames::new(SessionFrames {
                waiter,
                stream,
                blends: runtime.blends,
                watch: watch.clone(),
                rate: rate.clone(),
            }),
            images: Images::new(SwapchainImages { swapchain, watch: watch.clone() }),
            see_through: SeeThrough::open(runtime, &session),
            events: xr::EventDataBuffer::new(),
            gpu: gpu.clone(),
            session,
            format,
            size,
            watch,
            rate,
        })
    }

    /// The next thing that the runtime has to tell.
    ///
    /// # Errors
    /// See [`Halt`].
    pub(super) fn poll(&mut self, runtime: &Runtime) -> Result<Option<Event>, Halt> {
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
                    return Ok(Some(Event::SpaceChanges { at_ns: change.change_time().as_nanos() }));
                }
                xr::Event::InstanceLossPending(_) => return Ok(Some(Event::InstanceLossPending)),
                xr::Event::DisplayRefreshRateChangedFB(change) => {
                    log::info!("{} Hz", change.to_display_refresh_rate());
                    self.rate.set(change.to_display_refresh_rate());
                }
                xr::Event::EventsLost(lost) => log::warn!("{} events lost", lost.lost_event_count()),
                _ => {}
            }
        }
        Ok(None)
    }

    /// Lets frames run.
    ///
    /// # Errors
    /// See [`Halt`].
    pub(super) fn begin(&self) -> Result<(), Halt> {
        self.session.begin(EYES).halt("beginning the session").map(drop)
    }

    /// Lets frames stop.
    ///
    /// # Errors
    /// See [`Halt`].
    pub(super) fn end(&self) -> Result<(), Halt> {
        self.session.end().halt("ending the session").map(drop)
    }

    /// Asks the runtime to let this session go, which it does by events.
    ///
    /// # Errors
    /// See [`Halt`].
    pub(super) fn request_exit(&self) -> Result<(), Halt> {
        self.session.request_exit().halt("leaving")
    }

    /// Whether the room can be shown behind the clip.
    pub(super) fn can_see_through(&self) -> bool {
        self.see_through.is_possible()
    }

    /// The format that is drawn in.
    pub(super) fn format(&self) -> RuntimeFormat {
        self.format
    }

    /// A frame: waits for its time, moves the clip on, draws it for both eyes and shows it. `focus`
    /// is whether hands are for this program.
    ///
    /// # Errors
    /// See [`Halt`].
    pub(super) fn frame(&mut self, show: &mut Show, report: &mut Report, focus: bool) -> Result<Asked, Halt> {
        let Session { frames, images, watch, session, .. } = self;
        let frame = frames.begin().halt("beginning a frame")?;
        let (start, timing) = (Instant::now(), frame.timing());
        watch.take();
        show.receive()?;

        let time = xr::Time::from_nanos(timing.display_ns);
        let located = watch.time(|| locate(session, &self.stage, time))?;
        let poses = located.map(|views| views.map(|view| eye::pose(view.pose)));
        let head = poses.as_ref().map(eye::head);
        let hands = if focus {
            watch.time(|| self.input.hands(session, &self.stage, time))?
        } else {
            Hands::default()
        };
        let mut haptics = Haptics::default();
        let viewer = Viewer {
            attends: focus && head.is_some(),
            looks: timing.visible,
            head: head.as_ref(),
            hands: &hands,
        };
        let Moved { leaves, painting, beams } = show.advance(timing.display_ns, &viewer, &mut haptics);
        watch.time(|| self.input.feel(session, &haptics));

        let asked = if leaves || report.is_complete() { Asked::Exit } else { Asked::Nothing };
        let Some((located, poses)) = located.zip(poses).filter(|_| timing.visible) else {
            report.unseen();
            frame.end(Layers::default()).halt("ending a frame")?;
            return Ok(asked);
        };

        let see_through = show.see_through();
        let (level, settings) = (show.quality().level(), show.quality().settings());
        let size = show.quality().size(self.size);
        let views = show.stage_from_clip().and_then(|stage_from_clip| {
            let view = |i: usize| eye::view(&poses[i], located[i].fov.into(), size, &stage_from_clip);
            Some([view(0)?, view(1)?])
        });
        let image = images.acquire().halt("taking an image")?;
        let gpu = show.gpu().clone();
        let mut encoder = gpu.encoder();
        let (t, position_s) = (show.player().clip_time(), show.player().position_s());
        let drawn = views.zip(show.renderer()).map(|(views, renderer)| {
            let targets = self.eyes.targets(image.index());
            (views, renderer.draw(&gpu, &mut encoder, t, &views, &settings, targets))
        });
        if drawn.is_none() {
            let color = if see_through { [0.0; 4] } else { EMPTY };
            self.eyes.fill(&mut encoder, image.index(), color);
        }
        let capture = drawn.is_some() && report.is_last();
        if capture {
            self.eyes.record_read(&mut encoder, image.index());
        }
        watch.time(|| gpu.submit(encoder));
        image.release().halt("handing an image over")?;
        if let Some((painter, painting)) = show.painter().zip(painting) {
            self.panel.paint(&gpu, painter, painting)?;
        }

        let eyes = projections(&images.calls().swapchain, &located, size);
        let alpha = if see_through {
            xr::CompositionLayerFlags::BLEND_TEXTURE_SOURCE_ALPHA
        } else {
            xr::CompositionLayerFlags::EMPTY
        };
        let layer = xr::CompositionLayerProjection::new().layer_flags(alpha).space(&self.stage).views(&eyes);
        let room = self.see_through.layer(see_through);
        let quad = show.board().and_then(|board| self.panel.quad(&self.stage, board));
        let beams = beams.map(|beam| beam.map(|beam| self.beams.quad(&self.stage, &beam)));
        let mut layers: Vec<&xr::CompositionLayerBase<'_, xr::Vulkan>> = Vec::with_capacity(LAYERS);
        layers.extend(room.as_deref());
        layers.push(&layer);
        layers.extend(quad.as_deref());
        layers.extend(beams.iter().flatten().map(|beam| &**beam));
        frame.end(Layers { layers: &layers, see_through }).halt("ending a frame")?;

        let work = Work {
            cpu_s: (start.elapsed().saturating_sub(watch.take())).as_secs_f64(),
            display_ns: timing.display_ns,
            period_ns: timing.period_ns,
            loading: show.is_loading(),
        };
        match drawn {
            None => report.empty(work),
            Some((views, counts)) => {
                let gpu_ms = show.measure(counts, size, timing.period_ns);
                report.shown(work, Drawn { level, size, settings, counts, gpu_ms });
                if capture {
                    let pixels = self.eyes.read(&gpu)?.iter().map(|eye| eye.corner(size)).collect();
                    let panel = self.panel.read(&gpu)?;
                    report.capture(Shown { views, t, position_s, settings, pixels, panel });
                }
            }
        }
        Ok(if report.is_complete() { Asked::Exit } else { asked })
    }
}

/// Where the eyes will be at `time`; `None` while the headset is not tracked.
fn locate(
    session: &xr::Session<xr::Vulkan>,
    stage: &xr::Space,
    time: xr::Time,
) -> Result<Option<[xr::View; 2]>, Halt> {
    let (flags, views) = session.locate_views(EYES, time, stage).halt("locating the eyes")?;
    let needed = xr::ViewStateFlags::ORIENTATION_VALID | xr::ViewStateFlags::POSITION_VALID;
    Ok(views.try_into().ok().filter(|_| flags.contains(needed)))
}

/// `size` pixels in the corner of both layers of the image released last, seen from where they were
/// drawn for.
fn projections<'a>(
    swapchain: &'a xr::Swapchain<xr::Vulkan>,
    located: &[xr::View; 2],
    size: UVec2,
) -> [xr::CompositionLayerProjectionView<'a, xr::Vulkan>; 2] {
    let extent = xr::Extent2Di { width: size.x as i32, height: size.y as i32 };
    let rect = xr::Rect2Di { offset: xr::Offset2Di::default(), extent };
    [0, 1].map(|layer: usize| {
        let sub_image = xr::SwapchainSubImage::new()
            .swapchain(swapchain)
            .image_array_index(layer as u32)
            .image_rect(rect);
        let xr::View { pose, fov } = located[layer];
        xr::CompositionLayerProjectionView::new().pose(pose).fov(fov).sub_image(sub_image)
    })
}

impl Drop for Session {
    /// Waits for the GPU: the runtime destroys its images, whether they are being drawn into or not.
    fn drop(&mut self) {
        if let Err(fault) = self.gpu.wait() {
            log::warn!("{fault}");
        }
    }
}
