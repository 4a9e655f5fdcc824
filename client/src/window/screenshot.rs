//! [`Screenshot`]: an image of the clip as the window shows it, without the controls.
//!
//! It is rendered as by `--headless`, in 16 bits per channel, with its own renderer on its own thread, and delays no
//! frame of the window.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use program::{Fault, output};

use crate::gpu::{ChannelDepth, FrameLayout, Gpu, GpuClip, Offscreen, RenderSettings, Renderer};
use crate::view::View;

/// Most bytes of the clip's name in a file name. File systems allow 255 bytes in all.
const NAME_BYTES: usize = 200;

/// The content of a screenshot.
pub(crate) struct Screenshot {
    pub(crate) clip: Arc<GpuClip>,
    /// Name of the clip, for the name of the file.
    pub(crate) name: String,
    /// Normalised clip time, and the position in seconds.
    pub(crate) t: f64,
    pub(crate) time_s: f64,
    pub(crate) view: View,
    pub(crate) settings: RenderSettings,
}

impl Screenshot {
    /// Renders the image and writes it under an unused name to the first of `folders` that can be written; returns the
    /// path.
    ///
    /// # Errors
    /// [`Fault::Device`] if it cannot be rendered, [`Fault::Usage`] if it cannot be written.
    pub(crate) fn save(&self, gpu: &Gpu, folders: &[PathBuf]) -> Result<PathBuf, Fault> {
        let path = writable_path(folders, &file_stem(&self.name, self.time_s))?;
        let (views, depth) = ([self.view], ChannelDepth::Sixteen);
        let image = Offscreen::new(gpu, self.view.size, 1, depth)?;
        let mut renderer = Renderer::new(gpu, self.clip.clone(), FrameLayout::plain(depth.format(), 1))?;
        image.render(gpu, &mut renderer, self.t, &views, &self.settings)?;
        for pixels in image.read(gpu)? {
            output::write_png(&path, &pixels.to_rgb8(), pixels.size.into())?;
        }
        Ok(path)
    }
}

/// `clip_1.250s` for `clip.aarc` at 1.25 s. Characters that some file systems refuse become `_`.
fn file_stem(name: &str, time_s: f64) -> String {
    let stem = Path::new(name).file_stem().and_then(|stem| stem.to_str()).unwrap_or("clip");
    let plain = |c: char| if c.is_alphanumeric() || "-_.".contains(c) { c } else { '_' };
    let stem: String = stem.chars().map(plain).collect();
    format!("{}_{time_s:.3}s", &stem[..stem.floor_char_boundary(NAME_BYTES)])
}

/// An unused path in the first of `folders` that can be written.
fn writable_path(folders: &[PathBuf], stem: &str) -> Result<PathBuf, Fault> {
    let mut paths = folders.iter().map(|folder| free_path(folder, stem));
    paths.find(|path| output::check(path).is_ok()).ok_or_else(|| {
        let folders: Vec<String> = folders.iter().map(|folder| folder.display().to_string()).collect();
        Fault::Usage(format!(
            "no picture is saved: cannot write to {}: change its permissions, or make room on its disk",
            folders.join(" or ")
        ))
    })
}

/// An unused path in `folder`.
fn free_path(folder: &Path, stem: &str) -> PathBuf {
    let numbered = |number: u32| match number {
        1 => folder.join(format!("{stem}.png")),
        _ => folder.join(format!("{stem}_{number}.png")),
    };
    (1..).map(numbered).find(|path| !path.exists()).unwrap_or_else(|| numbered(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_have_clip_and_time() {
        assert_eq!(file_stem("clip.aarc", 1.25), "clip_1.250s");
        assert_eq!(file_stem("a b:c?.aarc", 0.0), "a_b_c__0.000s");
        assert_eq!(file_stem("", 2.0), "clip_2.000s");
        let long = file_stem(&"\u{20000}".repeat(100), 100.0);
        assert!(long.starts_with('\u{20000}') && long.len() + ".png".len() <= 255, "{}", long.len());
    }

    #[test]
    fn the_first_folder_that_can_be_written_takes_the_image() {
        let folder = tempfile::tempdir().unwrap();
        let [missing, there] = ["missing", "there"].map(|name| folder.path().join(name));
        std::fs::create_dir(&there).unwrap();
        assert_eq!(writable_path(&[missing.clone(), there.clone()], "a").unwrap(), there.join("a.png"));
        let nowhere = writable_path(std::slice::from_ref(&missing), "a").unwrap_err().to_string();
        assert!(nowhere.contains(missing.to_str().unwrap()), "{nowhere}");
    }

    #[test]
    fn no_file_is_overwritten() {
        let folder = tempfile::tempdir().unwrap();
        let first = free_path(folder.path(), "a");
        assert_eq!(first, folder.path().join("a.png"));
        std::fs::write(&first, b"").unwrap();
        let second = free_path(folder.path(), "a");
        assert_eq!(second, folder.path().join("a_2.png"));
        std::fs::write(&second, b"").unwrap();
        assert_eq!(free_path(folder.path(), "a"), folder.path().join("a_3.png"));
    }
}
