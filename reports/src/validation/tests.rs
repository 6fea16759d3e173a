use super::*;
use crate::plot::Plot;

fn row(id: &str, published: f64, simulated: Option<f64>, confidence: &str) -> Row {
    let (low, high) = (published * 0.9, published * 1.1);
    Row {
        id: id.to_owned(),
        unit: "ns".to_owned(),
        published,
        low,
        high,
        simulated,
        error_percent: simulated.map(|simulated| (simulated / published - 1.0) * 100.0),
        ok: simulated.is_some_and(|simulated| (low..=high).contains(&simulated)),
        must_pass: id == "lat.size.1m",
        confidence: confidence.to_owned(),
        held_out: id == "bw.mem.read.t002",
        note: String::new(),
    }
}

fn validation() -> Validation {
    let rows = vec![
        row("lat.size.1m", 100.0, Some(120.0), "high"),
        row("bw.mem.read.t001", 5.0, Some(5.0), "high"),
        row("bw.mem.read.t002", 10.0, Some(9.5), "high"),
        row("barrier.omp.t001", 1.0, None, "low"),
    ];
    Validation::new("knc-5110p".to_owned(), "windowed".to_owned(), rows)
}

#[test]
fn rows_that_are_not_expressed_count_but_have_no_error() {
    let summary = validation().summary;
    assert_eq!((summary.all.rows, summary.all.expressed, summary.all.inside), (4, 3, 2));
    assert!((summary.all.mean_error_percent - 25.0 / 3.0).abs() < 1e-9);
    assert!((summary.high_held_out.mean_error_percent - 5.0).abs() < 1e-9);
    assert_eq!(summary.high_fitted.rows, 2);
}

#[test]
fn a_row_that_must_pass_and_misses_is_a_failure() {
    let validation = validation();
    assert_eq!(validation.failures().map(|row| row.id.as_str()).collect::<Vec<_>>(), ["lat.size.1m"]);
    assert!(validation.table().contains("MISS"));
}

#[test]
fn the_page_lists_what_was_fitted_and_what_is_missing() {
    let sources = [
        ("l2.mshrs".to_owned(), "derived: fitted to bw.mem.read.t001".to_owned()),
        ("cores".to_owned(), "published: vendor data".to_owned()),
    ];
    let page = validation().markdown(&sources.into());
    assert!(page.contains("| `l2.mshrs` | bw.mem.read.t001 |") && !page.contains("| `cores` |"));
    assert!(page.contains("| `barrier.omp.t001` |"));
}

#[test]
fn plots_have_a_point_for_every_row() {
    let validation = validation();
    let points = |plot: Plot| match plot {
        Plot::Lines(lines) => lines.series.iter().map(|series| series.points.len()).collect::<Vec<_>>(),
        Plot::Bars(_) => Vec::new(),
    };
    assert_eq!(
        points(scatter_plot(&validation)),
        [2, 1, 0, 2],
        "fitted, held out, others, the line of equals"
    );
    assert_eq!(points(bandwidth_plot(&validation)), [2, 2]);
    assert_eq!(points(latency_plot(&validation)), [1, 1]);
}

#[test]
fn figures_have_four_digits() {
    let shown = [0.0, 0.2482, 24.11, 287.5, 1010.88, 4.0].map(figure);
    assert_eq!(shown, ["0", "0.2482", "24.11", "287.5", "1011", "4"]);
}
