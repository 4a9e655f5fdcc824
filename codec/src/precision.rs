//! [`Precision`]: the fidelity of the coder `rans`, per package and per Gaussian.

use crate::{
    ALPHA_MIN, EncodeError, Field, PixelFilter, columns::Columns, order::is_static, sh_coefficients,
};

/// Fidelity of a package of the coder `rans`. The coder `fixed` has one fidelity and ignores it.
#[derive(Clone, Debug, PartialEq)]
pub struct Precision {
    /// Target PSNR in dB of pictures of the decoded field against pictures of the field. The result
    /// is within a few dB of it; for an exact PSNR render, compare and correct the target. Cut to 0
    /// to 160.
    pub psnr: f64,
    /// Standard deviation, in source units, to which a pixel blurs a point; finer detail is lost.
    /// By default the blur of a picture of 480 lines that the whole field fills.
    pub footprint: Option<f32>,
    /// Sensitivity of pictures to each Gaussian, in the order of the field. If empty, the default,
    /// it is estimated from size, opacity and duration.
    pub sensitivities: Vec<Sensitivity>,
    /// The same for the plate.
    pub plate_sensitivities: Vec<Sensitivity>,
}

impl Default for Precision {
    /// 50.7 dB: costs a field that fits its capture to 24.3 dB another 0.01 dB.
    fn default() -> Precision {
        Precision { psnr: 50.7, footprint: None, sensitivities: Vec::new(), plate_sensitivities: Vec::new() }
    }
}

/// Sensitivity of pictures to an error in a Gaussian: weights, as root mean squares over all pixels
/// of some pictures. Above 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sensitivity {
    /// Weight of the Gaussian's colour in a pixel: `alpha T`, with `T` the transmittance in front.
    pub color: f32,
    /// Effect of the Gaussian's geometry on a pixel: `alpha T` times the distance from the centre in
    /// standard deviations, times the difference between its colour and the colour behind it.
    pub geometry: f32,
}

/// Estimated ratio of the sensitivity to geometry and to colour: a usual difference between a
/// Gaussian's colour and the colour behind it.
const GEOMETRY_RATIO: f64 = 0.3;

/// Lines of the picture that estimates assume.
const LINES: f64 = 480.0;

/// Estimated standard deviation of a filter in pixels.
const fn deviation(filter: PixelFilter) -> f64 {
    match filter {
        PixelFilter::Blur => 0.55,
        PixelFilter::Mip => 0.32,
    }
}

/// Detail that the coder keeps of a field with this filter, relative to the footprint `f`. Scales `s` are coded as
/// `ln(s^2 + f^2)`, which is what blurring makes of them. Compensated opacity falls as `s / f` below the footprint.
/// The code would lose `f sqrt(2 step)` of it, a fifth of the opacity at a step of 0.02; with an eighth
/// of the footprint it is a fortieth, and detail is right up to 8 times the resolution.
const fn kept_detail(filter: PixelFilter) -> f32 {
    if filter.compensates() { 0.125 } else { 1.0 }
}

/// A field prepared for the coder `rans`, before it is cut into chunks.
#[derive(Debug)]
pub(crate) struct Prepared<'a> {
    pub(crate) field: &'a Field,
    /// One per row.
    pub(crate) sensitivities: Vec<Sensitivity>,
    /// Quantisation step of a colour at a sensitivity of 1.
    pub(crate) step: f64,
    /// See [`Precision::footprint`].
    pub(crate) footprint: f32,
}

impl Precision {
    /// Checks that the field, and the plate, each have no sensitivities or one per Gaussian; and the ranges of all numbers.
    pub(crate) fn check(&self, field: &Field, plate: Option<&Field>) -> Result<(), EncodeError> {
        let parts = [
            (&self.sensitivities, field.len(), ""),
            (&self.plate_sensitivities, plate.map_or(0, Field::len), " of the plate"),
        ];
        for (sensitivities, rows, part) in parts {
            let count = sensitivities.len();
            if count != 0 && count != rows {
                let reason = format!("{count} sensitivities for {rows} Gaussians{part}");
                return Err(EncodeError::Precision { reason });
            }
        }
        let positive = |x: f32| x.is_finite() && x > 0.0;
        let sensitivities = self.sensitivities.iter().chain(&self.plate_sensitivities);
        let numbers = sensitivities.flat_map(|s| [s.color, s.geometry]).chain(self.footprint);
        match numbers.into_iter().find(|x| !positive(*x)) {
            Some(x) => Err(EncodeError::Precision { reason: format!("{x} is not a positive number") }),
            None if self.psnr.is_nan() => Err(EncodeError::Precision { reason: "the PSNR is NaN".into() }),
            None => Ok(()),
        }
    }

    /// Prepares a field with these bounds.
    pub(crate) fn prepare<'a>(&self, field: &'a Field, bounds: [[f32; 3]; 2]) -> Prepared<'a> {
        self.prepared(field, bounds, &self.sensitivities)
    }

    /// Prepares the plate of a field with these bounds.
    pub(crate) fn prepare_plate<'a>(&self, plate: &'a Field, bounds: [[f32; 3]; 2]) -> Prepared<'a> {
        self.prepared(plate, bounds, &self.plate_sensitivities)
    }

    fn prepared<'a>(&self, field: &'a Field, bounds: [[f32; 3]; 2], known: &[Sensitivity]) -> Prepared<'a> {
        let sensitivities = match known {
            [] => estimated(field, bounds),
            known => known.to_vec(),
        };
        // Columns of zeros must not change the step.
        let rows: Vec<usize> = (0..field.len()).collect();
        let columns = Columns::nonzero(field, &rows, !rows.iter().all(|&i| is_static(field, i)));
        let motion = columns.temporal.map_or(0, |temporal| 2 + 3 * usize::from(temporal.motion_order));
        let numbers = field.len() * (10 + motion + 3 * sh_coefficients(columns.sh_degree));
        // As if the errors of all numbers were independent.
        let error = libm::pow(10.0, -0.05 * self.psnr.clamp(0.0, 160.0));
        let footprint =
            self.footprint.unwrap_or_else(|| (diagonal(bounds) * deviation(field.filter) / LINES) as f32)
                * kept_detail(field.filter);
        Prepared { field, sensitivities, step: (12.0 / numbers as f64).sqrt() * error, footprint }
    }
}

fn diagonal([low, high]: [[f32; 3]; 2]) -> f64 {
    (0..3).map(|axis| (f64::from(high[axis]) - f64::from(low[axis])).powi(2)).sum::<f64>().sqrt()
}

/// Estimates sensitivities from the area of each Gaussian on a picture that the field fills, its
/// opacity and its duration.
fn estimated(field: &Field, bounds: [[f32; 3]; 2]) -> Vec<Sensitivity> {
    // The diagonal of a point is zero.
    let size = diagonal(bounds).max(f64::from(f32::MIN_POSITIVE));
    (0..field.len())
        .map(|i| {
            let mut sigma = field.log_scales[i].map(|x| libm::exp(f64::from(x.min(40.0))) / size);
            sigma.sort_by(f64::total_cmp);
            let duration = field.alive_interval(i).map_or(0.0, |(start, end)| end - start);
            // From a hundredth of a pixel to the whole picture.
            let area = (sigma[1] * sigma[2]).clamp(0.01 / (LINES * LINES), 1.0);
            let opacity = f64::from(field.opacities[i]).max(ALPHA_MIN);
            let color = opacity * (area * duration.max(1e-3)).sqrt();
            Sensitivity { color: color as f32, geometry: (GEOMETRY_RATIO * color) as f32 }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Temporal;

    #[test]
    fn columns_of_zeros_do_not_change_the_step() {
        let bare = Field {
            centers: vec![[0.0; 3], [1.0; 3]],
            rotations: vec![[1.0, 0.0, 0.0, 0.0]; 2],
            log_scales: vec![[-2.0; 3]; 2],
            opacities: vec![0.5; 2],
            sh: vec![[0.3; 3]; 2],
            ..Field::default()
        };
        let temporal = Temporal { tau: vec![0.5; 2], s: vec![f32::INFINITY; 2], ..Temporal::default() };
        let mut wide = Field { sh_degree: 1, temporal: Some(temporal), ..bare.clone() };
        wide.sh = [[0.3; 3], [0.0; 3], [0.0; 3], [0.0; 3]].repeat(2);
        let bounds = bare.bounds();
        let step = |field: &Field| Precision::default().prepare(field, bounds).step.to_bits();
        assert_eq!(step(&wide), step(&bare));
        wide.sh[1] = [0.1; 3];
        assert_ne!(step(&wide), step(&bare));
    }
}
