//! The intrinsic-like layer: every operation that a kernel may use.
//!
//! The vector operations are rows of one table, `for_each_operation!`: name, merging form, class, meaning and doc. The
//! table makes the methods of [`Vpu`], their implementation in [`Backend`](crate::backend::Backend) and the tests.
//!
//! Conventions: `a`, `b`, `c` are operands; `k` is a mask of 16 bits, lane 0 lowest; merging forms end in `_or` and take
//! *fallback, mask, operands*; compares under a mask end in `_masked`. Floats round to nearest even, with denormals. A
//! NaN is one value: whatever its payload, it is observed (stored, or seen as bits) as `0x7fc00000`.
//! Addresses are a constant base plus four times an index, which is how x86 addresses arrays. Masked-off lanes issue no
//! request and cannot fault; an active lane outside the arena is a defect of the kernel and stops the run. Vector indices
//! reach 2^31 words past the base, scalar ones 2^32. A prefetch outside the arena asks for no line.

use crate::arena::Addr;

/// A vector on a thread's stack, which takes no register: [`Vpu::vstack_i32`] puts it there.
#[derive(Debug, Clone, Copy)]
pub struct Stacked<T> {
    pub(crate) slot: u32,
    pub(crate) value: T,
}

/// How two scalars are compared before a branch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Compare {
    /// `a < b`, signed.
    Less,
    /// `a <= b`, signed.
    LessEqual,
    /// `a == b`.
    Equal,
    /// `a != b`.
    NotEqual,
}

impl Compare {
    /// What the comparison says of `a` and `b`.
    #[inline(always)]
    pub fn holds(self, a: i32, b: i32) -> bool {
        match self {
            Compare::Less => a < b,
            Compare::LessEqual => a <= b,
            Compare::Equal => a == b,
            Compare::NotEqual => a != b,
        }
    }
}

/// The operation table: calls `$callback!` with all rows.
///
/// Row: `name, form under a mask, class, [operands], meaning on host lanes L, doc`.
macro_rules! for_each_operation {
    ($callback:ident) => {
        $callback! {
            float_binary {
                vadd, vadd_or, VectorAlu, [a b], L::add(a, b), "`a[i] + b[i]`";
                vsub, vsub_or, VectorAlu, [a b], L::sub(a, b), "`a[i] - b[i]`";
                vmul, vmul_or, VectorMul, [a b], L::mul(a, b), "`a[i] * b[i]`";
                vmin, vmin_or, VectorAlu, [a b], L::min(a, b), "`a[i] < b[i] ? a[i] : b[i]`";
                vmax, vmax_or, VectorAlu, [a b], L::max(a, b), "`a[i] > b[i] ? a[i] : b[i]`";
            }
            float_ternary {
                vmadd, vmadd_or, VectorFma, [a b c], L::madd(a, b, c), "`a[i] * b[i] + c[i]`, rounded once";
                vmsub, vmsub_or, VectorFma, [a b c], L::msub(a, b, c), "`a[i] * b[i] - c[i]`, rounded once";
                vnmadd, vnmadd_or, VectorFma, [a b c], L::nmadd(a, b, c), "`c[i] - a[i] * b[i]`, rounded once";
            }
            float_unary {
                vrcp, vrcp_or, VectorMath, [a], L::rcp(a), "`1 / a[i]`, correctly rounded";
                vrsqrt, vrsqrt_or, VectorMath, [a], L::rsqrt(a),
                    "`1 / sqrt(a[i])`, square root and quotient each correctly rounded";
                vfloor, vfloor_or, VectorConvert, [a], L::floor(a), "greatest whole number not above `a[i]`";
                vround, vround_or, VectorConvert, [a], L::nearest(a), "nearest whole number, ties to even";
                vabs, vabs_or, VectorAlu, [a], L::from_bits(L::and(L::bits(a), L::splat_i(i32::MAX))), "`|a[i]|`";
            }
            int_binary {
                viadd, viadd_or, VectorAlu, [a b], L::iadd(a, b), "`a[i] + b[i]`, wrapping";
                visub, visub_or, VectorAlu, [a b], L::isub(a, b), "`a[i] - b[i]`, wrapping";
                vimul, vimul_or, VectorMul, [a b], L::imul(a, b), "low half of `a[i] * b[i]`";
                vimin, vimin_or, VectorAlu, [a b], L::imin(a, b), "lesser, signed";
                vimax, vimax_or, VectorAlu, [a b], L::imax(a, b), "greater, signed";
                vand, vand_or, VectorAlu, [a b], L::and(a, b), "`a[i] & b[i]`";
                vor, vor_or, VectorAlu, [a b], L::or(a, b), "`a[i] | b[i]`";
                vxor, vxor_or, VectorAlu, [a b], L::xor(a, b), "`a[i] ^ b[i]`";
                vandn, vandn_or, VectorAlu, [a b], L::andn(a, b), "`!a[i] & b[i]`";
                vsll, vsll_or, VectorAlu, [a b], L::sll(a, b), "`a[i] << b[i]`; 0 from 32 places on";
                vsrl, vsrl_or, VectorAlu, [a b], L::srl(a, b), "`a[i] >> b[i]`, unsigned; 0 from 32 places on";
                vsra, vsra_or, VectorAlu, [a b], L::sra(a, b), "`a[i] >> b[i]`, signed; the sign from 32 places on";
                vpermute, vpermute_or, VectorShuffle, [a b], L::permute(a, b), "`a[b[i] & 15]`";
            }
            float_compare {
                vcmp_lt, vcmp_lt_masked, VectorCompare, [a b], L::lt(a, b), "`a[i] < b[i]`; false for a NaN";
                vcmp_le, vcmp_le_masked, VectorCompare, [a b], L::le(a, b), "`a[i] <= b[i]`; false for a NaN";
                vcmp_gt, vcmp_gt_masked, VectorCompare, [a b], L::lt(b, a), "`a[i] > b[i]`; false for a NaN";
                vcmp_ge, vcmp_ge_masked, VectorCompare, [a b], L::le(b, a), "`a[i] >= b[i]`; false for a NaN";
                vcmp_eq, vcmp_eq_masked, VectorCompare, [a b], L::eq(a, b), "`a[i] == b[i]`; false for a NaN";
                vcmp_neq, vcmp_neq_masked, VectorCompare, [a b], !L::eq(a, b), "`a[i] != b[i]`; true for a NaN";
            }
            int_compare {
                vicmp_lt, vicmp_lt_masked, VectorCompare, [a b], L::ilt(a, b), "`a[i] < b[i]`, signed";
                vicmp_gt, vicmp_gt_masked, VectorCompare, [a b], L::ilt(b, a), "`a[i] > b[i]`, signed";
                vicmp_ge, vicmp_ge_masked, VectorCompare, [a b], !L::ilt(a, b), "`a[i] >= b[i]`, signed";
                vicmp_eq, vicmp_eq_masked, VectorCompare, [a b], L::ieq(a, b), "`a[i] == b[i]`";
                vicmp_neq, vicmp_neq_masked, VectorCompare, [a b], !L::ieq(a, b), "`a[i] != b[i]`";
                vucmp_lt, vucmp_lt_masked, VectorCompare, [a b], L::ult(a, b), "`a[i] < b[i]`, unsigned";
            }
            to_int {
                vcvt_f32_i32, vcvt_f32_i32_or, VectorConvert, [a], L::to_int(a),
                    "`a[i]` towards zero; `i32::MIN` for a NaN and for what does not fit";
            }
            to_float {
                vcvt_i32_f32, vcvt_i32_f32_or, VectorConvert, [a], L::to_float(a), "`a[i]` as a float, nearest even";
            }
            mask_binary {
                kand, Mask, [a b], a & b, "`a & b`";
                kandn, Mask, [a b], !a & b, "`!a & b`";
                kor, Mask, [a b], a | b, "`a | b`";
                kxor, Mask, [a b], a ^ b, "`a ^ b`";
                kxnor, Mask, [a b], !(a ^ b), "`!(a ^ b)`";
            }
            scalar_binary {
                s_add, ScalarAlu, [a b], a.wrapping_add(b), "`a + b`, wrapping";
                s_sub, ScalarAlu, [a b], a.wrapping_sub(b), "`a - b`, wrapping";
                s_mul, ScalarMul, [a b], a.wrapping_mul(b), "low half of `a * b`";
                s_and, ScalarAlu, [a b], a & b, "`a & b`";
                s_or, ScalarAlu, [a b], a | b, "`a | b`";
                s_xor, ScalarAlu, [a b], a ^ b, "`a ^ b`";
                s_shl, ScalarAlu, [a b], a.wrapping_shl(b as u32), "`a << (b & 31)`";
                s_shr, ScalarAlu, [a b], (a as u32).wrapping_shr(b as u32) as i32, "`a >> (b & 31)`, unsigned";
            }
        }
    };
}
pub(crate) use for_each_operation;

macro_rules! define_vpu {
    (
        float_binary { $($fb:ident, $fb_or:ident, $fbc:ident, [$($fbo:ident)+], $fbe:expr, $fbd:literal;)+ }
        float_ternary { $($ft:ident, $ft_or:ident, $ftc:ident, [$($fto:ident)+], $fte:expr, $ftd:literal;)+ }
        float_unary { $($fu:ident, $fu_or:ident, $fuc:ident, [$($fuo:ident)+], $fue:expr, $fud:literal;)+ }
        int_binary { $($ib:ident, $ib_or:ident, $ibc:ident, [$($ibo:ident)+], $ibe:expr, $ibd:literal;)+ }
        float_compare { $($fc:ident, $fc_masked:ident, $fcc:ident, [$($fco:ident)+], $fce:expr, $fcd:literal;)+ }
        int_compare { $($ic:ident, $ic_masked:ident, $icc:ident, [$($ico:ident)+], $ice:expr, $icd:literal;)+ }
        to_int { $($ti:ident, $ti_or:ident, $tic:ident, [$($tio:ident)+], $tie:expr, $tid:literal;)+ }
        to_float { $($tf:ident, $tf_or:ident, $tfc:ident, [$($tfo:ident)+], $tfe:expr, $tfd:literal;)+ }
        mask_binary { $($mb:ident, $mbc:ident, [$($mbo:ident)+], $mbe:expr, $mbd:literal;)+ }
        scalar_binary { $($sb:ident, $sbc:ident, [$($sbo:ident)+], $sbe:expr, $sbd:literal;)+ }
    ) => {
        #[expect(clippy::wrong_self_convention, reason = "`from_bits` is named for what it does to its operand")]
        /// The operations of one hardware thread's vector and scalar units; see the module's conventions.
        pub trait Vpu {
            /// A vector register of 16 floats.
            type F32: Copy;
            /// A vector register of 16 integers of 32 bits.
            type I32: Copy;
            /// A mask register of 16 bits, one a lane.
            type Mask: Copy;
            /// A scalar register of 32 bits.
            type S32: Copy;

            $(#[doc = $fbd] #[doc = "in every lane `i`."] fn $fb(&mut self, a: Self::F32, b: Self::F32) -> Self::F32;
              #[doc = "`k[i] ?` "] #[doc = $fbd] #[doc = "`: or[i]`."]
              fn $fb_or(&mut self, or: Self::F32, k: Self::Mask, a: Self::F32, b: Self::F32) -> Self::F32;)+
            $(#[doc = $ftd] #[doc = "in every lane `i`."]
              fn $ft(&mut self, a: Self::F32, b: Self::F32, c: Self::F32) -> Self::F32;
              #[doc = "`k[i] ?` "] #[doc = $ftd] #[doc = "`: or[i]`."]
              fn $ft_or(&mut self, or: Self::F32, k: Self::Mask, a: Self::F32, b: Self::F32, c: Self::F32) -> Self::F32;)+
            $(#[doc = $fud] #[doc = "in every lane `i`."] fn $fu(&mut self, a: Self::F32) -> Self::F32;
              #[doc = "`k[i] ?` "] #[doc = $fud] #[doc = "`: or[i]`."]
              fn $fu_or(&mut self, or: Self::F32, k: Self::Mask, a: Self::F32) -> Self::F32;)+
            $(#[doc = $ibd] #[doc = "in every lane `i`."] fn $ib(&mut self, a: Self::I32, b: Self::I32) -> Self::I32;
              #[doc = "`k[i] ?` "] #[doc = $ibd] #[doc = "`: or[i]`."]
              fn $ib_or(&mut self, or: Self::I32, k: Self::Mask, a: Self::I32, b: Self::I32) -> Self::I32;)+
            $(#[doc = $fcd] #[doc = "in every lane `i`."] fn $fc(&mut self, a: Self::F32, b: Self::F32) -> Self::Mask;
              #[doc = "`k[i] &&` "] #[doc = $fcd]
              fn $fc_masked(&mut self, k: Self::Mask, a: Self::F32, b: Self::F32) -> Self::Mask;)+
            $(#[doc = $icd] #[doc = "in every lane `i`."] fn $ic(&mut self, a: Self::I32, b: Self::I32) -> Self::Mask;
              #[doc = "`k[i] &&` "] #[doc = $icd]
              fn $ic_masked(&mut self, k: Self::Mask, a: Self::I32, b: Self::I32) -> Self::Mask;)+
            $(#[doc = $tid] #[doc = "in every lane `i`."] fn $ti(&mut self, a: Self::F32) -> Self::I32;
              #[doc = "`k[i] ?` "] #[doc = $tid] #[doc = "`: or[i]`."]
              fn $ti_or(&mut self, or: Self::I32, k: Self::Mask, a: Self::F32) -> Self::I32;)+
            $(#[doc = $tfd] #[doc = "in every lane `i`."] fn $tf(&mut self, a: Self::I32) -> Self::F32;
              #[doc = "`k[i] ?` "] #[doc = $tfd] #[doc = "`: or[i]`."]
              fn $tf_or(&mut self, or: Self::F32, k: Self::Mask, a: Self::I32) -> Self::F32;)+
            $(#[doc = $mbd] #[doc = "in every bit."] fn $mb(&mut self, a: Self::Mask, b: Self::Mask) -> Self::Mask;)+
            $(#[doc = $sbd] #[doc = "."] fn $sb(&mut self, a: Self::S32, b: Self::S32) -> Self::S32;)+

            // ---- moves and constants

            /// `value` in every lane: a broadcast load from the constant pool.
            fn vset_f32(&mut self, value: f32) -> Self::F32;
            /// `value` in every lane: a broadcast load from the constant pool.
            fn vset_i32(&mut self, value: i32) -> Self::I32;
            /// Lane numbers 0 to 15: a load from the constant pool.
            fn viota(&mut self) -> Self::I32;
            /// The bits of `a`, unchanged but for NaN, which is canonical: the same register seen as integers, no uop.
            fn bits_of(&mut self, a: Self::F32) -> Self::I32;
            /// The float with the bits of `a`: the same register seen as floats, no uop.
            fn from_bits(&mut self, a: Self::I32) -> Self::F32;
            /// `k[i] ? on[i] : off[i]`.
            fn vblend_f32(&mut self, k: Self::Mask, on: Self::F32, off: Self::F32) -> Self::F32;
            /// `k[i] ? on[i] : off[i]`.
            fn vblend_i32(&mut self, k: Self::Mask, on: Self::I32, off: Self::I32) -> Self::I32;
            /// `a[index[i] & 15]`.
            fn vpermute_f32(&mut self, a: Self::F32, index: Self::I32) -> Self::F32;
            /// Swizzle CDAB: neighbours swapped.
            #[doc(alias = "CDAB")]
            fn vswizzle_cdab(&mut self, a: Self::F32) -> Self::F32;
            /// Swizzle BADC: the pairs of each four lanes swapped.
            #[doc(alias = "BADC")]
            fn vswizzle_badc(&mut self, a: Self::F32) -> Self::F32;
            /// Permute of the four-lane groups, neighbours swapped.
            #[doc(alias = "VPERMF32X4")]
            fn vpermute_quads_cdab(&mut self, a: Self::F32) -> Self::F32;
            /// Permute of the four-lane groups, halves swapped.
            #[doc(alias = "VPERMF32X4")]
            fn vpermute_quads_badc(&mut self, a: Self::F32) -> Self::F32;
            /// Lane `lane` of `a` as a scalar: through memory, as on the chip (a vector store and a scalar load).
            fn vextract(&mut self, a: Self::I32, lane: u32) -> Self::S32;
            /// The scalar in every lane: through memory, as on the chip (a scalar store and a broadcast load).
            fn vsplat(&mut self, a: Self::S32) -> Self::I32;
            /// Puts `a` into slot `slot` of the thread's stack, below
            /// [`STACK_SLOTS`](crate::arena::STACK_SLOTS): a store of one line. What comes back is for
            /// [`vunstack_i32`](Vpu::vunstack_i32); a slot holds what was put there last.
            fn vstack_i32(&mut self, slot: u32, a: Self::I32) -> Stacked<Self::I32>;
            /// What was put on the stack: a load of one line.
            fn vunstack_i32(&mut self, a: Stacked<Self::I32>) -> Self::I32;

            // ---- masks

            /// The mask of all lanes.
            fn mask_all(&mut self) -> Self::Mask;
            /// The mask of no lane.
            fn mask_none(&mut self) -> Self::Mask;
            /// `!a` in every bit.
            fn knot(&mut self, a: Self::Mask) -> Self::Mask;
            /// The mask as a scalar, bit `i` for lane `i`.
            #[doc(alias = "kmov")]
            fn kmov_to_scalar(&mut self, a: Self::Mask) -> Self::S32;
            /// The low 16 bits of a scalar as a mask.
            #[doc(alias = "kmov")]
            fn kmov_from_scalar(&mut self, a: Self::S32) -> Self::Mask;

            // ---- vector memory; `base + 4 * index`, consecutive elements unless gathered

            /// `mem[base + 4*(index + i)]`: one line, two when unaligned.
            fn vload_f32(&mut self, base: Addr, index: Self::S32) -> Self::F32;
            /// `mem[base + 4*(index + i)]`: one line, two when unaligned.
            fn vload_i32(&mut self, base: Addr, index: Self::S32) -> Self::I32;
            /// `k[i] ? mem[base + 4*(index + i)] : or[i]`.
            fn vload_f32_or(&mut self, or: Self::F32, k: Self::Mask, base: Addr, index: Self::S32) -> Self::F32;
            /// `k[i] ? mem[base + 4*(index + i)] : or[i]`.
            fn vload_i32_or(&mut self, or: Self::I32, k: Self::Mask, base: Addr, index: Self::S32) -> Self::I32;
            /// `mem[base + 4*index]` in every lane.
            #[doc(alias = "vbroadcastss")]
            fn vbroadcast_f32(&mut self, base: Addr, index: Self::S32) -> Self::F32;
            /// `mem[base + 4*index]` in every lane.
            #[doc(alias = "vpbroadcastd")]
            fn vbroadcast_i32(&mut self, base: Addr, index: Self::S32) -> Self::I32;
            /// `mem[base + 4*(index + i)] = a[i]` where `k[i]`.
            fn vstore_f32(&mut self, k: Self::Mask, base: Addr, index: Self::S32, a: Self::F32);
            /// `mem[base + 4*(index + i)] = a[i]` where `k[i]`.
            fn vstore_i32(&mut self, k: Self::Mask, base: Addr, index: Self::S32, a: Self::I32);
            /// Stores a whole line without reading it first; `base + 4*index` must be a multiple of 64.
            #[doc(alias = "vmovnraps")]
            fn vstore_stream(&mut self, base: Addr, index: Self::S32, a: Self::I32);
            /// Consecutive elements from `base + 4*index` on into the enabled lanes; `or[i]` in the others.
            #[doc(alias = "vloadunpack")]
            fn vexpand_i32_or(&mut self, or: Self::I32, k: Self::Mask, base: Addr, index: Self::S32) -> Self::I32;
            /// The enabled lanes to consecutive elements from `base + 4*index` on.
            #[doc(alias = "vpackstore")]
            fn vcompress_i32(&mut self, k: Self::Mask, base: Addr, index: Self::S32, a: Self::I32);
            /// `k[i] ? mem[base + 4*index[i]] : or[i]`. Requests: one per distinct line touched.
            #[doc(alias = "vgatherd")]
            fn vgather_f32_or(&mut self, or: Self::F32, k: Self::Mask, base: Addr, index: Self::I32) -> Self::F32;
            /// `k[i] ? mem[base + 4*index[i]] : or[i]`. Requests: one per distinct line touched.
            #[doc(alias = "vgatherd")]
            fn vgather_i32_or(&mut self, or: Self::I32, k: Self::Mask, base: Addr, index: Self::I32) -> Self::I32;
            /// `mem[base + 4*index[i]] = a[i]` where `k[i]`; of lanes with one address the highest stays.
            #[doc(alias = "vscatterd")]
            fn vscatter_f32(&mut self, k: Self::Mask, base: Addr, index: Self::I32, a: Self::F32);
            /// `mem[base + 4*index[i]] = a[i]` where `k[i]`; of lanes with one address the highest stays.
            #[doc(alias = "vscatterd")]
            fn vscatter_i32(&mut self, k: Self::Mask, base: Addr, index: Self::I32, a: Self::I32);
            /// Asks for the line of `base + 4*index` in L1; waits for nothing, changes nothing.
            #[doc(alias = "vprefetch0")]
            fn prefetch_l1(&mut self, base: Addr, index: Self::S32);
            /// Asks for the line of `base + 4*index` in L2; waits for nothing, changes nothing.
            #[doc(alias = "vprefetch1")]
            fn prefetch_l2(&mut self, base: Addr, index: Self::S32);
            /// Asks for the lines of the active lanes in L1; waits for nothing, changes nothing.
            #[doc(alias = "vgatherpf0")]
            fn vgather_prefetch(&mut self, k: Self::Mask, base: Addr, index: Self::I32);

            // ---- atomics

            /// For each active lane in order: returns `mem[base + 4*index[i]]` and adds `a[i]` to it.
            ///
            /// The gather-modify-scatter loop: lanes with one address take further rounds; a round is a gather that owns
            /// its lines, an add, a scatter, two mask operations and a branch. `or[i]` where `k[i]` is off.
            fn vatomic_add_or(
                &mut self, or: Self::I32, k: Self::Mask, base: Addr, index: Self::I32, a: Self::I32,
            ) -> Self::I32;
            /// For each active lane in order: returns `mem[base + 4*index[i]]`, which becomes `a[i]` where it equals
            /// `expected[i]`. Rounds as in [`Vpu::vatomic_add_or`].
            fn vatomic_compare_exchange_or(
                &mut self, or: Self::I32, k: Self::Mask, base: Addr, index: Self::I32, expected: Self::I32, a: Self::I32,
            ) -> Self::I32;
            /// Returns `mem[base + 4*index]` and adds `a` to it.
            #[doc(alias = "lock xadd")]
            fn s_atomic_add(&mut self, base: Addr, index: Self::S32, a: Self::S32) -> Self::S32;
            /// Returns `mem[base + 4*index]`, which becomes `a` if it equals `expected`.
            #[doc(alias = "lock cmpxchg")]
            fn s_atomic_compare_exchange(
                &mut self, base: Addr, index: Self::S32, expected: Self::S32, a: Self::S32,
            ) -> Self::S32;

            // ---- scalars and branches

            /// A constant: an immediate operand, no uop.
            fn s_imm(&mut self, value: i32) -> Self::S32;
            /// `mem[base + 4*index]`.
            fn s_load(&mut self, base: Addr, index: Self::S32) -> Self::S32;
            /// `mem[base + 4*index] = a`.
            fn s_store(&mut self, base: Addr, index: Self::S32, a: Self::S32);
            /// Number of zero bits below the lowest one bit of `a`; 32 for 0.
            #[doc(alias = "tzcnt")]
            fn s_tzcnt(&mut self, a: Self::S32) -> Self::S32;
            /// Number of one bits in `a`.
            #[doc(alias = "popcnt")]
            fn s_popcnt(&mut self, a: Self::S32) -> Self::S32;
            /// Compare and branch: two uops. The only road from simulated scalars to host control flow.
            fn branch(&mut self, compare: Compare, a: Self::S32, b: Self::S32) -> bool;
            /// Whether any bit is set: a mask test and a branch.
            #[doc(alias = "kortest")]
            fn branch_any(&mut self, k: Self::Mask) -> bool;
            /// Whether all 16 bits are set: a mask test and a branch.
            #[doc(alias = "kortest")]
            fn branch_all(&mut self, k: Self::Mask) -> bool;
        }
    };
}
for_each_operation!(define_vpu);
