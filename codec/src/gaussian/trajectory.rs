//! Windows and trajectories in coordinates in which errors are equally visible.
//!
//! A trajectory is expressed in polynomials about the centre of its Gaussian's alive interval,
//! orthogonal over that interval under the weight of the Gaussian's visibility: Legendre polynomials
//! for a wide window, Hermite polynomials for a narrow one, a blend in between. So the squared errors
//! of the coefficients add up, and each coefficient has the step of a position.

use crate::{
    ALPHA_MIN,
    rans::math::{self, Unit},
};

/// Window width in clip time above which its inverse square is coded, so that infinity has a code.
/// Format.
const WIDE: Unit = Unit::new(0.4);

/// Logarithm of the width of the narrowest window. Format.
const NARROWEST: f64 = -20.0;

/// Coarsest step of a width; finest and coarsest step of a window centre in clip time. Format.
const WIDTH_STEP_MAX: f64 = 0.3;
const CENTER_STEP: (f64, f64) = (1.0 / 1_048_576.0, 0.5);

/// Smallest half length of a span. Format.
const SPAN_MIN: f64 = 1e-4;

/// Folded width of code 0, always on.
fn widest() -> f64 {
    math::ln(WIDE.size) + 0.5
}

/// Quantisation step of window widths.
pub(super) fn width_step(step: f64) -> f64 {
    step.min(WIDTH_STEP_MAX)
}

/// The narrowest width that has a code of its own.
#[cfg(feature = "encode")]
pub(super) fn narrowest() -> f64 {
    math::exp(NARROWEST + 1.0)
}

/// The coded number of a window width; 0 for an infinite one.
#[cfg(feature = "encode")]
pub(super) fn width_number(s: f64) -> f64 {
    let folded = if s < WIDE.size {
        math::ln(s).max(NARROWEST + 1.0)
    } else {
        math::ln(WIDE.size) + 0.5 * (1.0 - (WIDE.size / s) * (WIDE.size / s))
    };
    widest() - folded
}

/// The window width of a coded number.
pub(super) fn width(number: f64) -> f64 {
    let folded = (widest() - number).max(NARROWEST);
    if folded < math::ln(WIDE.size) {
        return math::exp(folded);
    }
    let left = 1.0 - 2.0 * (folded - math::ln(WIDE.size));
    if left <= 1e-9 { f64::INFINITY } else { WIDE.size / left.sqrt() }
}

/// Quantisation step of the centre of a window of finite width `s`.
pub(super) fn center_step(s: f64, step: f64) -> f64 {
    (step * s * math::in_units(s, WIDE).max(1.0)).clamp(CENTER_STEP.0, CENTER_STEP.1)
}

/// The alive interval of a Gaussian, and orthogonal polynomials over it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Span {
    /// Centre and half length, in clip time.
    pub(super) center: f64,
    pub(super) half: Unit,
    /// Parameters of the polynomials 1, u, u^2 - a and u^3 - b u in `u = (t - center) / half`.
    a: f64,
    b: f64,
    /// Root mean squares of the polynomials.
    pub(super) size: [Unit; 4],
    /// Largest distance of the span from the window centre.
    pub(super) support_radius: f64,
}

impl Span {
    /// The span of a Gaussian with these decoded numbers.
    pub(super) fn new(opacity: f64, tau: f64, s: f64) -> Span {
        let support_radius =
            s * (2.0 * math::ln(math::in_units(opacity, const { Unit::new(ALPHA_MIN) })).max(0.0)).sqrt();
        // Infinity times zero is NaN, which max and min ignore.
        let (mut start, mut end) = ((tau - support_radius).max(0.0), (tau + support_radius).min(1.0));
        if start >= end {
            start = tau.clamp(0.0, 1.0);
            end = start;
        }
        let half = (0.5 * (end - start)).max(SPAN_MIN);
        let ratio = half / s;
        let narrow = ratio * ratio;
        // The means of u^2, u^4 and u^6 are a, a b and a b c. a, b, c are 1/3, 3/5, 5/7 over an evenly
        // visible span, and 1, 3, 5 halves of the squared width if the window is much narrower.
        let blend = |even: f64, multiple: Unit| {
            let far = math::in_units(narrow, multiple);
            1.0 / (1.0 / (even * even) + far * far).sqrt()
        };
        let (a, b, c) = (
            blend(1.0 / 3.0, const { Unit::new(0.5) }),
            blend(0.6, const { Unit::new(1.5) }),
            blend(5.0 / 7.0, const { Unit::new(2.5) }),
        );
        let quadratic = (a * b - a * a).max(1e-9);
        let cubic = (a * b * c - a * b * b).max(1e-9);
        Span {
            center: 0.5 * (start + end),
            half: Unit::new(half),
            a,
            b,
            size: [1.0, a.sqrt(), quadratic.sqrt(), cubic.sqrt()].map(Unit::new),
            support_radius: (start - tau).abs().max((end - tau).abs()),
        }
    }

    /// Converts a trajectory `p[0] + p[1] d + ...` in `d = t - tau` to coefficients of the orthogonal
    /// polynomials.
    #[cfg(feature = "encode")]
    pub(super) fn orthogonal(&self, p: [f64; 4], tau: f64) -> [f64; 4] {
        let (d, h) = (self.center - tau, self.half.size);
        let [p0, p1, p2, p3] = p;
        let c0 = p0 + d * (p1 + d * (p2 + d * p3));
        let c1 = (p1 + d * (2.0 * p2 + 3.0 * p3 * d)) * h;
        let c2 = (p2 + 3.0 * p3 * d) * h * h;
        let c3 = p3 * h * h * h;
        [c0 + c2 * self.a, c1 + c3 * self.b, c2, c3]
    }

    /// Converts back from `Span::orthogonal`.
    #[inline(always)]
    pub(super) fn powers(&self, c: [f64; 4], tau: f64) -> [f64; 4] {
        let d = tau - self.center;
        let h = self.half;
        let p0 = c[0] - c[2] * self.a;
        let p1 = math::in_units(c[1] - c[3] * self.b, h);
        let p2 = math::in_units(c[2], h.times(h));
        let p3 = math::in_units(c[3], h.times(h).times(h));
        [p0 + d * (p1 + d * (p2 + d * p3)), p1 + d * (2.0 * p2 + 3.0 * p3 * d), p2 + 3.0 * p3 * d, p3]
    }
}
