//! Commands and their options. What they do stands in the library; here is only how it is asked for and shown.

mod compare;
mod interrupt;
mod machine;
mod progress;
mod report;
mod run;
mod scene;
mod schema;
mod study;
mod validate;
mod verify;
mod worker;

use std::io::{self, Write};
use std::process::ExitCode;

use clap::error::ErrorKind;
use clap::{Parser, Subcommand};
use lrbsim::BadInput;
use lrbsim_workloads::{Adjacency, Scene};

/// Exit code for a check that failed: a comparison, a validation, a verification, or a study with points that have no
/// result.
const CHECK_FAILED: u8 = 1;

/// Exit code for bad input.
const BAD_INPUT: u8 = 2;

/// A Larrabee-style many-core simulator, and the soft-shadow workload it was built to time.
#[derive(Debug, Parser)]
#[command(name = "lrbsim", version, about, max_term_width = 100)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Run one frame: a timing table, report.json and a picture.
    Run(Box<run::RunArgs>),
    /// Run a study: many points, a table, plots and a page.
    Study(study::StudyArgs),
    /// Compute a shard of a planned study: what a cluster runs.
    StudyWorker(worker::WorkerArgs),
    /// Compare two runs or two studies: what changed, by phase and cause.
    Compare(compare::CompareArgs),
    /// Draw report.html, tables and plots of earlier results again, without a simulation.
    Report(report::ReportArgs),
    /// Run published results again and check them bit for bit.
    Verify(verify::VerifyArgs),
    /// Look at machines.
    #[command(subcommand)]
    Machine(machine::MachineCommand),
    /// Look at scenes.
    #[command(subcommand)]
    Scene(scene::SceneCommand),
    /// Run microbenchmarks and compare them with published measurements.
    Validate(validate::ValidateArgs),
    /// Print the JSON Schema of a file format.
    Schema(schema::SchemaArgs),
}

/// Why a command ended early.
enum Failure {
    Input(BadInput),
    Output(io::Error),
    /// A worker could not go on; somebody may start it again.
    Early(BadInput),
}

impl From<BadInput> for Failure {
    fn from(error: BadInput) -> Failure {
        Failure::Input(error)
    }
}

impl From<io::Error> for Failure {
    fn from(error: io::Error) -> Failure {
        Failure::Output(error)
    }
}

/// Runs the command line of this process.
pub(crate) fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) if error.kind() == ErrorKind::InvalidUtf8 => return complain(not_text()),
        Err(error) => error.exit(),
    };
    let out = &mut io::stdout().lock();
    let done = match cli.command {
        Command::Run(args) => run::run(&args, out).map(|()| true),
        Command::Study(args) => study::run(&args, out),
        Command::StudyWorker(args) => worker::run(&args, out).map(|()| true),
        Command::Compare(args) => compare::run(&args, out),
        Command::Report(args) => report::run(&args, out).map(|()| true),
        Command::Validate(args) => validate::run(&args, out),
        Command::Verify(args) => verify::run(&args, out),
        Command::Machine(command) => machine::run(&command, out).map(|()| true),
        Command::Scene(command) => scene::run(&command, out).map(|()| true),
        Command::Schema(args) => schema::run(&args, out).map(|()| true),
    };
    match done.and_then(|passed| Ok(out.flush().map(|()| passed)?)) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(CHECK_FAILED),
        // Whoever read the output has seen enough, as `head` does.
        Err(Failure::Output(error)) if error.kind() == io::ErrorKind::BrokenPipe => ExitCode::SUCCESS,
        Err(Failure::Output(error)) => {
            complain(BadInput::new(format!("cannot write to standard output: {error}")))
        }
        Err(Failure::Input(error)) => complain(error),
        Err(Failure::Early(error)) => {
            complain(error);
            ExitCode::from(worker::STOPPED_EARLY)
        }
    }
}

/// What to say of arguments that must be text and are not; clap does not name them.
fn not_text() -> BadInput {
    let arguments: Vec<String> = std::env::args_os()
        .filter(|argument| argument.to_str().is_none())
        .map(|argument| format!("`{}`", argument.display()))
        .collect();
    BadInput::new(format!("not UTF-8 text: {}", arguments.join(", ")))
        .with_help("only names of files and folders may be anything else")
}

/// Tells on standard error what is odd about a scene.
fn warn(scene: &Scene) {
    for warning in scene.warnings(&Adjacency::new(&scene.mesh)) {
        say(&format!("warning: {warning}"));
    }
}

/// Says a line on standard error, in one piece: others may write to the same log.
fn say(line: &str) {
    // Nobody may be reading, or the disk is full; what is computed is the same.
    let _ = io::stderr().write_all(format!("{line}\n").as_bytes());
}

/// Shows what is wrong, on standard error.
fn complain(error: BadInput) -> ExitCode {
    // Lines are not wrapped: a message stays one line, for people who search it and programs that read it.
    let _ =
        miette::set_hook(Box::new(|_| Box::new(miette::MietteHandlerOpts::new().wrap_lines(false).build())));
    say(&format!("{:?}", miette::Report::new(error)));
    ExitCode::from(BAD_INPUT)
}
