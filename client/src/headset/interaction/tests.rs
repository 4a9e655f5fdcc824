//! Hands fed to [`Interaction`], frame by frame.

use codec::Viewpoint;
use glam::{DVec3, Quat, Vec2, Vec3, dvec3, vec2, vec3};

use super::random::Random;
use super::*;

const HEAD: Pose = Pose { position: Vec3::new(0.0, 1.6, 0.0), orientation: Quat::IDENTITY };
const FRAME_S: f64 = 0.1;

/// An interaction with a clock, and the hands of the next frame.
struct Bench {
    interaction: Interaction,
    clock: Clock,
    hands: Hands,
    focused: bool,
    on_panel: [bool; 2],
    haptics: Haptics,
}

impl Bench {
    fn new() -> Bench {
        let hand = |x| {
            let pose = Pose { position: vec3(x, 1.2, -0.3), orientation: Quat::IDENTITY };
            Hand { tracked: true, aim: pose, grip: pose, ..Hand::default() }
        };
        let (subject, mut interaction) = (subject(), Interaction::default());
        interaction.put(subject, Placement::start(&subject, &HEAD));
        let mut bench = Bench {
            interaction,
            clock: Clock::new(10.0, 30.0),
            hands: Hands { left: hand(-0.2), right: hand(0.2) },
            focused: true,
            on_panel: [false; 2],
            haptics: Haptics::default(),
        };
        assert_eq!(bench.frame(), []);
        bench
    }

    fn placement(&self) -> &Placement {
        self.interaction.placement().unwrap()
    }

    /// Runs a frame, and the commands for the clock.
    fn frame(&mut self) -> Vec<Command> {
        let mut commands = Vec::new();
        self.haptics = Haptics::default();
        self.interaction.take(&self.hands, self.focused, FRAME_S);
        self.interaction.update(&HEAD, self.on_panel, &self.clock, &mut commands, &mut self.haptics);
        for command in &commands {
            command.play(&mut self.clock);
        }
        commands
    }

    /// Changes the hands, and runs a frame.
    fn with(&mut self, change: impl FnOnce(&mut Hands)) -> Vec<Command> {
        change(&mut self.hands);
        self.frame()
    }
}

fn subject() -> Subject {
    let demo = include_bytes!("../../../../assets/demo.aarc");
    let mut clip = codec::decode(demo, &Default::default()).unwrap();
    clip.info.viewpoints = vec![Viewpoint {
        name: "front".into(),
        position: [0.0, 1.0, 4.0],
        target: [0.0, 1.0, 0.0],
        fov_y: 0.9,
    }];
    Subject::from_clip(&clip)
}

#[test]
fn buttons_append_their_commands() {
    let mut bench = Bench::new();
    assert_eq!(bench.with(|hands| hands.right.primary = true), [Command::TogglePlaying]);
    assert!(!bench.clock.is_playing());
    assert_eq!(bench.frame(), []);
    assert_eq!(bench.with(|hands| hands.right.primary = false), []);
    for (press, release, command) in [
        (
            (|hands: &mut Hands| hands.right.secondary = true) as fn(&mut Hands),
            (|hands: &mut Hands| hands.right.secondary = false) as fn(&mut Hands),
            Command::TogglePanel,
        ),
        (|hands| hands.left.menu = true, |hands| hands.left.menu = false, Command::TogglePanel),
        (|hands| hands.left.primary = true, |hands| hands.left.primary = false, Command::NextClip),
        (|hands| hands.left.secondary = true, |hands| hands.left.secondary = false, Command::Recentre),
    ] {
        assert_eq!(bench.with(press), []);
        assert_eq!(bench.with(release), [command]);
    }
}

#[test]
fn a_long_press_has_only_its_own_effect() {
    let mut bench = Bench::new();
    let mut commands = bench.with(|hands| hands.left.menu = true);
    for _ in 0..20 {
        commands.extend(bench.frame());
    }
    commands.extend(bench.with(|hands| hands.left.menu = false));
    assert_eq!(commands, [Command::Exit]);
}

#[test]
fn the_left_stick_steps_then_scrubs() {
    let mut bench = Bench::new();
    bench.clock.seek(1.0);
    assert_eq!(bench.with(|hands| hands.left.stick = Vec2::X), [Command::StepForward]);
    assert!(bench.clock.frame() == 31 && !bench.interaction.is_scrubbing());
    for _ in 0..14 {
        bench.frame();
    }
    // Ten of these frames scrub, at a fifth of the clip per second.
    let position_s = bench.clock.position_s();
    assert!(
        bench.interaction.is_scrubbing() && (position_s - 31.0 / 30.0 - 2.2).abs() < 0.25,
        "{position_s}"
    );
    bench.with(|hands| hands.left.stick = vec2(-0.5, 0.0));
    assert!(bench.clock.position_s() < position_s, "back over the middle without letting go");
    assert_eq!(bench.with(|hands| hands.left.stick = Vec2::ZERO), []);
    assert!(!bench.interaction.is_scrubbing());
    assert_eq!(bench.with(|hands| hands.left.stick = Vec2::Y), [Command::Faster]);
    assert_eq!(bench.clock.speed(), 1.25);
}

#[test]
fn the_right_stick_turns_by_steps_with_a_pulse() {
    let mut bench = Bench::new();
    let before = *bench.placement();
    assert_eq!(bench.with(|hands| hands.right.stick = Vec2::X), []);
    let turned = before.turned_about(HEAD.position.as_dvec3(), 30f64.to_radians());
    assert!(bench.placement().position().distance(turned.position()) < 1e-9);
    assert_eq!(bench.haptics.on(Side::Right), Some(Pulse::SNAP));
    let once = *bench.placement();
    bench.frame();
    assert_eq!(*bench.placement(), once);
    bench.with(|hands| hands.right.stick = Vec2::ZERO);
    assert_eq!(bench.with(|hands| hands.right.stick = Vec2::NEG_Y), [Command::Coarser]);
    assert_eq!(*bench.placement(), once, "neither up nor down");
    bench.with(|hands| hands.right.stick = Vec2::ZERO);
    bench.with(|hands| hands.right.stick = Vec2::NEG_X);
    assert!(bench.placement().position().distance(before.position()) < 1e-9, "and back");
}

#[test]
fn grips_carry_the_clip_and_so_does_a_trigger_off_the_panel() {
    for (select, on_panel, carried) in
        [(false, false, true), (true, false, true), (false, true, true), (true, true, false)]
    {
        let mut bench = Bench::new();
        bench.on_panel = [on_panel; 2];
        let before = bench.placement().position();
        bench.with(|hands| if select { hands.right.select = true } else { hands.right.squeeze = true });
        // Crossing the panel meanwhile changes nothing.
        bench.on_panel = [!on_panel; 2];
        bench.with(|hands| hands.right.grip.position.y += 0.5);
        let moved = bench.placement().position() - before;
        let expected = if carried { dvec3(0.0, 0.5, 0.0) } else { DVec3::ZERO };
        assert!(moved.distance(expected) < 1e-6, "select {select}, on panel {on_panel}: {moved}");
        assert_eq!(bench.interaction.is_holding(), carried);
    }
}

#[test]
fn after_a_loss_of_focus_or_tracking_buttons_need_a_release() {
    let mut bench = Bench::new();
    let away: [fn(&mut Bench, bool); 2] =
        [|bench, gone| bench.focused = !gone, |bench, gone| bench.hands.right.tracked = !gone];
    for away in away {
        bench.with(|hands| hands.right.squeeze = true);
        assert!(bench.interaction.is_holding());
        away(&mut bench, true);
        bench.with(|hands| (hands.right.primary, hands.right.stick) = (true, Vec2::X));
        assert!(!bench.interaction.is_holding());
        let before = *bench.placement();
        away(&mut bench, false);
        let commands = bench.with(|hands| hands.right.grip.position += Vec3::ONE);
        assert!(commands.is_empty() && *bench.placement() == before, "{commands:?}");
        bench.with(|hands| {
            let Hand { aim, grip, .. } = hands.right;
            hands.right = Hand { tracked: true, aim, grip, ..Hand::default() };
        });
        assert_eq!(bench.with(|hands| hands.right.primary = true), [Command::TogglePlaying]);
        bench.with(|hands| hands.right.primary = false);
    }
}

#[test]
fn without_a_clip_buttons_work_and_hands_hold_nothing() {
    let mut bench = Bench::new();
    let subject = subject();
    bench.interaction.take_away();
    bench.with(|hands| hands.left.primary = true);
    assert_eq!(bench.with(|hands| hands.left.primary = false), [Command::NextClip]);
    bench.with(|hands| (hands.right.squeeze, hands.right.stick) = (true, Vec2::X));
    bench.interaction.recentre(&HEAD, None);
    assert!(!bench.interaction.is_holding() && bench.haptics == Haptics::default());
    assert!(bench.interaction.placement().is_none() && bench.interaction.stage_from_clip().is_none());
    // A hand that was closed before the clip came holds it from its initial place.
    bench.interaction.put(subject, Placement::start(&subject, &HEAD));
    let before = *bench.placement();
    bench.frame();
    assert!(*bench.placement() == before && bench.interaction.is_holding());
}

#[test]
fn recentre_brings_the_clip_back() {
    let mut bench = Bench::new();
    let start = *bench.placement();
    bench.with(|hands| hands.right.squeeze = true);
    bench.with(|hands| hands.right.grip.position += vec3(1.0, 2.0, 3.0));
    assert_ne!(*bench.placement(), start);
    bench.interaction.recentre(&HEAD, None);
    assert_eq!(*bench.placement(), start);
    bench.frame();
    assert_eq!(*bench.placement(), start, "the hand holds it from where it is now");
}

#[test]
fn no_report_of_hands_displaces_the_clip_to_nowhere() {
    let mut bench = Bench::new();
    let mut random = Random::new(40);
    for frame in 0..3000 {
        for side in Side::BOTH {
            let mut pose = random.pose();
            match frame % 7 {
                3 => pose.position.x = f32::NAN,
                4 => pose.orientation = Quat::from_xyzw(0.0, 0.0, 0.0, 0.0),
                5 => pose.position *= 1e30,
                _ => {}
            }
            let mut flag = || random.signed() > 0.0;
            let mut hand = Hand {
                tracked: flag() || flag(),
                aim: pose,
                grip: pose,
                select: flag(),
                squeeze: flag(),
                primary: flag(),
                secondary: flag(),
                menu: flag(),
                stick: Vec2::ZERO,
            };
            hand.stick = vec2(random.signed() as f32, random.signed() as f32) * 1.2;
            match side {
                Side::Left => bench.hands.left = hand,
                Side::Right => bench.hands.right = hand,
            }
        }
        bench.focused = frame % 50 != 0;
        for command in bench.frame() {
            if let Command::Seek(position_s) = command {
                assert!(position_s.is_finite());
            }
        }
        let matrix = bench.interaction.stage_from_clip().unwrap().matrix();
        assert!(matrix.is_finite() && matrix.determinant() > 0.0, "frame {frame}: {matrix}");
    }
}
