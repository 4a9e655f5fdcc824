//! Tests of opening takes and loading segments: damaged, cut short, and changed while they play.

use std::path::PathBuf;

use codec::{ClipInfo, EncodeOptions, Field, SegmentPackage, Source, contents, encode, encode_take_head};
use glam::dvec3;
use tempfile::TempDir;

use super::*;
use crate::test_fields::{self, field, moving_field, room, y_up};

/// A clip of `count` Gaussians in a row from `x` on, in layers that end at `layers`.
fn clip(x: f32, count: usize, layers: &[usize]) -> Vec<u8> {
    let field = Field {
        centers: (0..count).map(|i| [x + i as f32, 0.0, 0.0]).collect(),
        rotations: vec![[1.0, 0.0, 0.0, 0.0]; count],
        log_scales: vec![[-2.0; 3]; count],
        opacities: vec![0.9; count],
        sh: vec![[0.3; 3]; count],
        ..Field::default()
    };
    let options = EncodeOptions { layers: layers.to_vec(), ..EncodeOptions::default() };
    encode(&Source { info: &ClipInfo::default(), field: &field, plate: None }, &options).unwrap()
}

/// A take of clips of a second each, one after the other.
fn take(clips: &[Vec<u8>]) -> Vec<u8> {
    take_with(&ClipInfo::default(), clips)
}

fn take_with(info: &ClipInfo, clips: &[Vec<u8>]) -> Vec<u8> {
    let limits = Limits::default();
    let heads: Vec<_> = clips.iter().map(|clip| contents(clip, &limits).unwrap()).collect();
    let starts = (0..).map(f64::from);
    let segments: Vec<_> = heads
        .iter()
        .zip(starts)
        .map(|(contents, start_s)| SegmentPackage { start_s, duration_s: 1.0, level: 0, contents })
        .collect();
    [encode_take_head(info, clips.len() as f64, &segments).unwrap(), clips.concat()].concat()
}

fn three() -> Vec<u8> {
    take(&[clip(0.0, 60, &[20]), clip(100.0, 50, &[]), clip(200.0, 70, &[30, 50])])
}

const DEMO: &[u8] = include_bytes!("../../../../assets/demo.aarc");

struct Written {
    path: PathBuf,
    _folder: TempDir,
}

fn written(bytes: &[u8]) -> Written {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.aarc");
    std::fs::write(&path, bytes).unwrap();
    Written { path, _folder: folder }
}

fn open(file: &Written) -> OpenTake {
    OpenTake::open(&file.path, &Limits::default()).unwrap()
}

/// Number of Gaussians of the first layers of a segment.
fn gaussians(opened: &OpenTake, segment: usize, layers: usize) -> Result<usize, Fault> {
    further(opened, segment, 0, layers)
}

/// Number of Gaussians of the layers of a segment behind the first `from`.
fn further(opened: &OpenTake, segment: usize, from: usize, layers: usize) -> Result<usize, Fault> {
    let loaded = opened.load(Want { segment, from, layers });
    let Loaded { packed, .. } = loaded.map_err(LoadError::into_fault)?;
    Ok(match packed {
        PackedWant::Segment(packed) if from == 0 => packed.gaussians(),
        PackedWant::Layers(packed) if from > 0 => packed.gaussians(),
        _ => panic!("first layers are a segment, others are not"),
    })
}

#[test]
fn segments_are_loaded_in_any_order_and_in_layers() {
    let file = written(&three());
    let opened = open(&file);
    assert_eq!((opened.layers(), opened.truncation()), (&[2, 1, 3][..], None));
    for (segment, layers, count) in [(2, 3, 70), (0, 1, 20), (1, 1, 50), (2, 2, 50), (0, 2, 60), (2, 1, 30)] {
        assert_eq!(gaussians(&opened, segment, layers).unwrap(), count, "{segment}, {layers}");
    }
    // Behind those that are there, only the others.
    for (segment, from, layers, count) in [(2, 1, 3, 40), (2, 2, 3, 20), (2, 1, 2, 20), (0, 1, 2, 40)] {
        let found = further(&opened, segment, from, layers).unwrap();
        assert_eq!(found, count, "{segment}, {from} to {layers}");
    }
    assert_eq!(opened.layer_ends(), [100, 160, 180]);
    // What holds an instant, the two after it, and a gap of the size of the largest.
    assert_eq!(opened.layout().room.total(), 180 + 70);
    let subject = opened.subject().unwrap();
    assert!((subject.ground.x - 9.5).abs() < 0.1, "by the first layer at the start: {subject:?}");
}

#[test]
fn a_take_without_viewpoints_opens_where_its_content_is_at_the_start() {
    // A person who walks 3 units in 2 seconds, in a room that is there twice, for a second each.
    let person = test_fields::person(dvec3(-1.5, 0.0, 0.0));
    let walk = test_fields::package(&y_up(), &moving_field(&person, dvec3(3.0, 0.0, 0.0)));
    let room = test_fields::package(&y_up(), &field(&room()));
    let heads = [&walk, &room, &room].map(|package| contents(package, &Limits::default()).unwrap());
    let spans = [(0.0, 2.0), (0.0, 1.0), (1.0, 1.0)];
    let segments: Vec<_> = spans
        .iter()
        .zip(&heads)
        .map(|(&(start_s, duration_s), contents)| SegmentPackage { start_s, duration_s, level: 0, contents })
        .collect();
    let head = encode_take_head(&y_up(), 2.0, &segments).unwrap();
    let mut bytes = [&head[..], &walk, &room, &room].concat();
    let opened = open(&written(&bytes));
    let [opening] = &opened.take.info.viewpoints[..] else { panic!("{:?}", opened.take.info) };
    assert!((opening.target[0] + 0.75).abs() < 0.2 && (opening.target[1] - 0.9).abs() < 0.1, "{opening:?}");
    let subject = opened.subject().unwrap();
    assert!((subject.ground - dvec3(-0.75, 0.0, 0.0)).length() < 0.2, "{subject:?}");
    assert!((subject.height_m - 1.8).abs() < 0.1 && subject.radius_m < 1.2, "{subject:?}");
    // What can be decoded counts, and the bounds where nothing can.
    bytes[head.len() + 200] ^= 1;
    let radius_m = open(&written(&bytes)).subject().unwrap().radius_m;
    // Between half of its sides and half of its diagonal, by the direction of the opening.
    assert!((3.0..5.7).contains(&radius_m), "of the room: {radius_m} m");
    bytes[head.len() + walk.len() + 200] ^= 1;
    let framed = codec::Viewpoint::framing(opened.take.bounds, y_up().up);
    assert_eq!(open(&written(&bytes)).take.info.viewpoints, [framed]);
}

/// A server that sends `head` of a file of `length` bytes, and then is silent.
#[cfg(all(feature = "net", feature = "xr"))]
fn silent_server(head: Vec<u8>, length: usize) -> String {
    use std::io::{Read as _, Write as _};
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    std::thread::spawn(move || {
        // Held open.
        let mut streams = Vec::new();
        for stream in listener.incoming() {
            let mut stream = stream.unwrap();
            let _ = stream.read(&mut [0; 4096]);
            if streams.is_empty() {
                let fields = format!("Content-Length: {length}\r\nETag: \"a\"");
                write!(stream, "HTTP/1.1 200 OK\r\n{fields}\r\n\r\n").unwrap();
                stream.write_all(&head).unwrap();
            }
            streams.push(stream);
        }
    });
    format!("http://{address}/a.aarc")
}

#[test]
#[cfg(all(feature = "net", feature = "xr"))]
fn nobody_waits_for_the_subject_of_a_take_whose_server_is_silent() {
    use std::time::{Duration, Instant};

    use crate::content::Download;
    let clips = [clip(0.0, 60, &[20]), clip(100.0, 50, &[])];
    let info = ClipInfo {
        viewpoints: vec![codec::Viewpoint::framing([[0.0; 3], [1.0; 3]], [0.0, 1.0, 0.0])],
        ..ClipInfo::default()
    };
    let bytes = take_with(&info, &clips);
    let head = bytes[..bytes.len() - clips.concat().len()].to_vec();
    let url = silent_server(head, bytes.len());
    let opened = Download::new(&url, Default::default()).find_map(|event| match event.unwrap() {
        super::super::OpenEvent::Take(take) => Some(take),
        _ => None,
    });
    let (opened, start) = (opened.expect("its head is there"), Instant::now());
    let is_overtaken = || start.elapsed() > Duration::from_millis(200);
    let cancelled = opened.subject_unless(&is_overtaken).unwrap_err();
    assert!(start.elapsed() < Duration::from_secs(5), "{cancelled}: {:?}", start.elapsed());
    // What was not read is not known, and is no longer read.
    assert!(opened.subject().is_err());
    assert!(start.elapsed() < Duration::from_secs(5), "{:?}", start.elapsed());
}

#[test]
fn a_clip_is_the_only_segment() {
    let file = written(&clip(0.0, 60, &[20]));
    let opened = open(&file);
    assert_eq!((opened.layers(), opened.layer_ends()), (&[2][..], vec![20, 60]));
    assert!(opened.is_static() && !open(&written(DEMO)).is_static());
    // It has room for nothing else.
    let layout = opened.layout();
    assert_eq!((layout.room.static_count, layout.room.dynamic_count), (60, 0));
    assert!(!layout.features.segmented && layout.features.motion.is_none());
    // What was decoded to open it is loaded once, whole.
    let want = Want { segment: 0, from: 0, layers: 1 };
    for (layers, count) in [(2, 60), (1, 20)] {
        let Loaded { want, packed: PackedWant::Segment(packed), .. } = opened.load(want).unwrap() else {
            panic!("it is a segment")
        };
        assert_eq!((want.layers, packed.gaussians()), (layers, count));
    }
    assert_eq!(further(&opened, 0, 1, 2).unwrap(), 40);
}

#[test]
fn a_clip_that_is_cut_short_or_damaged_says_so() {
    let all = codec::contents(DEMO, &Limits::default()).unwrap().layer_bytes();
    let note = |bytes: usize| open(&written(&DEMO[..bytes])).truncation();
    assert_eq!(note(DEMO.len()), None);
    for bytes in [all[0], all[0] + 1, all[1] - 1] {
        let note = note(bytes).unwrap();
        assert!(
            note.ends_with(&format!("cut short, 1 of {} layers play: copy it again for the rest", all.len()))
        );
    }
    let mut damaged = DEMO.to_vec();
    *damaged.last_mut().unwrap() ^= 1;
    let cut = &DEMO[..all[0] - 1];
    for (bytes, why) in [(&damaged[..], "CRC-32"), (cut, "cut short before its first layer")] {
        let file = written(bytes);
        let fault = OpenTake::open(&file.path, &Limits::default()).unwrap_err();
        let text = fault.to_string();
        assert!(matches!(fault, Fault::Data(_)) && text.contains(why), "{text}");
        assert!(text.contains("a.aarc: ") && text.ends_with("copy it again"), "{text}");
    }
}

#[test]
fn a_file_of_another_format_has_a_next_step() {
    let folder = tempfile::tempdir().unwrap();
    for (name, step) in
        [("a.PLY", "of this field"), ("a.aarc", "that aarc-studio package made"), ("a", "made")]
    {
        let path = folder.path().join(name);
        std::fs::write(&path, b"ply\nformat binary_little_endian 1.0\n").unwrap();
        let text = OpenTake::open(&path, &Limits::default()).unwrap_err().to_string();
        assert!(text.contains("not an .aarc package: ") && text.contains(step), "{text}");
    }
    let pointer = folder.path().join("b.aarc");
    std::fs::write(&pointer, b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 9\n").unwrap();
    let text = OpenTake::open(&pointer, &Limits::default()).unwrap_err().to_string();
    assert!(text.contains("b.aarc: a pointer of Git LFS"), "{text}");
    for path in [folder.path().to_owned(), folder.path().join("none.aarc")] {
        let fault = OpenTake::open(&path, &Limits::default()).unwrap_err();
        assert!(matches!(&fault, Fault::Data(text) if text.starts_with(&path.display().to_string())));
    }
}

#[test]
fn bad_takes_are_refused_with_one_sentence() {
    let whole = three();
    let mut damaged = whole.clone();
    damaged[90] ^= 1;
    let longer = [&whole[..], b"x"].concat();
    let small = Limits { max_gaussians: 69, ..Limits::default() };
    for (bytes, limits, why) in [
        (&damaged[..], Limits::default(), "copy it again"),
        (&longer[..], Limits::default(), "1 extra bytes after the last segment"),
        (&whole[..100], Limits::default(), "copy it again"),
        (&whole[..codec_head(&whole)], Limits::default(), "cut short before its first layer"),
        (&whole[..], small, "70 Gaussians at one instant, and at most 69"),
        (&whole[..], Limits { max_bytes: 1500, ..Limits::default() }, "smaller --budget"),
    ] {
        let file = written(bytes);
        let fault = OpenTake::open(&file.path, &limits).unwrap_err();
        let text = fault.to_string();
        assert!(matches!(fault, Fault::Data(_)) && text.contains(why) && text.contains("a.aarc: "), "{text}");
    }
}

#[test]
fn a_long_file_with_bytes_after_its_end_is_refused() {
    let clips: Vec<Vec<u8>> = (0..200).map(|i| clip(i as f32, 900, &[])).collect();
    let mut bytes = take(&clips);
    assert!(bytes.len() > 2 * HEAD_BYTES, "its end is not read with its head");
    assert_eq!(open(&written(&bytes)).layers(), [1; 200]);
    bytes.extend_from_slice(b"more");
    let text = OpenTake::open(&written(&bytes).path, &Limits::default()).unwrap_err().to_string();
    assert!(text.contains("4 extra bytes after the last segment"), "{text}");
}

/// Length of the head of a take.
fn codec_head(bytes: &[u8]) -> usize {
    package(bytes, &Limits::default()).unwrap().head_bytes
}

#[test]
fn of_a_file_that_is_cut_short_whole_layers_play() {
    let whole = three();
    let last = open(&written(&whole)).take.segments[2].clone();
    let cut = last.offset as usize + last.layers[1].bytes;
    for (length, layers) in [(cut, [2, 1, 2]), (cut - 1, [2, 1, 1]), (last.offset as usize + 1, [2, 1, 0])] {
        let file = written(&whole[..length]);
        let opened = open(&file);
        assert_eq!(opened.layers(), layers);
        let note = opened.truncation().unwrap();
        assert!(note.ends_with("2 of 3 segments are whole: copy it again for the rest"), "{note}");
        for (segment, &layers) in layers.iter().enumerate().filter(|(_, layers)| **layers > 0) {
            assert!(gaussians(&opened, segment, layers).is_ok(), "{segment}");
        }
    }
}

#[test]
fn a_damaged_segment_is_refused_alone() {
    let mut bytes = three();
    let middle = open(&written(&bytes)).take.segments[1].clone();
    let at = middle.offset as usize + middle.bytes() - 20;
    bytes[at] ^= 0x40;
    let file = written(&bytes);
    let opened = open(&file);
    let text = gaussians(&opened, 1, 1).unwrap_err().to_string();
    assert!(text.contains("a.aarc: segment 1, at 1.000 s: ") && text.contains("copy it again"), "{text}");
    assert!(gaussians(&opened, 0, 2).is_ok() && gaussians(&opened, 2, 3).is_ok());
    // If the last layer of a segment is damaged, the layers before it are loaded.
    let mut bytes = three();
    *bytes.last_mut().unwrap() ^= 1;
    let file = written(&bytes);
    let opened = open(&file);
    assert_eq!(further(&opened, 2, 1, 2).unwrap(), 20);
    let text = further(&opened, 2, 2, 3).unwrap_err().to_string();
    assert!(text.contains("a.aarc: segment 2, at 2.000 s: ") && text.contains("copy it again"), "{text}");
}

#[test]
fn a_file_that_changes_while_it_plays_is_noticed() {
    let file = written(&three());
    let opened = open(&file);
    // Other clips in its place, of the same lengths or not.
    let other = take(&[clip(5.0, 60, &[20]), clip(105.0, 50, &[]), clip(205.0, 70, &[30, 50])]);
    for bytes in [&other[..], &vec![0; other.len()], &other[..other.len() / 2], b""] {
        std::fs::write(&file.path, bytes).unwrap();
        let text = gaussians(&opened, 2, 3).unwrap_err().to_string();
        assert!(text.contains("segment 2, at 2.000 s: ") && text.contains("open it again"), "{text}");
    }
    std::fs::write(&file.path, three()).unwrap();
    assert!(gaussians(&opened, 2, 3).is_ok(), "the same again");
}

#[test]
#[cfg(unix)]
fn what_cannot_be_read_is_no_damage() {
    let mut bytes = three();
    *bytes.last_mut().unwrap() ^= 1;
    let file = written(&bytes);
    let mut opened = open(&file);
    let want = |segment, layers| Want { segment, from: 0, layers };
    // A folder opens as a file does, and cannot be read.
    let folder = TakeSource::open(file.path.parent().unwrap()).unwrap();
    let source = std::mem::replace(&mut opened.source, folder);
    assert!(matches!(opened.load(want(0, 2)), Err(LoadError::Unread(Fault::Data(_)))));
    opened.source = source;
    assert!(opened.load(want(0, 2)).is_ok());
    assert!(matches!(opened.load(want(2, 3)), Err(LoadError::Damaged(Fault::Data(_)))));
}
