//! Runs a study's shards as a job array of Slurm, with `sbatch` and `squeue` alone.
//!
//! Slurm is asked what is queued and never what is done: that, files say. So the submitter may die, the controller may forget,
//! and a node may be lost; the same command goes on from what is there.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use lrbsim_reports::table::counted;

use super::super::crew::Store as _;
use super::super::file::Study;
use super::super::ledger::Ledger;
use super::super::output::StudyOutput;
use super::super::run::{Options, Status, StudyProgress};
use super::super::work::Work;
use super::commands::{assignment, worker};
use super::plan::{Cut, Plan, SILENT_SECONDS, Site, locked};
use super::store::{PATIENCE_SECONDS, PlanStore};
use crate::error::BadInput;
use crate::host::Stopwatch;

/// How Slurm is asked to run a study.
#[derive(Debug, Clone, Default)]
pub struct SlurmOptions {
    /// Further arguments of `sbatch`, after those of lrbsim.
    pub sbatch_args: Vec<String>,
    /// Shards to cut the study into; forecast cost decides where it is `None`.
    pub shards: Option<usize>,
}

/// Tasks of an array at most, where Slurm does not say.
const ARRAY_SIZE_MAX: usize = 1001;

/// Seconds between two looks at the queue: at first, and at most. They grow with the time that the study has taken, so that
/// the end of a study is seen within a twentieth of that.
const POLL_SECONDS: (f64, f64) = (1.0, 30.0);

/// Seconds until a task that is gone counts as ended: what it wrote last may still be on its way through a network file
/// system, and a task that is queued again may not be in the queue yet.
const GRACE_SECONDS: f64 = 5.0;

/// Options of `sbatch` that are not the user's, with their letters and what their variables end with: lrbsim knows its tasks,
/// their logs and the number of the job by them.
const OWN_OPTIONS: [(&str, char, &str); 10] = [
    ("--job-name", 'J', "JOB_NAME"),
    ("--array", 'a', "ARRAY_INX"),
    ("--output", 'o', "OUTPUT"),
    ("--error", 'e', "ERROR"),
    ("--clusters", 'M', "CLUSTERS"),
    ("--wait", 'W', "WAIT"),
    ("--quiet", 'Q', "QUIET"),
    ("--test-only", '\0', "TEST_ONLY"),
    ("--parsable", '\0', "PARSABLE"),
    ("--wrap", '\0', "WRAP"),
];

/// Letters of `sbatch` that take no value: others may follow in the same word.
const FLAGS: &str = "hHIkOsvV";

/// Seconds between two looks at the progress bar.
const TICK: Duration = Duration::from_millis(200);

/// Lines of a log that are shown.
const LOG_LINES: usize = 5;

/// Shards whose logs are shown; of others, their numbers.
const LOGS_MAX: usize = 4;

/// A task that Slurm knows.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Task {
    /// Number of its job.
    job: String,
    shard: usize,
    state: String,
    /// Name of its job.
    name: String,
    reason: String,
}

/// Runs a study on the cluster whose commands are on the path: submits the shards that miss a point and are not queued,
/// waits, and gathers. `None` where points are missing at the end; why was said to `progress`.
pub fn run_on_slurm(
    study: &Study,
    options: &Options,
    slurm: &SlurmOptions,
    progress: &dyn StudyProgress,
) -> Result<Option<StudyOutput>, BadInput> {
    let watch = Stopwatch::start();
    sound(&slurm.sbatch_args)?;
    let work = Work::of(study, 0..study.len())?;
    let cut = Cut { shards: slurm.shards, threads: options.jobs };
    let site = || patiently(progress, site);
    let plan = Plan::open_or_make(study, &work, &options.cache, cut, site, progress)?;
    let store = PlanStore::new(&plan.basis, &plan.folder)?;
    let mut run = Run::new(&work, &plan, &store, watch, options.jobs);
    let foreign = run.missing.iter().filter(|point| store.is_foreign(&plan.basis.keys[**point])).count();
    if foreign > 0 {
        progress.say(&format!(
            "{} in {} of another build of lrbsim: run again, not mixed in",
            counted(foreign as u64, "point"),
            plan.basis.cache.display()
        ));
    }
    progress.status(&run.status(&[]));
    if !run.missing.is_empty() {
        let queued = run.submit(&slurm.sbatch_args, progress)?;
        progress.status(&Status { queued, ..run.status(&[]) });
        if !run.watch(progress) {
            return Ok(None);
        }
    }
    let status = run.status(&[]);
    if status.failed > 0 && store.failed().read_dir().is_ok_and(|mut files| files.next().is_some()) {
        let folder = store.failed().display();
        progress.say(&format!(
            "points that failed are not run again; remove {folder} to have them tried once more"
        ));
    }
    Ok(Some(StudyOutput::new(study, &work, run.ledger.outcomes(&work), store.cache.clone(), status)))
}

/// A study on its way.
struct Run<'a> {
    plan: &'a Plan,
    store: &'a PlanStore<'a>,
    watch: Stopwatch,
    /// CPUs of a task.
    threads: usize,
    /// Shard of each point that is in one.
    shard_of: BTreeMap<usize, usize>,
    /// Points without a result.
    missing: BTreeSet<usize>,
    ledger: Ledger,
}

impl<'a> Run<'a> {
    fn new(
        work: &Work,
        plan: &'a Plan,
        store: &'a PlanStore<'a>,
        watch: Stopwatch,
        threads: usize,
    ) -> Run<'a> {
        let mut run = Run {
            plan,
            store,
            watch,
            threads,
            shard_of: BTreeMap::new(),
            missing: BTreeSet::new(),
            ledger: Ledger::of(work),
        };
        for (number, part) in plan.shards.iter().enumerate() {
            run.shard_of.extend(part.points.iter().map(|point| (*point, number)));
            run.missing.extend(&part.points);
        }
        run.look(|_| true, false);
        run
    }

    /// Looks for the results of points in the shards that `within` picks.
    fn look(&mut self, within: impl Fn(usize) -> bool, new: bool) {
        let asked: Vec<usize> =
            self.missing.iter().copied().filter(|point| within(self.shard_of[point])).collect();
        for point in asked {
            let Some(outcome) = self.store.find(&self.plan.basis.keys[point]) else { continue };
            self.missing.remove(&point);
            self.ledger.end(point, outcome, new);
        }
    }

    /// Looks for the results of points in the shards that `within` picks, and takes nothing for missing that was missing some
    /// time ago.
    fn look_anew(&mut self, within: impl Fn(usize) -> bool) {
        let plan = self.plan;
        let asked = self.missing.iter().filter(|point| within(self.shard_of[point]));
        self.store.freshen(&asked.map(|point| plan.basis.keys[*point].as_str()).collect());
        self.look(within, true);
    }

    /// Points without a result in a shard.
    fn missing_of(&self, shard: usize) -> usize {
        self.missing.iter().filter(|point| self.shard_of[point] == shard).count()
    }

    /// Shards that miss a point.
    fn unfinished(&self) -> BTreeSet<usize> {
        self.missing.iter().map(|point| self.shard_of[point]).collect()
    }

    fn status(&self, queue: &[Task]) -> Status {
        let running = queue.iter().filter(|task| task.is_running()).count();
        let now = self.watch.elapsed().as_secs_f64();
        let left = (running > 0).then(|| self.ledger.forecast.left(now, running * self.threads)).flatten();
        Status { queued: queue.len(), ..self.ledger.status(running, now, left) }
    }

    /// Submits the shards that miss a point and are not queued from before. Tells how many tasks are queued now.
    fn submit(&self, args: &[String], progress: &dyn StudyProgress) -> Result<usize, BadInput> {
        let plan = self.plan;
        let folder = plan.folder.display().to_string();
        if folder.contains(['%', '\\', '\n']) {
            return Err(BadInput::new(format!(
                "`{folder}`: Slurm reads `%` and `\\` in the name of a log its own way"
            ))
            .with_help("start the study in a folder without them in its name"));
        }
        // Two submitters at once: the second sees what the first has submitted.
        let _lock = locked(&plan.folder, PATIENCE_SECONDS, progress)?;
        let others = plan.others();
        let names: Vec<String> = others.iter().map(|(name, _)| name.clone()).chain([plan.name()]).collect();
        let queue = patiently(progress, || queue(&names.join(","))).map_err(|said| {
            BadInput::new(format!("Slurm does not say what is queued: {said}")).with_help(
                "the same command goes on when Slurm answers; `lrbsim study export` lists commands to run without it",
            )
        })?;
        for (name, folder) in others {
            let tasks = queue.iter().filter(|task| task.name == name).count();
            if tasks > 0 {
                progress.say(&format!(
                    "{} of another plan of this study, {}, still in the queue; `scancel --me --name={name}` ends them",
                    counted(tasks as u64, "task"),
                    folder.display()
                ));
            }
        }
        let of_plan = queue.iter().filter(|task| task.name == plan.name());
        let queued: BTreeSet<usize> = of_plan.map(|task| task.shard).collect();
        let unfinished = self.unfinished();
        let wanted: Vec<usize> = unfinished.difference(&queued).copied().collect();
        if wanted.len() < unfinished.len() {
            let before = (unfinished.len() - wanted.len()) as u64;
            progress.say(&format!("{} of an earlier call still queued or running", counted(before, "task")));
        }
        if wanted.is_empty() {
            return Ok(queued.len());
        }
        let threads = self.threads;
        let minutes = (10.0 + plan.shard_seconds_max() * 3.0 / threads as f64 / 60.0).ceil() as u64;
        let megabytes = (plan.basis.memory * threads as u64).div_ceil(1 << 20);
        let mut sbatch = slurm("sbatch");
        sbatch
            .args(["--parsable", "--requeue", "--open-mode=append", "--ntasks=1", "--signal=B:TERM@60"])
            .arg(format!("--job-name={}", plan.name()))
            .arg(format!("--array={}", ranges(&wanted)))
            .arg(format!("--cpus-per-task={threads}"))
            .arg(format!("--time={minutes}"))
            .arg(format!("--chdir={folder}"))
            .arg(format!("--output={folder}/log/%A_%a.out"));
        // Slurm takes one way to say it alone.
        if !args.iter().any(|arg| arg.starts_with("--mem-per-")) {
            sbatch.arg(format!("--mem={megabytes}M"));
        }
        sbatch.args(args);
        let script = self.script()?;
        let said = patiently(progress, || run(&mut sbatch, Some(&script)));
        let job = said.and_then(|said| job_of(&said)).map_err(|said| {
            // A plan that nothing ever came of binds nobody.
            if queued.is_empty() && plan.is_untouched() {
                plan.discard();
            }
            BadInput::new(format!("Slurm takes no job: {said}")).with_help(
                "`--sbatch-arg` adds what your site asks for, as in `--sbatch-arg=--partition=NAME`; it may also say less memory or time. Where a site allows fewer tasks, say fewer `--shards`, and remove the folder of the plan if tasks of it ran",
            )
        })?;
        let tasks = counted(wanted.len() as u64, "task");
        progress.say(&format!(
            "submitted {tasks} as job {job}, logs are in {folder}/log; `scancel {job}` ends what is left of it"
        ));
        Ok(queued.len() + wanted.len())
    }

    /// What a task runs. Only the batch shell is told of an early end, so that the worker takes its place.
    fn script(&self) -> Result<String, BadInput> {
        let export = assignment().map_or_else(String::new, |assignment| format!("export {assignment}\n"));
        let worker = worker(&self.plan.folder, self.threads)?;
        Ok(format!(
            "#!/bin/sh\n{export}exec {worker} --shard \"$SLURM_ARRAY_TASK_ID\" --node \"${{SLURMD_NODENAME:-}}\"\n"
        ))
    }

    /// Waits until every point is over; whether that is so.
    fn watch(&mut self, progress: &dyn StudyProgress) -> bool {
        let mut last: Vec<Task> = Vec::new();
        let mut silent = false;
        let mut gone: BTreeMap<usize, f64> = BTreeMap::new();
        let mut told: BTreeSet<String> = BTreeSet::new();
        let mut held: BTreeSet<(String, usize)> = BTreeSet::new();
        let mut ended: BTreeSet<usize> = BTreeSet::new();
        loop {
            match queue(&self.plan.name()) {
                Ok(queue) => {
                    if std::mem::take(&mut silent) {
                        progress.say("Slurm answers again");
                    }
                    last = queue;
                }
                // The controller may come back; tasks go on without it.
                Err(said) if !std::mem::replace(&mut silent, true) => {
                    progress.say(&format!("Slurm does not answer, waiting: {said}"));
                }
                Err(_) => {}
            }
            // A task that has not begun has no results; a shard that nobody knows of may have, or one that is held after it
            // ran.
            let waits: BTreeSet<usize> =
                last.iter().filter(|task| !silent && task.is_waiting()).map(|task| task.shard).collect();
            self.look(|shard| !waits.contains(&shard), true);
            if self.missing.is_empty() {
                if last.iter().any(|task| !task.is_running()) {
                    // They would find everything done; those that are held would never. Best effort: they harm nobody.
                    let name = format!("--name={}", self.plan.name());
                    let _ = run(slurm("scancel").args(["--me", "--state=PENDING"]).arg(name), None);
                }
                return true;
            }
            let now = self.watch.elapsed().as_secs_f64();
            if !silent {
                let queued: BTreeSet<usize> = last.iter().map(|task| task.shard).collect();
                let unfinished = self.unfinished();
                gone.retain(|shard, _| unfinished.contains(shard) && !queued.contains(shard));
                for shard in unfinished.difference(&queued) {
                    if now - *gone.entry(*shard).or_insert(now) >= GRACE_SECONDS && ended.insert(*shard) {
                        self.look_anew(|other| other == *shard);
                        self.tell_of_end(*shard, ended.len(), progress);
                    }
                }
                ended.retain(|shard| gone.contains_key(shard));
                let left: Vec<&Task> = last.iter().filter(|task| unfinished.contains(&task.shard)).collect();
                let now_held = left.iter().filter(|task| task.is_held());
                tell_of_held(now_held.filter(|task| held.insert((task.job.clone(), task.shard))), progress);
                for task in left.iter().filter(|task| task.is_stuck()) {
                    if told.insert(task.reason.clone()) {
                        let drained = task.reason.contains("DRAINED");
                        let help = if drained { ": `sinfo -R` says why nodes are" } else { "" };
                        progress
                            .say(&format!("task {}_{} waits: {}{help}", task.job, task.shard, task.reason));
                    }
                }
                if left.iter().all(|task| task.is_held())
                    && unfinished.iter().all(|shard| ended.contains(shard) || queued.contains(shard))
                {
                    self.look_anew(|_| true);
                    if self.missing.is_empty() {
                        continue;
                    }
                    self.tell_of_rest(&left, ended.len(), progress);
                    return false;
                }
            }
            let (first, most) = POLL_SECONDS;
            let until = now + (now / 20.0).clamp(first, most);
            while self.watch.elapsed().as_secs_f64() < until {
                progress.status(&self.status(&last));
                std::thread::sleep(TICK);
            }
        }
    }

    /// Says that a task has ended before its points, and what it said last.
    fn tell_of_end(&self, shard: usize, ended: usize, progress: &dyn StudyProgress) {
        let missing = self.missing_of(shard);
        if missing == 0 {
            return;
        }
        let all = counted(self.plan.shards[shard].points.len() as u64, "point");
        let mut text = format!("shard {shard} has ended and misses {missing} of its {all}");
        if ended <= LOGS_MAX {
            match last_log(&self.plan.folder.join("log"), shard) {
                Some((path, lines)) => text += &format!("; {} ends with:{lines}", path.display()),
                None => text += "; it has left no log",
            }
        }
        progress.say(&text);
    }

    fn tell_of_rest(&self, held: &[&Task], ended: usize, progress: &dyn StudyProgress) {
        let missing = counted(self.missing.len() as u64, "point");
        let mut text = format!("{missing} missing, and nothing computes what is missing");
        if ended > 0 {
            text += &format!(": {} ended without", counted(ended as u64, "shard"));
        }
        if !held.is_empty() {
            let ids: BTreeSet<&str> = held.iter().map(|task| task.job.as_str()).collect();
            let ids: Vec<&str> = ids.into_iter().collect();
            text += &format!(
                "; {} held: `scontrol release {}` lets go on what is held, or `scancel {}` ends it; nodes that are drained `scontrol update nodename=NAME state=resume` puts back",
                counted(held.len() as u64, "task"),
                ids.join(","),
                ids.join(" ")
            );
        }
        text += ". All finished points are kept; the same command submits what is missing";
        progress.say(&text);
    }
}

impl Task {
    fn is_running(&self) -> bool {
        self.state == "RUNNING"
    }

    /// Whether it waits for its turn.
    fn is_waiting(&self) -> bool {
        self.state == "PENDING" && !self.is_held()
    }

    /// Whether it waits until somebody lets it go on. One that runs does not, whatever was done to its job: it would be held if it
    /// were requeued.
    fn is_held(&self) -> bool {
        self.state == "PENDING" && self.reason.to_ascii_lowercase().contains("held")
    }

    /// Whether it waits for something other than its turn.
    fn is_stuck(&self) -> bool {
        const USUAL: [&str; 9] = [
            "None",
            "Priority",
            "Resources",
            "BeginTime",
            "JobArrayTaskLimit",
            "Cleaning",
            "NodeDown",
            "Prolog",
            "",
        ];
        self.is_waiting() && !USUAL.contains(&self.reason.as_str())
    }
}

/// Says which tasks are held and why, many in a line.
fn tell_of_held<'a>(tasks: impl Iterator<Item = &'a &'a Task>, progress: &dyn StudyProgress) {
    let mut held: BTreeMap<(&str, &str), BTreeSet<usize>> = BTreeMap::new();
    for task in tasks {
        held.entry((&task.job, &task.reason)).or_default().insert(task.shard);
    }
    for ((job, reason), shards) in held {
        let shards = ranges(&shards.into_iter().collect::<Vec<_>>());
        progress.say(&format!("held: {job}_[{shards}], {reason}"));
    }
}

/// Refuses arguments of `sbatch` that would take from lrbsim what it relies on.
fn sound(args: &[String]) -> Result<(), BadInput> {
    for (index, arg) in args.iter().enumerate() {
        let long = arg.split('=').next().unwrap_or_default();
        let letter = arg
            .strip_prefix('-')
            .and_then(|rest| rest.trim_start_matches(|c| FLAGS.contains(c)).chars().next());
        let is_own = |option: &&(&str, char, &str)| match long.strip_prefix("--") {
            // `sbatch` takes the beginning of a name for the name.
            Some(_) => option.0.starts_with(long),
            None => letter == Some(option.1),
        };
        if let Some((option, ..)) = OWN_OPTIONS.iter().find(is_own) {
            return Err(BadInput::new(format!("`--sbatch-arg={arg}`: lrbsim itself decides on `{option}`"))
                .with_help("leave it out; `scontrol update jobid=JOB arraytaskthrottle=N` lets N tasks of a job run at once, and no more"));
        }
        // The value of the option before it, or else a script in place of lrbsim's.
        let before = index.checked_sub(1).map_or("", |before| &args[before]);
        if !arg.starts_with('-') && (!before.starts_with('-') || before.contains('=')) {
            return Err(BadInput::new(format!("`--sbatch-arg={arg}` is no option of `sbatch`")).with_help(
                "an option and its value are one argument, as in `--sbatch-arg=--partition=NAME`",
            ));
        }
    }
    Ok(())
}

/// The number of a job in what `sbatch` says, which may name its cluster too.
fn job_of(said: &str) -> Result<String, String> {
    let job = said.trim().split(';').next().unwrap_or_default();
    match !job.is_empty() && job.chars().all(|c| c.is_ascii_digit()) {
        true => Ok(job.to_owned()),
        false => Err(format!("`sbatch` says `{}`, which is no number of a job", said.trim())),
    }
}

/// The tasks of these names, with commas between, that are queued or running; what Slurm said where it does not tell.
fn queue(names: &str) -> Result<Vec<Task>, String> {
    let mut squeue = slurm("squeue");
    squeue.args(["--noheader", "--array", "--me", "--format=%F|%K|%T|%j|%r"]).arg(format!("--name={names}"));
    Ok(tasks(&run(&mut squeue, None)?))
}

/// Tasks in the text of `squeue`.
fn tasks(text: &str) -> Vec<Task> {
    let task = |line: &str| {
        let mut parts = line.trim().splitn(5, '|').map(str::to_owned);
        let (job, shard) = (parts.next()?, parts.next()?.parse().ok()?);
        let (state, name) = (parts.next()?, parts.next()?);
        Some(Task { job, shard, state, name, reason: parts.next().unwrap_or_default() })
    };
    text.lines().filter_map(task).collect()
}

/// How large the cluster is: the CPUs of its largest partition, and the tasks that an array may have.
fn site() -> Result<Site, BadInput> {
    let unknown = |said: String| {
        BadInput::new(format!("Slurm does not say how large the cluster is: {said}")).with_help(
            "a study is cut by that, once; start the same command again when Slurm answers, or see `lrbsim study export`",
        )
    };
    let text = run(slurm("sinfo").args(["--noheader", "--format=%C"]), None).map_err(unknown)?;
    // Allocated, idle, other, total.
    let cpus = text.lines().filter_map(|line| line.trim().rsplit('/').next()?.parse().ok()).max();
    let cpus = cpus
        .filter(|cpus| *cpus > 0)
        .ok_or_else(|| unknown("`sinfo` shows no CPU that you may use".to_owned()))?;
    let text = run(slurm("scontrol").args(["show", "config"]), None).map_err(unknown)?;
    let size = text
        .lines()
        .find_map(|line| line.strip_prefix("MaxArraySize")?.split('=').nth(1)?.trim().parse().ok());
    Ok(Site { cpus, shards_max: size.filter(|size| *size > 1).unwrap_or(ARRAY_SIZE_MAX) - 1 })
}

/// Does what asks Slurm, and says so where the answer is long in coming.
fn patiently<T>(progress: &dyn StudyProgress, ask: impl FnOnce() -> T) -> T {
    std::thread::scope(|scope| {
        let (answered, heard) = channel::<()>();
        scope.spawn(move || {
            if heard.recv_timeout(Duration::from_secs_f64(SILENT_SECONDS)) == Err(RecvTimeoutError::Timeout) {
                progress.say("asking Slurm, which is long in answering");
            }
        });
        let answer = ask();
        drop(answered);
        answer
    })
}

/// A command of Slurm without the user's variables that would change what it answers. His own for `sbatch` stay, but for
/// those that lrbsim decides on.
fn slurm(program: &str) -> Command {
    let mut command = Command::new(program);
    for (name, _) in std::env::vars_os() {
        let of_program = name.to_str().and_then(|name| {
            let (prefix, rest) = name.split_once('_')?;
            prefix.eq_ignore_ascii_case(program).then_some(rest)
        });
        if of_program.is_some_and(|end| program != "sbatch" || OWN_OPTIONS.iter().any(|own| own.2 == end)) {
            command.env_remove(name);
        }
    }
    command
}

/// What a command of Slurm prints; where it fails, what it says of that.
fn run(command: &mut Command, input: Option<&str>) -> Result<String, String> {
    let program = command.get_program().to_string_lossy().into_owned();
    let failed = |error: std::io::Error| match error.kind() {
        std::io::ErrorKind::NotFound => {
            format!("`{program}` is not on the path; where a site keeps Slurm in a module, load that first")
        }
        _ => format!("`{program}` cannot be run: {error}"),
    };
    command.stdin(if input.is_some() { Stdio::piped() } else { Stdio::null() });
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().map_err(failed)?;
    if let (Some(input), Some(mut pipe)) = (input, child.stdin.take()) {
        // One that reads nothing says why by itself.
        let _ = pipe.write_all(input.as_bytes());
    }
    let Output { status, stdout, stderr } = child.wait_with_output().map_err(failed)?;
    if status.success() {
        return Ok(String::from_utf8_lossy(&stdout).into_owned());
    }
    let said = String::from_utf8_lossy(&stderr).split_whitespace().collect::<Vec<_>>().join(" ");
    Err(format!("`{program}` failed ({status}): {said}"))
}

/// `0,1,2,7` as `0-2,7`.
fn ranges(numbers: &[usize]) -> String {
    let mut runs: Vec<(usize, usize)> = Vec::new();
    for number in numbers {
        match runs.last_mut() {
            Some((_, last)) if *last + 1 == *number => *last = *number,
            _ => runs.push((*number, *number)),
        }
    }
    let run = |(first, last): &(usize, usize)| match first == last {
        true => first.to_string(),
        false => format!("{first}-{last}"),
    };
    runs.iter().map(run).collect::<Vec<_>>().join(",")
}

/// The newest log of a shard, and its last lines.
fn last_log(folder: &Path, shard: usize) -> Option<(PathBuf, String)> {
    let end = format!("_{shard}.out");
    let of_shard =
        |path: &PathBuf| path.file_name().is_some_and(|name| name.to_string_lossy().ends_with(&end));
    let files = std::fs::read_dir(folder).ok()?.flatten().map(|entry| entry.path()).filter(of_shard);
    let path = files.max_by_key(|path| path.metadata().and_then(|meta| meta.modified()).ok())?;
    let bytes = std::fs::read(&path).ok()?;
    let text = String::from_utf8_lossy(&bytes);
    let lines: Vec<&str> = text.lines().collect();
    let last = &lines[lines.len().saturating_sub(LOG_LINES)..];
    let lines = last.iter().map(|line| format!("\n  {line}")).collect();
    Some((path, lines))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_are_named_by_ranges() {
        assert_eq!(ranges(&[0, 1, 2, 7, 9, 10]), "0-2,7,9-10");
        assert_eq!(ranges(&[3]), "3");
    }

    #[test]
    fn what_squeue_says_is_understood() {
        let text = "12|0|RUNNING|a|None\n12|1|RUNNING|a|JobHeldAdmin\n12|3|PENDING|a|launch failed requeued held\n12|4|PENDING|a|JobHeldUser\n 12|5|PENDING|a|QOSMaxJobsPerUserLimit\nnoise\n";
        let tasks = tasks(text);
        assert!(tasks.iter().all(|task| (task.job.as_str(), task.name.as_str()) == ("12", "a")));
        assert_eq!(tasks.iter().map(|task| task.shard).collect::<Vec<_>>(), [0, 1, 3, 4, 5]);
        assert_eq!(tasks.iter().map(Task::is_running).collect::<Vec<_>>(), [true, true, false, false, false]);
        assert_eq!(tasks.iter().map(Task::is_held).collect::<Vec<_>>(), [false, false, true, true, false]);
        assert_eq!(tasks.iter().map(Task::is_stuck).collect::<Vec<_>>(), [false, false, false, false, true]);
    }

    #[test]
    fn held_tasks_are_named_together() {
        struct Heard(std::sync::Mutex<Vec<String>>);
        impl StudyProgress for Heard {
            fn status(&self, _status: &Status) {}
            fn say(&self, text: &str) {
                self.0.lock().expect("nobody panics with it").push(text.to_owned());
            }
        }
        let heard = Heard(std::sync::Mutex::default());
        let lines: String = (0..1000).map(|shard| format!("7|{shard}|PENDING|a|JobHeldUser\n")).collect();
        tell_of_held(tasks(&lines).iter().collect::<Vec<_>>().iter(), &heard);
        assert_eq!(*heard.0.lock().expect("nobody panics with it"), ["held: 7_[0-999], JobHeldUser"]);
    }

    #[test]
    fn arguments_by_which_tasks_are_known_are_refused() {
        let refused = |words: &[&str]| {
            let words: Vec<String> = words.iter().map(|&word| word.to_owned()).collect();
            sound(&words).err().map(|bad| bad.to_string())
        };
        for word in [
            "--job-name=x",
            "-Jx",
            "-J",
            "--array=0-3%2",
            "-a0",
            "--arr=1",
            "--output=/dev/null",
            "-o",
            "--error",
            "-ex",
        ] {
            assert!(refused(&[word]).is_some(), "{word}");
        }
        for word in [
            "--test-only",
            "--parsable",
            "--wrap=date",
            "--clusters=b",
            "-Mb",
            "--wait",
            "-HJx",
            "-vQ",
            "script.sh",
        ] {
            assert!(refused(&[word]).is_some(), "{word}");
        }
        assert!(refused(&["--partition=main", "script.sh"]).is_some());
        for words in [
            ["--partition=main", "-Aname"],
            ["-p", "main"],
            ["--wait-all-nodes=1", "--exclusive"],
            ["-H", "--no-requeue"],
        ] {
            assert_eq!(refused(&words), None);
        }
        assert!(refused(&["--array=0-3%2"]).is_some_and(|said| said.contains("`--array`")));
    }

    #[test]
    fn only_a_number_is_a_job() {
        assert_eq!(job_of("4711\n").as_deref(), Ok("4711"));
        assert_eq!(job_of("4711;cluster\n").as_deref(), Ok("4711"));
        for said in ["", "\n", "Submitted batch job 4711\n", ";x"] {
            assert!(job_of(said).is_err(), "{said}");
        }
    }

    #[test]
    fn the_last_lines_of_the_newest_log_are_found() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        assert_eq!(last_log(folder.path(), 3), None);
        std::fs::write(folder.path().join("9_3.out"), "1\n2\n3\n4\n5\n6\n").expect("writable");
        std::fs::write(folder.path().join("9_13.out"), "no").expect("writable");
        let (path, lines) = last_log(folder.path(), 3).expect("there");
        assert_eq!((path, lines.as_str()), (folder.path().join("9_3.out"), "\n  2\n  3\n  4\n  5\n  6"));
    }
}
