//! [`run()`]: measures one case.

use std::time::Instant;

use super::result::CaseResult;
use client::gpu::{ChannelDepth, Gpu, GpuClip, RenderSettings, Renderer, SortOrder};
use client::player::UPLOAD_BYTES_MAX;
use codec::{Clip, Coder, EncodeOptions, Limits, Source};
use peak_alloc::PeakAlloc;
use refine::image::Image;
use refine::reference::{self, Order, render};

use refine::reference::PosedView;

use super::case::{DeviationKind, PackageExpectation, StabilityCase, StabilityScene, field_of};
use crate::device::Drawing;
use crate::resident::ResidentSegments;
use crate::scene::info;

/// Longest time of rendering a case in seconds, on any device.
const SECONDS_MAX: f64 = 60.0;

/// Largest memory of rendering a case in bytes, beyond the memory of its Gaussians.
const BYTES_MAX: u64 = 64 << 20;

/// Bytes of GPU memory per Gaussian: its record, its sort key, and scratch space for sorting.
const BYTES_PER_GAUSSIAN: u64 = 1 << 10;

/// Alpha in 255ths above which a pixel is not blank.
const SHOWS: f64 = 10.0;

/// Time and memory of rendering.
#[derive(Default)]
struct Meter {
    seconds: f64,
    heap_bytes: usize,
    gpu_bytes: u64,
}

impl Meter {
    /// Runs `draw`, adds its time, and keeps the largest peak of heap memory.
    fn count<T>(&mut self, draw: impl FnOnce() -> T) -> T {
        PeakAlloc.reset_peak_usage();
        let (before, start) = (PeakAlloc.current_usage(), Instant::now());
        let drawn = draw();
        self.seconds += start.elapsed().as_secs_f64();
        self.heap_bytes = self.heap_bytes.max(PeakAlloc.peak_usage().saturating_sub(before));
        drawn
    }

    fn bytes(&self) -> u64 {
        self.heap_bytes as u64 + self.gpu_bytes
    }
}

/// Measures `case` on `gpu`.
///
/// Heap bytes are counted only in programs whose global allocator is [`PeakAlloc`].
// Long: every failure of the case becomes part of its result.
pub fn run(case: &StabilityCase, gpu: &Gpu) -> CaseResult {
    let mut meter = Meter::default();
    let scene = (case.scene)();
    let mut measured = measure(case.measure, &scene, &scene.clip, gpu, &mut meter);
    let mut packaged = 0.0;
    let coded = match scene.coding {
        PackageExpectation::Untried(reason) => format!("not tried: {reason}"),
        PackageExpectation::Refused(words) => match (packages(&scene), &measured) {
            (Err(message), _) if message.contains(words) => format!("refused: {message}"),
            (Err(message), _) => {
                measured =
                    Err(format!("the encoder refuses it for another reason than {words:?}: {message}"));
                format!("refused: {message}")
            }
            (Ok(_), _) => {
                measured = Err("the encoder accepts a field that it must refuse".into());
                "taken".into()
            }
        },
        PackageExpectation::Taken => {
            let drawn = packages(&scene).and_then(|clips| {
                let deviation = |clip: &Clip| measure(case.measure, &scene, clip, gpu, &mut Meter::default());
                clips.iter().map(deviation).collect::<Result<Vec<f64>, String>>()
            });
            match drawn {
                Ok(deviations) => {
                    packaged = deviations.iter().copied().fold(0.0, f64::max);
                    let list: Vec<String> = Coder::ALL
                        .iter()
                        .zip(deviations)
                        .map(|(coder, deviation)| format!("{} {deviation:.3}", coder.name()))
                        .collect();
                    format!("taken: {}", list.join(", "))
                }
                Err(what) => {
                    measured = Err(format!("of a package: {what}"));
                    "taken".into()
                }
            }
        }
    };
    let allowed = BYTES_MAX + BYTES_PER_GAUSSIAN * scene.clip.len() as u64;
    let problem = match &measured {
        Err(what) => Some(what.clone()),
        Ok(deviation) if *deviation > case.bound => Some("the deviation exceeds its bound".into()),
        Ok(_) if packaged > case.bound => {
            Some(format!("the deviation of a package exceeds the bound: {coded}"))
        }
        Ok(_) if meter.seconds > SECONDS_MAX => Some(format!("rendering took {:.0} s", meter.seconds)),
        Ok(_) if meter.bytes() > allowed => Some(format!(
            "rendering took {} MiB, more than the allowed {}",
            meter.bytes() >> 20,
            allowed >> 20
        )),
        Ok(_) => None,
    };
    CaseResult {
        group: case.group.into(),
        case: case.name.clone(),
        outcome: if problem.is_none() { "holds" } else { "fails" }.into(),
        deviation: measured.ok(),
        bound: case.bound,
        unit: case.measure.unit().into(),
        package: coded,
        gaussians: scene.clip.len(),
        pictures: scene.posed_views.len(),
        seconds: meter.seconds,
        bytes: meter.bytes(),
        how: case.how.into(),
        problem,
    }
}

/// The scene after encoding and decoding, once per coder.
fn packages(scene: &StabilityScene) -> Result<Vec<Clip>, String> {
    let package = |coder| {
        let options = EncodeOptions { coder, ..EncodeOptions::default() };
        let source = Source { info: &info(), field: field_of(&scene.clip), plate: scene.clip.plate.as_ref() };
        let bytes = codec::encode(&source, &options).map_err(|error| error.to_string())?;
        codec::decode(&bytes, &Limits::default()).map_err(|error| error.to_string())
    };
    Coder::ALL.into_iter().map(package).collect()
}

/// The largest deviation over all views of `clip`: the scene's clip, or one decoded from a package of it.
fn measure(
    measure: DeviationKind,
    scene: &StabilityScene,
    clip: &Clip,
    gpu: &Gpu,
    meter: &mut Meter,
) -> Result<f64, String> {
    let fault = |fault: program::Fault| fault.to_string();
    let settings = RenderSettings { sort: scene.sort, ..RenderSettings::default() };
    let first = std::slice::from_ref(&scene.posed_views[0].camera);
    let depth = ChannelDepth::Sixteen;
    let mut drawing = meter
        .count(|| match &scene.take {
            None => Drawing::new(gpu, GpuClip::upload(gpu, clip)?, first, depth),
            Some(take) => {
                let layout = take.layout(clip);
                Drawing::by(gpu, first, depth, |frame| Renderer::new_take(gpu, layout, frame))
            }
        })
        .map_err(fault)?;
    meter.gpu_bytes = drawing.renderer().clip().bytes();
    let mut resident =
        scene.take.as_ref().map(|take| ResidentSegments::new(take.layout(clip), take.segments.len()));
    let mut largest = 0f64;
    let mut shows = false;
    let mut before: Option<Image> = None;
    for (i, posed_view) in scene.posed_views.iter().enumerate() {
        drawing.look(std::slice::from_ref(&posed_view.camera));
        if let (Some(take), Some(resident)) = (&scene.take, &mut resident) {
            let (renderer, t_s) = (drawing.renderer(), posed_view.t * take.duration_s);
            meter
                .count(|| resident.seek(gpu, renderer, &take.segments, t_s, UPLOAD_BYTES_MAX))
                .map_err(fault)?;
        }
        let mut images = meter.count(|| drawing.frame(posed_view.t, &settings)).map_err(fault)?;
        let image = images.pop().ok_or("no picture")?;
        check_bounded(&image).map_err(|what| format!("at {}: {what}", posed_view.t))?;
        let deviation = match measure {
            DeviationKind::Largest => difference(&image, &expected(scene, clip, i), f64::max),
            DeviationKind::Mean => root_mean_square(&image, &expected(scene, clip, i)),
            DeviationKind::Change => before.map_or(0.0, |before| difference(&image, &before, f64::max)),
            DeviationKind::Place => off_its_place(&image, clip, posed_view),
        };
        shows |= image.pixels.iter().any(|pixel| 255.0 * pixel[3] > SHOWS);
        if deviation.is_nan() {
            return Err(format!("at {}: the deviation is not a number", posed_view.t));
        }
        largest = largest.max(deviation);
        before = Some(image);
    }
    if shows == scene.blank {
        return Err(
            if shows { "the images must be blank and are not" } else { "the images are blank" }.into()
        );
    }
    Ok(largest)
}

/// The reference's image of a view. Instants outside the clip are clamped to its ends.
fn expected(scene: &StabilityScene, clip: &Clip, view: usize) -> Image {
    let posed_view = &scene.posed_views[view];
    let order = match scene.sort {
        SortOrder::Depth => Order::Depth,
        SortOrder::Radial => Order::Radial,
    };
    let t = scene.take.as_ref().map_or(posed_view.t, |take| take.meant[view]);
    let t = if t.is_nan() { 0.0 } else { t.clamp(0.0, 1.0) };
    let drawn = scene.meant.as_ref().unwrap_or(clip);
    render(&reference::RenderScene::from(drawn), &posed_view.camera, t, order)
}

/// Checks that every pixel is a finite premultiplied colour.
fn check_bounded(image: &Image) -> Result<(), String> {
    let good =
        |pixel: &[f64; 4]| pixel.iter().all(|c| c.is_finite() && *c >= 0.0) && pixel[3] <= 1.0 + 1.0 / 1024.0;
    match image.pixels.iter().position(|pixel| !good(pixel)) {
        None => Ok(()),
        Some(i) => {
            let (x, y) = (i as u32 % image.width, i as u32 / image.width);
            Err(format!("pixel {x},{y} is {:?}", image.pixels[i]))
        }
    }
}

/// Folds the differences of all channels with `together`. Channels are clamped to the displayed range; differences
/// are in 255ths.
fn difference(a: &Image, b: &Image, together: impl Fn(f64, f64) -> f64) -> f64 {
    let shown = |c: f64| c.clamp(0.0, 1.0);
    let pairs = a.pixels.iter().flatten().zip(b.pixels.iter().flatten());
    pairs.map(|(&a, &b)| 255.0 * (shown(a) - shown(b)).abs()).fold(0.0, together)
}

fn root_mean_square(a: &Image, b: &Image) -> f64 {
    (difference(a, b, |sum, d| sum + d * d) / (4 * a.pixels.len()) as f64).sqrt()
}

/// Distance in pixels between the centroid of alpha and the projection of the only Gaussian's centre by the
/// trajectory equation.
fn off_its_place(image: &Image, clip: &Clip, posed_view: &PosedView) -> f64 {
    let [mut sum, mut x, mut y] = [0.0; 3];
    for (i, pixel) in (0u32..).zip(&image.pixels) {
        sum += pixel[3];
        x += pixel[3] * (f64::from(i % image.width) + 0.5);
        y += pixel[3] * (f64::from(i / image.width) + 0.5);
    }
    let p = field_of(clip).position_at(0, posed_view.t);
    let m = posed_view.camera.camera_from_world;
    let [cx, cy, cz] = [0, 1, 2].map(|r| m[r][0] * p[0] + m[r][1] * p[1] + m[r][2] * p[2] + m[r][3]);
    let k = posed_view.camera.k;
    (x / sum - (k[0][0] * cx / cz + k[0][2])).hypot(y / sum - (k[1][1] * cy / cz + k[1][2]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(pixel: [f64; 4]) -> Image {
        let mut image = Image::new(2, 2);
        image.pixels[3] = pixel;
        image
    }

    #[test]
    fn pictures_that_are_none_are_found() {
        assert_eq!(check_bounded(&image([0.3, 0.2, 7.0, 1.0])), Ok(()));
        for pixel in
            [[f64::NAN, 0.0, 0.0, 1.0], [f64::INFINITY, 0.0, 0.0, 1.0], [-0.1, 0.0, 0.0, 1.0], [1.1; 4]]
        {
            let message = check_bounded(&image(pixel)).unwrap_err();
            assert!(message.starts_with("pixel 1,1 is"), "{message}");
        }
    }

    #[test]
    fn differences_are_those_of_what_is_displayed_and_of_alpha() {
        let (a, b) = (image([0.5, 3.0, 0.0, 1.0]), image([0.4, 2.0, 0.0, 0.8]));
        assert!((difference(&a, &b, f64::max) - 51.0).abs() < 1e-9);
        let expected = 255.0 * ((0.01 + 0.04) / 16f64).sqrt();
        assert!((root_mean_square(&a, &b) - expected).abs() < 1e-9);
    }
}
