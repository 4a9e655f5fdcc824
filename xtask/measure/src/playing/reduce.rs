//! Reduced clips: without some columns of the Gaussians.

use codec::{Clip, Field, Temporal, sh_coefficients};

/// The clip with view-dependent colour up to `degree`.
pub(super) fn to_sh_degree(clip: &Clip, degree: u8) -> Clip {
    let cut = |field: &Field| {
        let coefficients = sh_coefficients(degree.min(field.sh_degree));
        let sh = (0..field.len()).flat_map(|i| field.sh_of(i)[..coefficients].iter().copied()).collect();
        Field { sh, sh_degree: degree.min(field.sh_degree), ..field.clone() }
    };
    Clip { static_field: cut(&clip.static_field), dynamic_field: cut(&clip.dynamic_field), ..clip.clone() }
}

/// The clip with powers of time up to `order`: of each trajectory the Taylor expansion about the
/// middle of the Gaussian's life, where it is seen most.
pub(super) fn to_motion_order(clip: &Clip, order: u8) -> Clip {
    let mut reduced = clip.clone();
    let dynamic_field = &mut reduced.dynamic_field;
    let Some(temporal) = &clip.dynamic_field.temporal else { return reduced };
    let order = order.min(temporal.motion_order);
    let mut motion = Vec::with_capacity(dynamic_field.len() * usize::from(order));
    for i in 0..dynamic_field.len() {
        let tau = f64::from(temporal.tau[i]);
        let middle = clip.dynamic_field.alive_interval(i).map_or(tau, |(start, end)| 0.5 * (start + end));
        for axis in 0..3 {
            let mut powers = [f64::from(dynamic_field.centers[i][axis]), 0.0, 0.0, 0.0];
            for (power, v) in powers[1..].iter_mut().zip(temporal.motion_of(i)) {
                *power = f64::from(v[axis]);
            }
            let mut about_middle = shifted(powers, middle - tau);
            about_middle[1 + usize::from(order)..].fill(0.0);
            let [center, rest @ ..] = shifted(about_middle, tau - middle);
            dynamic_field.centers[i][axis] = center as f32;
            motion.resize((i + 1) * usize::from(order), [0.0; 3]);
            for (v, x) in motion[i * usize::from(order)..].iter_mut().zip(rest) {
                v[axis] = x as f32;
            }
        }
    }
    dynamic_field.temporal = Some(Temporal { motion_order: order, motion, ..temporal.clone() });
    reduced
}

/// The polynomial in `d + by` of the same values as the polynomial of `powers` in `d`.
fn shifted([a, b, c, d]: [f64; 4], by: f64) -> [f64; 4] {
    [a + by * (b + by * (c + by * d)), b + by * (2.0 * c + by * 3.0 * d), c + 3.0 * by * d, d]
}

/// The clip without rotation over time; each Gaussian is turned as in the middle of its life.
pub(super) fn without_rotation(clip: &Clip) -> Clip {
    let mut reduced = clip.clone();
    let dynamic_field = &mut reduced.dynamic_field;
    for i in 0..dynamic_field.len() {
        if let Some((start, end)) = clip.dynamic_field.alive_interval(i) {
            dynamic_field.rotations[i] =
                clip.dynamic_field.rotation_at(i, 0.5 * (start + end)).map(|x| x as f32);
        }
    }
    if let Some(temporal) = &mut dynamic_field.temporal {
        temporal.rotation_rates = None;
    }
    reduced
}

/// The Gaussians whose opacity at `t` is at least `least`, as one layer.
pub(super) fn to_alive(clip: &Clip, t: f64, least: f64) -> Clip {
    let alive = |field: &Field| {
        let rows: Vec<usize> = (0..field.len()).filter(|&i| field.opacity_at(i, t) >= least).collect();
        field.select(&rows)
    };
    let (static_field, dynamic_field) = (alive(&clip.static_field), alive(&clip.dynamic_field));
    Clip::of_one_layer(clip.info.clone(), clip.bounds, static_field, dynamic_field, clip.plate.clone())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Motion, Recipe, decoded_with};

    fn clip() -> Clip {
        let motion = Motion::Mixed;
        let recipe = Recipe { count: 60, sh_degree: 2, motion, motion_order: 3, turning: true, seed: 8 };
        decoded_with(&recipe.field(), None, &[])
    }

    fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
        (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum::<f64>().sqrt()
    }

    #[test]
    fn lower_orders_agree_in_the_middle_of_a_life() {
        let clip = clip();
        let whole = to_motion_order(&clip, 3);
        let reduced = to_motion_order(&clip, 1);
        assert_eq!(reduced.dynamic_field.motion_order(), 1);
        reduced.dynamic_field.check().unwrap();
        let mut off = 0.0f64;
        for i in 0..clip.dynamic_field.len() {
            let Some((start, end)) = clip.dynamic_field.alive_interval(i) else { continue };
            let middle = 0.5 * (start + end);
            let place = |clip: &Clip, t| clip.dynamic_field.position_at(i, t);
            assert!(distance(place(&reduced, middle), place(&clip, middle)) < 1e-5, "{i}");
            assert!(distance(place(&whole, end), place(&clip, end)) < 1e-4, "{i}");
            off = off.max(distance(place(&reduced, end), place(&clip, end)));
        }
        assert!(off > 0.01, "two powers are gone: {off}");
    }

    #[test]
    fn what_is_cut_is_gone_and_the_rest_stays() {
        let clip = clip();
        let flat = to_sh_degree(&clip, 0);
        flat.dynamic_field.check().unwrap();
        assert_eq!((flat.sh_degree(), flat.dynamic_field.sh_of(3)), (0, &clip.dynamic_field.sh_of(3)[..1]));
        assert!(without_rotation(&clip).dynamic_field.temporal.unwrap().rotation_rates.is_none());
        let alive = to_alive(&clip, 0.5, 0.3);
        let expected =
            (0..clip.dynamic_field.len()).filter(|&i| clip.dynamic_field.opacity_at(i, 0.5) >= 0.3).count();
        assert_eq!(alive.dynamic_field.len(), expected);
        assert!(expected < clip.dynamic_field.len());
    }
}
