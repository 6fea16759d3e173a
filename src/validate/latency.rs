//! Families `lat` and `hwp`: dependent loads.

use lrbsim_micro::{Bench, Chase, CopyState, Order, Remote};

use super::experiment::{Experiment, Outcome};
use super::id::{bytes, number, pattern};
use super::suite::{Conditions, NotExpressed, Plan, UNKNOWN};
use super::throughput;

/// The setting that switches the hardware prefetcher off.
pub(super) const PREFETCHER_OFF: &str = "prefetcher.streams=0";

/// Owner cores of the published table of remote L2 latencies.
const OWNERS: [u32; 10] = [1, 2, 4, 8, 16, 32, 44, 52, 56, 58];
const COPIES: [CopyState; 3] = [CopyState::Modified, CopyState::Exclusive, CopyState::Shared];

/// Loads before lines that nobody has loaded: enough for what the benchmark itself needs to be in the caches.
const WARM_LOADS: u32 = 64;

/// Loads of lines `stride_bytes` apart in an array of `array_bytes`, lap after lap.
fn laps(array_bytes: u64, stride_bytes: u32) -> Chase {
    let count = (array_bytes / u64::from(stride_bytes)).max(1) as u32;
    let lap = count.next_multiple_of(64);
    Chase {
        order: Order::Stride { count, stride_bytes },
        warm_loads: lap,
        loads: lap.max(8192).next_multiple_of(256),
    }
}

/// Loads of lines that nobody has loaded before.
fn fresh(stride_bytes: u32, loads: u32) -> Chase {
    let count = WARM_LOADS + Chase::loads_measured(loads);
    Chase { order: Order::Stride { count, stride_bytes }, warm_loads: WARM_LOADS, loads }
}

/// Loads that hit L1.
fn l1_hits() -> Chase {
    laps(16 << 10, 64)
}

/// Loads that hit L2, of fewer pages than a TLB holds.
fn l2_hits() -> Chase {
    laps(192 << 10, 128)
}

/// Loads that every time miss the TLB for 4 KB pages and hit L1.
fn tlb_misses() -> Chase {
    laps(8 * (64 << 10), 64 << 10)
}

/// Loads from memory, prefetcher off.
pub(super) fn memory(at: &Conditions<'_>, loads: u32) -> Experiment {
    at.under(&[PREFETCHER_OFF], Bench::Chase(fresh(64, loads.next_multiple_of(256))))
}

/// The latency of a hit in the L2.
pub(super) fn l2(at: &Conditions<'_>) -> Experiment {
    at.experiment(Bench::Chase(l2_hits()))
}

fn remote(at: &Conditions<'_>, copy: CopyState, owner: u32) -> Result<Experiment, NotExpressed> {
    if owner == 0 || owner >= at.cores || at.cores < 3 {
        return Err(NotExpressed("the machine has no such core beside core 0 and a third one"));
    }
    Ok(at.experiment(Bench::Remote(Remote { copy, owner, lines: 1024 })))
}

/// All cells of the table of remote latencies, state by state.
fn remote_table(at: &Conditions<'_>) -> Result<Vec<Experiment>, NotExpressed> {
    COPIES.iter().flat_map(|copy| OWNERS.map(|owner| remote(at, *copy, owner))).collect()
}

fn mean(outcomes: &[&Outcome]) -> f64 {
    outcomes.iter().map(|outcome| outcome.cycles_per_unit()).sum::<f64>() / outcomes.len() as f64
}

pub(super) fn plan(id: &[&str], unit: &str, at: &Conditions<'_>) -> Result<Plan, NotExpressed> {
    // A latency is in nanoseconds or in cycles.
    let latency = |experiment| {
        let value: fn(&Outcome) -> f64 =
            if unit == "ns" { Outcome::ns_per_unit } else { Outcome::cycles_per_unit };
        Plan::one(experiment, value)
    };
    let chase = |chase| latency(at.experiment(Bench::Chase(chase)));
    match id {
        ["lat", "l1"] => Ok(chase(l1_hits())),
        ["lat", "l2"] => Ok(latency(l2(at))),
        ["lat", "geom", _, geometry] => {
            let (count, stride) = pattern(geometry).ok_or(UNKNOWN)?;
            Ok(chase(laps(u64::from(count) * u64::from(stride), stride)))
        }
        ["lat", "size", size] => {
            let bench = Bench::Chase(laps(bytes(size).ok_or(UNKNOWN)?, 64));
            Ok(latency(at.under(&[PREFETCHER_OFF], bench)))
        }
        ["lat", "mem", "hwp", stride] => {
            let stride = u32::try_from(bytes(stride).ok_or(UNKNOWN)?).map_err(|_| UNKNOWN)?;
            Ok(chase(fresh(stride.max(4), ((2 << 20) / stride.max(4)).next_multiple_of(256))))
        }
        ["hwp", "line_interval"] => Ok(chase(fresh(64, 32_768))),
        ["lat", "mem", "loaded", threads] => {
            let threads = number(threads, "t").ok_or(UNKNOWN)?;
            let bench = throughput::memory_stream(at, "read_nopf", threads)?;
            Ok(Plan::of(vec![bench], move |o| f64::from(threads) * 64.0 / o[0].units_per_ns()))
        }
        ["lat", "mem", _] => Ok(latency(memory(at, 16_384))),
        ["lat", "ptr", "l2_tlb"] => {
            let order = Order::Random { bytes: 384 << 10 };
            Ok(chase(Chase { order, warm_loads: 6144, loads: 12_288 }))
        }
        ["lat", "ptr", "beyond_l2"] => {
            let order = Order::Random { bytes: 8 << 20 };
            Ok(chase(Chase { order, warm_loads: WARM_LOADS, loads: 16_384 }))
        }
        ["lat", "dtlb", "4k"] => {
            let benches = [tlb_misses(), l1_hits()].map(|chase| at.experiment(Bench::Chase(chase)));
            Ok(Plan::of(benches.into(), |o| o[0].cycles_per_unit() - o[1].cycles_per_unit()))
        }
        ["lat", "dtlb", "2m"] => {
            let pages = ["tlb.page_bytes=2097152"];
            // A line of 16 pages each, in as many sets of the caches.
            let order = Order::Stride { count: 16, stride_bytes: (2 << 20) + 320 };
            let misses = Chase { order, warm_loads: 64, loads: 1024 };
            let benches = [misses, l1_hits()].map(|chase| at.under(&pages, Bench::Chase(chase)));
            Ok(Plan::of(benches.into(), |o| o[0].cycles_per_unit() - o[1].cycles_per_unit()))
        }
        ["lat", "remote_l2", "mean"] => Ok(Plan::of(remote_table(at)?, mean)),
        ["lat", "remote_l2", "state_gap"] => Ok(Plan::of(remote_table(at)?, |o| {
            let [modified, _, shared] =
                [0, 1, 2].map(|state| mean(&o[state * OWNERS.len()..][..OWNERS.len()]));
            modified - shared
        })),
        ["lat", "remote_l2", "distance_slope"] => Ok(Plan::of(remote_table(at)?, |o| {
            let spread = |row: &[&Outcome]| {
                let cycles = || row.iter().map(|outcome| outcome.cycles_per_unit());
                cycles().fold(f64::MIN, f64::max) - cycles().fold(f64::MAX, f64::min)
            };
            o.chunks(OWNERS.len()).map(spread).fold(f64::MIN, f64::max)
        })),
        ["lat", "remote_l2", copy, core] => {
            let copy = match *copy {
                "modified" => CopyState::Modified,
                "exclusive" => CopyState::Exclusive,
                "shared" => CopyState::Shared,
                _ => return Err(UNKNOWN),
            };
            Ok(latency(remote(at, copy, number(core, "core").ok_or(UNKNOWN)?)?))
        }
        ["lat", "mem_minus_remote"] => {
            let mut experiments = remote_table(at)?;
            experiments.insert(0, memory(at, 16_384));
            Ok(Plan::of(experiments, |o| o[0].cycles_per_unit() - mean(&o[1..])))
        }
        _ => Err(UNKNOWN),
    }
}
