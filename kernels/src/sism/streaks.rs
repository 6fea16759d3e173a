//! Receivers into the order of their keys, streak by streak.
//!
//! A streak is what one lane meets of one key without a break: neighbors in the picture, mostly of one cell. `histogram`
//! adds a streak to its key with one atomic and notes the place in the key that the atomic gave it; `scatter` goes through
//! the same streaks again, needs no atomics, and puts the receivers of a streak side by side.

use lrbsim_isa::{Addr, Compare, Kernel, Vpu};

use super::grid::{Constants, key, load_positions};
use super::layout::{Layout, OWN_TRIANGLE, PIXEL, POSITION, RECEIVERS_TASK};
use crate::columns::{lanes_below, task_range};

/// Column of a streak's key.
const KEY: u32 = 0;
/// Column of a streak's place in its key: one past its end.
const END: u32 = 1;

/// Tasks that share the columns of the same receivers: the lines that 16 lanes fill at a time have to fit in an L1.
pub(super) const COLUMN_GROUPS: u32 = 2;

/// Counts the receivers of each key.
pub(super) struct Count(pub(super) Layout);

impl Kernel for Count {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let layout = &self.0;
        let (first, end) = task_range(v, task, RECEIVERS_TASK, layout.receiver_count);
        let step = v.s_imm(16);
        let four = v.s_imm(4);
        let constants = Constants::new(v);
        let [none, one, ..] = constants.whole;
        // Key and length of the streak that each lane is in.
        let (mut open, mut length) = (none, none);
        let mut begun = v.mask_none();
        let mut streak = first;
        let mut i = first;
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let p = load_positions(v, &constants, layout.receivers, live, i);
            let key = key(v, &constants, layout, live, p);
            let key = v.vblend_i32(live, key, open);
            let ended = v.vicmp_neq_masked(begun, key, open);
            let bits = v.kmov_to_scalar(ended);
            let vector = v.s_shr(i, four);
            v.s_store(layout.streak_lanes, vector, bits);
            streak = self.end_streaks(v, ended, open, length, streak);
            let carried = v.vblend_i32(ended, none, length);
            length = v.viadd_or(carried, live, carried, one);
            open = key;
            // Only the last vector of all is not full.
            begun = live;
            i = v.s_add(i, step);
        }
        let begun = v.vicmp_gt(length, none);
        streak = self.end_streaks(v, begun, open, length, streak);
        let total = v.s_sub(streak, first);
        v.s_store(layout.streak_totals, task, total);
    }
}

impl Count {
    /// Counts the streaks that end in lanes `ended`, and notes them from streak `at` on; the streak after them.
    #[inline(always)]
    fn end_streaks<V: Vpu>(
        &self,
        v: &mut V,
        ended: V::Mask,
        key: V::I32,
        length: V::I32,
        at: V::S32,
    ) -> V::S32 {
        let layout = &self.0;
        let before = v.vatomic_add_or(length, ended, layout.key_starts, key, length);
        let end = v.viadd(before, length);
        v.vcompress_i32(ended, layout.streaks.column(KEY), at, key);
        v.vcompress_i32(ended, layout.streaks.column(END), at, end);
        let bits = v.kmov_to_scalar(ended);
        let count = v.s_popcnt(bits);
        v.s_add(at, count)
    }
}

/// Moves the receivers to their places.
pub(super) struct Scatter(pub(super) Layout);

impl Kernel for Scatter {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let tasks = v.s_imm(self.0.receiver_tasks() as i32);
        if v.branch(Compare::Less, task, tasks) {
            self.columns(v, task, [POSITION, POSITION + 1, POSITION + 2]);
        } else {
            let task = v.s_sub(task, tasks);
            self.columns(v, task, [OWN_TRIANGLE, PIXEL]);
        }
    }
}

impl Scatter {
    /// Moves some columns of the receivers of task `task` of [`Count`].
    ///
    /// From its last streak to the first, and from their ends to their beginnings: streaks were noted as they ended, so a
    /// lane that is done with one finds its next at the end of those that are left.
    #[inline(always)]
    fn columns<V: Vpu, const N: usize>(&self, v: &mut V, task: V::S32, columns: [u32; N]) {
        let layout = &self.0;
        let (first, end) = task_range(v, task, RECEIVERS_TASK, layout.receiver_count);
        let step = v.s_imm(16);
        let four = v.s_imm(4);
        let s_one = v.s_imm(1);
        let whole_vectors = v.s_imm(-16);
        let one = v.vset_i32(1);
        let none = v.vset_i32(0);
        let total = v.s_load(layout.streak_totals, task);
        let mut streak = v.s_add(first, total);
        let mut next = lanes_below(v, first, end);
        let mut to = none;
        let last = v.s_sub(end, s_one);
        let mut i = v.s_and(last, whole_vectors);
        while v.branch(Compare::LessEqual, first, i) {
            // Lanes that come to another streak: to its end.
            let bits = v.kmov_to_scalar(next);
            let count = v.s_popcnt(bits);
            streak = v.s_sub(streak, count);
            let key = v.vexpand_i32_or(none, next, layout.streaks.column(KEY), streak);
            let end_in_key = v.vexpand_i32_or(none, next, layout.streaks.column(END), streak);
            let start = v.vgather_i32_or(none, next, layout.key_starts, key);
            to = v.viadd_or(to, next, start, end_in_key);
            let live = lanes_below(v, i, end);
            to = v.visub_or(to, live, to, one);
            for column in columns {
                let from = layout.receivers.column(column);
                v.prefetch_l1(Addr(from.0 - 64), i);
                let value = v.vload_i32_or(none, live, from, i);
                v.vscatter_i32(live, layout.samples.column(column), to, value);
            }
            let vector = v.s_shr(i, four);
            let bits = v.s_load(layout.streak_lanes, vector);
            next = v.kmov_from_scalar(bits);
            i = v.s_sub(i, step);
        }
    }
}
