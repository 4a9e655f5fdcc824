//! Fitted fields in every importable format.

use std::io::{Cursor, Read, Write};

use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use codec::Field;
use formats::{write_field_file, write_glb, write_splatv, write_spz, write_static_ply};
use image::{ImageFormat, Rgba, RgbaImage};

use super::{Seed, field, info, seed};
use crate::kinds::import::{FILE, FRAME, GLTF, KSPLAT, SOG_IMAGE, SOG_META, SPLAT};

/// Inputs of the target `import`.
pub fn fields() -> Vec<Seed> {
    let fixed = Field { temporal: None, ..field(0) };
    let colored = Field { sh_degree: 1, sh: vec![[0.1, 0.2, 0.3]; 16], ..fixed.clone() };
    let packed = write_spz(&colored, [0.0, 1.0, 0.0]);
    let mut plain = Vec::new();
    flate2::read::GzDecoder::new(&packed[..]).read_to_end(&mut plain).expect("our own file");
    let mut dynamic = write_splatv(&field(3), &info());
    // The unused rest of the texture's line.
    dynamic.truncate(dynamic.len() - (1024 - 4) * 64);
    let mut seeds = vec![
        seed("field-file.ply", FILE, &write_field_file(&field(2), &info())),
        seed("static.ply", FILE, &write_static_ply(&colored, None)),
        seed("ascii.ply", FILE, &ascii_ply(INRIA, "1 2 3 0.1 0.2 0.3 0 -1 -2 -3 0 2 0 0")),
        seed("spacetime.ply", FILE, &spacetime_ply()),
        seed("compressed.ply", FILE, &compressed_ply()),
        seed("gzip.spz", FILE, &packed),
        seed("v3.spz", FILE, &plain),
        seed("v4.spz", FILE, &spz_v4(&plain)),
        seed("dynamic.splatv", FILE, &dynamic),
        seed(
            "static.splat",
            SPLAT,
            &[&[0; 12][..], &[0x3c; 12], &[9, 99, 199, 255, 255, 128, 128, 128]].concat(),
        ),
        seed("bundle.sog", FILE, &bundle()),
        seed("freetime.ply", FILE, &freetime_ply()),
        seed("binary.glb", FILE, &write_glb(&colored, &info()).expect("a small file")),
        seed("text.gltf", GLTF, &gltf(&write_glb(&fixed, &info()).expect("a small file"))),
        seed("plain.ksplat", KSPLAT, &ksplat()),
        seed("frame.ply", FRAME, &one_gaussian()),
        seed("frames.ply", FRAME, &write_static_ply(&fixed, None)),
    ];
    for (i, (name, bytes)) in sog_files().iter().enumerate() {
        seeds.push(match i.checked_sub(1) {
            None => seed(name, SOG_META, bytes),
            Some(which) => seed(name, SOG_IMAGE, &[&[which as u8][..], bytes].concat()),
        });
    }
    seeds
}

const INRIA: &str = "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";

const SPACETIME: &str = "trbf_center trbf_scale motion_0 motion_1 motion_2 motion_3 motion_4 motion_5 motion_6 \
                         motion_7 motion_8 omega_0 omega_1 omega_2 omega_3";

fn properties(kind: &str, names: &str) -> String {
    names.split(' ').map(|name| format!("property {kind} {name}\n")).collect()
}

fn ascii_ply(names: &str, row: &str) -> Vec<u8> {
    let properties = properties("float", names);
    format!("ply\nformat ascii 1.0\nelement vertex 1\n{properties}end_header\n{row}\n").into_bytes()
}

fn spacetime_ply() -> Vec<u8> {
    let row = "0 0 0  1 0 0.5  0  0 0 0  2 0 0 0   0.25 0  1 2 3 4 5 6 7 8 9  0 0.2 0 0";
    ascii_ply(&format!("{INRIA} {SPACETIME}"), row)
}

fn freetime_ply() -> Vec<u8> {
    let row = "0 0 0  1 0 0.5  0  0 0 0  2 0 0 0   1 2 3  0.25 0.5";
    ascii_ply(&format!("{INRIA} vx vy vz time duration"), row)
}

/// A static field of one Gaussian.
pub(crate) fn one_gaussian() -> Vec<u8> {
    ascii_ply(INRIA, "1 2 3 0.1 0.2 0.3 0 -1 -2 -3 0 2 0 0")
}

/// The text of a binary glTF, with its buffer in itself.
fn gltf(glb: &[u8]) -> Vec<u8> {
    let length = u32::from_le_bytes([glb[12], glb[13], glb[14], glb[15]]) as usize;
    let mut document: serde_json::Value =
        serde_json::from_slice(&glb[20..20 + length]).expect("our own file");
    let buffer = BASE64_STANDARD.encode(&glb[28 + length..]);
    document["buffers"][0]["uri"] = format!("data:application/octet-stream;base64,{buffer}").into();
    document.to_string().into_bytes()
}

/// A `.ksplat` of one Gaussian, without compression.
fn ksplat() -> Vec<u8> {
    let mut bytes = vec![0; 4096 + 1024];
    let words = [(4, 1), (16, 1), (4096, 1), (4096 + 4, 1), (4096 + 8, 1), (4096 + 12, 1), (4096 + 32, 1)];
    for (at, word) in words {
        bytes[at..at + 4].copy_from_slice(&u32::to_le_bytes(word));
    }
    (bytes[1], bytes[4096 + 20]) = (1, 12);
    let numbers = [0f32, 0.0, 0.0, 1.0, 2.0, 3.0, 0.1, 0.1, 0.2, 1.0, 0.0, 0.0, 0.0];
    bytes.extend(numbers.map(f32::to_le_bytes).as_flattened());
    bytes.extend([9, 99, 199, 255]);
    bytes
}

fn compressed_ply() -> Vec<u8> {
    let chunk = "min_x min_y min_z max_x max_y max_z min_scale_x min_scale_y min_scale_z max_scale_x max_scale_y \
                 max_scale_z min_r min_g min_b max_r max_g max_b";
    let vertex = "packed_position packed_rotation packed_scale packed_color";
    let head = format!(
        "ply\nformat binary_little_endian 1.0\nelement chunk 1\n{}element vertex 2\n{}end_header\n",
        properties("float", chunk),
        properties("uint", vertex)
    );
    let range = [
        -1.0f32, -1.0, -1.0, 1.0, 1.0, 1.0, -6.0, -6.0, -6.0, -2.0, -2.0, -2.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0,
    ];
    let range = range.map(f32::to_le_bytes);
    [head.as_bytes(), range.as_flattened(), &[0x55; 16], &[0xa3; 16]].concat()
}

/// Converts a file of version 3 to version 4: a longer head, and each array compressed by itself.
fn spz_v4(plain: &[u8]) -> Vec<u8> {
    let strides = [9, 1, 3, 3, 4, 9];
    let mut arrays = &plain[16..];
    let streams = strides.map(|stride| {
        let (array, rest) = arrays.split_at(4 * stride);
        arrays = rest;
        (array.len(), zstd::bulk::compress(array, 1).expect("memory for a small frame"))
    });
    let mut file = plain[..16].to_vec();
    file[4] = 4;
    file[15] = strides.len() as u8;
    file.extend(32u32.to_le_bytes());
    file.resize(32, 0);
    for (length, stream) in &streams {
        file.extend((stream.len() as u64).to_le_bytes());
        file.extend((*length as u64).to_le_bytes());
    }
    streams.iter().for_each(|(_, stream)| file.extend(stream));
    file
}

/// The files of a SOG of two Gaussians, `meta.json` first.
pub(crate) fn sog_files() -> Vec<(&'static str, Vec<u8>)> {
    let image = |width: u32, height: u32, pixel: [u8; 4]| {
        let mut bytes = Cursor::new(Vec::new());
        let image = RgbaImage::from_pixel(width, height, Rgba(pixel));
        image.write_to(&mut bytes, ImageFormat::Png).expect("memory");
        bytes.into_inner()
    };
    let table = |low: f32, step: f32| (0..256).map(|k| low + step * k as f32).collect::<Vec<f32>>();
    let meta = serde_json::json!({
        "version": 2, "count": 2,
        "means": {"mins": [-1, -1, 0], "maxs": [1, 2, 0], "files": ["means_l", "means_u"]},
        "scales": {"codebook": table(-10.0, 0.0625), "files": ["scales"]},
        "quats": {"files": ["quats"]},
        "sh0": {"codebook": table(-2.0, 0.015625), "files": ["sh0"]},
        "shN": {"count": 64, "bands": 1, "codebook": table(-1.0, 0.0078125), "files": ["centroids", "labels"]},
    });
    vec![
        ("meta.json", meta.to_string().into_bytes()),
        ("means_l", image(2, 1, [9, 99, 199, 255])),
        ("means_u", image(2, 1, [3, 5, 7, 255])),
        ("scales", image(2, 1, [16, 32, 64, 255])),
        ("quats", image(2, 1, [255, 128, 128, 252])),
        ("sh0", image(2, 1, [10, 128, 250, 51])),
        ("centroids", image(64 * 3, 1, [1, 2, 3, 255])),
        ("labels", image(2, 1, [5, 0, 0, 255])),
    ]
}

fn bundle() -> Vec<u8> {
    let mut archive = zip::ZipWriter::new(Cursor::new(Vec::new()));
    for (name, bytes) in sog_files() {
        let stored =
            zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
        archive.start_file(name, stored).expect("memory");
        archive.write_all(&bytes).expect("memory");
    }
    archive.finish().expect("memory").into_inner()
}
