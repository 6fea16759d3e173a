//! Every row of the operation table.

use super::{Random, levels, observed, run};
use crate::arena::{Addr, Arena};
use crate::kernel::{AnyKernel, Kernel};
use crate::stream::Stream;
use crate::uop::{Class, Uop};
use crate::vpu::{Vpu, for_each_operation};

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
    let out = arena.overwritten(out_words as u64);
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
