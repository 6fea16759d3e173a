//! Finished points of studies are found again by a version of what results mean.

mod common;

use common::{request, run};
use lrbsim::RunRequest;
use lrbsim::study::SEMANTICS;
use lrbsim_machine::Fidelity;
use lrbsim_reports::picture::sha256;

/// The version that the results below belong to, and a hash of them.
const FROZEN: (u32, &str) = (3, "68c06c5150641b1e396963fa26fa7f46c97b41f6ee8e58190e33b77532f131e4");

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
        "results changed: raise SEMANTICS in src/study/cache.rs (unless it was raised since the last release of results), and freeze this pair"
    );
}
