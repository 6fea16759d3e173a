//! Shadow kernels, written once against the ISA layer and run by every back end.
//!
//! ```text
//! sism/   soft irregular shadow mapping (Johnson et al. 2009): silhouette, grid, bin, raster, hard, soft, compose
//! light.rs, segment.rs, plane.rs   the geometry of one receiver, one edge, one triangle
//! columns.rs                       arrays side by side in the arena
//! ```

pub mod sism;

pub mod columns;
pub mod light;
pub mod plane;
pub mod scan;
pub mod segment;
