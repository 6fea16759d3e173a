//! Where host time goes: the stages of a run, by what it tells of its progress.

use std::sync::Mutex;
use std::time::Duration;

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::Quiet;

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
}
