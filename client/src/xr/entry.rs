//! Android's entry point of the library, and the preparation before a clip plays.
//!
//! Android's NativeActivity loads the library and runs [`android_main`] on a thread of its own, which plays until the viewer
//! or the system ends it. The runtime derives the session's states from the activity's, so that only the session decides
//! what the viewer sees; the activity's own events must still be handled promptly, because the system waits for that.
//!
//! The working directory is the folder that the owner of the headset can reach over USB, so that names of clips and outputs
//! need no path.

#![allow(unsafe_code, reason = "the name of the entry point is fixed")]

use std::borrow::Cow;
use std::path::PathBuf;
use std::sync::OnceLock;

use android_activity::AndroidApp;
use log::LevelFilter;
use ndk::asset::AssetManager;
use program::Fault;

use crate::content::redacted;
use crate::xr::system::{System, Trust, command_line, read_intent};

/// Log filter: messages of this program, and warnings of everything else.
const LOG_FILTER: &str = "warn,client=info";

/// Tag of this program's lines in the log.
const LOG_TAG: &str = "aarc";

/// The assets of the APK, which belong to the process rather than to one activity.
static ASSETS: OnceLock<AssetManager> = OnceLock::new();

/// Plays until the viewer leaves or the activity is destroyed. Returning ends the activity.
// SAFETY: no other symbol has this name, and the activity's glue calls a function of this type.
#[unsafe(no_mangle)]
fn android_main(app: AndroidApp) {
    log_to_system();
    match play(app) {
        Ok(()) => log::info!("the end"),
        Err(fault) => log::error!("{fault}"),
    }
}

fn play(app: AndroidApp) -> Result<(), Fault> {
    ASSETS.get_or_init(|| app.asset_manager());
    crate::content::demo::set_reader(demo);
    let folders: Vec<PathBuf> =
        [app.external_data_path(), app.internal_data_path()].into_iter().flatten().collect();
    if let Some(folder) = folders.first()
        && let Err(error) = std::env::set_current_dir(folder)
    {
        log::warn!("{}: {error}: clips have to be named with their paths", folder.display());
    }
    let trust = if cfg!(debug_assertions) { Trust::All } else { Trust::Playback };
    let args = command_line(read_intent(&app), &folders, trust)?;
    let names: Vec<String> = args.clips.iter().map(|name| redacted(name)).collect();
    log::info!("playing {}", if names.is_empty() { "the demo clip".into() } else { names.join(", ") });
    crate::xr::run::play(&args, &mut System::new(app))
}

/// Sends log messages and panics to the system's log. A process may run several activities one after the
/// other; the first one sets up the log for all.
fn log_to_system() {
    static ONCE: OnceLock<()> = OnceLock::new();
    ONCE.get_or_init(|| {
        let filter = android_logger::FilterBuilder::new().parse(LOG_FILTER).build();
        android_logger::init_once(
            android_logger::Config::default()
                .with_max_level(LevelFilter::Info)
                .with_tag(LOG_TAG)
                .with_filter(filter),
        );
        std::panic::set_hook(Box::new(|panic| log::error!("{panic}")));
    });
}

/// Reads the demo clip, an asset.
///
/// # Errors
/// [`Fault::Data`] if the APK was packed without it.
fn demo() -> Result<Cow<'static, [u8]>, Fault> {
    let asset = ASSETS.get().and_then(|assets| assets.open(c"demo.aarc"));
    let mut asset = asset.ok_or_else(|| Fault::Data("demo clip: the APK was packed without it".into()))?;
    let bytes = asset.buffer().map_err(|error| Fault::Data(format!("demo clip: {error}")))?;
    Ok(Cow::Owned(bytes.to_vec()))
}
