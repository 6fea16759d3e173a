//! Plots of a validation, as SVG.

use super::{Row, Validation};
use std::fmt::Write;

const WIDTH: f64 = 720.0;
const HEIGHT: f64 = 480.0;
const MARGIN: f64 = 60.0;
const COLORS: [&str; 8] =
    ["#1b6ca8", "#c0392b", "#27875a", "#8e44ad", "#d38b00", "#2c3e50", "#16a0a0", "#a04000"];

/// Points in one color; drawn as a line, or apart.
struct Series {
    name: String,
    points: Vec<(f64, f64)>,
    line: bool,
    dashed: bool,
}

/// Logarithmic axes and what is in them.
fn plot(title: &str, x_title: &str, y_title: &str, series: &[Series]) -> String {
    let of = |pick: fn(&(f64, f64)) -> f64| {
        let values = || series.iter().flat_map(|series| series.points.iter().map(pick));
        let (low, high) = (values().fold(f64::MAX, f64::min), values().fold(0.0, f64::max));
        if low > high { (1.0, 10.0) } else { (low / 1.2, high * 1.2) }
    };
    let ((x_low, x_high), (y_low, y_high)) = (of(|point| point.0), of(|point| point.1));
    let x_at = |x: f64| MARGIN + (x / x_low).ln() / (x_high / x_low).ln() * (WIDTH - 2.0 * MARGIN);
    let y_at = |y: f64| HEIGHT - MARGIN - (y / y_low).ln() / (y_high / y_low).ln() * (HEIGHT - 2.0 * MARGIN);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" font-family=\"sans-serif\" \
         font-size=\"12\">\n<rect width=\"{WIDTH}\" height=\"{HEIGHT}\" fill=\"white\"/>\n\
         <text x=\"{MARGIN}\" y=\"24\" font-size=\"15\">{title}</text>\n"
    );
    let (left, right, top, bottom) = (MARGIN, WIDTH - MARGIN, MARGIN, HEIGHT - MARGIN);
    let _ = writeln!(
        svg,
        "<path d=\"M{left} {top}V{bottom}H{right}\" fill=\"none\" stroke=\"black\"/>\n\
         <text x=\"{right}\" y=\"{:.0}\" text-anchor=\"end\">{x_title}</text>\n\
         <text x=\"{left}\" y=\"{:.0}\">{y_title}</text>",
        bottom + 40.0,
        top - 10.0
    );
    // A mark a decade, and at 2 and 5.
    let marks = |low: f64, high: f64| {
        (-6..10)
            .flat_map(|decade| [1.0, 2.0, 5.0].map(|digit| digit * 10_f64.powi(decade)))
            .filter(move |value| (low..=high).contains(value))
    };
    for x in marks(x_low, x_high) {
        let _ = writeln!(
            svg,
            "<text x=\"{:.1}\" y=\"{:.0}\" text-anchor=\"middle\">{x}</text>",
            x_at(x),
            bottom + 18.0
        );
    }
    for y in marks(y_low, y_high) {
        let _ = writeln!(
            svg,
            "<text x=\"{:.0}\" y=\"{:.1}\" text-anchor=\"end\">{y}</text>",
            left - 6.0,
            y_at(y) + 4.0
        );
    }
    for (index, Series { name, points, line, dashed }) in series.iter().enumerate() {
        let color = COLORS[if *line { index / 2 } else { index } % COLORS.len()];
        if *line {
            let path: Vec<String> =
                points.iter().map(|(x, y)| format!("{:.1} {:.1}", x_at(*x), y_at(*y))).collect();
            let dash = if *dashed { " stroke-dasharray=\"5 4\"" } else { "" };
            let _ = writeln!(svg, "<path d=\"M{}\" fill=\"none\" stroke=\"{color}\"{dash}/>", path.join("L"));
        } else {
            for (x, y) in points {
                let _ = writeln!(
                    svg,
                    "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"3\" fill=\"{color}\" fill-opacity=\"0.6\"/>",
                    x_at(*x),
                    y_at(*y)
                );
            }
        }
        let _ = writeln!(
            svg,
            "<text x=\"{:.0}\" y=\"{:.0}\" fill=\"{color}\">{name}</text>",
            left + 12.0,
            top + 14.0 + 14.0 * index as f64
        );
    }
    svg.push_str("</svg>\n");
    svg
}

/// Published against simulated, a point a row.
pub fn scatter_plot(validation: &Validation) -> String {
    let points = |wanted: &dyn Fn(&Row) -> bool| {
        let rows = validation.rows.iter().filter(|row| wanted(row));
        rows.filter_map(|row| Some((row.published, row.simulated?)))
            .filter(|(published, simulated)| *published > 0.0 && *simulated > 0.0)
            .collect::<Vec<_>>()
    };
    let all = points(&|_| true);
    let (low, high) = all.iter().fold((f64::MAX, 0.0_f64), |(low, high), (x, _)| (low.min(*x), high.max(*x)));
    let equal =
        Series { name: "equal".to_owned(), points: vec![(low, low), (high, high)], line: true, dashed: true };
    let series = |name: &str, points| Series { name: name.to_owned(), points, line: false, dashed: false };
    let high_confidence = |row: &Row| row.confidence == "high";
    plot(
        &format!("{}: published against simulated, each row in its unit", validation.machine),
        "published",
        "simulated",
        &[
            equal,
            series("high confidence, fitted", points(&|row| high_confidence(row) && !row.held_out)),
            series("high confidence, held out", points(&|row| high_confidence(row) && row.held_out)),
            series("medium and low", points(&|row| !high_confidence(row))),
        ],
    )
}

/// Published and simulated values of the rows whose ids are `family` and a number.
fn curves(validation: &Validation, families: &[&str], number: impl Fn(&str) -> Option<f64>) -> Vec<Series> {
    let mut series = Vec::new();
    for family in families {
        let rows: Vec<(f64, &Row)> = validation
            .rows
            .iter()
            .filter_map(|row| Some((number(row.id.strip_prefix(family)?.strip_prefix('.')?)?, row)))
            .collect();
        let published = rows.iter().map(|(x, row)| (*x, row.published)).collect();
        let simulated = rows.iter().filter_map(|(x, row)| Some((*x, row.simulated?))).collect();
        let curve = |name, points, dashed| Series { name, points, line: true, dashed };
        series.push(curve(format!("{family}, published"), published, true));
        series.push(curve(format!("{family}, simulated"), simulated, false));
    }
    series.retain(|series| !series.points.is_empty());
    series
}

/// Bandwidth of the memory against threads.
pub fn bandwidth_plot(validation: &Validation) -> String {
    let families = [
        "bw.mem.read",
        "bw.mem.read_hwp",
        "bw.mem.read_nopf",
        "bw.mem.write",
        "bw.mem.write_ss",
        "stream.triad.untuned",
    ];
    let threads = |text: &str| text.strip_prefix('t')?.parse().ok();
    plot("Bandwidth of the memory", "threads", "GB/s", &curves(validation, &families, threads))
}

/// Latency against the size of the array, and under load against threads.
pub fn latency_plot(validation: &Validation) -> String {
    let kibibytes = |text: &str| match text.strip_suffix('k') {
        Some(digits) => digits.parse().ok(),
        None => text.strip_suffix('m')?.parse::<f64>().ok().map(|mebibytes| mebibytes * 1024.0),
    };
    plot("Latency of dependent loads", "KB", "ns", &curves(validation, &["lat.size"], kibibytes))
}
