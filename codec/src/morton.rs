//! Morton numbers: the bits of three coordinates of up to 21 bits, interleaved.

/// The Morton number of a point; x has the lowest bits.
#[cfg(feature = "encode")]
pub(crate) fn interleave(point: [u32; 3]) -> u64 {
    let [x, y, z] = point.map(|x| {
        let mut x = u64::from(x);
        x = (x | x << 32) & 0x001f_0000_0000_ffff;
        x = (x | x << 16) & 0x001f_0000_ff00_00ff;
        x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
        x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
        (x | x << 2) & 0x1249_2492_4924_9249
    });
    x | y << 1 | z << 2
}

/// The point of a Morton number.
pub(crate) fn deinterleave(morton: u64) -> [u32; 3] {
    [0, 1, 2].map(|axis| {
        let mut x = morton >> axis & 0x1249_2492_4924_9249;
        x = (x | x >> 2) & 0x10c3_0c30_c30c_30c3;
        x = (x | x >> 4) & 0x100f_00f0_0f00_f00f;
        x = (x | x >> 8) & 0x001f_0000_ff00_00ff;
        x = (x | x >> 16) & 0x001f_0000_0000_ffff;
        (x | x >> 32) as u32 & 0x1f_ffff
    })
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;

    #[test]
    fn morton_numbers_interleave() {
        assert_eq!(interleave([1, 0, 0]), 1);
        assert_eq!(interleave([0, 2, 0]), 16);
        assert_eq!(interleave([0xffff; 3]), (1 << 48) - 1);
        for point in
            [[0, 0, 0], [65535, 0, 1], [1, 32768, 255], [43690, 21845, 65535], [0x1f_ffff, 0, 0x12_3456]]
        {
            assert_eq!(deinterleave(interleave(point)), point);
        }
    }
}
