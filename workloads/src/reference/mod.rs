//! What shadows should look like, computed on the host in f64: the truths that kernels are compared with.
//!
//! * [`Truth`]: many shadow rays per receiver; right for any scene, with noise, whose size it tells.
//! * [`Occluders`]: the `exact` form of the soft irregular shadow map, every edge against every receiver, no grid.
//!   Kernels differ from it by rounding only; it differs from the rays by the method's own errors.
//! * [`AsPrinted`]: the printed form of the same, which differs from it by what the paper gives up.
//! * [`ErrorMetrics`]: how far one picture is from another.

mod hard;
mod metrics;
mod occluders;
mod printed;
mod rays;
mod segment;

#[cfg(test)]
mod cut_tests;
#[cfg(test)]
mod tests;

pub use hard::{HardHit, hard_test};
pub use metrics::ErrorMetrics;
pub use occluders::{ObjectRule, Occluders, Projection};
pub use printed::{AsPrinted, ImagePlane};
pub(crate) use rays::GOLDEN_ANGLE;
pub use rays::{Rays, Truth, shadow_rays, spiral};
pub use segment::{area_beyond, line_beyond, square_beyond};
