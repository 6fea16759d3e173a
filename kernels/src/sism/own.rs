//! A receiver's own triangle, taken out of the sums.
//!
//! A triangle hides nothing from the receivers on it, and `hard` counts no layer of it for them. But silhouettes are those of
//! whole bodies: among the parts that `soft` adds up are those of the triangle's own edges. From a receiver on the triangle all
//! of them lie on one line, where its plane cuts the disc of the light: its horizon. Their sum is less the part of the disc
//! beyond that line, seen from the middle [algorithms, 2.8]; it is given back here. On a round body next to its terminator, where
//! neighbors hide what lies below the horizon, that part is all of the shadow.
//!
//! Few planes cut the light: [`CUTS`] says which, so that the receivers on all others cost two loads.

use lrbsim_isa::Vpu;

use super::soft::{fixed, view};
use crate::expression::{each, int};
use crate::field;
use crate::irregular::primitives::{BACK, CUTS, FRONT, Primitives, TriangleRecord};
use crate::light::{Horizon, View};
use crate::plane::Vec3;
use crate::record::words;
use crate::segment::{Angle, or_nothing};

/// What takes the own triangles of receivers out of their sums.
#[derive(Clone, Copy)]
pub struct Own {
    /// The light that is seen, and all triangles.
    pub primitives: Primitives,
}

/// The own triangles of 16 receivers.
pub struct OwnTriangles<V: Vpu> {
    /// Lanes whose own triangle's plane cuts the light.
    pub cut: V::Mask,
    /// First words of their records.
    at: V::I32,
    /// First flags of their records.
    flags: V::I32,
}

impl Own {
    /// The own triangles of the receivers in `live`, by their numbers; a number that no triangle has is that of a receiver on
    /// none.
    #[inline(always)]
    pub fn triangles<V: Vpu>(&self, v: &mut V, live: V::Mask, number: V::I32) -> OwnTriangles<V> {
        let none = v.vset_i32(0);
        let words = v.vset_i32(words::<TriangleRecord>() as i32);
        let count = v.vset_i32(self.primitives.triangle_count as i32);
        let live = v.vucmp_lt_masked(live, number, count);
        let at = int!(v, number * words);
        let flags = v.vgather_i32_or(
            none,
            live,
            self.primitives.triangles.field(field!(TriangleRecord.flags[0])),
            at,
        );
        let bit = v.vset_i32(CUTS);
        let cuts = int!(v, flags & bit);
        OwnTriangles { cut: v.vicmp_neq(cuts, none), at, flags }
    }

    /// The parts in F and B, fixed point, that the sums of the receivers at `points` lack.
    #[inline(always)]
    pub fn parts<V: Vpu>(&self, v: &mut V, points: Vec3<V>, own: &OwnTriangles<V>) -> [V::I32; 2] {
        let none = v.vset_i32(0);
        let zero = v.vset_f32(0.0);
        let view = view(v, &self.primitives.light, points);
        let Horizon { cuts, places: [from, to], .. } = self.horizon(v, &view, own);
        let part = view.part_beyond(v, cuts, from, to, Angle::Atan2);
        let (live, part) = or_nothing(v, part);
        let part = fixed(v, part, zero);
        let part = v.vblend_i32(live, part, none);
        each!(layer in [FRONT, BACK] => {
            let counted = self.counted(v, own, layer);
            v.vblend_i32(counted, part, none)
        })
    }

    /// Numbers of the objects that the own triangles belong to; of the lanes in [`OwnTriangles::cut`].
    #[inline(always)]
    pub fn object<V: Vpu>(&self, v: &mut V, own: &OwnTriangles<V>) -> V::I32 {
        let none = v.vset_i32(0);
        let flags = self.primitives.triangles.field(field!(TriangleRecord.flags[1]));
        let flags = v.vgather_i32_or(none, own.cut, flags, own.at);
        let number = v.vset_i32(i32::MAX);
        int!(v, flags & number)
    }

    /// The horizons of receivers on the discs that they see.
    #[inline(always)]
    pub fn horizon<V: Vpu>(&self, v: &mut V, view: &View<V>, own: &OwnTriangles<V>) -> Horizon<V> {
        let zero = v.vset_f32(0.0);
        let normal = each!(axis in [0, 1, 2] => {
            let normals = self.primitives.triangles.field(field!(TriangleRecord.normal[axis]));
            v.vgather_f32_or(zero, own.cut, normals, own.at)
        });
        view.horizon(v, own.cut, normal)
    }

    /// The lanes whose own triangles are layers of the sum that `layer`, [`FRONT`] or [`BACK`], stands for.
    #[inline(always)]
    pub fn counted<V: Vpu>(&self, v: &mut V, own: &OwnTriangles<V>, layer: i32) -> V::Mask {
        let none = v.vset_i32(0);
        let bit = v.vset_i32(layer);
        let flags = own.flags;
        let counted = int!(v, flags & bit);
        v.vicmp_neq(counted, none)
    }
}
