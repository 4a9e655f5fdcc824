//! [`Document`]: the objects of a glTF that Gaussians need.

use std::collections::BTreeMap;

use serde::Deserialize;
use serde_json::Value;

use crate::limits::ImportBudget;

/// Longest text: parsed JSON takes many times its text.
const TEXT_MAX: usize = 16 << 20;

/// Most bytes of memory for a byte of text: an empty node, `{},`, in a vector that has just grown.
const BYTES_PER_BYTE: u64 = size_of::<Node>() as u64;

#[derive(Deserialize)]
#[serde(rename_all = "camelCase", default)]
#[derive(Default)]
pub(super) struct Document {
    pub(super) scene: Option<usize>,
    pub(super) scenes: Vec<SceneEntry>,
    pub(super) nodes: Vec<Node>,
    pub(super) meshes: Vec<Mesh>,
    pub(super) accessors: Vec<Accessor>,
    pub(super) buffer_views: Vec<BufferView>,
    pub(super) buffers: Vec<Buffer>,
    pub(super) animations: Vec<Value>,
    pub(super) extensions_required: Vec<String>,
    pub(super) extensions_used: Vec<String>,
}

#[derive(Deserialize)]
pub(super) struct SceneEntry {
    #[serde(default)]
    pub(super) nodes: Vec<usize>,
}

#[derive(Deserialize)]
pub(super) struct Node {
    pub(super) mesh: Option<usize>,
    #[serde(default)]
    pub(super) children: Vec<usize>,
    /// Column by column. Boxed, as the rest: a node of two characters takes the memory of all its properties.
    pub(super) matrix: Option<Box<[f64; 16]>>,
    pub(super) translation: Option<Box<[f64; 3]>>,
    /// Quaternion x, y, z, w.
    pub(super) rotation: Option<Box<[f64; 4]>>,
    pub(super) scale: Option<Box<[f64; 3]>>,
}

#[derive(Deserialize)]
pub(super) struct Mesh {
    pub(super) primitives: Vec<Primitive>,
}

#[derive(Deserialize)]
pub(super) struct Primitive {
    #[serde(default)]
    pub(super) attributes: BTreeMap<String, usize>,
    #[serde(default)]
    pub(super) extensions: BTreeMap<String, Value>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Accessor {
    pub(super) buffer_view: Option<usize>,
    #[serde(default)]
    pub(super) byte_offset: u64,
    pub(super) component_type: u32,
    #[serde(default)]
    pub(super) normalized: bool,
    pub(super) count: u64,
    #[serde(rename = "type")]
    pub(super) kind: String,
    pub(super) sparse: Option<Value>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct BufferView {
    pub(super) buffer: usize,
    #[serde(default)]
    pub(super) byte_offset: u64,
    pub(super) byte_length: u64,
    pub(super) byte_stride: Option<u64>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Buffer {
    pub(super) uri: Option<String>,
    pub(super) byte_length: u64,
}

impl Document {
    /// Parses a text.
    ///
    /// # Errors
    /// One sentence: too long, no JSON, or an object without a property.
    pub(super) fn parse(text: &[u8], budget: &mut ImportBudget) -> Result<Document, String> {
        if text.len() > TEXT_MAX {
            let (has, most) = (text.len() >> 20, TEXT_MAX >> 20);
            return Err(format!(
                "glTF: its JSON has {has} MiB, and at most {most} are read; export it as a .glb"
            ));
        }
        budget.spend(BYTES_PER_BYTE * text.len() as u64)?;
        serde_json::from_slice(text).map_err(|error| format!("glTF: {error}"))
    }
}
