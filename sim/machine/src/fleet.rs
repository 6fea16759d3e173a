//! One run of a program on many machines: its tasks are run once, for all of them.

use crate::chip::{CoreActivity, Stuck};
use crate::config::MachineSpec;
use crate::counters::StepReport;
use crate::fidelity::Fidelity;
use crate::roofline::{Machine, Survey};
use crate::tape::{Seat, Seats, Tape, TapedStep};
use crate::timing::{Timing, Untimed};
use lrbsim_isa::program::TaskSource;
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// What a step cost on a machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StepCost {
    /// What the step measured.
    pub report: StepReport,
    /// What each core did, by core; empty where nothing is timed.
    pub activity: Vec<CoreActivity>,
}

/// Why a machine of several has no result.
#[derive(Debug)]
pub enum Failure {
    /// In the step of this name nothing moved any more.
    Stuck(String, Stuck),
    /// A law was broken: what the simulator said when it stopped.
    Panic(Box<dyn Any + Send>),
    /// The host gave no thread.
    Thread(std::io::Error),
}

/// What a machine of several made of all steps.
pub type Costs = Result<Vec<StepCost>, Failure>;

/// What a program hands the tasks of its steps to, step by step.
pub trait Steps {
    /// Begins a frame: what the steps before cost is not asked for, but what they left in caches stays.
    fn frame(&mut self);

    /// Runs the tasks of a step. Returns whether any machine still takes part.
    fn run(&mut self, tasks: &dyn TaskSource) -> bool;
}

/// Machines at a level that costs no thread each: `run` gives what a step cost on each.
struct Counted<'s, R> {
    costs: &'s mut [Vec<StepCost>],
    run: R,
}

impl<R: FnMut(&dyn TaskSource) -> Vec<StepCost>> Steps for Counted<'_, R> {
    fn frame(&mut self) {
        self.costs.iter_mut().for_each(Vec::clear);
    }

    fn run(&mut self, tasks: &dyn TaskSource) -> bool {
        self.costs.iter_mut().zip((self.run)(tasks)).for_each(|(costs, cost)| costs.push(cost));
        true
    }
}

/// What writes to a tape.
struct Taped<'t, 'a> {
    tape: &'t Tape<'a>,
    seat: Option<Seat<'a>>,
}

impl Steps for Taped<'_, '_> {
    fn frame(&mut self) {
        self.tape.write_frame(&mut self.seat);
    }

    fn run(&mut self, tasks: &dyn TaskSource) -> bool {
        self.tape.write_step(tasks, &mut self.seat);
        self.tape.is_read()
    }
}

impl Fidelity {
    /// Whether at this level several machines can be given the tasks of one run: where it is not the machine that says which are recorded.
    pub fn takes_many(self) -> bool {
        match self {
            Fidelity::Functional | Fidelity::Roofline | Fidelity::Windowed | Fidelity::Cycle => true,
            Fidelity::Sampled(_) => false,
        }
    }

    /// Runs `program` once, and gives what the steps of its last frame cost on each of the cold machines of `specs`, as [`Fidelity::timing`] would have it
    /// for each alone. No more threads than `seats` compute at once; the one that calls has none yet.
    ///
    /// # Panics
    /// Where the level does not take many ([`Fidelity::takes_many`]).
    pub fn on_all<T>(
        self,
        specs: &[MachineSpec],
        seats: &Seats,
        program: impl FnOnce(&mut dyn Steps) -> T,
    ) -> (T, Vec<Costs>) {
        let mut costs: Vec<Vec<StepCost>> = specs.iter().map(|_| Vec::new()).collect();
        let result = match self {
            Fidelity::Functional => {
                let _seat = seats.take();
                let mut untimed = Untimed::new(1);
                let run = |tasks: &dyn TaskSource| {
                    let report = untimed.run_step(tasks).expect("what has no time moves");
                    vec![StepCost { report, activity: Vec::new() }; specs.len()]
                };
                program(&mut Counted { costs: &mut costs, run })
            }
            Fidelity::Roofline => {
                let _seat = seats.take();
                let mut machines: Vec<Machine> = specs.iter().map(Machine::new).collect();
                let mut survey = Survey::new(1);
                let run = |tasks: &dyn TaskSource| {
                    let found = survey.step(tasks);
                    let cost = |machine: &mut Machine| {
                        let report = machine.report(&found);
                        StepCost { report, activity: machine.activity().to_vec() }
                    };
                    machines.iter_mut().map(cost).collect()
                };
                program(&mut Counted { costs: &mut costs, run })
            }
            Fidelity::Windowed | Fidelity::Cycle => return self.over_tape(specs, seats, program),
            Fidelity::Sampled(_) => panic!("{self} takes one machine at a time"),
        };
        (result, costs.into_iter().map(Ok).collect())
    }

    fn over_tape<T>(
        self,
        specs: &[MachineSpec],
        seats: &Seats,
        program: impl FnOnce(&mut dyn Steps) -> T,
    ) -> (T, Vec<Costs>) {
        let tape = Tape::new(seats, specs.len());
        std::thread::scope(|scope| {
            // Whatever happens to the program, the machines do not wait for more.
            let ended = Ended(&tape);
            let read = |spec: &MachineSpec| {
                let (spec, tape) = (spec.clone(), &tape);
                let spawned =
                    std::thread::Builder::new().spawn_scoped(scope, move || self.read_all(&spec, tape));
                spawned.map_err(|error| {
                    tape.do_without();
                    Failure::Thread(error)
                })
            };
            let readers: Vec<_> = specs.iter().map(read).collect();
            let mut taped = Taped { tape: &tape, seat: Some(seats.take()) };
            let result = program(&mut taped);
            drop((ended, taped));
            let costs = readers
                .into_iter()
                .map(|reader| reader?.join().unwrap_or_else(|panic| Err(Failure::Panic(panic))));
            (result, costs.collect())
        })
    }

    /// What the steps of a tape's last frame cost on one machine.
    fn read_all(self, spec: &MachineSpec, tape: &Tape) -> Costs {
        let mut reader = tape.reader();
        let run = catch_unwind(AssertUnwindSafe(|| {
            let mut timing = self.timing(spec, 1);
            let mut costs = Vec::new();
            while let Some(step) = TapedStep::next(&mut reader) {
                if step.is_first {
                    costs.clear();
                }
                let report = timing.run_step(&step);
                let report = report.map_err(|stuck| Failure::Stuck(step.name().to_owned(), stuck))?;
                costs.push(StepCost { report, activity: timing.activity().to_vec() });
            }
            Ok(costs)
        }));
        run.unwrap_or_else(|panic| Err(Failure::Panic(panic)))
    }
}

/// Ends a tape when it is dropped.
struct Ended<'t, 'a>(&'t Tape<'a>);

impl Drop for Ended<'_, '_> {
    fn drop(&mut self) {
        self.0.end();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::shipped;
    use crate::streams::{Mix, Tasks};

    #[test]
    fn every_machine_of_several_gives_what_it_gives_alone() {
        let spec = |cores: u32| {
            let mut config = shipped("larrabee-24");
            config.cores = cores;
            config.validate().expect("sound")
        };
        let specs = [1, 3, 4, 7].map(spec);
        let steps: Vec<_> = Mix::ALL
            .into_iter()
            .map(|mix| Tasks {
                count: 90,
                make: move |task| mix.stream(task, 300 + (task * 37 % 11) as usize * 90),
            })
            .collect();
        for level in Fidelity::ALL.into_iter().filter(|level| level.takes_many()) {
            let alone = specs.iter().map(|spec| -> Vec<StepCost> {
                let mut timing = level.timing(spec, 1);
                let cost = |tasks| {
                    let report = timing.run_step(tasks).expect("moves");
                    StepCost { report, activity: timing.activity().to_vec() }
                };
                steps.iter().map(|tasks| tasks as &dyn TaskSource).map(cost).collect()
            });
            let alone: Vec<_> = alone.collect();
            for seats in [1, 3] {
                let seats = Seats::new(seats);
                let program = |run: &mut dyn Steps| {
                    run.frame();
                    steps.iter().all(|tasks| run.run(tasks))
                };
                let (is_taken, all) = level.on_all(&specs, &seats, program);
                assert!(is_taken);
                let all: Vec<_> = all.into_iter().map(|costs| costs.expect("moves")).collect();
                assert!(all == alone, "{level}");
            }
        }
    }
}
