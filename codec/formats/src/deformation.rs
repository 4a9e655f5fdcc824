//! [`refused`]: fields that a network beside them moves.
//!
//! 4DGaussians (Wu et al. 2024), Deformable 3D Gaussians (Yang et al. 2024) and SC-GS (Huang et al. 2024) fit one static
//! field and a network that moves it. Their `point_cloud.ply` alone would play as a still.

use std::fs;
use std::path::{Path, PathBuf};

/// File name of the fields of these programs, which fields of single instants do not have.
const FIELD: &str = "point_cloud.ply";

/// The network of 4DGaussians, beside the field.
const BESIDE: &str = "deformation.pth";

/// The folder of the network of the others, beside the folder `point_cloud`.
const FOLDER: &str = "deform";

/// The network there, in a folder for each iteration.
const NETWORK: &str = "deform.pth";

/// Why the field file at `path` is refused; `None` if no network moves it.
pub(crate) fn refused(path: &Path) -> Option<String> {
    if !path.ends_with(FIELD) {
        return None;
    }
    let network = network(path.parent()?)?;
    Some(format!(
        "a neural network moves these Gaussians ({}), which a field cannot hold; export the field of each frame, as a \
         sequence",
        network.display()
    ))
}

/// The network of the field in `folder`.
fn network(folder: &Path) -> Option<PathBuf> {
    let networks = folder.join("../..").join(FOLDER);
    let iterations = fs::read_dir(&networks).into_iter().flatten().flatten();
    let in_folders = iterations.map(|iteration| iteration.path().join(NETWORK));
    let mut all = [folder.join(BESIDE), networks.join(NETWORK)].into_iter().chain(in_folders);
    all.find(|network| network.is_file())
}
