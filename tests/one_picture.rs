//! The picture depends on the scene alone, and a report on what was asked for: not on how the host went about it.

mod common;

use common::{machine, request, run};
use lrbsim::{HostOptions, Machine, RunRequest};
use lrbsim_isa::host::HostSimd;
use lrbsim_machine::Fidelity;
use lrbsim_reports::run::Instructions;

const FIDELITIES: [Fidelity; Fidelity::ALL.len()] = Fidelity::ALL;

/// A machine of so few threads that most steps have many tasks for each, so that they are sampled.
fn small() -> Machine {
    machine(&["cores=1"])
}

/// SHA-256 of the picture that every other run must give too.
fn picture() -> String {
    let functional = RunRequest { fidelity: Fidelity::Functional, ..request("tiny") };
    run(&functional).report.image.sha256
}

#[test]
fn one_picture_for_every_number_of_cores_and_every_fidelity() {
    let picture = picture();
    for cores in [1, 24, 61] {
        for fidelity in FIDELITIES {
            let machine = machine(&[&format!("cores={cores}")]);
            let output = run(&RunRequest { machine, fidelity, ..request("tiny") });
            assert_eq!(output.report.image.sha256, picture, "{cores} cores, {fidelity}");
        }
    }
}

#[test]
fn one_picture_for_every_host_instruction_set() {
    let picture = picture();
    for simd in HostSimd::ALL {
        if !simd.is_available() {
            eprintln!("SKIPPED: this host has no {simd}");
            continue;
        }
        for fidelity in FIDELITIES {
            let host = HostOptions { simd, ..HostOptions::default() };
            let output = run(&RunRequest { fidelity, host, ..request("tiny") });
            assert_eq!(output.report.image.sha256, picture, "{simd}, {fidelity}");
        }
    }
}

#[test]
fn one_report_for_every_number_of_host_threads() {
    for fidelity in FIDELITIES {
        let report = |threads| {
            let host = HostOptions { threads, ..HostOptions::default() };
            [request("tiny"), RunRequest { machine: small(), ..request("tiny") }]
                .map(|request| run(&RunRequest { fidelity, host, ..request }).report.to_json())
        };
        let one = report(1);
        for threads in [2, 3, 8] {
            assert_eq!(report(threads), one, "{threads} host threads, {fidelity}");
        }
    }
}

#[test]
fn one_report_for_every_host_instruction_set() {
    let report = |simd| {
        let host = HostOptions { simd, ..HostOptions::default() };
        run(&RunRequest { host, ..request("tiny") }).report.to_json()
    };
    let one = report(HostSimd::Portable);
    for simd in HostSimd::ALL.into_iter().filter(|simd| simd.is_available()) {
        assert_eq!(report(simd), one, "{simd}");
    }
}

#[test]
fn warm_frames_change_times_but_not_the_picture() {
    let warm = run(&RunRequest { warm_frames: 2, ..request("tiny") }).report;
    let cold = run(&request("tiny")).report;
    assert_eq!(warm.image, cold.image);
    assert_eq!(warm.phases.len(), cold.phases.len());
    assert!(
        warm.total.cycles < cold.total.cycles,
        "{:?} warm, {:?} cold",
        warm.total.cycles,
        cold.total.cycles
    );
}

#[test]
fn the_cycle_stack_adds_up_in_every_phase() {
    let timed = Fidelity::ALL.into_iter().filter(|fidelity| fidelity.is_timed());
    for (fidelity, machine) in timed.flat_map(|fidelity| [(fidelity, machine(&[])), (fidelity, small())]) {
        let report = run(&RunRequest { fidelity, machine, ..request("tiny") }).report;
        for phase in &report.phases {
            let stack = phase.cycle_stack.expect("timed").total();
            let cycles = phase.cycles.expect("timed");
            assert_eq!(stack, cycles * u64::from(report.machine.cores), "{}, {fidelity}", phase.id);
            let busy: u64 = phase.core_busy_cycles.iter().flatten().sum();
            assert_eq!(Some(busy), phase.cycle_stack.map(|stack| stack.issue), "{}, {fidelity}", phase.id);
        }
    }
}

#[test]
fn every_fidelity_runs_the_same_instructions() {
    let counts = |fidelity| -> Vec<_> {
        let report = run(&RunRequest { fidelity, machine: small(), ..request("tiny") }).report;
        report
            .phases
            .into_iter()
            .map(|phase| (phase.id, phase.tasks, phase.instructions, phase.lanes))
            .collect()
    };
    let windowed = counts(Fidelity::Windowed);
    assert_eq!(windowed, counts(Fidelity::Cycle));
    // Untimed runs need no registers: they have no spills, and of a part of the tasks these are extrapolated, of few by no more than a half.
    let in_part = |fidelity: &Fidelity| matches!(fidelity, Fidelity::Sampled(_) | Fidelity::Roofline);
    let levels = Fidelity::ALL.into_iter().filter(|level| in_part(level) || !level.is_timed());
    for level in levels {
        for (timed, found) in windowed.iter().zip(counts(level)) {
            let apart = |of: &Instructions| of.total - of.spill;
            let all = [timed, &found].map(|(id, tasks, instructions, _)| (id, tasks, apart(instructions)));
            assert_eq!(all[0], all[1], "{level}");
            let spills = [timed, &found].map(|(_, _, instructions, _)| instructions.spill as f64);
            let is_close = (spills[0] - spills[1]).abs() <= 0.5 * spills[0];
            assert!(is_close || !in_part(&level), "{level}: {spills:?}");
        }
    }
}
