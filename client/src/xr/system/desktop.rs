//! [`System`] on a desktop: the OpenXR loader is a library of the system, and no event ends the program.

#![allow(unsafe_code, reason = "a library is loaded")]

use std::path::PathBuf;
use std::time::Duration;

use codec::Limits;
use openxr as xr;
use program::Fault;

use crate::headset::interaction::PlacementStore;
use crate::{content, folders};

/// The operating system, as a player needs it.
pub(in crate::xr) struct System;

impl System {
    /// Loads the OpenXR loader.
    ///
    /// # Errors
    /// [`Fault::Device`] that names the package to install.
    pub(in crate::xr) fn entry(&self) -> Result<xr::Entry, Fault> {
        // SAFETY: the library with this name is the system's OpenXR loader.
        unsafe { xr::Entry::load(&()) }.map_err(|error| {
            log::info!("{error}");
            Fault::Device(
                "no OpenXR loader was found: install it (Debian and Ubuntu: apt-get install libopenxr-loader1)"
                    .into(),
            )
        })
    }

    /// Starts the runtime with these extensions.
    ///
    /// # Errors
    /// The code of the loader or the runtime.
    pub(in crate::xr) fn start(
        &self,
        entry: &xr::Entry,
        application: &xr::ApplicationInfo<'_>,
        extensions: &xr::ExtensionSet,
    ) -> xr::Result<xr::Instance> {
        entry.create_instance(application, extensions, &[], &())
    }

    /// Waits for `time`; returns whether the program has to end now.
    pub(in crate::xr) fn wait(&mut self, time: Duration) -> bool {
        if !time.is_zero() {
            std::thread::sleep(time);
        }
        false
    }

    /// Limits on clips of a desktop.
    pub(in crate::xr) fn limits(&self) -> Limits {
        Limits::default()
    }

    /// The store of placements; `None` if the system has no place for it.
    pub(in crate::xr) fn store(&self) -> Option<PlacementStore> {
        folders::state().map(|folder| PlacementStore::open(&folder))
    }

    /// The folder in which the volume is remembered; `None` if the system has no place for it.
    pub(in crate::xr) fn state_dir(&self) -> Option<PathBuf> {
        folders::state()
    }

    /// The folder in which downloads are cached; `None` if the system has no place for them.
    pub(in crate::xr) fn cache_dir(&self) -> Option<PathBuf> {
        content::cache_dir()
    }

    /// The folder for compiled pipelines; `None` if the system has no place for them.
    pub(in crate::xr) fn pipelines(&self) -> Option<PathBuf> {
        folders::pipelines()
    }
}
