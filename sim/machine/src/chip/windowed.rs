//! The `windowed` level: cores run alone for a window; then the uncore serves what they asked for.
//!
//! A window is no longer than the shortest time in which anything outside a core can answer it
//! ([`Uncore::answer_cycles_min`](crate::coherence::Uncore::answer_cycles_min)): whatever a core asks for in a window, the
//! answer lies behind its end. So cores need not know of one another while they run, any host thread may run any of them, and
//! the result is the same. Requests are served in the order of time, core and number, each transaction whole but for its
//! write-backs, which wait until they are due; a peer's claim is seen half a window early or late at most.

use super::cores::AsPeers;
use super::stuck::Watch;
use super::{Parts, Stuck};
use crate::Cycle;
use crate::cache::WINDOW_MAX;
use crate::exchange::Message;
use crate::observer::Observer;
use crate::work::{Work, doing};

/// Runs a step that begins at `start`, whose threads have asked for their first tasks.
pub(super) fn run<O: Observer>(parts: &mut Parts<'_, '_, O>, start: Cycle) -> Result<(), Stuck> {
    let window = parts.uncore.answer_cycles_min().clamp(1, WINDOW_MAX);
    let mut watch = Watch::default();
    serve(parts, start, start);
    let mut base = start;
    loop {
        let (running, wake) = parts.cores.outlook();
        if running == 0 {
            break;
        }
        let soonest = wake.min(parts.uncore.next_due());
        watch.look(parts, base, soonest)?;
        // Skip the time in which nobody can do anything.
        base = base.max(soonest);
        let end = base + window;
        parts.hands.run_window(parts.cores, parts.tables, base, end);
        serve(parts, base, end);
        base = end;
    }
    let Parts { cores, tables, .. } = parts;
    cores.each_active(|core| core.read_inbox(tables, base, Cycle::MAX));
    Ok(())
}

/// Serves what the cores asked for in the window from `base` to `end`.
fn serve<O: Observer>(parts: &mut Parts<'_, '_, O>, base: Cycle, end: Cycle) {
    let _work = doing(Work::Uncore);
    let Parts { observer, cores, tables, uncore, step, hands, order, pulls } = parts;
    // In the order of time, core and number.
    for index in 0..cores.active() {
        let core = cores.core(index);
        for (number, request) in core.shared.caches.outbox.iter().enumerate() {
            uncore.prefetch(request);
            order.push((request.time - base) << 48 | (index as u64) << 24 | number as u64);
        }
        if !core.shared.pulls.is_empty() {
            pulls.extend(core.shared.pulls.drain(..).map(|pull| (pull.time, pull.thread, index)));
        }
        step.take_back(&mut core.shared.spent);
    }
    order.sort_unstable();
    let mut peers = AsPeers { cores, tables };
    for key in order.drain(..) {
        let (core, number) = ((key >> 24 & 0xff_ffff) as usize, (key & 0xff_ffff) as usize);
        let request = peers.cores.core(core).shared.caches.outbox[number];
        uncore.serve(core as u32, &request, base, &mut peers);
    }
    // Who waits for what is written back in the next window has to know before it begins.
    uncore.write_back_until(end + (end - base), base, &mut peers);
    cores.each_active(|core| core.shared.caches.outbox.clear());

    // Threads that asked in one cycle: the first of every core, then the second. None begins in a window that has passed.
    pulls.sort_unstable();
    for (asked, thread, core) in pulls.drain(..) {
        let (chunk, streams) = step.next_chunk(*hands);
        observer.tasks(core, thread, chunk, asked, end);
        cores.core(core).tell(Message::Tasks { thread, streams, from: end });
    }
}
