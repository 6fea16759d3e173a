//! Data structure construction: receivers into the cells of a perspective grid, one for each face of the light that
//! sees any; contiguous and cell-ordered, with the greatest depth of every cell, block, bin and group
//! [johnson09, §2.2].
//!
//! ```text
//! bounds ─► (host: size of each face's grid) ─► histogram ─► scan ─► scatter ─► nodes: cells ─► bins ─► groups
//! ```

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Addr, Arena, Step, Vpu};

use super::SLICES;
use super::bounds::Bounds;
use super::faces::Faces;
use super::nodes::Nodes;
use super::receivers::Receivers;
use super::streaks::{Histogram, Scatter, Streaks};
use crate::columns::Columns;
use crate::expression::scalar;
use crate::scan::{self, Scan};

/// A receiver in its cell. What is needed of a receiver but once stays where it was: every column that is moved to its cells
/// is read, fetched and written back, and the bandwidth of memory is what moving waits for.
#[repr(C)]
pub struct Sample {
    /// Where the sample lies, light-centred.
    pub position: [f32; 3],
    /// Number of the receiver that the sample is.
    pub receiver: u32,
}

/// The grid of a frame; filled by the steps of the phase `grid`, in the order of its fields.
#[derive(Clone, Copy)]
pub struct Grid {
    /// The receivers that the cells hold.
    pub receivers: Receivers,
    /// Bounds of the receivers by face.
    pub(super) bounds: Bounds,
    /// Faces that see receivers, and their bins.
    pub faces: Faces,
    /// First sample of each key; one more than there are keys.
    pub key_starts: Addr,
    /// The prefix sum of the keys.
    pub scan: Scan,
    /// Receivers of one key that follow one another.
    pub(super) streaks: Streaks,
    /// Receivers in the order of their keys, field by field.
    pub samples: Columns<Sample>,
    /// The hierarchy over the samples.
    pub nodes: Nodes,
}

impl Grid {
    /// The grid of `receivers`, of which nothing is known yet.
    pub fn new(receivers: Receivers) -> Grid {
        Grid {
            receivers,
            bounds: Bounds::default(),
            faces: Faces::default(),
            key_starts: Addr(0),
            scan: Scan::default(),
            streaks: Streaks::default(),
            samples: Columns::default(),
            nodes: Nodes::default(),
        }
    }

    /// The first samples of the keys after `cells` cells more: where a cell's samples begin, for the word `cell << 2`.
    #[inline(always)]
    pub const fn cell_starts(&self, cells: u32) -> Addr {
        self.key_starts.plus_words((cells * SLICES) as u64)
    }

    /// Words from the first column of samples to the one that holds their depths on `face`, but for the sign.
    #[inline(always)]
    pub fn depths_of_face<V: Vpu>(&self, v: &mut V, face: V::S32) -> V::S32 {
        scalar!(v, (face >> 1) * { self.samples.stride() as i32 })
    }
}

/// Sizes the grids, then counts the receivers of each key.
pub fn count(grid: &mut Grid, arena: &mut Arena) -> Step {
    grid.faces = Faces::new(arena, &grid.bounds);
    let keys = u64::from(grid.faces.cell_count() * SLICES);
    grid.key_starts = arena.alloc(scan::padded(keys));
    grid.scan = Scan::new(arena, grid.key_starts, keys);
    grid.streaks = Streaks::new(arena, &grid.receivers);
    Step::ordered("histogram", grid.receivers.tasks(), Histogram(*grid))
}

/// Moves the receivers to their places among the samples.
pub fn scatter(grid: &mut Grid, arena: &mut Arena) -> Step {
    grid.samples = Columns::new(arena, grid.receivers.count);
    // SAFETY: each task writes the offsets of its own streaks; every receiver has a place of its own among the samples.
    unsafe { Step::independent("scatter", grid.receivers.tasks(), Scatter(*grid)) }
}
