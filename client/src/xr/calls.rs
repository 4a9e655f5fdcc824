//! The runtime's calls for frames and images, behind the order that [`super::frame`] proves, and
//! [`Watch`], the time spent in them.

use std::cell::Cell;
use std::rc::Rc;
use std::time::{Duration, Instant};

use openxr as xr;

use super::frame::{FrameCalls, ImageCalls};
use super::runtime::Blends;

/// Adds up the time that a frame spends in the runtime and the driver.
#[derive(Clone, Default)]
pub(super) struct Watch(Rc<Cell<Duration>>);

impl Watch {
    /// Makes a call that is not ours.
    pub(super) fn time<T>(&self, call: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let result = call();
        self.0.set(self.0.get() + start.elapsed());
        result
    }

    /// What has added up since the last time.
    pub(super) fn take(&self) -> Duration {
        self.0.take()
    }
}

/// When a frame will be seen.
#[derive(Clone, Copy, Debug)]
pub(super) struct Timing {
    /// In nanoseconds, on the clock of the runtime.
    pub(super) display_ns: i64,
    /// From frame to frame.
    pub(super) period_ns: i64,
    /// Whether anybody will see it.
    pub(super) visible: bool,
}

/// What a frame shows.
#[derive(Default)]
pub(super) struct Layers<'a> {
    /// Back to front.
    pub(super) layers: &'a [&'a xr::CompositionLayerBase<'a, xr::Vulkan>],
    /// Whether the room shows behind them.
    pub(super) see_through: bool,
}

/// The calls for frames.
pub(super) struct SessionFrames {
    pub(super) waiter: xr::FrameWaiter,
    pub(super) stream: xr::FrameStream<xr::Vulkan>,
    pub(super) blends: Blends,
    pub(super) watch: Watch,
}

impl FrameCalls for SessionFrames {
    type Timing = Timing;
    type Layers<'a> = Layers<'a>;
    type Error = xr::sys::Result;

    fn wait(&mut self) -> xr::Result<Timing> {
        let state = self.waiter.wait()?;
        Ok(Timing {
            display_ns: state.predicted_display_time.as_nanos(),
            period_ns: state.predicted_display_period.as_nanos(),
            visible: state.should_render,
        })
    }

    fn begin(&mut self) -> xr::Result<()> {
        self.stream.begin()
    }

    fn end(&mut self, timing: Timing, shown: Layers<'_>) -> xr::Result<()> {
        let blend = self.blends.mode(shown.see_through);
        let time = xr::Time::from_nanos(timing.display_ns);
        self.watch.time(|| self.stream.end(time, blend, shown.layers))
    }
}

/// The calls for images.
pub(super) struct SwapchainImages {
    pub(super) swapchain: xr::Swapchain<xr::Vulkan>,
    pub(super) watch: Watch,
}

impl ImageCalls for SwapchainImages {
    type Error = xr::sys::Result;

    fn acquire(&mut self) -> xr::Result<usize> {
        self.watch.time(|| self.swapchain.acquire_image()).map(|index| index as usize)
    }

    fn wait(&mut self) -> xr::Result<()> {
        // An image that is not waited for to the end may be neither drawn into nor released.
        self.watch.time(|| self.swapchain.wait_image(xr::Duration::INFINITE))
    }

    fn release(&mut self) -> xr::Result<()> {
        self.watch.time(|| self.swapchain.release_image())
    }
}
