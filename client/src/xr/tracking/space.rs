//! The stage: the reference space of all poses, with the floor at 0.

use openxr as xr;

use crate::xr::runtime::error::{During, Halt};

/// Assumed eye height, between sitting and standing, for a runtime that does not know the floor.
const EYE_HEIGHT_M: f32 = 1.5;

/// Opens the best reference space that the runtime offers.
///
/// # Errors
/// See [`Halt`].
pub(in crate::xr) fn open(session: &xr::Session<xr::Vulkan>) -> Result<xr::Space, Halt> {
    let offered = session.enumerate_reference_spaces().halt("asking for its spaces")?;
    let (kind, floor_m) = choose(&offered);
    log::info!("reference space {kind:?}, floor at {floor_m} m");
    let position = xr::Vector3f { x: 0.0, y: floor_m, z: 0.0 };
    let origin = xr::Posef { position, ..xr::Posef::IDENTITY };
    session.create_reference_space(kind, origin).halt("opening a space")
}

/// The best of the spaces `offered`, and the height of the floor in it: the measured room, in which remembered placements
/// stay valid, else a space with a known floor, else one around the initial head position.
fn choose(offered: &[xr::ReferenceSpaceType]) -> (xr::ReferenceSpaceType, f32) {
    use xr::ReferenceSpaceType as Type;
    [Type::STAGE, Type::LOCAL_FLOOR]
        .into_iter()
        .find(|kind| offered.contains(kind))
        .map_or((Type::LOCAL, -EYE_HEIGHT_M), |kind| (kind, 0.0))
}

#[cfg(test)]
mod tests {
    use xr::ReferenceSpaceType as Type;

    use super::*;

    #[test]
    fn the_floor_is_measured_where_it_can_be() {
        assert_eq!(choose(&[Type::VIEW, Type::LOCAL, Type::STAGE, Type::LOCAL_FLOOR]), (Type::STAGE, 0.0));
        assert_eq!(choose(&[Type::VIEW, Type::LOCAL, Type::LOCAL_FLOOR]), (Type::LOCAL_FLOOR, 0.0));
        // Every runtime has this one.
        assert_eq!(choose(&[Type::VIEW, Type::LOCAL]), (Type::LOCAL, -EYE_HEIGHT_M));
    }
}
