//! [`StagedProgress`]: a progress bar that restarts with each stage of a command.

use indicatif::{ProgressBar, ProgressStyle};

/// A bar on standard error, drawn only where that is a terminal.
#[derive(Debug)]
pub struct StagedProgress(ProgressBar);

impl StagedProgress {
    /// A bar that is never drawn.
    pub fn hidden() -> StagedProgress {
        StagedProgress(ProgressBar::hidden())
    }

    /// A bar without a stage yet.
    pub fn visible() -> StagedProgress {
        let style = ProgressStyle::with_template("{bar:30} {percent:>3} %  {eta} left  {prefix}{msg}");
        StagedProgress(ProgressBar::new(1).with_style(style.expect("a valid template")))
    }

    /// Sets the text before the names of the following stages.
    pub fn set_prefix(&self, prefix: String) {
        self.0.set_prefix(prefix);
    }

    /// Begins a stage of so many steps.
    pub fn stage(&self, name: impl Into<String>, steps: usize) {
        self.0.reset();
        self.0.set_length(steps as u64);
        self.0.set_message(name.into());
    }

    /// Sets the text after the bar until the next stage.
    pub fn set_message(&self, message: String) {
        self.0.set_message(message);
    }

    /// Counts a step of the stage.
    pub fn step(&self) {
        self.0.inc(1);
    }

    /// Removes the bar.
    pub fn finish(&self) {
        self.0.finish_and_clear();
    }
}
