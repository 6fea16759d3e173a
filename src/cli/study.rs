//! `lrbsim study`.

use std::io::{IsTerminal as _, Write};
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::Mutex;

use clap::{Args, Subcommand, ValueEnum};
use indicatif::ProgressBar;
use lrbsim::fidelity::{self, FidelityRequest};
use lrbsim::progress::Stopwatch;
use lrbsim::reference::DEFAULT_CACHE;
use lrbsim::results::spare_inputs;
use lrbsim::stability::{self, StabilityRequest};
use lrbsim::study::{
    self, Options, SlurmOptions, Status, Study, StudyProgress, quoted, run_on_slurm, run_study,
};
use lrbsim::table3::{self, Table3Request};
use lrbsim::written::replaced_study;
use lrbsim::{Algorithm, BadInput, HostOptions};
use lrbsim_reports::analysis::{Finding, findings};
use lrbsim_reports::files::ResultDir;
use lrbsim_reports::table::counted;

use super::interrupt::on_interrupt;
use super::progress::{on_standard_error, style};
use super::worker::Log;
use super::{Failure, say};

/// Points at once at most: a host has no more threads.
pub(super) const JOBS_MAX: usize = 1024;

#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub(crate) struct StudyArgs {
    #[command(subcommand)]
    command: Option<StudyCommand>,

    #[command(flatten)]
    what: Option<What>,

    /// Host threads: so many points at once, or machines of points that share a functional run [default: the host's threads; 1 in each task of a cluster].
    #[arg(short, long, value_name = "N")]
    jobs: Option<usize>,

    /// Folder for the results [default: out/study-<name>].
    #[arg(short, long, value_name = "DIR")]
    out: Option<PathBuf>,

    /// What runs the points.
    #[arg(long, default_value = "local")]
    engine: EngineName,

    /// With `--engine slurm`, a further argument of `sbatch`, such as `--partition=NAME`; may be given again.
    #[arg(long, value_name = "ARG", allow_hyphen_values = true)]
    sbatch_arg: Vec<String>,

    /// Say first what is finished already. Finished points are never run again, with or without this.
    #[arg(long)]
    resume: bool,

    /// A method of `table3` with its options, as `lrbsim run` takes it, in place of those that it has; may be given again.
    #[arg(short, long = "algorithm", value_name = "ALGORITHM")]
    algorithms: Vec<String>,

    /// Only families of `stability`, methods of `table3`, or subjects of `fidelity`, whose names contain this.
    #[arg(long, value_name = "PATTERN")]
    only: Option<String>,

    /// Fewer points of `stability`, receivers of `table3`, or subjects of `fidelity`: to try them out.
    #[arg(long)]
    quick: bool,

    /// Print the results as JSON on standard output, and nothing else there.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Subcommand)]
enum StudyCommand {
    /// Plan a study and print the commands that compute it, for GNU parallel, PBS, LSF, HTCondor or a loop over ssh.
    Export(ExportArgs),
}

#[derive(Debug, Args)]
struct ExportArgs {
    #[command(flatten)]
    what: What,

    /// Host threads of each command: so many points at once, or machines of points that share a functional run.
    #[arg(short, long, value_name = "N", default_value_t = 1)]
    jobs: usize,
}

/// What is run.
#[derive(Debug, Args)]
struct What {
    /// A shipped study, `stability`, `table3`, `fidelity`, or a study file (.json); see `lrbsim schema study`.
    study: PathBuf,

    /// Folder of finished points, shared by studies.
    #[arg(long, value_name = "DIR", default_value = DEFAULT_CACHE)]
    cache: PathBuf,

    /// On a cluster, shards to cut the study into [default: by forecast cost].
    #[arg(long, value_name = "N")]
    shards: Option<usize>,

    /// Run a study of more than 10 000 points.
    #[arg(long)]
    yes: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum EngineName {
    /// This machine.
    Local,
    /// A cluster, by the commands of Slurm; see docs/cluster.md.
    Slurm,
}

pub(crate) fn run(args: &StudyArgs, out: &mut impl Write) -> Result<bool, Failure> {
    match (&args.command, &args.what) {
        (Some(StudyCommand::Export(args)), _) => export(args, out).map(|()| true),
        (None, Some(what)) => run_points(what, args, out),
        (None, None) => unreachable!("clap asks for a study where there is no subcommand"),
    }
}

/// The number of points at once, if it is one.
fn sound_jobs(jobs: usize) -> Result<usize, BadInput> {
    match (1..=JOBS_MAX).contains(&jobs) {
        true => Ok(jobs),
        false => Err(BadInput::new(format!("`--jobs` is {jobs}; it must be from 1 to {JOBS_MAX}"))),
    }
}

impl What {
    fn load(&self) -> Result<Study, BadInput> {
        if self.shards == Some(0) {
            return Err(BadInput::new("`--shards` is 0; it must be at least 1"));
        }
        Study::load(&self.study, self.yes)
    }
}

fn export(args: &ExportArgs, out: &mut impl Write) -> Result<(), Failure> {
    on_interrupt(|| ());
    let what = &args.what;
    if let Some((name, _)) = made(&what.study) {
        return Err(BadInput::new(format!("`{name}` has no points to run one by one"))
            .with_help(format!("`lrbsim study {name}` runs it on this machine, in a minute or two"))
            .into());
    }
    let options = Options { jobs: sound_jobs(args.jobs)?, cache: what.cache.clone() };
    let commands = study::commands(&what.load()?, &options, what.shards, &Log)?;
    for line in &commands.lines {
        writeln!(out, "{line}")?;
    }
    // Beside the list, which goes to a file or a program.
    let all = format!("{} of {}", counted(commands.shards as u64, "shard"), commands.plan.display());
    let mut gather = format!("lrbsim study {}", word(&what.study));
    if what.cache != Path::new(DEFAULT_CACHE) {
        gather += &format!(" --cache {}", word(&what.cache));
    }
    if what.yes {
        gather += " --yes";
    }
    say(&match commands.lines.len() {
        0 => format!("no point is missing in the {all}; `{gather}` gathers"),
        missing => format!(
            "points are missing in {missing} of the {all}; run these commands anywhere that sees this folder and {}, then `{gather}` gathers",
            what.cache.display()
        ),
    });
    Ok(())
}

/// A path as one word of a shell.
fn word(path: &Path) -> String {
    quoted(&path.display().to_string())
}

/// The command that this process was started with, for a shell: it goes on with a study.
fn again() -> String {
    let words = std::env::args_os().skip(1).map(|arg| format!(" {}", word(Path::new(&arg))));
    format!("lrbsim{}", words.collect::<String>())
}

fn run_points(what: &What, args: &StudyArgs, out: &mut impl Write) -> Result<bool, Failure> {
    let slurm = args.engine == EngineName::Slurm;
    if !slurm && (!args.sbatch_arg.is_empty() || what.shards.is_some()) {
        return Err(BadInput::new("`--sbatch-arg` and `--shards` are for a cluster")
            .with_help("add `--engine slurm`, or leave them out")
            .into());
    }
    let jobs = match args.jobs {
        None if slurm => 1,
        None => std::thread::available_parallelism().map_or(1, |threads| threads.get()),
        Some(jobs) => sound_jobs(jobs)?,
    };
    if !args.algorithms.is_empty() && what.study != Path::new(table3::NAME) {
        return Err(not_for("-a", &[table3::NAME]).into());
    }
    if let Some((name, run)) = made(&what.study) {
        if slurm {
            return Err(BadInput::new(format!(
                "`{name}` takes a minute or two and runs on this machine alone"
            ))
            .with_help("leave `--engine slurm` out")
            .into());
        }
        return run_made(name, *run, args, jobs, out);
    }
    if args.only.is_some() || args.quick {
        let given = if args.quick { "--quick" } else { "--only" };
        return Err(not_for(given, &MADE.map(|(name, _)| name)).into());
    }
    let study = what.load()?;
    let target = args.out.clone().unwrap_or_else(|| study::default_dir(&study.file.name));
    let inputs: Vec<PathBuf> = study.path.iter().cloned().collect();
    spare_inputs(&target, &["study.json"], &inputs)?;
    // Proves at once that the folder can be written.
    ResultDir::open(&target)
        .map_err(|error| BadInput::from(error).with_help("`-o` must name a folder that can be written"))?;

    let visible = std::io::stderr().is_terminal();
    let bar = Bar::new(visible, args.resume);
    bar.on_interrupt(format!(
        "finished points are kept in {}; `{}` goes on from there",
        what.cache.display(),
        again()
    ));
    let options = Options { jobs, cache: what.cache.clone() };
    let output = if slurm {
        let slurm = SlurmOptions { sbatch_args: args.sbatch_arg.clone(), shards: what.shards };
        match run_on_slurm(&study, &options, &slurm, &bar)? {
            Some(output) => output,
            None => return Ok(false),
        }
    } else {
        run_study(&study, &options, &bar)?
    };
    bar.finish();

    let status = output.status;
    let replaced = replaced_study(&target, &output.head.study);
    let (paths, digest, builds) = output.write(&target)?;
    if builds > 1 {
        say(&format!(
            "its points were run by {builds} builds of lrbsim, alike in what numbers mean; `build` in host.json tells which"
        ));
    }
    for warning in digest.warnings() {
        say(&warning);
    }
    // A result that was there may be gone by now.
    let failed = digest.study.points.iter().filter(|point| point.error.is_some()).count();
    if args.json {
        let written = target.join("study.json");
        let mut file =
            std::fs::File::open(&written).map_err(|error| BadInput::unreadable(&written, &error))?;
        std::io::copy(&mut file, out)?;
        return Ok(failed == 0);
    }
    let study = &output.head.study;
    let algorithm = Algorithm::from_str(&study.base.algorithm)?;
    // What an axis varies is not the base's.
    let varied = |path: &str| study.axes.iter().any(|axis| axis.path == path);
    let shown = |path: &str, shown: String| (!varied(path)).then_some(shown);
    let base = &study.base;
    let place = [shown("scene", base.scene.to_string()), shown("machine", base.machine.to_string())];
    let place: Vec<String> = place.into_iter().flatten().collect();
    let mut parts = Vec::from_iter((!place.is_empty()).then(|| place.join(" on ")));
    parts.extend(shown("algorithm", algorithm.title()));
    parts.extend(shown("fidelity", base.fidelity.to_string()));
    parts.extend(base.set.iter().map(|(path, value)| format!("{path} = {value}")));
    writeln!(out, "Study {}: {}\n", study.name, parts.join(", "))?;
    for (index, finding) in findings(&digest).iter().enumerate() {
        let gap = if index > 0 { "\n" } else { "" };
        writeln!(out, "{gap}{}\n\n{}", finding.title, finding.sheet.terminal())?;
        for note in &finding.notes {
            writeln!(out, "{note}")?;
        }
    }
    writeln!(
        out,
        "\n{}: {} run, {} found in {}, {failed} failed; {:.1} s",
        counted(status.points as u64, "point"),
        status.computed,
        status.points.saturating_sub(status.computed + failed),
        what.cache.display(),
        status.seconds
    )?;
    let page = target.join("report.html");
    writeln!(out, "wrote {}, study.json and {} more files beside it", page.display(), paths.len() - 2)?;
    if let Some(replaced) = replaced {
        writeln!(out, "{replaced}")?;
    }
    Ok(failed == 0)
}

/// What came of a study whose scenes are made for it.
struct Made {
    json: String,
    /// What is printed of it.
    first: Finding,
    /// How many of what it ran.
    count: String,
    failed: usize,
    file: &'static str,
    paths: Vec<PathBuf>,
}

/// What is wrong with an option of some made studies where another study is run.
fn not_for(option: &str, studies: &[&str]) -> BadInput {
    BadInput::new(format!("`{option}` is for `lrbsim study {}` alone", studies.join("` and `")))
        .with_help("the axes of a study file say which points are run")
}

type RunMade = fn(&StudyArgs, HostOptions, &super::progress::Bar, &Path) -> Result<Made, BadInput>;

/// Studies that are no product of axes, by name; none of their points is kept in the cache.
const MADE: [(&str, RunMade); 3] =
    [(stability::NAME, run_stability), (table3::NAME, run_table3), (fidelity::NAME, run_fidelity)];

/// The study of this name, if it is no product of axes.
fn made(study: &Path) -> Option<&'static (&'static str, RunMade)> {
    MADE.iter().find(|(name, _)| study == Path::new(name))
}

/// Runs a study that is no product of axes.
fn run_made(
    name: &str,
    run: RunMade,
    args: &StudyArgs,
    jobs: usize,
    out: &mut impl Write,
) -> Result<bool, Failure> {
    let target = args.out.clone().unwrap_or_else(|| study::default_dir(name));
    ResultDir::open(&target)
        .map_err(|error| BadInput::from(error).with_help("`-o` must name a folder that can be written"))?;
    on_interrupt(|| ());
    let watch = Stopwatch::start();
    let bar = super::progress::Bar::new(std::io::stderr().is_terminal());
    let host = HostOptions { threads: jobs, ..HostOptions::default() };
    let Made { json, first, count, failed, file, paths } = run(args, host, &bar, &target)?;
    bar.finish();
    if args.json {
        out.write_all(json.as_bytes())?;
        return Ok(failed == 0);
    }
    writeln!(out, "{}\n\n{}", first.title, first.sheet.terminal())?;
    for note in &first.notes {
        writeln!(out, "{note}")?;
    }
    writeln!(out, "{count}, {failed} failed; {:.1} s", watch.elapsed().as_secs_f64())?;
    let page = target.join("report.html");
    writeln!(out, "wrote {}, {file} and {} more files beside it", page.display(), paths.len() - 2)?;
    Ok(failed == 0)
}

fn run_stability(
    args: &StudyArgs,
    host: HostOptions,
    bar: &super::progress::Bar,
    target: &Path,
) -> Result<Made, BadInput> {
    let request = StabilityRequest { only: args.only.clone(), quick: args.quick, host };
    let report = stability::run_stability(&request, bar)?;
    let (points, failed) = report.count();
    Ok(Made {
        json: report.to_json(),
        // What breaks where is on the page.
        first: Finding { notes: Vec::new(), ..report.findings().swap_remove(0) },
        count: counted(points as u64, "point"),
        failed,
        file: stability::FILE,
        paths: stability::write(target, &report)?,
    })
}

fn run_table3(
    args: &StudyArgs,
    host: HostOptions,
    bar: &super::progress::Bar,
    target: &Path,
) -> Result<Made, BadInput> {
    let (algorithms, only) = (args.algorithms.clone(), args.only.clone());
    let request = Table3Request { algorithms, only, quick: args.quick, host };
    let report = table3::run_table3(&request, bar)?;
    Ok(Made {
        json: report.to_json(),
        first: report.findings().swap_remove(0),
        count: counted(report.rows.len() as u64, "method"),
        failed: 0,
        file: table3::FILE,
        paths: table3::write(target, &report)?,
    })
}

fn run_fidelity(
    args: &StudyArgs,
    host: HostOptions,
    bar: &super::progress::Bar,
    target: &Path,
) -> Result<Made, BadInput> {
    let request = FidelityRequest { only: args.only.clone(), quick: args.quick, host };
    let list = fidelity::run_fidelity(&request, bar)?;
    let first = list.findings().swap_remove(0);
    Ok(Made {
        json: list.errors.to_json(),
        first: Finding { notes: first.notes.into_iter().chain(list.advice()).collect(), ..first },
        count: counted(list.errors.subjects.len() as u64, "subject"),
        failed: 0,
        file: fidelity::FILE,
        paths: fidelity::write(target, &list)?,
    })
}

/// Bar on standard error, measured in work and not in points: points differ in cost.
struct Bar {
    bar: ProgressBar,
    visible: bool,
    resume: bool,
    state: std::sync::Arc<Mutex<Option<Status>>>,
}

impl Bar {
    fn new(visible: bool, resume: bool) -> Bar {
        let bar = on_standard_error(visible);
        bar.set_style(style("{prefix} {wide_bar} {percent}% {msg}"));
        bar.set_length(1000);
        Bar { bar, visible, resume, state: std::sync::Arc::default() }
    }

    fn finish(&self) {
        self.bar.finish_and_clear();
    }

    /// On an interrupt, says what is kept and how to go on.
    fn on_interrupt(&self, text: String) {
        let (bar, state) = (self.bar.clone(), self.state.clone());
        let handler = move || {
            bar.finish_and_clear();
            let status = state.lock().ok().and_then(|status| *status).unwrap_or_default();
            let done = status.found + status.computed;
            let points = counted(status.points as u64, "point");
            let goes_on = if status.queued > 0 { "tasks go on; " } else { "" };
            say(&format!("stopped with {done} of {points} finished; {goes_on}{text}"));
        };
        on_interrupt(handler);
    }
}

impl StudyProgress for Bar {
    fn say(&self, text: &str) {
        if self.visible { self.bar.println(text) } else { say(text) }
    }

    fn status(&self, status: &Status) {
        let first = self.state.lock().map(|mut last| last.replace(*status).is_none()).unwrap_or(false);
        if first && self.resume {
            let left = status.points - status.found - status.failed;
            let all = counted(status.points as u64, "point");
            self.say(&format!("{} of {all} finished; {left} left", status.found));
        }
        let done = status.found + status.computed + status.failed;
        self.bar.set_prefix(format!("{done}/{}", counted(status.points as u64, "point")));
        self.bar.set_position((status.part_done * 1000.0) as u64);
        let rate = status.computed as f64 / status.seconds.max(1e-3) * 60.0;
        let left =
            status.seconds_left.map_or_else(|| "? left".to_owned(), |left| format!("{} left", clock(left)));
        self.bar.set_message(format!("{rate:.1} points/min {left}"));
    }
}

/// `75` as `1:15`.
fn clock(seconds: f64) -> String {
    let seconds = seconds.ceil() as u64;
    match seconds / 3600 {
        0 => format!("{}:{:02}", seconds / 60, seconds % 60),
        hours => format!("{hours}:{:02}:{:02}", seconds / 60 % 60, seconds % 60),
    }
}
