//! The runtime's calls for frames and images, behind the order that [`super::frame`] proves, and
//! [`Stopwatch`], which measures the time spent in them.

use std::cell::Cell;
use std::rc::Rc;
use std::sync::Arc;
use std::time::{Duration, Instant};

use openxr as xr;

use super::Blends;
use super::frame::{FrameCalls, ImageCalls};
use crate::gpu::Gpu;

/// Sums the time that a frame spends in the runtime and the driver.
#[derive(Clone, Default)]
pub(in crate::xr) struct Stopwatch(Rc<Cell<Duration>>);

impl Stopwatch {
    /// Measures a call into the runtime or the driver.
    pub(in crate::xr) fn time<T>(&self, call: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let result = call();
        self.0.set(self.0.get() + start.elapsed());
        result
    }

    /// The sum since the last call of `take`.
    pub(in crate::xr) fn take(&self) -> Duration {
        self.0.take()
    }
}

/// When a frame will be seen.
#[derive(Clone, Copy, Debug)]
pub(in crate::xr) struct Timing {
    /// In nanoseconds, on the clock of the runtime.
    pub(in crate::xr) display_ns: i64,
    /// Nanoseconds between two images of the display; 0 if the runtime does not know.
    pub(in crate::xr) period_ns: i64,
    /// Whether the viewer will see it.
    pub(in crate::xr) visible: bool,
}

/// What a frame shows, back to front.
pub(in crate::xr) type Layers<'a> = &'a [&'a xr::CompositionLayerBase<'a, xr::Vulkan>];

/// Display times of frames, also of those for which the runtime predicts none.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::xr) struct DisplayClock {
    last: Option<(i64, Instant)>,
}

impl DisplayClock {
    /// The display time of a frame that begins at `now`, in nanoseconds on the clock of the runtime. The specification
    /// has positive times only, and a session would end with the first call that gets another one; so a
    /// `predicted_ns` that is not positive is replaced by the last time and what has passed since.
    fn display_ns(&mut self, predicted_ns: i64, now: Instant) -> i64 {
        let passed = |(ns, at): (i64, Instant)| ns + now.duration_since(at).as_nanos() as i64;
        let display_ns = if predicted_ns > 0 { predicted_ns } else { self.last.map_or(1, passed) };
        self.last = Some((display_ns, now));
        display_ns
    }
}

/// The calls for frames.
pub(in crate::xr) struct SessionFrames {
    pub(in crate::xr) waiter: xr::FrameWaiter,
    pub(in crate::xr) stream: xr::FrameStream<xr::Vulkan>,
    pub(in crate::xr) blends: Blends,
    /// Whether the room shows behind the layers, also of frames that end without one.
    pub(in crate::xr) passthrough: bool,
    pub(in crate::xr) stopwatch: Stopwatch,
    pub(in crate::xr) rate: DisplayRate,
    pub(in crate::xr) clock: DisplayClock,
}

/// Images per second of the display, if the runtime reports them.
#[derive(Clone, Debug, Default)]
pub(in crate::xr) struct DisplayRate(Rc<Cell<Option<f32>>>);

impl DisplayRate {
    /// Sets the rate; a rate that is not positive is unknown.
    pub(in crate::xr) fn set(&self, hz: f32) {
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
            display_ns: self.clock.display_ns(state.predicted_display_time.as_nanos(), Instant::now()),
            period_ns: self.rate.period_ns(state.predicted_display_period.as_nanos()),
            visible: state.should_render,
        })
    }

    fn begin(&mut self) -> xr::Result<()> {
        self.stream.begin()
    }

    fn end(&mut self, timing: Timing, layers: Layers<'_>) -> xr::Result<()> {
        let blend = self.blends.mode(self.passthrough);
        let time = xr::Time::from_nanos(timing.display_ns);
        self.stopwatch.time(|| self.stream.end(time, blend, layers))
    }
}

/// The calls for images.
pub(in crate::xr) struct SwapchainImages {
    pub(in crate::xr) swapchain: xr::Swapchain<xr::Vulkan>,
    pub(in crate::xr) stopwatch: Stopwatch,
    /// The device that draws into them.
    pub(in crate::xr) gpu: Arc<Gpu>,
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

    fn finish(&mut self) {
        // A lost device, which the frames report, draws no more.
        let _ = self.gpu.wait();
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

    #[test]
    fn frames_without_a_predicted_time_continue_the_clock() {
        let (start, mut clock) = (Instant::now(), DisplayClock::default());
        let mut at = |predicted_ns, ms| clock.display_ns(predicted_ns, start + Duration::from_millis(ms));
        assert_eq!([at(0, 0), at(0, 10), at(-5, 11)], [1, 10_000_001, 11_000_001], "it never predicts");
        assert_eq!(
            [at(700_000_000, 20), at(0, 33), at(724_000_000, 40)],
            [700_000_000, 713_000_000, 724_000_000]
        );
    }
}
