//! The access ports of an L1, for all threads of its core together.

use crate::Cycle;

/// Cycles in a window at most: bits in a word of the host.
pub(crate) const WINDOW_MAX: Cycle = 64;

/// Ports at most.
pub(crate) const PORTS_MAX: usize = 4;

/// Which accesses the L1 has taken in each cycle of a window of at most [`WINDOW_MAX`].
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Ports {
    base: Cycle,
    /// A bit a cycle for each port.
    taken: [u64; PORTS_MAX],
    count: usize,
}

impl Ports {
    /// `count` accesses a cycle.
    pub(crate) fn new(count: u32) -> Ports {
        Ports { base: 0, taken: [0; PORTS_MAX], count: (count as usize).clamp(1, PORTS_MAX) }
    }

    /// Begins a window at `base`: nobody asks for a cycle before it again.
    #[inline(always)]
    pub(crate) fn begin(&mut self, base: Cycle) {
        self.base = base;
        self.taken = [0; PORTS_MAX];
    }

    /// When the window began.
    #[inline(always)]
    pub(crate) fn base(&self) -> Cycle {
        self.base
    }

    /// Takes a port in the cycle `now`, which lies in the window, if one is left.
    #[inline(always)]
    pub(crate) fn take_now(&mut self, now: Cycle) -> bool {
        let bit = 1 << ((now - self.base) & 63);
        let free = self.taken[0] & bit == 0;
        self.taken[0] |= bit;
        free || self.take_another(bit)
    }

    /// Takes a port behind the first in the cycle of `bit`, if one is left.
    #[inline(never)]
    fn take_another(&mut self, bit: u64) -> bool {
        let port = self.taken[1..self.count].iter_mut().find(|taken| **taken & bit == 0);
        port.map(|taken| *taken |= bit).is_some()
    }

    /// Takes a port in the first cycle from `now` on, before `end`, in which one is left; `None`, and nothing changed, when
    /// there is none.
    pub(crate) fn take(&mut self, now: Cycle, end: Cycle) -> Option<Cycle> {
        (now..end).find(|cycle| self.take_now(*cycle))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_cycle_serves_more_accesses_than_there_are_ports() {
        for count in 1..=PORTS_MAX as u32 {
            let mut ports = Ports::new(count);
            ports.begin(100);
            let served: Vec<Cycle> = (0..10 * count).filter_map(|_| ports.take(103, 109)).collect();
            let expected: Vec<Cycle> =
                (103..109).flat_map(|cycle| std::iter::repeat_n(cycle, count as usize)).collect();
            assert_eq!(served, expected);
            let full = ports.clone();
            assert_eq!(ports.take(103, 109), None);
            assert_eq!(ports, full, "a refused request changes nothing");
        }
    }
}
