use super::*;
use crate::config::shipped;
use crate::laws::{self, Ahead, Fault, LOAD_CYCLES, Model, Resource, Verdict};
use crate::streams::Random;
use std::collections::{BTreeMap, BTreeSet};

fn spec() -> MemorySpec {
    let config = shipped("larrabee-24");
    config.validate().expect("sound").memory
}

#[test]
fn an_idle_read_takes_the_row_miss_latency_and_then_the_row_hit_latency() {
    let spec = spec();
    let mut memory = Memory::new(&spec);
    assert_eq!(memory.read(0, 1000, 0), 1000 + spec.row_miss_cycles);
    assert_eq!(memory.read(spec.controllers, 2000, 0), 2000 + spec.row_hit_cycles);
}

#[test]
fn streaming_reaches_the_peak_bandwidth_and_no_more() {
    let spec = spec();
    let mut memory = Memory::new(&spec);
    let lines = 1200;
    // All asked for at once: what counts is when the last leaves.
    let last = (0..lines).map(|line| memory.read(line, 0, 0)).max().expect("lines");
    let cycles_at_peak = u64::from(lines / spec.controllers) * spec.line_interval_x256 / 256;
    assert!(last >= cycles_at_peak, "{last} cycles beat the peak, {cycles_at_peak}");
    assert!(
        last <= cycles_at_peak + spec.row_miss_cycles + spec.row_cycle_cycles,
        "{last} > {cycles_at_peak}"
    );
}

#[test]
fn one_bank_opens_one_row_in_a_row_cycle() {
    let mut spec = spec();
    spec.banks = 1;
    spec.controllers = 1;
    let mut memory = Memory::new(&spec);
    let first = memory.read(0, 0, 0);
    let second = memory.read(spec.row_lines, 0, 0);
    assert_eq!(second - first, spec.row_cycle_cycles);
}

#[test]
fn every_access_is_a_row_hit_or_a_row_miss() {
    let mut memory = Memory::new(&spec());
    for line in 0..5000_u32 {
        memory.read(line.wrapping_mul(2_654_435_761) >> 8, u64::from(line), 0);
    }
    let counters = memory.counters;
    assert_eq!(counters.row_hits + counters.row_misses, counters.reads + counters.writes);
}

/// Two controllers whose every limit can be reached, and which answer a constant time after a burst has begun.
fn tight() -> MemorySpec {
    MemorySpec {
        controllers: 2,
        line_interval_x256: 1365,
        row_hit_cycles: 60,
        row_miss_cycles: 60,
        row_cycle_cycles: 40,
        write_row_cycle_cycles: 58,
        turnaround_lines: 1,
        write_buffer_lines: 4,
        banks: 8,
        row_lines: 4,
        ..spec()
    }
}

/// Which accesses come.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Mix {
    Reads,
    Writes,
    Both,
}

impl Mix {
    const ALL: [Mix; 3] = [Mix::Reads, Mix::Writes, Mix::Both];

    /// Line of a request, and whether it writes: three lines in a row somewhere.
    fn access(self, request: u32) -> (u32, bool) {
        let line = (request / 6).wrapping_mul(2_654_435_761) >> 10;
        let write = match self {
            Mix::Reads => false,
            Mix::Writes => true,
            Mix::Both => request.wrapping_mul(0x9e37_79b1) >> 30 == 0,
        };
        (line + request % 6, write)
    }
}

#[derive(Debug, Clone, PartialEq)]
struct Load(Memory, Mix);

impl Resource for Load {
    fn ask(&mut self, request: u32, at: Cycle, floor: Cycle) -> Cycle {
        let (line, write) = self.1.access(request);
        let done = if write { self.0.write(line, at, floor).written } else { self.0.read(line, at, floor) };
        done - 60
    }

    fn peak(&self, cycles: Cycle) -> u64 {
        self.0.peak_lines(cycles)
    }
}

/// The same memory without tables: every slot, span and entry in a set or a list.
#[derive(Default)]
struct Naive {
    wrote: [bool; 2],
    channels: [BTreeSet<u64>; 2],
    /// By controller and bank: the open row, since when, and all openings.
    banks: Vec<(u32, Cycle, BTreeMap<Cycle, Cycle>)>,
    /// When each of the four entries of the write buffer is given back.
    ends: [[Cycle; 4]; 2],
}

impl Naive {
    /// When row and channel would serve, and with which slots.
    fn burst(&self, at: &Place, write: bool, now: Cycle) -> (Cycle, Vec<u64>, Cycle) {
        let (row, since, openings) = &self.banks[at.controller * 8 + at.bank as usize];
        let cycles = if write { 58 } else { 40 };
        let mut opened = now.max(if *row == at.row { *since } else { 0 });
        for (from, to) in openings.iter().filter(|_| *row != at.row) {
            if *from < opened + cycles && opened < *to {
                opened = *to;
            }
        }
        let count = if self.wrote[at.controller] == write { 1 } else { 2 };
        let free = (opened * 256 / 1365..).filter(|slot| !self.channels[at.controller].contains(slot));
        let slots: Vec<u64> = free.take(count).collect();
        (opened, slots.clone(), opened.max((slots[count - 1] * 1365).div_ceil(256)))
    }

    fn access(&mut self, at: &Place, write: bool, asked: Cycle) -> Cycle {
        let first = self.ends[at.controller].iter().min().expect("four");
        let now = if write { asked.max(*first) } else { asked };
        let (opened, slots, burst) = self.burst(at, write, now);
        self.channels[at.controller].extend(slots);
        self.wrote[at.controller] = write;
        let bank = &mut self.banks[at.controller * 8 + at.bank as usize];
        if bank.0 != at.row {
            bank.2.insert(opened, opened + if write { 58 } else { 40 });
            (bank.0, bank.1) = (at.row, opened);
        }
        if write {
            *self.ends[at.controller].iter_mut().min().expect("four") = burst + 6;
        }
        burst
    }
}

#[test]
fn memory_obeys_the_laws() {
    for mix in Mix::ALL {
        let memory = Load(Memory::new(&tight()), mix);
        laws::never_early_nor_above_peak(&memory, LOAD_CYCLES).expect("kept");
        laws::serves_as_asked(&memory).expect("kept");
        let model = || -> Model {
            let places = Memory::new(&tight());
            let mut naive = Naive { banks: vec![(u32::MAX, 0, BTreeMap::new()); 16], ..Naive::default() };
            Box::new(move |request, at| {
                let (line, write) = mix.access(request);
                naive.access(&places.place(line), write, at)
            })
        };
        // Writes come nearly in the order of time: a write far ahead would keep its entry from those before it.
        let ahead = if mix == Mix::Reads { Ahead::Some } else { Ahead::None };
        laws::agrees_ahead(&memory, ahead, model).unwrap_or_else(|broken| panic!("{mix:?}: {broken}"));
    }
}

/// Posted writes without throttle, out of order: no buffer holds more than its lines, and what they take is what they hold.
fn write_buffer_is_finite(mut memory: Memory, most: usize) -> Verdict {
    let (mut held, mut random) = ([Vec::new(), Vec::new()], Random::new(4));
    for request in 0..20_000_u32 {
        let floor = Cycle::from(request) * 2;
        let now = floor + Cycle::from(random.below(300));
        let line = random.below(4000);
        let write = memory.write(line, now, floor);
        if write.accepted < now || write.written < write.accepted + 60 {
            return Err(format!("write {request} at {now}: {write:?}"));
        }
        held[memory.controller_of(line) as usize].push((write.accepted, write.written - 60 + 6));
    }
    held.iter().try_for_each(|held| laws::never_holds_more_than(most, held))
}

/// Whether the write buffers of a small memory with a defect, or none, are finite.
pub(crate) fn write_buffers_are_finite(fault: Option<Fault>) -> Verdict {
    let mut memory = Memory::new(&tight());
    if let Some(fault) = fault {
        memory.seed(fault);
    }
    write_buffer_is_finite(memory, 4)
}

#[test]
fn write_buffers_are_finite_and_those_that_are_not_are_caught() {
    let mut memory = Memory::new(&tight());
    write_buffer_is_finite(memory.clone(), 4).expect("kept");
    write_buffer_is_finite(memory.clone(), 3).expect_err("the buffer is used whole");
    for controller in &mut memory.controllers {
        controller.writes.fault = Some(Fault::UnboundedWriteBuffer);
    }
    write_buffer_is_finite(memory, 4).expect_err("more than its lines");
}

#[test]
fn a_write_is_taken_when_the_buffer_has_an_entry() {
    let mut memory = Memory::new(&MemorySpec { turnaround_lines: 0, ..tight() });
    // Lines of one row of a controller: only the channel holds them up, six cycles a line or five.
    let accepted: Vec<Cycle> = (0..7).map(|_| memory.write(0, 0, 0).accepted).collect();
    assert_eq!(accepted[..4], [0; 4]);
    assert!(accepted[4..].windows(2).all(|pair| (5..=6).contains(&(pair[1] - pair[0]))), "{accepted:?}");
}

#[test]
fn line_times_that_come_later_are_counted() {
    let spec = MemorySpec { controllers: 1, turnaround_lines: 0, line_interval_x256: 1280, ..tight() };
    let mut load = Load(Memory::new(&spec), Mix::Both);
    let bursts: Vec<Cycle> =
        (0..5000).map(|request| load.ask(request, request.into(), request.into())).collect();
    assert_eq!(load.0.take_line_times(), 5000);
    // Before the controller has ever been idle, every burst begins with its line time.
    for from in [5000, 8000, 12_000, 100_000] {
        let later = bursts.iter().filter(|burst| **burst >= from).count() as u64;
        assert_eq!(load.0.line_times_from(from), later);
    }
}
