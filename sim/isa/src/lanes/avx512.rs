//! Lanes in one 512-bit host register.

#![expect(unsafe_code, reason = "host intrinsics; every instruction is behind `HostSimd::detect`")]

use core::arch::x86_64::*;

use super::{Avx2, CANONICAL_NAN, LANES, Lanes};

/// Lanes as AVX-512 registers (foundation, byte/word, vector-length and doubleword sets).
#[derive(Debug, Clone, Copy)]
pub struct Avx512;

type F = __m512;
type I = __m512i;

impl Lanes for Avx512 {
    type F = F;
    type I = I;

    #[inline(always)]
    fn splat_f(value: f32) -> F {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { _mm512_set1_ps(value) }
    }
    #[inline(always)]
    fn splat_i(value: i32) -> I {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { _mm512_set1_epi32(value) }
    }
    #[inline(always)]
    fn from_f(values: [f32; LANES]) -> F {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { _mm512_loadu_ps(values.as_ptr()) }
    }
    #[inline(always)]
    fn from_i(values: [i32; LANES]) -> I {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { _mm512_loadu_si512(values.as_ptr().cast()) }
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
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { _mm512_add_ps(a, b) }
    }
    #[inline(always)]
    fn sub(a: F, b: F) -> F {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { _mm512_sub_ps(a, b) }
    }
    #[inline(always)]
    fn mul(a: F, b: F) -> F {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { _mm512_mul_ps(a, b) }
    }
    #[inline(always)]
    fn min(a: F, b: F) -> F {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { _mm512_min_ps(a, b) }
    }
    #[inline(always)]
    fn max(a: F, b: F) -> F {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { _mm512_max_ps(a, b) }
    }
    #[inline(always)]
    fn madd(a: F, b: F, c: F) -> F {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { _mm512_fmadd_ps(a, b, c) }
    }
    #[inline(always)]
    fn msub(a: F, b: F, c: F) -> F {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { _mm512_fmsub_ps(a, b, c) }
    }
    #[inline(always)]
    fn nmadd(a: F, b: F, c: F) -> F {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { _mm512_fnmadd_ps(a, b, c) }
    }
    #[inline(always)]
    fn rcp(a: F) -> F {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { _mm512_div_ps(_mm512_set1_ps(1.0), a) }
    }
    #[inline(always)]
    fn rsqrt(a: F) -> F {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { _mm512_div_ps(_mm512_set1_ps(1.0), _mm512_sqrt_ps(a)) }
    }
    #[inline(always)]
    fn floor(a: F) -> F {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { _mm512_roundscale_ps::<{ _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC }>(a) }
    }
    #[inline(always)]
    fn nearest(a: F) -> F {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { _mm512_roundscale_ps::<{ _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC }>(a) }
    }
    #[inline(always)]
    fn iadd(a: I, b: I) -> I {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { _mm512_add_epi32(a, b) }
    }
    #[inline(always)]
    fn isub(a: I, b: I) -> I {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { _mm512_sub_epi32(a, b) }
    }
    #[inline(always)]
    fn imul(a: I, b: I) -> I {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { _mm512_mullo_epi32(a, b) }
    }
    #[inline(always)]
    fn imin(a: I, b: I) -> I {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { _mm512_min_epi32(a, b) }
    }
    #[inline(always)]
    fn imax(a: I, b: I) -> I {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { _mm512_max_epi32(a, b) }
    }
    #[inline(always)]
    fn and(a: I, b: I) -> I {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { _mm512_and_si512(a, b) }
    }
    #[inline(always)]
    fn or(a: I, b: I) -> I {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { _mm512_or_si512(a, b) }
    }
    #[inline(always)]
    fn xor(a: I, b: I) -> I {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { _mm512_xor_si512(a, b) }
    }
    #[inline(always)]
    fn andn(a: I, b: I) -> I {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { _mm512_andnot_si512(a, b) }
    }
    #[inline(always)]
    fn sll(a: I, b: I) -> I {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { _mm512_sllv_epi32(a, b) }
    }
    #[inline(always)]
    fn srl(a: I, b: I) -> I {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { _mm512_srlv_epi32(a, b) }
    }
    #[inline(always)]
    fn sra(a: I, b: I) -> I {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { _mm512_srav_epi32(a, b) }
    }
    #[inline(always)]
    fn lt(a: F, b: F) -> u16 {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { _mm512_cmp_ps_mask::<_CMP_LT_OQ>(a, b) }
    }
    #[inline(always)]
    fn le(a: F, b: F) -> u16 {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { _mm512_cmp_ps_mask::<_CMP_LE_OQ>(a, b) }
    }
    #[inline(always)]
    fn eq(a: F, b: F) -> u16 {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { _mm512_cmp_ps_mask::<_CMP_EQ_OQ>(a, b) }
    }
    #[inline(always)]
    fn ilt(a: I, b: I) -> u16 {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { _mm512_cmplt_epi32_mask(a, b) }
    }
    #[inline(always)]
    fn ieq(a: I, b: I) -> u16 {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { _mm512_cmpeq_epi32_mask(a, b) }
    }
    #[inline(always)]
    fn ult(a: I, b: I) -> u16 {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { _mm512_cmplt_epu32_mask(a, b) }
    }
    #[inline(always)]
    fn blend_f(k: u16, on: F, off: F) -> F {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { _mm512_mask_blend_ps(k, off, on) }
    }
    #[inline(always)]
    fn blend_i(k: u16, on: I, off: I) -> I {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { _mm512_mask_blend_epi32(k, off, on) }
    }
    #[inline(always)]
    fn to_float(a: I) -> F {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { _mm512_cvtepi32_ps(a) }
    }
    #[inline(always)]
    fn to_int(a: F) -> I {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { _mm512_cvttps_epi32(a) }
    }
    #[inline(always)]
    fn bits(a: F) -> I {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { _mm512_castps_si512(a) }
    }
    #[inline(always)]
    fn from_bits(a: I) -> F {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { _mm512_castsi512_ps(a) }
    }
    #[inline(always)]
    fn canonical(a: F) -> F {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe {
            _mm512_mask_blend_ps(
                _mm512_cmp_ps_mask::<_CMP_UNORD_Q>(a, a),
                a,
                _mm512_set1_ps(f32::from_bits(CANONICAL_NAN)),
            )
        }
    }
    #[inline(always)]
    fn permute(a: I, index: I) -> I {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe { _mm512_permutexvar_epi32(index, a) }
    }
    #[inline(always)]
    fn distinct(k: u16, a: I) -> u16 {
        // SAFETY: the host has the instruction, see `Lanes`.
        unsafe {
            // Lane i: the set of lanes before i with the same value; those that are off do not count.
            let earlier = _mm512_conflict_epi32(a);
            _mm512_mask_testn_epi32_mask(k, earlier, _mm512_set1_epi32(i32::from(k)))
        }
    }
    #[inline(always)]
    fn rise(made: &[u32; LANES], ended: &[u8; LANES]) -> (i32, i32) {
        Avx2::rise(made, ended)
    }
    #[inline(always)]
    unsafe fn load(from: *const i32) -> I {
        // SAFETY: the caller vouches for the active lanes; the host has the instruction.
        unsafe { _mm512_loadu_epi32(from) }
    }
    #[inline(always)]
    unsafe fn store(to: *mut i32, a: I) {
        // SAFETY: the caller vouches for the active lanes; the host has the instruction.
        unsafe { _mm512_storeu_epi32(to, a) }
    }
    #[inline(always)]
    unsafe fn load_masked(or: I, k: u16, from: *const i32) -> I {
        // SAFETY: the caller vouches for the active lanes; the host has the instruction.
        unsafe { _mm512_mask_loadu_epi32(or, k, from) }
    }
    #[inline(always)]
    unsafe fn store_masked(k: u16, to: *mut i32, a: I) {
        // SAFETY: the caller vouches for the active lanes; the host has the instruction.
        unsafe { _mm512_mask_storeu_epi32(to, k, a) }
    }
    #[inline(always)]
    unsafe fn gather(or: I, k: u16, base: *const i32, index: I) -> I {
        // SAFETY: the caller vouches for the active lanes; the host has the instruction.
        unsafe { _mm512_mask_i32gather_epi32::<4>(or, k, index, base) }
    }
    #[inline(always)]
    unsafe fn scatter(k: u16, base: *mut i32, index: I, a: I) {
        // SAFETY: the caller vouches for the active lanes; the host has the instruction.
        unsafe { _mm512_mask_i32scatter_epi32::<4>(base, k, index, a) }
    }
    #[inline(always)]
    unsafe fn expand(or: I, k: u16, from: *const i32) -> I {
        // SAFETY: the caller vouches for the active lanes; the host has the instruction.
        unsafe { _mm512_mask_expandloadu_epi32(or, k, from) }
    }
    #[inline(always)]
    unsafe fn compress(k: u16, to: *mut i32, a: I) {
        // SAFETY: the caller vouches for the active lanes; the host has the instruction.
        unsafe { _mm512_mask_compressstoreu_epi32(to, k, a) }
    }
    #[inline(always)]
    unsafe fn store_distinct(k: u16, to: *mut i32, a: I) -> u32 {
        let first = Self::distinct(k, a);
        // SAFETY: the caller vouches for 16 words; the host has the instruction.
        unsafe { _mm512_storeu_epi32(to, _mm512_maskz_compress_epi32(first, a)) };
        first.count_ones()
    }
}
