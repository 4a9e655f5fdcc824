//! Tests of the anchor as a whole against ray-traced scenes.

use codec::Camera;
use glam::DVec3;

use super::pinhole::Pinhole;
use super::test_scene::{Shape, pattern, ring, sphere, view};
use super::*;

fn body(frame: usize) -> Vec<Shape> {
    let aside = DVec3::new(0.02 * frame as f64, 0.0, 0.0);
    vec![sphere(aside, 0.4), Shape { ends: [aside, aside + DVec3::new(0.5, 0.4, 0.1)], radius: 0.08 }]
}

/// A frame with the true depths.
fn frame(number: usize, cameras: &[Camera]) -> AnchorFrame {
    let shapes = body(number);
    let view = |(i, camera): (usize, &Camera)| {
        let (mut seen, depths) = view(i, camera, &shapes, pattern);
        seen.depths = Some(DepthMap { width: camera.width, height: camera.height, depths });
        seen
    };
    AnchorFrame { frame: number, time: number as f64, views: cameras.iter().enumerate().map(view).collect() }
}

fn settings(source: DepthSource) -> AnchorSettings {
    let hull = HullSettings { voxels: 64, misses: 1 };
    AnchorSettings { source, hull, gaussians: 2000, ..AnchorSettings::default() }
}

/// Depth maps of a frame, view by view.
fn depths(settings: &AnchorSettings, frame: &AnchorFrame) -> Vec<DepthMap> {
    let found = sources::surfaces(settings, frame, f64::INFINITY, &mut None).unwrap();
    found.surfaces.into_iter().map(|surface| surface.depths).collect()
}

fn run(settings: &AnchorSettings, frames: &[AnchorFrame]) -> Result<Parameters<f32>, AnchorError> {
    let last = frames.last().map_or(0, |frame| frame.frame);
    anchor(settings, Timeline::even(last + 1), frames.iter().cloned().map(Ok))
}

const SOURCES: [DepthSource; 5] = [
    DepthSource::Hull,
    DepthSource::HullAndSweep,
    DepthSource::Given(Alignment::Metric),
    DepthSource::Given(Alignment::Rig),
    DepthSource::Given(Alignment::Hull),
];

#[test]
fn gaussians_of_every_source_lie_on_the_surface() {
    let frames = [0, 2].map(|number| frame(number, &ring(12, 3.0, 64)));
    for source in SOURCES {
        let gaussians = run(&settings(source), &frames).unwrap();
        assert!((1400..2600).contains(&gaussians.len()), "{source:?}: {}", gaussians.len());
        assert!(gaussians.to_field(Timeline::even(3)).check().is_ok());
        let mut away: Vec<f64> = gaussians
            .centers
            .iter()
            .zip(&gaussians.tau)
            .step_by(2)
            .map(|(center, tau)| {
                let center = DVec3::from_array(center.map(f64::from));
                body(*tau as usize).iter().map(|shape| shape.distance(center).abs()).fold(1.0, f64::min)
            })
            .collect();
        away.sort_by(f64::total_cmp);
        // The paper's rule biases all depths: it takes the median depth of the near surface for the
        // distance of the centre.
        let most = if source == DepthSource::Given(Alignment::Rig) { 0.5 } else { 0.03 };
        assert!(away[away.len() * 8 / 10] < most, "{source:?}: {}", away[away.len() * 8 / 10]);
    }
}

#[test]
fn gaussians_project_to_their_pixels() {
    let frame = frame(0, &ring(4, 3.0, 64));
    let one = AnchorSettings {
        views: Some(vec![1]),
        mirror: Mirror::Off,
        gaussians: 400,
        ..settings(DepthSource::Given(Alignment::Metric))
    };
    let gaussians = run(&one, std::slice::from_ref(&frame)).unwrap();
    let (pinhole, seen) = (Pinhole::new(&frame.views[1].camera), &frame.views[1]);
    assert!(gaussians.tau.is_empty() && gaussians.motion.is_empty(), "one frame has no time");
    for (i, center) in gaussians.centers.iter().enumerate() {
        let (place, depth) = pinhole.project(DVec3::from_array(center.map(f64::from))).unwrap();
        assert!(place.iter().all(|at| (at.fract() - 0.5).abs() < 1e-3), "{place:?}: a pixel's centre");
        let pixel = pinhole.pixel(place).unwrap();
        let surface = f64::from(seen.depths.as_ref().unwrap().depths[pixel]);
        let behind = depth - surface;
        assert!(if i % 2 == 0 { behind.abs() < 1e-5 } else { behind > 0.01 && behind < 0.3 }, "{behind}");
        let dc = gaussians.sh[16 * i];
        for (coefficient, byte) in dc.iter().zip(seen.photograph.pixels[pixel]) {
            assert!((0.5 + 0.282_094_8 * coefficient - f32::from(byte) / 255.0).abs() < 1e-5);
        }
    }
}

#[test]
fn colours_are_divided_by_the_mask() {
    let mut frame = frame(0, &ring(4, 3.0, 64));
    for pixel in frame.views.iter_mut().flat_map(|view| &mut view.photograph.pixels) {
        *pixel = if pixel[3] > 0 { [100, 50, 200, 200] } else { [0; 4] };
    }
    let gaussians = run(&settings(DepthSource::Given(Alignment::Metric)), &[frame]).unwrap();
    let color = gaussians.sh[0].map(|c| 0.5 + 0.282_094_8 * c);
    for (c, expected) in color.iter().zip([0.5, 0.25, 1.0]) {
        assert!((c - expected).abs() < 1e-5, "{color:?}");
    }
}

#[test]
fn given_depths_are_aligned_to_the_units_of_the_capture() {
    let cameras = ring(12, 3.0, 64);
    let truth = frame(0, &cameras);
    let mut changed = truth.clone();
    for (i, view) in changed.views.iter_mut().enumerate() {
        let map = view.depths.as_mut().unwrap();
        for (k, depth) in map.depths.iter_mut().enumerate().filter(|(_, depth)| **depth > 0.0) {
            *depth = if k % 5 == 0 { 17.0 } else { (0.2 + 0.01 * i as f32) * *depth + 0.1 };
        }
    }
    let worst = |alignment, frame: &AnchorFrame| {
        let found = depths(&settings(DepthSource::Given(alignment)), frame);
        let mut errors: Vec<f32> = Vec::new();
        for (map, view) in found.iter().zip(&truth.views) {
            let known = map.depths.iter().zip(&view.depths.as_ref().unwrap().depths);
            errors
                .extend(known.filter(|(_, truth)| **truth > 0.0).map(|(depth, truth)| (depth - truth).abs()));
        }
        errors.sort_by(f32::total_cmp);
        errors[errors.len() * 7 / 10]
    };
    assert!(worst(Alignment::Metric, &changed) > 1.0);
    assert!(worst(Alignment::Hull, &changed) < 0.08, "{}", worst(Alignment::Hull, &changed));
    // One scale for all views, as in the paper.
    let mut scaled = truth.clone();
    for view in &mut scaled.views {
        view.depths.as_mut().unwrap().depths.iter_mut().for_each(|depth| *depth *= 0.01);
    }
    let found = depths(&settings(DepthSource::Given(Alignment::Rig)), &scaled);
    let mut all: Vec<f32> =
        found.iter().flat_map(|map| &map.depths).copied().filter(|depth| *depth > 0.0).collect();
    all.sort_by(f32::total_cmp);
    assert!((all[all.len() / 2] - 3.0).abs() < 1e-3, "the median is the radius: {}", all[all.len() / 2]);
}

/// Maps of half the size, and maps without depths.
#[test]
fn maps_of_another_size_are_sampled_and_empty_maps_refused() {
    let mut frame = frame(0, &ring(8, 3.0, 64));
    let metric = settings(DepthSource::Given(Alignment::Metric));
    let whole = run(&metric, std::slice::from_ref(&frame)).unwrap().len();
    for view in &mut frame.views {
        let map = view.depths.take().unwrap();
        let half = (0..32 * 32).map(|i| map.depths[(i / 32 * 2 + 1) * 64 + i % 32 * 2 + 1]).collect();
        view.depths = Some(DepthMap { width: 32, height: 32, depths: half });
    }
    let sampled = run(&metric, std::slice::from_ref(&frame)).unwrap().len();
    assert!((0.9..1.1).contains(&(sampled as f64 / whole as f64)), "{sampled} of {whole}");
    for nothing in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        for view in &mut frame.views {
            view.depths.as_mut().unwrap().depths.fill(nothing);
        }
        for alignment in [Alignment::Metric, Alignment::Rig, Alignment::Hull] {
            let fault = run(&settings(DepthSource::Given(alignment)), std::slice::from_ref(&frame));
            assert_eq!(fault.err(), Some(AnchorError::NoDepths), "{nothing} {alignment:?}");
        }
    }
    frame.views.iter_mut().for_each(|view| view.depths = None);
    assert_eq!(run(&metric, &[frame]).err(), Some(AnchorError::NoDepths));
}

#[test]
fn constant_depths_are_scaled_to_the_hulls_median() {
    let mut frame = frame(0, &ring(8, 3.0, 64));
    for view in &mut frame.views {
        view.depths.as_mut().unwrap().depths.fill(1.0);
    }
    let found = depths(&settings(DepthSource::Given(Alignment::Hull)), &frame);
    for map in &found {
        assert!(map.depths.iter().all(|depth| *depth == map.depths[0]));
        assert!((2.5..3.0).contains(&map.depths[0]), "{}", map.depths[0]);
    }
}

#[test]
fn frames_without_a_subject_are_skipped() {
    let cameras = ring(8, 3.0, 48);
    let mut frames = [0, 1, 2].map(|number| frame(number, &cameras));
    let empty = |frame: &mut AnchorFrame| {
        frame.views.iter_mut().for_each(|view| view.photograph.pixels.fill([0; 4]));
    };
    empty(&mut frames[1]);
    let hull = settings(DepthSource::HullAndSweep);
    let some = run(&hull, &frames).unwrap();
    assert!(some.tau.contains(&0.0) && !some.tau.contains(&1.0) && some.tau.contains(&2.0));
    frames.iter_mut().for_each(empty);
    assert_eq!(run(&hull, &frames).err(), Some(AnchorError::NoSubject));
    assert_eq!(run(&hull, &[]).err(), Some(AnchorError::NoFrames));
}

#[test]
fn one_camera_needs_depths_in_units_of_the_capture() {
    let frame = frame(0, &ring(8, 3.0, 48)[..1]);
    let fault = |source| run(&settings(source), std::slice::from_ref(&frame)).err();
    assert_eq!(fault(DepthSource::HullAndSweep), Some(AnchorError::OneView));
    assert_eq!(fault(DepthSource::Given(Alignment::Hull)), Some(AnchorError::OneView));
    assert_eq!(fault(DepthSource::Given(Alignment::Rig)), Some(AnchorError::NoRig));
    assert_eq!(fault(DepthSource::Given(Alignment::Metric)), None);
}

#[test]
fn black_photographs_have_a_surface_and_unmasked_ones_have_no_hull() {
    let mut frame = frame(0, &ring(8, 3.0, 48));
    for pixel in frame.views.iter_mut().flat_map(|view| &mut view.photograph.pixels) {
        *pixel = [0, 0, 0, pixel[3]];
    }
    let black = run(&settings(DepthSource::HullAndSweep), std::slice::from_ref(&frame)).unwrap();
    assert!(black.len() > 1000 && black.to_field(Timeline::even(1)).check().is_ok());
    for pixel in frame.views.iter_mut().flat_map(|view| &mut view.photograph.pixels) {
        pixel[3] = 255;
    }
    let fault = run(&settings(DepthSource::Hull), std::slice::from_ref(&frame)).err().unwrap();
    assert_eq!(fault, AnchorError::NoMasks);
    assert!(fault.to_string().contains("no masks") && !fault.to_string().contains('\n'));
    // Given depths need no masks, nor does a sweep of two cameras or more.
    for source in [DepthSource::Given(Alignment::Metric), DepthSource::HullAndSweep] {
        assert!(run(&settings(source), std::slice::from_ref(&frame)).is_ok());
    }
    frame.views.truncate(1);
    assert_eq!(run(&settings(DepthSource::HullAndSweep), &[frame]).err(), Some(AnchorError::OnePlace));
}

#[test]
fn a_photograph_of_another_size_is_refused() {
    let mut frame = frame(3, &ring(8, 3.0, 48));
    frame.views[5].camera.width = 47;
    let fault = run(&settings(DepthSource::Hull), std::slice::from_ref(&frame)).err();
    assert_eq!(fault, Some(AnchorError::Size { frame: 3, camera: 5 }));
    let nowhere = AnchorSettings { views: Some(vec![99]), ..settings(DepthSource::Hull) };
    frame.views.truncate(5);
    assert_eq!(run(&nowhere, &[frame]).err(), Some(AnchorError::NoViews));
}

#[test]
fn short_clips_from_one_side_get_a_back() {
    let cameras = ring(16, 3.0, 64);
    let frames = [0, 2].map(|number| frame(number, &cameras));
    let frontal = AnchorSettings { views: Some(vec![0]), ..settings(DepthSource::Hull) };
    let both = run(&frontal, &frames).unwrap();
    assert!((1200..2600).contains(&both.len()), "{}", both.len());
    let (mut front, mut back) = (0, 0);
    for (center, logit) in both.centers.iter().zip(&both.logits) {
        // Camera 0 is at +z, and the subject is around the origin.
        let counted = if *logit >= -1.2 && center[2] > 0.15 { &mut front } else { &mut back };
        *counted += usize::from(center[2].abs() > 0.15);
    }
    assert!(front > 300 && back > 300, "{front} {back}");
    let off = run(&AnchorSettings { mirror: Mirror::Off, ..frontal.clone() }, &frames).unwrap();
    assert!(off.centers.iter().all(|center| center[2] > -0.1));
    let long = anchor(&frontal, Timeline::even(10), frames.iter().cloned().map(Ok::<_, AnchorError>));
    assert!(long.unwrap().centers.iter().all(|center| center[2] > -0.1), "long clips are not mirrored");
    let ring = AnchorSettings { mirror: Mirror::On, ..settings(DepthSource::Hull) };
    assert_eq!(run(&ring, &frames).err(), Some(AnchorError::NoFront));
    // Named cameras that stand all around see the back: no budget is reserved for a mirror.
    let around = AnchorSettings { views: Some((0..16).collect()), ..settings(DepthSource::Hull) };
    let all = AnchorSettings { views: None, ..around.clone() };
    assert_eq!(run(&around, &frames).unwrap(), run(&all, &frames).unwrap());
}

#[test]
fn the_result_does_not_depend_on_threads() {
    let frames = [0, 2].map(|number| frame(number, &ring(8, 3.0, 48)));
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| run(&settings(DepthSource::HullAndSweep), &frames)).unwrap()
    };
    assert_eq!(with(1), with(3));
}
