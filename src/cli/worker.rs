//! `lrbsim study-worker`.

use std::io::Write;
use std::path::PathBuf;

use clap::Args;
use lrbsim::BadInput;
use lrbsim::study::{Shard, Status, Stopped, StudyProgress, run_shard};
use lrbsim_reports::table::counted;

use super::interrupt::on_interrupt_exit;
use super::study::JOBS_MAX;
use super::{Failure, say};

/// Exit code of a worker that stopped before its shard was done: a "temporary failure", as `sysexits.h` has it.
pub(super) const STOPPED_EARLY: u8 = 75;

#[derive(Debug, Args)]
#[command(
    after_help = "Exit codes: 0 every point of the shard has a result or is known to have none, 2 the plan cannot be used, \
75 stopped early: start it again."
)]
pub(crate) struct WorkerArgs {
    /// Folder of the plan, as `lrbsim study export` names it.
    #[arg(long, value_name = "DIR")]
    plan: PathBuf,

    /// Number of the shard, from 0.
    #[arg(long, value_name = "K")]
    shard: usize,

    /// Host threads: so many points at once, or machines of points that share a functional run.
    #[arg(long, value_name = "N", default_value_t = 1)]
    threads: usize,

    /// Name of this node for host.json [default: the host's name].
    #[arg(long, value_name = "NAME")]
    node: Option<String>,
}

/// A line for each point, on standard error: a worker's output is its log.
pub(super) struct Log;

impl StudyProgress for Log {
    fn status(&self, _status: &Status) {}

    fn say(&self, text: &str) {
        say(text);
    }
}

pub(crate) fn run(args: &WorkerArgs, out: &mut impl Write) -> Result<(), Failure> {
    if !(1..=JOBS_MAX).contains(&args.threads) {
        let found = args.threads;
        return Err(BadInput::new(format!("`--threads` is {found}; it must be from 1 to {JOBS_MAX}")).into());
    }
    on_interrupt_exit(STOPPED_EARLY.into(), || {
        say("stopped by a signal; finished points are kept, the same command goes on");
    });
    let WorkerArgs { plan, shard, threads, node } = args;
    let shard = Shard { plan, number: *shard, threads: *threads, node: node.clone() };
    let tally = run_shard(&shard, &Log).map_err(|stopped| match stopped {
        Stopped::Refused(bad) => Failure::Input(bad),
        Stopped::Early(bad) => Failure::Early(bad),
    })?;
    let status = tally.status;
    let line = format!(
        "shard {} of {}: {}: {} run, {} found, {} failed; {:.1} s\n",
        shard.number,
        tally.shards,
        counted(status.points as u64, "point"),
        status.computed,
        status.found,
        status.failed,
        status.seconds
    );
    // The results are in their files, whether or not the log has room for this. As one piece, so that nothing of it is left
    // for the end of the program to write.
    let _ = out.write_all(line.as_bytes());
    Ok(())
}
