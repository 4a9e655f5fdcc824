//! Errors of the coder `rans` at a requested precision.

use codec::{ALPHA_MIN, Clip, Coder, EncodeOptions, Field, Sensitivity};

use super::{options, package, source_row, valid_clip};

/// Options for this PSNR with equal sensitivities of all Gaussians. At 80 dB every number of a field
/// of at most 255 rows is exact to within 1e-3.
pub(crate) fn uniform(coder: Coder, field: &Field, psnr: f64, layers: &[usize]) -> EncodeOptions {
    let mut options = options(coder, layers);
    options.precision.psnr = psnr;
    options.precision.sensitivities = vec![Sensitivity { color: 1.0, geometry: 1.0 }; field.len()];
    options
}

/// Checks the clips of a field at the lowest, the default and the highest PSNR.
pub(crate) fn each_psnr(source: &Field, check: impl Fn(&Clip)) {
    for psnr in [0.0, 50.7, 160.0] {
        let mut options = options(Coder::Rans, &[]);
        options.precision.psnr = psnr;
        check(&valid_clip(&package(source, None, &options)));
    }
}

/// Covariance of a Gaussian with this rotation.
fn covariance(rotation: [f64; 4], log_scales: [f32; 3]) -> [[f64; 3]; 3] {
    let [w, x, y, z] = rotation;
    let r = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ];
    let v = log_scales.map(|s| f64::from(s).exp().powi(2));
    std::array::from_fn(|a| std::array::from_fn(|b| (0..3).map(|k| r[a][k] * v[k] * r[b][k]).sum()))
}

/// Largest errors at all times: of positions, colours and opacities, and of covariances relative to
/// the square of the largest scale.
#[derive(Debug, Default)]
pub(crate) struct Worst {
    pub(crate) position: f64,
    pub(crate) color: f64,
    pub(crate) opacity: f64,
    pub(crate) covariance: f64,
}

impl Worst {
    pub(crate) fn measure(decoded: &[&Field], source: &Field) -> Worst {
        let mut worst = Worst::default();
        for &field in decoded {
            (0..field.len()).for_each(|i| worst.compare(field, i, source, source_row(field, i)));
        }
        worst
    }

    pub(crate) fn compare(&mut self, decoded: &Field, i: usize, source: &Field, row: usize) {
        for step in 0..=20 {
            let t = f64::from(step) / 20.0;
            let opacity = source.opacity_at(row, t);
            self.opacity = self.opacity.max((decoded.opacity_at(i, t) - opacity).abs());
            if opacity < ALPHA_MIN {
                continue;
            }
            let (a, b) = (decoded.position_at(i, t), source.position_at(row, t));
            let distance = (0..3).map(|k| (a[k] - b[k]).abs()).fold(0.0, f64::max);
            self.position = self.position.max(distance);
            // The coder may permute the axes, so rotations are compared by covariance.
            let [a, b] = [(decoded, i), (source, row)]
                .map(|(field, i)| covariance(field.rotation_at(i, t), field.log_scales[i]));
            let scale = source.log_scales[row].iter().map(|s| f64::from(*s).exp()).fold(0.0, f64::max);
            for (a, b) in a.as_flattened().iter().zip(b.as_flattened()) {
                self.covariance = self.covariance.max((a - b).abs() / (scale * scale));
            }
        }
        for (a, b) in decoded.sh_of(i).as_flattened().iter().zip(source.sh_of(row).as_flattened()) {
            self.color = self.color.max(f64::from((a - b).abs()));
        }
    }

    #[track_caller]
    pub(crate) fn check(&self, bound: f64) {
        assert!(self.position <= 0.5 * bound, "{self:?}");
        assert!(self.color <= bound, "{self:?}");
        assert!(self.opacity <= bound, "{self:?}");
        assert!(self.covariance <= 2.0 * bound, "{self:?}");
    }
}
