//! Shadow maps (Williams 1978) with percentage-closer filtering (Reeves et al. 1987): what is drawn from the middle of the light hides what lies
//! behind it, and the light of a receiver is the part of some texels around it that do not hide it.
//!
//! The penumbra is as wide as the filter, whatever the size of the light: the light is a point. Shadows are found by texels, so
//! that their borders are off by the width of one.

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::options::{Entry, OptionSpec, Options, Values};
use lrbsim_isa::{Addr, Compare, Kernel, Phase, Runner, Step, Stopped, Vpu};
use lrbsim_workloads::ShadowInput;

use crate::columns::{lanes_below, task_range};
use crate::expression::{each, int, scalar};
use crate::field;
use crate::irregular::receivers::Receiver;
use crate::map::look::{Bias, lit, whole};
use crate::map::options::{BIAS, SIZE, bias, size};
use crate::map::{self, DepthMap};
use crate::method::{Method, Shadows, read};

/// Shadow maps, as a method among others.
pub struct ShadowMap;

const LOOK: Phase = Phase { id: "look", title: "shadow map lookup", in_paper_total: false };

/// Texels that a task looks at for each of 16 receivers that it handles together.
const TASK_TEXELS: u32 = 1024;

/// Receivers of a task at most.
const TASK_MAX: u32 = 256;

impl Method for ShadowMap {
    fn entry(&self) -> Entry {
        Entry {
            name: "shadow-map",
            about: "shadow maps with percentage-closer filtering (Williams 1978, Reeves 1987)",
            options: &[
                SIZE,
                OptionSpec {
                    name: "filter",
                    about: "texels of a side of the square that is looked at for each pixel; 1 is a hard shadow",
                    values: Values::Whole(1, 32),
                    default: "4",
                    tacit: false,
                },
                BIAS,
            ],
        }
    }

    fn phases(&self) -> &'static [Phase] {
        &[map::SETUP, map::TILES, map::DRAW, LOOK]
    }

    fn run(
        &self,
        options: &Options,
        input: &mut ShadowInput,
        runner: &mut Runner<'_>,
    ) -> Result<Shadows, Stopped> {
        let visibility = runner.arena.overwritten(u64::from(input.width * input.height));
        let filter = options.whole("filter");
        let map = DepthMap::draw(input, size(options), filter.div_ceil(2), runner)?;

        runner.phase(&LOOK);
        let task = (16 * (TASK_TEXELS / (filter * filter))).clamp(16, TASK_MAX);
        let kernel = Look { map, bias: bias(options), filter, task, visibility };
        // SAFETY: each task writes the pixels of its own receivers.
        runner.run(&unsafe { Step::independent("look", map.receivers.count.div_ceil(task), kernel) })?;
        Ok(Shadows { visibility: read(visibility, input, runner.arena), silhouette_edges: None })
    }
}

/// Looks receivers up in the map.
struct Look {
    map: DepthMap,
    bias: Bias,
    /// Texels of a side of the square that is looked at.
    filter: u32,
    /// Receivers of a task.
    task: u32,
    /// Visible part of the light by pixel.
    visibility: Addr,
}

impl Kernel for Look {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let Look { map, filter, .. } = self;
        let (mut i, end) = task_range(v, task, self.task, map.receivers.count);
        let one = v.vset_i32(1);
        let filter = *filter as i32;
        let texels = v.vset_f32((filter * filter) as f32);
        let side = v.s_imm(filter);
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let places = map.places(v, live, i, self.bias);
            // The square about the receiver begins at the border between texels that is nearest.
            let to_first = v.vset_f32(0.5 - 0.5 * filter as f32);
            let middle = places.texels(v, places.place);
            let middle = each!(axis in [0, 1] => v.vadd(middle[axis], to_first));
            let [first_x, mut y] = whole(v, middle);
            let mut hidden = v.vset_i32(0);
            let mut row = v.s_imm(0);
            while v.branch(Compare::Less, row, side) {
                let mut x = first_x;
                let mut column = v.s_imm(0);
                while v.branch(Compare::Less, column, side) {
                    let (_, hides) = map.look(v, live, &places, [x, y]);
                    hidden = v.viadd_or(hidden, hides, hidden, one);
                    x = int!(v, x + one);
                    column = scalar!(v, column + 1);
                }
                y = int!(v, y + one);
                row = scalar!(v, row + 1);
            }
            let visible = lit(v, hidden, texels);
            let pixel = v.vload_i32(map.receivers.columns.column(field!(Receiver.pixel)), i);
            v.vscatter_f32(live, self.visibility, pixel, visible);
            i = scalar!(v, i + 16);
        }
    }
}
