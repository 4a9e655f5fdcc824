//! What the tests of the package share: procedural fields, and a knife for packages.
#![allow(dead_code, reason = "every test file uses a part")]

use codec::{ClipInfo, Field, Temporal, Viewpoint, sh_coefficients};

/// SplitMix64: a small generator that gives the same numbers everywhere.
pub(crate) struct Rng(pub(crate) u64);

impl Rng {
    pub(crate) fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ z >> 31
    }

    /// Uniform in `[0, count)`.
    pub(crate) fn below(&mut self, count: usize) -> usize {
        (self.bits() % count as u64) as usize
    }

    /// Uniform in `[low, high)`.
    pub(crate) fn uniform(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * (self.bits() >> 40) as f32 / (1u64 << 24) as f32
    }

    pub(crate) fn vector<const N: usize>(&mut self, size: f32) -> [f32; N] {
        std::array::from_fn(|_| self.uniform(-size, size))
    }
}

/// Columns of a procedural field.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shape {
    pub(crate) rows: usize,
    pub(crate) sh_degree: u8,
    pub(crate) motion_order: u8,
    pub(crate) rotation_rates: bool,
    /// Every fourth row is always on and motionless.
    pub(crate) some_still: bool,
}

impl Shape {
    /// All columns and both regions.
    pub(crate) fn full(rows: usize) -> Shape {
        Shape { rows, sh_degree: 3, motion_order: 3, rotation_rates: true, some_still: true }
    }
}

/// A field of random numbers in the ranges that fitted fields have. Row `i` can be told from its
/// opacity, `(i % 255 + 1) / 255`, which no coder changes.
pub(crate) fn field(shape: Shape, seed: u64) -> Field {
    let mut rng = Rng(seed);
    let mut field = Field { sh_degree: shape.sh_degree, ..Field::default() };
    let mut temporal = Temporal { motion_order: shape.motion_order, ..Temporal::default() };
    let mut rates = Vec::new();
    for i in 0..shape.rows {
        let still = shape.some_still && i % 4 == 3;
        field.centers.push(rng.vector(3.0));
        let q: [f32; 4] = rng.vector(1.0);
        let norm = q.iter().map(|x| x * x).sum::<f32>().sqrt();
        field.rotations.push(q.map(|x| x / norm));
        field.log_scales.push(rng.vector::<3>(2.0).map(|x| x - 4.0));
        field.opacities.push((i % 255 + 1) as f32 / 255.0);
        field.sh.push(rng.vector(1.7));
        for k in 1..sh_coefficients(shape.sh_degree) {
            field.sh.push(rng.vector(0.5 / k as f32));
        }
        temporal.tau.push(rng.uniform(-0.1, 1.1));
        temporal.s.push(if still { f32::INFINITY } else { rng.uniform(0.01, 0.3) });
        for power in 0..shape.motion_order {
            let size = if still { 0.0 } else { 0.5 / f32::from(power + 1) };
            temporal.motion.push(rng.vector(size));
        }
        rates.push(rng.vector(if still { 0.0 } else { 0.3 }));
    }
    temporal.rotation_rates = shape.rotation_rates.then_some(rates);
    field.temporal = Some(temporal);
    field
}

/// A field of random static Gaussians.
pub(crate) fn static_field(rows: usize, sh_degree: u8, seed: u64) -> Field {
    let shape = Shape { rows, sh_degree, motion_order: 0, rotation_rates: false, some_still: false };
    Field { temporal: None, ..field(shape, seed) }
}

pub(crate) fn info() -> ClipInfo {
    ClipInfo {
        duration_s: 1.32,
        fps: 25.0,
        up: [0.0, -1.0, 0.0],
        metres_per_unit: 0.5,
        viewpoints: vec![
            Viewpoint { name: "front".into(), position: [0.0, 0.0, -5.0], target: [0.0; 3], fov_y: 0.8 },
            Viewpoint {
                name: "près".into(),
                position: [1.0, 0.5, -2.0],
                target: [0.0, 1.0, 0.0],
                fov_y: 1.2,
            },
        ],
    }
}

/// A package taken apart by the letter of FORMAT.md, without the crate's own parser. Putting it
/// together recomputes lengths, offsets and checksums, so that what a test changed is the only
/// thing wrong.
#[derive(Clone)]
pub(crate) struct Parts {
    /// The head up to the section table.
    pub(crate) head: Vec<u8>,
    /// Entries of the section table.
    pub(crate) table: Vec<[u8; 24]>,
    /// Bytes of each section.
    pub(crate) sections: Vec<Vec<u8>>,
}

impl Parts {
    pub(crate) fn of(package: &[u8]) -> Parts {
        let head_length = u32_at(package, 8);
        let count = u32_at(package, 72);
        let table_at = head_length - 4 - 24 * count;
        let table: Vec<[u8; 24]> =
            package[table_at..head_length - 4].chunks(24).map(|entry| entry.try_into().unwrap()).collect();
        let section = |entry: &[u8; 24]| {
            let (offset, length) = (u32_at(entry, 8), u32_at(entry, 12));
            package[offset..offset + length].to_vec()
        };
        Parts { head: package[..table_at].to_vec(), sections: table.iter().map(section).collect(), table }
    }

    pub(crate) fn join(&self) -> Vec<u8> {
        let mut package = self.head.clone();
        let head_length = self.head.len() + 24 * self.table.len() + 4;
        put_u32(&mut package, 8, head_length);
        put_u32(&mut package, 72, self.table.len());
        let mut offset = head_length;
        for (entry, section) in self.table.iter().zip(&self.sections) {
            let mut entry = *entry;
            put_u32(&mut entry, 8, offset);
            put_u32(&mut entry, 12, section.len());
            put_u32(&mut entry, 20, crc32fast::hash(section) as usize);
            package.extend_from_slice(&entry);
            offset += section.len();
        }
        let crc = crc32fast::hash(&package);
        package.extend_from_slice(&crc.to_le_bytes());
        self.sections.iter().for_each(|section| package.extend_from_slice(section));
        package
    }

    /// The payload of section `i` before compression.
    pub(crate) fn raw(&self, i: usize) -> Vec<u8> {
        zstd::bulk::decompress(&self.sections[i], u32_at(&self.table[i], 16)).unwrap()
    }

    /// Replaces the payload of section `i` by `raw`, compressed.
    pub(crate) fn set_raw(&mut self, i: usize, raw: &[u8]) {
        self.sections[i] = zstd::bulk::compress(raw, 1).unwrap();
    }

    /// Number of the first section of a kind (1 Gaussians, 2 time index) and region (0 still,
    /// 1 moving, 2 plate).
    pub(crate) fn find(&self, kind: u8, region: u8) -> usize {
        self.table.iter().position(|entry| entry[0] == kind && entry[3] == region).unwrap()
    }
}

pub(crate) fn u32_at(bytes: &[u8], at: usize) -> usize {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize
}

pub(crate) fn put_u32(bytes: &mut [u8], at: usize, value: usize) {
    bytes[at..at + 4].copy_from_slice(&u32::try_from(value).unwrap().to_le_bytes());
}
