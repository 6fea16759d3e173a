//! Threads that run the points that are not finished yet, the dearest first, as many at once as fit in memory.

use std::collections::{BTreeMap, VecDeque};
use std::panic::AssertUnwindSafe;
use std::sync::{Condvar, Mutex, MutexGuard};
use std::time::Duration;

use lrbsim_machine::Seats;

use super::cache::{Cache, Claim, Entry};
use super::ledger::{Ledger, Outcome};
use super::run::{Status, StudyProgress};
use super::work::{Fault, Task, Work, said};
use crate::error::BadInput;
use crate::host::Stopwatch;

/// How often progress is told, and how long a point waits for memory or another process before it asks again.
const TICK: Duration = Duration::from_millis(100);

/// Machines that one functional run serves at most: they end together, and whoever stops a study loses together those that are under way.
const TOGETHER_MAX: usize = 8;

/// Machines that are not simulated, each of which takes next to no time, that one functional run serves at most.
const COUNTED_TOGETHER_MAX: usize = 256;

/// Where points that are finished are found, and where they are put.
pub(super) trait Store: Sync {
    /// What is known of a point that is over: the seconds that it took, or why it has no result.
    fn find(&self, key: &str) -> Option<Result<f64, String>>;

    /// Claims a point; `None` while another process computes it and, for `waited` seconds so far, is waited for.
    fn claim(&self, key: &str, waited: f64) -> Result<Option<Claim>, BadInput>;

    /// The cache that finished points are in.
    fn cache(&self) -> &Cache;

    /// Keeps how a claimed point ended.
    fn keep(&self, claim: &Claim, task: &Task, outcome: Result<&mut Entry, &Fault>) -> Result<(), BadInput>;
}

/// Runs the points of `work` that `store` has not, on `jobs` threads at once, and tells how each ended. Points take no more than
/// `memory_budget` bytes together, but for one that takes more alone.
pub(super) fn run(
    work: &Work,
    store: &dyn Store,
    (jobs, memory_budget): (usize, u64),
    watch: Stopwatch,
    progress: &dyn StudyProgress,
) -> Result<(Vec<Outcome>, Status), BadInput> {
    let crew = Crew::new(work, store, (jobs, memory_budget), watch);
    std::thread::scope(|scope| {
        for _ in 0..jobs.max(1) {
            scope.spawn(|| crew.work());
        }
        crew.watch(jobs, progress);
    });
    store.cache().tidy(&work.tasks.iter().flatten().map(|task| task.key.as_str()).collect());
    let state = crew.state.into_inner().expect("nobody panics with the state in hand");
    let status = state.status(jobs, watch.elapsed().as_secs_f64());
    if let Some(bad) = state.fatal {
        return Err(bad);
    }
    Ok((state.ledger.outcomes(work), status))
}

/// Points like `task` that one functional run serves at most.
fn together_max(task: &Task) -> usize {
    if task.is_simulated() { TOGETHER_MAX } else { COUNTED_TOGETHER_MAX }
}

/// The threads and what they share.
struct Crew<'a> {
    work: &'a Work<'a>,
    store: &'a dyn Store,
    watch: Stopwatch,
    memory_budget: u64,
    /// Threads that compute at once, in whatever run.
    seats: Seats,
    state: Mutex<State>,
    changed: Condvar,
}

/// Points that one functional run serves, or one alone.
type Group = Vec<usize>;

struct State {
    waiting: VecDeque<Group>,
    /// Since when another process computes a point, in seconds.
    busy: BTreeMap<usize, f64>,
    /// Points that are running, in so many groups, and the threads that this takes.
    running: usize,
    groups: usize,
    threads: usize,
    memory: u64,
    ledger: Ledger,
    /// Why the crew cannot go on.
    fatal: Option<BadInput>,
}

impl State {
    /// Whether a point of this size may run too. One runs always: there is no better moment for it.
    fn has_room(&self, memory: u64, budget: u64) -> bool {
        self.running == 0 || self.memory.saturating_add(memory) <= budget
    }

    fn is_over(&self) -> bool {
        self.running == 0 && (self.waiting.is_empty() || self.fatal.is_some())
    }

    fn status(&self, jobs: usize, now: f64) -> Status {
        self.ledger.status(self.running, now, self.ledger.forecast.left(now, jobs))
    }
}

impl<'a> Crew<'a> {
    fn new(
        work: &'a Work<'a>,
        store: &'a dyn Store,
        (jobs, memory_budget): (usize, u64),
        watch: Stopwatch,
    ) -> Crew<'a> {
        let mut state = State {
            waiting: VecDeque::new(),
            busy: BTreeMap::new(),
            running: 0,
            groups: 0,
            threads: 0,
            memory: 0,
            ledger: Ledger::of(work),
            fatal: None,
        };
        // By what they have in common, the number of the last group of them.
        let mut last: BTreeMap<&str, usize> = BTreeMap::new();
        for (index, task) in work.tasks.iter().enumerate() {
            let Ok(task) = task else { continue };
            if work.first[index] != index {
                continue;
            }
            if let Some(outcome) = store.find(&task.key) {
                state.ledger.end(index, outcome, false);
                continue;
            }
            let together = task.together.as_deref();
            let group = together.and_then(|together| last.get(together));
            match group.map(|group| &mut state.waiting[*group]) {
                Some(group) if group.len() < together_max(task) => group.push(index),
                _ => {
                    together.map(|together| last.insert(together, state.waiting.len()));
                    state.waiting.push_back(vec![index]);
                }
            }
        }
        // The dearest first: the end is then not one worker's.
        let cost = |group: &Group| -> f64 {
            group.iter().filter_map(|index| work.tasks[*index].as_ref().ok()).map(|task| task.work).sum()
        };
        state.waiting.make_contiguous().sort_by(|a, b| cost(b).total_cmp(&cost(a)));
        let seats = Seats::new(jobs);
        Crew { work, store, watch, memory_budget, seats, state: Mutex::new(state), changed: Condvar::new() }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().expect("nobody panics with the state in hand")
    }

    fn now(&self) -> f64 {
        self.watch.elapsed().as_secs_f64()
    }

    /// Tells of the progress until all is done.
    fn watch(&self, jobs: usize, progress: &dyn StudyProgress) {
        let mut state = self.state();
        while !state.is_over() {
            progress.status(&state.status(jobs, self.now()));
            // Points end by the thousand in a second; what they did is told ten times.
            let wait = self.changed.wait_timeout_while(state, TICK, |state| !state.is_over());
            state = wait.expect("nobody panics with the state in hand").0;
        }
    }

    /// Runs points until there are none.
    fn work(&self) {
        while let Some(points) = self.next() {
            // A thread that dies would be waited for without end.
            let computed = std::panic::catch_unwind(AssertUnwindSafe(|| self.compute(&points)));
            let attempts = computed.unwrap_or_else(|panic| {
                let said = said(panic.as_ref());
                let point = self.task(points[0]).point;
                Err(BadInput::new(format!("point {point}: lrbsim itself failed: {said}")))
            });
            let mut state = self.state();
            state.running -= points.len();
            state.groups -= 1;
            state.threads -= self.threads(&points);
            state.memory -= self.memory(&points);
            match attempts {
                Ok(attempts) => {
                    for (index, attempt) in points.into_iter().zip(attempts) {
                        match attempt {
                            Attempt::Busy => {
                                let now = self.now();
                                state.busy.entry(index).or_insert(now);
                                state.waiting.push_back(vec![index]);
                            }
                            Attempt::Found(outcome) => state.ledger.end(index, outcome, false),
                            Attempt::Ran(outcome) => state.ledger.end(index, outcome, true),
                        }
                    }
                }
                Err(bad) => state.fatal = Some(bad),
            }
            self.changed.notify_all();
        }
    }

    fn task(&self, index: usize) -> &'a Task {
        self.work.tasks[index].as_ref().expect("only points that can be run wait")
    }

    /// Bytes that points take together.
    fn memory(&self, points: &[usize]) -> u64 {
        Task::memory(&points.iter().map(|index| self.task(*index)).collect::<Vec<_>>())
    }

    /// Threads that points take: one for each machine, where each has one, and one where all that differs is counted.
    fn threads(&self, points: &[usize]) -> usize {
        if self.task(points[0]).is_simulated() { points.len() } else { 1 }
    }

    /// The next points for which there is room; waits for them.
    fn next(&self) -> Option<Group> {
        let mut state = self.state();
        loop {
            if state.waiting.is_empty() || state.fatal.is_some() {
                return None;
            }
            // More machines than threads do not end sooner, and nothing of them is finished while they all run; but the last
            // machines of a group leave threads to the next.
            let place = if state.threads >= self.seats.count() && state.groups > 1 {
                None
            } else if state.running == 0 {
                Some(0)
            } else {
                let fits = |group: &Group| state.has_room(self.memory(group), self.memory_budget);
                state.waiting.iter().position(fits)
            };
            if let Some(mut points) = place.and_then(|place| state.waiting.remove(place)) {
                // What does not fit is another group's.
                let mut rest = Vec::new();
                while points.len() > 1 && self.memory(&points) > self.memory_budget {
                    rest.extend(points.pop());
                }
                if !rest.is_empty() {
                    state.waiting.push_front(rest);
                }
                state.running += points.len();
                state.groups += 1;
                state.threads += self.threads(&points);
                state.memory += self.memory(&points);
                let now = self.now();
                let part = self.seats.count().min(points.len()) as f64 / points.len() as f64;
                points.iter().for_each(|index| state.ledger.forecast.begin(*index, now, part));
                return Some(points);
            }
            state = self.changed.wait_timeout(state, TICK).expect("nobody panics with the state in hand").0;
        }
    }

    /// Runs points that go together, but for those that other processes compute or have computed.
    fn compute(&self, points: &[usize]) -> Result<Vec<Attempt>, BadInput> {
        let mut attempts: Vec<Attempt> = Vec::new();
        let mut claimed: Vec<(usize, Claim)> = Vec::new();
        for (place, index) in points.iter().enumerate() {
            let waited = self.state().busy.get(index).map_or(0.0, |since| self.now() - since);
            let key = &self.task(*index).key;
            attempts.push(match self.store.claim(key, waited)? {
                None => Attempt::Busy,
                Some(claim) => match self.store.find(key) {
                    Some(outcome) => Attempt::Found(outcome),
                    None => {
                        claimed.push((place, claim));
                        // Until it is known how it ends.
                        Attempt::Busy
                    }
                },
            });
        }
        if claimed.is_empty() {
            std::thread::sleep(TICK);
            return Ok(attempts);
        }
        let tasks: Vec<&Task> = claimed.iter().map(|(place, _)| self.task(points[*place])).collect();
        let outcomes = self.work.run(&tasks, &self.seats, self.store.cache().folder());
        let mut lost = None;
        for (((place, claim), task), mut outcome) in claimed.iter().zip(tasks).zip(outcomes) {
            // All are kept that can be.
            if let Err(bad) = self.store.keep(claim, task, outcome.as_mut().map_err(|fault| &*fault)) {
                lost.get_or_insert(bad);
            }
            attempts[*place] =
                Attempt::Ran(outcome.map(|entry| entry.host.seconds).map_err(|fault| fault.message));
        }
        lost.map_or(Ok(attempts), Err)
    }
}

/// How it went when a thread took a point.
enum Attempt {
    /// Another process computes the point.
    Busy,
    /// Another process has finished the point.
    Found(Result<f64, String>),
    /// The thread has run the point.
    Ran(Result<f64, String>),
}

#[cfg(test)]
mod tests {
    use super::super::file::Study;
    use super::super::forecast::Forecast;
    use super::*;
    use crate::progress::Quiet;

    /// A store that does not work.
    struct Broken(Cache);

    impl Store for Broken {
        fn find(&self, _key: &str) -> Option<Result<f64, String>> {
            None
        }

        fn claim(&self, _key: &str, _waited: f64) -> Result<Option<Claim>, BadInput> {
            panic!("nobody can claim a point")
        }

        fn cache(&self) -> &Cache {
            &self.0
        }

        fn keep(&self, _: &Claim, _: &Task, _: Result<&mut Entry, &Fault>) -> Result<(), BadInput> {
            Ok(())
        }
    }

    #[test]
    fn a_thread_that_panics_ends_the_crew_and_is_not_waited_for() {
        let text = r#"{"name": "x", "base": {"scene": "tiny", "fidelity": "functional"},
            "axes": [{"path": "cores", "values": [1, 2, 3]}]}"#;
        let study = Study::from_text("x.json", text, None, false).expect("sound");
        let work = Work::of(&study, 0..study.len()).expect("sound");
        let folder = tempfile::tempdir().expect("a temporary folder");
        let store = Broken(Cache::open(folder.path()).expect("writable"));
        let ended = run(&work, &store, (2, u64::MAX), Stopwatch::start(), &Quiet);
        let said = ended.expect_err("no point has a result").to_string();
        assert!(said.contains("nobody can claim a point"), "{said}");
    }

    #[test]
    fn points_run_together_only_as_far_as_they_fit() {
        let mut state = State {
            waiting: VecDeque::new(),
            busy: BTreeMap::new(),
            running: 0,
            groups: 0,
            threads: 0,
            memory: 0,
            ledger: Ledger::new(0, Forecast::new(std::iter::empty())),
            fatal: None,
        };
        assert!(state.has_room(1000, 100), "one runs, however large");
        (state.running, state.memory) = (1, 60);
        assert!(state.has_room(40, 100) && !state.has_room(41, 100) && !state.has_room(u64::MAX, 100));
    }
}
