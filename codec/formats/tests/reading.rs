//! Readers on real, synthetic, dirty and broken files.

mod support;

use std::io::{Cursor, Write};

use codec::PixelFilter;
use formats::{ImportError, Imported, import, write_splatv};
use image::{ImageFormat, Rgba, RgbaImage};
use support::{STATIC, ascii_ply, assert_close, assert_same_rotations, data, import_bytes, import_error};

/// Rotates a field by half a turn about x, which maps y down, z forward to y up, z back.
fn half_turn(mut field: codec::Field) -> codec::Field {
    // Powers of y plus z in the SH basis functions.
    let odd = [0, 1, 1, 0, 1, 2, 2, 1, 2, 3, 2, 3, 3, 2, 3, 2].map(|power| power % 2 == 1);
    field.centers.iter_mut().for_each(|[_, y, z]| (*y, *z) = (-*y, -*z));
    field.rotations.iter_mut().for_each(|[_, _, y, z]| (*y, *z) = (-*y, -*z));
    let coefficients = codec::sh_coefficients(field.sh_degree);
    for (k, c) in field.sh.iter_mut().enumerate() {
        *c = if odd[k % coefficients] { c.map(|x| -x) } else { *c };
    }
    field
}

/// The same three Gaussians in three formats; SPZ has other axes.
#[test]
fn inria_ply_splat_and_spz_agree() {
    let Some(folder) = data("format-fixtures/metalsplatter") else { return };
    let read = |extension: &str| {
        let path = folder.join("test-splat.3-points-from-train").with_added_extension(extension);
        import(&path).expect("a fixture").field
    };
    let (ply, splat, spz) = (read("ply"), read("splat"), half_turn(read("spz")));
    assert_eq!((ply.len(), splat.len(), spz.len()), (3, 3, 3));

    for (other, center, scale) in [(&splat, 1e-6, 1e-5), (&spz, 0.51 / 4096.0, 0.51 / 16.0)] {
        assert_close("centre", other.centers.as_flattened(), ply.centers.as_flattened(), |_| center);
        assert_close("scale", other.log_scales.as_flattened(), ply.log_scales.as_flattened(), |_| scale);
        assert_close("opacity", &other.opacities, &ply.opacities, |_| 1.01 / 255.0);
    }
    assert_same_rotations(&splat.rotations, &ply.rotations, 1.5 / 128.0);
    assert_same_rotations(&spz.rotations, &ply.rotations, 2.0 / 511.0);
    // .splat holds the constant coefficient only, clipped to colours in [0, 1].
    let constant = |field: &codec::Field| (0..3).flat_map(|i| field.sh_of(i)[0]).collect::<Vec<f32>>();
    let clipped: Vec<f32> =
        constant(&ply).iter().map(|c| c.clamp(-0.5 / 0.2820948, 0.5 / 0.2820948)).collect();
    assert_close("splat colour", &constant(&splat), &clipped, |_| 1.01 / 255.0 / 0.2820948);
    assert_close("spz colour", &constant(&spz), &constant(&ply), |_| 0.51 / 255.0 / 0.15);
    // The writer of that file rounds the higher coefficients to 8 bits and then to 5 or 4.
    assert_eq!(spz.sh_degree, 3);
    assert_close("spz sh", spz.sh.as_flattened(), ply.sh.as_flattened(), |_| 0.07);
}

#[test]
fn spz_versions_agree() {
    let Some(folder) = data("format-fixtures/splat-transform") else { return };
    let read = |name: &str| import(&folder.join(name)).expect("a fixture");
    let (v2, raw, v3, v4, splat) = (
        read("minimal-v2.spz"),
        read("minimal-raw.spz"),
        read("minimal-v3.spz"),
        read("minimal-v4.spz"),
        read("minimal.splat"),
    );
    assert_eq!(v2.field, raw.field);
    assert_eq!(v3.field, v4.field);
    assert_eq!(v3.field.centers, half_turn(splat.field.clone()).centers);
    // The writer of version 2 did not convert the axes.
    assert_eq!(v2.field.centers, splat.field.centers);
    assert_same_rotations(&v2.field.rotations, &v3.field.rotations, 0.01);
    assert_close("opacity", &v4.field.opacities, &splat.field.opacities, |_| 1e-6);
    assert_close("colour", v4.field.sh.as_flattened(), splat.field.sh.as_flattened(), |_| 0.6 / 255.0 / 0.15);
    assert_eq!(v4.hints.up, Some([0.0, 1.0, 0.0]));
}

#[test]
fn spinach_is_complete() {
    let Some(path) = data("spacetime-spinach/spinach_4.splatv") else { return };
    let imported = import(&path).expect("a real clip");
    println!("spinach: {}", imported.account.repairs);
    assert_eq!(imported.field.len(), 62_442);
    assert!(imported.account.repairs.dropped.is_empty(), "{}", imported.account.repairs);
    assert!(
        imported.account.repairs.is_empty(),
        "an infinite window is no damage: {}",
        imported.account.repairs
    );
    let temporal = imported.field.temporal.as_ref().expect("a dynamic field");
    assert_eq!(temporal.motion_order, 3);
    assert!(temporal.rotation_rates.is_some());
    let front = &imported.hints.viewpoints[0];
    assert_eq!((front.name.as_str(), front.position), ("front", [0.0; 3]));
    assert!((1.0..200.0).contains(&front.target[2]), "{front:?}");
    assert_eq!(imported.hints.up, Some([0.0, -1.0, 0.0]));
}

/// A `.splatv` file of `field` by another program, with these cameras.
fn foreign_splatv(field: &codec::Field, cameras: &serde_json::Value) -> Vec<u8> {
    let bytes = write_splatv(field, &support::info());
    let payload = 8 + u32::from_le_bytes([bytes[4], bytes[5], bytes[6], bytes[7]]) as usize;
    let mut header: serde_json::Value = serde_json::from_slice(&bytes[8..payload]).expect("JSON");
    let chunk = header[0].as_object_mut().expect("a chunk");
    chunk.remove("aarc");
    chunk.insert("cameras".into(), cameras.clone());
    let header = header.to_string().into_bytes();
    [&bytes[..4], &(header.len() as u32).to_le_bytes(), &header, &bytes[payload..]].concat()
}

/// A camera in splaTV's form: `rotation` is world from camera.
fn splatv_camera(name: &str, position: [f64; 3], rotation: [[f64; 3]; 3]) -> serde_json::Value {
    serde_json::json!({
        "id": 7, "img_name": name, "width": 400, "height": 300, "position": position, "rotation": rotation,
        "fx": 300.0, "fy": 300.0,
    })
}

#[test]
fn cameras_of_splatv_count_if_they_see_the_field() {
    let mut field = support::field(300, 0, Some(1), false);
    field.centers.iter_mut().for_each(|center| center[2] += 6.0);
    let ahead = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let back = [[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]];
    let hints = |field: &codec::Field, cameras: &[serde_json::Value]| {
        import_bytes("a.splatv", &foreign_splatv(field, &cameras.to_vec().into()))
            .expect("a valid file")
            .hints
    };
    let names = |field: &codec::Field, cameras: &[serde_json::Value]| -> Vec<String> {
        hints(field, cameras).viewpoints.into_iter().map(|viewpoint| viewpoint.name).collect()
    };
    let good = splatv_camera("stage left", [0.0, 0.0, -9.0], ahead);
    let away = splatv_camera("away", [0.0, 0.0, -9.0], back);
    let broken = splatv_camera("broken", [0.0, 0.0, -9.0], [[0.0; 3]; 3]);
    // The camera in splaTV's source would see this field, but is of another scene.
    let copied =
        splatv_camera("00001", [-3.0089893469241797, -0.11086489695181866, -3.7527640949141428], ahead);
    let all = [away.clone(), good.clone(), broken.clone(), copied.clone(), serde_json::json!({"id": 1})];
    let [viewpoint] = &hints(&field, &all).viewpoints[..] else { panic!("{:?}", hints(&field, &all)) };
    assert_eq!((viewpoint.name.as_str(), viewpoint.position), ("stage left", [0.0, 0.0, -9.0]));
    assert!((viewpoint.fov_y - 2.0 * 0.5f32.atan()).abs() < 1e-6);
    assert!((3.0..9.0).contains(&viewpoint.target[2]), "{viewpoint:?}");

    // Up is the up axis of the cameras: here +z, nearly.
    let level = [[1.0, 0.0, 0.0], [0.0, 0.1, 0.995], [0.0, -0.995, 0.1]];
    let above = splatv_camera("a\nb", [0.0, -9.0, 6.0], level);
    let tilted = hints(&field, &[above]);
    assert_eq!((tilted.up, tilted.viewpoints[0].name.as_str()), (Some([0.0, 0.0, 1.0]), "camera 0"));

    // Without one that counts, the capture's first camera, at the origin, if that one sees the field.
    for cameras in [&[away.clone(), copied.clone(), broken][..], &[]] {
        assert_eq!(names(&field, cameras), ["front"]);
    }
    field.centers.iter_mut().for_each(|center| center[2] -= 20.0);
    assert!(names(&field, &[copied, splatv_camera("x", [0.0; 3], ahead)]).is_empty(), "all is behind it");
    assert_eq!(names(&field, &[splatv_camera("x", [0.0; 3], back)]), ["x"]);

    // Nor does one count that looks at the inside of one Gaussian.
    let wall = 0;
    (field.centers[wall], field.log_scales[wall], field.opacities[wall]) = ([0.0, 0.0, -1.0], [1.5; 3], 1.0);
    let temporal = field.temporal.as_mut().expect("a dynamic field");
    (temporal.s[wall], temporal.motion[wall]) = (f32::INFINITY, [0.0; 3]);
    assert!(names(&field, &[splatv_camera("x", [0.0; 3], back)]).is_empty());
}

#[test]
fn guitar_is_complete() {
    let Some(path) = data("guitar/guitar.compressed.ply") else { return };
    let imported = import(&path).expect("a real field");
    assert_eq!((imported.field.len(), imported.field.sh_degree), (90_854, 0));
    assert!(imported.account.repairs.is_empty(), "{}", imported.account.repairs);
    assert_eq!(imported.format, "compressed PLY");
}

#[test]
fn playbot_lies_within_its_stated_bounds() {
    let Some(folder) = data("playbot-sog") else { return };
    let imported = import(&folder.join("3_0")).expect("a real field");
    assert_eq!((imported.field.len(), imported.field.sh_degree), (31_000, 2));
    assert!(imported.account.repairs.is_empty(), "{}", imported.account.repairs);
    let by_file = import(&folder.join("3_0/meta.json")).expect("the same field by its file");
    assert_eq!(by_file.field, imported.field);
    // From lod-meta.json, whose bounds include the extent of the Gaussians.
    let (low, high) = ([-1.033496, -1.083135, -1.039343], [1.03509, 0.05205518, 1.042389]);
    for axis in 0..3 {
        let range = imported.field.centers.iter().fold((f32::MAX, f32::MIN), |(least, most), center| {
            (least.min(center[axis]), most.max(center[axis]))
        });
        assert!(range.0 >= low[axis] && range.1 <= high[axis], "axis {axis}: {range:?}");
        assert!(range.1 - range.0 > 0.6 * (high[axis] - low[axis]), "axis {axis}: {range:?}");
    }
}

#[test]
fn ascii_ply_is_read() {
    let rows = ["1 2 3  0.1 0.2 0.3  0  -1 -2 -3  0 2 0 0", "4 5 6  0 0 0  -40  0 0 0  1 0 0 0"];
    let imported = import_bytes("a.ply", &ascii_ply(STATIC, &rows)).expect("a valid file");
    let field = imported.field;
    assert_eq!(field.centers, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
    assert_eq!(field.sh[0], [0.1, 0.2, 0.3]);
    assert_eq!(field.opacities[0], 0.5);
    assert!(field.opacities[1] > 0.0 && field.opacities[1] < 1e-17);
    assert_eq!(field.log_scales[0], [-1.0, -2.0, -3.0]);
    assert_eq!(field.rotations[0], [0.0, 1.0, 0.0, 0.0], "normalised");
    assert_eq!(field.temporal, None);
    assert!(imported.account.repairs.is_empty(), "{}", imported.account.repairs);
}

#[test]
fn sh_is_channel_major() {
    let rest: Vec<String> = (0..9).map(|k| format!("f_rest_{k}")).collect();
    let row = "0 0 0  0 0 0  0  0 0 0  1 0 0 0  1 2 3 4 5 6 7 8 9";
    let field = import_bytes("a.ply", &ascii_ply(&format!("{STATIC} {}", rest.join(" ")), &[row]))
        .expect("a valid file")
        .field;
    assert_eq!(field.sh_degree, 1);
    assert_eq!(field.sh_of(0)[1..], [[1.0, 4.0, 7.0], [2.0, 5.0, 8.0], [3.0, 6.0, 9.0]]);
}

#[test]
fn dirty_rows_are_repaired_or_dropped_and_counted() {
    let rows = [
        "1 1 1  0 0 0  0  0 0 0  1 0 0 0",
        "nan 1 1  0 0 0  0  0 0 0  1 0 0 0",
        "1 inf 1  0 0 0  0  0 0 0  1 0 0 0",
        "1 1 1  0 nan 0  0  0 0 0  1 0 0 0",
        "1 1 1  0 0 0  nan  0 0 0  1 0 0 0",
        "1 1 1  0 0 0  inf  0 0 0  1 0 0 0",
        "1 1 1  0 0 0  0  0 inf 0  1 0 0 0",
        "1 1 1  0 0 0  0  0 0 0  0 0 0 0",
        "1 1 1  0 0 0  0  0 0 0  1 nan 0 0",
        "1 1 1  0 0 0  0  0 0 0  3e-30 0 4e-30 0",
    ];
    let imported = import_bytes("a.ply", &ascii_ply(STATIC, &rows)).expect("some rows are good");
    let counts =
        |map: &std::collections::BTreeMap<&'static str, usize>| map.clone().into_iter().collect::<Vec<_>>();
    assert_eq!(
        counts(&imported.account.repairs.dropped),
        [
            ("non-finite centre", 2),
            ("non-finite colour", 1),
            ("non-finite opacity", 1),
            ("non-finite scale", 1)
        ]
    );
    assert_eq!(
        counts(&imported.account.repairs.repaired),
        [("non-finite quaternion", 1), ("zero quaternion", 1)]
    );
    assert_eq!(
        imported.account.repairs.to_string(),
        "repaired 2 (non-finite quaternion: 1, zero quaternion: 1), dropped 5 (non-finite centre: 2, \
         non-finite colour: 1, non-finite opacity: 1, non-finite scale: 1)"
    );
    let field = imported.field;
    assert_eq!(field.opacities, [0.5, 1.0, 0.5, 0.5, 0.5]);
    assert_eq!(field.rotations[2..], [[1.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.6, 0.0, 0.8, 0.0]]);
}

const SPACETIME: &str = "trbf_center trbf_scale motion_0 motion_1 motion_2 motion_3 motion_4 motion_5 motion_6 \
                         motion_7 motion_8 omega_0 omega_1 omega_2 omega_3";

#[test]
fn spacetime_ply_is_read() {
    let properties = format!("{STATIC} {SPACETIME}");
    let rows = [
        "0 0 0  1 0 0.5  0  0 0 0  2 0 0 0   0.25 0  1 2 3 4 5 6 7 8 9  0 0.2 0 0",
        "0 0 0  1 0 0.5  0  0 0 0  1 0 0 0   0.25 99  0 0 0 0 0 0 0 0 0  0 0 0 0",
        "0 0 0  1 0 0.5  0  0 0 0  1 0 0 0   0.25 -999  0 0 0 0 0 0 0 0 0  0 0 0 0",
        "0 0 0  1 0 0.5  0  0 0 0  1 0 0 0   nan 0  0 0 0 0 0 0 0 0 0  0 0 0 0",
        "0 0 0  1 0 0.5  0  0 0 0  1 0 0 0   0 0  0 0 0 0 0 0 0 0 inf  0 0 0 0",
        "0 0 0  1 0 0.5  0  0 0 0  1 0 0 0   0 0  0 0 0 0 0 0 0 0 0  0 0 0 nan",
    ];
    let imported = import_bytes("a.ply", &ascii_ply(&properties, &rows)).expect("a valid file");
    let temporal = imported.field.temporal.as_ref().expect("a dynamic field");
    assert_eq!(imported.format, "Spacetime Gaussians PLY");
    assert_eq!(temporal.motion_of(0), [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 9.0]]);
    assert_eq!(temporal.rotation_rates.as_ref().expect("one row turns")[0], [0.0, 0.1, 0.0, 0.0]);
    assert_eq!(temporal.s, [std::f32::consts::FRAC_1_SQRT_2, f32::INFINITY]);
    assert_close("colour", &imported.field.sh[0], &[1.7724539, -1.7724539, 0.0], |_| 1e-6);
    // The file's own equation at d = 0.3: exp(-(d / e^0)^2).
    let expected = 0.5 * (-0.3f64 * 0.3).exp();
    assert!((imported.field.opacity_at(0, 0.55) - expected).abs() < 1e-7);
    assert!(imported.account.repairs.repaired.is_empty(), "{}", imported.account.repairs);
    let dropped =
        ["empty window", "non-finite motion", "non-finite rotation rate", "non-finite window centre"];
    assert_eq!(imported.account.repairs.dropped.keys().copied().collect::<Vec<_>>(), dropped);
}

#[test]
fn spacetime_full_model_is_refused() {
    let message = import_error("a.ply", &ascii_ply(&format!("{STATIC} {SPACETIME} f_dc_3"), &["0"; 0]));
    assert!(message.contains("full model"), "{message}");
}

/// A compressed PLY with SH, without colour bounds in its chunks.
#[test]
fn compressed_ply_of_twelve_floats_is_read() {
    let axes = ["x", "y", "z"];
    let bounds: String = ["min_", "max_", "min_scale_", "max_scale_"]
        .iter()
        .flat_map(|bound| axes.map(|axis| format!("property float {bound}{axis}\n")))
        .collect();
    let words: String = ["position", "rotation", "scale", "color"]
        .map(|name| format!("property uint packed_{name}\n"))
        .concat();
    let rest: String = (0..9).map(|k| format!("property uchar f_rest_{k}\n")).collect();
    // Second row: the largest component is y; the others are 0, 0 and 1 / sqrt(2).
    let rotation = (2u32 << 30) | (511 << 20) | (511 << 10) | 1023;
    let text = format!(
        "ply\nformat ascii 1.0\nelement chunk 1\n{bounds}element vertex 2\n{words}element sh 2\n{rest}end_header\n\
         -1 -2 -3 1 2 3 -8 -8 -8 0 0 0\n\
         0 {} 0 {}\n4294967295 {rotation} 4294967295 {}\n\
         0 0 0 0 0 0 0 0 0\n255 128 0 1 2 3 4 5 6\n",
        (511 << 20) | (511 << 10) | 511,
        0xff00_8033u32,
        0x0000_00ffu32,
    );
    let imported = import_bytes("a.compressed.ply", text.as_bytes()).expect("a valid file");
    let field = imported.field;
    assert_eq!(field.centers, [[-1.0, -2.0, -3.0], [1.0, 2.0, 3.0]]);
    assert_eq!(field.log_scales, [[-8.0; 3], [0.0; 3]]);
    assert_close("opacity", &field.opacities, &[0.2, 1.0], |_| 1e-6);
    let red = 0.5 / 0.2820948;
    assert_close("colour", &field.sh_of(0)[0], &[red, -red, (128.0 / 255.0 - 0.5) / 0.2820948], |_| 1e-5);
    assert_eq!(field.sh_of(0)[1], [-4.0; 3]);
    assert_eq!(field.sh_of(1)[1][0], 4.0);
    assert_close("sh", &field.sh_of(1)[2][..2], &[4.0 / 256.0, 2.5 / 32.0 - 4.0], |_| 1e-5);
    let half = std::f32::consts::FRAC_1_SQRT_2;
    assert_same_rotations(&field.rotations, &[[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, half, half]], 2e-3);
    assert!(imported.account.repairs.is_empty());
}

/// File names and contents.
type FileSet = Vec<(&'static str, Vec<u8>)>;

/// A SOG file set of three Gaussians of degree 1, with PNG instead of WebP, which the format allows.
fn sog_files() -> FileSet {
    let png = |width: u32, pixels: &[[u8; 4]]| {
        let height = (pixels.len() as u32).div_ceil(width);
        let pixel = |x, y| Rgba(pixels.get((y * width + x) as usize).copied().unwrap_or_default());
        let mut bytes = Cursor::new(Vec::new());
        RgbaImage::from_fn(width, height, pixel).write_to(&mut bytes, ImageFormat::Png).expect("memory");
        bytes.into_inner()
    };
    let codebook = |low: f32, step: f32| (0..256).map(|k| low + step * k as f32).collect::<Vec<f32>>();
    let meta = serde_json::json!({
        "version": 2, "count": 3,
        "means": {"mins": [-1, -1, 0], "maxs": [1, 2, 0], "files": ["means_l.webp", "means_u.webp"]},
        "scales": {"codebook": codebook(-10.0, 0.0625), "files": ["scales.webp"]},
        "quats": {"files": ["quats.webp"]},
        "sh0": {"codebook": codebook(-2.0, 0.015625), "files": ["sh0.webp"]},
        "shN": {"count": 66, "bands": 1, "codebook": codebook(-1.0, 0.0078125), "files": ["centroids.webp", "labels.webp"]},
    });
    // Entry 65 is the second of the second row.
    let mut centroids = vec![[128, 128, 128, 255]; 2 * 64 * 3];
    centroids[(64 + 1) * 3..(64 + 2) * 3].copy_from_slice(&[[0, 1, 2, 255], [3, 4, 5, 255], [6, 7, 8, 255]]);
    vec![
        ("meta.json", meta.to_string().into_bytes()),
        ("means_l.webp", png(2, &[[0, 0, 0, 255], [255, 255, 9, 255], [0, 0, 0, 255]])),
        ("means_u.webp", png(2, &[[0, 0, 0, 255], [255, 255, 9, 255], [128, 0, 0, 255]])),
        ("scales.webp", png(2, &[[0, 16, 160, 255], [1, 1, 1, 255], [1, 1, 1, 255]])),
        ("quats.webp", png(2, &[[255, 128, 128, 252], [128, 128, 128, 255], [0, 0, 0, 7]])),
        ("sh0.webp", png(2, &[[0, 128, 255, 51], [128, 128, 128, 255], [128, 128, 128, 0]])),
        ("centroids.webp", png(64 * 3, &centroids)),
        ("labels.webp", png(2, &[[65, 0, 0, 255], [0, 0, 0, 255], [66, 0, 0, 255]])),
    ]
}

/// Imports a SOG file set from a folder.
fn import_sog(files: &[(&str, Vec<u8>)]) -> Result<Imported, ImportError> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (name, content) in files {
        std::fs::write(folder.path().join(name), content).expect("a temporary file");
    }
    import(folder.path())
}

#[test]
fn sog_is_read() {
    let imported = import_sog(&sog_files()).expect("a valid file set");
    let field = imported.field;
    let e = std::f32::consts::E;
    let centers = [[1.0 - e, 1.0 - e, 0.0], [e - 1.0, e * e - 1.0, 0.0]];
    assert_close("centre", field.centers[..2].as_flattened(), centers.as_flattened(), |_| 1e-5);
    assert!(field.centers[2][0].abs() < 1e-2, "the centre of a symmetric range");
    assert_eq!(field.log_scales[0], [-10.0, -9.0, 0.0]);
    assert_eq!(field.sh_of(0)[0], [-2.0, 0.0, 1.984375]);
    assert_eq!(field.sh_of(0)[1], [-1.0, -0.9921875, -0.984375]);
    assert_eq!(field.sh_of(0)[3], [-0.953125, -0.9453125, -0.9375]);
    assert_eq!(field.sh_of(1)[1], [0.0; 3]);
    assert_close("opacity", &field.opacities, &[0.2, 1.0, 0.0], |_| 1e-6);
    let half = std::f32::consts::FRAC_1_SQRT_2;
    assert_same_rotations(
        &field.rotations,
        &[[half, half, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0], [1.0, 0.0, 0.0, 0.0]],
        6e-3,
    );
    let repaired: Vec<_> = imported.account.repairs.repaired.into_iter().collect();
    assert_eq!(repaired, [("SH label outside the palette", 1), ("zero quaternion", 1)]);
}

#[test]
fn sog_bundle_equals_its_folder() {
    let files = sog_files();
    let folder = import_sog(&files).expect("a valid file set");
    for method in [zip::CompressionMethod::Stored, zip::CompressionMethod::Deflated] {
        let mut archive = zip::ZipWriter::new(Cursor::new(Vec::new()));
        for (name, content) in &files {
            let options = zip::write::SimpleFileOptions::default().compression_method(method);
            archive.start_file(*name, options).expect("memory");
            archive.write_all(content).expect("memory");
        }
        let bytes = archive.finish().expect("memory").into_inner();
        assert_eq!(import_bytes("scene.sog", &bytes).expect("a valid bundle").field, folder.field);
        for length in (4..bytes.len()).step_by(11) {
            import_error("scene.sog", &bytes[..length]);
        }
    }
}

#[test]
fn a_zip_is_a_sog_if_it_has_one() {
    let zip = |folders: &[&str], files: &[(&str, Vec<u8>)]| {
        let mut archive = zip::ZipWriter::new(Cursor::new(Vec::new()));
        for (folder, (name, content)) in
            folders.iter().flat_map(|folder| files.iter().map(move |file| (folder, file)))
        {
            let options = zip::write::SimpleFileOptions::default();
            archive.start_file(format!("{folder}{name}"), options).expect("memory");
            archive.write_all(content).expect("memory");
        }
        archive.finish().expect("memory").into_inner()
    };
    let files = sog_files();
    let flat = import_bytes("a.sog", &zip(&[""], &files)).expect("a valid bundle").field;
    // As file managers pack a folder.
    assert_eq!(import_bytes("a.zip", &zip(&["a take/"], &files)).expect("its folder").field, flat);
    let error = import_error("a.zip", &zip(&["a/", "b/"], &files));
    assert!(error.contains("a ZIP with 2 fields"), "{error}");
    let error = import_error(
        "a.zip",
        &zip(&["__MACOSX/._", "x"], &[("meta.json", Vec::new()), ("a.ply", Vec::new())]),
    );
    assert!(error.contains("a ZIP without meta.json is no SOG; unpack it"), "{error}");
}

#[test]
fn keys_of_sog_may_be_null_or_unknown() {
    let read = |more: &str| {
        let mut files = sog_files();
        let text = String::from_utf8(files[0].1.clone()).unwrap();
        files[0].1 = text.replacen('{', &format!("{{{more},"), 1).into_bytes();
        import_sog(&files).expect("a valid file set")
    };
    for (more, filter, note) in [
        (r#""antialias": null"#, PixelFilter::Blur, ""),
        (r#""antialias": true"#, PixelFilter::Mip, "0.3 px^2"),
        (r#""model": "antialiased""#, PixelFilter::Mip, "0.3 px^2"),
        (r#""model": "default", "antialias": null"#, PixelFilter::Blur, ""),
        (r#""model": "2dgs""#, PixelFilter::Blur, "the model `2dgs` is not known, drawn as `default`"),
        (
            r#""asset": {"generator": "a"}, "extras": {}, "lights": [[1], {"a": {}}]"#,
            PixelFilter::Blur,
            "not read: lights",
        ),
    ] {
        let imported = read(more);
        assert_eq!(imported.field.filter, filter, "{more}");
        let notes: Vec<String> = imported.account.notes().collect();
        assert!(notes.join("; ").contains(note) && notes.is_empty() == note.is_empty(), "{more}: {notes:?}");
    }
    let mut files = sog_files();
    let mut meta: serde_json::Value = serde_json::from_slice(&files[0].1).unwrap();
    meta["shN"] = serde_json::Value::Null;
    files[0].1 = meta.to_string().into_bytes();
    assert_eq!(import_sog(&files).expect("a valid file set").field.sh_degree, 0);
}

#[test]
fn broken_sog_is_refused() {
    let broken = |change: &dyn Fn(&mut FileSet), expected: &str| {
        let mut files = sog_files();
        change(&mut files);
        let message = import_sog(&files).expect_err("a broken file set").to_string();
        assert!(message.contains(expected), "{message}");
    };
    let edit = |old: &'static str, new: &'static str| {
        move |files: &mut FileSet| {
            let text = String::from_utf8(files[0].1.clone()).expect("JSON");
            assert!(text.contains(old), "no {old}");
            files[0].1 = text.replace(old, new).into_bytes();
        }
    };
    broken(&|files| drop(files.remove(4)), "quats.webp");
    broken(&|files| files[3].1.truncate(30), "scales.webp");
    broken(&|files| drop(files.remove(0)), "meta.json");
    broken(&edit("\"version\":2", "\"version\":3"), "version 3");
    broken(&edit(",\"version\":2", ""), "SOG of version 1");
    broken(&edit("\"count\":3", "\"count\":7"), "4 pixels for 7 Gaussians");
    broken(&edit("\"count\":3", "\"count\":70000000000"), "4 pixels for 70000000000 Gaussians");
    broken(&edit("\"count\":66", "\"count\":129"), "centroids.webp");
    broken(&edit("\"bands\":1", "\"bands\":4"), "bands");
    broken(&edit("quats.webp", "../quats.webp"), "not a plain file name");
}

#[test]
fn errors_of_bad_files_name_the_problem() {
    let expect = |name: &str, bytes: &[u8], parts: &[&str]| {
        let message = import_error(name, bytes);
        for part in parts.iter().chain(&[name]) {
            assert!(message.contains(part), "`{message}` lacks `{part}`");
        }
    };
    expect("a.ply", b"", &["empty"]);
    expect("a.bin", b"\x01\x02\x03\x04", &["01 02 03 04", ".splatv", ".spz", "SOG"]);
    expect("a.ply", b"ply\nformat ascii 1.0\nelement vertex 1\n", &["end_header", "38 bytes"]);
    expect("a.ply", b"ply\nformat binary 1.0\nend_header\n", &["format binary", "export"]);
    expect("a.ply", b"ply\nformat ascii 1.0\nend_header\n", &["vertex"]);
    expect("a.ply", b"ply\nelement vertex many\nend_header\n", &["element vertex many"]);
    expect("a.ply", b"ply\nelement vertex 1\nproperty list uchar int i\nend_header\n", &["vertex", "list"]);
    expect("a.ply", &ascii_ply("x y z", &["1"]), &["row 0", "no number for y"]);
    let pointcloud = "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 rot_0 rot_1 rot_2";
    expect("a.ply", &ascii_ply(pointcloud, &["1 1 1 1 1 1 1 1 1 1 1 1"]), &["lacks", "rot_3"]);
    expect("a.ply", &ascii_ply(&format!("{STATIC} f_rest_0"), &[]), &["1 properties f_rest_*"]);
    expect("a.ply", &ascii_ply(STATIC, &[]), &["no Gaussians"]);
    expect(
        "a.ply",
        &ascii_ply(STATIC, &["nan 0 0 0 0 0 0 0 0 0 0 0 0 0"]),
        &["no usable", "non-finite centre: 1"],
    );
    expect("a.ply", &ascii_ply(STATIC, &["0 0 0 0 0 0 0 0 0 0 0 x 0 0"]), &["row 0", "rot_1"]);
    expect("a.splatv", b"\x4b\x67\0\0\xff\0\0\0[]", &["truncated", "header"]);
    expect("a.splatv", b"\x4b\x67\0\0\xff\xff\xff\xff[]", &["header of 4294967295 bytes"]);
    expect("a.splatv", b"\x4b\x67\0\0\x02\0\0\0[]", &["splat"]);
    expect("a.spz", b"NGSP\x09\0\0\0\0\0\0\0\0\0\0\0", &["version 9"]);
    expect("a.spz", b"NGSP\x02\0\0\0\xff\xff\xff\xff\0\0\0\0", &["4294967295"]);
    expect("a.spz", b"\x1f\x8bnonsense", &["SPZ"]);

    let missing = import(std::path::Path::new("no/such/file.ply")).expect_err("no such file").to_string();
    assert!(missing.contains("no/such/file.ply"), "{missing}");
    if cfg!(unix) {
        let endless = import(std::path::Path::new("/dev/zero")).expect_err("no file").to_string();
        assert!(endless.contains("not a file"), "{endless}");
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    let message = import(folder.path()).expect_err("an empty folder").to_string();
    assert!(message.contains("meta.json"), "{message}");
}
