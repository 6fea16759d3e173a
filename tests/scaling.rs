//! More cores take less time.

mod common;

use common::{machine, machine_named, request, run};
use lrbsim::RunRequest;

#[test]
fn from_4_to_8_to_16_to_24_cores_the_total_falls_every_time() {
    let totals: Vec<f64> = [4, 8, 16, 24]
        .iter()
        .map(|cores| {
            let machine = machine(&[&format!("cores={cores}")]);
            run(&RunRequest { machine, ..request("saloon-small") }).report.total.ms.expect("timed")
        })
        .collect();
    assert!(totals.is_sorted_by(|fewer, more| fewer > more), "{totals:?} ms");
}

#[test]
fn without_a_memory_system_the_soft_phase_keeps_nine_tenths_of_the_cores() {
    let soft_ms = |cores: u32| {
        let machine = machine_named("ideal", &[&format!("cores={cores}")]);
        let report = run(&RunRequest { machine, ..request("saloon-small") }).report;
        report
            .phases
            .iter()
            .find(|phase| phase.id == "soft")
            .and_then(|phase| phase.ms)
            .expect("a timed soft phase")
    };
    let kept = soft_ms(4) / soft_ms(24) / (24.0 / 4.0);
    assert!(kept >= 0.9, "only {kept} of the ratio");
}
