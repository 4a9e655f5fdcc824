//! [`Display`]: Xvfb, an X server with a screen in memory, for tests of the desktop window. Finds
//! windows, takes screenshots, presses keys.

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use libtest_mimic::{Completion, Failed, Trial};
use x11rb::connection::Connection;
use x11rb::protocol::Event;
use x11rb::protocol::xproto::{
    ClientMessageEvent, ConnectionExt as _, CreateWindowAux, EventMask, ImageFormat, InputFocus, PropMode,
    SELECTION_NOTIFY_EVENT, SelectionNotifyEvent, SelectionRequestEvent, WindowClass,
};
use x11rb::protocol::xtest::ConnectionExt as _;
use x11rb::rust_connection::RustConnection;
use x11rb::wrapper::ConnectionExt as _;

pub use x11rb::protocol::xproto::Window;

use crate::gpu::{Passes, device};

/// Rows at the bottom of a player's window that hold the controls; the clip shows above them.
pub const CONTROLS: u32 = 120;

/// Longest wait for something to appear.
const PATIENCE: Duration = Duration::from_secs(60);

/// A running X server; ends when dropped.
pub struct Display {
    name: String,
    connection: RustConnection,
    root: Window,
    /// Ends the server when dropped.
    _server: Process,
}

/// A running program; ends when dropped.
struct Process(Child);

impl Drop for Process {
    fn drop(&mut self) {
        // It may have ended already.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Pixels of a window.
#[derive(Clone, Debug, PartialEq)]
pub struct Screenshot {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Red, green and blue bytes, row by row from the top.
    pub rgb: Vec<u8>,
}

/// A test that needs a device and a display: ignored if either is missing.
pub fn trial(name: &str, test: fn(&Display) -> Result<(), String>) -> Trial {
    Trial::ignorable_test(name, move || {
        if let Err(fault) = device(Passes::Shared) {
            return Ok(Completion::ignored_with(fault));
        }
        match Display::start(1000, 700) {
            Some(display) => test(&display).map(|()| Completion::Completed).map_err(Failed::from),
            None => Ok(Completion::ignored_with("Xvfb is not installed")),
        }
    })
}

/// A running program with a window; ends when dropped.
pub struct Player<'a> {
    display: &'a Display,
    process: Process,
    /// Its window.
    pub window: Window,
}

impl Player<'_> {
    /// Seconds of processor time that the program has used, over all threads.
    ///
    /// # Errors
    /// If the system does not count it as Linux does.
    pub fn cpu_s(&self) -> Result<f64, String> {
        /// `USER_HZ`, the same on all machines that Rust knows.
        const TICKS_PER_S: f64 = 100.0;
        let path = format!("/proc/{}/stat", self.process.0.id());
        let stat = fs::read_to_string(&path).map_err(|error| format!("{path}: {error}"))?;
        // The name, in brackets, may contain blanks; utime and stime are fields 14 and 15.
        let fields = stat.rsplit_once(')').map_or("", |(_, fields)| fields).split_whitespace();
        let ticks: Vec<f64> = fields.skip(11).take(2).filter_map(|ticks| ticks.parse().ok()).collect();
        match ticks[..] {
            [user, system] => Ok((user + system) / TICKS_PER_S),
            _ => Err(format!("{path}: {stat}")),
        }
    }

    /// Closes the window and waits for the program to end.
    ///
    /// # Errors
    /// If it fails, or runs on for 20 s.
    pub fn close(mut self) -> Result<(), String> {
        self.display.close(self.window);
        let start = Instant::now();
        loop {
            match self.process.0.try_wait().map_err(|error| error.to_string())? {
                Some(status) if status.success() => return Ok(()),
                Some(status) => return Err(format!("closing the window ended it with {status}")),
                None if start.elapsed() > Duration::from_secs(20) => {
                    return Err("closing the window does not end it".into());
                }
                None => sleep(Duration::from_millis(20)),
            }
        }
    }
}

impl Display {
    /// Starts a server with one screen of this size in pixels; `None` if Xvfb is not installed.
    ///
    /// # Panics
    /// If Xvfb is installed but does not work.
    pub fn start(width: u16, height: u16) -> Option<Display> {
        let child = Command::new("Xvfb")
            .args(["-displayfd", "1", "-nolisten", "tcp", "-screen", "0", &format!("{width}x{height}x24")])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .ok()?;
        let mut server = Process(child);
        let mut number = String::new();
        let stdout = server.0.stdout.take().expect("piped");
        BufReader::new(stdout).read_line(&mut number).expect("Xvfb says its number");
        let name = format!(":{}", number.trim());
        let (connection, screen) = x11rb::connect(Some(&name)).expect("Xvfb accepts connections");
        let root = connection.setup().roots[screen].root;
        Some(Display { name, connection, root, _server: server })
    }

    /// A command that runs `program` on this display.
    pub fn command(&self, program: &Path) -> Command {
        let mut command = Command::new(program);
        command.env("DISPLAY", &self.name).env_remove("WAYLAND_DISPLAY").env_remove("WAYLAND_SOCKET");
        command
    }

    /// Starts a command and waits for its window, whose title contains `title`.
    ///
    /// # Errors
    /// If no such window appears within a minute, or the program ends.
    pub fn open(&self, command: &mut Command, title: &str) -> Result<Player<'_>, String> {
        let mut process = Process(command.spawn().map_err(|error| error.to_string())?);
        let window = wait_for(|| {
            if process.0.try_wait().is_ok_and(|status| status.is_some()) {
                return Some(None);
            }
            self.find_window(self.root, title).map(Some)
        });
        let window = window.flatten().ok_or_else(|| format!("no window is called {title}"))?;
        Ok(Player { display: self, process, window })
    }

    fn atom(&self, name: &str) -> u32 {
        let atom = self.connection.intern_atom(false, name.as_bytes()).expect("the server listens");
        atom.reply().expect("an atom").atom
    }

    /// Sends a message to a window.
    fn tell(&self, window: Window, kind: &str, data: [u32; 5]) {
        let event = ClientMessageEvent::new(32, window, self.atom(kind), data);
        let sent = self.connection.send_event(false, window, EventMask::NO_EVENT, event);
        sent.expect("the server listens").check().expect("the window is there");
    }

    /// Title of a window.
    pub fn title(&self, window: Window) -> String {
        let name = self.atom("_NET_WM_NAME");
        let property =
            self.connection.get_property(false, window, name, 0u32, 0, 256).expect("the server listens");
        property.reply().map(|reply| String::from_utf8_lossy(&reply.value).into_owned()).unwrap_or_default()
    }

    fn find_window(&self, parent: Window, title: &str) -> Option<Window> {
        let tree = self.connection.query_tree(parent).ok()?.reply().ok()?;
        tree.children.iter().copied().find_map(|window| {
            if self.title(window).contains(title) { Some(window) } else { self.find_window(window, title) }
        })
    }

    /// A screenshot of the window; `None` if it cannot be read, for example before it is mapped.
    pub fn screenshot(&self, window: Window) -> Option<Screenshot> {
        let size = self.connection.get_geometry(window).ok()?.reply().ok()?;
        let image = self
            .connection
            .get_image(ImageFormat::Z_PIXMAP, window, 0, 0, size.width, size.height, u32::MAX)
            .ok()?
            .reply()
            .ok()?;
        // 32-bit pixels: blue, green, red, unused.
        let rgb = image.data.as_chunks::<4>().0.iter().flat_map(|[b, g, r, _]| [*r, *g, *b]).collect();
        Some(Screenshot { width: size.width.into(), height: size.height.into(), rgb })
    }

    /// Waits for a screenshot that satisfies `condition`; `None` after a minute.
    pub fn wait_until(&self, window: Window, condition: impl Fn(&Screenshot) -> bool) -> Option<Screenshot> {
        wait_for(|| self.screenshot(window).filter(&condition))
    }

    /// Gives the window the keyboard focus.
    pub fn focus(&self, window: Window) {
        let focus = self.connection.set_input_focus(InputFocus::PARENT, window, 0u32);
        focus.expect("the server listens").check().expect("a mapped window takes the focus");
    }

    /// Covers the screen with a window.
    pub fn cover(&self) {
        let screen = &self.connection.setup().roots[0];
        let window = self.window(screen.width_in_pixels, screen.height_in_pixels);
        self.connection.map_window(window).expect("the server listens").check().expect("the window is there");
    }

    /// Presses and releases the key of an X11 keysym, which is ASCII for letters.
    pub fn press(&self, keysym: u32) {
        let setup = self.connection.setup();
        let (min, count) = (setup.min_keycode, setup.max_keycode - setup.min_keycode + 1);
        let mapping = self.connection.get_keyboard_mapping(min, count).expect("the server listens");
        let mapping = mapping.reply().expect("a keyboard");
        let row = mapping.keysyms.chunks(mapping.keysyms_per_keycode.into());
        let index = row.into_iter().position(|keysyms| keysyms.contains(&keysym)).expect("the key exists");
        const PRESS_AND_RELEASE: [u8; 2] = [2, 3];
        for event in PRESS_AND_RELEASE {
            let keycode = min + u8::try_from(index).expect("keycodes are bytes");
            let event = self.connection.xtest_fake_input(event, keycode, 0, self.root, 0, 0, 0);
            event.expect("the server listens").check().expect("Xvfb has XTEST");
        }
    }

    /// Asks the window to close, like a close button.
    fn close(&self, window: Window) {
        self.tell(window, "WM_PROTOCOLS", [self.atom("WM_DELETE_WINDOW"), 0, 0, 0, 0]);
    }

    /// Drops files on the window, as file managers do by XDND.
    pub fn drop_files(&self, window: Window, paths: &[PathBuf]) {
        let source = self.window(1, 1);
        let owns = self.connection.set_selection_owner(source, self.atom("XdndSelection"), 0u32);
        owns.expect("the server listens").check().expect("the window is there");
        const XDND_VERSION: u32 = 5;
        self.tell(window, "XdndEnter", [source, XDND_VERSION << 24, self.atom("text/uri-list"), 0, 0]);
        self.tell(window, "XdndPosition", [source, 0, 0, 0, self.atom("XdndActionCopy")]);
        let request = wait_for(|| match self.connection.poll_for_event() {
            Ok(Some(Event::SelectionRequest(request))) => Some(request),
            _ => None,
        });
        let SelectionRequestEvent { time, requestor, selection, target, property, .. } =
            request.expect("the window asks what is dropped");
        let uris: String = paths.iter().map(|path| format!("file://{}\r\n", path.display())).collect();
        let written =
            self.connection.change_property8(PropMode::REPLACE, requestor, property, target, uris.as_bytes());
        written.expect("the server listens").check().expect("the window is there");
        let response_type = SELECTION_NOTIFY_EVENT;
        let answer =
            SelectionNotifyEvent { response_type, sequence: 0, time, requestor, selection, target, property };
        let sent = self.connection.send_event(false, requestor, EventMask::NO_EVENT, answer);
        sent.expect("the server listens").check().expect("the window is there");
        self.tell(window, "XdndDrop", [source, 0, 0, 0, 0]);
    }

    /// A window of the test's own, which is not shown.
    fn window(&self, width: u16, height: u16) -> Window {
        let screen = &self.connection.setup().roots[0];
        let window = self.connection.generate_id().expect("the server has numbers left");
        let properties = CreateWindowAux::new().override_redirect(1).background_pixel(screen.black_pixel);
        let class = WindowClass::INPUT_OUTPUT;
        let created = self.connection.create_window(
            0,
            window,
            self.root,
            0,
            0,
            width,
            height,
            0,
            class,
            0,
            &properties,
        );
        created.expect("the server listens").check().expect("a window");
        window
    }
}

impl Screenshot {
    /// Number of distinct colours.
    pub fn colors(&self) -> usize {
        let mut colors: Vec<&[u8; 3]> = self.rgb.as_chunks::<3>().0.iter().collect();
        colors.sort_unstable();
        colors.dedup();
        colors.len()
    }

    /// Whether more than 200 pixels of the clip, above the controls, differ.
    pub fn clip_changed(&self, other: &Screenshot) -> bool {
        let rows = (3 * self.width * self.height.saturating_sub(CONTROLS)) as usize;
        let pixels =
            |screen: &'_ Screenshot| screen.rgb[..rows.min(screen.rgb.len())].as_chunks::<3>().0.to_vec();
        pixels(self).iter().zip(&pixels(other)).filter(|(a, b)| a != b).count() > 200
    }
}

fn wait_for<T>(mut poll: impl FnMut() -> Option<T>) -> Option<T> {
    let start = Instant::now();
    loop {
        if let Some(value) = poll() {
            return Some(value);
        }
        if start.elapsed() > PATIENCE {
            return None;
        }
        sleep(Duration::from_millis(50));
    }
}
