//! The parameters of the player, and their values from the finest to the coarsest.

use client::gpu::{ChannelDepth, Cutoff, Level, RenderSettings, SortOrder};
use codec::Clip;
use glam::UVec2;

use super::bench::{Variant, VariantContent};
use super::reduce::{to_motion_order, to_sh_degree, without_rotation};

/// A parameter to sweep.
pub(super) struct Sweep {
    pub(super) name: &'static str,
    pub(super) about: &'static str,
    /// See [`Parameter::why_default`](crate::parameter::Parameter::why_default).
    pub(super) why_default: &'static str,
    pub(super) values: Vec<Value>,
}

/// One of its values.
pub(super) struct Value {
    pub(super) label: String,
    /// Whether it is the player's default.
    pub(super) default: bool,
    /// How it is drawn; `None` for the player as it is.
    pub(super) variant: Option<Variant>,
}

/// Parts of the image's sides.
const SIDES: [f32; 5] = [0.85, 0.7, 0.6, 0.5, 0.35];

/// Least opacities at the instant, in 255ths.
const LEAST_ALIVE: [f64; 5] = [2.0, 4.0, 8.0, 16.0, 32.0];

/// Why defaults show all that a clip holds.
const AS_STORED: &str = "the player shows all that a package holds";

/// The parameters that make a difference to `clip`, in pictures of `size` pixels.
// Long: a table of parameters and their values.
pub(super) fn sweeps(clip: &Clip, size: UVec2) -> Vec<Sweep> {
    let mut sweeps = vec![
        layers(clip),
        levels(clip, size),
        settings(
            "cutoff",
            "How far a Gaussian reaches: to where its alpha falls to 1/255, or no farther than so many \
             standard deviations.",
            "fields are fitted with it",
            "exact",
            [("sqrt 8", Cutoff::Sqrt8), ("sqrt 5", Cutoff::Sqrt5)].map(|(label, cutoff)| {
                (label.into(), RenderSettings { cutoff, ..RenderSettings::default() })
            }),
        ),
        settings(
            "sort",
            "What Gaussians are sorted by, in every frame: the depth that fields are fitted with, or the \
             distance from the eye, which does not change when the head turns.",
            "fields are fitted with it",
            "depth",
            [("radial".into(), RenderSettings { sort: SortOrder::Radial, ..RenderSettings::default() })],
        ),
        Sweep {
            name: "temporal cull",
            about: "Gaussians that are fainter than this at the instant are not drawn.",
            why_default: "a Gaussian of this opacity is the faintest that changes an image of 8 bits",
            values: with_default(
                "1/255",
                LEAST_ALIVE.map(|least| {
                    let content = VariantContent::Alive(least / 255.0);
                    (format!("{least}/255"), Variant { content, ..Variant::default() })
                }),
            ),
        },
        Sweep {
            name: "resolution scale",
            about: "Part of the image's sides that is drawn; the rest is interpolation.",
            why_default: "the player draws all pixels unless frames take too long",
            values: with_default(
                "1",
                SIDES.map(|side| {
                    let drawn = (size.as_vec2() * side).round().as_uvec2().max(UVec2::ONE);
                    (format!("{side}"), Variant { size: Some(drawn), ..Variant::default() })
                }),
            ),
        },
        target(),
    ];
    sweeps.extend(content(
        "SH degree",
        "Degree of the spherical harmonics that are evaluated.",
        clip.sh_degree(),
        |degree| to_sh_degree(clip, degree),
    ));
    sweeps.extend(content(
        "motion order",
        "Highest power of time in trajectories; lower ones are expansions about the middle of a Gaussian's \
         life.",
        clip.dynamic_field.motion_order(),
        |order| to_motion_order(clip, order),
    ));
    if clip.dynamic_field.temporal.as_ref().is_some_and(|temporal| temporal.rotation_rates.is_some()) {
        let content = VariantContent::Other(Box::new(without_rotation(clip)));
        sweeps.push(Sweep {
            name: "rotation over time",
            about: "Whether Gaussians turn; without, they stay as in the middle of their life.",
            why_default: AS_STORED,
            values: with_default("turning", [("still".into(), Variant { content, ..Variant::default() })]),
        });
    }
    sweeps.retain(|sweep| sweep.values.len() > 1);
    for sweep in &mut sweeps {
        for Value { label, variant, .. } in &mut sweep.values {
            if let Some(variant) = variant {
                variant.name = format!("{}: {label}", sweep.name);
            }
        }
    }
    sweeps
}

/// The values of a parameter: what the player takes, then others.
fn with_default(default: &str, others: impl IntoIterator<Item = (String, Variant)>) -> Vec<Value> {
    let other = |(label, variant): (String, Variant)| Value { label, default: false, variant: Some(variant) };
    let mut values = vec![Value { label: default.into(), default: true, variant: None }];
    values.extend(others.into_iter().map(other));
    values
}

fn settings(
    name: &'static str,
    about: &'static str,
    why_default: &'static str,
    default: &str,
    others: impl IntoIterator<Item = (String, RenderSettings)>,
) -> Sweep {
    let variant = |(label, settings)| (label, Variant { settings, ..Variant::default() });
    Sweep { name, about, why_default, values: with_default(default, others.into_iter().map(variant)) }
}

/// A sweep over what is in the clip, from `most` down to 0; none where `most` is 0.
fn content(name: &'static str, about: &'static str, most: u8, reduced: impl Fn(u8) -> Clip) -> Option<Sweep> {
    let variant = |value: u8| {
        let content = VariantContent::Other(Box::new(reduced(value)));
        (value.to_string(), Variant { content, ..Variant::default() })
    };
    let values = with_default(&most.to_string(), (0..most).rev().map(variant));
    (most > 0).then_some(Sweep { name, about, why_default: AS_STORED, values })
}

/// Gaussians of the clip in the first layer, the first two, and so on.
fn layer_ends(clip: &Clip) -> Vec<usize> {
    clip.layers.iter().map(|end| end.total()).collect()
}

fn layers(clip: &Clip) -> Sweep {
    let ends = layer_ends(clip);
    let others = ends.iter().enumerate().rev().skip(1).map(|(layer, end)| {
        (end.to_string(), RenderSettings { layers: Some(layer + 1), ..RenderSettings::default() })
    });
    settings(
        "layers",
        "How many Gaussians are drawn, the most important first, in layers of the package.",
        AS_STORED,
        &clip.len().to_string(),
        others,
    )
}

fn levels(clip: &Clip, size: UVec2) -> Sweep {
    let variant = |level: Level| {
        let settings = level.settings(RenderSettings::default(), &layer_ends(clip));
        let size = Some(level.size(size)).filter(|&drawn| drawn != size);
        (level.name().to_owned(), Variant { settings, size, ..Variant::default() })
    };
    Sweep {
        name: "quality",
        about: "Quality levels of the player in a headset, lowered while frames take too long; each sets \
                several of the other parameters.",
        why_default: "the player lowers the quality only while frames take too long",
        values: with_default(Level::Exact.name(), Level::ALL.into_iter().skip(1).map(variant)),
    }
}

/// Both are defaults: images are made with 16 bits, windows and headsets have 8.
fn target() -> Sweep {
    let eight = Variant { depth: ChannelDepth::Eight, ..Variant::default() };
    let mut values = with_default("16 bits (images)", [("8 bits (windows, headsets)".into(), eight)]);
    values.iter_mut().for_each(|value| value.default = true);
    Sweep {
        name: "target",
        about: "Bits per channel of what is drawn into. Images are made with 16, windows and headsets show 8; \
                all other parameters are measured with 16.",
        why_default: "windows and headsets take 8 bits, and files of images keep 16",
        values,
    }
}
