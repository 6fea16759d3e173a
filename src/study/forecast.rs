//! How long the rest of a study takes, also when its points differ a hundredfold in cost.

use std::collections::BTreeMap;

/// What is known about the cost of a study's points.
///
/// A point has an estimate of its work. Host seconds per work are learned from finished points of the same kind; where
/// there is none yet, from all finished points.
#[derive(Debug, Clone)]
pub struct Forecast {
    points: Vec<Cost>,
    /// What finished points of each kind took. Sums: a study of many points asks many times a second.
    kinds: Vec<Taken>,
    /// What all finished points took.
    all: Taken,
}

#[derive(Debug, Clone)]
struct Cost {
    work: f64,
    /// Number of its kind.
    kind: usize,
    state: State,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum State {
    Waiting,
    /// The point has been running since this second, and has this part of a host thread.
    Running(f64, f64),
    /// The point is finished, has failed, or is not run.
    Over,
}

/// Seconds that some work took.
#[derive(Debug, Clone, Copy, Default)]
struct Taken {
    seconds: f64,
    work: f64,
}

impl Taken {
    fn add(&mut self, seconds: f64, work: f64) {
        self.seconds += seconds;
        self.work += work;
    }

    fn rate(&self) -> Option<f64> {
        (self.work > 0.0).then(|| self.seconds / self.work)
    }
}

impl Forecast {
    /// Points of known work and kind, none of them begun.
    pub fn new(points: impl Iterator<Item = (f64, String)>) -> Forecast {
        let mut kinds = BTreeMap::new();
        let mut cost = |(work, kind)| {
            let number = kinds.len();
            Cost { work, kind: *kinds.entry(kind).or_insert(number), state: State::Waiting }
        };
        let points = points.map(&mut cost).collect();
        Forecast { points, kinds: vec![Taken::default(); kinds.len()], all: Taken::default() }
    }

    /// A point begins at second `now`, with such a part of a host thread: one that shares a run with others has less than all of one.
    pub fn begin(&mut self, point: usize, now: f64, part: f64) {
        self.points[point].state = State::Running(now, part);
    }

    /// A point took this long, now or earlier.
    pub fn done(&mut self, point: usize, seconds: f64) {
        let point = &mut self.points[point];
        point.state = State::Over;
        let seconds = seconds.max(1e-3);
        self.kinds[point.kind].add(seconds, point.work);
        self.all.add(seconds, point.work);
    }

    /// A point will not be run, or has failed: its cost is not known.
    pub fn gone(&mut self, point: usize) {
        self.points[point].state = State::Over;
    }

    /// Seconds that a point takes; `None` while nothing is finished.
    pub fn seconds(&self, point: usize) -> Option<f64> {
        self.cost(&self.points[point])
    }

    fn cost(&self, point: &Cost) -> Option<f64> {
        Some(point.work * self.kinds[point.kind].rate().or_else(|| self.all.rate())?)
    }

    /// Seconds from `now` to the end with `jobs` points at once; `None` while nothing is known.
    pub fn left(&self, now: f64, jobs: usize) -> Option<f64> {
        let (mut sum, mut longest) = (0.0, 0.0_f64);
        for point in &self.points {
            let (left, part) = match point.state {
                State::Waiting => (self.cost(point)?, 1.0),
                // A point that takes longer than was thought is believed to be nearly done, never to be done.
                State::Running(since, part) => {
                    let whole = self.cost(point)?;
                    ((whole - (now - since) * part).max(whole * 0.05), part)
                }
                State::Over => (0.0, 1.0),
            };
            sum += left;
            longest = longest.max(left / part);
        }
        Some((sum / jobs.max(1) as f64).max(longest))
    }

    /// Part of the whole work that is done, in [0, 1].
    pub fn part_done(&self, now: f64) -> f64 {
        let (mut done, mut all) = (0.0, 0.0);
        for point in &self.points {
            let part = match point.state {
                State::Waiting => 0.0,
                State::Running(since, part) => {
                    self.cost(point).map_or(0.0, |whole| ((now - since) * part / whole).clamp(0.0, 0.95))
                }
                State::Over => 1.0,
            };
            done += part * point.work;
            all += point.work;
        }
        if all > 0.0 { done / all } else { 1.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Work of points that differ a hundredfold, dear ones last, and of two kinds whose rates differ tenfold.
    fn points() -> Vec<(f64, String, f64)> {
        let work = [1.0, 2.0, 1.0, 5.0, 20.0, 100.0, 50.0, 100.0];
        let kinds = ["windowed", "cycle"];
        (0..8)
            .map(|i| {
                let kind = kinds[i % 2];
                let noise = 1.0 + 0.1 * ((i * 7 % 5) as f64 - 2.0) / 2.0;
                (work[i], kind.to_owned(), work[i] * noise * if kind == "cycle" { 10.0 } else { 1.0 })
            })
            .collect()
    }

    #[test]
    fn the_time_left_is_true_when_points_differ_a_hundredfold() {
        let points = points();
        let mut forecast = Forecast::new(points.iter().map(|(work, kind, _)| (*work, kind.clone())));
        let mut now = 0.0;
        assert_eq!(forecast.left(now, 1), None, "nothing is known yet");
        for (index, (_, _, seconds)) in points.iter().enumerate() {
            forecast.begin(index, now, 1.0);
            now += seconds;
            forecast.done(index, *seconds);
            let truth: f64 = points[index + 1..].iter().map(|point| point.2).sum();
            let left = forecast.left(now, 1).expect("something is known");
            // From the second point on, both kinds are known, as well as points of one kind are alike: within a tenth.
            if index >= 1 {
                assert!((left - truth).abs() <= 0.2 * truth, "after {index}: {left} of {truth}");
            }
        }
        assert_eq!((forecast.left(now, 1), forecast.part_done(now)), (Some(0.0), 1.0));
    }

    #[test]
    fn one_long_point_is_not_shared_between_jobs() {
        let mut forecast = Forecast::new([(1.0, String::new()), (100.0, String::new())].into_iter());
        forecast.done(0, 1.0);
        forecast.begin(1, 1.0, 1.0);
        assert_eq!(forecast.left(1.0, 8), Some(100.0));
        assert_eq!(forecast.left(51.0, 8), Some(50.0));
        assert_eq!(forecast.left(500.0, 8), Some(5.0));
    }

    #[test]
    fn finished_points_of_an_earlier_run_teach_too() {
        let mut forecast = Forecast::new([(1.0, String::new()), (4.0, String::new())].into_iter());
        forecast.done(0, 2.0);
        assert_eq!((forecast.left(0.0, 1), forecast.part_done(0.0)), (Some(8.0), 0.2));
    }
}
