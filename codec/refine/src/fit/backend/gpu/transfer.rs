//! Conversion of training state, view and photograph to and from device memory.

use shaders::fit::layout::{self, AdamUniforms, Statistics, StepUniforms};
use shaders::fit::{CAMERA_NUMBERS, COLUMNS, Columns};

use super::buffers::{PerGaussian, tiles};
use super::device::{Buffer, Device};
use super::steps::Inputs;
use crate::capture::Response;
use crate::fit::backend::{DeviceError, StepConfig, TrainingState};
use crate::fit::cameras::CAMERA_NUMBERS as FIT_CAMERA_NUMBERS;
use crate::fit::density::ScreenGradients;
use crate::fit::loss::alpha_channels;
use crate::fit::optimizer::{LearningRates, Moments};
use crate::fit::parameters::{Bounds, COLUMNS as FIT_COLUMNS, Carried, LOGIT_MAX, Parameters};
use crate::fit::views::{FrameView, Photograph};
use crate::raster::slope_limits;

/// Bytes per number.
const WORD: u64 = 4;

/// The columns of the parameters.
pub(super) fn columns_of(parameters: &Parameters<f32>) -> Columns {
    Columns {
        sh_degree: parameters.sh_degree,
        is_timed: !parameters.tau.is_empty(),
        motion_order: parameters.motion_order,
        rotates: !parameters.rotation_rates.is_empty(),
        mip: parameters.filter.compensates(),
    }
}

/// Copies a training state to the device.
pub(super) fn upload(device: &Device, to: &PerGaussian, state: &TrainingState) {
    let TrainingState { parameters, moments, screen_gradients } = state;
    for (buffer, values) in [
        (&to.parameters, parameters),
        (&to.first_moments, &moments.first),
        (&to.second_moments, &moments.second),
    ] {
        let mut offset = 0;
        for column in values.columns() {
            device.write(buffer, offset, column);
            offset += column.len() as u64 * WORD;
        }
    }
    let statistics_of = |row: usize| {
        let carried = moments.carried.get(row).copied().unwrap_or(Carried::NONE);
        Statistics {
            screen_gradient: screen_gradients.sums[row],
            images: screen_gradients.images[row],
            visits: moments.visits[row],
            is_usable: 0,
            share: carried.share_of_rates(),
            share_of_time: carried.share_of_time(),
            is_behind: parameters.is_behind(row).into(),
        }
    };
    let statistics: Vec<Statistics> = (0..parameters.len()).map(statistics_of).collect();
    device.write(&to.statistics, 0, &statistics);
}

/// Copies it back; `shape` has the columns of the parameters, and `carried` is what was uploaded.
pub(super) fn download(
    device: &Device,
    from: &PerGaussian,
    shape: &Parameters<f32>,
    carried: Vec<Carried>,
) -> Result<TrainingState, DeviceError> {
    let rows = from.count as usize;
    let mut parameters = rows_of(device, &from.parameters, shape, rows, rows)?;
    let first = rows_of(device, &from.first_moments, shape, rows, rows)?;
    let second = rows_of(device, &from.second_moments, shape, rows, rows)?;
    let statistics: Vec<Statistics> = device.read(&from.statistics, rows)?;
    if !shape.behind.is_empty() {
        parameters.behind = statistics.iter().map(|row| row.is_behind != 0).collect();
    }
    Ok(TrainingState {
        parameters,
        moments: Moments {
            first,
            second,
            visits: statistics.iter().map(|row| row.visits).collect(),
            carried,
        },
        screen_gradients: ScreenGradients {
            sums: statistics.iter().map(|row| row.screen_gradient).collect(),
            images: statistics.iter().map(|row| row.images).collect(),
        },
    })
}

/// Reads the first `rows` rows of the columns in a buffer with `capacity` rows.
pub(super) fn rows_of(
    device: &Device,
    buffer: &Buffer,
    shape: &Parameters<f32>,
    rows: usize,
    capacity: usize,
) -> Result<Parameters<f32>, DeviceError> {
    let counts = columns_of(shape).counts();
    let numbers: Vec<f32> = device.read(buffer, capacity * counts.iter().sum::<u32>() as usize)?;
    let mut all = shape.zeros(rows);
    let mut start = 0;
    for (column, count) in all.columns_mut().into_iter().zip(counts) {
        column.copy_from_slice(&numbers[start..start + rows * count as usize]);
        start += capacity * count as usize;
    }
    Ok(all)
}

/// What an image of the view gives its kernels; `near` is the near distance of the parameters.
pub(super) fn inputs(view: &FrameView, near: f64, detach_tau: bool) -> Inputs {
    Inputs {
        uniforms: step_uniforms(view, near, detach_tau),
        adam_uniforms: AdamUniforms::default(),
        response: response(&Response::NEUTRAL),
    }
}

/// What a step gives its kernels.
pub(super) fn step_inputs(
    view: &FrameView,
    near: f64,
    photograph: &Photograph,
    config: &StepConfig,
) -> Inputs {
    let Inputs { uniforms, response: neutral, .. } = inputs(view, near, config.detach_tau);
    let uniforms = StepUniforms {
        alpha_channels: alpha_channels(photograph) as f32,
        adds_gradient: config.lpips.is_some().into(),
        learns_camera: config.response.is_some().into(),
        ..uniforms
    };
    Inputs {
        uniforms,
        adam_uniforms: adam_uniforms(config),
        response: config.response.as_ref().map_or(neutral, response),
    }
}

/// The uniforms of an image, without the sizes of the buffers.
fn step_uniforms(view: &FrameView, near: f64, detach_tau: bool) -> StepUniforms {
    let camera = view.camera;
    let m = &camera.camera_from_world;
    let single = |v: [f64; 2]| v.map(|x| x as f32);
    let [slope_min, slope_max] = slope_limits(camera).map(single);
    let size = [camera.width, camera.height];
    StepUniforms {
        view_from_world: [0, 1, 2].map(|r| [0, 1, 2, 3].map(|c| m[r][c] as f32)),
        eye: camera.position().map(|x| x as f32),
        time: view.time as f32,
        focal: single([camera.k[0][0], camera.k[1][1]]),
        principal: single([camera.k[0][2], camera.k[1][2]]),
        slope_min,
        slope_max,
        size,
        tiles: tiles(size),
        detach_tau: detach_tau.into(),
        near: near as f32,
        ..StepUniforms::default()
    }
}

/// The response of a camera.
fn response(response: &Response) -> layout::Response {
    layout::Response {
        color: response.color.map(|row| row.map(|x| x as f32)),
        vignette: response.vignette as f32,
        _pad0: [0; 3],
    }
}

/// Learning rates, bounds and fragment term of a step.
fn adam_uniforms(config: &StepConfig) -> AdamUniforms {
    let LearningRates {
        centers,
        rotations,
        log_scales,
        logits,
        sh_first,
        sh_rest,
        tau,
        log_widths,
        rotation_rates,
        reach_max,
    } = config.rates;
    let mut rates = [0.0; 12];
    let motion = centers;
    let columns: [f64; COLUMNS] =
        [centers, rotations, log_scales, logits, sh_first, tau, log_widths, motion, rotation_rates];
    rates[..COLUMNS].copy_from_slice(&columns.map(|rate| rate as f32));
    rates[AdamUniforms::SH_REST as usize] = sh_rest as f32;
    let Bounds { log_scales, log_widths, tau, .. } = config.bounds;
    let single = |v: [f64; 2]| v.map(|x| x as f32);
    AdamUniforms {
        rates,
        log_scales: single(log_scales),
        log_widths: single(log_widths),
        tau: single(tau),
        logit_max: LOGIT_MAX as f32,
        fragment_weight: config.fragment_weight as f32,
        reach_max: reach_max as f32,
        _pad0: [0; 3],
    }
}

// Both sides have the same columns and learn the same of a camera.
const _: () = assert!(COLUMNS == FIT_COLUMNS && CAMERA_NUMBERS == FIT_CAMERA_NUMBERS);
