//! What methods with an irregular shadow map share: receivers in the cells of a grid around the light, and for every cell
//! the primitives that can shadow them [johnson09, §2.2 and §2.5; algorithms, 1].
//!
//! ```text
//! receivers ──► grid: bounds ─► faces ─► streaks ─► nodes       samples in cell order, and a hierarchy over them
//!                                                     │
//! primitives ───────────────────────────────► bin: touch        lists of the bins
//!                                                     │
//!                                             raster: touch     records of the cells
//!                                                     │
//!                                                    run        equal shares of (samples x records), one a task
//! ```
//!
//! The hierarchy has sixteen children everywhere, a vector of them: a group holds bins, a bin blocks, a block cells; a cell
//! is cut into slices by depth.

pub mod primitives;
pub mod triangles;
pub mod silhouette;
pub mod receivers;
pub mod grid;
pub mod bounds;
pub mod faces;
mod streaks;
pub mod nodes;
pub mod touch;
pub mod bin;
pub mod raster;
pub mod run;

/// Cells of a block, blocks of a bin, bins of a group: one vector each, so that one test serves 16 of them.
pub const CHILDREN: u32 = 16;

/// Cells of a bin.
pub const BIN_CELLS: u32 = CHILDREN * CHILDREN;

/// Depth slices of a cell.
pub const SLICES: u32 = 4;

/// More than any coordinate, and farther than any receiver.
pub(crate) const FAR: f32 = 1e30;
