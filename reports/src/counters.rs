//! From the counters of the machine to a row of the report.

use std::collections::BTreeMap;

use lrbsim_isa::{Class, Phase};
use lrbsim_machine::PhaseCounters;

use crate::run::{Instructions, Lanes, PhaseReport, milliseconds, ratio};

/// The machine side of a timed run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Clock {
    /// Core clock.
    pub clock_ghz: f64,
    /// Cores of the machine, busy or not.
    pub cores: u32,
}

/// The rows of a report, with shares of the whole frame. `clock` is `None` when nothing was timed.
pub fn phase_reports(phases: &[(&Phase, PhaseCounters)], clock: Option<Clock>) -> Vec<PhaseReport> {
    let frame_cycles: u64 = phases.iter().map(|(_, counters)| counters.cycles).sum();
    phases.iter().map(|(phase, counters)| phase_report(phase, counters, clock, frame_cycles)).collect()
}

fn phase_report(
    phase: &Phase,
    counters: &PhaseCounters,
    clock: Option<Clock>,
    frame_cycles: u64,
) -> PhaseReport {
    let cycles = counters.cycles;
    let instructions = instructions(&counters.class_counts);
    PhaseReport {
        id: phase.id.to_owned(),
        title: phase.title.to_owned(),
        in_paper_total: phase.in_paper_total,
        steps: counters.steps,
        tasks: counters.tasks,
        cycles: clock.map(|_| cycles),
        ms: clock.map(|clock| milliseconds(cycles, clock.clock_ghz)),
        share: clock.and_then(|_| ratio(cycles, frame_cycles)),
        ipc: clock.and_then(|clock| ratio(instructions.total, cycles * u64::from(clock.cores))),
        instructions,
        lanes: Lanes { active: counters.lanes_active, masked: counters.lanes_masked },
        paired_core_cycles: clock.map(|_| counters.paired),
        core_busy_cycles: None,
        cycle_stack: clock.map(|_| counters.cycle_stack),
        l1d: clock.map(|_| counters.l1d),
        l2: clock.map(|_| counters.l2),
        ring: clock.map(|_| counters.ring),
        directory: clock.map(|_| counters.directory),
        memory: clock.map(|_| counters.memory),
        atomics: clock.map(|_| counters.atomics),
    }
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

    #[test]
    fn rates_are_over_all_cores_and_the_whole_frame() {
        let mut counters = PhaseCounters { cycles: 100, ..PhaseCounters::default() };
        counters.class_counts[Class::VectorFma as usize] = 50;
        let other = PhaseCounters { cycles: 300, ..PhaseCounters::default() };
        let rows = phase_reports(&[(&PHASE, counters), (&PHASE, other)], Some(CLOCK));
        assert_eq!((rows[0].ipc, rows[0].share, rows[0].ms), (Some(0.25), Some(0.25), Some(5e-5)));
    }

    #[test]
    fn without_a_clock_nothing_is_timed() {
        let rows = phase_reports(&[(&PHASE, PhaseCounters::default())], None);
        assert_eq!((rows[0].cycles, rows[0].ipc, rows[0].l1d, rows[0].cycle_stack), (None, None, None, None));
    }

    #[test]
    fn a_phase_of_no_cycles_has_no_rates() {
        let rows = phase_reports(&[(&PHASE, PhaseCounters::default())], Some(CLOCK));
        assert_eq!((rows[0].cycles, rows[0].ipc, rows[0].share), (Some(0), None, None));
    }
}
