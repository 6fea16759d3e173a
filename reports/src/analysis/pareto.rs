//! The points that no other beats in both numbers; less is better.

use super::{Data, Finding, Row, grouped};
use crate::metric::{BIAS, ERROR_PLACES, MEAN_ERROR, title};
use crate::plot::{Axis, Lines, Look, Plot, Series};
use crate::sheet::{Cell, Sheet, short, show_value};
use crate::study::Analysis;
use crate::table::counted;

pub(super) fn pareto(data: &Data, analysis: &Analysis) -> Finding {
    let (x, y) = (data.x(analysis), data.y(analysis));
    let each = analysis.each.as_ref().and_then(|each| data.axes.iter().position(|axis| axis == each));
    // What stands by itself: all points, or those of a value of the axis.
    let groups = grouped(data.rows.iter().filter_map(|row| {
        let place = (data.number(row, &x)?, data.number(row, &y)?);
        let name = each.map_or_else(String::new, |axis| show_value(&row.values[axis]));
        Some((name, Known { row, place }))
    }));

    let mut columns = data.axes.clone();
    // An axis need not stand there twice.
    let extra: Vec<&String> = [&x, &y].into_iter().filter(|path| !data.axes.contains(path)).collect();
    columns.extend(extra.iter().map(|path| title(path)));
    columns.push("front".to_owned());
    let (mut rows, mut series) = (Vec::new(), Vec::new());
    let mut rated: Vec<(String, Rated)> = Vec::new();
    for (name, known) in &groups {
        let front = front(&known.iter().map(|known| known.place).collect::<Vec<_>>());
        for (point, on) in known.iter().zip(&front) {
            let row = point.row;
            let others = row.values.iter().enumerate().filter(|(axis, _)| Some(*axis) != each);
            let rival = others.map(|(_, value)| show_value(value)).collect::<Vec<_>>().join(", ");
            rated.push((rival, Rated { point, on: *on, group: name }));
            let mut cells: Vec<Cell> = row.values.iter().map(Cell::value).collect();
            cells.extend(extra.iter().map(|path| Cell::maybe(data.number(row, path))));
            cells.push(Cell::Text(if *on { "yes" } else { "" }.to_owned()));
            rows.push(cells);
        }
        let places = |of: bool| -> Vec<(f64, f64)> {
            let known = known.iter().zip(&front).filter(|(_, on)| **on == of);
            known.map(|(known, _)| known.place).collect()
        };
        let mut line = places(true);
        line.sort_by(|a, b| a.0.total_cmp(&b.0));
        let of = |what: &str| if name.is_empty() { what.to_owned() } else { format!("{name}: {what}") };
        series.push(Series { name: of("front"), look: Look::Line, points: line });
        series.push(Series { name: of("beaten by others"), look: Look::Dots, points: places(false) });
    }
    let plot = Lines {
        title: format!("{} against {}", title(&y), title(&x)),
        x: Axis::new(title(&x), true),
        y: Axis::new(title(&y), true),
        series,
    };
    let note = match (rows.is_empty(), &analysis.each) {
        (true, _) => data.why_nothing(&x, &y),
        (_, Some(each)) => {
            format!(
                "The front: no other point of the same {each} has less of one number and no more of the other."
            )
        }
        (_, None) => "The front: no other point has less of one number and no more of the other.".to_owned(),
    };
    let mut notes = vec![note];
    let untold = data.rows.iter().filter(|row| {
        data.number(row, MEAN_ERROR).is_some() && data.number(row, ERROR_PLACES[0].0).is_none()
    });
    let untold = untold.count();
    if y == MEAN_ERROR && untold > 0 {
        notes.push(format!(
            "Where pictures are off is not told of {}: an older build has run them. Another `--cache` has them run again.",
            counted(untold as u64, "point")
        ));
    }
    let rivals = grouped(rated.into_iter());
    notes.extend(rivals.iter().filter_map(|(rival, points)| {
        let failing = if y == MEAN_ERROR { failing(data, points) } else { None };
        match (each, failing) {
            (None, failing) => failing.map(|failing| format!("{rival}: what {failing}")),
            (Some(_), failing) => {
                let of = if points.len() > 1 { "There what" } else { "What" };
                let failing = failing.map_or_else(String::new, |failing| format!(" {of} {failing}"));
                Some(summary(data, rival, points, [&x, &y]) + &failing)
            }
        }
    }));
    Finding {
        name: "pareto".to_owned(),
        title: format!("{} against {}", title(&y), title(&x)),
        notes,
        plot: (!rows.is_empty()).then_some(Plot::Lines(plot)),
        sheet: Sheet { columns, rows },
    }
}

/// What is to be had from one rival, over all groups, and what is known of it where it does worst: a sentence.
fn summary(data: &Data, rival: &str, points: &[Rated], [x, y]: [&String; 2]) -> String {
    let range = |number: fn(&(f64, f64)) -> f64| {
        let numbers = || points.iter().map(|point| number(&point.point.place));
        let (low, high) =
            (numbers().fold(f64::INFINITY, f64::min), numbers().fold(f64::NEG_INFINITY, f64::max));
        if low == high { short(low) } else { format!("{} to {}", short(low), short(high)) }
    };
    let on = points.iter().filter(|point| point.on).count();
    let worst = worst(points).filter(|_| points.len() > 1);
    let worst = worst.map_or_else(String::new, |worst| {
        let others = data.columns.iter().filter(|path| ![x, y].contains(path));
        let shown =
            |path: &String| Some(format!("{} {}", title(path), short(data.number(worst.point.row, path)?)));
        let others: Vec<String> = others.filter_map(shown).collect();
        let with = if others.is_empty() { "" } else { ", with " };
        format!(" Worst in {}{with}{}.", worst.group, others.join(", "))
    });
    format!(
        "{rival}: {} {}, {} {}; on the front of {on} of {}.{worst}",
        title(x),
        range(|place| place.0),
        title(y),
        range(|place| place.1),
        points.len()
    )
}

/// The point of a rival that has most of the second number.
fn worst<'a, 'b>(points: &'b [Rated<'a>]) -> Option<&'b Rated<'a>> {
    points.iter().max_by(|a, b| a.point.place.1.total_cmp(&b.point.place.1))
}

/// Where the picture of a rival fails that is off the most: an end of a sentence; `None` where nothing tells, or nothing is off.
fn failing(data: &Data, points: &[Rated]) -> Option<String> {
    let row = worst(points)?.point.row;
    let all = data.number(row, MEAN_ERROR).filter(|all| *all > 0.0)?;
    let bias = data.number(row, BIAS)?;
    let mut places = Vec::new();
    for (path, place) in ERROR_PLACES {
        places.push((data.number(row, path)? / all, place));
    }
    places.sort_by(|a, b| b.0.total_cmp(&a.0));
    let told = places.iter().filter(|(share, _)| *share >= 0.005);
    let shares: Vec<String> =
        told.map(|(share, place)| format!("{:.0} % in {place}", 100.0 * share)).collect();
    let sign = match bias / all {
        b if b > 0.5 => "mostly too light",
        b if b < -0.5 => "mostly too dark",
        _ => "too light here and too dark there",
    };
    Some(format!("is off lies {}, {sign} ({}).", shares.join(", "), short(bias)))
}

/// A point as its rival is judged by it.
struct Rated<'a> {
    point: &'a Known<'a>,
    /// Whether it is on the front.
    on: bool,
    /// The value that its group has in common.
    group: &'a str,
}

/// A point that has both numbers.
struct Known<'a> {
    row: &'a Row<'a>,
    place: (f64, f64),
}

/// Which points no other beats.
fn front(points: &[(f64, f64)]) -> Vec<bool> {
    let beats = |a: &(f64, f64), b: &(f64, f64)| a.0 <= b.0 && a.1 <= b.1 && (a.0 < b.0 || a.1 < b.1);
    points.iter().map(|point| !points.iter().any(|other| beats(other, point))).collect()
}

#[cfg(test)]
mod tests {
    use serde_json::Value;

    use crate::digest::Digest;
    use crate::run::ErrorPlaces;
    use crate::study::{AnalysisEntry, AnalysisKind};

    #[test]
    fn each_value_of_an_axis_can_have_a_front_of_its_own() {
        let point = |scene: &str, cores: u32| [Value::from(scene), Value::from(cores)];
        let points = [point("easy", 1), point("easy", 2), point("hard", 1), point("hard", 2)];
        let times = [8.0, 9.0, 90.0, 50.0];
        let points: Vec<(&[Value], f64)> = points.iter().map(|values| &values[..]).zip(times).collect();
        let mut study = crate::analysis::tests::study(&["scene", "cores"], &["pareto"], &points);
        let fronts = |study: &crate::study::StudyReport| {
            let findings = crate::analysis::findings(&Digest::of(study));
            let sheet = &findings.iter().find(|finding| finding.name == "pareto").expect("asked for").sheet;
            sheet.rows.iter().map(|row| row.last().expect("a cell").shown() == "yes").collect::<Vec<_>>()
        };
        assert_eq!(fronts(&study), [true, false, false, false]);
        let mut each = study.study.analysis[0].options();
        each.each = Some("scene".to_owned());
        assert_eq!(each.kind, AnalysisKind::Pareto);
        study.study.analysis[0] = AnalysisEntry::Options(each);
        assert_eq!(fronts(&study), [true, false, true, true]);
        let findings = crate::analysis::findings(&Digest::of(&study));
        let notes = &findings.iter().find(|finding| finding.name == "pareto").expect("asked for").notes;
        assert!(
            notes[2].starts_with("2: ") && notes[2].ends_with("on the front of 1 of 2. Worst in hard."),
            "{notes:?}"
        );
    }

    #[test]
    fn methods_are_told_where_they_fail() {
        let values: Vec<[Value; 1]> = ["soft", "hard"].map(|name| [Value::from(name)]).into();
        let points: Vec<(&[Value], f64)> = values.iter().map(|values| (&values[..], 5.0)).collect();
        let mut study = crate::analysis::tests::study(&["algorithm"], &["pareto"], &points);
        study.study.metric = "image.error.mean".to_owned();
        let mut options = study.study.analysis[0].options();
        options.x = Some("total.ms".to_owned());
        study.study.analysis[0] = AnalysisEntry::Options(options);
        for (point, [umbra, penumbra, light]) in study.points.iter_mut().zip([[0.1, 0.3, 0.0], [0.0; 3]]) {
            let report = point.report.as_mut().expect("it was measured");
            let mut error = crate::sample::judged().image.error.expect("judged");
            error.places = Some(ErrorPlaces { umbra, penumbra, light });
            (error.mean, error.bias) = (umbra + penumbra + light, umbra - penumbra);
            report.image.error = Some(error);
        }
        let findings = crate::analysis::findings(&Digest::of(&study));
        let notes = &findings.iter().find(|finding| finding.name == "pareto").expect("asked for").notes;
        let told = "soft: what is off lies 75 % in penumbras, 25 % in umbras, \
                    too light here and too dark there (-0.2000).";
        // Where nothing is off, nothing fails.
        assert_eq!(notes[1..], [told]);
    }

    #[test]
    fn the_front_is_what_nothing_beats() {
        let points = [(1.0, 9.0), (2.0, 5.0), (2.0, 6.0), (3.0, 5.0), (4.0, 1.0), (4.0, 1.0)];
        assert_eq!(super::front(&points), [true, true, false, false, true, true]);
    }
}
