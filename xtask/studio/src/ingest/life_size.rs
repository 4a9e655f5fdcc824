//! [`metres_per_unit`]: how large a unit of the calibration is, by the height of the subject, who stands upright at the start.
//!
//! In each silhouette, the highest and the lowest point along the up direction are measured to a part of a pixel: rays through
//! the edge, at the depth at which rays beside it enter the visual hull. Of the heights in all cameras and frames the upper
//! quartile counts: cameras see round ends from above or below, and so a little less, and a matte that is wrong does not move
//! it.

use codec::Camera;
use glam::DVec3;
use program::Fault;
use refine::anchor::{AnchorError, AnchorFrame, AnchorView, DepthMap, HullSettings, hull_depths};
use refine::capture::PhotoId;
use refine::fit::Photograph;

use crate::capture::CaptureFiles;

/// Number of frames from the first on.
const FRAMES: usize = 5;

/// Longer side in pixels that photographs are shrunk to by a whole factor. Edges in between are in the masks' values.
const SIDE: u32 = 512;

/// Pixels below the highest one that may hold the highest edge, pixels from their middles to it, and steps in a pixel.
const CANDIDATES: f64 = 1.5;
const EDGE_MAX: usize = 2;
const EDGE_STEPS: usize = 4;

/// Mask value, out of 255, at an edge.
const EDGE: f64 = 127.5;

/// What several views measure.
#[derive(Clone, Copy, Debug)]
pub(super) struct Measure {
    /// The upper quartile.
    pub(super) value: f64,
    /// Half of the distance between the quartiles, as a share of it.
    pub(super) spread: f64,
}

/// Metres per unit if the subject of the capture is `height_m` tall; `up` has length 1.
///
/// # Errors
/// [`Fault::Data`] if a photograph cannot be read, or no view of the first frames shows the whole subject.
pub(super) fn metres_per_unit(
    capture_files: &CaptureFiles,
    up: [f64; 3],
    height_m: f64,
) -> Result<Measure, Fault> {
    let sides =
        capture_files.capture.cameras.iter().map(|camera| camera.camera.width.max(camera.camera.height));
    let capture_files = capture_files.coarser((sides.max().unwrap_or(1) / SIDE).max(1));
    let mut heights = Vec::new();
    let mut problem = "no camera shows it from its lowest to its highest point".to_owned();
    for frame in 0..FRAMES.min(capture_files.capture.frames()) {
        match heights_in(views(&capture_files, frame)?, DVec3::from(up)) {
            Ok(found) => heights.extend(found),
            Err(error) => problem = error.to_string(),
        }
    }
    match measure(heights.into_iter().filter(|height| *height > 0.0).collect()) {
        Some(Measure { value, spread }) => Ok(Measure { value: height_m / value, spread }),
        None => Err(Fault::Data(format!(
            "--height {height_m}: the subject cannot be measured at the start: {problem}; look at its masks, or state \
             --metres-per-unit"
        ))),
    }
}

/// What these values measure; `None` of nothing.
fn measure(mut values: Vec<f64>) -> Option<Measure> {
    values.sort_by(f64::total_cmp);
    let quartile = |number: usize| values.get(number * values.len().saturating_sub(1) / 4).copied();
    let (low, high) = quartile(1).zip(quartile(3))?;
    Some(Measure { value: high, spread: 0.5 * (high - low) / high })
}

/// The photographs of a frame.
fn views(capture_files: &CaptureFiles, frame: usize) -> Result<Vec<AnchorView>, Fault> {
    let of_frame = capture_files.capture.photos.iter().filter(|photo_id| photo_id.frame == frame);
    let view = |&photo_id: &PhotoId| {
        let photograph = Photograph::from(&capture_files.photo(photo_id)?);
        let camera: Camera = capture_files.capture.cameras[photo_id.camera].camera.clone();
        Ok(AnchorView { camera_id: photo_id.camera, camera, photograph, depths: None })
    };
    of_frame.map(view).collect()
}

/// Heights of the subject in the views of a frame, in units; none of a view that it is cut off in.
fn heights_in(views: Vec<AnchorView>, up: DVec3) -> Result<Vec<f64>, AnchorError> {
    let frame = AnchorFrame { frame: 0, time: 0.0, views };
    let maps = hull_depths(&frame, HullSettings::default())?;
    let height = |(view, map): (&AnchorView, &DepthMap)| Some(end(view, map, up)? + end(view, map, -up)?);
    Ok(frame.views.iter().zip(&maps).filter_map(height).collect())
}

/// How far the silhouette of a view goes `along` a direction of length 1, from the origin of the world; `None` if it is empty
/// or leaves the picture there.
fn end(AnchorView { camera, photograph, .. }: &AnchorView, map: &DepthMap, along: DVec3) -> Option<f64> {
    let (k, position) = (&camera.k, DVec3::from(camera.position()));
    let [right, down, forward] = [0, 1, 2].map(|row| DVec3::from_slice(&camera.camera_from_world[row][..3]));
    let [x_rate, y_rate] = [along.dot(right) / k[0][0], along.dot(down) / k[1][1]];
    let at = |[x, y]: [f64; 2], depth: f64| {
        let ray = along.dot(forward) + (x - k[0][2]) * x_rate + (y - k[1][2]) * y_rate;
        along.dot(position) + depth * ray
    };
    let width = photograph.width as usize;
    let middle = |pixel: usize| [pixel % width, pixel / width].map(|at| at as f64 + 0.5);
    let known = map.depths.iter().enumerate().filter(|(_, depth)| **depth > 0.0);
    let known: Vec<(usize, f64)> = known.map(|(pixel, depth)| (pixel, f64::from(*depth))).collect();
    let of_middles = known.iter().map(|(pixel, depth)| at(middle(*pixel), *depth));
    let highest = of_middles.fold(f64::NEG_INFINITY, f64::max);
    let rate = x_rate.hypot(y_rate);
    let is_candidate =
        |(pixel, depth): &&(usize, f64)| at(middle(*pixel), *depth) > highest - CANDIDATES * depth * rate;
    let mut end = f64::NEG_INFINITY;
    for (pixel, depth) in known.iter().filter(is_candidate) {
        let [x, y] = middle(*pixel);
        let place = |step: f64| [x + step * x_rate / rate, y + step * y_rate / rate];
        let edge = edge(|step| alpha(photograph, place(step)))?;
        end = end.max(at(place(edge), *depth));
    }
    end.is_finite().then_some(end)
}

/// Distance in pixels at which an alpha, by distance, falls below [`EDGE`]; the most if it does not. `None` if a value on the way
/// is unknown.
fn edge(alpha: impl Fn(f64) -> Option<f64>) -> Option<f64> {
    let mut before = alpha(0.0)?;
    for step in 1..=EDGE_MAX * EDGE_STEPS {
        let after = alpha(step as f64 / EDGE_STEPS as f64)?;
        if after < EDGE && before > after {
            let part = ((before - EDGE) / (before - after)).clamp(0.0, 1.0);
            return Some((step as f64 - 1.0 + part) / EDGE_STEPS as f64);
        }
        before = after;
    }
    Some(EDGE_MAX as f64)
}

/// Bilinear alpha of a photograph; `None` outside of the middles of its pixels, and where a lens shows nothing.
fn alpha(photograph: &Photograph, [x, y]: [f64; 2]) -> Option<f64> {
    let (left, top) = ((x - 0.5).floor(), (y - 0.5).floor());
    let [width, height] = [photograph.width, photograph.height].map(f64::from);
    if left < 0.0 || top < 0.0 || left + 1.0 >= width || top + 1.0 >= height {
        return None;
    }
    let first = top as usize * photograph.width as usize + left as usize;
    let below = first + photograph.width as usize;
    if ![first, first + 1, below, below + 1].into_iter().all(|pixel| photograph.is_valid(pixel)) {
        return None;
    }
    let [u, v] = [x - 0.5 - left, y - 0.5 - top];
    let row = |at: usize| {
        let [a, b] = [at, at + 1].map(|pixel| f64::from(photograph.pixels[pixel][3]));
        a + u * (b - a)
    };
    let (above, below) = (row(first), row(below));
    Some(above + v * (below - above))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::stage::{StageSettings, silhouettes};

    /// Views of the figure of the stage, and its height.
    fn stage(cameras: usize, size: u32, frame: f64) -> (Vec<AnchorView>, f64) {
        let settings = StageSettings { cameras, frames: 33, size: [size; 2], props: false };
        let (masks, height) = silhouettes(&settings, frame);
        let view = |(camera_id, (camera, mask)): (usize, (Camera, Vec<u8>))| {
            let pixels = mask.into_iter().map(|alpha| [alpha; 4]).collect();
            let photograph = Photograph { width: size, height: size, pixels, valid: Vec::new() };
            AnchorView { camera_id, camera, photograph, depths: None }
        };
        (masks.into_iter().enumerate().map(view).collect(), height)
    }

    #[test]
    fn a_figure_is_as_tall_as_it_is() {
        for (cameras, size, frame) in
            [(16, 96, 0.0), (16, 480, 0.0), (4, 240, 0.0), (6, 240, 9.0), (8, 240, 3.0)]
        {
            let (mut views, height) = stage(cameras, size, frame);
            let error = |views: &[AnchorView]| {
                let found = measure(heights_in(views.to_vec(), DVec3::Y).unwrap()).unwrap();
                found.value / height - 1.0
            };
            assert!(error(&views).abs() < 0.01);
            // The mask of one camera has a bar below the feet.
            let bar = 2 * views[1].photograph.pixels.len() / 3;
            let pixels = views[1].photograph.pixels[bar..].chunks_mut(size as usize);
            pixels.for_each(|row| row[size as usize * 2 / 5..size as usize * 3 / 5].fill([255; 4]));
            assert!(cameras < 8 || error(&views).abs() < 0.01);
        }
    }

    #[test]
    fn views_that_cut_the_subject_off_do_not_measure_it() {
        let (mut views, _) = stage(6, 96, 0.0);
        assert_eq!(heights_in(views[..1].to_vec(), DVec3::Y), Err(AnchorError::OneView));
        let lying = measure(heights_in(views.clone(), DVec3::X).unwrap()).unwrap();
        assert!(lying.value < 1.2, "{lying:?}");
        // Behind the edge of a lens, too.
        let mut beyond = views.clone();
        let photograph = &mut beyond[2].photograph;
        photograph.valid = (0..96 * 96).map(|pixel| pixel >= 48 * 96).collect();
        photograph.pixels[..48 * 96].fill([0; 4]);
        assert_eq!(heights_in(beyond, DVec3::Y).unwrap().len(), 5);
        let AnchorView { camera, photograph, .. } = &mut views[2];
        photograph.pixels.drain(..48 * 96);
        (photograph.height, camera.height) = (48, 48);
        camera.k[1][2] -= 48.0;
        assert_eq!(heights_in(views, DVec3::Y).unwrap().len(), 5);
    }
}
