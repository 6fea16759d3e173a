//! One run of a program on many machines: its tasks are run once, for all of them.

use crate::chip::{CoreActivity, Stuck};
use crate::config::MachineSpec;
use crate::counters::StepReport;
use crate::fidelity::Fidelity;
use crate::roofline::{Machine, Survey};
use crate::tape::{Seats, Tape, TapedStep};
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
    /// Nothing moved any more.
    Stuck(Stuck),
    /// A law was broken: what the simulator said when it stopped.
    Panic(Box<dyn Any + Send>),
}

/// What a machine of several made of all steps.
pub type Costs = Result<Vec<StepCost>, Failure>;

/// What a program hands the tasks of its steps to, step by step.
pub type RunTasks<'a> = dyn FnMut(&dyn TaskSource) + 'a;

impl Fidelity {
    /// Whether at this level several machines can be given the tasks of one run: where it is not the machine that says which are recorded.
    pub fn takes_many(self) -> bool {
        match self {
            Fidelity::Functional | Fidelity::Roofline | Fidelity::Windowed | Fidelity::Cycle => true,
            Fidelity::Sampled(_) => false,
        }
    }

    /// Runs `program` once, and gives what its steps cost on each of the cold machines of `specs`, as [`Fidelity::timing`] would have it
    /// for each alone. No more threads than `seats` compute at once; the one that calls has none yet.
    ///
    /// # Panics
    /// Where the level does not take many ([`Fidelity::takes_many`]).
    pub fn on_all<T>(
        self,
        specs: &[MachineSpec],
        seats: &Seats,
        program: impl FnOnce(&mut RunTasks) -> T,
    ) -> (T, Vec<Costs>) {
        match self {
            Fidelity::Functional => {
                let _seat = seats.take();
                let (mut untimed, mut costs) = (Untimed::new(1), Vec::new());
                let result = program(&mut |tasks| {
                    let report = untimed.run_step(tasks).expect("what has no time moves");
                    costs.push(StepCost { report, activity: Vec::new() });
                });
                (result, specs.iter().map(|_| Ok(costs.clone())).collect())
            }
            Fidelity::Roofline => {
                let _seat = seats.take();
                let mut machines: Vec<(Machine, Vec<StepCost>)> =
                    specs.iter().map(|spec| (Machine::new(spec), Vec::new())).collect();
                let mut survey = Survey::new(1);
                let result = program(&mut |tasks| {
                    let found = survey.step(tasks);
                    for (machine, costs) in &mut machines {
                        let report = machine.report(&found);
                        costs.push(StepCost { report, activity: machine.activity().to_vec() });
                    }
                });
                (result, machines.into_iter().map(|(_, costs)| Ok(costs)).collect())
            }
            Fidelity::Windowed | Fidelity::Cycle => self.over_tape(specs, seats, program),
            Fidelity::Sampled(_) => panic!("{self} takes one machine at a time"),
        }
    }

    fn over_tape<T>(
        self,
        specs: &[MachineSpec],
        seats: &Seats,
        program: impl FnOnce(&mut RunTasks) -> T,
    ) -> (T, Vec<Costs>) {
        let tape = Tape::new(seats, specs.len());
        std::thread::scope(|scope| {
            // Whatever happens to the program, the machines do not wait for more.
            let ended = Ended(&tape);
            let readers: Vec<_> =
                specs.iter().map(|spec| scope.spawn(|| self.read_all(spec, &tape))).collect();
            let mut seat = Some(seats.take());
            let result = program(&mut |tasks| tape.write_step(tasks, &mut seat));
            drop((ended, seat));
            let costs = readers
                .into_iter()
                .map(|reader| reader.join().unwrap_or_else(|panic| Err(Failure::Panic(panic))));
            (result, costs.collect())
        })
    }

    /// What the steps of a tape cost on one machine.
    fn read_all(self, spec: &MachineSpec, tape: &Tape) -> Costs {
        let mut reader = tape.reader();
        let run = catch_unwind(AssertUnwindSafe(|| {
            let mut timing = self.timing(spec, 1);
            let mut costs = Vec::new();
            while let Some(step) = TapedStep::next(&mut reader) {
                let report = timing.run_step(&step).map_err(Failure::Stuck)?;
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
    use crate::config::{MachineConfig, builtin_machine};
    use crate::streams::{Mix, Tasks};

    #[test]
    fn every_machine_of_several_gives_what_it_gives_alone() {
        let spec = |cores: u32| {
            let text = builtin_machine("larrabee-24").expect("shipped");
            let mut config: MachineConfig = serde_json::from_str(text).expect("parses");
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
                let program = |run: &mut RunTasks| steps.iter().for_each(|tasks| run(tasks));
                let (_, all) = level.on_all(&specs, &seats, program);
                let all: Vec<_> = all.into_iter().map(|costs| costs.expect("moves")).collect();
                assert!(all == alone, "{level}");
            }
        }
    }
}
