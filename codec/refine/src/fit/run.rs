//! [`Run`]: one step after the other.

use super::{Backend, DensityChange, DeviceError, Fit, Lpips, Pace, Picture, Shot, Step, decay};

/// A fit on its way: its Gaussians are with a back end.
pub struct Run<'a> {
    fit: Fit,
    backend: &'a mut dyn Backend,
    /// Number of Gaussians.
    count: usize,
    change: DensityChange,
}

impl Fit {
    /// Goes on with it.
    ///
    /// # Errors
    /// A [`DeviceError`], where the Gaussians do not fit on the device.
    pub fn run(mut self, backend: &mut dyn Backend) -> Result<Run<'_>, DeviceError> {
        let count = self.len();
        backend.load(self.take())?;
        Ok(Run { fit: self, backend, count, change: DensityChange::default() })
    }
}

impl Run<'_> {
    /// Takes a step on one of `shots`; all get their turn before any has its next, in an order that
    /// chance decides.
    ///
    /// # Errors
    /// A [`DeviceError`]; the run is then over.
    ///
    /// # Panics
    /// If there are no shots.
    pub fn step_on(&mut self, shots: &[&Shot], lpips: Option<&Lpips<f32>>) -> Result<Step, DeviceError> {
        let fit = &mut self.fit;
        let shot = shots[turn(fit.step, shots.len(), fit.settings.seed)];
        let pace = Pace {
            rates: fit.rates.scaled(decay(fit.step as usize, fit.settings.steps as usize)),
            bounds: fit.bounds,
            detached: fit.settings.detached,
            lpips,
        };
        let step = self.backend.step(shot, &pace)?;
        fit.non_finite += step.non_finite as u64;
        fit.step += 1;
        self.change = DensityChange::default();
        if fit.is_control_due(self.count) {
            fit.put(self.backend.store()?);
            self.change = fit.control();
            self.count = fit.len();
            self.backend.load(fit.take())?;
        }
        Ok(step)
    }

    /// Gaussians that were added, moved and taken after the last step.
    pub fn change(&self) -> DensityChange {
        self.change
    }

    /// Draws what the camera of `shot` sees.
    ///
    /// # Errors
    /// A [`DeviceError`].
    pub fn draw(&mut self, shot: &Shot) -> Result<Picture<f32>, DeviceError> {
        self.backend.draw(&shot.view())
    }

    /// The fit as it is now.
    ///
    /// # Errors
    /// A [`DeviceError`]; what was done since the run began is then lost.
    pub fn pause(mut self) -> Result<Fit, DeviceError> {
        self.fit.put(self.backend.store()?);
        Ok(self.fit)
    }

    /// Name of the back end.
    pub fn backend(&self) -> String {
        self.backend.name()
    }

    /// Steps done.
    pub fn step(&self) -> u64 {
        self.fit.step()
    }

    /// Whether all steps are done.
    pub fn is_done(&self) -> bool {
        self.fit.is_done()
    }

    /// Number of Gaussians.
    pub fn len(&self) -> usize {
        self.count
    }

    /// Whether there are no Gaussians.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }
}

/// Which of `count` has its turn at `step`: each once in every `count` steps, in an order that chance
/// decides anew each time.
fn turn(step: u64, count: usize, seed: u64) -> usize {
    let (round, place) = (step / count as u64, (step % count as u64) as usize);
    let mut order: Vec<usize> = (0..count).collect();
    fastrand::Rng::with_seed(seed ^ round.wrapping_mul(0x9e37_79b9_7f4a_7c15)).shuffle(&mut order);
    order[place]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_shot_has_its_turn_before_any_has_its_next() {
        let round = |round: u64| -> Vec<usize> { (0..7).map(|i| turn(7 * round + i, 7, 3)).collect() };
        for i in 0..5 {
            let mut sorted = round(i);
            sorted.sort_unstable();
            assert_eq!(sorted, [0, 1, 2, 3, 4, 5, 6]);
        }
        assert_ne!(round(0), round(1), "in another order");
    }
}
