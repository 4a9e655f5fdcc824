//! [`Input`]: the actions of the program, their bindings to controllers, and the [`Hands`] read from them.

use glam::Vec2;
use openxr as xr;

use super::eye;
use crate::headset::interaction::{Hand, Hands, Haptics, Side};
use crate::xr::runtime::error::{During, Halt};

/// An action of a hand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ActionName {
    Aim,
    Grip,
    Select,
    Squeeze,
    Stick,
    Primary,
    Secondary,
    Menu,
    Haptic,
}

/// A kind of controller, and the bindings of its parts.
struct Profile {
    path: &'static str,
    /// Whether the runtime supports it.
    is_supported: fn(&xr::ExtensionSet) -> bool,
    /// Parts of both hands.
    both: &'static [(ActionName, &'static str)],
    /// Parts of a single hand, `left` or `right`.
    single: &'static [(ActionName, &'static str, &'static str)],
}

const TOUCH_BOTH: &[(ActionName, &str)] = &[
    (ActionName::Aim, "input/aim/pose"),
    (ActionName::Grip, "input/grip/pose"),
    (ActionName::Select, "input/trigger/value"),
    (ActionName::Squeeze, "input/squeeze/value"),
    (ActionName::Stick, "input/thumbstick"),
    (ActionName::Haptic, "output/haptic"),
];

const TOUCH_SINGLE: &[(ActionName, &str, &str)] = &[
    (ActionName::Primary, "left", "input/x/click"),
    (ActionName::Secondary, "left", "input/y/click"),
    (ActionName::Menu, "left", "input/menu/click"),
    (ActionName::Primary, "right", "input/a/click"),
    (ActionName::Secondary, "right", "input/b/click"),
];

const PROFILES: [Profile; 4] = [
    Profile {
        path: "/interaction_profiles/khr/simple_controller",
        is_supported: |_| true,
        both: &[
            (ActionName::Aim, "input/aim/pose"),
            (ActionName::Grip, "input/grip/pose"),
            (ActionName::Select, "input/select/click"),
            (ActionName::Menu, "input/menu/click"),
            (ActionName::Haptic, "output/haptic"),
        ],
        single: &[],
    },
    Profile {
        path: "/interaction_profiles/oculus/touch_controller",
        is_supported: |_| true,
        both: TOUCH_BOTH,
        single: TOUCH_SINGLE,
    },
    Profile {
        path: "/interaction_profiles/meta/touch_controller_plus",
        is_supported: |extensions| extensions.meta_touch_controller_plus,
        both: TOUCH_BOTH,
        single: TOUCH_SINGLE,
    },
    // Bare hands: a pinch selects, a fist holds.
    Profile {
        path: "/interaction_profiles/ext/hand_interaction_ext",
        is_supported: |extensions| extensions.ext_hand_interaction,
        both: &[
            (ActionName::Aim, "input/aim/pose"),
            (ActionName::Grip, "input/grip/pose"),
            (ActionName::Select, "input/pinch_ext/value"),
            (ActionName::Squeeze, "input/grasp_ext/value"),
        ],
        single: &[],
    },
];

impl Profile {
    /// Every part with its full path.
    fn parts(&self) -> impl Iterator<Item = (ActionName, String)> {
        let both =
            self.both.iter().flat_map(|&(action, part)| ["left", "right"].map(|hand| (action, hand, part)));
        both.chain(self.single.iter().copied())
            .map(|(action, hand, part)| (action, format!("/user/hand/{hand}/{part}")))
    }
}

/// The actions, attached to a session.
pub(in crate::xr) struct Input {
    hands: [HandSpaces; 2],
    actions: Actions,
}

struct Actions {
    set: xr::ActionSet,
    aim: xr::Action<xr::Posef>,
    grip: xr::Action<xr::Posef>,
    select: xr::Action<bool>,
    squeeze: xr::Action<bool>,
    stick: xr::Action<xr::Vector2f>,
    primary: xr::Action<bool>,
    secondary: xr::Action<bool>,
    menu: xr::Action<bool>,
    haptic: xr::Action<xr::Haptic>,
}

struct HandSpaces {
    path: xr::Path,
    aim: xr::Space,
    grip: xr::Space,
}

impl Input {
    /// Creates the actions, suggests bindings, and attaches them to the session.
    ///
    /// # Errors
    /// See [`Halt`].
    pub(in crate::xr) fn attach(
        session: &xr::Session<xr::Vulkan>,
        extensions: &xr::ExtensionSet,
    ) -> Result<Input, Halt> {
        let instance = session.instance();
        let path = |text: &str| instance.string_to_path(text).halt("naming an input");
        let hands = [path(xr::USER_HAND_LEFT)?, path(xr::USER_HAND_RIGHT)?];
        let actions = Actions::new(instance, &hands)?;
        for profile in PROFILES.iter().filter(|profile| (profile.is_supported)(extensions)) {
            let parts: Vec<_> = profile
                .parts()
                .map(|(action, part)| Ok((action, path(&part)?)))
                .collect::<Result<_, Halt>>()?;
            let bindings: Vec<_> = parts.iter().map(|&(action, part)| actions.bind(action, part)).collect();
            let suggested = instance.suggest_interaction_profile_bindings(path(profile.path)?, &bindings);
            if let Err(code) = suggested {
                log::warn!("the runtime refuses {}: {code:?}", profile.path);
            }
        }
        session.attach_action_sets(&[&actions.set]).halt("attaching inputs")?;
        let spaces = |path| -> Result<HandSpaces, Halt> {
            let space = |action: &xr::Action<xr::Posef>| {
                action.create_space(session, path, xr::Posef::IDENTITY).halt("following a hand")
            };
            Ok(HandSpaces { path, aim: space(&actions.aim)?, grip: space(&actions.grip)? })
        };
        Ok(Input { hands: [spaces(hands[0])?, spaces(hands[1])?], actions })
    }

    /// State of both hands, with poses at display time `time`.
    ///
    /// # Errors
    /// See [`Halt`].
    pub(in crate::xr) fn hands(
        &self,
        session: &xr::Session<xr::Vulkan>,
        stage: &xr::Space,
        time: xr::Time,
    ) -> Result<Hands, Halt> {
        session.sync_actions(&[xr::ActiveActionSet::new(&self.actions.set)]).halt("reading inputs")?;
        let hand = |side: Side| self.hand(session, &self.hands[side as usize], stage, time);
        Ok(Hands { left: hand(Side::Left)?, right: hand(Side::Right)? })
    }

    fn hand(
        &self,
        session: &xr::Session<xr::Vulkan>,
        hand: &HandSpaces,
        stage: &xr::Space,
        time: xr::Time,
    ) -> Result<Hand, Halt> {
        let actions = &self.actions;
        let (aim, grip) = (hand.aim.locate(stage, time), hand.grip.locate(stage, time));
        let (aim, grip) = (aim.halt("following a hand")?, grip.halt("following a hand")?);
        let needed = xr::SpaceLocationFlags::POSITION_VALID | xr::SpaceLocationFlags::ORIENTATION_VALID;
        let known = |location: &xr::SpaceLocation| location.location_flags.contains(needed);
        let down = |action: &xr::Action<bool>| -> Result<bool, Halt> {
            let state = action.state(session, hand.path).halt("reading inputs")?;
            Ok(state.is_active && state.current_state)
        };
        let stick = actions.stick.state(session, hand.path).halt("reading inputs")?;
        let at = stick.current_state;
        Ok(Hand {
            tracked: known(&aim) && known(&grip),
            aim: eye::pose(aim.pose),
            grip: eye::pose(grip.pose),
            select: down(&actions.select)?,
            squeeze: down(&actions.squeeze)?,
            stick: if stick.is_active { Vec2::new(at.x, at.y) } else { Vec2::ZERO },
            primary: down(&actions.primary)?,
            secondary: down(&actions.secondary)?,
            menu: down(&actions.menu)?,
        })
    }

    /// Plays `haptics`. A controller without vibration ignores them.
    pub(in crate::xr) fn feel(&self, session: &xr::Session<xr::Vulkan>, haptics: &Haptics) {
        for side in Side::BOTH {
            let Some(pulse) = haptics.on(side) else { continue };
            let vibration = xr::HapticVibration::new()
                .amplitude(pulse.amplitude)
                .frequency(xr::FREQUENCY_UNSPECIFIED)
                .duration(xr::Duration::from_nanos((pulse.duration_s * 1e9) as i64));
            let path = self.hands[side as usize].path;
            if let Err(code) = self.actions.haptic.apply_feedback(session, path, &vibration) {
                log::info!("haptics: {code:?}");
            }
        }
    }
}

impl Actions {
    fn new(instance: &xr::Instance, hands: &[xr::Path; 2]) -> Result<Actions, Halt> {
        let set = instance.create_action_set("player", "Player", 0).halt("making inputs")?;
        fn action<T: xr::ActionTy>(
            set: &xr::ActionSet,
            hands: &[xr::Path],
            name: &str,
            localized: &str,
        ) -> Result<xr::Action<T>, Halt> {
            set.create_action(name, localized, hands).halt("making inputs")
        }
        Ok(Actions {
            aim: action(&set, hands, "aim", "Point")?,
            grip: action(&set, hands, "grip", "Hand")?,
            select: action(&set, hands, "select", "Select, or hold the clip")?,
            squeeze: action(&set, hands, "squeeze", "Hold the clip")?,
            stick: action(&set, hands, "stick", "Scrub, or turn")?,
            primary: action(&set, hands, "primary", "Play or pause, or next clip")?,
            secondary: action(&set, hands, "secondary", "Recentre, or panel")?,
            menu: action(&set, hands, "menu", "Panel; hold to leave")?,
            haptic: action(&set, hands, "haptic", "Feel")?,
            set,
        })
    }

    fn bind(&self, action: ActionName, part: xr::Path) -> xr::Binding<'_> {
        match action {
            ActionName::Aim => xr::Binding::new(&self.aim, part),
            ActionName::Grip => xr::Binding::new(&self.grip, part),
            ActionName::Select => xr::Binding::new(&self.select, part),
            ActionName::Squeeze => xr::Binding::new(&self.squeeze, part),
            ActionName::Stick => xr::Binding::new(&self.stick, part),
            ActionName::Primary => xr::Binding::new(&self.primary, part),
            ActionName::Secondary => xr::Binding::new(&self.secondary, part),
            ActionName::Menu => xr::Binding::new(&self.menu, part),
            ActionName::Haptic => xr::Binding::new(&self.haptic, part),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    #[test]
    fn every_controller_points_holds_and_selects_with_both_hands() {
        for profile in &PROFILES {
            let parts: Vec<_> = profile.parts().collect();
            for hand in ["left", "right"] {
                for action in [ActionName::Aim, ActionName::Grip, ActionName::Select] {
                    let found = parts.iter().any(|(d, part)| *d == action && part.contains(hand));
                    assert!(found, "{} {hand} {action:?}", profile.path);
                }
            }
            let paths: HashSet<_> = parts.iter().map(|(_, part)| part).collect();
            assert_eq!(paths.len(), parts.len(), "{}: a part has one action", profile.path);
            for (action, part) in &parts {
                assert_eq!(*action == ActionName::Haptic, part.contains("/output/"), "{part}");
            }
        }
    }

    #[test]
    fn the_leave_button_is_on_every_controller_that_has_one() {
        let with_menu = |path: &str| {
            let profile = PROFILES.iter().find(|profile| profile.path.ends_with(path)).unwrap();
            profile.parts().any(|(action, _)| action == ActionName::Menu)
        };
        assert!(with_menu("simple_controller") && with_menu("touch_controller"));
        assert!(with_menu("touch_controller_plus") && !with_menu("hand_interaction_ext"));
    }
}
