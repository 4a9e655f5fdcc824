//! Captures of two cameras in every layout, photographs of eight by six pixels, depth maps.

use std::io::Cursor;

use image::{DynamicImage, ImageBuffer, ImageFormat, Luma, Rgb, RgbImage};

use super::{Seed, seed};
use crate::kinds::capture::{
    COLMAP_BINARY, COLMAP_TEXT, DEPTH_NPY, DEPTH_PFM, DEPTH_PNG, EASYVOLCAP, MANIFEST, PHOTOGRAPH, TRANSFORMS,
};
use crate::parts::join;

/// Inputs of the target `capture`.
pub fn captures() -> Vec<Seed> {
    let (intrinsics, extrinsics) = easyvolcap();
    let depths = ImageBuffer::from_fn(8, 6, |x, y| Luma([(100 * y + x) as u16]));
    vec![
        seed("manifest", MANIFEST, manifest().as_bytes()),
        seed("easyvolcap", EASYVOLCAP, &join(intrinsics.as_bytes(), extrinsics.as_bytes())),
        seed("transforms", TRANSFORMS, transforms().as_bytes()),
        seed("colmap-binary", COLMAP_BINARY, &join(&cameras_bin(), &images_bin())),
        seed("colmap-text", COLMAP_TEXT, &join(CAMERAS_TXT.as_bytes(), IMAGES_TXT.as_bytes())),
        seed("photograph", PHOTOGRAPH, &photograph()),
        seed("depth-pfm", DEPTH_PFM, &pfm()),
        seed("depth-npy", DEPTH_NPY, &npy()),
        seed("depth-png", DEPTH_PNG, &png(depths.into())),
    ]
}

/// This project's manifest, with lenses, masks and a held-out camera.
pub(crate) fn manifest() -> String {
    let camera = |id: &str, held: bool, lens: &str| {
        format!(
            r#"{{"id": "{id}", "w": 8, "h": 6, "K": [[9, 0, 4], [0, 9, 3], [0, 0, 1]], {lens},
            "w2c": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 3], [0, 0, 0, 1]], "held": {held}}}"#
        )
    };
    format!(
        r#"{{"frames": 2, "first_frame": 0, "images": "images/{{camera}}/{{frame:01}}.png",
        "masks": "masks/{{camera}}/{{frame}}.png", "cameras": [{}, {}]}}"#,
        camera("00", false, r#""D": [0.1, -0.01, 0.001, 0, 0, 0.2, 0.1, 0.01]"#),
        camera("01", true, r#""D": [0.1, -0.01, 0.001, 0], "lens": "fisheye""#)
    )
}

/// EasyVolcap's two files.
pub(crate) fn easyvolcap() -> (String, String) {
    let matrix = |key: &str, rows: u32, columns: u32, data: &str| {
        format!("{key}: !!opencv-matrix\n  rows: {rows}\n  cols: {columns}\n  dt: d\n  data: [{data}]\n")
    };
    let names = "%YAML:1.0\n---\nnames:\n  - \"00\"\n  - \"01\"\n";
    let mut files = (names.to_owned(), names.to_owned());
    for camera in ["00", "01"] {
        files.0 += &matrix(&format!("K_{camera}"), 3, 3, "9., 0., 4., 0., 9., 3., 0., 0., 1.");
        files.0 += &format!("H_{camera}: 6\nW_{camera}: 8\n");
        files.0 += &matrix(&format!("D_{camera}"), 1, 5, "0.1, 0., 0., 0., 0.");
        files.1 += &matrix(&format!("R_{camera}"), 3, 1, "0.1, 0.2, 0.3");
        files.1 += &matrix(&format!("T_{camera}"), 3, 1, "0., 0., 3.");
    }
    files
}

fn transforms() -> String {
    let frame = |name: &str, time: f64| {
        format!(
            r#"{{"file_path": "./images/{name}", "time": {time},
            "transform_matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 3], [0, 0, 0, 1]]}}"#
        )
    };
    format!(
        r#"{{"camera_model": "OPENCV", "fl_x": 9, "fl_y": 9, "cx": 4, "cy": 3, "k1": 0.1, "w": 8, "h": 6,
        "frames": [{}, {}]}}"#,
        frame("a.png", 0.0),
        frame("b", 0.5)
    )
}

const CAMERAS_TXT: &str =
    "# Camera list\n1 OPENCV 8 6 9 9 4 3 0.1 0 0 0\n2 RADIAL_FISHEYE 16 12 18 8 6 0.1 0\n";
const IMAGES_TXT: &str = "# Image list\n1 1 0 0 0 0 0 3 1 a.png\n\n2 0.5 0.5 0.5 0.5 0 0 3 2 b.png\n1 2 -1\n";

fn cameras_bin() -> Vec<u8> {
    let camera = |id: u32, model: u32, parameters: &[f64]| {
        let parameters: Vec<u8> = parameters.iter().flat_map(|x| x.to_le_bytes()).collect();
        [&id.to_le_bytes()[..], &model.to_le_bytes(), &8u64.to_le_bytes(), &6u64.to_le_bytes(), &parameters]
            .concat()
    };
    let opencv = camera(1, 4, &[9.0, 9.0, 4.0, 3.0, 0.1, 0.0, 0.0, 0.0]);
    let fisheye = camera(2, 5, &[9.0, 9.0, 4.0, 3.0, 0.1, 0.0, 0.0, 0.0]);
    [&2u64.to_le_bytes()[..], &opencv, &fisheye].concat()
}

fn images_bin() -> Vec<u8> {
    let image = |id: u32, camera: u32, name: &str, points: u64| {
        let pose: Vec<u8> =
            [1.0f64, 0.0, 0.0, 0.0, 0.0, 0.0, 3.0].iter().flat_map(|x| x.to_le_bytes()).collect();
        let points = [&points.to_le_bytes()[..], &vec![0; 24 * points as usize]].concat();
        [&id.to_le_bytes()[..], &pose, &camera.to_le_bytes(), name.as_bytes(), b"\0", &points].concat()
    };
    [&2u64.to_le_bytes()[..], &image(1, 1, "a.png", 1), &image(2, 2, "b.png", 0)].concat()
}

/// A photograph, and where it is taken for one, a mask.
pub(crate) fn photograph() -> Vec<u8> {
    png(RgbImage::from_fn(8, 6, |x, y| Rgb([(30 * x) as u8, (40 * y) as u8, 99])).into())
}

fn png(image: DynamicImage) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, ImageFormat::Png).expect("memory");
    bytes.into_inner()
}

fn depths() -> Vec<u8> {
    (0..48).flat_map(|i| (1.0 + 0.1 * i as f32).to_le_bytes()).collect()
}

fn pfm() -> Vec<u8> {
    [b"Pf\n8 6\n-1.0\n", &depths()[..]].concat()
}

fn npy() -> Vec<u8> {
    let head = "{'descr': '<f4', 'fortran_order': False, 'shape': (6, 8), }";
    let head = format!("{head:117}\n");
    [b"\x93NUMPY\x01\x00", &(head.len() as u16).to_le_bytes()[..], head.as_bytes(), &depths()].concat()
}
