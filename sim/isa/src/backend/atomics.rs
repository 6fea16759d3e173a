//! Vector atomics: the gather-modify-scatter loop.

use core::sync::atomic::Ordering::Relaxed;

use super::{Backend, Value};
use crate::arena::Addr;
use crate::emit::Emit;
use crate::lanes::{LANES, Lanes};
use crate::uop::Class;

impl<L: Lanes, E: Emit> Backend<'_, L, E> {
    /// Adds to the words that the active lanes point to: `vatomic_add_or`.
    #[inline(always)]
    pub(super) fn add_or(
        &mut self,
        or: Value<L::I, E::Id>,
        k: Value<u16, E::Id>,
        base: Addr,
        index: Value<L::I, E::Id>,
        a: Value<L::I, E::Id>,
    ) -> Value<L::I, E::Id> {
        self.indexed_pointer(k.v, base, index.v);
        let (at, add, mut out) = (L::to_i(index.v), L::to_i(a.v), L::to_i(or.v));
        for lane in 0..LANES {
            if k.v >> lane & 1 == 1 {
                let addr = Self::address(base, at[lane]);
                self.memory.claim_addition(addr);
                let word = self.memory.atomic(Addr(addr));
                out[lane] = if self.shared {
                    word.fetch_add(add[lane], Relaxed)
                } else {
                    let old = word.load(Relaxed);
                    word.store(old.wrapping_add(add[lane]), Relaxed);
                    old
                };
            }
        }
        let id = self.emit_rounds(or, k, base, index, [a.id]);
        Value { v: L::from_i(out), id }
    }

    /// Replaces the words that the active lanes point to where they are as expected: `vatomic_compare_exchange_or`.
    #[inline(always)]
    pub(super) fn compare_exchange_or(
        &mut self,
        or: Value<L::I, E::Id>,
        k: Value<u16, E::Id>,
        base: Addr,
        index: Value<L::I, E::Id>,
        expected: Value<L::I, E::Id>,
        a: Value<L::I, E::Id>,
    ) -> Value<L::I, E::Id> {
        self.indexed_pointer(k.v, base, index.v);
        let (at, want, new) = (L::to_i(index.v), L::to_i(expected.v), L::to_i(a.v));
        let mut out = L::to_i(or.v);
        for lane in 0..LANES {
            if k.v >> lane & 1 == 1 {
                let addr = Self::address(base, at[lane]);
                self.memory.claim(addr);
                let word = self.memory.atomic(Addr(addr));
                out[lane] =
                    word.compare_exchange(want[lane], new[lane], Relaxed, Relaxed).unwrap_or_else(|old| old);
            }
        }
        let id = self.emit_rounds(or, k, base, index, [expected.id, a.id]);
        Value { v: L::from_i(out), id }
    }

    /// Emits the rounds of a vector atomic; returns the id of the last gather, `or`'s when no lane is active.
    ///
    /// `operands`: what the atomic adds, or what it expects and writes.
    #[inline(always)]
    fn emit_rounds<const N: usize>(
        &mut self,
        or: Value<L::I, E::Id>,
        k: Value<u16, E::Id>,
        base: Addr,
        index: Value<L::I, E::Id>,
        operands: [E::Id; N],
    ) -> E::Id {
        let mut live = k.v;
        let mut last = or.id;
        let mut mask = k.id;
        while live != 0 {
            let winners = L::distinct(live, index.v);
            let lines = self.lines_indexed(winners, base, index.v);
            self.emit.under_mask(winners);
            self.emit.reads([last, index.id]);
            let old = self.emit.memory(Class::AtomicGather, [mask, index.id, last], lines);
            self.emit.under_mask(winners);
            self.emit.reads(operands);
            self.emit.reads([old]);
            let mut producers = [old; 4];
            producers[0] = mask;
            producers[2..2 + N].copy_from_slice(&operands);
            let new = self.emit.alu(Class::VectorAlu, producers);
            self.emit.repeat_lines::<L>(lines);
            self.emit.under_mask(winners);
            self.emit.reads([index.id, new]);
            let done = self.emit.memory(Class::AtomicScatter, [mask, index.id, new], lines);
            mask = self.emit.alu(Class::Mask, [mask, done]);
            let test = self.emit.alu(Class::Mask, [mask]);
            self.emit.alu(Class::Branch, [test]);
            live &= !winners;
            last = old;
        }
        last
    }
}
