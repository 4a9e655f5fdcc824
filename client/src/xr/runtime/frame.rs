//! Frames and images in the order of calls that a runtime demands; the types permit no other.
//!
//! [`Frames::begin`] waits for the time of the next frame and begins it; the [`Frame`] it returns
//! is ended exactly once, with nothing to show if it is dropped. [`Images::acquire`] takes the next
//! image of a swapchain and waits until it is free; the [`Image`] it returns is released exactly
//! once. So neither an error nor a lost head leaves the runtime waiting.

/// The calls for frames.
pub(in crate::xr) trait FrameCalls {
    /// When a frame will be seen.
    type Timing: Copy;
    /// Layers of a frame; the default is none.
    type Layers<'a>: Default;
    type Error;
    fn wait(&mut self) -> Result<Self::Timing, Self::Error>;
    fn begin(&mut self) -> Result<(), Self::Error>;
    fn end(&mut self, timing: Self::Timing, layers: Self::Layers<'_>) -> Result<(), Self::Error>;
}

/// The frames of a session.
pub(in crate::xr) struct Frames<C: FrameCalls>(C);

/// A frame that was begun.
pub(in crate::xr) struct Frame<'f, C: FrameCalls> {
    calls: &'f mut C,
    timing: C::Timing,
    ended: bool,
}

impl<C: FrameCalls> Frames<C> {
    pub(in crate::xr) fn new(calls: C) -> Frames<C> {
        Frames(calls)
    }

    /// Waits until it is time to draw a frame, then begins it.
    pub(in crate::xr) fn begin(&mut self) -> Result<Frame<'_, C>, C::Error> {
        let timing = self.0.wait()?;
        self.0.begin()?;
        Ok(Frame { calls: &mut self.0, timing, ended: false })
    }
}

impl<C: FrameCalls> Frame<'_, C> {
    pub(in crate::xr) fn timing(&self) -> C::Timing {
        self.timing
    }

    /// Ends the frame with its layers.
    pub(in crate::xr) fn end(mut self, layers: C::Layers<'_>) -> Result<(), C::Error> {
        self.ended = true;
        self.calls.end(self.timing, layers)
    }
}

impl<C: FrameCalls> Drop for Frame<'_, C> {
    fn drop(&mut self) {
        if !self.ended {
            // The first error is the one to report.
            let _ = self.calls.end(self.timing, Default::default());
        }
    }
}

/// The calls for the images of a swapchain.
pub(in crate::xr) trait ImageCalls {
    type Error;
    fn acquire(&mut self) -> Result<usize, Self::Error>;
    fn wait(&mut self) -> Result<(), Self::Error>;
    fn release(&mut self) -> Result<(), Self::Error>;
}

/// The images of a swapchain.
pub(in crate::xr) struct Images<C: ImageCalls>(C);

/// An image that may be drawn into.
pub(in crate::xr) struct Image<'i, C: ImageCalls> {
    calls: &'i mut C,
    index: usize,
    released: bool,
}

impl<C: ImageCalls> Images<C> {
    pub(in crate::xr) fn new(calls: C) -> Images<C> {
        Images(calls)
    }

    /// The calls, for the swapchain in them.
    pub(in crate::xr) fn calls(&self) -> &C {
        &self.0
    }

    /// Acquires the next image and waits until the runtime no longer reads it.
    pub(in crate::xr) fn acquire(&mut self) -> Result<Image<'_, C>, C::Error> {
        let index = self.0.acquire()?;
        // Only an image whose wait has ended may be released.
        self.0.wait()?;
        Ok(Image { calls: &mut self.0, index, released: false })
    }
}

impl<C: ImageCalls> Image<'_, C> {
    /// Its number among the images of the swapchain.
    pub(in crate::xr) fn index(&self) -> usize {
        self.index
    }

    /// Releases the image to the runtime. All drawing into it must be submitted.
    pub(in crate::xr) fn release(mut self) -> Result<(), C::Error> {
        self.released = true;
        self.calls.release()
    }
}

impl<C: ImageCalls> Drop for Image<'_, C> {
    fn drop(&mut self) {
        if !self.released {
            let _ = self.calls.release();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Records the calls, and fails at one of them.
    #[derive(Default)]
    struct Log {
        calls: Vec<String>,
        fails: &'static str,
    }

    impl Log {
        fn call(&mut self, name: &str) -> Result<(), String> {
            self.calls.push(name.into());
            if self.fails == name { Err(name.into()) } else { Ok(()) }
        }
    }

    impl FrameCalls for &mut Log {
        type Timing = i64;
        type Layers<'a> = usize;
        type Error = String;
        fn wait(&mut self) -> Result<i64, String> {
            self.call("wait").map(|()| 7)
        }
        fn begin(&mut self) -> Result<(), String> {
            self.call("begin")
        }
        fn end(&mut self, timing: i64, layers: usize) -> Result<(), String> {
            assert_eq!(timing, 7);
            self.call(&format!("end {layers}"))
        }
    }

    impl ImageCalls for &mut Log {
        type Error = String;
        fn acquire(&mut self) -> Result<usize, String> {
            self.call("acquire").map(|()| 2)
        }
        fn wait(&mut self) -> Result<(), String> {
            self.call("wait image")
        }
        fn release(&mut self) -> Result<(), String> {
            self.call("release")
        }
    }

    /// The calls of a frame with the drawing `draw`, and the result.
    fn frame(
        fails: &'static str,
        draw: impl Fn() -> Result<(), String>,
    ) -> (Vec<String>, Result<(), String>) {
        let (mut frames, mut images) = (Log { fails, ..Log::default() }, Log { fails, ..Log::default() });
        let mut run = || {
            let mut frames = Frames::new(&mut frames);
            let frame = frames.begin()?;
            assert_eq!(frame.timing(), 7);
            let mut images = Images::new(&mut images);
            let image = images.acquire()?;
            assert_eq!(image.index(), 2);
            draw()?;
            image.release()?;
            frame.end(1)
        };
        let result = run();
        (frames.calls.into_iter().chain(images.calls).collect(), result)
    }

    #[test]
    fn calls_come_in_order() {
        let (calls, result) = frame("", || Ok(()));
        assert_eq!(calls, ["wait", "begin", "end 1", "acquire", "wait image", "release"]);
        assert_eq!(result, Ok(()));
    }

    #[test]
    fn frames_are_ended_and_images_released_after_errors() {
        let (calls, result) = frame("", || Err("draw".into()));
        assert_eq!(calls, ["wait", "begin", "end 0", "acquire", "wait image", "release"]);
        assert_eq!(result, Err("draw".into()));
        for (fails, expected) in [
            ("wait", vec!["wait"]),
            ("begin", vec!["wait", "begin"]),
            ("acquire", vec!["wait", "begin", "end 0", "acquire"]),
            ("wait image", vec!["wait", "begin", "end 0", "acquire", "wait image"]),
            ("release", vec!["wait", "begin", "end 0", "acquire", "wait image", "release"]),
            ("end 1", vec!["wait", "begin", "end 1", "acquire", "wait image", "release"]),
        ] {
            let (calls, result) = frame(fails, || Ok(()));
            assert_eq!(
                (calls, result),
                (expected.into_iter().map(String::from).collect(), Err(fails.into())),
                "{fails}"
            );
        }
    }
}
