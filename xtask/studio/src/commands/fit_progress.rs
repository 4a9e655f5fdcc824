//! [`show`]: the progress of a fit in its bar.

use indicatif::ProgressBar;

use crate::fit::FitProgress;

/// Shows the steps, the loss and the number of Gaussians.
pub(super) fn show(bar: &ProgressBar, progress: &FitProgress) {
    bar.set_position(progress.step);
    let held = progress.held_psnr_db.map_or(String::new(), |psnr| format!(", held {psnr:.2} dB"));
    bar.set_message(format!("loss {:.4}{held}, {} Gaussians", progress.loss, progress.gaussians));
}
