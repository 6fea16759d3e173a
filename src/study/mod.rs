//! Studies: a base run, axes, and many points, each stored under a hash of everything that determines it.
//!
//! ```text
//! study file ─► points ─► recipes ─► keys ─► cache hit?  ─► report
//!                                     └► worker: admitted by memory, one host thread ─► cache ─► report
//! ```

mod cache;
mod file;
mod forecast;
mod memory;
mod points;
mod recipe;
mod run;

use std::path::{Path, PathBuf};

pub use cache::Cache;
pub use file::{Study, builtin_study_names};
pub use forecast::Forecast;
pub use recipe::Recipe;
pub(crate) use run::said;
pub use run::{Options, Status, StudyOutput, StudyProgress, run_study};

use lrbsim_reports::analysis::{Finding, findings, markdown};
use lrbsim_reports::files::ResultDir;
use lrbsim_reports::page;
use lrbsim_reports::study::StudyReport;

use crate::error::BadInput;
use crate::results::safe_name;

/// Default folder of a study's results.
pub fn default_dir(name: &str) -> PathBuf {
    Path::new("out").join(safe_name(&format!("study-{name}")))
}

/// The files of a study other than `study.json`, all drawn from it: names and bytes.
pub fn drawings(study: &StudyReport) -> Vec<(String, Vec<u8>)> {
    let findings = findings(study);
    let mut files = vec![("table.md".to_owned(), markdown(study, &findings).into_bytes())];
    files.extend(findings.iter().flat_map(Finding::files));
    files.push(("report.html".to_owned(), page::of_study(study).into_bytes()));
    files
}

/// Writes the results of a study to `dir`, `study.json` last, in place of the results there, and tells their paths.
pub fn write(dir: &Path, study: &StudyReport) -> Result<Vec<PathBuf>, BadInput> {
    let mut dir = ResultDir::open(dir)?;
    for (name, bytes) in drawings(study) {
        dir.stage(&name, &bytes)?;
    }
    dir.stage("study.json", study.to_json().as_bytes())?;
    Ok(dir.replace()?)
}
