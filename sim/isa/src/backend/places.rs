//! Where an access goes: host pointers, checked, and line numbers.

use super::Backend;
use crate::arena::{Addr, LINE_BYTES, out_of_range};
use crate::emit::Emit;
use crate::lanes::Lanes;
use crate::stream::StreamLine;

impl<L: Lanes, E: Emit> Backend<'_, L, E> {
    /// Has the emitter note the line of the word at `addr`. A word lies in one line: addresses are multiples of 4.
    #[inline(always)]
    pub(super) fn line_of(&mut self, addr: u64) -> u8 {
        if !E::LINES {
            return 0;
        }
        debug_assert!(addr.is_multiple_of(4), "word at {addr:#x}, which is no multiple of 4");
        self.emit.line(StreamLine::arena(Addr(addr).line()));
        1
    }

    /// Has the emitter note the lines of `bytes` bytes from `addr` on, up to 64; how many they are.
    #[inline(always)]
    pub(super) fn lines_of(&mut self, addr: u64, bytes: u64) -> u8 {
        if !E::LINES || bytes == 0 {
            return 0;
        }
        self.emit.line_or_two(Addr(addr).line(), Addr(addr + bytes - 1).line())
    }

    /// Has the emitter note the lines from the first active lane to the last of a vector at `addr`; how many they are.
    #[inline(always)]
    pub(super) fn lines_masked(&mut self, k: u16, addr: u64) -> u8 {
        if !E::LINES || k == 0 {
            return 0;
        }
        let first = 4 * u64::from(k.trailing_zeros());
        let end = 4 * u64::from(16 - k.leading_zeros());
        self.lines_of(addr + first, end - first)
    }

    /// Has the emitter note the lines that the active lanes touch, each once, in lane order; how many they are.
    #[inline(always)]
    pub(super) fn lines_indexed(&mut self, k: u16, base: Addr, index: L::I) -> u8 {
        if !E::LINES {
            return 0;
        }
        let lines = Self::line_numbers(base, index);
        self.emit.distinct_lines::<L>(k, lines)
    }

    /// The number of the line that each lane of an indexed access touches; lanes out of range get some number.
    #[inline(always)]
    pub(super) fn line_numbers(base: Addr, index: L::I) -> L::I {
        // Index and line are added after the shift, where both fit: the arena may hold more than 2^32 words.
        let words_into_line = (base.0 / 4 % (LINE_BYTES / 4)) as i32;
        let from_base = L::srl(
            L::iadd(index, L::splat_i(words_into_line)),
            L::splat_i((LINE_BYTES / 4).trailing_zeros() as i32),
        );
        L::iadd(from_base, L::splat_i(base.line().0 as i32))
    }

    /// The mask of those lanes of an indexed access that lie inside the arena.
    #[inline(always)]
    pub(super) fn inside(&self, base: Addr, index: L::I) -> u16 {
        let room = self.memory.used_bytes().saturating_sub(base.0) / 4;
        L::ult(index, L::splat_i(room.min(i32::MAX as u64) as i32))
    }

    /// Claims the words of the active lanes from `addr` on, which the task is about to write.
    #[inline(always)]
    pub(super) fn claim_lanes(&self, k: u16, addr: u64) {
        if cfg!(debug_assertions) {
            (0..16).filter(|lane| k >> lane & 1 == 1).for_each(|lane| self.memory.claim(addr + 4 * lane));
        }
    }

    /// Claims the words of the active lanes of an indexed access, which the task is about to write.
    #[inline(always)]
    pub(super) fn claim_indexed(&self, k: u16, base: Addr, index: L::I) {
        if cfg!(debug_assertions) {
            let lanes = (0..16).filter(|lane| k >> lane & 1 == 1);
            lanes.for_each(|lane| self.memory.claim(Self::address(base, Self::lane(index, lane))));
        }
    }

    /// Host pointer to lane 0 of `k`'s lanes at `addr`; only the active lanes lie inside the arena for sure.
    #[inline(always)]
    pub(super) fn masked_pointer(&self, k: u16, addr: u64) -> *mut i32 {
        if k == 0 {
            return core::ptr::null_mut();
        }
        let first = 4 * u64::from(k.trailing_zeros());
        let end = 4 * u64::from(16 - k.leading_zeros());
        self.memory.pointer(addr + first, end - first).wrapping_sub(first as usize).cast()
    }

    /// Host pointer for the active lanes of an indexed access, each of which must lie inside the arena.
    #[inline(always)]
    pub(super) fn indexed_pointer(&self, k: u16, base: Addr, index: L::I) -> *mut i32 {
        let outside = k & !self.inside(base, index);
        if outside != 0 {
            let addr = Self::address(base, Self::lane(index, outside.trailing_zeros()));
            out_of_range(addr, 4, self.memory.used_bytes());
        }
        self.memory.base().wrapping_add(base.0 as usize).cast()
    }
}
