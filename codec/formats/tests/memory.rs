//! Peak memory of importing valid files and bombs. The allocator counts the whole process, so this file is one test;
//! it does not count the C memory of zstd.

mod support;

use std::io::{Cursor, Write};

use flate2::Compression;
use flate2::write::GzEncoder;
use formats::{ImportLimits, import_within, write_field_file, write_splatv, write_spz, write_static_ply};
use peak_alloc::PeakAlloc;
use support::{STATIC, ascii_ply, field, info};

#[global_allocator]
static ALLOCATOR: PeakAlloc = PeakAlloc;

/// Memory that the limits do not count: headers, decoders, and the temporary file's name.
const UNCOUNTED_BYTES: usize = 512 << 10;

/// Memory that the limits do not count while a read field is looked at: as much for any field.
const SURROUNDINGS_BYTES: u64 = 8 << 20;

/// Imports a file of these bytes, and returns the error and the peak memory beyond the memory already allocated.
fn peak_of(name: &str, bytes: &[u8], max_bytes: u64) -> (Result<usize, String>, usize) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    ALLOCATOR.reset_peak_usage();
    let before = ALLOCATOR.current_usage();
    let imported = import_within(&path, ImportLimits { max_bytes });
    let peak = ALLOCATOR.peak_usage() - before;
    (imported.map(|imported| imported.field.len()).map_err(|error| error.to_string()), peak)
}

/// A SOG bundle of equal Gaussians, in images of one colour.
fn sog(rows: usize) -> Vec<u8> {
    let side = rows.isqrt() as u32 + 1;
    let mut png = Cursor::new(Vec::new());
    image::RgbaImage::from_pixel(side, side, image::Rgba([128, 128, 128, 255]))
        .write_to(&mut png, image::ImageFormat::Png)
        .unwrap();
    let codebook: Vec<f32> = (0..256).map(|k| k as f32 / 64.0 - 2.0).collect();
    let meta = serde_json::json!({
        "version": 2, "count": rows,
        "means": {"mins": [-1, -1, 0], "maxs": [1, 2, 0], "files": ["a.png", "a.png"]},
        "scales": {"codebook": codebook, "files": ["a.png"]},
        "quats": {"files": ["a.png"]},
        "sh0": {"codebook": codebook, "files": ["a.png"]},
    });
    let mut archive = zip::ZipWriter::new(Cursor::new(Vec::new()));
    for (name, content) in [("meta.json", meta.to_string().into_bytes()), ("a.png", png.into_inner())] {
        archive.start_file(name, zip::write::SimpleFileOptions::default()).unwrap();
        archive.write_all(&content).unwrap();
    }
    archive.finish().unwrap().into_inner()
}

/// The head of an SPZ file that announces `rows` Gaussians of SH degree 3.
fn spz_head(version: u32, rows: u32) -> Vec<u8> {
    [b"NGSP", &version.to_le_bytes()[..], &rows.to_le_bytes(), &[3, 12, 0, 6]].concat()
}

#[test]
fn memory_is_bounded() {
    const ROWS: usize = 20_000;
    let (constant, dynamic) = (field(ROWS, 3, None, false), field(ROWS, 0, Some(3), true));
    let mut dirty = write_static_ply(&constant, None);
    let start = dirty.len() - 248 * ROWS;
    dirty[start..start + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    for (name, bytes) in [
        ("field.ply", write_field_file(&dynamic, &info())),
        ("static.ply", write_static_ply(&constant, None)),
        ("dirty.ply", dirty),
        ("ascii.ply", ascii_ply(STATIC, &["0 0 1 1 1 1 2 0 0 0 1 0 0 0"; ROWS])),
        ("a.splatv", write_splatv(&dynamic, &info())),
        ("a.spz", write_spz(&constant, [0.0, 1.0, 0.0])),
        ("a.splat", [&[0, 0, 0, 64].repeat(7)[..], &[255, 128, 128, 128]].concat().repeat(ROWS)),
        ("a.sog", sog(ROWS)),
    ] {
        // The least limit that accepts the file, to 16 KiB.
        let (mut refused, mut accepted) = (0, 1 << 30);
        while accepted - refused > 16 << 10 {
            let limit = (refused + accepted) / 2;
            let (imported, peak) = peak_of(name, &bytes, limit);
            let most = limit + UNCOUNTED_BYTES as u64 + SURROUNDINGS_BYTES;
            assert!(peak as u64 <= most, "{name}: peak {peak} of {limit}");
            match imported {
                Ok(_) => accepted = limit,
                Err(error) => {
                    assert!(error.contains("MB is the limit; prune the field"), "{name}: {error}");
                    refused = limit;
                }
            }
        }
        let (imported, peak) = peak_of(name, &bytes, accepted);
        println!("{name}: {} bytes, peak {peak} of {accepted}", bytes.len());
        assert!(imported.unwrap() > ROWS - 2 && peak > 44 * ROWS, "{name}: the allocator does not count");
    }

    // A header whose numbers would take 32 bytes each.
    let header = format!(r#"[{{"type": "splat", "size": 64, "cameras": [{}1]}}]"#, "1,".repeat(2 << 20));
    let length = (header.len() as u32).to_le_bytes();
    let long = [&[0x4b, 0x67, 0, 0][..], &length, header.as_bytes(), &[0; 64]].concat();
    let (imported, peak) = peak_of("long.splatv", &long, ImportLimits::default().max_bytes);
    assert!(imported.unwrap_err().contains("a header of"));
    assert!(peak < long.len() + UNCOUNTED_BYTES, "{peak}");

    // Keys that are not read: values that would take 32 bytes a number or 100 bytes a byte, and many.
    let numbers = format!(r#""lights": [{}1]"#, "1,".repeat(400_000));
    let keys: Vec<String> = (0..60_000).map(|k| format!("\"{k:x}\":0")).collect();
    let columns = r#""count": 1, "quats": {"files": ["a"]}, "scales": {"codebook": [], "files": ["a"]},
        "sh0": {"codebook": [], "files": ["a"]},
        "means": {"mins": [0, 0, 0], "maxs": [1, 1, 1], "files": ["a", "a"]}"#;
    let objects = format!(r#""cameras": [{}0]"#, r#"{"":0},"#.repeat(100_000));
    for more in [numbers, objects, keys.join(",")] {
        let header = format!(r#"[{{"type": "splat", "size": 64, {more}}}]"#);
        let length = (header.len() as u32).to_le_bytes();
        let splatv = [&[0x4b, 0x67, 0, 0][..], &length, header.as_bytes(), &[1; 64]].concat();
        let sog = format!(r#"{{"version": 2, {columns}, {more}}}"#).into_bytes();
        for (name, bytes) in [("a.splatv", splatv), ("meta.json", sog)] {
            for limit in [4, 16, 64].map(|mib| mib << 20) {
                let (_, peak) = peak_of(name, &bytes, limit);
                assert!(peak as u64 <= limit + UNCOUNTED_BYTES as u64, "{name}: {peak} of {limit}");
            }
        }
    }
    let long = format!(r#"{{"version": 2, "a": "{}"}}"#, "a".repeat(1 << 20));
    let (imported, peak) = peak_of("meta.json", long.as_bytes(), ImportLimits::default().max_bytes);
    assert!(imported.unwrap_err().contains("meta.json of"));
    assert!(peak < long.len() + UNCOUNTED_BYTES, "{peak}");

    // A mesh of many primitives in many places: 9 million primitives in half a megabyte.
    let attributes = serde_json::json!({
        "POSITION": 0,
        "KHR_gaussian_splatting:SCALE": 0,
        "KHR_gaussian_splatting:ROTATION": 1,
        "KHR_gaussian_splatting:OPACITY": 2,
        "KHR_gaussian_splatting:SH_DEGREE_0_COEF_0": 0,
    });
    let accessor =
        |kind: &str| serde_json::json!({"bufferView": 0, "componentType": 5126, "count": 100, "type": kind});
    let primitive =
        serde_json::json!({"attributes": attributes, "extensions": {"KHR_gaussian_splatting": {}}});
    let gltf = serde_json::json!({
        "nodes": vec![serde_json::json!({"mesh": 0}); 3_000],
        "meshes": [{"primitives": vec![primitive; 3_000]}],
        "accessors": [accessor("VEC3"), accessor("VEC4"), accessor("SCALAR")],
        "bufferViews": [{"buffer": 0, "byteLength": 1_600}],
        "buffers": [{"byteLength": 1_600, "uri": format!("data:;base64,{}", "A".repeat(2_136))}],
    });
    let gltf = gltf.to_string();
    let (imported, peak) = peak_of("places.gltf", gltf.as_bytes(), ImportLimits::default().max_bytes);
    assert!(imported.unwrap_err().contains("MB is the limit"));
    assert!(peak < 32 << 20, "{peak}");

    // Nodes of three characters.
    let nodes = format!(r#"{{"nodes": [{}{{}}]}}"#, "{},".repeat(1 << 20));
    let limit = 256 << 20;
    let (imported, peak) = peak_of("nodes.gltf", nodes.as_bytes(), limit);
    assert!(imported.is_err() && peak as u64 <= limit, "{peak}");

    // A bomb by gzip, whose rows are there: 400,000 Gaussians in 26 kB.
    let mut bomb = GzEncoder::new(Vec::new(), Compression::best());
    bomb.write_all(&spz_head(3, 400_000)).unwrap();
    bomb.write_all(&vec![0; 400_000 * 65]).unwrap();
    let bomb = bomb.finish().unwrap();
    assert!(bomb.len() < 30_000, "{} bytes are not a bomb", bomb.len());
    let (imported, peak) = peak_of("bomb.spz", &bomb, 16 << 20);
    assert!(imported.unwrap_err().contains("MB is the limit"));
    assert!(peak < 17 << 20, "{peak}");

    // Announced rows that the file cannot hold, in 100 kB, by gzip and by zstd.
    let mut packed = GzEncoder::new(Vec::new(), Compression::default());
    packed.write_all(&spz_head(3, 16_000_000)).unwrap();
    let gzip = [packed.finish().unwrap(), vec![0; 100_000]].concat();
    let zeros = zstd::encode_all(&vec![0u8; 9 << 20][..], 19).unwrap();
    let mut zstd = [spz_head(4, 1 << 20), 32u32.to_le_bytes().to_vec(), vec![0; 12]].concat();
    for _ in 0..6 {
        zstd.extend((zeros.len() as u64).to_le_bytes());
        zstd.extend((9u64 << 20).to_le_bytes());
    }
    (0..6).for_each(|_| zstd.extend(&zeros));
    for (name, bytes) in [("gzip.spz", gzip), ("zstd.spz", zstd)] {
        let (imported, peak) = peak_of(name, &bytes, ImportLimits::default().max_bytes);
        assert!(imported.unwrap_err().contains("cannot unpack to"), "{name}");
        assert!(peak < 1 << 20, "{name}: {peak}");
    }
}
