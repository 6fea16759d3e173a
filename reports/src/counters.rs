//! From the counters of the machine to a row of the report.

use std::collections::BTreeMap;

use lrbsim_isa::{Class, Phase};
use lrbsim_machine::counters::NORMAL_95;
use lrbsim_machine::{PhaseCounters, StepReport};

use crate::run::{Instructions, Lanes, PhaseReport, StepRow, milliseconds, ratio};

/// The machine side of a timed run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Clock {
    /// Core clock.
    pub clock_ghz: f64,
    /// Cores of the machine, busy or not.
    pub cores: u32,
}

/// What a phase cost on the machine.
#[derive(Debug, Clone)]
pub struct PhaseCosts {
    /// Which phase.
    pub phase: &'static Phase,
    /// The steps of the phase, in order, each with what it cost.
    pub steps: Vec<(&'static str, StepReport)>,
    /// Cycles in which each core issued, by core; `None` when nothing is timed.
    pub core_busy_cycles: Option<Vec<u64>>,
}

/// The rows of a report, with shares of the whole frame. `clock` is `None` when nothing was timed.
pub fn phase_reports(phases: &[PhaseCosts], clock: Option<Clock>) -> Vec<PhaseReport> {
    let frame_cycles = phases.iter().flat_map(|costs| &costs.steps).map(|(_, report)| report.cycles).sum();
    phases.iter().map(|costs| phase_report(costs, clock, frame_cycles)).collect()
}

fn phase_report(costs: &PhaseCosts, clock: Option<Clock>, frame_cycles: u64) -> PhaseReport {
    let phase = costs.phase;
    let mut counters = PhaseCounters::default();
    costs.steps.iter().for_each(|(_, report)| counters += report);
    let cycles = counters.cycles;
    let instructions = instructions(&counters.class_counts);
    let is_estimated = counters.bounds.greatest().is_some();
    PhaseReport {
        id: phase.id.to_owned(),
        title: phase.title.to_owned(),
        in_paper_total: phase.in_paper_total,
        steps: counters.steps,
        tasks: counters.tasks,
        cycles: clock.map(|_| cycles),
        ms: clock.map(|clock| milliseconds(cycles, clock.clock_ghz)),
        ms_interval: clock.and_then(|clock| interval(&counters, clock)),
        share: clock.and_then(|_| ratio(cycles, frame_cycles)),
        ipc: clock.and_then(|clock| ratio(instructions.total, cycles * u64::from(clock.cores))),
        instructions,
        lanes: Lanes { active: counters.lanes_active, masked: counters.lanes_masked },
        paired_core_cycles: clock.map(|_| counters.paired),
        core_busy_cycles: costs.core_busy_cycles.clone(),
        cycle_stack: clock.map(|_| counters.cycle_stack),
        bounds: clock.and(Some(counters.bounds)).filter(|_| is_estimated),
        l1d: clock.map(|_| counters.l1d),
        l2: clock.map(|_| counters.l2),
        // Estimates know of no messages.
        ring: clock.map(|_| counters.ring).filter(|_| !is_estimated),
        directory: clock.map(|_| counters.directory).filter(|_| !is_estimated),
        memory: clock.map(|_| counters.memory),
        atomics: clock.map(|_| counters.atomics),
        by_step: costs.steps.iter().map(|(name, report)| step_row(name, report, clock)).collect(),
    }
}

fn step_row(name: &str, report: &StepReport, clock: Option<Clock>) -> StepRow {
    StepRow {
        name: name.to_owned(),
        tasks: report.tasks,
        instructions: report.issued,
        cycles: clock.map(|_| report.cycles),
        ms: clock.map(|clock| milliseconds(report.cycles, clock.clock_ghz)),
        cycle_stack: clock.map(|_| report.cycle_stack),
    }
}

/// The milliseconds between which an extrapolated time lies with 95 % confidence; `None` where every task was timed.
fn interval(counters: &PhaseCounters, clock: Clock) -> Option<[f64; 2]> {
    let half = NORMAL_95 * (counters.cycles_variance as f64).sqrt();
    let at = |cycles: f64| cycles.max(0.0) / (clock.clock_ghz * 1e6);
    let cycles = counters.cycles as f64;
    (half > 0.0).then(|| [at(cycles - half), at(cycles + half)])
}

/// Sorts instructions by kind.
fn instructions(class_counts: &[u64; Class::COUNT]) -> Instructions {
    let mut sum = Instructions { by_class: BTreeMap::new(), ..Instructions::default() };
    for (class, count) in Class::ALL.into_iter().zip(*class_counts) {
        if count == 0 {
            continue;
        }
        let kind = match class {
            Class::Gather => &mut sum.gather,
            Class::Scatter => &mut sum.scatter,
            Class::AtomicGather | Class::AtomicScatter | Class::Atomic => &mut sum.atomic,
            Class::PrefetchL1 | Class::PrefetchL2 | Class::GatherPrefetch => &mut sum.prefetch,
            Class::Mask => &mut sum.mask,
            Class::Branch => &mut sum.branch,
            Class::SpillStore | Class::SpillLoad => &mut sum.spill,
            Class::ScalarAlu | Class::ScalarMul | Class::ScalarLoad | Class::ScalarStore => &mut sum.scalar,
            Class::VectorAlu
            | Class::VectorCompare
            | Class::VectorMul
            | Class::VectorFma
            | Class::VectorMath
            | Class::VectorConvert
            | Class::VectorShuffle
            | Class::VectorLoad
            | Class::VectorBroadcastLoad
            | Class::VectorStore
            | Class::VectorStreamStore
            | Class::VectorExpand
            | Class::VectorCompress => &mut sum.vector,
        };
        *kind += count;
        sum.total += count;
        sum.by_class.insert(class.name().to_owned(), count);
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run::Total;

    const PHASE: Phase = Phase { id: "x", title: "x", in_paper_total: true };
    const CLOCK: Clock = Clock { clock_ghz: 2.0, cores: 2 };

    #[test]
    fn every_instruction_is_of_one_kind() {
        let mut counts = [0; Class::COUNT];
        for (index, count) in counts.iter_mut().enumerate() {
            *count = 1 << index;
        }
        let sum = instructions(&counts);
        let kinds = [
            sum.vector,
            sum.gather,
            sum.scatter,
            sum.atomic,
            sum.scalar,
            sum.mask,
            sum.branch,
            sum.prefetch,
            sum.spill,
        ];
        assert_eq!(kinds.iter().sum::<u64>(), sum.total);
        assert_eq!(sum.total, (1 << Class::COUNT) - 1);
        assert_eq!(sum.by_class.len(), Class::COUNT);
    }

    fn costs(steps: &[StepReport]) -> PhaseCosts {
        let steps = steps.iter().map(|report| ("step", report.clone())).collect();
        PhaseCosts { phase: &PHASE, steps, core_busy_cycles: None }
    }

    #[test]
    fn rates_are_over_all_cores_and_the_whole_frame() {
        let mut counters = PhaseCounters { cycles: 100, ..PhaseCounters::default() };
        counters.class_counts[Class::VectorFma as usize] = 50;
        let other = PhaseCounters { cycles: 300, ..PhaseCounters::default() };
        let rows = phase_reports(&[costs(&[counters]), costs(&[other])], Some(CLOCK));
        assert_eq!((rows[0].ipc, rows[0].share, rows[0].ms), (Some(0.25), Some(0.25), Some(5e-5)));
    }

    #[test]
    fn the_rows_of_the_steps_add_up_to_the_phase() {
        let step = |cycles, tasks| StepReport { steps: 1, cycles, tasks, issued: 7, ..StepReport::default() };
        let row = &phase_reports(&[costs(&[step(100, 3), step(50, 0)])], Some(CLOCK))[0];
        let cycles: u64 = row.by_step.iter().filter_map(|step| step.cycles).sum();
        let tasks: u64 = row.by_step.iter().map(|step| step.tasks).sum();
        assert_eq!((row.cycles, row.tasks, row.steps), (Some(cycles), tasks, row.by_step.len() as u64));
        assert_eq!((row.by_step[1].ms, row.by_step[1].instructions), (Some(25e-6), 7));
    }

    #[test]
    fn what_is_extrapolated_has_an_interval_and_what_is_timed_has_none() {
        let timed = StepReport { cycles: 1000, ..StepReport::default() };
        let sampled = StepReport { cycles_variance: 10_000, ..timed.clone() };
        // Errors that do not depend on one another: 1.96 * sqrt(2) * 100 cycles at 2 GHz.
        let rows = phase_reports(&[costs(&[sampled.clone(), sampled]), costs(&[timed])], Some(CLOCK));
        let [low, high] = rows[0].ms_interval.expect("an interval");
        let half = 1.96 * 2.0_f64.sqrt() * 100.0 / 2e6;
        assert!((low - (1e-3 - half)).abs() < 1e-12 && (high - (1e-3 + half)).abs() < 1e-12, "{low} {high}");
        assert_eq!(rows[1].ms_interval, None);
        let [low, high] = Total::of_phases(&rows, 2.0).ms_interval.expect("an interval");
        assert!((high - low - 2.0 * half).abs() < 1e-12);
    }

    #[test]
    fn without_a_clock_nothing_is_timed() {
        let rows = phase_reports(&[costs(&[PhaseCounters::default()])], None);
        assert_eq!((rows[0].cycles, rows[0].ipc, rows[0].l1d, rows[0].cycle_stack), (None, None, None, None));
    }

    #[test]
    fn a_phase_of_no_cycles_has_no_rates() {
        let rows = phase_reports(&[costs(&[PhaseCounters::default()])], Some(CLOCK));
        assert_eq!((rows[0].cycles, rows[0].ipc, rows[0].share), (Some(0), None, None));
    }
}
