//! Progress on standard error: bars where that is a terminal, and of commands with stages lines where it is not.

use std::fmt::Write;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

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

/// Steps of a bar of the whole.
const SHARES: f64 = 1000.0;

/// Least time between two lines of a stage: what is quick needs none.
const LINES_APART: Duration = Duration::from_secs(1);

/// The stages of a command, one after another.
///
/// On a terminal they are a bar: of the whole where [`StagedProgress::plan`] said how much work that is, else of each
/// stage. In a log each stage is a line.
#[derive(Debug)]
pub struct StagedProgress {
    bar: ProgressBar,
    /// The log; `None` where there is a bar, or nothing is shown.
    log: Option<fn(&str)>,
    start: Instant,
    state: Mutex<StageState>,
}

/// Where a command is.
#[derive(Debug, Default)]
struct StageState {
    /// Text before the names of stages.
    prefix: String,
    /// The names of all stages with their work; empty without a plan.
    plan: Vec<(String, f64)>,
    /// Work of the stages that have ended.
    ended: f64,
    /// Work of the current stage, its number of steps, and how many of them are done.
    work: f64,
    steps: usize,
    done: usize,
    /// When the last line of the stage was written.
    written_at: Option<Instant>,
}

impl StageState {
    /// Share of the planned work that is done, 0 to 1; `None` without a plan.
    fn share(&self) -> Option<f64> {
        let whole: f64 = self.plan.iter().map(|(_, work)| work).sum();
        let of_stage = self.work * (self.done as f64 / self.steps.max(1) as f64).min(1.0);
        (whole > 0.0).then(|| ((self.ended + of_stage) / whole).min(1.0))
    }
}

impl StagedProgress {
    /// Progress that is never shown.
    pub fn hidden() -> StagedProgress {
        StagedProgress::on(ProgressBar::hidden(), None)
    }

    /// Progress on standard error: a bar if that is a terminal, else lines.
    pub fn visible() -> StagedProgress {
        let bar = ProgressBar::new(1).with_style(style("{bar:30} {percent:>3} %{left}  {msg}"));
        let log: fn(&str) = |line| eprintln!("{line}");
        let log = bar.is_hidden().then_some(log);
        StagedProgress::on(bar, log)
    }

    fn on(bar: ProgressBar, log: Option<fn(&str)>) -> StagedProgress {
        StagedProgress { bar, log, start: Instant::now(), state: Mutex::default() }
    }

    /// Begins a whole of these stages, each with its work in one unit.
    pub fn plan(&self, plan: Vec<(String, f64)>) {
        let mut state = self.state();
        *state = StageState { prefix: std::mem::take(&mut state.prefix), plan, ..StageState::default() };
        self.bar.reset();
        self.bar.set_length(SHARES as u64);
    }

    /// Sets the text before the names of the following stages.
    pub fn set_prefix(&self, prefix: String) {
        self.state().prefix = prefix;
    }

    /// Begins a stage of so many steps. Where there is a plan, it has the work of its name there.
    pub fn stage(&self, name: impl AsRef<str>, steps: usize) {
        let (mut state, name) = (self.state(), name.as_ref());
        state.ended += state.work;
        state.work = state.plan.iter().find(|(planned, _)| planned == name).map_or(0.0, |(_, work)| *work);
        (state.steps, state.done, state.written_at) = (steps, 0, None);
        if state.plan.is_empty() {
            self.bar.reset();
            self.bar.set_length(steps as u64);
        }
        drop(state);
        self.say(name);
    }

    /// Says what the stage does now: the text after the bar, or a line, unless the last one is as good as new.
    pub fn say(&self, what: &str) {
        let mut state = self.state();
        let what = format!("{}{what}", state.prefix);
        self.show(&state);
        let is_due = state.written_at.is_none_or(|written_at| written_at.elapsed() >= LINES_APART);
        if let Some(log) = self.log.filter(|_| is_due) {
            state.written_at = Some(Instant::now());
            let share = state.share().map_or(String::new(), |share| format!(", {:.0} %", 100.0 * share));
            log(&format!("note: {:.1} s{share}: {what}", self.start.elapsed().as_secs_f64()));
        }
        self.bar.set_message(what);
    }

    /// Counts a step of the stage.
    pub fn step(&self) {
        let mut state = self.state();
        state.done += 1;
        self.show(&state);
    }

    /// Removes the bar, and ends the plan: what follows is no part of it.
    pub fn finish(&self) {
        let mut state = self.state();
        *state = StageState { prefix: std::mem::take(&mut state.prefix), ..StageState::default() };
        self.bar.finish_and_clear();
    }

    fn show(&self, state: &StageState) {
        let position = state.share().map_or(state.done as u64, |share| (SHARES * share) as u64);
        self.bar.set_position(position);
    }

    fn state(&self) -> MutexGuard<'_, StageState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
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

    #[test]
    fn a_bar_has_the_share_of_the_whole_where_that_is_planned() {
        let screen = TextTerminal::default();
        let progress = StagedProgress::visible();
        progress.bar.set_draw_target(ProgressDrawTarget::term_like(Box::new(screen.clone())));
        let shown = || {
            progress.bar.force_draw();
            screen.text()
        };
        progress.set_prefix("5000: ".into());
        progress.plan(vec![("one".into(), 1.0), ("two".into(), 3.0)]);
        progress.stage("one", 10);
        // It ends early.
        progress.step();
        progress.stage("two", 2);
        progress.step();
        let half = shown();
        assert!(half.contains(" 62 %") && half.contains("5000: two"), "{half}");
        // One that nobody planned takes nothing from the others.
        progress.stage("three", 1);
        let end = shown();
        assert!(end.contains("100 %") && end.contains("three"), "{end}");
        progress.say("three, trial 2 of at most 9");
        assert!(shown().contains("5000: three, trial 2 of at most 9"));
        // What follows the whole is no part of it.
        progress.finish();
        progress.stage("four", 4);
        progress.step();
        assert!(shown().contains(" 25 %"));
    }
}
