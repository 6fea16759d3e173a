//! A hand-written report for the tests of every writer.

use std::collections::BTreeMap;

use lrbsim_machine::counters::{CacheCounters, CycleStack};
use lrbsim_machine::{MachineConfig, builtin_machine};

use crate::run::{
    ErrorPlaces, ImageError, ImageSummary, Instructions, Lanes, PhaseReport, Provenance, RunReport,
    SCHEMA_VERSION, SceneSummary, StepRow, Total, milliseconds,
};
use crate::validation::ModelError;

fn counts(pairs: &[(&str, u64)]) -> BTreeMap<String, u64> {
    pairs.iter().map(|(name, count)| ((*name).to_owned(), *count)).collect()
}

fn phase(id: &str, title: &str, in_paper_total: bool, cycles: u64) -> PhaseReport {
    PhaseReport {
        id: id.to_owned(),
        title: title.to_owned(),
        in_paper_total,
        steps: 2,
        tasks: 300,
        cycles: Some(cycles),
        ms: Some(milliseconds(cycles, 1.0)),
        ms_interval: None,
        share: Some(cycles as f64 / 1e7),
        instructions: Instructions {
            total: cycles * 3,
            vector: cycles * 2,
            scalar: cycles,
            by_class: counts(&[("vector_alu", cycles * 2), ("scalar_alu", cycles)]),
            ..Instructions::default()
        },
        ipc: Some(3.0 / 24.0),
        lanes: Lanes { active: cycles * 24, masked: cycles * 8 },
        paired_core_cycles: Some(cycles),
        core_busy_cycles: Some(vec![cycles, cycles / 2, cycles * 3 / 2]),
        cycle_stack: Some(CycleStack {
            issue: cycles * 3,
            memory: cycles * 16,
            dependency: cycles * 5,
            ..CycleStack::default()
        }),
        bounds: None,
        l1d: Some(CacheCounters { accesses: 1000, hits: 905, misses: 95, ..CacheCounters::default() }),
        l2: Some(CacheCounters {
            accesses: 95,
            hits: 19,
            misses: 76,
            writebacks: 7,
            ..CacheCounters::default()
        }),
        ring: Some(Default::default()),
        directory: Some(Default::default()),
        memory: Some(Default::default()),
        atomics: Some(Default::default()),
        by_step: vec![StepRow {
            name: format!("{id} step"),
            tasks: 96,
            instructions: cycles * 3,
            cycles: Some(cycles),
            ms: Some(milliseconds(cycles, 1.0)),
            cycle_stack: None,
        }],
    }
}

fn machine() -> MachineConfig {
    let text = builtin_machine("larrabee-24").expect("shipped");
    let mut machine: MachineConfig = serde_json::from_str(text).expect("what is shipped can be read");
    // The shipped sources grow; a golden file need not follow.
    machine.sources.clear();
    machine
}

/// A run on a timed machine.
pub(crate) fn timed() -> RunReport {
    let phases = vec![
        phase("silhouette", "silhouette detection", false, 500_000),
        phase("grid", "data structure construction", true, 3_500_000),
        phase("soft", "soft shadow kernel", true, 6_000_000),
    ];
    RunReport {
        schema_version: SCHEMA_VERSION,
        provenance: Provenance {
            lrbsim_version: "0.1.0".to_owned(),
            semantics: 1,
            machine_hash: "a".repeat(64),
            scene_hash: "b".repeat(64),
            algorithm: "sism:form=exact".to_owned(),
            fidelity: "windowed".to_owned(),
            warm_frames: 0,
            seed: 0,
        },
        scene: SceneSummary {
            name: "sample".to_owned(),
            triangles: 60_123,
            silhouette_edges: 8_100,
            receivers: 3,
            width: 2,
            height: 2,
            light: serde_json::json!({"kind": "sphere", "center": [0.0, 4.0, 0.0], "radius": 0.1}),
        },
        machine: machine(),
        total: Total::of_phases(&phases, 1.0),
        phases,
        image: ImageSummary::of(&[0.0, 1.0, 0.5, f32::NAN]),
        model_error: ModelError {
            machine: "knc-5110p".to_owned(),
            fidelity: "windowed".to_owned(),
            rows: 200,
            inside: 160,
            mean_error_percent: 5.5,
            worst_error_percent: 25.0,
            held_out_mean_error_percent: 6.5,
        },
        warnings: Vec::new(),
    }
}

/// A timed run that is judged by a reference.
pub(crate) fn judged() -> RunReport {
    let mut report = timed();
    report.image.error = Some(ImageError {
        samples: 256,
        shadowed_receivers: 2,
        receivers_in_question: 3,
        mean: 0.0123,
        rmse: 0.0345,
        max: 0.512,
        p99: 0.21,
        off_by_quarter: 0.0012,
        bias: -0.0034,
        places: Some(ErrorPlaces { umbra: 0.0013, penumbra: 0.01, light: 0.001 }),
        reference_mean: 0.0032,
        reference_rmse: 0.005,
    });
    report
}

/// The same run without a machine.
pub(crate) fn functional() -> RunReport {
    let mut report = timed();
    report.provenance.fidelity = "functional".to_owned();
    for phase in &mut report.phases {
        phase.cycles = None;
        phase.ms = None;
        phase.share = None;
        phase.ipc = None;
        phase.cycle_stack = None;
        phase.l1d = None;
        phase.l2 = None;
        phase.ring = None;
        phase.memory = None;
        phase.directory = None;
        phase.atomics = None;
        phase.paired_core_cycles = None;
        phase.core_busy_cycles = None;
    }
    report.total = Total::of_phases(&report.phases, 1.0);
    report
}
