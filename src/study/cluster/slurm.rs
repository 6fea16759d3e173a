//! Runs a study's shards as a job array of Slurm, with `sbatch` and `squeue` alone.
//!
//! Slurm is asked what is queued and never what is done: that, files say. So the submitter may die, the controller may forget,
//! and a node may be lost; the same command goes on from what is there.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::Duration;

use lrbsim_reports::lock::Lock;

use super::super::crew::Store as _;
use super::super::file::Study;
use super::super::ledger::Ledger;
use super::super::output::StudyOutput;
use super::super::run::{Options, Status, StudyProgress};
use super::super::work::Work;
use super::commands::{assignment, worker};
use super::plan::{Cut, Plan};
use super::store::PlanStore;
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

/// Seconds that a point of a task that is gone may still be on its way through a network file system.
const GRACE_SECONDS: f64 = 5.0;

/// Seconds between two looks at the progress bar.
const TICK: Duration = Duration::from_millis(200);

/// Lines of a log that are shown.
const LOG_LINES: usize = 5;

/// Shards whose logs are shown; of others, their numbers.
const LOGS_MAX: usize = 4;

/// A task that Slurm knows.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Task {
    id: String,
    shard: usize,
    state: String,
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
    let work = Work::of(study, 0..study.len())?;
    let cut = Cut { shards: slurm.shards, slots: cpus().max(1), shards_max: array_size_max() - 1 };
    let plan = Plan::open_or_make(study, &work, &options.cache, cut)?;
    let store = PlanStore::new(&plan.basis, &plan.folder)?;
    let mut run = Run::new(&work, &plan, &store, watch, options.jobs);
    let foreign = run.missing.iter().filter(|point| store.is_foreign(&plan.basis.keys[**point])).count();
    if foreign > 0 {
        progress.say(&format!(
            "{foreign} points in {} are of another build of lrbsim: they are run again, not mixed in",
            plan.basis.cache.display()
        ));
    }
    progress.status(&run.status(&[]));
    if !run.missing.is_empty() {
        run.submit(&slurm.sbatch_args, progress)?;
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

    /// Shards that miss a point.
    fn unfinished(&self) -> BTreeSet<usize> {
        self.missing.iter().map(|point| self.shard_of[point]).collect()
    }

    fn status(&self, queue: &[Task]) -> Status {
        let running = queue.iter().filter(|task| task.is_running()).count();
        let now = self.watch.elapsed().as_secs_f64();
        let left = (running > 0).then(|| self.ledger.forecast.left(now, running * self.threads)).flatten();
        self.ledger.status(running, now, left)
    }

    /// Submits the shards that miss a point and are not queued from before.
    fn submit(&self, args: &[String], progress: &dyn StudyProgress) -> Result<(), BadInput> {
        let plan = self.plan;
        let folder = plan.folder.display().to_string();
        if folder.contains(['%', '\\', '\n']) {
            return Err(BadInput::new(format!(
                "`{folder}`: Slurm reads `%` and `\\` in the name of a log its own way"
            ))
            .with_help("start the study in a folder without them in its name"));
        }
        // Two submitters at once: the second sees what the first has submitted.
        let _lock = Lock::wait(&plan.folder.join(".lock"))
            .map_err(|error| BadInput::new(format!("cannot write to `{folder}`: {error}")))?;
        let queue = queue(&plan.name()).map_err(|said| {
            BadInput::new(format!("Slurm does not say what is queued: {said}")).with_help(
                "the same command goes on when Slurm answers; `lrbsim study export` lists commands to run without it",
            )
        })?;
        let queued: BTreeSet<usize> = queue.iter().map(|task| task.shard).collect();
        let unfinished = self.unfinished();
        let wanted: Vec<usize> = unfinished.difference(&queued).copied().collect();
        if wanted.len() < unfinished.len() {
            let before = unfinished.len() - wanted.len();
            progress.say(&format!("{before} tasks of an earlier call are still queued or running"));
        }
        if wanted.is_empty() {
            return Ok(());
        }
        let threads = self.threads;
        let minutes = 10 + (plan.shard_seconds_max() * 3.0 / threads as f64 / 60.0).ceil() as u64;
        let megabytes = (plan.basis.memory * threads as u64).div_ceil(1 << 20);
        let mut sbatch = Command::new("sbatch");
        sbatch
            .args(["--parsable", "--requeue", "--open-mode=append", "--ntasks=1", "--signal=B:TERM@60"])
            .arg(format!("--job-name={}", plan.name()))
            .arg(format!("--array={}", ranges(&wanted)))
            .arg(format!("--cpus-per-task={threads}"))
            .arg(format!("--time={minutes}"))
            .arg(format!("--mem={megabytes}M"))
            .arg(format!("--chdir={folder}"))
            .arg(format!("--output={folder}/log/%A_%a.out"))
            .args(args);
        let said = run(&mut sbatch, Some(&self.script()?)).map_err(|said| {
            BadInput::new(format!("Slurm takes no job: {said}")).with_help(
                "`--sbatch-arg` adds what your site asks for, as in `--sbatch-arg=--partition=NAME`; it may also say less memory or time",
            )
        })?;
        let job = said.trim().split(';').next().unwrap_or_default().to_owned();
        let tasks = wanted.len();
        progress.say(&format!(
            "submitted {tasks} tasks as job {job}, logs are in {folder}/log; `scancel {job}` ends them"
        ));
        Ok(())
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
            // A task that has not begun has no results; a shard that nobody knows of may have.
            let waits: BTreeSet<usize> = last
                .iter()
                .filter(|task| !silent && task.state == "PENDING")
                .map(|task| task.shard)
                .collect();
            self.look(|shard| !waits.contains(&shard), true);
            if self.missing.is_empty() {
                if last.iter().any(|task| !task.is_running()) {
                    // They would find everything done; those that are held would never. Best effort: they harm nobody.
                    let name = format!("--name={}", self.plan.name());
                    let _ = run(Command::new("scancel").args(["--me", "--state=PENDING"]).arg(name), None);
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
                        self.tell_of_end(*shard, ended.len(), progress);
                    }
                }
                ended.retain(|shard| gone.contains_key(shard));
                let left: Vec<&Task> = last.iter().filter(|task| unfinished.contains(&task.shard)).collect();
                for task in left.iter().filter(|task| task.is_held()) {
                    if told.insert(task.id.clone()) {
                        progress.say(&format!("task {} is held: {}", task.id, task.reason));
                    }
                }
                for task in left.iter().filter(|task| task.is_stuck()) {
                    if told.insert(task.reason.clone()) {
                        let drained = task.reason.contains("DRAINED");
                        let help = if drained { ": `sinfo -R` says why nodes are" } else { "" };
                        progress.say(&format!("task {} waits: {}{help}", task.id, task.reason));
                    }
                }
                if left.iter().all(|task| task.is_held())
                    && unfinished.iter().all(|shard| ended.contains(shard) || queued.contains(shard))
                {
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
        let missing = self.missing.iter().filter(|point| self.shard_of[point] == shard).count();
        let all = self.plan.shards[shard].points.len();
        let mut text = format!("shard {shard} has ended and misses {missing} of its {all} points");
        if ended <= LOGS_MAX {
            match last_log(&self.plan.folder.join("log"), shard) {
                Some((path, lines)) => text += &format!("; {} ends with:{lines}", path.display()),
                None => text += "; it has left no log",
            }
        }
        progress.say(&text);
    }

    fn tell_of_rest(&self, held: &[&Task], ended: usize, progress: &dyn StudyProgress) {
        let mut text = format!("{} points are missing, and nothing computes them", self.missing.len());
        if ended > 0 {
            text += &format!(": {ended} shards have ended without them");
        }
        if !held.is_empty() {
            let ids: BTreeSet<&str> =
                held.iter().map(|task| task.id.split('_').next().unwrap_or(&task.id)).collect();
            let ids: Vec<&str> = ids.into_iter().collect();
            text += &format!(
                "; {} tasks are held: `scontrol release {}` lets them go on, or `scancel {}` ends them; nodes that are drained `scontrol update nodename=NAME state=resume` puts back",
                held.len(),
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

    /// Whether it waits until somebody lets it go on.
    fn is_held(&self) -> bool {
        self.reason.to_ascii_lowercase().contains("held")
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
        self.state == "PENDING" && !self.is_held() && !USUAL.contains(&self.reason.as_str())
    }
}

/// The tasks of this name that are queued or running; what Slurm said where it does not tell.
fn queue(name: &str) -> Result<Vec<Task>, String> {
    let mut squeue = Command::new("squeue");
    squeue.args(["--noheader", "--array", "--me", "--format=%F_%K|%K|%T|%r"]).arg(format!("--name={name}"));
    Ok(tasks(&run(&mut squeue, None)?))
}

/// Tasks in the text of `squeue`.
fn tasks(text: &str) -> Vec<Task> {
    let task = |line: &str| {
        let mut parts = line.trim().splitn(4, '|').map(str::to_owned);
        let (id, shard) = (parts.next()?, parts.next()?.parse().ok()?);
        Some(Task { id, shard, state: parts.next()?, reason: parts.next().unwrap_or_default() })
    };
    text.lines().filter_map(task).collect()
}

/// CPUs of the cluster, over all of the largest partition; 0 where Slurm does not say.
fn cpus() -> usize {
    let text = run(Command::new("sinfo").args(["--noheader", "--format=%C"]), None).unwrap_or_default();
    // Allocated, idle, other, total.
    text.lines().filter_map(|line| line.trim().rsplit('/').next()?.parse().ok()).max().unwrap_or(0)
}

/// Tasks that an array may have.
fn array_size_max() -> usize {
    let text = run(Command::new("scontrol").args(["show", "config"]), None).unwrap_or_default();
    let line = text
        .lines()
        .find_map(|line| line.strip_prefix("MaxArraySize")?.split('=').nth(1)?.trim().parse().ok());
    line.filter(|size| *size > 1).unwrap_or(ARRAY_SIZE_MAX)
}

/// What a command of Slurm prints; where it fails, what it says of that.
fn run(command: &mut Command, input: Option<&str>) -> Result<String, String> {
    let program = command.get_program().to_string_lossy().into_owned();
    let failed = |error: std::io::Error| match error.kind() {
        std::io::ErrorKind::NotFound => format!("`{program}` is not on the path"),
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
        let text = "12_0|0|RUNNING|None\n12_3|3|PENDING|launch failed requeued held\n12_4|4|PENDING|JobHeldUser\n 12_5|5|PENDING|QOSMaxJobsPerUserLimit\nnoise\n";
        let tasks = tasks(text);
        assert_eq!(tasks.iter().map(|task| task.shard).collect::<Vec<_>>(), [0, 3, 4, 5]);
        assert_eq!(tasks.iter().map(Task::is_running).collect::<Vec<_>>(), [true, false, false, false]);
        assert_eq!(tasks.iter().map(Task::is_held).collect::<Vec<_>>(), [false, true, true, false]);
        assert_eq!(tasks.iter().map(Task::is_stuck).collect::<Vec<_>>(), [false, false, false, true]);
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
