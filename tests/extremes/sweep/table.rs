//! What was found, as Markdown.

use std::fmt::Write;

/// One method at one value.
#[derive(Clone, Debug)]
pub(super) struct Cell {
    /// Relative deviation of the mean of the picture, and its standard error.
    pub(super) deviation: f64,
    pub(super) error: f64,
    /// The largest deviation of the picture, its upper and its left half in standard errors, and the p-value of it.
    pub(super) z: f64,
    pub(super) p: f64,
    /// Samples that were not finite, and dropped.
    pub(super) invalid: u64,
    /// Is every number of every layer finite, and of the picture denoised?
    pub(super) is_finite: bool,
    /// Seconds of a processor for one sample of one pixel.
    pub(super) seconds: f64,
}

impl Cell {
    /// Is it as it should be?
    pub(super) fn is_good(&self, level: f64) -> bool {
        self.p > level && self.invalid == 0 && self.is_finite
    }

    /// Deviation, its error and z, and the time relative to `base`.
    fn text(&self, base: Option<f64>, level: f64) -> String {
        let mut text =
            format!("{:+.2} ± {:.2} %, {:.1}", 100.0 * self.deviation, 100.0 * self.error, self.z);
        if let Some(base) = base.filter(|&base| base > 0.0) {
            write!(text, ", ×{:.2}", self.seconds / base).expect("a string");
        }
        if !self.is_finite {
            text += ", **not finite**";
        }
        if self.invalid > 0 {
            write!(text, ", **{} samples dropped**", self.invalid).expect("a string");
        }
        if self.p <= level {
            write!(text, ", **p {:.0e}**", self.p).expect("a string");
        }
        text
    }
}

/// A table of one axis: a row for each value, a column for each method.
pub(super) fn axis_table(
    name: &str,
    meaning: &str,
    methods: &[&str],
    rows: &[(String, bool, Vec<Cell>)],
    level: f64,
) -> String {
    let mut text = format!("\n## {name}\n\n{meaning}.\n\n| {} |", name.to_lowercase());
    methods.iter().for_each(|method| write!(text, " {method} |").expect("a string"));
    text += "\n|---|";
    text += &"---|".repeat(methods.len());
    text += "\n";
    let base = rows.iter().find(|(_, is_base, _)| *is_base).map(|(.., cells)| cells);
    for (value, _, cells) in rows {
        write!(text, "| {value} |").expect("a string");
        for (index, cell) in cells.iter().enumerate() {
            let seconds = base.map(|cells| cells[index].seconds);
            write!(text, " {} |", cell.text(seconds, level)).expect("a string");
        }
        text += "\n";
    }
    text
}
