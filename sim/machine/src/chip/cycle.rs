//! The `cycle` level, the reference: all cores and the uncore advance together, one cycle at a time.
//!
//! Every request leaves its core in the cycle that is being simulated, every leg of its transaction is done in the cycle in
//! which it is due, and its answer wakes the core in the cycle in which it arrives: each shared resource is asked in the
//! order of time. Cycles in which nothing can happen are skipped.

use super::cores::AsPeers;
use super::stuck::Watch;
use super::{Parts, Stuck};
use crate::Cycle;
use crate::exchange::Message;
use crate::observer::Observer;
use crate::work::{Work, doing};

/// Runs a step that begins at `start`, whose threads have asked for their first tasks.
pub(super) fn run<O: Observer>(parts: &mut Parts<'_, '_, O>, start: Cycle) -> Result<(), Stuck> {
    let mut watch = Watch::default();
    // No cycle is simulated twice.
    let mut next = start;
    loop {
        // What the cores have asked for so far leaves them, in the order of time, core and number.
        leave(parts, next);
        let (running, wake) = parts.cores.outlook();
        if running == 0 {
            return Ok(());
        }
        let soonest = wake.min(parts.uncore.next_due());
        watch.look(parts, next, soonest)?;
        let now = soonest.max(next);
        next = now + 1;

        let Parts { cores, tables, uncore, .. } = parts;
        {
            let _work = doing(Work::Uncore);
            uncore.run_until(now, &mut AsPeers { cores, tables });
        }
        let _work = doing(Work::Issue);
        cores.each_active(|core| core.run_cycle(tables, now));
    }
}

/// Hands the requests and pulls of all cores to the uncore, which answers for the cycle `next` at the earliest.
fn leave<O: Observer>(parts: &mut Parts<'_, '_, O>, next: Cycle) {
    let _work = doing(Work::Uncore);
    for index in 0..parts.cores.active() {
        let core = parts.cores.core(index);
        for request in core.shared.caches.outbox.drain(..) {
            parts.uncore.accept(index as u32, &request);
        }
        parts.step.take_back(&mut core.shared.spent);
    }
    // Threads that ask in one cycle: the first of every core, then the second.
    let mut pulls = std::mem::take(&mut parts.pulls);
    parts.cores.each_active(|core| {
        pulls.extend(core.shared.pulls.drain(..).map(|pull| (pull.time, pull.thread, core.index)));
    });
    pulls.sort_unstable();
    for (asked, thread, core) in pulls.drain(..) {
        let (chunk, streams) = parts.step.next_chunk(parts.hands);
        parts.observer.tasks(core, thread, chunk, asked, next);
        let core = parts.cores.core(core);
        core.tell(Message::Tasks { thread, streams, from: next });
        core.read_inbox(parts.tables, next, next);
    }
    parts.pulls = pulls;
}
