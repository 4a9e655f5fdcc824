//! The Gaussians of a primitive: the names of their attributes, and [`Gaussians`], which reads them.

use codec::{Field, SH_DEGREE_MAX, sh_coefficients};
use serde_json::Value;

use crate::columns::{rgb_of_sh, sh_of_rgb};

use super::accessor::Column;
use super::buffers::Buffers;
use super::document::{Document, Primitive};

/// Name of the extension.
pub(super) const EXTENSION: &str = "KHR_gaussian_splatting";

/// Prefix of the attributes of the extension.
pub(super) const PREFIX: &str = "KHR_gaussian_splatting:";

/// Attributes: the first is glTF's own, the others have the prefix.
pub(super) const POSITION: &str = "POSITION";
pub(super) const ROTATION: &str = "ROTATION";
pub(super) const SCALE: &str = "SCALE";
pub(super) const OPACITY: &str = "OPACITY";

/// The kernel that is drawn.
pub(super) const KERNEL: &str = "ellipse";

/// The colour space of display-referred colours.
pub(super) const DISPLAY: &str = "srgb_rec709_display";

/// The colour space of linear colours.
const LINEAR: &str = "lin_rec709_display";

/// Names of the SH coefficients up to a degree, in the order of [`Field::sh`].
pub(super) fn sh_names(sh_degree: u8) -> impl Iterator<Item = String> {
    (0..=sh_degree).flat_map(|degree| (0..2 * degree + 1).map(move |k| sh_name(degree, k)))
}

fn sh_name(degree: u8, k: u8) -> String {
    format!("SH_DEGREE_{degree}_COEF_{k}")
}

/// What `SCALE` holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ScaleForm {
    /// Standard deviations.
    Linear,
    /// Their natural logarithms.
    Logarithm,
}

/// A primitive whose attributes were checked, except against the buffers.
pub(super) struct Gaussians<'d> {
    pub(super) rows: usize,
    pub(super) sh_degree: u8,
    /// Whether its colours are linear instead of display-referred.
    pub(super) is_linear: bool,
    /// Whether it has SH of a degree that is not read.
    pub(super) is_cut: bool,
    positions: Column<'d>,
    rotations: Column<'d>,
    scales: Column<'d>,
    opacities: Column<'d>,
    sh: Vec<Column<'d>>,
}

impl<'d> Gaussians<'d> {
    /// The Gaussians of a primitive with the extension.
    ///
    /// # Errors
    /// One sentence: another kernel or colour space, compressed, an attribute missing or of another form.
    pub(super) fn new(document: &'d Document, primitive: &'d Primitive) -> Result<Gaussians<'d>, String> {
        let extension = &primitive.extensions[EXTENSION];
        if let Some(name) = extension["extensions"]
            .as_object()
            .and_then(|inner| inner.keys().find(|name| name.contains("compression")))
        {
            return Err(format!(
                "glTF: its Gaussians are compressed by {name}, which is not read; write it without"
            ));
        }
        let text = |key: &str, default: &'static str| match &extension[key] {
            Value::String(text) => text.clone(),
            _ => default.to_owned(),
        };
        let kernel = text("kernel", KERNEL);
        if kernel != KERNEL {
            return Err(format!("glTF: the kernel `{kernel}` is not drawn; `{KERNEL}` is"));
        }
        let color_space = text("colorSpace", DISPLAY);
        let is_linear = match color_space.as_str() {
            DISPLAY => false,
            LINEAR => true,
            other => return Err(format!("glTF: the colour space `{other}` is not known; `{DISPLAY}` is")),
        };
        let number = |name: &str| primitive.attributes.get(name).copied();
        let needed = |name: String| {
            number(&name).ok_or_else(|| format!("glTF: Gaussians without the attribute {name}"))
        };
        let own = |name: &str| needed(format!("{PREFIX}{name}"));
        let has_degree = |degree: &u8| number(&format!("{PREFIX}{}", sh_name(*degree, 0))).is_some();
        let sh_degree = (1..=SH_DEGREE_MAX).rev().find(has_degree).unwrap_or(0);
        let sh = sh_names(sh_degree)
            .map(|name| Column::new::<3>(document, own(&name)?))
            .collect::<Result<Vec<_>, String>>()?;
        let positions = Column::new::<3>(document, needed(POSITION.into())?)?;
        let gaussians = Gaussians {
            rows: usize::try_from(positions.rows()).unwrap_or(usize::MAX),
            sh_degree,
            is_linear,
            is_cut: has_degree(&(SH_DEGREE_MAX + 1)),
            rotations: Column::new::<4>(document, own(ROTATION)?)?,
            scales: Column::new::<3>(document, own(SCALE)?)?,
            opacities: Column::new::<1>(document, own(OPACITY)?)?,
            positions,
            sh,
        };
        gaussians.check_rows()?;
        Ok(gaussians)
    }

    fn check_rows(&self) -> Result<(), String> {
        let Gaussians { positions, rotations, scales, opacities, sh, .. } = self;
        let rows = positions.rows();
        match [rotations, scales, opacities].into_iter().chain(sh).find(|column| column.rows() != rows) {
            None => Ok(()),
            Some(column) => Err(format!(
                "glTF: {rows} positions of Gaussians, and {} of another attribute",
                column.rows()
            )),
        }
    }

    /// Appends the rows to a field of the same SH degree.
    ///
    /// # Errors
    /// One sentence, if an attribute extends beyond its buffer.
    pub(super) fn read(&self, buffers: &Buffers, form: ScaleForm, field: &mut Field) -> Result<(), String> {
        field.centers.extend(self.positions.numbers(buffers)?.rows::<3>());
        field.rotations.extend(self.rotations.numbers(buffers)?.rows::<4>().map(|[x, y, z, w]| [w, x, y, z]));
        field.log_scales.extend(self.scales.numbers(buffers)?.rows::<3>().map(|scales| match form {
            ScaleForm::Linear => scales.map(f32::ln),
            ScaleForm::Logarithm => scales,
        }));
        field.opacities.extend(self.opacities.numbers(buffers)?.rows::<1>().map(|[opacity]| opacity));
        let first = field.sh.len();
        let coefficients = sh_coefficients(self.sh_degree);
        field.sh.resize(first + coefficients * field.centers.len(), [0.0; 3]);
        for (k, column) in self.sh.iter().enumerate() {
            for (row, values) in column.numbers(buffers)?.rows::<3>().enumerate() {
                field.sh[first + row * coefficients + k] = values;
            }
        }
        if self.is_linear {
            field.sh[first..].chunks_exact_mut(coefficients).for_each(to_display);
        }
        Ok(())
    }
}

impl Gaussians<'_> {
    /// Checks that the attributes lie within their buffers.
    ///
    /// # Errors
    /// One sentence, if one does not.
    pub(super) fn check(&self, buffers: &Buffers) -> Result<(), String> {
        let Gaussians { positions, rotations, scales, opacities, sh, .. } = self;
        let mut columns = [positions, rotations, scales, opacities].into_iter().chain(sh);
        columns.try_for_each(|column| column.numbers(buffers).map(drop))
    }
}

impl ScaleForm {
    /// What the scales of a file are: a standard deviation is not below zero.
    ///
    /// # Errors
    /// One sentence, if an attribute extends beyond its buffer.
    pub(super) fn detect<'d>(
        parts: impl Iterator<Item = &'d Gaussians<'d>>,
        buffers: &Buffers,
    ) -> Result<ScaleForm, String> {
        for part in parts {
            if part.scales.numbers(buffers)?.rows::<3>().flatten().any(|scale| scale < 0.0) {
                return Ok(ScaleForm::Logarithm);
            }
        }
        Ok(ScaleForm::Linear)
    }
}

/// Makes display-referred colours of linear ones: the constant colour by the curve of sRGB, the rest by its slope there.
fn to_display(sh: &mut [[f32; 3]]) {
    for channel in 0..3 {
        let linear = rgb_of_sh(sh[0][channel]).clamp(0.0, 1.0);
        let (display, slope) = match linear <= 0.003_130_8 {
            true => (12.92 * linear, 12.92),
            false => (1.055 * linear.powf(1.0 / 2.4) - 0.055, 1.055 / 2.4 * linear.powf(1.0 / 2.4 - 1.0)),
        };
        sh[0][channel] = sh_of_rgb(display);
        sh[1..].iter_mut().for_each(|c| c[channel] *= slope as f32);
    }
}
