//! The study of stability: its files, what it says, and that it is the same on any host.

mod common;

use common::Folder;
use lrbsim::HostOptions;
use lrbsim::progress::Quiet;
use lrbsim::stability::{StabilityRequest, family_names, run_stability};
use lrbsim_reports::stability::{Outcome, StabilityReport};

fn run(only: Option<&str>, threads: usize) -> StabilityReport {
    let host = HostOptions { threads, ..HostOptions::default() };
    let request = StabilityRequest { only: only.map(str::to_owned), quick: true, host };
    run_stability(&request, &Quiet).expect("families of that name")
}

#[test]
fn the_study_of_stability_leaves_words_tables_and_plots_that_can_be_drawn_again() {
    let folder = Folder::new();
    let printed = folder.run(&["study", "stability", "--only", "needle"]).ok().stdout();
    assert!(
        printed.contains("Silhouettes inside the lamp") && printed.contains("11 points, 0 failed"),
        "{printed}"
    );
    let text = std::fs::read_to_string(folder.path("out/study-stability/stability.json")).expect("readable");
    let report: StabilityReport = serde_json::from_str(&text).expect("own JSON");
    assert_eq!(report.to_json(), text);
    let files =
        ["breaks.csv", "needle.csv", "needle.svg", "needle.png", "table.md", "report.html", "stability.json"];
    common::drawn_again(&folder, "out/study-stability", &files);
    folder.run(&["compare", "out/study-stability", "out/study-stability"]).refused(&["no times to compare"]);
}

#[test]
fn any_number_of_host_threads_gives_the_same_bytes() {
    assert_eq!(run(Some("t-junction"), 1).to_json(), run(Some("t-junction"), 3).to_json());
}

#[test]
fn no_picture_of_a_reduced_study_holds_anything_but_parts_of_the_light() {
    let report = run(None, 2);
    assert_eq!(report.families.iter().map(|family| family.id.as_str()).collect::<Vec<_>>(), family_names());
    let mut refused = Vec::new();
    for family in &report.families {
        for point in &family.points {
            match &point.outcome {
                Outcome::Measured(measured) => assert_eq!(measured.no_part, 0, "{} {}", family.id, point.x),
                Outcome::Refused(why) => refused.push((family.id.as_str(), point.x, why.as_str())),
                Outcome::Failed(why) => panic!("{} {}: {why}", family.id, point.x),
            }
        }
    }
    let said: Vec<_> = refused.iter().map(|(id, x, _)| (*id, *x)).collect();
    assert_eq!(said, [("scale", 1e39), ("radius", 1e10)], "{refused:?}");
}

#[test]
fn a_family_that_is_not_there_is_refused() {
    let folder = Folder::new();
    folder.run(&["study", "stability", "--only", "xyz"]).refused(&["no family of `stability`", "t-junction"]);
    folder
        .run(&["study", "cores", "--only", "xyz"])
        .refused(&["`--only` is for `lrbsim study stability` and `table3` and `fidelity` alone"]);
    folder.run(&["study", "stabilty"]).refused(&["did you mean `stability`?"]);
}
