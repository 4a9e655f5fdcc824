//! Time to upload a clip of 40,000 dynamic Gaussians, CPU time of a frame, and time of complete frames on the
//! default adapter. One frame is a headset's: two eyes through its lens, in which all Gaussians are alive.

use std::f32::consts::TAU;
use std::hint::black_box;
use std::ops::Range;
use std::time::{Duration, Instant};

use client::gpu::{
    ChannelDepth, FrameLayout, Gpu, GpuClip, Offscreen, RenderSettings, Renderer, SortOrder, choose_f16,
};
use client::view::View;
use codec::{Clip, ClipInfo, EncodeOptions, Field, Limits, Source, Temporal, Viewpoint};
use criterion::measurement::WallTime;
use criterion::{BenchmarkGroup, Criterion, criterion_group, criterion_main};
use program::Lens;

const GAUSSIANS: usize = 40_000;

/// Side of the image in pixels for measuring the CPU time alone.
const SMALL: u32 = 16;

/// A ball of Gaussians that move outwards while they fade in and out, most with low opacity. Their windows are `widths`
/// wide, in clips.
fn clip(widths: Range<f32>) -> Clip {
    let mut field = Field::default();
    let mut temporal = Temporal { motion_order: 3, ..Temporal::default() };
    let mut state = 1u32;
    let mut random = || {
        state = state.wrapping_mul(1664525).wrapping_add(1013904223);
        (state >> 8) as f32 / (1 << 24) as f32
    };
    for _ in 0..GAUSSIANS {
        let (z, angle) = (2.0 * random() - 1.0, TAU * random());
        let around = (1.0 - z * z).sqrt();
        let outwards = [around * angle.cos(), around * angle.sin(), z];
        let radius = random().cbrt();
        field.centers.push(outwards.map(|x| radius * x));
        let q = [random(), random(), random(), random() + 0.1];
        let norm = q.iter().map(|x| x * x).sum::<f32>().sqrt();
        field.rotations.push(q.map(|x| x / norm));
        field.log_scales.push([0; 3].map(|_| -5.0 + 1.5 * random()));
        field.opacities.push(random() * random());
        field.sh.push([0; 3].map(|_| 3.0 * random() - 1.5));
        temporal.tau.push(random());
        temporal.s.push(widths.start + (widths.end - widths.start) * random());
        let speeds = [0.3, 0.2, -0.4].map(|speed| speed * random());
        temporal.motion.extend(speeds.map(|speed| outwards.map(|x| speed * x)));
    }
    field.temporal = Some(temporal);
    let front = Viewpoint { name: "front".into(), position: [0.0, 0.0, 2.5], target: [0.0; 3], fov_y: 0.9 };
    let info =
        ClipInfo { duration_s: 2.0, up: [0.0, 1.0, 0.0], viewpoints: vec![front], ..ClipInfo::default() };
    let source = Source { info: &info, field: &field, plate: None };
    let bytes = codec::encode(&source, &EncodeOptions::default()).expect("a valid field");
    codec::decode(&bytes, &Limits::default()).expect("what was encoded")
}

fn frame(c: &mut Criterion) {
    let mut gpu = match Gpu::new_headless() {
        Ok(gpu) => gpu,
        Err(fault) => return eprintln!("skipped: {fault}"),
    };
    choose_f16(&mut gpu, ChannelDepth::Eight).expect("a working device");
    eprintln!("adapter: {}, {}, in f16: {}", gpu.adapter_name, gpu.driver, gpu.caps.f16);
    let clip = clip(0.05..0.25);
    let mut group = c.benchmark_group("frame");
    group.sample_size(10);

    group.bench_function("upload", |b| {
        b.iter(|| {
            let on_gpu = GpuClip::upload(&gpu, black_box(&clip)).expect("memory for the clip");
            gpu.submit(gpu.encoder());
            gpu.wait().expect("a working device");
            on_gpu
        })
    });

    let on_gpu = GpuClip::upload(&gpu, &clip).expect("memory for the clip");
    for side in [SMALL, 512, 1024] {
        let camera = clip.info.viewpoints[0].camera(clip.info.up, side, side);
        let views = [View::from_camera(&camera)];
        let image =
            Offscreen::new(&gpu, views[0].size, 1, ChannelDepth::Eight).expect("memory for the image");
        let mut renderer =
            Renderer::new(&gpu, on_gpu.clone(), FrameLayout::plain(ChannelDepth::Eight.format(), 1))
                .expect("memory for the renderer");
        let mut render = || {
            let rendered = image.render(&gpu, &mut renderer, 0.5, &views, &RenderSettings::default());
            rendered.expect("a working device")
        };
        if side == SMALL {
            group.bench_function("alive and sort", |b| {
                b.iter_custom(|iterations| {
                    let ms: f64 = (0..iterations)
                        .map(|_| {
                            let counts = render();
                            counts.alive_ms + counts.sort_ms
                        })
                        .sum();
                    Duration::from_secs_f64(ms * 1e-3)
                })
            });
        } else {
            group.bench_function(format!("{side}x{side}"), |b| b.iter(&mut render));
        }
    }
    headset(&mut group, &gpu);
    group.finish();
}

/// The frame thread of a headset: finds the Gaussians that are alive, culls, sorts, records and submits a frame of two
/// small images, and does not wait for the GPU.
fn headset(group: &mut BenchmarkGroup<'_, WallTime>, gpu: &Gpu) {
    let clip = clip(2.0..2.5);
    let head = clip.info.viewpoints[0].camera(clip.info.up, 1, 1);
    let cameras = Lens::Quest3.cameras(&head, f64::from(clip.info.metres_per_unit), [SMALL; 2]);
    let views = cameras.each_ref().map(View::from_camera);
    let image = Offscreen::new(gpu, views[0].size, 2, ChannelDepth::Eight).expect("memory for the image");
    let on_gpu = GpuClip::upload(gpu, &clip).expect("memory for the clip");
    let layout = FrameLayout::plain(ChannelDepth::Eight.format(), 2);
    let mut renderer = Renderer::new(gpu, on_gpu, layout).expect("memory for the renderer");
    let settings = RenderSettings { sort: SortOrder::Radial, ..RenderSettings::default() };
    let mut frame = 0_u32;
    group.bench_function("alive, sort and submit, two eyes", |b| {
        b.iter_custom(|iterations| {
            let times = (0..iterations).map(|_| {
                frame += 1;
                let start = Instant::now();
                let counts =
                    image.submit(gpu, &mut renderer, f64::from(frame % 180) / 180.0, &views, &settings);
                let elapsed = start.elapsed();
                assert!(counts.sorted as usize > GAUSSIANS * 9 / 10, "the lens shows nearly all");
                gpu.wait().expect("a working device");
                elapsed
            });
            times.sum()
        })
    });
}

criterion_group!(benches, frame);
criterion_main!(benches);
