//! The back ends: host lanes that compute, and an emitter that takes note.
//!
//! One implementation of every operation serves all of them, so they cannot drift apart:
//! `Scalar` = [`Portable`](crate::lanes::Portable) lanes, counting; `Native` = host SIMD, counting; `Recording` = host
//! SIMD, emitting uops.

mod operations;
// What the operations are made of:
mod access;
mod atomics;
mod places;

use core::marker::PhantomData;

use crate::arena::{Addr, Arena, Memory, STACK_OWN_LINES, STACK_SLOTS};
use crate::emit::Emit;
use crate::lanes::{LANES, Lanes};
use crate::stream::StreamLine;
use crate::uop::Class;

/// Stack slots that values between lanes and scalars take in turn.
const TRANSFER_SLOTS: u32 = 8;

/// First of the stack slots that hold spilled vector registers.
pub(crate) const SPILL_SLOT: u32 = TRANSFER_SLOTS;

/// Number of stack slots that hold spilled vector registers.
pub(crate) const SPILL_SLOTS: u32 = STACK_OWN_LINES - TRANSFER_SLOTS;

/// A value and the uop that produced it.
#[derive(Debug, Clone, Copy)]
pub struct Value<T, Id> {
    v: T,
    id: Id,
}

/// Host lanes `L` that compute on an arena, and an emitter `E` that takes note.
pub struct Backend<'a, L: Lanes, E: Emit> {
    memory: Memory<'a>,
    emit: E,
    /// Whether other host threads may add to the same words meanwhile.
    shared: bool,
    transfer_slot: u32,
    lanes: PhantomData<L>,
}

impl<'a, L: Lanes, E: Emit> Backend<'a, L, E> {
    /// A hardware thread about to run task `task`; `shared` when other host threads may add to the same words meanwhile.
    #[inline(always)]
    pub fn new(arena: &'a Arena, emit: E, task: u32, shared: bool) -> Self {
        Backend { memory: arena.memory_of_task(task), emit, shared, transfer_slot: 0, lanes: PhantomData }
    }

    /// The emitter, with what it took note of.
    #[inline(always)]
    pub(crate) fn emitted(&self) -> &E {
        &self.emit
    }

    /// The address `base + 4 * index`, where an access with a scalar index goes.
    #[inline(always)]
    fn address(base: Addr, index: i32) -> u64 {
        base.0.wrapping_add(4 * u64::from(index as u32))
    }

    /// The value of lane `lane` of `a`, modulo 16.
    #[inline(always)]
    fn lane(a: L::I, lane: u32) -> i32 {
        L::to_i(a)[lane as usize % LANES]
    }

    /// The stack line of what a kernel puts into `slot`.
    #[inline(always)]
    fn slot_line(slot: u32) -> StreamLine {
        assert!(slot < STACK_SLOTS, "slot {slot} of a stack; there are {STACK_SLOTS}");
        StreamLine::stack(STACK_OWN_LINES + slot)
    }

    /// The stack line for the next transfer between lanes and scalars.
    #[inline(always)]
    fn next_transfer_line(&mut self) -> StreamLine {
        self.transfer_slot = (self.transfer_slot + 1) % TRANSFER_SLOTS;
        StreamLine::stack(self.transfer_slot)
    }

    #[inline(always)]
    fn constant<T>(&mut self, class: Class, v: T) -> Value<T, E::Id> {
        let lines = if E::LINES {
            self.emit.line(StreamLine::CONSTANTS);
            1
        } else {
            0
        };
        Value { v, id: self.emit.memory(class, [], lines) }
    }

    #[inline(always)]
    fn shuffle(&mut self, a: Value<L::F, E::Id>, index: [i32; LANES]) -> Value<L::F, E::Id> {
        let v = L::from_bits(L::permute(L::bits(a.v), L::from_i(index)));
        self.emit.reads([a.id]);
        Value { v, id: self.emit.alu(Class::VectorShuffle, [a.id]) }
    }

    #[inline(always)]
    fn observe(a: Value<L::F, E::Id>) -> Value<L::I, E::Id> {
        Value { v: L::bits(L::canonical(a.v)), id: a.id }
    }

    #[inline(always)]
    fn as_float(a: Value<L::I, E::Id>) -> Value<L::F, E::Id> {
        Value { v: L::from_bits(a.v), id: a.id }
    }

    #[inline(always)]
    fn as_bits(a: Value<L::F, E::Id>) -> Value<L::I, E::Id> {
        Value { v: L::bits(a.v), id: a.id }
    }
}
