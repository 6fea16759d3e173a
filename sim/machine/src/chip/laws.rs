//! Laws that hold in every step of every run: nothing is lost, and no resource beats its peak.

use crate::Cycle;
use crate::coherence::Uncore;
use crate::config::MachineSpec;
use crate::counters::StepReport;

/// Work of the shared resources that is taken on at the end of a step, and done after it.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Carried {
    line_times: u64,
    slot_hops: u64,
    transactions: u64,
}

/// Checks the report of a step that ended at `end`, before which `carried` had been taken on. Returns what it leaves.
///
/// # Panics
/// When a law is broken: a defect of the simulator.
pub(super) fn check(
    report: &StepReport,
    spec: &MachineSpec,
    uncore: &mut Uncore,
    end: Cycle,
    carried: Carried,
) -> Carried {
    let cycles = report.cycles;
    let cores = u64::from(spec.cores);
    let left = Carried {
        line_times: uncore.memory.line_times_from(end),
        slot_hops: uncore.rings.slot_hops_from(end),
        transactions: uncore.transactions_from(end),
    };
    assert_eq!(
        report.cycle_stack.total(),
        cores * cycles,
        "Chip, cycle {end}: the causes of the cycle stack do not add up to cores x cycles: {:?}",
        report.cycle_stack
    );
    let recorded: u64 = report.class_counts.iter().sum();
    assert_eq!(report.issued, recorded, "Chip, cycle {end}: uops issued and uops recorded differ");

    let at_most = |what: &str, done: u64, peak: u64| {
        assert!(done <= peak, "Chip, cycle {end}: {what}: {done} in {cycles} cycles, and {peak} is the peak");
    };
    at_most("uops issued", report.issued, 2 * cores * cycles);
    if !spec.ideal.memory {
        // The task counter is read past the ports.
        let accesses = report.l1d.accesses - report.atomics.task_pulls.min(report.l1d.accesses);
        let ports = u64::from(spec.core.l1_accesses_per_cycle);
        at_most("Core.L1d accesses", accesses, ports * cores * cycles);
    }
    let done = |asked: u64, before: u64, after: u64| (asked + before).saturating_sub(after);
    at_most(
        "Memory line times",
        done(uncore.memory.take_line_times(), carried.line_times, left.line_times),
        uncore.memory.peak_lines(cycles),
    );
    if !spec.ring.free {
        at_most(
            "Rings link-slots",
            done(report.ring.slot_hops, carried.slot_hops, left.slot_hops),
            uncore.rings.peak_slot_hops(cycles),
        );
    }
    at_most(
        "Directory transactions",
        done(report.directory.transactions, carried.transactions, left.transactions),
        cores * (cycles / spec.directory_interval.max(1) + 2),
    );
    left
}
