//! Where texels lie: a square of them for each face around the light that sees receivers, as large as these need.

use lrbsim_isa::{Kernel, Runner, Step, Stopped, Vpu, math};

use crate::columns::Columns;
use crate::expression::{each, int};
use crate::face::FACES;
use crate::field;
use crate::irregular::bounds::{self, FaceBounds};
use crate::irregular::faces::{WIDER, extent};
use crate::irregular::receivers::Receivers;
use crate::record::{Field, Records, words};
use crate::scan;

/// Tiles of a side at most: small tiles are short tasks where much lies in few of them.
const TILES: u32 = 32;

/// Texels of a side of a tile at least: as many as a vector has lanes.
const TILE_MIN: u32 = 16;

/// All faces, a bit each.
const ALL_FACES: i32 = (1 << FACES) - 1;

/// What f32 makes of a place on the image plane, as a part of its distance from the axis: eight roundings.
const ROUNDED: f32 = 1.0 / (1 << 21) as f32;

/// What kernels look up of a face.
#[repr(C)]
pub struct MapFace {
    /// Where texel 0 begins on the image plane.
    pub origin: [f32; 2],
    /// Texels per unit of the image plane.
    pub per_unit: [f32; 2],
    /// Width of a texel on the image plane.
    pub unit: [f32; 2],
    /// Texels by which rounding may move a place on the image plane.
    pub slack: [f32; 2],
    /// Reciprocal depth of the farthest receiver: whatever throws a penumbra throws it no farther.
    pub farthest: f32,
    /// Number of its square among those of the faces that see receivers.
    pub slot: i32,
}

/// What kernels look up of a square of texels.
#[repr(C)]
pub struct MapSlot {
    /// The face whose square it is.
    pub face: i32,
}

/// Where the texels of a map lie.
#[derive(Clone, Copy)]
pub struct Layout {
    /// Parameters by number of the face.
    pub faces: Columns<MapFace>,
    /// Parameters by number of the square.
    pub slots: Columns<MapSlot>,
    /// Number of squares: of faces that see receivers.
    pub slot_count: u32,
    /// Texels of a side for which there is room, a power of two.
    pub size: u32,
    /// Texels of a side that are used; those beyond hold nothing.
    pub used: u32,
    /// Texels of a side of a tile, by their logarithm.
    pub tile_log2: u32,
}

/// How squares lie about the bounds of receivers.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Fit {
    /// Texels of a side.
    pub size: u32,
    /// How many texels reach across the bounds, which need not be a whole number of them.
    pub inside: f32,
    /// How many texels lie outside of the bounds on every side.
    pub margin: f32,
    /// How much wider than the receivers the bounds are.
    pub wider: f32,
    /// The faces that may have a square, a bit each.
    pub faces: i32,
    /// Tiles of a side at most.
    pub tiles: u32,
}

impl Layout {
    /// Lays out squares of `size` texels a side about the receivers, with `margin` texels on every side.
    pub fn build(
        receivers: &Receivers,
        size: u32,
        margin: u32,
        runner: &mut Runner<'_>,
    ) -> Result<Layout, Stopped> {
        let bounds = bounds::find(receivers, runner)?;
        let inside = (size - 2 * margin) as f32;
        let margin = margin as f32;
        Layout::fit(
            bounds,
            Fit { size, inside, margin, wider: WIDER, faces: ALL_FACES, tiles: TILES },
            runner,
        )
    }

    /// Lays out squares about these bounds.
    pub(crate) fn fit(
        bounds: Records<FaceBounds>,
        fit: Fit,
        runner: &mut Runner<'_>,
    ) -> Result<Layout, Stopped> {
        let faces = Columns::with_stride(runner.arena, 16);
        let slots = Columns::with_stride(runner.arena, 16);
        let count = runner.arena.overwritten(16);
        let kernel = Squares { bounds, fit, faces, slots, count };
        runner.run(&Step::ordered("map layout", 1, kernel))?;
        let slot_count = runner.arena.read_u32(count);
        let size = fit.size.next_power_of_two().max(TILE_MIN);
        let tile_log2 = (size / fit.tiles).max(TILE_MIN).trailing_zeros();
        Ok(Layout { faces, slots, slot_count, size, used: fit.size, tile_log2 })
    }

    /// The word of texels `[x, y]` of the squares `slot`: tile by tile, in a tile row by row.
    #[inline(always)]
    pub fn word<V: Vpu>(&self, v: &mut V, slot: V::I32, [x, y]: [V::I32; 2]) -> V::I32 {
        let tile_log2 = v.vset_i32(self.tile_log2 as i32);
        let tiles_log2 = v.vset_i32(self.tiles_log2() as i32);
        let in_tile = v.vset_i32((1 << self.tile_log2) - 1);
        let tile_y = int!(v, (slot << tiles_log2) + (y >> tile_log2));
        let tile = int!(v, (tile_y << tiles_log2) + (x >> tile_log2));
        let row = int!(v, (tile << tile_log2) + (y & in_tile));
        int!(v, (row << tile_log2) + (x & in_tile))
    }

    /// Tiles of a side, by their logarithm.
    #[inline(always)]
    pub const fn tiles_log2(&self) -> u32 {
        self.size.trailing_zeros() - self.tile_log2
    }

    /// Number of tiles of all squares.
    pub fn tile_count(&self) -> u32 {
        self.slot_count << (2 * self.tiles_log2())
    }

    /// Number of texels of all squares.
    pub fn texel_count(&self) -> u64 {
        u64::from(self.slot_count) * u64::from(self.size) * u64::from(self.size)
    }
}

/// Lays out the squares, a lane a face.
struct Squares {
    bounds: Records<FaceBounds>,
    fit: Fit,
    faces: Columns<MapFace>,
    slots: Columns<MapSlot>,
    /// Where the number of squares goes.
    count: lrbsim_isa::Addr,
}

impl Kernel for Squares {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, only: V::S32) {
        let lane = v.viota();
        let line = v.vset_i32(words::<FaceBounds>() as i32);
        let none = v.vset_i32(0);
        let one = v.vset_i32(1);
        let (zero, half) = (v.vset_f32(0.0), v.vset_f32(0.5));
        let faces = v.s_imm(ALL_FACES);
        let faces = v.kmov_from_scalar(faces);
        let at = int!(v, lane * line);
        let count = v.vgather_i32_or(none, faces, self.bounds.field(field!(FaceBounds.count)), at);
        let mut seen = v.vicmp_gt_masked(faces, count, none);
        if self.fit.faces != ALL_FACES {
            let wanted = v.s_imm(self.fit.faces);
            let wanted = v.kmov_from_scalar(wanted);
            seen = v.kand(seen, wanted);
        }

        let inside = v.vset_f32(self.fit.inside);
        let margin = v.vset_f32(self.fit.margin);
        for axis in 0..2 {
            let [low, minus_high] = each!(number in [2 * axis, 2 * axis + 1] => {
                v.vgather_f32_or(zero, seen, self.bounds.field(field!(FaceBounds.least[number])), at)
            });
            let high = v.vsub(zero, minus_high);
            let extent = extent(v, low, high, self.fit.wider);
            let per_unit = math::div(v, inside, extent);
            let unit = math::div(v, extent, inside);
            let middle = v.vadd(low, high);
            let middle = v.vmul(middle, half);
            let origin = v.vnmadd(extent, half, middle);
            let origin = v.vnmadd(margin, unit, origin);
            self.store(v, seen, field!(MapFace.origin[axis]), origin);
            self.store(v, seen, field!(MapFace.per_unit[axis]), per_unit);
            self.store(v, seen, field!(MapFace.unit[axis]), unit);
            let farther = v.vmax(high, minus_high);
            let rounded = v.vset_f32(ROUNDED);
            let rounded = v.vmul(rounded, farther);
            let slack = v.vmul(rounded, per_unit);
            self.store(v, seen, field!(MapFace.slack[axis]), slack);
        }

        let minus_deepest = v.vgather_f32_or(zero, seen, self.bounds.field(field!(FaceBounds.least[5])), at);
        let deepest = v.vsub(zero, minus_deepest);
        let farthest = v.vrcp_or(zero, seen, deepest);
        self.store(v, seen, field!(MapFace.farthest), farthest);

        let is_seen = v.vblend_i32(seen, one, none);
        let through = scan::running_sums(v, is_seen, lane, none);
        let slot = int!(v, through - one);
        let slot = v.vblend_i32(seen, slot, none);
        v.vstore_i32(faces, self.faces.column(field!(MapFace.slot)), only, slot);
        v.vscatter_i32(seen, self.slots.column(field!(MapSlot.face)), slot, lane);
        let total = v.vextract(through, FACES - 1);
        v.s_store(self.count, only, total);
    }
}

impl Squares {
    /// Stores a parameter of the faces in `live`.
    #[inline(always)]
    fn store<V: Vpu>(&self, v: &mut V, live: V::Mask, field: Field<MapFace, f32>, value: V::F32) {
        let first = v.s_imm(0);
        v.vstore_f32(live, self.faces.column(field), first, value);
    }
}
