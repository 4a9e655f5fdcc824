//! [`Precision`]: how exactly the coder `context` keeps a field, and where it may be less exact.

use crate::context::{Prepared, columns_needed};
use crate::encode::is_static;
use crate::{ALPHA_MIN, EncodeError, Field, sh_coefficients};

/// How exact a package is. The coder `fixed` has one precision and takes no notice.
#[derive(Clone, Debug, PartialEq)]
pub struct Precision {
    /// PSNR in dB to aim for, of pictures of the decoded field against pictures of the field.
    /// It is reached to within a few dB; who wants it exactly renders, compares and corrects it.
    pub psnr: f64,
    /// Standard deviation, in source units, of what a pixel blurs a point to: finer detail is not
    /// kept. By default a picture of 480 lines that the whole field fills.
    pub footprint: Option<f32>,
    /// How visible an error in each Gaussian is, in the order of the field. By default (empty)
    /// told from size, opacity and duration.
    pub sensitivities: Vec<Sensitivity>,
}

impl Default for Precision {
    /// 50.7 dB: the coding costs 0.01 dB of a field that fits its footage to 24.3 dB.
    fn default() -> Precision {
        Precision { psnr: 50.7, footprint: None, sensitivities: Vec::new() }
    }
}

/// How visible an error in a Gaussian is: root mean square over all pixels of some pictures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sensitivity {
    /// Of the weight that its colour has in a pixel, `alpha T`.
    pub color: f32,
    /// Of what its geometry does to a pixel: `alpha T` times the distance, in standard deviations,
    /// and times the difference between its colour and what is behind it.
    pub geometry: f32,
}

/// Sensitivities of the geometry are this fraction of those of the colour where nobody tells: a
/// usual difference between a Gaussian and what is behind it.
const CONTRAST: f64 = 0.3;

/// Lines of the picture that is told from the bounds, and the blur of a pixel in pixels.
const LINES: f64 = 480.0;
const BLUR: f64 = 0.55;

impl Precision {
    /// Checks that the sensitivities are those of the field.
    pub(crate) fn check(&self, field: &Field) -> Result<(), EncodeError> {
        let count = self.sensitivities.len();
        if count != 0 && count != field.len() {
            let reason = format!("{count} sensitivities for {} Gaussians", field.len());
            return Err(EncodeError::Precision { reason });
        }
        let positive = |x: f32| x.is_finite() && x > 0.0;
        let numbers = self.sensitivities.iter().flat_map(|s| [s.color, s.geometry]).chain(self.footprint);
        match numbers.into_iter().find(|x| !positive(*x)) {
            Some(x) => Err(EncodeError::Precision { reason: format!("{x} is not a positive number") }),
            None if self.psnr.is_nan() => Err(EncodeError::Precision { reason: "the PSNR is NaN".into() }),
            None => Ok(()),
        }
    }

    /// What the coder must know of the field.
    pub(crate) fn prepare<'a>(&self, field: &'a Field, bounds: [[f32; 3]; 2]) -> Prepared<'a> {
        let sensitivities = match self.sensitivities.is_empty() {
            true => told(field, bounds),
            false => self.sensitivities.clone(),
        };
        self.prepared(field, bounds, sensitivities)
    }

    /// What the coder must know of the plate behind a field with these bounds.
    pub(crate) fn prepare_plate<'a>(&self, plate: &'a Field, bounds: [[f32; 3]; 2]) -> Prepared<'a> {
        self.prepared(plate, bounds, told(plate, bounds))
    }

    fn prepared<'a>(
        &self,
        field: &'a Field,
        bounds: [[f32; 3]; 2],
        sensitivities: Vec<Sensitivity>,
    ) -> Prepared<'a> {
        // Columns that say nothing change nothing.
        let rows: Vec<usize> = (0..field.len()).collect();
        let columns = columns_needed(field, &rows, !rows.iter().all(|&i| is_static(field, i)));
        let motion = columns.temporal.map_or(0, |temporal| 2 + 3 * usize::from(temporal.motion_order));
        let numbers = field.len() * (10 + motion + 3 * sh_coefficients(columns.sh_degree));
        let error = libm::pow(10.0, -0.05 * self.psnr.clamp(0.0, 160.0));
        let footprint = self.footprint.unwrap_or_else(|| (diagonal(bounds) * BLUR / LINES) as f32);
        Prepared { field, sensitivities, step: (12.0 / numbers as f64).sqrt() * error, footprint }
    }
}

fn diagonal([low, high]: [[f32; 3]; 2]) -> f64 {
    (0..3).map(|axis| (f64::from(high[axis]) - f64::from(low[axis])).powi(2)).sum::<f64>().sqrt()
}

/// Sensitivities from the area of a Gaussian on a picture that the field fills, its opacity and
/// the time it is alive.
fn told(field: &Field, bounds: [[f32; 3]; 2]) -> Vec<Sensitivity> {
    // The diagonal of a point is zero.
    let size = diagonal(bounds).max(f64::from(f32::MIN_POSITIVE));
    (0..field.len())
        .map(|i| {
            let mut sigma = field.log_scales[i].map(|x| libm::exp(f64::from(x.min(40.0))) / size);
            sigma.sort_by(f64::total_cmp);
            let duration = field.alive_interval(i).map_or(0.0, |(start, end)| end - start);
            // No more than the whole picture, no less than a hundredth of a pixel.
            let area = (sigma[1] * sigma[2]).clamp(0.01 / (LINES * LINES), 1.0);
            let opacity = f64::from(field.opacities[i]).max(ALPHA_MIN);
            let color = opacity * (area * duration.max(1e-3)).sqrt();
            Sensitivity { color: color as f32, geometry: (CONTRAST * color) as f32 }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Temporal;

    #[test]
    fn columns_that_say_nothing_make_nothing_more_exact() {
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
        // What is said is not left out.
        wide.sh[1] = [0.1; 3];
        assert_ne!(step(&wide), step(&bare));
    }
}
