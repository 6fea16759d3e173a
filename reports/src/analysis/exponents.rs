//! y = a xᵇ for each axis alone: which exponent the whole and each phase have in what.

use super::fit::line;
use super::{Data, Finding};
use crate::metric::title;
use crate::plot::{Axis, Lines, Look, Plot, Series};
use crate::sheet::{Cell, Sheet};
use crate::study::{Analysis, StudyAxis};

pub(super) fn exponents(data: &Data, axes: &[StudyAxis], analysis: &Analysis) -> Finding {
    let y = data.y(analysis);
    let columns =
        ["in", "from", "to", "of", "exponent", "95 % low", "95 % high", "of the last two", "points"];
    let mut sheet = Sheet { columns: columns.map(str::to_owned).to_vec(), rows: Vec::new() };
    let mut series = Vec::new();
    for axis in axes {
        let x = axis.measure.as_deref().unwrap_or(&axis.path);
        // Of one at a time, only the points beside the base differ in nothing but this axis.
        let groups = data.groups(&axis.path);
        let Some((_, rows)) = groups.iter().max_by_key(|(_, rows)| rows.len()) else { continue };
        for (index, path) in data.with_phases(&y).into_iter().enumerate() {
            let points: Vec<(f64, f64)> =
                data.points(rows, x, &path).into_iter().filter(|(x, y)| *x > 0.0 && *y > 0.0).collect();
            let logs: Vec<(f64, f64)> = points.iter().map(|(x, y)| (x.ln(), y.ln())).collect();
            let Some(mut fit) = line(&logs) else { continue };
            if points.iter().all(|(_, y)| *y == points[0].1) {
                // Exactly, and not to the last bit of a sum.
                (fit.slope, fit.slope_half_interval) = (0.0, fit.slope_half_interval.map(|_| 0.0));
            }
            if index == 0 {
                let (least, first) = points[0];
                let points = points.iter().map(|(x, y)| (x / least, y / first)).collect();
                series.push(Series { name: title(x), look: Look::Line, points });
            }
            let last = line(&logs[logs.len().saturating_sub(2)..]).map(|line| line.slope);
            let end = |sign: f64| Cell::maybe(fit.slope_half_interval.map(|half| fit.slope + sign * half));
            sheet.rows.push(vec![
                Cell::Text(title(x)),
                Cell::Number(points[0].0),
                Cell::Number(points[points.len() - 1].0),
                Cell::Text(title(&path)),
                Cell::Number(fit.slope),
                end(-1.0),
                end(1.0),
                Cell::maybe(last),
                Cell::Number(points.len() as f64),
            ]);
        }
    }
    let notes = if sheet.rows.is_empty() {
        vec![data.why_nothing(&data.x(analysis), &y)]
    } else {
        vec![
            "Fitted to the logarithms by least squares, with all other axes as in the base. The interval is Student's, and says how well one exponent describes all points: a part that does not grow makes it wide, and the exponent less. Where that is so, the exponent between the last two points is nearer to what it comes to in the end.".to_owned(),
        ]
    };
    let plot = Lines {
        title: format!("{}, times the first, over each", title(&y)),
        x: Axis::new("times the least", true),
        y: Axis::new("times the first", true),
        series,
    };
    Finding {
        name: "exponents".to_owned(),
        title: format!("Exponents of {}", title(&y)),
        notes,
        plot: (!sheet.rows.is_empty()).then_some(Plot::Lines(plot)),
        sheet,
    }
}
