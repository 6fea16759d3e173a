//! Register pressure: how many vector registers a task needs at once, and the price of needing more than there are.

use crate::backend::{SPILL_SLOT, SPILL_SLOTS};
use crate::lanes::{LANES, Lanes};
use crate::stream::{Stream, StreamLine};
use crate::uop::{Class, Uop};

/// Vector registers of a hardware thread [abrash09; docs/machine.md 1.2].
pub const VECTOR_REGISTERS: u32 = 32;

/// How many vector registers a task needs at once, and how often it needs more than there are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Pressure {
    /// Most vector values that were live at once.
    pub live_max: u32,
    /// Number of vector values that were made while all registers were taken.
    pub spills: u32,
}

/// Counts the vector values live at once, and leaves 0 in both arrays from `first` on.
///
/// `last_reader[id]` is the id of the last uop that reads the vector made by uop `id`, 0 when none does; ids begin at
/// `first`. `ends` is scratch of the same length, all 0. A value is live from the uop that makes it to its last reader,
/// whose result may take over its register. Every recorded task passes here: two host instructions a uop for the
/// scatter, and a prefix sum that the host does 16 uops at a time.
#[inline(always)]
pub(crate) fn pressure<L: Lanes>(last_reader: &mut [u32], ends: &mut [u8], first: usize) -> Pressure {
    let next = last_reader.len();
    assert!(ends.len() == next && first <= next);
    count_ends(&last_reader[first..], ends);

    let (made, made_rest) = last_reader[first..].as_chunks_mut::<LANES>();
    let (ended, ended_rest) = ends[first..].as_chunks_mut::<LANES>();
    let (mut live, mut live_max, mut spills) = (0i32, 0i32, 0);
    for (made, ended) in made.iter_mut().zip(ended) {
        let (highest, last) = L::rise(made, ended);
        live_max = live_max.max(live + highest);
        if live + highest > VECTOR_REGISTERS as i32 {
            spills += count_spills(live, made, ended);
        }
        live += last;
        (*made, *ended) = ([0; LANES], [0; LANES]);
    }
    spills += count_spills(live, made_rest, ended_rest);
    for (made, ended) in made_rest.iter_mut().zip(ended_rest) {
        live += i32::from(*made != 0) - i32::from(*ended);
        live_max = live_max.max(live);
        (*made, *ended) = (0, 0);
    }
    Pressure { live_max: live_max as u32, spills }
}

/// Adds one to `ends` for each of `readers`. A value without a reader ends at 0, where nobody looks.
#[inline(always)]
#[expect(unsafe_code, reason = "a bounds check a uop, on an index that is right by construction")]
fn count_ends(readers: &[u32], ends: &mut [u8]) {
    let mut count = |last: u32| {
        debug_assert!((last as usize) < ends.len());
        // SAFETY: readers are uops of this task, whose ids are below the length of `ends`.
        unsafe {
            let end = ends.get_unchecked_mut(last as usize);
            *end = end.wrapping_add(1);
        }
    };
    let (blocks, rest) = readers.as_chunks::<LANES>();
    for block in blocks {
        for &last in block {
            count(last);
        }
    }
    for &last in rest {
        count(last);
    }
}

/// Number of vector values among these that were made while all registers were taken; `live` values were live before them.
#[cold]
#[inline(never)]
fn count_spills(mut live: i32, made: &[u32], ended: &[u8]) -> u32 {
    let mut spills = 0;
    for (made, ended) in made.iter().zip(ended) {
        live -= i32::from(*ended);
        if *made != 0 {
            live += 1;
            spills += u32::from(live > VECTOR_REGISTERS as i32);
        }
    }
    spills
}

/// Appends a store and a reload for every spill: one of the live values must go to the stack and come back.
///
/// The charge stands at the end of the task, where it costs issue slots and L1 accesses but delays no one else's
/// operands.
pub(crate) fn charge(stream: &mut Stream, spills: u32) {
    for spill in 0..spills {
        let line = StreamLine::stack(SPILL_SLOT + spill % SPILL_SLOTS);
        stream.uops.push(Uop::memory(Class::SpillStore, 0, 0, 1).0);
        stream.lines.push(line);
        stream.uops.push(Uop::memory(Class::SpillLoad, 1, 0, 1).0);
        stream.lines.push(line);
    }
    stream.lanes_active += 2 * LANES as u64 * u64::from(spills);
}
