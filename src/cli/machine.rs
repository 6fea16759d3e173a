//! `lrbsim machine`.

use std::io::Write;
use std::path::PathBuf;

use clap::Subcommand;
use lrbsim::{Machine, Setting};
use lrbsim_machine::builtin_machine_names;

use super::Failure;

#[derive(Debug, Subcommand)]
pub(crate) enum MachineCommand {
    /// List the shipped machines.
    List,
    /// Print a machine with every default filled in, as JSON.
    Show {
        /// A shipped machine or a machine file (.json).
        machine: PathBuf,
        /// Change one field of the machine; may be given again.
        #[arg(long = "set", value_name = "PATH=VALUE")]
        settings: Vec<String>,
    },
    /// Check a machine file.
    Check {
        /// A machine file (.json) or a shipped machine.
        machine: PathBuf,
    },
}

pub(crate) fn run(command: &MachineCommand, out: &mut impl Write) -> Result<(), Failure> {
    match command {
        MachineCommand::List => {
            for name in builtin_machine_names() {
                writeln!(out, "{name:14} {}", summary(&Machine::load(name, &[])?))?;
            }
        }
        MachineCommand::Show { machine, settings } => {
            let machine = Machine::load(machine, &Setting::all(settings)?)?;
            let text =
                serde_json::to_string_pretty(&machine.config).expect("a configuration has string keys");
            writeln!(out, "{text}")?;
        }
        MachineCommand::Check { machine: name } => {
            let machine = Machine::load(name, &[])?;
            writeln!(out, "{}: sound: {}", name.display(), summary(&machine))?;
        }
    }
    Ok(())
}

fn summary(machine: &Machine) -> String {
    let config = &machine.config;
    let ideal = if config.ideal.memory { ", no memory system" } else { "" };
    format!(
        "{} cores at {} GHz, {} threads each, L1D {} KiB, L2 {} KiB, {} GB/s{ideal}",
        config.cores,
        config.clock_ghz,
        config.threads_per_core,
        config.l1d.capacity_bytes / 1024,
        config.l2.capacity_bytes / 1024,
        config.memory.bandwidth_gb_per_s,
    )
}
