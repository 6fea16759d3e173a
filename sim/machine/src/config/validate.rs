//! Checks of a machine, in the order of its file.

use super::spec::{
    CacheSpec, CoreSpec, MachineSpec, MemorySpec, PrefetcherSpec, RingSpec, TlbLevelSpec, TlbSpec,
};
use super::{CacheConfig, MachineConfig, PrefetcherConfig, TlbConfig, TlbLevelConfig};
use crate::cache::PORTS_MAX;
use std::fmt::Display;

/// A number that no machine can have.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{path}` is {found}; it must be {expected}")]
pub struct ConfigError {
    /// JSON path from the machine's root, such as `l2.capacity_bytes`.
    pub path: String,
    /// What stands there.
    pub found: String,
    /// What would be right.
    pub expected: String,
}

/// Fixed-point unit of times that are fractions of a cycle.
const FRACTION: f64 = 256.0;
/// Longest time of the memory, in cycles.
const MEMORY_CYCLES_MAX: f64 = 1e6;
/// Largest cache.
const CACHE_BYTES_MAX: u64 = 1 << 30;
const LINE_BYTES: u64 = lrbsim_isa::arena::LINE_BYTES;
const SMALL_PAGE_BYTES: u32 = 4096;
const LARGE_PAGE_BYTES: u32 = 2 << 20;

fn error<T>(path: &str, found: impl Display, expected: impl Display) -> Result<T, ConfigError> {
    Err(ConfigError { path: path.to_owned(), found: found.to_string(), expected: expected.to_string() })
}

/// `value` when it lies in `[least, most]`.
fn range(path: &str, value: u32, least: u32, most: u32) -> Result<u32, ConfigError> {
    if value < least || value > most {
        return error(path, value, format_args!("from {least} to {most}"));
    }
    Ok(value)
}

/// `value` when it is a number in `(0, most]`.
fn positive(path: &str, value: f64, most: f64) -> Result<f64, ConfigError> {
    if !(value > 0.0 && value <= most) {
        return error(path, value, format_args!("greater than 0 and at most {most}"));
    }
    Ok(value)
}

/// A latency: 1 to 10 000 cycles.
fn latency(path: &str, value: u32) -> Result<u64, ConfigError> {
    range(path, value, 1, 10_000).map(u64::from)
}

/// A time of the memory in whole cycles, rounded up.
fn cycles_of_ns(path: &str, ns: f64, clock_ghz: f64) -> Result<u64, ConfigError> {
    let cycles = positive(path, ns, 100_000.0)? * clock_ghz;
    if cycles > MEMORY_CYCLES_MAX {
        let most = MEMORY_CYCLES_MAX / clock_ghz;
        return error(
            path,
            ns,
            format_args!("at most {most}: {MEMORY_CYCLES_MAX} cycles at clock_ghz, {clock_ghz}"),
        );
    }
    Ok(cycles.ceil() as u64)
}

fn cache(at: &str, config: &CacheConfig) -> Result<CacheSpec, ConfigError> {
    let path = |field: &str| format!("{at}.{field}");
    let ways = range(&path("ways"), config.ways, 1, 16)?;
    let set_bytes = LINE_BYTES * u64::from(ways);
    let bytes = config.capacity_bytes;
    if bytes == 0 || !bytes.is_multiple_of(set_bytes) || bytes > CACHE_BYTES_MAX {
        return error(
            &path("capacity_bytes"),
            bytes,
            format_args!(
                "a multiple of {set_bytes} ({ways} ways of {LINE_BYTES} bytes), from {set_bytes} to {CACHE_BYTES_MAX}"
            ),
        );
    }
    Ok(CacheSpec {
        sets: (bytes / set_bytes) as u32,
        ways,
        hit_cycles: latency(&path("hit_cycles"), config.hit_cycles)?,
        mshrs: range(&path("mshrs"), config.mshrs, 1, 1024)?,
    })
}

fn prefetcher(config: &PrefetcherConfig) -> Result<Option<PrefetcherSpec>, ConfigError> {
    let page_bytes = config.page_bytes;
    if !page_bytes.is_power_of_two() || u64::from(page_bytes) < LINE_BYTES {
        return error("prefetcher.page_bytes", page_bytes, format_args!("a power of two from {LINE_BYTES}"));
    }
    let spec = PrefetcherSpec {
        streams: range("prefetcher.streams", config.streams, 0, 256)?,
        lines_ahead: range("prefetcher.lines_ahead", config.lines_ahead, 1, 256)?,
        train_lines: range("prefetcher.train_lines", config.train_lines, 1, 64)?,
        mshrs_spared: range("prefetcher.mshrs_spared", config.mshrs_spared, 0, 1024)? as usize,
        page_lines: page_bytes / LINE_BYTES as u32,
    };
    Ok((spec.streams > 0).then_some(spec))
}

fn tlb_level(at: &str, config: &TlbLevelConfig) -> Result<TlbLevelSpec, ConfigError> {
    let path = |field: &str| format!("tlb.{at}.{field}");
    let ways = range(&path("ways"), config.ways, 1, 16)?;
    let entries = range(&path("entries"), config.entries, 1, 65_536)?;
    if !entries.is_multiple_of(ways) {
        return error(&path("entries"), entries, format_args!("a multiple of {ways}, the ways"));
    }
    let miss_cycles = u64::from(range(&path("miss_cycles"), config.miss_cycles, 0, 10_000)?);
    Ok(TlbLevelSpec { sets: entries / ways, ways, miss_cycles })
}

fn tlb(config: &TlbConfig) -> Result<Option<TlbSpec>, ConfigError> {
    let (small, large) = (tlb_level("small", &config.small)?, tlb_level("large", &config.large)?);
    let second = tlb_level("second", &config.second)?;
    let first = match config.page_bytes {
        SMALL_PAGE_BYTES => small,
        LARGE_PAGE_BYTES => large,
        other => {
            return error("tlb.page_bytes", other, format_args!("{SMALL_PAGE_BYTES} or {LARGE_PAGE_BYTES}"));
        }
    };
    let spec = TlbSpec { page_lines: config.page_bytes / LINE_BYTES as u32, first, second };
    Ok(config.enabled.then_some(spec))
}

/// A part of a time, 0 to 10.
fn overhead(path: &str, value: f64) -> Result<f64, ConfigError> {
    if !(0.0..=10.0).contains(&value) {
        return error(path, value, "from 0 to 10");
    }
    Ok(value)
}

pub(super) fn validate(config: &MachineConfig) -> Result<MachineSpec, ConfigError> {
    if config.name.trim().is_empty() {
        return error("name", "empty", "some text: reports and folders are named after it");
    }
    let clock_ghz = config.clock_ghz;
    if !(0.001..=100.0).contains(&clock_ghz) {
        return error("clock_ghz", clock_ghz, "from 0.001 to 100");
    }
    let cores = range("cores", config.cores, 1, 4096)?;
    let threads_per_core = range("threads_per_core", config.threads_per_core, 1, 16)?;

    // The core.
    let gather_lines = positive("core.gather_lines_per_cycle", config.core.gather_lines_per_cycle, 16.0)?;
    if gather_lines < 0.01 {
        return error("core.gather_lines_per_cycle", gather_lines, "at least 0.01");
    }
    let at = &config.core.latency_cycles;
    let core = CoreSpec {
        dual_issue: config.core.dual_issue,
        blocks_on_l1_miss: config.core.blocks_on_l1_miss,
        posted_streaming_stores: config.core.posted_streaming_stores,
        issue_interval: latency(
            "core.thread_issue_interval_cycles",
            config.core.thread_issue_interval_cycles,
        )?,
        gather_interval_x256: (FRACTION / gather_lines).round() as u64,
        l1_accesses_per_cycle: range(
            "core.l1_accesses_per_cycle",
            config.core.l1_accesses_per_cycle,
            1,
            PORTS_MAX as u32,
        )?,
        gather_overhead: u64::from(range(
            "core.gather_overhead_cycles",
            config.core.gather_overhead_cycles,
            0,
            1000,
        )?),
        vector_alu: latency("core.latency_cycles.vector_alu", at.vector_alu)?,
        vector_mul: latency("core.latency_cycles.vector_mul", at.vector_mul)?,
        vector_fma: latency("core.latency_cycles.vector_fma", at.vector_fma)?,
        vector_math: latency("core.latency_cycles.vector_math", at.vector_math)?,
        vector_convert: latency("core.latency_cycles.vector_convert", at.vector_convert)?,
        vector_shuffle: latency("core.latency_cycles.vector_shuffle", at.vector_shuffle)?,
        mask: latency("core.latency_cycles.mask", at.mask)?,
        scalar_alu: latency("core.latency_cycles.scalar_alu", at.scalar_alu)?,
        scalar_mul: latency("core.latency_cycles.scalar_mul", at.scalar_mul)?,
        branch: latency("core.latency_cycles.branch", at.branch)?,
    };

    // The caches.
    let l1d = cache("l1d", &config.l1d)?;
    let l2 = cache("l2", &config.l2)?;
    if l2.hit_cycles <= l1d.hit_cycles {
        return error(
            "l2.hit_cycles",
            l2.hit_cycles,
            format_args!("greater than l1d.hit_cycles, {}", l1d.hit_cycles),
        );
    }
    if config.l2.capacity_bytes < config.l1d.capacity_bytes {
        return error(
            "l2.capacity_bytes",
            config.l2.capacity_bytes,
            format_args!("at least l1d.capacity_bytes, {}: the L2 is inclusive", config.l1d.capacity_bytes),
        );
    }

    let prefetcher = prefetcher(&config.prefetcher)?;
    let tlb = tlb(&config.tlb)?;

    // The ring and what stands at its stops.
    let cores_per_ring = range("ring.cores_per_ring", config.ring.cores_per_ring, 1, 4096)?;
    let bytes_per_cycle = config.ring.bytes_per_cycle;
    if !bytes_per_cycle.is_power_of_two() || u64::from(bytes_per_cycle) > LINE_BYTES {
        // Anything else would move lines as the next smaller of these does.
        return error(
            "ring.bytes_per_cycle",
            bytes_per_cycle,
            format_args!("a power of two from 1 to {LINE_BYTES}, the bytes of a line"),
        );
    }
    let ring = RingSpec {
        rings: cores.div_ceil(cores_per_ring),
        line_slots: (LINE_BYTES as u32).div_ceil(bytes_per_cycle),
        hop_cycles: u64::from(range("ring.hop_cycles", config.ring.hop_cycles, 1, 64)?),
        crossing_cycles: u64::from(range("ring.crossing_cycles", config.ring.crossing_cycles, 1, 64)?),
        address_rings: range("ring.address_rings", config.ring.address_rings, 1, 16)?,
        acknowledge_rings: range("ring.acknowledge_rings", config.ring.acknowledge_rings, 0, 16)?,
        free: config.ideal.ring,
    };
    let directory_lookup = latency("directory.lookup_cycles", config.directory.lookup_cycles)?;
    let directory_interval = latency("directory.interval_cycles", config.directory.interval_cycles)?;

    // The memory.
    let controllers = range("memory.controllers", config.memory.controllers, 1, 1024)?;
    let bandwidth = positive("memory.bandwidth_gb_per_s", config.memory.bandwidth_gb_per_s, 1e6)?;
    let line_interval = LINE_BYTES as f64 * clock_ghz * f64::from(controllers) / bandwidth;
    if line_interval > MEMORY_CYCLES_MAX {
        return error("memory.bandwidth_gb_per_s", bandwidth, "enough for one line in 10⁶ cycles");
    }
    let row_bytes = u64::from(config.memory.row_bytes);
    if row_bytes == 0 || !row_bytes.is_multiple_of(LINE_BYTES) {
        return error("memory.row_bytes", row_bytes, format_args!("a multiple of {LINE_BYTES}"));
    }
    let row_miss_cycles = cycles_of_ns("memory.latency_ns", config.memory.latency_ns, clock_ghz)?;
    let row_hit_cycles =
        cycles_of_ns("memory.row_hit_latency_ns", config.memory.row_hit_latency_ns, clock_ghz)?;
    if row_hit_cycles > row_miss_cycles {
        return error(
            "memory.row_hit_latency_ns",
            config.memory.row_hit_latency_ns,
            format_args!("at most memory.latency_ns, {}", config.memory.latency_ns),
        );
    }
    let row_cycle = cycles_of_ns("memory.row_cycle_ns", config.memory.row_cycle_ns, clock_ghz)?;
    let recovery_ns = config.memory.write_recovery_ns;
    if !(0.0..=10_000.0).contains(&recovery_ns) {
        return error("memory.write_recovery_ns", recovery_ns, "from 0 to 10000");
    }
    let read_overhead = overhead("memory.ecc.read_overhead", config.memory.ecc.read_overhead)?;
    let write_overhead = overhead("memory.ecc.write_overhead", config.memory.ecc.write_overhead)?;
    let [read_part, write_part] =
        [read_overhead, write_overhead].map(|part| if config.memory.ecc.enabled { 1.0 + part } else { 1.0 });
    let memory = MemorySpec {
        controllers,
        line_interval_x256: ((line_interval * read_part * FRACTION).round() as u64).max(1),
        row_miss_cycles,
        row_hit_cycles,
        row_cycle_cycles: (row_cycle as f64 * read_part).round() as u64,
        write_row_cycle_cycles: ((row_cycle as f64 + recovery_ns * clock_ghz) * write_part).round() as u64,
        turnaround_lines: range("memory.turnaround_lines", config.memory.turnaround_lines, 0, 64)?,
        acknowledges_writes: config.memory.acknowledges_writes,
        write_buffer_lines: range("memory.write_buffer_lines", config.memory.write_buffer_lines, 1, 1024)?,
        banks: range("memory.banks", config.memory.banks, 1, 1024)?,
        row_lines: (row_bytes / LINE_BYTES) as u32,
    };

    Ok(MachineSpec {
        clock_ghz,
        cores,
        threads_per_core,
        core,
        l1d,
        l2,
        prefetcher,
        tlb,
        ring,
        directory_lookup,
        directory_interval,
        memory,
        atomic_cycles: latency("atomic.latency_cycles", config.atomic.latency_cycles)?,
        barrier_round: u64::from(range(
            "barrier.round_overhead_cycles",
            config.barrier.round_overhead_cycles,
            0,
            10_000,
        )?),
        chunk_tasks_max: range("scheduler.chunk_tasks_max", config.scheduler.chunk_tasks_max, 1, 1024)?,
        dispatch_cycles: u64::from(range(
            "scheduler.dispatch_cycles",
            config.scheduler.dispatch_cycles,
            0,
            10_000,
        )?),
        ideal: config.ideal,
    })
}
