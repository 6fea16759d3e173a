//! All cores of a chip, as the uncore reaches them.

use crate::Cycle;
use crate::coherence::{Peers, State};
use crate::core::{Core, CoreTables};
use crate::exchange::Message;
use std::sync::{Mutex, PoisonError};

/// The place of a core; `None` until its first task. Host threads that run cores side by side lock them; who has them all to
/// itself need not.
pub(super) type Slot = Mutex<Option<Box<Core>>>;

/// All cores.
pub(super) struct Cores {
    slots: Vec<Slot>,
    /// Cores that take part in the step: the first so many.
    active: usize,
}

impl Cores {
    pub(super) fn new(count: usize) -> Cores {
        Cores { slots: (0..count).map(|_| Slot::default()).collect(), active: 0 }
    }

    pub(super) fn len(&self) -> usize {
        self.slots.len()
    }

    pub(super) fn active(&self) -> usize {
        self.active
    }

    /// The first `count` cores take part in the next step.
    pub(super) fn set_active(&mut self, count: usize) {
        self.active = count;
    }

    /// The places of all cores, to be lent to host threads.
    pub(super) fn slots(&mut self) -> &mut Vec<Slot> {
        &mut self.slots
    }

    #[inline(always)]
    pub(super) fn slot(&mut self, core: usize) -> &mut Option<Box<Core>> {
        self.slots[core].get_mut().unwrap_or_else(PoisonError::into_inner)
    }

    /// A core that takes part in the step.
    #[inline(always)]
    pub(super) fn core(&mut self, core: usize) -> &mut Core {
        self.slot(core).as_mut().expect("a core that takes part exists")
    }

    /// Calls `f` with every core that takes part in the step, in order.
    #[inline(always)]
    pub(super) fn each_active(&mut self, mut f: impl FnMut(&mut Core)) {
        for core in 0..self.active {
            f(self.core(core));
        }
    }

    /// Calls `f` with every core that has ever run, in order.
    pub(super) fn each(&mut self, mut f: impl FnMut(&mut Core)) {
        for core in 0..self.len() {
            if let Some(core) = self.slot(core) {
                f(core);
            }
        }
    }

    /// Threads of all cores that still have or may still get a task, and when the first thread acts.
    #[inline(always)]
    pub(super) fn outlook(&mut self) -> (u32, Cycle) {
        let (mut running, mut wake) = (0, Cycle::MAX);
        self.each_active(|core| {
            running += core.running;
            wake = wake.min(core.wake);
        });
        (running, wake)
    }
}

/// The cores as peers of a transaction.
pub(super) struct AsPeers<'a> {
    pub(super) cores: &'a mut Cores,
    pub(super) tables: &'a CoreTables,
}

impl Peers for AsPeers<'_> {
    fn state(&mut self, core: u32, line: u32) -> State {
        self.cores.slot(core as usize).as_ref().map_or(State::I, |core| core.shared.caches.state_of(line))
    }

    #[inline(always)]
    fn unlocked(&mut self, core: u32, line: u32, now: Cycle) -> Cycle {
        self.cores.slot(core as usize).as_ref().map_or(now, |core| core.shared.caches.locks.free(line, now))
    }

    #[inline(always)]
    fn tell(&mut self, core: u32, message: Message) {
        let takes_part = (core as usize) < self.cores.active;
        let Some(core) = self.cores.slot(core as usize) else { return };
        core.tell(message);
        if !takes_part {
            // It does not run: there is no reason to wait.
            core.read_inbox(self.tables, 0, Cycle::MAX);
        }
    }
}
