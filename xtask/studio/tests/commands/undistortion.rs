//! Photographs and depth maps taken through lenses, in every layout of captures, come out as a pinhole has them.
//!
//! The photographs are rendered here: each pixel of the lens shows a pattern in the direction of its ray,
//! which the lens's formula gives, inverted by bisection.

use std::fs;
use std::path::Path;

use image::{ImageBuffer, Luma, Rgb};
use refine::capture::{Lens, Photo, PhotoId};
use serde_json::json;
use studio::capture::CaptureFiles;
use tempfile::tempdir;

const SIZE: [u32; 2] = [200, 150];
/// fx, fy, cx, cy.
const K: [f64; 4] = [90.0, 96.0, 97.0, 78.0];

/// The photograph of all layouts.
const PHOTO: PhotoId = PhotoId { camera: 0, frame: 0 };

/// Coefficients as OpenCV names them; the pictures here have no tangential distortion.
#[derive(Clone, Copy)]
enum Coefficients {
    /// k1 to k6.
    Rational([f64; 6]),
    /// k1 to k4.
    Fisheye([f64; 4]),
}
use Coefficients::{Fisheye, Rational};

/// Barrels that show more than the pinhole does, so that no pixel lacks a source.
const RATIONAL: Coefficients = Rational([0.31, 0.08, 0.01, 0.62, 0.15, 0.02]);
const FISHEYE: Coefficients = Fisheye([0.03, -0.02, 0.006, -0.001]);

impl Coefficients {
    /// Distorted radius of a point at tangent `r` off the axis.
    fn bent(self, r: f64) -> f64 {
        let q = r * r;
        match self {
            Rational([k1, k2, k3, k4, k5, k6]) => {
                r * (1.0 + k1 * q + k2 * q.powi(2) + k3 * q.powi(3))
                    / (1.0 + k4 * q + k5 * q.powi(2) + k6 * q.powi(3))
            }
            Fisheye([k1, k2, k3, k4]) => {
                let t = r.atan();
                t + k1 * t.powi(3) + k2 * t.powi(5) + k3 * t.powi(7) + k4 * t.powi(9)
            }
        }
    }

    /// The normalised point without the lens that a pixel of the lens shows; `None` where it shows none below a
    /// tangent of `end`.
    fn straight(self, column: u32, row: u32, end: f64) -> Option<[f64; 2]> {
        let at = normalised(column, row);
        let wanted = at[0].hypot(at[1]);
        let [mut low, mut high] = [0.0, end];
        if self.bent(high) <= wanted {
            return None;
        }
        for _ in 0..80 {
            let half_way = 0.5 * (low + high);
            if self.bent(half_way) < wanted { low = half_way } else { high = half_way }
        }
        Some(at.map(|x| x / wanted * low))
    }

    /// A photograph of the pattern through the lens, black where it shows none.
    fn save_photo(self, path: &Path, end: f64) {
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        let photo = ImageBuffer::from_fn(SIZE[0], SIZE[1], |x, y| {
            let color = self.straight(x, y, end).map_or([0.0; 3], pattern);
            Rgb(color.map(|c| (c * 65535.0).round() as u16))
        });
        photo.save(path).unwrap();
    }

    /// In OpenCV's order, without the zeros at the end.
    fn in_opencv_order(self) -> Vec<f64> {
        match self {
            Rational([k1, k2, k3, k4, k5, k6]) => vec![k1, k2, 0.0, 0.0, k3, k4, k5, k6],
            Fisheye(k) => k.to_vec(),
        }
    }
}

/// The normalised image coordinates of a pixel's centre.
fn normalised(column: u32, row: u32) -> [f64; 2] {
    [(f64::from(column) + 0.5 - K[2]) / K[0], (f64::from(row) + 0.5 - K[3]) / K[1]]
}

/// Colours by direction: waves of about 20 pixels, and none that is black.
fn pattern([x, y]: [f64; 2]) -> [f64; 3] {
    let wave = |phase: f64| 0.5 + 0.4 * (phase).sin();
    [wave(14.0 * x + 3.0 * y), wave(13.0 * y), wave(9.0 * x - 11.0 * y)]
}

/// Maximum error against the pattern and the number of unseen pixels, below a tangent of `end`.
fn error_and_unseen(photo: &Photo, end: f64) -> (f64, usize) {
    let (mut worst, mut unseen): (f64, usize) = (0.0, 0);
    for (i, pixel) in photo.image.pixels.iter().enumerate() {
        let point = normalised(i as u32 % SIZE[0], i as u32 / SIZE[0]);
        if point[0].hypot(point[1]) >= end {
            assert!(!photo.seen[i] && *pixel == [0.0; 4], "{point:?} is beyond the lens");
        } else if photo.seen[i] {
            let expected = pattern(point);
            (0..3).for_each(|c| worst = worst.max((pixel[c] - expected[c]).abs()));
        } else {
            unseen += 1;
        }
    }
    (worst, unseen)
}

const IDENTITY: [[f64; 4]; 4] =
    [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];

fn manifest(folder: &Path, coefficients: Coefficients) {
    let [fx, fy, cx, cy] = K;
    let mut camera = json!({
        "id": "00", "w": SIZE[0], "h": SIZE[1], "K": [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], "w2c": IDENTITY,
        "D": coefficients.in_opencv_order(),
    });
    if matches!(coefficients, Fisheye(_)) {
        camera["lens"] = "fisheye".into();
    }
    let manifest = json!({ "frames": 1, "images": "images/{camera}/{frame}.png", "cameras": [camera] });
    fs::write(folder.join("capture.json"), manifest.to_string()).unwrap();
}

fn easyvolcap(folder: &Path, d: &str) {
    let [fx, fy, cx, cy] = K;
    let matrix = |key: &str, data: &str| format!("{key}_00: !!opencv-matrix\n  data: [{data}]\n");
    let names = "%YAML:1.0\n---\nnames:\n  - \"00\"\n";
    let k = matrix("K", &format!("{fx}, 0., {cx}, 0., {fy}, {cy}, 0., 0., 1."));
    fs::write(folder.join("intri.yml"), [names, &k, &matrix("D", d)].concat()).unwrap();
    let pose = [matrix("R", "0., 0., 0."), matrix("T", "0., 0., 0.")].concat();
    fs::write(folder.join("extri.yml"), [names, &pose].concat()).unwrap();
}

fn transforms(folder: &Path, model: &str, coefficients: &[(&str, f64)]) {
    let [fx, fy, cx, cy] = K;
    let mut pose = IDENTITY;
    (pose[1][1], pose[2][2]) = (-1.0, -1.0);
    let mut transforms = json!({
        "camera_model": model, "fl_x": fx, "fl_y": fy, "cx": cx, "cy": cy,
        "frames": [{ "file_path": "images/00/0.png", "transform_matrix": pose }],
    });
    for (key, value) in coefficients {
        transforms[*key] = (*value).into();
    }
    fs::write(folder.join("transforms.json"), transforms.to_string()).unwrap();
}

/// A binary model of COLMAP with one camera.
fn colmap(folder: &Path, model: u32, parameters: &[f64]) {
    let parameters: Vec<u8> = parameters.iter().flat_map(|x| x.to_le_bytes()).collect();
    let size: Vec<u8> = SIZE.iter().flat_map(|side| u64::from(*side).to_le_bytes()).collect();
    let one = 1u64.to_le_bytes();
    let camera = [&one[..], &1u32.to_le_bytes(), &model.to_le_bytes(), &size, &parameters].concat();
    let pose: Vec<u8> = [1.0f64, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0].iter().flat_map(|x| x.to_le_bytes()).collect();
    let image = [&one[..], &[0; 4], &pose, &1u32.to_le_bytes(), b"00/0.png\0", &[0; 8]].concat();
    fs::write(folder.join("cameras.bin"), camera).unwrap();
    fs::write(folder.join("images.bin"), image).unwrap();
}

#[test]
fn photographs_are_undistorted_in_every_layout() {
    let check = |name: &str, coefficients: Coefficients, write: &dyn Fn(&Path, Vec<f64>)| {
        let folder = tempdir().unwrap();
        coefficients.save_photo(&folder.path().join("images/00/0.png"), 50.0);
        write(folder.path(), coefficients.in_opencv_order());
        let photo = CaptureFiles::open(folder.path()).unwrap().photo(PHOTO).unwrap();
        let (error, unseen) = error_and_unseen(&photo, f64::INFINITY);
        println!("{name}: {error}");
        // That of interpolation; without the lens it is 0.8.
        assert!(error < 0.01 && unseen == 0, "{name}: an error of {error}, {unseen} pixels unseen");
    };
    let with = |k: &[f64], d: Vec<f64>| [k, &d].concat();
    for coefficients in [RATIONAL, FISHEYE] {
        check("manifest", coefficients, &|folder, _| manifest(folder, coefficients));
    }
    check("EasyVolcap", RATIONAL, &|folder, d| {
        let d: Vec<String> = d.iter().map(f64::to_string).collect();
        easyvolcap(folder, &d.join(", "));
    });
    check("transforms, OPENCV_FISHEYE", FISHEYE, &|folder, d| {
        transforms(folder, "OPENCV_FISHEYE", &[("k1", d[0]), ("k2", d[1]), ("k3", d[2]), ("k4", d[3])]);
    });
    check("transforms, FULL_OPENCV", RATIONAL, &|folder, d| {
        let k = [("k1", d[0]), ("k2", d[1]), ("k3", d[4]), ("k4", d[5]), ("k5", d[6]), ("k6", d[7])];
        transforms(folder, "FULL_OPENCV", &k);
    });
    check("COLMAP, OPENCV_FISHEYE", FISHEYE, &|folder, d| colmap(folder, 5, &with(&K, d)));
    check("COLMAP, FULL_OPENCV", RATIONAL, &|folder, d| colmap(folder, 6, &with(&K, d)));
}

#[test]
fn colmaps_fisheyes_with_one_focal_length_are_read() {
    for (model, k) in [(8, &[0.1][..]), (9, &[0.1, -0.02])] {
        let folder = tempdir().unwrap();
        FISHEYE.save_photo(&folder.path().join("images/00/0.png"), 50.0);
        colmap(folder.path(), model, &[&[90.0, 97.0, 78.0], k].concat());
        let capture_files = CaptureFiles::open(folder.path()).unwrap();
        let camera = &capture_files.capture.cameras[0];
        assert_eq!(camera.lens, Lens::fisheye(k).unwrap());
        assert_eq!([camera.camera.k[0][0], camera.camera.k[1][1], camera.camera.k[1][2]], [90.0, 90.0, 78.0]);
    }
}

#[test]
fn pixels_beyond_a_fisheye_lens_are_unseen() {
    // t - 0.45 t^3 grows to t^2 = 1 / 1.35, a tangent of 1.16; the corners of the pinhole are at 1.4.
    let (coefficients, end) = (Fisheye([-0.45, 0.0, 0.0, 0.0]), (1.0f64 / 1.35).sqrt().tan());
    let folder = tempdir().unwrap();
    coefficients.save_photo(&folder.path().join("images/00/0.png"), end);
    manifest(folder.path(), coefficients);
    let photo = CaptureFiles::open(folder.path()).unwrap().photo(PHOTO).unwrap();
    let beyond = photo.seen.iter().filter(|seen| !**seen).count();
    let (_, unseen) = error_and_unseen(&photo, end);
    assert!(beyond > 500 && unseen == 0, "{beyond} beyond the lens, {unseen} others unseen");
}

/// Depth along the axis of a tilted plane in a direction; 0 where the plane is behind the camera.
fn plane([x, y]: [f64; 2]) -> f64 {
    (3.0 / (1.0 - 0.3 * x + 0.2 * y)).max(0.0)
}

#[test]
fn depth_maps_are_undistorted_with_the_lens() {
    for coefficients in [RATIONAL, FISHEYE] {
        let folder = tempdir().unwrap();
        coefficients.save_photo(&folder.path().join("images/00/0.png"), 50.0);
        manifest(folder.path(), coefficients);
        let maps = folder.path().join("maps");
        fs::create_dir_all(maps.join("00")).unwrap();
        let depths = ImageBuffer::from_fn(SIZE[0], SIZE[1], |x, y| {
            let depth = coefficients.straight(x, y, 50.0).map_or(0.0, plane);
            Luma([(depth * 1000.0).round().min(65535.0) as u16])
        });
        depths.save(maps.join("00/0.png")).unwrap();
        let map = CaptureFiles::open(folder.path()).unwrap().depth(&maps, PHOTO).unwrap().unwrap();
        let (mut with_lens, mut without): (f64, f64) = (0.0, 0.0);
        for (i, depth) in map.depths.iter().enumerate() {
            let (column, row) = (i as u32 % SIZE[0], i as u32 / SIZE[0]);
            let expected = plane(normalised(column, row));
            let error = |depth: f64| (depth / expected - 1.0).abs();
            with_lens = with_lens.max(error(f64::from(*depth)));
            without = without.max(error(f64::from(depths.get_pixel(column, row).0[0]) / 1000.0));
        }
        // The nearest value is up to half a pixel away.
        assert!(with_lens < 0.02 && without > 0.1, "{with_lens} with the lens, {without} without");
    }
}

#[test]
fn other_lenses_are_refused_in_a_sentence() {
    let refused = |problem: &str, write: &dyn Fn(&Path)| {
        let folder = tempdir().unwrap();
        FISHEYE.save_photo(&folder.path().join("images/00/0.png"), 50.0);
        write(folder.path());
        let error = CaptureFiles::open(folder.path()).unwrap_err().to_string();
        assert!(error.contains(problem) && !error.contains('\n'), "'{problem}' expected: {error}");
    };
    refused("9 coefficients: only k1, k2, p1, p2, k3, k4, k5, k6", &|folder| {
        easyvolcap(folder, "0, 0, 0, 0, 0, 0, 0, 0, 0.1");
    });
    refused("D_00 is missing, malformed or too short", &|folder| easyvolcap(folder, "0.1, .Nan"));
    refused("camera model FISHEYE624 is not supported", &|folder| transforms(folder, "FISHEYE624", &[]));
    refused("camera model OPENCV has k1, k2, k3, p1, p2", &|folder| {
        transforms(folder, "OPENCV", &[("k1", 0.1), ("k4", 0.1)]);
    });
    for model in [7, 10, 11] {
        refused("supported are SIMPLE_PINHOLE, PINHOLE", &|folder| {
            colmap(folder, model, &[9.0; 16]);
        });
    }
}
