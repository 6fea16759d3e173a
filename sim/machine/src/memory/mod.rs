//! The memory controllers: channels, banks and open rows.
//!
//! Line `l` belongs to controller `l mod controllers`; there, consecutive lines fill a row, and consecutive rows go round
//! the banks. Where that round begins and in which order it goes differ from one stretch of 2 MB to the next without pattern,
//! as the first does when an operating system hands out pages: arrays a power of two apart do not meet in one bank. An access waits for its bank to
//! be able to open a row, if it has to, and then for the channel. A write keeps its bank longer than a read.

mod spans;

#[cfg(test)]
mod tests;

use crate::Cycle;
use crate::config::MemorySpec;
use crate::counters::MemoryCounters;
use crate::division::Divisor;
use crate::occupancy::Slots;
use lrbsim_isa::arena::LINE_BYTES;
use spans::Spans;

/// Lines of a stretch of memory that lies in the chips as one.
const FRAME_LINES: u64 = (2 << 20) / LINE_BYTES;

#[derive(Debug)]
struct Bank {
    open_row: u32,
    /// When that row was opened, or will have been.
    open_since: Cycle,
    openings: Spans,
}

#[derive(Debug)]
struct Controller {
    channel: Slots,
    /// Whether the last access wrote.
    wrote: bool,
    banks: Vec<Bank>,
}

/// All controllers.
#[derive(Debug)]
pub(crate) struct Memory {
    row_miss_cycles: Cycle,
    row_hit_cycles: Cycle,
    /// For how long a read and a write that open a row keep their bank.
    row_cycle_cycles: [Cycle; 2],
    /// Line times that a channel loses when it changes direction.
    turnaround_lines: u32,
    /// Orders of the banks: steps from one row's bank to the next row's, prime to their number.
    strides: Vec<u64>,
    stride_count: Divisor,
    /// Rows of a controller in a stretch of memory that lies in the chips as one.
    frame_rows: Divisor,
    row_lines: Divisor,
    banks: Divisor,
    controller_count: Divisor,
    controllers: Vec<Controller>,
    pub(crate) counters: MemoryCounters,
}

impl Memory {
    pub(crate) fn new(spec: &MemorySpec) -> Memory {
        let longest = spec.row_cycle_cycles.max(spec.write_row_cycle_cycles);
        let bank = || Bank { open_row: u32::MAX, open_since: 0, openings: Spans::new(longest) };
        let strides: Vec<u64> =
            (1..=u64::from(spec.banks)).filter(|s| gcd(*s, spec.banks.into()) == 1).collect();
        let controller = || Controller {
            channel: Slots::new(spec.line_interval_x256),
            wrote: false,
            banks: (0..spec.banks).map(|_| bank()).collect(),
        };
        Memory {
            row_miss_cycles: spec.row_miss_cycles,
            row_hit_cycles: spec.row_hit_cycles,
            row_cycle_cycles: [spec.row_cycle_cycles, spec.write_row_cycle_cycles],
            turnaround_lines: spec.turnaround_lines,
            stride_count: Divisor::new(strides.len() as u64),
            strides,
            frame_rows: Divisor::new(
                (FRAME_LINES / u64::from(spec.controllers) / u64::from(spec.row_lines)).max(1),
            ),
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
        self.access(line, false, now)
    }

    /// Writes a line; returns when it is written.
    pub(crate) fn write(&mut self, line: u32, now: Cycle) -> Cycle {
        self.counters.writes += 1;
        self.access(line, true, now)
    }

    fn access(&mut self, line: u32, write: bool, now: Cycle) -> Cycle {
        self.counters.bytes += LINE_BYTES;
        let (within, controller) = self.controller_count.div_rem(line.into());
        let controller = &mut self.controllers[controller as usize];
        let (row, _) = self.row_lines.div_rem(within);
        let (frame, _) = self.frame_rows.div_rem(row);
        let turned =
            row * self.strides[self.stride_count.div_rem(scattered(frame)).1 as usize] + scattered(!frame);
        let bank = &mut controller.banks[self.banks.div_rem(turned).1 as usize];
        let row = row as u32;
        // The row.
        let (opened, latency) = if bank.open_row == row {
            self.counters.row_hits += 1;
            (now.max(bank.open_since), self.row_hit_cycles)
        } else {
            self.counters.row_misses += 1;
            bank.open_row = row;
            bank.open_since = bank.openings.take(now, self.row_cycle_cycles[usize::from(write)]);
            (bank.open_since, self.row_miss_cycles)
        };
        // The channel, which pauses where it changes direction.
        if controller.wrote != write {
            controller.wrote = write;
            for _ in 0..self.turnaround_lines {
                controller.channel.take(opened);
            }
        }
        // The burst is part of the idle latency, so only the wait adds to it.
        let burst = controller.channel.take(opened);
        self.counters.wait_cycles += burst - now;
        burst + latency
    }
}

/// Greatest common divisor.
fn gcd(a: u64, b: u64) -> u64 {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// A number below 2^24 for each frame, without pattern.
fn scattered(frame: u64) -> u64 {
    // Twice multiplied, with a fold between: once would leave frames at equal distances at equal distances.
    let folded = frame.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    (folded ^ folded >> 31).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 40
}
