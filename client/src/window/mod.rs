//! The desktop preview: a window that plays a clip, with a movable camera and controls.
//!
//! `viewer` holds the state that input changes, and uses neither window nor GPU. `session` connects it to
//! both and draws frames, and only while the image changes. This file runs the event loop.

mod bar;
mod camera;
mod display;
mod icon;
mod icons;
mod keys;
mod library;
mod overlay;
mod picker;
mod poster;
mod screen;
mod screenshot;
mod session;
mod style;
mod viewed_clip;
mod viewer;

use std::sync::Arc;
use std::time::Instant;

use program::Fault;
use winit::application::ApplicationHandler;
use winit::event::{StartCause, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoopProxy};
use winit::window::WindowId;

use crate::args::Args;
use crate::clips::{Entry, Queue, playlist};
use crate::content::{Arrival, OpenEvent, OpenTake, SourceOptions, Wait, cache_dir};
use crate::gpu::DEVICE_REPLACED;
use crate::terminal::Reporter;
use crate::{content, headless, viewpoint};
use session::{Event, Next, Session, Start};

/// Plays the clip of `args` in a window until it is closed.
///
/// # Errors
/// As [`content::open`] and [`viewpoint::find`]; as [`content::Arrival`] until the first clip plays;
/// [`Fault::Device`] without a display or a graphics device for it.
pub fn run(args: &Args) -> Result<(), Fault> {
    let mut reporter = Reporter::new();
    let First { entry, clip, rest, queue, notes } = first_clip(args, &mut reporter)?;
    reporter.end_progress();
    let viewpoints = &clip.info().viewpoints;
    let viewpoint = args.view.as_deref().map_or(Ok(0), |name| viewpoint::find(viewpoints, name))?;
    let settings = headless::settings(args, &clip)?;
    let source = args.source(cache_dir());
    let size = args.size;
    let named = args.clips.clone();
    let start = Start { named, entry, clip, rest, queue, notes, reporter, source, viewpoint, settings, size };
    let event_loop = display::connect()?;
    let mut app = App { start: Some(start), proxy: event_loop.create_proxy(), session: None, result: Ok(()) };
    event_loop.run_app(&mut app).map_err(|error| {
        Fault::Device(format!("the connection to the display failed: {error}: start again"))
    })?;
    app.result
}

/// The clip that plays first.
struct First {
    entry: Entry,
    clip: Arc<OpenTake>,
    /// What more its source has to tell.
    rest: Arrival,
    queue: Option<Queue>,
    /// Remarks on it, and on the clips before it, which do not load.
    notes: Vec<String>,
}

/// Waits for the clip of `args`, or for the first clip of their playlist that loads. Prints the faults of the clips
/// before it.
fn first_clip(args: &Args, reporter: &mut Reporter) -> Result<First, Fault> {
    let source = args.source(cache_dir());
    let mut notes = Vec::new();
    let mut tell = |event: &OpenEvent| {
        reporter.print(event);
        if let OpenEvent::Note(text) = event {
            notes.push(text.clone());
        }
    };
    let names = &args.clips;
    if !playlist::is_list(names) {
        let entry = Entry::single(names.first().cloned());
        let (clip, rest) = open_entry(&entry, &source, &mut tell)?;
        return Ok(First { entry, clip, rest, queue: None, notes });
    }
    let mut queue = Queue::new(playlist::wait(names, &source, &mut tell)?.clips);
    let mut last: Option<Fault> = None;
    for entry in queue.all() {
        if let Some(fault) = last.take() {
            tell(&OpenEvent::Note(format!("{fault}; skipped")));
        }
        match open_entry(&entry, &source, &mut tell) {
            Ok((clip, rest)) => {
                queue.go_to(entry.number);
                return Ok(First { entry, clip, rest, queue: Some(queue), notes });
            }
            Err(fault) => last = Some(fault),
        }
    }
    Err(last.expect("a playlist has a clip"))
}

/// Waits until a clip can be played. Returns what more its source has to tell, too.
fn open_entry(
    entry: &Entry,
    source: &SourceOptions,
    tell: impl FnMut(&OpenEvent),
) -> Result<(Arc<OpenTake>, Arrival), Fault> {
    let mut rest = content::open(entry.name.as_deref(), source)?;
    let clip = rest.wait(Wait::Playable, tell)?;
    Ok((clip, rest))
}

/// The state of the event loop.
struct App {
    /// Until the window opens.
    start: Option<Start>,
    proxy: EventLoopProxy<Event>,
    session: Option<Session>,
    result: Result<(), Fault>,
}

impl App {
    /// Ends the program, after a running screenshot is saved.
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

    fn new_events(&mut self, event_loop: &ActiveEventLoop, cause: StartCause) {
        if let (StartCause::ResumeTimeReached { .. }, Some(session)) = (cause, &mut self.session) {
            event_loop.set_control_flow(ControlFlow::WaitUntil(Instant::now() + session.request_frame()));
        }
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let Some(session) = &mut self.session else { return };
        match event {
            WindowEvent::CloseRequested => event_loop.exit(),
            WindowEvent::RedrawRequested => match session.frame() {
                Ok(next) => event_loop.set_control_flow(match next {
                    Next::After(delay) => ControlFlow::WaitUntil(Instant::now() + delay),
                    Next::Now => ControlFlow::WaitUntil(Instant::now() + session.request_frame()),
                    Next::OnInput => ControlFlow::Wait,
                }),
                Err(fault) => match session.reopen(fault) {
                    Ok(()) => Reporter::new().print(&OpenEvent::Note(DEVICE_REPLACED.into())),
                    Err(fault) => self.fail(event_loop, fault),
                },
            },
            WindowEvent::DroppedFile(path) => session.receive_file(path),
            event => session.input(&event),
        }
    }

    fn user_event(&mut self, event_loop: &ActiveEventLoop, event: Event) {
        if let Some(session) = &mut self.session
            && let Err(fault) = session.receive(event)
        {
            self.fail(event_loop, fault);
        }
    }

    fn about_to_wait(&mut self, _: &ActiveEventLoop) {
        if let Some(session) = &mut self.session {
            session.open_received();
        }
    }

    fn exiting(&mut self, _: &ActiveEventLoop) {
        // Dropped while the display is still connected.
        self.session = None;
    }
}
