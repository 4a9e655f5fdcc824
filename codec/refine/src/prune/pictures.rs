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
    pub fn psnr(&self, scene: &RenderScene, on_view: impl FnMut()) -> f64 {
        self.compare(scene, on_view).psnr_db
    }

    /// Compares `scene` with these pictures. `on_view` is called after each picture.
    pub fn compare(&self, scene: &RenderScene, mut on_view: impl FnMut()) -> Fidelity {
        self.compare_while(scene, |_, _| true, &mut on_view).expect("nothing ends it")
    }

    /// Compares `scene` with these pictures as [`Pictures::compare`] does; `None`, as soon as that is known, if
    /// the PSNR over all pictures is below the first of `least_db` or that of one picture is below the
    /// second.
    pub fn compare_at_least(&self, scene: &RenderScene, least_db: (f64, f64)) -> Option<Fidelity> {
        let pixels = self.taken.iter().map(|(_, image)| image.pixels.len()).sum();
        let may_meet = |all: &Errors, picture_db: f64| {
            psnr(all.squared, pixels) >= least_db.0 && picture_db >= least_db.1
        };
        self.compare_while(scene, may_meet, &mut || ())
    }

    /// Compares while `goes_on` says so, given the errors so far and the PSNR of the last picture.
    fn compare_while(
        &self,
        scene: &RenderScene,
        goes_on: impl Fn(&Errors, f64) -> bool,
        on_view: &mut dyn FnMut(),
    ) -> Option<Fidelity> {
        let (mut all, mut covered) = (Errors::default(), Errors::default());
        let mut worst: Option<WorstPicture> = None;
        for (view, image) in &self.taken {
            let other = render(scene, &view.camera, view.t, Order::Depth);
            let squared = image.squared_error(&other);
            all.add(squared, image.pixels.len());
            let (squared_covered, pixels) = image.squared_error_covered(&other);
            covered.add(squared_covered, pixels);
            let psnr_db = psnr(squared, image.pixels.len());
            if worst.as_ref().is_none_or(|worst| psnr_db < worst.psnr_db) {
                worst = Some(WorstPicture { psnr_db, view: view.clone() });
            }
            on_view();
            if !goes_on(&all, psnr_db) {
                return None;
            }
        }
        Some(Fidelity { psnr_db: all.psnr(), covered_psnr_db: covered.psnr(), worst })
    }
}

/// How close a scene comes to [`Pictures`].
#[derive(Clone, Debug, PartialEq)]
pub struct Fidelity {
    /// PSNR in dB over all pixels of all pictures; infinite if they are equal.
    pub psnr_db: f64,
    /// PSNR in dB over the pixels that the pictured scene covers; infinite if they are equal.
    pub covered_psnr_db: f64,
    /// The picture with the lowest PSNR; `None` without pictures.
    pub worst: Option<WorstPicture>,
}

/// The picture that a scene reproduces worst.
#[derive(Clone, Debug, PartialEq)]
pub struct WorstPicture {
    /// PSNR in dB over its pixels; infinite if all pictures are equal.
    pub psnr_db: f64,
    /// Its camera and instant.
    pub view: PosedView,
}

/// A sum of squared errors over pixels.
#[derive(Default)]
struct Errors {
    squared: f64,
    pixels: usize,
}

impl Errors {
    fn add(&mut self, squared: f64, pixels: usize) {
        self.squared += squared;
        self.pixels += pixels;
    }

    fn psnr(&self) -> f64 {
        psnr(self.squared, self.pixels)
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

    #[test]
    fn the_worst_picture_and_the_covered_pixels_are_told_apart() {
        let field = cloud(1, 60);
        let cameras = dome(&field, &[0.5], [0.0, 1.0, 0.0], 0.0, (32, 24));
        let pictures = Pictures::take(&RenderScene::from(&field), posed_views(&cameras, &[0.5]), || ());
        let part = field.select(&(0..50).collect::<Vec<_>>());
        let fidelity = pictures.compare(&RenderScene::from(&part), || ());
        let worst = fidelity.worst.unwrap();
        let of = |(view, image): &(PosedView, Image)| {
            image.psnr(&render(&(&part).into(), &view.camera, view.t, Order::Depth))
        };
        let lowest = pictures.taken.iter().min_by(|a, b| of(a).total_cmp(&of(b))).unwrap();
        assert_eq!((worst.view, worst.psnr_db), (lowest.0.clone(), of(lowest)));
        let scene = RenderScene::from(&part);
        let at_least = |mean_db, picture_db| pictures.compare_at_least(&scene, (mean_db, picture_db));
        assert!(at_least(fidelity.psnr_db, worst.psnr_db).is_some());
        assert!(at_least(fidelity.psnr_db + 1e-6, worst.psnr_db).is_none());
        assert!(at_least(fidelity.psnr_db, worst.psnr_db + 1e-6).is_none());
        assert!(worst.psnr_db < fidelity.psnr_db && fidelity.covered_psnr_db < fidelity.psnr_db);
    }
}
