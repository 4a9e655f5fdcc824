//! [`Numbers`]: the rows of an accessor as numbers.

use super::buffers::Buffers;
use super::document::{Accessor, Document};

/// Codes of the types of components: bytes and 32-bit floats, the two that are written, and the others.
pub(super) const U8: u32 = 5121;
pub(super) const F32: u32 = 5126;
const I8: u32 = 5120;
const I16: u32 = 5122;
const U16: u32 = 5123;

/// Names of rows of one to four components.
pub(super) const SHAPES: [&str; 4] = ["SCALAR", "VEC2", "VEC3", "VEC4"];

/// An accessor whose numbers and sizes were checked, except against its buffer.
#[derive(Clone, Copy)]
pub(super) struct Column<'d> {
    document: &'d Document,
    accessor: &'d Accessor,
    number: usize,
    kind: Kind,
    components: usize,
}

/// The type of a component.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    I8,
    U8,
    I16,
    U16,
    F32,
}

impl Kind {
    fn bytes(self) -> usize {
        match self {
            Kind::I8 | Kind::U8 => 1,
            Kind::I16 | Kind::U16 => 2,
            Kind::F32 => 4,
        }
    }

    /// The number at the start of `bytes`, and what a normalised integer is divided by.
    fn read(self, bytes: &[u8]) -> (f32, f32) {
        match self {
            Kind::I8 => (f32::from(bytes[0] as i8), 127.0),
            Kind::U8 => (f32::from(bytes[0]), 255.0),
            Kind::I16 => (f32::from(i16::from_le_bytes([bytes[0], bytes[1]])), 32767.0),
            Kind::U16 => (f32::from(u16::from_le_bytes([bytes[0], bytes[1]])), 65535.0),
            Kind::F32 => (f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]), 1.0),
        }
    }
}

impl<'d> Column<'d> {
    /// The accessor with this number, of rows of `N` numbers.
    ///
    /// # Errors
    /// One sentence with the number: it is not there, sparse, without a buffer view or vertices, of another type or other
    /// components.
    pub(super) fn new<const N: usize>(document: &'d Document, number: usize) -> Result<Column<'d>, String> {
        let wrong = |what: String| format!("glTF: accessor {number} {what}");
        let accessor = document.accessors.get(number).ok_or_else(|| wrong("is not there".into()))?;
        if accessor.sparse.is_some() {
            return Err(wrong("is sparse, which no program writes for Gaussians; write it without".into()));
        }
        if accessor.kind != SHAPES[N - 1] {
            return Err(wrong(format!(
                "has the type {}, where {N} numbers a vertex are expected",
                accessor.kind
            )));
        }
        let kind = match accessor.component_type {
            I8 => Kind::I8,
            U8 => Kind::U8,
            I16 => Kind::I16,
            U16 => Kind::U16,
            F32 => Kind::F32,
            other => return Err(wrong(format!("has components of type {other}"))),
        };
        if accessor.buffer_view.is_none() {
            return Err(wrong(
                "has no buffer view, so all its numbers are 0; write it with its numbers".into(),
            ));
        }
        if accessor.count == 0 {
            return Err(wrong("has no vertices; a glTF accessor has at least one".into()));
        }
        Ok(Column { document, accessor, number, kind, components: N })
    }

    /// Number of rows that the accessor announces.
    pub(super) fn rows(&self) -> u64 {
        self.accessor.count
    }

    /// The rows in the buffers.
    ///
    /// # Errors
    /// One sentence with the number of the accessor, which extends beyond its buffer.
    pub(super) fn numbers<'b>(&self, buffers: &'b Buffers) -> Result<Numbers<'b>, String> {
        let size = self.kind.bytes() * self.components;
        self.bytes(buffers, size)
            .map(|(bytes, stride)| Numbers {
                bytes,
                stride,
                kind: self.kind,
                is_normalized: self.accessor.normalized && self.kind != Kind::F32,
                rows: self.accessor.count as usize,
            })
            .ok_or_else(|| {
                let (number, rows) = (self.number, self.accessor.count);
                format!("glTF: accessor {number} announces {rows} vertices, more than its buffer has")
            })
    }

    fn bytes<'b>(&self, buffers: &'b Buffers, size: usize) -> Option<(&'b [u8], usize)> {
        let view = self.document.buffer_views.get(self.accessor.buffer_view?)?;
        let buffer = buffers.get(view.buffer)?;
        let end = view.byte_offset.checked_add(view.byte_length)?;
        let bytes = buffer.get(usize::try_from(view.byte_offset).ok()?..usize::try_from(end).ok()?)?;
        let bytes = bytes.get(usize::try_from(self.accessor.byte_offset).ok()?..)?;
        let stride = usize::try_from(view.byte_stride.unwrap_or(size as u64)).ok()?;
        let rows = usize::try_from(self.accessor.count).ok()?;
        let last = rows.checked_sub(1)?.checked_mul(stride)?.checked_add(size)?;
        (stride >= size && last <= bytes.len()).then_some((bytes, stride))
    }
}

/// Rows of numbers.
pub(super) struct Numbers<'b> {
    bytes: &'b [u8],
    stride: usize,
    kind: Kind,
    is_normalized: bool,
    rows: usize,
}

impl Numbers<'_> {
    /// The rows; `N` equals `N` in [`Column::new`].
    pub(super) fn rows<const N: usize>(&self) -> impl Iterator<Item = [f32; N]> + '_ {
        (0..self.rows).map(|row| {
            std::array::from_fn(|k| {
                let (number, one) = self.kind.read(&self.bytes[row * self.stride + k * self.kind.bytes()..]);
                if self.is_normalized { (number / one).max(-1.0) } else { number }
            })
        })
    }
}
