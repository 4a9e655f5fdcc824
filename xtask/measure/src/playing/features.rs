//! The optional features of clips: which of them a clip needs, and what it saves without the others.
//!
//! Savings are measured: a feature is switched on with columns of zeros, and the clip is rendered, counted and
//! packaged with it. Packages always drop columns of zeros, so for a package one Gaussian gets values that need the
//! feature.

use std::collections::BTreeMap;

use super::result::{ClipFeature, ResourceUse};
use client::gpu::{Gpu, SORT_DIGIT_BITS, SORT_DIGITS};
use codec::{
    Clip, Coder, EncodeOptions, Field, MOTION_ORDER_MAX, PixelFilter, SH_DEGREE_MAX, Source, sh_coefficients,
};
use shaders::{Features, Motion, Purpose, compose};

use super::bench::{EyeMode, Variant, VariantContent};
use super::measured::MeasuredVariant;
use super::pad;
use super::views::instants;

/// A feature, and a way to switch it on.
pub(super) struct FeatureToggle {
    name: String,
    left_out: bool,
    needs: String,
    switched_on: String,
    /// Counts that need no rendering: of the clip as it is, and with the feature.
    counts: [BTreeMap<String, f64>; 2],
    /// The variant without the feature; `None` for the clip as it is.
    without: Option<Variant>,
    /// The variant with the feature; `None` if rendering does not differ or nothing is switched on.
    with: Option<Variant>,
    /// Makes the input of a package with the feature.
    package: Option<Packing>,
}

/// Turns a clip into the input of a package with a feature.
type Packing = Box<dyn Fn(&Clip) -> Packable>;

/// The input of a package.
struct Packable {
    field: Field,
    plate: Option<Field>,
    layers: Vec<usize>,
}

impl FeatureToggle {
    /// The variants to render.
    pub(super) fn variants(&self) -> impl Iterator<Item = &Variant> {
        self.without.iter().chain(&self.with)
    }

    /// Whether a package with the feature is to be made.
    pub(super) fn packages(&self) -> bool {
        self.package.is_some()
    }

    /// The measured feature. `base` measures the clip as it is, `results` measure [`FeatureToggle::variants`].
    ///
    /// # Errors
    /// If a package cannot be made.
    pub(super) fn into_feature(
        self,
        clip: &Clip,
        base: &MeasuredVariant,
        results: &[MeasuredVariant],
    ) -> anyhow::Result<ClipFeature> {
        let [mut without, mut with] = self.counts.map(|counts| ResourceUse { counts, frame_ms: None });
        let drawn = |taken: &mut ResourceUse, measured: &MeasuredVariant| {
            taken.counts.extend(measured.inspection.counts.clone());
            taken.frame_ms = Some(measured.frame_ms());
        };
        if let (Some(_), Some(measured)) = (&self.with, results.last()) {
            drawn(&mut with, measured);
            drawn(&mut without, if self.without.is_some() { &results[0] } else { base });
        }
        if let Some(package) = &self.package {
            let as_it_is = Packable { field: ordered(clip), plate: clip.plate.clone(), layers: layers(clip) };
            without.counts.extend(package_bytes(clip, &as_it_is)?);
            with.counts.extend(package_bytes(clip, &package(clip))?);
        }
        let FeatureToggle { name, left_out, needs, switched_on, .. } = self;
        Ok(ClipFeature { name, left_out, needs, switched_on, without, with })
    }
}

/// All optional features of clips, for `clip` on `gpu`; `layers` are the ends of layers that `package` sets.
pub(super) fn features(clip: &Clip, gpu: &Gpu, layers: &[usize]) -> Vec<FeatureToggle> {
    let mut features = Vec::new();
    sh(clip, &mut features);
    motion(clip, &mut features);
    rotation(clip, &mut features);
    features.push(compensation(clip));
    features.extend([static_columns(clip), index(clip), plate(clip), layered(clip, layers)]);
    eyes(gpu, &mut features);
    features.push(sort_width(clip));
    features
}

/// A feature that the clip needs.
fn needed(name: String, needs: String) -> FeatureToggle {
    FeatureToggle {
        name,
        left_out: false,
        needs,
        switched_on: String::new(),
        counts: Default::default(),
        without: None,
        with: None,
        package: None,
    }
}

/// A feature that the clip does without; `with` is the clip with it.
fn left_out(feature: String, needs: String, switched_on: &str, clip: &Clip, with: Clip) -> FeatureToggle {
    let name = format!("with {feature}");
    FeatureToggle {
        left_out: true,
        switched_on: switched_on.into(),
        counts: [counts(clip), counts(&with)],
        with: Some(Variant { name, content: VariantContent::Other(Box::new(with)), ..Variant::default() }),
        ..needed(feature, needs)
    }
}

fn sh(clip: &Clip, features: &mut Vec<FeatureToggle>) {
    let depends = |field: &Field| {
        let varies = |i: &usize| field.sh_of(*i)[1..].iter().any(|c| *c != [0.0; 3]);
        (0..field.len()).filter(varies).count()
    };
    let of_clip = clip.sh_degree();
    if of_clip > 0 {
        let count = depends(&clip.static_field) + depends(&clip.dynamic_field);
        let needs = format!("{count} of {} Gaussians have view-dependent colour", clip.len());
        features.push(needed(format!("SH up to degree {of_clip}"), needs));
    }
    for degree in of_clip + 1..=SH_DEGREE_MAX {
        let needs = format!("no: nothing varies with the view beyond degree {of_clip}");
        let with = pad::with_sh_degree(clip, degree);
        let mut feature =
            left_out(format!("SH of degree {degree}"), needs, "coefficients of zero", clip, with);
        feature.package = Some(Box::new(move |clip| {
            let mut field = ordered(&pad::with_sh_degree(clip, degree));
            field.sh[sh_coefficients(degree) - 1] = [0.2; 3];
            packable(clip, field)
        }));
        features.push(feature);
    }
}

/// The clip with a dynamic region, which holds all Gaussians if the clip has none.
fn able_to_move(clip: &Clip) -> Clip {
    if clip.dynamic_field.is_empty() { pad::all_dynamic(clip) } else { clip.clone() }
}

fn motion(clip: &Clip, features: &mut Vec<FeatureToggle>) {
    let dynamic_count = clip.dynamic_field.len();
    let order = if dynamic_count > 0 { clip.dynamic_field.motion_order() } else { 0 };
    if order > 0 {
        let needs = format!("{dynamic_count} of {} Gaussians move or fade", clip.len());
        features.push(needed(format!("motion up to power {order}"), needs));
    }
    let switched_on =
        if dynamic_count > 0 { "coefficients of zero" } else { "windows, and coefficients of zero" };
    for order in order + 1..=MOTION_ORDER_MAX {
        let needs = "no: no trajectory has this power".into();
        let with = pad::with_motion_order(&able_to_move(clip), order);
        let mut feature = left_out(format!("motion of power {order}"), needs, switched_on, clip, with);
        feature.package = Some(Box::new(move |clip| {
            let mut field = windowed(ordered(&pad::with_motion_order(&able_to_move(clip), order)));
            let [low, high] = field.bounds();
            if let Some(temporal) = &mut field.temporal {
                temporal.motion[usize::from(order) - 1] =
                    [0, 1, 2].map(|axis| 0.02 * (high[axis] - low[axis]));
            }
            packable(clip, field)
        }));
        features.push(feature);
    }
}

fn rotation(clip: &Clip, features: &mut Vec<FeatureToggle>) {
    let rates = clip.dynamic_field.temporal.as_ref().and_then(|temporal| temporal.rotation_rates.as_ref());
    if let Some(rates) = rates {
        let count = rates.iter().filter(|rate| **rate != [0.0; 4]).count();
        let needs = format!("{count} of {} Gaussians rotate", clip.len());
        return features.push(needed("rotation over time".into(), needs));
    }
    let with = pad::with_rotation(&able_to_move(clip));
    let mut feature =
        left_out("rotation over time".into(), "no: no Gaussian rotates".into(), "rates of zero", clip, with);
    feature.package = Some(Box::new(|clip| {
        let mut field = windowed(ordered(&pad::with_rotation(&able_to_move(clip))));
        if let Some(rates) = field.temporal.as_mut().and_then(|temporal| temporal.rotation_rates.as_mut()) {
            rates[0] = [0.0, 0.5, 0.0, 0.0];
        }
        packable(clip, field)
    }));
    features.push(feature);
}

/// The mip filter's opacity. Frame times are not compared, because the filter changes the fragments, too.
fn compensation(clip: &Clip) -> FeatureToggle {
    let name = "opacity compensation".to_owned();
    if clip.filter().compensates() {
        return needed(name, "the clip has the mip filter".into());
    }
    let with = |field: &Field| Field { filter: PixelFilter::Mip, ..field.clone() };
    let compensated = Clip {
        static_field: with(&clip.static_field),
        dynamic_field: with(&clip.dynamic_field),
        ..clip.clone()
    };
    FeatureToggle {
        left_out: true,
        switched_on: "the mip filter".into(),
        counts: [counts(clip), counts(&compensated)],
        package: Some(Box::new(move |clip| packable(clip, with(&ordered(clip))))),
        ..needed(name, "no: the filter leaves opacities as they are".into())
    }
}

/// Windows and motion of the Gaussians that are always on and never move.
fn static_columns(clip: &Clip) -> FeatureToggle {
    let (static_count, name) = (clip.static_field.len(), "temporal columns of static Gaussians".to_owned());
    if static_count == 0 {
        return needed(name, "every Gaussian moves or fades".into());
    }
    let needs = format!("no: {static_count} of {} Gaussians neither move nor fade", clip.len());
    let without = pad::without_index(clip);
    let mut feature =
        left_out(name, needs, "all Gaussians in the dynamic region", &without, pad::all_dynamic(clip));
    // Both variants test every dynamic Gaussian at every instant: the time index is a feature of its own.
    feature.without = Some(Variant {
        name: "without time index".into(),
        content: VariantContent::Other(Box::new(without)),
        ..Variant::default()
    });
    feature.package = Some(Box::new(|clip| {
        let field = ordered(&pad::all_dynamic(clip));
        packable(clip, windowed(field))
    }));
    feature
}

fn index(clip: &Clip) -> FeatureToggle {
    let name = "Gaussians of other times".to_owned();
    if clip.dynamic_field.is_empty() {
        return needed(name, "all Gaussians are always alive, so there is no time index".into());
    }
    let tested = counts(clip)["rows_tested"];
    let needs = format!("no: the time index lists {tested:.0} of {} Gaussians at an instant", clip.len());
    left_out(name, needs, "every Gaussian is tested in every frame", clip, pad::without_index(clip))
}

fn plate(clip: &Clip) -> FeatureToggle {
    let name = "plate".to_owned();
    if let Some(plate) = &clip.plate {
        return needed(name, format!("{} Gaussians form the background", plate.len()));
    }
    let with = pad::with_plate(clip);
    let mut feature =
        left_out(name, "no: the clip has no background".into(), "one invisible Gaussian", clip, with);
    feature.package = Some(Box::new(|clip| Packable {
        plate: pad::with_plate(clip).plate,
        ..packable(clip, ordered(clip))
    }));
    feature
}

fn layered(clip: &Clip, ends: &[usize]) -> FeatureToggle {
    let (name, ends) = ("layers".to_owned(), ends.to_vec());
    match clip.layers.len() {
        1 => FeatureToggle {
            left_out: true,
            switched_on: "ends of layers as `package` sets them".into(),
            package: Some(Box::new(move |clip| Packable {
                layers: ends.clone(),
                ..packable(clip, ordered(clip))
            })),
            ..needed(name, "no: the package has one layer".into())
        },
        count => needed(name, format!("{count}: the clip plays as soon as the first has arrived")),
    }
}

fn eyes(gpu: &Gpu, features: &mut Vec<FeatureToggle>) {
    let two = |name: &str, eyes| Variant { name: name.into(), eyes, ..Variant::default() };
    features.push(FeatureToggle {
        left_out: true,
        switched_on: "two eyes, in one pass if the device supports that".into(),
        with: Some(two("two eyes", EyeMode::TwoAtOnce)),
        ..needed("second eye".into(), "no: a window has one eye; a headset sorts once for both".into())
    });
    if !gpu.caps.multiview {
        return;
    }
    features.push(FeatureToggle {
        left_out: true,
        switched_on: "two eyes, one after the other".into(),
        without: Some(two("two eyes at once", EyeMode::TwoAtOnce)),
        with: Some(two("two eyes in turn", EyeMode::TwoInTurn)),
        ..needed("second pass".into(), "no: this device draws both eyes of a headset in one pass".into())
    });
}

/// The sort skips the pass of a digit in which the depths of all Gaussians agree.
fn sort_width(clip: &Clip) -> FeatureToggle {
    let viewpoint = &clip.viewpoints()[0];
    let camera = viewpoint.camera(clip.info.up, 1, 1).camera_from_world;
    let [x, y, z, w] = camera[2];
    let (mut passes, mut differ) = (0.0, 0u32);
    for t in instants() {
        let keys = [&clip.static_field, &clip.dynamic_field].into_iter().flat_map(|field| {
            let alive = (0..field.len()).filter(move |&i| field.opacity_at(i, t) >= codec::ALPHA_MIN);
            alive.map(move |i| field.position_at(i, t))
        });
        let keys = keys.map(|p| (x * p[0] + y * p[1] + z * p[2] + w) as f32).filter(|&depth| depth > 0.0);
        // The bits of positive floats sort as the floats do.
        let (and, or) = keys.map(f32::to_bits).fold((u32::MAX, 0), |(and, or), key| (and & key, or | key));
        let differs = or & !and;
        differ |= differs;
        let mask = (1 << SORT_DIGIT_BITS) - 1;
        let is_sorted_by = |&i: &usize| u64::from(differs) >> (i as u32 * SORT_DIGIT_BITS) & mask != 0;
        passes += (0..SORT_DIGITS).filter(is_sorted_by).count() as f64 / instants().len() as f64;
    }
    let bits = u32::BITS - differ.leading_zeros();
    let most = SORT_DIGITS as f64;
    let count = |passes: f64| BTreeMap::from([("sort_passes".to_owned(), passes)]);
    FeatureToggle {
        left_out: passes < most,
        counts: [count(passes), count(most)],
        switched_on: format!("one pass per {SORT_DIGIT_BITS} of 32 bits"),
        ..needed("sort passes".into(), format!("depths differ in the lowest {bits} bits"))
    }
}

/// Counts of rendering a clip that need no rendering.
fn counts(clip: &Clip) -> BTreeMap<String, f64> {
    let temporal = clip.dynamic_field.temporal.as_ref().filter(|_| !clip.dynamic_field.is_empty());
    let motion = temporal
        .map(|temporal| Motion { order: temporal.motion_order, rotates: temporal.rotation_rates.is_some() });
    let mip = clip.filter().compensates();
    let features = Features { sh_degree: clip.sh_degree(), motion, mip, segmented: false };
    let shader = compose(features, Purpose::Draw { views: 1, foveated: false, f16: false });
    let bindings = shader.matches("@binding(").count();
    let tested = |t: f64| {
        let candidates = clip.time_index.candidates(t, clip.layers.len()).map(|rows| rows.len());
        clip.static_field.len() + candidates.sum::<usize>()
    };
    let rows_tested = instants().map(tested).sum::<usize>() as f64 / instants().len() as f64;
    [
        ("shader_lines", shader.lines().count() as f64),
        ("bindings", bindings as f64),
        ("rows_tested", rows_tested),
    ]
    .map(|(name, count)| (name.to_owned(), count))
    .into()
}

/// The Gaussians of the clip in the order of its layers, the most important layer first.
fn ordered(clip: &Clip) -> Field {
    let static_count = clip.static_field.len();
    let (mut rows, mut start) = (Vec::new(), codec::LayerEnd::default());
    for end in &clip.layers {
        rows.extend(start.static_count..end.static_count);
        rows.extend((start.dynamic_count..end.dynamic_count).map(|row| static_count + row));
        start = *end;
    }
    clip.merged().select(&rows)
}

/// Ends of the layers of the clip, in Gaussians.
fn layers(clip: &Clip) -> Vec<usize> {
    clip.layers.iter().map(|end| end.total()).collect()
}

fn packable(clip: &Clip, field: Field) -> Packable {
    Packable { field, plate: clip.plate.clone(), layers: layers(clip) }
}

/// The field with a wide finite window for each Gaussian that has none, so that it fades slightly.
fn windowed(field: Field) -> Field {
    let mut field = pad::with_temporal(field);
    if let Some(temporal) = &mut field.temporal {
        for (tau, s) in temporal.tau.iter_mut().zip(&mut temporal.s).filter(|(_, s)| s.is_infinite()) {
            (*tau, *s) = (0.5, 1.0);
        }
    }
    field
}

/// Sizes of the package by each coder in bytes, at default precision.
fn package_bytes(clip: &Clip, packable: &Packable) -> anyhow::Result<Vec<(String, f64)>> {
    let source = Source { info: &clip.info, field: &packable.field, plate: packable.plate.as_ref() };
    let size = |(name, coder): (&str, Coder)| {
        let options = EncodeOptions { coder, layers: packable.layers.clone(), ..EncodeOptions::default() };
        Ok((name.to_owned(), codec::encode(&source, &options)?.len() as f64))
    };
    [("package_bytes", Coder::Rans), ("package_bytes_fixed", Coder::Fixed)].into_iter().map(size).collect()
}
