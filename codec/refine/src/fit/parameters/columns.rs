//! [`Parameters`]: what a fit optimises, in well-conditioned form.
//!
//! A field's opacities and widths are bounded, its scales are ratios, its motion is per clip. Here
//! opacities are logits, widths and scales are logarithms, and time is in intervals (see [`Timeline`]), so
//! that a motion coefficient is a length: the distance that a Gaussian moves within an interval.

use std::ops::Range;

use codec::{Field, MOTION_ORDER_MAX, PixelFilter, SH_DEGREE_MAX, Temporal, sh_coefficients};
use serde::{Deserialize, Serialize};

use super::Timeline;
use crate::raster::Real;

/// Largest logit of an opacity: beyond `sigmoid(7)` the gradient is too small to return.
pub(in crate::fit) const LOGIT_MAX: f64 = 7.0;

/// Number of columns of [`Parameters`].
pub(in crate::fit) const COLUMNS: usize = 9;

/// The parameters of a fit, a gradient with respect to them, or Adam's moments of them. Row `i` of each
/// column is Gaussian `i`; a column that the scene does not need is empty.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Parameters<T> {
    /// Centres at `tau`, in units of the capture.
    pub centers: Vec<[T; 3]>,
    /// Quaternions w, x, y, z of any non-zero length.
    pub rotations: Vec<[T; 4]>,
    /// Natural logarithms of the standard deviations along the axes.
    pub log_scales: Vec<[T; 3]>,
    /// Peak opacities before the sigmoid.
    pub logits: Vec<T>,
    /// Degree of the spherical harmonics, 0 to 3.
    pub sh_degree: u8,
    /// Spherical harmonics coefficients as in [`Field::sh`].
    pub sh: Vec<[T; 3]>,
    /// The filter that the Gaussians are drawn with; not optimised.
    pub filter: PixelFilter,
    /// Depth from which on the Gaussians are drawn whole, as [`Field::near`]; not optimised.
    pub near: f64,
    /// Whether each is drawn behind all others, as a plate is; empty if none is. Not optimised.
    pub behind: Vec<bool>,
    /// Window centres in intervals; empty for a scene without time.
    pub tau: Vec<T>,
    /// Natural logarithms of the window widths in intervals; empty for a scene without time.
    pub log_widths: Vec<T>,
    /// Highest power of time in the trajectories, 0 to 3.
    pub motion_order: u8,
    /// `c1, c2, c3` of the trajectories `mu + c1 d + c2 d^2 + c3 d^3`, with `d` in intervals since `tau`:
    /// `[gaussian][power - 1]`, flattened.
    pub motion: Vec<[T; 3]>,
    /// Rates of the quaternions per interval, as in [`Temporal::rotation_rates`]; empty if no Gaussian
    /// rotates.
    pub rotation_rates: Vec<[T; 4]>,
}

impl<T: Real> Parameters<T> {
    /// Number of Gaussians.
    pub fn len(&self) -> usize {
        self.centers.len()
    }

    /// Whether there are no Gaussians.
    pub fn is_empty(&self) -> bool {
        self.centers.is_empty()
    }

    /// Whether the columns have lengths that match the number of rows, the degree and the order.
    pub fn is_consistent(&self) -> bool {
        let rows = self.len();
        let per_row = |length: usize, each: usize| length == rows * each;
        let absent_or = |length: usize| length == 0 || length == rows;
        self.sh_degree <= SH_DEGREE_MAX
            && self.motion_order <= MOTION_ORDER_MAX
            && per_row(self.rotations.len(), 1)
            && per_row(self.log_scales.len(), 1)
            && per_row(self.logits.len(), 1)
            && per_row(self.sh.len(), sh_coefficients(self.sh_degree))
            && absent_or(self.tau.len())
            && self.log_widths.len() == self.tau.len()
            && per_row(self.motion.len(), usize::from(self.motion_order))
            && absent_or(self.rotation_rates.len())
            && absent_or(self.behind.len())
    }

    /// Whether the columns are consistent and as long as the columns of `other`.
    pub fn has_shape_of(&self, other: &Parameters<T>) -> bool {
        self.is_consistent()
            && self.len() == other.len()
            && (self.sh_degree, self.motion_order) == (other.sh_degree, other.motion_order)
            && self.tau.len() == other.tau.len()
            && self.rotation_rates.len() == other.rotation_rates.len()
    }

    /// `rows` rows of zeros with the columns of `self`.
    pub fn zeros(&self, rows: usize) -> Parameters<T> {
        let z = T::zero();
        let if_timed = |count: usize| if self.tau.is_empty() { 0 } else { count };
        Parameters {
            centers: vec![[z; 3]; rows],
            rotations: vec![[z; 4]; rows],
            log_scales: vec![[z; 3]; rows],
            logits: vec![z; rows],
            sh_degree: self.sh_degree,
            sh: vec![[z; 3]; rows * sh_coefficients(self.sh_degree)],
            filter: self.filter,
            near: self.near,
            behind: vec![false; if self.behind.is_empty() { 0 } else { rows }],
            tau: vec![z; if_timed(rows)],
            log_widths: vec![z; if_timed(rows)],
            motion_order: self.motion_order,
            motion: vec![[z; 3]; rows * usize::from(self.motion_order)],
            rotation_rates: vec![[z; 4]; if self.rotation_rates.is_empty() { 0 } else { rows }],
        }
    }

    /// The parameters of a field. Opacities are clamped to logits within 7 of 0, windows to a width of 1e6
    /// clips.
    pub fn from_field(field: &Field, timeline: Timeline) -> Parameters<T> {
        let convert = |x: f32| T::from_f64(f64::from(x));
        let per_clip = timeline.intervals;
        let logit = |o: f32| {
            let o = f64::from(o);
            T::from_f64(libm::log(o / (1.0 - o)).clamp(-LOGIT_MAX, LOGIT_MAX))
        };
        let temporal = field.temporal.clone().unwrap_or_default();
        let order = usize::from(temporal.motion_order);
        let scaled = |(i, v): (usize, &[f32; 3])| {
            let scale = per_clip.powi(-((i % order) as i32 + 1));
            v.map(|x| T::from_f64(f64::from(x) * scale))
        };
        let width = |s: &f32| T::from_f64(libm::log(f64::from(*s).min(1e6) * per_clip));
        let rate = |q: &[f32; 4]| q.map(|x| T::from_f64(f64::from(x) / per_clip));
        Parameters {
            centers: field.centers.iter().map(|x| x.map(convert)).collect(),
            rotations: field.rotations.iter().map(|q| q.map(convert)).collect(),
            log_scales: field.log_scales.iter().map(|s| s.map(convert)).collect(),
            logits: field.opacities.iter().map(|o| logit(*o)).collect(),
            sh_degree: field.sh_degree,
            sh: field.sh.iter().map(|c| c.map(convert)).collect(),
            filter: field.filter,
            near: f64::from(field.near),
            behind: Vec::new(),
            tau: temporal.tau.iter().map(|t| T::from_f64(f64::from(*t) * per_clip)).collect(),
            log_widths: temporal.s.iter().map(width).collect(),
            motion_order: temporal.motion_order,
            motion: temporal.motion.iter().enumerate().map(scaled).collect(),
            rotation_rates: temporal.rotation_rates.iter().flatten().map(rate).collect(),
        }
    }

    /// The field of these parameters, its quaternions normalised.
    pub fn to_field(&self, timeline: Timeline) -> Field {
        let single = |x: T| x.to_double() as f32;
        let per_clip = timeline.intervals;
        let opacity = |a: &T| (1.0 / (1.0 + libm::exp(-a.to_double()))) as f32;
        let order = usize::from(self.motion_order);
        let scaled = |(i, c): (usize, &[T; 3])| {
            let scale = per_clip.powi((i % order) as i32 + 1);
            c.map(|x| (x.to_double() * scale) as f32)
        };
        let unit = |q: &[T; 4]| {
            let q = q.map(T::to_double);
            let norm = q.iter().map(|x| x * x).sum::<f64>().sqrt();
            q.map(|x| (x / norm) as f32)
        };
        // A field's rates are relative to the unit quaternion.
        let rate = |(q, rate): (&[T; 4], &[T; 4])| {
            let norm = q.iter().map(|x| x.to_double().powi(2)).sum::<f64>().sqrt();
            rate.map(|x| (x.to_double() * per_clip / norm) as f32)
        };
        let temporal = (!self.tau.is_empty()).then(|| Temporal {
            tau: self.tau.iter().map(|u| (u.to_double() / per_clip) as f32).collect(),
            s: self.log_widths.iter().map(|w| (libm::exp(w.to_double()) / per_clip) as f32).collect(),
            motion_order: self.motion_order,
            motion: self.motion.iter().enumerate().map(scaled).collect(),
            rotation_rates: (!self.rotation_rates.is_empty())
                .then(|| self.rotations.iter().zip(&self.rotation_rates).map(rate).collect()),
        });
        Field {
            centers: self.centers.iter().map(|x| x.map(single)).collect(),
            rotations: self.rotations.iter().map(unit).collect(),
            log_scales: self.log_scales.iter().map(|s| s.map(single)).collect(),
            opacities: self.logits.iter().map(opacity).collect(),
            sh_degree: self.sh_degree,
            sh: self.sh.iter().map(|c| c.map(single)).collect(),
            filter: self.filter,
            near: self.near as f32,
            temporal,
        }
    }

    /// Copies `rows`, in that order; a row may occur more than once.
    pub fn select(&self, rows: &[usize]) -> Parameters<T> {
        let mut selected = self.zeros(rows.len());
        let count = self.len().max(1);
        for (to, from) in selected.columns_mut().into_iter().zip(self.columns()) {
            let per_row = from.len() / count;
            for (to, row) in to.chunks_mut(per_row.max(1)).zip(rows) {
                to.copy_from_slice(&from[row * per_row..(row + 1) * per_row]);
            }
        }
        selected.behind = rows.iter().filter_map(|row| self.behind.get(*row).copied()).collect();
        selected
    }

    /// Appends the rows of `other`, which has the same columns, filter and near distance.
    pub fn append(&mut self, other: Parameters<T>) {
        if !(self.behind.is_empty() && other.behind.is_empty()) {
            self.behind.resize(self.len(), false);
            self.behind.extend(&other.behind);
            self.behind.resize(self.len() + other.len(), false);
        }
        self.centers.extend(other.centers);
        self.rotations.extend(other.rotations);
        self.log_scales.extend(other.log_scales);
        self.logits.extend(other.logits);
        self.sh.extend(other.sh);
        self.tau.extend(other.tau);
        self.log_widths.extend(other.log_widths);
        self.motion.extend(other.motion);
        self.rotation_rates.extend(other.rotation_rates);
    }

    /// Whether a row is drawn behind all others.
    pub fn is_behind(&self, row: usize) -> bool {
        self.behind.get(row).is_some_and(|behind| *behind)
    }

    /// How far the window of a row reaches from its centre, in its widths: until the opacity falls below
    /// [`codec::ALPHA_MIN`]. 0 if it is never above that.
    pub fn support_radius(&self, row: usize) -> f64 {
        let opacity = 1.0 / (1.0 + libm::exp(-self.logits[row].to_double()));
        (2.0 * libm::log((opacity / codec::ALPHA_MIN).max(1.0))).sqrt()
    }

    /// Moves the window of a row to `tau`; its trajectory and rotation over time stay the same.
    pub(in crate::fit) fn center_window(&mut self, row: usize, tau: T) {
        let d = tau - self.tau[row];
        self.tau[row] = tau;
        let order = usize::from(self.motion_order);
        let motion = &mut self.motion[row * order..(row + 1) * order];
        for axis in 0..3 {
            let c: [T; 3] = std::array::from_fn(|power| motion.get(power).map_or(T::zero(), |c| c[axis]));
            let (two, three) = (T::from_f64(2.0), T::from_f64(3.0));
            self.centers[row][axis] += d * (c[0] + d * (c[1] + d * c[2]));
            let moved = [c[0] + d * (two * c[1] + three * d * c[2]), c[1] + three * d * c[2], c[2]];
            motion.iter_mut().zip(moved).for_each(|(c, moved)| c[axis] = moved);
        }
        if let Some(rate) = self.rotation_rates.get(row) {
            (0..4).for_each(|i| self.rotations[row][i] += d * rate[i]);
        }
    }

    /// The columns as flat slices, row after row: centres, rotations, log-scales, logits, spherical
    /// harmonics, `tau`, log-widths, motion, rotation rates.
    pub fn columns(&self) -> [&[T]; COLUMNS] {
        [
            self.centers.as_flattened(),
            self.rotations.as_flattened(),
            self.log_scales.as_flattened(),
            &self.logits,
            self.sh.as_flattened(),
            &self.tau,
            &self.log_widths,
            self.motion.as_flattened(),
            self.rotation_rates.as_flattened(),
        ]
    }

    /// [`columns`](Parameters::columns), mutable.
    pub fn columns_mut(&mut self) -> [&mut [T]; COLUMNS] {
        [
            self.centers.as_flattened_mut(),
            self.rotations.as_flattened_mut(),
            self.log_scales.as_flattened_mut(),
            &mut self.logits,
            self.sh.as_flattened_mut(),
            &mut self.tau,
            &mut self.log_widths,
            self.motion.as_flattened_mut(),
            self.rotation_rates.as_flattened_mut(),
        ]
    }

    /// [`columns_mut`](Parameters::columns_mut), split into parts of these numbers of rows.
    ///
    /// # Panics
    /// If there are fewer rows.
    pub(in crate::fit) fn parts_mut(
        &mut self,
        lengths: impl Iterator<Item = usize>,
    ) -> Vec<[&mut [T]; COLUMNS]> {
        let count = self.len().max(1);
        let mut rest = self.columns_mut();
        let per_row = rest.each_ref().map(|column| column.len() / count);
        let part = |rows: usize| {
            std::array::from_fn(|i| {
                rest[i].split_off_mut(..rows * per_row[i]).expect("columns have all rows")
            })
        };
        lengths.map(part).collect()
    }

    /// The columns of a row.
    pub(in crate::fit) fn row_mut(&mut self, row: usize) -> [&mut [T]; COLUMNS] {
        let count = self.len();
        self.columns_mut().map(|column| {
            let range = row_range(column.len(), count, row);
            &mut column[range]
        })
    }

    /// Whether all numbers of a row are finite.
    pub(in crate::fit) fn is_finite(&self, row: usize) -> bool {
        self.all_in_row(row, |x| x.is_finite())
    }

    /// Whether all numbers of a row satisfy `predicate`.
    pub(in crate::fit) fn all_in_row(&self, row: usize, predicate: impl Fn(T) -> bool) -> bool {
        let count = self.len();
        self.columns()
            .iter()
            .all(|column| column[row_range(column.len(), count, row)].iter().all(|x| predicate(*x)))
    }
}

/// Where the numbers of a row are in a column of this length and `count` rows.
fn row_range(length: usize, count: usize, row: usize) -> Range<usize> {
    let per_row = length / count;
    row * per_row..(row + 1) * per_row
}

/// A row of the columns of `count` rows.
pub(in crate::fit) fn row_of<'a, T>(
    columns: &'a mut [&mut [T]; COLUMNS],
    count: usize,
    row: usize,
) -> [&'a mut [T]; COLUMNS] {
    columns.each_mut().map(|column| {
        let range = row_range(column.len(), count, row);
        &mut column[range]
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn field() -> Field {
        Field {
            centers: vec![[1.0, 2.0, 3.0], [-4.0, 0.5, 0.0]],
            rotations: vec![[1.0, 0.0, 0.0, 0.0], [0.0, 0.6, 0.0, 0.8]],
            log_scales: vec![[-3.0, -2.0, -1.0], [0.0, 0.1, 0.2]],
            opacities: vec![0.25, 0.9],
            sh_degree: 1,
            sh: (0..8).map(|i| [i as f32, 0.5, -0.25]).collect(),
            filter: PixelFilter::Mip,
            near: 0.5,
            temporal: Some(Temporal {
                tau: vec![0.25, 0.75],
                s: vec![0.125, 2.0],
                motion_order: 3,
                motion: (0..6).map(|i| [0.1 * i as f32, 1.0, -2.0]).collect(),
                rotation_rates: Some(vec![[0.0, 0.1, 0.2, 0.3]; 2]),
            }),
        }
    }

    #[test]
    fn a_field_survives_the_round_trip() {
        let timeline = Timeline::even(17);
        let back = Parameters::<f64>::from_field(&field(), timeline).to_field(timeline);
        for (i, t) in [(0, 0.0), (0, 0.3), (1, 0.8), (1, 1.0)] {
            for axis in 0..3 {
                let (a, b) = (field().position_at(i, t)[axis], back.position_at(i, t)[axis]);
                assert!((a - b).abs() < 1e-6, "{a} {b}");
            }
            assert!((field().opacity_at(i, t) - back.opacity_at(i, t)).abs() < 1e-6);
            for (a, b) in field().rotation_at(i, t).iter().zip(back.rotation_at(i, t)) {
                assert!((a - b).abs() < 1e-6);
            }
        }
        assert_eq!((back.sh, back.filter), (field().sh, PixelFilter::Mip));
        assert_eq!(back.log_scales, field().log_scales);
    }

    #[test]
    fn an_interval_is_the_unit_of_time() {
        let parameters = Parameters::<f64>::from_field(&field(), Timeline::even(17));
        assert_eq!(parameters.tau, [4.0, 12.0]);
        assert!((parameters.log_widths[0].exp() - 2.0).abs() < 1e-12);
        // Half a clip, 8 intervals, at the speed of c1.
        assert!((parameters.motion[0][1] * 16.0 - 1.0).abs() < 1e-12);
    }

    #[test]
    fn infinite_windows_and_extreme_opacities_stay_finite() {
        let mut always = field();
        always.temporal.as_mut().unwrap().s[0] = f32::INFINITY;
        always.opacities = vec![0.0, 1.0];
        let timeline = Timeline::even(17);
        let parameters = Parameters::<f32>::from_field(&always, timeline);
        assert_eq!(parameters.logits, [-LOGIT_MAX as f32, LOGIT_MAX as f32]);
        let back = parameters.to_field(timeline);
        assert!(back.check().is_ok());
        assert!((back.opacity_at(0, 1.0) / f64::from(back.opacities[0]) - 1.0).abs() < 1e-9);
    }

    #[test]
    fn rows_are_selected_and_appended() {
        let timeline = Timeline::even(17);
        let all = Parameters::<f32>::from_field(&field(), timeline);
        let mut selected = all.select(&[1]);
        selected.append(all.select(&[0]));
        assert_eq!(selected, all.select(&[1, 0]));
        assert_eq!(selected.select(&[1, 0]), all);
        assert_eq!(all.zeros(5).select(&[0, 0]), all.zeros(2));
    }
}
