//! The progress of a fit in its bar.

use indicatif::ProgressBar;

use crate::fit::FitProgress;
use crate::progress::counting;

/// A bar of so many steps. Until the first one, it says what takes its time.
pub(super) fn fit_bar(steps: u64) -> ProgressBar {
    counting(steps, "steps").with_message("(finding the first Gaussians in the photographs)")
}

/// Shows the steps, the loss and the number of Gaussians.
pub(super) fn show(bar: &ProgressBar, progress: &FitProgress) {
    bar.set_position(progress.step);
    let held = progress.held_psnr_db.map_or(String::new(), |psnr| format!(", held {psnr:.2} dB"));
    bar.set_message(format!("loss {:.4}{held}, {} Gaussians", progress.loss, progress.gaussians));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_comes_before_the_first_step_is_said() {
        let bar = fit_bar(60);
        assert_eq!(
            (bar.length(), bar.message().as_str()),
            (Some(60), "(finding the first Gaussians in the photographs)")
        );
        show(&bar, &FitProgress { step: 1, loss: 0.5, held_psnr_db: None, gaussians: 7 });
        assert_eq!((bar.position(), bar.message().as_str()), (1, "loss 0.5000, 7 Gaussians"));
    }
}
