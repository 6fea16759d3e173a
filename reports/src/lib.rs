//! Results of lrbsim: one typed report, many writers.
//!
//! ```text
//! RunReport ─► report.json        the whole result; everything else is drawn from it
//!           └► table              terminal text, as Table 2 of Johnson et al. 2009
//! StudyReport ─► study.json     everything that came out of a study
//!           └► digest           what is kept of it in memory ─► analysis: tables and plots, page
//! StabilityReport ─► stability.json, tables and plots of it
//! Table3Report ─► table3.json, tables and plots of it
//! FidelityReport ─► fidelity.json, tables and plots of it
//! picture   ─► image.png, visibility.png, the hash that names a picture
//! npy       ─► dumps
//! Validation ─► rows of published and simulated figures
//! files     ─► all of them appear whole, or not at all
//! ```
//!
//! Nothing here runs a simulation, and nothing but [`files`] touches the file system.

pub mod analysis;
pub mod animation;
pub mod base64;
pub mod compare;
pub mod counters;
pub mod dictionary;
pub mod digest;
pub mod fidelity;
pub mod files;
pub mod frames;
#[cfg(test)]
mod golden;
pub mod host;
pub mod lock;
pub mod metric;
pub mod npy;
pub mod page;
pub mod picture;
pub mod plot;
pub mod run;
#[cfg(test)]
mod sample;
pub mod sheet;
pub mod stability;
pub mod study;
pub mod table;
pub mod table3;
pub mod validation;

pub use digest::Digest;
pub use host::HostReport;
pub use run::RunReport;
