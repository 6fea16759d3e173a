//! What 16 lanes compute, on the host: one implementation a host instruction set.
//!
//! [`Portable`] is plain loops over arrays and defines every operation; [`Avx512`] and [`Avx2`] must be bit-equal to it,
//! except that a NaN is one value: its sign and payload are canonical only once it is observed (`canonical`).

mod portable;
pub use portable::Portable;

#[cfg(target_arch = "x86_64")]
mod avx512;
#[cfg(target_arch = "x86_64")]
pub use avx512::Avx512;

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
pub use avx2::Avx2;

/// Number of lanes of a vector.
pub const LANES: usize = 16;

/// The bits of the one NaN that is ever observed.
pub const CANONICAL_NAN: u32 = 0x7fc0_0000;

/// Implements one operation for every lane; see [`Portable`] for the definitions.
///
/// # Safety
/// The methods that take pointers read or write 4 bytes an active lane there (`store_distinct`: up to 64 bytes). All methods of a host instruction set may
/// only run on hosts that have it: [`HostSimd`](crate::host::HostSimd) sees to that.
#[expect(unsafe_code, reason = "memory operations take host pointers whose range the caller has checked")]
#[expect(clippy::missing_safety_doc, reason = "said once for all, above")]
#[expect(missing_docs, reason = "each method is the lane form of the operation of the same name in `vpu`")]
pub trait Lanes: 'static {
    type F: Copy;
    type I: Copy;

    fn splat_f(value: f32) -> Self::F;
    fn splat_i(value: i32) -> Self::I;
    fn from_f(values: [f32; LANES]) -> Self::F;
    fn from_i(values: [i32; LANES]) -> Self::I;
    fn to_f(a: Self::F) -> [f32; LANES];
    fn to_i(a: Self::I) -> [i32; LANES];

    fn add(a: Self::F, b: Self::F) -> Self::F;
    fn sub(a: Self::F, b: Self::F) -> Self::F;
    fn mul(a: Self::F, b: Self::F) -> Self::F;
    fn min(a: Self::F, b: Self::F) -> Self::F;
    fn max(a: Self::F, b: Self::F) -> Self::F;
    fn madd(a: Self::F, b: Self::F, c: Self::F) -> Self::F;
    fn msub(a: Self::F, b: Self::F, c: Self::F) -> Self::F;
    fn nmadd(a: Self::F, b: Self::F, c: Self::F) -> Self::F;
    fn rcp(a: Self::F) -> Self::F;
    fn rsqrt(a: Self::F) -> Self::F;
    fn floor(a: Self::F) -> Self::F;
    fn nearest(a: Self::F) -> Self::F;

    fn iadd(a: Self::I, b: Self::I) -> Self::I;
    fn isub(a: Self::I, b: Self::I) -> Self::I;
    fn imul(a: Self::I, b: Self::I) -> Self::I;
    fn imin(a: Self::I, b: Self::I) -> Self::I;
    fn imax(a: Self::I, b: Self::I) -> Self::I;
    fn and(a: Self::I, b: Self::I) -> Self::I;
    fn or(a: Self::I, b: Self::I) -> Self::I;
    fn xor(a: Self::I, b: Self::I) -> Self::I;
    fn andn(a: Self::I, b: Self::I) -> Self::I;
    fn sll(a: Self::I, b: Self::I) -> Self::I;
    fn srl(a: Self::I, b: Self::I) -> Self::I;
    fn sra(a: Self::I, b: Self::I) -> Self::I;

    fn lt(a: Self::F, b: Self::F) -> u16;
    fn le(a: Self::F, b: Self::F) -> u16;
    fn eq(a: Self::F, b: Self::F) -> u16;
    fn ilt(a: Self::I, b: Self::I) -> u16;
    fn ieq(a: Self::I, b: Self::I) -> u16;
    fn ult(a: Self::I, b: Self::I) -> u16;

    fn blend_f(k: u16, on: Self::F, off: Self::F) -> Self::F;
    fn blend_i(k: u16, on: Self::I, off: Self::I) -> Self::I;
    fn to_float(a: Self::I) -> Self::F;
    fn to_int(a: Self::F) -> Self::I;
    fn bits(a: Self::F) -> Self::I;
    fn from_bits(a: Self::I) -> Self::F;
    fn canonical(a: Self::F) -> Self::F;
    fn permute(a: Self::I, index: Self::I) -> Self::I;

    /// The lanes among `k` whose value no earlier lane among `k` has.
    fn distinct(k: u16, a: Self::I) -> u16;

    /// Where a sum rises by one for each `made` that is not 0 and falls by `ended`: its highest value after any of the 16
    /// steps, and its last. No operation of a kernel, but the same hosts do it.
    #[inline(always)]
    fn rise(made: &[u32; LANES], ended: &[u8; LANES]) -> (i32, i32) {
        let (mut highest, mut sum) = (i32::MIN, 0);
        for (made, ended) in made.iter().zip(ended) {
            sum += i32::from(*made != 0) - i32::from(*ended);
            highest = highest.max(sum);
        }
        (highest, sum)
    }

    unsafe fn load(from: *const i32) -> Self::I;
    unsafe fn store(to: *mut i32, a: Self::I);
    unsafe fn load_masked(or: Self::I, k: u16, from: *const i32) -> Self::I;
    unsafe fn store_masked(k: u16, to: *mut i32, a: Self::I);
    unsafe fn gather(or: Self::I, k: u16, base: *const i32, index: Self::I) -> Self::I;
    unsafe fn scatter(k: u16, base: *mut i32, index: Self::I, a: Self::I);
    unsafe fn expand(or: Self::I, k: u16, from: *const i32) -> Self::I;
    unsafe fn compress(k: u16, to: *mut i32, a: Self::I);
    /// The values of the lanes of [`Lanes::distinct`] to consecutive words at `to`, and how many there are; the rest of
    /// the 16 words at `to` may be overwritten.
    unsafe fn store_distinct(k: u16, to: *mut i32, a: Self::I) -> u32;
}
