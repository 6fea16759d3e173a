//! Analyses of hand-made studies whose answers are known.

use serde_json::json;

use super::*;
use crate::run::RunReport;
use crate::sample;
use crate::sheet::Cell;
use crate::study::{AnalysisEntry, STUDY_SCHEMA_VERSION, StudyFile, StudyPoint, StudyReport};

/// A report whose soft phase and total take this many milliseconds.
fn report(ms: f64) -> RunReport {
    let mut report = sample::timed();
    for phase in &mut report.phases {
        phase.ms = Some(ms / 2.0);
    }
    report.total.ms = Some(ms);
    report
}

/// A study over axes with points of known times.
pub(crate) fn study(axes: &[&str], analysis: &[&str], points: &[(&[Value], f64)]) -> StudyReport {
    let axes: Vec<Value> = axes.iter().map(|path| json!({"path": path, "values": [1, 2]})).collect();
    let study: StudyFile =
        serde_json::from_value(json!({"name": "made", "axes": axes, "analysis": analysis})).expect("sound");
    let points = points
        .iter()
        .map(|(values, ms)| StudyPoint {
            values: values.to_vec(),
            key: "k".to_owned(),
            error: None,
            pictures: None,
            report: Some(report(*ms)),
        })
        .collect();
    StudyReport {
        schema_version: STUDY_SCHEMA_VERSION,
        lrbsim_version: "0".to_owned(),
        semantics: 1,
        study,
        points,
    }
}

fn numbers(row: &[Cell]) -> Vec<f64> {
    row.iter().filter_map(|cell| if let Cell::Number(number) = cell { Some(*number) } else { None }).collect()
}

fn finding(study: &StudyReport, name: &str) -> Finding {
    findings(&Digest::of(study)).into_iter().find(|finding| finding.name == name).expect("it was asked for")
}

#[test]
fn a_study_survives_its_json() {
    let study = study(&["cores"], &["table"], &[(&[json!(1)], 8.0), (&[json!(2)], 5.0)]);
    let text = study.to_json();
    assert_eq!(serde_json::from_str::<StudyReport>(&text).expect("own JSON"), study);
    assert_eq!(text.lines().filter(|line| line.contains("\"key\":\"k\"")).count(), 2, "a point a line");
}

#[test]
fn the_table_has_a_row_for_every_point_and_says_what_failed() {
    let mut study = study(&["cores"], &[], &[(&[json!(1)], 8.0), (&[json!(2)], 5.0), (&[json!(4)], 3.0)]);
    study.points[1].report = None;
    study.points[1].error = Some("no".to_owned());
    let table = finding(&study, "table");
    assert_eq!(table.sheet.columns[..2], ["cores", "total, ms"]);
    assert_eq!(table.sheet.columns.last().map(String::as_str), Some("error"));
    assert_eq!(table.sheet.rows[1][1], Cell::Missing);
    assert_eq!(table.sheet.rows[2][..2], [Cell::Number(4.0), Cell::Number(3.0)]);
    assert!(table.notes[0].starts_with("1 of 3 points"));
}

#[test]
fn speedup_and_efficiency_are_relative_to_the_least() {
    let points: [(&[Value], f64); 3] = [(&[json!(4)], 3.0), (&[json!(1)], 9.0), (&[json!(2)], 4.5)];
    let speedup = finding(&study(&["cores"], &["speedup"], &points), "speedup");
    let rows: Vec<Vec<f64>> = speedup.sheet.rows.iter().map(|row| numbers(&row[..4])).collect();
    assert_eq!(rows, [[1.0, 9.0, 1.0, 1.0], [2.0, 4.5, 2.0, 1.0], [4.0, 3.0, 3.0, 0.75]]);
}

#[test]
fn a_series_without_the_baseline_has_no_speedup_and_that_is_said() {
    let points: [(&[Value], f64); 5] = [
        (&[json!(8), json!(128)], 12.0),
        (&[json!(24), json!(128)], 6.0),
        (&[json!(24), json!(512)], 5.0),
        (&[json!(48), json!(512)], 4.0),
        (&[json!(48), json!(128)], 4.8),
    ];
    let speedup = finding(&study(&["cores", "l2"], &["speedup"], &points), "speedup");
    let rows: Vec<Vec<f64>> = speedup.sheet.rows.iter().map(|row| numbers(row)).collect();
    assert_eq!(rows, [[8.0, 12.0, 1.0, 1.0], [24.0, 6.0, 2.0, 2.0 / 3.0], [48.0, 4.8, 2.5, 2.5 / 6.0]]);
    let Some(Plot::Lines(lines)) = &speedup.plot else { panic!("a plot") };
    let names: Vec<&str> = lines.series.iter().map(|series| series.name.as_str()).collect();
    assert_eq!(names, ["l2 128", "ideal"]);
    let note = "Left out, having no total at cores 8, which all speedups are relative to: l2 512.";
    assert_eq!(speedup.notes[1], note);
}

#[test]
fn what_has_no_number_says_so() {
    let all = ["speedup", "power_law", "pareto", "sensitivity"];
    let points: [(&[Value], f64); 2] = [(&[json!("a")], 8.0), (&[json!("b")], 5.0)];
    for name in &all[..3] {
        let notes = finding(&study(&["fidelity"], &all, &points), name).notes;
        assert!(notes[0].starts_with("Nothing is shown: the values of fidelity are names"), "{notes:?}");
    }
    for name in all {
        let notes = finding(&study(&["cores"], &all, &[]), name).notes;
        assert!(notes.len() == 1 && notes[0].starts_with("Nothing is shown: no "), "{notes:?}");
    }
}

#[test]
fn an_exact_power_is_found() {
    let points: Vec<([Value; 1], f64)> =
        [1, 2, 4, 8].map(|x| ([json!(x)], 3.0 * f64::from(x).powf(-1.5))).to_vec();
    let points: Vec<(&[Value], f64)> = points.iter().map(|(values, ms)| (&values[..], *ms)).collect();
    let fit = finding(&study(&["cores"], &["power_law"], &points), "power_law");
    let found = numbers(&fit.sheet.rows[0]);
    for (found, expected) in found.iter().zip([-1.5, -1.5, -1.5, 3.0, 4.0]) {
        assert!((found - expected).abs() < 1e-9, "{found} {expected}");
    }
}

#[test]
fn limits_are_those_at_the_greatest_x() {
    let points: [(&[Value], f64); 3] = [(&[json!(4)], 4.0), (&[json!(1)], 12.0), (&[json!(2)], 7.0)];
    let found = finding(&study(&["cores"], &["limits"], &points), "limits");
    let soft = found.sheet.rows.iter().find(|row| row[1].shown() == "soft").expect("a phase");
    // Phases take half of the whole; of the sample's cycle stack an eighth issues.
    assert_eq!(numbers(soft), [50.0, 3.0, 4.0, 12.5]);
    assert_eq!(soft[6].shown(), "memory 67%, dependency 21%");
}

#[test]
fn exponents_are_those_of_each_axis_alone() {
    // 3 a b^2 about a = b = 2, one at a time; phases take half of it.
    let at = |a: f64, b: f64| ([json!(a), json!(b)], 3.0 * a * b * b);
    let points = [at(2.0, 2.0), at(1.0, 2.0), at(4.0, 2.0), at(2.0, 1.0), at(2.0, 8.0)];
    let points: Vec<(&[Value], f64)> = points.iter().map(|(values, ms)| (&values[..], *ms)).collect();
    let found = finding(&study(&["cores", "l2.ways"], &["exponents"], &points), "exponents");
    let of = |x: &str| {
        let is_of = |row: &&Vec<Cell>| row[0].shown() == x && row[3].shown() == "soft, ms";
        numbers(found.sheet.rows.iter().find(is_of).expect("it was asked for"))
    };
    let table = finding(&study(&["cores", "l2.ways"], &["table"], &points), "table");
    let Some(Plot::Lines(lines)) = table.plot else { panic!("numbers are drawn") };
    let are_lines = lines.series.iter().all(|line| line.points.len() > 1);
    assert!(are_lines, "points of the other axis are no lines");
    let Some(Plot::Lines(lines)) = &found.plot else { panic!("numbers are drawn") };
    assert_eq!(lines.series[1].points, [(1.0, 1.0), (2.0, 4.0), (8.0, 64.0)]);
    for (x, ends, exponent) in [("cores", [1.0, 4.0], 1.0), ("l2.ways", [1.0, 8.0], 2.0)] {
        let row = of(x);
        assert_eq!((&row[..2], row[6]), (&ends[..], 3.0));
        assert!(row[2..6].iter().all(|found| (found - exponent).abs() < 1e-9), "{row:?}");
    }
}

#[test]
fn exponents_are_of_what_was_measured_where_an_axis_says_so() {
    let mut study = study(&["cores"], &["exponents"], &[(&[json!(1)], 2.0), (&[json!(2)], 8.0)]);
    study.study.axes[0].measure = Some("scene.triangles".to_owned());
    for (point, triangles) in study.points.iter_mut().zip([10, 40]) {
        point.report.as_mut().expect("it has one").scene.triangles = triangles;
    }
    let row = finding(&study, "exponents").sheet.rows[0].clone();
    assert_eq!(
        (row[0].shown(), numbers(&row)),
        ("scene.triangles".to_owned(), vec![10.0, 40.0, 1.0, 1.0, 2.0])
    );
}

#[test]
fn the_front_is_marked() {
    let points: [(&[Value], f64); 3] = [(&[json!(1)], 9.0), (&[json!(2)], 4.0), (&[json!(3)], 4.0)];
    let pareto = finding(&study(&["cores"], &["pareto"], &points), "pareto");
    let marks: Vec<String> = pareto.sheet.rows.iter().map(|row| row[2].shown()).collect();
    assert_eq!(marks, ["yes", "yes", ""]);
}

#[test]
fn the_axis_that_does_most_comes_first() {
    let points: [(&[Value], f64); 4] = [
        (&[json!(1), json!("a")], 8.0),
        (&[json!(2), json!("a")], 4.0),
        (&[json!(1), json!("b")], 8.8),
        (&[json!(2), json!("b")], 4.4),
    ];
    let effects = finding(&study(&["cores", "machine"], &["sensitivity"], &points), "sensitivity");
    let shown: Vec<Vec<String>> =
        effects.sheet.rows.iter().map(|row| row.iter().map(Cell::shown).collect()).collect();
    assert_eq!(shown[0], ["cores", "2", "-50", "1", "0", "-1"]);
    assert_eq!(shown[1], ["machine", "a", "0", "b", "10.00", "-"]);
}

#[test]
fn the_same_analysis_twice_has_two_names() {
    let mut twice = study(&["cores"], &["pareto", "pareto"], &[(&[json!(1)], 1.0)]);
    twice.study.analysis[1] = AnalysisEntry::Options(Analysis {
        kind: AnalysisKind::Pareto,
        x: Some("total.ms".to_owned()),
        y: Some("machine.cores".to_owned()),
        each: None,
    });
    let names: Vec<String> = findings(&Digest::of(&twice)).into_iter().map(|finding| finding.name).collect();
    assert_eq!(names, ["table", "pareto", "pareto-2"]);
}

#[test]
fn a_study_without_results_has_findings_all_the_same() {
    let all = ["table", "speedup", "power_law", "limits", "exponents", "pareto", "sensitivity"];
    for finding in findings(&Digest::of(&study(&["cores"], &all, &[]))) {
        assert!(finding.sheet.rows.is_empty() && finding.plot.is_none(), "{}", finding.name);
        assert!(!finding.sheet.markdown().is_empty());
    }
}

#[test]
fn what_was_published_stands_beside_what_was_measured() {
    let mut study = study(&["cores"], &["published"], &[(&[json!(1)], 8.0), (&[json!(2)], 5.0)]);
    let published = |cores: Value, numbers: Value| json!({"source": "A paper, Table 1", "point": {"cores": cores}, "numbers": numbers});
    let all = json!([
        published(json!(1), json!({"total.ms": 16.0, "phases.none.ms": 1.0})),
        published(json!([2.0, 3]), json!({"phases.soft.ms / total.ms": 0.25})),
        published(json!(3), json!({"total.ms": 1.0})),
    ]);
    study.study.published = serde_json::from_value(all).expect("sound");
    let Finding { sheet, notes, plot, .. } = finding(&study, "published");
    assert_eq!(notes, ["Published: A paper, Table 1."], "once");
    let rows: Vec<Vec<f64>> = sheet.rows.iter().map(|row| numbers(row)).collect();
    // Axis, measured, published, ratio; what was not measured has no ratio, and no bar; nor has what is of another unit.
    assert_eq!(rows, [vec![1.0, 1.0], vec![1.0, 8.0, 16.0, 0.5], vec![2.0, 0.5, 0.25, 2.0]]);
    let Some(Plot::Bars(bars)) = plot else { panic!("a bar each") };
    assert_eq!(bars.bars.iter().map(|bar| bar.to).collect::<Vec<f64>>(), [0.5]);
    assert_eq!(bars.label, "measured / published, of ms");
}
