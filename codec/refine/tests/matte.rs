//! Mattes of composites: the knight of ../shared/data/stage-knight walks through real rooms, from the videos of
//! ../shared/data/pose2sim-4cam, with noise, a shadow, flicker, and JPEG. Skipped, visibly, without the data or ffmpeg.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use image::RgbImage;
use image::codecs::jpeg::JpegEncoder;
use refine::matte::Plate;

const WIDTH: usize = 512;
const HEIGHT: usize = 375;

/// Pictures of a clip, and every how many of them a matte is made.
const FRAMES: usize = 33;
const STEP: usize = 4;

/// A part of a video from this row on, the knight's camera, and the standard deviation of the noise.
const SCENES: [(&str, u32, &str, f64); 6] = [
    ("cam01.mp4", 300, "00", 2.0),
    ("cam02.mp4", 500, "07", 3.0),
    ("cam03.mp4", 500, "19", 4.0),
    ("cam04.mp4", 700, "28", 2.0),
    ("cam03.mp4", 1000, "04", 3.0),
    ("cam02.mp4", 120, "24", 4.0),
];

fn data(path: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data").join(path);
    if !path.exists() {
        println!("skipped: no {}", path.display());
    }
    path.exists().then_some(path)
}

/// A part of the first frame of a video.
fn room(video: &str, top: u32) -> Option<Vec<[u8; 3]>> {
    let path = data("pose2sim-4cam/Single")?.join(video);
    let filter = format!("crop=1080:791:0:{top},scale={WIDTH}:{HEIGHT}:flags=area");
    let output = Command::new("ffmpeg")
        .args(["-nostdin", "-v", "error", "-i"])
        .arg(path)
        .args(["-frames:v", "1", "-vf", &filter, "-pix_fmt", "rgb24", "-f", "rawvideo", "-"])
        .output();
    let output = output.map_err(|error| println!("skipped: ffmpeg: {error}")).ok()?;
    assert_eq!(output.stdout.len(), WIDTH * HEIGHT * 3, "{}", String::from_utf8_lossy(&output.stderr));
    Some(output.stdout.as_chunks().0.to_vec())
}

/// Colours times alpha, and alpha, of the pixels of a picture.
type Layer = Vec<([u8; 3], u8)>;

/// The knight in the frames of a camera.
fn knight(camera: &str) -> Option<Vec<Layer>> {
    let folder = data("stage-knight")?;
    let masked = |frame: usize| {
        let read = |kind: &str| image::open(folder.join(format!("{kind}/{camera}/{frame:06}.png"))).unwrap();
        let (colors, mask) = (read("images").into_rgb8(), read("masks").into_luma8());
        colors.pixels().map(|p| p.0).zip(mask.pixels().map(|p| p.0[0])).collect()
    };
    Some((0..FRAMES).map(masked).collect())
}

/// A composite: the subject before the room, how many pixels to the right, how bright all of it is.
struct Composite<'a> {
    room: &'a [[u8; 3]],
    knight: &'a [([u8; 3], u8)],
    shift: isize,
    gain: f64,
    sigma: f64,
    seed: u64,
}

impl Composite<'_> {
    /// The knight's pixel that is at one of the composite.
    fn at(&self, x: usize, y: usize) -> ([u8; 3], u8) {
        let from = x.checked_add_signed(-self.shift).filter(|from| *from < WIDTH);
        from.and_then(|from| self.knight.get(y * WIDTH + from)).copied().unwrap_or_default()
    }

    fn alpha(&self) -> Vec<u8> {
        (0..WIDTH * HEIGHT).map(|i| self.at(i % WIDTH, i / WIDTH).1).collect()
    }

    /// What is left of light in the shadow, an ellipse below the feet that takes 30 %, with a soft edge.
    fn shade(&self, x: usize, y: usize, feet: usize) -> f64 {
        let across = (x as f64 - self.shift as f64 - 270.0) / 90.0;
        let down = (y as f64 - feet as f64) / 22.0;
        1.0 - 0.3 * ((1.0 - across.hypot(down)) * 8.0).clamp(0.0, 1.0)
    }

    /// The picture, after JPEG of quality 85.
    fn picture(&self) -> Vec<[u8; 3]> {
        let mut random = fastrand::Rng::with_seed(self.seed);
        // The sum of 12 uniform numbers has a standard deviation of 1.
        let mut noise = || self.sigma * ((0..12).map(|_| random.f64()).sum::<f64>() - 6.0);
        let feet = self.knight.iter().rposition(|(_, alpha)| *alpha > 127).map(|i| i / WIDTH);
        let mut bytes = Vec::with_capacity(3 * WIDTH * HEIGHT);
        for (i, behind) in self.room.iter().enumerate() {
            let (x, y) = (i % WIDTH, i / WIDTH);
            let (color, alpha) = self.at(x, y);
            let shade = feet.map_or(1.0, |feet| self.shade(x, y, feet));
            for c in 0..3 {
                let behind = f64::from(behind[c]) * shade * (1.0 - f64::from(alpha) / 255.0);
                let value = self.gain * (f64::from(color[c]) + behind) + noise();
                bytes.push(value.round().clamp(0.0, 255.0) as u8);
            }
        }
        let picture = RgbImage::from_raw(WIDTH as u32, HEIGHT as u32, bytes).unwrap();
        let mut jpeg = Vec::new();
        JpegEncoder::new_with_quality(&mut jpeg, 85).encode_image(&picture).unwrap();
        image::load_from_memory(&jpeg).unwrap().into_rgb8().pixels().map(|p| p.0).collect()
    }
}

/// Intersection over union of the pixels with an alpha of 128 or more.
fn iou(found: &[u8], truth: &[u8]) -> f64 {
    let pixels = || found.iter().zip(truth).map(|(a, b)| (*a >= 128, *b >= 128));
    pixels().filter(|(a, b)| *a && *b).count() as f64 / pixels().filter(|(a, b)| *a || *b).count() as f64
}

/// Mean absolute error of alpha, from 0 to 1, in the pixels on both sides of the truth's outline.
fn edge_error(found: &[u8], truth: &[u8]) -> f64 {
    let differs = |i: usize, j: usize| truth.get(j).is_some_and(|a| (*a >= 128) != (truth[i] >= 128));
    let is_edge = |i: &usize| {
        let i = *i;
        [i.wrapping_sub(1), i + 1, i.wrapping_sub(WIDTH), i + WIDTH].into_iter().any(|j| differs(i, j))
    };
    let edges: Vec<usize> = (0..truth.len()).filter(is_edge).collect();
    edges.iter().map(|i| f64::from(found[*i].abs_diff(truth[*i])) / 255.0).sum::<f64>() / edges.len() as f64
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

#[test]
fn mattes_of_a_walking_knight_are_right() {
    let mut all = Vec::new();
    for (number, (video, top, camera, sigma)) in SCENES.into_iter().enumerate() {
        let (Some(room), Some(knight)) = (room(video, top), knight(camera)) else { return };
        let composite = |i: usize| Composite {
            room: &room,
            knight: &knight[i],
            shift: 12 * i as isize - 192,
            gain: 1.0 + 0.03 * (1.7 * i as f64).sin(),
            sigma,
            seed: (100 * number + i) as u64,
        };
        let pictures: Vec<Vec<[u8; 3]>> = (0..FRAMES).map(|i| composite(i).picture()).collect();
        let clean = Composite { knight: &[], gain: 1.02, seed: 9, ..composite(0) }.picture();
        for (kind, plate) in [
            ("median", Plate::from_pictures(&pictures, WIDTH)),
            ("picture", Plate::from_pictures(&[clean], WIDTH)),
        ] {
            let (mut ious, mut errors, mut milliseconds) = (Vec::new(), Vec::new(), Vec::new());
            for i in (0..FRAMES).step_by(STEP) {
                let start = Instant::now();
                let matte = plate.matte(&pictures[i]);
                milliseconds.push(1e3 * start.elapsed().as_secs_f64());
                let truth = composite(i).alpha();
                ious.push(iou(&matte, &truth));
                errors.push(edge_error(&matte, &truth));
            }
            let least = ious.iter().copied().fold(1.0, f64::min);
            println!(
                "{video} {top}, camera {camera}, noise {sigma}, plate of the {kind:7}: IoU {:.4}, at least {least:.4}; edges \
                 off by {:.3}; {:.1} ms",
                mean(&ious),
                mean(&errors),
                mean(&milliseconds)
            );
            assert!(mean(&ious) > 0.96 && least > 0.9, "{video}, {kind}: {ious:?}");
            assert!(mean(&errors) < 0.2, "{errors:?}");
            all.extend(ious);
        }
    }
    println!("IoU of all {:.4}", mean(&all));
    assert!(mean(&all) > 0.978);
}

#[test]
fn a_knight_that_stays_is_part_of_the_plate() {
    let (Some(room), Some(knight)) = (room("cam01.mp4", 300), knight("00")) else { return };
    let composite =
        |seed: u64| Composite { room: &room, knight: &knight[0], shift: 0, gain: 1.0, sigma: 3.0, seed };
    let pictures: Vec<Vec<[u8; 3]>> = (0..9).map(|seed| composite(seed).picture()).collect();
    let matte = Plate::from_pictures(&pictures, WIDTH).matte(&pictures[4]);
    let found = matte.iter().filter(|alpha| **alpha >= 128).count();
    assert_eq!(found, 0);
}
