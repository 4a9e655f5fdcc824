//! The `.ksplat` file of GaussianSplats3D (mkkellogg), version 0.1.
//!
//! A header of 4096 bytes, a header of 1024 bytes for each of `max_sections` sections, then the sections. A section is
//! the lengths of its partially filled buckets (`u32`), the centres of its buckets (three `f32`), and its Gaussians, of
//! the full buckets first. In the headers, little-endian:
//!
//! | file, at | type | content |
//! |---|---|---|
//! | 0, 1 | `u8` | version |
//! | 4 | `u32` | sections that there is room for |
//! | 16 | `u32` | Gaussians |
//! | 20 | `u16` | compression: 0, 1 or 2 |
//! | 36, 40 | `f32` | range of SH coefficients in 8 bits; 0 for -1.5 and 1.5 |
//!
//! | section, at | type | content |
//! |---|---|---|
//! | 0, 4 | `u32` | Gaussians, and how many there is room for |
//! | 8, 12 | `u32` | Gaussians in a full bucket, buckets |
//! | 16, 20 | `f32`, `u16` | side of a bucket, bytes of its centre |
//! | 24 | `u32` | half the range of a coordinate; 0 for 32767 |
//! | 32, 36 | `u32` | full buckets, partially filled ones |
//! | 40 | `u16` | SH degree |
//!
//! A Gaussian has centre, three standard deviations, quaternion w, x, y, z, RGB and opacity as bytes, and SH by degree,
//! then by channel. Compression 0 has `f32`; 1 and 2 have `f16`, and centres as `u16` relative to their bucket; 2 has SH
//! as bytes.

use codec::{SH_DEGREE_MAX, sh_coefficients};

use crate::account::Repairs;
use crate::bytes::{f16_at, f32_at, u32_at};
use crate::columns::{padded_sh, unpack_rgba};
use crate::imported::Imported;
use crate::limits::ImportBudget;
use crate::statements::{Statement, honoured, ignored};

/// What a file says.
pub(crate) const STATEMENTS: &[Statement] = &[
    honoured("both headers, all sections", "the columns"),
    ignored("centre of the scene", "the first view of its player"),
];

const HEADER: usize = 4096;
const SECTION_HEADER: usize = 1024;

/// Half the range of SH coefficients in 8 bits where the header has none.
const SH_RANGE: f32 = 1.5;

/// Half the range of a coordinate where the header has none.
const COORDINATE_RANGE: u32 = 32767;

struct Header {
    max_sections: usize,
    gaussians: usize,
    compression: u16,
    sh_range: [f32; 2],
}

struct Section<'a> {
    header: &'a [u8],
    gaussians: usize,
    sh_degree: u8,
    /// Lengths of partially filled buckets, centres of all buckets, and Gaussians, as far as they are in the file.
    lengths: &'a [u8],
    centers: &'a [u8],
    rows: &'a [u8],
}

/// Reads the rows of a static field.
pub(crate) fn read(bytes: &[u8], budget: &mut ImportBudget) -> Result<Imported, String> {
    let header = Header::parse(bytes)?;
    let sections = sections(bytes, &header)?;
    let sh_degree = sections.iter().map(|section| section.sh_degree).max().unwrap_or(0);
    let rows = sections.iter().map(|section| section.rows_present(&header)).sum();
    let mut field = budget.field(rows, sh_degree)?;
    let repairs = Repairs::truncated(header.gaussians.saturating_sub(rows));
    for section in &sections {
        let stride = header.stride(section.sh_degree);
        let mut bucket_of = section.buckets();
        for (row, cells) in section.rows.chunks_exact(stride).take(section.gaussians).enumerate() {
            field.centers.push(header.center(cells, section, bucket_of(row)));
            let number = |k: usize| header.number(cells, k);
            field.log_scales.push([3, 4, 5].map(|k| number(k).ln()));
            field.rotations.push([6, 7, 8, 9].map(number));
            let at = header.color_at();
            let (color, opacity) = unpack_rgba([0, 1, 2, 3].map(|k| cells[at + k]));
            field.sh.push(color);
            field.opacities.push(opacity);
            let first = field.sh.len() - 1;
            header.push_sh(&cells[at + 4..], section.sh_degree, &mut field.sh);
            let padded = padded_sh(&field.sh[first..], section.sh_degree, sh_degree);
            field.sh.truncate(first);
            field.sh.extend(padded);
        }
    }
    Ok(Imported::new(".ksplat", field, repairs))
}

impl Header {
    fn parse(bytes: &[u8]) -> Result<Header, String> {
        if bytes.len() < HEADER {
            return Err(format!(".ksplat of {} bytes, and its header has {HEADER}", bytes.len()));
        }
        let [major, minor] = [bytes[0], bytes[1]];
        if (major, minor) != (0, 1) {
            return Err(format!(
                ".ksplat of version {major}.{minor}, and 0.1 is read; export the field in another format"
            ));
        }
        let compression = u32_at(bytes, 20) as u16;
        if compression > 2 {
            return Err(format!(
                ".ksplat header: compression {compression}, and 0, 1 and 2 are read; export the field in another format"
            ));
        }
        let or = |x: f32, default: f32| if x == 0.0 { default } else { x };
        Ok(Header {
            max_sections: u32_at(bytes, 4) as usize,
            gaussians: u32_at(bytes, 16) as usize,
            compression,
            sh_range: [or(f32_at(bytes, 36), -SH_RANGE), or(f32_at(bytes, 40), SH_RANGE)],
        })
    }

    /// Bytes of a number that is no coordinate.
    fn number_bytes(&self) -> usize {
        if self.compression == 0 { 4 } else { 2 }
    }

    /// First byte of the colour.
    fn color_at(&self) -> usize {
        10 * self.number_bytes()
    }

    /// Bytes of a Gaussian.
    fn stride(&self, sh_degree: u8) -> usize {
        let bytes_per_sh = [4, 2, 1][usize::from(self.compression)];
        self.color_at() + 4 + bytes_per_sh * 3 * (sh_coefficients(sh_degree) - 1)
    }

    /// Number `k` of a row.
    fn number(&self, cells: &[u8], k: usize) -> f32 {
        match self.compression {
            0 => f32_at(cells, 4 * k),
            _ => f16_at(cells, 2 * k),
        }
    }

    fn center(&self, cells: &[u8], section: &Section, bucket: usize) -> [f32; 3] {
        if self.compression == 0 {
            return [0, 1, 2].map(|axis| self.number(cells, axis));
        }
        let side = f32_at(section.header, 16);
        let range = match u32_at(section.header, 24) {
            0 => COORDINATE_RANGE,
            range => range,
        };
        let step = f64::from(side) / 2.0 / f64::from(range);
        // Of a bucket without a centre the Gaussians have no place: they are dropped as not finite.
        let center = section.centers.chunks_exact(12).nth(bucket);
        [0, 1, 2].map(|axis| {
            let coordinate = u16::from_le_bytes([cells[2 * axis], cells[2 * axis + 1]]);
            let origin = center.map_or(f32::NAN, |center| f32_at(center, 4 * axis));
            ((f64::from(coordinate) - f64::from(range)) * step + f64::from(origin)) as f32
        })
    }

    /// Appends the SH of degree 1 and above.
    fn push_sh(&self, cells: &[u8], sh_degree: u8, sh: &mut Vec<[f32; 3]>) {
        let [low, high] = self.sh_range;
        let value = |k: usize| match self.compression {
            0 => f32_at(cells, 4 * k),
            1 => f16_at(cells, 2 * k),
            _ => low + f32::from(cells[k]) / 255.0 * (high - low),
        };
        for degree in 1..=sh_degree {
            let (before, count) = (sh_coefficients(degree - 1) - 1, 2 * usize::from(degree) + 1);
            sh.extend((0..count).map(|k| [0, 1, 2].map(|channel| value(3 * before + channel * count + k))));
        }
    }
}

/// The sections, with as much of them as the file has.
fn sections<'a>(bytes: &'a [u8], header: &Header) -> Result<Vec<Section<'a>>, String> {
    let room = (bytes.len() - HEADER) / SECTION_HEADER;
    if header.max_sections > room {
        return Err(format!(
            ".ksplat header announces {} sections, and there is room for {room}",
            header.max_sections
        ));
    }
    let (headers, mut rest) = bytes[HEADER..].split_at(header.max_sections * SECTION_HEADER);
    let mut sections = Vec::with_capacity(header.max_sections);
    for (number, of_section) in headers.chunks_exact(SECTION_HEADER).enumerate() {
        let degree = u32_at(of_section, 40) as u16;
        if degree > SH_DEGREE_MAX.into() {
            return Err(format!(
                ".ksplat section {number}: SH degree {degree}, and at most {SH_DEGREE_MAX} is read; export the field in another \
                 format"
            ));
        }
        let sh_degree = degree as u8;
        let mut take = |count: u32, size: usize| {
            let length = u64::from(count).saturating_mul(size as u64);
            let (taken, after) = rest.split_at(usize::try_from(length).unwrap_or(usize::MAX).min(rest.len()));
            rest = after;
            taken
        };
        let lengths = take(u32_at(of_section, 36), 4);
        let center_bytes = usize::from(u32_at(of_section, 20) as u16);
        if center_bytes != 12 && header.compression > 0 {
            return Err(format!(
                ".ksplat section {number}: centres of buckets of {center_bytes} bytes, and 12 are read; export the field in \
                 another format"
            ));
        }
        let centers = take(u32_at(of_section, 12), center_bytes);
        let rows = take(u32_at(of_section, 4), header.stride(sh_degree));
        let gaussians = u32_at(of_section, 0) as usize;
        sections.push(Section { header: of_section, gaussians, sh_degree, lengths, centers, rows });
    }
    Ok(sections)
}

impl Section<'_> {
    /// Number of whole rows in the file.
    fn rows_present(&self, header: &Header) -> usize {
        self.gaussians.min(self.rows.len() / header.stride(self.sh_degree))
    }

    /// The bucket of a row; the rows are asked for in order.
    fn buckets(&self) -> impl FnMut(usize) -> usize {
        let (capacity, full) = (u32_at(self.header, 8) as usize, u32_at(self.header, 32) as usize);
        let in_full = capacity.saturating_mul(full);
        let lengths: Vec<usize> =
            self.lengths.chunks_exact(4).map(|length| u32_at(length, 0) as usize).collect();
        let (mut bucket, mut end) =
            (0, in_full.saturating_add(lengths.first().copied().unwrap_or(usize::MAX)));
        move |row| {
            if row < in_full {
                return row / capacity;
            }
            while row >= end {
                bucket += 1;
                end = end.saturating_add(lengths.get(bucket).copied().unwrap_or(usize::MAX));
            }
            full.saturating_add(bucket)
        }
    }
}
