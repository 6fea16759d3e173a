//! The definition of every operation: plain loops over arrays.
//!
//! Hosts other than x86-64 run these, inlined into every kernel. On x86-64 few hosts lack AVX2, and kernels call them: inlined
//! they were most of the machine code of all kernels, and of the time to compile it.

#![expect(unsafe_code, reason = "memory operations take host pointers whose range the caller has checked")]

use super::{CANONICAL_NAN, LANES, Lanes};

/// Lanes as arrays; what the other implementations are measured against.
#[derive(Debug, Clone, Copy)]
pub struct Portable;

type F = [f32; LANES];
type I = [i32; LANES];

#[inline(always)]
fn map<A: Copy, R: Copy + Default>(a: [A; LANES], f: impl Fn(A) -> R) -> [R; LANES] {
    let mut out = [R::default(); LANES];
    for i in 0..LANES {
        out[i] = f(a[i]);
    }
    out
}

#[inline(always)]
fn zip<A: Copy, R: Copy + Default>(a: [A; LANES], b: [A; LANES], f: impl Fn(A, A) -> R) -> [R; LANES] {
    let mut out = [R::default(); LANES];
    for i in 0..LANES {
        out[i] = f(a[i], b[i]);
    }
    out
}

#[inline(always)]
fn mask<A: Copy>(a: [A; LANES], b: [A; LANES], f: impl Fn(A, A) -> bool) -> u16 {
    let mut k = 0;
    for i in 0..LANES {
        k |= u16::from(f(a[i], b[i])) << i;
    }
    k
}

#[inline(always)]
fn select<A: Copy>(k: u16, on: [A; LANES], off: [A; LANES]) -> [A; LANES] {
    let mut out = off;
    for i in 0..LANES {
        if k >> i & 1 == 1 {
            out[i] = on[i];
        }
    }
    out
}

impl Lanes for Portable {
    type F = F;
    type I = I;

    #[inline(always)]
    fn splat_f(value: f32) -> F {
        [value; LANES]
    }
    #[inline(always)]
    fn splat_i(value: i32) -> I {
        [value; LANES]
    }
    #[inline(always)]
    fn from_f(values: F) -> F {
        values
    }
    #[inline(always)]
    fn from_i(values: I) -> I {
        values
    }
    #[inline(always)]
    fn to_f(a: F) -> F {
        a
    }
    #[inline(always)]
    fn to_i(a: I) -> I {
        a
    }

    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn add(a: F, b: F) -> F {
        zip(a, b, |a, b| a + b)
    }
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn sub(a: F, b: F) -> F {
        zip(a, b, |a, b| a - b)
    }
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn mul(a: F, b: F) -> F {
        zip(a, b, |a, b| a * b)
    }
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn min(a: F, b: F) -> F {
        zip(a, b, |a, b| if a < b { a } else { b })
    }
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn max(a: F, b: F) -> F {
        zip(a, b, |a, b| if a > b { a } else { b })
    }
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn madd(a: F, b: F, c: F) -> F {
        let mut out = c;
        for i in 0..LANES {
            out[i] = a[i].mul_add(b[i], c[i]);
        }
        out
    }
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn msub(a: F, b: F, c: F) -> F {
        let mut out = c;
        for i in 0..LANES {
            out[i] = a[i].mul_add(b[i], -c[i]);
        }
        out
    }
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn nmadd(a: F, b: F, c: F) -> F {
        let mut out = c;
        for i in 0..LANES {
            out[i] = (-a[i]).mul_add(b[i], c[i]);
        }
        out
    }
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn rcp(a: F) -> F {
        map(a, |a| 1.0 / a)
    }
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn rsqrt(a: F) -> F {
        map(a, |a| 1.0 / a.sqrt())
    }
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn floor(a: F) -> F {
        map(a, f32::floor)
    }
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn nearest(a: F) -> F {
        map(a, f32::round_ties_even)
    }

    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn iadd(a: I, b: I) -> I {
        zip(a, b, i32::wrapping_add)
    }
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn isub(a: I, b: I) -> I {
        zip(a, b, i32::wrapping_sub)
    }
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn imul(a: I, b: I) -> I {
        zip(a, b, i32::wrapping_mul)
    }
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn imin(a: I, b: I) -> I {
        zip(a, b, i32::min)
    }
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn imax(a: I, b: I) -> I {
        zip(a, b, i32::max)
    }
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn and(a: I, b: I) -> I {
        zip(a, b, |a, b| a & b)
    }
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn or(a: I, b: I) -> I {
        zip(a, b, |a, b| a | b)
    }
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn xor(a: I, b: I) -> I {
        zip(a, b, |a, b| a ^ b)
    }
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn andn(a: I, b: I) -> I {
        zip(a, b, |a, b| !a & b)
    }
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn sll(a: I, b: I) -> I {
        zip(a, b, |a, b| if (b as u32) < 32 { a << b } else { 0 })
    }
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn srl(a: I, b: I) -> I {
        zip(a, b, |a, b| if (b as u32) < 32 { (a as u32 >> b) as i32 } else { 0 })
    }
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn sra(a: I, b: I) -> I {
        zip(a, b, |a, b| a >> (b as u32).min(31))
    }

    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn lt(a: F, b: F) -> u16 {
        mask(a, b, |a, b| a < b)
    }
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn le(a: F, b: F) -> u16 {
        mask(a, b, |a, b| a <= b)
    }
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn eq(a: F, b: F) -> u16 {
        mask(a, b, |a, b| a == b)
    }
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn ilt(a: I, b: I) -> u16 {
        mask(a, b, |a, b| a < b)
    }
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn ieq(a: I, b: I) -> u16 {
        mask(a, b, |a, b| a == b)
    }
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn ult(a: I, b: I) -> u16 {
        mask(a, b, |a, b| (a as u32) < b as u32)
    }

    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn blend_f(k: u16, on: F, off: F) -> F {
        select(k, on, off)
    }
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn blend_i(k: u16, on: I, off: I) -> I {
        select(k, on, off)
    }
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn to_float(a: I) -> F {
        map(a, |a| a as f32)
    }
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn to_int(a: F) -> I {
        map(a, |a| if (-2_147_483_648.0..2_147_483_648.0).contains(&a) { a as i32 } else { i32::MIN })
    }
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn bits(a: F) -> I {
        map(a, |a| a.to_bits() as i32)
    }
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn from_bits(a: I) -> F {
        map(a, |a| f32::from_bits(a as u32))
    }
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn canonical(a: F) -> F {
        map(a, |a| if a.is_nan() { f32::from_bits(CANONICAL_NAN) } else { a })
    }
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn permute(a: I, index: I) -> I {
        map(index, |i| a[(i & 15) as usize])
    }

    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    fn distinct(k: u16, a: I) -> u16 {
        let values = Self::to_i(a);
        let (mut live, mut first) = (k, 0);
        while live != 0 {
            let lane = live.trailing_zeros() as usize & 15;
            first |= 1 << lane;
            live &= !Self::ieq(a, Self::splat_i(values[lane]));
        }
        first
    }
    #[inline(always)]
    unsafe fn load(from: *const i32) -> I {
        // SAFETY: the caller vouches for 64 bytes.
        unsafe { from.cast::<I>().read_unaligned() }
    }
    #[inline(always)]
    unsafe fn store(to: *mut i32, a: I) {
        // SAFETY: the caller vouches for 64 bytes.
        unsafe { to.cast::<I>().write_unaligned(a) }
    }
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    unsafe fn load_masked(or: I, k: u16, from: *const i32) -> I {
        let mut out = or;
        for (i, lane) in out.iter_mut().enumerate() {
            if k >> i & 1 == 1 {
                // SAFETY: the caller vouches for the active lanes.
                *lane = unsafe { from.wrapping_add(i).read_unaligned() };
            }
        }
        out
    }
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    unsafe fn store_masked(k: u16, to: *mut i32, a: I) {
        for (i, lane) in a.into_iter().enumerate() {
            if k >> i & 1 == 1 {
                // SAFETY: the caller vouches for the active lanes.
                unsafe { to.wrapping_add(i).write_unaligned(lane) }
            }
        }
    }
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    unsafe fn gather(or: I, k: u16, base: *const i32, index: I) -> I {
        let mut out = or;
        for i in 0..LANES {
            if k >> i & 1 == 1 {
                // SAFETY: the caller vouches for the active lanes.
                out[i] = unsafe { base.wrapping_offset(index[i] as isize).read_unaligned() };
            }
        }
        out
    }
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    unsafe fn scatter(k: u16, base: *mut i32, index: I, a: I) {
        for i in 0..LANES {
            if k >> i & 1 == 1 {
                // SAFETY: the caller vouches for the active lanes.
                unsafe { base.wrapping_offset(index[i] as isize).write_unaligned(a[i]) }
            }
        }
    }
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    unsafe fn expand(or: I, k: u16, from: *const i32) -> I {
        let mut out = or;
        let mut next = from;
        for (i, lane) in out.iter_mut().enumerate() {
            if k >> i & 1 == 1 {
                // SAFETY: the caller vouches for as many words as there are active lanes.
                *lane = unsafe { next.read_unaligned() };
                next = next.wrapping_add(1);
            }
        }
        out
    }
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    unsafe fn compress(k: u16, to: *mut i32, a: I) {
        let mut next = to;
        for (i, lane) in a.into_iter().enumerate() {
            if k >> i & 1 == 1 {
                // SAFETY: the caller vouches for as many words as there are active lanes.
                unsafe { next.write_unaligned(lane) }
                next = next.wrapping_add(1);
            }
        }
    }
    #[cfg_attr(not(target_arch = "x86_64"), inline(always))]
    unsafe fn store_distinct(k: u16, to: *mut i32, a: I) -> u32 {
        let values = Self::to_i(a);
        let (mut live, mut count) = (k, 0);
        while live != 0 {
            let value = values[live.trailing_zeros() as usize & 15];
            // SAFETY: the caller vouches for 16 words, and every round takes a lane away.
            unsafe { to.add(count as usize).write_unaligned(value) };
            live &= !Self::ieq(a, Self::splat_i(value));
            count += 1;
        }
        count
    }
}
