//! What playing a clip costs and keeps: every knob of the renderer swept, and every optional part
//! that the clip does without switched on.
//!
//! Each way to draw is a `Variant`, and all of them do the same work: the same clip, places, times
//! and size. Errors are those of pictures against the f64 reference of the whole field. Times are
//! taken in rounds, each of which draws all variants once, so that whatever else the machine does
//! meets all alike. `cargo xtask report` makes a page of it.

mod errors;
mod held;
mod measure;
mod pad;
mod parts;
mod reduce;
mod shots;
mod sweeps;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use client::gpu::{ChannelDepth, Gpu, Offscreen};
use codec::Clip;
use glam::UVec2;
use image::{ImageFormat, RgbImage};
use refine::image::Image;
use refine::reference::{self, Order, render};
use studio::report::knob::{Knob, Point, Spread, Stage};
use studio::report::playing::{Message, Picture, Setup};

use errors::Expected;
use measure::{Bench, ROUNDS, Sample, Variant};
use parts::{Switched, parts};
use shots::shots;
use sweeps::{Sweep, sweeps};

/// Measures `clip` in pictures of `size` pixels against `whole`, the field that it was made of.
/// `tell` is called with what is known, as soon as it is.
///
/// # Errors
/// What the renderer reports, also where `size` is more than it can draw; and what `tell` returns.
pub fn measure(
    gpu: &'static Gpu,
    clip: &Clip,
    whole: &reference::RenderScene,
    size: UVec2,
    tell: &mut dyn FnMut(Message) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    // Whether the device can draw that large, before the reference tries.
    Offscreen::new(gpu, size, 2, ChannelDepth::Sixteen)?;
    let shots = shots(clip, size);
    let sweeps = sweeps(clip, size);
    let switched = parts(clip, gpu);
    let swept = sweeps.iter().flat_map(|sweep| &sweep.values).filter_map(|value| value.variant.as_ref());
    let as_it_is = Variant { name: "player".into(), ..Variant::default() };
    let variants: Vec<&Variant> =
        std::iter::once(&as_it_is).chain(swept).chain(switched.iter().flat_map(Switched::variants)).collect();
    // What the page shows a picture of: the end of each sweep.
    let ends: Vec<&Variant> =
        sweeps.iter().filter_map(|sweep| sweep.values.last()?.variant.as_ref()).collect();

    let pictures = shots.pictures.len() + shots.turn.len();
    let packaged = switched.iter().filter(|switched| switched.packages()).count();
    tell(Message::Begin(Setup {
        adapter: gpu.adapter_name.clone(),
        driver: gpu.driver.clone(),
        gpu_timed: gpu.caps.timestamps,
        size: size.to_array(),
        gaussians: clip.len(),
        pictures: shots.pictures.len(),
        turn_frames: shots.turn.len(),
        rounds: ROUNDS,
        steps: (pictures + held::pictures(&shots) + variants.len() * (1 + ROUNDS) + packaged) as u64,
    }))?;
    let mut take = |shots: &[refine::prune::PosedView], order| {
        let mut taken = Vec::new();
        for shot in shots {
            tell(Message::Step("reference".into()))?;
            taken.push(render(whole, &shot.camera, shot.t, order));
        }
        anyhow::Ok(taken)
    };
    let expected = Expected {
        pictures: take(&shots.pictures, Order::Depth)?,
        // The order that does not change when the head turns: nothing pops.
        turn: take(&shots.turn, Order::Radial)?,
        cameras: shots.turn.iter().map(|shot| shot.camera.clone()).collect(),
    };
    tell(Message::Picture(picture("f64 reference", &expected.pictures[0])?))?;

    let mut bench = Bench::new(gpu, clip, size, &shots);
    let mut measured = Vec::new();
    for variant in &variants {
        tell(Message::Step(variant.name.clone()))?;
        let mut looked = bench.look(variant, &expected)?;
        if !measured.is_empty() {
            let is_shown = ends.iter().any(|end| std::ptr::eq(*end, *variant));
            looked.images.truncate(usize::from(is_shown));
            looked.turn.clear();
        }
        measured.push(looked);
    }
    let mut samples: Vec<Vec<Sample>> = vec![Vec::new(); variants.len()];
    for _ in 0..ROUNDS {
        for (i, variant) in variants.iter().enumerate() {
            tell(Message::Step(variant.name.clone()))?;
            samples[i].push(bench.time(i)?);
        }
    }
    let mut results = measured.into_iter().zip(samples).map(|(looked, samples)| Measured { looked, samples });
    let base = results.next().expect("the player as it is");
    tell(Message::Picture(picture("player", &base.looked.images[0])?))?;
    let mut on_picture = || tell(Message::Step("frames to a sort".into()));
    let duration_s = f64::from(clip.info.duration_s);
    let (held, longest) = held::knob(whole, &shots, duration_s, &expected, &base, &mut on_picture)?;
    let frames = held.points.last().map_or("", |point| &point.value);
    tell(Message::Picture(picture(&format!("{}: {frames}", held.name), &longest)?))?;
    tell(Message::Knob(held))?;
    for sweep in sweeps {
        let points: Vec<Option<Measured>> =
            sweep.values.iter().map(|value| value.variant.as_ref().and_then(|_| results.next())).collect();
        let coarsest = points.last().and_then(Option::as_ref).and_then(|last| last.looked.images.first());
        if let (Some(image), Some(value)) = (coarsest, sweep.values.last()) {
            tell(Message::Picture(picture(&format!("{}: {}", sweep.name, value.label), image)?))?;
        }
        tell(Message::Knob(knob(sweep, &points, &base)))?;
    }
    for switched in switched {
        let count = switched.variants().count();
        let results: Vec<Measured> = results.by_ref().take(count).collect();
        if switched.packages() {
            tell(Message::Step("package".into()))?;
        }
        tell(Message::Part(switched.into_part(clip, &base, &results)?))?;
    }
    Ok(())
}

/// What was measured of a variant.
struct Measured {
    looked: measure::Looked,
    samples: Vec<Sample>,
}

impl Measured {
    fn spread(&self, of: impl Fn(&Sample) -> f64) -> Spread {
        Spread::of(self.samples.iter().map(of))
    }

    fn frame_ms(&self) -> Spread {
        self.spread(|sample| sample.frame_ms)
    }
}

fn knob(sweep: Sweep, points: &[Option<Measured>], base: &Measured) -> Knob {
    let values = sweep.values.iter().zip(points);
    let points =
        values.map(|(value, measured)| point(&value.label, value.default, measured.as_ref().unwrap_or(base)));
    Knob {
        stage: Stage::Playing,
        name: sweep.name.into(),
        about: sweep.about.into(),
        cost: "ms a frame".into(),
        points: points.collect(),
    }
    .mark_front()
}

fn point(value: &str, default: bool, measured: &Measured) -> Point {
    let stages = [
        ("alive", measured.spread(|sample| sample.alive_ms)),
        ("sort", measured.spread(|sample| sample.sort_ms)),
        ("draw", measured.spread(|sample| sample.draw_ms)),
    ];
    Point {
        value: value.into(),
        default,
        on_front: false,
        cost: measured.frame_ms(),
        errors: measured.looked.errors,
        run_time_ms: Some(measured.frame_ms()),
        stages_ms: stages.map(|(name, spread)| (name.to_owned(), spread)).into(),
        counts: measured.looked.counts.clone(),
    }
}

/// An image over black, as a page shows it.
fn picture(name: &str, image: &Image) -> anyhow::Result<Picture> {
    let pixels = RgbImage::from_raw(image.width, image.height, image.to_rgb8());
    let mut png = std::io::Cursor::new(Vec::new());
    pixels.expect("three bytes a pixel").write_to(&mut png, ImageFormat::Png)?;
    Ok(Picture { name: name.into(), png: STANDARD.encode(png.into_inner()) })
}
