//! Every point with its numbers, and the metric over the first axis.

use super::{Data, Finding, named};
use crate::digest::Digest;
use crate::metric::title;
use crate::plot::{Axis, Bar, Bars, Lines, Look, Plot, Series};
use crate::sheet::{Cell, Sheet, show_value};
use crate::study::Analysis;
use crate::table::counted;

/// Lines that a plot still shows apart.
const LINES_MAX: usize = 9;

pub(super) fn table(digest: &Digest, data: &Data, analysis: &Analysis) -> Finding {
    let study = &digest.study;
    let y = data.y(analysis);
    let mut paths = data.with_phases(&y);
    paths.extend(study.study.columns.iter().filter(|path| **path != y).cloned());

    // Failed points too: their row says why.
    let failed = study.points.iter().any(|point| point.error.is_some());
    // Of the number that is asked for and of columns, not of each phase: a table is as wide as it can be read.
    let is_extrapolated = |path: &String| {
        let any = || data.rows.iter().any(|row| row.numbers.half_interval(path).is_some());
        (*path == y || study.study.columns.contains(path)) && any()
    };
    let paths: Vec<(String, bool)> =
        paths.into_iter().map(|path| (path.clone(), is_extrapolated(&path))).collect();
    let mut columns = data.axes.clone();
    for (path, is_extrapolated) in &paths {
        columns.push(title(path));
        if *is_extrapolated {
            columns.push(format!("\u{b1} {}", title(path)));
        }
    }
    if failed {
        columns.push("error".to_owned());
    }
    let mut rows = Vec::new();
    for (point, numbers) in study.points.iter().zip(&digest.numbers) {
        let mut row: Vec<Cell> = point.values.iter().map(Cell::value).collect();
        for (path, is_extrapolated) in &paths {
            row.push(Cell::maybe(numbers.as_ref().and_then(|numbers| numbers.get(path))));
            if *is_extrapolated {
                row.push(Cell::maybe(numbers.as_ref().and_then(|numbers| numbers.half_interval(path))));
            }
        }
        if failed {
            row.push(Cell::Text(point.error.clone().unwrap_or_default()));
        }
        rows.push(row);
    }
    let mut notes = match study.points.iter().filter(|point| point.error.is_some()).count() {
        0 => Vec::new(),
        n => {
            let all = counted(study.points.len() as u64, "point");
            vec![format!("{n} of {all} without a result; the last column says why.")]
        }
    };
    if paths.iter().any(|(_, is_extrapolated)| *is_extrapolated) {
        notes.push(
            "\u{b1}: half of the interval in which `windowed` has the number, with 95 % confidence."
                .to_owned(),
        );
    }
    notes.extend(digest.warnings());
    let sheet = Sheet { columns, rows };
    Finding {
        name: "table".to_owned(),
        title: "All points".to_owned(),
        notes,
        sheet,
        plot: plot(data, analysis, &y),
    }
}

fn plot(data: &Data, analysis: &Analysis, y: &str) -> Option<Plot> {
    let x = data.x(analysis);
    let mut groups = data.groups(&x);
    if groups.iter().any(|(_, rows)| rows.len() > 1) {
        // Beside lines, points of axes other than this one say nothing.
        groups.retain(|(_, rows)| rows.len() > 1);
    }
    let mut series = Vec::new();
    for path in &data.parts(y, groups.len()) {
        for (group, rows) in groups.iter().take(LINES_MAX) {
            let points = data.points(rows, &x, path);
            let what = title(path);
            let what = what.strip_suffix(", ms").unwrap_or(&what);
            series.push(Series { name: named(what, group), look: Look::Line, points });
        }
    }
    series.retain(|line| !line.points.is_empty());
    if series.is_empty() {
        // Values that are names: a bar each.
        let bars: Vec<Bar> = data
            .rows
            .iter()
            .filter_map(|row| {
                let names: Vec<String> = row.values.iter().map(show_value).collect();
                Some(Bar { name: names.join(", "), from: 0.0, to: row.numbers.get(y)? })
            })
            .collect();
        return (!bars.is_empty()).then(|| Plot::Bars(Bars { title: title(y), label: title(y), bars }));
    }
    let log = spans_decades(&series);
    Some(Plot::Lines(Lines {
        title: format!("{} over {}", title(y).trim_end_matches(", ms"), title(&x)),
        x: Axis::new(title(&x), log.0),
        y: Axis::new(title(y).rsplit(", ").next().unwrap_or_default().to_owned(), log.1),
        series,
    }))
}

/// Whether x and y are better seen in logarithms: they span more than a factor of 12.
fn spans_decades(series: &[Series]) -> (bool, bool) {
    let spans = |values: Vec<f64>| {
        let low = values.iter().copied().fold(f64::INFINITY, f64::min);
        let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        low > 0.0 && high / low > 12.0
    };
    let all = || series.iter().flat_map(|line| &line.points);
    (spans(all().map(|point| point.0).collect()), spans(all().map(|point| point.1).collect()))
}
