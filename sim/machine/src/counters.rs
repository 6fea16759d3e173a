//! What a step leaves to report: integers only, which add up; ratios are derived when they are shown.

use lrbsim_isa::OpCounts;
use lrbsim_isa::stream::Stream;
use lrbsim_isa::uop::Class;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::ops::AddAssign;

/// What a core spent a cycle on. Every core-cycle has exactly one cause.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(u8)]
pub enum Cause {
    /// At least one uop issued.
    Issue = 0,
    /// Waits for a result that is not from memory, or for a branch.
    Dependency,
    /// Waits for data that hit L1, or for an access port of the L1.
    L1,
    /// Waits for data that hit L2.
    L2,
    /// Waits for a free MSHR, or for a way of the L2 that no fill is on its way to.
    Mshr,
    /// Waits for the translation of an address.
    Tlb,
    /// Waits for a line or its ownership from other cores.
    Remote,
    /// Waits for data that was held up longest by full ring slots.
    Ring,
    /// Waits for data from memory.
    Memory,
    /// Waits for a locked operation, or for the line of one.
    Atomic,
    /// Waits while a gather or scatter hands its lines to the L1.
    GatherLines,
    /// Waits for the task counter.
    Queue,
    /// Waits for the end of the step, or has no task in it.
    Barrier,
}

impl Cause {
    /// Number of causes.
    pub const COUNT: usize = 13;

    /// All causes, in the order in which stacks are drawn.
    pub const ALL: [Cause; Cause::COUNT] = [
        Cause::Issue,
        Cause::Dependency,
        Cause::L1,
        Cause::L2,
        Cause::Mshr,
        Cause::Tlb,
        Cause::Remote,
        Cause::Ring,
        Cause::Memory,
        Cause::Atomic,
        Cause::GatherLines,
        Cause::Queue,
        Cause::Barrier,
    ];

    /// Name as it stands in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Cause::Issue => "issue",
            Cause::Dependency => "dependency",
            Cause::L1 => "l1",
            Cause::L2 => "l2",
            Cause::Mshr => "mshr",
            Cause::Tlb => "tlb",
            Cause::Remote => "remote",
            Cause::Ring => "ring",
            Cause::Memory => "memory",
            Cause::Atomic => "atomic",
            Cause::GatherLines => "gather_lines",
            Cause::Queue => "queue",
            Cause::Barrier => "barrier",
        }
    }
}

// A time carries its cause in four bits of its word, see `when.rs`.
const _: () = assert!(Cause::COUNT <= 16);

/// Declares a struct of additive `u64` counters.
macro_rules! counters {
    ($(#[$meta:meta])* $name:ident { $($(#[$field_meta:meta])* $field:ident,)* }) => {
        $(#[$meta])*
        #[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
        #[serde(deny_unknown_fields)]
        pub struct $name { $($(#[$field_meta])* pub $field: u64,)* }

        impl AddAssign for $name {
            fn add_assign(&mut self, other: $name) {
                $(self.$field += other.$field;)*
            }
        }
    };
}

counters! {
    /// Core-cycles by cause; they add up to cores × cycles.
    CycleStack {
        /// Core-cycles in which at least one uop issued.
        issue,
        /// Core-cycles waiting for a result that is not from memory.
        dependency,
        /// Core-cycles waiting for data that hit L1, or for an access port of the L1.
        l1,
        /// Core-cycles waiting for data that hit L2.
        l2,
        /// Core-cycles waiting for a free MSHR, or for a way of the L2 that no fill is on its way to.
        mshr,
        /// Core-cycles waiting for the translation of an address.
        tlb,
        /// Core-cycles waiting for other cores.
        remote,
        /// Core-cycles waiting for data that full ring slots held up longest.
        ring,
        /// Core-cycles waiting for memory.
        memory,
        /// Core-cycles waiting for locked operations.
        atomic,
        /// Core-cycles waiting for the lines of a gather or scatter.
        gather_lines,
        /// Core-cycles waiting for the task counter.
        queue,
        /// Core-cycles waiting for the end of the step, idle cores included.
        barrier,
    }
}

impl CycleStack {
    /// A stack from core-cycles in the order of [`Cause::ALL`].
    pub fn from_array(cycles: [u64; Cause::COUNT]) -> CycleStack {
        let [
            issue,
            dependency,
            l1,
            l2,
            mshr,
            tlb,
            remote,
            ring,
            memory,
            atomic,
            gather_lines,
            queue,
            barrier,
        ] = cycles;
        CycleStack {
            issue,
            dependency,
            l1,
            l2,
            mshr,
            tlb,
            remote,
            ring,
            memory,
            atomic,
            gather_lines,
            queue,
            barrier,
        }
    }

    /// Core-cycles of `cause`.
    pub fn get(&self, cause: Cause) -> u64 {
        match cause {
            Cause::Issue => self.issue,
            Cause::Dependency => self.dependency,
            Cause::L1 => self.l1,
            Cause::L2 => self.l2,
            Cause::Mshr => self.mshr,
            Cause::Tlb => self.tlb,
            Cause::Remote => self.remote,
            Cause::Ring => self.ring,
            Cause::Memory => self.memory,
            Cause::Atomic => self.atomic,
            Cause::GatherLines => self.gather_lines,
            Cause::Queue => self.queue,
            Cause::Barrier => self.barrier,
        }
    }

    /// Causes with their core-cycles, in the order of [`Cause::ALL`].
    pub fn iter(&self) -> impl Iterator<Item = (Cause, u64)> + '_ {
        Cause::ALL.into_iter().map(|cause| (cause, self.get(cause)))
    }

    /// Core-cycles of all causes: cores × cycles.
    pub fn total(&self) -> u64 {
        self.iter().map(|(_, cycles)| cycles).sum()
    }
}

counters! {
    /// One level of cache, all cores together.
    CacheCounters {
        /// Line accesses by uops (L1) or by L1 misses and L2 prefetches (L2): hits, misses and merged together.
        accesses,
        /// Accesses that found the line, ready and with the right they need.
        hits,
        /// Accesses that had to ask the level below.
        misses,
        /// Accesses that found the line on its way and waited for the same fill.
        merged,
        /// Misses of lines that were there, but only to read.
        upgrades,
        /// Modified lines given to the level below.
        writebacks,
        /// Lines thrown out, by capacity or because the level below lost them.
        evictions,
        /// Lines lost to writes of other cores.
        invalidations,
    }
}

counters! {
    /// The ring or rings, all links together.
    RingCounters {
        /// Messages sent.
        messages,
        /// Messages that did not leave their stop, and take no slot.
        local,
        /// Bytes sent; a request or acknowledgement counts 8, a line 64.
        bytes,
        /// Link-slots taken: one a slot of a message and a hop.
        slot_hops,
        /// Cycles that messages waited for free slots.
        wait_cycles,
    }
}

counters! {
    /// The directory, all slices together.
    DirectoryCounters {
        /// Transactions served.
        transactions,
        /// Transactions that got the line from another core.
        forwards,
        /// Invalidations sent.
        invalidations,
        /// Cycles that transactions waited for an earlier one on the same line or slice.
        wait_cycles,
    }
}

counters! {
    /// The memory controllers.
    MemoryCounters {
        /// Lines read.
        reads,
        /// Lines written.
        writes,
        /// Bytes moved.
        bytes,
        /// Accesses that found their row open.
        row_hits,
        /// Accesses that had to open their row.
        row_misses,
        /// Cycles that accesses waited for banks and channels.
        wait_cycles,
    }
}

counters! {
    /// Locked operations.
    AtomicCounters {
        /// Line accesses by locked operations of tasks.
        operations,
        /// Line accesses by locked operations that had to fetch the line or its ownership.
        transfers,
        /// Locked adds on the task counter.
        task_pulls,
        /// Barriers passed.
        barriers,
    }
}

counters! {
    /// What each limit of the machine alone would take of a step, in cycles; of a phase the sums over its steps. All are 0 where the
    /// time was simulated, and reports leave them out.
    Bounds {
        /// Issue slots of the cores.
        issue,
        /// Chains of results that wait for one another, and of accesses, in the threads that there are.
        chains,
        /// Ports of the L1 data caches, and the rate of gathers.
        l1,
        /// Misses that may be outstanding at once.
        l2,
        /// Links of the rings, and slices of the directory.
        ring,
        /// Channels of the memory controllers.
        memory,
        /// The line that most locked operations want, and the task counter.
        atomics,
        /// First tasks, and the barrier at the end of steps.
        barrier,
    }
}

impl Bounds {
    /// The limits by name, in the order of the fields.
    pub fn named(&self) -> [(&'static str, u64); 8] {
        let Bounds { issue, chains, l1, l2, ring, memory, atomics, barrier } = *self;
        [
            ("issue", issue),
            ("chains", chains),
            ("l1", l1),
            ("l2", l2),
            ("ring", ring),
            ("memory", memory),
            ("atomics", atomics),
            ("barrier", barrier),
        ]
    }

    /// The name of the greatest limit; `None` where there is none.
    pub fn greatest(&self) -> Option<&'static str> {
        // Of equals the first.
        let named = self.named().into_iter().rev().max_by_key(|(_, cycles)| *cycles)?;
        (named.1 > 0).then_some(named.0)
    }
}

/// Standard deviations on either side of a mean that hold 95 % of a normal distribution.
pub const NORMAL_95: f64 = 1.96;

/// Everything one step measured; the sum over steps is a phase.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StepReport {
    /// Steps in the sum.
    pub steps: u64,
    /// Simulated core cycles, barrier included.
    pub cycles: u64,
    /// Variance of `cycles`, where they were extrapolated from a sample; 0 where every task was timed.
    pub cycles_variance: u64,
    /// Tasks run.
    pub tasks: u64,
    /// Uops by class, indexed by class byte.
    pub class_counts: [u64; Class::COUNT],
    /// Uops issued: the sum of `class_counts`.
    pub issued: u64,
    /// Core-cycles in which two uops issued.
    pub paired: u64,
    /// Lane-slots of vector uops that did work.
    pub lanes_active: u64,
    /// Lane-slots of vector uops that were masked off.
    pub lanes_masked: u64,
    /// Most vector registers live at once in any task, before spills were charged. The sum keeps the greatest.
    pub live_vectors_max: u64,
    /// Core-cycles by cause.
    pub cycle_stack: CycleStack,
    /// L1 data caches.
    pub l1d: CacheCounters,
    /// L2 caches.
    pub l2: CacheCounters,
    /// Rings.
    pub ring: RingCounters,
    /// Directory.
    pub directory: DirectoryCounters,
    /// Memory controllers.
    pub memory: MemoryCounters,
    /// Locked operations.
    pub atomics: AtomicCounters,
    /// What each limit alone would take, where the time was estimated from them.
    #[serde(default)]
    pub bounds: Bounds,
}

/// The sum of the reports of a phase's steps.
pub type PhaseCounters = StepReport;

impl Default for StepReport {
    fn default() -> StepReport {
        StepReport {
            steps: 0,
            cycles: 0,
            cycles_variance: 0,
            tasks: 0,
            class_counts: [0; Class::COUNT],
            issued: 0,
            paired: 0,
            lanes_active: 0,
            lanes_masked: 0,
            live_vectors_max: 0,
            cycle_stack: CycleStack::default(),
            l1d: CacheCounters::default(),
            l2: CacheCounters::default(),
            ring: RingCounters::default(),
            directory: DirectoryCounters::default(),
            memory: MemoryCounters::default(),
            atomics: AtomicCounters::default(),
            bounds: Bounds::default(),
        }
    }
}

impl StepReport {
    /// What `tasks` tasks did that were run without being timed.
    pub fn of_counts(tasks: u32, counts: &OpCounts) -> StepReport {
        StepReport {
            tasks: u64::from(tasks),
            issued: counts.total(),
            lanes_active: counts.lanes_active(),
            lanes_masked: counts.lanes_masked,
            class_counts: counts.class_counts,
            ..StepReport::default()
        }
    }
}

impl StepReport {
    /// Counts a task that was recorded, and does not say that its uops have issued.
    pub(crate) fn count_task(&mut self, stream: &Stream) {
        self.tasks += 1;
        for (sum, count) in self.class_counts.iter_mut().zip(stream.count_classes()) {
            *sum += count;
        }
        self.lanes_active += stream.lanes_active;
        self.lanes_masked += stream.lanes_masked;
        self.live_vectors_max = self.live_vectors_max.max(u64::from(stream.live_vectors_max));
    }
}

impl AddAssign<&StepReport> for StepReport {
    fn add_assign(&mut self, other: &StepReport) {
        self.steps += other.steps;
        self.cycles += other.cycles;
        self.cycles_variance += other.cycles_variance;
        self.tasks += other.tasks;
        for (sum, count) in self.class_counts.iter_mut().zip(other.class_counts) {
            *sum += count;
        }
        self.issued += other.issued;
        self.paired += other.paired;
        self.lanes_active += other.lanes_active;
        self.lanes_masked += other.lanes_masked;
        self.live_vectors_max = self.live_vectors_max.max(other.live_vectors_max);
        self.cycle_stack += other.cycle_stack;
        self.l1d += other.l1d;
        self.l2 += other.l2;
        self.ring += other.ring;
        self.directory += other.directory;
        self.memory += other.memory;
        self.atomics += other.atomics;
        self.bounds += other.bounds;
    }
}

impl AddAssign for StepReport {
    fn add_assign(&mut self, other: StepReport) {
        *self += &other;
    }
}
