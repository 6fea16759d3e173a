//! Handing the lines of one memory uop to the caches, one after the other.

use super::table::{Kind, Row};
use super::{CoreTables, State, Thread, When};
use crate::Cycle;
use crate::cache::Intent;
use crate::coherence::{Access, Hierarchy};
use crate::counters::Cause;

/// How far a memory uop has come.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Walk {
    /// The uop's place in the stream.
    uop: usize,
    row: Row,
    lines: u32,
    done: u32,
    issued: Cycle,
    /// When the next line is due.
    due: Cycle,
    /// When the last line so far was handed on.
    last: Cycle,
    ready: When,
    /// Latest time at which a line that missed arrives.
    missing: When,
}

impl Walk {
    pub(super) fn new(uop: usize, row: Row, lines: u32, now: Cycle) -> Walk {
        let nothing = When::new(0, Cause::Dependency);
        Walk {
            uop,
            row,
            lines,
            done: 0,
            issued: now,
            due: now,
            last: now,
            ready: When::new(now + row.latency(), Cause::L1),
            missing: nothing,
        }
    }

    pub(super) fn idle() -> Walk {
        Walk::new(0, Row::NONE, 0, 0)
    }
}

impl Thread {
    /// Hands on the lines of `walk` that are due until `until`. Returns when the thread may go on; its state says whether
    /// that is with the next line ([`State::Walking`]) or with the next uop.
    #[inline(always)]
    pub(super) fn advance_walk(
        &mut self,
        tables: &CoreTables,
        hierarchy: &mut Hierarchy,
        core: usize,
        mut walk: Walk,
        until: Cycle,
    ) -> When {
        let kind = walk.row.kind();
        let (data, interval_x256) = match kind {
            Kind::Gather(intent) => (Some(intent), tables.gather_interval_x256),
            Kind::GatherPrefetch => (None, tables.gather_interval_x256),
            Kind::Access(intent) | Kind::Spill(intent) => (Some(intent), 256),
            _ => (None, 256),
        };
        while walk.done < walk.lines {
            if walk.due > until {
                self.walk = walk;
                self.state = State::Walking;
                let full = walk.due > walk.last + 1 + (tables.gather_interval_x256 >> 8);
                return When::new(walk.due, if full { Cause::L1 } else { Cause::GatherLines });
            }
            let line = self.next_line(kind);
            let accessed = match data {
                Some(intent) => {
                    let next = self.stream.lines.get(self.line_pc + 1..self.line_pc + 3);
                    load_or_store(hierarchy, core, line, intent, walk.due, next)
                }
                None => special(hierarchy, tables, core, line, kind, walk.due),
            };
            match accessed {
                // All MSHRs taken: this line and those behind it wait.
                Err(retry) => {
                    debug_assert!(retry > walk.due);
                    walk.due = retry;
                }
                Ok(access) => {
                    self.line_pc += 1;
                    walk.done += 1;
                    walk.last = walk.due;
                    // A store is done for its thread when the line is there; nobody reads its result. Nothing waits for a
                    // prefetch.
                    if data.is_some() || kind == Kind::Atomic {
                        let ready = When::new(access.ready, access.cause);
                        walk.ready = walk.ready.max(ready);
                        if access.missed {
                            walk.missing = walk.missing.max(ready);
                        }
                    }
                    let spaced = walk.issued + ((u64::from(walk.done) * interval_x256) >> 8);
                    // After a wait for MSHRs the lines behind keep their distance.
                    walk.due = spaced.max(walk.last + (interval_x256 >> 8));
                }
            }
        }

        // All lines are handed on.
        self.state = State::Running;
        self.ready[walk.uop % 256] = walk.ready;
        let mut hold = When::new(walk.last, Cause::GatherLines);
        if matches!(kind, Kind::Gather(_) | Kind::GatherPrefetch) {
            hold = When::new(walk.last + 1 + tables.gather_overhead, Cause::GatherLines);
        } else if walk.last > walk.issued {
            hold = When::new(walk.last + 1, Cause::L1);
        }
        if tables.blocks_on_l1_miss {
            hold = hold.max(walk.missing);
        }
        if matches!(kind, Kind::Atomic) {
            hold = hold.max(walk.ready);
        }
        hold
    }
}

/// One line of a load, a store, a gather or a scatter; `next` come after it in the stream.
#[inline(always)]
fn load_or_store(
    hierarchy: &mut Hierarchy,
    core: usize,
    line: u32,
    intent: Intent,
    now: Cycle,
    next: Option<&[u32]>,
) -> Result<Access, Cycle> {
    let mut access = match hierarchy.l1_hit(core, line, intent != Intent::Read) {
        Ok(()) => hierarchy.hit(now),
        Err(slot) => {
            // Where one line misses the next often do: the host fetches what they will need while it works on this one.
            if let Some(&[one, two]) = next {
                hierarchy.prefetch(core, one);
                hierarchy.prefetch(core, two);
            }
            hierarchy.access_beyond_hit(core, line, slot, intent, now)?
        }
    };
    if intent != Intent::Read && !access.missed {
        // Into the store buffer: done at once.
        access.ready = now + 1;
    }
    Ok(access)
}

/// One line of any other memory uop.
#[inline(never)]
fn special(
    hierarchy: &mut Hierarchy,
    tables: &CoreTables,
    core: usize,
    line: u32,
    kind: Kind,
    now: Cycle,
) -> Result<Access, Cycle> {
    match kind {
        Kind::PrefetchL1 | Kind::GatherPrefetch => hierarchy.access(core, line, Intent::Read, now),
        Kind::PrefetchL2 => {
            hierarchy.prefetch_l2(core, line, now)?;
            Ok(Access { ready: now + 1, cause: Cause::L2, missed: false })
        }
        Kind::Atomic => {
            let access = locked(hierarchy, core, line, tables.atomic_cycles, tables.l1_hit_cycles, now)?;
            hierarchy.atomics.operations += 1;
            hierarchy.atomics.transfers += u64::from(access.missed);
            Ok(access)
        }
        Kind::Access(_) | Kind::Gather(_) | Kind::Spill(_) => unreachable!("loads and stores"),
        Kind::Compute | Kind::Branch => unreachable!("touches no line"),
    }
}

/// A locked operation: owns the line, then works on it alone.
#[inline(never)]
pub(crate) fn locked(
    hierarchy: &mut Hierarchy,
    core: usize,
    line: u32,
    atomic_cycles: Cycle,
    l1_hit_cycles: Cycle,
    now: Cycle,
) -> Result<Access, Cycle> {
    let access = hierarchy.access(core, line, Intent::Write, now)?;
    // The operation's latency contains the look-up of a hit.
    let start = if access.missed { access.ready } else { access.ready - l1_hit_cycles };
    let ready = hierarchy.caches[core].lock(line, start.max(now), atomic_cycles);
    Ok(Access { ready, cause: Cause::Atomic, missed: access.missed })
}
