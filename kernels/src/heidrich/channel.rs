//! The visibility channel of a map: skins of a neighboring sample, drawn on what the map shows.

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Addr, Compare, Kernel, Runner, Step, Stopped, Vpu, math};

use super::warp::{self, SkinRecord};
use crate::columns::{higher, lanes_below, lower, take_lane};
use crate::expression::{each, int, scalar};
use crate::face::{FaceFrame, InFrame};
use crate::field;
use crate::map::DepthMap;
use crate::map::layout::MapFace;
use crate::map::tiles::{Tile, Tiles};
use crate::plane::dot;
use crate::record::{Gathered, Record, Records, Source};

/// What the channel has where no skin lies over the texel: more than all of the light.
pub const NO_SKIN: f32 = 2.0;

/// What f32 makes of where a skin begins and ends along a row, as a part of the sizes of its terms.
const ROUNDED: f32 = 1e-6;

/// Texels of a task, whole rows of a tile, by their logarithm. Skins of all depths meet where a sample sees its neighbor: thousands of them
/// may lie over one tile there, which would be a long task.
const TEXELS_LOG2: u32 = 6;

/// How visibility is interpolated between the corners of a skin.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Interpolation {
    /// Linearly on the image plane of the map that the skin is drawn on, which is right where light and surface are parallel to it
    /// [algorithms, 3.3].
    Affine,
    /// Linearly on the skin itself, as rasterizers do.
    Perspective,
}

/// Draws a channel of `map`. `near`: the least depth.
pub(super) fn draw(
    map: &DepthMap,
    skins: Records<SkinRecord>,
    tiles: &Tiles,
    interpolation: Interpolation,
    near: f32,
    runner: &mut Runner<'_>,
) -> Result<Addr, Stopped> {
    let channel = runner.arena.overwritten(map.layout.texel_count());
    let bands_log2 = 2 * map.layout.tile_log2 - TEXELS_LOG2;
    let kernel = Draw { map: *map, skins, tiles: *tiles, interpolation, near, channel };
    // SAFETY: each task writes the texels of its own band of a tile.
    runner.run(&unsafe { Step::independent("draw skins", map.layout.tile_count() << bands_log2, kernel) })?;
    Ok(channel)
}

/// Draws the skins of a band of a tile: the darkest stays.
///
/// Light is seen from this sample on up to the first thing that hides some of it: of several skins over one point the darkest tells
/// how much that is, in whatever order they are drawn.
struct Draw {
    map: DepthMap,
    skins: Records<SkinRecord>,
    tiles: Tiles,
    interpolation: Interpolation,
    near: f32,
    channel: Addr,
}

/// What makes the weight of a corner that of the interpolation. `depth`: of the corner; `near`: the least depth.
#[inline(always)]
pub fn factor<V: Vpu>(v: &mut V, interpolation: Interpolation, depth: V::F32, near: f32) -> V::F32 {
    match interpolation {
        Interpolation::Perspective => v.vset_f32(1.0),
        // A corner that is not ahead is infinitely far on the image plane.
        Interpolation::Affine => {
            let near = v.vset_f32(near);
            v.vmax(depth, near)
        }
    }
}

/// A skin on the image plane of a face.
pub struct SkinOnFace<V: Vpu> {
    /// Weights of the corners: of x, of y, and a constant.
    pub weights: [[V::F32; 3]; 3],
    /// What makes the sum of the weights a reciprocal depth.
    pub per_depth: V::F32,
    /// What makes the weights those of the interpolation.
    pub factors: [V::F32; 3],
    /// What makes the weights those of the interpolation, times what is seen of the light at the corners.
    pub lit: [V::F32; 3],
}

/// Weights of the corners of a skin in the frame of a face: of x, of y, and a constant.
#[inline(always)]
fn weights<V: Vpu, S: Source<V, SkinRecord>>(v: &mut V, skin: &InFrame<V, S>) -> [[V::F32; 3]; 3] {
    each!(k in [0, 1, 2] => skin.vec3(v, field!(SkinRecord.normals[k])))
}

impl<V: Vpu> SkinOnFace<V> {
    /// A skin on the face in whose frame it is, on which its corners have these weights.
    #[inline(always)]
    fn new(
        v: &mut V,
        skin: Record<V, SkinRecord>,
        in_frame: &InFrame<V, Record<V, SkinRecord>>,
        weights: [[V::F32; 3]; 3],
        interpolation: Interpolation,
        near: f32,
    ) -> SkinOnFace<V> {
        let per_depth = skin.float(v, field!(SkinRecord.per_depth));
        let factors = each!(k in [0, 1, 2] => {
            let depth = in_frame.depth(v, field!(SkinRecord.corners[k]));
            factor(v, interpolation, depth, near)
        });
        let lit = each!(k in [0, 1, 2] => {
            let lit = skin.float(v, field!(SkinRecord.lit[k]));
            v.vmul(lit, factors[k])
        });
        SkinOnFace { weights, per_depth, factors, lit }
    }

    /// Weights of the corners at the x of some places, to which those of their y are still to be added.
    #[inline(always)]
    pub fn at_x(&self, v: &mut V, x: V::F32) -> [V::F32; 3] {
        each!(k in [0, 1, 2] => warp::at_x(v, self.weights[k], x))
    }

    /// Weights of the corners at some places, and which of these the skin covers.
    #[inline(always)]
    pub fn at_y(&self, v: &mut V, at_x: [V::F32; 3], y: V::F32) -> ([V::F32; 3], V::Mask) {
        let zero = v.vset_f32(0.0);
        let weights = each!(k in [0, 1, 2] => warp::at_y(v, self.weights[k], at_x[k], y));
        let inside = v.vcmp_ge(weights[0], zero);
        let inside = v.vcmp_ge_masked(inside, weights[1], zero);
        (weights, v.vcmp_ge_masked(inside, weights[2], zero))
    }

    /// Reciprocal depth where the corners have these weights.
    #[inline(always)]
    pub fn depth(&self, v: &mut V, [a, b, c]: [V::F32; 3]) -> V::F32 {
        let sum = v.vadd(a, b);
        let sum = v.vadd(sum, c);
        v.vmul(sum, self.per_depth)
    }

    /// The part of the light that is seen where the corners have these weights.
    #[inline(always)]
    pub fn light(&self, v: &mut V, weights: [V::F32; 3]) -> V::F32 {
        let (zero, one) = (v.vset_f32(0.0), v.vset_f32(1.0));
        let over = dot(v, weights, self.lit);
        let under = dot(v, weights, self.factors);
        let light = math::div(v, over, under);
        let light = v.vmin(light, one);
        v.vmax(light, zero)
    }
}

impl Kernel for Draw {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let Draw { map, tiles, channel, .. } = self;
        let rows_log2 = (TEXELS_LOG2 - map.layout.tile_log2) as i32;
        let bands_log2 = map.layout.tile_log2 as i32 - rows_log2;
        let number = scalar!(v, task >> { bands_log2 });
        let tile = Tile::new(v, &map.layout, number);
        let first = scalar!(v, (task & { (1 << bands_log2) - 1 }) << { rows_log2 });
        let end = scalar!(v, first + { 1 << rows_log2 });
        let last = scalar!(v, end - 1);
        let all = v.mask_all();
        let no_skin = v.vset_f32(NO_SKIN);
        let nothing = v.s_imm(0);
        let mut word = tile.word(v, &map.layout, nothing, first);
        let end = tile.word(v, &map.layout, nothing, end);
        while v.branch(Compare::Less, word, end) {
            v.vstore_f32(all, *channel, word, no_skin);
            word = scalar!(v, word + 16);
        }
        let frame = FaceFrame::new(v, tile.face);
        let [mut item, end] = tiles.items_of(v, &tile);
        while v.branch(Compare::Less, item, end) {
            let live = lanes_below(v, item, end);
            let (near, numbers) = tiles.in_rows(v, &tile, live, item, [first, last]);
            let covers = self.covers_middles(v, near, numbers, &tile, &frame, [first, last]);
            let mut left = v.kmov_to_scalar(covers);
            while v.branch(Compare::NotEqual, left, nothing) {
                let lane = take_lane(v, &mut left);
                let item = scalar!(v, item + lane);
                let number = tiles.number(v, item);
                let record = self.skins.record(v, number);
                let in_frame = frame.see(v, record);
                let weights = weights(v, &in_frame);
                let [columns, [low_y, last_y]] = tiles.range(v, &tile, number);
                let low_y = higher(v, low_y, first);
                let last_y = lower(v, last_y, last);
                let skin = SkinOnFace::new(v, record, &in_frame, weights, self.interpolation, self.near);
                self.skin(v, &tile, [columns, [low_y, last_y]], &skin);
            }
            item = scalar!(v, item + 16);
        }
    }
}

impl Draw {
    /// Which of 16 skins in `live` may cover the middle of a texel of the rows `first..=last` of a tile, one skin a lane. Skins are
    /// slivers: their boxes are wide where they lie aslant, and near the picture of the other sample, where those of all depths
    /// meet, most of them pass between the middles.
    #[inline(always)]
    fn covers_middles<V: Vpu>(
        &self,
        v: &mut V,
        live: V::Mask,
        numbers: V::I32,
        tile: &Tile<V>,
        frame: &FaceFrame<V>,
        [first, last]: [V::S32; 2],
    ) -> V::Mask {
        let layout = &self.map.layout;
        let zero = v.vset_f32(0.0);
        let skins = Gathered::new(v, self.skins, live, numbers);
        let in_frame = frame.see(v, skins);
        let weights = weights(v, &in_frame);
        // Along a row the weight of a corner is 0 or more up to a place, or from a place on.
        let begins = each!(k in [0, 1, 2] => v.vcmp_gt(weights[k][0], zero));
        let ends = each!(k in [0, 1, 2] => v.vcmp_lt(weights[k][0], zero));
        let per_slope = each!(k in [0, 1, 2] => {
            let slopes = v.kor(begins[k], ends[k]);
            v.vrcp_or(zero, slopes, weights[k][0])
        });
        let per_unit = v.vbroadcast_f32(layout.faces.column(field!(MapFace.per_unit[0])), tile.face);
        let [low, high] = tile.columns_reach(v, layout);
        let mut covers = v.mask_none();
        let mut y = first;
        while v.branch(Compare::LessEqual, y, last) {
            let row = tile.row(v, y);
            let place_y = tile.middle(v, 1, row);
            let (mut from, mut to) = (low, high);
            for k in 0..3 {
                let rest = v.vmadd(weights[k][1], place_y, weights[k][2]);
                let place = v.vmul(rest, per_slope[k]);
                let place = v.vsub(zero, place);
                let column = tile.column_of(v, place, per_unit);
                // What f32 rounds, in columns, and some.
                let terms = v.vmul(weights[k][1], place_y);
                let (terms, constant) = (v.vabs(terms), v.vabs(weights[k][2]));
                let terms = v.vadd(terms, constant);
                let terms = v.vmul(terms, per_slope[k]);
                let terms = v.vabs(terms);
                let terms = v.vmul(terms, per_unit);
                let (part, least) = (v.vset_f32(ROUNDED), v.vset_f32(0.01));
                let slack = v.vmadd(terms, part, least);
                let earlier = v.vsub(column, slack);
                let later = v.vadd(column, slack);
                from = v.vmax_or(from, begins[k], from, earlier);
                to = v.vmin_or(to, ends[k], to, later);
            }
            // A middle lies half a column behind a number.
            let half = v.vset_f32(0.5);
            let to = v.vsub(to, half);
            let to = v.vfloor(to);
            let to = v.vadd(to, half);
            // What overflows may cover some.
            let none = v.vcmp_lt(to, from);
            let some = v.kandn(none, live);
            covers = v.kor(covers, some);
            y = scalar!(v, y + 1);
        }
        covers
    }

    /// Draws a skin on the texels of a tile that it may cover, from the first to the last along both axes.
    #[inline(always)]
    fn skin<V: Vpu>(
        &self,
        v: &mut V,
        tile: &Tile<V>,
        [[low_x, last_x], [low_y, last_y]]: [[V::S32; 2]; 2],
        skin: &SkinOnFace<V>,
    ) {
        let Draw { map, channel, .. } = self;
        let side = 1 << map.layout.tile_log2;
        let one = v.vset_i32(1);
        let mut x = scalar!(v, (low_x >> 4) << 4);
        while v.branch(Compare::LessEqual, x, last_x) {
            let columns = tile.columns(v, x);
            let place_x = tile.middle(v, 0, columns);
            let at_x = skin.at_x(v, place_x);
            let mut row = tile.row(v, low_y);
            let mut to = tile.word(v, &map.layout, x, low_y);
            let mut y = low_y;
            while v.branch(Compare::LessEqual, y, last_y) {
                let place_y = tile.middle(v, 1, row);
                let (weights, inside) = skin.at_y(v, at_x, place_y);
                if v.branch_any(inside) {
                    // What lies before the skin hides it.
                    let depth = skin.depth(v, weights);
                    let surface = v.vload_f32(map.texels, to);
                    let seen = v.vcmp_gt_masked(inside, depth, surface);
                    if v.branch_any(seen) {
                        let light = skin.light(v, weights);
                        let before = v.vload_f32(*channel, to);
                        let after = v.vmin(before, light);
                        v.vstore_f32(seen, *channel, to, after);
                    }
                }
                row = int!(v, row + one);
                to = scalar!(v, to + { side });
                y = scalar!(v, y + 1);
            }
            x = scalar!(v, x + 16);
        }
    }
}
