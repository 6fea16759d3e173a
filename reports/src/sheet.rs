//! Tables as data, and as Markdown, CSV and terminal text.

use std::fmt::Write as _;

use serde_json::Value;

/// A table: every row has a cell for every column.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Sheet {
    /// Titles of the columns, unit included.
    pub columns: Vec<String>,
    /// Cells of the table, row by row.
    pub rows: Vec<Vec<Cell>>,
}

/// One cell of a table.
#[derive(Debug, Clone, PartialEq)]
pub enum Cell {
    /// The cell holds words.
    Text(String),
    /// The cell holds a number; tables for people show four digits of it, CSV all.
    Number(f64),
    /// The cell holds a number that somebody chose: it is shown as it was chosen, without zeros at its end.
    Chosen(f64),
    /// The cell is empty: nothing was measured.
    Missing,
}

impl Cell {
    /// The cell of a number that may be missing.
    pub fn maybe(number: Option<f64>) -> Cell {
        number.map_or(Cell::Missing, Cell::Number)
    }

    /// The cell of a value of an axis.
    pub fn value(value: &Value) -> Cell {
        value.as_f64().map_or_else(|| Cell::Text(show_value(value)), Cell::Number)
    }

    /// The cell as people read it.
    pub fn shown(&self) -> String {
        match self {
            Cell::Text(text) => text.clone(),
            Cell::Number(number) => short(*number),
            Cell::Chosen(number) => round(*number),
            Cell::Missing => "-".to_owned(),
        }
    }

    fn exact(&self) -> String {
        match self {
            Cell::Text(text) => text.clone(),
            Cell::Number(number) | Cell::Chosen(number) => number.to_string(),
            Cell::Missing => String::new(),
        }
    }

    fn is_text(&self) -> bool {
        matches!(self, Cell::Text(_))
    }
}

/// A JSON value as people read it: strings without quotes.
pub fn show_value(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        other => other.to_string(),
    }
}

/// A change with its sign; one that is rounded to nothing has none.
pub fn signed(change: f64, decimals: usize) -> String {
    let text = format!("{change:+.decimals$}");
    if text.trim_start_matches(['+', '-', '0', '.']).is_empty() { text[1..].to_owned() } else { text }
}

/// A number with four digits, or all of its digits when it is whole.
pub fn short(number: f64) -> String {
    if number == number.trunc() && number.abs() < 1e15 {
        // There is no minus before 0.
        return format!("{}", number + 0.0);
    }
    let magnitude = number.abs();
    if !(1e-4..1e7).contains(&magnitude) {
        return format!("{number:.3e}");
    }
    let decimals = (0..=7).find(|d| magnitude * 10_f64.powi(*d) >= 999.95).unwrap_or(7);
    format!("{number:.*}", decimals as usize)
}

/// A number that somebody chose, with all of its digits; with an exponent where it is far from 1 and that is shorter.
pub fn round(number: f64) -> String {
    let (plain, power) = ((number + 0.0).to_string(), format!("{number:e}"));
    let far = number != 0.0 && !(1e-3..1e5).contains(&number.abs());
    if far && power.len() < plain.len() { power } else { plain }
}

impl Sheet {
    /// The table in Markdown.
    pub fn markdown(&self) -> String {
        let mut text = String::new();
        let escape = |cell: &str| cell.replace('|', "\\|").replace('\n', " ");
        let titles: Vec<String> = self.columns.iter().map(|title| escape(title)).collect();
        let _ = writeln!(text, "| {} |", titles.join(" | "));
        let rules: Vec<&str> =
            (0..self.columns.len()).map(|column| if self.is_text(column) { "---" } else { "---:" }).collect();
        let _ = writeln!(text, "|{}|", rules.join("|"));
        for row in &self.rows {
            let cells: Vec<String> = row.iter().map(|cell| escape(&cell.shown())).collect();
            let _ = writeln!(text, "| {} |", cells.join(" | "));
        }
        text
    }

    /// The table as comma-separated values with every digit (RFC 4180, line feeds alone).
    pub fn csv(&self) -> String {
        let quote = |cell: String| {
            let special = cell.contains([',', '"', '\n', '\r']);
            if special { format!("\"{}\"", cell.replace('"', "\"\"")) } else { cell }
        };
        let mut text = String::new();
        let titles: Vec<String> = self.columns.iter().cloned().map(quote).collect();
        let _ = writeln!(text, "{}", titles.join(","));
        for row in &self.rows {
            let cells: Vec<String> = row.iter().map(|cell| quote(cell.exact())).collect();
            let _ = writeln!(text, "{}", cells.join(","));
        }
        text
    }

    /// The table as aligned text.
    pub fn terminal(&self) -> String {
        let mut lines: Vec<Vec<String>> = vec![self.columns.clone()];
        lines.extend(self.rows.iter().map(|row| row.iter().map(Cell::shown).collect()));
        let width = |column: usize| lines.iter().map(|line| line[column].chars().count()).max().unwrap_or(0);
        let widths: Vec<usize> = (0..self.columns.len()).map(width).collect();
        let mut text = String::new();
        for (index, line) in lines.iter().enumerate() {
            let mut out = String::new();
            for (column, cell) in line.iter().enumerate() {
                let pad = " ".repeat(widths[column] - cell.chars().count());
                let gap = if column == 0 { "" } else { "  " };
                let _ = if self.is_text(column) {
                    write!(out, "{gap}{cell}{pad}")
                } else {
                    write!(out, "{gap}{pad}{cell}")
                };
            }
            let _ = writeln!(text, "{}", out.trim_end());
            if index == 0 {
                let all = widths.iter().sum::<usize>() + 2 * widths.len().saturating_sub(1);
                let _ = writeln!(text, "{}", "-".repeat(all));
            }
        }
        text
    }

    /// Whether a column holds words.
    fn is_text(&self, column: usize) -> bool {
        self.rows.iter().any(|row| row[column].is_text())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sheet() -> Sheet {
        Sheet {
            columns: vec!["name".to_owned(), "ms".to_owned()],
            rows: vec![
                vec![Cell::Text("a|b, \"c\"".to_owned()), Cell::Number(1.0 / 3.0)],
                vec![Cell::Text("d".to_owned()), Cell::Missing],
            ],
        }
    }

    #[test]
    fn markdown_keeps_its_columns() {
        assert_eq!(sheet().markdown(), "| name | ms |\n|---|---:|\n| a\\|b, \"c\" | 0.3333 |\n| d | - |\n");
    }

    #[test]
    fn csv_has_every_digit_and_quotes_what_needs_it() {
        assert_eq!(sheet().csv(), "name,ms\n\"a|b, \"\"c\"\"\",0.3333333333333333\nd,\n");
    }

    #[test]
    fn terminal_text_is_aligned() {
        let lines = ["name          ms", "----------------", "a|b, \"c\"  0.3333", "d              -"];
        assert_eq!(sheet().terminal().lines().collect::<Vec<_>>(), lines);
    }

    #[test]
    fn numbers_have_four_digits() {
        let shown: Vec<String> =
            [0.0, -0.0, 24.0, 262_144.0, 13.24567, 0.012345, 1234.56, 1.0e-9, 99.999].map(short).to_vec();
        assert_eq!(shown, ["0", "0", "24", "262144", "13.25", "0.01235", "1235", "1.000e-9", "100.0"]);
    }

    #[test]
    fn chosen_numbers_have_all_digits_and_no_rows_of_zeros() {
        let shown: Vec<String> =
            [0.0, -0.0, 24.0, 1e5, 200_002.0, 1e39, 0.5, 1.000_001, 1e-3, 1e-4, -1.5e-36].map(round).to_vec();
        let right = ["0", "0", "24", "1e5", "200002", "1e39", "0.5", "1.000001", "0.001", "1e-4", "-1.5e-36"];
        assert_eq!(shown, right);
    }

    #[test]
    fn changes_have_signs_where_they_are_not_rounded_to_nothing() {
        let shown: Vec<String> =
            [0.04, -0.04, -0.05, 12.0, -0.0, f64::INFINITY].map(|n| signed(n, 1)).to_vec();
        assert_eq!(shown, ["0.0", "0.0", "-0.1", "+12.0", "0.0", "+inf"]);
    }
}
