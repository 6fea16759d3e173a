//! y = a xᵇ: the exponent, with its confidence interval.

use super::fit::{Line, line};
use super::{Data, Finding, named};
use crate::metric::title;
use crate::plot::{Axis, Lines, Look, Plot, Series};
use crate::sheet::{Cell, Sheet};
use crate::study::Analysis;

pub(super) fn power_law(data: &Data, analysis: &Analysis) -> Finding {
    let (x, y) = (data.x(analysis), data.y(analysis));
    let groups = data.groups(&x);
    let columns = ["part", "exponent", "95 % low", "95 % high", "factor", "points"];
    let mut sheet = Sheet { columns: columns.map(str::to_owned).to_vec(), rows: Vec::new() };
    let mut series = Vec::new();
    let mut left_out = 0;
    for (group, rows) in &groups {
        for (index, path) in data.parts(&y, groups.len()).iter().enumerate() {
            let all = data.points(rows, &x, path);
            let points: Vec<(f64, f64)> = all.iter().copied().filter(|p| p.0 > 0.0 && p.1 > 0.0).collect();
            left_out += all.len() - points.len();
            let logs: Vec<(f64, f64)> = points.iter().map(|(x, y)| (x.ln(), y.ln())).collect();
            let Some(fit) = line(&logs) else { continue };
            let label = title(path);
            let name = named(label.strip_suffix(", ms").unwrap_or(&label), group);
            sheet.rows.push(row(&name, &fit, points.len()));
            if index == 0 {
                let ends = [points[0].0, points[points.len() - 1].0];
                let fitted = ends.map(|x| (x, (fit.intercept + fit.slope * x.ln()).exp()));
                let exponent = format!("x^{:.2}", fit.slope);
                series.push(Series { name, look: Look::Dots, points });
                series.push(Series { name: exponent, look: Look::Fit, points: fitted.to_vec() });
            }
        }
    }
    let mut notes = vec![
        "Fitted to the logarithms by least squares; the interval is Student's, and says how well one exponent describes all points.".to_owned(),
    ];
    if left_out > 0 {
        notes.push(format!("{left_out} values of 0 or less have no logarithm and are left out."));
    }
    if sheet.rows.is_empty() {
        notes = vec![data.why_nothing(&x, &y)];
    }
    let plot = Lines {
        title: format!("{} as a power of {}", title(&y), title(&x)),
        x: Axis::new(title(&x), true),
        y: Axis::new(title(&y), true),
        series,
    };
    Finding {
        name: "power_law".to_owned(),
        title: format!("{} as a power of {x}", title(&y)),
        notes,
        plot: (!sheet.rows.is_empty()).then_some(Plot::Lines(plot)),
        sheet,
    }
}

fn row(name: &str, fit: &Line, points: usize) -> Vec<Cell> {
    let end = |sign: f64| Cell::maybe(fit.slope_half_interval.map(|half| fit.slope + sign * half));
    let number = |value: f64| Cell::Number(value);
    vec![
        Cell::Text(name.to_owned()),
        number(fit.slope),
        end(-1.0),
        end(1.0),
        number(fit.intercept.exp()),
        number(points as f64),
    ]
}
