//! How many times as fast as with the least x, and how much of what was to be had.

use super::{Data, Finding, named};
use crate::metric::title;
use crate::plot::{Axis, Lines, Look, Plot, Series};
use crate::sheet::{Cell, Sheet};
use crate::study::Analysis;

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
    for (group, rows) in &groups {
        let lines: Vec<Vec<(f64, f64)>> =
            paths.iter().map(|path| relative(&data.points(rows, &x, path))).collect();
        let Some(&(first_x, _)) = lines[0].first() else { continue };
        for (&(at, value), &(_, speedup)) in
            data.points(rows, &x, &y).iter().filter(|point| point.1 > 0.0).zip(&lines[0])
        {
            let mut row = [at, value, speedup, speedup * first_x / at].map(Cell::Number).to_vec();
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
    let plot = Lines {
        title: format!("speedup over {}", title(&x)),
        x: Axis { label: title(&x), log: true },
        y: Axis { label: "times as fast as the first".to_owned(), log: true },
        series,
    };
    Finding {
        name: "speedup".to_owned(),
        title: format!("Speedup over {x}"),
        notes: vec![format!(
            "Speedup: {} with the least {x}, divided by the same here. Efficiency: speedup divided by how many times as great {x} is; 1 is ideal.",
            title(&y)
        )],
        plot: (!sheet.rows.is_empty()).then_some(Plot::Lines(plot)),
        sheet,
    }
}

/// Speedups over the first of `points`; where nothing was measured, 0 would be no time.
fn relative(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let first = points.first().map_or(0.0, |point| point.1);
    points.iter().filter(|point| point.1 > 0.0).map(|(x, y)| (*x, first / y)).collect()
}

fn without_unit(path: &str) -> String {
    let title = title(path);
    title.strip_suffix(", ms").unwrap_or(&title).to_owned()
}
