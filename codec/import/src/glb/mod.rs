//! glTF with `KHR_gaussian_splatting`: `.glb`, and `.gltf` with its buffers.
//!
//! A primitive of points with the extension holds Gaussians, one a vertex: `POSITION`, and under the prefix
//! `KHR_gaussian_splatting:` `ROTATION` (quaternion x, y, z, w), `SCALE` (standard deviations), `OPACITY` (in `[0, 1]`)
//! and `SH_DEGREE_l_COEF_n` (RGB, in the order and signs of 3D Gaussian Splatting). The axes are y up, in metres, after
//! the transforms of the nodes. Files from before a revision of the extension in 2026 have logarithms in `SCALE`.
//!
//! The general glTF libraries for Rust reject attributes of extensions, so the few objects that are needed are read here.

mod accessor;
mod buffers;
mod container;
mod document;
mod nodes;
mod primitive;

use std::path::Path;

use codec::Field;

use crate::budget::ImportBudget;
use crate::imported::{Hints, Imported, Repairs};
use crate::padding::padded_sh;

use buffers::Buffers;
use document::Document;
use primitive::{Gaussians, ScaleForm};

pub use primitive::{EXTENSION, PREFIX};

/// Extensions that may be required: the extension that is read, and an extension that allows integers in attributes.
const KNOWN: [&str; 2] = [EXTENSION, "KHR_mesh_quantization"];

/// Reads a `.glb`.
pub(crate) fn read_binary(
    bytes: &[u8],
    folder: &Path,
    budget: &mut ImportBudget,
) -> Result<Imported, String> {
    let (json, binary) = container::chunks(bytes)?;
    read(json, binary, folder, budget)
}

/// Reads a `.gltf`, whose buffers are in `folder` or in itself.
pub(crate) fn read_text(bytes: &[u8], folder: &Path, budget: &mut ImportBudget) -> Result<Imported, String> {
    read(bytes, None, folder, budget)
}

fn read(
    json: &[u8],
    binary: Option<&[u8]>,
    folder: &Path,
    budget: &mut ImportBudget,
) -> Result<Imported, String> {
    let document = Document::parse(json, budget)?;
    if let Some(name) = document.extensions_required.iter().find(|name| !KNOWN.contains(&name.as_str())) {
        return Err(format!("glTF that requires {name}, which is not read; write it without"));
    }
    let placed = nodes::placed(&document)?;
    let parts: Vec<(Gaussians, _)> = placed
        .iter()
        .flat_map(|(mesh, place)| document.meshes[*mesh].primitives.iter().map(move |one| (one, *place)))
        .filter(|(primitive, _)| primitive.extensions.contains_key(EXTENSION))
        .map(|(primitive, place)| Ok((Gaussians::new(&document, primitive)?, place)))
        .collect::<Result<_, String>>()?;
    let others = placed.iter().flat_map(|(mesh, _)| &document.meshes[*mesh].primitives).count() - parts.len();
    if parts.is_empty() {
        return Err(format!(
            "glTF without {EXTENSION}: it has {others} primitives of meshes or points, and no Gaussians"
        ));
    }
    let buffers = Buffers::load(&document, binary, folder, budget)?;
    parts.iter().try_for_each(|(part, _)| part.check(&buffers))?;
    let rows = parts.iter().fold(0, |rows: usize, (part, _)| rows.saturating_add(part.rows));
    let sh_degree = parts.iter().map(|(part, _)| part.sh_degree).max().unwrap_or(0);
    // A mesh may stand in many places: their rows are counted before any is read.
    let mut field = budget.field(rows, sh_degree)?;
    let form = ScaleForm::detect(&parts.iter().map(|(part, _)| part).collect::<Vec<_>>(), &buffers)?;
    let mut repairs = Repairs::default();
    for (part, place) in &parts {
        let mut one = budget.field(part.rows, part.sh_degree)?;
        part.read(&buffers, form, &mut one, &mut repairs)?;
        place.apply(&mut one);
        append(&mut field, &one);
    }
    let has_linear = parts.iter().any(|(part, _)| part.is_linear);
    let notes = notes(form, has_linear, others, document.animations.len());
    let hints = Hints { up: Some([0.0, 1.0, 0.0]), metres_per_unit: Some(1.0), ..Hints::default() };
    Ok(Imported { field, hints, repairs, format: "glTF (KHR_gaussian_splatting)", notes })
}

/// Appends rows of an SH degree that is not higher.
fn append(field: &mut Field, rows: &Field) {
    field.centers.extend(&rows.centers);
    field.rotations.extend(&rows.rotations);
    field.log_scales.extend(&rows.log_scales);
    field.opacities.extend(&rows.opacities);
    field.sh.extend(padded_sh(&rows.sh, rows.sh_degree, field.sh_degree));
}

/// What was assumed and left out.
fn notes(form: ScaleForm, has_linear: bool, others: usize, animations: usize) -> Vec<String> {
    let mut notes = Vec::new();
    if form == ScaleForm::Logarithm {
        notes.push(format!(
            "{PREFIX}SCALE has values below zero, so it holds logarithms, as before a revision of the extension"
        ));
    }
    if has_linear {
        notes.push(
            "linear colours became display-referred ones, to first order where they depend on the view"
                .into(),
        );
    }
    if others > 0 {
        notes.push(format!("{others} primitives without Gaussians are left out"));
    }
    if animations > 0 {
        notes.push(format!("{animations} animations are left out"));
    }
    notes
}
