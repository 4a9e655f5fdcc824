//! This project's own field file: a lossless superset of the PLY of 3D Gaussian Splatting.
//!
//! Specified in `xtask/FIELD.md`; written by `export` of the host tool.

use codec::{MOTION_ORDER_MAX, PixelFilter, Viewpoint};

use crate::budget::ImportBudget;
use crate::imported::{Hints, Imported, Repairs};
use crate::inria;
use crate::ply::{Ply, Table};

/// First word of the comments that hold metadata.
pub const MARK: &str = "aarc";

/// Version of the format.
pub const VERSION: &str = "1";

/// Maximum length of [`Viewpoint::name`] in bytes.
pub(crate) const NAME_MAX: usize = 63;

/// Whether the comments mark a field file.
pub(crate) fn is_marked(ply: &Ply) -> bool {
    metadata(ply).any(|(key, _)| key == "field")
}

/// Reads the rows of a field.
pub(crate) fn read(vertex: &Table, budget: &mut ImportBudget) -> Result<Imported, String> {
    let mut field = inria::static_columns(vertex, budget)?;
    let repairs = Repairs::of_truncated(vertex.missing_rows());

    let rows = 0..vertex.rows;
    if vertex.has("aarc_opacity") {
        let [exact] = vertex.find(["aarc_opacity"])?;
        field.opacities.clear();
        field.opacities.extend(rows.clone().map(|row| vertex.get(row, exact) as f32));
    }
    if vertex.has("tau") {
        let [tau, s] = vertex.find(["tau", "s"])?;
        let powers: Vec<[usize; 3]> = (1..=MOTION_ORDER_MAX)
            .take_while(|power| vertex.has(&format!("motion_{power}_x")))
            .map(|power| vertex.find(["x", "y", "z"].map(|axis| format!("motion_{power}_{axis}"))))
            .collect::<Result<_, _>>()?;
        let rates = match vertex.has("rot_rate_0") {
            true => Some(vertex.find([0, 1, 2, 3].map(|k| format!("rot_rate_{k}")))?),
            false => None,
        };
        let mut temporal = budget.temporal(vertex.rows, powers.len() as u8)?;
        for row in rows.clone() {
            temporal.tau.push(vertex.get(row, tau) as f32);
            temporal.s.push(vertex.get(row, s) as f32);
            temporal.motion.extend(powers.iter().map(|&power| vertex.row(row, power)));
        }
        if let Some(rates) = rates {
            let mut column = budget.vec(vertex.rows)?;
            column.extend(rows.map(|row| vertex.row(row, rates)));
            temporal.rotation_rates = Some(column);
        }
        field.temporal = Some(temporal);
    }
    Ok(Imported { field, hints: Hints::default(), repairs, format: "field file", notes: Vec::new() })
}

/// Keys and values of the metadata comments.
fn metadata<'p>(ply: &'p Ply) -> impl Iterator<Item = (&'p str, &'p str)> {
    ply.comments.iter().filter_map(|comment| {
        let (mark, rest) = comment.split_once(' ')?;
        (mark == MARK).then(|| rest.split_once(' ').unwrap_or((rest, "")))
    })
}

/// The metadata in the comments of any PLY; `export --ply --at` of the host tool writes some of it.
///
/// # Errors
/// One sentence that names the comment that cannot be used.
pub(crate) fn hints(ply: &Ply) -> Result<Hints, String> {
    let mut hints = Hints::default();
    for (key, value) in metadata(ply) {
        let wrong = || format!("comment {MARK} {key}: cannot use `{value}`");
        let positive = || numbers::<1>(value).map(|[x]| x).filter(|&x| x > 0.0).ok_or_else(wrong);
        match key {
            "field" if value == VERSION => {}
            "field" => return Err(format!("field file of version {value}, only {VERSION} is known")),
            "duration_s" => hints.duration_s = Some(positive()?),
            "fps" => hints.fps = Some(positive()?),
            "metres_per_unit" => hints.metres_per_unit = Some(positive()?),
            "up" => hints.up = Some(numbers(value).filter(is_unit).ok_or_else(wrong)?),
            "viewpoint" => hints.viewpoints.push(viewpoint(value).ok_or_else(wrong)?),
            // 0 states that nothing fades.
            "near" => {
                hints.near = Some(numbers::<1>(value).map(|[x]| x).filter(|&x| x >= 0.0).ok_or_else(wrong)?)
            }
            "filter" => {}
            // The host tool reads those on the fit; later versions may add keys.
            _ => hints.comments.push((key.into(), value.into())),
        }
    }
    Ok(hints)
}

/// The filter in the comments of any PLY; the filter of most fields if the comments name no filter.
///
/// # Errors
/// One sentence that names the comment, if it names no filter.
pub(crate) fn filter(ply: &Ply) -> Result<PixelFilter, String> {
    match metadata(ply).find(|(key, _)| *key == "filter") {
        None => Ok(PixelFilter::default()),
        Some((key, value)) => {
            PixelFilter::named(value).ok_or_else(|| format!("comment {MARK} {key}: cannot use `{value}`"))
        }
    }
}

/// Parses `position target fov_y name`; the name is the rest of the line.
fn viewpoint(value: &str) -> Option<Viewpoint> {
    let mut words = value.splitn(8, ' ');
    let mut next = || words.next()?.parse().ok().filter(|x: &f32| x.is_finite());
    let position = [next()?, next()?, next()?];
    let target = [next()?, next()?, next()?];
    let fov_y = next().filter(|fov| (0.0..std::f32::consts::PI).contains(fov))?;
    let name = words.next().unwrap_or_default().to_owned();
    (name.len() <= NAME_MAX).then_some(Viewpoint { name, position, target, fov_y })
}

/// Exactly `N` finite numbers.
fn numbers<const N: usize>(value: &str) -> Option<[f32; N]> {
    let parsed: Option<Vec<f32>> = value.split(' ').map(|word| word.parse().ok()).collect();
    parsed?.try_into().ok().filter(|all: &[f32; N]| all.iter().all(|x| x.is_finite()))
}

fn is_unit(v: &[f32; 3]) -> bool {
    (v.iter().map(|x| x * x).sum::<f32>() - 1.0).abs() < 1e-3
}
