//! `lrbsim schema`.

use std::io::Write;

use clap::{Args, ValueEnum};
use lrbsim::choices;
use lrbsim_machine::MachineConfig;
use lrbsim_reports::fidelity::{FidelityReport, FidelitySeconds};
use lrbsim_reports::frames::FramesReport;
use lrbsim_reports::stability::StabilityReport;
use lrbsim_reports::study::{StudyFile, StudyHosts, StudyReport};
use lrbsim_reports::table3::Table3Report;
use lrbsim_reports::{HostReport, RunReport, dictionary};
use lrbsim_workloads::SceneFile;
use schemars::schema_for;
use serde_json::Value;

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
    /// A study, as in configs/studies/*.json.
    Study,
    /// The result of a run, report.json.
    Report,
    /// What a run cost the host, host.json.
    Host,
    /// The result of a study, study.json.
    StudyReport,
    /// What a study cost the hosts that ran it, host.json.
    StudyHosts,
    /// The result of `study stability`, stability.json.
    Stability,
    /// The result of `study table3`, table3.json.
    Table3,
    /// The result of `study fidelity`, fidelity.json.
    Fidelity,
    /// What `study fidelity` took of the host, prices.json.
    Prices,
    /// The frames of a moving scene, frames.json.
    Frames,
    /// Every number of a report with its unit and meaning, as Markdown.
    Counters,
}

pub(crate) fn run(args: &SchemaArgs, out: &mut impl Write) -> Result<(), Failure> {
    let schema = match args.format {
        Format::Machine => schema_for!(MachineConfig),
        Format::Scene => schema_for!(SceneFile),
        Format::Study => {
            let mut schema = schema_for!(StudyFile).to_value();
            choices::narrow_study_schema(&mut schema);
            return print(&schema, out);
        }
        Format::Report => schema_for!(RunReport),
        Format::Host => schema_for!(HostReport),
        Format::StudyReport => schema_for!(StudyReport),
        Format::StudyHosts => schema_for!(StudyHosts),
        Format::Stability => schema_for!(StabilityReport),
        Format::Table3 => schema_for!(Table3Report),
        Format::Fidelity => schema_for!(FidelityReport),
        Format::Prices => schema_for!(FidelitySeconds),
        Format::Frames => schema_for!(FramesReport),
        Format::Counters => {
            out.write_all(dictionary::markdown().as_bytes())?;
            return Ok(());
        }
    };
    print(schema.as_value(), out)
}

fn print(schema: &Value, out: &mut impl Write) -> Result<(), Failure> {
    let text = serde_json::to_string_pretty(schema).expect("a schema has string keys");
    writeln!(out, "{text}")?;
    Ok(())
}
