//! [`Refinement`]: a pruned field moves until it looks like the photographs again, each Gaussian
//! where its row is.

use codec::Field;
use refine::fit::{
    self, Backend, DensityRule, DeviceError, Fit, Parameters, RenderedImage, Run, TrainingView,
};
use serde::Serialize;

use super::{Shots, mean_psnr};

/// What a field is refined by.
#[derive(Clone, Copy, Debug)]
pub struct Refinement<'a> {
    /// The photographs.
    pub shots: &'a Shots,
    /// Steps to take.
    pub steps: u64,
}

/// What came of refinement; the fields are keys of the JSON.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RefinementReport {
    /// Steps that were taken.
    pub steps: u64,
    /// Photographs that the field was moved towards.
    pub photographs: usize,
    /// PSNR of the subject in a few held photographs, in dB, before the first step and after the
    /// last; `None` where nothing is held.
    pub held_before_db: Option<f64>,
    /// After the last step.
    pub held_after_db: Option<f64>,
    /// Gradients and moments that were not finite, and so were left out.
    pub non_finite: u64,
}

impl Refinement<'_> {
    /// Moves `field`, which is not empty. The result has its rows in their order. `on_step` is called
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
        let Refinement { shots, steps } = *self;
        let settings =
            fit::FitSettings { steps, floor: 0, rule: DensityRule::Fixed, ..fit::FitSettings::default() };
        let parameters = Parameters::from_field(field, shots.timeline);
        let cameras = shots.train.iter().map(|(_, shot)| &shot.camera);
        let mut run = Run::start(Fit::new(settings, parameters, shots.timeline, cameras), backend)?;
        let train: Vec<&TrainingView> = shots.train.iter().map(|(_, shot)| shot).collect();
        let held_before_db = held_psnr(&mut run, shots)?;
        while !run.is_done() {
            run.step(&train, None)?;
            on_step();
        }
        let held_after_db = held_psnr(&mut run, shots)?;
        let fit = run.pause()?;
        let photographs = train.len();
        let non_finite = fit.non_finite();
        Ok((
            fit.to_field(),
            RefinementReport { steps, photographs, held_before_db, held_after_db, non_finite },
        ))
    }
}

fn held_psnr(run: &mut Run, shots: &Shots) -> Result<Option<f64>, DeviceError> {
    let pictures: Result<Vec<RenderedImage<f32>>, DeviceError> =
        shots.held.iter().map(|shot| run.render(shot)).collect();
    Ok(mean_psnr(shots, &pictures?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use codec::{Camera, Temporal};
    use refine::capture::PhotoId;
    use refine::fit::{Cpu, FrameView, Photograph, Timeline, cpu};

    const TIMELINE: Timeline = Timeline { frames: 3 };

    /// Two blobs, of which one moves.
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
        }
    }

    /// Photographs of [`field`], of which those of the middle frame are held.
    fn shots() -> Shots {
        let parameters = Parameters::<f32>::from_field(&field(), TIMELINE);
        let shot = |camera: usize, frame: usize| {
            let angle = camera as f64;
            let position = [2.0 * angle.sin(), 0.2, 2.0 * angle.cos()];
            let camera = Camera::look_at(position, [0.0; 3], [0.0, 1.0, 0.0], 0.9, 32, 32);
            let frame = frame as f64;
            let picture = cpu::render(&parameters, &FrameView { camera: &camera, frame }).image;
            let byte = |c: f32| (c.clamp(0.0, 1.0) * 255.0).round() as u8;
            let pixels = picture.pixels.iter().map(|&[r, g, b, _]| [r, g, b, 1.0].map(byte)).collect();
            let photograph = Photograph { width: 32, height: 32, pixels, valid: Vec::new() };
            TrainingView { camera, frame, photograph }
        };
        let train =
            (0..4).flat_map(|camera| [0, 2].map(|frame| (PhotoId { frame, camera }, shot(camera, frame))));
        Shots {
            train: train.collect(),
            held: (0..4).map(|camera| shot(camera, 1)).collect(),
            timeline: TIMELINE,
        }
    }

    #[test]
    fn what_was_moved_comes_back_row_by_row() {
        let mut moved = field();
        moved.centers[0][1] += 0.06;
        moved.sh[1] = [0.0; 3];
        let shots = shots();
        let mut steps = 0;
        let tuning = Refinement { shots: &shots, steps: 400 };
        let (tuned, report) = tuning.run(&moved, &mut Cpu::default(), || steps += 1).unwrap();
        assert_eq!((steps, report.steps, report.photographs, report.non_finite), (400, 400, 8, 0));
        let (before, after) = (report.held_before_db.unwrap(), report.held_after_db.unwrap());
        assert!(after > before + 6.0, "{before} {after}");
        assert_eq!(tuned.len(), 2);
        let away = |found: [f32; 3], wanted: [f32; 3]| (0..3).all(|i| (found[i] - wanted[i]).abs() < 0.03);
        assert!(away(tuned.centers[0], field().centers[0]), "{:?}", tuned.centers);
        assert!((tuned.sh[1][2] - 1.0).abs() < 0.35 && tuned.sh[1][0] < -0.75, "{:?}", tuned.sh);
    }
}
