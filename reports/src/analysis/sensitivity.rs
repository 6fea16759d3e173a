//! What each axis does to the metric when all others stay: the greatest effect first.

use super::fit::line;
use super::{Data, Finding, Row};
use crate::metric::title;
use crate::plot::{Bar, Bars, Plot};
use crate::sheet::{Cell, Sheet, show_value};
use crate::study::Analysis;

/// The effect of one axis.
struct Effect {
    axis: String,
    /// Values with the least and the greatest metric.
    least: (String, f64),
    greatest: (String, f64),
    /// Percent that the metric changes by when it goes up by one percent; `None` for names.
    elasticity: Option<f64>,
}

pub(super) fn sensitivity(data: &Data, analysis: &Analysis) -> Finding {
    let y = data.y(analysis);
    let mut effects: Vec<Effect> = data.axes.iter().filter_map(|axis| effect(data, axis, &y)).collect();
    // Equal effects stay in the order of the axes.
    effects.sort_by(|a, b| (b.greatest.1 - b.least.1).total_cmp(&(a.greatest.1 - a.least.1)));

    let columns =
        ["axis", "least at", "change, %", "greatest at", "change, %", "elasticity"].map(str::to_owned);
    let rows = effects.iter().map(|effect| {
        vec![
            Cell::Text(effect.axis.clone()),
            Cell::Text(effect.least.0.clone()),
            Cell::Number(effect.least.1),
            Cell::Text(effect.greatest.0.clone()),
            Cell::Number(effect.greatest.1),
            Cell::maybe(effect.elasticity),
        ]
    });
    let sheet = Sheet { columns: columns.to_vec(), rows: rows.collect() };
    let bar =
        |effect: &Effect| Bar { name: effect.axis.clone(), from: effect.least.1, to: effect.greatest.1 };
    let bars = Bars {
        title: format!("what each axis does to {}", title(&y)),
        label: "change from the first value, %".to_owned(),
        bars: effects.iter().map(bar).collect(),
    };
    let note = match effects.is_empty() {
        true => format!("Nothing is shown: no two points that have {y} above 0 differ in one axis alone."),
        false => "Change of the metric from that with the axis's first value, all other axes kept; the geometric mean over their values. Elasticity: percent of change for one percent more.".to_owned(),
    };
    Finding {
        name: "sensitivity".to_owned(),
        title: format!("Sensitivity of {}", title(&y)),
        notes: vec![note],
        plot: (!effects.is_empty()).then_some(Plot::Bars(bars)),
        sheet,
    }
}

/// What `axis` does; `None` when no two points differ in it alone.
fn effect(data: &Data, axis: &str, y: &str) -> Option<Effect> {
    let index = data.axes.iter().position(|name| name == axis)?;
    // Logarithms of the metric relative to the first value, by value, over all groups.
    let mut changes: Vec<(&Row, Vec<f64>)> = Vec::new();
    let mut slopes = Vec::new();
    for (_, rows) in data.groups(axis) {
        let first = rows.first().and_then(|row| data.number(row, y)).filter(|value| *value > 0.0);
        let Some(first) = first.filter(|_| rows.len() > 1) else { continue };
        for row in &rows {
            let Some(value) = data.number(row, y).filter(|value| *value > 0.0) else { continue };
            let change = (value / first).ln();
            match changes.iter_mut().find(|(other, _)| other.values[index] == row.values[index]) {
                Some((_, list)) => list.push(change),
                None => changes.push((row, vec![change])),
            }
        }
        let points = data.points(&rows, axis, y);
        let logs: Vec<_> =
            points.iter().filter(|p| p.0 > 0.0 && p.1 > 0.0).map(|(x, y)| (x.ln(), y.ln())).collect();
        slopes.extend(line(&logs).map(|line| line.slope));
    }
    let mean = |list: &[f64]| list.iter().sum::<f64>() / list.len() as f64;
    let means: Vec<(String, f64)> = changes
        .iter()
        .map(|(row, list)| (show_value(&row.values[index]), (mean(list).exp() - 1.0) * 100.0))
        .collect();
    Some(Effect {
        axis: axis.to_owned(),
        least: means.iter().min_by(|a, b| a.1.total_cmp(&b.1))?.clone(),
        greatest: means.iter().max_by(|a, b| a.1.total_cmp(&b.1))?.clone(),
        elasticity: (!slopes.is_empty()).then(|| mean(&slopes)),
    })
}
