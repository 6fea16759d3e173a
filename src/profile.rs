//! Where host time goes: the stages of a run, by what it tells of its progress, and the kinds of work in its steps.

use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

use lrbsim_machine::work::{Watched, Work};
use lrbsim_reports::sheet::{Cell, Sheet};

use crate::host::{CpuWatch, Stopwatch, peak_rss_bytes};
use crate::progress::Progress;

/// Stage of the host's work between the steps of a program: what it puts into the simulated memory, which steps it hands over.
const BETWEEN_STEPS: &str = "between steps";

/// Hears of a run's progress, tells somebody else of it, and takes the time between one stage and the next.
pub struct Profiler<'a> {
    listener: &'a dyn Progress,
    stages: Mutex<Stages>,
}

/// Stages so far, in the order of their beginnings.
struct Stages {
    ended: Vec<Stage>,
    name: String,
    watch: Stopwatch,
    cpu: CpuWatch,
}

/// What a stage took, all of its turns together.
#[derive(Debug, Clone, PartialEq)]
pub struct Stage {
    /// What the stage is called.
    pub name: String,
    /// Time that passed.
    pub wall: Duration,
    /// Processor time of all host threads.
    pub cpu: Duration,
    /// Greatest resident memory of the process from its beginning to the last end of this stage; `None` where the host does not tell.
    pub peak_rss_bytes: Option<u64>,
}

impl<'a> Profiler<'a> {
    /// A profiler whose first stage is `name`, and that passes on to `listener` what it hears.
    pub fn new(name: &str, listener: &'a dyn Progress) -> Profiler<'a> {
        let stages = Stages {
            ended: Vec::new(),
            name: name.to_owned(),
            watch: Stopwatch::start(),
            cpu: CpuWatch::start(),
        };
        Profiler { listener, stages: Mutex::new(stages) }
    }

    /// Ends the running stage, and begins stage `name`.
    fn begin(&self, name: &str) {
        let mut stages = self.stages.lock().expect("nothing panics while it takes the time");
        stages.end();
        name.clone_into(&mut stages.name);
    }

    /// Ends the last stage; all that there were.
    pub fn finish(self) -> Vec<Stage> {
        let mut stages = self.stages.into_inner().expect("nothing panics while it takes the time");
        stages.end();
        stages.ended
    }
}

impl Stages {
    /// Adds the running stage to those that have ended.
    fn end(&mut self) {
        let (wall, cpu) = (self.watch.elapsed(), self.cpu.elapsed());
        (self.watch, self.cpu) = (Stopwatch::start(), CpuWatch::start());
        let stage = match self.ended.iter_mut().find(|stage| stage.name == self.name) {
            Some(stage) => stage,
            None => {
                let zero = Duration::ZERO;
                self.ended.push(Stage {
                    name: self.name.clone(),
                    wall: zero,
                    cpu: zero,
                    peak_rss_bytes: None,
                });
                self.ended.last_mut().expect("it was added")
            }
        };
        stage.wall += wall;
        stage.cpu += cpu;
        stage.peak_rss_bytes = peak_rss_bytes();
    }
}

impl Progress for Profiler<'_> {
    fn part(&self, what: &str) {
        self.begin(what);
        self.listener.part(what);
    }

    fn counted(&self, what: &str, count: u32) {
        self.begin(what);
        self.listener.counted(what, count);
    }

    fn one_done(&self) {
        self.listener.one_done();
    }

    fn step(&self, title: &str, tasks: u32) {
        self.begin(title);
        self.listener.step(title, tasks);
    }

    fn task(&self, uops: u64) {
        self.listener.task(uops);
    }

    fn skipped(&self, tasks: u32) {
        self.listener.skipped(tasks);
    }

    fn uops(&self, uops: u64) {
        self.begin(BETWEEN_STEPS);
        self.listener.uops(uops);
    }
}

/// A table of stages for people.
pub fn sheet(stages: &[Stage]) -> Sheet {
    let all: Duration = stages.iter().map(|stage| stage.wall).sum();
    let row = |name: &str, wall: Duration, cpu: Duration, peak: Option<u64>| {
        let share = 100.0 * wall.as_secs_f64() / all.as_secs_f64().max(1e-9);
        vec![
            Cell::Text(name.to_owned()),
            Cell::Text(format!("{:.3}", wall.as_secs_f64())),
            Cell::Text(format!("{:.3}", cpu.as_secs_f64())),
            Cell::Text(format!("{share:.1} %")),
            Cell::Text(peak.map_or_else(String::new, |bytes| format!("{:.0}", bytes as f64 / 1e6))),
        ]
    };
    let mut rows: Vec<Vec<Cell>> =
        stages.iter().map(|stage| row(&stage.name, stage.wall, stage.cpu, stage.peak_rss_bytes)).collect();
    let peak = stages.iter().filter_map(|stage| stage.peak_rss_bytes).max();
    rows.push(row("all", all, stages.iter().map(|stage| stage.cpu).sum(), peak));
    let columns = ["host time of", "s", "processor s", "share", "peak so far, MB"].map(str::to_owned).into();
    Sheet { columns, rows }
}

/// Time between two looks at what host threads are doing.
const PERIOD: Duration = Duration::from_micros(500);

/// A thread that looks at what the others are doing, until it is told to end or nobody waits for what it sees.
pub struct Looker {
    is_over: Arc<AtomicBool>,
    thread: Option<JoinHandle<[Duration; Work::COUNT]>>,
}

impl Looker {
    /// Begins to look.
    ///
    /// # Errors
    /// If the host gives no thread.
    pub fn start() -> std::io::Result<Looker> {
        let is_over = Arc::new(AtomicBool::new(false));
        let (until, watched) = (Arc::clone(&is_over), Watched::begin());
        let thread =
            std::thread::Builder::new().name("profile".to_owned()).spawn(move || look(&until, &watched))?;
        Ok(Looker { is_over, thread: Some(thread) })
    }

    /// Ends it: the time that host threads spent on each kind of work, all together, in the order of [`Work::ALL`].
    pub fn finish(mut self) -> [Duration; Work::COUNT] {
        self.is_over.store(true, Relaxed);
        let thread = self.thread.take().expect("it ends once");
        thread.join().expect("who only looks does not panic")
    }
}

impl Drop for Looker {
    fn drop(&mut self) {
        self.is_over.store(true, Relaxed);
    }
}

fn look(is_over: &AtomicBool, watched: &Watched) -> [Duration; Work::COUNT] {
    let mut spent = [Duration::ZERO; Work::COUNT];
    let mut watch = Stopwatch::start();
    while !is_over.load(Relaxed) {
        std::thread::sleep(PERIOD);
        let since = watch.elapsed();
        watch = Stopwatch::start();
        for work in watched.now() {
            spent[work as usize] += since;
        }
    }
    spent
}

/// A table for people of what host threads did in steps, all together; works that none did are left out. `None` where nothing was seen.
///
/// A thread that waits for a processor of the host counts as one that works.
pub fn work_sheet(spent: &[Duration; Work::COUNT]) -> Option<Sheet> {
    let all: Duration = spent.iter().sum();
    let row = |title: &str, spent: Duration| {
        let share = 100.0 * spent.as_secs_f64() / all.as_secs_f64();
        vec![
            Cell::Text(title.to_owned()),
            Cell::Text(format!("{:.3}", spent.as_secs_f64())),
            Cell::Text(format!("{share:.1} %")),
        ]
    };
    let done = Work::ALL.into_iter().zip(spent).filter(|(_, spent)| !spent.is_zero());
    let rows = done.map(|(work, spent)| row(work.title(), *spent));
    let rows = rows.chain(std::iter::once(row("all", all))).collect();
    let columns = ["in steps, by kind of work", "thread-seconds", "share"].map(str::to_owned).into();
    (!all.is_zero()).then_some(Sheet { columns, rows })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::Quiet;
    use lrbsim_machine::work::doing;

    #[test]
    fn time_goes_to_what_threads_are_doing() {
        let looker = Looker::start().expect("a thread");
        let long = Duration::from_millis(60);
        {
            let _work = doing(Work::Other);
            std::thread::sleep(long);
        }
        let spent = looker.finish();
        assert!(spent[Work::Other as usize] >= long / 2, "{spent:?}");
    }

    #[test]
    fn stages_come_in_order_and_their_turns_are_added() {
        let profiler = Profiler::new("scene", &Quiet);
        profiler.part("eye view");
        for _ in 0..2 {
            profiler.step("binning", 3);
            profiler.uops(100);
        }
        profiler.part("output");
        let stages = profiler.finish();
        let names: Vec<&str> = stages.iter().map(|stage| stage.name.as_str()).collect();
        assert_eq!(names, ["scene", "eye view", "binning", BETWEEN_STEPS, "output"]);
        let sheet = sheet(&stages);
        assert_eq!(sheet.rows.len(), 6);
        let last = sheet.rows[5].iter().map(Cell::shown).collect::<Vec<_>>();
        assert_eq!((last[0].as_str(), last[3].as_str()), ("all", "100.0 %"));
    }

    #[test]
    fn works_that_nobody_does_have_no_row() {
        let mut spent = [Duration::ZERO; Work::COUNT];
        spent[Work::Uncore as usize] = Duration::from_millis(250);
        spent[Work::Issue as usize] = Duration::from_millis(750);
        let works = work_sheet(&spent).expect("something was done");
        let shown = |row: &Vec<Cell>| row.iter().map(Cell::shown).collect::<Vec<_>>();
        assert_eq!(works.rows.len(), 3, "nobody did anything else");
        assert_eq!(shown(&works.rows[1]), ["uncore", "0.250", "25.0 %"]);
        assert_eq!(shown(&works.rows[2]), ["all", "1.000", "100.0 %"]);
        assert_eq!(work_sheet(&[Duration::ZERO; Work::COUNT]), None);
    }
}
