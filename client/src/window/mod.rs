//! The desktop preview: a window that plays a clip, with a camera to move and controls.
//!
//! `viewer` holds what a person can change and knows neither window nor GPU; `session` joins
//! it with both and draws the frames; this file passes events on. Frames are drawn only while
//! something moves.

mod bar;
mod camera;
mod frame_times;
mod icon;
mod icons;
mod keys;
mod overlay;
mod screen;
mod screenshot;
mod session;
mod style;
mod viewer;

use std::panic::catch_unwind;
use std::time::Instant;

use codec::Clip;
use winit::application::ApplicationHandler;
use winit::event::{StartCause, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop, EventLoopProxy};
use winit::window::WindowId;

use crate::args::Args;
use crate::clips::{Arrival, Entry, LoadEvent, Queue, cache_dir, playlist};
use crate::gpu::DEVICE_REPLACED;
use crate::terminal::Reporter;
use crate::{clips, headless, viewpoint};
use program::Fault;
use session::{Event, Next, Session, Start};

/// Plays the clip that `args` name in a window, until it is closed.
///
/// # Errors
/// As [`clips::open`] and [`viewpoint::find`]; as [`clips::Arrival`] until there is a clip to show;
/// [`Fault::Device`] without a display or a graphics device that can draw on it.
pub fn run(args: &Args) -> Result<(), Fault> {
    let First { entry, clip, rest, queue } = first_clip(args)?;
    let viewpoints = viewpoint::viewpoints(&clip);
    let viewpoint = args.view.as_deref().map_or(Ok(0), |name| viewpoint::find(&viewpoints, name))?;
    let settings = headless::settings(args, &clip)?;
    let start = Start { entry, clip, rest, queue, viewpoint, settings, size: args.size };
    let event_loop = open_display()?;
    let mut app = App { start: Some(start), proxy: event_loop.create_proxy(), session: None, result: Ok(()) };
    event_loop
        .run_app(&mut app)
        .map_err(|error| Fault::Device(format!("the connection to the display failed: {error}")))?;
    app.result
}

/// The clip that plays first.
struct First {
    entry: Entry,
    clip: Clip,
    /// Its better versions, which are still being loaded.
    rest: Arrival,
    queue: Option<Queue>,
}

/// Waits for the clip that `args` name, or for the first one of their playlist that can be loaded; reports
/// on the terminal the ones that cannot.
fn first_clip(args: &Args) -> Result<First, Fault> {
    let mut reporter = Reporter::new();
    let layers = args.layer.map_or(1, |layers| layers as usize);
    let wait = |entry: Entry, queue, reporter: &mut Reporter| -> Result<First, Fault> {
        let mut rest = clips::open(entry.name.as_deref(), cache_dir())?;
        let clip = rest.wait(Some(layers), |event| reporter.tell(event))?;
        Ok(First { entry, clip, rest, queue })
    };
    let Some(list) = args.clip.as_deref().filter(|name| playlist::is_playlist(name)) else {
        return wait(Entry::single(args.clip.clone()), None, &mut reporter);
    };
    let queue = Queue::new(playlist::wait(list, cache_dir(), |event| reporter.tell(event))?.clips);
    let mut last = None;
    for entry in queue.all() {
        if let Some(fault) = last.take() {
            reporter.tell(&LoadEvent::Note(format!("{fault}; skipped")));
        }
        let mut queue = queue.clone();
        queue.go_to(entry.number);
        match wait(entry, Some(queue), &mut reporter) {
            Err(fault) => last = Some(fault),
            first => return first,
        }
    }
    Err(last.expect("a playlist has a clip"))
}

/// What to do where the libraries of the X server are not installed.
const LIBRARY_MISSING: &str = "a library is missing, on Debian and Ubuntu: \
                               apt-get install libx11-xcb1 libxcursor1 libxi6 libxkbcommon-x11-0";

/// Connects to the display.
fn open_display() -> Result<EventLoop<Event>, Fault> {
    // The window library panics where one of the libraries of the X server is missing.
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(|_| ()));
    let opened = catch_unwind(|| EventLoop::with_user_event().build());
    std::panic::set_hook(hook);
    let reason = match opened {
        Ok(Ok(event_loop)) => return Ok(event_loop),
        Ok(Err(error)) if error.to_string().contains("shared libraries") => LIBRARY_MISSING.into(),
        Ok(Err(error)) => no_display(|name| std::env::var(name).ok(), &error.to_string()),
        Err(_) => LIBRARY_MISSING.into(),
    };
    Err(Fault::Device(format!(
        "no display to open a window on: {reason}; --headless --out PATH renders images"
    )))
}

/// Why there is no display: from the environment, and from the error of the window library, which
/// may begin with a place in that library's source.
fn no_display(variable: impl Fn(&str) -> Option<String>, error: &str) -> String {
    let set = |name: &str| {
        let value = variable(name).filter(|value| !value.is_empty())?;
        Some(format!("{name}={value}"))
    };
    // In the order in which they are tried.
    let Some(display) = ["WAYLAND_DISPLAY", "DISPLAY"].into_iter().find_map(set) else {
        return "neither WAYLAND_DISPLAY nor DISPLAY is set".into();
    };
    let cause = match error.split_once(".rs:") {
        Some((_, rest)) => rest.trim_start_matches(|c: char| c.is_ascii_digit()).trim_start_matches(": "),
        None => error,
    };
    format!("cannot connect to {display} ({cause})")
}

/// What the event loop drives.
struct App {
    /// Until the window is there.
    start: Option<Start>,
    proxy: EventLoopProxy<Event>,
    session: Option<Session>,
    result: Result<(), Fault>,
}

impl App {
    /// Ends the program, once a picture under way is saved.
    fn fail(&mut self, event_loop: &ActiveEventLoop, fault: Fault) {
        self.result = Err(fault);
        self.session = None;
        event_loop.exit();
    }
}

impl ApplicationHandler<Event> for App {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        let Some(start) = self.start.take() else { return };
        match Session::open(event_loop, self.proxy.clone(), start) {
            Ok(session) => self.session = Some(session),
            Err(fault) => self.fail(event_loop, fault),
        }
    }

    fn new_events(&mut self, _: &ActiveEventLoop, cause: StartCause) {
        if let (StartCause::ResumeTimeReached { .. }, Some(session)) = (cause, &self.session) {
            session.request_frame();
        }
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let Some(session) = &mut self.session else { return };
        match event {
            WindowEvent::CloseRequested => event_loop.exit(),
            WindowEvent::RedrawRequested => match session.frame() {
                Ok(next) => {
                    event_loop.set_control_flow(match next {
                        Next::After(delay) => ControlFlow::WaitUntil(Instant::now() + delay),
                        Next::Now | Next::OnInput => ControlFlow::Wait,
                    });
                    if matches!(next, Next::Now) {
                        session.request_frame();
                    }
                }
                Err(fault) => match session.reopen(fault) {
                    Ok(()) => Reporter::new().tell(&LoadEvent::Note(DEVICE_REPLACED.into())),
                    Err(fault) => self.fail(event_loop, fault),
                },
            },
            WindowEvent::DroppedFile(path) => session.load(&path),
            event => session.input(&event),
        }
    }

    fn user_event(&mut self, _: &ActiveEventLoop, event: Event) {
        if let Some(session) = &mut self.session {
            session.receive(event);
        }
    }

    fn exiting(&mut self, _: &ActiveEventLoop) {
        // While the display is still connected.
        self.session = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_absent_display_is_explained() {
        assert_eq!(no_display(|_| None, "?"), "neither WAYLAND_DISPLAY nor DISPLAY is set");
        let empty = |name: &str| Some(if name == "DISPLAY" { ":9" } else { "" }.to_owned());
        let error = "os error at a/b/mod.rs:788: no server: x: absent";
        assert_eq!(no_display(empty, error), "cannot connect to DISPLAY=:9 (no server: x: absent)");
        assert_eq!(
            no_display(|_| Some("x".into()), "refused"),
            "cannot connect to WAYLAND_DISPLAY=x (refused)"
        );
    }
}
