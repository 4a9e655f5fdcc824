//! ONNX Runtime: loaded on first use, and its sessions.

use std::env::consts::{DLL_PREFIX, DLL_SUFFIX};
use std::fmt::Display;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use ort::environment::Environment;
use ort::ep::CPU;
use ort::logging::LogLevel;
use ort::session::Session;
use program::Fault;

/// Environment variable with the path of the library.
const VARIABLE: &str = "ORT_DYLIB_PATH";

/// The runtime, loaded at the first call.
///
/// # Errors
/// [`Fault::Device`] with the remedy.
pub(super) fn environment() -> Result<&'static Environment, Fault> {
    /// A process can have only one.
    static ENVIRONMENT: OnceLock<Result<Environment, String>> = OnceLock::new();
    let environment = ENVIRONMENT.get_or_init(|| {
        let builder = ort::init_from(library()).map_err(|error| one_line(&error))?;
        let environment = builder.with_telemetry(false).build().map_err(|error| one_line(&error))?;
        environment.set_log_level(LogLevel::Fatal);
        Ok(environment)
    });
    environment.as_ref().map_err(|error| {
        Fault::Device(format!(
            "no ONNX Runtime ({error}): install 1.17 or newer (pip install onnxruntime, or libonnxruntime-dev of \
             Debian 13) and set {VARIABLE} to its libonnxruntime.so"
        ))
    })
}

/// Path of the library, or its name for the system's search.
fn library() -> PathBuf {
    match std::env::var_os(VARIABLE).filter(|path| !path.is_empty()) {
        // Relative paths are the user's, not the program's.
        Some(path) => std::path::absolute(&path).unwrap_or_else(|_| path.into()),
        None => format!("{DLL_PREFIX}onnxruntime{DLL_SUFFIX}").into(),
    }
}

/// A session of the model at `path` that frees its memory when dropped: it uses no arena.
///
/// # Errors
/// The runtime's message.
pub(super) fn session(path: &Path) -> Result<Session, String> {
    let environment = environment().map_err(|fault| fault.to_string())?;
    let builder = Session::builder(environment).map_err(|error| error.to_string())?;
    let builder = builder.with_memory_pattern(false).map_err(|error| error.to_string())?;
    let cpu = CPU::default().with_arena_allocator(false).build();
    let mut builder = builder.with_execution_providers([cpu]).map_err(|error| error.to_string())?;
    builder.commit_from_file(path).map_err(|error| error.to_string())
}

/// Joins the lines of a message.
pub(super) fn one_line(message: &impl Display) -> String {
    message.to_string().split_whitespace().collect::<Vec<_>>().join(" ")
}
