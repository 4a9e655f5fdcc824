//! Captures with faults: each gives a sensible result or a one-line error that names the problem.

use std::fs;
use std::path::Path;

use crate::tool::{Outcome, aarc_studio};
use image::{DynamicImage, GrayImage, ImageBuffer, Luma, RgbImage};
use refine::capture::{Holdout, PhotoId};
use serde_json::{Value, json};
use studio::capture::CaptureFiles;
use studio::fit::TrainingViews;
use studio::synth::stage::{StageSettings, write};
use tempfile::{TempDir, tempdir};

const SIDE: u32 = 24;

/// A capture of four cameras, the last one held, and three frames, with an unrelated field.
struct Studio(TempDir);

impl Studio {
    fn new() -> Studio {
        let folder = tempdir().unwrap();
        let settings = StageSettings { cameras: 4, frames: 3, size: [SIDE, SIDE], props: false };
        write(&folder.path().join("capture"), &settings, || ()).unwrap();
        assert_eq!(aarc_studio(folder.path(), &["synth", "limbs", "-o", "field.ply"]).code, Some(0));
        Studio(folder)
    }

    fn folder(&self) -> &Path {
        self.0.path()
    }

    /// Applies a change to the original manifest.
    fn manifest(&self, change: impl Fn(&mut Value)) {
        let path = self.folder().join("capture/capture.json");
        let original = self.folder().join("original.json");
        if !original.exists() {
            fs::copy(&path, &original).unwrap();
        }
        let mut manifest: Value = serde_json::from_slice(&fs::read(original).unwrap()).unwrap();
        change(&mut manifest);
        fs::write(path, manifest.to_string()).unwrap();
    }

    fn file(&self, kind: &str, camera: usize, frame: usize) -> std::path::PathBuf {
        self.folder().join(format!("capture/{kind}/{camera:02}/{frame:06}.png"))
    }

    /// Paths of all images or masks.
    fn files(&self, kind: &'static str) -> impl Iterator<Item = std::path::PathBuf> {
        (0..12).map(move |i| self.file(kind, i % 4, i / 4))
    }

    fn eval(&self) -> Outcome {
        aarc_studio(
            self.folder(),
            &["eval", "field.ply", "--capture", "capture", "--holdout", "odd", "--json"],
        )
    }

    fn splits(&self) -> Value {
        self.eval().json()["splits"].clone()
    }

    fn capture_files(&self) -> CaptureFiles {
        CaptureFiles::open(&self.folder().join("capture")).unwrap()
    }
}

fn images(splits: &Value) -> Vec<Option<u64>> {
    ["train", "interp_b", "recon", "interp_a"].map(|split| splits[split]["images"].as_u64()).to_vec()
}

#[test]
fn one_camera_and_one_frame_are_enough() {
    let studio = Studio::new();
    assert_eq!(images(&studio.splits()), [Some(6), Some(3), Some(2), Some(1)]);
    studio.manifest(|manifest| manifest["cameras"].as_array_mut().unwrap().truncate(1));
    assert_eq!(images(&studio.splits()), [Some(2), Some(1), None, None]);
    studio.manifest(|manifest| manifest["frames"] = 1.into());
    assert_eq!(images(&studio.splits()), [Some(3), None, Some(1), None]);
    studio.manifest(|manifest| {
        manifest["frames"] = 1.into();
        manifest["cameras"].as_array_mut().unwrap().truncate(1);
    });
    assert_eq!(images(&studio.splits()), [Some(1), None, None, None]);
    // Writing pictures works too, without an interval between frames or a place between cameras.
    let args = ["eval", "field.ply", "--capture", "capture", "-o", "out"];
    let outcome = aarc_studio(studio.folder(), &args);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    assert!(!studio.folder().join("out/quarter_frames.png").exists());
}

#[test]
fn black_photographs_and_empty_masks_are_measured() {
    let studio = Studio::new();
    for path in studio.files("images") {
        RgbImage::new(SIDE, SIDE).save(path).unwrap();
    }
    let black = studio.splits();
    assert_eq!(images(&black), [Some(6), Some(3), Some(2), Some(1)]);
    assert!(black["train"]["psnr_fg"].is_number(), "{black}");
    for path in studio.files("masks") {
        GrayImage::new(SIDE, SIDE).save(path).unwrap();
    }
    let empty = studio.splits();
    assert!(empty["train"]["psnr_fg"].is_null() && empty["train"]["psnr_full"].is_number(), "{empty}");
    assert_eq!(empty["train"]["without_subject"], 6);
}

#[test]
fn images_of_8_and_16_bits_measure_the_same() {
    let studio = Studio::new();
    let before = studio.splits();
    for camera in [0, 3] {
        let path = studio.file("images", camera, 1);
        DynamicImage::ImageRgb16(image::open(&path).unwrap().to_rgb16()).save(path).unwrap();
        let path = studio.file("masks", camera, 1);
        DynamicImage::ImageLuma16(image::open(&path).unwrap().to_luma16()).save(path).unwrap();
    }
    assert_eq!(studio.splits(), before);
}

#[test]
fn missing_photographs_are_noted_and_missing_masks_refused() {
    let studio = Studio::new();
    fs::remove_file(studio.file("images", 1, 2)).unwrap();
    fs::remove_file(studio.file("images", 2, 2)).unwrap();
    fs::remove_file(studio.file("images", 2, 1)).unwrap();
    let outcome = studio.eval();
    assert!(outcome.stderr.contains("3 photographs are missing"), "{}", outcome.stderr);
    assert_eq!(images(&outcome.json()["splits"]), [Some(4), Some(2), Some(2), Some(1)]);
    fs::remove_file(studio.file("masks", 0, 1)).unwrap();
    let error = studio.eval().error(3);
    assert!(error.contains("masks/00/000001.png: this mask is missing"), "{error}");
}

#[test]
fn images_of_wrong_size_are_named() {
    let studio = Studio::new();
    let path = studio.file("masks", 0, 0);
    GrayImage::new(SIDE, 7).save(&path).unwrap();
    let error = studio.eval().error(3);
    assert!(error.contains("masks/00/000000.png: 24x7 pixels, but its photograph has 24x24"), "{error}");
    let path = studio.file("images", 0, 0);
    RgbImage::new(7, SIDE).save(&path).unwrap();
    let error = studio.eval().error(3);
    assert!(error.contains("images/00/000000.png: 7x24 pixels, but its camera has 24x24"), "{error}");
    let whole = fs::read(studio.file("images", 1, 0)).unwrap();
    for end in [0, 20, 60, whole.len() / 2] {
        fs::write(&path, &whole[..end]).unwrap();
        assert!(studio.eval().error(3).contains("images/00/000000.png"), "{end}");
    }
}

#[test]
fn a_manifest_with_faults_is_refused() {
    let studio = Studio::new();
    let refused = |problem: &str, change: &dyn Fn(&mut Value)| {
        studio.manifest(change);
        let error = studio.eval().error(3);
        assert!(error.contains("capture") && error.contains(problem), "'{problem}' expected: {error}");
    };
    refused("unknown field `colour`", &|m| m["colour"] = true.into());
    refused("unknown field `lenses`", &|m| m["cameras"][1]["lenses"] = 1.into());
    refused("unknown variant `fov`, expected `rational` or `fisheye`", &|m| {
        m["cameras"][1]["lens"] = "fov".into();
    });
    refused("camera 01 is listed twice", &|m| m["cameras"][0]["id"] = "01".into());
    refused("0 frames", &|m| m["frames"] = 0.into());
    refused("1000000000000 frames", &|m| m["frames"] = 1_000_000_000_000u64.into());
    refused("first_frame", &|m| m["first_frame"] = u64::MAX.into());
    refused("invalid value", &|m| m["frames"] = (-3).into());
    refused("fps 0: the range", &|m| m["fps"] = 0.into());
    refused("fps -25: the range", &|m| m["fps"] = (-25).into());
    refused("camera 02 has a time_offset_s, so the capture needs its fps", &|m| {
        m.as_object_mut().unwrap().remove("fps");
        m["cameras"][2]["time_offset_s"] = 0.01.into();
    });
    refused("camera 02: time_offset_s 12 is longer than the clip", &|m| {
        m["cameras"][2]["time_offset_s"] = 12.into();
    });
    refused("has no {frame}", &|m| m["images"] = "images/{camera}/000000.png".into());
    refused("{kamera}", &|m| m["images"] = "images/{kamera}/{frame:06}.png".into());
    refused("has no {camera}", &|m| m["images"] = "images/00/{frame:06}.png".into());
    refused("plates \"plates/00.png\" has no {camera}", &|m| m["plates"] = "plates/00.png".into());
    refused("has a {frame}, but a camera has one plate", &|m| m["plates"] = "{camera}/{frame:06}.png".into());
    refused("00.png: this plate is missing", &|m| m["plates"] = "plates/{camera}.png".into());
    refused("no camera has a photograph", &|m| m["cameras"] = json!([]));
    refused("no camera has a photograph", &|m| m["images"] = "nowhere/{camera}/{frame:06}.png".into());
    refused("image size 4000000000x3", &|m| {
        m["cameras"][0]["w"] = 4_000_000_000u32.into();
        m["cameras"][0]["h"] = 3.into();
    });
    refused("image size 0x24", &|m| m["cameras"][0]["w"] = 0.into());
    refused("camera 00: focal lengths", &|m| m["cameras"][0]["K"][0][0] = (-1.0).into());
    refused("skew of 0.5", &|m| m["cameras"][0]["K"][0][1] = 0.5.into());
    refused("must be a rotation", &|m| m["cameras"][2]["w2c"][0] = json!([0, 0, 0, 0]));
    refused("camera 02: the lens has 9 coefficients", &|m| {
        m["cameras"][2]["D"] = json!([0, 0, 0, 0, 0, 0, 0, 0, 0.1]);
    });
    refused("camera 02: the fisheye lens has 5 coefficients", &|m| {
        m["cameras"][2]["lens"] = "fisheye".into();
        m["cameras"][2]["D"] = json!([0, 0, 0, 0, 0.1]);
    });
    fs::write(studio.folder().join("capture/capture.json"), "{").unwrap();
    assert!(studio.eval().error(3).contains("capture.json"));
}

#[test]
fn a_camera_has_its_plate() {
    let studio = Studio::new();
    assert_eq!(studio.capture_files().plate_photo(1).unwrap(), None);
    studio.manifest(|m| m["plates"] = "images/{camera}/000002.png".into());
    let mut capture_files = studio.capture_files();
    let expected = |camera: usize| image::open(studio.file("images", camera, 2)).unwrap().into_rgb8();
    let found = |capture_files: &CaptureFiles, camera: usize| {
        let photo = capture_files.plate_photo(camera).unwrap().unwrap();
        assert!(photo.image.pixels.iter().all(|pixel| pixel[3] == 1.0));
        image::RgbImage::from_raw(photo.image.width, photo.image.height, photo.image.to_rgb8()).unwrap()
    };
    assert_eq!(found(&capture_files, 1), expected(1));
    let names = ["00", "02"].map(str::to_owned);
    capture_files.keep_cameras(&names).unwrap();
    assert_eq!(found(&capture_files, 1), expected(2), "those of other cameras are left out");
    image::RgbImage::new(7, 24).save(studio.file("images", 2, 2)).unwrap();
    let again = studio.capture_files();
    let error = again.plate_photo(2).unwrap_err();
    assert!(error.to_string().contains("000002.png: 7x24 pixels, but its camera has 24x24"), "{error}");
}

#[test]
fn a_photograph_is_fitted_at_its_own_time() {
    let studio = Studio::new();
    studio.manifest(|m| {
        m["fps"] = 20.into();
        m["cameras"][1]["time_offset_s"] = 0.0125.into();
    });
    let times = |holdout: Holdout, camera: usize| -> Vec<f64> {
        let views = TrainingViews::load(&studio.capture_files(), holdout, || ()).unwrap();
        let of_camera = views.train.iter().filter(|(photo_id, _)| photo_id.camera == camera);
        of_camera.map(|(_, view)| view.time).collect()
    };
    assert_eq!(times(Holdout::None, 0), [0.0, 1.0, 2.0]);
    assert_eq!(times(Holdout::None, 1), [0.25, 1.25, 2.25]);
    // An interval is then two frames long.
    assert_eq!(times(Holdout::Odd, 1), [0.125, 1.125]);
}

#[test]
fn the_frame_rate_of_a_capture_is_that_of_its_clip() {
    let studio = Studio::new();
    let fit = |more: &[&str]| {
        let args = ["fit", "capture", "-o", "fitted.ply", "--steps", "1", "--gaussians", "50"];
        aarc_studio(studio.folder(), &[&args, more].concat())
    };
    let duration_s = || {
        assert_eq!(aarc_studio(studio.folder(), &["package", "fitted.ply"]).code, Some(0));
        let json = aarc_studio(studio.folder(), &["inspect", "fitted.aarc", "--json"]).json();
        fs::remove_file(studio.folder().join("fitted.aarc")).unwrap();
        json["duration_s"].as_f64().unwrap()
    };
    studio.manifest(|m| m["fps"] = 20.into());
    let outcome = fit(&[]);
    assert!(outcome.code == Some(0) && !outcome.stderr.contains("assumed"), "{}", outcome.stderr);
    assert!((duration_s() - 0.1).abs() < 1e-6);
    let error = fit(&["--set", "fps=25"]).error(2);
    assert!(error.contains("--set fps=25: the capture states 20 frames per second"), "{error}");
    studio.manifest(|m| drop(m.as_object_mut().unwrap().remove("fps")));
    assert!(fit(&[]).stderr.contains("30 frames per second are assumed"));
    assert!((duration_s() - 2.0 / 30.0).abs() < 1e-6);
    assert_eq!(fit(&["--set", "fps=25"]).code, Some(0));
    assert!((duration_s() - 0.08).abs() < 1e-6);
}

#[test]
fn premultiplied_photographs_are_masked_once() {
    let studio = Studio::new();
    let photo_id = PhotoId { camera: 0, frame: 0 };
    let saved = image::open(studio.file("images", 0, 0)).unwrap().to_rgb8();
    let mask = image::open(studio.file("masks", 0, 0)).unwrap().to_luma8();
    let photo = |studio: &Studio| studio.capture_files().photo(photo_id).unwrap().image;
    let unit_value = |byte: u8| f64::from(byte) / 255.0;
    for (i, pixel) in photo(&studio).pixels.iter().enumerate() {
        let (x, y) = (i as u32 % SIDE, i as u32 / SIDE);
        let [r, g, b] = saved.get_pixel(x, y).0.map(unit_value);
        assert_eq!(*pixel, [r, g, b, unit_value(mask.get_pixel(x, y).0[0])]);
    }
    // Lossy files and noise leave no exact black.
    let taken = photo(&studio);
    studio.manifest(|m| m["images"] = "images/{camera}/{frame:06}.jpg".into());
    for path in studio.files("images") {
        let mut image = image::open(&path).unwrap().to_rgb8();
        image.put_pixel(0, 0, image::Rgb([1; 3]));
        let file = fs::File::create(path.with_extension("jpg")).unwrap();
        image::codecs::jpeg::JpegEncoder::new_with_quality(file, 95).encode_image(&image).unwrap();
    }
    let lossy = photo(&studio);
    let mean = |which: fn(&[f64; 4]) -> bool| {
        let pairs = lossy.pixels.iter().zip(&taken.pixels).filter(|(pixel, _)| which(pixel));
        let errors: Vec<f64> =
            pairs.map(|(a, b)| (0..3).map(|c| (a[c] - b[c]).abs()).sum::<f64>() / 3.0).collect();
        errors.iter().sum::<f64>() / errors.len() as f64
    };
    assert!(mean(|pixel| pixel[3] > 0.0) < 0.02, "{}", mean(|pixel| pixel[3] > 0.0));
    assert_eq!(mean(|pixel| pixel[3] == 0.0), 0.0, "nothing shines outside");
    studio.manifest(|_| ());
    // Before another background, the mask applies: to that camera alone.
    let others = |studio: &Studio| {
        let capture_files = studio.capture_files();
        (1..4)
            .map(|camera| capture_files.photo(PhotoId { camera, frame: 0 }).unwrap().image)
            .collect::<Vec<_>>()
    };
    let before = others(&studio);
    let mut white = saved.clone();
    white.pixels_mut().for_each(|pixel| pixel.0 = [255; 3]);
    white.save(studio.file("images", 0, 0)).unwrap();
    for (pixel, mask) in photo(&studio).pixels.iter().zip(mask.pixels()) {
        assert_eq!(*pixel, [unit_value(mask.0[0]); 4]);
    }
    assert!(others(&studio) == before);
}

#[test]
fn depths_are_found_by_the_names_of_photographs() {
    let studio = Studio::new();
    let capture_files = studio.capture_files();
    let folder = studio.folder().join("network");
    fs::create_dir_all(folder.join("00")).unwrap();
    let at = |frame| capture_files.depth(&folder, PhotoId { camera: 0, frame });
    assert_eq!(at(0).unwrap(), None);
    let depths = ImageBuffer::from_fn(3, 2, |x, y| Luma([(1000 * y + x) as u16]));
    depths.save(folder.join("00/000000.png")).unwrap();
    let values = [2.5f32, f32::NAN];
    let pfm = [b"Pf\n2 1\n-1\n", &values.map(f32::to_le_bytes).concat()[..]].concat();
    fs::write(folder.join("00/000001.pfm"), pfm).unwrap();
    let mut head = "{'descr': '<f4', 'fortran_order': False, 'shape': (1, 2), }".to_owned();
    head += &" ".repeat(117 - head.len());
    let npy = [b"\x93NUMPY\x01\x00\x76\x00", head.as_bytes(), b"\n", &values.map(f32::to_le_bytes).concat()]
        .concat();
    fs::write(folder.join("00/000002.npy"), npy).unwrap();
    let map = |frame| at(frame).unwrap().expect("a map");
    assert_eq!((map(0).width, map(0).height), (3, 2));
    let expected = [0.0, 0.001, 0.002, 1.0, 1.001, 1.002];
    assert!(map(0).depths.iter().zip(expected).all(|(a, e): (&f32, f32)| (a - e).abs() < 1e-6));
    for frame in [1, 2] {
        let map = map(frame);
        assert_eq!((map.width, map.height, map.depths[0], map.depths[1].is_nan()), (2, 1, 2.5, true));
    }
    GrayImage::new(3, 2).save(folder.join("00/000000.png")).unwrap();
    let error = at(0).unwrap_err();
    assert!(error.exit_code() == 3 && error.to_string().contains("16-bit grey"), "{error}");
}
