//! lrbsim: a Larrabee-style many-core simulator, and the soft-shadow workload it was built to time.
//!
//! This crate is the driver: it brings scenes, kernels and machines together and writes down what came out.
//!
//! ```no_run
//! use lrbsim::{HostOptions, Machine, RunRequest, progress::Quiet, run_frame};
//!
//! let request = RunRequest {
//!     scene: lrbsim::inputs::scene("tiny")?,
//!     machine: Machine::load("larrabee-24", &["cores=8".parse()?])?,
//!     algorithm: lrbsim::Algorithm::default(),
//!     fidelity: lrbsim_machine::Fidelity::Windowed,
//!     warm_frames: 0,
//!     reference: None,
//!     host: HostOptions::default(),
//! };
//! let output = run_frame(&request, &Quiet)?;
//! println!("{}", lrbsim_reports::table::render(&output.report));
//! # Ok::<(), lrbsim::BadInput>(())
//! ```

mod algorithm;
pub mod choices;
mod engine;
mod error;
pub mod fidelity;
mod frame;
pub mod frames;
mod host;
pub mod inputs;
mod json;
mod made;
pub mod profile;
pub mod progress;
pub mod published;
pub mod reference;
pub mod results;
mod settings;
pub mod stability;
pub mod study;
pub mod table3;
pub mod validate;
pub mod written;

pub use algorithm::Algorithm;
pub use error::BadInput;
pub use frame::{Frame, HostOptions, RunOutput, RunRequest, SEMANTICS, run_frame};
pub use inputs::Machine;
pub use reference::ReferenceRequest;
pub use settings::Setting;
