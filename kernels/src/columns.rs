//! Arrays side by side in the arena, and what every kernel does with them.

use lrbsim_isa::{Addr, Arena, Compare, Vpu};

/// Arrays of equal length: structure of arrays, one word an element.
#[derive(Debug, Clone, Copy, Default)]
pub struct Columns {
    base: Addr,
    /// Words from one array to the next.
    stride: u32,
}

impl Columns {
    /// Allocates `columns` arrays of `count` words each. A vector load of the last element stays inside.
    pub fn new(arena: &mut Arena, columns: u32, count: u32) -> Columns {
        let stride = (count + 16).next_multiple_of(16);
        Columns { base: arena.alloc(u64::from(columns) * u64::from(stride)), stride }
    }

    /// Where array `column` begins.
    #[inline(always)]
    pub const fn column(self, column: u32) -> Addr {
        self.base.plus(4 * column as u64 * self.stride as u64)
    }

    /// Words from one array to the next.
    #[inline(always)]
    pub const fn stride(self) -> u32 {
        self.stride
    }
}

/// Lanes `i` with `first + i < end`. Two scalar operations and a branch for all but the last vector of an array.
#[inline(always)]
pub fn lanes_below<V: Vpu>(v: &mut V, first: V::S32, end: V::S32) -> V::Mask {
    let left = v.s_sub(end, first);
    let lanes = v.s_imm(16);
    if v.branch(Compare::LessEqual, lanes, left) {
        return v.mask_all();
    }
    let one = v.s_imm(1);
    let bits = v.s_shl(one, left);
    let bits = v.s_sub(bits, one);
    v.kmov_from_scalar(bits)
}

/// The lower of two scalars.
#[inline(always)]
pub fn lower<V: Vpu>(v: &mut V, a: V::S32, b: V::S32) -> V::S32 {
    if v.branch(Compare::Less, a, b) { a } else { b }
}

/// First and end of task `task` of `size` items each, out of `count`.
#[inline(always)]
pub fn task_range<V: Vpu>(v: &mut V, task: V::S32, size: u32, count: u32) -> (V::S32, V::S32) {
    let size = v.s_imm(size as i32);
    let first = v.s_mul(task, size);
    let end = v.s_add(first, size);
    let count = v.s_imm(count as i32);
    (first, lower(v, end, count))
}

/// Number of the lowest bit that is set in `bits`, which is cleared: the lanes of a mask one after the other.
#[inline(always)]
pub fn take_lane<V: Vpu>(v: &mut V, bits: &mut V::S32) -> V::S32 {
    let one = v.s_imm(1);
    let lane = v.s_tzcnt(*bits);
    let rest = v.s_sub(*bits, one);
    *bits = v.s_and(*bits, rest);
    lane
}
