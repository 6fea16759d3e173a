//! Uops that wait for the uncore: the targets of MSHRs.
//!
//! A core learns when a line arrives only after its window, so a uop that misses has no time for its result yet. It is noted
//! here, line by line, and gets its time when the last of its lines has one.

use crate::Cycle;
use crate::cache::{Access, CoreCaches};
use crate::counters::Cause;
use crate::when::When;

/// Whom the result is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Waiter {
    /// The uop at `place` of the stream that its thread began as its `generation`-th.
    Uop { place: usize, generation: u32 },
    /// The thread itself, which has asked for tasks.
    Pull,
}

/// A uop, or a pull, some of whose lines have no time yet.
#[derive(Debug, Clone, Copy)]
pub(super) struct Waiting {
    pub(super) thread: u8,
    pub(super) waiter: Waiter,
    /// When the lines that have a time are there.
    pub(super) ready: When,
    /// Until when the uop holds its thread at least; it holds it until its lines are there too if `holds`.
    pub(super) hold: When,
    pub(super) holds: bool,
    /// Whether all its lines have been handed to the L1.
    pub(super) handed_on: bool,
    unanswered: u16,
}

/// A line that one of them waits for.
#[derive(Debug, Clone, Copy)]
struct Target {
    mshr: u16,
    waiting: WaitingId,
    not_before: Cycle,
    /// The line, for a locked operation, which begins when it is there.
    locks: Option<u32>,
}

/// All of a core.
#[derive(Debug, Clone, Default)]
pub(super) struct WaitList {
    /// Some are free: see `free`.
    waiting: Vec<Waiting>,
    free: Vec<WaitingId>,
    targets: Vec<Target>,
}

/// Names a [`Waiting`] of a list.
pub(super) type WaitingId = u32;

impl WaitList {
    /// Notes a uop or a pull of `thread` that has lines without a time.
    pub(super) fn add(&mut self, thread: u8, waiter: Waiter) -> WaitingId {
        let nothing = When::new(0, Cause::Dependency);
        let new = Waiting {
            thread,
            waiter,
            ready: nothing,
            hold: nothing,
            holds: false,
            handed_on: false,
            unanswered: 0,
        };
        match self.free.pop() {
            Some(id) => {
                self.waiting[id as usize] = new;
                id
            }
            None => {
                self.waiting.push(new);
                (self.waiting.len() - 1) as WaitingId
            }
        }
    }

    pub(super) fn get(&mut self, id: WaitingId) -> &mut Waiting {
        &mut self.waiting[id as usize]
    }

    /// Has `id` wait for the line of `access`, and lock it if `locks`.
    pub(super) fn wait_for(&mut self, id: WaitingId, access: Access, locks: Option<u32>) {
        self.get(id).unanswered += 1;
        let Access { mshr, not_before, .. } = access;
        self.targets.push(Target { mshr, waiting: id, not_before, locks });
    }

    /// All lines of `id` have been handed on. Returns it, and forgets it, if all of them have a time.
    pub(super) fn hand_on(&mut self, id: WaitingId) -> Option<Waiting> {
        let waiting = self.get(id);
        waiting.handed_on = true;
        let waiting = *waiting;
        (waiting.unanswered == 0).then(|| {
            self.free.push(id);
            waiting
        })
    }

    /// Whether anybody waits.
    pub(super) fn is_empty(&self) -> bool {
        self.targets.is_empty()
    }

    /// Gives their times to all whose lines have got them; calls `done` with those that wait for nothing more.
    pub(super) fn resolve(
        &mut self,
        caches: &mut CoreCaches,
        atomic_cycles: Cycle,
        floor: Cycle,
        mut done: impl FnMut(Waiting),
    ) {
        let WaitList { waiting, free, targets } = self;
        targets.retain(|target| {
            let fill = caches.l2_mshrs.fill(target.mshr.into());
            if fill == When::NEVER {
                return true;
            }
            let mut ready = fill.not_before(target.not_before);
            if let Some(line) = target.locks {
                ready = When::new(caches.locks.lock(line, ready.at(), atomic_cycles, floor), Cause::Atomic);
            }
            let waits = &mut waiting[target.waiting as usize];
            waits.ready = waits.ready.max(ready);
            waits.unanswered -= 1;
            if waits.unanswered == 0 && waits.handed_on {
                free.push(target.waiting);
                done(*waits);
            }
            false
        });
    }
}
