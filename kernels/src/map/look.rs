//! What the map says of receivers.

use lrbsim_isa::{Vpu, math};

use super::DepthMap;
use super::layout::MapFace;
use super::tiles::middle;
use crate::columns::Columns;
use crate::expression::{each, int};
use crate::face::{Constants, project};
use crate::field;
use crate::irregular::faces::load_positions;
use crate::irregular::primitives::TriangleRecord;
use crate::irregular::receivers::Receiver;
use crate::record::words;
use crate::segment::Vec2;

/// How much nearer to the light than a receiver, in parts of its depth, a surface must be to hide it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Bias {
    /// Than the plane of the receiver's own triangle at the texel's middle, by what f32 rounds there: a plane does not shadow
    /// itself, however slantwise it lies and however large texels are.
    Plane,
    /// Than the receiver itself, by the same part everywhere (Williams 1978).
    Constant,
}

/// What f32 makes of reciprocal depths on a plane, as a part of the sizes of their terms.
const ROUNDED: f32 = 4e-6;

/// How much nearer than a receiver a surface must be where that is the same everywhere, in parts of reciprocal depth.
const CONSTANT: f32 = 5e-3;

/// Texels from the map's first to what is far off it: more than any map has, and few enough that texels can be counted from there.
const FAR_OFF: f32 = (1 << 20) as f32;

/// Sixteen receivers on the map.
pub struct Places<V: Vpu> {
    /// Places on the image planes of their faces.
    pub place: Vec2<V>,
    /// Reciprocal depths.
    pub depth: V::F32,
    /// Number of the square of each.
    pub slot: V::I32,
    origin: Vec2<V>,
    per_unit: Vec2<V>,
    /// Width of a texel on the image plane.
    pub unit: Vec2<V>,
    /// How the reciprocal depth of the receiver's triangle grows along the image plane; `None` where that does not matter.
    slope: Option<Vec2<V>>,
    /// How much greater than that of the receiver, or of its plane, a reciprocal depth must be to hide it.
    slack: V::F32,
}

impl DepthMap {
    /// The 16 receivers from `i` on, on the map.
    #[inline(always)]
    pub fn places<V: Vpu>(&self, v: &mut V, live: V::Mask, i: V::S32, bias: Bias) -> Places<V> {
        let receivers: Columns<Receiver> = self.receivers.columns;
        let constants = Constants::new(v);
        let (zero, one) = (constants.zero, constants.one);
        let p = load_positions(v, &constants, &self.receivers, live, i);
        let (face, x, y, depth) = project(v, &constants, p);
        let depth = v.vrcp(depth);
        let faces = self.layout.faces;
        let none = constants.whole[0];
        let slot = v.vgather_i32_or(none, live, faces.column(field!(MapFace.slot)), face);
        let origin = each!(axis in [0, 1] => v.vgather_f32_or(zero, live, faces.column(field!(MapFace.origin[axis])), face));
        let per_unit = each!(axis in [0, 1] => v.vgather_f32_or(one, live, faces.column(field!(MapFace.per_unit[axis])), face));
        let unit = each!(axis in [0, 1] => v.vgather_f32_or(one, live, faces.column(field!(MapFace.unit[axis])), face));
        let slope = match bias {
            Bias::Constant => None,
            Bias::Plane => {
                // The plane of the triangle that the receiver lies on: `normal . direction / plane` is its reciprocal depth.
                let number = v.vload_i32(receivers.column(field!(Receiver.triangle)), i);
                let count = v.vset_i32(self.triangle_count as i32);
                let on = v.vucmp_lt_masked(live, number, count);
                let words = v.vset_i32(words::<TriangleRecord>() as i32);
                let record = int!(v, number * words);
                let plane =
                    v.vgather_f32_or(zero, on, self.triangles.field(field!(TriangleRecord.plane)), record);
                let on = v.vcmp_gt_masked(on, plane, zero);
                let per_plane = v.vrcp_or(zero, on, plane);
                let [_, one_axis, two, ..] = constants.whole;
                let axis = int!(v, face >> one_axis);
                let normal = self.triangles.field(field!(TriangleRecord.normal[0]));
                let mut axis = axis;
                let slopes = each!(_k in [0, 1] => {
                    // The next axis in cyclic order.
                    let wraps = v.vicmp_eq(axis, two);
                    let next = int!(v, axis + one_axis);
                    axis = v.vblend_i32(wraps, none, next);
                    let at = int!(v, record + axis);
                    let component = v.vgather_f32_or(zero, on, normal, at);
                    v.vmul(component, per_plane)
                });
                Some(slopes)
            }
        };
        let slack = match slope {
            None => {
                let part = v.vset_f32(CONSTANT);
                v.vmul(depth, part)
            }
            Some([along_x, along_y]) => {
                let part = v.vset_f32(ROUNDED);
                let (along_x, along_y) = (v.vabs(along_x), v.vabs(along_y));
                let terms = v.vadd(along_x, along_y);
                let terms = v.vadd(terms, depth);
                v.vmul(terms, part)
            }
        };
        Places { place: [x, y], depth, slot, origin, per_unit, unit, slope, slack }
    }

    /// The texels of the square that are nearest to these, and their words.
    #[inline(always)]
    pub fn word<V: Vpu>(&self, v: &mut V, places: &Places<V>, texel: [V::I32; 2]) -> ([V::I32; 2], V::I32) {
        let layout = &self.layout;
        let first = v.vset_i32(0);
        let last = v.vset_i32(layout.size as i32 - 1);
        let texel = each!(axis in [0, 1] => {
            let low = v.vimax(texel[axis], first);
            v.vimin(low, last)
        });
        (texel, layout.word(v, places.slot, texel))
    }

    /// Reciprocal depths of texels, and which of them hide the receivers of `live` from the point that the map is seen from. A texel beyond
    /// the border of the square is the nearest on it.
    #[inline(always)]
    pub fn look<V: Vpu>(
        &self,
        v: &mut V,
        live: V::Mask,
        places: &Places<V>,
        texel: [V::I32; 2],
    ) -> (V::F32, V::Mask) {
        let zero = v.vset_f32(0.0);
        let (texel, word) = self.word(v, places, texel);
        let depth = v.vgather_f32_or(zero, live, self.texels, word);

        let mut own = places.depth;
        if let Some(slope) = places.slope {
            for axis in 0..2 {
                let at = middle(v, texel[axis], places.unit[axis], places.origin[axis]);
                let from = v.vsub(at, places.place[axis]);
                own = v.vmadd(from, slope[axis], own);
            }
        }
        let least = v.vadd(own, places.slack);
        // Beyond the horizon of the receiver's plane nothing hides it, an empty texel least of all.
        let least = v.vmax(least, zero);
        (depth, v.vcmp_gt_masked(live, depth, least))
    }
}

impl<V: Vpu> Places<V> {
    /// Where `place` on the image plane lies among the texels, along both axes: a texel begins at its number.
    #[inline(always)]
    pub fn texels(&self, v: &mut V, place: Vec2<V>) -> Vec2<V> {
        each!(axis in [0, 1] => {
            let from = v.vsub(place[axis], self.origin[axis]);
            v.vmul(from, self.per_unit[axis])
        })
    }
}

/// The texels that hold these places among texels; those of places far off the map are far off it on the same side.
#[inline(always)]
pub fn whole<V: Vpu>(v: &mut V, places: Vec2<V>) -> [V::I32; 2] {
    let (low, high) = (v.vset_f32(-FAR_OFF), v.vset_f32(FAR_OFF));
    each!(axis in [0, 1] => {
        let place = v.vmax(places[axis], low);
        let place = v.vmin(place, high);
        let floor = v.vfloor(place);
        v.vcvt_f32_i32(floor)
    })
}

/// The part `count / of` of the light, taken from all of it.
#[inline(always)]
pub fn lit<V: Vpu>(v: &mut V, count: V::I32, of: V::F32) -> V::F32 {
    let one = v.vset_f32(1.0);
    let count = v.vcvt_i32_f32(count);
    let hidden = math::div(v, count, of);
    v.vsub(one, hidden)
}
