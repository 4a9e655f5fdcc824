//! [`Headset`]: the OpenXR runtime Monado with a simulated headset and a compositor without output.
//!
//! `cargo xtask ci` unpacks it with its dependencies from one release of Debian into a folder. Programs
//! that use the runtime load its libraries, among them its Vulkan driver, so they also run through that
//! folder's dynamic linker, on its C library.

use std::cell::{Cell, RefCell};
use std::env::consts::ARCH;
use std::ffi::OsStr;
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use tempfile::TempDir;
use xtask::workspace;

use crate::programs::example;
use crate::remote::Remote;

/// Reason to ignore a test that needs the runtime.
pub const MISSING: &str = "no OpenXR runtime for tests; cargo xtask ci gets one";

/// Longest wait for the service.
const PATIENCE: Duration = Duration::from_secs(60);

/// Log line of a service that is ready.
const STARTED: &str = "service has started";

/// One test's own runtime; ends when dropped.
pub struct Headset {
    service: RefCell<Child>,
    /// The test ended the service.
    killed: Cell<bool>,
    files: Files,
    /// Home folder of the runtime, with the service's socket, and of the programs that use it.
    folder: TempDir,
}

/// Paths of the unpacked runtime.
struct Files {
    root: PathBuf,
    libraries: PathBuf,
    linker: PathBuf,
}

impl Files {
    /// Finds the runtime; `None` if it was not unpacked.
    fn find() -> Option<Files> {
        let root = workspace::openxr_folder();
        let libraries = root.join(format!("usr/lib/{ARCH}-linux-gnu"));
        let mut entries = libraries.read_dir().ok()?.flatten();
        let linker = entries.find(|entry| entry.file_name().to_string_lossy().starts_with("ld-linux"))?;
        Some(Files { linker: linker.path(), root, libraries })
    }

    /// A command that runs `program` with the runtime's libraries and `home` as its home folder.
    fn command(&self, program: &Path, home: &Path) -> Command {
        // Debian keeps these libraries in folders of their own.
        let mut folders = vec![self.libraries.clone()];
        folders.extend(["lapack", "blas", "pulseaudio"].map(|name| self.libraries.join(name)));
        folders.push(self.root.join("usr/lib"));
        let path = std::env::join_paths(folders).expect("folders of the workspace have no colon");
        let mut command = Command::new(&self.linker);
        command.arg("--library-path").arg(path).arg(program);
        // The user's settings must not change the tests.
        for (name, _) in std::env::vars_os() {
            let name_text = name.to_string_lossy();
            if ["XR_", "XRT_", "XDG_", "VK_", "LD_LIBRARY"].iter().any(|start| name_text.starts_with(start)) {
                command.env_remove(&name);
            }
        }
        command
            .env("HOME", home)
            .env("XDG_RUNTIME_DIR", home)
            .env("XR_RUNTIME_JSON", home.join("runtime.json"))
            .env("VK_DRIVER_FILES", self.root.join("usr/share/vulkan/icd.d/lvp_icd.json"));
        command
    }
}

impl Headset {
    /// Starts a runtime; `None` if none is unpacked.
    ///
    /// # Panics
    /// If it does not work.
    pub fn start() -> Option<Headset> {
        let folder = tempfile::tempdir().expect("temporary files can be made");
        Headset::start_in(folder, ("SIMULATED_ENABLE", "1"))
    }

    /// Starts a runtime whose head and hand the test moves.
    ///
    /// # Panics
    /// As for [`Headset::start`].
    pub fn start_with_hand() -> Option<(Headset, Remote)> {
        let folder = tempfile::tempdir().expect("temporary files can be made");
        let port = Remote::configure(folder.path());
        let headset = Headset::start_in(folder, Remote::CHOICE)?;
        Some((headset, Remote::connect(port)))
    }

    /// Starts a runtime with the home folder `folder` and the devices that an environment variable
    /// selects.
    fn start_in(folder: TempDir, devices: (&str, &str)) -> Option<Headset> {
        let files = Files::find()?;
        let home = folder.path();
        // The service refuses a folder that others can read.
        fs::set_permissions(home, fs::Permissions::from_mode(0o700)).expect("it is ours");
        let write = |name: &str, text: String| {
            fs::write(home.join(name), text).expect("temporary files can be written");
        };
        let library = files.libraries.join("libopenxr_monado.so");
        write("runtime.json", manifest("runtime", &[("name", "Monado".as_ref()), path(&library)]));
        let layer = find(&files.libraries, "libXrApiLayer_core_validation.so");
        fs::create_dir(home.join("layers")).expect("temporary files can be made");
        let about = [
            ("name", LAYER.as_ref()),
            ("api_version", "1.0".as_ref()),
            ("implementation_version", "1".as_ref()),
            ("description", "validation".as_ref()),
            path(&layer),
        ];
        write("layers/validation.json", manifest("api_layer", &about));

        let log = fs::File::create(home.join("service.log")).expect("temporary files can be made");
        let service = files
            .command(&files.root.join("usr/bin/monado-service"), home)
            .envs([("XRT_COMPOSITOR_NULL", "1"), devices])
            // The service ends when this pipe closes, and so with this process.
            .stdin(Stdio::piped())
            .stdout(log.try_clone().expect("a file can be shared"))
            .stderr(log)
            .spawn()
            .unwrap_or_else(|error| panic!("{}: {error}", files.linker.display()));
        let headset = Headset { service: RefCell::new(service), killed: Cell::new(false), files, folder };
        let start = Instant::now();
        while !headset.log().contains(STARTED) {
            let ended = headset.service.borrow_mut().try_wait().expect("a child can be waited for").is_some();
            assert!(!ended && start.elapsed() < PATIENCE, "no service: {}", headset.log());
            sleep(Duration::from_millis(20));
        }
        Some(headset)
    }

    fn log(&self) -> String {
        fs::read(self.path("service.log"))
            .map(|text| String::from_utf8_lossy(&text).into_owned())
            .unwrap_or_default()
    }

    /// A path in the home folder, which is deleted with the runtime.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// A command that runs `program` under this runtime.
    pub fn command(&self, program: &Path) -> Command {
        self.files.command(program, self.folder.path())
    }

    /// A command that runs `program` under Khronos's validation layer; see [`Headset::findings`].
    pub fn validated(&self, program: &Path) -> Command {
        let mut command = self.command(program);
        command
            .env("XR_API_LAYER_PATH", self.path("layers"))
            .env("XR_ENABLE_API_LAYERS", LAYER)
            .env("XR_CORE_VALIDATION_EXPORT_TYPE", "text")
            .env("XR_CORE_VALIDATION_FILE_NAME", self.path("validation.txt"));
        command
    }

    /// A command that runs `program` on this runtime made odd: the layer `xr_odd_runtime`, with `oddities` as its
    /// `AARC_RUNTIME`, is between them.
    ///
    /// # Panics
    /// If the layer cannot be built, or its description cannot be written.
    pub fn odd(&self, program: &Path, oddities: &str) -> Command {
        let (layer, about) = (
            example("xr_odd_runtime"),
            [
                ("name", ODD_LAYER.as_ref()),
                ("api_version", "1.0".as_ref()),
                ("implementation_version", "1".as_ref()),
                ("description", "an odd runtime".as_ref()),
            ],
        );
        let about = [&about[..], &[path(&layer)]].concat();
        fs::write(self.path("layers/odd.json"), manifest("api_layer", &about)).expect("files can be written");
        let mut command = self.command(program);
        command
            .env("XR_API_LAYER_PATH", self.path("layers"))
            .env("XR_ENABLE_API_LAYERS", ODD_LAYER)
            .env("AARC_RUNTIME", oddities);
        command
    }

    /// Errors and warnings of the validation layer for the last validated program.
    ///
    /// # Errors
    /// If the layer was not active.
    pub fn findings(&self) -> Result<Vec<String>, String> {
        let text =
            fs::read(self.path("validation.txt")).map_err(|error| format!("no validation: {error}"))?;
        let text = String::from_utf8_lossy(&text);
        if !text.contains("Core Validation Layer is initialized") {
            return Err(format!("no validation: {text}"));
        }
        let found =
            text.lines().filter(|line| line.contains("VALID_ERROR") || line.contains("VALID_WARNING"));
        Ok(found.map(str::to_owned).collect())
    }

    /// The last lines of the service's log if it ended without [`Headset::kill`]; waits a second for it to end.
    pub fn crash(&self) -> Option<String> {
        let start = Instant::now();
        while !self.killed.get() && start.elapsed() < Duration::from_secs(1) {
            if let Ok(Some(status)) = self.service.borrow_mut().try_wait() {
                let log = self.log();
                let lines: Vec<&str> = log.lines().collect();
                let last = lines[lines.len().saturating_sub(20)..].join("\n");
                return Some(format!("{last}\n{status}"));
            }
            sleep(Duration::from_millis(20));
        }
        None
    }

    /// Kills the service with `SIGKILL`.
    pub fn kill(&self) {
        self.killed.set(true);
        let mut service = self.service.borrow_mut();
        // It may have ended already.
        let _ = service.kill();
        let _ = service.wait();
    }
}

impl Drop for Headset {
    fn drop(&mut self) {
        self.kill();
    }
}

/// Name of the validation layer.
const LAYER: &str = "XR_APILAYER_LUNARG_core_validation";

/// Name of the layer that makes the runtime odd.
const ODD_LAYER: &str = "XR_APILAYER_AARC_odd_runtime";

/// A manifest of a runtime or a layer for the OpenXR loader.
fn manifest(kind: &str, about: &[(&str, &OsStr)]) -> String {
    let about: serde_json::Map<_, _> =
        about.iter().map(|(key, value)| (key.to_string(), value.to_string_lossy().into())).collect();
    serde_json::json!({"file_format_version": "1.0.0", kind: about}).to_string()
}

fn path(library: &Path) -> (&'static str, &OsStr) {
    ("library_path", library.as_os_str())
}

/// Path of the file with this name anywhere below `folder`.
fn find(folder: &Path, name: &str) -> PathBuf {
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in folder.read_dir().into_iter().flatten().flatten() {
            let path = entry.path();
            if entry.file_name() == name {
                return path;
            }
            folders.extend(path.is_dir().then_some(path));
        }
    }
    panic!("{} holds no {name}", folder.display())
}
