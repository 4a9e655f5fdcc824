//! Depth maps on disk: a folder of PNG, PFM or NPY files with the names of the photographs, as
//! `xtask/CAPTURE.md` specifies.
//!
//! PFM and NPY are a short header and a block of values each; crates for them would add more code than
//! these readers.

use std::path::Path;

use codec::Camera;
use half::f16;
use image::DynamicImage;
use program::Fault;
use refine::anchor::DepthMap;
use refine::capture::{CalibratedCamera, Lens, PhotoId};

use super::capture_files::CaptureFiles;
use super::image_file::{bad_layout, read, read_bytes};
use crate::messages::unreadable;

/// Depth of one step of a 16-bit image, in units of the capture.
const PNG_STEP: f32 = 1e-3;

/// Maximum side of a map, and maximum size of a file: a map of that side in doubles.
const SIDE_MAX: usize = 1 << 14;
const BYTES_MAX: u64 = (8 * SIDE_MAX * SIDE_MAX + (1 << 16)) as u64;

impl CaptureFiles {
    /// Reads the depth map of a photograph from `folder`: `NAME.png`, `.pfm` or `.npy`, with the
    /// photograph's name. Lens distortion is removed as from the photograph. `None` if there is no such file.
    ///
    /// # Errors
    /// [`Fault::Data`] that names the file and the problem.
    ///
    /// # Panics
    /// If the capture has no such photograph.
    pub fn depth(&self, folder: &Path, photo_id: PhotoId) -> Result<Option<DepthMap>, Fault> {
        let CalibratedCamera { camera, lens, .. } = &self.capture.cameras[photo_id.camera];
        for (ending, read) in [("png", png as fn(&Path) -> _), ("pfm", pfm), ("npy", npy)] {
            let path = folder.join(format!("{}.{ending}", self.name(photo_id)));
            if path.is_file() {
                let map = read(&path)?;
                return Ok(Some(if lens.is_none() { map } else { undistorted(&map, camera, lens) }));
            }
        }
        Ok(None)
    }
}

fn png(path: &Path) -> Result<DepthMap, Fault> {
    match read(path)? {
        DynamicImage::ImageLuma16(image) => Ok(DepthMap {
            width: image.width(),
            height: image.height(),
            depths: image.pixels().map(|pixel| f32::from(pixel.0[0]) * PNG_STEP).collect(),
        }),
        other => {
            let is = format!("its pixels are {:?}", other.color());
            Err(bad_layout(path, format!("{is}: depths are 16-bit grey, in thousandths")))
        }
    }
}

/// A checked map of values whose rows run from the top, or else from the bottom.
fn depth_map(
    path: &Path,
    [width, height]: [usize; 2],
    depths: Vec<f32>,
    from_top: bool,
) -> Result<DepthMap, Fault> {
    if [width, height].iter().any(|side| !(1..=SIDE_MAX).contains(side)) {
        return Err(bad_layout(path, format!("{width}x{height} values: a side can have 1 to {SIDE_MAX}")));
    }
    if depths.len() != width * height {
        let (len, expected) = (depths.len(), width * height);
        return Err(bad_layout(path, format!("it holds {len} values, but {width}x{height} need {expected}")));
    }
    let depths = match from_top {
        true => depths,
        false => depths.chunks(width).rev().flatten().copied().collect(),
    };
    Ok(DepthMap { width: width as u32, height: height as u32, depths })
}

fn bytes_of(path: &Path) -> Result<Vec<u8>, Fault> {
    let size = path.metadata().map_err(|error| unreadable(path, &error))?.len();
    if size > BYTES_MAX {
        return Err(bad_layout(path, format!("{size} bytes are more than a depth map has")));
    }
    read_bytes(path)
}

/// Decodes values of `N` bytes; a partial last value is ignored.
fn values<const N: usize>(bytes: &[u8], value: impl Fn([u8; N]) -> f32) -> Vec<f32> {
    bytes.as_chunks::<N>().0.iter().map(|bytes| value(*bytes)).collect()
}

/// Reads a portable float map (Debevec): "Pf", width, height and a scale that is negative for little endian,
/// each followed by one white space; then rows from the bottom.
fn pfm(path: &Path) -> Result<DepthMap, Fault> {
    let bytes = bytes_of(path)?;
    let mut rest = bytes.as_slice();
    let mut words: [&str; 4] = [""; 4];
    for word in &mut words {
        let end = rest.iter().take(32).position(u8::is_ascii_whitespace);
        let text = end.and_then(|end| std::str::from_utf8(&rest[..end]).ok());
        *word = text.ok_or_else(|| bad_layout(path, "no PFM file: its head does not end"))?;
        rest = &rest[word.len() + 1..];
    }
    let [kind, width, height, scale] = words;
    if kind != "Pf" {
        return Err(bad_layout(
            path,
            format!("no PFM file of one channel: it starts with \"{}\"", kind.escape_default()),
        ));
    }
    let (Ok(width), Ok(height), Ok(scale)) = (width.parse(), height.parse(), scale.parse::<f32>()) else {
        return Err(bad_layout(path, "no PFM file: its head is not two sizes and a scale"));
    };
    let depths = match scale < 0.0 {
        true => values(rest, f32::from_le_bytes),
        false => values(rest, f32::from_be_bytes),
    };
    depth_map(path, [width, height], depths, false)
}

/// Encodes a map as PFM, in little endian.
#[cfg(feature = "onnx")]
pub fn pfm_file(map: &DepthMap) -> Vec<u8> {
    let rows = map.depths.chunks(map.width as usize).rev();
    let values = rows.flatten().flat_map(|depth| depth.to_le_bytes());
    format!("Pf\n{} {}\n-1.0\n", map.width, map.height).into_bytes().into_iter().chain(values).collect()
}

/// Reads NumPy's format, versions 1 to 3: a header with type and shape as a Python dictionary, then the
/// values.
fn npy(path: &Path) -> Result<DepthMap, Fault> {
    let bytes = bytes_of(path)?;
    let (head, body) =
        npy_parts(&bytes).ok_or_else(|| bad_layout(path, "no NPY file, or one that is cut off"))?;
    let value = |key: &str| head.split_once(&format!("'{key}':")).map(|(_, rest)| rest.trim_start());
    if value("fortran_order").is_none_or(|order| !order.starts_with("False")) {
        return Err(bad_layout(path, "its values are not in C order: save numpy.ascontiguousarray of them"));
    }
    let shape =
        value("shape").and_then(|rest| rest.strip_prefix('(')?.split_once(')')).map(|(shape, _)| shape);
    let sides: Option<Vec<usize>> = shape.and_then(|shape| {
        shape
            .split(',')
            .map(str::trim)
            .filter(|side| !side.is_empty())
            .map(|side| side.parse().ok())
            .collect()
    });
    // Drops batch and channel dimensions of 1; a map with a side of 1 keeps it.
    let sides = sides.ok_or_else(|| bad_layout(path, "its head has no shape"))?;
    let long: Vec<usize> = sides.iter().copied().filter(|side| *side != 1).collect();
    let [height, width] = match (&sides[..], &long[..]) {
        ([height, width], _) | (_, [height, width]) => [*height, *width],
        _ => {
            return Err(bad_layout(
                path,
                format!("its shape is {sides:?}: a depth map has height and width"),
            ));
        }
    };
    let depths = match value("descr").and_then(|rest| rest.strip_prefix('\'')?.split('\'').next()) {
        Some("<f2") => values(body, |b| f16::from_le_bytes(b).to_f32()),
        Some(">f2") => values(body, |b| f16::from_be_bytes(b).to_f32()),
        Some("<f4") => values(body, f32::from_le_bytes),
        Some(">f4") => values(body, f32::from_be_bytes),
        Some("<f8") => values(body, |b| f64::from_le_bytes(b) as f32),
        Some(">f8") => values(body, |b| f64::from_be_bytes(b) as f32),
        other => {
            let is = other.unwrap_or("unknown").escape_default();
            return Err(bad_layout(
                path,
                format!("its type is {is}: depths are float16, float32 or float64"),
            ));
        }
    };
    depth_map(path, [width, height], depths, true)
}

fn npy_parts(bytes: &[u8]) -> Option<(&str, &[u8])> {
    let (version, rest) = bytes.strip_prefix(b"\x93NUMPY")?.split_at_checked(2)?;
    let (len, rest) = match version[0] {
        1 => rest.split_first_chunk().map(|(len, rest)| (u32::from(u16::from_le_bytes(*len)), rest))?,
        2 | 3 => rest.split_first_chunk().map(|(len, rest)| (u32::from_le_bytes(*len), rest))?,
        _ => return None,
    };
    let (head, body) = rest.split_at_checked(len as usize)?;
    Some((std::str::from_utf8(head).ok()?, body))
}

/// Removes lens distortion from a map. Takes the nearest value, as a mean over an edge would lie on neither
/// side; depths outside the picture are 0, unknown.
fn undistorted(map: &DepthMap, camera: &Camera, lens: &Lens) -> DepthMap {
    let size = [map.width, map.height];
    let depth = |source: Option<[f64; 2]>| {
        let [x, y] = source?;
        let inside = (0.0..f64::from(map.width)).contains(&x) && (0.0..f64::from(map.height)).contains(&y);
        inside.then(|| map.depths[y as usize * map.width as usize + x as usize])
    };
    DepthMap { depths: lens.sources(camera, size).map(|at| depth(at).unwrap_or(0.0)).collect(), ..*map }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Applies a reader to a file of these bytes.
    fn read_bytes(read: fn(&Path) -> Result<DepthMap, Fault>, bytes: &[u8]) -> Result<DepthMap, String> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), bytes).unwrap();
        read(file.path()).map_err(|fault| {
            assert!(fault.exit_code() == 3 && !fault.to_string().contains('\n'), "{fault}");
            fault.to_string()
        })
    }

    /// A file as `numpy.save` writes it.
    fn npy_file(descr: &str, shape: &str, values: &[u8]) -> Vec<u8> {
        let mut head = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}");
        head += &" ".repeat(63 - (10 + head.len()) % 64);
        head.push('\n');
        let len = (head.len() as u16).to_le_bytes();
        [b"\x93NUMPY\x01\x00", &len[..], head.as_bytes(), values].concat()
    }

    #[test]
    fn pfm_is_read_from_the_bottom_in_both_orders() {
        let values = [1.0f32, 2.0, 3.0, 4.0, 5.0, f32::INFINITY];
        let little = [b"Pf\n3 2\n-1.0\n", &values.map(f32::to_le_bytes).concat()[..]].concat();
        let big = [b"Pf\n3 2\n1\n", &values.map(f32::to_be_bytes).concat()[..]].concat();
        let expected = DepthMap { width: 3, height: 2, depths: vec![4.0, 5.0, f32::INFINITY, 1.0, 2.0, 3.0] };
        assert_eq!(read_bytes(pfm, &little).unwrap(), expected);
        assert_eq!(read_bytes(pfm, &big).unwrap(), expected);
        #[cfg(feature = "onnx")]
        assert_eq!(pfm_file(&expected), little);
        for end in 0..little.len() {
            assert!(read_bytes(pfm, &little[..end]).is_err(), "{end}");
        }
        assert!(read_bytes(pfm, b"PF\n1 1\n-1\n0000").unwrap_err().contains("one channel"));
        assert!(read_bytes(pfm, b"Pf\n99999999999 1\n-1\n").unwrap_err().contains("a side can have"));
        assert!(read_bytes(pfm, b"Pf\n16000 16000\n-1\n").unwrap_err().contains("holds 0 values"));
    }

    #[test]
    fn npy_is_read_in_its_types() {
        let map = |depths: [f32; 4]| DepthMap { width: 2, height: 2, depths: depths.to_vec() };
        let depths = [1.5f32, 0.0, 2.25, -1.0];
        let expected = map(depths);
        let half = depths.map(|x| f16::from_f32(x).to_le_bytes()).concat();
        for (descr, bytes) in [
            ("<f2", half.clone()),
            (">f2", depths.map(|x| f16::from_f32(x).to_be_bytes()).concat()),
            ("<f4", depths.map(f32::to_le_bytes).concat()),
            (">f4", depths.map(f32::to_be_bytes).concat()),
            ("<f8", depths.map(|x| f64::from(x).to_le_bytes()).concat()),
            (">f8", depths.map(|x| f64::from(x).to_be_bytes()).concat()),
        ] {
            for shape in ["(2, 2)", "(1, 2, 2)", "(2, 2, 1)", "(1, 1, 2, 2)"] {
                assert_eq!(
                    read_bytes(npy, &npy_file(descr, shape, &bytes)).unwrap(),
                    expected,
                    "{descr} {shape}"
                );
            }
        }
        let row = read_bytes(npy, &npy_file("<f2", "(1, 4)", &half)).unwrap();
        assert_eq!((row.width, row.height), (4, 1));
        let whole = npy_file("<f2", "(2, 2)", &half);
        for end in 0..whole.len() {
            assert!(read_bytes(npy, &whole[..end]).is_err(), "{end}");
        }
    }

    #[test]
    fn other_arrays_are_refused() {
        let error = |descr: &str, shape: &str| read_bytes(npy, &npy_file(descr, shape, &[0; 8])).unwrap_err();
        assert!(error("<u2", "(2, 2)").contains("<u2"));
        assert!(error("<f2", "(4,)").contains("height and width"));
        assert!(error("<f2", "(2, 2, 3)").contains("height and width"));
        assert!(error("<f2", "(2, -2)").contains("shape"));
        assert!(error("<f2", "(3, 2)").contains("4 values, but 2x3 need 6"));
        assert!(error("<f2", "(18446744073709551615, 2)").contains("a side can have"));
        let fortran = npy_file("<f2", "(2, 2)", &[0; 8]);
        let fortran = String::from_utf8_lossy(&fortran[10..]).replace("False", "True ");
        let fortran = [b"\x93NUMPY\x01\x00v\x00", fortran.as_bytes()].concat();
        assert!(read_bytes(npy, &fortran).unwrap_err().contains("C order"));
    }

    #[test]
    fn undistortion_takes_the_nearest_value() {
        let camera = Camera::look_at([0.0; 3], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0], 1.0, 64, 48);
        let lens = Lens::rational(&[-0.1]).unwrap();
        // At half resolution; each value is its column plus 1.
        let depths = (0..32 * 24).map(|i| (i % 32 + 1) as f32).collect();
        let map = DepthMap { width: 32, height: 24, depths };
        let straight = undistorted(&map, &camera, &lens);
        let x = (25.0 + 0.5) * 2.0 - 32.0;
        let y = (6.0 + 0.5) * 2.0 - 24.0;
        let f = camera.k[0][0];
        let column = (32.0 + x * (1.0 - 0.1 * (x * x + y * y) / (f * f))) / 2.0;
        assert_eq!(straight.depths[6 * 32 + 25], column.floor() as f32 + 1.0);
        assert_eq!(straight.depths[12 * 32 + 16], 17.0);
        let wide = undistorted(&map, &camera, &Lens::rational(&[0.5]).unwrap());
        assert_eq!(wide.depths[0], 0.0);
    }
}
