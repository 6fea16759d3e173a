//! Records field by field in the arena, and what every kernel does with arrays.

use core::marker::PhantomData;

use lrbsim_isa::{Addr, Arena, Compare, Vpu};

use crate::expression::scalar;
use crate::record::{Field, words};

/// Records `R` field by field: an array for each word of the record, all of one length.
pub struct Columns<R> {
    base: Addr,
    /// Words from the start of one column to the start of the next.
    stride: u32,
    record: PhantomData<fn() -> R>,
}

impl<R> Columns<R> {
    /// Allocates columns of `count` records that somebody writes before anybody reads them. A vector load of the last
    /// element stays inside.
    pub fn overwritten(arena: &mut Arena, count: u32) -> Columns<R> {
        Columns::with_stride(arena, (count + 16).next_multiple_of(16))
    }

    /// Allocates columns of `stride` records, as [`Columns::overwritten`] but without room behind.
    pub fn with_stride(arena: &mut Arena, stride: u32) -> Columns<R> {
        let words = u64::from(words::<R>()) * u64::from(stride);
        Columns { base: arena.overwritten(words), stride, record: PhantomData }
    }

    /// Where the column of `field` begins, for a field of several words that of the first.
    #[inline(always)]
    pub const fn column<T>(self, field: Field<R, T>) -> Addr {
        self.base.plus(field.offset_bytes() * self.stride as u64)
    }

    /// Where `field` of record `number` lies, for the host.
    pub const fn host<T>(self, number: u32, field: Field<R, T>) -> Addr {
        self.column(field).plus_words(number as u64)
    }

    /// Says that nobody reads the columns of `field` again before somebody writes them, see [`Arena::discard`].
    pub fn discard<T>(self, arena: &mut Arena, field: Field<R, T>) {
        arena.discard(self.column(field), u64::from(words::<T>()) * u64::from(self.stride));
    }

    /// Words from the start of one column to the start of the next.
    #[inline(always)]
    pub const fn stride(self) -> u32 {
        self.stride
    }
}

impl<R> Default for Columns<R> {
    /// Columns that are not allocated yet.
    fn default() -> Self {
        Columns { base: Addr(0), stride: 0, record: PhantomData }
    }
}

impl<R> Clone for Columns<R> {
    #[inline(always)]
    fn clone(&self) -> Self {
        *self
    }
}

impl<R> Copy for Columns<R> {}

/// Lanes `i` with `first + i < end`. Two scalar operations and a branch for all but the last vector of an array.
#[inline(always)]
pub fn lanes_below<V: Vpu>(v: &mut V, first: V::S32, end: V::S32) -> V::Mask {
    let left = scalar!(v, end - first);
    let lanes = v.s_imm(16);
    if v.branch(Compare::LessEqual, lanes, left) {
        return v.mask_all();
    }
    let bits = scalar!(v, (1 << left) - 1);
    v.kmov_from_scalar(bits)
}

/// Stores the first lane of `value` to word `index` of the array at `base`.
#[inline(always)]
pub fn store_first<V: Vpu>(v: &mut V, base: Addr, index: V::S32, value: V::F32) {
    let bit = v.s_imm(1);
    let first = v.kmov_from_scalar(bit);
    v.vstore_f32(first, base, index, value);
}

/// The lower of two scalars.
#[inline(always)]
pub fn lower<V: Vpu>(v: &mut V, a: V::S32, b: V::S32) -> V::S32 {
    if v.branch(Compare::Less, a, b) { a } else { b }
}

/// The higher of two scalars.
#[inline(always)]
pub fn higher<V: Vpu>(v: &mut V, a: V::S32, b: V::S32) -> V::S32 {
    if v.branch(Compare::Less, a, b) { b } else { a }
}

/// First and end of task `task` of `size` items each, out of `count`.
#[inline(always)]
pub fn task_range<V: Vpu>(v: &mut V, task: V::S32, size: u32, count: u32) -> (V::S32, V::S32) {
    let first = scalar!(v, task * { size as i32 });
    let end = scalar!(v, first + { size as i32 });
    let count = v.s_imm(count as i32);
    (first, lower(v, end, count))
}

/// Number of the lowest bit that is set in `bits`, which is cleared: the lanes of a mask one after the other.
#[inline(always)]
pub fn take_lane<V: Vpu>(v: &mut V, bits: &mut V::S32) -> V::S32 {
    let all = *bits;
    let lane = v.s_tzcnt(all);
    *bits = scalar!(v, all & (all - 1));
    lane
}

/// Sum of 16 integers, as a scalar.
#[inline(always)]
pub fn sum<V: Vpu>(v: &mut V, mut a: V::I32) -> V::S32 {
    let lane = v.viota();
    for distance in [1, 2, 4, 8] {
        let distance = v.vset_i32(distance);
        let other = v.vxor(lane, distance);
        let other = v.vpermute(a, other);
        a = v.viadd(a, other);
    }
    v.vextract(a, 0)
}
