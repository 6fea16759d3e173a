//! Lines that locked operations of a core work on.

use crate::Cycle;

/// Locks that are kept before those that have ended are dropped.
const KEPT: usize = 16;

/// When the last locked operation on each line ends.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Locks {
    held: Vec<(u32, Cycle)>,
    /// A defect to be seeded: nobody waits for anybody.
    #[cfg(test)]
    pub(crate) none: bool,
}

impl Locks {
    /// Holds `line`, which the core owns, for a locked operation of so many `cycles` that may start at `now`; returns when it
    /// ends. Locks that ended by `floor` are of no interest any more.
    pub(crate) fn lock(&mut self, line: u32, now: Cycle, cycles: Cycle, floor: Cycle) -> Cycle {
        #[cfg(test)]
        if self.none {
            return now + cycles;
        }
        if let Some(lock) = self.held.iter_mut().find(|lock| lock.0 == line) {
            lock.1 = lock.1.max(now) + cycles;
            return lock.1;
        }
        if self.held.len() >= KEPT {
            self.held.retain(|lock| lock.1 > floor);
        }
        self.held.push((line, now + cycles));
        now + cycles
    }

    /// When `line` can be given away, if it is wanted at `now`.
    pub(crate) fn free(&self, line: u32, now: Cycle) -> Cycle {
        self.held.iter().find(|lock| lock.0 == line).map_or(now, |lock| lock.1.max(now))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn locks_of_one_line_follow_one_another_and_others_do_not_wait() {
        let mut locks = Locks::default();
        assert_eq!(locks.lock(8, 100, 5, 0), 105);
        assert_eq!(locks.lock(8, 101, 5, 0), 110);
        // Lines that agree modulo a power of two are other lines.
        assert_eq!(locks.lock(16, 101, 5, 0), 106);
        assert_eq!((locks.free(8, 50), locks.free(8, 120), locks.free(9, 50)), (110, 120, 50));
    }

    #[test]
    fn only_locks_that_have_ended_are_dropped() {
        let mut locks = Locks::default();
        locks.lock(7, 1_000, 5, 0);
        for line in 100..200 {
            locks.lock(line, 10, 5, 500);
        }
        assert_eq!(locks.free(7, 0), 1_005);
        assert!(locks.held.len() <= KEPT + 1);
    }
}
