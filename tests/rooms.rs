//! What a method, a fidelity or an observer of one's own takes: one folder and one registration each.

mod common;
mod toy;

use std::ops::Range;

use common::{request, run};
use lrbsim::{Algorithm, RunRequest, choices};
use lrbsim_isa::program::{StepSource, TaskSource};
use lrbsim_isa::{Arena, HostSimd, OpCounts, Stream, examples::Saxpy};
use lrbsim_kernels::method::METHODS;
use lrbsim_machine::{Chip, CoreActivity, Fidelity, Observer, StepReport, Stuck, Timing};
use toy::Toy;

/// The registration of the toy.
static TOY: Toy = Toy;

#[test]
fn a_method_is_one_folder_and_one_registration() {
    let algorithm = Algorithm::new(&TOY, "floor=0.03").expect("an option that it takes");
    for fidelity in [Fidelity::Functional, Fidelity::Windowed] {
        let output = run(&RunRequest { algorithm: algorithm.clone(), fidelity, ..request("tiny") });
        let report = &output.report;
        assert_eq!(report.provenance.algorithm, "toy:floor=0.03");
        // Five halvings lead below 0.03: as many steps as the data wants, and one before each that clears its counter.
        let [phase] = &report.phases[..] else { panic!("one phase: {:?}", report.phases) };
        assert_eq!((phase.id.as_str(), phase.steps, phase.by_step.len()), ("halve", 12, 12));
        for (step, name) in phase.by_step.iter().zip(["clear", "halve"].into_iter().cycle()) {
            assert!(step.name == name && step.instructions > 0, "{}", step.name);
        }
        assert_eq!(phase.cycles.is_some(), fidelity.is_timed());
        let seen = output.frame.visibility.iter().filter(|value| !value.is_nan());
        assert!(seen.clone().all(|&value| value == 1.0 / 64.0), "{:?}", report.image);
    }
    let error = Algorithm::new(&TOY, "floor=2").expect_err("too bright");
    assert_eq!(error.to_string(), "`floor` of `toy` is `2`; it must be a number from 0.001 to 1");
    let page = choices::page(&[METHODS[0], &TOY]);
    assert!(
        page.contains("### `toy`: half the light") && page.contains("| `halve` | halving | no |"),
        "{page}"
    );
}

/// A toy of a fidelity: every other task is timed, the rest is run and not recorded, and time is extrapolated.
/// `docs/adding-a-fidelity.md` walks through it.
struct EveryOther {
    chip: Chip,
}

impl Timing for EveryOther {
    fn run_step(&mut self, tasks: &dyn TaskSource) -> Result<StepReport, Stuck> {
        let timed = EvenTasks(tasks);
        let mut report = self.chip.run_step(&timed)?;
        let mut counts = OpCounts::default();
        for task in (1..tasks.tasks()).step_by(2) {
            tasks.skip(task..task + 1, &mut counts);
        }
        let skipped = tasks.tasks() - timed.tasks();
        let untimed = StepReport::of_counts(skipped, &counts);
        // As long again for each uop that was not timed; a tenth is this toy's idea of an error.
        let extra = report.cycles * untimed.issued / report.issued.max(1);
        report.cycles += extra;
        report.cycles_variance = (extra / 10).pow(2);
        report += untimed;
        Ok(report)
    }

    fn activity(&self) -> &[CoreActivity] {
        self.chip.activity()
    }
}

/// The tasks of even numbers.
struct EvenTasks<'a>(&'a dyn TaskSource);

impl TaskSource for EvenTasks<'_> {
    fn name(&self) -> &str {
        self.0.name()
    }

    fn tasks(&self) -> u32 {
        self.0.tasks().div_ceil(2)
    }

    fn is_ordered(&self) -> bool {
        self.0.is_ordered()
    }

    fn record(&self, task: u32, stream: &mut Stream) {
        self.0.record(2 * task, stream);
    }

    fn skip(&self, tasks: Range<u32>, counts: &mut OpCounts) {
        tasks.for_each(|task| self.0.skip(2 * task..2 * task + 1, counts));
    }
}

/// Runs saxpy of 99 tasks on `timing`, and checks what it left in the arena.
fn saxpy(timing: &mut dyn Timing) -> StepReport {
    let mut arena = Arena::new();
    let saxpy = Saxpy::new(&mut arena, 99 * 1024);
    let step = saxpy.step();
    let report = timing.run_step(&StepSource::new(&step, &mut arena, HostSimd::detect(), 1)).expect("moves");
    saxpy.check(&arena).expect("every task has run");
    report
}

#[test]
fn a_fidelity_that_skips_tasks_runs_each_once_and_has_an_interval() {
    let spec = common::machine(&[]).spec;
    let untimed = saxpy(&mut *Fidelity::Functional.timing(&spec, 2));
    let windowed = saxpy(&mut *Fidelity::Windowed.timing(&spec, 1));
    let sampled = saxpy(&mut EveryOther { chip: Chip::new(&spec, Fidelity::Windowed, 1) });
    for report in [&untimed, &windowed] {
        assert_eq!((report.tasks, &report.class_counts), (sampled.tasks, &sampled.class_counts));
        assert_eq!(report.cycles_variance, 0);
    }
    assert!(sampled.cycles_variance > 0);
    let error = sampled.cycles as f64 / windowed.cycles as f64 - 1.0;
    assert!(error.abs() < 0.2, "{error:+.3}");
}

/// Notes what passes.
#[derive(Default)]
struct Notes {
    steps: Vec<(String, u32, u64)>,
    tasks: Vec<(usize, u8, Range<u32>, u64, u64)>,
    barriers: Vec<(u64, u64)>,
}

impl Observer for Notes {
    fn step(&mut self, name: &str, tasks: u32, start: u64) {
        self.steps.push((name.to_owned(), tasks, start));
    }

    fn tasks(&mut self, core: usize, thread: u8, tasks: Range<u32>, asked: u64, from: u64) {
        self.tasks.push((core, thread, tasks, asked, from));
    }

    fn barrier(&mut self, arrival: u64, end: u64) {
        self.barriers.push((arrival, end));
    }
}

#[test]
fn an_observer_sees_every_task_once_and_changes_nothing() {
    let spec = common::machine(&[]).spec;
    for fidelity in [Fidelity::Windowed, Fidelity::Cycle] {
        let mut watched = Chip::observed(&spec, fidelity, 1, Notes::default());
        let report = saxpy(&mut watched);
        assert_eq!(report, saxpy(&mut Chip::new(&spec, fidelity, 1)), "{fidelity}");

        let notes = watched.observer();
        assert_eq!(notes.steps, [("saxpy".to_owned(), 99, 0)]);
        let mut tasks: Vec<u32> = notes.tasks.iter().flat_map(|(_, _, tasks, ..)| tasks.clone()).collect();
        tasks.sort_unstable();
        assert_eq!(tasks, (0..99).collect::<Vec<_>>(), "{fidelity}");
        // Each thread asks in the order of time, and in the end for nothing more.
        for (index, (core, thread, range, asked, from)) in notes.tasks.iter().enumerate() {
            assert!(asked <= from, "{fidelity}: core {core} thread {thread} got {range:?} before it asked");
            let next = notes.tasks[index + 1..].iter().find(|(c, t, ..)| (c, t) == (core, thread));
            assert_eq!(next.is_none(), range.is_empty(), "{fidelity}: core {core} thread {thread}");
            assert!(next.is_none_or(|(_, _, _, asked, _)| asked >= from), "{fidelity}");
        }
        let [(arrival, end)] = notes.barriers[..] else { panic!("one barrier: {:?}", notes.barriers) };
        assert!(arrival < end && end == report.cycles, "{fidelity}: {arrival} {end} {}", report.cycles);
    }
}

/// The code that the pages of documentation show is that of this file and of the program, line by line.
#[test]
fn the_pages_show_code_that_is_tested() {
    let read = |path: &str| std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{path}: {error}"));
    let sources = [
        "tests/rooms.rs",
        "sim/machine/src/timing.rs",
        "kernels/src/lib.rs",
        "kernels/src/method.rs",
        "kernels/src/pcss/mod.rs",
    ]
    .map(read);
    let lines: Vec<&str> = sources.iter().flat_map(|text| text.lines().map(str::trim)).collect();
    for page in ["docs/adding-a-method.md", "docs/adding-a-fidelity.md"] {
        let text = read(page);
        let blocks = text.split("```rust\n").skip(1).filter_map(|rest| rest.split("```").next());
        let shown: Vec<&str> = blocks.flat_map(str::lines).map(str::trim).collect();
        assert!(shown.len() > 10, "{page} shows no code");
        for line in shown.into_iter().filter(|line| *line != "…") {
            assert!(lines.contains(&line), "{page} shows `{line}`, which is nowhere");
        }
    }
}
