//! What a package does without, and what that saves.
//!
//! Saved bytes of the package are what the columns would take if they were there and zero: with the
//! coder `fixed` those of its columns before entropy coding, with the coder `context`, which learns
//! that a column is zero, hardly any. Saved bytes of the GPU are those of the player's records.

use codec::{Clip, Coder, Contents, MOTION_ORDER_MAX, Region, SH_DEGREE_MAX, SectionKind};
use serde::Serialize;
use shaders::{Motion, layout, sh_words};

/// Numbers that a Gaussian has of a part, and bits of each in the chunks of the coder `fixed`
/// (FORMAT.md). The ranges at the start of a chunk, 4 bytes a part, are not counted.
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

/// Bytes that the coder `context` takes for zeros in one column of a chunk, until it knows them:
/// measured, on chunks of any size.
const ZEROS_BYTES: usize = 5;

/// An optional part that is absent from some Gaussians.
#[derive(Serialize)]
pub(super) struct LeftOut {
    pub(super) part: String,
    /// Gaussians without it.
    pub(super) gaussians: usize,
    /// Package bytes that it would take.
    pub(super) bytes_saved: usize,
    /// Bytes it would take in GPU buffers.
    pub(super) gpu_bytes_saved: usize,
}

/// Gaussians that lack a part, and their chunks.
#[derive(Clone, Copy)]
struct Rows {
    gaussians: usize,
    chunks: usize,
}

/// Every optional part that Gaussians of the package do without. Together they are the
/// difference to a package of which every Gaussian has every part.
pub(super) fn left_out(contents: &Contents, clip: &Clip) -> Vec<LeftOut> {
    let mut parts = Vec::new();
    let mut add = |part: String, Rows { gaussians, chunks }: Rows, columns: &[Columns], gpu_words: usize| {
        let numbers: usize = columns.iter().map(|columns| columns.numbers).sum();
        let bits: usize = columns.iter().map(|columns| columns.numbers * columns.bits).sum();
        parts.push(LeftOut {
            part,
            gaussians,
            bytes_saved: match contents.coder {
                Coder::Fixed => gaussians * bits / 8,
                Coder::Context => chunks * numbers * ZEROS_BYTES,
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
    if clip.plate.is_none() {
        // Its Gaussians would be its whole cost, and there are none.
        add("plate".to_owned(), Rows { gaussians: 0, chunks: 0 }, &[], 0);
    }
    parts
}

/// Chunks of a region in the layers that the clip has.
fn chunks_of(contents: &Contents, clip: &Clip, region: Region) -> usize {
    let is_one = |section: &&codec::Section| {
        section.kind == SectionKind::Gaussians
            && section.region == region
            && usize::from(section.layer) < clip.layers.len()
    };
    contents.sections.iter().filter(is_one).count()
}

/// Bytes of the Gaussians in GPU buffers.
pub(super) fn gpu_bytes(contents: &Contents, clip: &Clip) -> usize {
    let record = |degree: u8| size_of::<layout::Gaussian>() + 4 * sh_words(degree);
    let motion = Motion { order: contents.motion_order, rotates: contents.rotation_rates };
    let plate = clip.plate.as_ref().map_or(0, |plate| plate.len() * record(plate.sh_degree));
    clip.len() * record(contents.sh_degree) + clip.dynamic_field.len() * 4 * motion.words() + plate
}
