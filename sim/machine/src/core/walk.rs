//! Handing the lines of one memory uop to the caches, one after the other.

use super::table::{Kind, Row};
use super::{CoreTables, State, Thread};
use crate::Cycle;
use crate::cache::Intent;
use crate::coherence::{Access, Hierarchy};
use crate::counters::Cause;
use crate::when::When;
use lrbsim_isa::arena::{STACK_BASE_LINE, STACK_LINES};

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
    /// Of the uop at place `uop`, issued at `now`; the first of its lines is handed on at `due`.
    pub(super) fn new(uop: usize, row: Row, lines: u32, now: Cycle, due: Cycle) -> Walk {
        let nothing = When::new(0, Cause::Dependency);
        Walk {
            uop,
            row,
            lines,
            done: 0,
            issued: now,
            due,
            last: now,
            ready: When::bare(now).plus(row.latency()),
            missing: nothing,
        }
    }

    pub(super) fn idle() -> Walk {
        Walk::new(0, Row::NONE, 0, 0, 0)
    }
}

impl Thread {
    /// Hands on the lines of `walk` that are due: all, or if `STEPWISE` those until `until`. Returns when the thread may go
    /// on; its state says whether that is with the next line ([`State::Walking`]) or with the next uop.
    #[inline(never)]
    pub(super) fn advance_walk<const STEPWISE: bool>(
        &mut self,
        tables: &CoreTables,
        hierarchy: &mut Hierarchy,
        core: usize,
        walk: Walk,
        until: Cycle,
    ) -> When {
        let kind = walk.row.kind();
        let gathers = matches!(kind, Kind::Gather(_) | Kind::GatherPrefetch);
        let interval = if gathers { tables.gather_interval_x256 } else { 256 };
        match kind {
            Kind::Gather(intent) | Kind::Access(intent) => {
                self.hand_on::<STEPWISE>(tables, hierarchy, walk, until, interval, |hierarchy, lines, now| {
                    load_or_store(hierarchy, core, lines, intent, now)
                })
            }
            Kind::Spill(intent) => {
                let stack = STACK_BASE_LINE + self.number * STACK_LINES;
                self.hand_on::<STEPWISE>(tables, hierarchy, walk, until, interval, |hierarchy, lines, now| {
                    load_or_store(hierarchy, core, &[stack + lines[0] % STACK_LINES], intent, now)
                })
            }
            _ => {
                self.hand_on::<STEPWISE>(tables, hierarchy, walk, until, interval, |hierarchy, lines, now| {
                    special(hierarchy, tables, core, lines[0], kind, now)
                })
            }
        }
    }

    /// The same for a kind of uop. `access` is called with what is left of the stream's lines; it hands on the first.
    #[inline(always)]
    fn hand_on<const STEPWISE: bool>(
        &mut self,
        tables: &CoreTables,
        hierarchy: &mut Hierarchy,
        mut walk: Walk,
        until: Cycle,
        interval_x256: u64,
        access: impl Fn(&mut Hierarchy, &[u32], Cycle) -> Result<Access, Cycle>,
    ) -> When {
        let kind = walk.row.kind();
        while walk.done < walk.lines {
            if STEPWISE && walk.due > until {
                self.walk = walk;
                self.state = State::Walking;
                let full = walk.due > walk.last + 1 + (tables.gather_interval_x256 >> 8);
                return When::new(walk.due, if full { Cause::L1 } else { Cause::GatherLines });
            }
            match access(hierarchy, &self.stream.lines[self.line_pc..], walk.due) {
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
                    if !kind.is_prefetch() {
                        walk.ready = walk.ready.max(access.ready);
                        if access.missed {
                            walk.missing = walk.missing.max(access.ready);
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

/// The first of the `lines` left of the stream, for a load, a store, a gather or a scatter.
#[inline(always)]
pub(super) fn load_or_store(
    hierarchy: &mut Hierarchy,
    core: usize,
    lines: &[u32],
    intent: Intent,
    now: Cycle,
) -> Result<Access, Cycle> {
    let line = lines[0];
    let mut access = match hierarchy.l1_hit(core, line, intent != Intent::Read) {
        Ok(()) => hierarchy.hit(now),
        Err(slot) => {
            // Where one line misses those behind it often do: the host fetches what they will need meanwhile.
            if let Some(later) = lines.get(2)
                && slot.is_none()
            {
                hierarchy.prefetch(core, *later);
            }
            hierarchy.access_beyond_hit(core, line, slot, intent, now)?
        }
    };
    if intent != Intent::Read && !access.missed {
        // Into the store buffer: done at once.
        access.ready = When::new(now + 1, Cause::L1);
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
            Ok(Access { ready: When::new(now + 1, Cause::L2), missed: false })
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
    let start = if access.missed { access.ready.at() } else { access.ready.at() - l1_hit_cycles };
    let ready = hierarchy.caches[core].lock(line, start.max(now), atomic_cycles);
    Ok(Access { ready: When::new(ready, Cause::Atomic), missed: access.missed })
}
