//! [`Refinement`]: optimizes a pruned field against the photographs. The rows keep their number and
//! order.

use codec::Field;
use refine::fit::{
    Backend, Carried, DensityRule, DeviceError, Fit, FitSettings, Learned, Parameters, RenderedImage, Run,
    TrainingView,
};
use serde::Serialize;

use super::start::put_behind;
use super::training_views::{TrainingViews, mean_psnr};

/// Settings of a refinement.
#[derive(Clone, Copy, Debug)]
pub struct Refinement<'a> {
    /// The photographs.
    pub views: &'a TrainingViews,
    /// What the photographs show behind the field; it stays as it is. `None` if they show nothing there.
    pub plate: Option<&'a Field>,
    /// Steps to take.
    pub steps: u64,
    /// Weight of the fragment term, [`FitSettings::fragment_weight`]; 0 for none.
    pub fragment_weight: f64,
}

/// Results of a refinement; the fields are keys of the JSON.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RefinementReport {
    /// Steps taken.
    pub steps: u64,
    /// Number of photographs in the loss.
    pub photographs: usize,
    /// PSNR of the subject in a few held-out photographs, in dB, before the first step; `None` if none is
    /// held out.
    pub held_before_db: Option<f64>,
    /// The same after the last step.
    pub held_after_db: Option<f64>,
    /// Number of non-finite gradients and moments, which the optimizer skips.
    pub non_finite: u64,
}

impl Refinement<'_> {
    /// Refines `field`, which is not empty; the result has the same rows in the same order. Calls `on_step`
    /// after each step.
    ///
    /// # Errors
    /// A [`DeviceError`] of the back end.
    ///
    /// # Panics
    /// If there is no photograph to fit to.
    pub fn run(
        &self,
        field: &Field,
        backend: &mut dyn Backend,
        mut on_step: impl FnMut(),
    ) -> Result<(Field, RefinementReport), DeviceError> {
        let Refinement { views, plate, steps, fragment_weight } = *self;
        let settings = FitSettings {
            steps,
            floor: 0,
            rule: DensityRule::Fixed,
            fragment_weight,
            ..FitSettings::default()
        };
        let mut parameters = Parameters::from_field(field, views.timeline);
        let carried = plate.map(|plate| put_behind(&mut parameters, plate, Carried::FIXED, views.timeline));
        let cameras = views.train.iter().map(|(_, view)| &view.camera);
        let fit = Fit::new(settings, parameters, views.timeline, cameras);
        let fit = match carried {
            Some(carried) => fit.carrying(carried),
            None => fit,
        };
        let mut run = Run::start(fit.seen_by(views.rig(Learned::default())), backend)?;
        let train: Vec<&TrainingView> = views.train.iter().map(|(_, view)| view).collect();
        let held_before_db = held_psnr(&mut run, views)?;
        while !run.is_done() {
            run.step(&train, None)?;
            on_step();
        }
        let held_after_db = held_psnr(&mut run, views)?;
        let fit = run.pause()?;
        let photographs = train.len();
        let non_finite = fit.non_finite();
        Ok((
            fit.into_fitted().to_field(views.timeline),
            RefinementReport { steps, photographs, held_before_db, held_after_db, non_finite },
        ))
    }
}

fn held_psnr(run: &mut Run, views: &TrainingViews) -> Result<Option<f64>, DeviceError> {
    let pictures: Result<Vec<RenderedImage<f32>>, DeviceError> =
        views.held.iter().map(|view| run.render(view)).collect();
    Ok(mean_psnr(views, &pictures?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use codec::{Camera, Temporal};
    use refine::capture::{PhotoId, Response};
    use refine::fit::{Cpu, FRAGMENT_WEIGHT, FrameView, Photograph, Timeline, cpu};

    const TIMELINE: Timeline = Timeline::even(3);

    /// Two Gaussians: a static one and a dynamic one.
    fn field() -> Field {
        Field {
            centers: vec![[-0.3, 0.0, 0.0], [0.3, 0.1, 0.0]],
            rotations: vec![[1.0, 0.0, 0.0, 0.0]; 2],
            log_scales: vec![[-2.0; 3]; 2],
            opacities: vec![0.9, 0.8],
            sh_degree: 0,
            sh: vec![[1.0, 0.0, -1.0], [-1.0, 0.5, 1.0]],
            temporal: Some(Temporal {
                tau: vec![0.5; 2],
                s: vec![2.0; 2],
                motion_order: 1,
                motion: vec![[0.0; 3], [0.0, 0.4, 0.0]],
                rotation_rates: None,
            }),
            ..Field::default()
        }
    }

    /// Photographs of [`field`]; the middle frame is held out.
    fn views() -> TrainingViews {
        views_of(None)
    }

    /// The same before a plate.
    fn views_of(plate: Option<&Field>) -> TrainingViews {
        let mut parameters = Parameters::<f32>::from_field(&field(), TIMELINE);
        if let Some(plate) = plate {
            put_behind(&mut parameters, plate, Carried::FIXED, TIMELINE);
        }
        let view = |camera: usize, frame: usize| {
            let angle = camera as f64;
            let position = [2.0 * angle.sin(), 0.2, 2.0 * angle.cos()];
            let camera_id = camera;
            let camera = Camera::look_at(position, [0.0; 3], [0.0, 1.0, 0.0], 0.9, 32, 32);
            let time = frame as f64;
            let picture = cpu::render(&parameters, &FrameView { camera: &camera, time }).image;
            let byte = |c: f32| (c.clamp(0.0, 1.0) * 255.0).round() as u8;
            let pixels = picture.pixels.iter().map(|pixel| pixel.map(byte)).collect();
            let photograph = Photograph { width: 32, height: 32, pixels, valid: Vec::new() };
            TrainingView { camera_id, camera, time, photograph }
        };
        let train =
            (0..4).flat_map(|camera| [0, 2].map(|frame| (PhotoId { frame, camera }, view(camera, frame))));
        TrainingViews {
            train: train.collect(),
            held: (0..4).map(|camera| view(camera, 1)).collect(),
            timeline: TIMELINE,
            responses: vec![Response::NEUTRAL; 4],
        }
    }

    /// The photographs say next to nothing about the size of a Gaussian that is nearly transparent.
    #[test]
    fn the_fragment_term_shrinks_what_the_photographs_do_not_need() {
        let mut faint = field();
        faint.centers.push([0.0; 3]);
        faint.rotations.push([1.0, 0.0, 0.0, 0.0]);
        faint.log_scales.push([-1.0; 3]);
        faint.opacities.push(0.02);
        faint.sh.push([0.0; 3]);
        let temporal = faint.temporal.as_mut().unwrap();
        temporal.tau.push(0.5);
        temporal.s.push(2.0);
        temporal.motion.push([0.0; 3]);
        let views = views();
        let area = |fragment_weight: f64| -> f32 {
            let refinement = Refinement { views: &views, plate: None, steps: 200, fragment_weight };
            let (refined, _) = refinement.run(&faint, &mut Cpu::default(), || ()).unwrap();
            let [a, b, c] = refined.log_scales[2].map(f32::exp);
            a * b + b * c + c * a
        };
        let [without, with] = [0.0, 0.1].map(area);
        assert!(with < 0.8 * without, "{with} with the term, {without} without");
    }

    #[test]
    fn displaced_rows_return_to_their_places() {
        let mut moved = field();
        moved.centers[0][1] += 0.06;
        moved.sh[1] = [0.0; 3];
        let views = views();
        let mut steps = 0;
        let refinement =
            Refinement { views: &views, plate: None, steps: 400, fragment_weight: FRAGMENT_WEIGHT };
        let (refined, report) = refinement.run(&moved, &mut Cpu::default(), || steps += 1).unwrap();
        assert_eq!((steps, report.steps, report.photographs, report.non_finite), (400, 400, 8, 0));
        let (before, after) = (report.held_before_db.unwrap(), report.held_after_db.unwrap());
        assert!(after > before + 6.0, "{before} {after}");
        assert_eq!(refined.len(), 2);
        let is_near =
            |found: [f32; 3], expected: [f32; 3]| (0..3).all(|i| (found[i] - expected[i]).abs() < 0.03);
        assert!(is_near(refined.centers[0], field().centers[0]), "{:?}", refined.centers);
        assert!((refined.sh[1][2] - 1.0).abs() < 0.35 && refined.sh[1][0] < -0.75, "{:?}", refined.sh);
    }

    /// A gray wall behind the field: photographs show both, and only the field is refined.
    #[test]
    fn what_is_behind_stays_and_is_not_taken_for_the_field() {
        let plate = Field {
            centers: vec![[0.0, 0.0, -0.5]],
            rotations: vec![[1.0, 0.0, 0.0, 0.0]],
            log_scales: vec![[1.0, 1.0, -3.0]],
            opacities: vec![0.99],
            sh: vec![[0.2; 3]],
            ..Field::default()
        };
        let views = views_of(Some(&plate));
        let mut moved = field();
        moved.centers[0][1] += 0.06;
        let refined = |plate| {
            let refinement = Refinement { views: &views, plate, steps: 200, fragment_weight: 0.0 };
            refinement.run(&moved, &mut Cpu::default(), || ()).unwrap()
        };
        let (before, report) = refined(Some(&plate));
        assert_eq!(before.len(), 2, "the plate is no part of the result");
        assert!(report.held_after_db > report.held_before_db, "{report:?}");
        let size = |field: &Field| field.log_scales.iter().map(|scales| scales[0]).fold(-9.0, f32::max);
        let alone = refined(None).0;
        assert!(size(&alone) > size(&before) + 0.2, "without it, the field grows to cover the wall");
    }
}
