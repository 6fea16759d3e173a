//! `lrbsim validate`.

use std::io::Write;
use std::path::PathBuf;

use clap::Args;
use lrbsim::validate::{Targets, ValidateRequest, validate, write as write_files};
use lrbsim::{BadInput, Machine, Setting};
use lrbsim_machine::Fidelity;
use lrbsim_reports::files::ResultDir;

use super::Failure;
use super::interrupt::on_interrupt;

#[derive(Debug, Args)]
pub(crate) struct ValidateArgs {
    /// A shipped machine or a machine file (.json).
    #[arg(short, long, default_value = "knc-5110p")]
    machine: PathBuf,

    /// Change one field of the machine; may be given again.
    #[arg(long = "set", value_name = "PATH=VALUE")]
    settings: Vec<String>,

    /// Published figures, in the format of configs/targets/knc_measured.json, instead of the shipped ones.
    #[arg(long, value_name = "FILE")]
    targets: Option<PathBuf>,

    /// Only rows whose id contains this.
    #[arg(long, value_name = "PATTERN")]
    only: Option<String>,

    /// How much of the machine is modeled: windowed or cycle.
    #[arg(long, value_name = "LEVEL", default_value = "windowed")]
    fidelity: String,

    /// Write validation.md, its plots and the summary that reports carry to this folder too.
    #[arg(short, long, value_name = "DIR")]
    out: Option<PathBuf>,

    /// Print the rows as JSON on standard output, and nothing else there.
    #[arg(long)]
    json: bool,
}

/// Runs the benchmarks; false when a row that must pass does not.
pub(crate) fn run(args: &ValidateArgs, out: &mut impl Write) -> Result<bool, Failure> {
    on_interrupt(|| ());
    let fidelity: Fidelity = args.fidelity.parse().map_err(BadInput::from)?;
    if !fidelity.is_timed() {
        return Err(
            BadInput::new("`--fidelity functional` has no times; it must be windowed or cycle").into()
        );
    }
    let machine = Machine::load(&args.machine, &Setting::all(&args.settings)?)?;
    let targets = args.targets.as_deref().map_or_else(|| Ok(Targets::shipped()), Targets::load)?;
    // Before the long run.
    let folder = args.out.as_deref().map(ResultDir::open).transpose().map_err(BadInput::from)?;
    let request = ValidateRequest { machine, targets, only: args.only.clone(), fidelity };
    let result = validate(&request)?;
    if let Some(folder) = folder {
        write_files(&result, &request.machine, folder)?;
    }
    if args.json {
        let text = serde_json::to_string_pretty(&result).expect("rows have string keys and finite numbers");
        writeln!(out, "{text}")?;
    } else {
        write!(out, "{}", result.table())?;
        for row in result.failures() {
            writeln!(out, "missed: {}", row.id)?;
        }
    }
    Ok(result.failures().next().is_none())
}
