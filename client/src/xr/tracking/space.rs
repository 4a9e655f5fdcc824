//! [`Stage`]: the reference space of all poses, with the floor at 0, and what changes of the runtime's spaces mean in it.

use openxr as xr;
use xr::ReferenceSpaceType as Type;

use crate::headset::interaction::{Pose, SpaceChange};
use crate::xr::runtime::error::{During, Halt};

/// Assumed eye height, between sitting and standing, for a runtime that does not know the floor.
const EYE_HEIGHT_M: f32 = 1.5;

/// The reference space of all poses.
pub(in crate::xr) struct Stage {
    pub(in crate::xr) space: xr::Space,
    kind: Type,
}

impl Stage {
    /// Opens the best reference space that the runtime offers.
    ///
    /// # Errors
    /// See [`Halt`].
    pub(in crate::xr) fn open(session: &xr::Session<xr::Vulkan>) -> Result<Stage, Halt> {
        let offered = session.enumerate_reference_spaces().halt("asking for its spaces")?;
        let (kind, floor_m) = choose(&offered);
        log::info!("reference space {kind:?}, floor at {floor_m} m");
        let position = xr::Vector3f { x: 0.0, y: floor_m, z: 0.0 };
        let origin = xr::Posef { position, ..xr::Posef::IDENTITY };
        let space = session.create_reference_space(kind, origin).halt("opening a space")?;
        Ok(Stage { space, kind })
    }

    /// What a change of the reference space `changed` means, whose new origin the space before sees at `origin`, if that is
    /// known.
    pub(in crate::xr) fn change(&self, changed: Type, origin: Option<Pose>) -> Option<SpaceChange> {
        meaning(self.kind, changed, origin)
    }
}

/// The meaning of a change of the space `changed` for poses in the space `ours`. The local spaces change when the viewer
/// recentres the view, and the measured room when it is measured again: what stands in it stays there if the runtime knows
/// where that is. No pose here is relative to the head's own space.
fn meaning(ours: Type, changed: Type, origin: Option<Pose>) -> Option<SpaceChange> {
    match changed {
        Type::LOCAL | Type::LOCAL_FLOOR => Some(SpaceChange::Viewer),
        Type::STAGE if ours == Type::STAGE => {
            Some(origin.map_or(SpaceChange::Viewer, |old_from_new| SpaceChange::Stage { old_from_new }))
        }
        _ => None,
    }
}

/// The best of the spaces `offered`, and the height of the floor in it: the measured room, in which remembered placements
/// stay valid, else a space with a known floor, else one around the initial head position.
fn choose(offered: &[Type]) -> (Type, f32) {
    [Type::STAGE, Type::LOCAL_FLOOR]
        .into_iter()
        .find(|kind| offered.contains(kind))
        .map_or((Type::LOCAL, -EYE_HEIGHT_M), |kind| (kind, 0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_floor_is_measured_where_it_can_be() {
        assert_eq!(choose(&[Type::VIEW, Type::LOCAL, Type::STAGE, Type::LOCAL_FLOOR]), (Type::STAGE, 0.0));
        assert_eq!(choose(&[Type::VIEW, Type::LOCAL, Type::LOCAL_FLOOR]), (Type::LOCAL_FLOOR, 0.0));
        // Every runtime has this one.
        assert_eq!(choose(&[Type::VIEW, Type::LOCAL]), (Type::LOCAL, -EYE_HEIGHT_M));
    }

    #[test]
    fn each_change_means_what_its_space_says() {
        let origin = Some(Pose::default());
        let carried = Some(SpaceChange::Stage { old_from_new: Pose::default() });
        for (ours, changed, origin, expected) in [
            (Type::STAGE, Type::STAGE, origin, carried),
            (Type::STAGE, Type::STAGE, None, Some(SpaceChange::Viewer)),
            (Type::STAGE, Type::LOCAL, origin, Some(SpaceChange::Viewer)),
            (Type::LOCAL, Type::LOCAL_FLOOR, None, Some(SpaceChange::Viewer)),
            (Type::LOCAL, Type::STAGE, origin, None),
            (Type::STAGE, Type::VIEW, origin, None),
        ] {
            assert_eq!(meaning(ours, changed, origin), expected, "{ours:?} {changed:?} {origin:?}");
        }
    }
}
