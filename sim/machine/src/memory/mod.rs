//! The memory controllers: channels, banks and open rows.
//!
//! Line `l` belongs to controller `l mod controllers`; there, consecutive lines fill a row, and consecutive rows go round
//! the banks. Each stretch of 2 MB begins that round at a bank of its own and goes it in an order of its own, without pattern:
//! an operating system that hands out pages leaves arrays a power of two apart in different banks too. An access waits for its
//! bank to be able to open a row, if it has to, and then for the channel. A write keeps its bank longer than a read, and stands
//! in the controller's write buffer until its burst is over; where that is full it has to wait outside.

mod spans;
mod write_buffer;

#[cfg(test)]
pub(crate) mod tests;

use crate::Cycle;
use crate::config::MemorySpec;
use crate::counters::MemoryCounters;
use crate::division::Divisor;
use crate::occupancy::Slots;
use lrbsim_isa::arena::LINE_BYTES;
use spans::Spans;
use write_buffer::WriteBuffer;

/// Lines of a stretch of memory that lies in the chips as one.
const FRAME_LINES: u64 = (2 << 20) / LINE_BYTES;

/// The row that is open in a bank.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Bank {
    open_row: u32,
    /// When that row was opened, or will have been.
    open_since: Cycle,
}

#[derive(Debug, Clone, PartialEq)]
struct Controller {
    channel: Slots,
    /// Whether the last access wrote.
    wrote: bool,
    banks: Vec<Bank>,
    openings: Spans,
    writes: WriteBuffer,
}

/// Where a line lies.
#[derive(Debug, Clone, Copy)]
struct Place {
    controller: usize,
    bank: u32,
    row: u32,
}

/// What became of a write.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Write {
    /// When the write buffer took it.
    pub(crate) accepted: Cycle,
    /// When it is written.
    pub(crate) written: Cycle,
}

/// All controllers.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Memory {
    row_miss_cycles: Cycle,
    row_hit_cycles: Cycle,
    /// For how long a read and a write that open a row keep their bank.
    row_cycle_cycles: [Cycle; 2],
    /// Line times that a channel loses when it changes direction.
    turnaround_lines: u32,
    /// Time that a line takes on a channel, rounded up.
    burst_cycles: Cycle,
    /// Orders of the banks: steps from one row's bank to the next row's, prime to their number.
    strides: Vec<u64>,
    stride_count: Divisor,
    /// Rows of a controller in a stretch of memory that lies in the chips as one.
    frame_rows: Divisor,
    row_lines: Divisor,
    banks: Divisor,
    controller_count: Divisor,
    controllers: Vec<Controller>,
    /// Line times that channels have been taken for since somebody asked: lines, and changes of direction.
    line_times: u64,
    pub(crate) counters: MemoryCounters,
}

impl Memory {
    pub(crate) fn new(spec: &MemorySpec) -> Memory {
        let longest = spec.row_cycle_cycles.max(spec.write_row_cycle_cycles);
        let strides: Vec<u64> =
            (1..=u64::from(spec.banks)).filter(|s| gcd(*s, spec.banks.into()) == 1).collect();
        let controller = || Controller {
            channel: Slots::new(spec.line_interval_x256),
            wrote: false,
            banks: vec![Bank { open_row: u32::MAX, open_since: 0 }; spec.banks as usize],
            openings: Spans::new(spec.banks, longest),
            writes: WriteBuffer::new(spec.write_buffer_lines),
        };
        Memory {
            row_miss_cycles: spec.row_miss_cycles,
            row_hit_cycles: spec.row_hit_cycles,
            row_cycle_cycles: [spec.row_cycle_cycles, spec.write_row_cycle_cycles],
            turnaround_lines: spec.turnaround_lines,
            burst_cycles: spec.line_interval_x256.div_ceil(256),
            stride_count: Divisor::new(strides.len() as u64),
            strides,
            frame_rows: Divisor::new(
                (FRAME_LINES / u64::from(spec.controllers) / u64::from(spec.row_lines)).max(1),
            ),
            row_lines: Divisor::new(spec.row_lines.into()),
            banks: Divisor::new(spec.banks.into()),
            controller_count: Divisor::new(spec.controllers.into()),
            controllers: (0..spec.controllers).map(|_| controller()).collect(),
            line_times: 0,
            counters: MemoryCounters::default(),
        }
    }

    /// The controller of a line.
    #[inline(always)]
    pub(crate) fn controller_of(&self, line: u32) -> u32 {
        self.controller_count.div_rem(line.into()).1 as u32
    }

    /// Reads a line; returns when it leaves the controller. Nobody asks for times before `floor` from now on.
    pub(crate) fn read(&mut self, line: u32, now: Cycle, floor: Cycle) -> Cycle {
        self.counters.reads += 1;
        let (burst, latency) = self.access(self.place(line), false, now, floor);
        self.counters.wait_cycles += burst - now;
        burst + latency
    }

    /// Writes a line that has arrived `now`; returns when the write buffer took it, and when it is written.
    pub(crate) fn write(&mut self, line: u32, now: Cycle, floor: Cycle) -> Write {
        self.counters.writes += 1;
        let place = self.place(line);
        let accepted = self.controllers[place.controller].writes.free_from(now);
        let (burst, latency) = self.access(place, true, accepted, floor);
        self.controllers[place.controller].writes.hold(burst + self.burst_cycles);
        self.counters.wait_cycles += burst - now;
        Write { accepted, written: burst + latency }
    }

    fn place(&self, line: u32) -> Place {
        let (within, controller) = self.controller_count.div_rem(line.into());
        let (row, _) = self.row_lines.div_rem(within);
        let (frame, _) = self.frame_rows.div_rem(row);
        let turned =
            row * self.strides[self.stride_count.div_rem(scattered(frame)).1 as usize] + scattered(!frame);
        let bank = self.banks.div_rem(turned).1 as u32;
        Place { controller: controller as usize, bank, row: row as u32 }
    }

    /// Takes bank and channel; returns when the burst begins, and the latency from there.
    fn access(&mut self, at: Place, write: bool, now: Cycle, floor: Cycle) -> (Cycle, Cycle) {
        self.counters.bytes += LINE_BYTES;
        let controller = &mut self.controllers[at.controller];
        let bank = &mut controller.banks[at.bank as usize];
        // The row.
        let (opened, latency) = if bank.open_row == at.row {
            self.counters.row_hits += 1;
            (now.max(bank.open_since), self.row_hit_cycles)
        } else {
            self.counters.row_misses += 1;
            bank.open_row = at.row;
            let cycles = self.row_cycle_cycles[usize::from(write)];
            bank.open_since = controller.openings.take(at.bank, now, cycles, floor);
            (bank.open_since, self.row_miss_cycles)
        };
        // The channel, which pauses where it changes direction.
        if controller.wrote != write {
            controller.wrote = write;
            for _ in 0..self.turnaround_lines {
                controller.channel.take(opened, floor);
            }
            self.line_times += u64::from(self.turnaround_lines);
        }
        // The burst is part of the idle latency, so only the wait adds to it.
        let burst = controller.channel.take(opened, floor);
        self.line_times += 1;
        (burst, latency)
    }

    /// Seeds a defect in all controllers.
    #[cfg(test)]
    pub(crate) fn seed(&mut self, fault: crate::laws::Fault) {
        for controller in &mut self.controllers {
            controller.channel.fault = Some(fault);
            controller.writes.fault = Some(fault);
        }
    }

    /// Line times that channels have been taken for since this was last asked, for lines and for changes of direction.
    pub(crate) fn take_line_times(&mut self) -> u64 {
        std::mem::take(&mut self.line_times)
    }

    /// Line times that channels have been taken for from `from` on, which is not before the floor.
    pub(crate) fn line_times_from(&self, from: Cycle) -> u64 {
        self.controllers.iter().map(|controller| controller.channel.taken_from(from)).sum()
    }

    /// Most lines that all channels together move in `cycles` cycles in a row: rounded up, and one more for each channel.
    pub(crate) fn peak_lines(&self, cycles: Cycle) -> u64 {
        self.controllers.iter().map(|controller| controller.channel.peak(cycles)).sum()
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
