//! The points that no other beats in both numbers; less is better.

use super::{Data, Finding};
use crate::metric::title;
use crate::plot::{Axis, Lines, Look, Plot, Series};
use crate::sheet::{Cell, Sheet};
use crate::study::Analysis;

pub(super) fn pareto(data: &Data, analysis: &Analysis) -> Finding {
    let (x, y) = (data.x(analysis), data.y(analysis));
    let known: Vec<_> = data
        .rows
        .iter()
        .filter_map(|row| Some((row, data.number(row, &x)?, data.number(row, &y)?)))
        .collect();
    let places: Vec<(f64, f64)> = known.iter().map(|(_, x, y)| (*x, *y)).collect();
    let front = front(&places);

    let mut columns = data.axes.clone();
    // An axis need not stand there twice.
    let extra: Vec<&String> = [&x, &y].into_iter().filter(|path| !data.axes.contains(path)).collect();
    columns.extend(extra.iter().map(|path| title(path)));
    columns.push("front".to_owned());
    let mut rows = Vec::new();
    for (index, (row, _, _)) in known.iter().enumerate() {
        let mut cells: Vec<Cell> = row.values.iter().map(Cell::value).collect();
        cells.extend(extra.iter().map(|path| Cell::maybe(data.number(row, path))));
        cells.push(Cell::Text(if front[index] { "yes" } else { "" }.to_owned()));
        rows.push(cells);
    }

    let mut line: Vec<(f64, f64)> =
        places.iter().zip(&front).filter(|(_, on)| **on).map(|(point, _)| *point).collect();
    line.sort_by(|a, b| a.0.total_cmp(&b.0));
    let behind = places.iter().zip(&front).filter(|(_, on)| !**on).map(|(point, _)| *point).collect();
    let plot = Lines {
        title: format!("{} against {}", title(&y), title(&x)),
        x: Axis::new(title(&x), true),
        y: Axis::new(title(&y), true),
        series: vec![
            Series { name: "front".to_owned(), look: Look::Line, points: line },
            Series { name: "beaten by others".to_owned(), look: Look::Dots, points: behind },
        ],
    };
    let note = match rows.is_empty() {
        true => data.why_nothing(&x, &y),
        false => "The front: no other point has less of one number and no more of the other.".to_owned(),
    };
    Finding {
        name: "pareto".to_owned(),
        title: format!("{} against {}", title(&y), title(&x)),
        notes: vec![note],
        plot: (!rows.is_empty()).then_some(Plot::Lines(plot)),
        sheet: Sheet { columns, rows },
    }
}

/// Which points no other beats.
fn front(points: &[(f64, f64)]) -> Vec<bool> {
    let beats = |a: &(f64, f64), b: &(f64, f64)| a.0 <= b.0 && a.1 <= b.1 && (a.0 < b.0 || a.1 < b.1);
    points.iter().map(|point| !points.iter().any(|other| beats(other, point))).collect()
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_front_is_what_nothing_beats() {
        let points = [(1.0, 9.0), (2.0, 5.0), (2.0, 6.0), (3.0, 5.0), (4.0, 1.0), (4.0, 1.0)];
        assert_eq!(super::front(&points), [true, true, false, false, true, true]);
    }
}
