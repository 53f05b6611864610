//! Progress of a training run on standard error: a bar on a terminal, now and then a plain line elsewhere.

use std::io::{self, IsTerminal};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};

pub use kestrel_draw::chart::amount;

use crate::output::{is_quiet, warn};

/// Shortest time between two plain lines, so that a log of a long run stays short.
const LINE_INTERVAL: Duration = Duration::from_secs(5);

/// Redraws of the bar per second; more cannot be read.
const REDRAWS_PER_SECOND: u8 = 5;

/// What the user sees after an update.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProgressReport {
    /// Environment steps since the run began.
    pub steps: u64,
    /// Mean return of the episodes that ended in the update, if any did.
    pub episode_return: Option<f32>,
    /// Share of successes among them in \[0, 1\].
    pub success_rate: Option<f32>,
}

/// Shows how far a run is.
#[derive(Debug)]
pub struct Progress {
    bar: Option<ProgressBar>,
    lines: Lines,
}

impl Progress {
    /// Starts at `done` of `total` environment steps (`done` is 0 unless the run resumes).
    pub fn new(total: u64, done: u64) -> Self {
        Self::counting("steps", total, done)
    }

    /// As [`Self::new`], of other things than steps.
    pub fn counting(unit: &'static str, total: u64, done: u64) -> Self {
        let lines = Lines { unit, total, began_at: done, started: Instant::now(), last: None };
        let visible = io::stderr().is_terminal() && !is_quiet();
        Self { bar: visible.then(|| bar(unit, total, done)), lines }
    }

    /// Shows the state after an update.
    pub fn show(&mut self, report: &ProgressReport) {
        self.show_steps(report.steps, || results(report));
    }

    /// Shows how many steps are done and a `message`.
    pub fn show_steps(&mut self, steps: u64, message: impl Fn() -> String) {
        match &self.bar {
            Some(bar) => {
                bar.set_position(steps);
                bar.set_message(message());
            }
            None => self.write_line_when_due(steps, message),
        }
    }

    /// Prints a line of its own above the bar, or among the plain lines.
    pub fn say(&self, text: &str) {
        let print = || warn(text);
        match &self.bar {
            Some(bar) => bar.suspend(print),
            None => print(),
        }
    }

    /// Leaves the last state on the screen and goes on to the next line.
    pub fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.abandon();
        }
    }

    fn write_line_when_due(&mut self, steps: u64, message: impl Fn() -> String) {
        if let Some(line) = self.lines.line_when_due(steps, message, self.lines.started.elapsed()) {
            warn(line);
        }
    }
}

/// Plain lines, at most one per [`LINE_INTERVAL`], and one when the run is complete.
#[derive(Debug)]
struct Lines {
    unit: &'static str,
    total: u64,
    began_at: u64,
    started: Instant,
    last: Option<Duration>,
}

impl Lines {
    fn line_when_due(&mut self, steps: u64, message: impl Fn() -> String, elapsed: Duration) -> Option<String> {
        let complete = steps >= self.total;
        let due = self.last.is_none_or(|last| elapsed >= last + LINE_INTERVAL);
        (due || complete).then(|| {
            self.last = Some(elapsed);
            self.line(steps, &message(), elapsed)
        })
    }

    fn line(&self, steps: u64, message: &str, elapsed: Duration) -> String {
        let per_second = steps.saturating_sub(self.began_at) as f64 / elapsed.as_secs_f64().max(1e-3);
        let secs_left = self.total.saturating_sub(steps) as f64 / per_second;
        let unit = self.unit;
        let left = if per_second > 0.0 { clock(secs_left) } else { "?".to_owned() };
        format!(
            "{:>3} %  {} of {} {unit}  {} {unit}/s  {left} left  {message}",
            percentage(steps, self.total),
            amount(steps as f64),
            amount(self.total as f64),
            amount(per_second),
        )
    }
}

fn bar(unit: &str, total: u64, done: u64) -> ProgressBar {
    let target = ProgressDrawTarget::stderr_with_hz(REDRAWS_PER_SECOND);
    let template = format!(
        "{{bar:28.cyan/238}} {{share}} %  {{done}} of {{total}}  {{rate}} {unit}/s  {{left}} left  {{msg}}"
    );
    let style = ProgressStyle::with_template(&template)
        .expect("the template is well formed")
        .progress_chars("━━─")
        .with_key("share", |state: &ProgressState, out: &mut dyn std::fmt::Write| {
            let _ = write!(out, "{:>3}", percentage(state.pos(), state.len().unwrap_or(0)));
        })
        .with_key("done", |state: &ProgressState, out: &mut dyn std::fmt::Write| {
            let _ = out.write_str(&amount(state.pos() as f64));
        })
        .with_key("total", |state: &ProgressState, out: &mut dyn std::fmt::Write| {
            let _ = out.write_str(&amount(state.len().unwrap_or(0) as f64));
        })
        .with_key("rate", |state: &ProgressState, out: &mut dyn std::fmt::Write| {
            let _ = out.write_str(&amount(state.per_sec()));
        })
        .with_key("left", |state: &ProgressState, out: &mut dyn std::fmt::Write| {
            let known = state.per_sec() > 0.0;
            let _ = out.write_str(&if known { clock(state.eta().as_secs_f64()) } else { "?".to_owned() });
        });
    let bar = ProgressBar::with_draw_target(Some(total), target).with_style(style).with_position(done);
    bar.reset_eta();
    bar
}

/// Whole per cent, 100 only when nothing is left.
fn percentage(done: u64, total: u64) -> u64 {
    if total == 0 { 100 } else { (done.min(total) as u128 * 100 / total as u128) as u64 }
}

fn results(report: &ProgressReport) -> String {
    match (report.episode_return, report.success_rate) {
        (Some(episode_return), Some(success_rate)) => {
            format!("return {episode_return:.2}  success {:.1} %", 100.0 * success_rate)
        }
        _ => "no episode ended".to_owned(),
    }
}

/// Minutes and seconds, or hours and minutes.
fn clock(secs: f64) -> String {
    let whole = secs.min(359_999.0).round() as u64;
    let (hours, minutes, secs) = (whole / 3600, whole / 60 % 60, whole % 60);
    if hours > 0 { format!("{hours} h {minutes:02} min") } else { format!("{minutes}:{secs:02}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: Duration = Duration::from_secs(1);

    fn lines(total: u64, began_at: u64) -> Lines {
        Lines { unit: "steps", total, began_at, started: Instant::now(), last: None }
    }

    fn report(steps: u64) -> ProgressReport {
        ProgressReport { steps, episode_return: Some(312.456), success_rate: Some(0.875) }
    }

    #[test]
    fn a_line_tells_share_speed_time_left_and_results() {
        assert_eq!(
            lines(2_000_000, 0).line(500_000, &results(&report(500_000)), 2 * SECOND),
            " 25 %  500 k of 2.00 M steps  250 k steps/s  0:06 left  return 312.46  success 87.5 %"
        );
    }

    #[test]
    fn steps_of_an_earlier_session_do_not_count_as_speed() {
        let line = lines(2_000_000, 1_000_000).line(1_500_000, "", 5 * SECOND);
        assert!(line.contains(" 100 k steps/s  0:05 left"), "{line}");
    }

    #[test]
    fn before_the_first_step_nobody_knows_the_time_left() {
        let line = lines(2_000_000, 1_000_000).line(1_000_000, "", SECOND);
        assert!(line.contains(" 0 steps/s  ? left"), "{line}");
    }

    #[test]
    fn lines_are_seconds_apart_but_the_last_one_always_comes() {
        let mut lines = lines(1000, 0);
        let mut due =
            |steps, millis| lines.line_when_due(steps, String::new, Duration::from_millis(millis)).is_some();
        assert!(due(1, 10));
        assert!(!due(2, 20) && !due(3, 5000));
        assert!(due(4, 5010));
        assert!(!due(999, 5020));
        assert!(due(1000, 5030));
    }

    #[test]
    fn without_an_ended_episode_there_is_no_return() {
        let none = ProgressReport { steps: 1, episode_return: None, success_rate: None };
        assert_eq!(results(&none), "no episode ended");
    }

    #[test]
    fn a_run_is_at_100_percent_only_when_complete() {
        assert_eq!([percentage(999, 1000), percentage(1000, 1000), percentage(1001, 1000)], [99, 100, 100]);
        assert_eq!(percentage(0, 0), 100);
    }

    #[test]
    fn clocks_are_read_at_a_glance() {
        assert_eq!([0.4, 61.0, 3720.0].map(clock), ["0:00", "1:01", "1 h 02 min"]);
        assert_eq!(clock(f64::INFINITY), "99 h 59 min");
    }

    #[test]
    fn a_bar_is_drawn_on_a_terminal_only() {
        let progress = Progress::new(10, 0);
        progress.say("saved");
        progress.finish();
        assert_eq!(progress.bar.is_some(), io::stderr().is_terminal());
    }
}
