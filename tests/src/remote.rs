//! [`Remote`]: a head and a hand that a test moves, through Monado's remote driver.
//!
//! Every packet holds the whole state: the pose of the head, and of each controller its pose, for
//! aiming and gripping, and its buttons. Zero bytes are at rest.

use std::io::Write;
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::path::Path;
use std::time::{Duration, Instant};

use glam::{Quat, Vec2, Vec3};

use client::headset::interaction::Pose;
use client::headset::panel::{PanelQuad, SIZE};

/// Pose of the head, which looks along -z, and position of the right hand, in metres of the stage.
const HEAD: Pose = Pose { position: Vec3::new(0.0, 1.6, 0.0), orientation: Quat::IDENTITY };
const HAND: Vec3 = Vec3::new(0.2, 1.2, -0.2);

/// Longest wait for the driver.
const PATIENCE: Duration = Duration::from_secs(10);

/// First bytes of every packet: the protocol's version.
const MAGIC: [u8; 8] = *b"mndrmt3\0";

/// Length of a packet, and offsets of the head's pose and the right controller, in bytes.
const BYTES: usize = 376;
const HEAD_AT: usize = 104;
const RIGHT_AT: usize = 256;

/// Offsets in a controller: its trigger's value, its presence, and its upper button, which acts as the
/// menu button.
const TRIGGER_AT: usize = 72;
const ACTIVE_AT: usize = 105;
const MENU_AT: usize = 110;

/// The remote devices of a runtime.
pub struct Remote {
    stream: TcpStream,
    hand: Quat,
    trigger: bool,
    menu: bool,
}

impl Remote {
    /// Environment variable that selects the driver.
    pub(crate) const CHOICE: (&str, &str) = ("P_OVERRIDE_ACTIVE_CONFIG", "remote");

    /// Writes the configuration of a service with this home folder, and returns its port.
    ///
    /// # Panics
    /// If the folder cannot be written, or the system has no port.
    pub(crate) fn configure(home: &Path) -> u16 {
        // The system hands out other ports first, so this one stays free until the service binds it.
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

    /// Connects to a running service; the hand appears and points ahead.
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

    /// Points at the panel where it first appears; `at` is in its points from the upper left.
    ///
    /// # Panics
    /// If the service has ended, like all methods.
    pub fn point(&mut self, at: Vec2) {
        let quad = PanelQuad::before(&HEAD);
        let offset = (at - 0.5 * Vec2::new(SIZE.x, SIZE.y)) / Vec2::new(SIZE.x, -SIZE.y) * quad.size_m();
        let target = quad.pose().position + quad.pose().orientation * offset.extend(0.0);
        self.hand = Quat::from_rotation_arc(Vec3::NEG_Z, (target - HAND).normalize());
        self.send();
    }

    /// Presses or releases the trigger.
    pub fn trigger(&mut self, down: bool) {
        self.trigger = down;
        self.send();
    }

    /// Presses or releases the menu button.
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
