//! A run in which nothing moves any more.

use super::Parts;
use crate::Cycle;
use crate::core::State;
use std::fmt;

/// Turns of the simulation, not cycles, without progress after which a step is given up: a machine may be as slow as it likes,
/// but every few turns somebody issues a uop, hands on a line or gets an answer.
const TURNS_MAX: u32 = 100_000;

/// Threads that a message names at most.
const NAMED_MAX: usize = 8;

/// A step in which nothing moves: a defect of the simulator, which ends this run and no other.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Stuck {
    /// The cycle from which nothing moved.
    pub cycle: Cycle,
    /// Who waits for whom: a line a thread, as many as fit in a message.
    pub waits: Vec<String>,
    /// Threads that wait beside those named.
    pub others: usize,
}

impl std::error::Error for Stuck {}

impl fmt::Display for Stuck {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "nothing moves on the simulated chip from cycle {} on", self.cycle)?;
        for wait in &self.waits {
            write!(f, "; {wait}")?;
        }
        if self.others > 0 {
            write!(f, "; and {} more threads", self.others)?;
        }
        Ok(())
    }
}

/// Looks for progress.
#[derive(Debug, Default)]
pub(super) struct Watch {
    turns: u32,
    moved: u64,
}

impl Watch {
    /// A turn at `now`; the next thing happens at `next`, [`Cycle::MAX`] and the like when nothing will.
    #[inline(always)]
    pub(super) fn look<O>(
        &mut self,
        parts: &mut Parts<'_, '_, O>,
        now: Cycle,
        next: Cycle,
    ) -> Result<(), Stuck> {
        self.turns += 1;
        if next < crate::when::When::NEVER.at() && self.turns < TURNS_MAX {
            return Ok(());
        }
        self.look_closely(parts, now, next)
    }

    #[cold]
    fn look_closely<O>(
        &mut self,
        parts: &mut Parts<'_, '_, O>,
        now: Cycle,
        next: Cycle,
    ) -> Result<(), Stuck> {
        let mut moved = parts.uncore.counters.transactions;
        parts.cores.each_active(|core| moved += core.progress());
        let never = next >= crate::when::When::NEVER.at();
        if never || moved == self.moved {
            return Err(stuck(parts, now));
        }
        *self = Watch { turns: 0, moved };
        Ok(())
    }
}

/// Says who waits for whom.
fn stuck<O>(parts: &mut Parts<'_, '_, O>, now: Cycle) -> Stuck {
    let (mut waits, mut others) = (Vec::new(), 0);
    parts.cores.each_active(|core| {
        for (number, thread) in core.threads.iter().enumerate() {
            if thread.state == State::Done {
                continue;
            }
            if waits.len() == NAMED_MAX {
                others += 1;
                continue;
            }
            let (at, of) = thread.progress();
            let caches = &core.shared.caches;
            let asked = caches.l2_mshrs.occupied(now);
            let what = match thread.state {
                State::Asking => "waits for tasks".to_owned(),
                State::Walking => "waits for an MSHR or a port of its L1".to_owned(),
                _ => format!("is at uop {at} of {of}"),
            };
            let lines: Vec<String> = asked.iter().take(3).map(|(line, _)| line.to_string()).collect();
            let for_lines = if lines.is_empty() {
                "has all MSHRs of its L2 free".to_owned()
            } else {
                format!("has MSHRs of its L2 taken by {} lines: {}", asked.len(), lines.join(", "))
            };
            waits.push(format!("Chip.Core[{}].Thread[{number}] {what}, its core {for_lines}", core.index));
        }
    });
    Stuck { cycle: now, waits, others }
}
