//! Shared by tests, benches and fuzz targets: procedural fields, and packages taken apart.
#![allow(dead_code, reason = "every test file uses a part")]

use codec::{
    Clip, ClipInfo, Coder, EncodeOptions, Field, Limits, Source, Temporal, Viewpoint, decode, encode,
    sh_coefficients,
};

pub(crate) mod precision;

/// SplitMix64: a small generator of the same numbers on every machine.
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
    /// Whether every fourth row is static.
    pub(crate) some_static: bool,
}

impl Shape {
    /// All columns, both regions.
    pub(crate) fn full(rows: usize) -> Shape {
        Shape { rows, sh_degree: 3, motion_order: 3, rotation_rates: true, some_static: true }
    }
}

/// A field of random numbers in the ranges of fitted fields. The opacity of row `i` is
/// `(i % 255 + 1) / 255`, so that [`source_row`] can find it again.
pub(crate) fn field(shape: Shape, seed: u64) -> Field {
    let mut rng = Rng(seed);
    let mut field = Field { sh_degree: shape.sh_degree, ..Field::default() };
    let mut temporal = Temporal { motion_order: shape.motion_order, ..Temporal::default() };
    let mut rates = Vec::new();
    for i in 0..shape.rows {
        let is_static = shape.some_static && i % 4 == 3;
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
        temporal.s.push(if is_static { f32::INFINITY } else { rng.uniform(0.01, 0.3) });
        for power in 0..shape.motion_order {
            let size = if is_static { 0.0 } else { 0.5 / f32::from(power + 1) };
            temporal.motion.push(rng.vector(size));
        }
        rates.push(rng.vector(if is_static { 0.0 } else { 0.3 }));
    }
    temporal.rotation_rates = shape.rotation_rates.then_some(rates);
    field.temporal = Some(temporal);
    field
}

/// A field of random static Gaussians.
pub(crate) fn static_field(rows: usize, sh_degree: u8, seed: u64) -> Field {
    let shape = Shape { rows, sh_degree, motion_order: 0, rotation_rates: false, some_static: false };
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

/// Options of a coder with these ends of layers.
pub(crate) fn options(coder: Coder, layers: &[usize]) -> EncodeOptions {
    EncodeOptions { coder, layers: layers.to_vec(), ..EncodeOptions::default() }
}

/// Packages a field with [`info`].
pub(crate) fn package(field: &Field, plate: Option<&Field>, options: &EncodeOptions) -> Vec<u8> {
    encode(&Source { info: &info(), field, plate }, options).unwrap()
}

/// Decodes a package and checks all fields of the clip.
pub(crate) fn valid_clip(package: &[u8]) -> Clip {
    let clip = decode(package, &Limits::default()).unwrap();
    check_fields(&clip);
    clip
}

pub(crate) fn check_fields(clip: &Clip) {
    for field in [&clip.static_field, &clip.dynamic_field].into_iter().chain(&clip.plate) {
        field.check().unwrap();
    }
}

/// The source row, below 255, of a decoded row with an exact opacity.
pub(crate) fn source_row(decoded: &Field, i: usize) -> usize {
    (decoded.opacities[i] * 255.0).round() as usize - 1
}

/// A package taken apart as FORMAT.md says, without the crate's own parser. [`Parts::join`] recomputes
/// lengths, offsets and checksums, so that a test's change is the only error.
#[derive(Clone)]
pub(crate) struct Parts {
    /// The head before the section table.
    pub(crate) head: Vec<u8>,
    /// Entries of the section table.
    pub(crate) table: Vec<[u8; 24]>,
    /// The bytes of each section.
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

    /// The package with section `i` replaced by `payload`, stored as it is.
    pub(crate) fn with_payload(&self, i: usize, payload: Vec<u8>) -> Vec<u8> {
        let mut parts = self.clone();
        put_u32(&mut parts.table[i], 16, payload.len());
        parts.sections[i] = payload;
        parts.join()
    }

    /// Offset of section `i` in the package.
    pub(crate) fn offset(&self, i: usize) -> usize {
        self.head.len() + 24 * self.table.len() + 4 + self.sections[..i].iter().map(Vec::len).sum::<usize>()
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

    /// Compresses `raw` as the payload of section `i`.
    pub(crate) fn set_raw(&mut self, i: usize, raw: &[u8]) {
        self.sections[i] = zstd::bulk::compress(raw, 1).unwrap();
    }

    /// Number of the first section of a kind (1 Gaussians, 2 time index) and region (0 static,
    /// 1 dynamic, 2 plate).
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
