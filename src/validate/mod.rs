//! Microbenchmarks on a simulated machine against published measurements.
//!
//! ```text
//! targets.json ─ rows ─► suite: id → experiments and a formula ─► distinct experiments, each once, in parallel
//!                                                                      │ cycles, counters
//!                              reports::validation ◄─ rows with what was simulated
//! ```

mod experiment;
mod id;
mod latency;
mod suite;
mod targets;
mod throughput;

use std::collections::BTreeMap;

use lrbsim_machine::Fidelity;
use lrbsim_reports::files::ResultDir;
use lrbsim_reports::validation::{ModelError, Row, Validation, bandwidth_plot, latency_plot, scatter_plot};
use rayon::prelude::*;

use crate::error::BadInput;
use crate::inputs::Machine;

pub use experiment::{Experiment, Outcome};
pub use targets::{Target, Targets};

/// How far the model is from measured machines, as of the last validation that was written to `docs`.
pub fn model_error() -> ModelError {
    const WRITTEN: &str = include_str!("../../docs/validation-error.json");
    serde_json::from_str(WRITTEN).expect("`validate -o docs` wrote it")
}

/// Writes the page, its plots and the summary for reports to the folder `out`.
pub fn write(validation: &Validation, machine: &Machine, out: ResultDir) -> Result<(), BadInput> {
    let mut out = out;
    let summary = serde_json::to_string_pretty(&validation.model_error()).expect("fields have string keys");
    let files = [
        ("validation-scatter.svg", scatter_plot(validation).svg_without_font()),
        ("validation-bandwidth.svg", bandwidth_plot(validation).svg_without_font()),
        ("validation-latency.svg", latency_plot(validation).svg_without_font()),
        ("validation-error.json", summary + "\n"),
        ("validation.md", validation.markdown(&machine.config.sources)),
    ];
    for (name, text) in &files {
        out.stage(name, text.as_bytes())?;
    }
    out.add()?;
    Ok(())
}

/// What is compared with what.
#[derive(Debug, Clone)]
pub struct ValidateRequest {
    /// The machine that is validated.
    pub machine: Machine,
    /// The published figures that it is compared with.
    pub targets: Targets,
    /// Only rows whose id contains this.
    pub only: Option<String>,
    /// How much of the machine is modeled.
    pub fidelity: Fidelity,
}

/// Runs the benchmarks of all rows that are asked for.
pub fn validate(request: &ValidateRequest) -> Result<Validation, BadInput> {
    let ValidateRequest { machine, targets, only, fidelity } = request;
    let wanted: Vec<&Target> = targets
        .targets
        .iter()
        .filter(|t| only.as_ref().is_none_or(|only| t.id.contains(only.as_str())))
        .collect();
    if wanted.is_empty() {
        let only = only.as_deref().unwrap_or_default();
        return Err(BadInput::new(format!("no target's id contains `{only}`")).with_help(format!(
            "the first of {} targets is `{}`",
            targets.targets.len(),
            targets.first_id()
        )));
    }

    // Rows share experiments: each distinct one is run once.
    let plans: Vec<_> = wanted.iter().map(|target| suite::plan(target, targets, machine)).collect();
    let mut results: BTreeMap<&Experiment, Option<Result<Outcome, BadInput>>> = BTreeMap::new();
    for experiment in plans.iter().flatten().flat_map(|plan| &plan.experiments) {
        results.insert(experiment, None);
    }
    let mut open: Vec<_> = results.iter_mut().collect();
    // The longest first, so that none is left alone at the end.
    open.sort_by_key(|(experiment, _)| std::cmp::Reverse(experiment.weight()));
    open.par_iter_mut().with_max_len(1).for_each(|(experiment, result)| {
        **result = Some(experiment.run(machine, *fidelity));
    });

    let mut rows = Vec::new();
    for (target, plan) in wanted.iter().zip(&plans) {
        let row = match plan {
            Ok(plan) => {
                let mut outcomes = Vec::new();
                for experiment in &plan.experiments {
                    match results.get(experiment).and_then(Option::as_ref) {
                        Some(Ok(outcome)) => outcomes.push(outcome),
                        Some(Err(error)) => {
                            let at = format!("`{}`: {error}", target.id);
                            return Err(
                                BadInput::new(at).with_help("the machine does not stand this experiment")
                            );
                        }
                        None => unreachable!("every experiment was run"),
                    }
                }
                row(target, targets, Some((plan.value)(&outcomes)), plan.note())
            }
            Err(reason) => row(target, targets, None, reason.to_string()),
        };
        rows.push(row);
    }
    Ok(Validation::new(machine.config.name.clone(), fidelity.to_string(), rows))
}

fn row(target: &Target, targets: &Targets, simulated: Option<f64>, note: String) -> Row {
    Row {
        id: target.id.clone(),
        unit: target.unit.clone(),
        published: target.value,
        low: target.low,
        high: target.high,
        simulated,
        error_percent: simulated.map(|simulated| error_percent(target.value, simulated)),
        ok: simulated.is_some_and(|simulated| (target.low..=target.high).contains(&simulated)),
        must_pass: targets.must_pass.contains(&target.id),
        confidence: target.confidence.clone(),
        held_out: held_out(&target.id),
        note,
    }
}

/// How far `simulated` is from `published`, in percent of the latter.
fn error_percent(published: f64, simulated: f64) -> f64 {
    (simulated / published - 1.0) * 100.0
}

/// Whether the row may not be used to choose a parameter: a fifth of all rows, by a hash of the id (FNV-1a).
fn held_out(id: &str) -> bool {
    let hash = id.bytes().fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
    });
    hash.is_multiple_of(5)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn request(only: &str) -> ValidateRequest {
        ValidateRequest {
            machine: Machine::load("knc-5110p", &[]).expect("shipped"),
            targets: Targets::shipped(),
            only: Some(only.to_owned()),
            fidelity: Fidelity::Windowed,
        }
    }

    #[test]
    fn about_a_fifth_of_the_rows_is_held_out() {
        let targets = Targets::shipped();
        let held = targets.targets.iter().filter(|target| held_out(&target.id)).count();
        assert!((40..=67).contains(&held), "{held} of {}", targets.targets.len());
    }

    #[test]
    fn nearly_all_rows_of_high_confidence_are_expressed() {
        let (targets, machine) = (Targets::shipped(), request("").machine);
        let high = || targets.targets.iter().filter(|target| target.confidence == "high");
        let expressed = high().filter(|target| suite::plan(target, &targets, &machine).is_ok()).count();
        assert!(expressed * 10 >= high().count() * 9, "{expressed} of {}", high().count());
    }

    #[test]
    fn a_pattern_that_fits_nothing_is_bad_input() {
        let error = validate(&request("bw.mem.raed")).expect_err("no such row");
        assert!(error.to_string().contains("`bw.mem.raed`"), "{error}");
    }

    #[test]
    fn rows_come_out_in_the_order_of_the_file_and_repeat() {
        let first = validate(&request("issue.")).expect("sound");
        assert!(first.rows.len() > 10 && first.rows.iter().all(|row| row.simulated.is_some()));
        assert_eq!(first, validate(&request("issue.")).expect("sound"));
    }
}
