//! [`Place`]: where clips stand in the room, as hands move them and as it is remembered.

use crate::clock::Clock;
use crate::content::{digest, is_url, redacted, request_url};
use crate::headset::interaction::{
    Command, Haptics, Interaction, Placement, PlacementStore, Pose, SpaceChange,
};
use program::{Standpoint, Subject};

/// Where the clip on display stands.
pub(crate) struct Place {
    pub(crate) interaction: Interaction,
    store: Option<PlacementStore>,
    /// Where clips are put, instead of a comfortable place.
    standpoint: Option<Standpoint>,
    /// Name in the store of the clip on display, or of the playlist whose clips share a place.
    key: Option<String>,
}

impl Place {
    /// Clips are placed where `store` has them, else at `standpoint` or at a comfortable place.
    pub(crate) fn new(store: Option<PlacementStore>, standpoint: Option<Standpoint>) -> Place {
        Place { interaction: Interaction::default(), store, standpoint, key: None }
    }

    /// Changes to another clip or playlist, which [`Place::settle`] places once the head is tracked.
    pub(crate) fn change(&mut self, name: Option<&str>) {
        self.save();
        self.interaction.take_away();
        self.key = Some(key(name));
    }

    /// Places a clip that has no place yet: where it was left, or in front of the viewer.
    pub(crate) fn settle(&mut self, subject: Subject, head: &Pose) {
        if self.interaction.placement().is_none() {
            let left = self.left();
            let start = || Placement::start_at(&subject, head, self.standpoint, 1.0);
            self.interaction.put(subject, left.unwrap_or_else(start));
        }
    }

    /// Where the clip was left, if that is remembered.
    fn left(&self) -> Option<Placement> {
        self.store.as_ref().zip(self.key.as_ref()).and_then(|(store, key)| store.get(key))
    }

    /// Puts the clip in front of the viewer again.
    pub(crate) fn recentre(&mut self, head: &Pose) {
        self.interaction.recentre(head, self.standpoint);
    }

    /// Keeps the clip where it is, or in front of the viewer, in changed spaces. What is remembered, of all clips, is
    /// carried over to another stage. Recentring by the system does not change it.
    pub(crate) fn change_space(&mut self, change: SpaceChange, head: &Pose) {
        self.save();
        self.interaction.change_space(change, head, self.standpoint);
        if let (SpaceChange::Stage { old_from_new }, Some(store)) = (change, &mut self.store) {
            store.carry_over(&old_from_new);
        }
    }

    /// Goes on with the next clip of a list, remembered under `name`: it stands where it was left, or else, and while a
    /// hand holds, where the clip before it stands.
    pub(crate) fn follow(&mut self, name: Option<&str>, subject: Subject) {
        let key = Some(key(name));
        let is_named = self.key != key;
        if is_named {
            self.save();
            self.key = key;
        }
        let left = self.left().filter(|_| is_named && !self.interaction.is_holding());
        if let Some(placement) = left.or(self.interaction.placement().copied()) {
            self.interaction.put(subject, placement);
        }
    }

    /// Lets the hands of a frame move the clip, as [`Interaction::update`], and remembers where it is once no hand holds it.
    pub(crate) fn update(
        &mut self,
        head: &Pose,
        on_panel: [bool; 2],
        clock: &Clock,
        commands: &mut Vec<Command>,
        haptics: &mut Haptics,
    ) {
        self.interaction.update(head, on_panel, clock, commands, haptics);
        if !self.interaction.is_holding() {
            self.save();
        }
    }

    /// Remembers where the viewer has put the clip, though a hand may hold it.
    pub(crate) fn save(&mut self) {
        let is_moved = self.interaction.take_moved();
        let (Some(store), Some(key)) = (self.store.as_mut().filter(|_| is_moved), &self.key) else { return };
        if let Some(placement) = self.interaction.placement() {
            store.set(key, placement);
        }
    }
}

impl Drop for Place {
    /// A run may end by a fault, and while a hand holds the clip.
    fn drop(&mut self) {
        self.save();
    }
}

/// Name of a clip in the store, independent of the working directory. It holds no secrets: a digest stands for the query of
/// a URL, and a user name counts for nothing, as for the server.
fn key(name: Option<&str>) -> String {
    name.map_or("demo".into(), |name| {
        if is_url(name) {
            let (shown, requested) = (request_url(&redacted(name)), request_url(name));
            return if shown == requested { shown } else { format!("{shown} {}", &digest(requested)[..16]) };
        }
        std::path::absolute(name).map_or(name.into(), |path| path.to_string_lossy().into_owned())
    })
}

#[cfg(test)]
mod tests {
    use glam::{Quat, Vec3, vec3};

    use super::*;
    use crate::headset::interaction::{Hand, Hands};

    #[test]
    fn the_store_holds_no_secrets_and_tells_urls_apart() {
        let urls = ["", "?1", "?2"].map(|query| format!("https://host/a.aarc{query}"));
        let keys = urls.each_ref().map(|url| key(Some(url)));
        assert!(keys[0] == urls[0] && keys[1] != keys[2], "{keys:?}");
        assert!(keys.iter().all(|key| key.starts_with(&urls[0]) && !key.contains('?')), "{keys:?}");
        // User names are not sent, so they name no other clip.
        let of_ann = urls.map(|url| key(Some(&url.replace("host", "ann:pass@host"))));
        assert_eq!(of_ann, keys);
        // One URL in two spellings, and the path that a playlist names.
        let spelled = ["a b.aarc", "a%20b.aarc"].map(|file| key(Some(&format!("https://host/{file}"))));
        assert_eq!(spelled, [const { "https://host/a%20b.aarc" }; 2]);
        assert!(key(Some("a.aarc")).ends_with("/a.aarc") && key(None) == "demo");
    }

    const DEMO: &[u8] = include_bytes!("../../../../assets/demo.aarc");
    const HEAD: Pose = Pose { position: Vec3::new(0.0, 1.6, 0.0), orientation: Quat::IDENTITY };

    fn subject() -> Subject {
        Subject::from_clip(&codec::decode(DEMO, &Default::default()).unwrap())
    }

    /// The place of a clip that has one, remembered in `folder`.
    fn place(folder: &std::path::Path) -> Place {
        let mut place = Place::new(Some(PlacementStore::open(folder)), None);
        place.change(Some("a.aarc"));
        place.settle(subject(), &HEAD);
        place
    }

    /// A frame in which a hand that holds the clip, or not, is at `x`.
    fn hold(place: &mut Place, squeeze: bool, x: f32) {
        let grip = Pose { position: vec3(x, 1.2, -0.3), orientation: Quat::IDENTITY };
        let right = Hand { tracked: true, aim: grip, grip, squeeze, ..Hand::default() };
        place.interaction.take(&Hands { right, ..Hands::default() }, true, 0.01);
        let clock = Clock::new(1.0, 30.0);
        place.update(&HEAD, [false; 2], &clock, &mut Vec::new(), &mut Haptics::default());
    }

    fn remembered(folder: &std::path::Path) -> Option<Placement> {
        PlacementStore::open(folder).get(&key(Some("a.aarc")))
    }

    #[test]
    fn only_a_clip_that_was_moved_is_remembered_and_from_its_release_on() {
        let folder = tempfile::tempdir().unwrap();
        let mut moved = place(folder.path());
        hold(&mut moved, false, 0.0);
        moved.save();
        assert!(moved.store.as_ref().unwrap().get(&key(Some("a.aarc"))).is_none());
        for (squeeze, x) in [(true, 0.0), (true, 0.2), (true, 0.4)] {
            hold(&mut moved, squeeze, x);
        }
        assert!(moved.store.as_ref().unwrap().get(&key(Some("a.aarc"))).is_none(), "a hand holds it");
        hold(&mut moved, false, 0.4);
        let left = *moved.interaction.placement().unwrap();
        drop(moved);
        assert_eq!(remembered(folder.path()), Some(left));
        assert_eq!(place(folder.path()).interaction.placement(), Some(&left));
    }

    #[test]
    fn a_run_that_ends_while_a_hand_holds_the_clip_remembers_it() {
        let folder = tempfile::tempdir().unwrap();
        let mut held = place(folder.path());
        for (squeeze, x) in [(false, 0.0), (true, 0.0), (true, 0.2), (true, 0.4)] {
            hold(&mut held, squeeze, x);
        }
        let left = *held.interaction.placement().unwrap();
        drop(held);
        assert_eq!(remembered(folder.path()), Some(left));
    }

    #[test]
    fn another_stage_carries_what_is_remembered_and_recentring_by_the_system_is_not_remembered() {
        let folder = tempfile::tempdir().unwrap();
        let mut store = PlacementStore::open(folder.path());
        for (name, x) in [("a.aarc", 1.0), ("another.aarc", 5.0)] {
            store.set(&key(Some(name)), &Placement::new(0.25, 0.0, glam::dvec3(x, 0.5, -2.0)));
        }
        drop(store);
        let mut placed = place(folder.path());
        placed.change_space(SpaceChange::Viewer, &HEAD);
        let recentred = *placed.interaction.placement().unwrap();
        assert!(recentred.scale() == 0.25 && recentred.position().x.abs() < 1e-9, "{recentred:?}");
        let origin = Pose { position: vec3(1.0, 0.0, 0.0), orientation: Quat::IDENTITY };
        placed.change_space(SpaceChange::Stage { old_from_new: origin }, &HEAD);
        drop(placed);
        for (name, x) in [("a.aarc", 0.0), ("another.aarc", 4.0)] {
            let left = PlacementStore::open(folder.path()).get(&key(Some(name))).unwrap();
            let distance = left.position().distance(glam::dvec3(x, 0.5, -2.0));
            assert!(distance < 1e-6 && left.scale() == 0.25, "{name} {left:?}");
        }
    }

    #[test]
    fn clips_of_a_list_stand_where_each_was_left_and_a_new_one_where_the_one_before_stands() {
        let folder = tempfile::tempdir().unwrap();
        let b = Placement::new(0.5, 0.0, glam::dvec3(2.0, 0.0, -1.0));
        PlacementStore::open(folder.path()).set(&key(Some("b.aarc")), &b);
        let mut place = place(folder.path());
        for (squeeze, x) in [(false, 0.0), (true, 0.0), (true, 0.2), (true, 0.4), (false, 0.4)] {
            hold(&mut place, squeeze, x);
        }
        let a = *place.interaction.placement().unwrap();
        let mut stands = |name| {
            place.follow(Some(name), subject());
            *place.interaction.placement().unwrap()
        };
        assert_eq!(["b.aarc", "c.aarc", "a.aarc"].map(&mut stands), [b, b, a]);
        // The clips of a playlist have one name and one place.
        assert_eq!(stands("a.aarc"), a);
        (0..3).for_each(|i| hold(&mut place, true, 0.2 * i as f32));
        let held = *place.interaction.placement().unwrap();
        place.follow(Some("b.aarc"), subject());
        assert!(held != a && place.interaction.placement() == Some(&held), "a hand takes it along");
    }
}
