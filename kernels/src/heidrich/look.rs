//! What the samples of the light say of receivers, one sample after the other.

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Addr, Arena, Compare, Kernel, Runner, Step, Stopped, Vpu, math};

use super::channel::look;
use crate::columns::{lanes_below, task_range};
use crate::expression::scalar;
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
    /// Skins tell of all that lies behind them, as printed.
    Printed,
}

/// What is known of receivers when some of the samples have been looked at.
#[derive(Clone, Copy)]
pub(super) struct Known {
    /// What the sample before adds to the segment that follows it, by receiver; [`HIDDEN`] where it does not see the receiver.
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
        let (zero, one) = (v.vset_f32(0.0), v.vset_f32(1.0));
        let hidden = v.vset_f32(HIDDEN);
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let places = map.places(v, live, i, self.bias);
            let texel = places.texels(v, places.place);
            let texel = whole(v, texel);
            let (_, hides) = map.look(v, live, &places, texel);
            let (_, word) = map.word(v, &places, texel);

            let mut sum = zero;
            if let Some(channel) = before {
                let own = look(v, live, channel, word);
                let own = v.vblend_f32(hides, zero, own);
                let other = v.vload_f32_or(hidden, live, known.before, i);
                let from_other = v.vmax(other, zero);
                let light = v.vadd(own, from_other);
                // Where both see the receiver, and a skin ends at it, they would have more than the segment.
                let mut light = v.vmin(light, one);
                if self.skin == Skin::Masked {
                    let both = v.vcmp_ge(other, zero);
                    let both = v.kandn(hides, both);
                    light = v.vblend_f32(both, one, light);
                }
                sum = light;
                if !self.is_second {
                    let so_far = v.vload_f32_or(zero, live, known.sums, i);
                    sum = v.vadd(so_far, light);
                }
            }
            if let Some(channel) = after {
                let light = look(v, live, channel, word);
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
