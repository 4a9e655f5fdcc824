//! A headset without a headset: Monado, an OpenXR runtime, with a simulated one and a compositor
//! that shows nothing.
//!
//! `cargo xtask ci` unpacks it, and everything that it needs, from one release of Debian into a
//! folder. Libraries of the runtime, its Vulkan driver among them, are loaded into the programs
//! that use it; so these run through the folder's own dynamic linker as well, on its C library.

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

use crate::remote::Remote;

/// Why a test that needs the runtime is ignored.
pub const MISSING: &str = "no OpenXR runtime for tests; cargo xtask ci gets one";

/// Longest to wait for the service.
const PATIENCE: Duration = Duration::from_secs(60);

/// What the service says when it may be used.
const STARTED: &str = "service has started";

/// A running runtime of its own for one test; ends when dropped.
pub struct Headset {
    service: Child,
    files: Files,
    /// Everything that the runtime and its programs write, the service's socket among it.
    folder: TempDir,
}

/// Where the parts of the unpacked runtime lie.
struct Files {
    root: PathBuf,
    libraries: PathBuf,
    linker: PathBuf,
}

impl Files {
    /// Those of the set-up's folder; `None` where there is none.
    fn find() -> Option<Files> {
        let root = workspace::openxr_folder();
        let libraries = root.join(format!("usr/lib/{ARCH}-linux-gnu"));
        let mut entries = libraries.read_dir().ok()?.flatten();
        let linker = entries.find(|entry| entry.file_name().to_string_lossy().starts_with("ld-linux"))?;
        Some(Files { linker: linker.path(), root, libraries })
    }

    /// A command for `program` in the runtime's world, which leaves its traces in `home` only.
    fn command(&self, program: &Path, home: &Path) -> Command {
        // Libraries of these two have alternatives, each in a folder of its own.
        let mut folders = vec![self.libraries.clone()];
        folders.extend(["lapack", "blas", "pulseaudio"].map(|name| self.libraries.join(name)));
        folders.push(self.root.join("usr/lib"));
        let path = std::env::join_paths(folders).expect("folders of the workspace have no colon");
        let mut command = Command::new(&self.linker);
        command.arg("--library-path").arg(path).arg(program);
        // Settings of the person who runs the tests are not for them.
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
    /// Starts a runtime; `None` where the set-up could not get one.
    ///
    /// # Panics
    /// If it is there but does not work.
    pub fn start() -> Option<Headset> {
        let folder = tempfile::tempdir().expect("temporary files can be made");
        Headset::start_in(folder, ("SIMULATED_ENABLE", "1"))
    }

    /// The same with a head and a hand that the test moves.
    ///
    /// # Panics
    /// As for [`Headset::start`].
    pub fn start_with_hand() -> Option<(Headset, Remote)> {
        let folder = tempfile::tempdir().expect("temporary files can be made");
        let port = Remote::configure(folder.path());
        let headset = Headset::start_in(folder, Remote::CHOICE)?;
        Some((headset, Remote::connect(port)))
    }

    /// Starts a runtime at home in `folder` with the devices that a variable of its environment
    /// chooses.
    fn start_in(folder: TempDir, devices: (&str, &str)) -> Option<Headset> {
        let files = Files::find()?;
        let home = folder.path();
        // Sockets are for the user alone.
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
            // The service ends when this pipe closes: with this process, however that ends.
            .stdin(Stdio::piped())
            .stdout(log.try_clone().expect("a file can be shared"))
            .stderr(log)
            .spawn()
            .unwrap_or_else(|error| panic!("{}: {error}", files.linker.display()));
        let mut headset = Headset { service, files, folder };
        let start = Instant::now();
        while !headset.log().contains(STARTED) {
            let ended = headset.service.try_wait().expect("a child can be waited for").is_some();
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

    /// A path in the folder of this runtime, which goes with it.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// A command for `program` under this runtime.
    pub fn command(&self, program: &Path) -> Command {
        self.files.command(program, self.folder.path())
    }

    /// The same with Khronos's validation layer in between; [`Headset::findings`] has what it says.
    pub fn validated(&self, program: &Path) -> Command {
        let mut command = self.command(program);
        command
            .env("XR_API_LAYER_PATH", self.path("layers"))
            .env("XR_ENABLE_API_LAYERS", LAYER)
            .env("XR_CORE_VALIDATION_EXPORT_TYPE", "text")
            .env("XR_CORE_VALIDATION_FILE_NAME", self.path("validation.txt"));
        command
    }

    /// What the validation layer found in the last validated program.
    ///
    /// # Errors
    /// If it was not at work.
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

    /// Ends the service as no program can prevent, `kill -9`.
    pub fn kill(&mut self) {
        // It may have ended by itself.
        let _ = self.service.kill();
        let _ = self.service.wait();
    }
}

impl Drop for Headset {
    fn drop(&mut self) {
        self.kill();
    }
}

/// Name of the validation layer.
const LAYER: &str = "XR_APILAYER_LUNARG_core_validation";

/// A description of a runtime or a layer, as the loader reads it.
fn manifest(kind: &str, about: &[(&str, &OsStr)]) -> String {
    let about: serde_json::Map<_, _> =
        about.iter().map(|(key, value)| (key.to_string(), value.to_string_lossy().into())).collect();
    serde_json::json!({"file_format_version": "1.0.0", kind: about}).to_string()
}

fn path(library: &Path) -> (&'static str, &OsStr) {
    ("library_path", library.as_os_str())
}

/// The file of this name somewhere below the folder.
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
