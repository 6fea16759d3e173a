//! Results of lrbsim: one typed report, many writers.
//!
//! ```text
//! RunReport ─► report.json        the whole result; everything else is drawn from it
//!           └► table              terminal text, as Table 2 of Johnson et al. 2009
//! picture   ─► image.png, visibility.png, the hash that names a picture
//! npy       ─► dumps
//! Validation ─► rows of published and simulated figures
//! files     ─► all of them appear whole, or not at all
//! ```
//!
//! Nothing here runs a simulation, and nothing but [`files`] touches the file system.

pub mod counters;
pub mod files;
#[cfg(test)]
mod golden;
pub mod host;
pub mod npy;
pub mod picture;
pub mod run;
#[cfg(test)]
mod sample;
pub mod table;
pub mod validation;

pub use host::HostReport;
pub use run::RunReport;
