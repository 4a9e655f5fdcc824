//! `cargo xtask synth stage`: the views are consistent with one surface, and errors leave no partial capture.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use crate::tool::aarc_studio;
use codec::Camera;
use refine::anchor::DepthMap;
use refine::capture::{Holdout, PhotoId, Split};
use refine::image::Image;
use studio::capture::CaptureFiles;
use studio::synth::stage::{StageSettings, write};
use tempfile::tempdir;

/// Relative paths and contents of all files below a folder.
fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        match path.is_dir() {
            true => found.extend(
                files(&path)
                    .into_iter()
                    .map(|(name, bytes)| (Path::new(path.file_name().unwrap()).join(name), bytes)),
            ),
            false => drop(found.insert(path.file_name().unwrap().into(), fs::read(&path).unwrap())),
        }
    }
    found
}

#[test]
fn a_stage_is_a_deterministic_capture() {
    let folder = tempdir().unwrap();
    let folder = folder.path();
    let args = ["synth", "stage", "-o", "stage", "--cameras", "5", "--frames", "3", "--size", "20x16"];
    let outcome = aarc_studio(folder, &args);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    assert!(outcome.stdout.contains("5 cameras, 1 of them held; 3 frames of 20x16"), "{}", outcome.stdout);
    let written = files(&folder.join("stage"));
    assert_eq!(written.len(), 1 + 3 * 5 * 3);
    // The folder may exist if it is empty.
    fs::create_dir(folder.join("again")).unwrap();
    write(
        &folder.join("again"),
        &StageSettings { cameras: 5, frames: 3, size: [20, 16], props: false },
        || (),
    )
    .unwrap();
    assert!(files(&folder.join("again")) == written, "the same bytes");
    assert_eq!(fs::read_dir(folder).unwrap().count(), 2, "no temporary folder is left");

    let capture_files = CaptureFiles::open(&folder.join("stage")).unwrap();
    let splits = Split::assign(&capture_files.capture, Holdout::Odd).unwrap();
    let counts = Split::ALL.map(|split| splits.iter().filter(|(_, of)| *of == split).count());
    assert_eq!((counts, capture_files.missing_count()), ([8, 4, 2, 1], 0));
    // The figure moves.
    let photo = |frame| capture_files.photo(PhotoId { camera: 1, frame }).unwrap().image;
    assert!(photo(0).psnr(&photo(2)) < 25.0);
}

#[test]
fn bad_requests_end_with_one_line() {
    let folder = tempdir().unwrap();
    let folder = folder.path();
    let error =
        |more: &[&str]| aarc_studio(folder, &[&["synth", "stage", "-o", "stage"], more].concat()).error(2);
    assert!(error(&["--cameras", "0"]).contains("0 cameras"));
    assert!(error(&["--frames", "100001"]).contains("100001 frames"));
    assert!(error(&["--size", "64x4"]).contains("64x4 pixels"));
    fs::create_dir(folder.join("stage")).unwrap();
    fs::write(folder.join("stage/mine.txt"), "mine").unwrap();
    assert!(error(&[]).contains("cannot write stage"));
    assert_eq!(files(folder).len(), 1);
    assert!(
        aarc_studio(folder, &["synth", "stage", "-o", "no/stage"]).error(2).contains("cannot write no/stage")
    );
}

/// A photograph with its camera and depths.
struct DepthView {
    camera: Camera,
    photo: Image,
    depths: DepthMap,
}

fn depth_views(settings: StageSettings) -> Vec<DepthView> {
    let folder = tempdir().unwrap();
    let stage = folder.path().join("stage");
    write(&stage, &settings, || ()).unwrap();
    let capture_files = CaptureFiles::open(&stage).unwrap();
    let view = |id: &PhotoId| DepthView {
        camera: capture_files.capture.cameras[id.camera].camera.clone(),
        photo: capture_files.photo(*id).unwrap().image,
        depths: capture_files.depth(&stage.join("depths"), *id).unwrap().expect("depths"),
    };
    capture_files.capture.photos.iter().map(view).collect()
}

#[test]
fn masks_agree_with_depths_and_colours() {
    for DepthView { photo, depths, .. } in
        depth_views(StageSettings { cameras: 3, frames: 2, size: [48, 40], props: false })
    {
        assert_eq!((depths.width, depths.height), (48, 40));
        for (pixel, depth) in photo.pixels.iter().zip(&depths.depths) {
            let [r, g, b, mask] = *pixel;
            assert!(*depth == 0.0 || (1.5..4.5).contains(depth), "{depth}");
            // If all samples hit, or none, so does the pixel's centre.
            assert!(mask < 1.0 || *depth > 0.0);
            assert!(mask > 0.0 || *depth == 0.0);
            // Colours are multiplied by coverage once.
            let brightest = r.max(g).max(b);
            assert!(brightest <= mask + 0.5 / 255.0 && brightest >= 0.1 * mask - 1.0 / 255.0, "{pixel:?}");
        }
    }
}

/// World position of the surface at a pixel.
fn point(view: &DepthView, x: u32, y: u32) -> Option<[f64; 3]> {
    let z = f64::from(view.depths.depths[(y * view.camera.width + x) as usize]);
    let (k, m) = (&view.camera.k, &view.camera.camera_from_world);
    let at = |i: usize, pixel: u32| (f64::from(pixel) + 0.5 - k[i][2]) / k[i][i] * z;
    let translated = [at(0, x) - m[0][3], at(1, y) - m[1][3], z - m[2][3]];
    (z > 0.0).then(|| [0, 1, 2].map(|axis| (0..3).map(|r| m[r][axis] * translated[r]).sum()))
}

/// Pixel coordinates and depth of a point.
fn project(camera: &Camera, point: [f64; 3]) -> [f64; 3] {
    let m = &camera.camera_from_world;
    let p = [0, 1, 2].map(|r| (0..3).map(|axis| m[r][axis] * point[axis]).sum::<f64>() + m[r][3]);
    let pixel = |i: usize| p[i] / p[2] * camera.k[i][i] + camera.k[i][2];
    [pixel(0), pixel(1), p[2]]
}

/// A point that one camera sees lies on the surface that another sees, or behind it; if both see it, it has the
/// same colour. The test uses only cameras and depths, not shapes or light.
#[test]
fn cameras_agree_on_one_surface() {
    let size = 112;
    let views = depth_views(StageSettings { cameras: 8, frames: 1, size: [size, size], props: false });
    let (mut points, mut through, mut both) = (0, 0, 0);
    let (mut alike, mut unlike) = (0.0, 0.0);
    for from in 0..views.len() {
        let (from, to) = (&views[from], &views[(from + 1) % views.len()]);
        for (x, y) in (0..size).flat_map(|y| (0..size).map(move |x| (x, y))) {
            let Some(point) = point(from, x, y) else { continue };
            let [u, v, z] = project(&to.camera, point);
            let (u, v) = (u as u32, v as u32);
            let depth = |x: u32, y: u32| f64::from(to.depths.depths[(y * size + x) as usize]);
            // Neighbouring pixels may miss the figure, but not all of them.
            let around = (v - 1..=v + 1).flat_map(|y| (u - 1..=u + 1).map(move |x| (x, y)));
            let nearest = around.map(|(x, y)| depth(x, y)).filter(|d| *d > 0.0).fold(f64::INFINITY, f64::min);
            points += 1;
            through += usize::from(nearest > z + 0.01);
            if (depth(u, v) - z).abs() < 0.005 {
                both += 1;
                let difference = |a: [f64; 4], b: [f64; 4]| (0..3).map(|c| (a[c] - b[c]).abs()).sum::<f64>();
                let color = from.photo.pixel(x, y);
                alike += difference(color, to.photo.pixel(u, v));
                unlike += difference(color, to.photo.pixel(u, v.saturating_sub(size / 14)));
            }
        }
    }
    assert!(points > 4000 && through * 200 < points, "{through} of {points} see through the figure");
    assert!(both * 5 > points, "{both} of {points} are seen by both");
    assert!(alike < 0.6 * unlike, "{alike} and {unlike} over {both} points");
}
