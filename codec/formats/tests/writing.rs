//! Writers: files that are written are read as the same field.

mod support;

use codec::{ALPHA_MIN, ClipInfo, Field, PixelFilter, Surroundings};
use formats::{Hints, frozen, import, write_field_file, write_splatv, write_spz, write_static_ply};
use support::{assert_close, assert_same_rotations, data, field, import_bytes, import_error, info};

#[test]
fn field_file_is_lossless() {
    let fields = (0..=3)
        .map(|degree| field(7, degree, None, false))
        .chain((0..=3u8).flat_map(|order| [false, true].map(|turns| field(9, order, Some(order), turns))));
    for (i, original) in fields.enumerate() {
        let near = [0.0, 0.55, 1.0 / 3.0][i % 3];
        let mut original = Field { filter: PixelFilter::ALL[i % 2], near, ..original };
        // Opacities that do not survive conversion to a logit.
        original.opacities[..4].copy_from_slice(&[0.0, 1.0, f32::MIN_POSITIVE, 1.0 - f32::EPSILON]);
        let imported =
            import_bytes("field.ply", &write_field_file(&original, &info())).expect("our own file");
        assert_eq!(imported.field, original);
        assert!(imported.account.repairs.is_empty(), "{}", imported.account.repairs);
        assert_eq!(imported.format, "field file");
        let (hints, info) = (imported.hints, info());
        assert_eq!(hints.duration_s, Some(info.duration_s));
        assert_eq!(hints.fps, Some(info.fps));
        assert_eq!(hints.up, Some(info.up));
        assert_eq!(hints.metres_per_unit, Some(info.metres_per_unit));
        assert_eq!(hints.viewpoints, info.viewpoints);
    }
}

#[test]
fn other_formats_keep_the_metadata_that_they_can_hold() {
    let hints = |name: &str, bytes: &[u8]| import_bytes(name, bytes).expect("our own file").hints;
    let ClipInfo { duration_s, fps, up, metres_per_unit, viewpoints } = info();
    let whole = Hints {
        up: Some(up),
        metres_per_unit: Some(metres_per_unit),
        duration_s: Some(duration_s),
        fps: Some(fps),
        viewpoints,
        ..Hints::default()
    };
    assert_eq!(hints("a.splatv", &write_splatv(&field(3, 0, Some(3), true), &info())), whole);
    assert_eq!(hints("a.ply", &write_static_ply(&field(3, 1, None, false), Some(&info()))), whole);
    assert_eq!(hints("a.ply", &write_static_ply(&field(3, 1, None, false), None)), Hints::default());
    for up in [[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]] {
        assert_eq!(hints("a.spz", &write_spz(&field(3, 1, None, false), up)).up, Some([0.0, 1.0, 0.0]));
    }
    // Viewers of .splatv find the same cameras in their own form.
    let bytes = write_splatv(&field(3, 0, Some(3), true), &info());
    let text = String::from_utf8_lossy(&bytes[8..]).into_owned();
    assert_eq!(text.matches("\"img_name\"").count(), 2, "{}", text.split_at(900).0);
}

#[test]
fn files_that_can_keep_the_filter() {
    for filter in PixelFilter::ALL {
        let field = Field { filter, ..field(3, 1, None, false) };
        for (name, bytes) in [
            ("a.ply", write_static_ply(&field, None)),
            ("a.spz", write_spz(&field, info().up)),
            ("f.ply", write_field_file(&field, &info())),
        ] {
            assert_eq!(import_bytes(name, &bytes).expect("our own file").field.filter, filter, "{name}");
        }
    }
    let field = Field { filter: PixelFilter::Mip, ..field(3, 0, None, false) };
    let bytes = write_static_ply(&field, None);
    let at = bytes.windows(4).position(|window| window == b"mip\n").expect("the comment");
    let unknown = [&bytes[..at], b"map", &bytes[at + 3..]].concat();
    let error = import_bytes("a.ply", &unknown).expect_err("no such filter").to_string();
    assert!(error.contains("comment aarc filter: cannot use `map`"), "{error}");
}

#[test]
fn files_that_can_keep_the_near_distance() {
    let field = Field { near: 0.55, ..field(300, 1, None, false) };
    for (name, bytes) in
        [("a.ply", write_static_ply(&field, None)), ("f.ply", write_field_file(&field, &info()))]
    {
        let whole = import_bytes(name, &bytes).expect("our own file");
        assert_eq!((whole.field.near, whole.hints.near), (0.55, Some(0.55)), "{name}");
        let text = b"near 0.55\n";
        let at = bytes.windows(text.len()).position(|window| window == text).expect("the comment");
        for value in ["-1", "NaN", "inf", "0.5 0.5", "far", ""] {
            let other =
                [&bytes[..at], format!("near {value}\n").as_bytes(), &bytes[at + text.len()..]].concat();
            let error = import_error(name, &other);
            assert!(error.contains(&format!("comment aarc near: cannot use `{value}`")), "{name}: {error}");
        }
        let zero = [&bytes[..at], b"near 0\n", &bytes[at + text.len()..]].concat();
        assert_eq!(import_bytes(name, &zero).expect("0 is a number").field.near, 0.0, "{name}");
    }
    // A field file without a distance has none; a file of another program gets a share of its size.
    let none = Field { near: 0.0, ..field };
    assert_eq!(
        import_bytes("f.ply", &write_field_file(&none, &info())).expect("our own file").field.near,
        0.0
    );
    let radius = Surroundings::new(&none, None, info().up).content_radius();
    for (name, bytes) in [("a.ply", write_static_ply(&none, None)), ("a.spz", write_spz(&none, info().up))] {
        let near = f64::from(import_bytes(name, &bytes).expect("our own file").field.near);
        assert!((near / (0.02 * radius) - 1.0).abs() < 0.05, "{name}: {near} of {radius}");
    }
}

/// Values at the limits of what a field may hold.
#[test]
fn our_own_exports_need_no_repair() {
    let extreme = |is_dynamic: bool| {
        let mut field = field(60, 1, is_dynamic.then_some(3), true);
        for (i, scales) in field.log_scales.iter_mut().enumerate() {
            *scales = [[-40.0, 0.0, 30.0], [-18.0, -17.0, -16.0], [10.0, 11.5, -3.0]][i % 3];
        }
        for (i, opacity) in field.opacities.iter_mut().enumerate() {
            *opacity = [0.0, 1.0, f32::MIN_POSITIVE, 0.5][i % 4];
        }
        for (i, rotation) in field.rotations.iter_mut().enumerate() {
            *rotation = [[0.5; 4], [1.0, 0.0, 0.0, 0.0], [0.70710677, 0.0, -0.70710677, 0.0]][i % 3];
        }
        if let Some(temporal) = &mut field.temporal {
            for (i, s) in temporal.s.iter_mut().enumerate() {
                *s = [f32::INFINITY, 1e-12, 1e9, 46_000.0, 0.2][i % 5];
            }
            temporal.motion[0] = [1e9, -1e9, 0.0];
            temporal.rotation_rates.as_mut().expect("rates")[0] = [1e7, 0.0, 0.0, 0.0];
        }
        field.check().expect("a valid field");
        field
    };
    let (dynamic, constant) = (extreme(true), extreme(false));
    for (name, rows, bytes) in [
        ("field.ply", dynamic.len(), write_field_file(&dynamic, &info())),
        ("a.splatv", dynamic.len(), write_splatv(&dynamic, &info())),
        ("still.splatv", constant.len(), write_splatv(&constant, &info())),
        ("a.ply", constant.len(), write_static_ply(&constant, Some(&info()))),
        ("a.spz", constant.len(), write_spz(&constant, info().up)),
    ] {
        let imported = import_bytes(name, &bytes).expect("our own file");
        assert!(imported.account.repairs.is_empty(), "{name}: {}", imported.account.repairs);
        assert_eq!(imported.field.len(), rows, "{name}");
    }
}

#[test]
fn field_file_without_its_comments_is_an_inria_ply() {
    let original = field(20, 3, Some(3), true);
    let bytes = write_field_file(&original, &info());
    let mark = bytes.windows(5).position(|window| window == b" aarc").expect("a comment");
    let mut unmarked = bytes;
    unmarked[mark + 1] = b'b';
    let imported = import_bytes("field.ply", &unmarked).expect("a plain PLY");
    assert_eq!(imported.format, "3D Gaussian Splatting PLY");
    assert_eq!(imported.field.sh, original.sh);
    assert_eq!(imported.field.centers, original.centers);
    assert_close("opacity", &imported.field.opacities, &original.opacities, |_| 2e-7);
    assert_eq!(imported.field.temporal, None);
}

#[test]
fn zero_columns_are_omitted() {
    let mut original = field(6, 2, Some(3), true);
    for i in 0..6 {
        original.sh[i * 9 + 4..(i + 1) * 9].fill([0.0; 3]);
    }
    let temporal = original.temporal.as_mut().expect("a dynamic field");
    temporal.motion.iter_mut().skip(2).step_by(3).for_each(|v| *v = [0.0; 3]);
    temporal.rotation_rates.as_mut().expect("rates").fill([0.0; 4]);
    let read = |field: &Field| {
        import_bytes("field.ply", &write_field_file(field, &info())).expect("our own file").field
    };
    let reduced = read(&original);
    assert_eq!(reduced.sh_degree, 1);
    assert_eq!(reduced.sh_of(5), &original.sh_of(5)[..4]);
    let temporal = reduced.temporal.expect("a dynamic field");
    assert_eq!((temporal.motion_order, &temporal.rotation_rates), (2, &None));
    assert_eq!(
        temporal.motion_of(5),
        &original.temporal.as_ref().expect("a dynamic field").motion_of(5)[..2]
    );

    let temporal = original.temporal.as_mut().expect("a dynamic field");
    temporal.motion.fill([0.0; 3]);
    temporal.s.fill(f32::INFINITY);
    assert_eq!(read(&original).temporal, None);
}

#[test]
fn bad_metadata_is_refused() {
    let text = String::from_utf8_lossy(&write_field_file(&field(1, 0, None, false), &info())).into_owned();
    for (old, new) in [
        ("aarc field 1", "aarc field 2"),
        ("fps 29.97", "fps 0"),
        ("duration_s 1.6333333", "duration_s NaN"),
        ("up 0 0.6 -0.8", "up 0 0.6"),
        ("up 0 0.6 -0.8", "up 0 0 0"),
        ("viewpoint 0.1", "viewpoint inf"),
        ("viewpoint 0.1 ", "viewpoint "),
    ] {
        assert!(text.contains(old), "{text}");
        let message = import_error("field.ply", text.replace(old, new).as_bytes());
        let key = new.split(' ').find(|word| *word != "aarc").expect("a key");
        assert!(message.contains(key), "{message}");
    }
}

#[test]
fn static_ply_preserves_the_static_columns() {
    let original = field(12, 3, Some(2), false);
    let imported = import_bytes("a.ply", &write_static_ply(&original, None)).expect("a plain PLY");
    assert_eq!(imported.field.centers, original.centers);
    assert_eq!(imported.field.rotations, original.rotations);
    assert_eq!(imported.field.log_scales, original.log_scales);
    assert_eq!(imported.field.sh, original.sh);
    assert_close("opacity", &imported.field.opacities, &original.opacities, |_| 2e-7);
}

#[test]
fn splatv_preserves_half_precision() {
    // More than one row of the texture, so that padding is needed.
    let original = field(1030, 1, Some(3), true);
    let imported = import_bytes("a.splatv", &write_splatv(&original, &info())).expect("our own file");
    assert!(imported.account.repairs.dropped.is_empty(), "{}", imported.account.repairs);
    let read = imported.field;
    assert_eq!(read.len(), original.len());
    assert_eq!(read.centers, original.centers);
    assert_same_rotations(&read.rotations, &original.rotations, 1e-3);
    let half = |x: f32| x.abs() / 1024.0 + 1e-6;
    assert_close("scale", read.log_scales.as_flattened(), original.log_scales.as_flattened(), |_| 1e-3);
    assert_close("opacity", &read.opacities, &original.opacities, |_| 0.51 / 255.0);
    let constant: Vec<[f32; 3]> = (0..original.len()).map(|i| original.sh_of(i)[0]).collect();
    assert_close("colour", read.sh.as_flattened(), constant.as_flattened(), |_| 0.51 / 255.0 / 0.2820948);
    let (read, original) =
        (read.temporal.expect("a dynamic field"), original.temporal.expect("a dynamic field"));
    assert_close("tau", &read.tau, &original.tau, half);
    assert_close("s", &read.s, &original.s, half);
    assert_close("motion", read.motion.as_flattened(), original.motion.as_flattened(), half);
    let (read, original) = (read.rotation_rates.expect("rates"), original.rotation_rates.expect("rates"));
    assert_close("rates", read.as_flattened(), original.as_flattened(), |x| half(x) + 1e-3);
}

#[test]
fn spz_preserves_values_within_its_steps() {
    for degree in 0..=3 {
        let original = field(50, degree, None, false);
        let imported = import_bytes("a.spz", &write_spz(&original, [0.0, 0.0, 1.0])).expect("our own file");
        assert!(imported.account.repairs.is_empty(), "{}", imported.account.repairs);
        let read = imported.field;
        assert_eq!(read.sh_degree, degree);
        assert_close("centre", read.centers.as_flattened(), original.centers.as_flattened(), |_| 3e-7);
        assert_same_rotations(&read.rotations, &original.rotations, 2.0 / 511.0);
        assert_close("scale", read.log_scales.as_flattened(), original.log_scales.as_flattened(), |_| {
            0.51 / 16.0
        });
        assert_close("opacity", &read.opacities, &original.opacities, |_| 0.51 / 255.0);
        for i in 0..original.len() {
            assert_close("colour", &read.sh_of(i)[0], &original.sh_of(i)[0], |_| 0.51 / 255.0 / 0.15);
            let higher = |field: &Field| field.sh_of(i)[1..].as_flattened().to_vec();
            assert_close("sh", &higher(&read), &higher(&original), |_| 0.51 / 128.0);
        }
    }
}

/// Niantic's own file, imported and exported, gives the same Gaussians. The PLY that it was made from gives
/// them within the quantisation steps.
#[test]
fn spz_agrees_with_its_reference() {
    let Some(folder) = data("format-fixtures/metalsplatter") else { return };
    let read = |extension: &str| {
        let path = folder.join("test-splat.3-points-from-train").with_added_extension(extension);
        import(&path).expect("a fixture").field
    };
    let (ply, reference) = (read("ply"), read("spz"));
    let again = import_bytes("a.spz", &write_spz(&reference, [0.0, 1.0, 0.0])).expect("our own file").field;
    assert_eq!(again, reference);

    let ours = import_bytes("a.spz", &write_spz(&ply, [0.0, -1.0, 0.0])).expect("our own file").field;
    assert_close("centre", ours.centers.as_flattened(), reference.centers.as_flattened(), |_| 0.51 / 4096.0);
    assert_close("opacity", &ours.opacities, &reference.opacities, |_| 0.0);
    assert_close("scale", ours.log_scales.as_flattened(), reference.log_scales.as_flattened(), |_| 0.0);
    assert_eq!(ours.rotations, reference.rotations);
    // That writer rounds higher SH to 8 bits and then to 5 or 4.
    assert_close("sh", ours.sh.as_flattened(), reference.sh.as_flattened(), |_| 0.07);
}

#[test]
fn frozen_field_is_the_field_at_that_time() {
    let original = field(200, 1, Some(3), true);
    let t = 0.37;
    let frozen_field = frozen(&original, t);
    frozen_field.check().expect("a valid field");
    let visible: Vec<usize> = (0..200).filter(|&i| original.opacity_at(i, t) >= ALPHA_MIN).collect();
    assert!(visible.len() > 50 && visible.len() < 200, "a field that fades");
    assert_eq!(frozen_field.len(), visible.len());
    assert_eq!(frozen_field.temporal, None);
    for (row, &i) in visible.iter().enumerate() {
        assert_eq!(frozen_field.centers[row], original.position_at(i, t).map(|x| x as f32));
        assert_eq!(frozen_field.rotations[row], original.rotation_at(i, t).map(|x| x as f32));
        assert_eq!(frozen_field.opacities[row], original.opacity_at(i, t) as f32);
        assert_eq!(frozen_field.sh_of(row), original.sh_of(i));
        assert_eq!(frozen_field.log_scales[row], original.log_scales[i]);
    }
}
