//! How the points of a study ended, and how long those that have not may take.

use super::forecast::Forecast;
use super::run::Status;
use super::work::Work;

/// How a point ended: the error where it has no result.
pub(super) type Outcome = Result<(), String>;

/// The points of a study, with how each ended that is over.
pub(super) struct Ledger {
    /// What is known of the cost of all points.
    pub forecast: Forecast,
    over: Vec<Option<Outcome>>,
    found: usize,
    computed: usize,
    failed: usize,
}

impl Ledger {
    /// So many points, of which none is over.
    pub fn new(points: usize, forecast: Forecast) -> Ledger {
        Ledger { forecast, over: vec![None; points], found: 0, computed: 0, failed: 0 }
    }

    /// The points of `work`, of which those are over that need not be looked for: some cannot be run, and doubles of another
    /// point have its result.
    pub fn of(work: &Work) -> Ledger {
        let mut ledger = Ledger::new(work.tasks.len(), work.forecast());
        for (index, task) in work.tasks.iter().enumerate() {
            match task {
                Err(error) => ledger.end(index, Err(error.clone()), false),
                Ok(_) if work.first[index] != index => {
                    ledger.found += 1;
                    ledger.forecast.gone(index);
                }
                Ok(_) => {}
            }
        }
        ledger
    }

    /// Takes down how a point ended: after how many seconds, or why it has no result; `computed`: by this call.
    pub fn end(&mut self, point: usize, outcome: Result<f64, String>, computed: bool) {
        match &outcome {
            Ok(seconds) => {
                *(if computed { &mut self.computed } else { &mut self.found }) += 1;
                self.forecast.done(point, *seconds);
            }
            Err(_) => {
                self.failed += 1;
                self.forecast.gone(point);
            }
        }
        self.over[point] = Some(outcome.map(|_| ()));
    }

    /// How far the study is `now`, in seconds since its start; `seconds_left` as far as that is known.
    pub fn status(&self, running: usize, now: f64, seconds_left: Option<f64>) -> Status {
        Status {
            points: self.over.len(),
            found: self.found,
            computed: self.computed,
            failed: self.failed,
            running,
            queued: 0,
            part_done: self.forecast.part_done(now),
            seconds: now,
            seconds_left,
        }
    }

    /// How each point of `work` ended, doubles as their first.
    ///
    /// # Panics
    /// Where one is not over.
    pub fn outcomes(self, work: &Work) -> Vec<Outcome> {
        work.first.iter().map(|first| self.over[*first].clone().expect("every point is over")).collect()
    }
}
