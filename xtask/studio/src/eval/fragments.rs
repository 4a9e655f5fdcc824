//! [`fragments_per_lit_pixel`]: what a field costs a player. It is counted in pictures of one width, so that it does not
//! depend on the size of the photographs.

use refine::capture::PhotoId;
use refine::reference::{Order, Radius, RenderScene, coverage, render};

use crate::capture::CaptureFiles;

/// Width in pixels of the pictures in which fragments are counted; their height follows the camera's.
const COUNTED_WIDTH: u32 = 512;

/// Alpha from which a pixel is lit.
const LIT: f64 = 1.0 / 255.0;

/// Fragments that a player shades per lit pixel in the views of `photos`, drawn 512 pixels wide; `None` if no pixel is
/// lit.
pub fn fragments_per_lit_pixel<'a>(
    scene: &RenderScene,
    capture_files: &CaptureFiles,
    photos: impl IntoIterator<Item = &'a PhotoId>,
) -> Option<f64> {
    let capture = &capture_files.capture;
    let (mut fragments, mut lit) = (0, 0);
    for photo_id in photos {
        let camera = &capture.cameras[photo_id.camera].camera;
        let height = (f64::from(camera.height) * f64::from(COUNTED_WIDTH) / f64::from(camera.width)).round();
        let camera = camera.resized(COUNTED_WIDTH, (height as u32).max(1));
        let t = capture.clip_time(*photo_id);
        fragments += coverage(scene, std::slice::from_ref(&camera), t, Radius::Exact).fragments;
        let image = render(scene, &camera, t, Order::Depth);
        lit += image.pixels.iter().filter(|[.., alpha]| *alpha >= LIT).count();
    }
    (lit > 0).then(|| fragments as f64 / lit as f64)
}
