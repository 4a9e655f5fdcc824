//! Packs, signs and checks the APK of the player from the parts that `cargo xtask apk` makes.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;
use apk_packer::{identity, package};
use clap::Parser;

/// Packs, signs and checks the APK of the player.
#[derive(Parser)]
struct Args {
    /// AndroidManifest.xml; its version is set from --app-version.
    #[arg(long, value_name = "FILE")]
    manifest: PathBuf,
    /// The launcher's icon, a PNG of 192x192 pixels.
    #[arg(long, value_name = "FILE")]
    icon: PathBuf,
    /// The player, lib*.so for 64-bit ARM, with the name in the manifest.
    #[arg(long, value_name = "FILE")]
    library: PathBuf,
    /// libopenxr_loader.so for 64-bit ARM.
    #[arg(long, value_name = "FILE")]
    openxr_loader: PathBuf,
    /// A clip, added as an asset of its name.
    #[arg(long, value_name = "FILE")]
    clip: PathBuf,
    /// Licences of everything in the APK, added as an asset of its name.
    #[arg(long, value_name = "FILE")]
    notices: PathBuf,
    /// Version of the player, MAJOR.MINOR.PATCH.
    #[arg(long, value_name = "VERSION")]
    app_version: String,
    /// Debug key and certificate, PEM; made if missing.
    #[arg(long, value_name = "FILE", required_unless_present = "keystore")]
    debug_key: Option<PathBuf>,
    /// Keystore to sign with, .p12 or .jks with one key; its password is in APK_KEYSTORE_PASSWORD.
    #[arg(long, value_name = "FILE", conflicts_with = "debug_key")]
    keystore: Option<PathBuf>,
    /// The APK to write.
    #[arg(long, value_name = "FILE")]
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

fn run(args: &Args) -> anyhow::Result<()> {
    let identity = match (&args.keystore, &args.debug_key) {
        (Some(keystore), _) => {
            let password = std::env::var("APK_KEYSTORE_PASSWORD")
                .context("APK_KEYSTORE_PASSWORD, the password of the keystore, is not set")?;
            identity::of_keystore(keystore, &password)?
        }
        (None, Some(key)) => identity::for_debugging(key)?,
        (None, None) => anyhow::bail!("no key to sign with"),
    };
    let parts = package::Parts {
        manifest: &args.manifest,
        icon: &args.icon,
        library: &args.library,
        openxr_loader: &args.openxr_loader,
        clip: &args.clip,
        notices: &args.notices,
        version: &args.app_version,
    };
    package::write(&parts, identity, &args.out)?;
    print!("{}", package::check(&args.out)?);
    Ok(())
}
