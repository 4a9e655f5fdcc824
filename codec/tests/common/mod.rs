//! Shared by tests, benches and fuzz targets: procedural fields, and packages taken apart.
#![allow(dead_code, reason = "every test file uses a part")]

use codec::{
    Clip, ClipInfo, Coder, Contents, EncodeOptions, Field, Limits, SegmentPackage, Source, Temporal,
    Viewpoint, contents, decode, encode, encode_take_head, sh_coefficients,
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
    pub(crate) fn new(package: &[u8]) -> Parts {
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

/// A take package taken apart as FORMAT.md says, without the crate's own parser. [`TakeParts::join`] recomputes
/// everything in the table that the segments determine, so that a test's change is the only error.
#[derive(Clone)]
pub(crate) struct TakeParts {
    /// The head before the table of segments.
    pub(crate) head: Vec<u8>,
    /// The first 24 bytes of each entry, then 8 for each layer.
    pub(crate) entries: Vec<Vec<u8>>,
    /// The package of each segment.
    pub(crate) segments: Vec<Vec<u8>>,
}

impl TakeParts {
    /// The parts of a take; nothing if a length or a count leads out of it.
    pub(crate) fn new(package: &[u8]) -> Option<TakeParts> {
        if package.get(64) != Some(&0) || package.len() < 88 {
            return None;
        }
        let head_length = u32_at(package, 8);
        let table_end = head_length.checked_sub(4)?;
        let mut at = 84;
        for _ in 0..package[65] {
            at += 29 + usize::from(*package.get(at + 28)?);
        }
        // The near distance.
        if package[63] & 16 != 0 {
            at += 4;
        }
        let mut parts =
            TakeParts { head: package.get(..at)?.to_vec(), entries: Vec::new(), segments: Vec::new() };
        let mut offset = head_length;
        for _ in 0..u32_at(package, 72) {
            let length = 24 + 8 * usize::from(*package.get(at + 17)?);
            let entry = package.get(at..at + length).filter(|_| at + length <= table_end && length > 24)?;
            let bytes = u32_at(entry, length - 8);
            parts.entries.push(entry.to_vec());
            parts.segments.push(package.get(offset..offset + bytes)?.to_vec());
            (at, offset) = (at + length, offset + bytes);
        }
        (at == table_end).then_some(parts)
    }

    /// Joins the parts, after writing into each entry what its segment determines.
    pub(crate) fn join(&self) -> Vec<u8> {
        let mut parts = self.clone();
        for (entry, segment) in parts.entries.iter_mut().zip(&self.segments) {
            let length = entry.len();
            put_u32(entry, length - 8, segment.len());
            // The head of a segment may be damaged.
            let head_length = if segment.len() < 88 { 0 } else { u32_at(segment, 8) };
            if !(88..=segment.len()).contains(&head_length) {
                continue;
            }
            put_u32(entry, 20, u32_at(segment, head_length - 4));
            let ends = layer_ends(segment);
            for (layer, end) in ends.into_iter().enumerate().take(length / 8 - 4) {
                put_u32(entry, 24 + 8 * layer, end);
            }
        }
        parts.join_as_they_are()
    }

    /// Joins the parts with the table as it is; recomputes only length, number of segments and checksum.
    pub(crate) fn join_as_they_are(&self) -> Vec<u8> {
        let mut package = self.head.clone();
        let head_length = self.head.len() + self.entries.iter().map(Vec::len).sum::<usize>() + 4;
        put_u32(&mut package, 8, head_length);
        put_u32(&mut package, 72, self.entries.len());
        self.entries.iter().for_each(|entry| package.extend_from_slice(entry));
        let crc = crc32fast::hash(&package);
        package.extend_from_slice(&crc.to_le_bytes());
        self.segments.iter().for_each(|segment| package.extend_from_slice(segment));
        package
    }

    /// Offset of entry `i`, or of the checksum after the last one.
    pub(crate) fn entry_at(&self, i: usize) -> usize {
        self.head.len() + self.entries[..i].iter().map(Vec::len).sum::<usize>()
    }
}

/// Ends of the layers of a clip package, by its section table; none if it leads out of the head.
fn layer_ends(package: &[u8]) -> Vec<usize> {
    let (head_length, count) = (u32_at(package, 8), u32_at(package, 72));
    let mut ends = Vec::new();
    let Some(table_at) = count.checked_mul(24).and_then(|table| (head_length - 4).checked_sub(table)) else {
        return ends;
    };
    for entry in package[table_at..head_length - 4].chunks(24).filter(|entry| entry[1] & 1 != 0) {
        let layer = usize::from(entry[2]).min(15);
        ends.resize(ends.len().max(layer + 1), 0);
        ends[layer] = u32_at(entry, 8).saturating_add(u32_at(entry, 12)).min(u32::MAX as usize);
    }
    ends
}

/// A segment of a take: start and duration in seconds, level, and package.
pub(crate) type TakeSegment = (f64, f64, u8, Vec<u8>);

/// Packages a take of `duration_s` seconds with [`info`].
pub(crate) fn take_package(duration_s: f64, segments: &[TakeSegment]) -> Vec<u8> {
    let heads: Vec<Contents> =
        segments.iter().map(|segment| contents(&segment.3, &Limits::default()).unwrap()).collect();
    let entries: Vec<SegmentPackage> = segments
        .iter()
        .zip(&heads)
        .map(|(&(start_s, duration_s, level, _), contents)| SegmentPackage {
            start_s,
            duration_s,
            level,
            contents,
        })
        .collect();
    let mut bytes = encode_take_head(&info(), duration_s, &entries).unwrap();
    segments.iter().for_each(|segment| bytes.extend_from_slice(&segment.3));
    bytes
}

/// The package of a segment that lasts `duration_s` seconds.
pub(crate) fn segment_package(
    field: &Field,
    plate: Option<&Field>,
    options: &EncodeOptions,
    duration_s: f64,
) -> Vec<u8> {
    let info = ClipInfo { duration_s: duration_s as f32, viewpoints: Vec::new(), ..info() };
    encode(&Source { info: &info, field, plate }, options).unwrap()
}

/// A take of 3.5 s of three small segments: one that spans it, with a plate and of two layers; one with few columns;
/// and one with all.
pub(crate) fn small_take(coder: Coder) -> Vec<u8> {
    let few = Shape { sh_degree: 0, motion_order: 1, rotation_rates: false, ..Shape::full(4) };
    let all = Shape { sh_degree: 1, motion_order: 2, ..Shape::full(5) };
    let segments = [
        (static_field(4, 0, 1), Some(static_field(2, 0, 2)), &[2][..], (0.0, 3.5, 2)),
        (field(few, 3), None, &[], (0.0, 2.0, 0)),
        (field(all, 4), None, &[2], (1.0, 2.5, 0)),
    ];
    let segments = segments.map(|(field, plate, layers, (start, duration, level))| {
        let package = segment_package(&field, plate.as_ref(), &options(coder, layers), duration);
        (start, duration, level, package)
    });
    take_package(3.5, &segments)
}

pub(crate) fn u32_at(bytes: &[u8], at: usize) -> usize {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize
}

pub(crate) fn put_u32(bytes: &mut [u8], at: usize, value: usize) {
    bytes[at..at + 4].copy_from_slice(&u32::try_from(value).unwrap().to_le_bytes());
}
