//! [`adam`]: one step of Adam (Kingma and Ba, "Adam: a method for stochastic optimization", 2015) for the
//! Gaussians that an image shows.
//!
//! An image shows the Gaussians of a few frames. The others have no gradient; neither they nor their
//! moments move. Bias correction therefore counts the gradients of each row, not the steps.

use std::sync::LazyLock;

use rayon::prelude::*;

use super::{LearningRates, Moments};
use crate::fit::parameters::{Bounds, COLUMNS, Carried, Parameters, row_of};
use crate::raster::Real;

pub(in crate::fit) const BETA1: f64 = 0.9;
pub(in crate::fit) const BETA2: f64 = 0.999;

/// Gradients are means over many pixels, 1e-9 and less: the usual 1e-8 would dominate them.
pub(in crate::fit) const EPSILON: f64 = 1e-15;

/// Bias corrections of the first and the second moment, by number of gradients. The last entry serves all greater numbers:
/// it is 1 to within 1e-14.
static CORRECTIONS: LazyLock<Vec<[f64; 2]>> = LazyLock::new(|| {
    let after = |gradients: usize| [BETA1, BETA2].map(|beta| 1.0 / (1.0 - num_traits::pow(beta, gradients)));
    (0..1 << 15).map(after).collect()
});

/// Rows per parallel task.
const CHUNK: usize = 1024;

/// The first of the columns of time, which are the last: window, motion and rotation rates.
const TIME_COLUMN: usize = 5;

/// The columns of the logarithms of the window widths, and of motion.
const WIDTH_COLUMN: usize = 6;
const MOTION_COLUMN: usize = 7;

/// Moves `rows` against their gradients (row `i` of `gradient` is the gradient of `rows[i]`) and projects them
/// into the bounds. Steps of carried rows are shorter by their [share](Carried::share). Skips rows whose gradient, or its
/// square, is not finite; returns how many.
///
/// # Panics
/// If `rows` are not strictly ascending, or the shapes differ.
pub(in crate::fit) fn adam<T: Real>(
    parameters: &mut Parameters<T>,
    moments: &mut Moments<T>,
    rows: &[u32],
    gradient: &Parameters<T>,
    rates: &LearningRates,
    bounds: &Bounds,
) -> usize {
    assert!(rows.is_sorted_by(|a, b| a < b), "rows ascend");
    assert!(
        rows.len() == gradient.len() && moments.visits.len() == parameters.len(),
        "a gradient for each row"
    );
    assert!(rows.last().is_none_or(|row| (*row as usize) < parameters.len()), "rows of the parameters");
    let by_column = rates.by_column(parameters);
    let step = |(chunk, mut part): (usize, RowChunk<T>)| {
        let first = chunk * CHUNK;
        let before = |end: usize| rows.partition_point(|row| (*row as usize) < end);
        let range = before(first)..before(first + CHUNK);
        if range.is_empty() {
            return 0;
        }
        let gradient = gradient.columns().map(|column| {
            let per_row = column.len() / rows.len();
            &column[per_row * range.start..per_row * range.end]
        });
        let rows: Vec<usize> = rows[range].iter().map(|row| *row as usize - first).collect();
        let usable = usable(rows.len(), &gradient);
        part.step(&rows, &gradient, &usable, rates, &by_column);
        for (row, _) in rows.iter().zip(&usable).filter(|(_, usable)| **usable) {
            bounds.project(row_of(&mut part.values, part.visits.len(), *row));
        }
        usable.iter().filter(|usable| !**usable).count()
    };
    RowChunk::split(parameters, moments).into_par_iter().enumerate().map(step).sum()
}

/// Whether each of `count` rows of a gradient, and its square, are finite.
fn usable<T: Real>(count: usize, gradient: &[&[T]; COLUMNS]) -> Vec<bool> {
    let mut usable = vec![true; count];
    for column in gradient.iter().filter(|column| !column.is_empty()) {
        for (usable, row) in usable.iter_mut().zip(column.chunks_exact(column.len() / count)) {
            // 0 times x is 0 for a finite x, else NaN: a sum without branches.
            *usable &= row.iter().fold(T::zero(), |sum, g| sum + *g * *g * T::zero()) == T::zero();
        }
    }
    usable
}

/// The rates of the first `N` coefficients of motion, from their rates by power.
fn by_axis<T: Real, const N: usize>(by_power: &[T; 3]) -> [T; N] {
    std::array::from_fn(|k| by_power[k / 3])
}

/// Bias corrections of the first and the second moment of each row; `None` where it is skipped.
type Corrections<T> = Vec<Option<[T; 2]>>;

/// Consecutive rows of the parameters, with their moments.
struct RowChunk<'a, T> {
    values: [&'a mut [T]; COLUMNS],
    first: [&'a mut [T]; COLUMNS],
    second: [&'a mut [T]; COLUMNS],
    visits: &'a mut [u32],
    /// Empty in a fit that goes on from no other.
    carried: &'a [Carried],
}

impl<'a, T: Real> RowChunk<'a, T> {
    /// Splits all rows into chunks of [`CHUNK`].
    fn split(parameters: &'a mut Parameters<T>, moments: &'a mut Moments<T>) -> Vec<RowChunk<'a, T>> {
        let count = parameters.len();
        let lengths = || (0..count).step_by(CHUNK).map(|first| CHUNK.min(count - first));
        let Moments { first, second, visits, carried } = moments;
        let moments = first.parts_mut(lengths()).into_iter().zip(second.parts_mut(lengths()));
        let of_rows = visits.chunks_mut(CHUNK).enumerate().map(|(chunk, visits)| {
            let first = (chunk * CHUNK).min(carried.len());
            (visits, &carried[first..carried.len().min(first + CHUNK)])
        });
        let parts = parameters.parts_mut(lengths()).into_iter().zip(moments).zip(of_rows);
        parts
            .map(|((values, (first, second)), (visits, carried))| RowChunk {
                values,
                first,
                second,
                visits,
                carried,
            })
            .collect()
    }

    /// Steps the `usable` of these rows; row `i` of `gradient` is the gradient of `rows[i]`, and `by_column` are the
    /// [`rates`](LearningRates::by_column) of each column.
    fn step(
        &mut self,
        rows: &[usize],
        gradient: &[&[T]; COLUMNS],
        usable: &[bool],
        rates: &LearningRates,
        by_column: &[Vec<T>; COLUMNS],
    ) {
        let (corrections, of_time) = self.corrections(rows, usable);
        // Before the widths step, as on a GPU.
        let widths = &self.values[WIDTH_COLUMN];
        let by_power = |row: &usize| rates.motion(widths[*row].to_double()).map(T::from_f64);
        let motion: Vec<[T; 3]> = match self.values[MOTION_COLUMN].is_empty() {
            true => Vec::new(),
            false => rows.iter().map(by_power).collect(),
        };
        let columns = self.values.iter_mut().zip(&mut self.first).zip(&mut self.second);
        for (number, (((values, first), second), (gradient, rates))) in
            columns.zip(gradient.iter().zip(by_column)).enumerate()
        {
            if values.is_empty() {
                continue;
            }
            let corrections = match &of_time {
                Some(of_time) if number >= TIME_COLUMN => of_time,
                _ => &corrections,
            };
            let column = Column { values, first, second };
            // The compiler makes vectors of a row whose length it knows: rows of the columns up to degree 3.
            match (number, rates.len()) {
                (MOTION_COLUMN, _) => match gradient.len() / rows.len() {
                    3 => step(column, rows, gradient, corrections, |i| by_axis::<T, 3>(&motion[i])),
                    6 => step(column, rows, gradient, corrections, |i| by_axis::<T, 6>(&motion[i])),
                    _ => step(column, rows, gradient, corrections, |i| by_axis::<T, 9>(&motion[i])),
                },
                (_, 1) => step_alike::<T, 1>(column, rows, gradient, corrections, rates),
                (_, 3) => step_alike::<T, 3>(column, rows, gradient, corrections, rates),
                (_, 4) => step_alike::<T, 4>(column, rows, gradient, corrections, rates),
                (_, 12) => step_alike::<T, 12>(column, rows, gradient, corrections, rates),
                (_, 27) => step_alike::<T, 27>(column, rows, gradient, corrections, rates),
                (_, 48) => step_alike::<T, 48>(column, rows, gradient, corrections, rates),
                (_, length) => unreachable!("no column has {length} numbers a row"),
            }
        }
    }

    /// Counts the gradients of `rows` and returns their bias corrections, and in a fit that goes on from an earlier one the
    /// corrections for the columns of time apart. The first correction has the share of the row, because a factor of it is
    /// one of the step.
    fn corrections(&mut self, rows: &[usize], usable: &[bool]) -> (Corrections<T>, Option<Corrections<T>>) {
        let correction = |(row, usable): (&usize, &bool)| {
            let visits = &mut self.visits[*row];
            *visits = visits.saturating_add(u32::from(*usable));
            let corrections = CORRECTIONS[(*visits as usize).min(CORRECTIONS.len() - 1)];
            usable.then(|| corrections.map(T::from_f64))
        };
        let all: Corrections<T> = rows.iter().zip(usable).map(correction).collect();
        if self.carried.is_empty() {
            return (all, None);
        }
        let shared = |share: fn(Carried) -> f32| -> Corrections<T> {
            let of_row = |(correction, row): (&Option<[T; 2]>, &usize)| {
                let share = T::from_f64(share(self.carried[*row]).into());
                correction.map(|[first, second]| [share * first, second])
            };
            all.iter().zip(rows).map(of_row).collect()
        };
        (shared(Carried::share_of_rates), Some(shared(Carried::share_of_time)))
    }
}

/// One column of consecutive rows with its moments.
struct Column<'a, T> {
    values: &'a mut [T],
    first: &'a mut [T],
    second: &'a mut [T],
}

/// Steps a column of `N` numbers per row, whose rates are the same in each row.
fn step_alike<T: Real, const N: usize>(
    column: Column<T>,
    rows: &[usize],
    gradient: &[T],
    corrections: &[Option<[T; 2]>],
    rates: &[T],
) {
    let rates: [T; N] = rates.try_into().expect("a rate for each number");
    step(column, rows, gradient, corrections, |_| rates);
}

/// Steps a column of `N` numbers per row: row `i` of `rows` at `rates(i)`.
fn step<T: Real, const N: usize>(
    Column { values, first, second }: Column<T>,
    rows: &[usize],
    gradient: &[T],
    corrections: &[Option<[T; 2]>],
    rates: impl Fn(usize) -> [T; N],
) {
    let [beta1, beta2, epsilon] = [BETA1, BETA2, EPSILON].map(T::from_f64);
    let [rest1, rest2] = [T::from_f64(1.0 - BETA1), T::from_f64(1.0 - BETA2)];
    let [values, first, second] = [values, first, second].map(|column| column.as_chunks_mut::<N>().0);
    for (i, ((row, g), correction)) in
        rows.iter().zip(gradient.as_chunks::<N>().0).zip(corrections).enumerate()
    {
        let Some([bias1, bias2]) = correction else { continue };
        let rates = rates(i);
        // Copies: the compiler knows that they do not overlap.
        let (mut value, mut mean, mut square) = (values[*row], first[*row], second[*row]);
        for k in 0..N {
            mean[k] = beta1 * mean[k] + rest1 * g[k];
            square[k] = beta2 * square[k] + rest2 * g[k] * g[k];
            value[k] -= rates[k] * (mean[k] * *bias1) / ((square[k] * *bias2).sqrt() + epsilon);
        }
        (values[*row], first[*row], second[*row]) = (value, mean, square);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::parameters::Timeline;

    fn parameters<T: Real>(rows: usize) -> Parameters<T> {
        let at = |i: usize| T::from_f64(i as f64);
        Parameters {
            centers: (0..rows).map(|i| [at(i), T::zero(), T::one()]).collect(),
            rotations: vec![[T::one(), T::zero(), T::zero(), T::zero()]; rows],
            log_scales: vec![[T::from_f64(-3.0); 3]; rows],
            logits: vec![T::zero(); rows],
            sh_degree: 1,
            sh: vec![[T::zero(); 3]; 4 * rows],
            tau: vec![T::from_f64(2.0); rows],
            log_widths: vec![T::from_f64(0.5); rows],
            filter: codec::PixelFilter::default(),
            near: 0.0,
            behind: Vec::new(),
            motion_order: 2,
            motion: vec![[T::zero(); 3]; 2 * rows],
            rotation_rates: vec![[T::zero(); 4]; rows],
        }
    }

    fn bounds() -> Bounds {
        Bounds::new(1.0, Timeline::even(9))
    }

    fn run<T: Real>(
        all: &mut Parameters<T>,
        moments: &mut Moments<T>,
        rows: &[u32],
        gradient: &Parameters<T>,
    ) -> usize {
        let rates = LearningRates::new(1.0, Timeline::even(9), all);
        adam(all, moments, rows, gradient, &rates, &bounds())
    }

    /// Among rows that stay, one that comes and goes still learns to move, and they still learn to: windows of 0.5, 1 and
    /// infinitely many intervals reach 1.5, 3 and, in a clip of 8, 4 intervals far.
    #[test]
    fn the_motion_of_each_row_steps_by_the_reach_of_its_window() {
        let mut all = parameters::<f64>(4);
        all.log_widths = vec![0.5_f64.ln(), 0.0, f64::INFINITY, f64::INFINITY];
        let mut moments = Moments::new(&all);
        let mut gradient = all.zeros(3);
        gradient.motion.fill([0.5; 3]);
        gradient.log_widths.fill(0.5);
        assert_eq!(run(&mut all, &mut moments, &[0, 1, 3], &gradient), 0);
        let center = LearningRates::new(1.0, Timeline::even(9), &all).centers;
        for (row, reach) in [(0, 1.5), (1, 3.0), (3, 4.0)] {
            for (order, c) in all.motion[2 * row..][..2].iter().enumerate() {
                let expected = -center / f64::powi(reach, order as i32 + 1);
                assert!(c.iter().all(|c| (c - expected).abs() < 1e-12), "{row}: {c:?}, not {expected}");
            }
        }
        assert_eq!(all.motion[4], [0.0; 3], "it was not drawn");
    }

    /// A gradient of 0.5 and then of -1, by hand: the first moments are 0.05 and -0.055, the second
    /// 0.00025 and 0.00124975; corrected, the steps are 1 and
    /// -0.055 / 0.19 / sqrt(0.00124975 / 0.001999) = -0.3661.
    #[test]
    fn two_steps_are_those_computed_by_hand() {
        let mut all = parameters::<f64>(3);
        let mut moments = Moments::new(&all);
        let mut gradient = all.zeros(1);
        gradient.logits[0] = 0.5;
        gradient.sh[1] = [0.0, 0.5, 0.0];
        assert_eq!(run(&mut all, &mut moments, &[1], &gradient), 0);
        assert!((all.logits[1] + 0.05).abs() < 1e-12, "{}", all.logits[1]);
        gradient.logits[0] = -1.0;
        gradient.sh[1] = [0.0, -1.0, 0.0];
        run(&mut all, &mut moments, &[1], &gradient);
        let two = -0.1 + 0.036_610_352_703_584_27;
        assert!((all.logits[1] - 0.5 * two).abs() < 1e-12, "{}", all.logits[1]);
        // The rate of the other coefficients is a tenth of that.
        assert!((all.sh[5][1] - 0.05 * two).abs() < 1e-12, "{}", all.sh[5][1]);
        assert_eq!((moments.visits.clone(), all.logits[0], all.sh[4]), (vec![0, 2, 0], 0.0, [0.0; 3]));
        assert!((moments.first.logits[1] + 0.055).abs() < 1e-15);
        assert!((moments.second.logits[1] - 0.001_249_75).abs() < 1e-15);
    }

    #[test]
    fn the_first_gradient_of_a_row_makes_a_full_step() {
        let mut all = parameters::<f32>(2);
        let mut moments = Moments::new(&all);
        let mut gradient = all.zeros(1);
        gradient.tau[0] = 1e-9;
        for _ in 0..50 {
            run(&mut all, &mut moments, &[0], &gradient);
        }
        run(&mut all, &mut moments, &[1], &gradient);
        assert!((all.tau[1] - (2.0 - 1e-2)).abs() < 1e-6, "{}", all.tau[1]);
        assert_eq!(moments.visits, [50, 1]);
    }

    #[test]
    fn any_number_of_gradients_has_a_correction() {
        let mut all = parameters::<f64>(3);
        let mut moments = Moments::new(&all);
        moments.visits = vec![32_766, 40_000, u32::MAX];
        let mut gradient = all.zeros(3);
        gradient.logits.fill(1.0);
        run(&mut all, &mut moments, &[0, 1, 2], &gradient);
        assert_eq!(moments.visits, [32_767, 40_001, u32::MAX]);
        // Without a correction: 0.1 over the root of 0.001.
        let step = 0.05 * 0.1 / 0.001_f64.sqrt();
        assert!(all.logits.iter().all(|logit| (logit + step).abs() < 1e-12), "{:?}", all.logits);
    }

    #[test]
    fn a_static_field_moves() {
        let timed = parameters::<f64>(2);
        let mut all = Parameters {
            tau: Vec::new(),
            log_widths: Vec::new(),
            motion_order: 0,
            motion: Vec::new(),
            rotation_rates: Vec::new(),
            ..timed
        };
        let mut moments = Moments::new(&all);
        let mut gradient = all.zeros(1);
        gradient.logits[0] = 1.0;
        assert_eq!(run(&mut all, &mut moments, &[1], &gradient), 0);
        assert_eq!((all.logits[0], all.logits[1] < 0.0), (0.0, true));
    }

    #[test]
    fn steps_of_carried_rows_are_shorter_and_what_stands_still_keeps_its_time() {
        use crate::fit::parameters::STATIC_SHARE;
        let mut all = parameters::<f64>(3);
        let mut moments = Moments::new(&all);
        moments.carried = vec![
            Carried::NONE,
            Carried { share: 0.25, ..Carried::NONE },
            Carried { share: 0.5, is_static: true, ..Carried::NONE },
        ];
        let mut gradient = all.zeros(3);
        for column in gradient.columns_mut() {
            column.fill(1.0);
        }
        let before = all.clone();
        run(&mut all, &mut moments, &[0, 1, 2], &gradient);
        let columns = before.columns().into_iter().zip(all.columns()).enumerate();
        for (number, (before, after)) in columns {
            let per_row = before.len() / 3;
            let moved = |row: usize| before[row * per_row] - after[row * per_row];
            let of_static = if number >= TIME_COLUMN { 0.0 } else { 0.5 * f64::from(STATIC_SHARE) };
            assert!(moved(0) > 0.0, "column {number}");
            assert!((moved(1) - 0.25 * moved(0)).abs() < 1e-12, "column {number}");
            assert!((moved(2) - of_static * moved(0)).abs() < 1e-12, "column {number}");
        }
    }

    #[test]
    fn non_finite_gradients_are_skipped_and_counted() {
        let mut all = parameters::<f32>(4);
        let mut moments = Moments::new(&all);
        let mut gradient = all.zeros(4);
        gradient.centers = vec![[1.0, f32::NAN, 0.0], [f32::INFINITY; 3], [1e30; 3], [1e15, 0.0, 0.0]];
        let before = all.clone();
        assert_eq!(run(&mut all, &mut moments, &[0, 1, 2, 3], &gradient), 3);
        assert_eq!(
            (all.select(&[0, 1, 2]), &moments.visits[..]),
            (before.select(&[0, 1, 2]), &[0, 0, 0, 1][..])
        );
        assert_eq!(all.centers[3], [3.0 - 4.8e-4, 0.0, 1.0]);
        for _ in 0..20 {
            run(&mut all, &mut moments, &[0, 1, 2, 3], &gradient);
        }
        assert!(all.columns().iter().all(|column| column.iter().all(|x| x.is_finite())));
    }

    #[test]
    fn rows_are_projected_into_the_bounds() {
        let mut all = parameters::<f64>(2);
        let least = libm::log(0.5);
        all.log_widths = vec![least + 0.002; 2];
        let mut moments = Moments::new(&all);
        let mut gradient = all.zeros(1);
        gradient.log_widths[0] = 1.0;
        run(&mut all, &mut moments, &[1], &gradient);
        assert_eq!(all.log_widths, [least + 0.002, least]);
    }

    #[test]
    fn a_row_moves_the_same_alone_and_among_others() {
        let rows: Vec<u32> = (0..5000).filter(|i| i % 3 != 1).collect();
        let mut all = parameters::<f32>(5000);
        let mut moments = Moments::new(&all);
        let mut gradient = all.zeros(rows.len());
        for (g, row) in gradient.centers.iter_mut().zip(&rows) {
            *g = [*row as f32 - 2500.0, 0.0, 1e-7];
        }
        moments.carried =
            (0..5000).map(|i| Carried { share: 1.0 / (1 + i % 7) as f32, ..Carried::NONE }).collect();
        let (mut one, mut one_moments) = (all.select(&[4001]), moments.select(&[4001]));
        let at = rows.iter().position(|row| *row == 4001).unwrap();
        for _ in 0..3 {
            run(&mut all, &mut moments, &rows, &gradient);
            run(&mut one, &mut one_moments, &[0], &gradient.select(&[at]));
        }
        assert_eq!((all.select(&[4001]), moments.select(&[4001])), (one, one_moments));
        assert_eq!(all.centers[4000], parameters::<f32>(5000).centers[4000]);
    }

    #[test]
    fn moments_follow_their_rows() {
        let all = parameters::<f64>(2);
        let mut moments = Moments::new(&all);
        let mut gradient = all.zeros(2);
        gradient.logits = vec![1.0, 2.0];
        run(&mut all.clone(), &mut moments, &[0, 1], &gradient);
        let mut changed = moments.select(&[1, 0, 1]);
        assert_eq!(changed.visits, [1, 1, 1]);
        assert_eq!(
            changed.first.logits,
            [moments.first.logits[1], moments.first.logits[0], moments.first.logits[1]]
        );
        changed.clear(2);
        assert_eq!(changed.select(&[0, 1]), moments.select(&[1, 0]));
        assert_eq!(changed.select(&[2]), Moments::new(&all).select(&[0]));
        let mut none = Parameters::<f64>::default();
        let mut no_moments = Moments::new(&none);
        assert_eq!(
            adam(
                &mut none,
                &mut no_moments,
                &[],
                &Parameters::default(),
                &LearningRates::new(1.0, Timeline::even(9), &Parameters::<f64>::default()),
                &bounds()
            ),
            0
        );
    }
}
