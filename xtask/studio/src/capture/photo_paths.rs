//! [`PhotoPaths`]: the paths of the photographs of a capture and of their masks, in one text.
//!
//! A take has a photograph per camera and frame, and strings of their own would need several times the memory of the
//! characters. Here each photograph has a record in a common text: its path up to its name, its name, the rest of its path
//! and, if it has a mask, the path of the mask. A NUL separates them: no path of an existing file has one.

const SEPARATOR: char = '\0';

/// Paths of photographs and masks, by number. They are relative to the folder of the capture, or absolute.
#[derive(Clone, Debug, Default)]
pub(super) struct PhotoPaths {
    /// All records.
    text: String,
    /// The end of each record in `text`, in bytes.
    ends: Vec<usize>,
}

/// The paths of one photograph.
#[derive(Clone, Copy, Debug)]
pub(super) struct PhotoPath<'a> {
    /// The photograph, which exists.
    pub(super) image: &'a str,
    /// Name of the photograph: the part of `image` that depth maps and pictures of it share.
    pub(super) name: &'a str,
    pub(super) mask: Option<&'a str>,
}

impl PhotoPaths {
    /// Adds the paths of a photograph.
    ///
    /// # Panics
    /// If its name is no part of its path.
    pub(super) fn push(&mut self, photo: PhotoPath) {
        // Wherever in the path a name stands, the three parts make up the path.
        let (before, after) = photo.image.split_once(photo.name).expect("a name is a part of its path");
        for part in [before, photo.name] {
            self.text.push_str(part);
            self.text.push(SEPARATOR);
        }
        self.text.push_str(after);
        if let Some(mask) = photo.mask {
            self.text.push(SEPARATOR);
            self.text.push_str(mask);
        }
        self.ends.push(self.text.len());
    }

    /// Path of photograph `i`.
    ///
    /// # Panics
    /// If there is none.
    pub(super) fn image(&self, i: usize) -> String {
        self.record(i).split(SEPARATOR).take(3).collect()
    }

    /// Name of photograph `i`.
    ///
    /// # Panics
    /// If there is none.
    pub(super) fn name(&self, i: usize) -> &str {
        self.record(i).split(SEPARATOR).nth(1).expect("a record has a name")
    }

    /// Path of the mask of photograph `i`, if it has one.
    ///
    /// # Panics
    /// If there is no such photograph.
    pub(super) fn mask(&self, i: usize) -> Option<&str> {
        self.record(i).splitn(4, SEPARATOR).nth(3)
    }

    /// The paths of these photographs, in this order.
    ///
    /// # Panics
    /// If there is no such photograph.
    pub(super) fn select(&self, photos: impl Iterator<Item = usize> + Clone) -> PhotoPaths {
        let len = photos.clone().map(|i| self.record(i).len()).sum();
        let mut selected =
            PhotoPaths { text: String::with_capacity(len), ends: Vec::with_capacity(photos.clone().count()) };
        for i in photos {
            selected.text.push_str(self.record(i));
            selected.ends.push(selected.text.len());
        }
        selected
    }

    fn record(&self, i: usize) -> &str {
        let start = if i == 0 { 0 } else { self.ends[i - 1] };
        &self.text[start..self.ends[i]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PHOTOS: [PhotoPath; 6] = [
        PhotoPath { image: "images/a/0.png", name: "a/0", mask: Some("masks/a/0.png") },
        PhotoPath { image: "/elsewhere/é.jpg", name: "/elsewhere/é", mask: None },
        // The name is found within the folder first.
        PhotoPath { image: "images/i.png", name: "i", mask: None },
        PhotoPath { image: "r_000.5.png", name: "r_000", mask: Some("") },
        PhotoPath { image: "images", name: "", mask: Some("no\0file") },
        PhotoPath { image: "7", name: "7", mask: None },
    ];

    fn paths() -> PhotoPaths {
        let mut paths = PhotoPaths::default();
        PHOTOS.into_iter().for_each(|photo| paths.push(photo));
        paths
    }

    fn check(paths: &PhotoPaths, i: usize, photo: PhotoPath) {
        assert_eq!(
            (paths.image(i).as_str(), paths.name(i), paths.mask(i)),
            (photo.image, photo.name, photo.mask)
        );
    }

    #[test]
    fn paths_come_back_as_they_were() {
        let paths = paths();
        for (i, photo) in PHOTOS.into_iter().enumerate() {
            check(&paths, i, photo);
        }
    }

    #[test]
    fn selected_paths_have_a_text_of_their_own() {
        let selected = paths().select([5, 3, 0].into_iter());
        for (i, of) in [5, 3, 0].into_iter().enumerate() {
            check(&selected, i, PHOTOS[of]);
        }
        assert_eq!(
            selected.text.capacity(),
            "\0".len() * 8 + "7r_000.5.pngimages/a/0.pngmasks/a/0.png".len()
        );
        assert!(paths().select(std::iter::empty()).text.is_empty());
    }

    #[test]
    #[should_panic(expected = "a name is a part of its path")]
    fn a_name_is_a_part_of_its_path() {
        PhotoPaths::default().push(PhotoPath { image: "a.png", name: "b", mask: None });
    }
}
