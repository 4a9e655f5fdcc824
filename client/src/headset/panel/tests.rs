//! Hands that point at the panel, frame by frame.

use egui::epaint::text::{FallbackRequest, FontProvider};
use egui::pos2;
use glam::{Quat, Vec3, vec3};

use super::widgets::id;
use super::*;
use crate::clock::Clock;
use crate::headset::interaction::{Hand, Hands, Pulse, Side};

const HEAD: Pose = Pose { position: Vec3::new(0.0, 1.6, 0.0), orientation: Quat::IDENTITY };
const FRAME_S: f64 = 0.02;

/// A panel, its clock, and the hands that point at it.
struct Bench {
    panel: Panel,
    clock: Clock,
    is_static: bool,
    inputs: Inputs,
    hands: Hands,
    notice: Option<Notice<'static>>,
    buffered: Vec<(f64, f64)>,
    commands: Vec<Command>,
    haptics: Haptics,
    on_panel: [bool; 2],
    painted: bool,
}

impl Bench {
    fn new() -> Bench {
        let mut bench = Bench {
            panel: Panel::new(&HEAD),
            clock: Clock::new(10.0, 30.0),
            is_static: false,
            inputs: Inputs::default(),
            hands: Hands::default(),
            notice: None,
            buffered: Vec::new(),
            commands: Vec::new(),
            haptics: Haptics::default(),
            on_panel: [false; 2],
            painted: false,
        };
        bench.hands.left.tracked = true;
        bench.hands.right.tracked = true;
        for side in Side::BOTH {
            bench.aim_away(side);
        }
        // The first frame lays the controls out.
        bench.frame();
        bench
    }

    fn hand(&mut self, side: Side) -> &mut Hand {
        match side {
            Side::Left => &mut self.hands.left,
            Side::Right => &mut self.hands.right,
        }
    }

    /// Runs a frame, carries its commands out and records them.
    fn frame(&mut self) {
        self.commands.clear();
        self.haptics = Haptics::default();
        self.inputs.update(&self.hands, true, FRAME_S);
        self.on_panel = self.panel.point(&self.inputs, &mut self.haptics);
        let state = PanelState {
            title: "juggler",
            clock: &self.clock,
            is_static: self.is_static,
            qualities: &["Auto", "High", "Low"],
            quality: 1,
            lowered: false,
            passthrough: Some(false),
            volume: Some((1.0, false)),
            has_next: true,
            buffered: &self.buffered,
            statistics: &[("Gaussians", "40000".into()), ("GPU", "5.1 ms".into())],
            notice: self.notice,
        };
        self.painted = self.panel.frame(&state, FRAME_S, &mut self.commands).is_some();
        for command in &self.commands {
            command.play(&mut self.clock);
            self.panel.apply(*command, &HEAD);
        }
    }

    /// Points a hand at a position on the panel, in points.
    fn aim(&mut self, side: Side, at: Pos2) {
        let position = vec3([-0.25, 0.25][side as usize], 1.1, -0.2);
        let direction = (self.panel.quad().stage_point(at) - position).normalize();
        let orientation = Quat::from_rotation_arc(Vec3::NEG_Z, direction);
        self.hand(side).aim = Pose { position, orientation };
    }

    fn aim_away(&mut self, side: Side) {
        self.hand(side).aim = Pose { position: Vec3::Y, orientation: Quat::from_rotation_x(1.5) };
    }

    /// Center of the control `name`.
    fn place(&self, name: &str) -> Pos2 {
        self.panel.ctx.read_response(id(name)).unwrap_or_else(|| panic!("{name} is not there")).rect.center()
    }

    fn select(&mut self, side: Side, down: bool) -> &[Command] {
        self.hand(side).select = down;
        self.frame();
        &self.commands
    }

    /// Points at the control `name` and clicks; returns the commands.
    fn press(&mut self, side: Side, name: &str) -> Vec<Command> {
        let at = self.place(name);
        self.aim(side, at);
        self.frame();
        assert_eq!(self.select(side, true), [], "{name} acts when it is let go");
        self.select(side, false).to_vec()
    }
}

#[test]
fn a_static_clip_has_no_timeline_and_the_panel_rests() {
    let mut bench = Bench { is_static: true, ..Bench::new() };
    for _ in 0..5 {
        bench.frame();
    }
    let at = bench.place("Timeline");
    for _ in 0..10 {
        bench.clock.advance(0.1);
        bench.frame();
        assert!(!bench.painted, "time changes nothing");
    }
    bench.aim(Side::Right, at);
    bench.frame();
    assert_eq!(bench.select(Side::Right, true), []);
    bench.is_static = false;
    bench.select(Side::Right, false);
    assert!(matches!(bench.select(Side::Right, true), [Command::Seek(_)]));
}

#[test]
fn either_hand_presses_the_buttons() {
    for side in Side::BOTH {
        let mut bench = Bench::new();
        assert_eq!(bench.press(side, "Play"), [Command::TogglePlaying]);
        assert!(!bench.clock.is_playing() && bench.on_panel[side as usize]);
        for (name, command) in [
            ("Frame back", Command::StepBack),
            ("Frame on", Command::StepForward),
            ("Slower", Command::Slower),
            ("Faster", Command::Faster),
            ("Speed", Command::NormalSpeed),
            ("Reverse", Command::ToggleReverse),
            ("Loop", Command::ToggleLoop),
            ("Next clip", Command::NextClip),
            ("Sound", Command::ToggleMuted),
            ("Better", Command::Better),
            ("Coarser", Command::Coarser),
            ("Room", Command::TogglePassthrough),
            ("Recentre", Command::Recentre),
        ] {
            assert_eq!(bench.press(side, name), [command], "{name}");
        }
    }
}

#[test]
fn a_press_gives_a_pulse() {
    let mut bench = Bench::new();
    let at = bench.place("Play");
    bench.aim(Side::Left, at);
    bench.select(Side::Left, true);
    assert_eq!(Side::BOTH.map(|side| bench.haptics.on(side)), [Some(Pulse::PRESS), None]);
    bench.select(Side::Left, false);
    assert_eq!(bench.haptics, Haptics::default());
}

#[test]
fn the_timeline_seeks_and_holds_even_beyond_the_panel() {
    let mut bench = Bench::new();
    let at = bench.place("Timeline");
    bench.aim(Side::Right, pos2(410.0, at.y));
    bench.select(Side::Right, true);
    bench.frame();
    assert!(bench.panel.is_scrubbing() && (bench.clock.position_s() - 5.0).abs() < 0.1);
    bench.aim(Side::Right, pos2(600.0, at.y - 900.0));
    bench.frame();
    let position_s = bench.clock.position_s();
    assert!((position_s - 7.6).abs() < 0.1 && bench.on_panel == [false, true], "{position_s}");
    bench.aim(Side::Right, pos2(9000.0, at.y));
    bench.frame();
    assert_eq!(bench.clock.position_s(), 10.0);
    // Past the plane: the handle stays.
    bench.aim_away(Side::Right);
    bench.frame();
    assert!(bench.panel.is_scrubbing() && bench.clock.position_s() == 10.0);
    bench.select(Side::Right, false);
    assert!(!bench.panel.is_scrubbing() && bench.on_panel == [false, false]);
}

#[test]
fn a_click_may_drift_and_is_cancelled_off_the_button() {
    let mut bench = Bench::new();
    let at = bench.place("Play");
    bench.aim(Side::Right, at);
    bench.select(Side::Right, true);
    bench.aim(Side::Right, at + egui::vec2(30.0, 20.0));
    bench.frame();
    assert_eq!(bench.select(Side::Right, false), [Command::TogglePlaying], "a trigger moves the ray");
    bench.aim(Side::Right, at);
    bench.select(Side::Right, true);
    bench.aim(Side::Right, at - egui::vec2(0.0, 300.0));
    bench.frame();
    assert_eq!(bench.select(Side::Right, false), []);
}

#[test]
fn losing_the_hand_cancels_a_press() {
    for name in ["Play", "Exit"] {
        let mut bench = Bench::new();
        let at = bench.place(name);
        bench.aim(Side::Right, at);
        bench.frame();
        bench.select(Side::Right, true);
        bench.hands.right.tracked = false;
        bench.frame();
        assert_eq!(bench.commands, []);
        bench.hands.right.tracked = true;
        assert_eq!(bench.select(Side::Right, false), []);
        assert_eq!(bench.panel.leaving_until_s, None);
    }
}

#[test]
fn the_other_hand_takes_over_as_it_presses() {
    let mut bench = Bench::new();
    let (play, repeat) = (bench.place("Play"), bench.place("Loop"));
    bench.aim(Side::Left, play);
    bench.frame();
    bench.aim(Side::Right, repeat);
    bench.frame();
    assert_eq!(bench.panel.pointer.at().unwrap().0.round(), play.round(), "the first one keeps it");
    bench.select(Side::Right, true);
    assert_eq!(bench.panel.pointer.at().unwrap().0.round(), repeat.round());
    // While it presses, the first one has no effect.
    bench.select(Side::Left, true);
    bench.select(Side::Left, false);
    assert_eq!(bench.commands, []);
    assert_eq!(bench.select(Side::Right, false), [Command::ToggleLoop]);
}

#[test]
fn the_nearer_of_two_hands_owns_the_pointer() {
    let mut bench = Bench::new();
    let (play, repeat) = (bench.place("Play"), bench.place("Loop"));
    bench.aim(Side::Left, play);
    bench.aim(Side::Right, repeat);
    let forward = bench.hands.right.aim.forward();
    bench.hands.right.aim.position += 0.4 * forward;
    bench.frame();
    assert_eq!(bench.panel.pointer.at().unwrap().0.round(), repeat.round());
}

#[test]
fn the_pointer_stays_a_little_beyond_the_edge() {
    let mut bench = Bench::new();
    let edge = |x: f32| pos2(x, 600.0);
    for (x, there) in [(-10.0, false), (10.0, true), (-10.0, true), (-40.0, false), (-10.0, false)] {
        bench.aim(Side::Right, edge(x));
        bench.frame();
        assert_eq!(bench.panel.pointer.at().is_some(), there, "{x}");
    }
}

#[test]
fn empty_areas_are_not_part_of_the_panel() {
    let mut bench = Bench::new();
    let above = pos2(410.0, 300.0);
    bench.aim(Side::Right, above);
    bench.frame();
    assert_eq!(bench.on_panel, [false; 2]);
    assert_eq!(bench.press(Side::Right, "Buttons"), [Command::ToggleButtons]);
    bench.frame();
    bench.aim(Side::Right, above);
    bench.frame();
    assert_eq!(bench.on_panel, [false, true]);
}

#[test]
fn rays_end_on_the_panel_and_hide_with_it() {
    let mut bench = Bench::new();
    let at = bench.place("Play");
    bench.aim(Side::Left, at);
    bench.frame();
    let lengths =
        |bench: &Bench| bench.panel.rays(&bench.inputs, &HEAD).map(|ray| ray.map(|ray| ray.size_m().y));
    let [Some(left), Some(right)] = lengths(&bench) else { panic!("both hands have a ray") };
    let distance = bench.hands.left.aim.position.distance(bench.panel.quad().stage_point(at));
    assert!((left - distance).abs() < 0.06 && right < left, "{left} of {distance}, and {right}");
    bench.hands.right.tracked = false;
    bench.frame();
    assert!(matches!(lengths(&bench), [Some(_), None]), "a hand that is not there has none");
    bench.panel.apply(Command::TogglePanel, &HEAD);
    assert_eq!(lengths(&bench), [None, None]);
}

#[test]
fn names_in_other_scripts_have_the_fonts_of_the_system() {
    let mut bench = Bench::new();
    let font = style::font(20.0);
    let has = |bench: &Bench, c| bench.panel.ctx.fonts_mut(|fonts| fonts.has_glyph(&font, c));
    let system = egui_system_font_provider::SystemFontProvider::new();
    // Which of them it has depends on the machine; DejaVu has the first.
    for name in ["ა", "雨", "한"] {
        let request = FallbackRequest { cluster: name, family: &font.family };
        let expected = system.font_for(&request).is_some();
        let c = name.chars().next().unwrap();
        assert_eq!(has(&bench, c), expected, "{name}");
        bench.panel.forget_picture();
        bench.frame();
        assert_eq!(has(&bench, c), expected, "{name}, in another session");
    }
}

#[test]
fn exit_needs_a_second_press() {
    let mut bench = Bench::new();
    assert_eq!(bench.press(Side::Right, "Exit"), []);
    assert_eq!(bench.press(Side::Right, "Exit"), [Command::Exit]);
    assert_eq!(bench.press(Side::Right, "Exit"), []);
    for _ in 0..(LEAVING_S / FRAME_S) as usize + 2 {
        bench.frame();
    }
    assert_eq!(bench.press(Side::Right, "Exit"), [], "asks anew after a while");
}

#[test]
fn a_notice_can_be_closed_but_progress_cannot() {
    let mut bench = Bench::new();
    bench.notice = Some(Notice::Error("https://example.org/a.aarc: 404 Not Found: check the address"));
    bench.frame();
    assert_eq!(bench.press(Side::Left, "Close"), [Command::Dismiss]);
    bench.notice = Some(Notice::Working { text: "Loading", part: Some(f32::NAN) });
    bench.frame();
    bench.frame();
    assert!(bench.panel.ctx.read_response(id("Close")).is_none() && bench.painted);
}

#[test]
fn a_hidden_panel_takes_no_pointing_and_returns_in_front_of_the_viewer() {
    let mut bench = Bench::new();
    let at = bench.place("Timeline");
    bench.aim(Side::Right, at);
    bench.select(Side::Right, true);
    assert!(bench.panel.apply(Command::TogglePanel, &HEAD) && !bench.panel.is_visible());
    bench.frame();
    assert!(!bench.painted && bench.on_panel == [false; 2] && !bench.panel.is_scrubbing());
    bench.select(Side::Right, false);
    let elsewhere = Pose { position: vec3(2.0, 1.2, 1.0), orientation: Quat::from_rotation_y(2.0) };
    bench.panel.apply(Command::TogglePanel, &elsewhere);
    assert_eq!(*bench.panel.quad(), PanelQuad::before(&elsewhere));
    bench.frame();
    assert!(bench.painted && bench.commands.is_empty());
    assert!(!bench.panel.apply(Command::Recentre, &HEAD), "the clip recentres too");
    assert_eq!(*bench.panel.quad(), PanelQuad::before(&HEAD));
}

#[test]
fn the_panel_is_painted_only_after_a_change() {
    let mut bench = Bench::new();
    bench.clock.toggle_playing();
    for _ in 0..5 {
        bench.frame();
    }
    assert!(!bench.painted, "nothing moves");
    bench.clock.seek(3.0);
    bench.frame();
    assert!(bench.painted);
    bench.frame();
    bench.frame();
    assert!(!bench.painted);
    bench.buffered.push((0.0, 2.0));
    bench.frame();
    assert!(bench.painted, "more is buffered");
    bench.frame();
    let at = bench.place("Play");
    bench.aim(Side::Right, at);
    bench.frame();
    assert!(bench.painted, "the pointer moves");
    bench.notice = Some(Notice::Note("Recentred"));
    for _ in 0..3 {
        bench.frame();
    }
    assert!(!bench.painted);
}

#[test]
fn another_session_paints_all_of_a_panel_that_stays_as_it_was() {
    let mut bench = Bench::new();
    let at = bench.place("Timeline");
    bench.aim(Side::Right, at);
    bench.select(Side::Right, true);
    bench.panel.apply(Command::ToggleStatistics, &HEAD);
    bench.panel.forget_picture();
    assert!(bench.panel.is_visible() && !bench.panel.is_scrubbing());
    bench.aim_away(Side::Right);
    bench.frame();
    assert!(bench.painted && bench.panel.page == Some(Page::Statistics));
    assert!(bench.commands.is_empty(), "the press was in the session before");
    bench.panel.apply(Command::TogglePanel, &HEAD);
    bench.panel.forget_picture();
    bench.frame();
    assert!(!bench.painted && !bench.panel.is_visible());
}

#[test]
fn a_step_of_a_fast_clip_is_painted() {
    let mut bench = Bench::new();
    bench.clock = Clock::new(10.0, 120.0);
    bench.clock.set_playing(false);
    for step in 0..8 {
        for _ in 0..4 {
            bench.frame();
        }
        assert!(!bench.painted);
        bench.clock.step_forward();
        bench.frame();
        assert!(bench.painted, "frame {step}");
    }
}

#[test]
fn a_still_picture_has_no_timeline_to_hold() {
    let mut bench = Bench::new();
    bench.clock = Clock::new(0.0, 30.0);
    bench.frame();
    bench.frame();
    let at = bench.place("Timeline");
    bench.aim(Side::Right, at);
    bench.frame();
    bench.select(Side::Right, true);
    bench.frame();
    assert!(!bench.panel.is_scrubbing() && bench.commands.is_empty());
    assert_eq!(bench.press(Side::Left, "Play"), []);
}
