//! `cargo xtask depths`: estimates depth maps of photographs with a network.

use std::path::PathBuf;

use super::capture::FrameSelection;
use super::options::OutOption;

/// Estimate depth maps of a capture's photographs with a network, for `fit --anchor DIR`: one PFM file for each training photograph.
///
/// Needs a build with --features onnx.
#[derive(clap::Args)]
pub struct Args {
    /// Folder of the capture: its cameras and photographs (layouts: xtask/CAPTURE.md)
    capture: PathBuf,
    /// Folder of the network: backbone.json and the files of its stages, *.onnx (format:
    /// xtask/CAPTURE.md). ONNX Runtime is loaded from the system's library path, or from ORT_DYLIB_PATH
    #[arg(long, value_name = "DIR")]
    backbone: PathBuf,
    #[command(flatten)]
    out: OutOption,
    #[command(flatten)]
    selection: FrameSelection,
}

#[cfg(not(feature = "onnx"))]
pub(crate) fn run(_: &Args) -> anyhow::Result<()> {
    anyhow::bail!(program::Fault::Usage(
        "depths: this build cannot run networks; \
         run `cargo run --release --package studio --features onnx -- depths ...`"
            .into(),
    ))
}

#[cfg(feature = "onnx")]
pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    use crate::backbone::Backbone;
    use crate::capture::pfm_file;
    use crate::progress::counting;
    use program::{Fault, output};
    use refine::capture::{PhotoId, Split};

    let capture_files = args.selection.open(&args.capture)?;
    let splits = Split::assign(&capture_files.capture, args.selection.holdout_of_fit())
        .map_err(|error| Fault::Data(error.to_string()))?;
    let train = splits.into_iter().filter(|(_, split)| *split == Split::Train);
    let mut photo_ids: Vec<PhotoId> = train.map(|(photo_id, _)| photo_id).collect();
    photo_ids.sort();
    let mut backbone = Backbone::open(&args.backbone)?;
    let bar = counting(photo_ids.len() as u64, "photographs");
    let mut size = (0, 0);
    for photo_ids in photo_ids.chunk_by(|a, b| a.frame == b.frame) {
        let maps =
            backbone.depths(photo_ids.iter().map(|photo_id| capture_files.unprocessed_photo(*photo_id)))?;
        for (photo_id, map) in photo_ids.iter().zip(&maps) {
            let path = args.out.path.join(format!("{}.pfm", capture_files.name(*photo_id)));
            let folder = path.parent().expect("it is a file");
            output::make_folder(folder)?;
            output::write(&path, &pfm_file(map))?;
            size = (map.width, map.height);
            bar.inc(1);
        }
    }
    bar.finish_and_clear();
    println!("{} depth maps of {}x{} in {}", photo_ids.len(), size.0, size.1, args.out.path.display());
    Ok(())
}
