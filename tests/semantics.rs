//! Finished points of studies are found again by a version of what results mean.

mod common;

use common::{request, run};
use lrbsim::{Algorithm, RunRequest, SEMANTICS};
use lrbsim_kernels::method::METHODS;
use lrbsim_machine::{Fidelity, Sampling};
use lrbsim_reports::picture::sha256;
use lrbsim_workloads::Light;
use lrbsim_workloads::glam::DVec3;

/// The version that the results below belong to, and a hash of them.
const FROZEN: (u32, &str) = (15, "abc8a2b36d8bb8c324b93118776aac1ba4e9cedb2a57fd2beb54123eb4685d5a");

/// What comes out of a run: its phases and its picture.
fn results(request: &RunRequest) -> String {
    let report = run(request).report;
    serde_json::json!({"phases": report.phases, "image": report.image}).to_string()
}

/// `light`, or in its place a rectangle or a line that `algorithm` draws.
fn light_for(algorithm: &Algorithm, light: Light) -> Light {
    let (center, half_u, half_v) = (light.center(), DVec3::X * light.radius(), DVec3::Z * light.radius());
    let others =
        [Light::Rect { center, half_u, half_v }, Light::Linear { p0: center - half_u, p1: center + half_u }];
    [light].into_iter().chain(others).find(|light| algorithm.check_light(light).is_ok()).expect("one of them")
}

#[test]
fn results_that_change_raise_the_version() {
    let mut all = results(&RunRequest { fidelity: Fidelity::Cycle, ..request("tiny") });
    for method in METHODS {
        let has_map = method.entry().options.iter().any(|option| option.name == "size");
        let algorithm =
            Algorithm::new(method, if has_map { "size=128" } else { "" }).expect("the method takes these");
        let mut request = request("tiny");
        request.scene.light = light_for(&algorithm, request.scene.light);
        all += &results(&RunRequest { algorithm, ..request });
    }
    // Enough tasks that some are not timed.
    let sampled = RunRequest { fidelity: Fidelity::Sampled(Sampling::DEFAULT), ..request("saloon-small") };
    let sampled = run(&sampled).report;
    assert!(sampled.total.ms_interval.is_some(), "nothing was left out");
    all += &serde_json::json!(sampled.phases).to_string();
    let found = sha256(all.as_bytes());
    assert_eq!(
        (SEMANTICS, found.as_str()),
        FROZEN,
        "results changed: raise SEMANTICS in src/frame.rs (unless it was raised since the last release of results), and freeze this pair"
    );
}
