//! One benchmark on one machine.

use lrbsim_isa::host::HostSimd;
use lrbsim_isa::program::StepSource;
use lrbsim_machine::{Chip, CoreActivity, Fidelity, StepReport};
use lrbsim_micro::Bench;

use crate::Setting;
use crate::error::BadInput;
use crate::inputs::Machine;

/// Everything that determines an outcome, beside the machine that it starts from.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Experiment {
    /// What the part and the conditions of the measurement change of the machine, as `PATH=VALUE`.
    pub settings: Vec<String>,
    /// The benchmark that is run.
    pub bench: Bench,
}

/// What came out of an experiment.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// Cycles by which the long pass took longer than the short one, see [`lrbsim_micro`]: of each the mean of the
    /// cores that work in it. The programs run for seconds, so that every thread meets all banks of the memory; in a
    /// pass as short as these the last thread is only the one that had bad luck.
    pub cycles: f64,
    /// Units of work in that time.
    pub units: f64,
    /// Clock of the machine, GHz.
    pub clock_ghz: f64,
    /// What the machine counted in that time.
    pub counts: Counts,
}

/// What the machine counted in an experiment.
#[derive(Debug, Clone, Copy)]
pub struct Counts {
    /// Accesses of L1 data caches.
    pub l1d_accesses: f64,
    /// Messages, on a ring or within a stop.
    pub ring_messages: f64,
    /// Lines read from memory.
    pub memory_reads: f64,
}

/// What came out of one pass.
struct Pass {
    cycles: f64,
    report: StepReport,
}

impl Pass {
    fn of(report: StepReport, activity: &[CoreActivity]) -> Pass {
        // Cores without a thread come and go at once; they issue two or three uops.
        let most = activity.iter().map(|core| core.issued).max().unwrap_or(0);
        let works = |core: &&CoreActivity| core.issued * 2 > most;
        let arrivals: Vec<f64> =
            activity.iter().filter(works).map(|core| core.arrival_cycles as f64).collect();
        Pass { cycles: arrivals.iter().sum::<f64>() / arrivals.len() as f64, report }
    }

    /// What it counted beyond what `short` did.
    fn counts_beyond(&self, short: &Pass) -> Counts {
        let beyond = |count: fn(&StepReport) -> u64| count(&self.report) as f64 - count(&short.report) as f64;
        Counts {
            l1d_accesses: beyond(|report| report.l1d.accesses),
            ring_messages: beyond(|report| report.ring.messages + report.ring.local),
            memory_reads: beyond(|report| report.memory.reads),
        }
    }
}

impl Outcome {
    /// Cycles a unit of work.
    pub fn cycles_per_unit(&self) -> f64 {
        self.cycles / self.units
    }

    /// Nanoseconds a unit of work.
    pub fn ns_per_unit(&self) -> f64 {
        self.cycles_per_unit() / self.clock_ghz
    }

    /// Units of work a nanosecond: GB/s when the units are bytes.
    pub fn units_per_ns(&self) -> f64 {
        self.ns_per_unit().recip()
    }
}

impl Experiment {
    /// A guess at what it costs the host, to begin with the longest.
    pub(super) fn weight(&self) -> u64 {
        match &self.bench {
            Bench::Stream(stream) => {
                u64::from(stream.threads.count()) * u64::from(stream.extent.lines_worked())
            }
            _ => 10_000,
        }
    }

    /// Runs the experiment.
    pub(super) fn run(&self, machine: &Machine, fidelity: Fidelity) -> Result<Outcome, BadInput> {
        let mut settings: Vec<Setting> =
            self.settings.iter().map(|text| text.parse()).collect::<Result<_, BadInput>>()?;
        // Measured programs pin their threads and start them together: no task counter, and no barrier in the time.
        for part in ["ideal.queue=true", "ideal.barrier=true"] {
            settings.push(part.parse()?);
        }
        let machine = machine.with(&settings)?;
        let mut prepared = self.bench.prepare(machine.spec.cores);
        let mut chip = Chip::new(&machine.spec, fidelity, 1);
        let mut passes = Vec::new();
        for step in &prepared.passes {
            let simd = HostSimd::detect();
            let source = StepSource::new(step, &mut prepared.arena, simd, 1);
            let report = chip.run_step(&source).map_err(|stuck| BadInput::new(stuck.to_string()))?;
            passes.push(Pass::of(report, chip.activity()));
        }
        let [.., short, long] = &passes[..] else {
            unreachable!("a benchmark has a short pass and a long one")
        };
        Ok(Outcome {
            cycles: long.cycles - short.cycles,
            units: prepared.units as f64,
            clock_ghz: machine.config.clock_ghz,
            counts: long.counts_beyond(short),
        })
    }
}
