//! `cargo xtask synth`: procedural data, made of formulas.

use std::path::PathBuf;

use clap::Subcommand;
use xtask::synth::{juggler, limbs};
use xtask::{export, output};

/// Make a procedural scene.
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(subcommand)]
    scene: Scene,
}

#[derive(Subcommand)]
enum Scene {
    /// The demo scene: a juggler in a circus ring, 3 seconds that loop, as a field file
    Clip {
        /// File to write (.ply)
        #[arg(short, long, value_name = "PATH")]
        out: PathBuf,
    },
    /// A figure whose thin limbs a ranking cuts off and the topology floor keeps, as a field file
    Limbs {
        /// File to write (.ply)
        #[arg(short, long, value_name = "PATH")]
        out: PathBuf,
    },
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let (Scene::Clip { out } | Scene::Limbs { out }) = &args.scene;
    output::check(out)?;
    let (field, info) = match args.scene {
        Scene::Clip { .. } => juggler::clip(),
        Scene::Limbs { .. } => limbs::figure(),
    };
    let bytes = export::field_file(&field, &info);
    output::write(out, &bytes)?;
    println!("{}: {} Gaussians, {} bytes", out.display(), field.len(), bytes.len());
    Ok(())
}
