//! The `windowed` level: cores run in turn, each for a window. That is far below the length of a task, so that cores early
//! in the order do not take all tasks, and of the order of a transaction, so that a line's transactions are served nearly
//! in order.

use super::{NO_PROGRESS_CYCLES_MAX, Step, stuck};
use crate::Cycle;
use crate::coherence::Hierarchy;
use crate::core::{Core, CoreTables, WINDOW, Window};

pub(super) fn run(
    cores: &mut [Box<Core>],
    tables: &CoreTables,
    hierarchy: &mut Hierarchy,
    step: &mut Step<'_>,
    start: Cycle,
) {
    let count = cores.len();
    let mut turn = 0;
    let mut base = start;
    loop {
        if cores.iter().all(|core| core.running == 0) {
            return;
        }
        // Skip the time in which nobody can do anything.
        let wake = cores.iter().map(|core| core.wake).min().unwrap_or(Cycle::MAX);
        if wake.saturating_sub(base) > NO_PROGRESS_CYCLES_MAX {
            stuck(cores, hierarchy, base);
        }
        base = base.max(start + (wake - start) / WINDOW * WINDOW);
        let end = base + WINDOW;
        // Another core begins each time: the first has the pick of tasks and slots.
        turn = if turn + 1 >= count { 0 } else { turn + 1 };
        for offset in 0..count {
            let index = if turn + offset >= count { turn + offset - count } else { turn + offset };
            let core = &mut cores[index];
            if core.wake < end {
                let mut window = Window::new(base);
                while let Some(thread) = core.run_window(tables, hierarchy, &mut window) {
                    step.feed(core, thread, hierarchy);
                }
            }
        }
        base = end;
    }
}
