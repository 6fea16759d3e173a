//! Faces: the six 90-degree views from the light, the grid of each that sees receivers, and in which cell a receiver lies.

use lrbsim_isa::{Arena, Vpu, math};

use super::bounds::Extent;
use super::receivers::Receiver;
use super::{BIN_CELLS, CHILDREN, FACES, SLICES};
use crate::columns::Columns;
use crate::expression::{each, int};
use crate::field;
use crate::plane::Vec3;
use crate::record::Field;

/// Receivers that a cell should hold: one and a half vectors.
const CELL_RECEIVERS: u32 = 24;

/// The grid of one face, as the host lays it out.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct FaceGrid {
    /// Number of the face: twice the axis, plus one for the negative half.
    pub face: u32,
    /// Lower corner of the grid on the image plane.
    pub origin: [f32; 2],
    /// Size of a cell on the image plane.
    pub cell: [f32; 2],
    /// Bins in each direction.
    pub bins: [u32; 2],
    /// Number of its first bin, a multiple of [`CHILDREN`].
    pub first_bin: u32,
    /// Depths that part the slices.
    pub slice_depths: [f32; SLICES as usize - 1],
}

impl FaceGrid {
    /// Bins that it takes, whole groups.
    pub fn bins_padded(&self) -> u32 {
        (self.bins[0] * self.bins[1]).next_multiple_of(CHILDREN)
    }

    /// The grid of a face that sees receivers within `bounds`; its first bin is `first_bin`.
    fn new(face: u32, bounds: &Extent, first_bin: u32) -> FaceGrid {
        let (low, high) = (bounds.low, bounds.high);
        // Cells about square, on average with the wished number of receivers; bins whole. A little wider than the bounds,
        // so that rounding puts no receiver outside.
        let widen = |low: f32, high: f32| ((high - low) * 1.001).max(1e-6 + 1e-6 * low.abs().max(high.abs()));
        let extent = [widen(low[0], high[0]), widen(low[1], high[1])];
        let bins_wished = (f64::from(bounds.count) / f64::from(CELL_RECEIVERS * BIN_CELLS)).max(1.0);
        let aspect = f64::from(extent[0]) / f64::from(extent[1]);
        let across = ((bins_wished * aspect).sqrt().round()).clamp(1.0, bins_wished.ceil());
        let down = (bins_wished / across).round().max(1.0);
        let bins = [across as u32, down as u32];
        let cell = [extent[0] / (16 * bins[0]) as f32, extent[1] / (16 * bins[1]) as f32];
        let origin = [0, 1].map(|i| 0.5 * (low[i] + high[i]) - 0.5 * extent[i]);

        // Slices of equal ratio: cells cubical in a perspective grid [algorithms, 1.3].
        let (near, far) = (low[2], high[2]);
        let middle = (near * far).sqrt();
        let slice_depths = [(near * middle).sqrt(), middle, (middle * far).sqrt()];
        FaceGrid { face, origin, cell, bins, first_bin, slice_depths }
    }
}

/// What a receiver looks up of its face.
#[repr(C)]
pub(super) struct FaceParameters {
    /// Lower corner of the grid on the image plane.
    origin: [f32; 2],
    /// Cells per unit of the image plane.
    pub(super) per_cell: [f32; 2],
    /// Number of the last cell in each direction.
    last_cell: [f32; 2],
    /// Bins in the first direction.
    bins_x: u32,
    /// Number of the first bin.
    first_bin: u32,
    /// Depths that part the slices.
    slice_depths: [f32; SLICES as usize - 1],
}

/// Where a bin lies.
#[repr(C)]
pub struct BinPlace {
    /// Its face.
    pub face: u32,
    /// Its lower corner on the image plane.
    pub low: [f32; 2],
}

/// The faces that see receivers.
#[derive(Clone, Copy, Default)]
pub struct Faces {
    /// Grids of `count` faces.
    grids: [FaceGrid; FACES as usize],
    count: u32,
    /// Parameters by number of the face.
    pub(super) parameters: Columns<FaceParameters>,
    /// Where each bin lies.
    pub(super) bin_places: Columns<BinPlace>,
    /// Bins of all faces, whole groups.
    pub bin_count: u32,
}

impl Faces {
    /// Sizes the grids by the bounds of their receivers and writes the constants of faces and bins, untimed: the
    /// descriptors that a driver would set up.
    pub(super) fn new(arena: &mut Arena, bounds: &[Option<Extent>; FACES as usize]) -> Faces {
        let mut faces = Faces::default();
        for (face, bounds) in (0..FACES).zip(bounds) {
            if let Some(bounds) = bounds {
                let grid = FaceGrid::new(face, bounds, faces.bin_count);
                faces.bin_count += grid.bins_padded();
                faces.grids[faces.count as usize] = grid;
                faces.count += 1;
            }
        }
        faces.parameters = Columns::with_stride(arena, 8);
        faces.bin_places = Columns::new(arena, faces.bin_count);
        for grid in faces.grids() {
            faces.write(arena, grid);
        }
        faces
    }

    /// The grids.
    #[inline(always)]
    pub fn grids(&self) -> &[FaceGrid] {
        &self.grids[..self.count as usize]
    }

    /// Cells of all bins.
    pub fn cell_count(&self) -> u32 {
        self.bin_count * BIN_CELLS
    }

    /// Blocks of all bins.
    pub fn block_count(&self) -> u32 {
        self.bin_count * CHILDREN
    }

    /// Writes the constants of one face and of its bins.
    fn write(&self, arena: &mut Arena, grid: &FaceGrid) {
        let mut float = |field: Field<FaceParameters, f32>, value: f32| {
            arena.write_u32(self.parameters.host(grid.face, field), value.to_bits());
        };
        for i in 0..2 {
            float(field!(FaceParameters.origin[i]), grid.origin[i]);
            float(field!(FaceParameters.per_cell[i]), 1.0 / grid.cell[i]);
            float(field!(FaceParameters.last_cell[i]), (16 * grid.bins[i] - 1) as f32);
        }
        for (i, depth) in grid.slice_depths.into_iter().enumerate() {
            float(field!(FaceParameters.slice_depths[i]), depth);
        }
        arena.write_u32(self.parameters.host(grid.face, field!(FaceParameters.bins_x)), grid.bins[0]);
        arena.write_u32(self.parameters.host(grid.face, field!(FaceParameters.first_bin)), grid.first_bin);
        for number in 0..grid.bins_padded() {
            let bin = grid.first_bin + number;
            let corner = [number % grid.bins[0], number / grid.bins[0]];
            arena.write_u32(self.bin_places.host(bin, field!(BinPlace.face)), grid.face);
            for (i, corner) in corner.into_iter().enumerate() {
                let low = grid.origin[i] + grid.cell[i] * (16 * corner) as f32;
                arena.write_u32(self.bin_places.host(bin, field!(BinPlace.low[i])), low.to_bits());
            }
        }
    }
}

/// Constants that the kernels of the grid keep in registers.
pub(super) struct Constants<V: Vpu> {
    pub(super) zero: V::F32,
    pub(super) one: V::F32,
    /// 0 to 5: the faces, and small numbers.
    pub(super) whole: [V::I32; FACES as usize],
}

impl<V: Vpu> Constants<V> {
    #[inline(always)]
    pub(super) fn new(v: &mut V) -> Constants<V> {
        Constants {
            zero: v.vset_f32(0.0),
            one: v.vset_f32(1.0),
            whole: each!(i in [0, 1, 2, 3, 4, 5] => v.vset_i32(i)),
        }
    }
}

/// Positions of the 16 receivers from `i` on; asks for those of the next vector.
#[inline(always)]
pub(super) fn load_positions<V: Vpu>(
    v: &mut V,
    constants: &Constants<V>,
    receivers: Columns<Receiver>,
    live: V::Mask,
    i: V::S32,
) -> Vec3<V> {
    each!(axis in [0, 1, 2] => {
        let column = receivers.column(field!(Receiver.position[axis]));
        v.prefetch_l1(column.plus_lines(1), i);
        v.vload_f32_or(constants.one, live, column, i)
    })
}

/// Face of each point, by its largest component (the first of equal ones), and its image there: x, y, depth.
#[inline(always)]
pub(super) fn project<V: Vpu>(
    v: &mut V,
    constants: &Constants<V>,
    p: Vec3<V>,
) -> (V::I32, V::F32, V::F32, V::F32) {
    let size = [v.vabs(p[0]), v.vabs(p[1]), v.vabs(p[2])];
    // Largest component: y beats x, z beats both, only if strictly larger.
    let by_y = v.vcmp_gt(size[1], size[0]);
    let larger = v.vmax(size[0], size[1]);
    let by_z = v.vcmp_gt(size[2], larger);
    let depth = v.vblend_f32(by_z, size[2], larger);
    let along = v.vblend_f32(by_y, p[1], p[0]);
    let along = v.vblend_f32(by_z, p[2], along);
    // The other two, in cyclic order.
    let x = v.vblend_f32(by_y, p[2], p[1]);
    let x = v.vblend_f32(by_z, p[0], x);
    let y = v.vblend_f32(by_y, p[0], p[2]);
    let y = v.vblend_f32(by_z, p[1], y);
    let x = math::div(v, x, depth);
    let y = math::div(v, y, depth);
    // Face number: twice the axis, plus one for the negative half.
    let whole = &constants.whole;
    let face = v.vblend_i32(by_y, whole[2], whole[0]);
    let face = v.vblend_i32(by_z, whole[4], face);
    let negative = v.vcmp_lt(along, constants.zero);
    let face = v.viadd_or(face, negative, face, whole[1]);
    (face, x, y, depth)
}

impl Faces {
    /// The key of each point, `cell << 2 | slice`.
    #[inline(always)]
    pub(super) fn key<V: Vpu>(
        &self,
        v: &mut V,
        constants: &Constants<V>,
        live: V::Mask,
        p: Vec3<V>,
    ) -> V::I32 {
        let (face, x, y, depth) = project(v, constants, p);
        let zero = constants.zero;
        let [none, one, two, three, four, _] = constants.whole;
        let parameters = self.parameters;
        let cx = self.cell_along(v, constants, live, 0, x, face);
        let cy = self.cell_along(v, constants, live, 1, y, face);
        let bins_x = v.vgather_i32_or(none, live, parameters.column(field!(FaceParameters.bins_x)), face);
        let first_bin =
            v.vgather_i32_or(none, live, parameters.column(field!(FaceParameters.first_bin)), face);

        // Bin, block in the bin, cell in the block: two bits of each coordinate a level.
        let bin_x = int!(v, cx >> four);
        let bin_y = int!(v, cy >> four);
        let mut number = int!(v, ((bin_y * bins_x) + bin_x) + first_bin);
        let block_y = int!(v, cy >> two);
        let block_x = int!(v, cx >> two);
        for c in [block_y, block_x, cy, cx] {
            let digit = int!(v, c & three);
            number = int!(v, (number << two) | digit);
        }
        // Slice.
        let mut slice = none;
        for i in 0..SLICES as usize - 1 {
            let bounds = parameters.column(field!(FaceParameters.slice_depths[i]));
            let bound = v.vgather_f32_or(zero, live, bounds, face);
            let past = v.vcmp_gt(depth, bound);
            slice = v.viadd_or(slice, past, slice, one);
        }
        int!(v, (number << two) | slice)
    }

    /// Cell of each point along one axis of its face's grid.
    #[inline(always)]
    fn cell_along<V: Vpu>(
        &self,
        v: &mut V,
        constants: &Constants<V>,
        live: V::Mask,
        axis: usize,
        x: V::F32,
        face: V::I32,
    ) -> V::I32 {
        let zero = constants.zero;
        let mut parameter = |field| v.vgather_f32_or(zero, live, self.parameters.column(field), face);
        let origin = parameter(field!(FaceParameters.origin[axis]));
        let per_cell = parameter(field!(FaceParameters.per_cell[axis]));
        let last = parameter(field!(FaceParameters.last_cell[axis]));
        let from = v.vsub(x, origin);
        let cell = v.vmul(from, per_cell);
        let cell = v.vmax(cell, zero);
        let cell = v.vmin(cell, last);
        v.vcvt_f32_i32(cell)
    }
}
