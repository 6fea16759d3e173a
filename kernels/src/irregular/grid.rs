//! Data structure construction: receivers into the cells of a perspective grid, one for each face of the light that
//! sees any; contiguous and cell-ordered, with the greatest depth of every cell, block, bin and group
//! [johnson09, §2.2].
//!
//! ```text
//! bounds ─► faces: grids ─► bin places ─► histogram ─► scan ─► scatter ─► nodes: cells ─► bins ─► groups
//! ```

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Addr, Runner, Step, Stopped, Vpu};

use super::SLICES;
use super::bounds;
use super::faces::Faces;
use super::nodes::Nodes;
use super::primitives::LightConstants;
use super::receivers::{Receiver, Receivers};
use super::streaks::{Histogram, Scatter, Streaks};
use crate::clear;
use crate::columns::Columns;
use crate::expression::scalar;
use crate::field;
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

/// The grid of a frame.
#[derive(Clone, Copy)]
pub struct Grid {
    /// The receivers that the cells hold.
    pub receivers: Receivers,
    /// Faces that see receivers, and their bins.
    pub faces: Faces,
    /// First sample of each key; one more than there are keys.
    pub key_starts: Addr,
    /// Receivers in the order of their keys, field by field.
    pub samples: Columns<Sample>,
    /// The hierarchy over the samples.
    pub nodes: Nodes,
}

impl Grid {
    /// Puts the receivers into cells: sizes the grids by their bounds, counts the receivers of each key, and moves them to
    /// their places. `light` bounds the penumbras that will be looked for.
    pub fn build(
        receivers: Receivers,
        light: &LightConstants,
        runner: &mut Runner<'_>,
    ) -> Result<Grid, Stopped> {
        let bounds = bounds::find(&receivers, runner)?;
        let faces = Faces::build(light, bounds, runner)?;

        let keys = u64::from(faces.cell_count() * SLICES);
        let [key_starts] = clear::zeroed(runner, [scan::padded(keys)])?;
        let scan = Scan::new(runner.arena, key_starts, keys);
        let streaks = Streaks::new(runner.arena, &receivers);
        let histogram = Histogram { receivers, faces, streaks, key_starts };
        runner.run(&Step::ordered("histogram", receivers.tasks(), histogram))?;
        scan.run(runner)?;

        let samples = Columns::overwritten(runner.arena, receivers.count);
        let scatter = Scatter { receivers, streaks, key_starts, samples };
        // SAFETY: each task writes the offsets of its own streaks; every receiver has a place of its own among the samples.
        runner.run(&unsafe { Step::independent("scatter", receivers.tasks(), scatter) })?;
        // From here on places are those of the samples.
        streaks.discard(runner.arena);
        receivers.columns.discard(runner.arena, field!(Receiver.position));

        let nodes = Nodes::build(&faces, key_starts, samples, runner)?;
        Ok(Grid { receivers, faces, key_starts, samples, nodes })
    }

    /// The first samples of the keys after `cells` cells more: where a cell's samples begin, for the word `cell << 2`.
    #[inline(always)]
    pub const fn cell_starts(&self, cells: u32) -> Addr {
        cell_starts(self.key_starts, cells)
    }
}

/// Where, among the first samples of the keys at `key_starts`, those of the keys after `cells` cells more begin.
#[inline(always)]
pub(super) const fn cell_starts(key_starts: Addr, cells: u32) -> Addr {
    key_starts.plus_words((cells * SLICES) as u64)
}

/// Words from the first column of `samples` to the one that holds their depths on `face`, but for the sign.
#[inline(always)]
pub(super) fn depths_of_face<V: Vpu>(v: &mut V, samples: Columns<Sample>, face: V::S32) -> V::S32 {
    scalar!(v, (face >> 1) * { samples.stride() as i32 })
}
