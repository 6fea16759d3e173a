//! `lrbsim study fidelity`: what each level of modeling costs.

mod common;

use common::Folder;
use lrbsim_reports::fidelity::FidelityReport;

#[test]
fn the_study_leaves_a_price_list_and_a_page_that_can_be_drawn_again() {
    let folder = Folder::new();
    let printed = folder.run(&["study", "fidelity", "--quick", "-o", "out"]).ok().stdout();
    for part in ["The price list", "`windowed` is the default", "3 subjects, 0 failed"] {
        assert!(printed.contains(part), "`{part}` is not in {printed}");
    }
    let files = [
        "prices.csv",
        "prices.svg",
        "tiny.csv",
        "triad.csv",
        "prices.md",
        "report.html",
        "prices.json",
        "fidelity.json",
    ];
    common::drawn_again(&folder, "out", &files);
    folder.run(&["compare", "out", "out"]).refused(&["no times to compare"]);

    let text = std::fs::read(folder.path("out/fidelity.json")).expect("readable");
    let mut report: FidelityReport = serde_json::from_slice(&text).expect("its own JSON");
    for subject in &report.subjects {
        let level = |name: &str| {
            let is_it = |level: &&lrbsim_reports::fidelity::FidelityLevel| level.level.starts_with(name);
            subject.levels.iter().find(is_it).expect("every level")
        };
        assert_eq!(level("functional").error, None);
        assert_eq!((level("cycle").error, level("cycle").phase_error), (Some(0.0), Some(0.0)));
        let windowed = level("windowed").phase_error.expect("timed");
        // Subjects of a few thousand cycles.
        assert!(windowed.abs() < 0.1, "{}: {windowed}", subject.name);
        // Where all tasks are timed, nothing is extrapolated.
        let sampled = level("sampled").error.expect("timed");
        assert!(sampled.abs() < 0.1, "{}: {sampled}", subject.name);
    }

    // Seconds of other runs, and none.
    report.subjects[0].instructions += 1;
    std::fs::write(folder.path("out/fidelity.json"), report.to_json()).expect("a folder of the test");
    folder.run(&["report", "out"]).refused(&["of another study", "`lrbsim study fidelity` makes both"]);
    std::fs::remove_file(folder.path("out/prices.json")).expect("it was written");
    folder.run(&["report", "out"]).refused(&["prices.json", "`lrbsim study fidelity` makes both"]);
}

#[test]
fn what_is_no_subject_is_refused() {
    let folder = Folder::new();
    folder.run(&["study", "fidelity", "--only", "xyz"]).refused(&[
        "no subject of `fidelity`",
        "palm",
        "triad",
    ]);
}
