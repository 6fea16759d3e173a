//! Faces: the six 90-degree views from the light, the grid of each that sees receivers, and in which cell a receiver lies.
//!
//! Grids are what a frame's receivers make them, so that the machine lays them out. Kernels look up what they need of a face;
//! the host reads how many bins there are, to size arrays, and nothing else.

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Kernel, Runner, Step, Stopped, Vpu, math};

use super::bounds::FaceBounds;
use super::primitives::{Form, LightConstants, POSITION_SLACK};
use super::receivers::{Receiver, Receivers};
use super::{BIN_CELLS, CHILDREN, SLICES};
use crate::columns::{Columns, store_first};
use crate::expression::{each, int, scalar};
use crate::face::{Constants, FACES, project};
use crate::field;
use crate::plane::Vec3;
use crate::record::{Field, Records, words};
use crate::scan;

/// Receivers that a cell should hold: one and a half vectors.
const CELL_RECEIVERS: u32 = 24;

/// What kernels look up of a face; of one that sees no receivers only its groups, of which it has none.
#[repr(C)]
pub struct FaceParameters {
    /// Lower corner of the grid on the image plane.
    pub origin: [f32; 2],
    /// Cells per unit of the image plane.
    pub per_cell: [f32; 2],
    /// Number of the last cell in each direction.
    pub last_cell: [f32; 2],
    /// Bins in the first direction.
    pub bins_x: i32,
    /// Number of the first bin, a multiple of [`CHILDREN`].
    pub first_bin: i32,
    /// The first group of bins, and one past the last.
    pub groups: [i32; 2],
    /// Depths that part the slices.
    pub slice_depths: [f32; SLICES as usize - 1],
}

/// What kernels look up of all faces together.
#[repr(C)]
struct FaceTotals {
    /// Bins of all faces, whole groups.
    bins: i32,
    /// A bit for each face that sees receivers.
    seen: i32,
    /// Radius of the light for the bound of a penumbra: larger by rounding.
    bound_radius: f32,
}

/// Where a bin lies.
#[repr(C)]
pub struct BinPlace {
    /// Its face.
    pub face: i32,
    /// Its lower corner on the image plane.
    pub low: [f32; 2],
}

/// The faces around the light, and the bins of those that see receivers.
#[derive(Clone, Copy)]
pub struct Faces {
    /// Parameters by number of the face.
    pub parameters: Columns<FaceParameters>,
    totals: Records<FaceTotals>,
    /// Where each bin lies.
    pub bin_places: Columns<BinPlace>,
    /// Bins of all faces, whole groups.
    pub bin_count: u32,
    /// How edges are seen on the light, which bounds their penumbras.
    pub form: Form,
}

impl Faces {
    /// Lays out the grids by the bounds of their receivers, and says where each bin lies.
    pub(super) fn build(
        light: &LightConstants,
        bounds: Records<FaceBounds>,
        runner: &mut Runner<'_>,
    ) -> Result<Faces, Stopped> {
        let parameters = Columns::with_stride(runner.arena, 8);
        let totals = Records::overwritten(runner.arena, 1);
        let grids = Grids { bounds, bound_radius: light.bound_radius, parameters, totals };
        runner.run(&Step::ordered("face grids", 1, grids))?;

        let bin_count = runner.arena.read_u32(totals.field(field!(FaceTotals.bins)));
        let bin_places = Columns::overwritten(runner.arena, bin_count);
        // SAFETY: each task writes the places of its own group.
        runner.run(&unsafe {
            Step::independent("bin places", bin_count / CHILDREN, BinPlaces { parameters, bin_places })
        })?;
        Ok(Faces { parameters, totals, bin_places, bin_count, form: light.form })
    }

    /// Cells of all bins.
    pub fn cell_count(&self) -> u32 {
        self.bin_count * BIN_CELLS
    }

    /// Blocks of all bins.
    pub fn block_count(&self) -> u32 {
        self.bin_count * CHILDREN
    }

    /// The faces that see receivers, a bit each.
    #[inline(always)]
    pub(crate) fn seen<V: Vpu>(&self, v: &mut V) -> V::S32 {
        let only = v.s_imm(0);
        self.totals.at(only).scalar(v, field!(FaceTotals.seen))
    }

    /// Radius of the light for the bound of a penumbra.
    #[inline(always)]
    pub(super) fn bound_radius<V: Vpu>(&self, v: &mut V) -> V::F32 {
        let only = v.s_imm(0);
        self.totals.at(only).float(v, field!(FaceTotals.bound_radius))
    }

    /// The first group of the bins of face `face`, and one past the last.
    #[inline(always)]
    pub(super) fn groups<V: Vpu>(&self, v: &mut V, face: V::S32) -> [V::S32; 2] {
        each!(end in [0, 1] => v.s_load(self.parameters.column(field!(FaceParameters.groups[end])), face))
    }
}

/// Lays out the grids, a lane a face.
struct Grids {
    bounds: Records<FaceBounds>,
    /// Radius of the light for the bound of a penumbra, before rounding is added.
    bound_radius: f32,
    parameters: Columns<FaceParameters>,
    totals: Records<FaceTotals>,
}

impl Kernel for Grids {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, only: V::S32) {
        let lane = v.viota();
        let line = v.vset_i32(words::<FaceBounds>() as i32);
        let none = v.vset_i32(0);
        let (zero, half, one) = (v.vset_f32(0.0), v.vset_f32(0.5), v.vset_f32(1.0));
        let faces = v.s_imm((1 << FACES) - 1);
        let faces = v.kmov_from_scalar(faces);

        // The bounds of the faces that see receivers.
        let at = int!(v, lane * line);
        let count = v.vgather_i32_or(none, faces, self.bounds.field(field!(FaceBounds.count)), at);
        let seen = v.vicmp_gt_masked(faces, count, none);
        let low = each!(axis in [0, 1, 2] => {
            v.vgather_f32_or(one, seen, self.bounds.field(field!(FaceBounds.least[2 * axis])), at)
        });
        let high = each!(axis in [0, 1, 2] => {
            let minus_high = self.bounds.field(field!(FaceBounds.least[2 * axis + 1]));
            let minus_high = v.vgather_f32_or(one, seen, minus_high, at);
            v.vsub(zero, minus_high)
        });

        // Cells about square, on average with the wished number of receivers; bins whole.
        let extent = each!(axis in [0, 1] => extent(v, low[axis], high[axis], WIDER));
        let per_bin = v.vset_f32(1.0 / (CELL_RECEIVERS * BIN_CELLS) as f32);
        let wished = v.vcvt_i32_f32(count);
        let wished = v.vmul(wished, per_bin);
        let wished = v.vmax(wished, one);
        let aspect = math::div(v, extent[0], extent[1]);
        let across = v.vmul(wished, aspect);
        let across = math::sqrt(v, across);
        let across = v.vround(across);
        let across = v.vmax(across, one);
        let most = v.vadd(wished, half);
        let most = v.vround(most);
        let across = v.vmin(across, most);
        let down = math::div(v, wished, across);
        let down = v.vround(down);
        let down = v.vmax(down, one);
        let bins = [across, down];
        let sixteen = v.vset_f32(16.0);
        for axis in 0..2 {
            let cells = v.vmul(bins[axis], sixteen);
            let last_cell = v.vsub(cells, one);
            let per_cell = math::div(v, cells, extent[axis]);
            let sum = v.vadd(low[axis], high[axis]);
            let sum = v.vsub(sum, extent[axis]);
            let origin = v.vmul(sum, half);
            self.store(v, seen, field!(FaceParameters.last_cell[axis]), last_cell);
            self.store(v, seen, field!(FaceParameters.per_cell[axis]), per_cell);
            self.store(v, seen, field!(FaceParameters.origin[axis]), origin);
        }

        // Slices of equal ratio: cells cubical in a perspective grid [algorithms, 1.3].
        let (near, far) = (low[2], high[2]);
        let middle = mean(v, near, far);
        let depths = [mean(v, near, middle), middle, mean(v, middle, far)];
        for (i, depth) in depths.into_iter().enumerate() {
            self.store(v, seen, field!(FaceParameters.slice_depths[i]), depth);
        }

        // Whole groups of bins, one face after the other.
        let bins = each!(axis in [0, 1] => v.vcvt_f32_i32(bins[axis]));
        self.store_int(v, seen, field!(FaceParameters.bins_x), bins[0]);
        let four = v.vset_i32(4);
        let fifteen = v.vset_i32(CHILDREN as i32 - 1);
        let [bins_x, bins_y] = bins;
        let groups = int!(v, ((bins_x * bins_y) + fifteen) >> four);
        let groups = v.vblend_i32(seen, groups, none);
        let end_group = scan::running_sums(v, groups, lane, none);
        let first_group = int!(v, end_group - groups);
        let first_bin = int!(v, first_group << four);
        self.store_int(v, faces, field!(FaceParameters.first_bin), first_bin);
        self.store_int(v, faces, field!(FaceParameters.groups[0]), first_group);
        self.store_int(v, faces, field!(FaceParameters.groups[1]), end_group);

        // What all faces have together. The farthest receiver is the deepest one of its face.
        let bin_count = int!(v, end_group << four);
        let bin_count = v.vextract(bin_count, 15);
        v.s_store(self.totals.field(field!(FaceTotals.bins)), only, bin_count);
        let seen_bits = v.kmov_to_scalar(seen);
        v.s_store(self.totals.field(field!(FaceTotals.seen)), only, seen_bits);
        let farthest = v.vblend_f32(seen, far, zero);
        let farthest = math::reduce_max(v, farthest);
        let slack = v.vset_f32(POSITION_SLACK);
        let bound_radius = v.vset_f32(self.bound_radius);
        let bound_radius = v.vmadd(farthest, slack, bound_radius);
        store_first(v, self.totals.field(field!(FaceTotals.bound_radius)), only, bound_radius);
    }
}

impl Grids {
    /// Stores a parameter of the faces in `live`.
    #[inline(always)]
    fn store<V: Vpu>(&self, v: &mut V, live: V::Mask, field: Field<FaceParameters, f32>, value: V::F32) {
        let first = v.s_imm(0);
        v.vstore_f32(live, self.parameters.column(field), first, value);
    }

    /// Stores a parameter of the faces in `live` that is an integer.
    #[inline(always)]
    fn store_int<V: Vpu>(&self, v: &mut V, live: V::Mask, field: Field<FaceParameters, i32>, value: V::I32) {
        let first = v.s_imm(0);
        v.vstore_i32(live, self.parameters.column(field), first, value);
    }
}

/// How much wider than their receivers grids are, so that rounding puts none of them outside.
pub(crate) const WIDER: f32 = 1.001;

/// Width of grids over `low..high`, `wider` times as much.
#[inline(always)]
pub(crate) fn extent<V: Vpu>(v: &mut V, low: V::F32, high: V::F32, wider: f32) -> V::F32 {
    let wider = v.vset_f32(wider);
    let least = v.vset_f32(1e-6);
    let size = v.vsub(high, low);
    let size = v.vmul(size, wider);
    let (low, high) = (v.vabs(low), v.vabs(high));
    let far = v.vmax(low, high);
    let least = v.vmadd(far, least, least);
    v.vmax(size, least)
}

/// Geometric mean.
#[inline(always)]
fn mean<V: Vpu>(v: &mut V, a: V::F32, b: V::F32) -> V::F32 {
    let product = v.vmul(a, b);
    math::sqrt(v, product)
}

/// Writes the places of the bins of a group.
struct BinPlaces {
    parameters: Columns<FaceParameters>,
    bin_places: Columns<BinPlace>,
}

impl Kernel for BinPlaces {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, group: V::S32) {
        let BinPlaces { parameters, bin_places } = self;
        // The face: the one whose groups the group is of.
        let faces = v.s_imm((1 << FACES) - 1);
        let faces = v.kmov_from_scalar(faces);
        let none = v.vset_i32(0);
        let first_face = v.s_imm(0);
        let [first, end] = each!(end in [0, 1] => {
            let column = parameters.column(field!(FaceParameters.groups[end]));
            v.vload_i32_or(none, faces, column, first_face)
        });
        let number = v.vsplat(group);
        let own = v.vicmp_ge_masked(faces, number, first);
        let own = v.vicmp_gt_masked(own, end, number);
        let own = v.kmov_to_scalar(own);
        let face = v.s_tzcnt(own);

        // Column and line of each bin in the face's grid.
        let lane = v.viota();
        let four = v.vset_i32(CHILDREN.trailing_zeros() as i32);
        let bin = int!(v, (number << four) + lane);
        let first_bin = v.vbroadcast_i32(parameters.column(field!(FaceParameters.first_bin)), face);
        let bins_x = v.vbroadcast_i32(parameters.column(field!(FaceParameters.bins_x)), face);
        let in_face = int!(v, bin - first_bin);
        // Half a bin from where lines end: far more than what f32 makes of millions of bins.
        let half = v.vset_f32(0.5);
        let middle = v.vcvt_i32_f32(in_face);
        let middle = v.vadd(middle, half);
        let width = v.vcvt_i32_f32(bins_x);
        let line = math::div(v, middle, width);
        let line = v.vcvt_f32_i32(line);
        let column = int!(v, in_face - (line * bins_x));

        let all = v.mask_all();
        let first = scalar!(v, group << { CHILDREN.trailing_zeros() as i32 });
        let face_number = v.vsplat(face);
        v.vstore_i32(all, bin_places.column(field!(BinPlace.face)), first, face_number);
        let sixteen = v.vset_f32(16.0);
        for (axis, corner) in [column, line].into_iter().enumerate() {
            let per_cell = v.vbroadcast_f32(parameters.column(field!(FaceParameters.per_cell[axis])), face);
            let origin = v.vbroadcast_f32(parameters.column(field!(FaceParameters.origin[axis])), face);
            let cell = v.vrcp(per_cell);
            let bin = v.vmul(cell, sixteen);
            let corner = v.vcvt_i32_f32(corner);
            let low = v.vmadd(corner, bin, origin);
            v.vstore_f32(all, bin_places.column(field!(BinPlace.low[axis])), first, low);
        }
    }
}

/// Positions of the 16 receivers from `i` on, from their viewpoint; asks for those of the next vector.
#[inline(always)]
pub(crate) fn load_positions<V: Vpu>(
    v: &mut V,
    constants: &Constants<V>,
    receivers: &Receivers,
    live: V::Mask,
    i: V::S32,
) -> Vec3<V> {
    let point = each!(axis in [0, 1, 2] => {
        let column = receivers.columns.column(field!(Receiver.position[axis]));
        v.prefetch_l1(column.plus_lines(1), i);
        v.vload_f32_or(constants.one, live, column, i)
    });
    receivers.viewpoint.see(v, live, point)
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
