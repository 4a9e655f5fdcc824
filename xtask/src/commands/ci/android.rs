//! Android checks that need neither the NDK nor a headset.
//!
//! The player is compiled with Debian's Rust and linked against stand-ins for Android's libraries that have exactly the symbols of
//! `android/symbols.txt`; a new symbol has to be looked up and added there. The library (without that Rust, a stub) is
//! packed as an APK, which Android's own programs check.
//!
//! None of it runs on Android, and its output is not for use.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, ensure};
use xtask::workspace;

use super::debian_rust;
use super::steps::Steps;
use crate::commands::apk::{API_LEVEL, FEATURES, LIBRARY, PAGE_BYTES, TARGET};
use crate::setup::Need;

/// Runs the checks that this machine can run.
pub(super) fn check(steps: &mut Steps) {
    let library = if Need::DebianRust.is_met() {
        link(steps)
    } else {
        steps.skip("link, Android", "its compiler is not installed");
        None
    };
    if Need::ApkTools.is_met() {
        check_apk(steps, library.as_deref());
    } else {
        steps.skip("an APK, by aapt, apksigner and zipalign", "they are not installed");
    }
}

/// Runs Android's programs on an APK of the library, or of a stub.
fn check_apk(steps: &mut Steps, library: Option<&Path>) {
    let mut test = workspace::cargo();
    test.current_dir(workspace::root().join("xtask/apk"))
        .args(["test", "--quiet", "--locked", "--test", "packing", "--"])
        .args(["--ignored", "--nocapture"]);
    let name = match library {
        Some(library) => {
            test.env("PLAYER_LIBRARY", library);
            "APK of the player, by aapt, apksigner and zipalign"
        }
        None => "APK of a stub, by aapt, apksigner and zipalign",
    };
    steps.run(name, &mut test);
}

/// Builds and links the player's library, and returns its path.
fn link(steps: &mut Steps) -> Option<PathBuf> {
    let name = "link, Android";
    let stand_ins = debian_rust::folder().join("stand-ins");
    let made = fs::read_to_string(workspace::root().join("android/symbols.txt"))
        .context("android/symbols.txt")
        .and_then(|list| make_stand_ins(&parse_symbols(&list)?, &stand_ins));
    if let Err(error) = made {
        steps.fail(name, &error);
        return None;
    }
    let mut cargo = workspace::cargo();
    cargo.args(["rustc", "--quiet", "--crate-type", "cdylib", "--release"]);
    configure(&mut cargo);
    let mut flags = vec![format!("-Clink-arg=-L{}", stand_ins.display())];
    flags.extend(LINK_ARGS.iter().map(|arg| format!("-Clink-arg={arg}")).chain([
        format!("-Clink-arg=--target={TARGET}{API_LEVEL}"),
        format!("-Clink-arg=-Wl,-z,max-page-size={PAGE_BYTES}"),
    ]));
    cargo
        .env("CARGO_TARGET_AARCH64_LINUX_ANDROID_LINKER", debian_rust::program("clang"))
        .env("CARGO_ENCODED_RUSTFLAGS", flags.join("\x1f"))
        .env("CARGO_PROFILE_RELEASE_STRIP", "symbols");
    let linked = steps.run(name, &mut cargo);
    linked.then(|| debian_rust::folder().join(TARGET).join("release").join(LIBRARY))
}

/// Sets arguments and environment so that Cargo builds the player for Android.
fn configure(cargo: &mut Command) {
    // Headers of GNU/Linux stand in for Android's.
    let headers = workspace::debian_rust_folder().join("usr/aarch64-linux-gnu/include");
    let target = format!("--target={TARGET}{API_LEVEL}");
    let flags = [&*target, "-nostdlibinc", "-isystem", &headers.to_string_lossy()];
    cargo.args(["--package", "client", "--lib"]).args(FEATURES);
    debian_rust::configure(cargo, TARGET, "std,panic_abort", &debian_rust::folder());
    cargo
        .env("CC_aarch64_linux_android", debian_rust::program("clang"))
        .env("CFLAGS_aarch64_linux_android", workspace::shell_line(&flags))
        .env("CC_SHELL_ESCAPED_FLAGS", "1")
        .env("AR_aarch64_linux_android", "ar")
        .env("RANLIB_aarch64_linux_android", "ranlib");
}

/// Builds a library for each entry, with its symbols as empty functions.
fn make_stand_ins(symbols: &Symbols<'_>, folder: &Path) -> anyhow::Result<()> {
    fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    for (library, symbols) in symbols {
        let source = folder.join(library).with_extension("c");
        let functions: Vec<String> =
            symbols.iter().map(|symbol| format!("void {symbol}(void) {{}}\n")).collect();
        fs::write(&source, functions.concat())?;
        let mut clang = Command::new(debian_rust::program("clang"));
        clang
            .env("LD_LIBRARY_PATH", debian_rust::libraries())
            .args(LINK_ARGS)
            .arg(format!("--target={TARGET}{API_LEVEL}"))
            // Some names are builtins of the compiler with other types.
            .args(["-w", "-ffreestanding", "-fno-builtin", "-fPIC"]);
        let made = if library.ends_with(".a") {
            let object = source.with_extension("o");
            ensure!(clang.arg("-c").arg(&source).arg("-o").arg(&object).status()?.success(), "clang failed");
            let archive = folder.join(library);
            Command::new("ar").arg("rcs").arg(archive).arg(object).status()?
        } else {
            clang.args(["-shared", "-nostdlib"]).arg(format!("-Wl,-soname,{library}"));
            clang.arg(&source).arg("-o").arg(folder.join(library)).status()?
        };
        ensure!(made.success(), "{library} could not be made");
    }
    Ok(())
}

/// Linker arguments in addition to Rust's.
const LINK_ARGS: [&str; 3] = ["-fuse-ld=lld", "-nostartfiles", "-Wl,--no-undefined"];

/// Symbols by library.
type Symbols<'a> = BTreeMap<&'a str, Vec<&'a str>>;

/// Parses the list: names of libraries that end in a colon, each followed by its symbols. `#` starts a
/// comment.
fn parse_symbols(text: &str) -> anyhow::Result<Symbols<'_>> {
    let mut symbols = Symbols::new();
    let mut library = None;
    for (i, line) in text.lines().enumerate() {
        for word in line.split('#').next().unwrap_or_default().split_whitespace() {
            if let Some(name) = word.strip_suffix(':') {
                library = Some(name);
                symbols.entry(name).or_default();
            } else {
                let library =
                    library.with_context(|| format!("line {}: {word} belongs to no library", i + 1))?;
                ensure!(
                    word.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_'),
                    "line {}: {word} is not a symbol",
                    i + 1
                );
                symbols.entry(library).or_default().push(word);
            }
        }
    }
    Ok(symbols)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_list_of_symbols_is_parsed() {
        let text = "# why\nlibm.so:\n  sin cos # round\n  tan\nlibdl.so: dlsym\n";
        let symbols = parse_symbols(text).unwrap();
        assert_eq!(symbols["libm.so"], ["sin", "cos", "tan"]);
        assert_eq!(symbols["libdl.so"], ["dlsym"]);
        assert!(parse_symbols("sin").is_err() && parse_symbols("libm.so: s;n").is_err());
    }

    #[test]
    fn no_symbol_is_listed_twice() {
        let text = fs::read_to_string(workspace::root().join("android/symbols.txt")).unwrap();
        let mut all: Vec<&str> = parse_symbols(&text).unwrap().into_values().flatten().collect();
        let count = all.len();
        all.sort_unstable();
        all.dedup();
        assert_eq!(all.len(), count);
    }
}
