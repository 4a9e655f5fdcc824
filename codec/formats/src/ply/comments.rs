//! The metadata of a clip in the comments of a PLY, as `xtask/FIELD.md` specifies them: a comment is [`MARK`], a key and
//! a value. Comments of other programs state the filter and the up axis.

use codec::{ClipInfo, Field, NAME_BYTES_MAX, PixelFilter, Viewpoint};

use crate::imported::Hints;
use crate::overrides::normalized;
use crate::spz::ASSUMED_VARIANCE;

use super::container::Ply;

/// First word of the comments that hold metadata.
pub const MARK: &str = "aarc";

/// Version of the field file.
pub const VERSION: &str = "1";

/// Key of the comment that marks a field file, whose value is its version.
const FIELD: &str = "field";

/// Mip-Splatting's standard deviation of the filter in space, in units.
pub(super) const FILTER_3D: &str = "filter_3D";

/// Whether the comments mark a field file.
pub(super) fn is_marked(ply: &Ply) -> bool {
    metadata(ply).any(|(key, _)| key == FIELD)
}

/// The comment that marks a field file.
pub(super) fn mark() -> String {
    comment(FIELD, VERSION)
}

/// The comment of a key and its value.
pub(super) fn comment(key: &str, value: impl std::fmt::Display) -> String {
    format!("{MARK} {key} {value}")
}

/// Keys and values of the metadata comments.
fn metadata<'p>(ply: &'p Ply) -> impl Iterator<Item = (&'p str, &'p str)> {
    ply.comments.iter().filter_map(|comment| {
        let (mark, rest) = comment.split_once(' ')?;
        (mark == MARK).then(|| rest.split_once(' ').unwrap_or((rest, "")))
    })
}

/// The metadata in the comments of any PLY; a static one that this project wrote has some, too.
///
/// # Errors
/// One sentence that names the comment that cannot be used.
pub(super) fn hints(ply: &Ply) -> Result<Hints, String> {
    let mut hints = Hints::default();
    for (key, value) in metadata(ply) {
        let wrong = || format!("comment {MARK} {key}: cannot use `{value}`");
        let positive = || numbers::<1>(value).map(|[x]| x).filter(|&x| x > 0.0).ok_or_else(wrong);
        match key {
            FIELD if value == VERSION => {}
            FIELD => {
                return Err(format!(
                    "field file of version {value}, and {VERSION} is read; update this program"
                ));
            }
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
            // The host tool reads the comments on a fit; later versions may add keys.
            _ => hints.comments.push((key.into(), value.into())),
        }
    }
    hints.up = hints.up.or_else(|| foreign_up(ply));
    Ok(hints)
}

/// The comment on the up axis as nerfstudio spells it: its letter, after which up points. Brush writes `Vertical axis: y`
/// whatever the axes of the capture are, and others three numbers.
const UP: &str = "Vertical Axis";

/// Brush's comment on the filter: `default` or `mip`.
const RENDER_MODE: &str = "SplatRenderMode";

/// Postshot's comment on the filter: 0 or 1.
const ANTIALIASED: &str = "antialiased";

/// A comment of another program with this key, in any case: the key as the file spells it, and its value.
fn foreign<'p>(ply: &'p Ply, key: &str) -> Option<(&'p str, &'p str)> {
    ply.comments.iter().find_map(|comment| {
        let (spelled, value) = comment.split_at_checked(key.len())?;
        let is_it = spelled.eq_ignore_ascii_case(key) && value.starts_with([' ', ':']);
        is_it.then(|| (spelled, value.trim_start_matches([' ', ':']).trim_end()))
    })
}

/// The value of a comment of another program, in lower case.
fn foreign_word(ply: &Ply, key: &str) -> Option<String> {
    foreign(ply, key).map(|(_, value)| value.to_ascii_lowercase())
}

/// The up axis that a comment of another program states.
fn foreign_up(ply: &Ply) -> Option<[f32; 3]> {
    let (spelled, value) = foreign(ply, UP)?;
    let letter = || (spelled == UP).then(|| axis(value)).flatten();
    numbers(value).and_then(normalized).or_else(letter)
}

/// The unit vector of an axis by its letter, with or without a sign.
fn axis(value: &str) -> Option<[f32; 3]> {
    let (sign, letter) = match value.strip_prefix('-') {
        Some(letter) => (-1.0, letter),
        None => (1.0, value.strip_prefix('+').unwrap_or(value)),
    };
    let axis = ["x", "y", "z"].iter().position(|name| letter.eq_ignore_ascii_case(name))?;
    Some(std::array::from_fn(|k| if k == axis { sign } else { 0.0 }))
}

/// The filter of a file.
#[derive(Default)]
pub(super) struct Filter {
    pub(super) filter: PixelFilter,
    /// The note on how another program says so.
    pub(super) assumed: Option<String>,
}

/// The filter in the comments of any PLY. If they name none, the mip filter of Mip-Splatting, which alone has
/// [`FILTER_3D`], else the filter of most fields.
///
/// # Errors
/// One sentence that names the comment, if it names no filter.
pub(super) fn filter(ply: &Ply) -> Result<Filter, String> {
    if let Some((key, value)) = metadata(ply).find(|(key, _)| *key == "filter") {
        let filter = PixelFilter::named(value);
        let filter = filter.ok_or_else(|| format!("comment {MARK} {key}: cannot use `{value}`"))?;
        return Ok(Filter { filter, assumed: None });
    }
    let mip = |assumed: String| Filter { filter: PixelFilter::Mip, assumed: Some(assumed) };
    let (mode, flag) = (foreign_word(ply, RENDER_MODE), foreign_word(ply, ANTIALIASED));
    Ok(match (mode.as_deref(), flag.as_deref()) {
        (Some("mip"), _) => mip(format!("drawn with the mip filter, as its comment {RENDER_MODE} says")),
        (_, Some("1" | "true")) => mip(ASSUMED_VARIANCE.into()),
        (None, None) if ply.table("vertex").is_some_and(|vertex| vertex.has(FILTER_3D)) => {
            mip(format!("drawn with the mip filter, with which Mip-Splatting fits what has {FILTER_3D}"))
        }
        (Some("default") | None, Some("0" | "false") | None) => Filter::default(),
        (Some(value), _) => {
            let assumed =
                format!("its comment {RENDER_MODE}: {value} is not known; drawn with the default filter");
            Filter { assumed: Some(assumed), ..Filter::default() }
        }
        (None, Some(value)) => {
            let assumed =
                format!("its comment {ANTIALIASED} {value} is not known; drawn with the default filter");
            Filter { assumed: Some(assumed), ..Filter::default() }
        }
    })
}

/// The comment of another program that would change what is drawn and cannot be used.
pub(super) fn unread(ply: &Ply) -> Option<String> {
    let (spelled, value) = foreign(ply, UP).filter(|_| foreign_up(ply).is_none())?;
    Some(format!("its comment {spelled}: {value} does not say which way is up"))
}

/// The comments on a clip. Rust prints the shortest digits that read back as the same number.
pub(super) fn on_clip(info: &ClipInfo) -> Vec<String> {
    let vector = |v: [f32; 3]| format!("{} {} {}", v[0], v[1], v[2]);
    let mut comments = vec![
        comment("duration_s", info.duration_s),
        comment("fps", info.fps),
        comment("up", vector(info.up)),
        comment("metres_per_unit", info.metres_per_unit),
    ];
    comments.extend(info.viewpoints.iter().map(|view| {
        let name = view.name.replace(char::is_control, " ");
        let (position, target) = (vector(view.position), vector(view.target));
        comment("viewpoint", format_args!("{position} {target} {} {name}", view.fov_y))
    }));
    comments
}

/// The comments on how the Gaussians are drawn, where most fields differ: the filter, the near distance.
pub(super) fn on_drawing(field: &Field) -> impl Iterator<Item = String> {
    let Field { filter, near, .. } = *field;
    let filter = (filter != PixelFilter::default()).then(|| comment("filter", filter.name()));
    filter.into_iter().chain((near > 0.0).then(|| comment("near", near)))
}

/// Parses `position target fov_y name`; the name is the rest of the line.
fn viewpoint(value: &str) -> Option<Viewpoint> {
    let mut words = value.splitn(8, ' ');
    let mut next = || words.next()?.parse().ok().filter(|x: &f32| x.is_finite());
    let position = [next()?, next()?, next()?];
    let target = [next()?, next()?, next()?];
    let fov_y = next().filter(|fov| (0.0..std::f32::consts::PI).contains(fov))?;
    let name = words.next().unwrap_or_default().to_owned();
    (name.len() <= NAME_BYTES_MAX).then_some(Viewpoint { name, position, target, fov_y })
}

/// Exactly `N` finite numbers.
fn numbers<const N: usize>(value: &str) -> Option<[f32; N]> {
    let parsed: Option<Vec<f32>> = value.split(' ').map(|word| word.parse().ok()).collect();
    parsed?.try_into().ok().filter(|all: &[f32; N]| all.iter().all(|x| x.is_finite()))
}

fn is_unit(v: &[f32; 3]) -> bool {
    (v.iter().map(|x| x * x).sum::<f32>() - 1.0).abs() < 1e-3
}
