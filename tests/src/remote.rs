//! [`Remote`]: a head and a hand that a test moves, by Monado's driver for devices far away.
//!
//! Every packet says all there is to say: where the head is, and of each controller the pose, which
//! serves for pointing and for holding, and its buttons. What is not set is at rest.

use std::io::Write;
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::path::Path;
use std::time::{Duration, Instant};

use glam::{Quat, Vec2, Vec3};

use client::xr::interaction::Pose;
use client::xr::panel::{PanelQuad, SIZE};

/// Where the head is, looking along -z, and the right hand, in metres of the stage.
const HEAD: Pose = Pose { position: Vec3::new(0.0, 1.6, 0.0), orientation: Quat::IDENTITY };
const HAND: Vec3 = Vec3::new(0.2, 1.2, -0.2);

/// Longest to wait for the driver.
const PATIENCE: Duration = Duration::from_secs(10);

/// What every packet begins with: the version of its form.
const MAGIC: [u8; 8] = *b"mndrmt3\0";

/// Bytes of a packet, and where in it the parts begin: the pose of the head, and the right
/// controller.
const BYTES: usize = 376;
const HEAD_AT: usize = 104;
const RIGHT_AT: usize = 256;

/// Where in a controller's part these are: how far the trigger is pulled, whether it is there, and
/// its upper button, which serves as the menu button.
const TRIGGER_AT: usize = 72;
const ACTIVE_AT: usize = 105;
const MENU_AT: usize = 110;

/// The devices of a runtime whose service uses the driver.
pub struct Remote {
    stream: TcpStream,
    hand: Quat,
    trigger: bool,
    menu: bool,
}

impl Remote {
    /// The variable that has a service use the driver.
    pub(crate) const CHOICE: (&str, &str) = ("P_OVERRIDE_ACTIVE_CONFIG", "remote");

    /// Tells a service with this home folder where to listen; the port.
    ///
    /// # Panics
    /// If the folder cannot be written, or the system has no port.
    pub(crate) fn configure(home: &Path) -> u16 {
        // Whoever asks next gets another one: it is free until the service takes it.
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).expect("there is a free port");
        let port = listener.local_addr().expect("it is bound").port();
        let about = serde_json::json!({
            "active": "remote",
            "remote": {"version": 0, "port": port, "view_count": 2},
        });
        let folder = home.join(".config/monado");
        std::fs::create_dir_all(&folder).expect("temporary files can be made");
        std::fs::write(folder.join("config_v0.json"), about.to_string())
            .expect("temporary files can be written");
        port
    }

    /// Connects to a service that has started: the hand is there and points ahead.
    ///
    /// # Panics
    /// If the driver does not answer.
    pub(crate) fn connect(port: u16) -> Remote {
        let start = Instant::now();
        let stream = loop {
            match TcpStream::connect((Ipv4Addr::LOCALHOST, port)) {
                Ok(stream) => break stream,
                Err(error) => assert!(start.elapsed() < PATIENCE, "no remote devices: {error}"),
            }
            std::thread::sleep(Duration::from_millis(20));
        };
        stream.set_nodelay(true).expect("a stream can be set up");
        let mut remote = Remote { stream, hand: Quat::IDENTITY, trigger: false, menu: false };
        remote.send();
        remote
    }

    /// Points at a place of the panel where it first appears, in its points from the upper left.
    ///
    /// # Panics
    /// If the service went away, as for the rest.
    pub fn point(&mut self, at: Vec2) {
        let quad = PanelQuad::before(&HEAD);
        let offset = (at - 0.5 * Vec2::new(SIZE.x, SIZE.y)) / Vec2::new(SIZE.x, -SIZE.y) * quad.size_m();
        let target = quad.pose().position + quad.pose().orientation * offset.extend(0.0);
        self.hand = Quat::from_rotation_arc(Vec3::NEG_Z, (target - HAND).normalize());
        self.send();
    }

    /// Pulls the trigger or lets it go.
    pub fn trigger(&mut self, down: bool) {
        self.trigger = down;
        self.send();
    }

    /// Presses the menu button or lets it go.
    pub fn menu(&mut self, down: bool) {
        self.menu = down;
        self.send();
    }

    fn send(&mut self) {
        let mut packet = [0; BYTES];
        packet[..MAGIC.len()].copy_from_slice(&MAGIC);
        let mut write = |at: usize, numbers: &[f32]| {
            for (place, number) in packet[at..].chunks_exact_mut(4).zip(numbers) {
                place.copy_from_slice(&number.to_le_bytes());
            }
        };
        let pose = |pose: Pose| [pose.orientation.to_array().as_slice(), &pose.position.to_array()].concat();
        write(HEAD_AT, &pose(HEAD));
        write(RIGHT_AT, &pose(Pose { position: HAND, orientation: self.hand }));
        write(RIGHT_AT + TRIGGER_AT, &[f32::from(u8::from(self.trigger))]);
        packet[RIGHT_AT + ACTIVE_AT] = 1;
        packet[RIGHT_AT + MENU_AT] = u8::from(self.menu);
        self.stream.write_all(&packet).expect("the service listens");
    }
}
