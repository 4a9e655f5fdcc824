//! Packs, signs and checks the APK of the player from the parts that `cargo xtask apk` makes.

use std::env;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;
use apk_packer::{identity, package};
use clap::Parser;

/// Packs, signs and checks the APK of the player.
///
/// APK_KEYSTORE names the keystore to sign with, .p12 or .jks with one key; its password is in APK_KEYSTORE_PASSWORD.
/// Without it a debug key signs, ROOT/android/debug-key.pem, made if missing.
#[derive(Parser)]
struct Args {
    /// The repository, with android/AndroidManifest.xml, android/icon.png and assets/demo.aarc.
    root: PathBuf,
    /// Folder with libclient.so and libopenxr_loader.so for 64-bit ARM, and NOTICES.txt.
    parts: PathBuf,
    /// Version of the player, MAJOR.MINOR.PATCH.
    app_version: String,
    /// The APK to write.
    out: PathBuf,
}

fn main() -> ExitCode {
    match run(&Args::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn run(Args { root, parts, app_version, out }: &Args) -> anyhow::Result<()> {
    let identity = match env::var_os("APK_KEYSTORE") {
        Some(keystore) => {
            let password = env::var("APK_KEYSTORE_PASSWORD")
                .context("APK_KEYSTORE_PASSWORD, the password of the keystore, is not set")?;
            identity::of_keystore(keystore.as_ref(), &password)?
        }
        None => identity::for_debugging(&root.join("android/debug-key.pem"))?,
    };
    let parts = package::Parts {
        manifest: &root.join("android/AndroidManifest.xml"),
        icon: &root.join("android/icon.png"),
        library: &parts.join("libclient.so"),
        openxr_loader: &parts.join("libopenxr_loader.so"),
        clip: &root.join("assets/demo.aarc"),
        notices: &parts.join("NOTICES.txt"),
        version: app_version,
    };
    package::write(&parts, identity, out)?;
    print!("{}", package::check(out)?);
    Ok(())
}
