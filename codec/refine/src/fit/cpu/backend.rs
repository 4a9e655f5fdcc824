//! [`Cpu`]: the cores of the machine as a back end.

use crate::fit::{
    Backend, DeviceError, Gaussians, Gradient, Pace, Picture, Shot, Step, View, adam, cpu, loss,
};

/// All cores of the machine. The same bits for any number of them.
#[derive(Clone, Debug, Default)]
pub struct Cpu {
    loaded: Option<Gaussians>,
}

impl Cpu {
    fn loaded(&mut self) -> &mut Gaussians {
        self.loaded.as_mut().expect("Gaussians were loaded")
    }
}

impl Backend for Cpu {
    fn name(&self) -> String {
        "cpu".into()
    }

    fn load(&mut self, gaussians: Gaussians) -> Result<(), DeviceError> {
        self.loaded = Some(gaussians);
        Ok(())
    }

    fn draw(&mut self, view: &View) -> Result<Picture<f32>, DeviceError> {
        Ok(cpu::draw(&self.loaded().parameters, view).picture)
    }

    fn step(&mut self, shot: &Shot, pace: &Pace) -> Result<Step, DeviceError> {
        let Gaussians { parameters, moments, pulls } = self.loaded();
        let drawing = cpu::draw(parameters, &shot.view());
        let loss = loss(&drawing.picture.pixels, &shot.photograph, pace.lpips);
        let Gradient { rows, values, screen, non_finite } =
            drawing.backward(parameters, &shot.view(), &loss.gradient, pace.detached);
        let skipped = adam(parameters, moments, &rows, &values, &pace.rates, &pace.bounds);
        pulls.note(&rows, &screen);
        Ok(Step { loss: loss.value, drawn: rows.len(), non_finite: non_finite + skipped })
    }

    fn store(&mut self) -> Result<Gaussians, DeviceError> {
        Ok(self.loaded.take().expect("Gaussians were loaded"))
    }

    fn peak_device_bytes(&self) -> Option<u64> {
        None
    }
}
