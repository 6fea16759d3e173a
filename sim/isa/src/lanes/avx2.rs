//! Lanes in two 256-bit host registers.

#![expect(unsafe_code, reason = "host intrinsics; every instruction is behind `HostSimd::detect`")]

use core::arch::x86_64::*;

use super::{CANONICAL_NAN, LANES, Lanes, Portable};

/// Lanes as pairs of AVX2 registers, with fused multiply-add.
#[derive(Debug, Clone, Copy)]
pub struct Avx2;

type F = [__m256; 2];
type I = [__m256i; 2];

/// A pair of registers, each what one intrinsic makes of that half of the operands.
macro_rules! halves {
    ($op:expr, $($arg:ident),+) => {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { [$op($($arg[0]),+), $op($($arg[1]),+)] }
    };
}

/// A mask of 16 bits as two registers of all-ones or all-zeros lanes.
#[inline(always)]
fn spread(k: u16) -> I {
    // SAFETY: the host has the instruction, see `Lanes`.
    unsafe {
        let k = _mm256_set1_epi32(i32::from(k));
        let low = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
        let high = _mm256_slli_epi32::<8>(low);
        [
            _mm256_cmpeq_epi32(_mm256_and_si256(k, low), low),
            _mm256_cmpeq_epi32(_mm256_and_si256(k, high), high),
        ]
    }
}

/// The sign bits of all 16 lanes, as a mask.
#[inline(always)]
fn signs(a: F) -> u16 {
    // SAFETY: the host has the instruction, see `Lanes`.
    unsafe { (_mm256_movemask_ps(a[0]) | _mm256_movemask_ps(a[1]) << 8) as u16 }
}

#[inline(always)]
fn cast(a: I) -> F {
    halves!(_mm256_castsi256_ps, a)
}

/// Distinct values up to which one comparison with all lanes for each is cheaper than [`distinct_by_pairs`].
const FEW: u32 = 2;

/// [`Lanes::distinct`] by comparing all pairs of lanes: the same time however many values there are.
#[inline(always)]
fn distinct_by_pairs(k: u16, a: I) -> u16 {
    if signs(cast(a)) & k != 0 {
        // Negative numbers stand for lanes that are off, below. No index or line inside an arena is one.
        return Portable::distinct(k, Avx2::to_i(a));
    }
    // SAFETY: the host has the instruction, see `Lanes`.
    unsafe {
        let ascending = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
        let off = [
            _mm256_sub_epi32(_mm256_set1_epi32(-8), ascending),
            _mm256_sub_epi32(_mm256_set1_epi32(-16), ascending),
        ];
        let on = spread(k);
        let a = [_mm256_blendv_epi8(off[0], a[0], on[0]), _mm256_blendv_epi8(off[1], a[1], on[1])];
        let mut low = _mm256_setzero_si256();
        let mut high = _mm256_cmpeq_epi32(a[1], a[0]);
        for by in 1..8 {
            let from = _mm256_sub_epi32(ascending, _mm256_set1_epi32(by));
            let inside = _mm256_cmpgt_epi32(from, _mm256_set1_epi32(-1));
            // Lane i has what lane i - by has, modulo 8.
            let before = [_mm256_permutevar8x32_epi32(a[0], from), _mm256_permutevar8x32_epi32(a[1], from)];
            low = _mm256_or_si256(low, _mm256_and_si256(inside, _mm256_cmpeq_epi32(a[0], before[0])));
            let same = _mm256_and_si256(inside, _mm256_cmpeq_epi32(a[1], before[1]));
            high = _mm256_or_si256(high, _mm256_or_si256(same, _mm256_cmpeq_epi32(a[1], before[0])));
        }
        k & !signs(cast([low, high]))
    }
}

/// For each set of 8 lanes, the numbers of its lanes in order, a byte each; then zeros.
static PACKED: [u64; 256] = {
    let mut table = [0; 256];
    let mut set = 0;
    while set < 256 {
        let (mut lane, mut at) = (0, 0);
        while lane < 8 {
            if set >> lane & 1 == 1 {
                table[set] |= lane << at;
                at += 8;
            }
            lane += 1;
        }
        set += 1;
    }
    table
};

/// The lanes of `set` at the front, in order.
#[inline(always)]
fn pack(a: __m256i, set: u16) -> __m256i {
    // SAFETY: the host has the instruction, see `Lanes`.
    unsafe {
        let order = _mm_cvtsi64_si128(PACKED[usize::from(set & 0xff)] as i64);
        _mm256_permutevar8x32_epi32(a, _mm256_cvtepu8_epi32(order))
    }
}

impl Lanes for Avx2 {
    type F = F;
    type I = I;

    #[inline(always)]
    fn splat_f(value: f32) -> F {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { [_mm256_set1_ps(value); 2] }
    }
    #[inline(always)]
    fn splat_i(value: i32) -> I {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { [_mm256_set1_epi32(value); 2] }
    }
    #[inline(always)]
    fn from_f(values: [f32; LANES]) -> F {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { core::mem::transmute::<[f32; LANES], F>(values) }
    }
    #[inline(always)]
    fn from_i(values: [i32; LANES]) -> I {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { core::mem::transmute::<[i32; LANES], I>(values) }
    }
    #[inline(always)]
    fn to_f(a: F) -> [f32; LANES] {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { core::mem::transmute::<F, [f32; LANES]>(a) }
    }
    #[inline(always)]
    fn to_i(a: I) -> [i32; LANES] {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { core::mem::transmute::<I, [i32; LANES]>(a) }
    }
    #[inline(always)]
    fn add(a: F, b: F) -> F {
        halves!(_mm256_add_ps, a, b)
    }
    #[inline(always)]
    fn sub(a: F, b: F) -> F {
        halves!(_mm256_sub_ps, a, b)
    }
    #[inline(always)]
    fn mul(a: F, b: F) -> F {
        halves!(_mm256_mul_ps, a, b)
    }
    #[inline(always)]
    fn min(a: F, b: F) -> F {
        halves!(_mm256_min_ps, a, b)
    }
    #[inline(always)]
    fn max(a: F, b: F) -> F {
        halves!(_mm256_max_ps, a, b)
    }
    #[inline(always)]
    fn madd(a: F, b: F, c: F) -> F {
        halves!(_mm256_fmadd_ps, a, b, c)
    }
    #[inline(always)]
    fn msub(a: F, b: F, c: F) -> F {
        halves!(_mm256_fmsub_ps, a, b, c)
    }
    #[inline(always)]
    fn nmadd(a: F, b: F, c: F) -> F {
        halves!(_mm256_fnmadd_ps, a, b, c)
    }
    #[inline(always)]
    fn rcp(a: F) -> F {
        let one = Self::splat_f(1.0);
        halves!(_mm256_div_ps, one, a)
    }
    #[inline(always)]
    fn rsqrt(a: F) -> F {
        let root = halves!(_mm256_sqrt_ps, a);
        Self::rcp(root)
    }
    #[inline(always)]
    fn floor(a: F) -> F {
        halves!(_mm256_floor_ps, a)
    }
    #[inline(always)]
    fn nearest(a: F) -> F {
        halves!(_mm256_round_ps::<{ _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC }>, a)
    }
    #[inline(always)]
    fn iadd(a: I, b: I) -> I {
        halves!(_mm256_add_epi32, a, b)
    }
    #[inline(always)]
    fn isub(a: I, b: I) -> I {
        halves!(_mm256_sub_epi32, a, b)
    }
    #[inline(always)]
    fn imul(a: I, b: I) -> I {
        halves!(_mm256_mullo_epi32, a, b)
    }
    #[inline(always)]
    fn imin(a: I, b: I) -> I {
        halves!(_mm256_min_epi32, a, b)
    }
    #[inline(always)]
    fn imax(a: I, b: I) -> I {
        halves!(_mm256_max_epi32, a, b)
    }
    #[inline(always)]
    fn and(a: I, b: I) -> I {
        halves!(_mm256_and_si256, a, b)
    }
    #[inline(always)]
    fn or(a: I, b: I) -> I {
        halves!(_mm256_or_si256, a, b)
    }
    #[inline(always)]
    fn xor(a: I, b: I) -> I {
        halves!(_mm256_xor_si256, a, b)
    }
    #[inline(always)]
    fn andn(a: I, b: I) -> I {
        halves!(_mm256_andnot_si256, a, b)
    }
    #[inline(always)]
    fn sll(a: I, b: I) -> I {
        halves!(_mm256_sllv_epi32, a, b)
    }
    #[inline(always)]
    fn srl(a: I, b: I) -> I {
        halves!(_mm256_srlv_epi32, a, b)
    }
    #[inline(always)]
    fn sra(a: I, b: I) -> I {
        halves!(_mm256_srav_epi32, a, b)
    }
    #[inline(always)]
    fn lt(a: F, b: F) -> u16 {
        signs(halves!(_mm256_cmp_ps::<_CMP_LT_OQ>, a, b))
    }
    #[inline(always)]
    fn le(a: F, b: F) -> u16 {
        signs(halves!(_mm256_cmp_ps::<_CMP_LE_OQ>, a, b))
    }
    #[inline(always)]
    fn eq(a: F, b: F) -> u16 {
        signs(halves!(_mm256_cmp_ps::<_CMP_EQ_OQ>, a, b))
    }
    #[inline(always)]
    fn ilt(a: I, b: I) -> u16 {
        signs(cast(halves!(_mm256_cmpgt_epi32, b, a)))
    }
    #[inline(always)]
    fn ieq(a: I, b: I) -> u16 {
        signs(cast(halves!(_mm256_cmpeq_epi32, a, b)))
    }
    #[inline(always)]
    fn ult(a: I, b: I) -> u16 {
        let flip = Self::splat_i(i32::MIN);
        Self::ilt(Self::xor(a, flip), Self::xor(b, flip))
    }
    #[inline(always)]
    fn blend_f(k: u16, on: F, off: F) -> F {
        let k = cast(spread(k));
        halves!(_mm256_blendv_ps, off, on, k)
    }
    #[inline(always)]
    fn blend_i(k: u16, on: I, off: I) -> I {
        let k = spread(k);
        halves!(_mm256_blendv_epi8, off, on, k)
    }
    #[inline(always)]
    fn to_float(a: I) -> F {
        halves!(_mm256_cvtepi32_ps, a)
    }
    #[inline(always)]
    fn to_int(a: F) -> I {
        halves!(_mm256_cvttps_epi32, a)
    }
    #[inline(always)]
    fn bits(a: F) -> I {
        halves!(_mm256_castps_si256, a)
    }
    #[inline(always)]
    fn from_bits(a: I) -> F {
        halves!(_mm256_castsi256_ps, a)
    }
    #[inline(always)]
    fn canonical(a: F) -> F {
        let nan = halves!(_mm256_cmp_ps::<_CMP_UNORD_Q>, a, a);
        let canonical = Self::splat_f(f32::from_bits(CANONICAL_NAN));
        halves!(_mm256_blendv_ps, a, canonical, nan)
    }
    #[inline(always)]
    fn permute(a: I, index: I) -> I {
        // Permute within each source half, then take the half that bit 3 of the index names.
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe {
            let pick = |index: __m256i| {
                let low = _mm256_permutevar8x32_epi32(a[0], index);
                let high = _mm256_permutevar8x32_epi32(a[1], index);
                let from_high = _mm256_slli_epi32::<28>(index);
                _mm256_castps_si256(_mm256_blendv_ps(
                    _mm256_castsi256_ps(low),
                    _mm256_castsi256_ps(high),
                    _mm256_castsi256_ps(from_high),
                ))
            };
            [pick(index[0]), pick(index[1])]
        }
    }
    #[inline(always)]
    fn distinct(k: u16, a: I) -> u16 {
        let values = Self::to_i(a);
        let (mut live, mut first) = (k, 0);
        // Most often there are few.
        for _ in 0..FEW {
            if live == 0 {
                return first;
            }
            let lane = live.trailing_zeros() as usize & 15;
            first |= 1 << lane;
            live &= !Self::ieq(a, Self::splat_i(values[lane]));
        }
        if live == 0 { first } else { distinct_by_pairs(k, a) }
    }
    #[inline(always)]
    fn rise(made: &[u32; LANES], ended: &[u8; LANES]) -> (i32, i32) {
        // SAFETY: loads from references; the host has the instruction, see `Lanes`.
        unsafe {
            let zero = _mm256_setzero_si256();
            let made = made.as_ptr().cast::<__m256i>();
            let low = _mm256_cmpeq_epi32(_mm256_loadu_si256(made), zero);
            let high = _mm256_cmpeq_epi32(_mm256_loadu_si256(made.add(1)), zero);
            // -1 for what was not made, in order: the packing works on the halves of the registers.
            let not_made = _mm256_permute4x64_epi64::<0b11_01_10_00>(_mm256_packs_epi32(low, high));
            let ended = _mm256_cvtepu8_epi16(_mm_loadu_si128(ended.as_ptr().cast()));
            // Sums of 1, 2, 4, 8 lanes in each half, then of the low half into the high one.
            let mut sum = _mm256_sub_epi16(not_made, ended);
            sum = _mm256_add_epi16(sum, _mm256_slli_si256::<2>(sum));
            sum = _mm256_add_epi16(sum, _mm256_slli_si256::<4>(sum));
            sum = _mm256_add_epi16(sum, _mm256_slli_si256::<8>(sum));
            let low_to_high = _mm256_permute2x128_si256::<0x08>(sum, sum);
            sum = _mm256_add_epi16(sum, _mm256_shuffle_epi8(low_to_high, _mm256_set1_epi16(0x0f0e)));
            // Had all been made, it would have risen by one each.
            let steps = _mm256_setr_epi16(1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16);
            sum = _mm256_add_epi16(sum, steps);
            let upper = _mm256_extracti128_si256::<1>(sum);
            let highest = _mm_max_epi16(_mm256_castsi256_si128(sum), upper);
            // The one horizontal instruction finds the least of unsigned words.
            let from_top = _mm_sub_epi16(_mm_set1_epi16(i16::MAX), highest);
            let least = _mm_cvtsi128_si32(_mm_minpos_epu16(from_top)) & 0xffff;
            (i32::from(i16::MAX) - least, _mm_extract_epi16::<7>(upper) as i16 as i32)
        }
    }
    #[inline(always)]
    unsafe fn load(from: *const i32) -> I {
        // SAFETY: the caller vouches for the active lanes; the host has the instruction.
        unsafe { [_mm256_loadu_si256(from.cast()), _mm256_loadu_si256(from.wrapping_add(8).cast())] }
    }
    #[inline(always)]
    unsafe fn store(to: *mut i32, a: I) {
        // SAFETY: the caller vouches for the active lanes; the host has the instruction.
        unsafe {
            _mm256_storeu_si256(to.cast(), a[0]);
            _mm256_storeu_si256(to.wrapping_add(8).cast(), a[1]);
        }
    }
    #[inline(always)]
    unsafe fn load_masked(or: I, k: u16, from: *const i32) -> I {
        let live = spread(k);
        // SAFETY: masked-off lanes are not read; the host has the instruction.
        let loaded = unsafe {
            [_mm256_maskload_epi32(from, live[0]), _mm256_maskload_epi32(from.wrapping_add(8), live[1])]
        };
        halves!(_mm256_blendv_epi8, or, loaded, live)
    }
    #[inline(always)]
    unsafe fn store_masked(k: u16, to: *mut i32, a: I) {
        let live = spread(k);
        // SAFETY: masked-off lanes are not written; the host has the instruction.
        unsafe {
            _mm256_maskstore_epi32(to, live[0], a[0]);
            _mm256_maskstore_epi32(to.wrapping_add(8), live[1], a[1]);
        }
    }
    #[inline(always)]
    unsafe fn gather(or: I, k: u16, base: *const i32, index: I) -> I {
        let live = spread(k);
        // SAFETY: masked-off lanes are not read; the host has the instruction.
        unsafe {
            [
                _mm256_mask_i32gather_epi32::<4>(or[0], base, index[0], live[0]),
                _mm256_mask_i32gather_epi32::<4>(or[1], base, index[1], live[1]),
            ]
        }
    }
    #[inline(always)]
    unsafe fn scatter(k: u16, base: *mut i32, index: I, a: I) {
        // SAFETY: the caller vouches for the active lanes. AVX2 has no scatter.
        unsafe { Portable::scatter(k, base, Self::to_i(index), Self::to_i(a)) }
    }
    #[inline(always)]
    unsafe fn expand(or: I, k: u16, from: *const i32) -> I {
        // SAFETY: the caller vouches for the active lanes. AVX2 has no expand.
        Self::from_i(unsafe { Portable::expand(Self::to_i(or), k, from) })
    }
    #[inline(always)]
    unsafe fn compress(k: u16, to: *mut i32, a: I) {
        // SAFETY: the caller vouches for the active lanes. AVX2 has no compress.
        unsafe { Portable::compress(k, to, Self::to_i(a)) }
    }
    #[inline(always)]
    unsafe fn store_distinct(k: u16, to: *mut i32, a: I) -> u32 {
        let values = Self::to_i(a);
        let (mut live, mut count) = (k, 0);
        for _ in 0..FEW {
            if live == 0 {
                return count;
            }
            let value = values[live.trailing_zeros() as usize & 15];
            // SAFETY: the caller vouches for 16 words, and every round takes a lane away.
            unsafe { to.add(count as usize).write_unaligned(value) };
            live &= !Self::ieq(a, Self::splat_i(value));
            count += 1;
        }
        if live == 0 {
            return count;
        }
        let first = distinct_by_pairs(k, a);
        let low = first & 0xff;
        // SAFETY: the caller vouches for 16 words: 8 at `to`, and 8 after at most 8 of them; the host has the
        // instruction.
        unsafe {
            _mm256_storeu_si256(to.cast(), pack(a[0], low));
            _mm256_storeu_si256(to.add(low.count_ones() as usize).cast(), pack(a[1], first >> 8));
        }
        first.count_ones()
    }
}
