//! [`Pointer`]: one pointer on the panel for two hands.
//!
//! The hand that points at the panel, the nearer one of two, owns the pointer until it points elsewhere or the
//! other one presses. A pressing hand keeps the pointer anywhere, so that a drag may leave the panel.

use egui::{Event, Modifiers, PointerButton, Pos2, Rect};

use super::quad::{Hit, PanelQuad};
use crate::headset::interaction::{Button, Haptics, Inputs, Pulse, Side};

/// Margin in points beyond the edge within which a hand keeps the pointer: hands tremble.
const STAY: f32 = 24.0;

/// Farthest distance of a drag from the panel, in points.
const DRAG_RANGE: f32 = 10_000.0;

/// The owner of the pointer, and its position.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Pointer {
    hand: Option<Side>,
    pressing: bool,
    /// Position in points; the last one while no hand owns the pointer.
    at: Pos2,
}

/// The pointer after a frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Pointing {
    /// Hands that point at the panel or drag on it.
    pub(super) on_panel: [bool; 2],
    /// A press ended because its hand was lost: not a click.
    pub(super) lost: bool,
}

impl Pointer {
    /// Takes in where the hands point, and appends the events for the interface. `occupied` are the areas of
    /// the panel that are drawn on.
    pub(super) fn update(
        &mut self,
        inputs: &Inputs,
        quad: &PanelQuad,
        occupied: &[Rect],
        events: &mut Vec<Event>,
        haptics: &mut Haptics,
    ) -> Pointing {
        let hits = Side::BOTH.map(|side| inputs.aim(side).and_then(|aim| quad.hit(&aim)));
        let on = |side: Side, margin: f32| {
            hits[side as usize].filter(|hit| occupied.iter().any(|rect| rect.expand(margin).contains(hit.at)))
        };
        let nearest = |pressing: bool| {
            let pointing = |&side: &Side| !pressing || inputs.pressed(side, Button::Select);
            let candidates = Side::BOTH.into_iter().filter(pointing);
            candidates
                .filter_map(|side| on(side, 0.0).map(|hit| (side, hit)))
                .min_by(|a, b| a.1.distance_m.total_cmp(&b.1.distance_m))
        };
        let mut lost = false;

        if let (true, Some(side)) = (self.pressing, self.hand) {
            if let Some(hit) = hits[side as usize] {
                let range = Rect::ZERO.expand(DRAG_RANGE);
                self.move_to(range.clamp(hit.at), events);
            }
            if !inputs.is_held(side, Button::Select) {
                lost = inputs.aim(side).is_none();
                self.press(false, events);
            }
        }
        if !self.pressing {
            if let Some((side, hit)) = nearest(true) {
                self.take(side, hit, events);
                self.press(true, events);
                haptics.play(side, Pulse::PRESS);
            } else if let Some((side, hit)) = self.staying(on).or_else(|| nearest(false)) {
                self.take(side, hit, events);
            } else if self.hand.take().is_some() {
                events.push(Event::PointerGone);
            }
        }
        let on_panel =
            Side::BOTH.map(|side| on(side, 0.0).is_some() || self.pressing && self.hand == Some(side));
        Pointing { on_panel, lost }
    }

    /// The present owner, if it still points near enough.
    fn staying(&self, on: impl Fn(Side, f32) -> Option<Hit>) -> Option<(Side, Hit)> {
        self.hand.and_then(|side| on(side, STAY).map(|hit| (side, hit)))
    }

    fn take(&mut self, side: Side, hit: Hit, events: &mut Vec<Event>) {
        let comes_back = self.hand.replace(side).is_none();
        if comes_back || self.at != hit.at {
            self.move_to(hit.at, events);
        }
    }

    fn move_to(&mut self, at: Pos2, events: &mut Vec<Event>) {
        self.at = at;
        events.push(Event::PointerMoved(at));
    }

    fn press(&mut self, pressed: bool, events: &mut Vec<Event>) {
        self.pressing = pressed;
        let (pos, button, modifiers) = (self.at, PointerButton::Primary, Modifiers::NONE);
        events.push(Event::PointerButton { pos, button, pressed, modifiers });
    }

    /// Gives the pointer up, as the panel is hidden.
    pub(super) fn leave(&mut self, events: &mut Vec<Event>) {
        if self.pressing {
            self.press(false, events);
        }
        if self.hand.take().is_some() {
            events.push(Event::PointerGone);
        }
    }

    /// Position of the pointer in points, if a hand owns it, and whether it presses.
    pub(super) fn at(&self) -> Option<(Pos2, bool)> {
        self.hand.map(|_| (self.at, self.pressing))
    }
}
