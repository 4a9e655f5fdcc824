//! [`ImageOutput`]: the PNG files of a run, one or a numbered sequence; and [`tiled`], which joins images.

use std::path::{Path, PathBuf};

use image::{RgbImage, imageops};

use crate::Fault;
use crate::output::{check, check_folder, make_folder, write_png};

/// Where a run writes its images.
#[derive(Clone, Debug)]
pub struct ImageOutput {
    path: PathBuf,
    is_sequence: bool,
}

impl ImageOutput {
    /// Checks before any work is done that images can be written: one to the file `path`, or a sequence to
    /// the folder `path`.
    ///
    /// # Errors
    /// [`Fault::Usage`] with the path, the reason, and what to name instead.
    pub fn check(path: &Path, is_sequence: bool) -> Result<ImageOutput, Fault> {
        if is_sequence {
            check_folder(path)?;
        } else if let Some(extension) = path.extension().filter(|end| !end.eq_ignore_ascii_case("png")) {
            return Err(Fault::Usage(format!(
                "cannot write {}: images are PNG files, not .{}: name it {}",
                path.display(),
                extension.display(),
                path.with_extension("png").display()
            )));
        } else {
            check(path)?;
        }
        Ok(ImageOutput { path: path.into(), is_sequence })
    }

    /// Writes image number `i`, from 0, and returns its path.
    ///
    /// # Errors
    /// [`Fault::Usage`] with the path and the reason.
    pub fn write(&self, i: usize, image: &RgbImage) -> Result<PathBuf, Fault> {
        let path = if self.is_sequence {
            make_folder(&self.path)?;
            self.path.join(frame_name(i))
        } else {
            self.path.clone()
        };
        write_png(&path, image.as_raw(), image.dimensions())?;
        Ok(path)
    }
}

/// File name of image number `i` of a sequence, from 0.
pub fn frame_name(i: usize) -> String {
    format!("frame_{i:04}.png")
}

/// Tiles images of one size in rows of `columns`.
///
/// # Panics
/// If there is no image.
pub fn tiled(images: &[RgbImage], columns: u32) -> RgbImage {
    let (width, height) = images[0].dimensions();
    let rows = (images.len() as u32).div_ceil(columns);
    let mut sheet = RgbImage::new(width * columns, height * rows);
    for (i, image) in images.iter().enumerate() {
        let (column, row) = (i as u32 % columns, i as u32 / columns);
        imageops::replace(&mut sheet, image, (column * width).into(), (row * height).into());
    }
    sheet
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;

    fn image(value: u8) -> RgbImage {
        RgbImage::from_pixel(3, 2, Rgb([value; 3]))
    }

    #[test]
    fn images_are_tiled_in_rows() {
        let sheet = tiled(&[image(1), image(2), image(3)], 2);
        assert_eq!(sheet.dimensions(), (6, 4));
        let at = |x, y| sheet.get_pixel(x, y).0[0];
        assert_eq!([at(0, 0), at(5, 1), at(2, 3), at(3, 2)], [1, 2, 3, 0]);
    }

    #[test]
    fn one_image_is_a_file_and_a_sequence_a_folder() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        for name in ["one.png", "two.PNG", "three"] {
            let written = ImageOutput::check(&path(name), false).unwrap().write(7, &image(1)).unwrap();
            assert_eq!(written, path(name));
        }
        let sequence = ImageOutput::check(&path("many"), true).unwrap();
        assert!(!path("many").exists(), "before the first image");
        assert_eq!(sequence.write(7, &image(1)).unwrap(), path("many/frame_0007.png"));
        assert!(path("many/frame_0007.png").is_file());
    }

    #[test]
    fn only_names_of_png_files_are_taken() {
        let folder = tempfile::tempdir().unwrap();
        let Err(Fault::Usage(message)) = ImageOutput::check(&folder.path().join("a.jpg"), false) else {
            panic!("a PNG is no JPEG")
        };
        assert!(message.contains("not .jpg") && message.ends_with("a.png"), "{message}");
        ImageOutput::check(&folder.path().join("a.jpg"), true).unwrap();
    }
}
