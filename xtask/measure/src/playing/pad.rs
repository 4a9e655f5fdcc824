//! Padded clips: the same picture, with the cost of a feature that the clip does not need.

use codec::{Clip, Field, LayerEnd, Temporal, TimeIndex, sh_coefficients};

/// The clip with columns for view-dependent colour up to `degree`, of zeros.
pub(super) fn with_sh_degree(clip: &Clip, degree: u8) -> Clip {
    let widen = |field: &Field| {
        let mut sh = Vec::with_capacity(field.len() * sh_coefficients(degree));
        for i in 0..field.len() {
            sh.extend_from_slice(field.sh_of(i));
            sh.resize((i + 1) * sh_coefficients(degree), [0.0; 3]);
        }
        Field { sh, sh_degree: degree, ..field.clone() }
    };
    Clip {
        static_field: widen(&clip.static_field),
        dynamic_field: widen(&clip.dynamic_field),
        ..clip.clone()
    }
}

/// The clip with columns for powers of time up to `order`, of zeros.
pub(super) fn with_motion_order(clip: &Clip, order: u8) -> Clip {
    let mut padded = clip.clone();
    if let Some(temporal) = &mut padded.dynamic_field.temporal {
        let motion = (0..temporal.tau.len()).flat_map(|i| {
            let mut row = temporal.motion_of(i).to_vec();
            row.resize(usize::from(order), [0.0; 3]);
            row
        });
        temporal.motion = motion.collect();
        temporal.motion_order = order;
    }
    padded
}

/// The clip with columns for rotation over time, of zeros.
pub(super) fn with_rotation(clip: &Clip) -> Clip {
    let mut padded = clip.clone();
    let rows = padded.dynamic_field.len();
    if let Some(temporal) = &mut padded.dynamic_field.temporal {
        temporal.rotation_rates = Some(vec![[0.0; 4]; rows]);
    }
    padded
}

/// The field with windows that never end for all, if it has no temporal columns.
pub(super) fn with_temporal(mut field: Field) -> Field {
    let rows = field.len();
    field.temporal.get_or_insert_with(|| Temporal {
        tau: vec![0.5; rows],
        s: vec![f32::INFINITY; rows],
        ..Temporal::default()
    });
    field
}

/// The clip with its motionless Gaussians among the others, and without a time index.
pub(super) fn all_dynamic(clip: &Clip) -> Clip {
    let dynamic_field = with_temporal(clip.merged());
    let rows = dynamic_field.len();
    let end = LayerEnd { static_count: 0, dynamic_count: rows };
    Clip {
        static_field: Field { sh_degree: clip.static_field.sh_degree, ..Field::default() },
        layers: vec![end],
        layers_announced: vec![end],
        time_index: TimeIndex::of_candidates(rows),
        dynamic_field,
        ..clip.clone()
    }
}

/// The clip without a time index: all dynamic Gaussians are tested at every instant.
pub(super) fn without_index(clip: &Clip) -> Clip {
    let (static_count, dynamic_count) = (clip.static_field.len(), clip.dynamic_field.len());
    let end = LayerEnd { static_count, dynamic_count };
    Clip {
        layers: vec![end],
        layers_announced: vec![end],
        time_index: TimeIndex::of_candidates(dynamic_count),
        ..clip.clone()
    }
}

/// The clip with a plate of one Gaussian, one of its own, that cannot be seen.
pub(super) fn with_plate(clip: &Clip) -> Clip {
    let from = if clip.static_field.is_empty() { &clip.dynamic_field } else { &clip.static_field };
    let plate = Field { temporal: None, ..from.select(&[0]) };
    Clip { plate: Some(Field { opacities: vec![0.0], ..plate }), ..clip.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Motion, Recipe, decoded_with};
    use refine::reference::{Order, render};

    /// Padding shows nowhere.
    #[test]
    fn padded_clips_look_the_same() {
        let motion = Motion::Mixed;
        let recipe = Recipe { count: 80, sh_degree: 1, motion, motion_order: 1, turning: false, seed: 4 };
        let clip = decoded_with(&recipe.field(), None, &[40]);
        let camera = clip.info.viewpoints[0].camera(clip.info.up, 48, 36);
        let picture = |clip: &Clip| render(&clip.into(), &camera, 0.4, Order::Depth);
        let expected = picture(&clip);
        let padded = [
            with_sh_degree(&clip, 3),
            with_motion_order(&clip, 3),
            with_rotation(&clip),
            all_dynamic(&clip),
            without_index(&clip),
            with_plate(&clip),
        ];
        for (i, padded) in padded.iter().enumerate() {
            for field in [&padded.static_field, &padded.dynamic_field] {
                field.check().unwrap();
            }
            let off = picture(padded).max_difference(&expected);
            assert!(off < 1e-6, "{i}: {off}");
        }
        assert_eq!((padded[0].sh_degree(), padded[1].dynamic_field.motion_order()), (3, 3));
    }
}
