//! Set-up: detects missing system packages and installs them.
//!
//! A command names its needs, each with the consequence of lacking it. [`satisfy`] prints what is
//! missing and installs it, if it may (as root, or with `sudo` without a password); otherwise it prints
//! the command to run. Packages that would conflict with the machine's own are unpacked into a folder of
//! this project, which needs no privilege. The set-up asks a person at the terminal before it uses `sudo`,
//! never removes a package and never fails; the command fails later where it uses what is missing.

mod apt;
mod folders;
mod unpacked;

use std::env;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::Command;

use unpacked::Unpacked;

/// A requirement of a command that Cargo cannot fetch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Need {
    /// The Vulkan loader and at least one driver. Mesa's software driver serves any machine.
    Vulkan,
    /// The X libraries that the desktop window loads at run time.
    WindowLibraries,
    /// The headers of the system's sound library, to build the player.
    SoundHeaders,
    /// An X server without a screen, for the tests of the window.
    VirtualDisplay,
    /// A C++ compiler, for libFuzzer.
    CppCompiler,
    /// An OpenXR runtime with a simulated headset, for the headset tests.
    Headset,
    /// A Rust that compiles for other systems and processors, to check with.
    DebianRust,
    /// Android's programs that check an APK.
    ApkTools,
    /// A cluster scheduler, for the test of job arrays.
    Slurm,
    /// Programs that decode videos, for the tests of captures.
    Ffmpeg,
    /// ONNX Runtime, for the tests of networks.
    OnnxRuntime,
    /// A second Vulkan driver, for the tests that draw.
    SecondDriver,
    /// Emulators of other processors, and C compilers for them.
    Foreign,
}

/// Options of the commands that set the machine up.
#[derive(clap::Args)]
pub(crate) struct SetupArgs {
    /// Print what the set-up would install, and end
    #[arg(long)]
    dry_run: bool,
}

/// Origin of a requirement.
enum Source {
    /// Packages to install, named as in Debian and Ubuntu.
    Installed(&'static [&'static str]),
    /// Packages to unpack into a folder.
    Unpacked(Unpacked),
}

impl Need {
    fn name(self) -> &'static str {
        match self {
            Need::Vulkan => "a Vulkan loader and driver",
            Need::WindowLibraries => "the X libraries of a window",
            Need::SoundHeaders => "the headers of ALSA, the sound library",
            Need::VirtualDisplay => "Xvfb, an X server without a screen",
            Need::CppCompiler => "c++, a C++ compiler",
            Need::Headset => "Monado, an OpenXR runtime",
            Need::DebianRust => "a Rust compiler with the source of its library",
            Need::ApkTools => "aapt, apksigner and zipalign",
            Need::Slurm => "Slurm, a cluster scheduler",
            Need::Ffmpeg => "ffmpeg and ffprobe",
            Need::OnnxRuntime => "ONNX Runtime",
            Need::SecondDriver => "SwiftShader, a Vulkan driver",
            Need::Foreign => "QEMU and C compilers for other processors",
        }
    }

    fn source(self) -> Source {
        Source::Installed(match self {
            Need::Vulkan => &["libvulkan1", apt::MESA],
            Need::WindowLibraries => {
                &["libx11-6", "libx11-xcb1", "libxcb1", "libxcursor1", "libxi6", "libxkbcommon-x11-0"]
            }
            Need::SoundHeaders => &["libasound2-dev", "pkg-config"],
            Need::VirtualDisplay => &["xvfb"],
            Need::CppCompiler => &["g++"],
            Need::ApkTools => &["aapt", "apksigner", "zipalign"],
            Need::Ffmpeg => &["ffmpeg"],
            Need::Headset => return Source::Unpacked(folders::headset()),
            Need::DebianRust => return Source::Unpacked(folders::debian_rust()),
            Need::Slurm => return Source::Unpacked(folders::slurm()),
            Need::OnnxRuntime => return Source::Unpacked(folders::onnx()),
            Need::SecondDriver => return Source::Unpacked(folders::swiftshader()),
            Need::Foreign => return Source::Unpacked(folders::foreign()),
        })
    }

    /// Whether the machine has it.
    pub(crate) fn is_met(self) -> bool {
        match self {
            Need::Vulkan => {
                library_exists("libvulkan.so.1") && has_driver(&driver_paths(|name| env::var_os(name)))
            }
            Need::WindowLibraries => [
                "libX11.so.6",
                "libX11-xcb.so.1",
                "libxcb.so.1",
                "libXcursor.so.1",
                "libXi.so.6",
                "libxkbcommon-x11.so.0",
            ]
            .iter()
            .all(|name| library_exists(name)),
            Need::SoundHeaders => Command::new("pkg-config")
                .args(["--exists", "alsa"])
                .status()
                .is_ok_and(|status| status.success()),
            Need::VirtualDisplay => program_exists("Xvfb"),
            Need::CppCompiler => program_exists("c++"),
            Need::Headset
            | Need::DebianRust
            | Need::Slurm
            | Need::OnnxRuntime
            | Need::SecondDriver
            | Need::Foreign => match self.source() {
                Source::Unpacked(folder) => folder.is_complete(),
                Source::Installed(_) => unreachable!("these are unpacked"),
            },
            Need::ApkTools => ["aapt", "apksigner", "zipalign"].into_iter().all(program_exists),
            Need::Ffmpeg => ["ffmpeg", "ffprobe"].into_iter().all(program_exists),
        }
    }
}

/// Installs what is missing, as far as permitted, and returns whether the command is to go on: not after a dry
/// run. Each need comes with the consequence of lacking it, which is printed if it stays unmet.
pub(crate) fn satisfy(args: &SetupArgs, needs: &[(Need, &str)]) -> bool {
    let missing: Vec<&(Need, &str)> = needs.iter().filter(|(need, _)| !need.is_met()).collect();
    let mut packages: Vec<&str> = Vec::new();
    let mut folders = Vec::new();
    for (need, _) in &missing {
        eprintln!("set-up: this machine lacks {}", need.name());
        match need.source() {
            Source::Installed(names) => packages.extend(names),
            Source::Unpacked(folder) => folders.push(folder),
        }
    }
    if !packages.is_empty() {
        if program_exists("apt-get") {
            apt::install(&packages, args.dry_run);
        } else {
            let packages = packages.join(" ");
            eprintln!("set-up: install it with your package manager; in Debian the packages are {packages}");
        }
    }
    for folder in folders {
        eprintln!("set-up: {}", folder.description());
        let made = if args.dry_run { Ok(()) } else { folder.make() };
        if let Err(error) = made {
            eprintln!("set-up: {} could not be made: {error:#}", folder.folder.display());
        }
    }
    if args.dry_run {
        eprintln!("set-up: {}", if missing.is_empty() { "nothing is missing" } else { "nothing was done" });
        return false;
    }
    for (need, without) in missing.into_iter().filter(|(need, _)| !need.is_met()) {
        eprintln!("set-up: without {}, {without}", need.name());
    }
    true
}

/// Whether PATH contains a program of this name.
fn program_exists(name: &str) -> bool {
    env::split_paths(&env::var_os("PATH").unwrap_or_default()).any(|folder| folder.join(name).is_file())
}

/// Whether the dynamic linker finds a library of this name.
fn library_exists(name: &str) -> bool {
    let paths = env::var_os("LD_LIBRARY_PATH").unwrap_or_default();
    if env::split_paths(&paths).any(|folder| folder.join(name).is_file()) {
        return true;
    }
    // Only root's PATH contains the folder of `ldconfig`.
    ["ldconfig", "/sbin/ldconfig"].iter().any(|ldconfig| {
        Command::new(ldconfig).arg("-p").output().is_ok_and(|output| {
            String::from_utf8_lossy(&output.stdout)
                .lines()
                .any(|line| line.split_whitespace().next() == Some(name))
        })
    })
}

/// Files and folders in which the Vulkan loader looks for driver manifests, in its order (the loader's
/// documentation, "Driver Discovery on Linux").
fn driver_paths(variable: impl Fn(&str) -> Option<OsString>) -> Vec<PathBuf> {
    let list = |name: &str| -> Option<Vec<PathBuf>> {
        variable(name).filter(|value| !value.is_empty()).map(|value| env::split_paths(&value).collect())
    };
    if let Some(paths) = list("VK_DRIVER_FILES").or_else(|| list("VK_ICD_FILENAMES")) {
        return paths;
    }
    let home = |rest: &str| -> Vec<PathBuf> {
        list("HOME").into_iter().flatten().map(|home| home.join(rest)).collect()
    };
    let mut roots: Vec<PathBuf> = Vec::new();
    roots.extend(list("XDG_CONFIG_HOME").unwrap_or_else(|| home(".config")));
    roots.extend(list("XDG_CONFIG_DIRS").unwrap_or_else(|| vec!["/etc/xdg".into()]));
    roots.push("/etc".into());
    roots.extend(list("XDG_DATA_HOME").unwrap_or_else(|| home(".local/share")));
    roots.extend(
        list("XDG_DATA_DIRS").unwrap_or_else(|| vec!["/usr/local/share".into(), "/usr/share".into()]),
    );
    let mut paths = list("VK_ADD_DRIVER_FILES").unwrap_or_default();
    paths.extend(roots.iter().map(|root| root.join("vulkan/icd.d")));
    paths
}

/// Whether one of the paths is a driver manifest or a folder that contains one.
fn has_driver(paths: &[PathBuf]) -> bool {
    let is_manifest = |path: &Path| path.extension().is_some_and(|end| end == "json") && path.is_file();
    paths.iter().any(|path| {
        is_manifest(path)
            || path.read_dir().is_ok_and(|entries| entries.flatten().any(|entry| is_manifest(&entry.path())))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn paths_with(variables: &[(&str, &str)]) -> Vec<String> {
        let variables: Vec<_> = variables.iter().map(|(k, v)| (k.to_string(), OsString::from(v))).collect();
        driver_paths(|name| variables.iter().find(|(k, _)| k == name).map(|(_, v)| v.clone()))
            .into_iter()
            .map(|path| path.to_str().unwrap().to_owned())
            .collect()
    }

    #[test]
    fn driver_paths_follow_the_vulkan_loader() {
        assert_eq!(
            paths_with(&[("HOME", "/home/ann")]),
            [
                "/home/ann/.config/vulkan/icd.d",
                "/etc/xdg/vulkan/icd.d",
                "/etc/vulkan/icd.d",
                "/home/ann/.local/share/vulkan/icd.d",
                "/usr/local/share/vulkan/icd.d",
                "/usr/share/vulkan/icd.d",
            ]
        );
        assert_eq!(
            paths_with(&[
                ("XDG_DATA_DIRS", "/a:/b"),
                ("XDG_CONFIG_DIRS", "/c"),
                ("VK_ADD_DRIVER_FILES", "/d.json")
            ]),
            ["/d.json", "/c/vulkan/icd.d", "/etc/vulkan/icd.d", "/a/vulkan/icd.d", "/b/vulkan/icd.d"]
        );
        assert_eq!(
            paths_with(&[("VK_ICD_FILENAMES", "/x.json:/y.json"), ("VK_ADD_DRIVER_FILES", "/d.json")]),
            ["/x.json", "/y.json"]
        );
        assert_eq!(
            paths_with(&[("VK_DRIVER_FILES", "/z.json"), ("VK_ICD_FILENAMES", "/x.json")]),
            ["/z.json"]
        );
    }

    #[test]
    fn a_driver_is_a_json_file_given_directly_or_in_a_folder() {
        let folder = tempfile::tempdir().unwrap();
        let description = folder.path().join("driver.json");
        assert!(!has_driver(&[folder.path().to_owned(), description.clone()]));
        std::fs::write(folder.path().join("notes.txt"), "").unwrap();
        assert!(!has_driver(&[folder.path().to_owned()]));
        std::fs::write(&description, "{}").unwrap();
        assert!(has_driver(&[folder.path().to_owned()]));
        assert!(has_driver(&[description]));
    }

    #[test]
    fn absent_libraries_and_programs_are_detected() {
        assert!(library_exists("libc.so.6"));
        assert!(!library_exists("libnothing-of-this-name.so.1"));
        assert!(program_exists("sh"));
        assert!(!program_exists("nothing-of-this-name"));
    }
}
