//! How many times as fast as with the least x of all series, and how much of what was to be had.

use super::{Data, Finding, Row, named};
use crate::metric::title;
use crate::plot::{Axis, Lines, Look, Plot, Series};
use crate::sheet::{Cell, Sheet, short};
use crate::study::Analysis;

/// Series that are named where they are left out, at most.
const NAMES_MAX: usize = 6;

pub(super) fn speedup(data: &Data, analysis: &Analysis) -> Finding {
    let (x, y) = (data.x(analysis), data.y(analysis));
    let groups = data.groups(&x);
    let paths = data.parts(&y, groups.len());
    let mut columns = vec![x.clone(), title(&y), "speedup".to_owned(), "efficiency".to_owned()];
    columns.extend(paths[1..].iter().map(|path| format!("{} speedup", without_unit(path))));
    if groups.len() > 1 {
        columns.insert(0, "of".to_owned());
    }
    let mut sheet = Sheet { columns, rows: Vec::new() };
    let mut series = Vec::new();
    let mut ends = (f64::INFINITY, f64::NEG_INFINITY);
    // One baseline for all series: of one that does not begin there, nobody knows how fast it would be.
    let of_y: Vec<Vec<(f64, f64)>> = groups.iter().map(|(_, rows)| measured(data, rows, &x, &y)).collect();
    let baseline = of_y.iter().flatten().map(|point| point.0).fold(f64::INFINITY, f64::min);
    let mut left_out = Vec::new();
    for ((group, rows), of_y) in groups.iter().zip(of_y) {
        let lines: Vec<Vec<(f64, f64)>> =
            paths.iter().map(|path| relative(&measured(data, rows, &x, path), baseline)).collect();
        if lines[0].is_empty() {
            left_out.push(group.as_str());
            continue;
        }
        for (&(at, value), &(_, speedup)) in of_y.iter().zip(&lines[0]) {
            let mut row = [at, value, speedup, speedup * baseline / at].map(Cell::Number).to_vec();
            let there = |line: &Vec<(f64, f64)>| line.iter().find(|point| point.0 == at).map(|point| point.1);
            row.extend(lines[1..].iter().map(|line| Cell::maybe(there(line))));
            if groups.len() > 1 {
                row.insert(0, Cell::Text(group.clone()));
            }
            sheet.rows.push(row);
            ends = (ends.0.min(at), ends.1.max(at));
        }
        for (path, points) in paths.iter().zip(lines) {
            series.push(Series { name: named(&without_unit(path), group), look: Look::Line, points });
        }
    }
    if ends.0 < ends.1 {
        let points = vec![(ends.0, 1.0), (ends.1, ends.1 / ends.0)];
        series.push(Series { name: "ideal".to_owned(), look: Look::Dashed, points });
    }
    let mut notes = vec![format!(
        "Speedup: {} with the least {x}, divided by the same here. Efficiency: speedup divided by how many times as great {x} is; 1 is ideal.",
        title(&y)
    )];
    if sheet.rows.is_empty() {
        notes = vec![data.why_nothing(&x, &y)];
    } else if !left_out.is_empty() {
        notes.push(format!(
            "Left out, having no {} at {x} {}, which all speedups are relative to: {}.",
            without_unit(&y),
            short(baseline),
            listed(&left_out)
        ));
    }
    let plot = Lines {
        title: format!("speedup over {}", title(&x)),
        x: Axis::new(title(&x), true),
        y: Axis::new("times as fast as the first", true),
        series,
    };
    Finding {
        name: "speedup".to_owned(),
        title: format!("Speedup over {x}"),
        notes,
        plot: (!sheet.rows.is_empty()).then_some(Plot::Lines(plot)),
        sheet,
    }
}

/// Points of one group by rising x; where nothing was measured, 0 would be no time.
fn measured(data: &Data, rows: &[&Row], x: &str, y: &str) -> Vec<(f64, f64)> {
    let mut points = data.points(rows, x, y);
    points.retain(|point| point.1 > 0.0);
    points
}

/// Speedups over the point at `baseline`; none without it.
fn relative(points: &[(f64, f64)], baseline: f64) -> Vec<(f64, f64)> {
    let first = points.iter().find(|point| point.0 == baseline);
    first.map_or_else(Vec::new, |(_, first)| points.iter().map(|(x, y)| (*x, first / y)).collect())
}

/// Names in a sentence, of many only the first.
fn listed(names: &[&str]) -> String {
    let shown = names[..names.len().min(NAMES_MAX)].join("; ");
    match names.len().saturating_sub(NAMES_MAX) {
        0 => shown,
        more => format!("{shown}; and {more} more"),
    }
}

fn without_unit(path: &str) -> String {
    let title = title(path);
    title.strip_suffix(", ms").unwrap_or(&title).to_owned()
}
