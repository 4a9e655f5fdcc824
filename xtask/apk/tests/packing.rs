//! An APK of stub libraries, read back: requirements of Android, the headset and the OpenXR loader.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Barrier;
use std::thread;

use apk::prelude::*;
use apk_packer::identity::for_debugging;
use apk_packer::package::{Contents, Parts, check, write};
use tempfile::TempDir;
use zip::CompressionMethod;

const CLIP: &[u8] = b"not a clip, but the packer does not look inside";

/// Machines in the header of an ELF file.
const AARCH64: u16 = 183;
const X86_64: u16 = 62;

/// A minimal ELF shared library that exports one function and needs others, in one segment of the
/// given alignment.
fn library(machine: u16, alignment: u64, export: &str, needed: &[&str]) -> Vec<u8> {
    let mut names = vec![0u8];
    let mut name = |text: &str| {
        let at = names.len() as u64;
        names.extend(text.bytes().chain([0]));
        at
    };
    let export = name(export);
    let needed: Vec<u64> = needed.iter().map(|text| name(text)).collect();
    const HEADERS: u64 = 64 + 2 * 56;
    const SYMBOLS: u64 = HEADERS;
    const HASH: u64 = SYMBOLS + 2 * 24;
    const DYNAMIC: u64 = HASH + 5 * 4 + 4;
    let strings = DYNAMIC + 16 * (needed.len() as u64 + 6);
    let end = strings + names.len() as u64;

    let mut bytes = Vec::new();
    let mut put = |numbers: &[(u64, usize)]| {
        numbers.iter().for_each(|&(value, size)| bytes.extend(&value.to_le_bytes()[..size]));
    };
    // The file: 64 bits, little-endian, a shared object of this machine, two program headers.
    put(&[(0x0001_0102_464c_457f, 8), (0, 8), (3, 2), (machine.into(), 2), (1, 4), (0, 8), (64, 8), (0, 8)]);
    put(&[(0, 4), (64, 2), (56, 2), (2, 2), (64, 2), (0, 2), (0, 2)]);
    // The whole file is loaded; part of it is the dynamic section.
    put(&[(1, 4), (5, 4), (0, 8), (0, 8), (0, 8), (end, 8), (end, 8), (alignment, 8)]);
    let size = strings - DYNAMIC;
    put(&[(2, 4), (6, 4), (DYNAMIC, 8), (DYNAMIC, 8), (DYNAMIC, 8), (size, 8), (size, 8), (8, 8)]);
    // Symbols: the empty one, and a global function at the start of the file.
    put(&[(0, 24 / 3), (0, 8), (0, 8), (export, 4), (0x12, 1), (0, 1), (1, 2), (64, 8), (4, 8)]);
    // A hash table with one bucket for both; padding.
    put(&[(1, 4), (2, 4), (1, 4), (0, 4), (0, 4), (0, 4)]);
    needed.iter().for_each(|&name| put(&[(1, 8), (name, 8)]));
    let size = names.len() as u64;
    for (tag, value) in [(4, HASH), (5, strings), (6, SYMBOLS), (10, size), (11, 24), (0, 0)] {
        put(&[(tag, 8), (value, 8)]);
    }
    bytes.extend(names);
    bytes
}

/// A folder with the parts of an APK.
struct Workshop(TempDir);

impl Workshop {
    fn new() -> Workshop {
        let workshop = Workshop(tempfile::tempdir().unwrap());
        let player = library(
            AARCH64,
            0x4000,
            "ANativeActivity_onCreate",
            &["libandroid.so", "liblog.so", "libm.so", "libc.so"],
        );
        workshop.put("libclient.so", &player);
        workshop.put("libopenxr_loader.so", &library(AARCH64, 0x4000, "xrGetInstanceProcAddr", &["libc.so"]));
        workshop.put("demo.aarc", CLIP);
        workshop.put("NOTICES.txt", b"licences");
        workshop
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn put(&self, name: &str, bytes: &[u8]) {
        fs::write(self.path(name), bytes).unwrap();
    }

    fn pack(&self, out: &str) -> anyhow::Result<Contents> {
        let android = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../android");
        let [library, openxr_loader, clip, notices, out] =
            ["libclient.so", "libopenxr_loader.so", "demo.aarc", "NOTICES.txt", out]
                .map(|name| self.path(name));
        let parts = Parts {
            manifest: &android.join("AndroidManifest.xml"),
            icon: &android.join("icon.png"),
            library: &library,
            openxr_loader: &openxr_loader,
            clip: &clip,
            notices: &notices,
            version: "1.2.3",
        };
        write(&parts, for_debugging(&self.path("key.pem"))?, &out)?;
        check(&out)
    }
}

#[test]
fn the_apk_is_signed_aligned_and_complete() {
    let workshop = Workshop::new();
    let contents = workshop.pack("a.apk").unwrap();
    assert_eq!(contents.schemes, Schemes::V2 | Schemes::V3);
    assert_eq!((contents.package.as_str(), contents.version.as_str()), ("org.aarc.client", "1.2.3"));
    let needed: Vec<_> =
        contents.libraries.iter().map(|(name, _, needed)| (name.as_str(), needed.len())).collect();
    assert_eq!(needed, [("lib/arm64-v8a/libclient.so", 4), ("lib/arm64-v8a/libopenxr_loader.so", 1)]);

    let mut archive = zip::ZipArchive::new(File::open(workshop.path("a.apk")).unwrap()).unwrap();
    let mut place = |name: &str| {
        let entry = archive.by_name(name).unwrap();
        (entry.data_start().unwrap(), entry.compression())
    };
    for name in ["lib/arm64-v8a/libclient.so", "lib/arm64-v8a/libopenxr_loader.so"] {
        let (start, compression) = place(name);
        assert_eq!((start % 0x4000, compression), (0, CompressionMethod::Stored), "{name} can be mapped");
    }
    assert_eq!(place("assets/demo.aarc").1, CompressionMethod::Stored);
    place("assets/NOTICES.txt");
    let bytes = fs::read(workshop.path("a.apk")).unwrap();
    assert!(bytes.windows(CLIP.len()).any(|window| window == CLIP), "the clip is stored uncompressed");
}

#[test]
fn first_runs_at_the_same_time_share_one_key() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("key.pem");
    let start = Barrier::new(4);
    let used = || {
        start.wait();
        for_debugging(&path).unwrap().certificate().sha256_fingerprint()
    };
    let all: Vec<_> = thread::scope(|scope| {
        let runs: Vec<_> = (0..4).map(|_| scope.spawn(used)).collect();
        runs.into_iter().map(|run| run.join().unwrap()).collect()
    });
    let kept = for_debugging(&path).unwrap().certificate().sha256_fingerprint();
    assert!(all.iter().all(|used| *used == kept));
    assert_eq!(folder.path().read_dir().unwrap().count(), 1, "nothing else is left");
}

#[cfg(unix)]
#[test]
fn a_key_behind_a_link_is_never_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let [link, key] = ["link.pem", "key.pem"].map(|name| folder.path().join(name));
    std::os::unix::fs::symlink(&key, &link).unwrap();
    let error = for_debugging(&link).unwrap_err().to_string();
    assert!(error.contains("link.pem: a link to nothing"), "{error}");
    assert!(link.is_symlink() && !key.exists());
    let made = for_debugging(&key).unwrap().certificate().sha256_fingerprint();
    assert_eq!(for_debugging(&link).unwrap().certificate().sha256_fingerprint(), made);
}

#[test]
fn the_manifest_meets_the_requirements_of_headsets() {
    let workshop = Workshop::new();
    workshop.pack("a.apk").unwrap();
    let manifest = Apk::open(workshop.path("a.apk")).unwrap().manifest().unwrap();
    assert_eq!((manifest.min_sdk().to_string().as_str(), manifest.version_code()), ("29", Some(1_002_004)));
    assert_eq!(manifest.effective_target_sdk().unwrap().get(), 34);
    assert_eq!(manifest.native_activity_library(), Some(Ok("client")));
    assert_eq!((manifest.has_code(), manifest.extract_native_libs()), (false, Some(false)));
    let permissions: Vec<_> = manifest.permissions().collect();
    for permission in ["android.permission.INTERNET", "org.khronos.openxr.permission.OPENXR"] {
        assert!(permissions.contains(&permission), "{permission}");
    }
    let features: Vec<_> = manifest.features().collect();
    for feature in ["android.hardware.vr.headtracking", "android.hardware.vulkan.version"] {
        assert!(features.contains(&feature), "{feature}");
    }
    let text = manifest.to_string();
    for words in [
        "com.oculus.supportedDevices",
        "quest3",
        "android.intent.category.LAUNCHER",
        "com.oculus.intent.category.VR",
        "org.khronos.openxr.intent.category.IMMERSIVE_HMD",
        "org.khronos.openxr.runtime_broker;org.khronos.openxr.system_runtime_broker",
        "org.khronos.openxr.OpenXRRuntimeService",
    ] {
        assert!(text.contains(words), "{words} is not in\n{text}");
    }
}

#[test]
fn the_same_parts_and_key_give_the_same_bytes() {
    let workshop = Workshop::new();
    workshop.pack("a.apk").unwrap();
    workshop.pack("b.apk").unwrap();
    let read = |name: &str| fs::read(workshop.path(name)).unwrap();
    assert!(read("a.apk") == read("b.apk"));
}

#[test]
fn a_changed_byte_breaks_the_signature() {
    let workshop = Workshop::new();
    workshop.pack("a.apk").unwrap();
    let mut bytes = fs::read(workshop.path("a.apk")).unwrap();
    let clip = bytes.windows(CLIP.len()).position(|window| window == CLIP).unwrap();
    bytes[clip] ^= 1;
    workshop.put("a.apk", &bytes);
    assert!(check(&workshop.path("a.apk")).is_err());
}

#[test]
fn libraries_that_cannot_start_are_refused() {
    const ENTRY: &str = "ANativeActivity_onCreate";
    for (what, bytes) in [
        ("another machine", library(X86_64, 0x4000, ENTRY, &["libc.so"])),
        ("pages of 4 KiB", library(AARCH64, 0x1000, ENTRY, &["libc.so"])),
        ("no entry point", library(AARCH64, 0x4000, "main", &["libc.so"])),
        ("a library that Android lacks", library(AARCH64, 0x4000, ENTRY, &["libstdc++.so.6"])),
        ("no library", b"#!/bin/sh".to_vec()),
    ] {
        let workshop = Workshop::new();
        workshop.put("libclient.so", &bytes);
        assert!(workshop.pack("a.apk").is_err(), "{what}");
        assert!(!workshop.path("a.apk").exists(), "{what}: leaves no file behind");
    }
}

/// Output of a program that must accept a file.
fn output_of(program: &str, args: &[&str], file: &Path) -> String {
    let output = Command::new(program).args(args).arg(file).output();
    let output = output.unwrap_or_else(|error| panic!("{program} cannot be run: {error}"));
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{program} {args:?}:\n{text}\n{errors}");
    text
}

/// Packs the library at `PLAYER_LIBRARY`, or the stub without it.
#[test]
#[ignore = "needs aapt, apksigner and zipalign; `cargo xtask ci --full` runs it if they are installed"]
fn android_tools_accept_the_apk() {
    let workshop = Workshop::new();
    if let Some(library) = std::env::var_os("PLAYER_LIBRARY") {
        fs::copy(library, workshop.path("libclient.so")).unwrap();
    }
    println!("{}", workshop.pack("a.apk").unwrap());
    let apk = workshop.path("a.apk");

    let has = |text: &str, words: &[&str]| {
        for words in words {
            assert!(text.contains(words), "{words} is not in\n{text}");
        }
    };
    let signed = output_of("apksigner", &["verify", "--verbose", "--min-sdk-version", "24"], &apk);
    has(&signed, &["Scheme v2): true", "Scheme v3): true", "Number of signers: 1"]);

    let badging = output_of("aapt", &["dump", "badging"], &apk);
    has(
        &badging,
        &[
            "package: name='org.aarc.client' versionCode='1002004' versionName='1.2.3'",
            "sdkVersion:'29'",
            "launchable-activity: name='android.app.NativeActivity'",
            "uses-feature: name='android.hardware.vr.headtracking'",
            "native-code: 'arm64-v8a'",
        ],
    );
    let manifest =
        Command::new("aapt").args(["dump", "xmltree"]).arg(&apk).arg("AndroidManifest.xml").output();
    let manifest = String::from_utf8(manifest.unwrap().stdout).unwrap();
    let activity = manifest.split("E: activity").nth(1).expect("there is an activity");
    // True is all ones, false zero.
    has(
        activity,
        &["android:exported(0x01010010)=(type 0x12)0xffffffff", "\"android.app.lib_name\"", "\"client\""],
    );
    has(&manifest, &["android:extractNativeLibs(0x010104ea)=(type 0x12)0x0"]);

    output_of("zipalign", &["-c", "4"], &apk);
    // Only libraries must be aligned to 16 KiB, so zipalign reports the APK as a whole as unaligned.
    let alignment = Command::new("zipalign").args(["-c", "-v", "16384"]).arg(&apk).output().unwrap();
    let alignment = String::from_utf8(alignment.stdout).unwrap();
    for name in ["lib/arm64-v8a/libclient.so", "lib/arm64-v8a/libopenxr_loader.so"] {
        has(&alignment, &[&format!("{name} (OK)")]);
    }
}
