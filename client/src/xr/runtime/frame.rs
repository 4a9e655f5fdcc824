//! Frames and images in the order of calls that a runtime demands; the types permit no other.
//!
//! [`Frames::begin`] waits for the time of the next frame and begins it; the [`Frame`] it returns
//! is ended exactly once, with nothing to show if it is dropped. [`Images::acquire`] takes the next
//! image of a swapchain and waits until it is free; the [`Image`] it returns is released exactly
//! once. So neither an error nor a lost head leaves the runtime waiting. Dropping [`Images`] waits for
//! the drawing into them, because the runtime destroys images even while they are drawn into.

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

    /// The calls, for the settings in them.
    pub(in crate::xr) fn calls(&mut self) -> &mut C {
        self.calls
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
            // The first error is reported, and not this call's.
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
    /// Waits until all submitted drawing into the images is done.
    fn finish(&mut self);
}

/// The images of a swapchain, which go with it after all drawing into them.
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

impl<C: ImageCalls> Drop for Images<C> {
    fn drop(&mut self) {
        self.0.finish();
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
    use std::cell::RefCell;

    use super::*;

    /// Records the calls for frames and images in the order in which they come, and fails at one of them.
    #[derive(Default)]
    struct Log {
        calls: RefCell<Vec<String>>,
        fails: &'static str,
    }

    impl Log {
        fn call(&self, name: &str) -> Result<(), String> {
            self.calls.borrow_mut().push(name.into());
            if self.fails == name { Err(name.into()) } else { Ok(()) }
        }
    }

    impl FrameCalls for &Log {
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

    impl ImageCalls for &Log {
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
        fn finish(&mut self) {
            // Nothing can fail here.
            let _ = self.call("finish");
        }
    }

    /// The calls of a session of one frame with the drawing `draw`, and the result.
    fn session(
        fails: &'static str,
        draw: impl Fn() -> Result<(), String>,
    ) -> (Vec<String>, Result<(), String>) {
        let log = Log { fails, ..Log::default() };
        let (mut frames, mut images) = (Frames::new(&log), Images::new(&log));
        let mut run = || {
            let frame = frames.begin()?;
            assert_eq!(frame.timing(), 7);
            let image = images.acquire()?;
            assert_eq!(image.index(), 2);
            draw()?;
            image.release()?;
            frame.end(1)
        };
        let result = run();
        drop(images);
        (log.calls.into_inner(), result)
    }

    #[test]
    fn calls_come_in_order() {
        let (calls, result) = session("", || Ok(()));
        assert_eq!(calls, ["wait", "begin", "acquire", "wait image", "release", "end 1", "finish"]);
        assert_eq!(result, Ok(()));
    }

    #[test]
    fn frames_are_ended_and_images_released_after_errors() {
        let (calls, result) = session("", || Err("draw".into()));
        assert_eq!(calls, ["wait", "begin", "acquire", "wait image", "release", "end 0", "finish"]);
        assert_eq!(result, Err("draw".into()));
        for (fails, expected) in [
            ("wait", &["wait"][..]),
            ("begin", &["wait", "begin"]),
            ("acquire", &["wait", "begin", "acquire", "end 0"]),
            ("wait image", &["wait", "begin", "acquire", "wait image", "end 0"]),
            ("release", &["wait", "begin", "acquire", "wait image", "release", "end 0"]),
            ("end 1", &["wait", "begin", "acquire", "wait image", "release", "end 1"]),
        ] {
            let (calls, result) = session(fails, || Ok(()));
            assert_eq!(
                (calls, result),
                ([expected, &["finish"]].concat().into_iter().map(String::from).collect(), Err(fails.into())),
                "{fails}"
            );
        }
    }

    #[test]
    fn images_wait_for_drawing_even_if_opening_fails_after_it() {
        let log = Log::default();
        let open = || -> Result<(), String> {
            let mut images = Images::new(&log);
            images.acquire()?.release()?;
            Err("the next step".into())
        };
        assert!(open().is_err());
        assert_eq!(*log.calls.borrow(), ["acquire", "wait image", "release", "finish"]);
    }
}
