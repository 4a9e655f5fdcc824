//! The `.glb` file of glTF with `KHR_gaussian_splatting`. The module of that name in [`crate::import`] describes it.

use ::import::{GAUSSIANS_EXTENSION, GAUSSIANS_PREFIX, Similarity};
use codec::{ClipInfo, Field, SH_C0, sh_coefficients};
use serde_json::{Value, json};

/// The type of a component of 32-bit floats, and of bytes.
const FLOAT: u32 = 5126;
const BYTE: u32 = 5121;

/// The binary chunk and the objects that describe it.
#[derive(Default)]
struct Attributes {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    names: serde_json::Map<String, Value>,
}

/// The static columns of a field, with y up and in metres. Windows and motion are omitted: see [`super::frozen`].
/// Viewers without the extension show points with the constant colours.
///
/// Returns `None` for a field beyond the 4 GiB of the format.
pub fn glb(field: &Field, info: &ClipInfo) -> Option<Vec<u8>> {
    let mut field = field.clone();
    let scale = info.metres_per_unit.into();
    Similarity { scale, ..Similarity::turning(info.up, [0.0, 1.0, 0.0]) }.apply(&mut field);
    let attributes = attributes(&field);
    let document = json!({
        "asset": {"version": "2.0", "generator": format!("aarc-studio {}", env!("CARGO_PKG_VERSION"))},
        "extensionsUsed": [GAUSSIANS_EXTENSION],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{
            "mode": 0,
            "attributes": attributes.names,
            "extensions": {GAUSSIANS_EXTENSION: {
                "kernel": "ellipse",
                "colorSpace": "srgb_rec709_display",
                "projection": "perspective",
                "sortingMethod": "cameraDistance",
            }},
        }]}],
        "buffers": [{"byteLength": attributes.bytes.len()}],
        "bufferViews": attributes.views,
        "accessors": attributes.accessors,
    });
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let length = u32::try_from(12 + 8 + text.len() + 8 + attributes.bytes.len()).ok()?;
    let mut file = Vec::with_capacity(length as usize);
    file.extend(b"glTF");
    file.extend(2u32.to_le_bytes());
    file.extend(length.to_le_bytes());
    for (kind, content) in [(b"JSON", &text), (b"BIN\0", &attributes.bytes)] {
        file.extend((content.len() as u32).to_le_bytes());
        file.extend(kind);
        file.extend(content);
    }
    Some(file)
}

fn attributes(field: &Field) -> Attributes {
    let mut attributes = Attributes::default();
    let mut extent = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
    for center in &field.centers {
        for axis in 0..3 {
            extent[0][axis] = extent[0][axis].min(center[axis]);
            extent[1][axis] = extent[1][axis].max(center[axis]);
        }
    }
    attributes.push_floats("POSITION".into(), field.centers.iter().copied());
    attributes.accessors[0]["min"] = json!(extent[0]);
    attributes.accessors[0]["max"] = json!(extent[1]);
    attributes.push_colors(field);
    let own = |name: &str| format!("{GAUSSIANS_PREFIX}{name}");
    attributes.push_floats(own("ROTATION"), field.rotations.iter().map(|&[w, x, y, z]| [x, y, z, w]));
    attributes.push_floats(own("SCALE"), field.log_scales.iter().map(|scales| scales.map(f32::exp)));
    attributes.push_floats(own("OPACITY"), field.opacities.iter().map(|&opacity| [opacity]));
    let coefficients = sh_coefficients(field.sh_degree);
    let names = (0..=field.sh_degree)
        .flat_map(|degree| (0..2 * degree + 1).map(move |k| format!("SH_DEGREE_{degree}_COEF_{k}")));
    for (k, name) in names.enumerate() {
        attributes.push_floats(own(&name), field.sh.iter().skip(k).step_by(coefficients).copied());
    }
    attributes
}

impl Attributes {
    fn push_floats<const N: usize>(&mut self, name: String, rows: impl Iterator<Item = [f32; N]>) {
        let start = self.bytes.len();
        rows.for_each(|row| self.bytes.extend(row.map(f32::to_le_bytes).as_flattened()));
        self.describe(name, start, 4 * N, json!({"componentType": FLOAT, "type": kind_of(N)}));
    }

    /// The constant colours and the opacities as bytes.
    fn push_colors(&mut self, field: &Field) {
        let start = self.bytes.len();
        let byte = |x: f64| (x.clamp(0.0, 1.0) * 255.0).round() as u8;
        for row in 0..field.len() {
            self.bytes.extend(field.sh_of(row)[0].map(|c| byte(0.5 + SH_C0 * f64::from(c))));
            self.bytes.push(byte(field.opacities[row].into()));
        }
        let form = json!({"componentType": BYTE, "type": kind_of(4), "normalized": true});
        self.describe("COLOR_0".into(), start, 4, form);
    }

    fn describe(&mut self, name: String, start: usize, row_bytes: usize, form: Value) {
        let length = self.bytes.len() - start;
        self.names.insert(name, self.accessors.len().into());
        let mut accessor = form;
        accessor["bufferView"] = self.views.len().into();
        accessor["count"] = (length / row_bytes).into();
        self.accessors.push(accessor);
        self.views.push(json!({"buffer": 0, "byteOffset": start, "byteLength": length, "target": 34962}));
    }
}

fn kind_of(components: usize) -> &'static str {
    ["SCALAR", "VEC2", "VEC3", "VEC4"][components - 1]
}
