//! All cores of a chip, as the uncore reaches them.

use crate::Cycle;
use crate::coherence::{Peers, State};
use crate::core::{Core, CoreTables};
use crate::exchange::Message;

/// The cores that one host thread runs; `None` until a core's first task.
pub(super) type Group = Vec<Option<Box<Core>>>;

/// All cores, dealt to as many groups as host threads run them: core `i` is in group `i mod groups`.
pub(super) struct Cores {
    groups: Vec<Group>,
    count: usize,
    /// Cores that take part in the step: the first so many.
    active: usize,
}

impl Cores {
    pub(super) fn new(count: usize, groups: usize) -> Cores {
        let size = |group: usize| (count + groups - 1 - group) / groups;
        Cores {
            groups: (0..groups).map(|group| (0..size(group)).map(|_| None).collect()).collect(),
            count,
            active: 0,
        }
    }

    pub(super) fn len(&self) -> usize {
        self.count
    }

    pub(super) fn active(&self) -> usize {
        self.active
    }

    /// The first `count` cores take part in the next step.
    pub(super) fn set_active(&mut self, count: usize) {
        self.active = count;
    }

    /// The groups, to be lent to host threads.
    pub(super) fn groups(&mut self) -> &mut [Group] {
        &mut self.groups
    }

    #[inline(always)]
    pub(super) fn slot(&mut self, core: usize) -> &mut Option<Box<Core>> {
        let groups = self.groups.len();
        if groups == 1 { &mut self.groups[0][core] } else { &mut self.groups[core % groups][core / groups] }
    }

    #[inline(always)]
    fn get(&self, core: usize) -> Option<&Core> {
        let groups = self.groups.len();
        let slot =
            if groups == 1 { &self.groups[0][core] } else { &self.groups[core % groups][core / groups] };
        slot.as_deref()
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
        for core in 0..self.count {
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
    fn state(&self, core: u32, line: u32) -> State {
        self.cores.get(core as usize).map_or(State::I, |core| core.shared.caches.state_of(line))
    }

    #[inline(always)]
    fn unlocked(&self, core: u32, line: u32, now: Cycle) -> Cycle {
        self.cores.get(core as usize).map_or(now, |core| core.shared.caches.locks.free(line, now))
    }

    #[inline(always)]
    fn tell(&mut self, core: u32, message: Message) {
        let takes_part = (core as usize) < self.cores.active;
        let Some(core) = self.cores.slot(core as usize) else { return };
        core.tell(message);
        if !takes_part {
            // It does not run: there is no reason to wait.
            core.read_inbox(self.tables, 0);
            core.shared.caches.grant_claims(Cycle::MAX);
        }
    }
}
