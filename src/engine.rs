//! Runs the steps of a program: functionally, or on a simulated chip that is fed by recording threads.
//!
//! ```text
//! host threads = 1    the timing thread records a task when the chip pulls it
//! host threads = n    n - 1 threads record ahead, in index order ─► bounded queues ─► the timing thread
//! ```
//!
//! Which of these runs never shows in a result: the chip sees the same streams in the same order.

use crossbeam_channel::{Receiver, Sender, bounded};
use lrbsim_isa::host::{HostSimd, run_functional};
use lrbsim_isa::program::{StepSource, TaskSource};
use lrbsim_isa::stream::TASK_UOPS_MAX;
use lrbsim_isa::{Arena, Ordering, Step, Stream};
use lrbsim_machine::{Chip, Fidelity, MachineSpec, StepReport};

use crate::error::BadInput;
use crate::progress::Progress;

/// Streams that may be recorded and not yet timed, over all recording threads. A stream has up to about 64 K uops: a few
/// hundred KiB.
const STREAMS_AHEAD: usize = 64;

/// Recording threads at most: recording is several times faster than timing, more would only wait.
const RECORDERS_MAX: usize = 4;

/// What runs the steps of a frame.
pub struct Engine {
    /// `None`: nothing is timed.
    chip: Option<Chip>,
    simd: HostSimd,
    host_threads: usize,
}

impl Engine {
    /// An engine at `fidelity` on a cold chip.
    pub fn new(spec: &MachineSpec, fidelity: Fidelity, simd: HostSimd, host_threads: usize) -> Engine {
        let chip = (fidelity != Fidelity::Functional).then(|| Chip::new(spec, fidelity));
        Engine { chip, simd, host_threads }
    }

    /// Cycles in which each core issued in the last step, by core; `None` when nothing is timed.
    pub fn core_busy_cycles(&self) -> Option<impl Iterator<Item = u64>> {
        self.chip.as_ref().map(|chip| chip.activity().iter().map(|core| core.busy_cycles))
    }

    /// Runs all tasks of `step` and the barrier that ends it.
    pub fn run(
        &mut self,
        step: &Step,
        arena: &Arena,
        progress: &dyn Progress,
    ) -> Result<StepReport, BadInput> {
        let Some(chip) = &mut self.chip else {
            return Ok(run_untimed(step, arena, self.simd, self.host_threads));
        };
        let mut too_long = None;
        let report = if self.host_threads > 1 && step.tasks > 1 {
            record_ahead(step, arena, self.simd, self.host_threads - 1, |inner| {
                chip.run_step(&mut Watched { inner, progress, too_long: &mut too_long })
            })
        } else {
            let inner = StepSource { step, arena, simd: self.simd };
            chip.run_step(&mut Watched { inner, progress, too_long: &mut too_long })
        };
        match too_long {
            None => Ok(report),
            Some(task) => Err(BadInput::new(format!(
                "task {task} of step `{}` has more instructions than can be recorded: more than {TASK_UOPS_MAX}, or \
                 more than the host has memory for",
                step.name
            ))
            .with_help("a smaller image or mesh has shorter tasks; `--fidelity functional` records none")),
        }
    }
}

/// Counts operations, without a machine.
fn run_untimed(step: &Step, arena: &Arena, simd: HostSimd, threads: usize) -> StepReport {
    let counts = run_functional(step, arena, simd, threads);
    StepReport {
        steps: 1,
        tasks: u64::from(step.tasks),
        issued: counts.total(),
        lanes_active: counts.lanes_active(),
        lanes_masked: counts.lanes_masked,
        class_counts: counts.class_counts,
        ..StepReport::default()
    }
}

/// Has `recorders` threads record the tasks of `step` before `consume` asks for them.
fn record_ahead<R>(
    step: &Step,
    arena: &Arena,
    simd: HostSimd,
    recorders: usize,
    consume: impl FnOnce(RecordedAhead) -> R,
) -> R {
    // Tasks of an ordered step depend on one another: one thread runs them, in index order.
    let recorders = if step.ordering == Ordering::Ordered {
        1
    } else {
        recorders.min(RECORDERS_MAX).min(step.tasks as usize).max(1)
    };
    let shared = recorders > 1;
    let ahead = (STREAMS_AHEAD / recorders).max(2);
    std::thread::scope(|scope| {
        let queues: Vec<Queue> = (0..recorders)
            .map(|first| {
                let (full, queue) = bounded(ahead);
                let (empty, recycled) = bounded(ahead + 1);
                scope.spawn(move || {
                    // Task i is of recorder i modulo their number, so that the consumer knows where to look.
                    for task in (0..step.tasks).skip(first).step_by(recorders) {
                        let mut stream: Stream = recycled.try_recv().unwrap_or_default();
                        stream.clear();
                        step.kernel.record_shared(simd, arena, task, shared, &mut stream);
                        if full.send(stream).is_err() {
                            return; // the consumer is gone: it panicked, and that is what will be told
                        }
                    }
                });
                Queue { full: queue, empty }
            })
            .collect();
        consume(RecordedAhead { tasks: step.tasks, queues })
    })
}

/// The consumer's ends of one recorder's queues.
struct Queue {
    full: Receiver<Stream>,
    /// Takes emptied streams back, so that their buffers are used again.
    empty: Sender<Stream>,
}

/// Hands out streams that other threads record, in index order.
struct RecordedAhead {
    tasks: u32,
    queues: Vec<Queue>,
}

impl TaskSource for RecordedAhead {
    fn tasks(&self) -> u32 {
        self.tasks
    }

    fn record(&mut self, task: u32, stream: &mut Stream) {
        let queue = &self.queues[task as usize % self.queues.len()];
        let recorded = queue.full.recv().expect("a recorder leaves early only when it panics");
        let emptied = std::mem::replace(stream, recorded);
        // A full queue of empty streams drops this one: the recorder has enough.
        let _ = queue.empty.try_send(emptied);
    }
}

/// Tells of every task that the chip pulls.
struct Watched<'a, T> {
    inner: T,
    progress: &'a dyn Progress,
    /// The first task whose stream was cut short.
    too_long: &'a mut Option<u32>,
}

impl<T: TaskSource> TaskSource for Watched<'_, T> {
    fn tasks(&self) -> u32 {
        self.inner.tasks()
    }

    fn record(&mut self, task: u32, stream: &mut Stream) {
        self.inner.record(task, stream);
        if stream.cut_short {
            self.too_long.get_or_insert(task);
        }
        self.progress.task(stream.uops.len() as u64);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lrbsim_isa::Addr;
    use lrbsim_isa::kernel::Kernel;
    use lrbsim_isa::vpu::Vpu;

    const TASKS: u32 = 500;

    /// Adds its index to a counter and notes what was there.
    struct Count {
        counter: Addr,
        notes: Addr,
    }

    impl Kernel for Count {
        #[inline(always)]
        fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
            let zero = v.s_imm(0);
            let before = v.s_atomic_add(self.counter, zero, task);
            v.s_store(self.notes, task, before);
        }
    }

    fn step(ordering: Ordering, arena: &mut Arena) -> (Step, Addr) {
        let (counter, notes) = (arena.alloc(1), arena.alloc(u64::from(TASKS)));
        let kernel = Box::new(Count { counter, notes });
        (Step { name: "count", ordering, tasks: TASKS, kernel }, notes)
    }

    fn streams(source: &mut impl TaskSource) -> Vec<Stream> {
        let mut stream = Stream::default();
        (0..source.tasks())
            .map(|task| {
                source.record(task, &mut stream);
                stream.clone()
            })
            .collect()
    }

    #[test]
    fn recorded_ahead_or_not_the_chip_sees_the_same_streams() {
        let simd = HostSimd::Portable;
        let mut arena = Arena::new();
        let (step_here, notes) = step(Ordering::Ordered, &mut arena);
        let here = streams(&mut StepSource { step: &step_here, arena: &arena, simd });
        let notes_here = arena.read_u32s(notes, TASKS as usize);
        for ordering in [Ordering::Ordered, Ordering::Independent] {
            for recorders in [1, 2, 3, 9] {
                let mut arena = Arena::new();
                let (step, notes) = step(ordering, &mut arena);
                let ahead = record_ahead(&step, &arena, simd, recorders, |mut source| streams(&mut source));
                assert_eq!(ahead, here, "{ordering:?}, {recorders} recorders");
                if ordering == Ordering::Ordered {
                    assert_eq!(arena.read_u32s(notes, TASKS as usize), notes_here, "{recorders} recorders");
                }
            }
        }
    }

    #[test]
    fn a_consumer_that_leaves_early_does_not_hang_the_recorders() {
        let mut arena = Arena::new();
        let (step, _) = step(Ordering::Independent, &mut arena);
        for recorders in [1, 3] {
            record_ahead(&step, &arena, HostSimd::Portable, recorders, |mut source| {
                source.record(0, &mut Stream::default());
            });
        }
    }
}
