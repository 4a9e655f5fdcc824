//! [`Pictures`]: reference pictures of a scene, which packages of it are compared with.

use super::PosedView;
use crate::image::{Image, psnr};
use crate::reference::{Order, RenderScene, render};

/// Pictures of a scene from several cameras at several times.
#[derive(Clone, Debug)]
pub struct Pictures {
    pub(crate) taken: Vec<(PosedView, Image)>,
}

impl Pictures {
    /// Renders `scene` for each of `views`. `on_view` is called after each.
    pub fn take(scene: &RenderScene, views: Vec<PosedView>, mut on_view: impl FnMut()) -> Pictures {
        let take = |view: PosedView| {
            let image = render(scene, &view.camera, view.t, Order::Depth);
            on_view();
            (view, image)
        };
        Pictures { taken: views.into_iter().map(take).collect() }
    }

    /// PSNR in dB of `scene` against these pictures, over all pixels of all pictures; infinite if they are
    /// equal. `on_view` is called after each picture.
    pub fn psnr(&self, scene: &RenderScene, mut on_view: impl FnMut()) -> f64 {
        let mut pixels = 0;
        let mut squared_error = 0.0;
        for (view, image) in &self.taken {
            squared_error += image.squared_error(&render(scene, &view.camera, view.t, Order::Depth));
            pixels += image.pixels.len();
            on_view();
        }
        psnr(squared_error, pixels)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prune::scenes::cloud;
    use crate::prune::{dome, posed_views};

    #[test]
    fn errors_are_pooled_over_pixels() {
        let field = cloud(1, 60);
        let cameras = dome(&field, &[0.5], [0.0, 1.0, 0.0], 0.0, (32, 24));
        let scene = RenderScene::from(&field);
        let pictures = Pictures::take(&scene, posed_views(&cameras, &[0.3, 0.7]), || ());
        assert_eq!(pictures.psnr(&scene, || ()), f64::INFINITY);

        let part = field.select(&(0..50).collect::<Vec<_>>());
        let mut calls = 0;
        let psnr = pictures.psnr(&RenderScene::from(&part), || calls += 1);
        assert_eq!(calls, 16);
        let mut squares = 0.0;
        for (view, image) in &pictures.taken {
            let other = render(&(&part).into(), &view.camera, view.t, Order::Depth);
            for (a, b) in image.pixels.iter().zip(&other.pixels) {
                squares += (0..3).map(|c| (a[c].clamp(0.0, 1.0) - b[c].clamp(0.0, 1.0)).powi(2)).sum::<f64>();
            }
        }
        let expected = -10.0 * (squares / f64::from(16 * 3 * 32 * 24)).log10();
        assert!((psnr - expected).abs() < 1e-9 && psnr < 60.0, "{psnr}, {expected} expected");
    }
}
