//! Pictures side by side and in rows.

use refine::capture::Photo;
use refine::image::Image;

/// Margin around a subject relative to its longer side.
const MARGIN: f64 = 0.1;

/// A crop: half-open ranges of columns and rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Crop {
    pub(super) x: [u32; 2],
    pub(super) y: [u32; 2],
}

impl Crop {
    /// Bounds of the subject over photographs of one size, with a margin; the whole picture if none
    /// shows the subject.
    ///
    /// # Panics
    /// If `photos` is empty.
    pub(crate) fn around(photos: &[&Photo]) -> Crop {
        let (width, height) = (photos[0].image.width, photos[0].image.height);
        let mut found: Option<[[u32; 2]; 2]> = None;
        for photo in photos {
            for i in (0..photo.image.pixels.len()).filter(|i| photo.is_subject(*i)) {
                let at = [i as u32 % width, i as u32 / width];
                let [low, high] = found.unwrap_or([at, at]);
                found = Some([[0, 1].map(|k| low[k].min(at[k])), [0, 1].map(|k| high[k].max(at[k]))]);
            }
        }
        let Some([low, high]) = found else { return Crop { x: [0, width], y: [0, height] } };
        let longer = (high[0] - low[0]).max(high[1] - low[1]);
        let edge = 1 + (MARGIN * f64::from(longer)) as u32;
        let range = |k: usize, side: u32| [low[k].saturating_sub(edge), (high[k] + 1 + edge).min(side)];
        Crop { x: range(0, width), y: range(1, height) }
    }

    /// This part of `image`.
    pub(crate) fn apply(self, image: &Image) -> Image {
        let mut part = Image::new(self.x[1] - self.x[0], self.y[1] - self.y[0]);
        for (row, y) in part.pixels.chunks_mut(part.width as usize).zip(self.y[0]..) {
            let start = (y * image.width + self.x[0]) as usize;
            row.copy_from_slice(&image.pixels[start..start + row.len()]);
        }
        part
    }
}

/// Pictures of one size in rows and columns.
///
/// # Panics
/// If there are no pictures, or sizes or numbers of columns differ.
pub(super) fn sheet(rows: &[Vec<Image>]) -> Image {
    let (width, height) = (rows[0][0].width, rows[0][0].height);
    let columns = rows[0].len();
    let mut sheet = Image::new(width * columns as u32, height * rows.len() as u32);
    let stride = sheet.width as usize;
    for (row, images) in rows.iter().enumerate() {
        assert_eq!(images.len(), columns, "as many pictures in each row");
        for (column, image) in images.iter().enumerate() {
            assert_eq!((image.width, image.height), (width, height), "pictures of one size");
            for (y, line) in image.pixels.chunks(width as usize).enumerate() {
                let start = (row * height as usize + y) * stride + column * width as usize;
                sheet.pixels[start..start + line.len()].copy_from_slice(line);
            }
        }
    }
    sheet
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An image whose red and green are each pixel's coordinates.
    fn ramp(width: u32, height: u32, alpha: impl Fn(u32, u32) -> f64) -> Image {
        let mut image = Image::new(width, height);
        for (i, pixel) in image.pixels.iter_mut().enumerate() {
            let (x, y) = (i as u32 % width, i as u32 / width);
            *pixel = [f64::from(x), f64::from(y), 0.0, alpha(x, y)];
        }
        image
    }

    #[test]
    fn a_crop_holds_the_subject_and_an_edge() {
        let photo = |alpha: fn(u32, u32) -> f64| {
            let image = ramp(40, 30, alpha);
            Photo { seen: vec![true; image.pixels.len()], image }
        };
        let one = photo(|x, y| f64::from(u8::from((10..15).contains(&x) && y == 7)));
        let other = photo(|x, y| f64::from(u8::from(x == 30 && y == 29)));
        let crop = Crop::around(&[&one, &other]);
        // The longer side is 22 pixels: an edge of 3.
        assert_eq!(crop, Crop { x: [7, 34], y: [4, 30] });
        let part = crop.apply(&one.image);
        assert_eq!((part.width, part.height, part.pixel(0, 0)[..2].to_vec()), (27, 26, vec![7.0, 4.0]));
        let nothing = photo(|_, _| 0.0);
        assert_eq!(Crop::around(&[&nothing]), Crop { x: [0, 40], y: [0, 30] });
    }

    #[test]
    fn a_sheet_holds_every_picture_in_its_place() {
        let image = |number: f64| {
            let mut image = ramp(3, 2, |_, _| 1.0);
            image.pixels.iter_mut().for_each(|pixel| pixel[2] = number);
            image
        };
        let sheet = sheet(&[vec![image(0.0), image(1.0)], vec![image(2.0), image(3.0)]]);
        assert_eq!((sheet.width, sheet.height), (6, 4));
        assert_eq!(sheet.pixel(4, 3), [1.0, 1.0, 3.0, 1.0]);
        assert_eq!(sheet.pixel(2, 0), [2.0, 0.0, 0.0, 1.0]);
    }
}
