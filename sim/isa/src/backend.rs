//! The back ends: host lanes that compute, and an emitter that takes note.
//!
//! One implementation of every operation serves all of them, so they cannot drift apart:
//! `Scalar` = [`Portable`](crate::lanes::Portable) lanes, counting; `Native` = host SIMD, counting; `Recording` = host
//! SIMD, emitting uops.

use core::marker::PhantomData;
use core::sync::atomic::Ordering::Relaxed;

use crate::arena::{Addr, Arena, LINE_BYTES, Memory, STACK_BASE_LINE, STACK_LINES, out_of_range};
use crate::emit::Emit;
use crate::lanes::{LANES, Lanes};
use crate::uop::Class;
use crate::vpu::{Compare, Vpu, for_each_operation};

/// Line of the constant pool: constants are few and stay in L1.
const CONSTANT_LINE: u32 = 2;

/// Stack slots that values between lanes and scalars take in turn.
const TRANSFER_SLOTS: u32 = 8;

/// First stack slot of spilled registers.
pub(crate) const SPILL_SLOT: u32 = TRANSFER_SLOTS;

/// Stack slots of spilled registers.
pub(crate) const SPILL_SLOTS: u32 = STACK_LINES - TRANSFER_SLOTS;

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
    /// A hardware thread about to run a task; `shared` when other host threads may add to the same words meanwhile.
    #[inline(always)]
    pub fn new(arena: &'a Arena, emit: E, shared: bool) -> Self {
        Backend { memory: arena.memory(), emit, shared, transfer_slot: 0, lanes: PhantomData }
    }

    /// What took note.
    #[inline(always)]
    pub(crate) fn emitted(&self) -> &E {
        &self.emit
    }

    /// `base + 4 * index` of a scalar index.
    #[inline(always)]
    fn address(base: Addr, index: i32) -> u64 {
        base.0.wrapping_add(4 * u64::from(index as u32))
    }

    /// Notes the line of a word. A word lies in one line: addresses are multiples of 4.
    #[inline(always)]
    fn line_of(&mut self, addr: u64) -> u8 {
        if !E::LINES {
            return 0;
        }
        debug_assert!(addr.is_multiple_of(4), "word at {addr:#x}, which is no multiple of 4");
        self.emit.line((addr / LINE_BYTES) as u32);
        1
    }

    /// Notes the lines of up to 64 consecutive bytes.
    #[inline(always)]
    fn lines_of(&mut self, addr: u64, bytes: u64) -> u8 {
        if !E::LINES || bytes == 0 {
            return 0;
        }
        let first = (addr / LINE_BYTES) as u32;
        let last = ((addr + bytes - 1) / LINE_BYTES) as u32;
        self.emit.line_or_two(first, last)
    }

    /// Notes the lines that the active lanes touch, each once, in lane order.
    #[inline(always)]
    fn lines_indexed(&mut self, k: u16, base: Addr, index: L::I) -> u8 {
        if !E::LINES {
            return 0;
        }
        let lines = Self::line_numbers(base, index);
        self.emit.distinct_lines::<L>(k, lines)
    }

    /// The line of every lane of an indexed access; lanes out of range get some number.
    #[inline(always)]
    fn line_numbers(base: Addr, index: L::I) -> L::I {
        // Index and line are added after the shift, where both fit: the arena may hold more than 2^32 words.
        let words_into_line = (base.0 / 4 % (LINE_BYTES / 4)) as i32;
        let from_base = L::srl(
            L::iadd(index, L::splat_i(words_into_line)),
            L::splat_i((LINE_BYTES / 4).trailing_zeros() as i32),
        );
        L::iadd(from_base, L::splat_i(base.line().0 as i32))
    }

    /// The lanes of an indexed access that lie inside the arena.
    #[inline(always)]
    fn inside(&self, base: Addr, index: L::I) -> u16 {
        let room = self.memory.used_bytes().saturating_sub(base.0) / 4;
        L::ult(index, L::splat_i(room.min(i32::MAX as u64) as i32))
    }

    /// Host pointer to lane 0 of `k`'s lanes at `addr`; only the active lanes lie inside the arena for sure.
    #[inline(always)]
    fn masked_pointer(&self, k: u16, addr: u64) -> *mut i32 {
        if k == 0 {
            return core::ptr::null_mut();
        }
        let first = 4 * u64::from(k.trailing_zeros());
        let end = 4 * u64::from(16 - k.leading_zeros());
        self.memory.pointer(addr + first, end - first).wrapping_sub(first as usize).cast()
    }

    /// Lines and byte count of the active lanes' span at `addr`.
    #[inline(always)]
    fn lines_masked(&mut self, k: u16, addr: u64) -> u8 {
        if !E::LINES || k == 0 {
            return 0;
        }
        let first = 4 * u64::from(k.trailing_zeros());
        let end = 4 * u64::from(16 - k.leading_zeros());
        self.lines_of(addr + first, end - first)
    }

    /// Host pointer for the active lanes of an indexed access, each of which must lie inside the arena.
    #[inline(always)]
    fn indexed_pointer(&self, k: u16, base: Addr, index: L::I) -> *mut i32 {
        let outside = k & !self.inside(base, index);
        if outside != 0 {
            let addr = Self::address(base, Self::lane(index, outside.trailing_zeros()));
            out_of_range(addr, 4, self.memory.used_bytes());
        }
        self.memory.base().wrapping_add(base.0 as usize).cast()
    }

    /// Lane `lane` of `a`.
    #[inline(always)]
    fn lane(a: L::I, lane: u32) -> i32 {
        L::to_i(a)[lane as usize % LANES]
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

    /// The stack line for the next transfer between lanes and scalars.
    #[inline(always)]
    fn next_transfer_line(&mut self) -> u32 {
        self.transfer_slot = (self.transfer_slot + 1) % TRANSFER_SLOTS;
        STACK_BASE_LINE + self.transfer_slot
    }

    #[inline(always)]
    fn constant<T>(&mut self, class: Class, v: T) -> Value<T, E::Id> {
        let lines = if E::LINES {
            self.emit.line(CONSTANT_LINE);
            1
        } else {
            0
        };
        Value { v, id: self.emit.memory(class, [], lines) }
    }

    #[inline(always)]
    #[expect(unsafe_code, reason = "the range is checked just before")]
    fn load(&mut self, base: Addr, index: Value<i32, E::Id>) -> Value<L::I, E::Id> {
        let addr = Self::address(base, index.v);
        let from = self.memory.pointer(addr, 64);
        // SAFETY: `pointer` checked 64 bytes.
        let v = unsafe { L::load(from.cast()) };
        let lines = self.lines_of(addr, 64);
        Value { v, id: self.emit.memory(Class::VectorLoad, [index.id], lines) }
    }

    #[inline(always)]
    #[expect(unsafe_code, reason = "the range is checked just before")]
    fn load_or(
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
    fn store(&mut self, k: Value<u16, E::Id>, base: Addr, index: Value<i32, E::Id>, a: Value<L::I, E::Id>) {
        let addr = Self::address(base, index.v);
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
    #[expect(unsafe_code, reason = "the range is checked just before")]
    fn gather(
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
    fn scatter(
        &mut self,
        k: Value<u16, E::Id>,
        base: Addr,
        index: Value<L::I, E::Id>,
        a: Value<L::I, E::Id>,
    ) {
        let to = self.indexed_pointer(k.v, base, index.v);
        // SAFETY: `indexed_pointer` checked the active lanes.
        unsafe { L::scatter(k.v, to, index.v, a.v) };
        let lines = self.lines_indexed(k.v, base, index.v);
        self.emit.under_mask(k.v);
        self.emit.reads([index.id, a.id]);
        self.emit.memory(Class::Scatter, [k.id, index.id, a.id], lines);
    }

    #[inline(always)]
    fn broadcast(&mut self, base: Addr, index: Value<i32, E::Id>) -> Value<L::I, E::Id> {
        let addr = Self::address(base, index.v);
        let v = L::splat_i(i32::from_le_bytes(self.memory.get(Addr(addr))));
        let lines = self.line_of(addr);
        Value { v, id: self.emit.memory(Class::VectorBroadcastLoad, [index.id], lines) }
    }

    #[inline(always)]
    fn shuffle(&mut self, a: Value<L::F, E::Id>, index: [i32; LANES]) -> Value<L::F, E::Id> {
        let v = L::from_bits(L::permute(L::bits(a.v), L::from_i(index)));
        self.emit.reads([a.id]);
        Value { v, id: self.emit.alu(Class::VectorShuffle, [a.id]) }
    }

    #[inline(always)]
    fn prefetch(&mut self, class: Class, base: Addr, index: Value<i32, E::Id>) {
        let addr = Self::address(base, index.v);
        let lines = if addr < self.memory.used_bytes() { self.line_of(addr) } else { 0 };
        self.emit.memory(class, [index.id], lines);
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

macro_rules! implement_vpu {
    (
        float_binary { $($fb:ident, $fb_or:ident, $fbc:ident, [$fba:ident $fbb:ident], $fbe:expr, $fbd:literal;)+ }
        float_ternary { $($ft:ident, $ft_or:ident, $ftc:ident, [$fta:ident $ftb:ident $ftc2:ident], $fte:expr, $ftd:literal;)+ }
        float_unary { $($fu:ident, $fu_or:ident, $fuc:ident, [$fua:ident], $fue:expr, $fud:literal;)+ }
        int_binary { $($ib:ident, $ib_or:ident, $ibc:ident, [$iba:ident $ibb:ident], $ibe:expr, $ibd:literal;)+ }
        float_compare { $($fc:ident, $fc_masked:ident, $fcc:ident, [$fca:ident $fcb:ident], $fce:expr, $fcd:literal;)+ }
        int_compare { $($ic:ident, $ic_masked:ident, $icc:ident, [$ica:ident $icb:ident], $ice:expr, $icd:literal;)+ }
        to_int { $($ti:ident, $ti_or:ident, $tic:ident, [$tia:ident], $tie:expr, $tid:literal;)+ }
        to_float { $($tf:ident, $tf_or:ident, $tfc:ident, [$tfa:ident], $tfe:expr, $tfd:literal;)+ }
        mask_binary { $($mb:ident, $mbc:ident, [$mba:ident $mbb:ident], $mbe:expr, $mbd:literal;)+ }
        scalar_binary { $($sb:ident, $sbc:ident, [$sba:ident $sbb:ident], $sbe:expr, $sbd:literal;)+ }
    ) => {
        impl<L: Lanes, E: Emit> Vpu for Backend<'_, L, E> {
            type F32 = Value<L::F, E::Id>;
            type I32 = Value<L::I, E::Id>;
            type Mask = Value<u16, E::Id>;
            type S32 = Value<i32, E::Id>;

            implement_vpu!(@binary F32, blend_f, $($fb, $fb_or, $fbc, [$fba $fbb], $fbe;)+);
            implement_vpu!(@binary I32, blend_i, $($ib, $ib_or, $ibc, [$iba $ibb], $ibe;)+);
            implement_vpu!(@unary F32, F32, blend_f, $($fu, $fu_or, $fuc, [$fua], $fue;)+);
            implement_vpu!(@unary F32, I32, blend_i, $($ti, $ti_or, $tic, [$tia], $tie;)+);
            implement_vpu!(@unary I32, F32, blend_f, $($tf, $tf_or, $tfc, [$tfa], $tfe;)+);
            implement_vpu!(@compare F32, $($fc, $fc_masked, $fcc, [$fca $fcb], $fce;)+);
            implement_vpu!(@compare I32, $($ic, $ic_masked, $icc, [$ica $icb], $ice;)+);
            implement_vpu!(@plain Mask, $($mb, $mbc, [$mba $mbb], $mbe;)+);
            implement_vpu!(@plain S32, $($sb, $sbc, [$sba $sbb], $sbe;)+);

            $(
                #[inline(always)]
                fn $ft(&mut self, $fta: Self::F32, $ftb: Self::F32, $ftc2: Self::F32) -> Self::F32 {
                    self.emit.reads([$fta.id, $ftb.id, $ftc2.id]);
                    let id = self.emit.alu(Class::$ftc, [$fta.id, $ftb.id, $ftc2.id]);
                    let ($fta, $ftb, $ftc2) = ($fta.v, $ftb.v, $ftc2.v);
                    Value { v: $fte, id }
                }
                #[inline(always)]
                fn $ft_or(
                    &mut self, or: Self::F32, k: Self::Mask, $fta: Self::F32, $ftb: Self::F32, $ftc2: Self::F32,
                ) -> Self::F32 {
                    self.emit.under_mask(k.v);
                    self.emit.reads([or.id, $fta.id, $ftb.id, $ftc2.id]);
                    let id = self.emit.alu(Class::$ftc, [or.id, k.id, $fta.id, $ftb.id, $ftc2.id]);
                    let ($fta, $ftb, $ftc2) = ($fta.v, $ftb.v, $ftc2.v);
                    Value { v: L::blend_f(k.v, $fte, or.v), id }
                }
            )+

            #[inline(always)]
            fn vset_f32(&mut self, value: f32) -> Self::F32 {
                self.constant(Class::VectorBroadcastLoad, L::splat_f(value))
            }
            #[inline(always)]
            fn vset_i32(&mut self, value: i32) -> Self::I32 {
                self.constant(Class::VectorBroadcastLoad, L::splat_i(value))
            }
            #[inline(always)]
            fn viota(&mut self) -> Self::I32 {
                self.constant(Class::VectorLoad, L::from_i(core::array::from_fn(|i| i as i32)))
            }
            #[inline(always)]
            fn bits_of(&mut self, a: Self::F32) -> Self::I32 {
                Self::observe(a)
            }
            #[inline(always)]
            fn from_bits(&mut self, a: Self::I32) -> Self::F32 {
                Self::as_float(a)
            }
            #[inline(always)]
            fn vblend_f32(&mut self, k: Self::Mask, on: Self::F32, off: Self::F32) -> Self::F32 {
                self.emit.reads([on.id, off.id]);
                let id = self.emit.alu(Class::VectorAlu, [k.id, on.id, off.id]);
                Value { v: L::blend_f(k.v, on.v, off.v), id }
            }
            #[inline(always)]
            fn vblend_i32(&mut self, k: Self::Mask, on: Self::I32, off: Self::I32) -> Self::I32 {
                self.emit.reads([on.id, off.id]);
                let id = self.emit.alu(Class::VectorAlu, [k.id, on.id, off.id]);
                Value { v: L::blend_i(k.v, on.v, off.v), id }
            }
            #[inline(always)]
            fn vpermute_f32(&mut self, a: Self::F32, index: Self::I32) -> Self::F32 {
                self.emit.reads([a.id, index.id]);
                let id = self.emit.alu(Class::VectorShuffle, [a.id, index.id]);
                Value { v: L::from_bits(L::permute(L::bits(a.v), index.v)), id }
            }
            #[inline(always)]
            fn vswizzle_cdab(&mut self, a: Self::F32) -> Self::F32 {
                self.shuffle(a, core::array::from_fn(|i| i as i32 ^ 1))
            }
            #[inline(always)]
            fn vswizzle_badc(&mut self, a: Self::F32) -> Self::F32 {
                self.shuffle(a, core::array::from_fn(|i| i as i32 ^ 2))
            }
            #[inline(always)]
            fn vpermute_quads_cdab(&mut self, a: Self::F32) -> Self::F32 {
                self.shuffle(a, core::array::from_fn(|i| i as i32 ^ 4))
            }
            #[inline(always)]
            fn vpermute_quads_badc(&mut self, a: Self::F32) -> Self::F32 {
                self.shuffle(a, core::array::from_fn(|i| i as i32 ^ 8))
            }
            #[inline(always)]
            fn vextract(&mut self, a: Self::I32, lane: u32) -> Self::S32 {
                let line = self.next_transfer_line();
                let lines = if E::LINES { 1 } else { 0 };
                self.emit.line(line);
                self.emit.reads([a.id]);
                let stored = self.emit.memory(Class::VectorStore, [a.id], lines);
                self.emit.line(line);
                let id = self.emit.memory(Class::ScalarLoad, [stored], lines);
                Value { v: Self::lane(a.v, lane), id }
            }
            #[inline(always)]
            fn vsplat(&mut self, a: Self::S32) -> Self::I32 {
                let line = self.next_transfer_line();
                let lines = if E::LINES { 1 } else { 0 };
                self.emit.line(line);
                let stored = self.emit.memory(Class::ScalarStore, [a.id], lines);
                self.emit.line(line);
                let id = self.emit.memory(Class::VectorBroadcastLoad, [stored], lines);
                Value { v: L::splat_i(a.v), id }
            }

            #[inline(always)]
            fn mask_all(&mut self) -> Self::Mask {
                Value { v: u16::MAX, id: self.emit.alu(Class::Mask, []) }
            }
            #[inline(always)]
            fn mask_none(&mut self) -> Self::Mask {
                Value { v: 0, id: self.emit.alu(Class::Mask, []) }
            }
            #[inline(always)]
            fn knot(&mut self, a: Self::Mask) -> Self::Mask {
                Value { v: !a.v, id: self.emit.alu(Class::Mask, [a.id]) }
            }
            #[inline(always)]
            fn kmov_to_scalar(&mut self, a: Self::Mask) -> Self::S32 {
                Value { v: i32::from(a.v), id: self.emit.alu(Class::Mask, [a.id]) }
            }
            #[inline(always)]
            fn kmov_from_scalar(&mut self, a: Self::S32) -> Self::Mask {
                Value { v: a.v as u16, id: self.emit.alu(Class::Mask, [a.id]) }
            }

            #[inline(always)]
            fn vload_f32(&mut self, base: Addr, index: Self::S32) -> Self::F32 {
                let loaded = self.load(base, index);
                Self::as_float(loaded)
            }
            #[inline(always)]
            fn vload_i32(&mut self, base: Addr, index: Self::S32) -> Self::I32 {
                self.load(base, index)
            }
            #[inline(always)]
            fn vload_f32_or(&mut self, or: Self::F32, k: Self::Mask, base: Addr, index: Self::S32) -> Self::F32 {
                let loaded = self.load_or(Self::as_bits(or), k, base, index);
                Self::as_float(loaded)
            }
            #[inline(always)]
            fn vload_i32_or(&mut self, or: Self::I32, k: Self::Mask, base: Addr, index: Self::S32) -> Self::I32 {
                self.load_or(or, k, base, index)
            }
            #[inline(always)]
            fn vbroadcast_f32(&mut self, base: Addr, index: Self::S32) -> Self::F32 {
                let loaded = self.broadcast(base, index);
                Self::as_float(loaded)
            }
            #[inline(always)]
            fn vbroadcast_i32(&mut self, base: Addr, index: Self::S32) -> Self::I32 {
                self.broadcast(base, index)
            }
            #[inline(always)]
            fn vstore_f32(&mut self, k: Self::Mask, base: Addr, index: Self::S32, a: Self::F32) {
                self.store(k, base, index, Self::observe(a));
            }
            #[inline(always)]
            fn vstore_i32(&mut self, k: Self::Mask, base: Addr, index: Self::S32, a: Self::I32) {
                self.store(k, base, index, a);
            }
            #[inline(always)]
            #[expect(unsafe_code, reason = "the range is checked just before")]
            fn vstore_stream(&mut self, base: Addr, index: Self::S32, a: Self::I32) {
                let addr = Self::address(base, index.v);
                assert!(addr.is_multiple_of(LINE_BYTES), "streaming store to {addr:#x}, which is no multiple of 64");
                let to = self.memory.pointer(addr, 64);
                // SAFETY: `pointer` checked 64 bytes.
                unsafe { L::store(to.cast(), a.v) };
                let lines = self.lines_of(addr, 64);
                self.emit.reads([a.id]);
                self.emit.memory(Class::VectorStreamStore, [index.id, a.id], lines);
            }
            #[inline(always)]
            #[expect(unsafe_code, reason = "the range is checked just before")]
            fn vexpand_i32_or(&mut self, or: Self::I32, k: Self::Mask, base: Addr, index: Self::S32) -> Self::I32 {
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
            #[inline(always)]
            #[expect(unsafe_code, reason = "the range is checked just before")]
            fn vcompress_i32(&mut self, k: Self::Mask, base: Addr, index: Self::S32, a: Self::I32) {
                let addr = Self::address(base, index.v);
                let bytes = 4 * u64::from(k.v.count_ones());
                let to = if k.v == 0 { core::ptr::null_mut() } else { self.memory.pointer(addr, bytes) };
                // SAFETY: `pointer` checked as many words as there are active lanes.
                unsafe { L::compress(k.v, to.cast(), a.v) };
                let lines = self.lines_of(addr, bytes);
                self.emit.under_mask(k.v);
                self.emit.reads([a.id]);
                self.emit.memory(Class::VectorCompress, [k.id, index.id, a.id], lines);
            }
            #[inline(always)]
            fn vgather_f32_or(&mut self, or: Self::F32, k: Self::Mask, base: Addr, index: Self::I32) -> Self::F32 {
                let gathered = self.gather(Self::as_bits(or), k, base, index);
                Self::as_float(gathered)
            }
            #[inline(always)]
            fn vgather_i32_or(&mut self, or: Self::I32, k: Self::Mask, base: Addr, index: Self::I32) -> Self::I32 {
                self.gather(or, k, base, index)
            }
            #[inline(always)]
            fn vscatter_f32(&mut self, k: Self::Mask, base: Addr, index: Self::I32, a: Self::F32) {
                self.scatter(k, base, index, Self::observe(a));
            }
            #[inline(always)]
            fn vscatter_i32(&mut self, k: Self::Mask, base: Addr, index: Self::I32, a: Self::I32) {
                self.scatter(k, base, index, a);
            }
            #[inline(always)]
            fn prefetch_l1(&mut self, base: Addr, index: Self::S32) {
                self.prefetch(Class::PrefetchL1, base, index);
            }
            #[inline(always)]
            fn prefetch_l2(&mut self, base: Addr, index: Self::S32) {
                self.prefetch(Class::PrefetchL2, base, index);
            }
            #[inline(always)]
            fn vgather_prefetch(&mut self, k: Self::Mask, base: Addr, index: Self::I32) {
                let lines = self.lines_indexed(k.v & self.inside(base, index.v), base, index.v);
                self.emit.under_mask(k.v);
                self.emit.reads([index.id]);
                self.emit.memory(Class::GatherPrefetch, [k.id, index.id], lines);
            }

            #[inline(always)]
            fn vatomic_add_or(
                &mut self, or: Self::I32, k: Self::Mask, base: Addr, index: Self::I32, a: Self::I32,
            ) -> Self::I32 {
                self.indexed_pointer(k.v, base, index.v);
                let (at, add, mut out) = (L::to_i(index.v), L::to_i(a.v), L::to_i(or.v));
                for lane in 0..LANES {
                    if k.v >> lane & 1 == 1 {
                        let word = self.memory.atomic(Addr(Self::address(base, at[lane])));
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
            #[inline(always)]
            fn vatomic_compare_exchange_or(
                &mut self, or: Self::I32, k: Self::Mask, base: Addr, index: Self::I32, expected: Self::I32, a: Self::I32,
            ) -> Self::I32 {
                self.indexed_pointer(k.v, base, index.v);
                let (at, want, new) = (L::to_i(index.v), L::to_i(expected.v), L::to_i(a.v));
                let mut out = L::to_i(or.v);
                for lane in 0..LANES {
                    if k.v >> lane & 1 == 1 {
                        let word = self.memory.atomic(Addr(Self::address(base, at[lane])));
                        out[lane] =
                            word.compare_exchange(want[lane], new[lane], Relaxed, Relaxed).unwrap_or_else(|old| old);
                    }
                }
                let id = self.emit_rounds(or, k, base, index, [expected.id, a.id]);
                Value { v: L::from_i(out), id }
            }
            #[inline(always)]
            fn s_atomic_add(&mut self, base: Addr, index: Self::S32, a: Self::S32) -> Self::S32 {
                let addr = Self::address(base, index.v);
                let v = self.memory.atomic(Addr(addr)).fetch_add(a.v, Relaxed);
                let lines = self.line_of(addr);
                Value { v, id: self.emit.memory(Class::Atomic, [index.id, a.id], lines) }
            }
            #[inline(always)]
            fn s_atomic_compare_exchange(
                &mut self, base: Addr, index: Self::S32, expected: Self::S32, a: Self::S32,
            ) -> Self::S32 {
                let addr = Self::address(base, index.v);
                let word = self.memory.atomic(Addr(addr));
                let v = word.compare_exchange(expected.v, a.v, Relaxed, Relaxed).unwrap_or_else(|old| old);
                let lines = self.line_of(addr);
                Value { v, id: self.emit.memory(Class::Atomic, [index.id, expected.id, a.id], lines) }
            }

            #[inline(always)]
            fn s_imm(&mut self, value: i32) -> Self::S32 {
                Value { v: value, id: E::NONE }
            }
            #[inline(always)]
            fn s_load(&mut self, base: Addr, index: Self::S32) -> Self::S32 {
                let addr = Self::address(base, index.v);
                let v = i32::from_le_bytes(self.memory.get(Addr(addr)));
                let lines = self.line_of(addr);
                Value { v, id: self.emit.memory(Class::ScalarLoad, [index.id], lines) }
            }
            #[inline(always)]
            fn s_store(&mut self, base: Addr, index: Self::S32, a: Self::S32) {
                let addr = Self::address(base, index.v);
                self.memory.put(Addr(addr), a.v.to_le_bytes());
                let lines = self.line_of(addr);
                self.emit.memory(Class::ScalarStore, [index.id, a.id], lines);
            }
            #[inline(always)]
            fn s_tzcnt(&mut self, a: Self::S32) -> Self::S32 {
                Value { v: a.v.trailing_zeros() as i32, id: self.emit.alu(Class::ScalarAlu, [a.id]) }
            }
            #[inline(always)]
            fn s_popcnt(&mut self, a: Self::S32) -> Self::S32 {
                Value { v: a.v.count_ones() as i32, id: self.emit.alu(Class::ScalarAlu, [a.id]) }
            }
            #[inline(always)]
            fn branch(&mut self, compare: Compare, a: Self::S32, b: Self::S32) -> bool {
                let flags = self.emit.alu(Class::ScalarAlu, [a.id, b.id]);
                self.emit.alu(Class::Branch, [flags]);
                compare.holds(a.v, b.v)
            }
            #[inline(always)]
            fn branch_any(&mut self, k: Self::Mask) -> bool {
                let flags = self.emit.alu(Class::Mask, [k.id]);
                self.emit.alu(Class::Branch, [flags]);
                k.v != 0
            }
            #[inline(always)]
            fn branch_all(&mut self, k: Self::Mask) -> bool {
                let flags = self.emit.alu(Class::Mask, [k.id]);
                self.emit.alu(Class::Branch, [flags]);
                k.v == u16::MAX
            }
        }
    };

    (@binary $T:ident, $blend:ident, $($name:ident, $name_or:ident, $class:ident, [$a:ident $b:ident], $e:expr;)+) => { $(
        #[inline(always)]
        fn $name(&mut self, $a: Self::$T, $b: Self::$T) -> Self::$T {
            self.emit.reads([$a.id, $b.id]);
            let id = self.emit.alu(Class::$class, [$a.id, $b.id]);
            let ($a, $b) = ($a.v, $b.v);
            Value { v: $e, id }
        }
        #[inline(always)]
        fn $name_or(&mut self, or: Self::$T, k: Self::Mask, $a: Self::$T, $b: Self::$T) -> Self::$T {
            self.emit.under_mask(k.v);
            self.emit.reads([or.id, $a.id, $b.id]);
            let id = self.emit.alu(Class::$class, [or.id, k.id, $a.id, $b.id]);
            let ($a, $b) = ($a.v, $b.v);
            Value { v: L::$blend(k.v, $e, or.v), id }
        }
    )+ };
    (@unary $A:ident, $R:ident, $blend:ident, $($name:ident, $name_or:ident, $class:ident, [$a:ident], $e:expr;)+) => { $(
        #[inline(always)]
        fn $name(&mut self, $a: Self::$A) -> Self::$R {
            self.emit.reads([$a.id]);
            let id = self.emit.alu(Class::$class, [$a.id]);
            let $a = $a.v;
            Value { v: $e, id }
        }
        #[inline(always)]
        fn $name_or(&mut self, or: Self::$R, k: Self::Mask, $a: Self::$A) -> Self::$R {
            self.emit.under_mask(k.v);
            self.emit.reads([or.id, $a.id]);
            let id = self.emit.alu(Class::$class, [or.id, k.id, $a.id]);
            let $a = $a.v;
            Value { v: L::$blend(k.v, $e, or.v), id }
        }
    )+ };
    (@compare $T:ident, $($name:ident, $name_masked:ident, $class:ident, [$a:ident $b:ident], $e:expr;)+) => { $(
        #[inline(always)]
        fn $name(&mut self, $a: Self::$T, $b: Self::$T) -> Self::Mask {
            self.emit.reads([$a.id, $b.id]);
            let id = self.emit.alu(Class::$class, [$a.id, $b.id]);
            let ($a, $b) = ($a.v, $b.v);
            Value { v: $e, id }
        }
        #[inline(always)]
        fn $name_masked(&mut self, k: Self::Mask, $a: Self::$T, $b: Self::$T) -> Self::Mask {
            self.emit.under_mask(k.v);
            self.emit.reads([$a.id, $b.id]);
            let id = self.emit.alu(Class::$class, [k.id, $a.id, $b.id]);
            let ($a, $b) = ($a.v, $b.v);
            Value { v: k.v & $e, id }
        }
    )+ };
    (@plain $T:ident, $($name:ident, $class:ident, [$a:ident $b:ident], $e:expr;)+) => { $(
        #[inline(always)]
        fn $name(&mut self, $a: Self::$T, $b: Self::$T) -> Self::$T {
            let id = self.emit.alu(Class::$class, [$a.id, $b.id]);
            let ($a, $b) = ($a.v, $b.v);
            Value { v: $e, id }
        }
    )+ };
}
for_each_operation!(implement_vpu);
