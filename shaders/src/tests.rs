//! Validates every composition of shaders, and compares structs, bindings and entry points with Rust.

use std::mem::{offset_of, size_of};

use naga::valid::{Capabilities, ValidationFlags, Validator};

use super::*;
use crate::layout::{Foveation, Frame, Gaussian, Ranges, Slot, ViewUniform};

/// All features of clips, then the features of takes.
fn all_features() -> Vec<Features> {
    let clips = features_of_clips();
    let takes: Vec<_> = clips.iter().map(|&features| Features { segmented: true, ..features }).collect();
    [clips, takes].concat()
}

fn features_of_clips() -> Vec<Features> {
    let mut all = Vec::new();
    for (sh_degree, mip) in (0..=3).flat_map(|degree| [(degree, false), (degree, true)]) {
        let features = Features { sh_degree, mip, ..Features::default() };
        all.push(features);
        for order in 0..=3 {
            for rotates in [false, true] {
                all.push(Features { motion: Some(Motion { order, rotates }), ..features });
            }
        }
    }
    all
}

const PURPOSES: [Purpose; 8] = [
    Purpose::Draw { views: 1, foveated: false, f16: false },
    Purpose::Draw { views: 2, foveated: false, f16: false },
    Purpose::Draw { views: 1, foveated: true, f16: false },
    Purpose::Draw { views: 2, foveated: true, f16: false },
    Purpose::Draw { views: 1, foveated: false, f16: true },
    Purpose::Draw { views: 2, foveated: true, f16: true },
    Purpose::Count { foveated: false },
    Purpose::Count { foveated: true },
];

fn parse(features: Features, purpose: Purpose) -> naga::Module {
    let source = compose(features, purpose);
    naga::front::wgsl::parse_str(&source)
        .unwrap_or_else(|error| panic!("{features:?} {purpose:?}: {}", error.emit_to_string(&source)))
}

#[test]
fn every_composition_is_valid() {
    for features in all_features() {
        for purpose in PURPOSES {
            let module = parse(features, purpose);
            let mut capabilities = Capabilities::SHADER_FLOAT16_IN_FLOAT32;
            capabilities.set(Capabilities::MULTIVIEW, matches!(purpose, Purpose::Draw { views: 2, .. }));
            capabilities
                .set(Capabilities::SHADER_FLOAT16, matches!(purpose, Purpose::Draw { f16: true, .. }));
            Validator::new(ValidationFlags::all(), capabilities)
                .validate(&module)
                .unwrap_or_else(|error| panic!("{features:?} {purpose:?}: {error:?}"));
            let stages: Vec<_> = module.entry_points.iter().map(|e| (e.name.as_str(), e.stage)).collect();
            assert!(stages.contains(&(VERTEX_ENTRY, naga::ShaderStage::Vertex)), "{stages:?}");
            assert!(stages.contains(&(FRAGMENT_ENTRY, naga::ShaderStage::Fragment)), "{stages:?}");
        }
    }
}

/// A root of a number that rounding makes negative is NaN, and WGSL promises nothing of NaN.
#[test]
fn no_root_is_of_a_number_that_may_be_negative() {
    // The variances of a footprint are at least FILTER.
    let roots = ["sqrt(max(0.0, ", "sqrt(vec2<f32>(major, minor))"];
    for features in all_features() {
        let sources = PURPOSES.map(|purpose| compose(features, purpose));
        for line in sources.iter().flat_map(|source| source.lines()).filter(|line| line.contains("sqrt(")) {
            assert!(roots.iter().any(|root| line.contains(root)), "{line}");
        }
    }
}

#[test]
fn a_shader_compensates_only_what_its_frames_need() {
    for features in all_features() {
        for purpose in PURPOSES {
            let source = compose(features, purpose);
            let is_foveated =
                matches!(purpose, Purpose::Draw { foveated: true, .. } | Purpose::Count { foveated: true });
            assert_eq!(source.contains("area / sigma.x / sigma.y"), features.mip, "{features:?} {purpose:?}");
            assert_eq!(
                source.contains("let adapted"),
                is_foveated && !features.mip,
                "{features:?} {purpose:?}"
            );
            let variance = format!("const FILTER: f32 = {:?};", if features.mip { 0.1 } else { 0.3 });
            assert!(source.contains(&variance), "{features:?} {purpose:?}");
        }
    }
}

/// Name, group and binding of the global variables.
fn bindings(module: &naga::Module) -> Vec<(String, u32, u32)> {
    let global = |variable: &naga::GlobalVariable| {
        let binding = variable.binding?;
        Some((variable.name.clone()?, binding.group, binding.binding))
    };
    module.global_variables.iter().filter_map(|(_, variable)| global(variable)).collect()
}

#[test]
fn a_shader_binds_only_the_features_of_its_field() {
    for features in all_features() {
        for purpose in PURPOSES {
            let mut expected = vec![
                ("frame", 0, FRAME),
                ("views", 0, VIEWS),
                (if features.segmented { "slots" } else { "ranges" }, 1, RANGES),
                ("gaussians", 1, GAUSSIANS),
                ("order", 1, ORDER),
            ];
            expected.extend(features.motion.map(|_| ("motion", 1, MOTION)));
            expected.extend((features.sh_degree > 0).then_some(("sh", 1, SH)));
            expected.extend(matches!(purpose, Purpose::Count { .. }).then_some(("counts", 2, COUNTS)));
            let mut found = bindings(&parse(features, purpose));
            found.sort();
            let mut expected: Vec<_> = expected
                .into_iter()
                .map(|(name, group, binding)| (name.to_owned(), group, binding))
                .collect();
            expected.sort();
            assert_eq!(found, expected, "{features:?} {purpose:?}");
        }
    }
}

/// Size of a WGSL struct, and names and offsets of its members.
pub(crate) fn struct_layout(module: &naga::Module, name: &str) -> (usize, Vec<(String, usize)>) {
    let (_, found) = module
        .types
        .iter()
        .find(|(_, found)| found.name.as_deref() == Some(name))
        .unwrap_or_else(|| panic!("struct {name} is declared"));
    let naga::TypeInner::Struct { members, span } = &found.inner else { panic!("{name} is a struct") };
    let member = |member: &naga::StructMember| {
        (member.name.clone().expect("members have names"), member.offset as usize)
    };
    (*span as usize, members.iter().map(member).collect())
}

macro_rules! assert_layout {
    ($module:expr, $name:ident { $($member:ident),+ }) => {
        let (size, members) = crate::tests::struct_layout($module, stringify!($name));
        assert_eq!(size, size_of::<$name>(), stringify!($name));
        let expected = vec![$((stringify!($member).to_owned(), offset_of!($name, $member))),+];
        assert_eq!(members, expected, stringify!($name));
    };
}
#[cfg(feature = "fit")]
pub(crate) use assert_layout;

#[test]
fn structs_match_their_counterparts() {
    let module = &parse(Features::default(), PURPOSES[0]);
    assert_layout!(module, Frame { time, time_rest, radius_max, near });
    assert_layout!(
        module,
        ViewUniform { view_from_world, eye, focal, principal, size, slope_min, slope_max, blur }
    );
    assert_layout!(module, Ranges { motion_units, first_dynamic });
    assert_layout!(module, Gaussian { center, rotation, rotation_scale, scales, opacity_red, green_blue });
    let module = &parse(Features { segmented: true, ..Features::default() }, PURPOSES[0]);
    assert_layout!(module, Slot { ranges, time, time_rest });
    assert_layout!(module, Ranges { motion_units, first_dynamic });
}

/// Each replacement applies once to each shader that has what it replaces, so that no shader of a take reads the ranges
/// or the instant of a clip. A clip's shaders are the files: nothing of a take is in them.
#[test]
fn only_shaders_of_takes_have_slots() {
    for features in features_of_clips() {
        for purpose in PURPOSES {
            let clip = compose(features, purpose);
            for taken in ["slot", "SLOTS", "ROW_BITS"] {
                assert!(!clip.contains(taken), "{features:?} {purpose:?}: {taken}");
            }
            let occurrences = SEGMENTED.map(|(of_clip, _)| clip.matches(of_clip).count());
            let in_motion = usize::from(features.motion.is_some());
            assert_eq!(occurrences, [1, 1, in_motion, in_motion, in_motion], "{features:?} {purpose:?}");
            let take = compose(Features { segmented: true, ..features }, purpose);
            let wrong = ["frame.time", "uniform> ranges", "ranges.first_dynamic)"];
            assert!(wrong.iter().all(|wrong| !take.contains(wrong)), "{features:?} {purpose:?}");
        }
    }
}

#[test]
fn the_stage_that_foveates_is_valid_for_one_eye_and_for_two() {
    for (views, linear) in [(1, false), (2, false), (1, true), (2, true)] {
        let module = covering_module(&compose_foveate(views, linear), views);
        let expected =
            [("foveation", 0, FOVEATION), ("inset", 0, INSET), ("linear", 0, LINEAR), ("wide", 0, WIDE)];
        assert_eq!(
            sorted_bindings(&module),
            expected.map(|(name, group, binding)| (name.to_owned(), group, binding))
        );
        assert_layout!(&module, Foveation { offset, size, wide_from_full, feather });
    }
}

#[test]
fn the_stage_of_linear_light_is_valid_for_one_eye_and_for_two() {
    for views in [1, 2] {
        let module = covering_module(&compose_linear_light(views), views);
        assert_eq!(sorted_bindings(&module), [("drawn".to_owned(), 0, DRAWN)]);
    }
}

/// The validated module of a stage that makes an image from others, for passes of `views` eyes.
fn covering_module(source: &str, views: u32) -> naga::Module {
    let module = naga::front::wgsl::parse_str(source)
        .unwrap_or_else(|error| panic!("{}", error.emit_to_string(source)));
    let mut capabilities = Capabilities::empty();
    capabilities.set(Capabilities::MULTIVIEW, views == 2);
    Validator::new(ValidationFlags::all(), capabilities).validate(&module).expect("valid");
    module
}

fn sorted_bindings(module: &naga::Module) -> Vec<(String, u32, u32)> {
    let mut found = bindings(module);
    found.sort();
    found
}

#[test]
fn record_sizes() {
    let words = |order, rotates| Motion { order, rotates }.words();
    assert_eq!([0, 1, 2, 3].map(|order| words(order, false)), [2, 3, 5, 6]);
    assert_eq!([0, 1, 2, 3].map(|order| words(order, true)), [4, 5, 7, 8]);
    assert_eq!([0, 1, 2, 3].map(sh_words), [0, 4, 9, 16]);
    assert_eq!(size_of::<Gaussian>(), 32);
}
