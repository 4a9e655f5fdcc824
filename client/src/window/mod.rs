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

use std::time::Instant;

use program::Fault;
use winit::application::ApplicationHandler;
use winit::event::{StartCause, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoopProxy};
use winit::window::WindowId;

use crate::args::Args;
use crate::content::OpenEvent;
use crate::gpu::DEVICE_REPLACED;
use crate::terminal::Reporter;
use session::{Event, Next, Session};

/// Plays the clip of `args` in a window until it is closed. The window opens at once, and says that it opens the clip.
///
/// # Errors
/// Until the first clip plays: as [`crate::content::open`] and [`crate::viewpoint::find`], and as
/// [`crate::content::Arrival`]. [`Fault::Device`] without a display or a graphics device for it.
pub fn run(args: &Args) -> Result<(), Fault> {
    let event_loop = display::connect()?;
    let mut app = App { args, proxy: event_loop.create_proxy(), session: None, result: Ok(()) };
    event_loop.run_app(&mut app).map_err(|error| {
        Fault::Device(format!("the connection to the display failed: {error}: start again"))
    })?;
    app.result
}

/// The state of the event loop.
struct App<'a> {
    args: &'a Args,
    proxy: EventLoopProxy<Event>,
    /// The window, once there is one.
    session: Option<Session>,
    result: Result<(), Fault>,
}

impl App<'_> {
    /// Ends the program, after a running screenshot is saved.
    fn fail(&mut self, event_loop: &ActiveEventLoop, fault: Fault) {
        self.result = Err(fault);
        self.session = None;
        event_loop.exit();
    }
}

impl ApplicationHandler<Event> for App<'_> {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        if self.session.is_some() {
            return;
        }
        match Session::open(event_loop, self.proxy.clone(), self.args) {
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
