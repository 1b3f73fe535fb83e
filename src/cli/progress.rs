//! Progress of long work: a bar on a terminal, plain lines elsewhere.

use indicatif::{ProgressBar, ProgressStyle};
use std::io::IsTerminal;
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// Lines come this far apart when no terminal is there to draw a bar on.
const LINE_INTERVAL: Duration = Duration::from_secs(10);

/// Shows how far work has come.
pub(super) struct Progress {
    bar: ProgressBar,
    /// What is being done, its unit, and the moment of the last line; `None` where the bar is drawn.
    lines: Option<(&'static str, &'static str, Mutex<Instant>)>,
    start: Instant,
}

impl Progress {
    /// `total` steps of `unit`; `name` says what is being done.
    pub(super) fn new(name: &'static str, unit: &'static str, total: u64) -> Self {
        let template = format!(
            "{name:>10} [{{bar:32}}] {{percent:>3}} %  {{human_pos}}/{{human_len}} {unit}  {{per_sec}}  {{eta}} left"
        );
        let style = ProgressStyle::with_template(&template)
            .expect("the template is a constant that parses")
            .progress_chars("=> ")
            .with_key(
                "per_sec",
                |state: &indicatif::ProgressState, out: &mut dyn std::fmt::Write| {
                    // A failed write to the bar's own text shows as a missing figure; there is nobody to tell.
                    let _ = write!(out, "{}/s", human(state.per_sec()));
                },
            );
        let bar = ProgressBar::new(total).with_style(style);
        let now = Instant::now();
        let lines = (!std::io::stderr().is_terminal()).then(|| (name, unit, Mutex::new(now)));
        Self { bar, lines, start: now }
    }

    /// `done` steps are done.
    pub(super) fn at(&self, done: u64) {
        let Some((name, unit, last)) = &self.lines else {
            // Workers may report out of order; the bar only goes forward.
            self.bar.set_position(done.max(self.bar.position()));
            return;
        };
        let Ok(mut last) = last.try_lock() else { return };
        if last.elapsed() < LINE_INTERVAL {
            return;
        }
        *last = Instant::now();
        let total = self.bar.length().unwrap_or(1).max(1);
        let part = done as f64 / total as f64;
        let elapsed = self.start.elapsed().as_secs_f64();
        let left = elapsed * (1.0 - part) / part.max(1e-9);
        eprintln!(
            "{name}: {:.0} % of {}{unit}, {}/s, {left:.0} s left",
            100.0 * part,
            human(total as f64),
            human(done as f64 / elapsed)
        );
    }

    /// The work is over; the bar goes away.
    pub(super) fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

/// A number with a suffix for thousands, such as 1.25 M.
pub(super) fn human(number: f64) -> String {
    let (scaled, suffix) = match number {
        n if n >= 1e9 => (n / 1e9, " G"),
        n if n >= 1e6 => (n / 1e6, " M"),
        n if n >= 1e3 => (n / 1e3, " k"),
        n => (n, " "),
    };
    format!("{scaled:.3}{suffix}")
}
