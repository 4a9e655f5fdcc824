//! Motions as Gaussians: temporal windows over the clip, each with a polynomial fitted by least squares.
//!
//! Within a window paths are parabolas. Gaussians that are always on sway along a cubic without a
//! quadratic term. So large and small coefficients never share a power, and a coder with one scale per
//! power preserves both.

use codec::{Field, Temporal};
use glam::{DMat3, DQuat, DVec3};

/// Width of a window (one standard deviation) relative to the distance between windows: opacities
/// of neighbours add up to nearly the same everywhere.
const WIDTH: f64 = 0.5;

/// Half the fitted part of a window, in standard deviations: beyond it the Gaussian is nearly invisible.
const WINDOW_SIGMAS: f64 = 3.0;

/// Powers of time in a window.
const WINDOW_POWERS: [usize; 3] = [0, 1, 2];

/// Powers of time of Gaussians that are always on.
const ALWAYS_POWERS: [usize; 3] = [0, 1, 3];

/// Instants at which a window is fitted.
const INSTANTS: usize = 21;

/// Largest root mean square deviation of a Gaussian that is always on, in metres.
const DEVIATION_WHOLE: f64 = 0.004;

/// The same for one with a window, weighted by the window: the largest deviations are faint.
const DEVIATION_WINDOW: f64 = 0.012;

/// Peak opacity of a Gaussian of a surface.
const OPACITY: f32 = 0.97;

/// Standard deviation along the surface, relative to the spacing.
const SPREAD: f64 = 0.64;

/// Standard deviation across the surface, relative to the spacing.
const THICKNESS: f64 = 0.12;

/// Position of a surfel at an instant, and its rotation from rest.
pub(super) struct SurfelPose {
    pub(super) position: DVec3,
    pub(super) rotation: DQuat,
}

/// A piece of the surface at rest.
pub(super) struct Surfel<'a> {
    pub(super) normal: DVec3,
    /// Distance of the neighbours in metres.
    pub(super) spacing: f64,
    /// Display-referred colour for a normal.
    pub(super) color: &'a dyn Fn(DVec3) -> DVec3,
}

/// Equal windows that cover the clip.
pub(super) struct Windows {
    /// Centres in clip time.
    centers: Vec<f64>,
    /// Standard deviation in clip time.
    width: f64,
    /// Largest deviation that this number of windows may have, in metres.
    tolerance: f64,
    /// Instants relative to the centre, and the weights of their deviations.
    instants: Vec<(f64, f64)>,
    /// Coefficients of powers 0 to 3 from the values at the instants.
    solve: [[f64; INSTANTS]; 4],
}

impl Windows {
    /// One window, open all the time.
    pub(super) fn whole() -> Windows {
        let instants = (0..INSTANTS).map(|i| ((i as f64 + 0.5) / INSTANTS as f64 - 0.5, 1.0)).collect();
        Windows::new(vec![0.5], f64::INFINITY, DEVIATION_WHOLE, ALWAYS_POWERS, instants)
    }

    /// `count` windows in the clip, and one before and after it, so that the end looks like the
    /// start to which a player jumps back.
    pub(super) fn periodic(count: usize) -> Windows {
        let width = WIDTH / count as f64;
        let instants = (0..INSTANTS).map(|i| {
            let z = WINDOW_SIGMAS * (2.0 * i as f64 / (INSTANTS - 1) as f64 - 1.0);
            (z * width, (-z * z / 4.0).exp())
        });
        let centers = (0..count + 2).map(|k| (k as f64 - 0.5) / count as f64).collect();
        Windows::new(centers, width, DEVIATION_WINDOW, WINDOW_POWERS, instants.collect())
    }

    fn new(
        centers: Vec<f64>,
        width: f64,
        tolerance: f64,
        powers: [usize; 3],
        instants: Vec<(f64, f64)>,
    ) -> Windows {
        // Weighted normal equations in d / scale, solved for unit values at each instant in turn.
        let scale = instants[INSTANTS - 1].0;
        let power = |d: f64, exponent: usize| (d / scale).powi(exponent as i32);
        let normal = powers.map(|r| {
            powers.map(|c| instants.iter().map(|&(d, weight)| weight * power(d, r + c)).sum::<f64>())
        });
        let inverse = DMat3::from_cols_array_2d(&normal).inverse();
        let mut solve = [[0.0; INSTANTS]; 4];
        for (i, &(d, weight)) in instants.iter().enumerate() {
            let coefficients = inverse * (weight * DVec3::from_array(powers.map(|c| power(d, c))));
            for (exponent, coefficient) in powers.into_iter().zip(coefficients.to_array()) {
                solve[exponent][i] = coefficient / scale.powi(exponent as i32);
            }
        }
        Windows { centers, width, tolerance, instants, solve }
    }

    /// Fitted instants of each window, in clip time.
    pub(super) fn instants(&self) -> impl Iterator<Item = impl Iterator<Item = f64>> {
        self.centers.iter().map(|center| self.instants.iter().map(move |(d, _)| center + d))
    }

    /// The polynomial near the positions at the instants of a window, and its weighted root mean
    /// square deviation.
    fn fit(&self, positions: &[DVec3; INSTANTS]) -> ([DVec3; 4], f64) {
        let path: [DVec3; 4] = self.solve.map(|row| row.iter().zip(positions).map(|(s, p)| *s * *p).sum());
        let (mut squares, mut weights) = (0.0, 0.0);
        for (&(d, weight), p) in self.instants.iter().zip(positions) {
            let fitted = path[0] + d * (path[1] + d * (path[2] + d * path[3]));
            squares += weight * (fitted - *p).length_squared();
            weights += weight;
        }
        (path, (squares / weights).sqrt())
    }

    /// Quaternion at the centre of a window, and its rate: a weighted linear fit.
    fn fit_rotation(&self, rotations: &[DQuat; INSTANTS]) -> (DQuat, DQuat) {
        let reference = rotations[INSTANTS / 2];
        let zero = DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0);
        let (mut sum, mut moment, mut weights, mut inertia) = (zero, zero, 0.0, 0.0);
        for (&(d, weight), q) in self.instants.iter().zip(rotations) {
            let q = *q * q.dot(reference).signum();
            sum += q * weight;
            moment += q * (weight * d);
            weights += weight;
            inertia += weight * d * d;
        }
        let (q, rate) = (sum * (1.0 / weights), moment * (1.0 / inertia));
        let length = q.length();
        (q * (1.0 / length), rate * (1.0 / length))
    }
}

/// A field in the making.
#[derive(Default)]
pub(super) struct Gaussians {
    rows: Vec<Row>,
}

struct Row {
    center: DVec3,
    rotation: DQuat,
    scales: DVec3,
    opacity: f32,
    color: DVec3,
    tau: f64,
    s: f64,
    motion: [DVec3; 3],
    rate: DQuat,
}

impl Gaussians {
    /// Adds a Gaussian that never moves: standard deviations `scales` along the axes that
    /// `rotation` turns.
    pub(super) fn push_static(&mut self, center: DVec3, rotation: DQuat, scales: DVec3, color: DVec3) {
        self.rows.push(Row {
            center,
            rotation,
            scales,
            opacity: OPACITY,
            color,
            tau: 0.0,
            s: f64::INFINITY,
            motion: [DVec3::ZERO; 3],
            rate: DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0),
        });
    }

    /// Adds a disc on a surface that never moves.
    pub(super) fn push_static_surfel(&mut self, point: DVec3, normal: DVec3, spacing: f64, color: DVec3) {
        self.push_static(point, facing(normal), disc(spacing), color);
    }

    /// Adds a moving surfel, with the first set of windows whose paths deviate little enough, or the
    /// last. `place(set, window, instant)` is its pose.
    pub(super) fn push_fitted(
        &mut self,
        surfel: &Surfel,
        sets: &[Windows],
        place: &dyn Fn(usize, usize, usize) -> SurfelPose,
    ) {
        let (set, paths) = fit_first(sets, place);
        let windows = &sets[set];
        let at_rest = facing(surfel.normal);
        for (window, path) in paths.into_iter().enumerate() {
            let is_static = windows.width.is_infinite() && path[1..].iter().all(|v| v.length() < 1e-6);
            if is_static {
                let color = (surfel.color)(surfel.normal);
                return self.push_static(path[0], at_rest, disc(surfel.spacing), color);
            }
            let (turn, mut rate) =
                windows.fit_rotation(&std::array::from_fn(|i| place(set, window, i).rotation));
            if windows.width.is_infinite() {
                // An oscillating rotation has no mean rate.
                rate = DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0);
            }
            self.rows.push(Row {
                center: path[0],
                rotation: turn * at_rest,
                scales: disc(surfel.spacing),
                opacity: OPACITY,
                color: (surfel.color)(turn * surfel.normal),
                tau: windows.centers[window],
                s: windows.width,
                motion: [path[1], path[2], path[3]],
                rate: rate * at_rest,
            });
        }
    }

    /// Adds a soft shadow of this radius and opacity on the floor.
    pub(super) fn push_shadow(
        &mut self,
        radius: f64,
        opacity: f32,
        sets: &[Windows],
        place: &dyn Fn(usize, usize, usize) -> SurfelPose,
    ) {
        let (set, paths) = fit_first(sets, place);
        for (window, path) in paths.into_iter().enumerate() {
            self.rows.push(Row {
                center: path[0],
                rotation: facing(DVec3::Y),
                scales: DVec3::new(radius, radius, 0.002),
                opacity,
                color: DVec3::splat(0.05),
                tau: sets[set].centers[window],
                s: sets[set].width,
                motion: [path[1], path[2], path[3]],
                rate: DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0),
            });
        }
    }

    /// The finished field, of SH degree 0 and motion order 3.
    pub(super) fn into_field(self) -> Field {
        let rows = &self.rows;
        let single = |v: DVec3| v.as_vec3().to_array();
        let quaternion = |q: DQuat| [q.w, q.x, q.y, q.z].map(|c| c as f32);
        // 0.5 + Y_0 c is the colour, and Y_0 = 1 / (2 sqrt(pi)).
        let constant = |color: DVec3| single((color - 0.5) * 2.0 * std::f64::consts::PI.sqrt());
        Field {
            centers: rows.iter().map(|row| single(row.center)).collect(),
            rotations: rows.iter().map(|row| quaternion(row.rotation)).collect(),
            log_scales: rows.iter().map(|row| single(row.scales.map(f64::ln))).collect(),
            opacities: rows.iter().map(|row| row.opacity).collect(),
            sh_degree: 0,
            sh: rows.iter().map(|row| constant(row.color)).collect(),
            temporal: Some(Temporal {
                tau: rows.iter().map(|row| row.tau as f32).collect(),
                s: rows.iter().map(|row| row.s as f32).collect(),
                motion_order: 3,
                motion: rows.iter().flat_map(|row| row.motion.map(single)).collect(),
                rotation_rates: Some(rows.iter().map(|row| quaternion(row.rate)).collect()),
            }),
            ..Field::default()
        }
    }
}

/// Fits the sets in turn until no window deviates by more than its set allows. Returns the index of
/// that set, or of the last, and its paths.
fn fit_first(
    sets: &[Windows],
    place: &dyn Fn(usize, usize, usize) -> SurfelPose,
) -> (usize, Vec<[DVec3; 4]>) {
    let mut last = (0, Vec::new());
    for (set, windows) in sets.iter().enumerate() {
        let fits = (0..windows.centers.len())
            .map(|window| windows.fit(&std::array::from_fn(|i| place(set, window, i).position)));
        let (paths, deviations): (Vec<_>, Vec<_>) = fits.unzip();
        last = (set, paths);
        if deviations.into_iter().all(|deviation| deviation <= windows.tolerance) {
            break;
        }
    }
    last
}

/// The smallest rotation that turns the z axis to a normal.
fn facing(normal: DVec3) -> DQuat {
    DQuat::from_rotation_arc(DVec3::Z, normal)
}

/// Standard deviations of a flat Gaussian whose neighbours are `spacing` away.
fn disc(spacing: f64) -> DVec3 {
    DVec3::new(SPREAD, SPREAD, THICKNESS) * spacing
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polynomials_are_found_exactly() {
        let terms = [[1.0, 2.0, 3.0], [-1.0, 0.5, 0.0], [0.0, 4.0, 1.0], [9.0, 0.0, -7.0]];
        for (windows, powers) in [(Windows::whole(), ALWAYS_POWERS), (Windows::periodic(12), WINDOW_POWERS)] {
            let mut path = [DVec3::ZERO; 4];
            for power in powers {
                path[power] = DVec3::from_array(terms[power]);
            }
            let (fitted, deviation) = windows.fit(&std::array::from_fn(|i| {
                let d = windows.instants[i].0;
                path[0] + d * (path[1] + d * (path[2] + d * path[3]))
            }));
            assert!(deviation < 1e-12);
            for (a, b) in fitted.iter().zip(&path) {
                assert!((*a - *b).length() < 1e-9, "{a} for {b}");
            }
        }
    }

    #[test]
    fn a_steady_turn_is_followed() {
        let windows = Windows::periodic(12);
        let turn = |d: f64| DQuat::from_axis_angle(DVec3::Y, 0.3 + 5.0 * d);
        let (q, rate) = windows.fit_rotation(&std::array::from_fn(|i| turn(windows.instants[i].0)));
        for (d, _) in &windows.instants {
            let at = (q + rate * *d).normalize();
            assert!(at.dot(turn(*d)).abs().acos() < 0.01, "at {d}");
        }
    }

    #[test]
    fn opacities_of_the_windows_add_up_steadily() {
        let windows = Windows::periodic(9);
        for step in 0..=100 {
            let t = f64::from(step) / 100.0;
            let through: f64 = windows
                .centers
                .iter()
                .map(|c| 1.0 - f64::from(OPACITY) * (-0.5 * ((t - c) / windows.width).powi(2)).exp())
                .product();
            assert!(through < 0.18, "{through} of what is behind shows at {t}");
        }
    }
}
