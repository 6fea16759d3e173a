//! Register pressure: how many vector registers a task needs at once, and the price of needing more than there are.

use crate::arena::STACK_BASE_LINE;
use crate::backend::{SPILL_SLOT, SPILL_SLOTS};
use crate::emit::{FarUse, lane_slots};
use crate::stream::Stream;
use crate::uop::{Class, Uop};

/// Vector registers of a hardware thread [machine.md 1.2: abrash09].
pub const VECTOR_REGISTERS: u32 = 32;

/// Counts the vector values live at once and appends a store and a reload for every value made while all registers are
/// taken: one of the live values must then go to the stack and come back.
///
/// A value is live from the uop that makes it to its last use. The charge stands at the end of the task, where it costs
/// issue slots and L1 accesses but delays no one else's operands: a lower bound of what a compiler would do.
pub(crate) fn charge(stream: &mut Stream, far: &[FarUse]) {
    let defines: [bool; Class::COUNT] = core::array::from_fn(|i| Class::ALL[i].defines_vector());
    let memory: [bool; Class::COUNT] = core::array::from_fn(|i| Class::ALL[i].is_memory());
    let mut far = far.to_vec();
    far.sort_unstable_by_key(|far| far.user);

    let uops = &stream.uops;
    let mut live = vec![false; uops.len()];
    let (mut live_count, mut live_max, mut spills) = (0u32, 0u32, 0u32);
    // Backwards: the first use met is the last use, the definition ends the range.
    for i in (0..uops.len()).rev() {
        let uop = uops[i];
        let class = (uop & 0xff) as usize;
        if live[i] {
            if live_count > VECTOR_REGISTERS {
                spills += 1;
            }
            live_count -= 1;
        }
        let mut begin = |producer: usize| {
            if !live[producer] && defines[(uops[producer] & 0xff) as usize] {
                live[producer] = true;
                live_count += 1;
            }
        };
        let producers = if memory[class] { uop >> 8 & 0xffff } else { uop >> 8 };
        let mut rest = producers;
        while rest != 0 {
            if rest & 0xff != 0 {
                begin(i - (rest & 0xff) as usize);
            }
            rest >>= 8;
        }
        while let Some(last) = far.last()
            && last.user as usize == i
        {
            begin(last.producer as usize);
            far.pop();
        }
        live_max = live_max.max(live_count);
    }

    stream.live_vectors_max = live_max;
    for spill in 0..spills {
        let line = STACK_BASE_LINE + SPILL_SLOT + spill % SPILL_SLOTS;
        stream.uops.push(Uop::memory(Class::SpillStore, 0, 0, 1).0);
        stream.lines.push(line);
        stream.uops.push(Uop::memory(Class::SpillLoad, 1, 0, 1).0);
        stream.lines.push(line);
    }
    stream.lanes_active = lane_slots(&stream.count_classes()) - stream.lanes_masked;
}
