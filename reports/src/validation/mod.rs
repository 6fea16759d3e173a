//! What `validate` found: rows of published and simulated figures.

mod markdown;
mod plots;

#[cfg(test)]
mod tests;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::fmt::Write;

use crate::sheet::signed;

pub use plots::{bandwidth_plot, latency_plot, scatter_plot};

/// One published figure beside what the machine gives.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Stable name: family, variant, parameters.
    pub id: String,
    /// Unit of all figures of the row.
    pub unit: String,
    /// The figure that was published.
    pub published: f64,
    /// Lowest figure that is acceptable.
    pub low: f64,
    /// Highest figure that is acceptable.
    pub high: f64,
    /// The figure that the machine gives; `null` when the row cannot be expressed.
    pub simulated: Option<f64>,
    /// `simulated` over `published`, less one, in percent.
    pub error_percent: Option<f64>,
    /// Whether `simulated` lies from `low` to `high`.
    pub ok: bool,
    /// Whether a miss fails the validation.
    pub must_pass: bool,
    /// How far the published figure can be trusted: `high`, `medium` or `low`.
    pub confidence: String,
    /// Whether no parameter may be chosen by this row.
    pub held_out: bool,
    /// Conditions of the measurement; or why the row is not expressed.
    pub note: String,
}

/// All rows, and what they come to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Validation {
    /// Name of the machine.
    pub machine: String,
    /// How much of it was modeled.
    pub fidelity: String,
    /// What the rows come to together.
    pub summary: Summary,
    /// The rows in the order of the targets file.
    pub rows: Vec<Row>,
}

/// Errors of a set of rows.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Errors {
    /// Rows in the set.
    pub rows: u32,
    /// Rows of the set that can be expressed.
    pub expressed: u32,
    /// Expressed rows of the set that lie in their range.
    pub inside: u32,
    /// Mean of the absolute errors of the expressed rows, percent.
    pub mean_error_percent: f64,
    /// Greatest absolute error of the expressed rows, percent.
    pub worst_error_percent: f64,
}

/// Errors of the rows, by trust and by use.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Summary {
    /// Errors of all rows.
    pub all: Errors,
    /// Errors of the rows of high confidence.
    pub high: Errors,
    /// Errors of the rows of high confidence that parameters may be chosen by.
    pub high_fitted: Errors,
    /// Errors of the rows of high confidence that no parameter may be chosen by.
    pub high_held_out: Errors,
    /// Errors of the rows that have to be met.
    pub must_pass: Errors,
}

/// How far the model is from measured machines: what every report carries, so that nobody reads its times without it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ModelError {
    /// The machine that was validated; times of others rest on the same model with other parameters.
    pub machine: String,
    /// The fidelity at which the machine was validated.
    pub fidelity: String,
    /// Published figures of high confidence that were compared.
    pub rows: u32,
    /// Of those, the ones within the range that their sources allow.
    pub inside: u32,
    /// Mean of their absolute errors, percent.
    pub mean_error_percent: f64,
    /// Greatest of the absolute errors of these figures, percent.
    pub worst_error_percent: f64,
    /// Mean over the rows by which no parameter was chosen, percent.
    pub held_out_mean_error_percent: f64,
}

impl Errors {
    fn of<'a>(rows: impl Iterator<Item = &'a Row>) -> Errors {
        let mut errors = Errors::default();
        let mut sum = 0.0;
        for row in rows {
            errors.rows += 1;
            if let Some(error) = row.error_percent {
                errors.expressed += 1;
                errors.inside += u32::from(row.ok);
                sum += error.abs();
                errors.worst_error_percent = errors.worst_error_percent.max(error.abs());
            }
        }
        errors.mean_error_percent = sum / f64::from(errors.expressed.max(1));
        errors
    }
}

impl Validation {
    /// Sums up `rows`.
    pub fn new(machine: String, fidelity: String, rows: Vec<Row>) -> Validation {
        let high = || rows.iter().filter(|row| row.confidence == "high");
        let summary = Summary {
            all: Errors::of(rows.iter()),
            high: Errors::of(high()),
            high_fitted: Errors::of(high().filter(|row| !row.held_out)),
            high_held_out: Errors::of(high().filter(|row| row.held_out)),
            must_pass: Errors::of(rows.iter().filter(|row| row.must_pass)),
        };
        Validation { machine, fidelity, summary, rows }
    }

    /// The summary that every report carries.
    pub fn model_error(&self) -> ModelError {
        let tenth = |percent: f64| (percent * 10.0).round() / 10.0;
        let high = &self.summary.high;
        ModelError {
            machine: self.machine.clone(),
            fidelity: self.fidelity.clone(),
            rows: high.expressed,
            inside: high.inside,
            mean_error_percent: tenth(high.mean_error_percent),
            worst_error_percent: tenth(high.worst_error_percent),
            held_out_mean_error_percent: tenth(self.summary.high_held_out.mean_error_percent),
        }
    }

    /// Rows that have to be met and are not.
    pub fn failures(&self) -> impl Iterator<Item = &Row> {
        self.rows.iter().filter(|row| row.must_pass && !row.ok)
    }

    /// The rows as text for a terminal.
    pub fn table(&self) -> String {
        let mut text = String::new();
        let width = self.rows.iter().map(|row| row.id.len()).max().unwrap_or(0);
        let _ = writeln!(
            text,
            "{:width$}   {:>10}  {:>21}  {:>10}  {:>8}  ",
            "id", "published", "allowed", "simulated", "error"
        );
        for row in &self.rows {
            let allowed = format!("{} to {}", figure(row.low), figure(row.high));
            let simulated = row.simulated.map_or_else(|| "-".to_owned(), figure);
            let error =
                row.error_percent.map_or_else(|| "-".to_owned(), |error| format!("{} %", signed(error, 1)));
            let _ = writeln!(
                text,
                "{:width$} {} {:>10}  {allowed:>21}  {simulated:>10}  {error:>8}  {:4}  {} {}",
                row.id,
                if row.must_pass { '!' } else { ' ' },
                figure(row.published),
                row.verdict(),
                row.unit,
                if row.note.is_empty() { String::new() } else { format!("({})", row.note) },
            );
        }
        let _ = write!(text, "\n{}", self.summary_text());
        text
    }

    /// The summary as lines of text.
    pub fn summary_text(&self) -> String {
        let mut text = format!("{} at fidelity {}\n", self.machine, self.fidelity);
        let sets = [
            ("all rows", &self.summary.all),
            ("high confidence", &self.summary.high),
            ("  of these fitted", &self.summary.high_fitted),
            ("  of these held out", &self.summary.high_held_out),
            ("must pass (!)", &self.summary.must_pass),
        ];
        for (name, errors) in sets {
            let _ = writeln!(
                text,
                "{name:20} {:3} rows, {:3} expressed, {:3} in range, mean error {:.1} %, worst {:.1} %",
                errors.rows,
                errors.expressed,
                errors.inside,
                errors.mean_error_percent,
                errors.worst_error_percent
            );
        }
        text
    }
}

impl Row {
    fn verdict(&self) -> &'static str {
        match (self.simulated, self.ok) {
            (None, _) => "-",
            (Some(_), true) => "ok",
            (Some(_), false) => "MISS",
        }
    }
}

/// A figure in four digits.
fn figure(value: f64) -> String {
    let digits = if value == 0.0 { 0 } else { 3 - value.abs().log10().floor().clamp(-3.0, 3.0) as i32 };
    let text = format!("{value:.*}", digits.max(0) as usize);
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}
