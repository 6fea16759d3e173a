//! The ISA layer of lrbsim: what a kernel is written against, and the stream of operations it leaves behind.
//!
//! ```text
//!            kernel (generic over Vpu)
//!                   │ operations of `vpu`
//!     ┌─────────────┼──────────────┐
//!  Scalar        Native         Recording      back ends: bit-equal results
//!  the definition host SIMD     host SIMD + a uop per operation
//!     └─────────────┴──────┬───────┘
//!                        Arena                 simulated memory, lines of 64 bytes
//! ```
//!
//! Function and timing are apart: a back end computes, and only a recording one leaves a [`Stream`] for a machine to
//! time.

pub mod arena;
pub mod backend;
mod claims;
pub mod emit;
pub mod examples;
pub mod functional;
pub mod host;
pub mod kernel;
pub mod lanes;
pub mod math;
pub mod options;
pub mod program;
mod record;
mod spill;
pub mod stream;
#[cfg(test)]
mod tests;
pub mod uop;
pub mod vpu;

pub use arena::{Addr, Arena, ArenaError, Line};
pub use emit::OpCounts;
pub use functional::{run_functional, skip_all};
pub use host::HostSimd;
pub use kernel::{AnyKernel, Kernel};
pub use program::{Ordering, Phase, Runner, Step, StepSource, Stopped, TaskSource};
pub use spill::VECTOR_REGISTERS;
pub use stream::{Place, Stream, StreamLine};
pub use uop::{Class, Uop};
pub use vpu::{Compare, Stacked, Vpu};
