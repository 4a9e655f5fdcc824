//! Every stage that can be composed is valid, and its structs, bindings and kernels are those that Rust
//! believes in.

use std::mem::{offset_of, size_of};

use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};

use super::layout::{AdamUniforms, Memory, Series, State, StepUniforms};
use super::*;
use crate::tests::{assert_layout, struct_layout};

const NAMES: [&str; 28] = [
    "step",
    "series",
    "pace",
    "state",
    "parameters",
    "splats",
    "keys",
    "rows",
    "sorted_keys",
    "sorted_rows",
    "counts",
    "block_sums",
    "order",
    "tile_starts",
    "picture",
    "photograph",
    "blurred",
    "derivatives",
    "differences",
    "d_picture",
    "d_pairs",
    "d_parameters",
    "memory",
    "first_moments",
    "second_moments",
    "pair_tiles",
    "pair_rows",
    "tile_pairs",
];

fn all_columns() -> Vec<Columns> {
    let mut all = Vec::new();
    for sh_degree in 0..=3 {
        all.push(Columns { sh_degree, is_timed: false, motion_order: 0, rotates: false });
        for motion_order in 0..=3 {
            for rotates in [false, true] {
                all.push(Columns { sh_degree, is_timed: true, motion_order, rotates });
            }
        }
    }
    all
}

fn parse(stage: Stage, columns: Columns) -> naga::Module {
    let source = compose(stage, columns);
    naga::front::wgsl::parse_str(&source)
        .unwrap_or_else(|error| panic!("{stage:?} {columns:?}: {}", error.emit_to_string(&source)))
}

fn validate(module: &naga::Module) -> ModuleInfo {
    Validator::new(ValidationFlags::all(), Capabilities::empty())
        .validate(module)
        .unwrap_or_else(|error| panic!("{error:?}"))
}

#[test]
fn every_stage_is_valid_and_has_its_kernels() {
    for columns in all_columns() {
        for stage in Stage::ALL {
            let module = parse(stage, columns);
            validate(&module);
            let kernels: Vec<_> = module.entry_points.iter().map(|entry| entry.name.as_str()).collect();
            assert_eq!(kernels, stage.kernels());
        }
    }
}

#[test]
fn a_buffer_has_one_number_and_a_kernel_at_most_eight() {
    assert_eq!(binding::TILE_PAIRS as usize + 1, NAMES.len());
    for stage in Stage::ALL {
        let module = parse(stage, all_columns()[0]);
        let info = validate(&module);
        for (_, variable) in module.global_variables.iter() {
            let Some(binding) = &variable.binding else { continue };
            assert_eq!(binding.group, 0);
            assert_eq!(variable.name.as_deref(), Some(NAMES[binding.binding as usize]), "{stage:?}");
        }
        for (index, entry) in module.entry_points.iter().enumerate() {
            let is_storage = |variable: &naga::GlobalVariable| {
                matches!(variable.space, naga::AddressSpace::Storage { .. })
            };
            let bound = module.global_variables.iter().filter(|(handle, variable)| {
                is_storage(variable) && !info.get_entry_point(index)[*handle].is_empty()
            });
            assert!(bound.count() <= 8, "{}", entry.name);
        }
    }
}

#[test]
fn structs_have_the_layout_of_their_counterparts() {
    let module = |stage| parse(stage, all_columns()[0]);
    let adam = &module(Stage::Adam);
    assert_layout!(adam, Memory { pull, pictures, visits, is_usable });
    // The last member of these is padding, which WGSL adds by itself.
    let (size, members) = struct_layout(adam, "StepUniforms");
    assert_eq!(size, size_of::<StepUniforms>());
    let expected = [
        offset_of!(StepUniforms, view_from_world),
        offset_of!(StepUniforms, eye),
        offset_of!(StepUniforms, frame),
        offset_of!(StepUniforms, focal),
        offset_of!(StepUniforms, principal),
        offset_of!(StepUniforms, slope_min),
        offset_of!(StepUniforms, slope_max),
        offset_of!(StepUniforms, size),
        offset_of!(StepUniforms, tiles),
        offset_of!(StepUniforms, gaussians),
        offset_of!(StepUniforms, pair_capacity),
        offset_of!(StepUniforms, is_detached),
    ];
    assert_eq!(members.iter().map(|(_, offset)| *offset).collect::<Vec<_>>(), expected);
    let (size, members) = struct_layout(adam, "AdamUniforms");
    assert_eq!(size, size_of::<AdamUniforms>());
    let expected = [
        offset_of!(AdamUniforms, rates),
        offset_of!(AdamUniforms, log_scales),
        offset_of!(AdamUniforms, log_widths),
        offset_of!(AdamUniforms, tau),
        offset_of!(AdamUniforms, logit_max),
    ];
    assert_eq!(members.iter().map(|(_, offset)| *offset).collect::<Vec<_>>(), expected);
    assert_layout!(&module(Stage::Sort), Series { length_at, capacity, total_at, shift });
    assert_eq!(struct_layout(&module(Stage::Bin), "Splat").0 as u64, SPLAT_BYTES);
}

#[test]
fn the_state_is_known_by_its_places() {
    let places = [
        (State::GAUSSIANS, offset_of!(State, gaussians)),
        (State::DRAWN, offset_of!(State, drawn)),
        (State::PAIRS, offset_of!(State, pairs)),
        (State::NON_FINITE, offset_of!(State, non_finite)),
        (State::ABSOLUTE, offset_of!(State, absolute)),
        (State::SIMILARITY, offset_of!(State, similarity)),
        (State::SPARE, offset_of!(State, spare)),
    ];
    assert!(places.iter().all(|(place, offset)| *place as usize * 4 == *offset));
}

#[test]
fn a_scene_has_no_columns_that_it_does_not_need() {
    let still = Columns { sh_degree: 0, is_timed: false, motion_order: 0, rotates: false };
    assert_eq!(still.numbers(), 14);
    let all = Columns { sh_degree: 3, is_timed: true, motion_order: 3, rotates: true };
    assert_eq!(all.counts(), [3, 4, 3, 1, 48, 1, 1, 9, 4]);
}
