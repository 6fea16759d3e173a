//! Records: structures with named fields in the arena, and where each field lies.
//!
//! A record is a `#[repr(C)]` structure of words, of which the host never makes a value: the compiler lays it out, and
//! [`field!`](crate::field) asks where a field went. Records lie one after the other, [`Records`], where a task broadcasts
//! one of them, or field by field, [`Columns`](crate::columns::Columns), where it loads 16 side by side.

use core::marker::PhantomData;

use lrbsim_isa::{Addr, Arena, Vpu};

use crate::expression::{each, scalar};
use crate::plane::Vec3;

/// Where a field of type `T` lies in a record `R`.
pub struct Field<R, T> {
    offset_bytes: u64,
    types: PhantomData<fn(&R) -> &T>,
}

impl<R, T> Field<R, T> {
    /// The field that `of` picks, at `offset_bytes`; [`field!`](crate::field) is the road to it.
    #[inline(always)]
    pub const fn new(offset_bytes: usize, _of: fn(&R) -> &T) -> Field<R, T> {
        Field { offset_bytes: offset_bytes as u64, types: PhantomData }
    }

    /// Bytes from the start of the record to the field.
    #[inline(always)]
    pub const fn offset_bytes(self) -> u64 {
        self.offset_bytes
    }
}

impl<R> Field<R, R> {
    /// All of a record: the field of a record that has no names, an array.
    #[inline(always)]
    pub const fn whole() -> Field<R, R> {
        Field { offset_bytes: 0, types: PhantomData }
    }
}

impl<R, T, const N: usize> Field<R, [T; N]> {
    /// Element `index` of a field that is an array.
    ///
    /// # Panics
    /// Where the array has no such element.
    #[inline(always)]
    pub const fn at(self, index: usize) -> Field<R, T> {
        assert!(index < N, "no such element");
        Field { offset_bytes: self.offset_bytes + (index * size_of::<T>()) as u64, types: PhantomData }
    }
}

impl<R, T> Clone for Field<R, T> {
    #[inline(always)]
    fn clone(&self) -> Self {
        *self
    }
}

impl<R, T> Copy for Field<R, T> {}

/// Where a field of a record lies, as a [`Field`](crate::record::Field): `field!(Node.depth)`, `field!(Node.center[axis])`.
#[macro_export]
macro_rules! field {
    ($record:ident . $field:ident $([$index:expr])*) => {
        $crate::record::Field::new(core::mem::offset_of!($record, $field), |record: &$record| &record.$field)
            $(.at($index))*
    };
}

/// Number of words of a record `R`.
#[inline(always)]
pub const fn words<R>() -> u32 {
    (size_of::<R>() / 4) as u32
}

/// Records `R` one after the other in the arena.
pub struct Records<R> {
    base: Addr,
    record: PhantomData<fn() -> R>,
}

impl<R> Records<R> {
    /// Allocates `count` records that somebody writes before anybody reads them.
    pub fn overwritten(arena: &mut Arena, count: u64) -> Records<R> {
        Records::from_base(arena.overwritten(count * u64::from(words::<R>())))
    }

    /// The records that begin at `base`.
    pub const fn from_base(base: Addr) -> Records<R> {
        Records { base, record: PhantomData }
    }

    /// Where `field` of record 0 lies: the base of accesses whose index is `words::<R>()` times the number of a record.
    #[inline(always)]
    pub const fn field<T>(self, field: Field<R, T>) -> Addr {
        self.base.plus(field.offset_bytes())
    }

    /// Where `field` of record `number` lies, for the host.
    pub const fn host(self, number: u32, field: Field<R, impl Sized>) -> Addr {
        self.base.plus(number as u64 * size_of::<R>() as u64 + field.offset_bytes())
    }

    /// The record of number `number`. One scalar operation: a shift where records are a power of two of words, else a multiplication.
    #[inline(always)]
    pub fn record<V: Vpu>(self, v: &mut V, number: V::S32) -> Record<V, R> {
        let words = words::<R>() as i32;
        if words.count_ones() == 1 {
            return self.at(scalar!(v, number << { words.trailing_zeros() as i32 }));
        }
        self.at(scalar!(v, number * { words }))
    }

    /// The record whose first word is word `index` of these.
    #[inline(always)]
    pub const fn at<V: Vpu>(self, index: V::S32) -> Record<V, R> {
        Record { records: self, index }
    }
}

impl<R> Default for Records<R> {
    /// Records that are not allocated yet.
    fn default() -> Self {
        Records { base: Addr(0), record: PhantomData }
    }
}

impl<R> Clone for Records<R> {
    #[inline(always)]
    fn clone(&self) -> Self {
        *self
    }
}

impl<R> Copy for Records<R> {}

/// One record that a task reads: where records lie, and the word of this one among them.
pub struct Record<V: Vpu, R> {
    records: Records<R>,
    index: V::S32,
}

impl<V: Vpu, R> Record<V, R> {
    /// A field of the record that is a float, in every lane. One broadcast load.
    #[inline(always)]
    pub fn float(self, v: &mut V, field: Field<R, f32>) -> V::F32 {
        v.vbroadcast_f32(self.records.field(field), self.index)
    }

    /// A field of the record that is a number of something, in every lane. One broadcast load.
    #[inline(always)]
    pub fn number(self, v: &mut V, field: Field<R, u32>) -> V::I32 {
        v.vbroadcast_i32(self.records.field(field), self.index)
    }

    /// A field of the record that is an integer, in every lane. One broadcast load.
    #[inline(always)]
    pub fn int(self, v: &mut V, field: Field<R, i32>) -> V::I32 {
        v.vbroadcast_i32(self.records.field(field), self.index)
    }

    /// A field of the record that has three components, each in every lane. Three broadcast loads.
    #[inline(always)]
    pub fn vec3(self, v: &mut V, field: Field<R, [f32; 3]>) -> Vec3<V> {
        each!(axis in [0, 1, 2] => self.float(v, field.at(axis)))
    }

    /// A field of the record that is an integer, as a scalar. One scalar load.
    #[inline(always)]
    pub fn scalar(self, v: &mut V, field: Field<R, i32>) -> V::S32 {
        v.s_load(self.records.field(field), self.index)
    }
}

/// Where 16 lanes find what they are told of a primitive: one record for all of them, a [`Record`], or one for each, [`Gathered`].
pub trait Source<V: Vpu, R>: Copy {
    /// A field that is a float.
    fn float(self, v: &mut V, field: Field<R, f32>) -> V::F32;

    /// A field that is an integer.
    fn int(self, v: &mut V, field: Field<R, i32>) -> V::I32;

    /// A source whose fields are what lies so many words behind those of this one.
    fn behind(self, v: &mut V, words: V::S32) -> Self;

    /// A field that has three components.
    #[inline(always)]
    fn vec3(self, v: &mut V, field: Field<R, [f32; 3]>) -> Vec3<V> {
        each!(axis in [0, 1, 2] => self.float(v, field.at(axis)))
    }
}

impl<V: Vpu, R> Source<V, R> for Record<V, R> {
    #[inline(always)]
    fn float(self, v: &mut V, field: Field<R, f32>) -> V::F32 {
        Record::float(self, v, field)
    }

    #[inline(always)]
    fn int(self, v: &mut V, field: Field<R, i32>) -> V::I32 {
        Record::int(self, v, field)
    }

    #[inline(always)]
    fn behind(self, v: &mut V, words: V::S32) -> Self {
        Record { index: v.s_add(self.index, words), ..self }
    }
}

/// Sixteen records that a task reads, one in each lane: a gather a field.
pub struct Gathered<V: Vpu, R> {
    records: Records<R>,
    /// Lanes that have a record; fields are 0 in the others.
    live: V::Mask,
    /// The first word of each lane's record.
    at: V::I32,
    none: V::I32,
}

impl<V: Vpu, R> Gathered<V, R> {
    /// The records of these numbers. One multiplication of vectors.
    #[inline(always)]
    pub fn new(v: &mut V, records: Records<R>, live: V::Mask, numbers: V::I32) -> Gathered<V, R> {
        let words = v.vset_i32(words::<R>() as i32);
        let none = v.vset_i32(0);
        Gathered { records, live, at: v.vimul(numbers, words), none }
    }
}

impl<V: Vpu, R> Source<V, R> for Gathered<V, R> {
    #[inline(always)]
    fn float(self, v: &mut V, field: Field<R, f32>) -> V::F32 {
        let zero = v.from_bits(self.none);
        v.vgather_f32_or(zero, self.live, self.records.field(field), self.at)
    }

    #[inline(always)]
    fn int(self, v: &mut V, field: Field<R, i32>) -> V::I32 {
        v.vgather_i32_or(self.none, self.live, self.records.field(field), self.at)
    }

    #[inline(always)]
    fn behind(self, v: &mut V, words: V::S32) -> Self {
        let words = v.vsplat(words);
        Gathered { at: v.viadd(self.at, words), ..self }
    }
}

impl<V: Vpu, R> Clone for Gathered<V, R> {
    #[inline(always)]
    fn clone(&self) -> Self {
        *self
    }
}

impl<V: Vpu, R> Copy for Gathered<V, R> {}

impl<V: Vpu, R> Clone for Record<V, R> {
    #[inline(always)]
    fn clone(&self) -> Self {
        *self
    }
}

impl<V: Vpu, R> Copy for Record<V, R> {}
