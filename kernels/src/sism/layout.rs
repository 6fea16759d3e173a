//! Where everything of a frame lies in the arena.

use lrbsim_isa::{Addr, Arena};
use lrbsim_workloads::{Counting, ShadowInput};

use super::lists::Lists;
use crate::columns::Columns;
use crate::light::Disc;
use crate::plane::TRIANGLE_WORDS;

/// Cells of a block, blocks of a bin, bins of a group: one vector each, so that one test serves 16 of them.
pub const CHILDREN: u32 = 16;

/// Cells of a bin.
pub const BIN_CELLS: u32 = CHILDREN * CHILDREN;

/// Depth slices of a cell.
pub const SLICES: u32 = 4;

/// Faces around the light: +x, -x, +y, -y, +z, -z.
pub const FACES: u32 = 6;

/// Words of an edge's record: `0..3` and `3..6` the ends, `6..9` normal of the plane through the light, `9` and `10`
/// weights in F and B, `11` least distance from the light, `12` what is added before its part is rounded, `13` a bit for
/// each face that it can touch.
pub const EDGE_WORDS: u32 = 16;

/// Rounding of positions about a receiver, relative to the largest coordinate of receivers, with a factor of eight to spare.
const POSITION_SLACK: f32 = 1e-6;

/// Receivers of a task of `grid`: neighbors in the picture, along the curve.
pub const RECEIVERS_TASK: u32 = 1024;

/// Columns of the receivers, and of the samples: receivers in the order of cells.
pub const POSITION: u32 = 0;
/// Column of the triangle that a receiver lies on.
pub const OWN_TRIANGLE: u32 = 3;
/// Column of a receiver's pixel.
pub const PIXEL: u32 = 4;
/// Number of columns of receivers.
const RECEIVER_COLUMNS: u32 = 5;
/// Column of the receiver that a sample is. What is needed of it but once is looked up there: every column that is moved to
/// its cells is read, fetched and written back, and the bandwidth of memory is what moving waits for.
pub const RECEIVER: u32 = 3;
/// Number of columns of samples.
pub const SAMPLE_COLUMNS: u32 = 4;

/// Columns of nodes (cells, blocks, bins, groups): centre, half size, greatest depth, greatest `|p'|`.
pub const CENTER_X: u32 = 0;
/// Centre, second coordinate.
pub const CENTER_Y: u32 = 1;
/// Half size, first coordinate.
pub const HALF_X: u32 = 2;
/// Half size, second coordinate.
pub const HALF_Y: u32 = 3;
/// Greatest depth of a receiver inside; 0 where there is none.
pub const DEPTH: u32 = 4;
/// Greatest distance from the light of a point of the rectangle on the image plane.
pub const REACH: u32 = 5;
/// Number of columns of nodes.
pub const NODE_COLUMNS: u32 = 6;

/// The light, as constants of the kernels' code.
#[derive(Debug, Clone, Copy)]
pub struct LightConstants {
    /// Where its disc stands.
    pub disc: Disc,
    /// Radius, 0 for a point.
    pub radius: f32,
    /// Radius for the bound of a penumbra: larger by rounding, and for a disc that does not face the receivers.
    pub bound_radius: f32,
}

/// One of the six 90-degree views from the light, as the host lays out its grid.
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
    pub slice_depths: [f32; 3],
}

impl FaceGrid {
    /// Bins that it takes, whole groups.
    pub fn bins_padded(&self) -> u32 {
        (self.bins[0] * self.bins[1]).next_multiple_of(CHILDREN)
    }
}

/// Addresses and sizes of a frame: the immediates of the kernels.
#[derive(Debug, Clone, Copy)]
pub struct Layout {
    /// The light.
    pub light: LightConstants,
    /// Pixels of the picture.
    pub pixels: u32,

    /// x, y, z of the vertices.
    pub vertices: Columns,
    /// Corners and counting rule of the triangles.
    pub triangles: Columns,
    /// Number of triangles.
    pub triangle_count: u32,
    /// Ends of the edges.
    pub edges: Columns,
    /// Number of edges.
    pub edge_count: u32,
    /// First face of each edge, one more than there are edges.
    pub edge_first: Addr,
    /// `triangle << 1 | side` of the faces on edges.
    pub edge_faces: Addr,
    /// x, y, z, own triangle and pixel of the receivers, along a Hilbert curve through the picture.
    pub receivers: Columns,
    /// Number of receivers.
    pub receiver_count: u32,

    /// Records of the triangles, see [`crate::plane`].
    pub triangle_records: Addr,
    /// Weights of the edges: F in the low half, B in the high half.
    pub edge_weights: Addr,
    /// Number of silhouette edges; then a cursor.
    pub silhouette_counter: Addr,
    /// Edge of each silhouette.
    pub silhouettes: Addr,
    /// Number of silhouettes, once it is known.
    pub silhouette_count: u32,
    /// Records of the silhouettes, [`EDGE_WORDS`] each.
    pub edge_records: Addr,

    /// Bounds of the receivers lane by lane, by task and face: where tasks of `receiver bounds` work.
    pub lane_bounds: Addr,
    /// Bounds of the receivers by face and task.
    pub task_bounds: Addr,
    /// Bounds of the receivers by face.
    pub face_bounds: Addr,
    /// Parameters by face, a row of 8 words each; see `grid`.
    pub face_table: Addr,
    /// Faces that see receivers.
    pub faces: [FaceGrid; FACES as usize],
    /// How many of `faces` there are.
    pub face_count: u32,
    /// Face, and lower corner on the image plane, of each bin.
    pub bin_table: Columns,
    /// Bins of all faces, whole groups.
    pub bin_count: u32,
    /// Streaks of the receivers, task by task: key, and the place in the key one past its end.
    pub streaks: Columns,
    /// Number of streaks of each task.
    pub streak_totals: Addr,
    /// By vector of receivers: lanes in which a streak begins.
    pub streak_lanes: Addr,
    /// First sample of each key, `cell << 2 | slice`; one more than there are keys.
    pub key_starts: Addr,
    /// Receivers in the order of their keys.
    pub samples: Columns,
    /// The hierarchy over the samples.
    pub cells: Columns,
    /// Blocks of 16 cells.
    pub blocks: Columns,
    /// Bins of 16 blocks.
    pub bins: Columns,
    /// Groups of 16 bins.
    pub groups: Columns,

    /// Lists of the bins: triangles of all bins, then edges of all bins.
    pub bin_lists: Lists,
    /// What is in them: primitives.
    pub bin_items: Addr,
    /// Pieces of bin lists that tasks of `raster` take: bin, first, end.
    pub raster_tasks: Columns,
    /// Number of triangle pieces; number of all pieces; cursors.
    pub raster_counters: Addr,
    /// Number of pieces.
    pub raster_task_count: u32,
    /// Lists of the cells: records of triangles of all cells, then of edges of all cells.
    pub cell_lists: Lists,
    /// What is in them: records: primitive, least depth it can reach.
    pub records: Addr,

    /// Counters of the pieces of `hard` and `soft`.
    pub run_counters: Addr,
    /// Pieces of each block, hard and soft.
    pub block_pieces: Columns,
    /// Tasks of `hard`: block, piece, pieces.
    pub hard_runs: Columns,
    /// Tasks of `soft`.
    pub soft_runs: Columns,
    /// Layers in F and B, then coverage in F and B at 2^-24, of each sample.
    pub sums: Columns,
    /// Visible part of the light by pixel.
    pub visibility: Addr,
}

impl Layout {
    /// Copies the input of a frame into the arena (untimed) and makes room for what does not depend on results.
    pub fn new(input: &ShadowInput, arena: &mut Arena) -> Layout {
        let count = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
        let triangle_count = count(input.triangles.len());
        let edge_count = count(input.edges.len());
        let receiver_count = count(input.receivers.len());

        let vertices = Columns::new(arena, 3, count(input.vertices.len()));
        for axis in 0..3 {
            let values = input.vertices.iter().map(|p| p[axis].to_bits());
            fill(arena, vertices.column(axis as u32), values);
        }
        let triangles = Columns::new(arena, 4, triangle_count.next_multiple_of(CHILDREN));
        for corner in 0..3 {
            fill(arena, triangles.column(corner as u32), input.triangles.iter().map(|t| t[corner]));
        }
        fill(arena, triangles.column(3), input.counting.iter().map(|&rule| counted_words(rule)));
        let edges = Columns::new(arena, 2, edge_count);
        for end in 0..2 {
            fill(arena, edges.column(end as u32), input.edges.iter().map(|e| e[end]));
        }
        let edge_first = arena.alloc(u64::from(edge_count) + 17);
        fill(arena, edge_first, input.edge_first.iter().copied());
        let edge_faces = arena.alloc(input.edge_faces.len() as u64);
        fill(arena, edge_faces, input.edge_faces.iter().copied());

        let order = curve_order(input);
        let receivers = Columns::new(arena, RECEIVER_COLUMNS, receiver_count);
        for axis in 0..3 {
            let values = order.iter().map(|&i| input.receivers[i as usize][axis].to_bits());
            fill(arena, receivers.column(axis as u32), values);
        }
        let own = order.iter().map(|&i| input.receiver_triangle[i as usize]);
        fill(arena, receivers.column(OWN_TRIANGLE), own);
        let pixel = order.iter().map(|&i| input.receiver_pixel[i as usize]);
        fill(arena, receivers.column(PIXEL), pixel);

        let disc = input.light_normal.map_or(Disc::Facing, Disc::Fixed);
        // A disc that stands still lies in the ball of its radius; the line from p to v meets that ball only if
        // sin phi (1 - r/|p|) <= r (1/|v| - cos phi/|p|), and |p| > |v| > 2.5 r wherever the bound is used.
        let bound_radius =
            if disc == Disc::Facing { input.light_radius } else { input.light_radius * (5.0 / 3.0) };
        // The receiver is subtracted from the ends of an edge: they are rounded by its distance from the light, which for
        // ends near the light is as if the light were larger.
        let farthest = input.receivers.iter().flatten().fold(0.0_f32, |far, x| far.max(x.abs()));
        let bound_radius = bound_radius + POSITION_SLACK * farthest;
        let pixels = input.width * input.height;
        let empty = Columns::default();
        Layout {
            light: LightConstants { disc, radius: input.light_radius, bound_radius },
            pixels,
            vertices,
            triangles,
            triangle_count,
            edges,
            edge_count,
            edge_first,
            edge_faces,
            receivers,
            receiver_count,
            triangle_records: arena
                .alloc(u64::from(triangle_count.next_multiple_of(CHILDREN)) * u64::from(TRIANGLE_WORDS)),
            edge_weights: arena.alloc(u64::from(edge_count) + 16),
            silhouette_counter: arena.alloc(1),
            silhouettes: Addr(0),
            silhouette_count: 0,
            edge_records: Addr(0),
            lane_bounds: Addr(0),
            task_bounds: Addr(0),
            face_bounds: Addr(0),
            face_table: Addr(0),
            faces: [FaceGrid::default(); FACES as usize],
            face_count: 0,
            bin_table: empty,
            bin_count: 0,
            streaks: empty,
            streak_totals: Addr(0),
            streak_lanes: Addr(0),
            key_starts: Addr(0),
            samples: empty,
            cells: empty,
            blocks: empty,
            bins: empty,
            groups: empty,
            bin_lists: Lists::default(),
            bin_items: Addr(0),
            raster_tasks: empty,
            raster_counters: arena.alloc(16),
            raster_task_count: 0,
            cell_lists: Lists::default(),
            records: Addr(0),
            run_counters: arena.alloc(64),
            block_pieces: empty,
            hard_runs: empty,
            soft_runs: empty,
            sums: empty,
            visibility: arena.alloc(u64::from(pixels)),
        }
    }

    /// Tasks of the steps that go through the receivers.
    pub fn receiver_tasks(&self) -> u32 {
        self.receiver_count.div_ceil(RECEIVERS_TASK)
    }

    /// Cells of all bins.
    pub fn cell_count(&self) -> u32 {
        self.bin_count * BIN_CELLS
    }

    /// Blocks of all bins.
    pub fn block_count(&self) -> u32 {
        self.bin_count * CHILDREN
    }

    /// Whether the light has a penumbra at all.
    pub fn is_soft(&self) -> bool {
        self.light.radius > 0.0
    }
}

/// Layers of a triangle in F (bit 0) and B (bit 1): facing the light in the low half, facing away in the high half.
fn counted_words(rule: Counting) -> u32 {
    use crate::plane::{BACK, FRONT};
    let (toward, away) = match rule {
        Counting::Closed => (FRONT | BACK, 0),
        Counting::Shell => (FRONT, BACK),
        Counting::Sheet => (FRONT | BACK, FRONT | BACK),
    };
    (toward | away << 16) as u32
}

/// Writes `values` to consecutive words.
fn fill(arena: &mut Arena, to: Addr, values: impl Iterator<Item = u32>) {
    for (i, value) in values.enumerate() {
        arena.write_u32(to.plus(4 * i as u64), value);
    }
}

/// Order in which the eye view leaves its receivers: along a Hilbert curve through the picture, so that receivers that
/// follow one another share cells.
fn curve_order(input: &ShadowInput) -> Vec<u32> {
    let side = input.width.max(input.height).next_power_of_two();
    let mut order: Vec<u32> = (0..input.receivers.len() as u32).collect();
    order.sort_by_cached_key(|&i| {
        let pixel = input.receiver_pixel[i as usize];
        hilbert(side, pixel % input.width, pixel / input.width)
    });
    order
}

/// Place of a pixel on the Hilbert curve through a square; `side` is a power of two.
fn hilbert(side: u32, mut x: u32, mut y: u32) -> u64 {
    let mut place = 0;
    let mut half = side / 2;
    while half > 0 {
        let (right, upper) = (u32::from(x & half > 0), u32::from(y & half > 0));
        place = place << 2 | u64::from((3 * right) ^ upper);
        if upper == 0 {
            if right == 1 {
                (x, y) = (side - 1 - x, side - 1 - y);
            }
            (x, y) = (y, x);
        }
        half /= 2;
    }
    place
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_visits_every_pixel_and_steps_to_a_neighbor() {
        let side = 16;
        let mut curve: Vec<(u32, u32)> = (0..side * side).map(|i| (i % side, i / side)).collect();
        curve.sort_by_key(|&(x, y)| hilbert(side, x, y));
        let places: Vec<u64> = curve.iter().map(|&(x, y)| hilbert(side, x, y)).collect();
        assert_eq!(places, (0..u64::from(side * side)).collect::<Vec<_>>());
        for pair in curve.windows(2) {
            let steps = pair[0].0.abs_diff(pair[1].0) + pair[0].1.abs_diff(pair[1].1);
            assert_eq!(steps, 1, "{pair:?}");
        }
    }
}
