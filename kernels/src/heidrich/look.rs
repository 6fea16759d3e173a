//! What the samples of the light say of receivers, one sample after the other.

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Addr, Arena, Compare, Kernel, Runner, Step, Stopped, Vpu, math};

use super::channel::NO_SKIN;
use crate::columns::{lanes_below, task_range};
use crate::expression::{each, scalar};
use crate::field;
use crate::irregular::receivers::Receiver;
use crate::map::DepthMap;
use crate::map::look::{Bias, whole};

/// Number of receivers that a task handles.
const TASK: u32 = 256;

/// Where a receiver is looked up whose light comes from both samples of a segment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Skin {
    /// Skins tell of receivers that one of the samples sees: what both see is lit by all of the segment [algorithms, 3.3].
    Masked,
    /// Skins tell also of receivers that both samples see and that lie behind skins of both: what hides the middle of the segment has
    /// borders for either.
    Agreed,
    /// Skins tell of all that lies behind them, as printed.
    Printed,
}

/// What is known of receivers when some of the samples have been looked at.
#[derive(Clone, Copy)]
pub(super) struct Known {
    /// What the channel of the sample before has of the segment that follows it, by receiver; [`HIDDEN`] where that sample does not see
    /// the receiver.
    before: Addr,
    /// Sum over the segments so far of what is seen of each, by receiver.
    sums: Addr,
}

/// What stands for the light of a sample that does not see a receiver.
const HIDDEN: f32 = -1.0;

impl Known {
    /// Room for what is known of `receivers` receivers.
    pub(super) fn new(arena: &mut Arena, receivers: u64) -> Known {
        let words = receivers + 16;
        Known { before: arena.overwritten(words), sums: arena.overwritten(words) }
    }
}

/// Looks the receivers up in the map of one sample, and adds what it says to what is known.
pub(super) struct Look {
    /// The map from the sample.
    pub(super) map: DepthMap,
    pub(super) bias: Bias,
    pub(super) skin: Skin,
    /// Channels of the segment before the sample and of the one after it; `None` at either end of the light.
    pub(super) channels: [Option<Addr>; 2],
    /// Whether the sample ends the first segment, which begins the sums.
    pub(super) is_second: bool,
    pub(super) known: Known,
    /// Number of segments.
    pub(super) segments: u32,
    /// Visible part of the light by pixel.
    pub(super) visibility: Addr,
}

impl Look {
    /// Runs the step of this sample.
    pub(super) fn run(self, runner: &mut Runner<'_>) -> Result<(), Stopped> {
        let tasks = self.map.receivers.count.div_ceil(TASK);
        // SAFETY: each task writes the words and the pixels of its own receivers.
        runner.run(&unsafe { Step::independent("look", tasks, self) })
    }
}

impl Kernel for Look {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let Look { map, known, .. } = self;
        let [before, after] = self.channels;
        let (mut i, end) = task_range(v, task, TASK, map.receivers.count);
        let zero = v.vset_f32(0.0);
        let (hidden, no_skin) = (v.vset_f32(HIDDEN), v.vset_f32(NO_SKIN));
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let places = map.places(v, live, i, self.bias);
            let texel = places.texels(v, places.place);
            let texel = whole(v, texel);
            let (_, hides) = map.look(v, live, &places, texel);
            let (_, word) = map.word(v, &places, texel);

            let mut sum = zero;
            if let Some(channel) = before {
                let own = v.vgather_f32_or(no_skin, live, channel, word);
                let own = v.vblend_f32(hides, hidden, own);
                let other = v.vload_f32_or(hidden, live, known.before, i);
                let light = segment(v, self.skin, own, other);
                sum = light;
                if !self.is_second {
                    let so_far = v.vload_f32_or(zero, live, known.sums, i);
                    sum = v.vadd(so_far, light);
                }
            }
            if let Some(channel) = after {
                let light = v.vgather_f32_or(no_skin, live, channel, word);
                let light = v.vblend_f32(hides, hidden, light);
                v.vstore_f32(live, known.before, i, light);
                if before.is_some() {
                    v.vstore_f32(live, known.sums, i, sum);
                }
            } else {
                let segments = v.vset_f32(self.segments as f32);
                let visible = math::div(v, sum, segments);
                let pixel = v.vload_i32(map.receivers.columns.column(field!(Receiver.pixel)), i);
                v.vscatter_f32(live, self.visibility, pixel, visible);
            }
            i = scalar!(v, i + 16);
        }
    }
}

/// How much of a segment is seen, from what the channels of its two samples have: [`HIDDEN`] where a sample does not see the receiver, and
/// [`NO_SKIN`] where it does, and no skin tells more: then half of the segment.
#[inline(always)]
fn segment<V: Vpu>(v: &mut V, skin: Skin, own: V::F32, other: V::F32) -> V::F32 {
    let (zero, half, one) = (v.vset_f32(0.0), v.vset_f32(0.5), v.vset_f32(1.0));
    let [part, other_part] = each!(part in [own, other] => {
        let seen = v.vmax(part, zero);
        let has_no_skin = v.vcmp_gt(part, one);
        v.vblend_f32(has_no_skin, half, seen)
    });
    let light = v.vadd(part, other_part);
    // Where a skin ends both samples together would have more than the segment.
    let light = v.vmin(light, one);
    if skin == Skin::Printed {
        return light;
    }
    let mut all = v.vcmp_ge(own, zero);
    all = v.vcmp_ge_masked(all, other, zero);
    if skin == Skin::Agreed {
        let greater = v.vmax(own, other);
        all = v.vcmp_gt_masked(all, greater, one);
    }
    v.vblend_f32(all, one, light)
}
