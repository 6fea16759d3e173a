//! Plots of a validation.

use super::{Row, Validation};
use crate::plot::{Axis, Lines, Look, Plot, Series};

fn plot(title: &str, x: &str, y: &str, series: Vec<Series>) -> Plot {
    let axis = |label: &str| Axis::new(label, true);
    Plot::Lines(Lines { title: title.to_owned(), x: axis(x), y: axis(y), series })
}

/// Published against simulated, a point a row.
pub fn scatter_plot(validation: &Validation) -> Plot {
    let series = |name: &str, wanted: &dyn Fn(&Row) -> bool| {
        let rows = validation.rows.iter().filter(|row| wanted(row));
        let points = rows
            .filter_map(|row| Some((row.published, row.simulated?)))
            .filter(|(published, simulated)| *published > 0.0 && *simulated > 0.0)
            .collect();
        Series { name: name.to_owned(), look: Look::Dots, points }
    };
    let high = |row: &Row| row.confidence == "high";
    let mut all = vec![
        series("high, fitted", &|row| high(row) && !row.held_out),
        series("high, held out", &|row| high(row) && row.held_out),
        series("medium and low", &|row| !high(row)),
    ];
    let values = || all.iter().flat_map(|series| &series.points).map(|point| point.0);
    let (low, top) = (values().fold(f64::MAX, f64::min), values().fold(0.0, f64::max));
    if low < top {
        let points = vec![(low, low), (top, top)];
        all.push(Series { name: "equal".to_owned(), look: Look::Dashed, points });
    }
    let title = format!("{}: published and simulated, each row in its unit", validation.machine);
    plot(&title, "published", "simulated", all)
}

/// Published and simulated values of the rows whose ids are one of `families` and a number.
fn curves(validation: &Validation, families: &[&str], number: impl Fn(&str) -> Option<f64>) -> Vec<Series> {
    let mut all = Vec::new();
    for family in families {
        let rows: Vec<(f64, &Row)> = validation
            .rows
            .iter()
            .filter_map(|row| Some((number(row.id.strip_prefix(family)?.strip_prefix('.')?)?, row)))
            .collect();
        let published = rows.iter().map(|(x, row)| (*x, row.published)).collect();
        let simulated = rows.iter().filter_map(|(x, row)| Some((*x, row.simulated?))).collect();
        all.push(Series { name: format!("{family}, published"), look: Look::Dashed, points: published });
        all.push(Series { name: format!("{family}, simulated"), look: Look::Line, points: simulated });
    }
    all.retain(|series| !series.points.is_empty());
    all
}

/// Bandwidth of the memory against threads.
pub fn bandwidth_plot(validation: &Validation) -> Plot {
    let families = ["bw.mem.read", "bw.mem.read_hwp", "bw.mem.read_nopf", "bw.mem.write", "bw.mem.write_ss"];
    let threads = |text: &str| text.strip_prefix('t')?.parse().ok();
    plot("Bandwidth of the memory", "threads", "GB/s", curves(validation, &families, threads))
}

/// Latency against the size of the array.
pub fn latency_plot(validation: &Validation) -> Plot {
    let kibibytes = |text: &str| match text.strip_suffix('k') {
        Some(digits) => digits.parse().ok(),
        None => text.strip_suffix('m')?.parse::<f64>().ok().map(|mebibytes| mebibytes * 1024.0),
    };
    plot("Latency of dependent loads", "KB", "ns", curves(validation, &["lat.size"], kibibytes))
}
