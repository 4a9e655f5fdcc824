//! [`Reader`] and `Writer`: little-endian numbers from and to byte strings.

use crate::{Error, counters::Work, error::FormatError};

/// Reads numbers in order, never past the end.
pub(crate) struct Reader<'a> {
    bytes: &'a [u8],
    /// Offset of `bytes` in the package.
    base: usize,
    position: usize,
    /// Name of `bytes`, for errors.
    part: &'static str,
}

impl<'a> Reader<'a> {
    pub(crate) fn new(bytes: &'a [u8], base: usize, part: &'static str) -> Reader<'a> {
        Reader { bytes, base, position: 0, part }
    }

    /// Offset of the next byte in the package.
    pub(crate) fn at(&self) -> usize {
        self.base + self.position
    }

    pub(crate) fn take(&mut self, count: usize) -> Result<&'a [u8], Error> {
        let rest = &self.bytes[self.position..];
        let taken =
            rest.get(..count).ok_or(Error::format(self.at(), FormatError::Short { part: self.part }))?;
        self.position += count;
        Work::Bytes.count(count);
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], Error> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N)?);
        Ok(array)
    }

    pub(crate) fn u8(&mut self) -> Result<u8, Error> {
        Ok(self.array::<1>()?[0])
    }

    pub(crate) fn u16(&mut self) -> Result<u16, Error> {
        self.array().map(u16::from_le_bytes)
    }

    pub(crate) fn u32(&mut self) -> Result<u32, Error> {
        self.array().map(u32::from_le_bytes)
    }

    pub(crate) fn f32(&mut self) -> Result<f32, Error> {
        self.array().map(f32::from_le_bytes)
    }

    pub(crate) fn f64(&mut self) -> Result<f64, Error> {
        self.array().map(f64::from_le_bytes)
    }

    pub(crate) fn f32x3(&mut self) -> Result<[f32; 3], Error> {
        Ok([self.f32()?, self.f32()?, self.f32()?])
    }

    /// Reads an unsigned LEB128 number: 7 bits per byte, lowest first, the top bit set on all bytes
    /// but the last.
    pub(crate) fn leb128(&mut self) -> Result<u32, Error> {
        let at = self.at();
        let mut value = 0u64;
        for shift in (0..35).step_by(7) {
            let byte = self.u8()?;
            value |= u64::from(byte & 0x7f) << shift;
            if byte & 0x80 == 0 {
                return u32::try_from(value).map_err(|_| Error::value(at, "LEB128 number", value));
            }
        }
        Err(Error::value(at, "LEB128 number", "longer than 5 bytes"))
    }

    /// Returns the bytes not read.
    pub(crate) fn rest(self) -> &'a [u8] {
        &self.bytes[self.position..]
    }

    /// Checks that every byte was read.
    pub(crate) fn finish(self) -> Result<(), Error> {
        match self.bytes.len() - self.position {
            0 => Ok(()),
            count => Err(Error::format(self.at(), FormatError::Extra { count, part: self.part })),
        }
    }
}

/// Appends numbers to a byte string.
#[cfg(feature = "encode")]
#[derive(Default)]
pub(crate) struct Writer {
    pub(crate) bytes: Vec<u8>,
}

#[cfg(feature = "encode")]
impl Writer {
    pub(crate) fn u8(&mut self, value: u8) {
        self.bytes.push(value);
    }

    pub(crate) fn u16(&mut self, value: u16) {
        self.bytes.extend_from_slice(&value.to_le_bytes());
    }

    pub(crate) fn u32(&mut self, value: u32) {
        self.bytes.extend_from_slice(&value.to_le_bytes());
    }

    pub(crate) fn f32(&mut self, value: f32) {
        self.bytes.extend_from_slice(&value.to_le_bytes());
    }

    pub(crate) fn f64(&mut self, value: f64) {
        self.bytes.extend_from_slice(&value.to_le_bytes());
    }

    pub(crate) fn f32x3(&mut self, value: [f32; 3]) {
        for x in value {
            self.f32(x);
        }
    }

    pub(crate) fn leb128(&mut self, mut value: u32) {
        while value >= 0x80 {
            self.u8(value as u8 | 0x80);
            value >>= 7;
        }
        self.u8(value as u8);
    }
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;

    #[test]
    fn leb128_round_trips_and_stops_at_32_bits() {
        for value in [0, 1, 127, 128, 16383, 16384, u32::MAX - 1, u32::MAX] {
            let mut writer = Writer::default();
            writer.leb128(value);
            let mut reader = Reader::new(&writer.bytes, 0, "test");
            assert_eq!(reader.leb128(), Ok(value));
            assert_eq!(reader.finish(), Ok(()));
        }
        assert!(Reader::new(&[0xff, 0xff, 0xff, 0xff, 0x1f], 0, "test").leb128().is_err(), "33 bits");
        assert!(Reader::new(&[0x80, 0x80, 0x80, 0x80, 0x80, 0], 0, "test").leb128().is_err(), "6 bytes");
        assert!(Reader::new(&[0x80], 0, "test").leb128().is_err(), "unterminated");
    }

    #[test]
    fn errors_carry_the_offset_in_the_package() {
        let mut reader = Reader::new(&[1, 2, 3], 100, "part");
        assert_eq!(reader.u8(), Ok(1));
        assert_eq!(reader.u32(), Err(Error::format(101, FormatError::Short { part: "part" })));
        assert_eq!(reader.finish(), Err(Error::format(101, FormatError::Extra { count: 2, part: "part" })));
    }
}
