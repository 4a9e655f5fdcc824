//! [`Pictures`]: reference pictures of a scene, which packages of it are compared with.

use codec::Field;

use crate::image::{Image, psnr};
use crate::in_order::for_each_in_order;
use crate::reference::PosedView;
use crate::reference::{Order, RenderScene, render};

/// Pictures of a scene from several cameras at several times.
#[derive(Clone, Debug)]
pub struct Pictures {
    pub(crate) taken: Vec<(PosedView, Image)>,
    /// Of each view, the picture of the plate that scenes are compared in front of; empty without one.
    plates: Vec<Image>,
}

impl Pictures {
    /// Renders `scene` for each of `views`. `on_view` is called after each.
    pub fn take(scene: &RenderScene, views: Vec<PosedView>, mut on_view: impl FnMut()) -> Pictures {
        let mut images = Vec::with_capacity(views.len());
        let take = |view: &PosedView| render(scene, &view.camera, view.t, Order::Depth);
        for_each_in_order(&views, take, |_, image| {
            images.push(image);
            on_view();
        });
        Pictures { taken: views.into_iter().zip(images).collect(), plates: Vec::new() }
    }

    /// Renders `scene` as [`Pictures::take`] does, in front of `plate`. Scenes are then compared in front of the same
    /// plate, which is rendered only here: they must have none of their own.
    pub fn take_before(
        scene: &RenderScene,
        plate: Option<&Field>,
        views: Vec<PosedView>,
        mut on_view: impl FnMut(),
    ) -> Pictures {
        let Some(plate) = plate else { return Pictures::take(scene, views, on_view) };
        let plates = Pictures::take(&RenderScene::from(plate), views.clone(), || ());
        let plates: Vec<Image> = plates.taken.into_iter().map(|(_, image)| image).collect();
        let mut pictures = Pictures::take(scene, views, &mut on_view);
        for ((_, image), plate) in pictures.taken.iter_mut().zip(&plates) {
            image.put_before(plate);
        }
        Pictures { plates, ..pictures }
    }

    /// PSNR in dB of `scene` against these pictures, over all pixels of all pictures; infinite if they are
    /// equal. `on_view` is called after each picture.
    pub fn psnr(&self, scene: &RenderScene, on_view: impl FnMut()) -> f64 {
        self.compare(scene, on_view).psnr_db
    }

    /// Compares `scene` with these pictures. `on_view` is called after each picture.
    pub fn compare(&self, scene: &RenderScene, mut on_view: impl FnMut()) -> Fidelity {
        let mut errors = Vec::with_capacity(self.taken.len());
        let pictures: Vec<usize> = (0..self.len()).collect();
        for_each_in_order(
            &pictures,
            |picture| self.errors_in(*picture, scene),
            |_, one| {
                errors.push(one);
                on_view();
            },
        );
        self.fidelity(&errors)
    }

    /// Compares `scene` with these pictures as [`Pictures::compare`] does, in `order`; `None`, as soon as that is
    /// known, if the PSNR over all pictures is below the first of `least_db` or the PSNR of one picture is
    /// below the second. `known` holds the errors of `scene` that are known, one entry per picture, and
    /// gets those that are computed.
    pub(crate) fn compare_at_least(
        &self,
        scene: &RenderScene,
        least_db: (f64, f64),
        order: &[usize],
        known: &mut [Option<PictureErrors>],
    ) -> Option<Fidelity> {
        let pixels = self.taken.iter().map(|(_, image)| image.pixels.len()).sum();
        let mut squared = 0.0;
        for &picture in order {
            let errors = *known[picture].get_or_insert_with(|| self.errors_in(picture, scene));
            squared += errors.squared;
            if psnr(squared, pixels) < least_db.0 || psnr(errors.squared, errors.pixels) < least_db.1 {
                return None;
            }
        }
        let all: Option<Vec<PictureErrors>> = known.iter().copied().collect();
        all.map(|errors| self.fidelity(&errors))
    }

    /// Errors of `scene` in one of the pictures.
    fn errors_in(&self, picture: usize, scene: &RenderScene) -> PictureErrors {
        let (view, image) = &self.taken[picture];
        let mut other = render(scene, &view.camera, view.t, Order::Depth);
        if let Some(plate) = self.plates.get(picture) {
            other.put_before(plate);
        }
        let (covered_squared, covered_pixels) = image.squared_error_covered(&other);
        let squared = image.squared_error(&other);
        PictureErrors { squared, pixels: image.pixels.len(), covered_squared, covered_pixels }
    }

    /// Number of pictures.
    pub(crate) fn len(&self) -> usize {
        self.taken.len()
    }

    /// The fidelity of a scene with these `errors`, one entry per picture.
    fn fidelity(&self, errors: &[PictureErrors]) -> Fidelity {
        let psnr_of = |squared: fn(&PictureErrors) -> f64, pixels: fn(&PictureErrors) -> usize| {
            psnr(errors.iter().map(squared).sum(), errors.iter().map(pixels).sum())
        };
        let mut worst: Option<WorstPicture> = None;
        for ((view, _), errors) in self.taken.iter().zip(errors) {
            let psnr_db = psnr(errors.squared, errors.pixels);
            if worst.as_ref().is_none_or(|worst| psnr_db < worst.psnr_db) {
                worst = Some(WorstPicture { psnr_db, view: view.clone() });
            }
        }
        Fidelity {
            psnr_db: psnr_of(|errors| errors.squared, |errors| errors.pixels),
            covered_psnr_db: psnr_of(|errors| errors.covered_squared, |errors| errors.covered_pixels),
            worst,
        }
    }
}

/// Errors of a scene in one picture: sums of squared differences, and the numbers of pixels that they are over.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PictureErrors {
    pub(crate) squared: f64,
    pixels: usize,
    covered_squared: f64,
    covered_pixels: usize,
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prune::posed_views;
    use crate::prune::scenes::around;
    use crate::prune::scenes::cloud;

    #[test]
    fn errors_are_pooled_over_pixels() {
        let field = cloud(1, 60);
        let cameras = around(&field, 0.0, (32, 24));
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
    fn a_plate_that_is_rendered_once_looks_as_in_every_picture() {
        let (field, plate) = (cloud(1, 60), Field { temporal: None, ..cloud(2, 200) });
        let part = field.select(&(0..50).collect::<Vec<_>>());
        let views = posed_views(&around(&field, 0.0, (32, 24)), &[0.3, 0.7]);
        let scene = RenderScene::from(&field);
        let before = Pictures::take_before(&scene, Some(&plate), views.clone(), || ());
        let together = Pictures::take(&scene.with_plate(&plate), views, || ());
        let [a, b] = [
            before.compare(&RenderScene::from(&part), || ()),
            together.compare(&RenderScene::from(&part).with_plate(&plate), || ()),
        ];
        // A pixel that is nearly opaque is finished, and what is behind it left out.
        let close = |a: f64, b: f64| (a - b).abs() < 0.01;
        assert!(close(a.psnr_db, b.psnr_db) && close(a.covered_psnr_db, b.covered_psnr_db), "{a:?} {b:?}");
        assert_eq!(a.worst.unwrap().view, b.worst.unwrap().view);
        assert!(a.psnr_db < 60.0, "{}", a.psnr_db);
    }

    #[test]
    fn the_worst_picture_and_the_covered_pixels_are_told_apart() {
        let field = cloud(1, 60);
        let cameras = around(&field, 0.0, (32, 24));
        let pictures = Pictures::take(&RenderScene::from(&field), posed_views(&cameras, &[0.5]), || ());
        let part = field.select(&(0..50).collect::<Vec<_>>());
        let fidelity = pictures.compare(&RenderScene::from(&part), || ());
        let worst = fidelity.worst.clone().unwrap();
        let psnr = |(view, image): &(PosedView, Image)| {
            image.psnr(&render(&(&part).into(), &view.camera, view.t, Order::Depth))
        };
        let lowest = pictures.taken.iter().min_by(|a, b| psnr(a).total_cmp(&psnr(b))).unwrap();
        assert_eq!((worst.view, worst.psnr_db), (lowest.0.clone(), psnr(lowest)));
        let scene = RenderScene::from(&part);
        let order: Vec<usize> = (0..pictures.len()).rev().collect();
        let at_least = |mean_db, picture_db| {
            let mut known = vec![None; pictures.len()];
            let found = pictures.compare_at_least(&scene, (mean_db, picture_db), &order, &mut known);
            (found, known.iter().flatten().count())
        };
        assert_eq!(
            at_least(fidelity.psnr_db - 1e-9, worst.psnr_db),
            (Some(fidelity.clone()), pictures.len())
        );
        assert!(at_least(fidelity.psnr_db + 1e-6, worst.psnr_db).0.is_none());
        assert!(at_least(fidelity.psnr_db, worst.psnr_db + 1e-6).0.is_none());
        assert_eq!(at_least(99.0, 0.0), (None, 1), "the first picture tells");
        assert!(worst.psnr_db < fidelity.psnr_db && fidelity.covered_psnr_db < fidelity.psnr_db);
    }
}
