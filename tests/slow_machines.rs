//! Machines on which next to nothing moves, but moves: they take their time and end as any other.
//!
//! A line that takes 64 000 cycles and more, for which 24 cores queue, keeps the chip still for longer than any
//! deadlock would have to; what tells the two apart is that time goes on to a next event.

mod common;

use common::Folder;
use lrbsim_reports::RunReport;
use lrbsim_reports::study::StudyReport;

/// A line every 64 000 cycles.
const SLOW: &str = "memory.bandwidth_gb_per_s=0.001";

/// `tiny` in a small picture, with more arguments.
fn run(more: &[&str]) -> RunReport {
    let args: Vec<&str> = ["run", "tiny", "--size", "64x48", "--json"].iter().chain(more).copied().collect();
    serde_json::from_str(&Folder::new().run(&args).ok().stdout()).expect("a report")
}

#[track_caller]
fn ends_as_any_other(fidelity: &str) {
    let slow = run(&["--fidelity", fidelity, "--set", SLOW]);
    let usual = run(&["--fidelity", fidelity]);
    assert_eq!(slow.image.sha256, usual.image.sha256);
    // Every line that is read takes its time on the way, one after the other.
    let slow_ms = slow.total.ms.expect("timed");
    let line_ms = 64.0 / 0.001 * 1e-6;
    assert!(slow_ms > 100.0 * line_ms, "{slow_ms} ms are not the time of a hundred lines");
}

#[test]
fn windowed_ends_on_a_memory_that_moves_a_line_in_64_000_cycles() {
    ends_as_any_other("windowed");
}

#[test]
fn cycle_ends_on_a_memory_that_moves_a_line_in_64_000_cycles() {
    ends_as_any_other("cycle");
}

#[test]
fn a_clock_far_faster_than_the_memory_ends_too() {
    run(&["--fidelity", "cycle", "--set", "clock_ghz=100", "--set", "memory.bandwidth_gb_per_s=1"]);
}

#[test]
fn a_study_has_results_for_a_point_that_hardly_moves() {
    let folder = Folder::new();
    folder.write(
        "bw.json",
        r#"{
  "name": "bw",
  "base": {"scene": "tiny", "fidelity": "cycle"},
  "axes": [{"path": "memory.bandwidth_gb_per_s", "values": [0.001, 0.5]}],
  "analysis": ["table"]
}
"#,
    );
    let printed = folder.run(&["study", "bw.json"]).ok().stdout();
    assert!(printed.contains("2 points: 2 run, 0 found in out/cache, 0 failed"), "{printed}");
    let text = std::fs::read_to_string(folder.path("out/study-bw/study.json")).expect("results");
    let study: StudyReport = serde_json::from_str(&text).expect("its own JSON");
    let ms = |bandwidth: f64| {
        study.at(&[bandwidth.into()]).expect("a point of the study").total.ms.expect("timed")
    };
    assert!(ms(0.001) > 10.0 * ms(0.5), "{} and {} ms", ms(0.001), ms(0.5));
}
