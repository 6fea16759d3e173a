//! The visibility channel of a map: skins of a neighboring sample, drawn on what the map shows.

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Addr, Compare, Kernel, Runner, Step, Stopped, Vpu, math};

use super::warp::SkinRecord;
use crate::expression::{each, int, scalar};
use crate::field;
use crate::map::DepthMap;
use crate::map::draw::Axes;
use crate::map::tiles::{Tile, Tiles};
use crate::plane::dot;
use crate::record::{Record, Records};

/// What the channel has where no skin lies over the texel: more than all of the light.
const NO_SKIN: f32 = 2.0;

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
    let kernel = Draw { map: *map, skins, tiles: *tiles, interpolation, near, channel };
    // SAFETY: each task writes the texels of its own tile.
    runner.run(&unsafe { Step::independent("draw skins", map.layout.tile_count(), kernel) })?;
    Ok(channel)
}

/// What the `channel` has at `word`: half of the light, where no skin lies over the texel.
#[inline(always)]
pub(super) fn look<V: Vpu>(v: &mut V, live: V::Mask, channel: Addr, word: V::I32) -> V::F32 {
    let (half, one) = (v.vset_f32(0.5), v.vset_f32(1.0));
    let light = v.vgather_f32_or(half, live, channel, word);
    let none = v.vcmp_gt(light, one);
    v.vblend_f32(none, half, light)
}

/// Draws the skins of a tile: the darkest stays.
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
    /// The same times what is seen of the light at the corners.
    pub lit: [V::F32; 3],
}

impl<V: Vpu> SkinOnFace<V> {
    /// A skin on the face with these axes.
    #[inline(always)]
    pub fn new(
        v: &mut V,
        skin: Record<V, SkinRecord>,
        axes: &Axes<V>,
        interpolation: Interpolation,
        near: f32,
    ) -> SkinOnFace<V> {
        let weights = each!(k in [0, 1, 2] => {
            let [x, y, depth] = each!(axis in [0, 1, 2] => skin.component(v, field!(SkinRecord.normals[k]), axes.numbers[axis]));
            [x, y, v.vmul(depth, axes.sign)]
        });
        let per_depth = skin.float(v, field!(SkinRecord.per_depth));
        let factors = each!(k in [0, 1, 2] => {
            let depth = skin.component(v, field!(SkinRecord.corners[k]), axes.numbers[2]);
            let depth = v.vmul(depth, axes.sign);
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
        each!(k in [0, 1, 2] => v.vmadd(self.weights[k][0], x, self.weights[k][2]))
    }

    /// Weights of the corners at some places, and which of these the skin covers.
    #[inline(always)]
    pub fn at_y(&self, v: &mut V, at_x: [V::F32; 3], y: V::F32) -> ([V::F32; 3], V::Mask) {
        let zero = v.vset_f32(0.0);
        let weights = each!(k in [0, 1, 2] => v.vmadd(self.weights[k][1], y, at_x[k]));
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
        let tile = Tile::new(v, &map.layout, task);
        let all = v.mask_all();
        let no_skin = v.vset_f32(NO_SKIN);
        let [mut word, end] = tile.words;
        while v.branch(Compare::Less, word, end) {
            v.vstore_f32(all, *channel, word, no_skin);
            word = scalar!(v, word + 16);
        }
        let axes = Axes::new(v, tile.face);
        let [mut item, end] = tiles.items_of(v, &tile);
        while v.branch(Compare::Less, item, end) {
            let number = tiles.number(v, item);
            let skin = self.skins.record(v, number);
            let skin = SkinOnFace::new(v, skin, &axes, self.interpolation, self.near);
            self.skin(v, &tile, number, &skin);
            item = scalar!(v, item + 1);
        }
    }
}

impl Draw {
    /// Draws skin `number` on a tile.
    #[inline(always)]
    fn skin<V: Vpu>(&self, v: &mut V, tile: &Tile<V>, number: V::S32, skin: &SkinOnFace<V>) {
        let Draw { map, tiles, channel, .. } = self;
        let side = 1 << map.layout.tile_log2;
        let [[low_x, last_x], [low_y, last_y]] = tiles.range(v, tile, number);
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
