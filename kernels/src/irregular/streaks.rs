//! Receivers into the order of their keys, streak by streak.
//!
//! A streak is a run of receivers along the curve that have one key: neighbors in the picture, mostly of one cell.
//! `histogram` finds the streaks and adds each to its key with one atomic, noting the place in the key that the atomic gave
//! it; `scatter` goes through the same streaks again, needs no atomics, and puts the receivers of a streak side by side.
//! The lanes of a vector lie in few streaks, hence in few lines, wherever they go.

use lrbsim_isa::{Addr, Arena, Compare, Kernel, Vpu};

use super::faces::{Faces, load_positions};
use super::grid::Sample;
use super::receivers::{Receiver, Receivers};
use crate::columns::{Columns, lanes_below, task_range};
use crate::expression::{each, int, scalar};
use crate::face::Constants;
use crate::field;
use crate::record::Field;

/// A run of receivers that have one key.
#[repr(C)]
struct Streak {
    key: i32,
    /// Its first receiver; after the last streak of a task, the end of its receivers.
    first: u32,
    /// What leads from the number of a receiver to its place: in its key, then among all samples.
    offset: i32,
}

/// Room for the streaks of a task, and for the end of the last.
const TASK_STREAKS: u32 = Receivers::TASK + 16;

/// The streaks of a frame.
#[derive(Clone, Copy)]
pub(super) struct Streaks {
    /// Task by task, [`TASK_STREAKS`] each.
    columns: Columns<Streak>,
    /// Number of streaks of each task.
    totals: Addr,
    /// By vector of receivers: lanes in which a streak begins.
    lanes: Addr,
}

impl Streaks {
    /// Room for the streaks of all tasks.
    pub(super) fn new(arena: &mut Arena, receivers: &Receivers) -> Streaks {
        Streaks {
            columns: Columns::overwritten(arena, receivers.tasks() * TASK_STREAKS),
            totals: arena.overwritten(u64::from(receivers.tasks())),
            lanes: arena.overwritten(u64::from(receivers.count.div_ceil(16))),
        }
    }

    /// Says that nobody reads the streaks again.
    pub(super) fn discard(self, arena: &mut Arena) {
        self.columns.discard(arena, Field::whole());
    }

    /// Number of the first streak of a task.
    #[inline(always)]
    fn first_of<V: Vpu>(v: &mut V, task: V::S32) -> V::S32 {
        scalar!(v, task * { TASK_STREAKS as i32 })
    }
}

/// Counts the receivers of each key.
pub(super) struct Histogram {
    pub(super) receivers: Receivers,
    pub(super) faces: Faces,
    pub(super) streaks: Streaks,
    /// Where the receivers of each key are counted.
    pub(super) key_starts: Addr,
}

impl Kernel for Histogram {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let Histogram { receivers, faces, streaks, key_starts } = self;
        let (first, end) = task_range(v, task, Receivers::TASK, receivers.count);
        let constants = Constants::new(v);
        let none = constants.whole[0];
        let lane = v.viota();
        let fifteen = v.vset_i32(15);
        let sixteen = v.vset_i32(16);
        let below = int!(v, (lane + fifteen) & fifteen);
        let lowest = v.vicmp_eq(lane, none);
        let first_streak = Streaks::first_of(v, task);

        // The streaks: where the key is not that of the receiver before.
        let mut streak = first_streak;
        let mut receiver = v.vsplat(first);
        receiver = int!(v, receiver + lane);
        // Keys of the vector before, turned by a lane: its last comes first. No key is negative.
        let mut turned_before = v.vset_i32(-1);
        let mut i = first;
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let p = load_positions(v, &constants, receivers, live, i);
            let key = faces.key(v, &constants, live, p);
            let turned = v.vpermute(key, below);
            let before = v.vblend_i32(lowest, turned_before, turned);
            turned_before = turned;
            let begins = v.vicmp_neq_masked(live, key, before);
            let bits = v.kmov_to_scalar(begins);
            let vector = scalar!(v, i >> 4);
            v.s_store(streaks.lanes, vector, bits);
            v.vcompress_i32(begins, streaks.columns.column(field!(Streak.key)), streak, key);
            v.vcompress_i32(begins, streaks.columns.column(field!(Streak.first)), streak, receiver);
            let count = v.s_popcnt(bits);
            streak = scalar!(v, streak + count);
            receiver = int!(v, receiver + sixteen);
            i = scalar!(v, i + 16);
        }
        v.s_store(streaks.columns.column(field!(Streak.first)), streak, end);
        let total = scalar!(v, streak - first_streak);
        v.s_store(streaks.totals, task, total);

        // Their places in their keys, 16 streaks at a time.
        let mut i = first_streak;
        while v.branch(Compare::Less, i, streak) {
            let live = lanes_below(v, i, streak);
            let key = v.vload_i32_or(none, live, streaks.columns.column(field!(Streak.key)), i);
            let begin = v.vload_i32_or(none, live, streaks.columns.column(field!(Streak.first)), i);
            let next =
                v.vload_i32_or(none, live, streaks.columns.column(field!(Streak.first)).plus_words(1), i);
            let length = int!(v, next - begin);
            let place = v.vatomic_add_or(none, live, *key_starts, key, length);
            let offset = int!(v, place - begin);
            v.vstore_i32(live, streaks.columns.column(field!(Streak.offset)), i, offset);
            i = scalar!(v, i + 16);
        }
    }
}

/// Moves the receivers to their places.
pub(super) struct Scatter {
    pub(super) receivers: Receivers,
    pub(super) streaks: Streaks,
    /// First place of each key.
    pub(super) key_starts: Addr,
    /// Where the receivers go.
    pub(super) samples: Columns<Sample>,
}

impl Kernel for Scatter {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let Scatter { receivers, streaks, key_starts, samples } = self;
        let (first, end) = task_range(v, task, Receivers::TASK, receivers.count);
        let one = v.vset_i32(1);
        let none = v.vset_i32(0);
        let lane = v.viota();
        let fifteen = v.vset_i32(15);
        let sixteen = v.vset_i32(16);
        // For sums over the lanes below: whose sum each lane adds, by doubling.
        let doubling = each!(distance in [1, 2, 4, 8] => {
            let distance = v.vset_i32(distance);
            let from = int!(v, lane - distance);
            (from, v.vicmp_ge(from, none))
        });

        // From places in keys to places among all samples.
        let first_streak = Streaks::first_of(v, task);
        let total = v.s_load(streaks.totals, task);
        let last_streak = scalar!(v, first_streak + total);
        let mut i = first_streak;
        while v.branch(Compare::Less, i, last_streak) {
            let live = lanes_below(v, i, last_streak);
            let key = v.vload_i32_or(none, live, streaks.columns.column(field!(Streak.key)), i);
            let start = v.vgather_i32_or(none, live, *key_starts, key);
            let offset = v.vload_i32_or(none, live, streaks.columns.column(field!(Streak.offset)), i);
            let offset = int!(v, offset + start);
            v.vstore_i32(live, streaks.columns.column(field!(Streak.offset)), i, offset);
            i = scalar!(v, i + 16);
        }

        let mut receiver = v.vsplat(first);
        receiver = int!(v, receiver + lane);
        // The streak that is open before each vector.
        let mut open = v.vsplat(first_streak);
        open = int!(v, open - one);
        let mut i = first;
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let vector = scalar!(v, i >> 4);
            let bits = v.s_load(streaks.lanes, vector);
            let begins = v.kmov_from_scalar(bits);
            // The streak of each lane: one more wherever one begins.
            let mut begun = v.vblend_i32(begins, one, none);
            for (from, has) in doubling {
                let below = v.vpermute(begun, from);
                begun = v.viadd_or(begun, has, begun, below);
            }
            let streak = int!(v, open + begun);
            open = v.vpermute(streak, fifteen);
            let offset = v.vgather_i32_or(none, live, streaks.columns.column(field!(Streak.offset)), streak);
            let to = int!(v, offset + receiver);
            for axis in 0..3 {
                let from = receivers.columns.column(field!(Receiver.position[axis]));
                v.prefetch_l1(from.plus_lines(1), i);
                let value = v.vload_i32_or(none, live, from, i);
                v.vscatter_i32(live, samples.column(field!(Sample.position[axis])), to, value);
            }
            v.vscatter_i32(live, samples.column(field!(Sample.receiver)), to, receiver);
            receiver = int!(v, receiver + sixteen);
            i = scalar!(v, i + 16);
        }
    }
}
