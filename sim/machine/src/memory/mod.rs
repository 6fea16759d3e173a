//! The memory controllers: channels, banks and open rows.
//!
//! Line `l` belongs to controller `l mod controllers`; there, consecutive lines fill a row, and consecutive rows go round
//! the banks (mixed with higher bits, so that power-of-two strides do not meet in one bank). An access waits for its bank
//! to be able to open a row, if it has to, and then for the channel. Writes take the same slots, but nobody waits for them.

#[cfg(test)]
mod tests;

use crate::Cycle;
use crate::config::MemorySpec;
use crate::counters::MemoryCounters;
use crate::division::Divisor;
use crate::occupancy::Slots;
use lrbsim_isa::arena::LINE_BYTES;

#[derive(Debug)]
struct Bank {
    open_row: u32,
    openings: Slots,
}

#[derive(Debug)]
struct Controller {
    channel: Slots,
    banks: Vec<Bank>,
}

/// All controllers.
#[derive(Debug)]
pub(crate) struct Memory {
    row_miss_cycles: Cycle,
    row_hit_cycles: Cycle,
    row_lines: Divisor,
    banks: Divisor,
    controller_count: Divisor,
    controllers: Vec<Controller>,
    pub(crate) counters: MemoryCounters,
}

impl Memory {
    pub(crate) fn new(spec: &MemorySpec) -> Memory {
        let bank = || Bank { open_row: u32::MAX, openings: Slots::new(spec.row_cycle_cycles * 256) };
        let controller = || Controller {
            channel: Slots::new(spec.line_interval_x256),
            banks: (0..spec.banks).map(|_| bank()).collect(),
        };
        Memory {
            row_miss_cycles: spec.row_miss_cycles,
            row_hit_cycles: spec.row_hit_cycles,
            row_lines: Divisor::new(spec.row_lines.into()),
            banks: Divisor::new(spec.banks.into()),
            controller_count: Divisor::new(spec.controllers.into()),
            controllers: (0..spec.controllers).map(|_| controller()).collect(),
            counters: MemoryCounters::default(),
        }
    }

    /// The controller of a line.
    #[inline(always)]
    pub(crate) fn controller_of(&self, line: u32) -> u32 {
        self.controller_count.div_rem(line.into()).1 as u32
    }

    /// Reads a line; returns when it leaves the controller.
    pub(crate) fn read(&mut self, line: u32, now: Cycle) -> Cycle {
        self.counters.reads += 1;
        self.access(line, now)
    }

    /// Writes a line.
    pub(crate) fn write(&mut self, line: u32, now: Cycle) {
        self.counters.writes += 1;
        self.access(line, now);
    }

    fn access(&mut self, line: u32, now: Cycle) -> Cycle {
        self.counters.bytes += LINE_BYTES;
        let (within, controller) = self.controller_count.div_rem(line.into());
        let controller = &mut self.controllers[controller as usize];
        let (row, _) = self.row_lines.div_rem(within);
        let (above, _) = self.banks.div_rem(row);
        let mixed = row ^ above ^ self.banks.div_rem(above).0;
        let bank = &mut controller.banks[self.banks.div_rem(mixed).1 as usize];
        let row = row as u32;
        // The row.
        let (opened, latency) = if bank.open_row == row {
            self.counters.row_hits += 1;
            (now, self.row_hit_cycles)
        } else {
            self.counters.row_misses += 1;
            bank.open_row = row;
            (bank.openings.take(now), self.row_miss_cycles)
        };
        // The channel: the burst is part of the idle latency, so only the wait adds to it.
        let burst = controller.channel.take(opened);
        self.counters.wait_cycles += burst - now;
        burst + latency
    }
}
