//! `validation.md`.

use super::{Row, Validation, figure};
use crate::sheet::signed;
use std::collections::BTreeMap;
use std::fmt::Write;

/// How sources of fitted parameters begin.
const FITTED: &str = "derived: fitted to ";

impl Validation {
    /// The page: summary, plots, fitted parameters, rows that miss, rows that are not expressed, all rows. `sources`
    /// are those of the machine.
    pub fn markdown(&self, sources: &BTreeMap<String, String>) -> String {
        let mut text = format!(
            "# Validation\n\nMicrobenchmarks on `{}` at fidelity `{}` against published measurements. Written by \
             `lrbsim validate -o docs`; do not edit. What papers on shadow methods found stands in `docs/methods.md`.\n\n",
            self.machine, self.fidelity
        );
        text.push_str(
            "| Rows | All | Expressed | In range | Mean error | Worst error |\n|---|---|---|---|---|---|\n",
        );
        let s = &self.summary;
        for (name, e) in [
            ("all", s.all),
            ("high confidence", s.high),
            ("of these fitted", s.high_fitted),
            ("of these held out", s.high_held_out),
            ("must pass", s.must_pass),
        ] {
            let _ = writeln!(
                text,
                "| {name} | {} | {} | {} | {:.1} % | {:.1} % |",
                e.rows, e.expressed, e.inside, e.mean_error_percent, e.worst_error_percent
            );
        }
        text.push_str(
            "\nHeld out: a fifth of all rows, chosen by a hash of the id; no parameter was chosen by them. Errors are relative \
             to the published value. `!`: must pass, `h`: held out.\n\n\
             ![published against simulated](validation-scatter.svg)\n\n\
             ![bandwidth against threads](validation-bandwidth.svg)\n\n\
             ![latency against size](validation-latency.svg)\n",
        );

        text.push_str("\n## Parameters that no source gives\n\nOne set serves all rows.\n\n| Parameter | Fitted to |\n|---|---|\n");
        for (path, source) in sources {
            if let Some(rows) = source.strip_prefix(FITTED) {
                let _ = writeln!(text, "| `{path}` | {rows} |");
            }
        }

        self.section(&mut text, "Rows out of their range", |row| row.simulated.is_some() && !row.ok);
        text.push_str("\n## Rows that are not expressed\n\n| Row | Why |\n|---|---|\n");
        for row in self.rows.iter().filter(|row| row.simulated.is_none()) {
            let _ = writeln!(text, "| `{}` | {} |", row.id, row.note);
        }
        self.section(&mut text, "All rows", |row| row.simulated.is_some());
        text
    }

    fn section(&self, text: &mut String, title: &str, wanted: impl Fn(&Row) -> bool) {
        let _ = write!(
            text,
            "\n## {title}\n\n| Row | | Unit | Published | Allowed | Simulated | Error | Confidence | Conditions |\n\
             |---|---|---|---|---|---|---|---|---|\n"
        );
        for row in self.rows.iter().filter(|row| wanted(row)) {
            let marks =
                format!("{}{}", if row.must_pass { "!" } else { "" }, if row.held_out { "h" } else { "" });
            let _ = writeln!(
                text,
                "| `{}` | {marks} | {} | {} | {} to {} | {} | {} | {} | {} |",
                row.id,
                row.unit,
                figure(row.published),
                figure(row.low),
                figure(row.high),
                row.simulated.map_or_else(String::new, figure),
                row.error_percent.map_or_else(String::new, |error| format!("{} %", signed(error, 1))),
                row.confidence,
                row.note,
            );
        }
    }
}
