//! The optional parts that a package lacks, and the bytes that it saves without them.
//!
//! Saved package bytes are the size of the columns if they were present and zero. With the coder `fixed` that is their
//! size before entropy coding. The coder `rans` learns that a column is zero, so there it is a few bytes. Saved
//! GPU bytes are the part's share of the player's records.

use std::collections::BTreeMap;

use codec::{Clip, Coder, Contents, MOTION_ORDER_MAX, Region, SH_DEGREE_MAX, SectionKind, Segment, Take};
use serde::Serialize;
use shaders::{Motion, layout, sh_words};

/// Numbers per Gaussian of a part, and bits per number in chunks of the coder `fixed` (FORMAT.md). The ranges at the
/// start of a chunk, 4 bytes per part, are not counted.
#[derive(Clone, Copy)]
struct Columns {
    numbers: usize,
    bits: usize,
}

/// Window centre and width.
const WINDOW: Columns = Columns { numbers: 2, bits: 16 };

/// Motion coefficients of one power.
const MOTION_POWER: Columns = Columns { numbers: 3, bits: 10 };

const ROTATION_RATES: Columns = Columns { numbers: 4, bits: 8 };

/// Coefficients of one spherical harmonic.
const SH_FUNCTION: Columns = Columns { numbers: 3, bits: 8 };

/// Bytes of a column of zeros in a chunk of the coder `rans`, until its model has learned the zeros; measured, for
/// chunks of any size.
const ZEROS_BYTES: usize = 5;

/// Bytes that another layer costs a segment at least (FORMAT.md): in the counts of its head, and for one more chunk in
/// its section table.
const LAYER_BYTES: usize = 8 + 24;

/// An optional part that is absent from some Gaussians.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct LeftOut {
    /// Name of the part.
    pub(crate) part: String,
    /// Gaussians without it.
    pub(crate) gaussians: usize,
    /// Size of the part in the package if it were present.
    pub(crate) bytes_saved: usize,
    /// Size of the part in GPU buffers if it were present.
    pub(crate) gpu_bytes_saved: usize,
}

/// Sums over the segments of a take.
#[derive(Debug, Default)]
pub(crate) struct TakeLeftOut {
    /// The parts that some segment lacks.
    pub(crate) parts: Vec<LeftOut>,
    /// Gaussians of all plates.
    pub(crate) plates: usize,
    /// Largest size of a segment in GPU buffers, in bytes.
    pub(crate) segment_gpu_bytes: usize,
}

impl TakeLeftOut {
    /// What the table of a take tells.
    pub(crate) fn of_table(take: &Take) -> TakeLeftOut {
        let mut sums = TakeLeftOut::default();
        let segments = &take.segments;
        let gaussians = segments.iter().map(Segment::gaussians).sum();
        let mut add = |is_absent: bool, part: &str, bytes_saved: usize| {
            let part = LeftOut { part: part.into(), gaussians, bytes_saved, gpu_bytes_saved: 0 };
            sums.parts.extend(is_absent.then_some(part));
        };
        let has_one_layer = segments.iter().all(|segment| segment.layers.len() == 1);
        add(has_one_layer, "layers after the first", segments.len() * LAYER_BYTES);
        // A level is a number that every entry of the table has; one segment has none above it.
        let has_one_level = segments.len() > 1 && segments.iter().all(|segment| segment.level == 0);
        add(has_one_level, "levels above the lowest", 0);
        sums
    }

    /// Adds a decoded segment.
    pub(crate) fn add(&mut self, take: &Take, contents: &Contents, clip: &Clip) {
        self.plates += contents.plate_len;
        // The player gives every segment the columns of the take.
        let widened = widened(contents, take);
        self.segment_gpu_bytes = self.segment_gpu_bytes.max(gpu_bytes(&widened, clip));
        let on_gpu: BTreeMap<String, usize> =
            left_out(&widened, clip).into_iter().map(|part| (part.part, part.gpu_bytes_saved)).collect();
        for part in left_out(contents, clip) {
            let gpu_bytes_saved = on_gpu.get(&part.part).copied().unwrap_or(0);
            self.add_part(LeftOut { gpu_bytes_saved, ..part });
        }
    }

    fn add_part(&mut self, part: LeftOut) {
        match self.parts.iter_mut().find(|other| other.part == part.part) {
            Some(other) => {
                other.gaussians += part.gaussians;
                other.bytes_saved += part.bytes_saved;
                other.gpu_bytes_saved += part.gpu_bytes_saved;
            }
            None => self.parts.push(part),
        }
    }
}

/// The contents of a segment with the columns that the take gives it.
fn widened(contents: &Contents, take: &Take) -> Contents {
    Contents {
        sh_degree: take.sh_degree,
        motion_order: take.motion_order,
        rotation_rates: take.rotation_rates,
        ..contents.clone()
    }
}

/// Gaussians that lack a part, and their chunks.
#[derive(Clone, Copy)]
struct Rows {
    gaussians: usize,
    chunks: usize,
}

/// All optional parts that some Gaussians of the package lack. Together they are the difference to a package in which
/// every Gaussian has every part.
pub(crate) fn left_out(contents: &Contents, clip: &Clip) -> Vec<LeftOut> {
    let mut parts = Vec::new();
    let mut add = |part: String, Rows { gaussians, chunks }: Rows, columns: &[Columns], gpu_words: usize| {
        let numbers: usize = columns.iter().map(|columns| columns.numbers).sum();
        let bits: usize = columns.iter().map(|columns| columns.numbers * columns.bits).sum();
        parts.push(LeftOut {
            part,
            gaussians,
            bytes_saved: match contents.coder {
                Coder::Fixed => gaussians * bits / 8,
                Coder::Rans => chunks * numbers * ZEROS_BYTES,
            },
            gpu_bytes_saved: gaussians * gpu_words * 4,
        });
    };
    let static_rows =
        Rows { gaussians: clip.static_field.len(), chunks: chunks_of(contents, clip, Region::Static) };
    let dynamic_rows =
        Rows { gaussians: clip.dynamic_field.len(), chunks: chunks_of(contents, clip, Region::Dynamic) };
    let all = Rows { gaussians: clip.len(), chunks: static_rows.chunks + dynamic_rows.chunks };
    for degree in contents.sh_degree + 1..=SH_DEGREE_MAX {
        let functions = 2 * usize::from(degree) + 1;
        let gpu_words = sh_words(degree) - sh_words(degree - 1);
        add(format!("SH degree {degree}"), all, &vec![SH_FUNCTION; functions], gpu_words);
    }
    let mut motion = Motion { order: contents.motion_order, rotates: contents.rotation_rates };
    if static_rows.gaussians > 0 {
        let mut columns = vec![WINDOW];
        columns.extend(vec![MOTION_POWER; usize::from(motion.order)]);
        columns.extend(motion.rotates.then_some(ROTATION_RATES));
        let part = "temporal columns of motionless Gaussians".to_owned();
        add(part, static_rows, &columns, motion.words());
    }
    for order in contents.motion_order + 1..=MOTION_ORDER_MAX {
        let larger = Motion { order, ..motion };
        let gpu_words = larger.words() - motion.words();
        add(format!("motion of power {order}"), all, &[MOTION_POWER], gpu_words);
        motion = larger;
    }
    if !motion.rotates {
        let gpu_words = Motion { rotates: true, ..motion }.words() - motion.words();
        add("rotation over time".to_owned(), all, &[ROTATION_RATES], gpu_words);
    }
    if !contents.filter.compensates() {
        // The mip filter is a flag of the head and code of the player.
        add("opacity compensation".to_owned(), Rows { chunks: 0, ..all }, &[], 0);
    }
    if clip.plate.is_none() {
        // A plate costs only its Gaussians, and an absent one has none.
        add("plate".to_owned(), Rows { gaussians: 0, chunks: 0 }, &[], 0);
    }
    parts
}

/// Number of chunks of a region in the decoded layers of the clip.
fn chunks_of(contents: &Contents, clip: &Clip, region: Region) -> usize {
    let is_one = |section: &&codec::Section| {
        section.kind == SectionKind::Gaussians
            && section.region == region
            && usize::from(section.layer) < clip.layers.len()
    };
    contents.sections.iter().filter(is_one).count()
}

/// Size of the Gaussians in GPU buffers, in bytes.
pub(crate) fn gpu_bytes(contents: &Contents, clip: &Clip) -> usize {
    let record = |degree: u8| size_of::<layout::Gaussian>() + 4 * sh_words(degree);
    let motion = Motion { order: contents.motion_order, rotates: contents.rotation_rates };
    let plate = clip.plate.as_ref().map_or(0, |plate| plate.len() * record(plate.sh_degree));
    clip.len() * record(contents.sh_degree) + clip.dynamic_field.len() * 4 * motion.words() + plate
}
