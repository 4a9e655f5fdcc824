//! `cargo xtask apk`: the player as an APK for headsets, signed and ready for `adb install`.
//!
//! Builds the player's library with the Android NDK, adds an OpenXR loader, the demo clip and the
//! licences, and runs the packer, a workspace of its own in xtask/apk, which signs and checks the APK.
//! Looks for all prerequisites first, so that one error names everything missing.

use std::borrow::Cow;
use std::env;
use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::Context;
use program::Fault;
use xtask::workspace;

use super::notices::notices;

/// The target that the player is built for.
pub(super) const TARGET: &str = "aarch64-linux-android";

/// Oldest Android API level that the APK runs on; the manifest repeats it.
pub(super) const API_LEVEL: u32 = 29;

/// Largest page size in bytes that a library must be aligned to.
pub(super) const PAGE_BYTES: u32 = 16384;

/// The player's library.
pub(super) const LIBRARY: &str = "libclient.so";

/// The loader's file name in an APK, and the end of its path in archives.
const LOADER: &str = "libopenxr_loader.so";
const LOADER_IN_ARCHIVE: &str = "arm64-v8a/libopenxr_loader.so";

/// The player's features on Android.
pub(super) const FEATURES: [&str; 3] = ["--no-default-features", "--features", "audio,net,xr"];

/// Notice of the loader, which Khronos builds.
const LOADER_NOTICE: &str = "
==== OpenXR loader ====

Copyright The Khronos Group Inc., Apache-2.0 (text above). It contains JsonCpp, jnipp and
android-jni-wrappers; their notices are at https://github.com/KhronosGroup/OpenXR-SDK-Source.
";

/// Build the player as a signed APK for headsets.
///
/// APK_KEYSTORE names the keystore to sign with (.p12 or .jks with one key), APK_KEYSTORE_PASSWORD holds
/// its password, which only the packer sees. Without them a debug key signs, made on first use and stored in
/// android/debug-key.pem.
/// Android installs an update only if the same key signed it.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Optimise [default: the development profile]
    #[arg(long)]
    release: bool,

    /// libopenxr_loader.so for 64-bit ARM, or Khronos's .aar that contains it [default: OPENXR_LOADER]
    #[arg(long, value_name = "FILE")]
    openxr_loader: Option<PathBuf>,

    /// Pack this build of the player's library instead of building it
    #[arg(long, value_name = "FILE.so", conflicts_with = "release")]
    library: Option<PathBuf>,

    /// APK to write
    #[arg(short, long, value_name = "FILE.apk", default_value = "aarc.apk")]
    out: PathBuf,
}

impl Args {
    /// The arguments of an optimised APK at `out`, with the loader that the environment names.
    pub(super) fn release(out: PathBuf) -> Args {
        Args { release: true, openxr_loader: None, library: None, out }
    }
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let (loader, toolchain) =
        prerequisites(args.openxr_loader.as_deref(), args.library.is_some()).map_err(Fault::Device)?;
    let parts = workspace::target_folder().join("apk/parts");
    fs::create_dir_all(&parts).with_context(|| parts.display().to_string())?;
    take_loader(&loader, &parts.join(LOADER))?;
    let library = match (&args.library, toolchain) {
        (Some(library), _) => library.clone(),
        (None, Some(toolchain)) => toolchain.build(args.release)?,
        (None, None) => unreachable!("there is a toolchain or a library"),
    };
    fs::copy(&library, parts.join(LIBRARY))
        .map_err(|error| Fault::Data(format!("{}: {error}", library.display())))?;
    let notices_part = parts.join("NOTICES.txt");
    let notices = notices(&[&["--package", "client"], &FEATURES[..]].concat(), TARGET)?;
    fs::write(&notices_part, notices + LOADER_NOTICE).with_context(|| notices_part.display().to_string())?;
    pack(&parts, &args.out)?;
    println!("{}", workspace::shell_line(&["adb", "install", "-r", &args.out.to_string_lossy()]));
    Ok(())
}

/// What an APK needs and this machine lacks, given the option `--openxr-loader`; `None` if it can be made.
pub(super) fn missing(openxr_loader: Option<&Path>) -> Option<String> {
    prerequisites(openxr_loader, false).err()
}

/// Finds the loader, and the toolchain unless there `is_library`.
///
/// # Errors
/// A sentence with the remedy for each missing part.
fn prerequisites(
    openxr_loader: Option<&Path>,
    is_library: bool,
) -> Result<(PathBuf, Option<Toolchain>), String> {
    let loader = openxr_loader.map(PathBuf::from).or_else(|| env::var_os("OPENXR_LOADER").map(PathBuf::from));
    let loader = loader.ok_or_else(|| {
        let source = "openxr_loader_for_android-VERSION.aar from the releases of Khronos's OpenXR-SDK-Source";
        format!("no OpenXR loader: download {source} and give --openxr-loader FILE, or OPENXR_LOADER")
    });
    let toolchain = if is_library { Ok(None) } else { Toolchain::find().map(Some) };
    match (loader, toolchain) {
        (Ok(loader), Ok(toolchain)) => Ok((loader, toolchain)),
        (loader, toolchain) => {
            let missing: Vec<String> = toolchain.err().into_iter().flatten().chain(loader.err()).collect();
            Err(missing.join("; "))
        }
    }
}

/// Rust's Android target and the Android NDK.
struct Toolchain {
    /// Folder of the NDK's programs.
    programs: PathBuf,
}

impl Toolchain {
    /// Finds both.
    ///
    /// # Errors
    /// One sentence for each missing part, with the remedy.
    fn find() -> Result<Toolchain, Vec<String>> {
        let mut missing = Vec::new();
        let library = Command::new("rustc")
            .args(["--print", "target-libdir", "--target", TARGET])
            .current_dir(workspace::root())
            .stderr(Stdio::null())
            .output();
        let library = library.map(|output| PathBuf::from(String::from_utf8_lossy(&output.stdout).trim()));
        if !library.is_ok_and(|folder| folder.is_dir()) {
            missing.push(format!("no Rust for Android: run `rustup target add {TARGET}`"));
        }
        let ndk =
            ["ANDROID_NDK_HOME", "ANDROID_NDK_ROOT"].into_iter().find_map(env::var_os).map(PathBuf::from);
        match ndk.as_deref().map(programs_of) {
            Some(Ok(programs)) if missing.is_empty() => return Ok(Toolchain { programs }),
            Some(Ok(_)) => {}
            Some(Err(problem)) => missing.push(problem),
            None => missing.push(
                "no Android NDK: install it (`sdkmanager 'ndk;27.2.12479018'`, or from its download page) and set \
                 ANDROID_NDK_HOME to its folder"
                    .into(),
            ),
        }
        Err(missing)
    }

    /// Builds the player's library and returns its path.
    fn build(&self, release: bool) -> Result<PathBuf, Fault> {
        let program = |name: &str| self.programs.join(name);
        let compiler = program(&format!("{TARGET}{API_LEVEL}-clang"));
        let profile = if release { "release" } else { "dev" };
        let page_flag = format!("-Clink-arg=-Wl,-z,max-page-size={PAGE_BYTES}");
        let status = workspace::cargo()
            .args(["rustc", "--package", "client", "--lib", "--crate-type", "cdylib", "--target", TARGET])
            .args(FEATURES)
            .args(["--profile", profile, "--locked", "--target-dir"])
            .arg(workspace::target_folder())
            .env("CARGO_TARGET_AARCH64_LINUX_ANDROID_LINKER", &compiler)
            .env("CARGO_TARGET_AARCH64_LINUX_ANDROID_RUSTFLAGS", page_flag)
            .env("CC_aarch64_linux_android", &compiler)
            .env("AR_aarch64_linux_android", program("llvm-ar"))
            .env("CARGO_PROFILE_RELEASE_STRIP", "symbols")
            .stdin(Stdio::null())
            .status()
            .map_err(|error| Fault::Device(format!("cannot run cargo: {error}")))?;
        if !status.success() {
            return Err(Fault::Device("cargo could not build the player; its messages are above".into()));
        }
        let folder = if release { "release" } else { "debug" };
        Ok(workspace::target_folder().join(TARGET).join(folder).join(LIBRARY))
    }
}

/// The folder of an NDK's programs for this machine.
fn programs_of(ndk: &Path) -> Result<PathBuf, String> {
    let hosts = ndk.join("toolchains/llvm/prebuilt");
    let compiler = format!("{TARGET}{API_LEVEL}-clang");
    let mut folders = hosts.read_dir().into_iter().flatten().flatten().map(|host| host.path().join("bin"));
    folders.find(|folder| folder.join(&compiler).is_file()).ok_or_else(|| {
        format!("{} is no Android NDK: it holds no {compiler}; set ANDROID_NDK_HOME to one", ndk.display())
    })
}

/// Copies the loader's library from `from`, the library itself or an archive that contains it.
fn take_loader(from: &Path, to: &Path) -> Result<(), Fault> {
    let bad = |what: String| Fault::Data(format!("{}: {what}", from.display()));
    let mut file = File::open(from).map_err(|error| bad(error.to_string()))?;
    let mut bytes = Vec::new();
    match zip::ZipArchive::new(&mut file) {
        Ok(mut archive) => {
            let name = archive.file_names().flatten().find(|name| name.ends_with(LOADER_IN_ARCHIVE));
            let name = name.map(Cow::into_owned);
            let name = name.ok_or_else(|| bad(format!("holds no {LOADER_IN_ARCHIVE}")))?;
            let entry = archive.by_name(&name).map_err(|error| bad(error.to_string()))?;
            // Khronos's loaders have about a megabyte.
            entry.take(64 << 20).read_to_end(&mut bytes).map_err(|error| bad(error.to_string()))?;
        }
        Err(_) => bytes = fs::read(from).map_err(|error| bad(error.to_string()))?,
    }
    if !bytes.starts_with(b"\x7fELF") {
        return Err(bad("is neither a library nor an archive that holds one".into()));
    }
    fs::write(to, bytes).map_err(|error| Fault::Usage(format!("{}: {error}", to.display())))
}

/// Runs the packer on the folder of `parts`; it takes the key from the environment.
fn pack(parts: &Path, out: &Path) -> anyhow::Result<()> {
    let mut packer = Command::new(workspace::build_packer()?);
    packer.arg(workspace::root()).arg(parts).arg(env!("CARGO_PKG_VERSION")).arg(out);
    let status = packer.stdin(Stdio::null()).status().context("cannot run the packer")?;
    if !status.success() {
        return Err(Fault::Data("the APK could not be packed; the packer's message is above".into()).into());
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    #[test]
    fn the_loader_is_found_in_an_archive_or_taken_as_it_is() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let library = b"\x7fELF and so on";
        fs::write(path("loader.so"), library).unwrap();
        let archive = |name: &str, entry: &str, bytes: &[u8]| {
            let mut archive = zip::ZipWriter::new(File::create(path(name)).unwrap());
            archive.start_file(entry, zip::write::SimpleFileOptions::default()).unwrap();
            archive.write_all(bytes).unwrap();
            archive.finish().unwrap();
        };
        let inside = "prefab/modules/openxr_loader/libs/android.arm64-v8a/libopenxr_loader.so";
        archive("good.aar", inside, library);
        archive("other.aar", "prefab/modules/openxr_loader/libs/android.x86/libopenxr_loader.so", library);
        archive("bad.aar", inside, b"nothing");
        fs::write(path("bad.so"), "nothing").unwrap();
        for name in ["loader.so", "good.aar"] {
            take_loader(&path(name), &path("out")).unwrap();
            assert_eq!(fs::read(path("out")).unwrap(), library, "{name}");
            fs::remove_file(path("out")).unwrap();
        }
        for name in ["other.aar", "bad.aar", "bad.so", "missing"] {
            let Err(Fault::Data(message)) = take_loader(&path(name), &path("out")) else { panic!("{name}") };
            assert!(message.contains(name) && !path("out").exists(), "{message}");
        }
    }

    #[test]
    fn an_ndk_is_known_by_its_compiler() {
        let ndk = tempfile::tempdir().unwrap();
        assert!(programs_of(ndk.path()).unwrap_err().contains("no Android NDK"));
        let programs = ndk.path().join("toolchains/llvm/prebuilt/linux-x86_64/bin");
        fs::create_dir_all(&programs).unwrap();
        assert!(programs_of(ndk.path()).is_err());
        fs::write(programs.join("aarch64-linux-android29-clang"), "").unwrap();
        assert_eq!(programs_of(ndk.path()).unwrap(), programs);
    }
}
