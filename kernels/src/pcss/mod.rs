//! Percentage-closer soft shadows (Fernando 2005): a shadow map whose filter is as wide as the penumbra would be, if all that hides
//! the light were as far from it as what the map has around a receiver is on average.
//!
//! ```text
//! search   texels that the light could be hidden by: their mean depth is that of the blocker
//! width    of the penumbra by similar triangles, w = r (p - b) / (p b) on the image plane at depth 1
//! filter   the part of texels in that width that do not hide the receiver
//! ```
//!
//! Blockers are found by the texels of a spiral, turned from pixel to pixel; the search is as wide as what is nearest to the light
//! on the receiver's face allows. What is not in the map, behind what is, hides nothing; where things at several depths
//! hide the light the mean of them is the depth of none.

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::options::{Entry, OptionSpec, Options, Values};
use lrbsim_isa::{Addr, Compare, Kernel, Phase, Runner, Step, Stopped, Vpu, math};
use lrbsim_workloads::{Light, Outline, ShadowInput};

use crate::columns::{lanes_below, store_first, task_range};
use crate::expression::{each, int, scalar};
use crate::field;
use crate::irregular::receivers::Receiver;
use crate::map::look::{Bias, Places, lit, whole};
use crate::map::options::{BIAS, SIZE, bias, objection_to_other_than, size};
use crate::map::{self, DepthMap};
use crate::method::{Method, Shadows, read};
use crate::samples::{LightSamples, rotated};
use crate::segment::Vec2;

/// Percentage-closer soft shadows, as a method among others.
pub struct Pcss;

const SEARCH: Phase = Phase { id: "search", title: "blocker search and filter", in_paper_total: false };

/// Texels that a task looks at for each of 16 receivers that it handles together.
const TASK_TEXELS: u32 = 512;

/// Receivers of a task at most.
const TASK_MAX: u32 = 256;

/// Part of the map's side that lies outside of the receivers on each side, for what hides those at its border.
const MARGIN: u32 = 16;

impl Method for Pcss {
    fn entry(&self) -> Entry {
        Entry {
            name: "pcss",
            about: "percentage-closer soft shadows (Fernando 2005)",
            options: &[
                SIZE,
                OptionSpec {
                    name: "search",
                    about: "texels in which blockers are looked for",
                    values: Values::Whole(1, 256),
                    default: "16",
                    tacit: false,
                },
                OptionSpec {
                    name: "taps",
                    about: "texels that the shadow is filtered from",
                    values: Values::Whole(1, 256),
                    default: "32",
                    tacit: false,
                },
                BIAS,
            ],
        }
    }

    fn phases(&self) -> &'static [Phase] {
        &[map::SETUP, map::TILES, map::DRAW, SEARCH]
    }

    fn objection_to_light(&self, _options: &Options, light: &Light) -> Option<String> {
        objection_to_other_than("disc that faces the receiver", "pcss", light)
    }

    fn run(
        &self,
        options: &Options,
        input: &mut ShadowInput,
        runner: &mut Runner<'_>,
    ) -> Result<Shadows, Stopped> {
        let visibility = runner.arena.overwritten(u64::from(input.width * input.height));
        let spiral = |runner: &mut Runner<'_>, count| LightSamples::new(runner.arena, Outline::Disc, count);
        let search = spiral(runner, options.whole("search"));
        let taps = spiral(runner, options.whole("taps"));
        let size = size(options);
        let map = DepthMap::draw(input, size, size / MARGIN, runner)?;

        runner.phase(&SEARCH);
        let nearest = runner.arena.overwritten(16);
        let slots = map.layout.slot_count;
        // SAFETY: each task writes the word of its own square.
        runner.run(&unsafe { Step::independent("nearest of faces", slots, Nearest { map, nearest }) })?;
        let radius = input.light_radius;
        let task = (16 * (TASK_TEXELS / (search.count + taps.count))).clamp(16, TASK_MAX);
        let kernel = Search { map, bias: bias(options), radius, search, taps, nearest, task, visibility };
        // SAFETY: each task writes the pixels of its own receivers.
        runner.run(&unsafe { Step::independent("search", map.receivers.count.div_ceil(task), kernel) })?;
        Ok(Shadows { visibility: read(visibility, input, runner.arena), silhouette_edges: None })
    }
}

/// Finds the greatest reciprocal depth on each square of the map.
struct Nearest {
    map: DepthMap,
    /// The greatest, by square.
    nearest: Addr,
}

impl Kernel for Nearest {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, slot: V::S32) {
        let tiles = 1 << (2 * self.map.layout.tiles_log2());
        let mut i = scalar!(v, slot * { tiles });
        let end = scalar!(v, i + { tiles });
        let mut greatest = v.vset_f32(0.0);
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let more = v.vload_f32_or(greatest, live, self.map.nearest, i);
            greatest = v.vmax(greatest, more);
            i = scalar!(v, i + 16);
        }
        let greatest = math::reduce_max(v, greatest);
        store_first(v, self.nearest, slot, greatest);
    }
}

/// Searches blockers of receivers, and filters the map as wide as they ask for.
struct Search {
    map: DepthMap,
    bias: Bias,
    /// Radius of the light.
    radius: f32,
    /// Places in the unit disc where blockers are looked for.
    search: LightSamples,
    /// Places in the unit disc that are filtered.
    taps: LightSamples,
    /// Greatest reciprocal depth of each square.
    nearest: Addr,
    /// Receivers of a task.
    task: u32,
    /// Visible part of the light by pixel.
    visibility: Addr,
}

impl Kernel for Search {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let Search { map, .. } = self;
        let (mut i, end) = task_range(v, task, self.task, map.receivers.count);
        let lane = v.viota();
        let none = v.vset_i32(0);
        let (zero, one) = (v.vset_f32(0.0), v.vset_f32(1.0));
        let half = v.vset_f32(0.5);
        let radius = v.vset_f32(self.radius);
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let places = map.places(v, live, i, self.bias);
            let receiver = v.vsplat(i);
            let receiver = int!(v, receiver + lane);
            let turn = self.search.turn(v, map.receivers.columns, live, receiver);

            // Blockers, in the circle through which the nearest surface could hide part of the light.
            let nearest = v.vgather_f32_or(zero, live, self.nearest, places.slot);
            let reach = v.vsub(nearest, places.depth);
            let reach = v.vmax(reach, zero);
            let reach = v.vmul(reach, radius);
            let mut blockers = none;
            let mut depths = zero;
            let mut number = v.s_imm(0);
            let count = v.s_imm(self.search.count as i32);
            while v.branch(Compare::Less, number, count) {
                let (depth, hides) = self.tap(v, live, &places, &self.search, number, turn, reach);
                let depth = v.vrcp_or(zero, hides, depth);
                depths = v.vadd(depths, depth);
                let one = v.vset_i32(1);
                blockers = v.viadd_or(blockers, hides, blockers, one);
                number = scalar!(v, number + 1);
            }
            let blocked = v.vicmp_gt_masked(live, blockers, none);
            let mut visible = one;
            if v.branch_any(blocked) {
                // The penumbra by their mean depth, but no narrower than a texel.
                let blockers = v.vcvt_i32_f32(blockers);
                let per_depth = math::div(v, blockers, depths);
                let width = v.vsub(per_depth, places.depth);
                let width = v.vmul(width, radius);
                let texel = v.vmax(places.unit[0], places.unit[1]);
                let least = v.vmul(texel, half);
                let width = v.vmax(width, least);
                let mut hidden = none;
                let mut number = v.s_imm(0);
                let count = v.s_imm(self.taps.count as i32);
                while v.branch(Compare::Less, number, count) {
                    let (_, hides) = self.tap(v, blocked, &places, &self.taps, number, turn, width);
                    let one = v.vset_i32(1);
                    hidden = v.viadd_or(hidden, hides, hidden, one);
                    number = scalar!(v, number + 1);
                }
                let of = v.vset_f32(self.taps.count as f32);
                let part = lit(v, hidden, of);
                visible = v.vblend_f32(blocked, part, one);
            }
            let pixel = v.vload_i32(map.receivers.columns.column(field!(Receiver.pixel)), i);
            v.vscatter_f32(live, self.visibility, pixel, visible);
            i = scalar!(v, i + 16);
        }
    }
}

impl Search {
    /// Looks at the texel at sample `number` of `samples`, turned by `turn` and `width` times as far from the receivers.
    #[expect(clippy::too_many_arguments, reason = "each is a number of 16 receivers")]
    #[inline(always)]
    fn tap<V: Vpu>(
        &self,
        v: &mut V,
        live: V::Mask,
        places: &Places<V>,
        samples: &LightSamples,
        number: V::S32,
        turn: Vec2<V>,
        width: V::F32,
    ) -> (V::F32, V::Mask) {
        let place = samples.place(v, number);
        let turned = rotated(v, place, turn);
        let place = each!(axis in [0, 1] => v.vmadd(turned[axis], width, places.place[axis]));
        let texel = places.texels(v, place);
        let texel = whole(v, texel);
        self.map.look(v, live, places, texel)
    }
}
