//! glTF with `KHR_gaussian_splatting`: `.glb`, and `.gltf` with its buffers.
//!
//! A primitive of points with the extension holds Gaussians, one a vertex: `POSITION`, and under the prefix
//! `KHR_gaussian_splatting:` `ROTATION` (quaternion x, y, z, w), `SCALE` (standard deviations), `OPACITY` (in `[0, 1]`)
//! and `SH_DEGREE_l_COEF_n` (RGB, in the order and signs of 3D Gaussian Splatting). The axes are y up, in metres, after
//! the transforms of the nodes. Files from before a revision of the extension in 2026 have logarithms in `SCALE`.
//!
//! The general glTF libraries for Rust reject attributes of extensions, so the few objects that are needed are read here.

mod accessor;
mod attributes;
mod buffers;
mod container;
mod document;
mod nodes;
mod primitive;

use std::path::Path;

use codec::{ClipInfo, Field};
use serde_json::json;

use crate::account::{Account, Repairs, SH_CUT, listed};
use crate::columns::padded_sh;
use crate::imported::{Hints, Imported};
use crate::limits::ImportBudget;
use crate::origin;
use crate::similarity::Similarity;
use crate::statements::{Statement, Treatment, honoured, ignored, noted, treatment, unread};
use crate::up_axis::Y_UP;

use attributes::Attributes;
use buffers::Buffers;
use document::{Document, Mesh};
use primitive::{DISPLAY, EXTENSION, Gaussians, KERNEL, PREFIX, SCALE, ScaleForm};

pub(crate) use container::START;

/// The extensions that are known, and what is left out.
pub(crate) const STATEMENTS: &[Statement] = &[
    honoured(EXTENSION, "Gaussians: kernel `ellipse`, both colour spaces"),
    honoured("KHR_mesh_quantization", "integers in attributes"),
    ignored("KHR_materials_* KHR_lights_* KHR_texture_*", "Gaussians have none"),
    noted("any other extension", "refused where the file requires it"),
    noted("meshes, animations", "left out"),
];

/// Reads a `.glb`, or a `.gltf`, whose buffers are in `folder` or in itself.
pub(crate) fn read(bytes: &[u8], folder: &Path, budget: &mut ImportBudget) -> Result<Imported, String> {
    let (json, binary) = match bytes.starts_with(&START) {
        true => container::chunks(bytes)?,
        false => (bytes, None),
    };
    let document = Document::parse(json, budget)?;
    let is_known = |name: &str| treatment(STATEMENTS, name) == Treatment::Honoured;
    let is_harmful = |name: &&String| treatment(STATEMENTS, name) == Treatment::Noted;
    if let Some(name) = document.extensions_required.iter().find(is_harmful) {
        return Err(format!("glTF that requires {name}, which is not read; write it without"));
    }
    let placed = nodes::placed(&document, budget)?;
    let meshes = gaussians(&document, &placed)?;
    let parts = || meshes.iter().flatten();
    // A mesh may stand in many places: all that is counted here is by mesh, for they are more than fit in memory.
    let sum = |count: &dyn Fn(usize) -> usize| {
        placed.iter().fold(0, |sum: usize, (mesh, _)| sum.saturating_add(count(*mesh)))
    };
    let others = sum(&|mesh| document.meshes[mesh].primitives.len() - meshes[mesh].len());
    if parts().next().is_none() {
        return Err(format!(
            "glTF without {EXTENSION}: it has {others} primitives of meshes or points, and no Gaussians; export Gaussians"
        ));
    }
    let buffers = Buffers::load(&document, binary, folder, budget)?;
    parts().try_for_each(|part| part.check(&buffers))?;
    let mesh_rows: Vec<usize> = meshes
        .iter()
        .map(|mesh| mesh.iter().fold(0, |rows: usize, part| rows.saturating_add(part.rows)))
        .collect();
    let rows = sum(&|mesh| mesh_rows[mesh]);
    let sh_degree = parts().map(|part| part.sh_degree).max().unwrap_or(0);
    let mut field = budget.field(rows, sh_degree)?;
    let mut centers = budget.vec(rows)?;
    let form = ScaleForm::detect(parts(), &buffers)?;
    let mut repairs = Repairs::default();
    for (mesh, place) in &placed {
        for part in &meshes[*mesh] {
            let mut one = budget.field(part.rows, part.sh_degree)?;
            part.read(&buffers, form, &mut one)?;
            // In `f64`: the sum with a translation may need more digits than the centre has.
            centers.extend(one.centers.drain(..).map(place.points()));
            place.apply(&mut one);
            repairs.repair_rows(SH_CUT, if part.is_cut { part.rows } else { 0 });
            append(&mut field, &one);
        }
    }
    let has_linear = parts().any(|part| part.is_linear);
    let (assumed, mut lost) = (assumed(form, has_linear), left_out(others, document.animations.len()));
    let used = document.extensions_used.iter().map(String::as_str).filter(|name| !is_known(name));
    lost.extend(unread(STATEMENTS, used).map(|names| format!("extensions that are not read: {names}")));
    let account = Account { repairs, assumed, lost };
    let hints = Hints { up: Some(Y_UP), metres_per_unit: Some(1.0), ..Hints::default() };
    let mut imported = Imported { field, hints, format: "glTF (KHR_gaussian_splatting)", account };
    origin::place(&mut imported, |row| centers[row], budget)?;
    Ok(imported)
}

/// The Gaussians of each mesh; none of a mesh that is not placed.
fn gaussians<'d>(
    document: &'d Document,
    placed: &[(usize, Similarity)],
) -> Result<Vec<Vec<Gaussians<'d>>>, String> {
    let mut is_placed = vec![false; document.meshes.len()];
    placed.iter().for_each(|(mesh, _)| is_placed[*mesh] = true);
    let of_mesh = |(mesh, is_placed): (&'d Mesh, bool)| {
        let primitives = mesh
            .primitives
            .iter()
            .filter(|primitive| is_placed && primitive.extensions.contains_key(EXTENSION));
        primitives.map(|primitive| Gaussians::new(document, primitive)).collect()
    };
    document.meshes.iter().zip(is_placed).map(of_mesh).collect()
}

/// Appends rows of an SH degree that is not higher, without their centres.
fn append(field: &mut Field, rows: &Field) {
    field.rotations.extend(&rows.rotations);
    field.log_scales.extend(&rows.log_scales);
    field.opacities.extend(&rows.opacities);
    field.sh.extend(padded_sh(&rows.sh, rows.sh_degree, field.sh_degree));
}

/// What was assumed.
fn assumed(form: ScaleForm, has_linear: bool) -> Vec<String> {
    let logarithms = (form == ScaleForm::Logarithm).then(|| {
        format!(
            "{PREFIX}{SCALE} has values below zero, so it holds logarithms, as before a revision of the extension"
        )
    });
    let linear = has_linear.then(|| {
        "linear colours became display-referred ones, to first order where they depend on the view".into()
    });
    logarithms.into_iter().chain(linear).collect()
}

/// What a file has besides its Gaussians.
fn left_out(primitives: usize, animations: usize) -> Vec<String> {
    let others = [(primitives, "primitives without Gaussians"), (animations, "animations")];
    others
        .into_iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, what)| format!("{count} {what} are left out"))
        .collect()
}

/// The static columns of a field as a `.glb`, with y up and in metres. Windows and motion are omitted: see
/// [`crate::frozen()`]. Viewers without the extension show points with the constant colours.
///
/// Returns `None` for a field beyond the 4 GiB of the format.
pub fn write(field: &Field, info: &ClipInfo) -> Option<Vec<u8>> {
    let mut field = field.clone();
    let scale = info.metres_per_unit.into();
    Similarity { scale, ..Similarity::turning(info.up, Y_UP) }.apply(&mut field);
    let attributes = Attributes::new(&field);
    let document = json!({
        "asset": {"version": "2.0", "generator": format!("aarc-studio {}", env!("CARGO_PKG_VERSION"))},
        "extensionsUsed": [EXTENSION],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{
            "mode": 0,
            "attributes": attributes.names,
            "extensions": {EXTENSION: {
                "kernel": KERNEL,
                "colorSpace": DISPLAY,
                "projection": "perspective",
                "sortingMethod": "cameraDistance",
            }},
        }]}],
        "buffers": [{"byteLength": attributes.bytes.len()}],
        "bufferViews": attributes.views,
        "accessors": attributes.accessors,
    });
    container::file(document.to_string().into_bytes(), &attributes.bytes)
}

/// What a file does not hold of a field and the metadata of its clip.
pub(crate) fn lost(field: &Field, info: &ClipInfo) -> Vec<&'static str> {
    listed([
        (field.filter.compensates(), "the mip filter"),
        (field.near > 0.0, "the near distance"),
        (!info.viewpoints.is_empty(), "viewpoints"),
        (true, "duration and frame rate"),
    ])
}
