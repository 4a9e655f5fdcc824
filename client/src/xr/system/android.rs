//! [`System`] on Android: the OpenXR loader is in the APK, and the activity's events may end the program.

#![allow(unsafe_code, reason = "a library is loaded, and references of Java's are handed over")]

use std::path::PathBuf;
use std::time::{Duration, Instant};

use android_activity::{AndroidApp, InputStatus, MainEvent, PollEvent};
use codec::Limits;
use openxr as xr;
use program::Fault;

use crate::headset::interaction::PlacementStore;
use crate::xr::system::memory;

/// Interval between looks for events while another program has the headset.
const PAUSED_REST: Duration = Duration::from_millis(250);

/// The operating system, as a player needs it.
pub(in crate::xr) struct System {
    /// For the loader and the runtime. It refers to objects of `app`.
    platform: xr::AndroidPlatformInfo,
    app: AndroidApp,
    paused: bool,
    destroyed: bool,
}

impl System {
    /// The system as the activity `app` sees it.
    pub(in crate::xr) fn new(app: AndroidApp) -> System {
        // SAFETY: both pointers are what their functions are named for, and valid as long as `app`.
        let platform = unsafe { xr::AndroidPlatformInfo::new(app.vm_as_ptr(), app.activity_as_ptr()) };
        System { platform, app, paused: false, destroyed: false }
    }

    /// Loads the OpenXR loader and initialises it for the activity.
    ///
    /// # Errors
    /// [`Fault::Device`] with the remedy.
    pub(in crate::xr) fn entry(&self) -> Result<xr::Entry, Fault> {
        // SAFETY: the library with this name is the OpenXR loader of the APK.
        unsafe { xr::Entry::load(&self.platform) }.map_err(|error| {
            Fault::Device(format!("the OpenXR loader in the APK does not start: pack a newer one: {error}"))
        })
    }

    /// Starts the runtime with these extensions and the extension that passes the activity on.
    ///
    /// # Errors
    /// The code of the loader or the runtime.
    pub(in crate::xr) fn start(
        &self,
        entry: &xr::Entry,
        application: &xr::ApplicationInfo<'_>,
        extensions: &xr::ExtensionSet,
    ) -> xr::Result<xr::Instance> {
        let mut extensions = extensions.clone();
        extensions.khr_android_create_instance = true;
        entry.create_instance(application, &extensions, &[], &self.platform)
    }

    /// Handles the activity's events for `time`, or longer while the activity is paused; returns whether the
    /// program has to end now.
    pub(in crate::xr) fn wait(&mut self, time: Duration) -> bool {
        let rest = if self.paused && !time.is_zero() { time.max(PAUSED_REST) } else { time };
        let until = Instant::now() + rest;
        let mut waiting = true;
        while waiting && !self.destroyed {
            let app = self.app.clone();
            app.poll_events(Some(until.saturating_duration_since(Instant::now())), |event| match event {
                PollEvent::Main(event) => self.take(&event),
                _ => waiting = false,
            });
        }
        self.destroyed
    }

    fn take(&mut self, event: &MainEvent<'_>) {
        match event {
            MainEvent::Resume { .. } => self.paused = false,
            MainEvent::Pause => self.paused = true,
            MainEvent::Destroy => self.destroyed = true,
            MainEvent::LowMemory => log::warn!("the headset runs out of memory"),
            // Controllers come through the runtime. All other input goes back to the system, which takes a
            // program that leaves it in the queue for a hung one.
            MainEvent::InputAvailable => match self.app.input_events_iter() {
                Ok(mut inputs) => while inputs.next(|_| InputStatus::Unhandled) {},
                Err(error) => log::warn!("input events: {error}"),
            },
            // The activity's window stays empty: the runtime has its own.
            _ => {}
        }
    }

    /// Limits on clips that fit the headset's memory.
    pub(in crate::xr) fn limits(&self) -> Limits {
        let total_bytes = memory::total_bytes();
        let limits = memory::clip_limits(total_bytes);
        log::info!("{} MiB of memory, {limits:?}", total_bytes >> 20);
        limits
    }

    /// The store of placements; `None` if the system has no place for it.
    pub(in crate::xr) fn store(&self) -> Option<PlacementStore> {
        self.app.internal_data_path().map(|folder| PlacementStore::open(&folder))
    }

    /// The folder in which the volume is remembered; `None` if the system has no place for it.
    pub(in crate::xr) fn state_dir(&self) -> Option<PathBuf> {
        self.app.internal_data_path()
    }

    /// The folder in which downloads are cached, which the system empties when it needs room; `None` if
    /// there is none.
    pub(in crate::xr) fn cache_dir(&self) -> Option<PathBuf> {
        super::intent::cache_folder(&self.app).map(|folder| folder.join("clips"))
    }

    /// The folder for compiled pipelines, which the system empties like the folder of downloads; `None` if there is
    /// none.
    pub(in crate::xr) fn pipelines(&self) -> Option<PathBuf> {
        super::intent::cache_folder(&self.app).map(|folder| folder.join("pipelines"))
    }
}
