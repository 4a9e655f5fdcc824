//! The runtime's calls for frames and images, behind the order that [`super::frame`] proves, and
//! [`Stopwatch`], which measures the time spent in them.

use std::cell::Cell;
use std::rc::Rc;
use std::time::{Duration, Instant};

use openxr as xr;

use super::frame::{FrameCalls, ImageCalls};
use super::runtime::Blends;

/// Sums the time that a frame spends in the runtime and the driver.
#[derive(Clone, Default)]
pub(super) struct Stopwatch(Rc<Cell<Duration>>);

impl Stopwatch {
    /// Measures a call into the runtime or the driver.
    pub(super) fn time<T>(&self, call: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let result = call();
        self.0.set(self.0.get() + start.elapsed());
        result
    }

    /// The sum since the last call of `take`.
    pub(super) fn take(&self) -> Duration {
        self.0.take()
    }
}

/// When a frame will be seen.
#[derive(Clone, Copy, Debug)]
pub(super) struct Timing {
    /// In nanoseconds, on the clock of the runtime.
    pub(super) display_ns: i64,
    /// Nanoseconds between two images of the display; 0 if the runtime does not know.
    pub(super) period_ns: i64,
    /// Whether the viewer will see it.
    pub(super) visible: bool,
}

/// What a frame shows.
#[derive(Default)]
pub(super) struct Layers<'a> {
    /// Back to front.
    pub(super) layers: &'a [&'a xr::CompositionLayerBase<'a, xr::Vulkan>],
    /// Whether the room shows behind them.
    pub(super) passthrough: bool,
}

/// The calls for frames.
pub(super) struct SessionFrames {
    pub(super) waiter: xr::FrameWaiter,
    pub(super) stream: xr::FrameStream<xr::Vulkan>,
    pub(super) blends: Blends,
    pub(super) stopwatch: Stopwatch,
    pub(super) rate: DisplayRate,
}

/// Images per second of the display, if the runtime reports them.
#[derive(Clone, Debug, Default)]
pub(super) struct DisplayRate(Rc<Cell<Option<f32>>>);

impl DisplayRate {
    /// Sets the rate; a rate that is not positive is unknown.
    pub(super) fn set(&self, hz: f32) {
        self.0.set(Some(hz).filter(|hz| *hz > 0.0));
    }

    /// Nanoseconds between two images. The `predicted_ns` of a frame is the fallback: some runtimes
    /// predict the interval of late frames instead of the display's.
    fn period_ns(&self, predicted_ns: i64) -> i64 {
        self.0.get().map_or(predicted_ns, |hz| (1e9 / f64::from(hz)).round() as i64)
    }
}

impl FrameCalls for SessionFrames {
    type Timing = Timing;
    type Layers<'a> = Layers<'a>;
    type Error = xr::sys::Result;

    fn wait(&mut self) -> xr::Result<Timing> {
        let state = self.waiter.wait()?;
        Ok(Timing {
            display_ns: state.predicted_display_time.as_nanos(),
            period_ns: self.rate.period_ns(state.predicted_display_period.as_nanos()),
            visible: state.should_render,
        })
    }

    fn begin(&mut self) -> xr::Result<()> {
        self.stream.begin()
    }

    fn end(&mut self, timing: Timing, layers: Layers<'_>) -> xr::Result<()> {
        let blend = self.blends.mode(layers.passthrough);
        let time = xr::Time::from_nanos(timing.display_ns);
        self.stopwatch.time(|| self.stream.end(time, blend, layers.layers))
    }
}

/// The calls for images.
pub(super) struct SwapchainImages {
    pub(super) swapchain: xr::Swapchain<xr::Vulkan>,
    pub(super) stopwatch: Stopwatch,
}

impl ImageCalls for SwapchainImages {
    type Error = xr::sys::Result;

    fn acquire(&mut self) -> xr::Result<usize> {
        self.stopwatch.time(|| self.swapchain.acquire_image()).map(|index| index as usize)
    }

    fn wait(&mut self) -> xr::Result<()> {
        // Only an image whose wait has ended may be drawn into or released.
        self.stopwatch.time(|| self.swapchain.wait_image(xr::Duration::INFINITE))
    }

    fn release(&mut self) -> xr::Result<()> {
        self.stopwatch.time(|| self.swapchain.release_image())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn late_frames_do_not_change_the_period_of_the_display() {
        let rate = DisplayRate::default();
        assert_eq!(rate.period_ns(16_000_000), 16_000_000, "nothing better is known");
        rate.set(90.0);
        assert_eq!(rate.period_ns(350_000_000), 11_111_111);
        rate.set(72.0);
        assert_eq!(rate.period_ns(11_111_111), 13_888_889);
        rate.set(0.0);
        assert_eq!(rate.period_ns(5), 5);
    }
}
