//! SOG version 2 of PlayCanvas: one static field as a set of images.
//!
//! `meta.json` names the images and holds ranges and tables; pixel `i` in reading order belongs to
//! Gaussian `i`. Centres are 16 bits over two images, in a space compressed by
//! `sign(x) ln(|x| + 1)`. Log-scales and SH are bytes that index tables of 256 values. Quaternions
//! are three bytes in `[-1, 1] / sqrt(2)` and one that names the omitted component.
//! Higher SH comes from a palette: two bytes per Gaussian name an entry, which is a run of pixels,
//! 64 entries to a line. The files lie in a folder or, bundled, in a ZIP archive.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::io::{Cursor, Read};
use std::path::Path;

use codec::{PixelFilter, SH_DEGREE_MAX, sh_coefficients};
use image::{ImageReader, RgbaImage};
use serde::Deserialize;
use serde::de::IgnoredAny;

use crate::account::Repairs;
use crate::columns::with_largest;
use crate::imported::Imported;
use crate::limits::ImportBudget;
use crate::spz::ASSUMED_VARIANCE;
use crate::statements::{Statement, Treatment, honoured, ignored, noted, treatment, unread};

/// Name of the file that names the others.
pub const INDEX: &str = "meta.json";

/// Name of the file that names the parts of a streamed SOG.
pub(crate) const STREAMED_INDEX: &str = "lod-meta.json";

/// The first bytes of a bundle.
pub(crate) const START: &[u8] = b"PK\x03\x04";

/// Longest `meta.json`: its tables of 256 numbers take some 20 kB.
const INDEX_MAX: usize = 1 << 20;

/// Most bytes of memory for a byte of `meta.json`: an unknown key of one character.
const BYTES_PER_INDEX_BYTE: u64 = 16;

/// Bytes of memory per pixel of an image: within its decoder, decoded, and as RGBA.
const BYTES_PER_PIXEL: u64 = 12;

/// Most pixels of an image of `count` Gaussians beyond `2 * count`. Writers pad images to whole lines.
const PADDING_MAX: u64 = 1 << 16;

/// The keys of `meta.json`.
pub(crate) const STATEMENTS: &[Statement] = &[
    honoured("version count means scales quats sh0 shN", "the columns"),
    honoured("antialias model", "the filter, without its variance; another model than `default` is noted"),
    ignored("asset extras", "the program that wrote it, and what it attached"),
    noted("any other key", "not read"),
    noted("lod-meta.json", "refused: one part of a streamed SOG is not the field"),
];

/// The value of `model` that says what `antialias` says.
const ANTIALIASED: &str = "antialiased";

/// Entries of the SH palette per line of its image.
const PALETTE_COLUMNS: usize = 64;

#[derive(Deserialize)]
struct Meta {
    count: usize,
    means: Means,
    scales: Coded,
    quats: Quats,
    sh0: Coded,
    #[serde(rename = "shN")]
    sh_n: Option<Palette>,
    antialias: Option<bool>,
    /// How splat-transform states the same, and more.
    model: Option<String>,
}

#[derive(Deserialize)]
struct Means {
    mins: [f64; 3],
    maxs: [f64; 3],
    files: [String; 2],
}

#[derive(Deserialize)]
struct Coded {
    codebook: Vec<f32>,
    files: [String; 1],
}

#[derive(Deserialize)]
struct Quats {
    files: [String; 1],
}

#[derive(Deserialize)]
struct Palette {
    count: usize,
    bands: u8,
    codebook: Vec<f32>,
    files: [String; 2],
}

/// Reads the rows of a bundle, or of the file set in `folder` with this `meta.json`.
pub(crate) fn read(bytes: &[u8], folder: &Path, budget: &mut ImportBudget) -> Result<Imported, String> {
    if bytes.starts_with(START) {
        return read_bundle(bytes, budget);
    }
    let load = |name: &str, budget: &mut ImportBudget| {
        budget.read_file(&folder.join(name)).map_err(|error| format!("{name}: {error}"))
    };
    read_files(bytes, load, budget)
}

fn read_bundle(bytes: &[u8], budget: &mut ImportBudget) -> Result<Imported, String> {
    let mut archive = zip::ZipArchive::new(Cursor::new(bytes)).map_err(|error| format!("ZIP: {error}"))?;
    let folder = folder_of_index(archive.file_names().flatten())?;
    let mut load = |name: &str, budget: &mut ImportBudget| {
        let wrong = |error: String| format!("{name} in the ZIP: {error}");
        let file = archive.by_name(&format!("{folder}{name}")).map_err(|error| wrong(error.to_string()))?;
        let size = file.size();
        ImportBudget::check_ratio(file.compressed_size(), size).map_err(wrong)?;
        let mut content = budget.vec(usize::try_from(size).unwrap_or(usize::MAX)).map_err(wrong)?;
        // One byte more would come before the checksum is compared.
        file.take(size.saturating_add(1))
            .read_to_end(&mut content)
            .map_err(|error| wrong(error.to_string()))?;
        Ok(content)
    };
    let meta = load(INDEX, budget)?;
    read_files(&meta, load, budget)
}

/// The path before the names of the files of a field in a ZIP: nothing, or the folder that was packed.
///
/// # Errors
/// One sentence if there is no [`INDEX`], or several.
fn folder_of_index<'n>(names: impl Iterator<Item = Cow<'n, str>>) -> Result<String, String> {
    let folders = names.filter_map(|name| Some(name.strip_suffix(INDEX)?.to_owned()));
    let mut folders: Vec<String> =
        folders.filter(|before| before.is_empty() || before.ends_with('/')).collect();
    folders.sort_unstable();
    match &mut folders[..] {
        [first, rest @ ..] if first.is_empty() || rest.is_empty() => Ok(std::mem::take(first)),
        [] => Err(format!("a ZIP without {INDEX} is no SOG; unpack it, and name the field in it")),
        several => {
            let count = several.len();
            Err(format!("a ZIP with {count} fields, each with a {INDEX}; unpack it, and name one"))
        }
    }
}

// Long: one image after the other, then one row after the other.
fn read_files(
    meta: &[u8],
    mut load: impl FnMut(&str, &mut ImportBudget) -> Result<Vec<u8>, String>,
    budget: &mut ImportBudget,
) -> Result<Imported, String> {
    let (meta, unread) = parse_meta(meta, budget)?;
    let mut image = |name: &str, pixels_max: u64, budget: &mut ImportBudget| -> Result<RgbaImage, String> {
        // A file set is flat; a path would lead outside its folder.
        if Path::new(name).file_name() != Some(OsStr::new(name)) {
            return Err(format!("meta.json names `{name}`, which is not a plain file name"));
        }
        decode(&load(name, budget)?, pixels_max, budget).map_err(|error| format!("{name}: {error}"))
    };
    let mut column = |name: &str, budget: &mut ImportBudget| -> Result<RgbaImage, String> {
        let image = image(name, (2 * meta.count as u64).saturating_add(PADDING_MAX), budget)?;
        let pixels = image.pixels().len();
        match pixels >= meta.count {
            true => Ok(image),
            false => Err(format!("{name} has {pixels} pixels for {} Gaussians", meta.count)),
        }
    };
    let [low, high] = &meta.means.files;
    let (low, high) = (column(low, budget)?, column(high, budget)?);
    let quats = column(&meta.quats.files[0], budget)?;
    let scales = column(&meta.scales.files[0], budget)?;
    let colors = column(&meta.sh0.files[0], budget)?;
    let scale_table = table("scales", &meta.scales.codebook)?;
    let color_table = table("sh0", &meta.sh0.codebook)?;
    let palette = match &meta.sh_n {
        Some(palette) => {
            let [_, labels] = &palette.files;
            let labels = column(labels, budget)?;
            Some(Sh::load(palette, labels, |name, pixels_max| image(name, pixels_max, budget))?)
        }
        None => None,
    };

    let mut repairs = Repairs::default();
    let sh_degree = palette.as_ref().map_or(0, |palette| palette.degree);
    let mut field = budget.field(meta.count, sh_degree)?;
    for i in 0..meta.count {
        let (low, high) = (pixel(&low, i), pixel(&high, i));
        field.centers.push(std::array::from_fn(|axis| {
            let t = f64::from(u16::from_le_bytes([low[axis], high[axis]])) / 65535.0;
            let (min, max) = (meta.means.mins[axis], meta.means.maxs[axis]);
            let compressed = min + (max - min) * t;
            (compressed.abs().exp_m1().copysign(compressed)) as f32
        }));
        field.rotations.push(unpack_rotation(pixel(&quats, i)));
        let [x, y, z, _] = pixel(&scales, i);
        field.log_scales.push([x, y, z].map(|byte| scale_table[usize::from(byte)]));
        let [r, g, b, opacity] = pixel(&colors, i);
        field.opacities.push(f32::from(opacity) / 255.0);
        field.sh.push([r, g, b].map(|byte| color_table[usize::from(byte)]));
        if let Some(palette) = &palette {
            palette.push_row(i, &mut field.sh, &mut repairs);
        }
    }
    let model = meta.model.filter(|model| model != "default");
    let is_antialiased = meta.antialias == Some(true) || model.as_deref() == Some(ANTIALIASED);
    if is_antialiased {
        field.filter = PixelFilter::Mip;
    }
    let mut imported = Imported::new("SOG", field, repairs);
    imported.account.assumed.extend(is_antialiased.then(|| ASSUMED_VARIANCE.into()));
    let unknown = model.filter(|model| model != ANTIALIASED);
    imported.account.lost.extend(
        unknown.map(|model| format!("{INDEX}: the model `{model}` is not known, drawn as `default`")),
    );
    imported.account.lost.extend(unread.map(|keys| format!("{INDEX}: keys that are not read: {keys}")));
    Ok(imported)
}

/// Why the index of a streamed SOG is refused.
pub(crate) fn streamed(index: &[u8]) -> String {
    #[derive(Default, Deserialize)]
    #[serde(rename_all = "camelCase", default)]
    struct Index {
        lod_levels: usize,
        filenames: Vec<IgnoredAny>,
    }
    let Index { lod_levels, filenames } = serde_json::from_slice(index).unwrap_or_default();
    let parts = filenames.len();
    format!(
        "a streamed SOG of {lod_levels} levels of detail in {parts} parts, which is not read: one part is not the \
         field; export it as one .sog or .ply, for example with splat-transform"
    )
}

fn of_version(version: u32) -> String {
    format!(
        "SOG of version {version}, and 2 is read; export the field again with today's splat-transform or SuperSplat"
    )
}

/// The contents of `meta.json`, and its keys that are not read.
fn parse_meta(bytes: &[u8], budget: &mut ImportBudget) -> Result<(Meta, Option<String>), String> {
    if bytes.len() > INDEX_MAX {
        return Err(format!("{INDEX} of {} bytes, and {INDEX_MAX} are the most", bytes.len()));
    }
    budget.spend(BYTES_PER_INDEX_BYTE * bytes.len() as u64)?;
    let wrong = |error: serde_json::Error| format!("meta.json: {error}");
    #[derive(Deserialize)]
    struct Version {
        version: Option<u32>,
        means: Option<IgnoredAny>,
    }
    let version: Version = serde_json::from_slice(bytes).map_err(wrong)?;
    match version.version {
        Some(2) => {
            let meta = serde_json::from_slice(bytes).map_err(wrong)?;
            let keys: BTreeMap<String, IgnoredAny> = serde_json::from_slice(bytes).map_err(wrong)?;
            let others = keys.keys().map(String::as_str);
            let others = others.filter(|key| treatment(STATEMENTS, key) != Treatment::Honoured);
            Ok((meta, unread(STATEMENTS, others)))
        }
        Some(version) => Err(of_version(version)),
        // The first version stated none.
        None if version.means.is_some() => Err(of_version(1)),
        None => Err("it states no version of SOG, as the meta.json of a field does".into()),
    }
}

/// Decodes an image of at most `pixels_max` pixels.
fn decode(bytes: &[u8], pixels_max: u64, budget: &mut ImportBudget) -> Result<RgbaImage, String> {
    let reader =
        || ImageReader::new(Cursor::new(bytes)).with_guessed_format().map_err(|error| error.to_string());
    let (width, height) = reader()?.into_dimensions().map_err(|error| error.to_string())?;
    let pixels = u64::from(width) * u64::from(height);
    if pixels > pixels_max {
        return Err(format!("{width} x {height} pixels are more than its Gaussians need"));
    }
    let bytes_max = pixels * BYTES_PER_PIXEL;
    budget.spend(bytes_max)?;
    let mut reader = reader()?;
    let mut limits = image::Limits::default();
    limits.max_alloc = Some(bytes_max);
    reader.limits(limits);
    Ok(reader.decode().map_err(|error| error.to_string())?.into_rgba8())
}

/// A table that a byte may index.
fn table<'t>(name: &str, codebook: &'t [f32]) -> Result<&'t [f32; 256], String> {
    codebook
        .try_into()
        .map_err(|_| format!("meta.json: the codebook of {name} has {} values, not 256", codebook.len()))
}

fn pixel(image: &RgbaImage, i: usize) -> [u8; 4] {
    std::array::from_fn(|k| image.as_raw()[4 * i + k])
}

/// A tag of 252 to 255 says that w, x, y or z is left out; other tags give the zero quaternion.
fn unpack_rotation([a, b, c, tag]: [u8; 4]) -> [f32; 4] {
    let Some(largest) = tag.checked_sub(252).map(usize::from) else { return [0.0; 4] };
    let small = [a, b, c].map(|byte| (f64::from(byte) / 255.0 * 2.0 - 1.0) * std::f64::consts::FRAC_1_SQRT_2);
    with_largest(largest, small).map(|x| x as f32)
}

/// Higher SH coefficients by palette.
struct Sh<'m> {
    degree: u8,
    entries: usize,
    table: &'m [f32; 256],
    labels: RgbaImage,
    centroids: RgbaImage,
}

impl<'m> Sh<'m> {
    fn load(
        palette: &'m Palette,
        labels: RgbaImage,
        image: impl FnOnce(&str, u64) -> Result<RgbaImage, String>,
    ) -> Result<Sh<'m>, String> {
        let degree = palette.bands;
        if !(1..=SH_DEGREE_MAX).contains(&degree) {
            return Err(format!("meta.json: shN has {degree} bands, not 1 to {SH_DEGREE_MAX}"));
        }
        let [name, _] = &palette.files;
        let width = PALETTE_COLUMNS * (sh_coefficients(degree) - 1);
        let height = palette.count.div_ceil(PALETTE_COLUMNS);
        let pixels = (2 * width as u64).saturating_mul(height as u64).saturating_add(PADDING_MAX);
        let centroids = image(name, pixels)?;
        let size = (centroids.width() as usize, centroids.height() as usize);
        if size.0 != width || size.1 < height {
            return Err(format!("{name} is {} x {} pixels, not {width} x {height}", size.0, size.1));
        }
        let table = table("shN", &palette.codebook)?;
        Ok(Sh { degree, entries: palette.count, table, labels, centroids })
    }

    /// Appends the coefficients of Gaussian `i`.
    fn push_row(&self, i: usize, sh: &mut Vec<[f32; 3]>, repairs: &mut Repairs) {
        let rest = sh_coefficients(self.degree) - 1;
        let [low, high, ..] = pixel(&self.labels, i);
        let entry = usize::from(u16::from_le_bytes([low, high]));
        if entry >= self.entries {
            repairs.repair_rows("SH label outside the palette", 1);
            sh.extend(std::iter::repeat_n([0.0; 3], rest));
            return;
        }
        // Entries follow each other in reading order, as lines are whole numbers of entries.
        sh.extend((0..rest).map(|k| {
            let [r, g, b, _] = pixel(&self.centroids, entry * rest + k);
            [r, g, b].map(|byte| self.table[usize::from(byte)])
        }));
    }
}
