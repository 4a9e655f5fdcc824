//! Tests of the viewer: input in, playback position and camera out.

use egui::{Event, Key, Modifiers, MouseWheelUnit, Pos2, RawInput, pos2, vec2};

use codec::Viewpoint;

use super::*;
use crate::window::library::listed;

/// A viewer with an interface and without a window.
struct Bench {
    ctx: Context,
    viewer: Viewer,
    volume: Option<Volume>,
    time_s: f64,
    size: egui::Vec2,
}

const SIZE: egui::Vec2 = vec2(1000.0, 700.0);
const CENTER: Pos2 = pos2(500.0, 300.0);

fn clip() -> ViewedClip {
    let viewpoint = |name: &str, x: f32| Viewpoint {
        name: name.into(),
        position: [x, 0.0, 5.0],
        target: [0.0; 3],
        fov_y: 0.8,
    };
    ViewedClip {
        duration_s: 2.0,
        fps: 10.0,
        is_static: false,
        up: [0.0, 1.0, 0.0],
        viewpoints: vec![viewpoint("front", 0.0), viewpoint("side", 3.0)],
        layers: 3,
    }
}

fn statistics() -> [(&'static str, String); 1] {
    [("frame", "16.7 ms".into())]
}

fn key_event(key: Key, pressed: bool) -> Event {
    Event::Key { key, physical_key: Some(key), pressed, repeat: false, modifiers: Modifiers::NONE }
}

impl Bench {
    fn new() -> Bench {
        Bench::with(clip())
    }

    fn with(clip: ViewedClip) -> Bench {
        let ctx = Context::default();
        crate::window::style::apply(&ctx);
        let viewer = Viewer::new(clip, RenderSettings::default());
        let mut bench = Bench { ctx, viewer, volume: None, time_s: 0.0, size: SIZE };
        // The first frame lays the controls out.
        bench.frame(0.0, vec![]);
        bench
    }

    /// The texts of the interface that are visible as a whole.
    fn texts(&mut self) -> Vec<(String, Rect)> {
        let screen = Rect::from_min_size(Pos2::ZERO, self.size);
        let input = RawInput {
            screen_rect: Some(screen),
            time: Some(self.time_s),
            focused: true,
            ..RawInput::default()
        };
        let seconds = FrameSeconds { elapsed_s: 0.0, played_s: 0.0 };
        let output = self.ctx.run_ui(input, |ui| {
            self.viewer.frame(ui, seconds, self.volume.as_mut(), &statistics());
        });
        let mut texts = Vec::new();
        for shape in &output.shapes {
            collect_texts(&shape.shape, shape.clip_rect.intersect(screen), &mut texts);
        }
        output.drop_without_applying_deltas();
        texts
    }

    fn frame(&mut self, elapsed_s: f64, events: Vec<Event>) -> Requests {
        self.time_s += elapsed_s;
        let screen_rect = Some(Rect::from_min_size(Pos2::ZERO, self.size));
        let time = Some(self.time_s);
        let input = RawInput { screen_rect, time, focused: true, events, ..RawInput::default() };
        let mut requests = Requests::default();
        let output = self.ctx.run_ui(input, |ui| {
            // Sound is half as fast as the display.
            let played_s = if self.volume.is_some() { 0.5 * elapsed_s } else { elapsed_s };
            let seconds = FrameSeconds { elapsed_s, played_s };
            requests = self.viewer.frame(ui, seconds, self.volume.as_mut(), &statistics());
        });
        output.drop_without_applying_deltas();
        requests
    }

    fn press(&mut self, key: Key) -> Requests {
        self.frame(0.0, vec![key_event(key, true), key_event(key, false)])
    }

    /// Clicks where the interface shows this text.
    fn click(&mut self, text: &str) -> Requests {
        let screen_rect = Some(Rect::from_min_size(Pos2::ZERO, self.size));
        let input = RawInput { screen_rect, time: Some(self.time_s), focused: true, ..RawInput::default() };
        let seconds = FrameSeconds { elapsed_s: 0.0, played_s: 0.0 };
        let output = self.ctx.run_ui(input, |ui| {
            self.viewer.frame(ui, seconds, self.volume.as_mut(), &[]);
        });
        let found = output.shapes.iter().find_map(|shape| place(&shape.shape, text));
        output.drop_without_applying_deltas();
        let at = found.unwrap_or_else(|| panic!("{text} is not shown"));
        let event = |pressed| primary(at, pressed);
        self.frame(0.0, vec![Event::PointerMoved(at)]);
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

/// The texts of a shape that lie in `visible`.
fn collect_texts(shape: &egui::Shape, visible: Rect, texts: &mut Vec<(String, Rect)>) {
    match shape {
        egui::Shape::Vec(shapes) => shapes.iter().for_each(|shape| collect_texts(shape, visible, texts)),
        egui::Shape::Text(shape) if visible.contains_rect(shape.visual_bounding_rect()) => {
            texts.push((shape.galley.text().into(), shape.visual_bounding_rect()));
        }
        _ => {}
    }
}

/// The middle of a text among shapes.
fn place(shape: &egui::Shape, text: &str) -> Option<Pos2> {
    match shape {
        egui::Shape::Vec(shapes) => shapes.iter().find_map(|shape| place(shape, text)),
        egui::Shape::Text(shape) if shape.galley.text() == text => {
            Some(shape.visual_bounding_rect().center())
        }
        _ => None,
    }
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    glam::DVec3::from(a).distance(glam::DVec3::from(b))
}

#[test]
fn it_plays_at_once_and_keys_control_the_player() {
    let mut bench = Bench::new();
    bench.frame(0.5, vec![]);
    assert!((bench.viewer.clock.position_s() - 0.5).abs() < 1e-9);
    bench.press(Key::Space);
    bench.frame(0.5, vec![]);
    assert!((bench.viewer.clock.position_s() - 0.5).abs() < 1e-9);
    assert_eq!(bench.viewer.next_change_s(false), None);
    bench.press(Key::ArrowRight);
    assert_eq!(bench.viewer.clock.frame(), 6);
    bench.press(Key::L);
    bench.press(Key::ArrowDown);
    assert!(!bench.viewer.clock.is_looping() && bench.viewer.clock.speed() == 0.75);
    bench.press(Key::Home);
    assert_eq!(bench.viewer.clock.position_s(), 0.0);
    bench.viewer.clock.seek(1.0);
    bench.press(Key::B);
    bench.press(Key::Space);
    bench.frame(0.4, vec![]);
    assert!((bench.viewer.clock.position_s() - 0.7).abs() < 1e-9, "backwards at a speed of 0.75");
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
fn the_wheel_zooms_only_over_the_picture() {
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
    let expected = 5.0 * crate::window::camera::ZOOM_PER_NOTCH.powi(3);
    assert!((bench.eye()[2] - expected).abs() < 0.05, "{:?}, expected {expected}", bench.eye());
}

fn primary(pos: Pos2, pressed: bool) -> Event {
    Event::PointerButton { pos, button: PointerButton::Primary, pressed, modifiers: Modifiers::NONE }
}

/// Height of the timeline of `clip` in the window, if there is one.
fn timeline_y(clip: &ViewedClip) -> Option<f32> {
    (600..700).map(|y| y as f32).find(|&y| {
        let mut probe = Bench::with(clip.clone());
        probe.frame(0.0, vec![Event::PointerMoved(pos2(500.0, y))]);
        probe.frame(0.0, vec![primary(pos2(500.0, y), true)]);
        probe.viewer.is_scrubbing
    })
}

#[test]
fn the_timeline_seeks_and_pauses_while_held() {
    let mut bench = Bench::new();
    let y = timeline_y(&clip()).expect("a timeline");
    bench.frame(0.0, vec![Event::PointerMoved(pos2(500.0, y))]);
    bench.frame(0.0, vec![primary(pos2(500.0, y), true)]);
    bench.frame(0.3, vec![Event::PointerMoved(pos2(750.0, y))]);
    let position_s = bench.viewer.clock.position_s();
    assert!((position_s - 1.5).abs() < 0.05, "{position_s}");
    bench.frame(0.3, vec![]);
    assert_eq!(bench.viewer.clock.position_s(), position_s, "held");
    bench.frame(0.0, vec![primary(pos2(750.0, y), false)]);
    bench.frame(0.1, vec![]);
    assert!((bench.viewer.clock.position_s() - position_s - 0.1).abs() < 1e-9, "released, it plays");
}

#[test]
fn a_click_within_one_frame_seeks() {
    let mut bench = Bench::new();
    let at = pos2(750.0, timeline_y(&clip()).expect("a timeline"));
    bench.frame(0.0, vec![Event::PointerMoved(at)]);
    bench.frame(0.0, vec![primary(at, true), primary(at, false)]);
    let position_s = bench.viewer.clock.position_s();
    assert!((position_s - 1.5).abs() < 0.05 && !bench.viewer.is_scrubbing, "{position_s}");
    bench.frame(0.1, vec![]);
    assert!((bench.viewer.clock.position_s() - position_s - 0.1).abs() < 1e-9, "it plays on");
}

#[test]
fn a_static_clip_has_no_timeline_and_rests() {
    let statue = ViewedClip { is_static: true, ..clip() };
    assert_eq!(timeline_y(&statue), None);
    let mut bench = Bench::with(statue);
    assert_eq!(bench.viewer.next_change_s(false), None);
    bench.frame(0.5, vec![]);
    assert_eq!(bench.viewer.clip_time(), 0.0);
    assert_eq!(bench.viewer.next_change_s(true), Some(1.5), "the next clip of a playlist follows");
    bench.press(Key::Space);
    assert_eq!(bench.viewer.next_change_s(true), None, "it is paused");
    bench.press(Key::Space);
    bench.viewer.update_clip(ViewedClip { layers: 4, ..clip() });
    assert_eq!(bench.viewer.next_change_s(false), Some(0.0), "its next layer moves");
    assert!((bench.viewer.clock.position_s() - 0.5).abs() < 1e-9);
}

#[test]
fn held_keys_fly_and_a_drag_steers() {
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
    assert!(bench.eye()[2] < 4.9 && bench.viewer.next_change_s(false) == Some(0.0));
    let eye = bench.eye();
    bench.drag(PointerButton::Primary, Modifiers::NONE, CENTER, CENTER + vec2(70.0, 0.0));
    assert!(distance(bench.eye(), eye) < 1e-9);
    bench.frame(0.0, vec![key(false)]);
    let eye = bench.eye();
    bench.frame(1.0, vec![]);
    assert_eq!(bench.eye(), eye);
}

#[test]
fn keys_choose_viewpoints_and_recentre() {
    let mut bench = Bench::new();
    bench.press(Key::Num2);
    assert!(bench.viewer.viewpoint == 1 && distance(bench.eye(), [3.0, 0.0, 5.0]) < 1e-6);
    bench.drag(PointerButton::Primary, Modifiers::NONE, CENTER, CENTER + vec2(140.0, 60.0));
    assert!(distance(bench.eye(), [3.0, 0.0, 5.0]) > 0.1);
    bench.press(Key::R);
    assert!(distance(bench.eye(), [3.0, 0.0, 5.0]) < 1e-6);
    bench.press(Key::Num9);
    assert_eq!(bench.viewer.viewpoint, 1, "there is no ninth viewpoint");
    let down = |bench: &Bench| bench.viewer.camera.camera(64, 64).camera_from_world[1];
    let before = down(&bench);
    bench.press(Key::T);
    assert!(distance(bench.eye(), [3.0, 0.0, 5.0]) < 1e-6, "the eye stays where another axis is up");
    assert_ne!(down(&bench), before);
    assert!(matches!(bench.viewer.message, Some(Message::Note { .. })));
}

#[test]
fn keys_of_the_window_become_requests() {
    let mut bench = Bench::new();
    assert_eq!(bench.frame(0.0, vec![]), Requests::default());
    assert!(bench.press(Key::P).screenshot);
    assert!(bench.press(Key::F11).toggle_full_screen);
}

#[test]
fn letters_work_while_a_control_has_the_focus() {
    let mut bench = Bench::new();
    (0..3).for_each(|_| drop(bench.press(Key::Tab)));
    assert!(bench.ctx.memory(|memory| memory.focused().is_some()));
    assert!(bench.press(Key::P).screenshot);
    bench.frame(0.0, vec![key_event(Key::W, true)]);
    assert!(bench.viewer.fly_keys.fly().is_flying());
}

#[test]
fn statistics_are_shown_on_request() {
    let mut bench = Bench::new();
    let shows = |bench: &mut Bench| bench.texts().iter().any(|(text, _)| text == "16.7 ms");
    assert!(!shows(&mut bench));
    bench.press(Key::I);
    assert!(shows(&mut bench));
}

#[test]
fn the_view_fills_what_the_bar_does_not_cover() {
    let mut bench = Bench::new();
    let bar = bench.texts().into_iter().find(|(text, _)| text == "Keys").expect("it is in the bar").1;
    let camera = bench.viewer.camera(1000, 700);
    // The lower edge of the view of the viewpoint.
    let bottom = camera.k[1][2] + camera.k[1][1] * f64::from(clip().viewpoints[0].fov_y / 2.0).tan();
    assert!(bottom > 550.0 && bottom < f64::from(bar.top()), "{bottom}, {bar}");
    assert_eq!((camera.width, camera.height), (1000, 700), "it goes on behind the bar");
    bench.press(Key::U);
    bench.frame(0.0, vec![]);
    assert_eq!(bench.viewer.camera(1000, 700).k[1][2], 350.0);
    bench.press(Key::U);
    bench.viewer.set_full_screen(&bench.ctx, true);
    bench.frame(0.0, vec![]);
    assert_eq!(bench.viewer.camera(1000, 700).k[1][2], 350.0, "the bar disappears again");
}

#[test]
fn hidden_controls_say_how_they_return() {
    let mut bench = Bench::new();
    let shows = |bench: &mut Bench, wanted: &str| bench.texts().iter().any(|(text, _)| text == wanted);
    bench.press(Key::U);
    bench.frame(0.0, vec![]);
    assert!(shows(&mut bench, "U shows the controls again") && !shows(&mut bench, "Keys"));
    bench.press(Key::U);
    bench.frame(0.0, vec![]);
    assert!(shows(&mut bench, "Keys"));
}

#[test]
fn in_full_screen_the_controls_disappear_while_the_pointer_rests() {
    let mut bench = Bench::new();
    let shows_bar = |bench: &mut Bench| bench.texts().iter().any(|(text, _)| text == "Keys");
    bench.frame(100.0, vec![]);
    assert!(shows_bar(&mut bench), "in a window they stay");
    bench.viewer.set_full_screen(&bench.ctx, true);
    bench.frame(0.1, vec![]);
    assert!(shows_bar(&mut bench), "at first they are there");
    bench.frame(5.0, vec![]);
    assert!(!shows_bar(&mut bench));
    bench.frame(0.1, vec![Event::PointerMoved(CENTER)]);
    assert!(shows_bar(&mut bench));
    bench.click("View");
    bench.frame(5.0, vec![]);
    bench.frame(5.0, vec![]);
    assert!(shows_bar(&mut bench), "a menu is open");
}

#[test]
fn full_screen_ends_by_escape_by_its_key_and_by_a_double_click() {
    let mut bench = Bench::new();
    assert!(!bench.press(Key::Escape).toggle_full_screen, "it has not begun");
    bench.viewer.set_full_screen(&bench.ctx, true);
    for key in [Key::Escape, Key::F, Key::F11] {
        assert!(bench.press(key).toggle_full_screen, "{key:?}");
    }
    bench.frame(0.1, vec![Event::PointerMoved(CENTER)]);
    let click = |bench: &mut Bench| bench.frame(0.05, vec![primary(CENTER, true), primary(CENTER, false)]);
    assert!(!click(&mut bench).toggle_full_screen);
    assert!(click(&mut bench).toggle_full_screen);
}

#[test]
fn escape_closes_the_list_before_the_message() {
    let mut bench = Bench::new();
    bench.viewer.message = Some(Message::Error("no such file".into()));
    bench.press(Key::H);
    assert!(bench.viewer.show_keys);
    bench.press(Key::Escape);
    assert!(!bench.viewer.show_keys && bench.viewer.message.is_some());
    bench.press(Key::Escape);
    assert_eq!(bench.viewer.message, None);
}

#[test]
fn a_note_disappears_and_an_error_stays() {
    let mut bench = Bench::new();
    bench.viewer.note("saved".into());
    // It waits until it is seen.
    bench.frame(10.0, vec![]);
    bench.frame(1.0, vec![]);
    assert!(bench.viewer.message.is_some());
    bench.frame(10.0, vec![]);
    assert_eq!(bench.viewer.message, None);
    bench.viewer.message = Some(Message::Error("broken".into()));
    bench.frame(100.0, vec![]);
    assert!(bench.viewer.message.is_some());
}

#[test]
fn notes_are_read_before_others_and_the_clip_take_their_place() {
    let mut bench = Bench::new();
    bench.viewer.message = Some(Message::Working("opening".into()));
    for note in ["3 rows were repaired", "no sound", "no sound"] {
        bench.viewer.note(note.into());
    }
    bench.viewer.change_clip(clip());
    bench.viewer.progress("50 %".into());
    bench.frame(1.0, vec![]);
    let texts = bench.texts();
    assert!(texts.iter().any(|(text, _)| text == "3 rows were repaired\nno sound"), "{texts:?}");
    bench.frame(10.0, vec![]);
    bench.viewer.progress("60 %".into());
    assert_eq!(bench.viewer.message, Some(Message::Working("60 %".into())));
    bench.viewer.change_clip(clip());
    assert_eq!(bench.viewer.message, None, "it is opened");
}

#[test]
fn an_error_stays_until_it_is_dismissed() {
    let mut bench = Bench::new();
    bench.viewer.note("3 rows were repaired".into());
    bench.viewer.error("b.aarc: damaged".into());
    bench.viewer.progress("50 %".into());
    bench.viewer.change_clip(clip());
    bench.viewer.note("no sound".into());
    bench.frame(100.0, vec![]);
    let all = "3 rows were repaired\nb.aarc: damaged\nno sound";
    assert_eq!(bench.viewer.message, Some(Message::Error(all.into())));
    bench.press(Key::Escape);
    bench.viewer.progress("60 %".into());
    assert_eq!(bench.viewer.message, Some(Message::Working("60 %".into())));
    bench.viewer.error("c.aarc: damaged".into());
    assert_eq!(bench.viewer.message, Some(Message::Error("c.aarc: damaged".into())));
}

#[test]
fn more_layers_of_a_clip_change_nothing_else() {
    let mut bench = Bench::new();
    bench.press(Key::Num2);
    bench.frame(0.5, vec![]);
    bench.viewer.settings.layers = Some(1);
    let (eye, position_s) = (bench.eye(), bench.viewer.clock.position_s());
    bench.viewer.update_clip(ViewedClip { layers: 4, ..clip() });
    let viewer = &bench.viewer;
    assert_eq!((viewer.clip.layers, viewer.viewpoint, viewer.settings.layers), (4, 1, Some(1)));
    assert_eq!((viewer.clock.position_s(), bench.eye()), (position_s, eye));
    bench.viewer.update_clip(ViewedClip { duration_s: 7.0, ..clip() });
    assert_eq!(bench.viewer.clock.position_s(), 0.0, "it has changed on the server");
}

#[test]
fn the_next_clip_of_a_playlist_keeps_the_settings() {
    let mut bench = Bench::new();
    bench.press(Key::Num2);
    bench.press(Key::ArrowDown);
    bench.drag(PointerButton::Primary, Modifiers::NONE, CENTER, CENTER + vec2(140.0, 0.0));
    bench.viewer.settings.layers = Some(3);
    let eye = bench.eye();
    bench.viewer.clock.seek(1.9);
    bench.viewer.clock.set_has_next(true);
    bench.frame(0.2, vec![]);
    assert!(bench.viewer.clock.overrun_s().is_some());
    bench.viewer.continue_with(ViewedClip { duration_s: 7.0, layers: 2, ..clip() });
    let viewer = &bench.viewer;
    assert!((viewer.clock.position_s() - 0.05).abs() < 1e-9 && viewer.clock.speed() == 0.75);
    assert!(viewer.viewpoint == 1 && viewer.settings.layers.is_none(), "it has two layers");
    assert_eq!(bench.eye(), eye);
    bench.viewer.continue_with(ViewedClip { viewpoints: clip().viewpoints[1..].to_vec(), ..clip() });
    assert_ne!(bench.eye(), eye, "other viewpoints");
    assert_eq!(bench.viewer.viewpoint, 0);
}

#[test]
fn another_clip_starts_at_its_first_viewpoint() {
    let mut bench = Bench::new();
    bench.press(Key::Num2);
    bench.frame(1.0, vec![]);
    bench.viewer.settings.layers = Some(1);
    let other = ViewedClip { duration_s: 7.0, viewpoints: clip().viewpoints[..1].to_vec(), ..clip() };
    bench.viewer.change_clip(other);
    let viewer = &bench.viewer;
    assert!(viewer.clock.position_s() == 0.0 && viewer.clock.duration_s() == 7.0);
    assert!(viewer.viewpoint == 0 && viewer.settings.layers.is_none());
    assert!(distance(bench.eye(), [0.0, 0.0, 5.0]) < 1e-6);
}

#[test]
fn a_clip_with_sound_goes_on_by_what_is_heard_and_has_a_volume() {
    let mut bench = Bench::new();
    bench.press(Key::M);
    bench.volume = Some(Volume::open(None));
    bench.frame(1.0, vec![]);
    assert!((bench.viewer.clock.position_s() - 0.5).abs() < 1e-9);
    let is_muted = |bench: &Bench| bench.volume.as_ref().unwrap().is_muted();
    bench.press(Key::M);
    assert!(is_muted(&bench));
    bench.press(Key::M);
    assert!(!is_muted(&bench));
}

#[test]
fn the_volume_is_set_only_where_sound_is_heard() {
    let sets_volume = |speed: f64, silence: Option<&str>| {
        let mut bench = Bench::new();
        bench.volume = Some(Volume::open(None));
        bench.viewer.silence = silence.map(String::from);
        bench.viewer.clock.set_speed(speed);
        let y = bench
            .texts()
            .into_iter()
            .find(|(text, _)| text == "Keys")
            .expect("it is in the bar")
            .1
            .center()
            .y;
        (0..100).any(|i| {
            let at = pos2(5.0 * i as f32, y);
            bench.frame(0.0, vec![Event::PointerMoved(at)]);
            bench.frame(0.0, vec![primary(at, true), primary(at, false)]);
            bench.volume.as_ref().unwrap().level() < 1.0
        })
    };
    assert!(sets_volume(1.0, None) && !sets_volume(0.5, None));
    assert!(!sets_volume(1.0, Some("there is no audio device")));
}

#[test]
fn keys_and_the_menu_choose_other_clips() {
    let mut bench = Bench::new();
    let opened = |requests: Requests| requests.open;
    assert_eq!(opened(bench.press(Key::O)), [Opening::Picker]);
    assert_eq!(opened(bench.press(Key::PageUp)), [Opening::Beside(Direction::Back)]);
    assert_eq!(opened(bench.press(Key::PageDown)), [Opening::Beside(Direction::Forward)]);
    let twice = [true, false, true, false].map(|pressed| key_event(Key::PageUp, pressed)).to_vec();
    assert_eq!(
        opened(bench.frame(0.0, twice)),
        [const { Opening::Beside(Direction::Back) }; 2],
        "in one frame"
    );
    bench.viewer.choices = Choices {
        has_previous: true,
        has_next: true,
        is_package: true,
        recent: listed(["/clips/dance.aarc", "/x/a.aarc", "/y/a.aarc"].map(String::from).to_vec()).into(),
    };
    assert_eq!(bench.click("Clips"), Requests::default());
    bench.frame(0.0, vec![]);
    assert_eq!(opened(bench.click("dance.aarc")), [Opening::Clip("/clips/dance.aarc".into())]);
    bench.frame(0.0, vec![]);
    bench.click("Clips");
    bench.frame(0.0, vec![]);
    assert_eq!(opened(bench.click("y/a.aarc")), [Opening::Clip("/y/a.aarc".into())], "x/a.aarc is another");
    for (item, expected) in [
        ("Next", Requests { open: vec![Opening::Beside(Direction::Forward)], ..Requests::default() }),
        ("Use this frame as the poster", Requests { set_poster: true, ..Requests::default() }),
    ] {
        bench.frame(0.0, vec![]);
        bench.click("Clips");
        bench.frame(0.0, vec![]);
        assert_eq!(bench.click(item), expected);
    }
    bench.press(Key::T);
    bench.click("Clips");
    bench.frame(0.0, vec![]);
    assert!(!bench.click("Use this frame as the poster").set_poster, "it would not look as the window does");
    assert!(
        bench
            .viewer
            .message
            .as_ref()
            .is_some_and(|message| format!("{message:?}").contains("open the clip again"))
    );
    bench.viewer.choices.is_package = false;
    bench.frame(0.0, vec![]);
    bench.click("Clips");
    bench.frame(0.0, vec![]);
    assert!(!bench.click("Use this frame as the poster").set_poster, "it has no file to change");
}

/// A window of `size` with the widest bar: a clip of minutes with sound, backwards, slowly, and with many viewpoints.
fn crowded(size: egui::Vec2, duration_s: f64) -> Bench {
    let mut viewpoints = clip().viewpoints;
    let first = viewpoints[0].clone();
    viewpoints.extend((2..20).map(|i| Viewpoint { name: format!("camera {i}"), ..first.clone() }));
    let mut bench = Bench::with(ViewedClip { duration_s, viewpoints, ..clip() });
    bench.size = size;
    bench.volume = Some(Volume::open(None));
    bench.viewer.clock.set_speed(0.25);
    bench.viewer.clock.set_reversed(true);
    let names = (0..8).map(|i| format!("/clips/clip-{i}.aarc")).collect();
    bench.viewer.choices =
        Choices { has_previous: true, has_next: true, is_package: true, recent: listed(names).into() };
    (0..3).for_each(|_| drop(bench.frame(0.0, vec![])));
    bench
}

const LEAST_SIZE: egui::Vec2 = vec2(800.0, 400.0);

#[test]
fn nothing_in_the_bar_overlaps_or_is_cut_off() {
    for (size, duration_s, time) in [
        (LEAST_SIZE, 3.0, " 0.00 / 3.00 s"),
        (LEAST_SIZE, 690.0, " 0:00.00 / 11:30.00"),
        (LEAST_SIZE, 6000.0, "  0:00.00"),
        (vec2(1280.0, 800.0), 6000.0, "  0:00.00 / 100:00.00"),
    ] {
        let texts = crowded(size, duration_s).texts();
        for text in [time, "-0.25x", "Loop", "Clips", "View", "Rendering", "Snapshot", "Keys"] {
            assert!(texts.iter().any(|(there, _)| there == text), "{text} of {size}: {texts:?}");
        }
        check_overlaps(&texts);
    }
}

fn check_overlaps(texts: &[(String, Rect)]) {
    for (i, (text, rect)) in texts.iter().enumerate() {
        let other = texts[..i].iter().find(|(_, other)| other.intersects(*rect));
        assert!(other.is_none(), "{text} and {other:?}");
    }
}

#[test]
fn menus_fit_the_window_and_their_lists_scroll() {
    for (size, clips, cameras) in [(LEAST_SIZE, 3, 4), (vec2(1280.0, 800.0), 8, 15)] {
        let opened = |menu: &str| {
            let mut bench = crowded(size, 3.0);
            bench.click(menu);
            (0..3).for_each(|_| drop(bench.frame(0.0, vec![])));
            let texts = bench.texts();
            check_overlaps(&texts);
            texts
        };
        let count = |texts: &[(String, Rect)], start: &str| {
            texts.iter().filter(|(text, _)| text.starts_with(start)).count()
        };
        let texts = opened("Clips");
        assert_eq!(count(&texts, "Open a file"), 1, "{texts:?}");
        assert!(count(&texts, "clip-") >= clips, "{size}: {texts:?}");
        let texts = opened("View");
        for entry in ["front", "Recentre", "Hide controls"] {
            assert_eq!(count(&texts, entry), 1, "{entry} of {size}: {texts:?}");
        }
        assert!(count(&texts, "camera ") >= cameras, "{size}: {texts:?}");
        assert!(count(&opened("-0.25x"), "Backwards") == 1 && count(&opened("Rendering"), "Sort by") == 1);
    }
}
