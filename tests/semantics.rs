//! Finished points of studies are found again by a version of what results mean.

mod common;

use common::{request, run};
use lrbsim::{RunRequest, SEMANTICS};
use lrbsim_machine::Fidelity;
use lrbsim_reports::picture::sha256;

/// The version that the results below belong to, and a hash of them.
const FROZEN: (u32, &str) = (10, "2718ccc2924157b5348d413838d7f53a282726f9448c9e1278894598cceaa8dc");

#[test]
fn results_that_change_raise_the_version() {
    let reports: Vec<String> = [Fidelity::Windowed, Fidelity::Cycle]
        .map(|fidelity| {
            let report = run(&RunRequest { fidelity, ..request("tiny") }).report;
            serde_json::json!({"phases": report.phases, "image": report.image}).to_string()
        })
        .to_vec();
    let found = sha256(reports.concat().as_bytes());
    assert_eq!(
        (SEMANTICS, found.as_str()),
        FROZEN,
        "results changed: raise SEMANTICS in src/frame.rs (unless it was raised since the last release of results), and freeze this pair"
    );
}
