//! Progress bars, drawn on standard error only where that is a terminal.

use std::fmt::Write;

use indicatif::{HumanDuration, ProgressBar, ProgressState, ProgressStyle};

/// A bar that counts up to `length` of `noun`, in the plural.
pub fn counting(length: u64, noun: &str) -> ProgressBar {
    ProgressBar::new(length).with_style(style(&format!("{{bar:30}} {{pos}}/{{len}} {noun}{{left}} {{msg}}")))
}

/// A style whose key `left` is the remaining time, once there is a first step to estimate it from.
fn style(template: &str) -> ProgressStyle {
    let left = |state: &ProgressState, text: &mut dyn Write| {
        if state.pos() > 0 {
            let _ = write!(text, ", {:#} left", HumanDuration(state.eta()));
        }
    };
    ProgressStyle::with_template(template).expect("a valid template").with_key("left", left)
}

/// A bar that restarts with each stage of a command.
#[derive(Debug)]
pub struct StagedProgress(ProgressBar);

impl StagedProgress {
    /// A bar that is never drawn.
    pub fn hidden() -> StagedProgress {
        StagedProgress(ProgressBar::hidden())
    }

    /// A bar without a stage yet.
    pub fn visible() -> StagedProgress {
        StagedProgress(ProgressBar::new(1).with_style(style("{bar:30} {percent:>3} %{left}  {prefix}{msg}")))
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

#[cfg(test)]
mod tests {
    use std::io;
    use std::sync::{Arc, Mutex};

    use indicatif::{ProgressDrawTarget, TermLike};

    use super::*;

    /// A terminal that keeps what is written to it.
    #[derive(Clone, Debug, Default)]
    struct TextTerminal(Arc<Mutex<String>>);

    impl TextTerminal {
        fn text(&self) -> String {
            std::mem::take(&mut self.0.lock().unwrap())
        }
    }

    impl TermLike for TextTerminal {
        fn width(&self) -> u16 {
            100
        }
        fn move_cursor_up(&self, _: usize) -> io::Result<()> {
            Ok(())
        }
        fn move_cursor_down(&self, _: usize) -> io::Result<()> {
            Ok(())
        }
        fn move_cursor_right(&self, _: usize) -> io::Result<()> {
            Ok(())
        }
        fn move_cursor_left(&self, _: usize) -> io::Result<()> {
            Ok(())
        }
        fn write_line(&self, text: &str) -> io::Result<()> {
            self.write_str(text)
        }
        fn write_str(&self, text: &str) -> io::Result<()> {
            self.0.lock().unwrap().push_str(text);
            Ok(())
        }
        fn clear_line(&self) -> io::Result<()> {
            Ok(())
        }
        fn flush(&self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn no_time_is_left_before_the_first_step() {
        let screen = TextTerminal::default();
        let bar = counting(95_200, "steps");
        bar.set_draw_target(ProgressDrawTarget::term_like(Box::new(screen.clone())));
        bar.force_draw();
        let start = screen.text();
        assert!(start.contains("0/95200 steps") && !start.contains("left"), "{start}");
        bar.set_position(40);
        bar.force_draw();
        let later = screen.text();
        assert!(later.contains("40/95200 steps, ") && later.contains(" left"), "{later}");
    }
}
