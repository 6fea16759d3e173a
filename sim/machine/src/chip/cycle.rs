//! The `cycle` level, the reference: all cores advance together, one cycle at a time.
//!
//! Every request leaves its core at the cycle that is being simulated, and all take the same time to find out that they miss,
//! so shared resources are asked in global time order. Cycles in which no core can do anything are skipped: the event
//! queue is the cores' wake-up times.

use super::{NO_PROGRESS_CYCLES_MAX, Step, stuck};
use crate::Cycle;
use crate::coherence::Hierarchy;
use crate::core::{Core, CoreTables};

pub(super) fn run(
    cores: &mut [Box<Core>],
    tables: &CoreTables,
    hierarchy: &mut Hierarchy,
    step: &mut Step<'_>,
    start: Cycle,
) {
    let count = cores.len();
    let mut now = start;
    let mut turn = 0;
    while cores.iter().any(|core| core.running > 0) {
        let mut wake = Cycle::MAX;
        // Another core begins each cycle: requests of one cycle are served in that order.
        turn = if turn + 1 >= count { 0 } else { turn + 1 };
        for offset in 0..count {
            let index = if turn + offset >= count { turn + offset - count } else { turn + offset };
            let core = &mut cores[index];
            if core.wake <= now {
                while let Some(thread) = core.ended(now) {
                    step.feed(core, thread, hierarchy);
                }
                core.step(tables, hierarchy, now);
            }
            wake = wake.min(core.wake);
        }
        if wake.saturating_sub(now) > NO_PROGRESS_CYCLES_MAX && cores.iter().any(|core| core.running > 0) {
            stuck(cores, hierarchy, now);
        }
        now = wake;
    }
}
