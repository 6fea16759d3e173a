//! A kernel of one operation.

use crate::arena::Addr;
use crate::kernel::Kernel;
use crate::vpu::Vpu;

/// Operations that touch memory or move lanes, one a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Op {
    Load,
    LoadOr,
    Broadcast,
    Store,
    StoreStream,
    Expand,
    Compress,
    Gather,
    Scatter,
    AtomicAdd,
    AtomicCompareExchange,
    ScalarAtomicAdd,
    ScalarCompareExchange,
    ScalarLoad,
    ScalarStore,
    PrefetchL1,
    PrefetchL2,
    GatherPrefetch,
    Cdab,
    Badc,
    QuadsCdab,
    QuadsBadc,
    Extract,
    Splat,
    Blend,
    PermuteFloat,
    Bits,
    BranchAny,
}

pub(super) const OPS: [Op; 28] = [
    Op::Load,
    Op::LoadOr,
    Op::Broadcast,
    Op::Store,
    Op::StoreStream,
    Op::Expand,
    Op::Compress,
    Op::Gather,
    Op::Scatter,
    Op::AtomicAdd,
    Op::AtomicCompareExchange,
    Op::ScalarAtomicAdd,
    Op::ScalarCompareExchange,
    Op::ScalarLoad,
    Op::ScalarStore,
    Op::PrefetchL1,
    Op::PrefetchL2,
    Op::GatherPrefetch,
    Op::Cdab,
    Op::Badc,
    Op::QuadsCdab,
    Op::QuadsBadc,
    Op::Extract,
    Op::Splat,
    Op::Blend,
    Op::PermuteFloat,
    Op::Bits,
    Op::BranchAny,
];

/// One operation between a prologue that loads its operands and a store of its result.
///
/// At `input`: lanes a, fallback, indices, expected; then mask and scalar index.
pub(super) struct OneOp {
    pub(super) op: Op,
    pub(super) input: Addr,
    pub(super) data: Addr,
    pub(super) out: Addr,
}

/// Uops of [`OneOp`] before its operation.
pub(super) const PROLOGUE: usize = 8;

impl Kernel for OneOp {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, zero: V::S32) {
        let line = |n: u64| self.input.plus(64 * n);
        let (a, or) = (v.vload_i32(line(0), zero), v.vload_i32(line(1), zero));
        let (index, expected) = (v.vload_i32(line(2), zero), v.vload_i32(line(3), zero));
        let (k, at) = (v.s_load(line(4), zero), v.s_load(line(4).plus(4), zero));
        let k = v.kmov_from_scalar(k);
        let all = v.mask_all();
        let (float, or_float) = (v.from_bits(a), v.from_bits(or));
        let out = match self.op {
            Op::Load => v.vload_i32(self.data, at),
            Op::LoadOr => v.vload_i32_or(or, k, self.data, at),
            Op::Broadcast => v.vbroadcast_i32(self.data, at),
            Op::Store => {
                v.vstore_i32(k, self.data, at, a);
                or
            }
            Op::StoreStream => {
                v.vstore_stream(self.data, zero, a);
                or
            }
            Op::Expand => v.vexpand_i32_or(or, k, self.data, at),
            Op::Compress => {
                v.vcompress_i32(k, self.data, at, a);
                or
            }
            Op::Gather => v.vgather_i32_or(or, k, self.data, index),
            Op::Scatter => {
                v.vscatter_i32(k, self.data, index, a);
                or
            }
            Op::AtomicAdd => v.vatomic_add_or(or, k, self.data, index, a),
            Op::AtomicCompareExchange => v.vatomic_compare_exchange_or(or, k, self.data, index, expected, a),
            Op::ScalarAtomicAdd | Op::ScalarCompareExchange | Op::ScalarLoad | Op::Extract => {
                let scalar = match self.op {
                    Op::ScalarAtomicAdd => v.s_atomic_add(self.data, at, at),
                    Op::ScalarCompareExchange => v.s_atomic_compare_exchange(self.data, at, at, zero),
                    Op::ScalarLoad => v.s_load(self.data, at),
                    _ => v.vextract(a, 5),
                };
                v.s_store(self.out, zero, scalar);
                return;
            }
            Op::ScalarStore => {
                v.s_store(self.data, at, at);
                or
            }
            Op::PrefetchL1 => {
                v.prefetch_l1(self.data, at);
                or
            }
            Op::PrefetchL2 => {
                v.prefetch_l2(self.data, at);
                or
            }
            Op::GatherPrefetch => {
                v.vgather_prefetch(k, self.data, index);
                or
            }
            Op::Splat => v.vsplat(at),
            Op::Blend => v.vblend_i32(k, a, or),
            Op::Bits => v.bits_of(float),
            Op::BranchAny => {
                if v.branch_any(k) {
                    a
                } else {
                    or
                }
            }
            Op::Cdab | Op::Badc | Op::QuadsCdab | Op::QuadsBadc | Op::PermuteFloat => {
                let moved = match self.op {
                    Op::Cdab => v.vswizzle_cdab(float),
                    Op::Badc => v.vswizzle_badc(float),
                    Op::QuadsCdab => v.vpermute_quads_cdab(float),
                    Op::QuadsBadc => v.vpermute_quads_badc(float),
                    _ => v.vpermute_f32(or_float, index),
                };
                v.bits_of(moved)
            }
        };
        v.vstore_i32(all, self.out, zero, out);
    }
}

/// Words of the data that [`OneOp`] works on: the last allocation of its arena, so that its end is the arena's.
pub(super) const DATA_WORDS: usize = 128;
