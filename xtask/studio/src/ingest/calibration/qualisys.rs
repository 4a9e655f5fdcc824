//! Qualisys: the XML text `.qca.txt` that QTM exports.
//!
//! Lengths in the picture are in 64ths of a pixel, lengths in the world in millimetres, and z is up. `transform` is the
//! rotation from the world to a camera whose y and z axes are opposite to OpenCV's, and the camera's position.

use std::path::Path;

use glam::{DMat3, DVec3};
use program::Fault;
use refine::capture::Lens;

use super::camera::{Calibration, RigCamera, opencv_camera};
use crate::capture::{bad, intrinsics, read_text};

/// Units of a pixel.
const PER_PIXEL: f64 = 64.0;

/// Metres of a millimetre.
const METRES: f64 = 1e-3;

pub(super) fn read(path: &Path) -> Result<Calibration, Fault> {
    let text = read_text(path)?;
    let advised = |problem: &str| format!("{problem}; export the calibration from QTM again");
    let wrong = |problem: &str| bad(path, advised(problem));
    if !text.contains("<calibration") {
        return Err(wrong("no calibration of Qualisys"));
    }
    // `<cameras>` is another element.
    let (mut cameras, mut unusable) = (Vec::new(), Vec::new());
    for element in text.split("<camera ").skip(1) {
        let name = attribute(element, "serial").ok_or_else(|| wrong("a camera has no serial"))?;
        match camera(element, name.to_owned()) {
            Ok(camera) => cameras.push(camera),
            // Systems have cameras of markers besides, which take no video.
            Err(problem) => unusable.push((name.to_owned(), advised(&problem))),
        }
    }
    match (cameras.is_empty(), unusable.first()) {
        (true, None) => Err(wrong("it has no camera")),
        (true, Some((_, problem))) => Err(bad(path, problem)),
        (false, _) => Ok(Calibration {
            path: path.to_owned(),
            layout: "Qualisys",
            cameras,
            unusable,
            up: Some([0.0, 0.0, 1.0]),
            metres_per_unit: Some(1.0),
        }),
    }
}

/// Reads an element from its attributes on.
fn camera(element: &str, name: String) -> Result<RigCamera, String> {
    let number = |tag: &str, key: &str| {
        let start = element.find(&format!("<{tag} ")).ok_or_else(|| format!("camera {name} has no {tag}"))?;
        let number = attribute(&element[start..], key).and_then(|text| text.parse::<f64>().ok());
        number.filter(|x| x.is_finite()).ok_or_else(|| format!("camera {name}: {tag} has no number {key}"))
    };
    if attribute(element, "viewrotation").is_some_and(|angle| angle.parse() != Ok(0.0)) {
        return Err(format!("camera {name} has a viewrotation, which is not supported"));
    }
    let [left, right, top, bottom] = ["left", "right", "top", "bottom"].map(|key| number("fov_video", key));
    let (left, right, top, bottom) = (left?, right?, top?, bottom?);
    let size = (right - left + 1.0, bottom - top + 1.0);
    if !(size.0 >= 1.0 && size.1 >= 1.0) {
        return Err(format!("camera {name}: fov_video is empty"));
    }
    let lens = |key: &str| number("intrinsic", key);
    let pixels = |key: &str| number("intrinsic", key).map(|x| x / PER_PIXEL);
    let (fx, fy) = (pixels("focalLengthU")?, pixels("focalLengthV")?);
    let (cx, cy) = (pixels("centerPointU")? - left, pixels("centerPointV")? - top);
    let has_skew = element.split_once("<intrinsic ").is_some_and(|(_, tag)| attribute(tag, "skew").is_some());
    let skew = if has_skew { pixels("skew")? } else { 0.0 };
    let k =
        intrinsics(&[fx, skew, cx, 0.0, fy, cy]).map_err(|problem| format!("camera {name}: {problem}"))?;
    let d = [
        lens("radialDistortion1")?,
        lens("radialDistortion2")?,
        // QTM's own spelling.
        lens("tangentalDistortion1")?,
        lens("tangentalDistortion2")?,
        lens("radialDistortion3")?,
    ];
    let mut rows = [DVec3::ZERO; 3];
    for (r, row) in rows.iter_mut().enumerate() {
        for c in 0..3 {
            row[c] = number("transform", &format!("r{}{}", r + 1, c + 1))?;
        }
    }
    let rotation = DMat3::from_cols(rows[0], -rows[1], -rows[2]).transpose();
    let position =
        DVec3::new(number("transform", "x")?, number("transform", "y")?, number("transform", "z")?) * METRES;
    let translation = -(rotation * position);
    let rows = rotation.transpose().to_cols_array_2d();
    let camera = opencv_camera((size.0 as u32, size.1 as u32), k, rows, translation.to_array());
    Ok(RigCamera {
        lens: Lens::rational(&d).map_err(|problem| format!("camera {name}: {problem}"))?,
        camera,
        name,
    })
}

/// The value of the first attribute of this name within an element's first tag.
fn attribute<'t>(element: &'t str, key: &str) -> Option<&'t str> {
    let tag = element.split('>').next()?;
    let (_, rest) = tag.split_once(&format!(" {key}=\"")).or_else(|| tag.split_once(&format!("{key}=\"")))?;
    rest.split('"').next()
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "<calibration><cameras><camera active=\"1\" serial=\"c1\" viewrotation=\"0\">\n\
        <fov_video bottom=\"47\" left=\"0\" right=\"63\" top=\"0\"/>\n\
        <transform r11=\"1\" r12=\"0\" r13=\"0\" r21=\"0\" r22=\"0\" r23=\"1\" r31=\"0\" r32=\"-1\" r33=\"0\" x=\"0\" y=\"-2000\" z=\"1000\"/>\n\
        <intrinsic centerPointU=\"2016\" centerPointV=\"1504\" focalLengthU=\"6400\" focalLengthV=\"6400\" radialDistortion1=\"0.1\" \
        radialDistortion2=\"0.2\" radialDistortion3=\"0.5\" tangentalDistortion1=\"0.3\" tangentalDistortion2=\"0.4\"/></camera></cameras></calibration>";

    fn read_text(text: &str) -> Result<Calibration, Fault> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text).unwrap();
        read(file.path())
    }

    #[test]
    fn a_camera_looks_along_its_axis_in_metres() {
        let calibration = read_text(TEXT).unwrap();
        let RigCamera { name, camera, lens } = &calibration.cameras[0];
        assert_eq!((name.as_str(), camera.width, camera.height), ("c1", 64, 48));
        assert_eq!([camera.k[0][0], camera.k[0][2], camera.k[1][2]], [100.0, 32.0, 24.0]);
        assert_eq!(*lens, Lens::rational(&[0.1, 0.2, 0.3, 0.4, 0.5]).unwrap());
        // 2 m in front of the origin and 1 m above it, level, looking along +y.
        assert_eq!(camera.position(), [0.0, -2.0, 1.0]);
        assert_eq!(camera.camera_from_world[2][..3], [0.0, 1.0, 0.0]);
        assert_eq!(camera.camera_from_world[1][..3], [0.0, 0.0, -1.0]);
        camera.check().unwrap();
    }

    #[test]
    fn what_is_missing_is_named() {
        for (from, to, problem) in [
            ("serial", "serials", "a camera has no serial"),
            ("r23=\"1\"", "", "camera c1: transform has no number r23"),
            ("<intrinsic", "<other", "camera c1 has no intrinsic"),
            ("viewrotation=\"0\"", "viewrotation=\"90\"", "viewrotation"),
            ("right=\"63\"", "right=\"-5\"", "empty"),
            ("<intrinsic", "<intrinsic skew=\"64\"", "camera c1: K has a skew of 1"),
            ("<intrinsic", "<intrinsic skew=\"none\"", "camera c1: intrinsic has no number skew"),
        ] {
            let error = read_text(&TEXT.replacen(from, to, 1)).unwrap_err().to_string();
            assert!(error.contains(problem), "{error}");
        }
        // Beside a camera that is whole, it is kept for the case that there is a video of it.
        let markers =
            TEXT.replace("<camera active", "<camera serial=\"m1\" viewrotation=\"90\"/><camera active");
        let calibration = read_text(&markers).unwrap();
        assert_eq!(calibration.cameras.len(), 1);
        let [(name, problem)] = &calibration.unusable[..] else { panic!("one") };
        assert!(name == "m1" && problem.contains("camera m1 has a viewrotation"), "{problem}");
    }
}
