//! The `.spz` file of Niantic: versions 2 to 4 are read, version 3 is written.
//!
//! Version 2 and 3 are one stream, packed with gzip or plain: a header of 16 bytes, then one
//! array per attribute. Version 4 has a header of 32 bytes, a table of compressed and plain sizes,
//! and the same arrays packed with zstd one by one. Per Gaussian:
//!
//! | bytes | attribute |
//! |---|---|
//! | 9 | centre, 24-bit two's complement with `fractional_bits` binary places |
//! | 1 | opacity / 255 |
//! | 3 | constant SH coefficients, `(byte / 255 - 0.5) / 0.15` |
//! | 3 | log-scales, `byte / 16 - 10` |
//! | 3 | version 2: x, y, z of the quaternion, `byte / 127.5 - 1`, w not negative |
//! | 4 | from version 3: index of the largest of x, y, z, w, and the others as sign and 9 bits |
//! | 9, 24, 45, 72 | SH of degree 1 to 4, `[coefficient][channel]`, `(byte - 128) / 128` |
//!
//! The format's axes are x right, y up, z back, unless an extension states others. The reader keeps them. Extensions
//! follow each other before the table of sizes, or behind the arrays before version 4: `u32` type, `u32` length, content.

use std::f64::consts::FRAC_1_SQRT_2;
use std::io::{self, ErrorKind, Read, Write};

use codec::{ClipInfo, Field, PixelFilter, SH_DEGREE_MAX, sh_coefficients};
use flate2::Compression;
use flate2::read::GzDecoder;
use flate2::write::GzEncoder;

use crate::account::{Repairs, SH_CUT, listed};
use crate::bytes::u32_at;
use crate::columns::with_largest;
use crate::imported::Imported;
use crate::limits::ImportBudget;
use crate::statements::{NAMES_MAX, Statement, honoured, ignored, noted};
use crate::up_axis::Y_UP;

/// The first bytes of a file: of one that is plain, and of one that gzip packed.
pub(crate) const STARTS: [&[u8]; 2] = [&MAGIC, &[0x1f, 0x8b]];

/// First four bytes of a plain file.
const MAGIC: [u8; 4] = *b"NGSP";

/// Factor from the constant SH coefficient to the stored colour, narrower than the basis so that
/// colours outside `[0, 1]` fit.
const COLOR_SCALE: f32 = 0.15;

/// Bytes of the header of versions 2 and 3.
const HEADER: usize = 16;

/// Bytes of the header of version 4.
const HEADER_V4: usize = 32;

/// Bit of byte 14 of the header: the field was fitted with compensated opacities.
const ANTIALIASED: u8 = 1;

/// Bit of byte 14 of the header: there are extensions.
const EXTENDED: u8 = 2;

/// Bit of byte 14 of the header, which Spark sets: the Gaussians are a tree of levels of detail, parents with their children,
/// whose numbers follow the arrays.
const LEVELS: u8 = 0x80;

/// Type of the extension that states the axes, as a `u32` number of [`AXES`].
const AXES_EXTENSION: u32 = 0xADBE_0003;

/// Type of the extension that limits the orbit of a camera.
const ORBIT_EXTENSION: u32 = 0xADBE_0002;

/// Directions of x, y and z: left or right, up or down, front or back. The first states nothing.
const AXES: [&str; 17] = [
    "", "LDB", "RDB", "LUB", "RUB", "LDF", "RDF", "LUF", "RUF", "LFD", "RFD", "LFU", "RFU", "LBD", "RBD",
    "LBU", "RBU",
];

/// Most bytes behind the arrays that are looked at.
const EXTENSIONS_MAX: u64 = 1 << 20;

/// What a file says besides its arrays.
pub(crate) const STATEMENTS: &[Statement] = &[
    honoured("antialiased", "the filter, without its variance"),
    noted("levels of detail", "flag 0x80 of Spark, refused: parents are drawn over their children"),
    noted("any other flag", "not read"),
    honoured("extension ADBE0003", "axes; left-handed ones are noted, and mirror what is drawn"),
    ignored("extension ADBE0002", "limits of an orbiting camera"),
    noted("any other extension", "not read"),
];

/// Bits of a coordinate without its sign: the most binary places.
const COORDINATE_BITS: u8 = 23;

/// Largest value of a component of a quaternion in 9 bits, for 1 / sqrt(2).
const COMPONENT_MAX: u32 = 511;

/// Signs of the SH basis functions, in the order of 3D Gaussian Splatting, under a half turn about x:
/// negative if the powers of y and z sum to an odd number.
const HALF_TURN_SH: [f32; 16] =
    [1.0, -1.0, -1.0, 1.0, -1.0, 1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0, -1.0, 1.0, -1.0, 1.0];

/// What is assumed of a file with the bit [`ANTIALIASED`]. Mip-Splatting and Brush compensate for 0.1 px^2; `antialiased` of
/// gsplat, `--antialiasing` of 3D Gaussian Splatting, and viewers such as PlayCanvas for 0.3 px^2.
pub(crate) const ASSUMED_VARIANCE: &str = "antialiased, drawn with the filter of Mip-Splatting, 0.1 px^2; the file \
                                           states no variance, and antialiased fits of gsplat and 3D Gaussian \
                                           Splatting have 0.3 px^2";

struct Header {
    version: u32,
    gaussians: usize,
    sh_degree: u8,
    fractional_bits: u8,
    /// Whether the field was fitted with compensated opacities.
    is_antialiased: bool,
    has_extensions: bool,
    /// Bits of the flags that are not known.
    unknown_flags: u8,
    /// Version 4: number of packed arrays, and where their table of sizes starts.
    streams: usize,
    table: usize,
}

impl Header {
    /// Reads the header of a file of `file_size` bytes.
    fn parse(bytes: &[u8], file_size: usize) -> Result<Header, String> {
        if bytes.len() < HEADER || bytes[..4] != MAGIC {
            return Err("SPZ without its header".into());
        }
        let header = Header {
            version: u32_at(bytes, 4),
            gaussians: u32_at(bytes, 8) as usize,
            sh_degree: bytes[12],
            fractional_bits: bytes[13],
            is_antialiased: bytes[14] & ANTIALIASED != 0,
            has_extensions: bytes[14] & EXTENDED != 0,
            unknown_flags: bytes[14] & !(ANTIALIASED | EXTENDED),
            streams: usize::from(bytes[15]),
            table: bytes.get(16..20).map_or(0, |table| u32_at(table, 0) as usize),
        };
        if !(2..=4).contains(&header.version) {
            return Err(format!(
                "SPZ of version {}, and 2, 3 and 4 are read; export it as one of these",
                header.version
            ));
        }
        if header.unknown_flags & LEVELS != 0 {
            return Err(
                "SPZ with levels of detail, which would all be drawn over each other; export it without, or \
                        name the file that they were made of"
                    .into(),
            );
        }
        if header.sh_degree > 4 || header.fractional_bits > COORDINATE_BITS {
            let Header { sh_degree, fractional_bits, .. } = header;
            return Err(format!(
                "SPZ header: SH degree {sh_degree}, {fractional_bits} binary places, and at most 4 and \
                 {COORDINATE_BITS} are read; export it as a .ply"
            ));
        }
        let plain = header.gaussians as u64 * header.strides().iter().sum::<usize>() as u64;
        ImportBudget::check_ratio(file_size as u64, plain)
            .map_err(|what| format!("SPZ of {} Gaussians: {what}", header.gaussians))?;
        Ok(header)
    }

    /// The field with what the header and the extensions say of it.
    fn stated(&self, extensions: &[u8], mut imported: Imported) -> Imported {
        imported.hints.up = Some(Y_UP);
        if self.is_antialiased {
            imported.field.filter = PixelFilter::Mip;
            imported.account.assumed.push(ASSUMED_VARIANCE.into());
        }
        let unknown = (0..8).map(|bit| self.unknown_flags & 1 << bit).filter(|flag| *flag != 0);
        let unknown: Vec<String> = unknown.map(|flag| format!("0x{flag:02x}")).collect();
        if !unknown.is_empty() {
            imported.account.lost.push(format!("flags that are not read: {}", unknown.join(", ")));
        }
        if self.has_extensions {
            read_extensions(extensions, &mut imported);
        }
        imported
    }

    /// Bytes per Gaussian of each array.
    fn strides(&self) -> [usize; 6] {
        let rotation = if self.version == 2 { 3 } else { 4 };
        [9, 1, 3, 3, rotation, 3 * (sh_coefficients(self.sh_degree) - 1)]
    }
}

/// Reads the rows of a static field.
pub(crate) fn read(bytes: &[u8], budget: &mut ImportBudget) -> Result<Imported, String> {
    let (header, arrays, extensions) = if bytes.starts_with(&MAGIC) && bytes.get(4) == Some(&4) {
        read_v4(bytes, budget)?
    } else if bytes.starts_with(&MAGIC) {
        read_v2_v3(bytes, bytes.len(), budget)?
    } else {
        read_v2_v3(GzDecoder::new(bytes), bytes.len(), budget)?
    };
    // The arrays follow each other: a truncated file has only the first ones in full.
    let strides = header.strides();
    let rows = (arrays.iter().zip(strides))
        .filter(|(_, stride)| *stride > 0)
        .map(|(array, stride)| array.len() / stride)
        .min()
        .unwrap_or(0);
    let mut repairs = Repairs::truncated(header.gaussians - rows);
    let sh_degree = header.sh_degree.min(SH_DEGREE_MAX);
    if sh_degree < header.sh_degree {
        repairs.repair_rows(SH_CUT, rows);
    }

    let [centers, opacities, colors, scales, rotations, sh] = &arrays;
    let unit = 1.0 / f64::from(1u32 << header.fractional_bits);
    let center = |bytes: &[u8; 9]| {
        [0, 3, 6].map(|k| {
            // The upper three bytes of an i32, so that the shift extends the sign.
            let fixed = i32::from_le_bytes([0, bytes[k], bytes[k + 1], bytes[k + 2]]) >> 8;
            (f64::from(fixed) * unit) as f32
        })
    };
    let base = |color: &[u8; 3]| color.map(|byte| (f32::from(byte) / 255.0 - 0.5) / COLOR_SCALE);
    let rest_stored = sh_coefficients(header.sh_degree) - 1;
    let rest_used = sh_coefficients(sh_degree) - 1;
    let rest = |row: usize| {
        let coefficients = &sh.as_chunks::<3>().0[row * rest_stored..][..rest_used];
        coefficients.iter().map(|c| c.map(|byte| (f32::from(byte) - 128.0) / 128.0))
    };
    let mut field = budget.field(rows, sh_degree)?;
    field.centers.extend(first(centers, rows).map(center));
    match header.version {
        2 => field.rotations.extend(first(rotations, rows).map(|&xyz| unpack_first_three(xyz))),
        _ => field
            .rotations
            .extend(first(rotations, rows).map(|&word| unpack_smallest_three(u32::from_le_bytes(word)))),
    }
    let log_scale = |bytes: &[u8; 3]| bytes.map(|byte| f32::from(byte) / 16.0 - 10.0);
    field.log_scales.extend(first(scales, rows).map(log_scale));
    field.opacities.extend(opacities[..rows].iter().map(|&byte| f32::from(byte) / 255.0));
    for (row, color) in first(colors, rows).enumerate() {
        field.sh.push(base(color));
        field.sh.extend(rest(row));
    }
    Ok(header.stated(&extensions, Imported::new("SPZ", field, repairs)))
}

/// Takes the axes of extensions, the first ones stated, and notes the unknown ones.
fn read_extensions(mut bytes: &[u8], imported: &mut Imported) {
    let lost = &mut imported.account.lost;
    let (mut has_axes, mut unknown) = (false, 0);
    while bytes.len() >= 8 {
        let (kind, length) = (u32_at(bytes, 0), u32_at(bytes, 4) as usize);
        let Some((content, rest)) = bytes[8..].split_at_checked(length) else { break };
        bytes = rest;
        if kind == ORBIT_EXTENSION || kind == AXES_EXTENSION && has_axes {
            continue;
        }
        has_axes |= kind == AXES_EXTENSION;
        let axes = (kind == AXES_EXTENSION && length >= 4).then(|| u32_at(content, 0) as usize);
        match axes.map(|number| AXES.get(number).copied().ok_or(number)) {
            Some(Ok("")) => {}
            Some(Ok(axes)) => {
                imported.hints.up = up_of_axes(axes);
                imported.account.assumed.push(format!("its axes are {axes}, as its extension says"));
                // RUB is right-handed; each opposite direction, and y for z, makes the other hand of it.
                let changes = axes.matches(['L', 'D', 'F']).count() + usize::from(axes.ends_with(['U', 'D']));
                if changes % 2 == 1 {
                    lost.push(format!(
                        "its axes {axes} are left-handed, and are drawn as right-handed: mirrored"
                    ));
                }
            }
            Some(Err(number)) => {
                lost.push(format!("its axes are of the unknown kind {number}, drawn with y up"))
            }
            None => {
                unknown += 1;
                if unknown <= NAMES_MAX {
                    lost.push(format!("an extension that is not read: {kind:08X}, of {length} bytes"));
                }
            }
        }
    }
    if unknown > NAMES_MAX {
        lost.push(format!("{} more extensions that are not read", unknown - NAMES_MAX));
    }
}

/// The up axis of axes with these directions.
fn up_of_axes(axes: &str) -> Option<[f32; 3]> {
    let axis = axes.find(['U', 'D'])?;
    let sign = if axes.contains('U') { 1.0 } else { -1.0 };
    Some(std::array::from_fn(|k| if k == axis { sign } else { 0.0 }))
}

/// A header, the arrays, and the bytes of the extensions.
type Parts = (Header, [Vec<u8>; 6], Vec<u8>);

fn read_v2_v3(mut source: impl Read, file_size: usize, budget: &mut ImportBudget) -> Result<Parts, String> {
    let header = read_up_to(&mut source, HEADER, budget)?;
    let header = Header::parse(&header, file_size)?;
    if header.version == 4 {
        return Err("SPZ of version 4 inside gzip; unpack it with `gunzip`, or export it without".into());
    }
    let mut arrays = <[Vec<u8>; 6]>::default();
    for (array, stride) in arrays.iter_mut().zip(header.strides()) {
        *array = read_up_to(&mut source, header.gaussians * stride, budget)?;
    }
    let mut extensions = Vec::new();
    budget.spend(2 * EXTENSIONS_MAX)?;
    read_to(&mut extensions, source.by_ref().take(EXTENSIONS_MAX))?;
    // Up to the end, where gzip has its checksum.
    unless_cut(io::copy(&mut source, &mut io::sink()))?;
    Ok((header, arrays, extensions))
}

fn read_v4(bytes: &[u8], budget: &mut ImportBudget) -> Result<Parts, String> {
    if bytes.len() < HEADER_V4 {
        return Err(format!("SPZ truncated at byte {}", bytes.len()));
    }
    let header = Header::parse(&bytes[..HEADER_V4], bytes.len())?;
    let table = bytes.get(header.table..).and_then(|table| table.get(..16 * header.streams));
    let Some(table) = table else {
        return Err(format!("SPZ truncated at byte {}, in its table of sizes", bytes.len()));
    };
    let mut packed = &bytes[header.table + table.len()..];
    let mut arrays = <[Vec<u8>; 6]>::default();
    let sizes = table.as_chunks::<8>().0.as_chunks::<2>().0;
    for ((array, stride), [size, _plain]) in arrays.iter_mut().zip(header.strides()).zip(sizes) {
        let size = usize::try_from(u64::from_le_bytes(*size)).unwrap_or(usize::MAX).min(packed.len());
        let (stream, rest) = packed.split_at(size);
        packed = rest;
        let mut decoder =
            zstd::stream::read::Decoder::with_buffer(stream).map_err(|e| format!("SPZ: {e}"))?;
        *array = read_up_to(&mut decoder, header.gaussians * stride, budget)?;
        // The end of the stream, where a checksum may be.
        read_to(&mut Vec::new(), decoder.take(1))?;
    }
    let extensions = bytes.get(HEADER_V4..header.table).unwrap_or_default();
    budget.spend(extensions.len() as u64)?;
    Ok((header, arrays, extensions.to_vec()))
}

/// The first `rows` rows of an array of `N` bytes each.
fn first<const N: usize>(array: &[u8], rows: usize) -> impl Iterator<Item = &[u8; N]> {
    array.as_chunks().0[..rows].iter()
}

/// Reads `size` bytes, or fewer if the source ends.
fn read_up_to(source: impl Read, size: usize, budget: &mut ImportBudget) -> Result<Vec<u8>, String> {
    let mut bytes = budget.vec(size)?;
    read_to(&mut bytes, source.take(size as u64))?;
    Ok(bytes)
}

/// Appends the bytes of a source.
fn read_to(bytes: &mut Vec<u8>, mut source: impl Read) -> Result<(), String> {
    unless_cut(source.read_to_end(bytes))
}

/// Bytes before an early end are used, and the caller counts the missing ones; where the packed bytes are damaged, what was
/// unpacked is wrong.
fn unless_cut<T>(read: io::Result<T>) -> Result<(), String> {
    match read {
        Err(error) if error.kind() != ErrorKind::UnexpectedEof => Err(format!("SPZ: damaged: {error}")),
        _ => Ok(()),
    }
}

fn unpack_first_three(xyz: [u8; 3]) -> [f32; 4] {
    let [x, y, z] = xyz.map(|byte| f32::from(byte) / 127.5 - 1.0);
    [(1.0 - (x * x + y * y + z * z)).max(0.0).sqrt(), x, y, z]
}

/// Bits 30-31: index of the omitted one of x, y, z, w; then 10 bits for each of the others, in order.
fn unpack_smallest_three(word: u32) -> [f32; 4] {
    let others = [20, 10, 0].map(|shift| {
        let bits = word >> shift;
        let magnitude = f64::from(bits & COMPONENT_MAX) / f64::from(COMPONENT_MAX) * FRAC_1_SQRT_2;
        if bits & 0x200 == 0 { magnitude } else { -magnitude }
    });
    let [x, y, z, w] = with_largest((word >> 30) as usize, others).map(|x| x as f32);
    [w, x, y, z]
}

/// The static columns of a field. Windows and motion are omitted: see [`crate::frozen()`].
///
/// The format has y up and z back. A field whose `up` is nearer to -y, as after COLMAP, is
/// turned by half a turn about x, as Niantic's own converter does; others keep their axes.
pub fn write(field: &Field, up: [f32; 3]) -> Vec<u8> {
    let places = binary_places(field);
    let mut bytes = MAGIC.to_vec();
    bytes.extend(3u32.to_le_bytes());
    bytes.extend((field.len() as u32).to_le_bytes());
    let flags = if field.filter.compensates() { ANTIALIASED } else { 0 };
    bytes.extend([field.sh_degree, places, flags, 0]);

    let flip = if up[1] < 0.0 { -1.0 } else { 1.0 };
    let largest = (1 << COORDINATE_BITS) - 1;
    for [x, y, z] in &field.centers {
        for x in [*x, y * flip, z * flip] {
            let fixed = (f64::from(x) * f64::from(1u32 << places)).round() as i32;
            bytes.extend(&fixed.clamp(-largest, largest).to_le_bytes()[..3]);
        }
    }
    bytes.extend(field.opacities.iter().map(|opacity| byte(opacity * 255.0)));
    for i in 0..field.len() {
        bytes.extend(field.sh_of(i)[0].map(|c| byte((c * COLOR_SCALE + 0.5) * 255.0)));
    }
    bytes.extend(field.log_scales.as_flattened().iter().map(|scale| byte((scale + 10.0) * 16.0)));
    for [w, x, y, z] in &field.rotations {
        bytes.extend(pack_smallest_three([*w, *x, y * flip, z * flip]).to_le_bytes());
    }
    for i in 0..field.len() {
        for (c, half_turn) in field.sh_of(i).iter().zip(HALF_TURN_SH).skip(1) {
            let sign = if flip < 0.0 { half_turn } else { 1.0 };
            bytes.extend(c.map(|x| byte(sign * x * 128.0 + 128.0)));
        }
    }

    let mut gzip = GzEncoder::new(Vec::new(), Compression::default());
    gzip.write_all(&bytes).and_then(|()| gzip.finish()).expect("a Vec takes every byte")
}

/// What a file does not hold of a field and the metadata of its clip.
pub(crate) fn lost(field: &Field, info: &ClipInfo) -> Vec<&'static str> {
    listed([
        (field.filter.compensates(), "the variance of the mip filter"),
        (field.near > 0.0, "the near distance"),
        (![Y_UP, [0.0, -1.0, 0.0]].contains(&info.up), "the up axis"),
        (info.metres_per_unit != 1.0, "metres per unit"),
        (!info.viewpoints.is_empty(), "viewpoints"),
        (true, "duration and frame rate"),
    ])
}

/// Largest number of binary places with which every coordinate fits.
fn binary_places(field: &Field) -> u8 {
    let extent = field.centers.as_flattened().iter().fold(0.0f32, |extent, x| extent.max(x.abs()));
    let bits_before = if extent > 0.0 { extent.log2().floor() as i32 + 1 } else { 0 };
    (i32::from(COORDINATE_BITS) - bits_before).clamp(0, COORDINATE_BITS.into()) as u8
}

/// The nearest byte; others are clamped.
fn byte(x: f32) -> u8 {
    x.round() as u8
}

/// Inverse of [`unpack_smallest_three`].
fn pack_smallest_three([w, x, y, z]: [f32; 4]) -> u32 {
    let q = [x, y, z, w];
    let largest = (1..4).fold(0, |best, k| if q[k].abs() > q[best].abs() { k } else { best });
    // The same rotation, with a positive omitted component.
    let negate = q[largest] < 0.0;
    (0..4).filter(|&k| k != largest).fold(largest as u32, |word, k| {
        let largest = COMPONENT_MAX as f32;
        let magnitude = (q[k].abs() / std::f32::consts::FRAC_1_SQRT_2 * largest).round().min(largest) as u32;
        word << 10 | u32::from((q[k] < 0.0) != negate) << 9 | magnitude
    })
}
