//! Shadow kernels, written once against the ISA layer and run by every back end.
//!
//! ```text
//! method.rs    what a method is, and the list of all
//! sism/        soft irregular shadow mapping (Johnson et al. 2009): silhouette, hard, soft, compose
//! irregular/   what methods with an irregular shadow map share: grid, bin, raster
//! scene.rs     the geometry of a frame in the arena
//! light.rs, segment.rs, rectangle.rs, plane.rs   the geometry of one receiver, one edge, one triangle
//! scan.rs      prefix sums
//! clear.rs     arrays that begin as zero
//! record.rs, columns.rs, expression.rs   how a kernel writes where things lie, and arithmetic on that
//! ```

mod expression;
pub mod record;
pub mod columns;
pub mod plane;
pub mod light;
pub mod segment;
pub mod rectangle;
pub mod clear;
pub mod scan;
pub mod scene;
pub mod irregular;
pub mod method;
pub mod sism;
