//! `study stability`: how right pictures stay where numbers get hard.
//!
//! ```text
//! families ─► scene ─► refused: what the program says is the result
//!               ├─► sums of parts, functionally ─► judge ◄─ brute force in f64
//!               └─► default algorithm, functionally ─► judge ◄─ shadow rays
//! ```
//!
//! Other studies are a product of axes over one scene; this one is a list of small scenes that are made for it.

mod families;
mod judge;

use std::panic::AssertUnwindSafe;
use std::path::{Path, PathBuf};

use lrbsim_reports::page;
use lrbsim_reports::stability::{
    Outcome, STABILITY_SCHEMA_VERSION, StabilityFamily, StabilityPoint, StabilityReport,
};

use crate::algorithm::Algorithm;
use crate::error::BadInput;
use crate::frame::{HostOptions, SEMANTICS, on_host_threads};
use crate::made;
use crate::progress::Progress;
use crate::study::said;

use families::{FAMILIES, Family};

/// Name of the study, as `lrbsim study` takes it.
pub const NAME: &str = "stability";

/// Name of the file of its results.
pub const FILE: &str = "stability.json";

/// Names of the families of points, in order.
pub fn family_names() -> Vec<&'static str> {
    FAMILIES.iter().map(|family| family.id).collect()
}

/// What of the study is run, and how.
#[derive(Debug, Clone)]
pub struct StabilityRequest {
    /// Only families whose names contain this.
    pub only: Option<String>,
    /// Leaves out points that take long, and two of any three others but the last.
    pub quick: bool,
    /// How the host goes about it; changes no result.
    pub host: HostOptions,
}

/// Runs the study: every point of the families that were asked for, one after the other.
///
/// # Errors
/// If no family was asked for, or the host gives no threads.
pub fn run_stability(
    request: &StabilityRequest,
    progress: &dyn Progress,
) -> Result<StabilityReport, BadInput> {
    let asked = |family: &&Family| request.only.as_ref().is_none_or(|only| family.id.contains(only));
    let families: Vec<&Family> = FAMILIES.iter().filter(asked).collect();
    if families.is_empty() {
        let only = request.only.as_deref().unwrap_or_default();
        return Err(BadInput::new(format!(
            "`--only {only}` is in the name of no family of `{NAME}`; it must be in one of: {}",
            family_names().join(", ")
        )));
    }
    let points = |family: &'static Family| {
        let kept = |index: usize, x: f64| {
            !request.quick
                || !family.is_dear(x) && (index.is_multiple_of(3) || index + 1 == family.points.len())
        };
        family.points.iter().enumerate().filter(move |(index, x)| kept(*index, **x)).map(|(_, x)| *x)
    };
    let count: usize = families.iter().map(|family| points(family).count()).sum();
    progress.counted(NAME, u32::try_from(count).unwrap_or(u32::MAX));
    let algorithm = Algorithm::default();
    // Brute force sums parts: what is judged beside it is how well they are found.
    let sums: Algorithm = "sism:overlap=sum".parse().expect("it is one");
    let run = |family: &Family, x: f64| {
        let point = point(family, x, &algorithm, &sums, request.host);
        progress.one_done();
        point
    };
    let families = on_host_threads(request.host.threads, || {
        families
            .into_iter()
            .map(|family| StabilityFamily {
                id: family.id.to_owned(),
                title: family.title.to_owned(),
                axis: family.axis.to_owned(),
                varied: family.varied.to_owned(),
                meaning: family.meaning.to_owned(),
                points: points(family).map(|x| run(family, x)).collect(),
            })
            .collect()
    })?;
    Ok(StabilityReport {
        schema_version: STABILITY_SCHEMA_VERSION,
        lrbsim_version: env!("CARGO_PKG_VERSION").to_owned(),
        semantics: SEMANTICS,
        algorithm: algorithm.to_string(),
        sums: sums.to_string(),
        samples: judge::SAMPLES,
        families,
    })
}

/// One point: what came of it, whatever that is.
fn point(
    family: &Family,
    x: f64,
    algorithm: &Algorithm,
    sums: &Algorithm,
    host: HostOptions,
) -> StabilityPoint {
    let scene = match family.scene(x) {
        Ok(scene) => scene,
        Err(refusal) => return StabilityPoint { x, outcome: Outcome::Refused(refusal.to_string()) },
    };
    // A defect of the program that one point shows is that point's result; the others go on.
    let judged = std::panic::catch_unwind(AssertUnwindSafe(|| judge::judge(&scene, algorithm, sums, host)));
    let outcome = match judged {
        Ok(Ok(measured)) => Outcome::Measured(Box::new(measured)),
        Ok(Err(refusal)) => Outcome::Refused(refusal.to_string()),
        Err(panic) => Outcome::Failed(said(panic.as_ref()).to_owned()),
    };
    StabilityPoint { x, outcome }
}

/// The files of the study other than its results, all drawn from them: names and bytes.
pub fn drawings(report: &StabilityReport) -> Vec<(String, Vec<u8>)> {
    made::drawings("table.md", report.markdown(), &report.findings(), page::of_stability(report))
}

/// Writes the results of the study to `dir`, its JSON last, in place of the results there, and tells their paths.
pub fn write(dir: &Path, report: &StabilityReport) -> Result<Vec<PathBuf>, BadInput> {
    made::write(dir, &drawings(report), FILE, &report.to_json())
}
