//! [`Viewer`]: everything a person can change, and how keys, mouse and controls change it.
//!
//! It knows the interface library but neither the window nor the GPU, so that its tests feed it
//! key presses and drags and look at the clock and the camera.

use codec::{Camera, Clip, Viewpoint};
use egui::{Context, Id, PointerButton, Rect, Response, Sense, Ui};

use super::bar;
use super::camera::CameraControl;
use super::keys::{self, Command, FlyKeys};
use super::overlay::{self, Message};
use crate::gpu::RenderSettings;
use crate::player::Player;
use crate::viewpoint;

/// Points of scrolling per notch of a wheel.
const POINTS_PER_NOTCH: f64 = 40.0;

/// What a viewer must know of a clip.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Scene {
    duration_s: f64,
    fps: f64,
    up: [f32; 3],
    /// Never empty.
    viewpoints: Vec<Viewpoint>,
    /// At least 1.
    layers: usize,
}

impl Scene {
    /// Of a clip; one without viewpoints gets one that frames its box.
    pub(crate) fn of(clip: &Clip) -> Scene {
        let info = &clip.info;
        Scene {
            duration_s: info.duration_s.into(),
            fps: info.fps.into(),
            up: info.up,
            viewpoints: viewpoint::viewpoints(clip),
            layers: clip.layers.len().max(1),
        }
    }
}

/// What a frame of the interface asks of the window.
#[derive(Debug, Default, PartialEq, Eq)]
pub(crate) struct Requests {
    pub(crate) screenshot: bool,
    pub(crate) toggle_full_screen: bool,
}

/// The state of the interface.
pub(crate) struct Viewer {
    pub(crate) player: Player,
    pub(crate) settings: RenderSettings,
    pub(crate) message: Option<Message>,
    /// Whether the timeline is held.
    pub(crate) scrubbing: bool,
    scene: Scene,
    camera: CameraControl,
    /// Number of the viewpoint last chosen.
    viewpoint: usize,
    fly_keys: FlyKeys,
    controls_shown: bool,
    statistics_shown: bool,
    keys_shown: bool,
}

impl Viewer {
    /// A viewer of `scene` that plays from its viewpoint number `viewpoint`.
    ///
    /// # Panics
    /// If there is no such viewpoint.
    pub(crate) fn new(scene: Scene, viewpoint: usize, settings: RenderSettings) -> Viewer {
        Viewer {
            player: Player::new(scene.duration_s, scene.fps),
            settings,
            message: None,
            scrubbing: false,
            camera: CameraControl::new(&scene.viewpoints[viewpoint], scene.up),
            scene,
            viewpoint,
            fly_keys: FlyKeys::default(),
            controls_shown: true,
            statistics_shown: true,
            keys_shown: false,
        }
    }

    /// Changes to another clip: from its start, from its first viewpoint, with all its layers.
    pub(crate) fn change_scene(&mut self, scene: Scene) {
        self.player.change_clip(scene.duration_s, scene.fps);
        self.settings.layers = None;
        self.camera = CameraControl::new(&scene.viewpoints[0], scene.up);
        self.viewpoint = 0;
        self.scene = scene;
        self.message = None;
    }

    /// Goes on with the clip that follows in a playlist. Seen from the same viewpoints it is on the same
    /// stage, and the camera stays where it is.
    pub(crate) fn follow_scene(&mut self, scene: Scene) {
        self.player.follow_with(scene.duration_s, scene.fps);
        self.settings.layers = self.settings.layers.filter(|layers| *layers <= scene.layers);
        if (scene.up, &scene.viewpoints) != (self.scene.up, &self.scene.viewpoints) {
            self.camera = CameraControl::new(&scene.viewpoints[0], scene.up);
            self.viewpoint = 0;
        }
        self.scene = scene;
    }

    /// Changes to a clip with more layers of the same scene: nothing that a person set changes. Of
    /// another scene, as [`Viewer::change_scene`].
    pub(crate) fn refine_scene(&mut self, scene: Scene) {
        if (Scene { layers: self.scene.layers, ..scene.clone() }) == self.scene {
            self.scene.layers = scene.layers;
        } else {
            self.change_scene(scene);
        }
    }

    /// Viewpoints to choose from; never empty.
    pub(crate) fn viewpoints(&self) -> &[Viewpoint] {
        &self.scene.viewpoints
    }

    /// Number of the viewpoint last chosen.
    pub(crate) fn viewpoint(&self) -> usize {
        self.viewpoint
    }

    /// Layers that can be drawn, at least 1.
    pub(crate) fn layers(&self) -> usize {
        self.scene.layers
    }

    /// The camera for a window of `width` x `height` pixels.
    pub(crate) fn camera(&self, width: u32, height: u32) -> Camera {
        self.camera.camera(width, height)
    }

    /// Whether the picture changes without further input.
    pub(crate) fn is_animating(&self) -> bool {
        self.player.is_moving() || self.fly_keys.fly().is_moving()
    }

    /// One frame: takes the input in, moves clock and camera on by `elapsed_s` seconds, and shows
    /// the controls. `statistics` are rows of names and values.
    pub(crate) fn frame(&mut self, ui: &mut Ui, elapsed_s: f64, statistics: &[(&str, String)]) -> Requests {
        let ctx = ui.ctx().clone();
        let mut commands = self.keyboard(&ctx);
        let window = ui.available_rect_before_wrap();
        if self.controls_shown {
            bar::show(ui, self, &mut commands);
        }
        let picture = ui.available_rect_before_wrap();
        self.mouse(ui, picture);

        let mut requests = Requests::default();
        for command in commands {
            self.apply(command, &mut requests);
        }
        if !self.scrubbing {
            self.player.advance(elapsed_s);
        }
        self.camera.fly(self.fly_keys.fly(), elapsed_s);

        if self.statistics_shown && self.controls_shown && !self.keys_shown {
            overlay::statistics(&ctx, statistics);
        }
        if self.keys_shown {
            overlay::keys(&ctx);
        }
        overlay::message(&ctx, window.bottom() - picture.bottom(), &mut self.message);
        if ctx.input(|input| !input.raw.hovered_files.is_empty()) {
            overlay::drop_hint(&ctx);
        }
        requests
    }

    /// Keys, unless a control has the focus and takes them itself.
    fn keyboard(&mut self, ctx: &Context) -> Vec<Command> {
        if ctx.egui_wants_keyboard_input() {
            self.fly_keys.release();
            return Vec::new();
        }
        ctx.input(|input| {
            self.fly_keys.update(input);
            keys::commands(input)
        })
    }

    /// Drags and the wheel on the picture.
    fn mouse(&mut self, ui: &Ui, picture: Rect) {
        let response = ui.interact(picture, Id::unique("picture"), Sense::drag());
        if response.drag_started() {
            // A control that was reached with Tab gives the keys back.
            ui.memory_mut(|memory| memory.focused().into_iter().for_each(|id| memory.surrender_focus(id)));
        }
        self.drag(&response, f64::from(ui.ctx().content_rect().height()));
        if response.contains_pointer() {
            let (scroll, zoom) = ui.input(|input| (input.smooth_scroll_delta().y, input.zoom_delta()));
            // A pinch to double size halves the distance: ln 2 / ln(1 / 0.9) notches.
            let pinch =
                f64::from(zoom.max(f32::MIN_POSITIVE)).ln() / super::camera::ZOOM_PER_NOTCH.recip().ln();
            self.camera.zoom(f64::from(scroll) / POINTS_PER_NOTCH + pinch);
        }
    }

    fn drag(&mut self, response: &Response, window_height: f64) {
        let delta = response.drag_delta();
        let (dx, dy) = (f64::from(delta.x) / window_height, f64::from(delta.y) / window_height);
        let modifiers = response.ctx.input(|input| input.modifiers);
        let flying = self.fly_keys.fly().is_moving();
        let other_button =
            response.dragged_by(PointerButton::Secondary) || response.dragged_by(PointerButton::Middle);
        if other_button || response.dragged() && modifiers.shift && !flying {
            self.camera.pan(dx, dy);
        } else if response.dragged() && (flying || modifiers.ctrl) {
            self.camera.look(dx, dy);
        } else if response.dragged() {
            self.camera.orbit(dx, dy);
        }
    }

    fn apply(&mut self, command: Command, requests: &mut Requests) {
        let player = &mut self.player;
        match command {
            Command::TogglePlaying => player.toggle_playing(),
            Command::StepBack => player.step_back(),
            Command::StepForward => player.step_forward(),
            Command::GoToStart => player.seek(0.0),
            Command::Slower => player.slower(),
            Command::Faster => player.faster(),
            Command::NormalSpeed => player.set_speed(1.0),
            Command::ToggleLoop => player.set_looping(!player.is_looping()),
            Command::GoToViewpoint(number) => self.go_to_viewpoint(number),
            Command::Recentre => self.go_to_viewpoint(self.viewpoint),
            Command::Screenshot => requests.screenshot = true,
            Command::ToggleKeys => self.keys_shown = !self.keys_shown,
            Command::ToggleStatistics => self.statistics_shown = !self.statistics_shown,
            Command::ToggleInterface => self.controls_shown = !self.controls_shown,
            Command::ToggleFullScreen => requests.toggle_full_screen = true,
            Command::Dismiss if self.keys_shown => self.keys_shown = false,
            Command::Dismiss => self.message = None,
        }
    }

    fn go_to_viewpoint(&mut self, number: usize) {
        if let Some(viewpoint) = self.scene.viewpoints.get(number) {
            self.camera.go_to(viewpoint);
            self.viewpoint = number;
        }
    }
}

#[cfg(test)]
mod tests {
    use egui::{Event, Key, Modifiers, MouseWheelUnit, Pos2, RawInput, pos2, vec2};

    use super::*;

    /// A viewer and the interface around it, without a window.
    struct Bench {
        ctx: Context,
        viewer: Viewer,
        time_s: f64,
    }

    const SIZE: egui::Vec2 = vec2(1000.0, 700.0);
    const CENTER: Pos2 = pos2(500.0, 300.0);

    fn scene() -> Scene {
        let viewpoint = |name: &str, x: f32| Viewpoint {
            name: name.into(),
            position: [x, 0.0, 5.0],
            target: [0.0; 3],
            fov_y: 0.8,
        };
        Scene {
            duration_s: 2.0,
            fps: 10.0,
            up: [0.0, 1.0, 0.0],
            viewpoints: vec![viewpoint("front", 0.0), viewpoint("side", 3.0)],
            layers: 3,
        }
    }

    impl Bench {
        fn new() -> Bench {
            let ctx = Context::default();
            super::super::style::apply(&ctx);
            let viewer = Viewer::new(scene(), 0, RenderSettings::default());
            let mut bench = Bench { ctx, viewer, time_s: 0.0 };
            // The first frame lays the controls out.
            bench.frame(0.0, vec![]);
            bench
        }

        fn frame(&mut self, elapsed_s: f64, events: Vec<Event>) -> Requests {
            self.time_s += elapsed_s;
            let screen_rect = Some(Rect::from_min_size(Pos2::ZERO, SIZE));
            let time = Some(self.time_s);
            let input = RawInput { screen_rect, time, focused: true, events, ..RawInput::default() };
            let mut requests = Requests::default();
            let output = self.ctx.run_ui(input, |ui| {
                requests = self.viewer.frame(ui, elapsed_s, &[("frame", "16.7 ms".into())]);
            });
            output.drop_without_applying_deltas();
            requests
        }

        fn press(&mut self, key: Key) -> Requests {
            let event = |pressed| Event::Key {
                key,
                physical_key: Some(key),
                pressed,
                repeat: false,
                modifiers: Modifiers::NONE,
            };
            self.frame(0.0, vec![event(true), event(false)])
        }

        fn drag(&mut self, button: PointerButton, modifiers: Modifiers, from: Pos2, to: Pos2) {
            let event = |pos, pressed| Event::PointerButton { pos, button, pressed, modifiers };
            let frames = [
                vec![Event::ModifiersChanged(modifiers), Event::PointerMoved(from)],
                vec![event(from, true)],
                vec![Event::PointerMoved(to)],
                vec![event(to, false)],
            ];
            for events in frames {
                self.frame(0.0, events);
            }
        }

        fn eye(&self) -> [f64; 3] {
            self.viewer.camera(100, 100).position()
        }
    }

    fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
        glam::DVec3::from(a).distance(glam::DVec3::from(b))
    }

    #[test]
    fn it_plays_at_once_and_keys_drive_the_clock() {
        let mut bench = Bench::new();
        bench.frame(0.5, vec![]);
        assert!((bench.viewer.player.position_s() - 0.5).abs() < 1e-9);
        bench.press(Key::Space);
        bench.frame(0.5, vec![]);
        assert!((bench.viewer.player.position_s() - 0.5).abs() < 1e-9 && !bench.viewer.is_animating());
        bench.press(Key::ArrowRight);
        assert_eq!(bench.viewer.player.frame(), 6);
        bench.press(Key::L);
        bench.press(Key::ArrowDown);
        assert!(!bench.viewer.player.is_looping() && bench.viewer.player.speed() == 0.75);
        bench.press(Key::Home);
        assert_eq!(bench.viewer.player.position_s(), 0.0);
    }

    #[test]
    fn a_drag_on_the_picture_orbits_and_one_on_the_bar_does_not() {
        let mut bench = Bench::new();
        let eye = bench.eye();
        bench.drag(PointerButton::Primary, Modifiers::NONE, CENTER, CENTER + vec2(140.0, 0.0));
        let turned = bench.eye();
        assert!(distance(eye, turned) > 0.5 && (distance(turned, [0.0; 3]) - 5.0).abs() < 1e-6);
        bench.drag(PointerButton::Primary, Modifiers::NONE, pos2(500.0, 690.0), CENTER);
        assert_eq!(bench.eye(), turned);
    }

    #[test]
    fn buttons_and_modifiers_choose_the_motion() {
        let to = CENTER + vec2(70.0, 0.0);
        let front = [0.0, 0.0, 5.0];
        for (button, modifiers) in [
            (PointerButton::Secondary, Modifiers::NONE),
            (PointerButton::Middle, Modifiers::NONE),
            (PointerButton::Primary, Modifiers::SHIFT),
        ] {
            let mut bench = Bench::new();
            bench.drag(button, modifiers, CENTER, to);
            let [x, y, z] = bench.eye();
            assert!(x < -0.1 && y.abs() < 1e-9 && (z - 5.0).abs() < 1e-9, "pan moved the eye to {x} {y} {z}");
        }
        let mut bench = Bench::new();
        bench.drag(PointerButton::Primary, Modifiers::CTRL, CENTER, to);
        assert!(distance(bench.eye(), front) < 1e-9, "looking around keeps the eye");
        assert!(bench.viewer.camera(100, 100).camera_from_world[2][0] < -0.01);
    }

    #[test]
    fn the_wheel_zooms_on_the_picture_alone() {
        let mut bench = Bench::new();
        let wheel = |pos| {
            vec![
                Event::PointerMoved(pos),
                Event::MouseWheel {
                    unit: MouseWheelUnit::Line,
                    delta: vec2(0.0, 3.0),
                    phase: egui::TouchPhase::Move,
                    source: egui::MouseWheelSource::Unknown,
                    modifiers: Modifiers::NONE,
                },
            ]
        };
        bench.press(Key::Space);
        bench.frame(0.1, wheel(pos2(500.0, 690.0)));
        for _ in 0..20 {
            bench.frame(0.1, vec![]);
        }
        assert_eq!(bench.eye(), [0.0, 0.0, 5.0]);
        bench.frame(0.1, wheel(CENTER));
        for _ in 0..20 {
            bench.frame(0.1, vec![]);
        }
        let expected = 5.0 * super::super::camera::ZOOM_PER_NOTCH.powi(3);
        assert!((bench.eye()[2] - expected).abs() < 0.05, "{:?}, expected {expected}", bench.eye());
    }

    #[test]
    fn the_timeline_seeks_and_holds_the_clock() {
        let mut bench = Bench::new();
        // The timeline spans the window less its margins, at the top of the bar.
        let y = (600..700).map(|y| y as f32).find(|&y| {
            let mut probe = Bench::new();
            probe.frame(0.0, vec![Event::PointerMoved(pos2(500.0, y))]);
            let event = |pressed| Event::PointerButton {
                pos: pos2(500.0, y),
                button: PointerButton::Primary,
                pressed,
                modifiers: Modifiers::NONE,
            };
            probe.frame(0.0, vec![event(true)]);
            probe.viewer.scrubbing
        });
        let at = |x: f32| pos2(x, y.expect("a timeline"));
        let button = |x, pressed| Event::PointerButton {
            pos: at(x),
            button: PointerButton::Primary,
            pressed,
            modifiers: Modifiers::NONE,
        };
        bench.frame(0.0, vec![Event::PointerMoved(at(500.0))]);
        bench.frame(0.0, vec![button(500.0, true)]);
        bench.frame(0.3, vec![Event::PointerMoved(at(750.0))]);
        let position_s = bench.viewer.player.position_s();
        assert!((position_s - 1.5).abs() < 0.05, "{position_s}");
        bench.frame(0.3, vec![]);
        assert_eq!(bench.viewer.player.position_s(), position_s, "held");
        bench.frame(0.0, vec![button(750.0, false)]);
        bench.frame(0.1, vec![]);
        assert!((bench.viewer.player.position_s() - position_s - 0.1).abs() < 1e-9, "let go, it plays on");
    }

    #[test]
    fn held_keys_fly_and_a_drag_then_steers() {
        let mut bench = Bench::new();
        let key = |pressed| Event::Key {
            key: Key::W,
            physical_key: Some(Key::W),
            pressed,
            repeat: false,
            modifiers: Modifiers::NONE,
        };
        bench.frame(0.0, vec![key(true)]);
        bench.frame(1.0, vec![]);
        assert!(bench.eye()[2] < 4.9 && bench.viewer.is_animating());
        let eye = bench.eye();
        bench.drag(PointerButton::Primary, Modifiers::NONE, CENTER, CENTER + vec2(70.0, 0.0));
        assert!(distance(bench.eye(), eye) < 1e-9);
        bench.frame(0.0, vec![key(false)]);
        let eye = bench.eye();
        bench.frame(1.0, vec![]);
        assert_eq!(bench.eye(), eye);
    }

    #[test]
    fn viewpoints_and_recentre() {
        let mut bench = Bench::new();
        bench.press(Key::Num2);
        assert!(bench.viewer.viewpoint() == 1 && distance(bench.eye(), [3.0, 0.0, 5.0]) < 1e-6);
        bench.drag(PointerButton::Primary, Modifiers::NONE, CENTER, CENTER + vec2(140.0, 60.0));
        assert!(distance(bench.eye(), [3.0, 0.0, 5.0]) > 0.1);
        bench.press(Key::R);
        assert!(distance(bench.eye(), [3.0, 0.0, 5.0]) < 1e-6);
        bench.press(Key::Num9);
        assert_eq!(bench.viewer.viewpoint(), 1, "there is no ninth viewpoint");
    }

    #[test]
    fn the_window_is_asked_for_what_it_does() {
        let mut bench = Bench::new();
        assert_eq!(bench.frame(0.0, vec![]), Requests::default());
        assert!(bench.press(Key::P).screenshot);
        assert!(bench.press(Key::F11).toggle_full_screen);
    }

    #[test]
    fn escape_closes_the_list_before_the_message() {
        let mut bench = Bench::new();
        bench.viewer.message = Some(Message::Error("no such file".into()));
        bench.press(Key::H);
        assert!(bench.viewer.keys_shown);
        bench.press(Key::Escape);
        assert!(!bench.viewer.keys_shown && bench.viewer.message.is_some());
        bench.press(Key::Escape);
        assert_eq!(bench.viewer.message, None);
    }

    #[test]
    fn a_note_goes_away_and_an_error_stays() {
        let mut bench = Bench::new();
        bench.viewer.message = Some(Message::note(&bench.ctx, "saved".into()));
        bench.frame(1.0, vec![]);
        assert!(bench.viewer.message.is_some());
        bench.frame(10.0, vec![]);
        assert_eq!(bench.viewer.message, None);
        bench.viewer.message = Some(Message::Error("broken".into()));
        bench.frame(100.0, vec![]);
        assert!(bench.viewer.message.is_some());
    }

    #[test]
    fn more_layers_of_the_same_scene_change_nothing_else() {
        let mut bench = Bench::new();
        bench.press(Key::Num2);
        bench.frame(0.5, vec![]);
        bench.viewer.settings.layers = Some(1);
        let (eye, position_s) = (bench.eye(), bench.viewer.player.position_s());
        bench.viewer.refine_scene(Scene { layers: 4, ..scene() });
        let viewer = &bench.viewer;
        assert_eq!((viewer.layers(), viewer.viewpoint(), viewer.settings.layers), (4, 1, Some(1)));
        assert_eq!((viewer.player.position_s(), bench.eye()), (position_s, eye));
        bench.viewer.refine_scene(Scene { duration_s: 7.0, ..scene() });
        assert_eq!(bench.viewer.player.position_s(), 0.0, "it has changed on the server");
    }

    #[test]
    fn the_next_clip_of_a_list_goes_on_with_what_was_set() {
        let mut bench = Bench::new();
        bench.press(Key::Num2);
        bench.press(Key::ArrowDown);
        bench.drag(PointerButton::Primary, Modifiers::NONE, CENTER, CENTER + vec2(140.0, 0.0));
        bench.viewer.settings.layers = Some(3);
        let eye = bench.eye();
        bench.viewer.player.seek(1.9);
        bench.viewer.player.set_followed(true);
        bench.frame(0.2, vec![]);
        assert!(bench.viewer.player.over_s().is_some());
        bench.viewer.follow_scene(Scene { duration_s: 7.0, layers: 2, ..scene() });
        let viewer = &bench.viewer;
        assert!((viewer.player.position_s() - 0.05).abs() < 1e-9 && viewer.player.speed() == 0.75);
        assert!(viewer.viewpoint() == 1 && viewer.settings.layers.is_none(), "it has no third layer");
        assert_eq!(bench.eye(), eye);
        bench.viewer.follow_scene(Scene { viewpoints: scene().viewpoints[1..].to_vec(), ..scene() });
        assert_ne!(bench.eye(), eye, "elsewhere");
        assert_eq!(bench.viewer.viewpoint(), 0);
    }

    #[test]
    fn another_scene_starts_over_from_its_first_viewpoint() {
        let mut bench = Bench::new();
        bench.press(Key::Num2);
        bench.frame(1.0, vec![]);
        bench.viewer.settings.layers = Some(1);
        let other = Scene { duration_s: 7.0, viewpoints: scene().viewpoints[..1].to_vec(), ..scene() };
        bench.viewer.change_scene(other);
        let viewer = &bench.viewer;
        assert!(viewer.player.position_s() == 0.0 && viewer.player.duration_s() == 7.0);
        assert!(viewer.viewpoint() == 0 && viewer.settings.layers.is_none());
        assert!(distance(bench.eye(), [0.0, 0.0, 5.0]) < 1e-6);
    }
}
