//! Every stage is valid WGSL for all columns, and its structs, bindings and kernels match Rust.

use std::mem::{offset_of, size_of};

use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};

use super::layout::{AdamUniforms, Response, Series, Statistics, StepUniforms, Totals};
use super::*;
use crate::tests::{assert_layout, struct_layout};

const NAMES: [&str; 30] = [
    "uniforms",
    "series",
    "adam_uniforms",
    "totals",
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
    "image",
    "photograph",
    "tile_sums",
    "derivatives",
    "view_sums",
    "d_image",
    "d_pairs",
    "d_parameters",
    "statistics",
    "first_moments",
    "second_moments",
    "pair_tiles",
    "pair_rows",
    "tile_pairs",
    "response",
    "d_camera",
];

const STATIC: Columns =
    Columns { sh_degree: 0, is_timed: false, motion_order: 0, rotates: false, mip: false };

fn all_columns() -> Vec<Columns> {
    let mut all = Vec::new();
    for (sh_degree, mip) in (0..=3).flat_map(|degree| [(degree, false), (degree, true)]) {
        let plain = Columns { sh_degree, mip, ..STATIC };
        all.push(plain);
        for motion_order in 0..=3 {
            for rotates in [false, true] {
                all.push(Columns { is_timed: true, motion_order, rotates, ..plain });
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
fn a_buffer_has_one_binding_and_a_kernel_at_most_eight_buffers() {
    assert_eq!(binding::D_CAMERA as usize + 1, NAMES.len());
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
fn groups_have_the_threads_and_the_memory_of_every_device() {
    for stage in Stage::ALL {
        let module = parse(stage, all_columns()[0]);
        let info = validate(&module);
        for (index, entry) in module.entry_points.iter().enumerate() {
            let bytes = |(handle, variable): (naga::Handle<naga::GlobalVariable>, &naga::GlobalVariable)| {
                let is_used = !info.get_entry_point(index)[handle].is_empty();
                let is_shared = variable.space == naga::AddressSpace::WorkGroup;
                if is_used && is_shared { module.types[variable.ty].inner.size(module.to_ctx()) } else { 0 }
            };
            let shared: u32 = module.global_variables.iter().map(bytes).sum();
            let threads: u32 = entry.workgroup_size.iter().product();
            assert!(threads <= 256 && shared <= 16_384, "{}: {threads} threads, {shared} bytes", entry.name);
        }
    }
}

#[test]
fn structs_have_the_layout_of_their_counterparts() {
    let module = |stage| parse(stage, all_columns()[0]);
    let adam = &module(Stage::Adam);
    assert_layout!(
        adam,
        Statistics { screen_gradient, images, visits, is_usable, share, share_of_time, is_behind }
    );
    // The Rust structs end in explicit padding, which WGSL adds by itself.
    assert_layout!(
        adam,
        StepUniforms {
            view_from_world,
            eye,
            time,
            focal,
            principal,
            slope_min,
            slope_max,
            size,
            tiles,
            gaussians,
            pair_capacity,
            detach_tau,
            near,
            alpha_channels,
            adds_gradient,
            learns_camera
        }
    );
    assert_layout!(
        adam,
        AdamUniforms { rates, log_scales, log_widths, tau, logit_max, fragment_weight, reach_max }
    );
    assert_layout!(&module(Stage::Sort), Series { length_at, capacity, total_at, shift });
    assert_layout!(&module(Stage::Loss), Response { color, vignette });
    assert_eq!(struct_layout(&module(Stage::Sum), "ViewGradient").0 as u64, VIEW_BYTES);
    assert_eq!(struct_layout(&module(Stage::Bin), "Splat").0 as u64, SPLAT_BYTES);
}

#[test]
fn totals_have_their_indices() {
    let indices = [
        (Totals::GAUSSIANS, offset_of!(Totals, gaussians)),
        (Totals::DRAWN, offset_of!(Totals, drawn)),
        (Totals::PAIRS, offset_of!(Totals, pairs)),
        (Totals::NON_FINITE, offset_of!(Totals, non_finite)),
        (Totals::ABSOLUTE, offset_of!(Totals, absolute)),
        (Totals::SIMILARITY, offset_of!(Totals, similarity)),
        (Totals::SPARE, offset_of!(Totals, spare)),
        (Totals::HALTED, offset_of!(Totals, halted)),
    ];
    assert!(indices.iter().all(|(index, offset)| *index as usize * 4 == *offset));
}

#[test]
fn absent_columns_are_empty() {
    assert_eq!(STATIC.numbers(), 14);
    let all = Columns { sh_degree: 3, is_timed: true, motion_order: 3, rotates: true, mip: true };
    assert_eq!(all.counts(), [3, 4, 3, 1, 48, 1, 1, 9, 4]);
}
