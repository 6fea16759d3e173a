//! What the simulator asks of the computer that it runs on. No result depends on it, only host time does.

mod prefetch;
mod simd;

pub use prefetch::prefetch;
pub use simd::HostSimd;
