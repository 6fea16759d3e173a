//! Every operation on every back end against independent scalar expressions and a dumb model of memory.

use crate::arena::{Addr, Arena, STACK_BASE_LINE};
use crate::emit::OpCounts;
use crate::examples;
use crate::host::HostSimd;
use crate::kernel::{AnyKernel, Kernel};
use crate::lanes::{Lanes, Portable};
use crate::program::{MakeStep, Phase, Program};
use crate::scan::{self, Scan};
use crate::stream::Stream;
use crate::uop::{Class, Uop};
use crate::vpu::{Compare, Vpu, for_each_operation};

/// A small seeded generator (splitmix64).
struct Random(u64);

impl Random {
    fn word(&mut self) -> u32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ z >> 31) >> 16) as u32
    }

    fn below(&mut self, bound: u32) -> u32 {
        self.word() % bound
    }

    /// A word that is often a special float, a shift count or an extreme.
    fn lane(&mut self) -> u32 {
        const SPECIAL: [u32; 32] = [
            0,
            0x8000_0000,
            1,
            0x8000_0001,
            0x007f_ffff,
            0x807f_ffff,
            0x0080_0000,
            0x8080_0000,
            0x7f7f_ffff,
            0xff7f_ffff,
            0x7f80_0000,
            0xff80_0000,
            0x7fc0_0000,
            0xffc0_0000,
            0x7f80_0001,
            0xff80_0001,
            0x7fff_ffff,
            0xffff_ffff,
            0x7fa5_5aa5,
            0x3f80_0000,
            0xbf80_0000,
            0x3f00_0000,
            0x4f00_0000,
            0xcf00_0000,
            0xcf00_0001,
            0x4eff_ffff,
            31,
            32,
            33,
            0x4b00_0001,
            0x3fc0_0000,
            0x7e96_7699,
        ];
        match self.below(4) {
            0 => SPECIAL[self.below(32) as usize],
            1 => (self.below(2000) as f32 / 16.0 - 60.0).to_bits(),
            2 => self.below(40),
            _ => self.word(),
        }
    }

    fn mask(&mut self) -> u16 {
        match self.below(5) {
            0 => 0,
            1 => 0xffff,
            2 => 1 << self.below(16),
            _ => self.word() as u16,
        }
    }
}

/// The SIMD levels of this host; says which it lacks.
fn levels() -> Vec<HostSimd> {
    HostSimd::ALL
        .into_iter()
        .filter(|simd| {
            if !simd.is_available() {
                eprintln!("SKIPPED on {simd}: this host lacks it");
            }
            simd.is_available()
        })
        .collect()
}

/// Words of one case of [`EveryRow`]: a, b, c, fallback, and the two masks.
const CASE_WORDS: u32 = 5 * 16;

/// Runs every row of the operation table and its masked form, and stores each result in a line of its own.
struct EveryRow {
    cases: Addr,
    out: Addr,
}

macro_rules! every_row {
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
        /// Result kind, name and class of every row, in the order in which [`EveryRow`] stores results.
        const ROWS: &[(Kind, &str, Class, usize)] = &[
            $((Kind::Float, stringify!($fb), Class::$fbc, 2),)+
            $((Kind::Float, stringify!($ft), Class::$ftc, 3),)+
            $((Kind::Float, stringify!($fu), Class::$fuc, 1),)+
            $((Kind::Int, stringify!($ib), Class::$ibc, 2),)+
            $((Kind::Mask, stringify!($fc), Class::$fcc, 2),)+
            $((Kind::Mask, stringify!($ic), Class::$icc, 2),)+
            $((Kind::Int, stringify!($ti), Class::$tic, 1),)+
            $((Kind::Float, stringify!($tf), Class::$tfc, 1),)+
            $((Kind::MaskOnly, stringify!($mb), Class::$mbc, 2),)+
            $((Kind::Scalar, stringify!($sb), Class::$sbc, 2),)+
        ];

        impl Kernel for EveryRow {
            #[inline(always)]
            fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
                let case_words = v.s_imm(CASE_WORDS as i32);
                let at = v.s_mul(task, case_words);
                let line = |n: u64| self.cases.plus(64 * n);
                let (a, b, c) = (v.vload_f32(line(0), at), v.vload_f32(line(1), at), v.vload_f32(line(2), at));
                let or = v.vload_f32(line(3), at);
                let (ia, ib, ior) = (v.vload_i32(line(0), at), v.vload_i32(line(1), at), v.vload_i32(line(3), at));
                let (sa, sb) = (v.s_load(line(0), at), v.s_load(line(1), at));
                let (k, k2) = (v.s_load(line(4), at), v.s_load(line(4).plus(4), at));
                let (k, k2) = (v.kmov_from_scalar(k), v.kmov_from_scalar(k2));
                let all = v.mask_all();
                let out_words = v.s_imm((ROWS.len() * 32) as i32);
                let out_at = v.s_mul(task, out_words);
                let mut out = self.out;
                macro_rules! keep {
                    (F $value:expr) => {{ let x = $value; v.vstore_f32(all, out, out_at, x); out = out.plus(64); }};
                    (I $value:expr) => {{ let x = $value; v.vstore_i32(all, out, out_at, x); out = out.plus(64); }};
                    (S $value:expr) => {{ let x = $value; v.s_store(out, out_at, x); out = out.plus(64); }};
                    (M $value:expr) => {{
                        let x = $value;
                        let x = v.kmov_to_scalar(x);
                        v.s_store(out, out_at, x);
                        out = out.plus(64);
                    }};
                }
                $(keep!(F v.$fb(a, b)); keep!(F v.$fb_or(or, k, a, b));)+
                $(keep!(F v.$ft(a, b, c)); keep!(F v.$ft_or(or, k, a, b, c));)+
                $(keep!(F v.$fu(a)); keep!(F v.$fu_or(or, k, a));)+
                $(keep!(I v.$ib(ia, ib)); keep!(I v.$ib_or(ior, k, ia, ib));)+
                $(keep!(M v.$fc(a, b)); keep!(M v.$fc_masked(k, a, b));)+
                $(keep!(M v.$ic(ia, ib)); keep!(M v.$ic_masked(k, ia, ib));)+
                $(keep!(I v.$ti(a)); keep!(I v.$ti_or(ior, k, a));)+
                $(keep!(F v.$tf(ia)); keep!(F v.$tf_or(or, k, ia));)+
                $(keep!(M v.$mb(k, k2)); keep!(M v.knot(k));)+
                $(keep!(S v.$sb(sa, sb)); keep!(S v.s_tzcnt(sa));)+
                let _ = out;
            }
        }
    };
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Float,
    Int,
    Mask,
    MaskOnly,
    Scalar,
}

for_each_operation!(every_row);

/// One lane of a row, written apart from the back ends: exact products and sums in f64 where that rounds once.
fn lane_of(name: &str, a: u32, b: u32, c: u32) -> u32 {
    let (x, y, z) = (f32::from_bits(a), f32::from_bits(b), f32::from_bits(c));
    let (i, j) = (a as i32, b as i32);
    let float = |value: f32| value.to_bits();
    match name {
        "vadd" => float(x + y),
        "vsub" => float(x - y),
        // Products of two f32 are exact in f64.
        "vmul" => float((f64::from(x) * f64::from(y)) as f32),
        "vmin" => {
            if x < y {
                a
            } else {
                b
            }
        }
        "vmax" => {
            if x > y {
                a
            } else {
                b
            }
        }
        "vmadd" => float(x.mul_add(y, z)),
        "vmsub" => float(x.mul_add(y, -z)),
        "vnmadd" => float((-x).mul_add(y, z)),
        // f64 has more than 2p + 2 bits, so the second rounding changes nothing.
        "vrcp" => float((1.0 / f64::from(x)) as f32),
        "vrsqrt" => float((1.0 / f64::from(f64::from(x).sqrt() as f32)) as f32),
        "vfloor" => float(f64::from(x).floor() as f32),
        "vround" => float(f64::from(x).round_ties_even() as f32),
        "vabs" => a & 0x7fff_ffff,
        "viadd" => (i64::from(i) + i64::from(j)) as u32,
        "visub" => (i64::from(i) - i64::from(j)) as u32,
        "vimul" => (i64::from(i) * i64::from(j)) as u32,
        "vimin" => i.min(j) as u32,
        "vimax" => i.max(j) as u32,
        "vand" => a & b,
        "vor" => a | b,
        "vxor" => a ^ b,
        "vandn" => !a & b,
        "vsll" => {
            if b < 32 {
                (u64::from(a) << b) as u32
            } else {
                0
            }
        }
        "vsrl" => a.checked_shr(b).unwrap_or(0),
        "vsra" => (i64::from(i) >> b.min(40)) as u32,
        "vcvt_f32_i32" => {
            if x.is_nan() || !(-2_147_483_648.0..2_147_483_648.0).contains(&x) {
                1 << 31
            } else {
                x.trunc() as i32 as u32
            }
        }
        "vcvt_i32_f32" => float(f64::from(i) as f32),
        "vcmp_lt" => u32::from(x < y),
        "vcmp_le" => u32::from(x <= y),
        "vcmp_gt" => u32::from(x > y),
        "vcmp_ge" => u32::from(x >= y),
        "vcmp_eq" => u32::from(x == y),
        "vcmp_neq" => u32::from(x != y),
        "vicmp_lt" => u32::from(i < j),
        "vicmp_gt" => u32::from(i > j),
        "vicmp_ge" => u32::from(i >= j),
        "vicmp_eq" => u32::from(a == b),
        "vicmp_neq" => u32::from(a != b),
        "vucmp_lt" => u32::from(a < b),
        "kand" => a & b,
        "kandn" => !a & b & 0xffff,
        "kor" => a | b,
        "kxor" => a ^ b,
        "kxnor" => !(a ^ b) & 0xffff,
        "s_add" => a.wrapping_add(b),
        "s_sub" => a.wrapping_sub(b),
        "s_mul" => a.wrapping_mul(b),
        "s_and" => a & b,
        "s_or" => a | b,
        "s_xor" => a ^ b,
        "s_shl" => a << (b & 31),
        "s_shr" => a >> (b & 31),
        other => panic!("row '{other}' of the operation table has no independent definition here"),
    }
}

/// What is seen of a float: NaN is one value.
fn observed(bits: u32) -> u32 {
    if f32::from_bits(bits).is_nan() { 0x7fc0_0000 } else { bits }
}

/// Runs tasks `0..tasks` counting or recording; returns the class counts and masked lane-slots either way.
fn run(kernel: &impl AnyKernel, simd: HostSimd, arena: &Arena, tasks: u32, recording: bool) -> OpCounts {
    let mut counts = OpCounts::default();
    if !recording {
        kernel.run(simd, arena, 0..tasks, false, &mut counts);
        return counts;
    }
    let mut stream = Stream::default();
    for task in 0..tasks {
        kernel.record(simd, arena, task, &mut stream);
    }
    assert_eq!(stream.live_vectors_max.max(32), 32, "spills would be counted below");
    OpCounts { class_counts: stream.count_classes(), lanes_masked: stream.lanes_masked }
}

#[test]
fn every_row_is_bit_equal_to_its_definition_on_every_back_end() {
    const CASES: u32 = 3000;
    let mut random = Random(1);
    let mut cases: Vec<u32> = (0..CASES * CASE_WORDS).map(|_| random.lane()).collect();
    for case in cases.chunks_mut(CASE_WORDS as usize) {
        (case[64], case[65]) = (u32::from(random.mask()), u32::from(random.mask()));
    }
    let mut arena = Arena::new();
    let at = arena.alloc_u32(&cases);
    let slots = ROWS.len() * 2;
    let out_words = CASES as usize * slots * 16;
    let out = arena.alloc(out_words as u64);
    let kernel = EveryRow { cases: at, out };
    let mut counted = None;
    for simd in levels() {
        for recording in [false, true] {
            arena.write_u32s(out, &vec![0xdead_beef; out_words]);
            let counts = run(&kernel, simd, &arena, CASES, recording);
            assert_eq!(counts, *counted.get_or_insert(counts.clone()), "{simd}, recording {recording}");
            let found = arena.read_u32s(out, out_words);
            for (case, words) in cases.chunks(CASE_WORDS as usize).enumerate() {
                let (k, k2) = (words[64], words[65]);
                for (row, (kind, name, _, _)) in ROWS.iter().enumerate() {
                    let slot = |form: usize| &found[(case * slots + 2 * row + form) * 16..][..16];
                    let value = |i: usize| match *name {
                        "vpermute" => words[(words[16 + i] & 15) as usize],
                        _ => lane_of(name, words[i], words[16 + i], words[32 + i]),
                    };
                    let at = || format!("{name} on {simd}, recording {recording}, case {case}");
                    match kind {
                        Kind::Float | Kind::Int => {
                            let seen = |bits| if *kind == Kind::Float { observed(bits) } else { bits };
                            for i in 0..16 {
                                assert_eq!(
                                    slot(0)[i],
                                    seen(value(i)),
                                    "{} lane {i}: {:x?}",
                                    at(),
                                    [words[i], words[16 + i], words[32 + i]]
                                );
                                let merged = if k >> i & 1 == 1 { value(i) } else { words[48 + i] };
                                assert_eq!(slot(1)[i], seen(merged), "masked {} lane {i}", at());
                            }
                        }
                        Kind::Mask => {
                            let all: u32 = (0..16).map(|i| value(i) << i).sum();
                            assert_eq!((slot(0)[0], slot(1)[0]), (all, all & k), "{}", at());
                        }
                        Kind::MaskOnly => {
                            assert_eq!(
                                (slot(0)[0], slot(1)[0]),
                                (lane_of(name, k, k2, 0), !k & 0xffff),
                                "{}",
                                at()
                            );
                        }
                        Kind::Scalar => {
                            assert_eq!(
                                (slot(0)[0], slot(1)[0]),
                                (value(0), words[0].trailing_zeros()),
                                "{}",
                                at()
                            );
                        }
                    }
                }
            }
        }
    }
}

/// Operations that touch memory or move lanes, one a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Op {
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

const OPS: [Op; 28] = [
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
struct OneOp {
    op: Op,
    input: Addr,
    data: Addr,
    out: Addr,
}

/// Uops of [`OneOp`] before its operation.
const PROLOGUE: usize = 8;

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
const DATA_WORDS: usize = 128;

struct Expected {
    data: Vec<u32>,
    out: Vec<u32>,
    /// Class and lines of each uop of the operation, lines counted from the data's first.
    uops: Vec<(Class, Vec<u32>)>,
}

fn distinct(lines: impl Iterator<Item = u32>) -> Vec<u32> {
    let mut seen = Vec::new();
    for line in lines {
        if !seen.contains(&line) {
            seen.push(line);
        }
    }
    seen
}

fn model(op: Op, input: &[u32], before: &[u32]) -> Expected {
    let (a, or, index, expected) = (&input[..16], &input[16..32], &input[32..48], &input[48..64]);
    let (k, at) = (input[64], input[65] as usize);
    let on: Vec<usize> = (0..16).filter(|i| k >> i & 1 == 1).collect();
    let (mut data, mut out, mut uops) = (before.to_vec(), or.to_vec(), Vec::new());
    let span = |lanes: &[usize]| distinct(lanes.iter().map(|i| ((at + i) / 16) as u32));
    // A span's first and last line; there is none between.
    let ends = |lanes: &[usize]| match lanes {
        [] => vec![],
        [.., last] => span(&[lanes[0], *last]),
    };
    let all: Vec<usize> = (0..16).collect();
    let packed: Vec<usize> = (0..on.len()).collect();
    let lines_of = |lanes: &[usize]| distinct(lanes.iter().map(|i| index[*i] / 16));
    match op {
        Op::Load => {
            out.copy_from_slice(&data[at..at + 16]);
            uops.push((Class::VectorLoad, ends(&all)));
        }
        Op::LoadOr => {
            on.iter().for_each(|i| out[*i] = data[at + i]);
            uops.push((Class::VectorLoad, ends(&on)));
        }
        Op::Broadcast => {
            out.fill(data[at]);
            uops.push((Class::VectorBroadcastLoad, span(&[0])));
        }
        Op::Store => {
            on.iter().for_each(|i| data[at + i] = a[*i]);
            uops.push((Class::VectorStore, ends(&on)));
        }
        Op::StoreStream => {
            data[..16].copy_from_slice(a);
            uops.push((Class::VectorStreamStore, vec![0]));
        }
        Op::Expand => {
            on.iter().enumerate().for_each(|(n, i)| out[*i] = data[at + n]);
            uops.push((Class::VectorExpand, ends(&packed)));
        }
        Op::Compress => {
            on.iter().enumerate().for_each(|(n, i)| data[at + n] = a[*i]);
            uops.push((Class::VectorCompress, ends(&packed)));
        }
        Op::Gather => {
            on.iter().for_each(|i| out[*i] = data[index[*i] as usize]);
            uops.push((Class::Gather, lines_of(&on)));
        }
        Op::Scatter => {
            on.iter().for_each(|i| data[index[*i] as usize] = a[*i]);
            uops.push((Class::Scatter, lines_of(&on)));
        }
        Op::AtomicAdd | Op::AtomicCompareExchange => {
            for i in &on {
                let word = &mut data[index[*i] as usize];
                out[*i] = *word;
                if op == Op::AtomicAdd {
                    *word = word.wrapping_add(a[*i]);
                } else if *word == expected[*i] {
                    *word = a[*i];
                }
            }
            let mut rest = on;
            while !rest.is_empty() {
                let round: Vec<usize> = rest
                    .iter()
                    .copied()
                    .filter(|i| !rest.iter().any(|j| j < i && index[*j] == index[*i]))
                    .collect();
                uops.push((Class::AtomicGather, lines_of(&round)));
                uops.push((Class::VectorAlu, vec![]));
                uops.push((Class::AtomicScatter, lines_of(&round)));
                uops.extend([(Class::Mask, vec![]), (Class::Mask, vec![]), (Class::Branch, vec![])]);
                rest.retain(|i| !round.contains(i));
            }
        }
        Op::ScalarAtomicAdd => {
            out = vec![data[at]];
            data[at] = data[at].wrapping_add(at as u32);
            uops.push((Class::Atomic, span(&[0])));
        }
        Op::ScalarCompareExchange => {
            out = vec![data[at]];
            if data[at] == at as u32 {
                data[at] = 0;
            }
            uops.push((Class::Atomic, span(&[0])));
        }
        Op::ScalarLoad => {
            out = vec![data[at]];
            uops.push((Class::ScalarLoad, span(&[0])));
        }
        Op::ScalarStore => {
            data[at] = at as u32;
            uops.push((Class::ScalarStore, span(&[0])));
        }
        Op::PrefetchL1 => uops.push((Class::PrefetchL1, span(&[0]))),
        Op::PrefetchL2 => uops.push((Class::PrefetchL2, span(&[0]))),
        Op::GatherPrefetch => uops.push((Class::GatherPrefetch, lines_of(&on))),
        Op::Extract => {
            out = vec![a[5]];
            uops.extend([(Class::VectorStore, vec![u32::MAX]), (Class::ScalarLoad, vec![u32::MAX])]);
        }
        Op::Splat => {
            out.fill(at as u32);
            uops.extend([(Class::ScalarStore, vec![u32::MAX]), (Class::VectorBroadcastLoad, vec![u32::MAX])]);
        }
        Op::Blend => {
            on.iter().for_each(|i| out[*i] = a[*i]);
            uops.push((Class::VectorAlu, vec![]));
        }
        Op::Bits => out = a.iter().map(|bits| observed(*bits)).collect(),
        Op::BranchAny => {
            if k != 0 {
                out.copy_from_slice(a);
            }
            uops.extend([(Class::Mask, vec![]), (Class::Branch, vec![])]);
        }
        Op::Cdab | Op::Badc | Op::QuadsCdab | Op::QuadsBadc => {
            let flip = match op {
                Op::Cdab => 1,
                Op::Badc => 2,
                Op::QuadsCdab => 4,
                _ => 8,
            };
            out = (0..16usize).map(|i| observed(a[i ^ flip])).collect();
            uops.push((Class::VectorShuffle, vec![]));
        }
        Op::PermuteFloat => {
            out = index.iter().map(|i| observed(or[(i & 15) as usize])).collect();
            uops.push((Class::VectorShuffle, vec![]));
        }
    }
    Expected { data, out, uops }
}

#[test]
fn memory_operations_agree_with_a_vector_of_words_on_every_back_end() {
    let mut random = Random(2);
    let mut arena = Arena::new();
    let input_at = arena.alloc(5 * 16);
    let out = arena.alloc(16);
    let data_at = arena.alloc(DATA_WORDS as u64);
    let levels = levels();
    for round in 0..1500 {
        let op = OPS[round % OPS.len()];
        let mut input: Vec<u32> = (0..80).map(|_| random.lane()).collect();
        let k = u32::from(random.mask());
        // Few distinct indices make lanes conflict; lanes that are off point anywhere.
        let bound = [DATA_WORDS as u32, 3, 40][random.below(3) as usize];
        for i in 0..16 {
            if k >> i & 1 == 1 {
                input[32 + i] = random.below(bound);
            }
        }
        // Up to the arena's end, and past it where the lanes beyond are off.
        let reach = match op {
            Op::Load => 16,
            Op::LoadOr | Op::Store => 32 - k.leading_zeros(),
            Op::Expand | Op::Compress => k.count_ones(),
            _ => 1,
        };
        let last = DATA_WORDS as u32 - reach;
        (input[64], input[65]) = (k, if random.below(3) == 0 { last } else { random.below(last + 1) });
        let data: Vec<u32> =
            (0..DATA_WORDS as u32).map(|i| if i % 3 == 0 { i } else { random.lane() }).collect();
        for i in 0..16 {
            // Make some compare-exchanges succeed.
            if i % 2 == 0 && k >> i & 1 == 1 {
                input[48 + i] = data[input[32 + i] as usize];
            }
        }
        let right = model(op, &input, &data);
        let kernel = OneOp { op, input: input_at, data: data_at, out };
        let mut first: Option<Stream> = None;
        for &simd in &levels {
            for recording in [false, true] {
                arena.write_u32s(input_at, &input);
                arena.write_u32s(data_at, &data);
                let (mut stream, mut counts) = (Stream::default(), OpCounts::default());
                if recording {
                    kernel.record(simd, &arena, 0, &mut stream);
                } else {
                    AnyKernel::run(&kernel, simd, &arena, 0..1, false, &mut counts);
                }
                let at = format!("{op:?} on {simd}, recording {recording}, round {round}, input {input:x?}");
                assert_eq!(arena.read_u32s(data_at, DATA_WORDS), right.data, "memory of {at}");
                assert_eq!(arena.read_u32s(out, right.out.len()), right.out, "result of {at}");
                if recording {
                    check_stream(&stream, &right.uops, data_at, &at);
                    assert_eq!(stream, *first.get_or_insert(stream.clone()), "stream of {at}");
                }
                if let (false, Some(stream)) = (recording, &first) {
                    assert_eq!(counts.class_counts, stream.count_classes(), "{at}");
                    assert_eq!(counts.lanes_masked, stream.lanes_masked, "{at}");
                    assert_eq!(counts.lanes_active(), stream.lanes_active, "{at}");
                }
            }
        }
    }
}

/// The uops between prologue and final store are those expected, with their lines.
fn check_stream(stream: &Stream, expected: &[(Class, Vec<u32>)], data: Addr, at: &str) {
    assert_eq!(stream.uops.len(), PROLOGUE + expected.len() + 1, "uops of {at}");
    let mut lines = stream.lines.iter();
    for (i, uop) in stream.uops.iter().enumerate() {
        let uop = Uop(*uop);
        let own: Vec<u32> = lines.by_ref().take(uop.lines()).copied().collect();
        let Some((class, right)) = i.checked_sub(PROLOGUE).and_then(|i| expected.get(i)) else { continue };
        assert_eq!(uop.class(), *class, "class of {at}");
        if right == &[u32::MAX] {
            assert!(own.len() == 1 && own[0] >= STACK_BASE_LINE, "stack line of {at}");
            continue;
        }
        let right: Vec<u32> = right.iter().map(|line| line + data.line().0).collect();
        assert_eq!(own, right, "lines of {at}");
    }
    assert_eq!(lines.next(), None, "lines left over of {at}");
}

#[test]
fn lines_are_right_where_word_numbers_outgrow_32_bits() {
    let mut arena = Arena::new();
    let input = arena.alloc(80);
    let out = arena.alloc(16);
    let huge = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| arena.alloc_bytes(17 << 30)));
    if huge.is_err() {
        eprintln!("SKIPPED: this host reserves less than 17 GiB of address space");
        return;
    }
    let data = Addr((16 << 30) - 128);
    let mut words = vec![0; 80];
    (0..16).for_each(|i| words[32 + i] = 5 * i as u32);
    words[64] = 0xffff;
    arena.write_u32s(input, &words);
    (0..80).for_each(|i| arena.write_u32(data.plus(4 * i), i as u32));
    let kernel = OneOp { op: Op::Gather, input, data, out };
    for simd in levels() {
        let mut stream = Stream::default();
        kernel.record(simd, &arena, 0, &mut stream);
        check_stream(&stream, &[(Class::Gather, (0..5).collect())], data, "a gather across 16 GiB");
        assert_eq!(arena.read_u32s(out, 16), words[32..48], "{simd}");
    }
}

#[test]
fn an_active_lane_past_the_end_stops_the_run() {
    for simd in levels() {
        for bad in [DATA_WORDS as u32, 0x7fff_ffff, 0x8000_0000, u32::MAX] {
            let mut arena = Arena::new();
            let input = arena.alloc(80);
            let out = arena.alloc(16);
            let data = arena.alloc(DATA_WORDS as u64);
            arena.write_u32(input.plus(4 * (32 + 7)), bad);
            arena.write_u32(input.plus(4 * 64), 1 << 7);
            for op in [Op::Gather, Op::Scatter, Op::AtomicAdd, Op::AtomicCompareExchange] {
                let kernel = OneOp { op, input, data, out };
                let ended = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
                    AnyKernel::run(&kernel, simd, &arena, 0..1, false, &mut OpCounts::default());
                }));
                assert!(ended.is_err(), "{op:?} at {bad:#x} on {simd}");
            }
            // A prefetch there asks for nothing.
            let mut stream = Stream::default();
            OneOp { op: Op::GatherPrefetch, input, data, out }.record(simd, &arena, 0, &mut stream);
            check_stream(&stream, &[(Class::GatherPrefetch, vec![])], data, "a prefetch past the end");
        }
    }
}

/// Each row once, after as many moves as it has operands, so that its producers are known.
#[test]
fn a_row_names_its_operands_and_an_operation_with_many_keeps_the_youngest() {
    struct Operands;
    impl Kernel for Operands {
        #[inline(always)]
        fn run<V: Vpu>(&self, v: &mut V, _: V::S32) {
            let or = v.vset_f32(1.0);
            let k = v.mask_all();
            let a = v.vset_f32(2.0);
            let b = v.vset_f32(3.0);
            let c = v.vset_f32(4.0);
            v.vadd(a, b);
            v.vmadd(a, b, c);
            v.vmadd_or(or, k, a, b, c);
            v.vadd_or(or, k, a, b);
            v.vcmp_lt_masked(k, c, or);
            v.vblend_f32(k, a, or);
        }
    }
    let right = [vec![2, 3], vec![2, 3, 4], vec![3, 4, 5], vec![5, 6, 7], vec![5, 8, 9], vec![8, 9, 10]];
    for simd in levels() {
        let mut stream = Stream::default();
        Operands.record(simd, &Arena::new(), 0, &mut stream);
        let found: Vec<Vec<u8>> = stream.uops[5..]
            .iter()
            .map(|uop| {
                let mut producers: Vec<u8> = Uop(*uop).producers().into_iter().filter(|d| *d != 0).collect();
                producers.sort_unstable();
                producers
            })
            .collect();
        assert_eq!(found, right, "{simd}");
    }
}

/// Makes `live` vectors, waits `apart` uops, then adds them up from the youngest on.
struct Live {
    live: usize,
    apart: usize,
}

impl Kernel for Live {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, _: V::S32) {
        let first = v.vset_f32(0.0);
        let mut made = [first; 40];
        for slot in &mut made[1..self.live] {
            *slot = v.vset_f32(1.0);
        }
        // Past 32, each value made is charged: those of the sum too, until no more than 32 are live.
        // Masks and values that nobody reads take no vector register.
        for _ in 0..self.apart {
            v.mask_all();
        }
        let mut sum = made[self.live - 1];
        for value in made[..self.live - 1].iter().rev() {
            sum = v.vadd(sum, *value);
        }
        v.bits_of(sum);
    }
}

#[test]
fn vectors_past_the_32nd_are_charged_as_spills() {
    for apart in [0, 10, 1000] {
        for (live, spills) in [(31, 0), (32, 0), (33, 1), (40, 8 + 7)] {
            for simd in levels() {
                let mut stream = Stream::default();
                Live { live, apart }.record(simd, &Arena::new(), 0, &mut stream);
                let counts = stream.count_classes();
                let charged = (counts[Class::SpillStore as usize], counts[Class::SpillLoad as usize]);
                assert_eq!(
                    (stream.live_vectors_max as usize, charged),
                    (live, (spills, spills)),
                    "{apart} apart"
                );
                let slots = 16 * (2 * live as u64 - 1 + 2 * spills);
                assert_eq!(stream.lanes_active, slots);
            }
        }
    }
}

#[test]
fn a_host_read_inside_a_task_is_caught() {
    struct Cheat(std::sync::Arc<Arena>, Addr);
    impl Kernel for Cheat {
        #[inline(always)]
        fn run<V: Vpu>(&self, v: &mut V, _: V::S32) {
            let value = self.0.read_u32(self.1);
            v.s_imm(value as i32);
        }
    }
    let mut arena = Arena::new();
    let at = arena.alloc(1);
    let arena = std::sync::Arc::new(arena);
    let cheat = Cheat(arena.clone(), at);
    arena.read_u32(at);
    assert_eq!(arena.host_reads_in_task(), 0);
    AnyKernel::run(&cheat, HostSimd::Portable, &arena, 0..2, false, &mut OpCounts::default());
    cheat.record(HostSimd::Portable, &arena, 0, &mut Stream::default());
    arena.read_u32(at);
    assert_eq!(arena.host_reads_in_task(), if cfg!(debug_assertions) { 3 } else { 0 });
}

/// Evaluates one function of the math library on all words of two arrays.
struct Math {
    function: u8,
    count: u32,
    a: Addr,
    b: Addr,
    out: Addr,
}

impl Kernel for Math {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, mut i: V::S32) {
        let all = v.mask_all();
        let (step, end) = (v.s_imm(16), v.s_imm(self.count as i32));
        while v.branch(Compare::Less, i, end) {
            let (a, b) = (v.vload_f32(self.a, i), v.vload_f32(self.b, i));
            let result = match self.function {
                0 => crate::math::div(v, a, b),
                1 => crate::math::sqrt(v, a),
                2 => crate::math::atan2(v, a, b),
                3 => crate::math::reduce_add(v, a),
                4 => crate::math::reduce_min(v, a),
                _ => crate::math::reduce_max(v, a),
            };
            v.vstore_f32(all, self.out, i, result);
            i = v.s_add(i, step);
        }
    }
}

fn evaluate(function: u8, a: &[f32], b: &[f32]) -> Vec<f32> {
    let mut arena = Arena::new();
    let mut padded = |values: &[f32]| {
        let mut values = values.to_vec();
        values.resize(values.len().next_multiple_of(16), 1.0);
        arena.alloc_f32(&values)
    };
    let (at_a, at_b) = (padded(a), padded(b));
    let count = a.len().next_multiple_of(16) as u32;
    let out = arena.alloc(u64::from(count));
    let kernel = Math { function, count, a: at_a, b: at_b, out };
    let mut results: Option<Vec<u32>> = None;
    for simd in levels() {
        AnyKernel::run(&kernel, simd, &arena, 0..1, false, &mut OpCounts::default());
        let bits = arena.read_u32s(out, a.len());
        assert!(bits == *results.get_or_insert(bits.clone()), "function {function} on {simd}");
    }
    results.unwrap_or_default().into_iter().map(f32::from_bits).collect()
}

/// Error of `found` in units in the last place of `right`, which is normal.
fn ulps(found: f32, right: f64) -> f64 {
    let unit = f64::from(f32::from_bits((right as f32).to_bits() & 0x7f80_0000)) * f64::from(f32::EPSILON);
    (f64::from(found) - right).abs() / unit
}

/// A float of either sign with a binary exponent in `exponents`.
fn float_in(random: &mut Random, exponents: core::ops::Range<i32>) -> f32 {
    let exponent = exponents.start + random.below((exponents.end - exponents.start) as u32) as i32;
    let word = random.word();
    f32::from_bits(word & 0x807f_ffff | ((exponent + 127) as u32) << 23)
}

const SAMPLES: usize = 400_000;

#[test]
fn division_is_within_one_ulp() {
    let mut random = Random(3);
    let (mut a, mut b) = (Vec::new(), Vec::new());
    while a.len() < SAMPLES {
        let (x, y) = (float_in(&mut random, -102..128), float_in(&mut random, -126..128));
        let quotient = (f64::from(x) / f64::from(y)).abs();
        if (1.2e-38..3.4e38).contains(&quotient) {
            a.push(x);
            b.push(y);
        }
    }
    let worst = evaluate(0, &a, &b)
        .into_iter()
        .enumerate()
        .map(|(i, found)| (ulps(found, f64::from(a[i]) / f64::from(b[i])), i))
        .fold((0.0, 0), |worst, this| if this.0 <= worst.0 { worst } else { this });
    assert!(worst.0 <= 1.0, "{} ulp for {:e} / {:e}", worst.0, a[worst.1], b[worst.1]);
    let special = evaluate(0, &[1.0, 0.0, -0.0], &[0.0, 3.0, 3.0]);
    assert!(special[0].is_nan() && special[1] == 0.0 && special[2] == 0.0);
}

#[test]
fn square_root_is_within_one_ulp() {
    let mut random = Random(4);
    let mut a: Vec<f32> = (0..SAMPLES).map(|_| float_in(&mut random, -102..128).abs()).collect();
    a.extend([2f32.powi(-102), 1.0, 4.0, f32::MAX]);
    for (a, found) in a.iter().zip(evaluate(1, &a, &a)) {
        let error = ulps(found, f64::from(*a).sqrt());
        assert!(error <= 1.0, "{error} ulp for sqrt({a:e})");
    }
    let special = evaluate(1, &[0.0, -1.0, f32::INFINITY], &[0.0; 3]);
    assert!(special[0] == 0.0 && special[1].is_nan() && special[2].is_nan());
}

#[test]
fn atan2_is_right_in_all_octants() {
    let mut random = Random(5);
    let mut points = Vec::new();
    for _ in 0..SAMPLES {
        // Near each other, far apart, and anywhere on a circle.
        let x = float_in(&mut random, -60..60);
        let angle = random.word() as f32 * 1.5e-9;
        points.push((x, x * float_in(&mut random, -3..4)));
        points.push((x, float_in(&mut random, -60..60)));
        points.push((x * angle.sin(), x * angle.cos()));
    }
    let extremes = [0.0, 1.0, -1.0, 1e-30, -1e-30, 1e37, -1e37, 0.414_213_57, 2.414_213_6];
    for y in extremes {
        points.extend(extremes.map(|x| (y, x)));
    }
    let (y, x): (Vec<f32>, Vec<f32>) = points.into_iter().unzip();
    let (mut absolute, mut relative) = (0.0f64, 0.0f64);
    for (i, found) in evaluate(2, &y, &x).into_iter().enumerate() {
        let right = f64::from(y[i]).atan2(f64::from(x[i]));
        let error = (f64::from(found) - right).abs();
        assert!(error <= 4e-7, "atan2({:e}, {:e}) is {found}; it must be {right}", y[i], x[i]);
        absolute = absolute.max(error);
        // Below that the angle is denormal.
        if right.abs() > 1.2e-38 {
            relative = relative.max(error / right.abs());
        }
    }
    eprintln!("atan2: absolute {absolute:e}, relative {relative:e}");
    assert!(absolute <= 3e-7 && relative <= 4e-7, "absolute {absolute:e}, relative {relative:e}");
}

#[test]
fn reductions_hold_in_every_lane() {
    let a: Vec<f32> = (0..16).map(|i| ((i * 7) % 16) as f32).collect();
    assert_eq!(evaluate(3, &a, &a), [120.0; 16]);
    assert_eq!(evaluate(4, &a, &a), [0.0; 16]);
    assert_eq!(evaluate(5, &a, &a), [15.0; 16]);
}

#[test]
fn blocks_of_register_pressure_agree_with_their_definition() {
    fn check<L: Lanes>(at: &str) {
        let mut random = Random(0x1234_5678_9abc_def1);
        for round in 0..2000 {
            let sparse = 1 + round % 4;
            let made = core::array::from_fn(|_| if random.below(sparse) == 0 { random.word() } else { 0 });
            let ended = core::array::from_fn(|_| random.below(if round == 0 { 256 } else { 4 }) as u8);
            assert_eq!(L::rise(&made, &ended), Portable::rise(&made, &ended), "{at} {made:?} {ended:?}");
        }
        assert_eq!(L::rise(&[0; 16], &[255; 16]), (-255, -16 * 255), "{at}");
        assert_eq!(L::rise(&[u32::MAX; 16], &[0; 16]), (16, 16), "{at}");
    }
    fn check_distinct<L: Lanes>(at: &str) {
        let mut random = Random(0xfeed_5678_9abc_def1);
        for round in 0..20_000 {
            let span = 1 + random.below(40);
            let offset = if round % 3 == 0 { -20 } else { 1 << 20 };
            let values: [i32; 16] = core::array::from_fn(|_| random.below(span) as i32 + offset);
            let k = random.mask();
            let first = Portable::distinct(k, values);
            assert_eq!(L::distinct(k, L::from_i(values)), first, "{at} {k:#x} {values:?}");
            let mut stored = [0; 16];
            #[expect(unsafe_code, reason = "room for 16 words")]
            // SAFETY: `stored` has 16 words.
            let count = unsafe { L::store_distinct(k, stored.as_mut_ptr(), L::from_i(values)) };
            let expected: Vec<i32> = (0..16).filter(|i| first >> i & 1 == 1).map(|i| values[i]).collect();
            assert_eq!(&stored[..count as usize], expected, "{at} {k:#x} {values:?}");
        }
    }
    for simd in levels() {
        let at = simd.to_string();
        match simd {
            #[cfg(target_arch = "x86_64")]
            HostSimd::Avx512 => {
                check::<crate::lanes::Avx512>(&at);
                check_distinct::<crate::lanes::Avx512>(&at);
            }
            #[cfg(target_arch = "x86_64")]
            HostSimd::Avx2 => {
                check::<crate::lanes::Avx2>(&at);
                check_distinct::<crate::lanes::Avx2>(&at);
            }
            _ => check_distinct::<Portable>(&at),
        }
    }
}

/// Streams of whole programs, frozen: what is recorded must not change with how it is recorded.
#[test]
fn recorded_programs_are_the_same_bytes_as_ever() {
    fn mix(hash: &mut u64, word: u64) {
        *hash = (*hash ^ word).wrapping_mul(0x0000_0100_0000_01b3).rotate_left(23);
    }
    fn hash<S>(mut program: Program<S>, simd: HostSimd) -> u64 {
        let mut arena = Arena::new();
        let mut stream = Stream::default();
        let mut hash = 1;
        for make_step in program.phases.iter().flat_map(|phase| &phase.steps) {
            let step = make_step(&mut program.state, &mut arena);
            for task in 0..step.tasks {
                stream.clear();
                step.kernel.record(simd, &arena, task, &mut stream);
                stream.uops.iter().chain(&stream.lines).for_each(|word| mix(&mut hash, u64::from(*word)));
                mix(&mut hash, stream.lanes_active);
                mix(&mut hash, stream.lanes_masked);
                mix(&mut hash, u64::from(stream.live_vectors_max));
            }
        }
        hash
    }
    let scan = || {
        let make_step = |_: &mut (), arena: &mut Arena| {
            let words = arena.alloc(scan::padded(5000));
            Scan::new(arena, words, 5000).blocks()
        };
        let steps: Vec<MakeStep<()>> = vec![make_step];
        Program { state: (), phases: vec![Phase { id: "scan", title: "scan", in_paper_total: false, steps }] }
    };
    for simd in levels() {
        let hashes = [
            hash(examples::saxpy(5001), simd),
            hash(examples::histogram(3000, 70), simd),
            hash(examples::transpose(48, 80), simd),
            hash(scan(), simd),
        ];
        let frozen =
            [0x9976_ff4d_d553_7b9c, 0x1c87_3619_7292_6f36, 0x9f4e_59fd_47e8_3731, 0x05a5_cf7a_2e10_b832];
        assert_eq!(hashes, frozen, "{simd}: {hashes:#x?}");
    }
}
