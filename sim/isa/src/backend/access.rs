//! Loads, stores and prefetches of vectors.

use super::{Backend, Value};
use crate::arena::{Addr, LINE_BYTES};
use crate::emit::Emit;
use crate::lanes::Lanes;
use crate::uop::Class;

impl<L: Lanes, E: Emit> Backend<'_, L, E> {
    #[inline(always)]
    #[expect(unsafe_code, reason = "the range is checked just before")]
    pub(super) fn load(&mut self, base: Addr, index: Value<i32, E::Id>) -> Value<L::I, E::Id> {
        let addr = Self::address(base, index.v);
        let from = self.memory.pointer(addr, 64);
        // SAFETY: `pointer` checked 64 bytes.
        let v = unsafe { L::load(from.cast()) };
        let lines = self.lines_of(addr, 64);
        Value { v, id: self.emit.memory(Class::VectorLoad, [index.id], lines) }
    }

    #[inline(always)]
    #[expect(unsafe_code, reason = "the range is checked just before")]
    pub(super) fn load_or(
        &mut self,
        or: Value<L::I, E::Id>,
        k: Value<u16, E::Id>,
        base: Addr,
        index: Value<i32, E::Id>,
    ) -> Value<L::I, E::Id> {
        let addr = Self::address(base, index.v);
        let from = self.masked_pointer(k.v, addr);
        // SAFETY: `masked_pointer` checked the active lanes.
        let v = unsafe { L::load_masked(or.v, k.v, from) };
        let lines = self.lines_masked(k.v, addr);
        self.emit.under_mask(k.v);
        self.emit.reads([or.id]);
        Value { v, id: self.emit.memory(Class::VectorLoad, [or.id, k.id, index.id], lines) }
    }

    #[inline(always)]
    #[expect(unsafe_code, reason = "the range is checked just before")]
    pub(super) fn store(
        &mut self,
        k: Value<u16, E::Id>,
        base: Addr,
        index: Value<i32, E::Id>,
        a: Value<L::I, E::Id>,
    ) {
        let addr = Self::address(base, index.v);
        self.claim_lanes(k.v, addr);
        if k.v == u16::MAX {
            let to = self.memory.pointer(addr, 64);
            // SAFETY: `pointer` checked 64 bytes.
            unsafe { L::store(to.cast(), a.v) };
        } else {
            let to = self.masked_pointer(k.v, addr);
            // SAFETY: `masked_pointer` checked the active lanes.
            unsafe { L::store_masked(k.v, to, a.v) };
        }
        let lines = self.lines_masked(k.v, addr);
        self.emit.under_mask(k.v);
        self.emit.reads([a.id]);
        self.emit.memory(Class::VectorStore, [k.id, index.id, a.id], lines);
    }

    #[inline(always)]
    pub(super) fn broadcast(&mut self, base: Addr, index: Value<i32, E::Id>) -> Value<L::I, E::Id> {
        let addr = Self::address(base, index.v);
        let v = L::splat_i(i32::from_le_bytes(self.memory.get(Addr(addr))));
        let lines = self.line_of(addr);
        Value { v, id: self.emit.memory(Class::VectorBroadcastLoad, [index.id], lines) }
    }

    #[inline(always)]
    #[expect(unsafe_code, reason = "the range is checked just before")]
    pub(super) fn gather(
        &mut self,
        or: Value<L::I, E::Id>,
        k: Value<u16, E::Id>,
        base: Addr,
        index: Value<L::I, E::Id>,
    ) -> Value<L::I, E::Id> {
        let from = self.indexed_pointer(k.v, base, index.v);
        // SAFETY: `indexed_pointer` checked the active lanes.
        let v = unsafe { L::gather(or.v, k.v, from, index.v) };
        let lines = self.lines_indexed(k.v, base, index.v);
        self.emit.under_mask(k.v);
        self.emit.reads([or.id, index.id]);
        Value { v, id: self.emit.memory(Class::Gather, [or.id, k.id, index.id], lines) }
    }

    #[inline(always)]
    #[expect(unsafe_code, reason = "the range is checked just before")]
    pub(super) fn scatter(
        &mut self,
        k: Value<u16, E::Id>,
        base: Addr,
        index: Value<L::I, E::Id>,
        a: Value<L::I, E::Id>,
    ) {
        let to = self.indexed_pointer(k.v, base, index.v);
        self.claim_indexed(k.v, base, index.v);
        // SAFETY: `indexed_pointer` checked the active lanes.
        unsafe { L::scatter(k.v, to, index.v, a.v) };
        let lines = self.lines_indexed(k.v, base, index.v);
        self.emit.under_mask(k.v);
        self.emit.reads([index.id, a.id]);
        self.emit.memory(Class::Scatter, [k.id, index.id, a.id], lines);
    }

    #[inline(always)]
    pub(super) fn prefetch(&mut self, class: Class, base: Addr, index: Value<i32, E::Id>) {
        let addr = Self::address(base, index.v);
        let lines = if addr < self.memory.used_bytes() { self.line_of(addr) } else { 0 };
        self.emit.memory(class, [index.id], lines);
    }

    /// Stores a whole line, which is not read first: `vstore_stream`.
    #[inline(always)]
    #[expect(unsafe_code, reason = "the range is checked just before")]
    pub(super) fn store_stream(&mut self, base: Addr, index: Value<i32, E::Id>, a: Value<L::I, E::Id>) {
        let addr = Self::address(base, index.v);
        assert!(addr.is_multiple_of(LINE_BYTES), "streaming store to {addr:#x}, which is no multiple of 64");
        let to = self.memory.pointer(addr, 64);
        self.claim_lanes(u16::MAX, addr);
        // SAFETY: `pointer` checked 64 bytes.
        unsafe { L::store(to.cast(), a.v) };
        let lines = self.lines_of(addr, 64);
        self.emit.reads([a.id]);
        self.emit.memory(Class::VectorStreamStore, [index.id, a.id], lines);
    }

    /// Loads consecutive words into the active lanes: `vexpand_or`.
    #[inline(always)]
    #[expect(unsafe_code, reason = "the range is checked just before")]
    pub(super) fn expand_or(
        &mut self,
        or: Value<L::I, E::Id>,
        k: Value<u16, E::Id>,
        base: Addr,
        index: Value<i32, E::Id>,
    ) -> Value<L::I, E::Id> {
        let addr = Self::address(base, index.v);
        let bytes = 4 * u64::from(k.v.count_ones());
        let from = if k.v == 0 { core::ptr::null_mut() } else { self.memory.pointer(addr, bytes) };
        // SAFETY: `pointer` checked as many words as there are active lanes.
        let v = unsafe { L::expand(or.v, k.v, from.cast()) };
        let lines = self.lines_of(addr, bytes);
        self.emit.under_mask(k.v);
        self.emit.reads([or.id]);
        Value { v, id: self.emit.memory(Class::VectorExpand, [or.id, k.id, index.id], lines) }
    }

    /// Stores the active lanes to consecutive words: `vcompress`.
    #[inline(always)]
    #[expect(unsafe_code, reason = "the range is checked just before")]
    pub(super) fn compress(
        &mut self,
        k: Value<u16, E::Id>,
        base: Addr,
        index: Value<i32, E::Id>,
        a: Value<L::I, E::Id>,
    ) {
        let addr = Self::address(base, index.v);
        let bytes = 4 * u64::from(k.v.count_ones());
        let to = if k.v == 0 { core::ptr::null_mut() } else { self.memory.pointer(addr, bytes) };
        self.claim_lanes(((1_u32 << k.v.count_ones()) - 1) as u16, addr);
        // SAFETY: `pointer` checked as many words as there are active lanes.
        unsafe { L::compress(k.v, to.cast(), a.v) };
        let lines = self.lines_of(addr, bytes);
        self.emit.under_mask(k.v);
        self.emit.reads([a.id]);
        self.emit.memory(Class::VectorCompress, [k.id, index.id, a.id], lines);
    }
}
