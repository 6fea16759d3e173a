//! Shadow kernels, written once against the ISA layer and run by every back end.
//!
//! ```text
//! method.rs    what a method is, and the list of all
//! sism/        soft irregular shadow mapping (Johnson et al. 2009): silhouette, hard, soft, compose
//! shadow_map/  depth map of the light and percentage-closer filtering (Williams 1978, Reeves 1987)
//! pcss/        percentage-closer soft shadows (Fernando 2005)
//! penumbra_map/ penumbra maps (Wyman and Hansen 2003)
//! heidrich/    soft shadow maps for linear lights (Heidrich et al. 2000)
//! atty/         soft shadow maps by micro-patches (Atty et al. 2006)
//! raytrace/    distribution ray tracing (Cook et al. 1984)
//! irregular/   what methods with an irregular shadow map share: grid, bin, raster
//! map/         what methods with a regular shadow map share: layout, tiles, draw, look
//! scene.rs     the geometry of a frame in the arena
//! light.rs, segment.rs, rectangle.rs, plane.rs   the geometry of one receiver, one edge, one triangle
//! samples.rs   samples of the light
//! scan.rs      prefix sums
//! lists.rs     lists that many tasks fill
//! clear.rs     arrays that begin as zero
//! record.rs, columns.rs, expression.rs   how a kernel writes where things lie, and arithmetic on that
//! ```

mod expression;
pub mod record;
pub mod columns;
pub mod plane;
pub mod face;
pub mod light;
pub mod segment;
pub mod rectangle;
pub mod clear;
pub mod scan;
pub mod samples;
pub mod lists;
pub mod scene;
pub mod irregular;
pub mod map;
pub mod method;
pub mod sism;
pub mod shadow_map;
pub mod pcss;
pub mod penumbra_map;
pub mod heidrich;
pub mod atty;
pub mod raytrace;
pub mod sintorn;
