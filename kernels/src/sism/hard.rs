//! Hard shadow kernel: layers between each sample and the light [johnson09, §2.4; algorithms, 1].

use lrbsim_isa::{Addr, Arena, Compare, Kernel, Ordering, Step, Vpu};

use super::Frame;
use super::layout::{Layout, OWN_TRIANGLE, RECEIVER};
use super::run::{PerVector, Samples, walk};
use crate::columns::Columns;
use crate::plane::{BACK, FRONT, TRIANGLE_WORDS, Vec3, hidden};

/// Column of [`Layout::sums`] with the layers in F; those in B follow.
pub const LAYERS: u32 = 0;

/// Counts the layers of every sample.
pub fn count(frame: &mut Frame, arena: &mut Arena) -> Step {
    frame.layout.sums = Columns::new(arena, 4, frame.layout.receiver_count);
    let layout = frame.layout;
    Step {
        name: "hard",
        ordering: Ordering::Independent,
        tasks: frame.run_counts[0],
        kernel: Box::new(Hard { layout }),
    }
}

struct Hard {
    layout: Layout,
}

impl Kernel for Hard {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        walk(v, &self.layout, self.layout.hard_runs, 0, task, self);
    }
}

impl PerVector for Hard {
    #[inline(always)]
    fn vector<V: Vpu>(&self, v: &mut V, samples: &Samples<V>, records: (V::S32, V::S32), depth: V::S32) {
        let layout = &self.layout;
        let two = v.s_imm(2);
        let words = v.s_imm(TRIANGLE_WORDS as i32);
        let none = v.vset_i32(0);
        let receiver = v.vload_i32(layout.samples.column(RECEIVER), samples.first);
        let own = v.vgather_i32_or(none, samples.live, layout.receivers.column(OWN_TRIANGLE), receiver);
        let mut layers = [none; 2];
        let (mut record, end) = records;
        while v.branch(Compare::Less, record, end) {
            let start = v.s_load(layout.records.plus(4), record);
            if v.branch(Compare::LessEqual, start, depth) {
                let triangle = v.s_load(layout.records, record);
                let number = v.vbroadcast_i32(layout.records, record);
                let index = v.s_mul(triangle, words);
                let at = (layout.triangle_records, index);
                layers = count_layers(v, samples.live, samples.position, own, number, at, layers);
            }
            record = v.s_add(record, two);
        }
        for (i, layers) in layers.into_iter().enumerate() {
            let column = layout.sums.column(LAYERS + i as u32);
            v.vstore_i32(samples.live, column, samples.first, layers);
        }
    }
}

/// Adds to the layers in F and B those that the triangle of record `at` makes for 16 samples.
#[inline(always)]
pub fn count_layers<V: Vpu>(
    v: &mut V,
    live: V::Mask,
    points: Vec3<V>,
    own: V::I32,
    number: V::I32,
    at: (Addr, V::S32),
    layers: [V::I32; 2],
) -> [V::I32; 2] {
    let covered = hidden(v, live, points, own, number, at.0, at.1);
    if !v.branch_any(covered) {
        return layers;
    }
    let flags = v.vbroadcast_i32(at.0.plus(52), at.1);
    let one = v.vset_i32(FRONT);
    let front = v.vand(flags, one);
    let shift = v.vset_i32(BACK.trailing_zeros() as i32);
    let back = v.vsrl(flags, shift);
    let back = v.vand(back, one);
    [v.viadd_or(layers[0], covered, layers[0], front), v.viadd_or(layers[1], covered, layers[1], back)]
}
