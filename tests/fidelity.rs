//! What the faster fidelity gives up.

mod common;

use common::{request, run};
use lrbsim::RunRequest;
use lrbsim_machine::Fidelity;

/// Largest error of `windowed` against `cycle` in a phase that matters.
const TOLERANCE: f64 = 0.035;

/// A phase matters from this share of the time on.
const SHARE: f64 = 0.05;

fn windowed_agrees_with_cycle(scene: &str) {
    let exactly = RunRequest { fidelity: Fidelity::Cycle, ..request(scene) };
    let (windowed, cycle) = rayon::join(|| run(&request(scene)).report, || run(&exactly).report);
    assert_eq!(windowed.image.sha256, cycle.image.sha256);
    let mut compared = 0;
    for (fast, exact) in windowed.phases.iter().zip(&cycle.phases) {
        assert_eq!(fast.id, exact.id);
        let (Some(fast_cycles), Some(exact_cycles), Some(share)) = (fast.cycles, exact.cycles, exact.share)
        else {
            panic!("phase {} of {scene} has no time", fast.id);
        };
        if share > SHARE {
            let error = fast_cycles as f64 / exact_cycles as f64 - 1.0;
            println!("{scene} {}: {:+.2} %", fast.id, 100.0 * error);
            assert!(error.abs() <= TOLERANCE, "{} of {scene}: {:+.2} %", fast.id, 100.0 * error);
            compared += 1;
        }
    }
    assert!(compared >= 3, "only {compared} phases of {scene} take more than {SHARE} of the time");
}

#[test]
fn windowed_is_near_cycle_on_tiny() {
    windowed_agrees_with_cycle("tiny");
}

#[test]
fn windowed_is_near_cycle_on_saloon_small() {
    windowed_agrees_with_cycle("saloon-small");
}
