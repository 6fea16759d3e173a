//! From what a step asks of any machine to the time it takes on one.

use super::Lengths;
use super::profile::{DISTANCES, PARTS, Profile};
use super::reuse::{BINS, kept};
use crate::config::MachineSpec;
use crate::core::{Row, table};
use crate::counters::{Bounds, Cause};
use crate::ring::{Message, Rings};
use crate::scheduler::{barrier_cycles, mean_transfer_cycles};
use lrbsim_isa::uop::Class;

/// What a machine charges, in cycles.
pub(super) struct Costs {
    spec: MachineSpec,
    rows: Box<[Row; 256]>,
    /// A line or its ownership from another core.
    transfer: f64,
    /// A line from memory, with the way there.
    memory: f64,
    /// Stops that a message passes.
    hops: f64,
    barrier: f64,
}

/// The time of a step.
pub(super) struct Estimate {
    /// Cycles until all threads have passed its barrier.
    pub(super) cycles: f64,
    /// What each limit alone would take.
    pub(super) bounds: Bounds,
    /// Cycles until a thread has its first task.
    pub(super) start: f64,
    /// Core-cycles in which something issues.
    pub(super) issue: f64,
    /// Thread-cycles by what a thread waits for.
    pub(super) waits: [f64; Cause::COUNT],
    /// Lines that miss the L1, and the L2, and that memory reads and writes.
    pub(super) l1_misses: f64,
    pub(super) l2_misses: f64,
    pub(super) reads: f64,
    pub(super) writes: f64,
}

/// Chunks in which `threads` threads get `tasks` tasks, see [`chunk_lengths`](crate::scheduler::chunk_lengths): of `most` at first, and of
/// fewer as they run out.
fn chunks(tasks: f64, threads: f64, most: u32) -> f64 {
    let round = 2.0 * threads;
    let of_length = |length: u32| {
        let (from, to) = (f64::from(length) * round, f64::from(length + 1) * round);
        let to = if length == most { f64::INFINITY } else { to };
        (tasks.min(to) - from).max(0.0) / f64::from(length)
    };
    // No chunk is longer than tasks for it.
    let longest = most.min((tasks / round) as u32);
    tasks.min(round) + (1..=longest).map(of_length).sum::<f64>()
}

/// Limits that are close add up in part: between the greatest and the sum, nearer to the greatest.
fn together(limits: &[f64]) -> f64 {
    // Not by `powf`, which hosts round as they please.
    let square = |x: f64| x * x;
    limits.iter().map(|limit| square(square(*limit))).sum::<f64>().sqrt().sqrt()
}

impl Costs {
    pub(super) fn new(spec: &MachineSpec) -> Costs {
        let rings = Rings::new(spec, false);
        let transfer = mean_transfer_cycles(spec, &rings) as f64;
        // All pairs while they are few, a regular sample of them beyond.
        let stride = (spec.cores.div_ceil(16) | 1) as usize;
        let (mut cycles, mut pairs) = (0, 0);
        for from in (0..spec.cores).step_by(stride) {
            for to in (0..spec.cores).step_by(stride) {
                cycles += rings.idle_cycles(from, to, Message::Address);
                pairs += 1;
            }
        }
        let way = cycles as f64 / f64::from(pairs);
        Costs {
            rows: table(spec),
            transfer,
            // Not from another core's L2, by another way, but from its home's memory.
            memory: transfer - spec.l2.hit_cycles as f64 - way + spec.memory.row_miss_cycles as f64,
            hops: if spec.ring.free { 0.0 } else { way / spec.ring.hop_cycles.max(1) as f64 },
            barrier: barrier_cycles(spec, &rings) as f64,
            spec: spec.clone(),
        }
    }

    /// Cycles that the results of a class take.
    fn latency(&self, class: Class) -> f64 {
        self.rows[class as usize].latency().cycles() as f64
    }

    /// The time of a step of `tasks` tasks of these lengths.
    pub(super) fn estimate(&self, profile: &Profile, tasks: u32, lengths: Lengths) -> Estimate {
        let spec = &self.spec;
        let threads = f64::from(spec.threads_for(tasks).max(1));
        let cores = f64::from(spec.cores).min(threads);
        let beside = threads / cores;
        let elsewhere = 1.0 - 1.0 / cores;
        let uops = profile.uops();

        // What misses, by the room that each thread of a core has.
        let room = |cache: &crate::config::CacheSpec| f64::from(cache.sets * cache.ways) / beside;
        let missing = |bins: &[f64; BINS], lines: f64| -> f64 {
            bins.iter().enumerate().map(|(bin, count)| count * (1.0 - kept(bin, lines))).sum()
        };
        let has_memory = f64::from(u8::from(!spec.ideal.memory));
        let new_lines = profile.near_lines[BINS - 1];
        let new_uops = profile.near_uops[BINS - 1];
        let near = |bins: &[f64; BINS], lines| missing(bins, lines) - bins[BINS - 1];
        // Groups that this core has run before, at the middle of the step.
        let before = ((profile.groups / cores - 1.0) / 2.0).max(0.0);
        let found = |room: f64| -> f64 {
            let recent = (room * beside / profile.group_lines.max(1.0)).min(before);
            let of_part = |(bin, count): (usize, &f64)| {
                let part = if bin == PARTS { 0.0 } else { 1.0 / f64::from(1_u32 << bin) };
                let expected = part * recent;
                count * expected / (1.0 + expected)
            };
            // What others write is elsewhere by then, if there are others.
            let kept = profile.contended * (1.0 - elsewhere) * recent / (1.0 + recent);
            (profile.shared.iter().enumerate().map(of_part).sum::<f64>() + kept) / new_lines.max(1.0)
        };
        let (room1, room2) = (room(&spec.l1d), room(&spec.l2));
        let (found1, found2) = (found(room1).min(1.0), found(room2).min(1.0));
        let l1_misses = (near(&profile.near_lines, room1) + new_lines * (1.0 - found1)) * has_memory;
        let l2_misses = (near(&profile.near_lines, room2) + new_lines * (1.0 - found2)) * has_memory;

        // Where lines come from that no access of the group or the core has left there.
        let chip = f64::from(spec.l2.sets * spec.l2.ways) * f64::from(spec.cores);
        let distinct: f64 = profile.far.iter().sum();
        let missing_far = missing(&profile.far, chip);
        let part_far = missing_far / distinct.max(1.0);
        let first = (missing_far - profile.streamed * part_far).max(0.0);
        // What an earlier group has brought, and no L2 of the chip has any more.
        let lost = |volume: f64| (1.0 - chip / volume.max(1.0)).clamp(0.0, 1.0);
        let again = (new_lines * (1.0 - found2) - distinct).max(0.0) * lost(new_lines);
        let reads = (first + again + near(&profile.near_lines, room2)).min(l2_misses);
        let writes = profile.written.min(distinct) * part_far * lost(profile.volume) * has_memory;
        let from_memory = if l2_misses > 0.0 { reads / l2_misses } else { 0.0 };

        // One thread alone.
        let single = if spec.core.dual_issue { 0.0 } else { profile.pairs };
        let issue = uops - profile.pairs + single;
        let slower = issue / (uops - profile.pairs).max(1.0);
        let interval = spec.core.issue_interval as f64;
        let mut waits = [0.0; Cause::COUNT];
        let mut loads_waited_for = 0.0;
        for class in Class::ALL {
            let latency = self.latency(class);
            let row = &profile.waits[class as usize];
            let cause = if class.is_memory() { Cause::L1 } else { Cause::Dependency };
            for (distance, count) in row.iter().enumerate().take(DISTANCES) {
                waits[cause as usize] += count * (latency - distance as f64 * slower * interval).max(0.0);
            }
            if class.is_memory() {
                loads_waited_for += row.iter().sum::<f64>();
            }
        }
        waits[Cause::Dependency as usize] +=
            profile.count(Class::Branch) * (self.latency(Class::Branch) - interval).max(0.0);
        waits[Cause::L1 as usize] += profile.second_lines;
        // A thread hands on no more than one line a cycle.
        let line_interval = spec.core.gather_interval_x256 as f64 / 256.0;
        let counts = |classes: &[Class]| classes.iter().map(|class| profile.count(*class)).sum::<f64>();
        let gathers = counts(&[
            Class::Gather,
            Class::Scatter,
            Class::AtomicGather,
            Class::AtomicScatter,
            Class::GatherPrefetch,
        ]);
        waits[Cause::GatherLines as usize] += (profile.gather_lines * line_interval.max(1.0) - gathers)
            .max(0.0)
            + gathers * spec.core.gather_overhead as f64;
        waits[Cause::Atomic as usize] +=
            counts(&[Class::Atomic, Class::AtomicGather]) * (spec.atomic_cycles as f64 - interval).max(0.0);
        // Uops whose farthest line misses. A thread that does not sleep through them waits where a result is used.
        let stalls = if spec.core.blocks_on_l1_miss {
            1.0
        } else {
            (loads_waited_for / profile.near_uops.iter().sum::<f64>().max(1.0)).min(1.0)
        } * has_memory;
        let miss1 = (near(&profile.near_uops, room1) + new_uops * (1.0 - found1)) * stalls;
        let miss2 = (near(&profile.near_uops, room2) + new_uops * (1.0 - found2)) * stalls;
        let hit2 = spec.l2.hit_cycles as f64;
        waits[Cause::L2 as usize] += (miss1 - miss2) * hit2;
        waits[Cause::Memory as usize] += miss2 * from_memory * self.memory;
        let others = miss2 * (1.0 - from_memory);
        waits[Cause::Remote as usize] += others * elsewhere * self.transfer;
        waits[Cause::L2 as usize] += others * (1.0 - elsewhere) * hit2;
        let alone = issue * interval + waits.iter().sum::<f64>();

        // What each limit takes, in cycles of the chip.
        let ports = profile.lines / f64::from(spec.core.l1_accesses_per_cycle);
        let l1 = ports.max(profile.gather_lines * line_interval) / cores;
        let missing_cycles =
            l2_misses * (from_memory * self.memory + (1.0 - from_memory) * elsewhere * self.transfer);
        let mshrs = f64::from(spec.l1d.mshrs.min(spec.l2.mshrs));
        let l2 = ((l1_misses - l2_misses).max(0.0) * hit2 + missing_cycles) / mshrs / cores;
        let line_slots = f64::from(spec.ring.line_slots);
        let links = 2.0 * f64::from(spec.cores);
        let directory = l2_misses * spec.directory_interval as f64 / f64::from(spec.cores);
        // A line, two messages for addresses or more, and what of both goes by way of the ring of rings.
        let strands = f64::from(spec.ring.address_rings);
        let rings = f64::from(spec.ring.rings);
        let crossing = (1.0 - 1.0 / rings) * (rings / 4.0).max(1.0) / (2.0 * rings);
        let slots = line_slots.max(2.0 / strands);
        let moving = if spec.ring.free { 0.0 } else { slots * (self.hops / links).max(crossing) };
        let ring = (l2_misses * moving).max(directory);
        let line_cycles = spec.memory.line_interval_x256 as f64 / 256.0;
        let memory = (reads + writes) * line_cycles / f64::from(spec.memory.controllers);
        let move_cycles = spec.atomic_cycles as f64 + elsewhere * self.transfer * has_memory;
        // Every thread asks for its first task, one core after the other, and for others whenever it has none.
        let chunks = chunks(f64::from(tasks), threads, spec.chunk_tasks_max);
        let pulls = if spec.ideal.queue { 0.0 } else { (chunks - threads).max(0.0) };
        let hottest = profile.locked_hottest / if spec.ideal.memory { cores } else { 1.0 };
        // Who waits has asked already: half of the way is behind the request. Threads of a core take the counter one after the other.
        let handed_on = spec.atomic_cycles as f64 + elsewhere * self.transfer * has_memory / 2.0;
        let atomics = (hottest + pulls / beside) * handed_on;
        let start =
            if spec.ideal.queue { 0.0 } else { cores * move_cycles / 2.0 + spec.dispatch_cycles as f64 };

        // Tasks do not divide evenly among threads.
        let tail = |units: f64| {
            let each = (f64::from(tasks) / units).max(1.0);
            if each < 2.0 { each.ceil() / each } else { 1.0 + 0.5 * units * lengths.typical }
        };
        let chains = (alone / threads * tail(threads)).max(alone * lengths.longest);
        let [issue_cycles, l1, l2] = [issue / cores, l1, l2].map(|limit| limit * tail(cores));
        let core = together(&[issue_cycles, chains, l1, l2]);
        let running = together(&[core, ring, memory, atomics]);
        Estimate {
            cycles: running + start + self.barrier,
            bounds: Bounds {
                issue: issue_cycles as u64,
                chains: chains as u64,
                l1: l1 as u64,
                l2: l2 as u64,
                ring: ring as u64,
                memory: memory as u64,
                atomics: atomics as u64,
                barrier: (start + self.barrier) as u64,
            },
            start,
            issue,
            waits,
            l1_misses,
            l2_misses,
            reads,
            writes,
        }
    }
}
