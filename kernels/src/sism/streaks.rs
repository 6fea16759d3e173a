//! Receivers into the order of their keys, streak by streak.
//!
//! A streak is a run of receivers along the curve that have one key: neighbors in the picture, mostly of one cell.
//! `histogram` finds the streaks and adds each to its key with one atomic, noting the place in the key that the atomic gave
//! it; `scatter` goes through the same streaks again, needs no atomics, and puts the receivers of a streak side by side.
//! The lanes of a vector lie in few streaks, hence in few lines, wherever they go.

use lrbsim_isa::{Compare, Kernel, Vpu};

use super::grid::{Constants, key, load_positions};
use super::layout::{Layout, POSITION, RECEIVER, RECEIVERS_TASK};
use crate::columns::{lanes_below, task_range};

/// Columns of the streaks.
pub(super) const COLUMNS: u32 = 3;
/// Column of a streak's key.
const KEY: u32 = 0;
/// Column of a streak's first receiver; after the last streak of a task, the end of its receivers.
const FIRST: u32 = 1;
/// Column of what leads from the number of a receiver to its place: in its key, then among all samples.
const OFFSET: u32 = 2;

/// Room for the streaks of a task, and for the end of the last.
pub(super) const STREAKS_TASK: u32 = RECEIVERS_TASK + 16;

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
        let none = constants.whole[0];
        let lane = v.viota();
        let fifteen = v.vset_i32(15);
        let sixteen = v.vset_i32(16);
        let below = v.viadd(lane, fifteen);
        let below = v.vand(below, fifteen);
        let lowest = v.vicmp_eq(lane, none);
        let first_streak = first_streak(v, task);

        // The streaks: where the key is not that of the receiver before.
        let mut streak = first_streak;
        let mut receiver = v.vsplat(first);
        receiver = v.viadd(receiver, lane);
        // Keys of the vector before, turned by a lane: its last comes first. No key is negative.
        let mut turned_before = v.vset_i32(-1);
        let mut i = first;
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let p = load_positions(v, &constants, layout.receivers, live, i);
            let key = key(v, &constants, layout, live, p);
            let turned = v.vpermute(key, below);
            let before = v.vblend_i32(lowest, turned_before, turned);
            turned_before = turned;
            let begins = v.vicmp_neq_masked(live, key, before);
            let bits = v.kmov_to_scalar(begins);
            let vector = v.s_shr(i, four);
            v.s_store(layout.streak_lanes, vector, bits);
            v.vcompress_i32(begins, layout.streaks.column(KEY), streak, key);
            v.vcompress_i32(begins, layout.streaks.column(FIRST), streak, receiver);
            let count = v.s_popcnt(bits);
            streak = v.s_add(streak, count);
            receiver = v.viadd(receiver, sixteen);
            i = v.s_add(i, step);
        }
        v.s_store(layout.streaks.column(FIRST), streak, end);
        let total = v.s_sub(streak, first_streak);
        v.s_store(layout.streak_totals, task, total);

        // Their places in their keys, 16 streaks at a time.
        let mut i = first_streak;
        while v.branch(Compare::Less, i, streak) {
            let live = lanes_below(v, i, streak);
            let key = v.vload_i32_or(none, live, layout.streaks.column(KEY), i);
            let begin = v.vload_i32_or(none, live, layout.streaks.column(FIRST), i);
            let next = v.vload_i32_or(none, live, layout.streaks.column(FIRST).plus(4), i);
            let length = v.visub(next, begin);
            let place = v.vatomic_add_or(none, live, layout.key_starts, key, length);
            let offset = v.visub(place, begin);
            v.vstore_i32(live, layout.streaks.column(OFFSET), i, offset);
            i = v.s_add(i, step);
        }
    }
}

/// Moves the receivers to their places.
pub(super) struct Scatter(pub(super) Layout);

impl Kernel for Scatter {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let layout = &self.0;
        let (first, end) = task_range(v, task, RECEIVERS_TASK, layout.receiver_count);
        let step = v.s_imm(16);
        let four = v.s_imm(4);
        let one = v.vset_i32(1);
        let none = v.vset_i32(0);
        let lane = v.viota();
        let fifteen = v.vset_i32(15);
        let sixteen = v.vset_i32(16);
        // For sums over the lanes below: whose sum each lane adds, by doubling.
        let doubling = [1, 2, 4, 8].map(|distance| {
            let distance = v.vset_i32(distance);
            let from = v.visub(lane, distance);
            (from, v.vicmp_ge(from, none))
        });

        // From places in keys to places among all samples.
        let first_streak = first_streak(v, task);
        let total = v.s_load(layout.streak_totals, task);
        let last_streak = v.s_add(first_streak, total);
        let mut i = first_streak;
        while v.branch(Compare::Less, i, last_streak) {
            let live = lanes_below(v, i, last_streak);
            let key = v.vload_i32_or(none, live, layout.streaks.column(KEY), i);
            let start = v.vgather_i32_or(none, live, layout.key_starts, key);
            let offset = v.vload_i32_or(none, live, layout.streaks.column(OFFSET), i);
            let offset = v.viadd(offset, start);
            v.vstore_i32(live, layout.streaks.column(OFFSET), i, offset);
            i = v.s_add(i, step);
        }

        let mut receiver = v.vsplat(first);
        receiver = v.viadd(receiver, lane);
        // The streak that is open before each vector.
        let mut open = v.vsplat(first_streak);
        open = v.visub(open, one);
        let mut i = first;
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let vector = v.s_shr(i, four);
            let bits = v.s_load(layout.streak_lanes, vector);
            let begins = v.kmov_from_scalar(bits);
            // The streak of each lane: one more wherever one begins.
            let mut begun = v.vblend_i32(begins, one, none);
            for (from, has) in doubling {
                let below = v.vpermute(begun, from);
                begun = v.viadd_or(begun, has, begun, below);
            }
            let streak = v.viadd(open, begun);
            open = v.vpermute(streak, fifteen);
            let offset = v.vgather_i32_or(none, live, layout.streaks.column(OFFSET), streak);
            let to = v.viadd(offset, receiver);
            for axis in POSITION..POSITION + 3 {
                let from = layout.receivers.column(axis);
                v.prefetch_l1(from.plus(64), i);
                let value = v.vload_i32_or(none, live, from, i);
                v.vscatter_i32(live, layout.samples.column(axis), to, value);
            }
            v.vscatter_i32(live, layout.samples.column(RECEIVER), to, receiver);
            receiver = v.viadd(receiver, sixteen);
            i = v.s_add(i, step);
        }
    }
}

/// Number of the first streak of a task.
#[inline(always)]
fn first_streak<V: Vpu>(v: &mut V, task: V::S32) -> V::S32 {
    let size = v.s_imm(STREAKS_TASK as i32);
    v.s_mul(task, size)
}
