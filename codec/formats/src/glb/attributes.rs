//! [`Attributes`]: the attributes of the Gaussians of a field, for writing.

use codec::{Field, sh_coefficients};
use serde_json::{Map, Value, json};

use crate::bytes::byte_of_unit;
use crate::columns::rgb_of_sh;

use super::accessor::{F32, SHAPES, U8};
use super::primitive::{OPACITY, POSITION, PREFIX, ROTATION, SCALE, sh_names};

/// Target of a buffer view that holds attributes.
const ARRAY_BUFFER: u32 = 34962;

/// The binary chunk and the objects that describe it.
#[derive(Default)]
pub(super) struct Attributes {
    pub(super) bytes: Vec<u8>,
    pub(super) views: Vec<Value>,
    pub(super) accessors: Vec<Value>,
    /// Name of an attribute to the number of its accessor.
    pub(super) names: Map<String, Value>,
}

impl Attributes {
    /// The static columns of a field.
    pub(super) fn new(field: &Field) -> Attributes {
        let mut attributes = Attributes::default();
        let mut extent = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
        for center in &field.centers {
            for axis in 0..3 {
                extent[0][axis] = extent[0][axis].min(center[axis]);
                extent[1][axis] = extent[1][axis].max(center[axis]);
            }
        }
        attributes.push_floats(POSITION.into(), field.centers.iter().copied());
        attributes.accessors[0]["min"] = json!(extent[0]);
        attributes.accessors[0]["max"] = json!(extent[1]);
        attributes.push_colors(field);
        let own = |name: &str| format!("{PREFIX}{name}");
        attributes.push_floats(own(ROTATION), field.rotations.iter().map(|&[w, x, y, z]| [x, y, z, w]));
        attributes.push_floats(own(SCALE), field.log_scales.iter().map(|scales| scales.map(f32::exp)));
        attributes.push_floats(own(OPACITY), field.opacities.iter().map(|&opacity| [opacity]));
        let coefficients = sh_coefficients(field.sh_degree);
        for (k, name) in sh_names(field.sh_degree).enumerate() {
            attributes.push_floats(own(&name), field.sh.iter().skip(k).step_by(coefficients).copied());
        }
        attributes
    }

    fn push_floats<const N: usize>(&mut self, name: String, rows: impl Iterator<Item = [f32; N]>) {
        let start = self.bytes.len();
        rows.for_each(|row| self.bytes.extend(row.map(f32::to_le_bytes).as_flattened()));
        self.describe(name, start, 4 * N, json!({"componentType": F32, "type": SHAPES[N - 1]}));
    }

    /// The constant colours and the opacities as bytes.
    fn push_colors(&mut self, field: &Field) {
        let start = self.bytes.len();
        for row in 0..field.len() {
            self.bytes.extend(field.sh_of(row)[0].map(|c| byte_of_unit(rgb_of_sh(c))));
            self.bytes.push(byte_of_unit(field.opacities[row].into()));
        }
        let form = json!({"componentType": U8, "type": SHAPES[3], "normalized": true});
        self.describe("COLOR_0".into(), start, 4, form);
    }

    fn describe(&mut self, name: String, start: usize, row_bytes: usize, form: Value) {
        let length = self.bytes.len() - start;
        self.names.insert(name, self.accessors.len().into());
        let mut accessor = form;
        accessor["bufferView"] = self.views.len().into();
        accessor["count"] = (length / row_bytes).into();
        self.accessors.push(accessor);
        self.views
            .push(json!({"buffer": 0, "byteOffset": start, "byteLength": length, "target": ARRAY_BUFFER}));
    }
}
