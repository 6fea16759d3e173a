//! The operations of [`Vpu`]: the rows of the table by their meaning, the others one by one.

use core::sync::atomic::Ordering::Relaxed;

use super::{Backend, Value};
use crate::arena::Addr;
use crate::emit::Emit;
use crate::lanes::Lanes;
use crate::uop::Class;
use crate::vpu::{Compare, Stacked, Vpu, for_each_operation};

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
            fn vstack_i32(&mut self, slot: u32, a: Self::I32) -> Stacked<Self::I32> {
                self.emit.line(Self::slot_line(slot));
                self.emit.reads([a.id]);
                let id = self.emit.memory(Class::VectorStore, [a.id], if E::LINES { 1 } else { 0 });
                Stacked { slot, value: Value { v: a.v, id } }
            }
            #[inline(always)]
            fn vunstack_i32(&mut self, a: Stacked<Self::I32>) -> Self::I32 {
                self.emit.line(Self::slot_line(a.slot));
                let lines = if E::LINES { 1 } else { 0 };
                Value { v: a.value.v, id: self.emit.memory(Class::VectorLoad, [a.value.id], lines) }
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
            fn vstore_stream(&mut self, base: Addr, index: Self::S32, a: Self::I32) {
                self.store_stream(base, index, a);
            }
            #[inline(always)]
            fn vexpand_i32_or(&mut self, or: Self::I32, k: Self::Mask, base: Addr, index: Self::S32) -> Self::I32 {
                self.expand_or(or, k, base, index)
            }
            #[inline(always)]
            fn vcompress_i32(&mut self, k: Self::Mask, base: Addr, index: Self::S32, a: Self::I32) {
                self.compress(k, base, index, a);
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
                self.add_or(or, k, base, index, a)
            }
            #[inline(always)]
            fn vatomic_compare_exchange_or(
                &mut self, or: Self::I32, k: Self::Mask, base: Addr, index: Self::I32, expected: Self::I32, a: Self::I32,
            ) -> Self::I32 {
                self.compare_exchange_or(or, k, base, index, expected, a)
            }
            #[inline(always)]
            fn s_atomic_add(&mut self, base: Addr, index: Self::S32, a: Self::S32) -> Self::S32 {
                let addr = Self::address(base, index.v);
                self.memory.claim_addition(addr);
                let v = self.memory.atomic(Addr(addr)).fetch_add(a.v, Relaxed);
                let lines = self.line_of(addr);
                Value { v, id: self.emit.memory(Class::Atomic, [index.id, a.id], lines) }
            }
            #[inline(always)]
            fn s_atomic_compare_exchange(
                &mut self, base: Addr, index: Self::S32, expected: Self::S32, a: Self::S32,
            ) -> Self::S32 {
                let addr = Self::address(base, index.v);
                self.memory.claim(addr);
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
                self.memory.claim(addr);
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
