//! `lrbsim schema`.

use std::io::Write;

use clap::{Args, ValueEnum};
use lrbsim_machine::MachineConfig;
use lrbsim_reports::RunReport;
use lrbsim_workloads::SceneFile;
use schemars::schema_for;

use super::Failure;

#[derive(Debug, Args)]
pub(crate) struct SchemaArgs {
    /// Which file format.
    format: Format,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Format {
    /// A machine, as in configs/machines/*.json.
    Machine,
    /// A scene, as in configs/scenes/*.json.
    Scene,
    /// The result of a run, report.json.
    Report,
}

pub(crate) fn run(args: &SchemaArgs, out: &mut impl Write) -> Result<(), Failure> {
    let schema = match args.format {
        Format::Machine => schema_for!(MachineConfig),
        Format::Scene => schema_for!(SceneFile),
        Format::Report => schema_for!(RunReport),
    };
    let text = serde_json::to_string_pretty(&schema).expect("a schema has string keys");
    writeln!(out, "{text}")?;
    Ok(())
}
