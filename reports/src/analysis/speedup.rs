//! How many times as fast as with the least x, and how much of what was to be had.

use super::{Data, Finding, named};
use crate::metric::title;
use crate::plot::{Axis, Lines, Look, Plot, Series};
use crate::sheet::{Cell, Sheet};
use crate::study::Analysis;

pub(super) fn speedup(data: &Data, analysis: &Analysis) -> Finding {
    let (x, y) = (data.x(analysis), data.y(analysis));
    let groups = data.groups(&x);
    let paths = data.with_phases(&y);
    let mut columns = vec!["part".to_owned(), x.clone()];
    columns.extend([title(&y), "speedup".to_owned(), "efficiency".to_owned()]);
    let mut sheet = Sheet { columns, rows: Vec::new() };
    let mut series = Vec::new();
    let mut ends = (f64::INFINITY, f64::NEG_INFINITY);
    for (group, rows) in &groups {
        for (index, path) in paths.iter().enumerate() {
            let points = data.points(rows, &x, path);
            let Some(&(first_x, first_y)) = points.first() else { continue };
            let label = title(path);
            let name = named(label.strip_suffix(", ms").unwrap_or(&label), group);
            let mut line = Vec::new();
            for (at, value) in points.into_iter().filter(|point| point.1 > 0.0) {
                let speedup = first_y / value;
                let efficiency = speedup * first_x / at;
                let mut row = vec![Cell::Text(name.clone()), Cell::Number(at), Cell::Number(value)];
                row.extend([speedup, efficiency].map(Cell::Number));
                sheet.rows.push(row);
                line.push((at, speedup));
                ends = (ends.0.min(at), ends.1.max(at));
            }
            if index == 0 || groups.len() == 1 {
                series.push(Series { name, look: Look::Line, points: line });
            }
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
