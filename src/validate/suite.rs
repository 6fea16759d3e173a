//! From the id of a row to what is run for it.

use lrbsim_micro::Bench;

use super::experiment::{Experiment, Outcome};
use super::targets::{Target, Targets};
use super::{latency, throughput};
use crate::inputs::Machine;

/// What the outcomes of experiments say.
type Formula = Box<dyn Fn(&[&Outcome]) -> f64 + Send + Sync>;

/// How a row is measured.
pub(super) struct Plan {
    /// The experiments that are run.
    pub(super) experiments: Vec<Experiment>,
    /// What comes out of it, in the row's unit.
    pub(super) value: Formula,
    /// What a reader of the figure should know beside the conditions; may be empty.
    pub(super) remark: String,
}

/// Why a row is not measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct NotExpressed(pub(super) &'static str);

impl std::fmt::Display for NotExpressed {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "not expressed: {}", self.0)
    }
}

impl Plan {
    /// The plan of one experiment.
    pub(super) fn one(experiment: Experiment, value: fn(&Outcome) -> f64) -> Plan {
        Plan::of(vec![experiment], move |outcomes| value(outcomes[0]))
    }

    /// The plan of several experiments.
    pub(super) fn of(
        experiments: Vec<Experiment>,
        value: impl Fn(&[&Outcome]) -> f64 + Send + Sync + 'static,
    ) -> Plan {
        Plan { experiments, value: Box::new(value), remark: String::new() }
    }

    /// The plan with a remark.
    pub(super) fn remarked(self, remark: String) -> Plan {
        Plan { remark, ..self }
    }

    /// The conditions of the measurement, and the remark.
    pub(super) fn note(&self) -> String {
        let mut settings: Vec<&str> =
            self.experiments.iter().flat_map(|e| &e.settings).map(String::as_str).collect();
        settings.sort_unstable();
        settings.dedup();
        settings.extend(Some(self.remark.as_str()).filter(|remark| !remark.is_empty()));
        settings.join(", ")
    }
}

/// The machine of a row: what its part and its conditions change.
pub(super) struct Conditions<'a> {
    /// The machine that is validated.
    pub(super) machine: &'a Machine,
    settings: Vec<String>,
    /// Cores of the row's part.
    pub(super) cores: u32,
}

impl Conditions<'_> {
    /// The row's machine under no further conditions.
    pub(super) fn experiment(&self, bench: Bench) -> Experiment {
        self.under(&[], bench)
    }

    /// The row's machine with some settings.
    pub(super) fn under(&self, settings: &[&str], bench: Bench) -> Experiment {
        let settings =
            self.settings.iter().cloned().chain(settings.iter().map(|s| (*s).to_owned())).collect();
        Experiment { settings, bench }
    }

    /// Lines that an L2 holds.
    pub(super) fn l2_lines(&self) -> u32 {
        self.machine.spec.l2.sets * self.machine.spec.l2.ways
    }
}

/// How the row of `target` is measured.
pub(super) fn plan(target: &Target, targets: &Targets, machine: &Machine) -> Result<Plan, NotExpressed> {
    let conditions = conditions(target, targets, machine);
    let id: Vec<&str> = target.id.split('.').collect();
    match id[0] {
        "lat" | "hwp" => latency::plan(&id, &target.unit, &conditions),
        "issue" | "flops" | "l1" | "l2" | "gather" | "atomic" | "false_sharing" | "bw" | "stream"
        | "ring" => throughput::plan(&id, &conditions),
        "barrier" => Err(NotExpressed(
            "a software barrier spins on flags, and a kernel's work cannot depend on what other threads did when",
        )),
        "dgemm" => Err(NotExpressed("the measured library's kernel is not published")),
        _ => Err(UNKNOWN),
    }
}

/// Of an id that is in no family.
pub(super) const UNKNOWN: NotExpressed = NotExpressed("no benchmark has this id");

/// A sibling part is the machine with another clock, other cores and another memory; a machine that is none of the
/// parts runs the row as it is.
fn conditions<'a>(target: &Target, targets: &Targets, machine: &'a Machine) -> Conditions<'a> {
    let own = machine.config.name.replace('-', "_");
    let mut cores = machine.config.cores;
    let mut settings = Vec::new();
    if target.part != own
        && targets.parts.contains_key(&own)
        && let Some(part) = targets.parts.get(&target.part)
    {
        settings.extend(part.core_ghz.map(|ghz| format!("clock_ghz={ghz}")));
        settings.extend(part.cores.map(|cores| format!("cores={cores}")));
        let own_rate = machine.config.memory.bandwidth_gb_per_s;
        if let Some(rate) = part.memory_gb_per_s.filter(|rate| *rate != own_rate) {
            settings.push(format!("memory.bandwidth_gb_per_s={rate}"));
            // Chips of a faster grade: the same numbers of their clocks.
            let memory = &machine.config.memory;
            for (field, ns) in
                [("row_cycle_ns", memory.row_cycle_ns), ("write_recovery_ns", memory.write_recovery_ns)]
            {
                settings.push(format!("memory.{field}={}", (ns * own_rate / rate * 10.0).round() / 10.0));
            }
        }
        cores = part.cores.unwrap_or(cores);
    }
    Conditions { machine, settings, cores }
}
