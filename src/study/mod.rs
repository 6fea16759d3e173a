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

pub use cache::{Cache, SEMANTICS};
pub use file::{Study, builtin_study_names};
pub use forecast::Forecast;
pub use recipe::Recipe;
pub use run::{Options, Progress, Status, StudyOutput, run_study};

use lrbsim_reports::analysis::{Finding, findings, markdown};
use lrbsim_reports::files::write_with_temporary;
use lrbsim_reports::page;
use lrbsim_reports::study::StudyReport;

use crate::error::BadInput;
use crate::lock::Lock;
use crate::results::safe_name;

/// Default folder of a study's results.
pub fn default_dir(name: &str) -> PathBuf {
    Path::new("out").join(safe_name(&format!("study-{name}")))
}

/// The files of a study other than `study.json`, all drawn from it: names and bytes.
pub fn drawings(study: &StudyReport) -> Vec<(String, Vec<u8>)> {
    let findings = findings(study);
    let mut files = vec![("table.md".to_owned(), markdown(study, &findings).into_bytes())];
    for Finding { name, sheet, plot, .. } in &findings {
        files.push((format!("{name}.csv"), sheet.csv().into_bytes()));
        if let Some(plot) = plot {
            files.push((format!("{name}.svg"), plot.svg().into_bytes()));
            files.push((format!("{name}.png"), plot.png()));
        }
    }
    files.push(("report.html".to_owned(), page::of_study(study).into_bytes()));
    files
}

/// Writes the results of a study to `dir`, `study.json` last, and tells their paths.
///
/// Two studies may write to one folder: the second waits for the first. What a killed one left half is written over.
pub fn write(dir: &Path, study: &StudyReport) -> Result<Vec<PathBuf>, BadInput> {
    let cannot =
        |error: std::io::Error| BadInput::new(format!("cannot write to `{}`: {error}", dir.display()));
    std::fs::create_dir_all(dir).map_err(cannot)?;
    let _lock = Lock::wait(&dir.join(".lock")).map_err(cannot)?;
    let mut files = drawings(study);
    files.push(("study.json".to_owned(), study.to_json().into_bytes()));
    let mut paths = Vec::new();
    for (name, bytes) in files {
        let path = dir.join(&name);
        write_with_temporary(&path, &dir.join(format!(".{name}.partial")), &bytes)?;
        paths.push(path);
    }
    Ok(paths)
}
