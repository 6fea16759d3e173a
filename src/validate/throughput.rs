//! Families `issue`, `flops`, `l1`, `l2`, `bw`, `stream`, `ring`, `gather`, `atomic`: work in a time.

use lrbsim_micro::{
    Arrays, Atomic, Bench, Extent, Gather, Issue, LineOperation, LockedLine, Operation, Prefetch, Store,
    Stream, Threads,
};

use super::experiment::{Experiment, Outcome};
use super::id::{bytes, number};
use super::latency::{self, PREFETCHER_OFF};
use super::suite::{Conditions, NotExpressed, Plan, UNKNOWN};

/// What the compiler of the measured programs is taken to prefetch: far enough ahead that it is never the distance that
/// limits, and into L1 shortly before the use.
const COMPILER: Prefetch = Prefetch::Both { l2_ahead: 48, l1_ahead: 4 };

/// Bytes of the arrays in the measurements of memory bandwidth.
const ARRAY_BYTES: u64 = 1 << 30;

/// Lines that a core reads or writes while a bandwidth is measured: some hundred times what is in flight; and more when
/// few cores work, so that they too meet many banks.
const LINES_PER_CORE_MIN: u32 = 8192;
const LINES_PER_CORE_MAX: u32 = 65_536;
const LINES: u32 = 524_288;

/// Lines of each array that a thread works on while a loop is measured that stays in a cache, and laps: enough of both
/// that threads get out of step and the end of a lap does not stand for all of it.
const RESIDENT_LINES_MIN: u32 = 8192;
const LAPS_MIN: u32 = 4;

/// With one address and one acknowledge ring a direction.
const ONE_PAIR: [&str; 2] = ["ring.address_rings=1", "ring.acknowledge_rings=1"];

pub(super) fn plan(id: &[&str], at: &Conditions<'_>) -> Result<Plan, NotExpressed> {
    match id[0] {
        "issue" | "flops" => arithmetic(id, at),
        "l1" | "l2" => cache(id, at),
        "gather" => gather(id, at),
        "atomic" | "false_sharing" => atomic(id, at),
        "bw" => bandwidth(id, at),
        "stream" => stream(id, at),
        "ring" => ring(id, at),
        _ => Err(UNKNOWN),
    }
}

fn on_core(threads: u32) -> Threads {
    Threads::OnCore { core: 0, threads }
}

/// The number of threads in `text`, when the machine has so many.
fn threads_of(text: &str, most: u32) -> Result<u32, NotExpressed> {
    let threads = number(text, "t").ok_or(UNKNOWN)?;
    if threads == 0 || threads > most {
        return Err(NotExpressed("the machine has not so many hardware threads"));
    }
    Ok(threads)
}

fn issue(operation: Operation, chains: u32, threads: Threads) -> Bench {
    Bench::Issue(Issue { operation, chains, threads })
}

fn arithmetic(id: &[&str], at: &Conditions<'_>) -> Result<Plan, NotExpressed> {
    let fma = |chains| at.experiment(issue(Operation::MultiplyAdd, chains, on_core(1)));
    match id {
        ["issue", "fma_latency"] => Ok(Plan::one(fma(1), Outcome::cycles_per_unit)),
        ["issue", "single_thread_gap"] => Ok(Plan::one(fma(2), Outcome::cycles_per_unit)),
        ["issue", name, threads] => {
            let (operation, chains) = match (number(name, "mul"), number(name, "mad")) {
                (Some(chains), _) => (Operation::Multiply, chains),
                (_, Some(chains)) => (Operation::MultiplyAdd, chains),
                _ => return Err(UNKNOWN),
            };
            if !(1..=4).contains(&chains) {
                return Err(NotExpressed("the kernel has 1 to 4 chains"));
            }
            let threads = threads_of(threads, at.machine.config.threads_per_core)?;
            let bench = issue(operation, chains, on_core(threads));
            Ok(Plan::one(at.experiment(bench), |o| o.cycles_per_unit().recip()))
        }
        // Eight lanes of double precision take the issue slots of sixteen of single.
        ["flops", "dp", _, threads] => {
            let threads = threads_of(threads, at.cores * at.machine.config.threads_per_core)?;
            let bench = issue(Operation::MultiplyAdd, 2, Threads::Spread(threads));
            Ok(Plan::one(at.experiment(bench), |o| 16.0 * o.units_per_ns()))
        }
        _ => Err(UNKNOWN),
    }
}

/// A loop on one core over arrays of `footprint_bytes` together, lap after lap.
fn resident(
    kernel: &str,
    threads: u32,
    footprint_bytes: u32,
    prefetch: Prefetch,
) -> Result<Bench, NotExpressed> {
    let (reads, store, arrays) = match kernel {
        "sum" => (1, Store::No, 1),
        "scale" => (1, Store::Ordinary, 2),
        "scale_inplace" => (1, Store::InPlace, 1),
        "saxpy" => (2, Store::Ordinary, 3),
        "saxpy_inplace" => (2, Store::InPlace, 2),
        _ => return Err(UNKNOWN),
    };
    let lines = (footprint_bytes / 64 / arrays / threads / 8).max(1) * 8;
    Ok(Bench::Stream(Stream {
        reads,
        store,
        prefetch,
        arrays: Arrays::Split { bytes: 0 },
        threads: on_core(threads),
        extent: Extent::Laps { lines, laps: (RESIDENT_LINES_MIN / lines).max(LAPS_MIN).next_multiple_of(4) },
    }))
}

/// Issue cycles a line of a loop that hits L1, if every slot were used: with each load a uop of its own, as here, and
/// with one of them folded into the arithmetic, as on the chip.
///
/// ```text
/// uops a line    loads, one of arithmetic, stores, less the folded one; and the loop's own, over the lines of a turn
/// cycles a line  half of the uops, at least one a load: two pipes, and one load a cycle, folded or not
/// ```
///
/// One thread issues every `thread_issue_interval_cycles`, several share the cycles.
fn issue_cycles_a_line(stream: &Stream, interval_cycles: f64) -> [f64; 2] {
    let loads = f64::from(stream.reads);
    let stores = if stream.store == Store::No { 0.0 } else { 1.0 };
    let cycles = (interval_cycles / f64::from(stream.threads.count())).max(1.0);
    [0.0, 1.0].map(|folded| {
        let uops = loads + 1.0 + stores - folded + f64::from(Stream::LOOP_UOPS) / f64::from(Stream::UNROLL);
        cycles * (uops / 2.0).max(loads)
    })
}

/// The remark of a row of L1 bandwidth.
fn what_folding_gives(stream: &Stream, at: &Conditions<'_>) -> String {
    let interval = f64::from(at.machine.config.core.thread_issue_interval_cycles);
    let [apart, folded] = issue_cycles_a_line(stream, interval);
    format!("at best {apart:.2} cycles a line, where a folded load operand allows {folded:.2}")
}

fn cache(id: &[&str], at: &Conditions<'_>) -> Result<Plan, NotExpressed> {
    let l2_bytes = at.l2_lines() * 64 / 2;
    let most = at.machine.config.threads_per_core;
    // Highest rate: of one to all threads, each prefetching into L1.
    let fastest =
        |o: &[&Outcome]| o.iter().map(|outcome| 64.0 * outcome.cycles_per_unit()).fold(f64::MAX, f64::min);
    let reads = || -> Result<Vec<Experiment>, NotExpressed> {
        (1..=most)
            .map(|threads| Ok(at.experiment(resident("sum", threads, l2_bytes, Prefetch::L1 { ahead: 16 })?)))
            .collect()
    };
    match id {
        ["l2", "miss_block"] => {
            let bench = at.experiment(resident("scale", 2, l2_bytes, Prefetch::No)?);
            // Bytes count every line once, and every line misses; two threads wait side by side.
            Ok(Plan::one(bench, |o| o.cycles_per_unit() * 64.0 * 2.0))
        }
        ["l2", "read_max_one_core"] => Ok(Plan::of(reads()?, fastest)),
        ["l2", "l1_misses_in_flight"] => {
            let mut experiments = reads()?;
            experiments.insert(0, latency::l2(at));
            Ok(Plan::of(experiments, move |o| o[0].cycles_per_unit() / fastest(&o[1..])))
        }
        [level, kernel, _, threads] => {
            let threads = threads_of(threads, most)?;
            let l1_bytes = at.machine.spec.l1d.sets * at.machine.spec.l1d.ways * 64;
            let footprint = if *level == "l1" { l1_bytes / 4 * 3 } else { l2_bytes };
            let bench = resident(kernel, threads, footprint, Prefetch::No)?;
            let folding = match &bench {
                Bench::Stream(stream) if *level == "l1" => what_folding_gives(stream, at),
                _ => String::new(),
            };
            Ok(Plan::one(at.experiment(bench), Outcome::units_per_ns).remarked(folding))
        }
        _ => Err(UNKNOWN),
    }
}

/// A loop over arrays in memory.
fn from_memory(at: &Conditions<'_>, reads: u32, store: Store, prefetch: Prefetch, threads: Threads) -> Bench {
    let a_core = threads.count() / threads.cores_used(at.cores);
    // A cache that starts empty has nothing to write back: fill it first.
    let warm = if store == Store::No { 256 } else { at.l2_lines() * 9 / 8 };
    let lines = |lines: u32| (lines / a_core).max(256).next_multiple_of(32);
    Bench::Stream(Stream {
        reads,
        store,
        prefetch,
        arrays: Arrays::Split { bytes: ARRAY_BYTES },
        threads,
        extent: Extent::Onward {
            warm_lines: lines(warm),
            lines: lines(
                (LINES / threads.cores_used(at.cores)).clamp(LINES_PER_CORE_MIN, LINES_PER_CORE_MAX),
            ),
        },
    })
}

/// `bw.mem.KIND` with so many threads.
pub(super) fn memory_stream(
    at: &Conditions<'_>,
    kind: &str,
    threads: u32,
) -> Result<Experiment, NotExpressed> {
    if threads == 0 || threads > at.cores * at.machine.config.threads_per_core {
        return Err(NotExpressed("the machine has not so many hardware threads"));
    }
    let (direction, prefetch) = kind.split_once('_').unwrap_or((kind, ""));
    let (software, hardware) = match prefetch {
        "" => (true, true),
        "swp" => (true, false),
        "hwp" => (false, true),
        "nopf" => (false, false),
        // Streaming stores read nothing that could be prefetched.
        "ss" => (false, true),
        _ => return Err(UNKNOWN),
    };
    let (reads, store) = match (direction, prefetch) {
        ("read", "ss") => return Err(UNKNOWN),
        ("read", _) => (1, Store::No),
        ("write", "ss") => (0, Store::Streaming),
        ("write", _) => (0, Store::Ordinary),
        _ => return Err(UNKNOWN),
    };
    let bench = from_memory(
        at,
        reads,
        store,
        if software { COMPILER } else { Prefetch::No },
        Threads::Spread(threads),
    );
    Ok(at.under(if hardware { &[] } else { &[PREFETCHER_OFF] }, bench))
}

fn bandwidth(id: &[&str], at: &Conditions<'_>) -> Result<Plan, NotExpressed> {
    let threads_per_core = at.machine.config.threads_per_core;
    match id {
        ["bw", "mem", "read_one_core", threads] => {
            let threads = on_core(threads_of(threads, threads_per_core)?);
            let bench = from_memory(at, 1, Store::No, COMPILER, threads);
            Ok(Plan::one(at.experiment(bench), Outcome::units_per_ns))
        }
        ["bw", "mem", kind, threads] => {
            let threads = number(threads, "t").ok_or(UNKNOWN)?;
            Ok(Plan::one(memory_stream(at, kind, threads)?, Outcome::units_per_ns))
        }
        ["bw", "same", size, threads] => {
            bytes(size).ok_or(UNKNOWN)?;
            let threads = threads_of(threads, at.cores * threads_per_core)?;
            let Bench::Stream(stream) = from_memory(at, 1, Store::No, COMPILER, Threads::Spread(threads))
            else {
                unreachable!("a stream")
            };
            let same = Stream { arrays: Arrays::Same, ..stream };
            let value = move |o: &[&Outcome]| o[0].units_per_ns() / f64::from(threads);
            Ok(Plan::of(vec![at.experiment(Bench::Stream(same))], value))
        }
        _ => Err(UNKNOWN),
    }
}

/// A STREAM kernel with one thread on each of so many cores, and beyond that more a core.
fn stream_kernel(
    at: &Conditions<'_>,
    kernel: &str,
    store: Store,
    threads: u32,
) -> Result<Bench, NotExpressed> {
    let reads = match kernel {
        "copy" | "scale" => 1,
        "add" | "triad" => 2,
        _ => return Err(UNKNOWN),
    };
    Ok(from_memory(at, reads, store, COMPILER, Threads::Spread(threads)))
}

const ECC: &str = "memory.ecc.enabled=true";

fn stream(id: &[&str], at: &Conditions<'_>) -> Result<Plan, NotExpressed> {
    let all = |kernel, store| stream_kernel(at, kernel, store, at.cores);
    match id {
        ["stream", "triad", "untuned", threads] => {
            let threads = threads_of(threads, at.cores * at.machine.config.threads_per_core)?;
            let bench = stream_kernel(at, "triad", Store::Ordinary, threads)?;
            Ok(Plan::one(at.experiment(bench), Outcome::units_per_ns))
        }
        ["stream", "tuned", kernel] => {
            // One core is left to the operating system of the card.
            let threads = at.cores.min(60);
            let bench = stream_kernel(at, kernel, Store::Streaming, threads)?;
            Ok(Plan::one(at.experiment(bench), Outcome::units_per_ns))
        }
        ["stream", "ecc_off", kernel] => {
            Ok(Plan::one(at.experiment(all(kernel, Store::Ordinary)?), Outcome::units_per_ns))
        }
        ["stream", "ecc_on", kernel] => {
            Ok(Plan::one(at.under(&[ECC], all(kernel, Store::Ordinary)?), Outcome::units_per_ns))
        }
        ["stream", "ecc_cost"] => {
            let triad = all("triad", Store::Ordinary)?;
            let experiments = vec![at.under(&[ECC], triad.clone()), at.experiment(triad)];
            Ok(Plan::of(experiments, |o| o[0].units_per_ns() / o[1].units_per_ns()))
        }
        _ => Err(UNKNOWN),
    }
}

fn ring(id: &[&str], at: &Conditions<'_>) -> Result<Plan, NotExpressed> {
    let reads = |threads| from_memory(at, 1, Store::No, COMPILER, Threads::Spread(threads));
    match id {
        ["ring", "streaming_store_gain"] => {
            let triad = |store| stream_kernel(at, "triad", store, at.cores);
            let experiments =
                vec![at.experiment(triad(Store::Streaming)?), at.experiment(triad(Store::Ordinary)?)];
            Ok(Plan::of(experiments, |o| o[0].units_per_ns() / o[1].units_per_ns()))
        }
        ["ring", "ad_ak_doubling"] => {
            let experiments = vec![at.experiment(reads(at.cores)), at.under(&ONE_PAIR, reads(at.cores))];
            Ok(Plan::of(experiments, |o| o[0].units_per_ns() / o[1].units_per_ns()))
        }
        ["ring", "saturation_one_pair"] => {
            let cores: Vec<u32> = (4..=at.cores).step_by(4).collect();
            let experiments = cores.iter().map(|cores| at.under(&ONE_PAIR, reads(*cores))).collect();
            Ok(Plan::of(experiments, move |o| {
                let rates: Vec<f64> = o.iter().map(|outcome| outcome.units_per_ns()).collect();
                let best = rates.iter().copied().fold(0.0, f64::max);
                let first = rates.iter().position(|rate| *rate >= 0.95 * best).unwrap_or(0);
                cores.get(first).copied().map_or(0.0, f64::from)
            }))
        }
        ["ring", "msgs_per_miss"] => {
            // Few enough lines that none is thrown out, of which the home would be told.
            let experiment = latency::memory(at, at.l2_lines() / 2);
            Ok(Plan::one(experiment, |o| o.counts.ring_messages / o.counts.memory_reads))
        }
        _ => Err(UNKNOWN),
    }
}

fn gather(id: &[&str], at: &Conditions<'_>) -> Result<Plan, NotExpressed> {
    let bench = |lines, table_bytes| at.experiment(Bench::Gather(Gather { lines, table_bytes }));
    match id {
        ["gather", "steps"] => {
            // Two numbers of lines, so that what the loop around the gathers loads does not count.
            Ok(Plan::of(vec![bench(8, 8 << 10), bench(16, 8 << 10)], |o| {
                let accesses = |i: usize| o[i].counts.l1d_accesses;
                (accesses(1) - accesses(0)) / (8.0 * o[0].units)
            }))
        }
        ["gather", level, lines] => {
            let lines = number(lines, "lines").filter(|lines| (1..=16).contains(lines)).ok_or(UNKNOWN)?;
            let table_bytes = match *level {
                "l1" => 8 << 10,
                "l2" => 128 << 10,
                _ => return Err(UNKNOWN),
            };
            Ok(Plan::one(bench(lines, table_bytes), Outcome::cycles_per_unit))
        }
        _ => Err(UNKNOWN),
    }
}

fn atomic(id: &[&str], at: &Conditions<'_>) -> Result<Plan, NotExpressed> {
    let bench = |line, operation| at.experiment(Bench::Atomic(Atomic { line, operation }));
    match id {
        ["atomic", "faa", "l1"] => {
            Ok(Plan::one(bench(LockedLine::Own, LineOperation::Add), Outcome::ns_per_unit))
        }
        ["atomic", "cas", "l1"] => {
            Ok(Plan::one(bench(LockedLine::Own, LineOperation::CompareExchange), Outcome::ns_per_unit))
        }
        ["atomic", "swp", "l1"] => Err(NotExpressed("the ISA layer has no locked exchange")),
        ["atomic", "remote"] => {
            Ok(Plan::one(bench(LockedLine::Remote, LineOperation::Add), Outcome::ns_per_unit))
        }
        ["atomic", "contended", "rate"] => {
            let bench = bench(LockedLine::Contended, LineOperation::Add);
            Ok(Plan::one(bench, |o| 1000.0 * o.units_per_ns()))
        }
        ["false_sharing", "write"] => {
            Ok(Plan::one(bench(LockedLine::Remote, LineOperation::Store), Outcome::ns_per_unit))
        }
        _ => Err(UNKNOWN),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folded_operand_leaves_room_for_the_uops_of_the_loop() {
        let of = |threads| {
            let Ok(Bench::Stream(stream)) = resident("saxpy_inplace", threads, 24 << 10, Prefetch::No) else {
                panic!("a stream")
            };
            issue_cycles_a_line(&stream, 2.0)
        };
        assert_eq!([1, 2, 3, 4].map(of), [[4.5, 4.0], [2.25, 2.0], [2.25, 2.0], [2.25, 2.0]]);
    }
}
