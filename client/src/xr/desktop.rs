//! [`System`] on a desktop: the loader is a library of the system's, and nobody interrupts.

#![allow(unsafe_code, reason = "a library is loaded")]

use std::path::PathBuf;
use std::time::Duration;

use openxr as xr;
use program::Fault;

use super::interaction::PlacementStore;
use crate::{clips, folders};

/// What the operating system gives a player and asks of it.
pub(super) struct System;

impl System {
    /// Loads the OpenXR loader.
    ///
    /// # Errors
    /// [`Fault::Device`] that says what to install.
    pub(super) fn entry(&self) -> Result<xr::Entry, Fault> {
        // SAFETY: the OpenXR loader of the system is what it says.
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
    /// What the loader or the runtime says.
    pub(super) fn start(
        &self,
        entry: &xr::Entry,
        application: &xr::ApplicationInfo<'_>,
        extensions: &xr::ExtensionSet,
    ) -> xr::Result<xr::Instance> {
        entry.create_instance(application, extensions, &[], &())
    }

    /// Waits for this long; whether the program has to end now.
    pub(super) fn wait(&mut self, time: Duration) -> bool {
        if !time.is_zero() {
            std::thread::sleep(time);
        }
        false
    }

    /// Where the placements of clips are remembered; `None` where there is no place for them.
    pub(super) fn store(&self) -> Option<PlacementStore> {
        folders::state().map(|folder| PlacementStore::open(&folder))
    }

    /// Where clips from the network are kept; `None` where there is no place for them.
    pub(super) fn cache_dir(&self) -> Option<PathBuf> {
        clips::cache_dir()
    }
}
