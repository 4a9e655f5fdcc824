//! How large the content of a field is, without what stands far behind it or was left astray.
//!
//! Every step is a median, so neither a few rows nor their sizes move the result far, and it has the unit of the field.

use crate::Field;

/// Rows that are looked at, at most; of more, every other one, or fewer.
const SAMPLES: usize = 1 << 20;

/// The distance from the centre of the content within which half of it lies, in source units. What a Gaussian counts is
/// its opacity times the area that it shows from its broad side, at most the median area: a backdrop is made of few large
/// ones. The centre is the median along each axis. `None` if nothing is visible, or all of it is at one point.
pub fn content_radius(field: &Field) -> Option<f64> {
    let step = field.len().div_ceil(SAMPLES).max(1);
    let is_visible = |row: &usize| field.opacities[*row] > 0.0;
    let rows: Vec<usize> = (0..field.len()).step_by(step).filter(is_visible).collect();
    let areas: Vec<f64> = rows.iter().map(|&row| log_area(field.log_scales[row])).collect();
    let opacity = |&row: &usize| f64::from(field.opacities[row]);
    let median = weighted_median(areas.iter().copied().zip(rows.iter().map(opacity)));
    let weight = |(row, area): (&usize, &f64)| opacity(row) * libm::exp((area - median).min(0.0));
    let weights: Vec<f64> = rows.iter().zip(&areas).map(weight).collect();
    let along = |axis: usize| rows.iter().map(move |&row| f64::from(field.centers[row][axis]));
    let center = [0, 1, 2].map(|axis| weighted_median(along(axis).zip(weights.iter().copied())));
    let distance = |&row: &usize| {
        let squares = (0..3).map(|axis| f64::from(field.centers[row][axis]) - center[axis]).map(|x| x * x);
        squares.sum::<f64>().sqrt()
    };
    let radius = weighted_median(rows.iter().map(distance).zip(weights.iter().copied()));
    (radius > 0.0).then_some(radius)
}

/// Logarithm of the product of the two largest scales.
fn log_area(log_scales: [f32; 3]) -> f64 {
    let smallest = log_scales.into_iter().fold(f32::INFINITY, f32::min);
    log_scales.into_iter().map(f64::from).sum::<f64>() - f64::from(smallest)
}

/// The value up to which half of the weight lies; 0 without values.
fn weighted_median(values: impl Iterator<Item = (f64, f64)>) -> f64 {
    let mut values: Vec<(f64, f64)> = values.collect();
    // Stable, so that equal values add their weights in the order of the rows on any machine.
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = 0.5 * values.iter().map(|(_, weight)| weight).sum::<f64>();
    let mut sum = 0.0;
    let reaches_half = |(_, weight): &&(f64, f64)| {
        sum += weight;
        sum >= half
    };
    values.iter().find(reaches_half).map_or(0.0, |(value, _)| *value)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows of the content: a ball of radius 1.
    const BALL: usize = 4000;

    /// Numbers between -1 and 1.
    fn numbers() -> impl FnMut() -> f64 {
        let mut state = 7u64;
        move || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 40) as f64 / f64::from(1 << 23) - 1.0
        }
    }

    /// A ball of radius 1 around `origin`, in units of `unit`; `far` rows of a backdrop of large Gaussians 40 away to one
    /// side, and `strays` anywhere up to 1000 away.
    fn field(unit: f64, origin: [f64; 3], far: usize, strays: usize) -> Field {
        let mut random = numbers();
        let mut rows: Vec<([f64; 3], f64)> = Vec::new();
        while rows.len() < BALL {
            let place = [random(), random(), random()];
            if place.iter().map(|x| x * x).sum::<f64>() <= 1.0 {
                rows.push((place, 0.02 + 0.01 * random()));
            }
        }
        rows.extend((0..far).map(|_| ([30.0 * random(), 30.0 * random(), 40.0], 5.0)));
        rows.extend((0..strays).map(|_| ([0; 3].map(|_| 1000.0 * random()), 50.0)));
        Field {
            centers: rows
                .iter()
                .map(|(place, _)| [0, 1, 2].map(|axis| ((place[axis] + origin[axis]) * unit) as f32))
                .collect(),
            rotations: vec![[1.0, 0.0, 0.0, 0.0]; rows.len()],
            log_scales: rows
                .iter()
                .map(|(_, scale)| [*scale, 0.1 * scale, *scale].map(|scale| (scale * unit).ln() as f32))
                .collect(),
            opacities: vec![0.6; rows.len()],
            sh: vec![[0.5; 3]; rows.len()],
            ..Field::default()
        }
    }

    fn radius(unit: f64, origin: [f64; 3], far: usize, strays: usize) -> f64 {
        content_radius(&field(unit, origin, far, strays)).unwrap()
    }

    #[test]
    fn half_of_a_ball_lies_within_four_fifths_of_its_radius() {
        assert!((radius(1.0, [0.0; 3], 0, 0) - 0.5f64.cbrt()).abs() < 0.02);
    }

    #[test]
    fn the_unit_and_the_origin_do_not_matter() {
        let expected = radius(1.0, [0.0; 3], 0, 0);
        for unit in [1e-3, 1e6] {
            let found = radius(unit, [0.0; 3], 0, 0) / unit;
            assert!((found / expected - 1.0).abs() < 1e-5, "{unit}: {found} {expected}");
        }
        let found = radius(1.0, [300.0, -2000.0, 50.0], 0, 0);
        assert!((found / expected - 1.0).abs() < 1e-3, "{found} {expected}");
    }

    #[test]
    fn a_far_backdrop_and_strays_matter_little() {
        let expected = radius(1.0, [0.0; 3], 0, 0);
        // 18 % and 2 % of all rows.
        for (far, strays) in [(BALL * 18 / 82, 0), (0, BALL * 2 / 98), (BALL * 18 / 80, BALL * 2 / 80)] {
            let found = radius(1.0, [0.0; 3], far, strays);
            assert!((found / expected - 1.0).abs() < 0.35, "{far}, {strays}: {found} {expected}");
        }
    }

    #[test]
    fn rows_count_by_what_they_show() {
        // As many rows far away as in the ball, and almost as many.
        let mut field = field(1.0, [0.0; 3], BALL, 0);
        field.opacities[BALL..].fill(0.002);
        let expected = radius(1.0, [0.0; 3], 0, 0);
        let found = content_radius(&field).unwrap();
        assert!((found / expected - 1.0).abs() < 0.02, "faint rows: {found} {expected}");
        field.opacities[BALL..].fill(0.5);
        field.log_scales[BALL..].fill([-12.0; 3]);
        let found = content_radius(&field).unwrap();
        assert!((found / expected - 1.0).abs() < 0.02, "tiny rows: {found} {expected}");
    }

    #[test]
    fn many_rows_are_sampled() {
        let few = field(1.0, [0.0; 3], 0, 0);
        let rows: Vec<usize> = (0..SAMPLES + 5).map(|row| row % BALL).collect();
        let [few, many] = [few.clone(), few.select(&rows)].map(|field| content_radius(&field).unwrap());
        assert!((few / many - 1.0).abs() < 0.01, "{few} {many}");
    }

    #[test]
    fn what_shows_nothing_has_no_size() {
        assert_eq!(content_radius(&Field::default()), None);
        let field = field(1.0, [0.0; 3], 0, 0);
        assert_eq!(content_radius(&field.select(&[0])), None);
        assert_eq!(content_radius(&Field { opacities: vec![0.0; BALL], ..field }), None);
    }
}
