//! A machine as written in `configs/machines/*.json`, and what validation turns it into.

mod builtin;
mod spec;
mod validate;

#[cfg(test)]
mod tests;

pub(crate) use builtin::shipped;
pub use builtin::{builtin_machine, builtin_machine_names};
pub use spec::{
    CacheSpec, CoreSpec, MachineSpec, MemorySpec, PrefetcherSpec, RingSpec, TlbLevelSpec, TlbSpec,
};
pub use validate::ConfigError;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A machine: every number that timing depends on. Lines have 64 bytes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MachineConfig {
    /// Name, as in reports.
    pub name: String,
    /// Core and ring clock, GHz. Turns cycles into time, and times of the memory into cycles.
    pub clock_ghz: f64,
    /// Cores, each at its own ring stop.
    pub cores: u32,
    /// Hardware threads a core.
    pub threads_per_core: u32,
    /// The core.
    pub core: CoreConfig,
    /// The data cache that a core's threads share.
    pub l1d: CacheConfig,
    /// The cache private to a core, inclusive of its L1.
    pub l2: CacheConfig,
    /// The hardware prefetcher beside the L2.
    pub prefetcher: PrefetcherConfig,
    /// Translation of data addresses.
    pub tlb: TlbConfig,
    /// The ring or rings.
    pub ring: RingConfig,
    /// The directory, one slice at every ring stop of a core.
    pub directory: DirectoryConfig,
    /// The memory controllers and what hangs off them.
    pub memory: MemoryConfig,
    /// Locked operations.
    pub atomic: AtomicConfig,
    /// The barrier at the end of a step.
    pub barrier: BarrierConfig,
    /// The task counter.
    pub scheduler: SchedulerConfig,
    /// Parts that cost nothing, to ask what they cost.
    #[serde(default)]
    pub ideal: IdealConfig,
    /// JSON path of a number above → `published: KEY, place` | `derived: how` | `assumed: why`.
    pub sources: BTreeMap<String, String>,
}

/// The core: in-order, with a vector-or-any pipe U and a scalar, mask and memory pipe V.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CoreConfig {
    /// Whether pipe V exists: two uops of one thread may issue in a cycle.
    pub dual_issue: bool,
    /// Least cycles between two issues of one thread; 1: back to back.
    pub thread_issue_interval_cycles: u32,
    /// Whether a thread sleeps from an L1 miss (load or store, not prefetch) until the line is there. If not, only a uop
    /// that needs the loaded value waits.
    pub blocks_on_l1_miss: bool,
    /// Distinct lines that a gather or scatter hands to the L1 in a cycle; may be a fraction.
    pub gather_lines_per_cycle: f64,
    /// Accesses of loads, stores and prefetches that the L1 serves in a cycle, for all threads of the core together.
    pub l1_accesses_per_cycle: u32,
    /// Cycles that a gather or scatter holds its thread beside those for its lines.
    pub gather_overhead_cycles: u32,
    /// Whether a streaming store that misses goes past the L1 to the L2, without its thread waiting.
    pub posted_streaming_stores: bool,
    /// Result latencies of uops that touch no memory.
    pub latency_cycles: LatencyConfig,
}

/// Cycles from issue to the earliest issue of a consumer, by class.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LatencyConfig {
    /// Vector add, compare, logic, shift, blend.
    pub vector_alu: u32,
    /// Vector multiply.
    pub vector_mul: u32,
    /// Vector fused multiply-add.
    pub vector_fma: u32,
    /// Vector reciprocal and reciprocal square root.
    pub vector_math: u32,
    /// Vector convert and round.
    pub vector_convert: u32,
    /// Swizzle, permute, register broadcast.
    pub vector_shuffle: u32,
    /// Mask logic and moves.
    pub mask: u32,
    /// Scalar ALU.
    pub scalar_alu: u32,
    /// Scalar multiply.
    pub scalar_mul: u32,
    /// Cycles from a branch to the next issue of its thread, mispredictions averaged in.
    pub branch: u32,
}

/// One cache level.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CacheConfig {
    /// A whole number of sets, at least one.
    pub capacity_bytes: u64,
    /// Lines in a set, at most 16.
    pub ways: u32,
    /// Load-to-use latency of a hit, from the issue of the load. That of the L2 contains the L1 look-up.
    pub hit_cycles: u32,
    /// Misses that may be outstanding at once.
    pub mshrs: u32,
}

/// The streamer of the L2: finds streams of L2 misses and runs ahead of them, into the L2, never past a page.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PrefetcherConfig {
    /// Streams followed at once, one a page; 0: no prefetcher.
    pub streams: u32,
    /// Lines that it runs ahead of the last access.
    pub lines_ahead: u32,
    /// Greatest distance in lines between two accesses to a page that makes them a stream.
    pub train_lines: u32,
    /// MSHRs of the L2 that it leaves free for others.
    pub mshrs_spared: u32,
    /// Bytes of the pages that streams end at, a power of two.
    pub page_bytes: u32,
}

/// Translation of data addresses: a first TLB for the page size in use, and a second one behind it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TlbConfig {
    /// Whether translation costs anything.
    pub enabled: bool,
    /// Bytes of a page: 4096 or 2097152.
    pub page_bytes: u32,
    /// The first TLB for pages of 4 KB.
    pub small: TlbLevelConfig,
    /// The first TLB for pages of 2 MB.
    pub large: TlbLevelConfig,
    /// The second TLB; an entry covers 2 MB, in pages of either size.
    pub second: TlbLevelConfig,
}

/// One TLB of a core.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TlbLevelConfig {
    /// Entries, a whole number of sets.
    pub entries: u32,
    /// Entries in a set, at most 16.
    pub ways: u32,
    /// Cycles that a miss adds to its access.
    pub miss_cycles: u32,
}

/// The bidirectional ring: belts of slots in each direction, of their own for lines and for short messages.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RingConfig {
    /// Bytes that a link moves in a cycle in each direction: a power of two, at most the 64 of a line.
    pub bytes_per_cycle: u32,
    /// Cycles from a stop to the next.
    pub hop_cycles: u32,
    /// Greatest number of cores on one ring; more cores are spread evenly over several rings, linked in a ring.
    pub cores_per_ring: u32,
    /// Cycles that a message spends where it changes rings.
    pub crossing_cycles: u32,
    /// Belts a direction for addresses: requests, forwards, notices.
    pub address_rings: u32,
    /// Belts a direction for acknowledgements. 0: they take the address belts, and the home is not told when a line from
    /// memory has left its controller and arrived.
    pub acknowledge_rings: u32,
}

/// The distributed directory.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DirectoryConfig {
    /// Cycles from the arrival of a request at its home to the departure of what it causes.
    pub lookup_cycles: u32,
    /// Cycles between two requests served by one slice.
    pub interval_cycles: u32,
}

/// The memory controllers, spread evenly over the ring stops.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MemoryConfig {
    /// Number of controllers; lines are interleaved over them.
    pub controllers: u32,
    /// Peak bandwidth of all controllers together, 10⁹ bytes a second.
    pub bandwidth_gb_per_s: f64,
    /// Idle latency of an access that opens a row, from arrival at the controller to the line leaving it, ns.
    pub latency_ns: f64,
    /// Idle latency of an access whose row is open, from arrival at the controller to the line leaving it, ns.
    pub row_hit_latency_ns: f64,
    /// Least time between two row openings in one bank, ns.
    pub row_cycle_ns: f64,
    /// Banks a controller.
    pub banks: u32,
    /// Bytes of a row; a whole number of lines.
    pub row_bytes: u32,
    /// Time that a write keeps its bank longer than a read, ns; may be 0.
    pub write_recovery_ns: f64,
    /// Line times that a channel loses between a read and a write, either way round.
    pub turnaround_lines: u32,
    /// Whether a write-back keeps the MSHR of the miss that caused it until the controller has acknowledged it. If not,
    /// nothing ever waits for a write.
    pub acknowledges_writes: bool,
    /// Lines that the write buffer of a controller holds, each from its arrival until its burst is over. Further ones wait.
    pub write_buffer_lines: u32,
    /// Check bits in the same chips.
    pub ecc: EccConfig,
}

/// In-band error correction: check bits that take room and time of the same chips.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EccConfig {
    /// Whether there is any.
    pub enabled: bool,
    /// Part of a line's time that a read takes more.
    pub read_overhead: f64,
    /// Part of a line's time that a write takes more, whose check bits cover more than its line and have to be read first.
    pub write_overhead: f64,
}

/// Locked operations.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AtomicConfig {
    /// Cycles from issue to the result of a locked operation on a line that the core owns in its L1; the next one on that
    /// line starts then, and the issuing thread waits as long.
    pub latency_cycles: u32,
}

/// The barrier: `⌈log2 cores⌉` rounds of pairwise signals.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BarrierConfig {
    /// Cycles a round costs beside one transfer of a line between cores: the store of a flag and the test that sees it.
    pub round_overhead_cycles: u32,
}

/// The task counter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SchedulerConfig {
    /// Most tasks taken with one locked add; fewer near the end of a step, see the scheduler.
    pub chunk_tasks_max: u32,
    /// Cycles from the result of the locked add to the first uop of the task.
    pub dispatch_cycles: u32,
}

/// Parts of the machine that cost nothing.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct IdealConfig {
    /// Every access is an L1 hit.
    pub memory: bool,
    /// Messages arrive when they are sent.
    pub ring: bool,
    /// Tasks are there when a thread asks.
    pub queue: bool,
    /// All threads go on when the last arrives.
    pub barrier: bool,
}

impl MachineConfig {
    /// The only road to a [`MachineSpec`], so no component re-checks what it holds.
    ///
    /// # Errors
    /// Names the first number that no machine can have, by its JSON path.
    pub fn validate(&self) -> Result<MachineSpec, ConfigError> {
        validate::validate(self)
    }
}
