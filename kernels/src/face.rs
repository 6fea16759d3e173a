//! The six faces around the light, and vectors as a face sees them: two components across it, and the depth along it.
//!
//! The frame of a face follows its axis in cyclic order: x, y and depth of a face along z are the axes x, y and z. On a negative half the
//! depth runs against its axis, and the frame is a mirror image.

use lrbsim_isa::{Vpu, math};

use crate::expression::{each, int, scalar};
use crate::plane::Vec3;
use crate::record::{Field, Source};

/// Number of faces around the light: +x, -x, +y, -y, +z, -z.
pub const FACES: u32 = 6;

/// The frame of one face, for vectors that lie in memory.
pub struct FaceFrame<V: Vpu> {
    /// Numbers of the axes that are its x, y and depth.
    axes: [V::S32; 3],
    /// The sign bit where the depth runs against its axis, and 0 where it runs along, in every lane.
    flip: V::I32,
}

impl<V: Vpu> FaceFrame<V> {
    /// The frame of face `face`.
    #[inline(always)]
    pub fn new(v: &mut V, face: V::S32) -> FaceFrame<V> {
        // The axes after axis i, and after that, are pairs of bits of two words.
        let pair = scalar!(v, face & 6);
        let x = v.s_imm(0b00_10_01);
        let x = scalar!(v, (x >> pair) & 3);
        let y = v.s_imm(0b01_00_10);
        let y = scalar!(v, (y >> pair) & 3);
        let depth = scalar!(v, face >> 1);
        let number = v.vsplat(face);
        let last_bit = v.vset_i32(31);
        FaceFrame { axes: [x, y, depth], flip: int!(v, number << last_bit) }
    }

    /// The vectors of `source` in this frame.
    #[inline(always)]
    pub fn see<R, S: Source<V, R>>(&self, v: &mut V, source: S) -> InFrame<V, S> {
        InFrame { components: each!(axis in [0, 1, 2] => source.behind(v, self.axes[axis])), flip: self.flip }
    }
}

/// The vectors of a record, or of 16 of them, in the frame of a face.
pub struct InFrame<V: Vpu, S> {
    /// Where the x, the y and the depth of each vector are found.
    components: [S; 3],
    flip: V::I32,
}

impl<V: Vpu, S: Copy> InFrame<V, S> {
    /// A vector, lane by lane.
    #[inline(always)]
    pub fn vec3<R>(&self, v: &mut V, field: Field<R, [f32; 3]>) -> Vec3<V>
    where
        S: Source<V, R>,
    {
        let [x, y] = each!(axis in [0, 1] => self.across(v, field, axis));
        [x, y, self.depth(v, field)]
    }

    /// The x (axis 0) or the y (axis 1) of a vector.
    #[inline(always)]
    pub fn across<R>(&self, v: &mut V, field: Field<R, [f32; 3]>, axis: usize) -> V::F32
    where
        S: Source<V, R>,
    {
        self.components[axis].float(v, field.at(0))
    }

    /// The depth of a vector.
    #[inline(always)]
    pub fn depth<R>(&self, v: &mut V, field: Field<R, [f32; 3]>) -> V::F32
    where
        S: Source<V, R>,
    {
        let along = self.components[2].float(v, field.at(0));
        flipped(v, along, self.flip)
    }

    /// `factor`, negated in a mirror image: a vector product of two vectors of this frame, times that, is what the frame sees of their
    /// product.
    #[inline(always)]
    pub fn mirrored(&self, v: &mut V, factor: V::F32) -> V::F32 {
        flipped(v, factor, self.flip)
    }
}

/// Constants that tell faces apart, which kernels keep in registers.
pub(crate) struct Constants<V: Vpu> {
    pub(crate) zero: V::F32,
    pub(crate) one: V::F32,
    /// 0 to 5: the faces, and small numbers.
    pub(crate) whole: [V::I32; FACES as usize],
}

impl<V: Vpu> Constants<V> {
    #[inline(always)]
    pub(crate) fn new(v: &mut V) -> Constants<V> {
        Constants {
            zero: v.vset_f32(0.0),
            one: v.vset_f32(1.0),
            whole: each!(i in [0, 1, 2, 3, 4, 5] => v.vset_i32(i)),
        }
    }
}

/// The face of each of 16 vectors, and its frame, for vectors in registers.
pub(crate) struct OwnFaces<V: Vpu> {
    /// Number of the face: twice the axis that it lies along, plus one for the negative half.
    pub(crate) number: V::I32,
    /// The faces of these lie along y, along z unless they lie along that, and in the negative half.
    along_y: V::Mask,
    along_z: V::Mask,
    negative: V::Mask,
}

impl<V: Vpu> OwnFaces<V> {
    /// The faces of points, by their largest component, the first of equal ones.
    #[inline(always)]
    pub(crate) fn of(v: &mut V, constants: &Constants<V>, p: Vec3<V>) -> OwnFaces<V> {
        let size = [v.vabs(p[0]), v.vabs(p[1]), v.vabs(p[2])];
        // Largest component: y beats x, z beats both, only if strictly larger.
        let along_y = v.vcmp_gt(size[1], size[0]);
        let larger = v.vmax(size[0], size[1]);
        let along_z = v.vcmp_gt(size[2], larger);
        let along = v.vblend_f32(along_y, p[1], p[0]);
        let along = v.vblend_f32(along_z, p[2], along);
        let whole = &constants.whole;
        let number = v.vblend_i32(along_y, whole[2], whole[0]);
        let number = v.vblend_i32(along_z, whole[4], number);
        let negative = v.vcmp_lt(along, constants.zero);
        let number = v.viadd_or(number, negative, number, whole[1]);
        OwnFaces { number, along_y, along_z, negative }
    }

    /// Face `face` for all of them.
    #[inline(always)]
    pub(crate) fn all(v: &mut V, face: V::S32) -> OwnFaces<V> {
        let number = v.vsplat(face);
        let (none, one, two) = (v.vset_i32(0), v.vset_i32(1), v.vset_i32(2));
        let axis = int!(v, number >> one);
        let along_y = v.vicmp_eq(axis, one);
        let along_z = v.vicmp_eq(axis, two);
        let negative = int!(v, number & one);
        let negative = v.vicmp_neq(negative, none);
        OwnFaces { number, along_y, along_z, negative }
    }

    /// A vector in the frame of each face: the components across it in cyclic order, and that along it, the depth. The constant 0 is the caller's.
    #[inline(always)]
    pub(crate) fn turn(&self, v: &mut V, zero: V::F32, p: Vec3<V>) -> Vec3<V> {
        let along = v.vblend_f32(self.along_y, p[1], p[0]);
        let along = v.vblend_f32(self.along_z, p[2], along);
        let x = v.vblend_f32(self.along_y, p[2], p[1]);
        let x = v.vblend_f32(self.along_z, p[0], x);
        let y = v.vblend_f32(self.along_y, p[0], p[2]);
        let y = v.vblend_f32(self.along_z, p[1], y);
        [x, y, v.vsub_or(along, self.negative, zero, along)]
    }
}

/// Face of each point, and its image there: x, y, depth.
#[inline(always)]
pub(crate) fn project<V: Vpu>(
    v: &mut V,
    constants: &Constants<V>,
    p: Vec3<V>,
) -> (V::I32, V::F32, V::F32, V::F32) {
    let face = OwnFaces::of(v, constants, p);
    let [x, y, depth] = face.turn(v, constants.zero, p);
    (face.number, math::div(v, x, depth), math::div(v, y, depth), depth)
}

/// Sixteen times `N` vectors in the frame of face `face`.
#[inline(always)]
pub(crate) fn turned<V: Vpu, const N: usize>(
    v: &mut V,
    face: V::S32,
    mut vectors: [Vec3<V>; N],
) -> [Vec3<V>; N] {
    let faces = OwnFaces::all(v, face);
    let zero = v.vset_f32(0.0);
    for vector in &mut vectors {
        *vector = faces.turn(v, zero, *vector);
    }
    vectors
}

/// `x` with the sign bits of `flip` turned.
#[inline(always)]
pub(crate) fn flipped<V: Vpu>(v: &mut V, x: V::F32, flip: V::I32) -> V::F32 {
    let bits = v.bits_of(x);
    let bits = v.vxor(bits, flip);
    v.from_bits(bits)
}
