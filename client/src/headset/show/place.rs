//! [`Place`]: where clips stand in the room, as hands move them and as it is remembered.

use crate::content::{is_url, redacted};
use crate::headset::interaction::{Interaction, Placement, PlacementStore, Pose};
use program::{Standpoint, Subject};

/// Where the clip on display stands.
pub(crate) struct Place {
    pub(crate) interaction: Interaction,
    store: Option<PlacementStore>,
    /// Where clips are put, instead of a comfortable place.
    standpoint: Option<Standpoint>,
    /// Name of the clip or playlist on display in the store.
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
            let left = self.store.as_ref().zip(self.key.as_ref()).and_then(|(store, key)| store.get(key));
            let start = || Placement::start_at(&subject, head, self.standpoint);
            self.interaction.put(subject, left.unwrap_or_else(start));
        }
    }

    /// Puts the clip in front of the viewer again.
    pub(crate) fn recentre(&mut self, head: &Pose) {
        self.interaction.recentre(head, self.standpoint);
    }

    /// Puts the next clip of a playlist where the clip before it stands.
    pub(crate) fn hand_over(&mut self, subject: Subject) {
        if let Some(placement) = self.interaction.placement().copied() {
            self.interaction.put(subject, placement);
        }
    }

    /// Writes the placements to disk.
    pub(crate) fn save(&mut self) {
        let (Some(store), Some(key)) = (&mut self.store, &self.key) else { return };
        if let Some(placement) = self.interaction.placement() {
            store.set(key, placement);
        }
        store.save();
    }
}

/// Name of a clip in the store, independent of the working directory.
fn key(name: Option<&str>) -> String {
    name.map_or("demo".into(), |name| {
        if is_url(name) {
            return redacted(name);
        }
        std::path::absolute(name).map_or(name.into(), |path| path.to_string_lossy().into_owned())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_store_holds_no_secrets() {
        assert_eq!(key(Some("https://ann:pass@host/a.aarc?key")), "https://host/a.aarc");
        assert!(key(Some("a.aarc")).ends_with("/a.aarc") && key(None) == "demo");
    }
}
