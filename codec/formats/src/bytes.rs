//! Little-endian numbers in bytes: [`u32_at`], [`f32_at`] and [`f16_at`] read them, [`byte_of_unit`] makes one.

use half::f16;

/// The number at these four bytes.
///
/// # Panics
/// If there are fewer, here and below.
pub(crate) fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(std::array::from_fn(|k| bytes[at + k]))
}

/// The number at these four bytes.
pub(crate) fn f32_at(bytes: &[u8], at: usize) -> f32 {
    f32::from_bits(u32_at(bytes, at))
}

/// The number at these two bytes.
pub(crate) fn f16_at(bytes: &[u8], at: usize) -> f32 {
    f16::from_le_bytes([bytes[at], bytes[at + 1]]).to_f32()
}

/// A number in `[0, 1]` as a byte, the nearest; others are clamped.
pub(crate) fn byte_of_unit(x: f64) -> u8 {
    (x.clamp(0.0, 1.0) * 255.0).round() as u8
}
