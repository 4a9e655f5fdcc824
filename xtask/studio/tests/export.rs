//! Exporters: what is written reads back.

mod support;

use codec::{ALPHA_MIN, Field};
use studio::export::{field_file, frozen, splatv, spz, static_ply};
use studio::import::import;
use support::{assert_close, assert_same_rotations, field, import_bytes, info};

#[test]
fn field_file_is_lossless() {
    let fields = (0..=3)
        .map(|degree| field(7, degree, None, false))
        .chain((0..=3u8).flat_map(|order| [false, true].map(|turns| field(9, order, Some(order), turns))));
    for original in fields {
        let mut original = original;
        // Opacities that a logit does not keep.
        original.opacities[..4].copy_from_slice(&[0.0, 1.0, f32::MIN_POSITIVE, 1.0 - f32::EPSILON]);
        let imported = import_bytes("field.ply", &field_file(&original, &info())).expect("our own file");
        assert_eq!(imported.field, original);
        assert!(imported.repairs.is_empty(), "{}", imported.repairs);
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
fn field_file_without_its_comments_is_an_inria_ply() {
    let original = field(20, 3, Some(3), true);
    let bytes = field_file(&original, &info());
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
fn columns_that_say_nothing_are_left_out() {
    let mut original = field(6, 2, Some(3), true);
    for i in 0..6 {
        original.sh[i * 9 + 4..(i + 1) * 9].fill([0.0; 3]);
    }
    let temporal = original.temporal.as_mut().expect("a moving field");
    temporal.motion.iter_mut().skip(2).step_by(3).for_each(|v| *v = [0.0; 3]);
    temporal.rotation_rates.as_mut().expect("rates").fill([0.0; 4]);
    let read =
        |field: &Field| import_bytes("field.ply", &field_file(field, &info())).expect("our own file").field;
    let reduced = read(&original);
    assert_eq!(reduced.sh_degree, 1);
    assert_eq!(reduced.sh_of(5), &original.sh_of(5)[..4]);
    let temporal = reduced.temporal.expect("still moving");
    assert_eq!((temporal.motion_order, &temporal.rotation_rates), (2, &None));
    assert_eq!(temporal.motion_of(5), &original.temporal.as_ref().expect("moving").motion_of(5)[..2]);

    let temporal = original.temporal.as_mut().expect("a moving field");
    temporal.motion.fill([0.0; 3]);
    temporal.s.fill(f32::INFINITY);
    assert_eq!(read(&original).temporal, None);
}

#[test]
fn bad_metadata_is_refused() {
    let text = String::from_utf8_lossy(&field_file(&field(1, 0, None, false), &info())).into_owned();
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
        let message = support::import_error("field.ply", text.replace(old, new).as_bytes());
        let key = new.split(' ').find(|word| *word != "aarc").expect("a key");
        assert!(message.contains(key), "{message}");
    }
}

#[test]
fn static_ply_keeps_the_static_columns() {
    let original = field(12, 3, Some(2), false);
    let imported = import_bytes("a.ply", &static_ply(&original)).expect("a plain PLY");
    assert_eq!(imported.field.centers, original.centers);
    assert_eq!(imported.field.rotations, original.rotations);
    assert_eq!(imported.field.log_scales, original.log_scales);
    assert_eq!(imported.field.sh, original.sh);
    assert_close("opacity", &imported.field.opacities, &original.opacities, |_| 2e-7);
}

#[test]
fn splatv_keeps_half_precision() {
    // More than one line of the texture, so that its padding is in play.
    let original = field(1030, 1, Some(3), true);
    let imported = import_bytes("a.splatv", &splatv(&original, &info())).expect("our own file");
    assert!(imported.repairs.dropped.is_empty(), "{}", imported.repairs);
    let read = imported.field;
    assert_eq!(read.len(), original.len());
    assert_eq!(read.centers, original.centers);
    assert_same_rotations(&read.rotations, &original.rotations, 1e-3);
    let half = |x: f32| x.abs() / 1024.0 + 1e-6;
    assert_close("scale", read.log_scales.as_flattened(), original.log_scales.as_flattened(), |_| 1e-3);
    assert_close("opacity", &read.opacities, &original.opacities, |_| 0.51 / 255.0);
    let constant: Vec<[f32; 3]> = (0..original.len()).map(|i| original.sh_of(i)[0]).collect();
    assert_close("colour", read.sh.as_flattened(), constant.as_flattened(), |_| 0.51 / 255.0 / 0.2820948);
    let (read, original) = (read.temporal.expect("moving"), original.temporal.expect("moving"));
    assert_close("tau", &read.tau, &original.tau, half);
    assert_close("s", &read.s, &original.s, half);
    assert_close("motion", read.motion.as_flattened(), original.motion.as_flattened(), half);
    let (read, original) = (read.rotation_rates.expect("rates"), original.rotation_rates.expect("rates"));
    assert_close("rates", read.as_flattened(), original.as_flattened(), |x| half(x) + 1e-3);
}

#[test]
fn spz_keeps_its_steps() {
    for degree in 0..=3 {
        let original = field(50, degree, None, false);
        let imported = import_bytes("a.spz", &spz(&original, [0.0, 0.0, 1.0])).expect("our own file");
        assert!(imported.repairs.is_empty(), "{}", imported.repairs);
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

/// Niantic's own file, read and written, gives the same Gaussians; and so does the PLY that it was
/// made from, within its steps.
#[test]
fn spz_agrees_with_its_reference() {
    let Some(folder) = support::data("format-fixtures/metalsplatter") else { return };
    let read = |extension: &str| {
        let path = folder.join("test-splat.3-points-from-train").with_added_extension(extension);
        import(&path).expect("a fixture").field
    };
    let (ply, reference) = (read("ply"), read("spz"));
    let again = import_bytes("a.spz", &spz(&reference, [0.0, 1.0, 0.0])).expect("our own file").field;
    assert_eq!(again, reference);

    let ours = import_bytes("a.spz", &spz(&ply, [0.0, -1.0, 0.0])).expect("our own file").field;
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
    let still = frozen(&original, t);
    still.check().expect("a valid field");
    let visible: Vec<usize> = (0..200).filter(|&i| original.opacity_at(i, t) >= ALPHA_MIN).collect();
    assert!(visible.len() > 50 && visible.len() < 200, "a field that fades");
    assert_eq!(still.len(), visible.len());
    assert_eq!(still.temporal, None);
    for (row, &i) in visible.iter().enumerate() {
        assert_eq!(still.centers[row], original.position_at(i, t).map(|x| x as f32));
        assert_eq!(still.rotations[row], original.rotation_at(i, t).map(|x| x as f32));
        assert_eq!(still.opacities[row], original.opacity_at(i, t) as f32);
        assert_eq!(still.sh_of(row), original.sh_of(i));
        assert_eq!(still.log_scales[row], original.log_scales[i]);
    }
}

/// A clip's two regions become one field again, in which the still rows are still.
#[test]
fn merged_clip_has_both_regions() {
    let (still, moving) = (field(5, 0, None, false), field(7, 2, Some(2), true));
    let clip = |still: &Field, moving: &Field| codec::Clip {
        info: info(),
        bounds: [[-9.0; 3], [9.0; 3]],
        static_field: still.clone(),
        dynamic_field: moving.clone(),
        layers: vec![codec::LayerEnd { static_count: still.len(), dynamic_count: moving.len() }],
        layers_announced: 1,
        time_index: codec::TimeIndex::default(),
        plate: None,
    };
    let both = clip(&still, &moving).merged();
    both.check().expect("a valid field");
    for (row, (source, i)) in (0..5).map(|i| (&still, i)).chain((0..7).map(|i| (&moving, i))).enumerate() {
        for t in [0.0, 0.4, 1.0] {
            assert_eq!(both.position_at(row, t), source.position_at(i, t));
            assert_eq!(both.rotation_at(row, t), source.rotation_at(i, t));
            assert_eq!(both.opacity_at(row, t), source.opacity_at(i, t));
        }
        let sh = source.sh_of(i);
        assert_eq!(&both.sh_of(row)[..sh.len()], sh);
        assert!(both.sh_of(row)[sh.len()..].iter().all(|c| *c == [0.0; 3]));
    }
    let nothing_moves = Field { temporal: Some(codec::Temporal::default()), ..Field::default() };
    assert_eq!(clip(&still, &nothing_moves).merged(), still);
}
