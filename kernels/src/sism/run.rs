//! A run of samples: what `hard` and `soft` share.
//!
//! A task owns the samples of its run, so that sums need no atomics and repeat bit for bit. Cell by cell it takes 16
//! samples at a time and walks all records of the cell; a record that begins deeper than all 16 is skipped.

use lrbsim_isa::{Compare, Vpu, math};

use super::layout::{Layout, POSITION, SLICES};
use super::raster::{cell_vectors, sum};
use crate::columns::{Columns, lanes_below, lower};
use crate::plane::Vec3;

/// 16 samples of one cell.
pub struct Samples<V: Vpu> {
    /// Lanes that hold a sample.
    pub live: V::Mask,
    /// Index of lane 0.
    pub first: V::S32,
    /// Light-centred positions.
    pub position: Vec3<V>,
}

/// What is done with 16 samples and the records of their cell.
pub trait PerVector {
    /// Handles records `first..end` (in pairs of words) for `samples`, of which the deepest is at `depth` (the bits of a
    /// positive float, which order like integers).
    fn vector<V: Vpu>(&self, v: &mut V, samples: &Samples<V>, records: (V::S32, V::S32), depth: V::S32);
}

/// Runs task `task` of `runs` over the records of kind `kind` (0 triangles, 1 edges).
#[inline(always)]
pub fn walk<V: Vpu>(
    v: &mut V,
    layout: &Layout,
    runs: Columns,
    kind: u32,
    task: V::S32,
    work: &impl PerVector,
) {
    let one = v.s_imm(1);
    let two = v.s_imm(2);
    let four = v.s_imm(4);
    let fifteen = v.s_imm(15);
    let sixteen = v.s_imm(16);
    let zero = v.s_imm(0);
    let block = v.s_load(runs.column(0), task);
    let piece = v.s_load(runs.column(1), task);
    let log2 = v.s_load(runs.column(2), task);
    let log2 = v.s_sub(log2, one);

    // This run's vectors of the block: first..end of count.
    let first_cell = v.s_shl(block, four);
    let vectors = cell_vectors(v, layout, first_cell);
    let count = sum(v, vectors);
    let first = v.s_mul(piece, count);
    let first = v.s_shr(first, log2);
    let next = v.s_add(piece, one);
    let end = v.s_mul(next, count);
    let end = v.s_shr(end, log2);

    // The face, for the depth of the samples.
    let eight = v.s_imm(8);
    let bin = v.s_shr(first_cell, eight);
    let face = v.s_load(layout.bin_table.column(0), bin);
    let axis = v.s_shr(face, one);
    let stride = v.s_imm(layout.samples.stride() as i32);
    let depths = v.s_mul(axis, stride);

    let lists = layout.cell_lists.starts.plus(4 * u64::from(kind * layout.cell_count()));
    let next_cell = layout.key_starts.plus(4 * u64::from(SLICES));
    let mut seen = zero;
    for number in 0..16 {
        let number = v.s_imm(number);
        let cell = v.s_add(first_cell, number);
        let key = v.s_shl(cell, two);
        let sample_first = v.s_load(layout.key_starts, key);
        let sample_end = v.s_load(next_cell, key);
        let samples = v.s_sub(sample_end, sample_first);
        let samples = v.s_add(samples, fifteen);
        let in_cell = v.s_shr(samples, four);
        let cell_first = seen;
        seen = v.s_add(seen, in_cell);
        // Does the run reach this cell, and does the cell have records?
        if v.branch(Compare::LessEqual, seen, first) {
            continue;
        }
        if v.branch(Compare::LessEqual, end, cell_first) {
            break;
        }
        let record_first = v.s_load(lists, cell);
        let record_end = v.s_load(lists.plus(4), cell);
        if v.branch(Compare::Equal, record_first, record_end) {
            continue;
        }
        let record_first = v.s_add(record_first, record_first);
        let record_end = v.s_add(record_end, record_end);
        let from = if v.branch(Compare::Less, cell_first, first) { first } else { cell_first };
        let to = lower(v, seen, end);
        let from = v.s_sub(from, cell_first);
        let to = v.s_sub(to, cell_first);
        let from = v.s_shl(from, four);
        let to = v.s_shl(to, four);
        let mut i = v.s_add(sample_first, from);
        let stop = v.s_add(sample_first, to);
        let stop = lower(v, stop, sample_end);
        while v.branch(Compare::Less, i, stop) {
            let live = lanes_below(v, i, stop);
            let mut axis = |a| v.vload_f32(layout.samples.column(POSITION + a), i);
            let position = [axis(0), axis(1), axis(2)];
            let none = v.vset_f32(0.0);
            let at = v.s_add(depths, i);
            let depth = v.vload_f32_or(none, live, layout.samples.column(POSITION), at);
            let depth = v.vabs(depth);
            let depth = math::reduce_max(v, depth);
            let bits = v.bits_of(depth);
            let depth = v.vextract(bits, 0);
            let samples = Samples { live, first: i, position };
            work.vector(v, &samples, (record_first, record_end), depth);
            i = v.s_add(i, sixteen);
        }
    }
}
