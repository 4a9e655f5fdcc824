//! Set-up: finds out what a command needs of the machine and installs what is missing.
//!
//! A command names its needs, each with what it does without; [`satisfy`] looks for them, prints
//! and installs what is missing where it may (as root, or with `sudo` that asks for no password),
//! and otherwise prints the one command to run. What would not fit beside the machine's own packages
//! is unpacked into a folder of this project instead, which anyone may. It never waits for an answer
//! and never fails: whoever needs the thing finds out by using it.

mod android;
mod apt;
mod headset;
mod slurm;
mod unpacked;

use std::env;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::Command;

use unpacked::Unpacked;

/// Something that a command needs and Cargo cannot fetch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Need {
    /// The Vulkan loader and at least one driver. Mesa's software driver serves any machine.
    Vulkan,
    /// The X libraries that the desktop preview opens at run time.
    WindowLibraries,
    /// An X server without a screen, for the tests of the desktop preview.
    VirtualDisplay,
    /// A C++ compiler, for libFuzzer.
    CppCompiler,
    /// An OpenXR runtime with a simulated headset, for the tests of the headset's path.
    Headset,
    /// A compiler that can check for Android.
    AndroidCompiler,
    /// Programs of Android that look at an APK.
    ApkTools,
    /// A scheduler of clusters, for the test of many takes.
    Slurm,
}

/// Where something comes from.
enum Source {
    /// Packages to install, by their names in Debian and Ubuntu.
    Installed(&'static [&'static str]),
    /// A folder to make.
    Unpacked(Unpacked),
}

impl Need {
    fn what(self) -> &'static str {
        match self {
            Need::Vulkan => "a Vulkan loader and driver",
            Need::WindowLibraries => "the X libraries of a window",
            Need::VirtualDisplay => "Xvfb, an X server without a screen",
            Need::CppCompiler => "c++, a C++ compiler",
            Need::Headset => "Monado, an OpenXR runtime",
            Need::AndroidCompiler => "a Rust compiler with the source of its library",
            Need::ApkTools => "aapt, apksigner and zipalign",
            Need::Slurm => "Slurm, a scheduler of clusters",
        }
    }

    fn source(self) -> Source {
        Source::Installed(match self {
            Need::Vulkan => &["libvulkan1", apt::MESA],
            Need::WindowLibraries => {
                &["libx11-6", "libx11-xcb1", "libxcb1", "libxcursor1", "libxi6", "libxkbcommon-x11-0"]
            }
            Need::VirtualDisplay => &["xvfb"],
            Need::CppCompiler => &["g++"],
            Need::ApkTools => &["aapt", "apksigner", "zipalign"],
            Need::Headset => return Source::Unpacked(headset::runtime()),
            Need::AndroidCompiler => return Source::Unpacked(android::compiler()),
            Need::Slurm => return Source::Unpacked(slurm::scheduler()),
        })
    }

    /// Whether the machine meets it.
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
            Need::VirtualDisplay => program_exists("Xvfb"),
            Need::CppCompiler => program_exists("c++"),
            Need::Headset => headset::runtime().is_there(),
            Need::AndroidCompiler => android::compiler().is_there(),
            Need::Slurm => slurm::scheduler().is_there(),
            Need::ApkTools => ["aapt", "apksigner", "zipalign"].into_iter().all(program_exists),
        }
    }
}

/// Installs those of the needs that the machine does not meet, as far as it may. Each need comes
/// with what happens without it, which is printed where it stays unmet.
pub(crate) fn satisfy(needs: &[(Need, &str)]) {
    let missing = |needs: &[(Need, &str)]| -> Vec<Need> {
        needs.iter().map(|&(need, _)| need).filter(|need| !need.is_met()).collect()
    };
    let wanted = missing(needs);
    if wanted.is_empty() {
        return;
    }
    let mut packages: Vec<&str> = Vec::new();
    let mut folders = Vec::new();
    for need in &wanted {
        eprintln!("set-up: this machine lacks {}", need.what());
        match need.source() {
            Source::Installed(names) => packages.extend(names),
            Source::Unpacked(folder) => folders.push(folder),
        }
    }
    if !packages.is_empty() {
        install(&packages);
    }
    for folder in folders {
        if let Err(error) = folder.make() {
            eprintln!("set-up: {} could not be made: {error:#}", folder.folder.display());
        }
    }
    for &(need, without) in needs {
        if wanted.contains(&need) && !need.is_met() {
            eprintln!("set-up: without {}, {without}", need.what());
        }
    }
}

/// Installs the packages, or says how to.
fn install(packages: &[&str]) {
    if !program_exists("apt-get") {
        eprintln!("set-up: install it as your system does; Debian calls the packages {}", packages.join(" "));
    } else if let Some(privilege) = apt::Privilege::find() {
        apt::install(&privilege, packages);
    } else {
        eprintln!("set-up: to install it, run\n\n    {}\n", apt::command_for_people(packages));
    }
}

/// Whether a program of this name is on the path.
fn program_exists(name: &str) -> bool {
    env::split_paths(&env::var_os("PATH").unwrap_or_default()).any(|folder| folder.join(name).is_file())
}

/// Whether the dynamic linker finds a library of this name.
fn library_exists(name: &str) -> bool {
    let paths = env::var_os("LD_LIBRARY_PATH").unwrap_or_default();
    if env::split_paths(&paths).any(|folder| folder.join(name).is_file()) {
        return true;
    }
    // Only root has the folder of `ldconfig` on its path.
    ["ldconfig", "/sbin/ldconfig"].iter().any(|ldconfig| {
        Command::new(ldconfig).arg("-p").output().is_ok_and(|output| {
            String::from_utf8_lossy(&output.stdout)
                .lines()
                .any(|line| line.split_whitespace().next() == Some(name))
        })
    })
}

/// Files and folders in which the Vulkan loader looks for descriptions of drivers, in its order
/// (the loader's documentation, "Driver Discovery on Linux").
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

/// Whether one of the paths is a driver description or a folder that holds one.
fn has_driver(paths: &[PathBuf]) -> bool {
    let is_description = |path: &Path| path.extension().is_some_and(|end| end == "json") && path.is_file();
    paths.iter().any(|path| {
        is_description(path)
            || path
                .read_dir()
                .is_ok_and(|entries| entries.flatten().any(|entry| is_description(&entry.path())))
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
    fn drivers_are_looked_for_where_the_loader_does() {
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
    fn a_driver_is_a_json_file_named_or_in_a_folder() {
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
    fn libraries_and_programs_are_told_from_absent_ones() {
        assert!(library_exists("libc.so.6"));
        assert!(!library_exists("libnothing-of-this-name.so.1"));
        assert!(program_exists("sh"));
        assert!(!program_exists("nothing-of-this-name"));
    }
}
