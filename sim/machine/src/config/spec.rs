//! A machine whose numbers have been checked, in the units that timing uses. Times are core cycles.

use super::IdealConfig;
use crate::Cycle;

/// A machine that passed [`MachineConfig::validate`](super::MachineConfig::validate).
#[derive(Debug, Clone, PartialEq)]
pub struct MachineSpec {
    /// Core and ring clock, GHz.
    pub clock_ghz: f64,
    /// Cores.
    pub cores: u32,
    /// Hardware threads a core.
    pub threads_per_core: u32,
    /// The core.
    pub core: CoreSpec,
    /// The L1 data cache.
    pub l1d: CacheSpec,
    /// The L2.
    pub l2: CacheSpec,
    /// The hardware prefetcher; `None` when there is none.
    pub prefetcher: Option<PrefetcherSpec>,
    /// Translation; `None` when it costs nothing.
    pub tlb: Option<TlbSpec>,
    /// The ring or rings.
    pub ring: RingSpec,
    /// From the arrival of a request at its home to the departure of what it causes.
    pub directory_lookup: Cycle,
    /// Between two requests served by one slice of the directory.
    pub directory_interval: Cycle,
    /// The memory.
    pub memory: MemorySpec,
    /// A locked operation on a line owned in L1.
    pub atomic_cycles: Cycle,
    /// A round of the barrier beside one transfer of a line.
    pub barrier_round: Cycle,
    /// Most tasks taken at once.
    pub chunk_tasks_max: u32,
    /// From the result of the locked add to the first uop of the task.
    pub dispatch_cycles: Cycle,
    /// Parts that cost nothing.
    pub ideal: IdealConfig,
}

/// The core.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CoreSpec {
    /// Whether two uops may issue in a cycle.
    pub dual_issue: bool,
    /// Whether a thread sleeps through its L1 misses.
    pub blocks_on_l1_miss: bool,
    /// Whether streaming stores that miss go past the L1 and nobody waits.
    pub posted_streaming_stores: bool,
    /// Least cycles between two issues of a thread.
    pub issue_interval: Cycle,
    /// Cycles between two lines of a gather, in 1/256.
    pub gather_interval_x256: u64,
    /// Accesses that the L1 serves in a cycle, for all threads of the core together.
    pub l1_accesses_per_cycle: u32,
    /// Cycles that a gather holds its thread beside those for its lines.
    pub gather_overhead: Cycle,
    /// Latency of vector ALU uops.
    pub vector_alu: Cycle,
    /// Latency of vector multiplies.
    pub vector_mul: Cycle,
    /// Latency of vector multiply-adds.
    pub vector_fma: Cycle,
    /// Latency of vector reciprocals.
    pub vector_math: Cycle,
    /// Latency of vector conversions.
    pub vector_convert: Cycle,
    /// Latency of vector shuffles.
    pub vector_shuffle: Cycle,
    /// Latency of mask uops.
    pub mask: Cycle,
    /// Latency of scalar ALU uops.
    pub scalar_alu: Cycle,
    /// Latency of scalar multiplies.
    pub scalar_mul: Cycle,
    /// From a branch to the next issue of its thread.
    pub branch: Cycle,
}

/// One cache level.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CacheSpec {
    /// Sets, at least one.
    pub sets: u32,
    /// Lines in a set, 1 to 16.
    pub ways: u32,
    /// Load-to-use latency of a hit, from issue.
    pub hit_cycles: Cycle,
    /// Misses that may be outstanding at once.
    pub mshrs: u32,
}

/// The streamer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PrefetcherSpec {
    /// Streams followed at once.
    pub streams: u32,
    /// Lines that it runs ahead.
    pub lines_ahead: u32,
    /// Greatest distance of two accesses of a stream.
    pub train_lines: u32,
    /// MSHRs of the L2 that it leaves free.
    pub mshrs_spared: usize,
    /// Lines of a page.
    pub page_lines: u32,
}

/// Translation.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TlbSpec {
    /// Lines of a page.
    pub page_lines: u32,
    /// The first TLB.
    pub first: TlbLevelSpec,
    /// The second one.
    pub second: TlbLevelSpec,
}

/// One TLB.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TlbLevelSpec {
    /// Sets, at least one.
    pub sets: u32,
    /// Entries in a set, 1 to 16.
    pub ways: u32,
    /// What a miss adds.
    pub miss_cycles: Cycle,
}

/// The ring or rings.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RingSpec {
    /// Number of rings.
    pub rings: u32,
    /// Consecutive slots that a line takes.
    pub line_slots: u32,
    /// From a stop to the next.
    pub hop_cycles: Cycle,
    /// Where a message changes rings.
    pub crossing_cycles: Cycle,
    /// Belts a direction for addresses, at least one.
    pub address_rings: u32,
    /// Belts a direction for acknowledgements; 0: they take those for addresses.
    pub acknowledge_rings: u32,
    /// Whether messages arrive when they are sent.
    pub free: bool,
}

/// The memory.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MemorySpec {
    /// Controllers.
    pub controllers: u32,
    /// Cycles that one line takes on the channel of a controller, in 1/256.
    pub line_interval_x256: u64,
    /// Idle latency of an access that opens a row.
    pub row_miss_cycles: Cycle,
    /// Idle latency when the row is open.
    pub row_hit_cycles: Cycle,
    /// For how long a read that opens a row keeps its bank.
    pub row_cycle_cycles: Cycle,
    /// For how long a write that opens a row keeps its bank.
    pub write_row_cycle_cycles: Cycle,
    /// Line times that a channel loses when it changes direction.
    pub turnaround_lines: u32,
    /// Whether write-backs keep MSHRs.
    pub acknowledges_writes: bool,
    /// Lines that the write buffer of a controller holds, at least one.
    pub write_buffer_lines: u32,
    /// Banks a controller.
    pub banks: u32,
    /// Lines in a row.
    pub row_lines: u32,
}

impl MachineSpec {
    /// Hardware threads that a step of `tasks` tasks wakes: one for each, as far as there are any.
    pub(crate) fn threads_for(&self, tasks: u32) -> u32 {
        tasks.min(self.cores * self.threads_per_core)
    }
}
