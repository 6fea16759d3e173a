//! `lrbsim validate`: published measurements of Knights Corner.

mod common;

use common::Folder;
use lrbsim::Machine;
use lrbsim::validate::{Targets, ValidateRequest, model_error, validate};
use lrbsim_machine::Fidelity;
use lrbsim_reports::validation::Validation;

/// The rows that have to be met, but for `without`.
fn must_pass(fidelity: Fidelity, without: &str) -> Validation {
    let mut targets = Targets::shipped();
    let wanted = targets.must_pass.clone();
    targets.targets.retain(|target| wanted.contains(&target.id) && target.id != without);
    let machine = Machine::load("knc-5110p", &[]).expect("shipped");
    validate(&ValidateRequest { machine, targets, only: None, fidelity }).expect("sound")
}

/// A known miss, and how far off it is in per cent: ordinary writes by one thread a core lose more to changes of
/// direction on the chip than here, at both levels. See docs/deviations.md.
const MISSED: (&str, f64) = ("bw.mem.write.t060", 30.0);

/// The row that takes as long at `cycle` as all others together; `bw.mem` has the same reads and writes.
const LONG: &str = "stream.tuned.triad";

#[test]
fn rows_that_have_to_be_met_are_met_but_one_and_windowed_is_within_4_percent_of_cycle() {
    let (windowed, cycle) = (must_pass(Fidelity::Windowed, ""), must_pass(Fidelity::Cycle, LONG));
    assert_eq!((windowed.rows.len(), cycle.rows.len()), (30, 29));
    for exact in &cycle.rows {
        let fast = windowed.rows.iter().find(|fast| fast.id == exact.id).expect("the same rows");
        let (a, b) = (fast.simulated.expect("expressed"), exact.simulated.expect("expressed"));
        let apart = (a / b - 1.0) * 100.0;
        println!("{}: windowed {a:.3} cycle {b:.3} ({apart:+.1} %)", fast.id);
        assert!(apart.abs() <= 4.0, "{}: windowed {a}, cycle {b}", fast.id);
    }
    for fast in &windowed.rows {
        let found = fast.simulated.expect("expressed");
        println!("{}: published {} windowed {found:.3}", fast.id, fast.published);
        let error = fast.error_percent.expect("expressed").abs();
        let is_met = if fast.id == MISSED.0 { !fast.ok && error <= MISSED.1 } else { fast.ok };
        assert!(is_met, "{}: {found} for {} to {}", fast.id, fast.low, fast.high);
    }
}

#[test]
fn reports_carry_the_errors_that_the_page_shows() {
    let error = model_error();
    let page = include_str!("../docs/validation.md");
    let row = format!(
        "| high confidence | 200 | {} | {} | {:.1} % | {:.1} % |",
        error.rows, error.inside, error.mean_error_percent, error.worst_error_percent
    );
    assert!(page.contains(&row), "no row {row}");
    assert_eq!(error.machine, "knc-5110p");
}

#[test]
fn json_has_the_rows_of_the_contract_and_nothing_else_is_printed() {
    let folder = Folder::new();
    let text = folder.run(&["validate", "--only", "lat.l", "--json"]).ok().stdout();
    let value: serde_json::Value = serde_json::from_str(&text).expect("JSON alone");
    let rows = value["rows"].as_array().expect("rows");
    assert_eq!(rows.len(), 2);
    for field in ["id", "published", "low", "high", "simulated", "error_percent", "ok", "note"] {
        assert!(!rows[0][field].is_null(), "{field}");
    }
}

/// A targets file with one row, `lat.l1` from `low` to `high`, that must pass.
fn targets(low: f64, high: f64) -> String {
    let value = (low + high) / 2.0;
    format!(
        r#"{{"parts": {{}}, "must_pass": ["lat.l1"], "targets": [{{"id": "lat.l1", "unit": "cycle", "value": {value},
        "low": {low}, "high": {high}, "confidence": "high", "part": "any"}}]}}"#
    )
}

#[test]
fn a_row_that_must_pass_and_misses_is_exit_code_1() {
    let folder = Folder::new();
    folder.write("met.json", &targets(2.9, 3.1));
    folder.write("missed.json", &targets(5.0, 6.0));
    folder.run(&["validate", "--targets", "met.json"]).ok();
    let output = common::lrbsim()
        .args(["validate", "--targets"])
        .arg(folder.path("missed.json"))
        .output()
        .expect("the binary starts");
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stdout).contains("missed: lat.l1"));
}

#[test]
fn what_cannot_be_validated_is_refused() {
    let folder = Folder::new();
    folder.write("bad.json", &targets(2.9, 3.1).replace("\"low\": 2.9", "\"low\": 4.0"));
    folder.run(&["validate", "--targets", "bad.json"]).refused(&["`lat.l1`", "is not within", "bad.json"]);
    folder.run(&["validate", "--targets", "none.json"]).refused(&["none.json"]);
    folder.run(&["validate", "--only", "lat.l9"]).refused(&["`lat.l9`", "lat.l1"]);
    folder.run(&["validate", "--fidelity", "functional"]).refused(&["functional", "windowed or cycle"]);
    folder.run(&["validate", "-m", "knc-5110"]).refused(&["knc-5110p"]);
}

#[test]
fn ids_with_any_number_are_expressed_on_any_machine() {
    let folder = Folder::new();
    let row = |id: &str| {
        format!(
            r#"{{"id": "{id}", "unit": "GB/s", "value": 1, "low": 0, "high": 1000, "confidence": "low", "part": "any"}}"#
        )
    };
    let ids =
        ["bw.mem.read.t7", "lat.geom.l1.5x8k", "gather.l1.lines03", "lat.size.96k", "bw.mem.read.t9999"];
    let rows: Vec<String> = ids.map(row).into();
    folder
        .write("t.json", &format!(r#"{{"parts": {{}}, "must_pass": [], "targets": [{}]}}"#, rows.join(",")));
    let text = folder.run(&["validate", "-m", "larrabee-24", "--targets", "t.json", "--json"]).ok().stdout();
    let value: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    let simulated: Vec<bool> =
        value["rows"].as_array().expect("rows").iter().map(|row| row["simulated"].is_number()).collect();
    assert_eq!(simulated, [true, true, true, true, false]);
}
