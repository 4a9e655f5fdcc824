//! What files of other programs say about a field: honoured or named, never dropped without a word.

mod support;

use std::io::{Cursor, Read, Write};
use std::path::Path;

use codec::PixelFilter;
use flate2::Compression;
use flate2::read::GzDecoder;
use flate2::write::GzEncoder;
use formats::{
    FORMATS, ImportLimits, Imported, SceneFiles, write_field_file, write_glb, write_splatv, write_spz,
};
use support::{STATIC, ascii_ply, assert_close, field, import_bytes, import_error, info};

/// A row of [`STATIC`].
const ROW: &str = "0 0 0 1 0 0 2 -2 -2 -2 1 0 0 0";

/// A PLY of one Gaussian, with these lines in its header and these columns behind the static ones.
fn ply(lines: &str, columns: &str, values: &str) -> Vec<u8> {
    let names = format!("{STATIC} {columns}");
    let bytes = ascii_ply(names.trim(), &[&format!("{ROW} {values}")]);
    let text = String::from_utf8(bytes).expect("text");
    text.replacen("element", &format!("{lines}element"), 1).into_bytes()
}

fn read(bytes: &[u8]) -> Imported {
    import_bytes("a.ply", bytes).expect("a field")
}

fn notes(imported: &Imported) -> String {
    imported.account.sentences().join("; ")
}

#[test]
fn comments_of_other_programs_state_filter_and_up_axis() {
    for (comment, filter, note) in [
        ("SplatRenderMode: mip", PixelFilter::Mip, "SplatRenderMode"),
        ("SplatRenderMode: default", PixelFilter::Blur, ""),
        ("SplatRenderMode: other", PixelFilter::Blur, "SplatRenderMode: other is not known"),
        ("SplatRenderMode: \u{1b}]0;", PixelFilter::Blur, "\\u{1b}]0;"),
        ("antialiased 1", PixelFilter::Mip, "0.3 px^2"),
        ("antialiased: true", PixelFilter::Mip, "0.3 px^2"),
        ("antialiased 0", PixelFilter::Blur, ""),
        ("Vertical axis: y", PixelFilter::Blur, "Vertical axis: y"),
        ("Exported by a program", PixelFilter::Blur, ""),
    ] {
        let imported = read(&ply(&format!("comment {comment}\n"), "", ""));
        assert_eq!(imported.field.filter, filter, "{comment}");
        let notes = notes(&imported);
        assert!(notes.contains(note) && notes.is_empty() == note.is_empty(), "{comment}: `{notes}`");
    }
    assert_eq!(read(&ply("comment Vertical axis: 0 0 2\n", "", "")).hints.up, Some([0.0, 0.0, 1.0]));
}

#[test]
fn columns_are_read_or_named() {
    let filtered = read(&ply("", "filter_3D", "0.08"));
    let scale = f64::exp(-2.0);
    let wider = scale.hypot(0.08);
    let opacity = 1.0 / (1.0 + f64::exp(-2.0)) * (scale / wider).powi(3);
    assert_close("scale", &filtered.field.log_scales[0], &[wider.ln() as f32; 3], |_| 1e-6);
    assert_close("opacity", &filtered.field.opacities, &[opacity as f32], |_| 1e-6);
    assert!(notes(&filtered).contains("filter_3D"));

    let lifetime = read(&ply("", "lifetime_mu lifetime_w nx", "0 0.2 0"));
    assert!(notes(&lifetime).contains("not read: lifetime_mu, lifetime_w; "), "{}", notes(&lifetime));
    let many = (0..20).map(|k| format!("c{k}")).collect::<Vec<_>>().join(" ");
    assert!(notes(&read(&ply("", &many, &"0 ".repeat(20)))).contains("c7 and 12 more"));

    // Of a variant that this file is not, or of another element.
    for (columns, named) in [
        ("t scale_t", "t, scale_t"),
        ("scale_t rot_r_0 rot_r_1 rot_r_2 rot_r_3", "scale_t, rot_r_0, rot_r_1, rot_r_2, rot_r_3"),
        ("trbf_scale motion_0", "trbf_scale, motion_0"),
        ("vx vy vz time", "vx, vy, vz, time"),
        ("tau s aarc_opacity", "tau, s, aarc_opacity"),
        ("red green blue", "red, green, blue"),
    ] {
        let imported = read(&ply("", columns, &"0 ".repeat(columns.split(' ').count())));
        let said = format!("columns that are not read: {named}; ");
        assert!(notes(&imported).contains(&said), "{}", notes(&imported));
    }
    let text = String::from_utf8(ply("", "", "")).unwrap();
    let text = text.replace("end_header", "element sh 1\nproperty uchar f_rest_0\nend_header") + "7\n";
    assert_eq!(notes(&read(text.as_bytes())), "elements that are not read: sh");
    let words = "packed_position packed_rotation packed_scale packed_color".replace(' ', "\nproperty uint ");
    let ends = ["x", "y", "z", "scale_x", "scale_y", "scale_z"].map(|axis| format!("min_{axis} max_{axis}"));
    let ends = format!("{} max_r", ends.join(" ")).replace(' ', "\nproperty float ");
    let compressed = format!(
        "ply\nformat ascii 1.0\nelement chunk 1\nproperty float {ends}\nelement vertex 1\nproperty uint {words}\n\
         end_header\n{}\n0 0 0 255\n",
        "0 1 ".repeat(6) + "1"
    );
    assert!(notes(&read(compressed.as_bytes())).contains("not read: max_r; "));

    let rest: Vec<String> = (0..72).map(|k| format!("f_rest_{k}")).collect();
    let values: Vec<String> = (0..72).map(|k| k.to_string()).collect();
    let cut = read(&ply("", &rest.join(" "), &values.join(" ")));
    assert_eq!((cut.field.sh_degree, cut.field.sh_of(0)[15]), (3, [14.0, 38.0, 62.0]));
    assert!(notes(&cut).contains("SH above degree 3"), "{}", notes(&cut));

    let text = String::from_utf8(ply("", "", "")).unwrap();
    let disc = text.replace("property float scale_2\n", "").replace("-2 -2 -2", "-2 -2");
    let disc = read(disc.as_bytes());
    assert_close("disc", &disc.field.log_scales[0], &[-2.0, -2.0, -15.8155], |_| 1e-3);
    assert!(notes(&disc).contains("discs"));

    let colored = |kind: &str, white: &str| {
        let names = ["f_dc_0", "f_dc_1", "f_dc_2"].into_iter().zip(["red", "green", "blue"]);
        let text = names.fold(text.clone(), |text, (old, new)| {
            text.replace(&format!("float {old}"), &format!("{kind} {new}"))
        });
        read(text.replace("0 0 0 1 0 0", &format!("0 0 0 {white} 0 0")).as_bytes())
    };
    for (kind, white) in [("uchar", "255"), ("ushort", "65535"), ("float", "1")] {
        let imported = colored(kind, white);
        let white = 0.5 / codec::SH_C0 as f32;
        assert_close(kind, &imported.field.sh_of(0)[0], &[white, -white, -white], |_| 1e-6);
        assert!(notes(&imported).contains("red, green and blue"));
    }
}

#[test]
fn what_is_no_gaussian_refuses_nothing() {
    let with = |bytes: &[u8]| read(bytes).field.centers;
    assert_eq!(with(&ply("comment \u{e9}\n", "", "")), [[0.0; 3]]);
    let latin: Vec<u8> =
        ply("comment Andr?\n", "", "").iter().map(|&b| if b == b'?' { 0xe9 } else { b }).collect();
    assert_eq!(with(&latin), [[0.0; 3]], "a comment in Latin-1");
    assert_eq!(with(&[b"\xef\xbb\xbf", &ply("", "", "")[..]].concat()), [[0.0; 3]], "a byte order mark");

    let face = "element face 2\nproperty uchar flag\nproperty list uchar int corners\nproperty short end\n";
    let text = String::from_utf8(ply(face, "", "")).unwrap();
    let text = text.replace("end_header\n", "end_header\n1 3 0 0 0 7\n\n0 0 7\n");
    let imported = read(text.as_bytes());
    assert_eq!(imported.field.len(), 1);
    assert!(notes(&imported).contains("elements that are not read: face"));
    let header = &text[..text.find("end_header\n").unwrap() + 11];
    let values: Vec<f32> = ROW.split(' ').map(|x| x.parse().unwrap()).collect();
    let faces = |int: fn(i32) -> [u8; 4], short: [u8; 2]| {
        [&[1, 3][..], &int(0), &int(1), &int(2), &short, &[0, 0], &short].concat()
    };
    let little =
        faces(i32::to_le_bytes, [7, 0]).into_iter().chain(values.iter().flat_map(|x| x.to_le_bytes()));
    let big = faces(i32::to_be_bytes, [0, 7]).into_iter().chain(values.iter().flat_map(|x| x.to_be_bytes()));
    for (encoding, body) in [("little", little.collect::<Vec<u8>>()), ("big", big.collect())] {
        let header = header.replace("ascii", &format!("binary_{encoding}_endian"));
        let file = [header.as_bytes(), &body].concat();
        assert_eq!(read(&file).field, imported.field, "{encoding}");
        // The list ends beyond the file.
        let cut = [header.as_bytes(), &[1, 255, 0, 0]].concat();
        assert!(import_error("a.ply", &cut).contains("truncated"));
    }

    for none in ["nan", "-nan", "-nan(ind)", "nan(snan)", "1.#QNAN", "-1.#IND"] {
        let good = "9 9 9 1 0 0 2 -2 -2 -2 1 0 0 0";
        let imported = read(&ascii_ply(STATIC, &[&ROW.replacen("2", none, 1), good]));
        assert_eq!(
            (imported.field.len(), notes(&imported).as_str()),
            (1, "dropped 1 (non-finite opacity: 1)"),
            "{none}"
        );
    }
    assert!(
        notes(&read(&ascii_ply(STATIC, &[ROW, &ROW.replacen("0", "-1.#INF", 1)])))
            .contains("non-finite centre")
    );
}

#[test]
fn scales_of_any_unit_are_drawn_and_others_dropped() {
    for shift in [-60.0, 0.0, 30.0] {
        let row = |scale: f32| format!("0 0 0 0 0 0 0 {} {} {scale} 1 0 0 0", shift - 2.0, shift - 2.0);
        let rows = [row(f32::NEG_INFINITY), row(shift - 2.0), row(100.0)];
        let imported = read(&ascii_ply(STATIC, &[&rows[0], &rows[1], &rows[2]]));
        let scales = &imported.field.log_scales;
        assert_eq!(scales.len(), 2, "{}", notes(&imported));
        assert!((scales[0][2] - scales[1][2] + 13.8155).abs() < 1e-3, "{scales:?}");
        assert_eq!(
            notes(&imported),
            "repaired 1 (zero scale: 1), dropped 1 (scale beyond 32-bit numbers: 1)"
        );
    }
}

#[test]
fn far_centres_are_read_about_another_origin_with_all_that_belongs_to_them() {
    let row = |x: &str| format!("{x} 5411000.456 230 0 0 0 2 -2 -2 -2 1 0 0 0");
    let far = ascii_ply(STATIC, &[&row("448000.123"), &row("448000.373"), &row("448000.623")]);
    let imported = read(&far);
    assert_eq!(imported.hints.origin, Some([448000.373, 5411000.456, 230.0]));
    assert_close(
        "centre",
        imported.field.centers.as_flattened(),
        &[-0.25, 0., 0., 0., 0., 0., 0.25, 0., 0.],
        |_| 1e-6,
    );
    assert!(notes(&imported).contains("relative to 448000.373 5411000.456 230"), "{}", notes(&imported));
    // The same numbers in 32 bits have no more digits, and coarse ones are enough for large Gaussians.
    assert_eq!(read(&write_field_file(&imported.field, &info())).hints.origin, None);
    let large = String::from_utf8(far.clone()).unwrap().replace("-2 -2 -2", "9 9 9");
    assert_eq!(read(large.as_bytes()).hints.origin, None);
    // A stray far away is no reason to move the others.
    let near = ["1.5 2 3 0 0 0 2 -5 -5 -5 1 0 0 0", "1.1 2 3 0 0 0 2 -5 -5 -5 1 0 0 0"];
    let stray = "1000000.123 0 0 0 0 0 2 -5 -5 -5 1 0 0 0";
    assert_eq!(read(&ascii_ply(STATIC, &[near[0], near[1], stray])).hints.origin, None);

    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    std::fs::write(path("a.ply"), &far).unwrap();
    std::fs::write(path("plate.ply"), ascii_ply(STATIC, &[&row("448001.373")])).unwrap();
    let view = r#"{"name": "a", "position": [448000, 5411000, 230], "target": [448001, 5411000, 230], "fov_y_deg": 50}"#;
    std::fs::write(path("scene.json"), format!("\u{feff}{{\"viewpoints\": [{view}]}}")).unwrap();
    let scene = SceneFiles::at(folder.path()).unwrap().read(ImportLimits::default()).unwrap();
    assert_close("plate", &scene.plate.unwrap().field.centers[0], &[1.0, 0.0, 0.0], |_| 1e-6);
    assert_close("view", &scene.info.viewpoints[0].position, &[-0.373, -0.456, 0.0], |_| 1e-6);

    let frames = tempfile::tempdir().unwrap();
    for (k, x) in ["448000.123", "448000.223", "448000.323"].into_iter().enumerate() {
        std::fs::write(frames.path().join(format!("f{k}.ply")), ascii_ply(STATIC, &[&row(x)])).unwrap();
    }
    let scene = SceneFiles::at(frames.path()).unwrap().read(ImportLimits::default()).unwrap();
    let moved = [0.0, 1.0].map(|t| scene.subject.field.position_at(0, t)[0]);
    assert!(moved[0].abs() < 1e-3 && (moved[1] - 0.2).abs() < 1e-3, "{moved:?}");
    assert!(notes(&scene.subject).contains("relative to 448000.123"), "{}", notes(&scene.subject));
}

#[test]
fn gaussians_in_four_dimensions_move_and_fade() {
    let columns = "t scale_t rot_r_0 rot_r_1 rot_r_2 rot_r_3";
    let read = |scales: [f64; 4], left: [f64; 4], right: [f64; 4], t: f64| {
        let logs = scales.map(f64::ln);
        let [a, b, c, d] = left;
        let [p, q, r, s] = right;
        let row = format!(
            "0 0 0 1 0 0 2 {} {} {} {a} {b} {c} {d} {t} {} {p} {q} {r} {s}",
            logs[0], logs[1], logs[2], logs[3]
        );
        read(&ascii_ply(&format!("{STATIC} {columns}"), &[&row]))
    };
    // A turn in the plane of x and t.
    let angle: f64 = 0.7;
    let (sin, cos) = angle.sin_cos();
    let [half_sin, half_cos] = [(angle / 2.0).sin(), (angle / 2.0).cos()];
    let imported = read(
        [0.5, 0.2, 0.1, 0.3],
        [2.0 * half_cos, 0.0, 0.0, 2.0 * half_sin],
        [half_cos, 0.0, 0.0, -half_sin],
        0.4,
    );
    let variance = (0.5 * sin).powi(2) + (0.3 * cos).powi(2);
    let velocity = (0.3f64.powi(2) - 0.5f64.powi(2)) * sin * cos / variance;
    let temporal = imported.field.temporal.as_ref().expect("it moves");
    assert_close("window", &[temporal.tau[0], temporal.s[0]], &[0.4, variance.sqrt() as f32], |_| 1e-6);
    assert_close("motion", &temporal.motion[0], &[velocity as f32, 0.0, 0.0], |_| 1e-6);
    let across = 0.5 * 0.3 / variance.sqrt();
    let scales = [across.ln() as f32, 0.2f32.ln(), 0.1f32.ln()];
    assert_close("scales", &imported.field.log_scales[0], &scales, |_| 1e-5);
    assert!(notes(&imported).contains("times from 0 to 1"), "{}", notes(&imported));

    // A turn about x, which both quaternions are.
    let turn = [half_cos, 0.0, 0.0, half_sin];
    let turned = read([0.5, 0.2, 0.1, 0.3], turn, turn, 0.4);
    let [w, x, y, z] = turned.field.rotations[0].map(f64::from);
    let axis_y = [2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)];
    let axis_z = [2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)];
    let [_, sy, sz] = turned.field.log_scales[0].map(|scale| f64::from(scale).exp().powi(2));
    let across = sy * axis_y[1] * axis_y[2] + sz * axis_z[1] * axis_z[2];
    assert!((across - (0.1f64.powi(2) - 0.2f64.powi(2)) * sin * cos).abs() < 1e-6, "{across}");
    assert!(turned.field.temporal.as_ref().is_none_or(|temporal| temporal.motion_order == 0));

    // Seconds are the duration; times about zero are shifted.
    let identity = [1.0, 0.0, 0.0, 0.0];
    let seconds = read([0.5, 0.2, 0.1, 2.0], identity, identity, 7.3);
    assert_eq!(seconds.hints.duration_s, Some(8.0));
    assert_close("tau", &seconds.field.temporal.unwrap().tau, &[7.3 / 8.0], |_| 1e-6);
    let about = read([0.5, 0.2, 0.1, 0.2], identity, identity, -0.3);
    assert_close("tau", &about.field.temporal.unwrap().tau, &[0.2], |_| 1e-6);
    // Fits whose points have no time begin with a tenth more on both sides, which some Gaussians leave later.
    for (times, length) in
        [([-1.0, 11.0], 10.0), ([-1.3, 11.3], 10.0), ([0.0, 10.0], 10.0), ([-0.3, 3.4], 3.0)]
    {
        let rows = times.map(|t| format!("{ROW} {t} 0 1 0 0 0"));
        let imported = self::read(&ascii_ply(&format!("{STATIC} {columns}"), &[&rows[0], &rows[1]]));
        assert_eq!(imported.hints.duration_s, Some(length), "{times:?}");
        let said = format!("are at times from {} to {}, ", times[0], times[1]);
        assert!(notes(&imported).contains(&said), "{}", notes(&imported));
    }
}

#[test]
fn colours_that_change_over_time_are_of_the_own_instant() {
    for frequencies in [1, 2] {
        let coefficients = 16 * (1 + frequencies);
        let rest: Vec<String> = (0..3 * (coefficients - 1)).map(|k| format!("f_rest_{k}")).collect();
        // Coefficient k of a channel is k, and 1000 more for the next channel.
        let values = [0, 1, 2].map(|channel| {
            let values: Vec<String> = (1..coefficients).map(|k| (1000 * channel + k).to_string()).collect();
            values.join(" ")
        });
        let columns = format!("{} t scale_t rot_r_0 rot_r_1 rot_r_2 rot_r_3", rest.join(" "));
        let imported = read(&ply("", &columns, &format!("{} 0.5 0 1 0 0 0", values.join(" "))));
        assert_eq!((imported.field.sh_degree, imported.field.sh.len()), (3, 16));
        for (k, sum) in imported.field.sh_of(0).iter().enumerate() {
            let terms: usize = (0..=frequencies).map(|term| k + 16 * term).sum();
            let constant = [1.0, 0.0, 0.0];
            let expected = [0, 1, 2].map(|channel| {
                let count = if k == 0 { frequencies } else { frequencies + 1 };
                let first = if k == 0 { constant[channel] } else { 0.0 };
                (terms + 1000 * channel * count) as f32 + first
            });
            assert_eq!(*sum, expected, "coefficient {k}");
        }
        let notes = notes(&imported);
        assert!(notes.contains("at its own centre in time") && !notes.contains("SH above"), "{notes}");
    }
}

#[test]
fn checksums_of_others_are_read() {
    let good = write_spz(&field(40, 1, None, false), [0.0, 1.0, 0.0]);
    assert!(import_bytes("a.spz", &good).is_ok());
    let rotten = |bytes: &[u8], at: usize| {
        let mut bytes = bytes.to_vec();
        bytes[at] ^= 1;
        bytes
    };
    // The checksum itself, before the length at the end.
    assert!(import_error("a.spz", &rotten(&good, good.len() - 8)).contains("damaged"));
    let mut accepted = 0;
    for at in 10..good.len() - 4 {
        accepted += usize::from(import_bytes("a.spz", &rotten(&good, at)).is_ok());
    }
    assert_eq!(accepted, 0, "changed bytes were read");

    let good = spz(4, &[]);
    assert!(import_bytes("a.spz", &good).is_ok());
    assert!(
        import_error("a.spz", &rotten(&good, good.len() - 1)).contains("damaged"),
        "the checksum of zstd"
    );

    let mut archive = zip::ZipWriter::new(Cursor::new(Vec::new()));
    let stored = zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
    archive.start_file("meta.json", stored).unwrap();
    archive.write_all(br#"{"version": 2, "count": 1}"#).unwrap();
    let bundle = archive.finish().unwrap().into_inner();
    let at = bundle.windows(5).position(|window| window == b"count").unwrap();
    let message = import_error("a.sog", &rotten(&bundle, at));
    assert!(message.contains("checksum"), "{message}");
}

/// An SPZ of one Gaussian with extensions, each a type and its content.
fn spz(version: u32, extensions: &[(u32, &[u8])]) -> Vec<u8> {
    let written = write_spz(&field(1, 0, None, false), [0.0, 1.0, 0.0]);
    let mut plain = Vec::new();
    GzDecoder::new(&written[..]).read_to_end(&mut plain).unwrap();
    plain[14] |= 2;
    let records: Vec<u8> = extensions
        .iter()
        .flat_map(|(kind, content)| {
            [&kind.to_le_bytes()[..], &(content.len() as u32).to_le_bytes(), content].concat()
        })
        .collect();
    if version == 3 {
        plain.extend(records);
        let mut gzip = GzEncoder::new(Vec::new(), Compression::default());
        gzip.write_all(&plain).unwrap();
        return gzip.finish().unwrap();
    }
    let (head, arrays) = plain.split_at(16);
    let mut file = head.to_vec();
    file[4] = 4;
    file[15] = 5;
    file.extend((32 + records.len() as u32).to_le_bytes());
    file.extend([0; 12]);
    file.extend(records);
    let (mut table, mut streams, mut rest) = (Vec::new(), Vec::new(), arrays);
    for size in [9, 1, 3, 3, 4] {
        let (array, after) = rest.split_at(size);
        let mut encoder = zstd::stream::Encoder::new(Vec::new(), 3).unwrap();
        encoder.include_checksum(true).unwrap();
        encoder.write_all(array).unwrap();
        let packed = encoder.finish().unwrap();
        table.extend([packed.len() as u64, size as u64].map(u64::to_le_bytes).concat());
        streams.extend(packed);
        rest = after;
    }
    [file, table, streams].concat()
}

#[test]
fn extensions_of_spz_state_axes() {
    let read =
        |version, extensions: &[(u32, &[u8])]| import_bytes("a.spz", &spz(version, extensions)).unwrap();
    for version in [3, 4] {
        for (number, up, is_mirrored) in [
            (0u32, [0.0, 1.0, 0.0], false),
            (4, [0.0, 1.0, 0.0], false),
            (6, [0.0, -1.0, 0.0], false),
            (7, [0.0, 1.0, 0.0], false),
            (8, [0.0, 1.0, 0.0], true),
            (12, [0.0, 0.0, 1.0], false),
            (16, [0.0, 0.0, 1.0], true),
        ] {
            let imported = read(version, &[(0xADBE_0003, &number.to_le_bytes())]);
            assert_eq!(imported.hints.up, Some(up), "version {version}, axes {number}");
            assert_eq!(notes(&imported).contains("mirrored"), is_mirrored, "{}", notes(&imported));
        }
        let others =
            read(version, &[(0xADBE_0002, &[0; 12]), (0x1234_0001, &[0; 3]), (0xADBE_0003, &[99, 0, 0, 0])]);
        let notes = notes(&others);
        assert!(notes.contains("12340001, of 3 bytes") && notes.contains("unknown kind 99"), "{notes}");
        assert!(!notes.contains("ADBE0002"), "{notes}");
    }
}

#[test]
fn extensions_of_gltf_and_chunks_of_splatv_are_named() {
    let with = |old: &str, new: &str| {
        let bytes = write_glb(&field(2, 3, None, false), &info()).unwrap();
        let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
        let json = String::from_utf8(bytes[20..20 + length].to_vec()).unwrap();
        assert!(json.contains(old), "{json}");
        let mut json = json.replacen(old, new, 1).into_bytes();
        json.resize(json.len().next_multiple_of(4), b' ');
        let size = (bytes.len() - length + json.len()) as u32;
        let head =
            [&bytes[..8], &size.to_le_bytes(), &(json.len() as u32).to_le_bytes(), &bytes[16..20]].concat();
        notes(&import_bytes("a.glb", &[head, json, bytes[20 + length..].to_vec()].concat()).unwrap())
    };
    let used = "\"extensionsUsed\":[";
    let more = format!("{used}\"KHR_other\",\"EXT_thing\",\"KHR_materials_unlit\",");
    let notes_of_extensions = with(used, &more);
    assert!(notes_of_extensions.contains("not read: KHR_other, EXT_thing"), "{notes_of_extensions}");
    assert!(!notes_of_extensions.contains("unlit"));
    let attribute = "\"KHR_gaussian_splatting:SH_DEGREE_3_COEF_0\":";
    let more = format!("\"KHR_gaussian_splatting:SH_DEGREE_4_COEF_0\":0,{attribute}");
    assert!(with(attribute, &more).contains("SH above degree 3 left out: 2"));

    let bytes = write_splatv(&field(2, 0, None, false), &info());
    let length = 8 + u32::from_le_bytes(bytes[4..8].try_into().unwrap()) as usize;
    let header = String::from_utf8(bytes[8..length].to_vec()).unwrap();
    let header = header.replacen('{', "{\"lights\":1,", 1);
    let header =
        format!("{},{{\"type\":\"mesh\",\"size\":0}}]", header.trim_end().strip_suffix(']').unwrap());
    let file =
        [&bytes[..4], &(header.len() as u32).to_le_bytes(), header.as_bytes(), &bytes[length..]].concat();
    let notes = notes(&import_bytes("a.splatv", &file).unwrap());
    assert!(
        notes.contains("keys that are not read: lights") && notes.contains("chunks that are not read: mesh"),
        "{notes}"
    );
}

#[test]
fn text_and_noise_are_no_field() {
    let pointer = b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 63327587\n".repeat(2);
    let page = "<!DOCTYPE html><title>404 Not Found</title>".repeat(200);
    let mut noise = support::Noise(7);
    let noise: Vec<u8> = (0..3200).map(|_| noise.bits() as u8).collect();
    for name in ["a.ply", "a.splat", "a.ksplat", "a.spz", "a.sog", "a.splatv", "a.glb"] {
        let message = import_error(name, &pointer);
        assert!(message.contains("Git LFS") && message.contains("git lfs pull"), "{message}");
        import_error(name, &noise);
    }
    for name in ["a.splat", "a.ksplat"] {
        let message = import_error(name, page.as_bytes());
        assert!(message.contains("this is text") && message.contains("404 Not Found"), "{message}");
    }
    assert!(import_error("a.splat", &noise).contains("cannot be Gaussians"));
    // What a converter writes for a cloud of points: no quaternion.
    let point = [[0.0f32; 3], [0.01; 3]].as_flattened().iter().flat_map(|x| x.to_le_bytes());
    let point: Vec<u8> = point.chain([200, 10, 10, 255, 255, 0, 0, 0]).collect();
    assert_eq!(import_bytes("a.splat", &point).unwrap().field.len(), 1);
}

#[test]
fn what_is_not_supported_is_not_called_damaged() {
    let streamed = r#"{"lodLevels": 3, "filenames": ["0_0/meta.json", "0_1/meta.json"], "tree": {}}"#;
    let message = import_error("lod-meta.json", streamed.as_bytes());
    assert!(message.contains("3 levels of detail in 2 parts"), "{message}");
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("lod-meta.json"), streamed).unwrap();
    let of_scene =
        SceneFiles::at(folder.path()).unwrap().read(ImportLimits::default()).unwrap_err().to_string();
    let of_folder = formats::import(folder.path()).unwrap_err().to_string();
    let messages = [
        message,
        of_scene,
        of_folder,
        import_error("meta.json", br#"{"means": {"shape": [3]}}"#),
        import_error("a.spz", b"NGSP\x09\0\0\0\0\0\0\0\0\0\0\0"),
        import_error("a.ply", &ascii_ply("x y z", &["0 0 0"])),
    ];
    for message in messages {
        assert!(message.contains("export") && !message.contains("again, or"), "{message}");
    }
}

#[test]
fn frames_of_any_format_are_a_sequence_and_keep_their_notes() {
    let folder = tempfile::tempdir().unwrap();
    for k in 0..3 {
        let mut bytes = spz(3, &[(0x1234_0001, &[0; 3])]);
        std::fs::write(folder.path().join(format!("{k}.spz")), &mut bytes).unwrap();
    }
    let scene = SceneFiles::at(folder.path()).unwrap().read(ImportLimits::default()).unwrap();
    assert_eq!(scene.subject.hints.frames, Some(3));
    assert!(notes(&scene.subject).contains("12340001"), "{}", notes(&scene.subject));
}

/// `xtask/README.md` has the statements of every reader, and no others.
#[test]
fn the_table_of_statements_is_the_readers() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../xtask/README.md");
    let document = std::fs::read_to_string(path).expect("the manual");
    let is_row = |line: &&str| {
        ["honoured", "noted", "ignored"].iter().any(|word| line.contains(&format!("| {word} |")))
    };
    let shown: Vec<&str> = document.lines().filter(is_row).collect();
    let rows =
        FORMATS.iter().flat_map(|format| format.statements.iter().map(move |statement| (format, statement)));
    let expected: Vec<String> = rows
        .map(|(format, statement)| {
            let name = statement.name.replace('*', "\\*");
            let format = format.title.split(' ').next().unwrap_or_default().trim_end_matches(',');
            format!("| {format} | {} | {} | {} |", name, statement.treatment.word(), statement.meaning)
        })
        .collect();
    assert_eq!(shown, expected, "write these rows:\n{}", expected.join("\n"));
}
