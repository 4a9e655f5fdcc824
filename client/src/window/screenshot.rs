//! [`Screenshot`]: an image of the clip as the window shows it, without the controls.
//!
//! It is rendered as by `--headless`, with its own renderer on its own thread, and delays no frame of the
//! window.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use program::{Fault, output};

use crate::gpu::{ChannelDepth, FrameLayout, Gpu, GpuClip, Offscreen, RenderSettings, Renderer};
use crate::view::View;

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
    /// Renders the image and writes it to `folder` under an unused name; returns the path.
    ///
    /// # Errors
    /// [`Fault::Device`] if it cannot be rendered, [`Fault::Usage`] if it cannot be written.
    pub(crate) fn save(&self, gpu: &Gpu, folder: &Path) -> Result<PathBuf, Fault> {
        let path = free_path(folder, &file_stem(&self.name, self.time_s));
        output::check(&path)?;
        let views = [self.view];
        let image = Offscreen::new(gpu, self.view.size, 1, ChannelDepth::Eight)?;
        let mut renderer =
            Renderer::new(gpu, self.clip.clone(), FrameLayout::plain(ChannelDepth::Eight.format(), 1))?;
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
    let stem: String = stem.chars().map(plain).take(64).collect();
    format!("{stem}_{time_s:.3}s")
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
