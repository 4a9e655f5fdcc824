//! ONNX Runtime: found and loaded when it is needed, and sessions of it.

use std::env::consts::{DLL_PREFIX, DLL_SUFFIX};
use std::fmt::Display;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use ort::environment::Environment;
use ort::ep::CPU;
use ort::logging::LogLevel;
use ort::session::Session;
use program::Fault;

/// Variable of the environment that says where the library is.
const VARIABLE: &str = "ORT_DYLIB_PATH";

/// The runtime, loaded at the first call.
///
/// # Errors
/// [`Fault::Device`] that says what to install or set.
pub(super) fn environment() -> Result<&'static Environment, Fault> {
    /// There can be one in a process.
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

/// Where the library is, or its name for the system to look for.
fn library() -> PathBuf {
    match std::env::var_os(VARIABLE).filter(|path| !path.is_empty()) {
        // Relative paths are the user's, not the program's.
        Some(path) => std::path::absolute(&path).unwrap_or_else(|_| path.into()),
        None => format!("{DLL_PREFIX}onnxruntime{DLL_SUFFIX}").into(),
    }
}

/// A session of the model at `path`, which gives back what it takes when it is dropped: no arena that
/// keeps memory for the next run.
///
/// # Errors
/// What the runtime says.
pub(super) fn session(path: &Path) -> Result<Session, String> {
    let environment = environment().map_err(|fault| fault.to_string())?;
    let builder = Session::builder(environment).map_err(|error| error.to_string())?;
    let builder = builder.with_memory_pattern(false).map_err(|error| error.to_string())?;
    let cpu = CPU::default().with_arena_allocator(false).build();
    let mut builder = builder.with_execution_providers([cpu]).map_err(|error| error.to_string())?;
    builder.commit_from_file(path).map_err(|error| error.to_string())
}

/// A message that may have several lines, in one.
pub(super) fn one_line(message: &impl Display) -> String {
    message.to_string().split_whitespace().collect::<Vec<_>>().join(" ")
}
