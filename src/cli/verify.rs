//! `lrbsim verify`.

use std::io::Write;
use std::path::PathBuf;

use clap::Args;
use lrbsim::BadInput;
use lrbsim::published::{abandon, folders, publish, verify};

use super::Failure;
use super::interrupt::on_interrupt;

#[derive(Debug, Args)]
pub(crate) struct VerifyArgs {
    /// A published result, its manifest, or a folder of published results.
    #[arg(default_value = "reports/published")]
    path: PathBuf,

    /// Publish what comes out instead of checking it.
    #[arg(long)]
    write: bool,

    /// With --write: the command of a new published result, such as -- run saloon-small -m larrabee-32.
    #[arg(last = true)]
    command: Vec<String>,
}

pub(crate) fn run(args: &VerifyArgs, out: &mut impl Write) -> Result<bool, Failure> {
    on_interrupt(abandon);
    if !args.command.is_empty() && !args.write {
        return Err(BadInput::new("a command is published with `--write` only").into());
    }
    let folders = if args.command.is_empty() { folders(&args.path)? } else { vec![args.path.clone()] };
    let mut passed = true;
    for folder in folders {
        let verdict = if args.write { publish(&folder, &args.command)? } else { verify(&folder)? };
        let word = match (args.write, verdict.faults.is_empty()) {
            (true, _) => "published",
            (false, true) => "the same",
            (false, false) => "NOT the same",
        };
        writeln!(out, "{}: {word}, {} files", folder.display(), verdict.same)?;
        for fault in &verdict.faults {
            writeln!(out, "  {fault}")?;
        }
        passed &= verdict.faults.is_empty();
    }
    Ok(passed)
}
