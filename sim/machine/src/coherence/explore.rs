//! Every reachable state of one line in three cores' caches and the directory, through the code that is timed.
//!
//! A state is what can be seen of the line: both tags of each core, the directory's record, and whether memory has what
//! was written last. From each, every operation of every core is tried; a state is reached again by running the operations
//! that first led to it. Seeded faults show that the checks can fail.

use super::bench::{self, Order, Wish};
use super::{Fault, State};
use crate::cache::{Intent, Tags};
use crate::config::{MachineConfig, shipped};
use crate::streams::Random;
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};

const CORES: usize = 3;
const LINE: u32 = 0;

/// What a core may do to the line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Operation {
    Load,
    Store,
    StreamStore,
    Atomic,
    PrefetchL2,
    /// Loads of another line, which throw this one out of the L1 but not of the L2.
    EvictL1,
    /// Loads of other lines, which throw this one out of L1 and L2.
    EvictL2,
}

const OPERATIONS: [Operation; 7] = [
    Operation::Load,
    Operation::Store,
    Operation::StreamStore,
    Operation::Atomic,
    Operation::PrefetchL2,
    Operation::EvictL1,
    Operation::EvictL2,
];

/// What a core has of the line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Copy {
    /// Writable and dirty; `None` when the L1 has nothing.
    l1: Option<(bool, bool)>,
    l2: State,
}

#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
struct Seen {
    copies: [Copy; CORES],
    owner: Option<u32>,
    sharers: Vec<u32>,
    /// Whether memory has what was written last.
    fresh: bool,
}

/// Three cores whose L1s hold one line and whose L2s hold two.
struct Bench {
    bench: bench::Bench,
    fresh: bool,
}

/// The machine, its order and what is wrong with it.
#[derive(Debug, Clone, Copy)]
struct Setting {
    order: Order,
    fault: Option<Fault>,
    posted: bool,
}

impl Bench {
    fn new(setting: Setting) -> Bench {
        let Setting { order, fault, posted } = setting;
        let mut config = shipped("larrabee-24");
        config.cores = CORES as u32;
        (config.l1d.capacity_bytes, config.l1d.ways) = (64, 1);
        (config.l2.capacity_bytes, config.l2.ways) = (128, 2);
        config.core.posted_streaming_stores = posted;
        config.memory.acknowledges_writes = posted;
        let spec = config.validate().expect("sound");
        Bench { bench: bench::Bench::new(&spec, order, fault), fresh: true }
    }

    /// Has `core` begin an operation at `at`; returns whether it writes the line.
    fn begin(&mut self, core: usize, operation: Operation, at: u64) -> bool {
        // Lines of its own, which nobody writes.
        let others = [1, 2].map(|i| 16 * (1 + core as u32) + i);
        let read = |line| Wish::Access { line, intent: Intent::Read };
        let mut wish = |wish| self.bench.wish(core, wish, at);
        match operation {
            Operation::Load => wish(read(LINE)),
            Operation::Store => wish(Wish::Access { line: LINE, intent: Intent::Write }),
            Operation::StreamStore => wish(Wish::Access { line: LINE, intent: Intent::Stream }),
            Operation::Atomic => wish(Wish::Lock { line: LINE }),
            Operation::PrefetchL2 => wish(Wish::PrefetchL2 { line: LINE }),
            Operation::EvictL1 => wish(read(others[0])),
            Operation::EvictL2 => {
                for (line, later) in [others[0], others[1], others[0], others[1]].into_iter().zip(0..) {
                    self.bench.wish(core, read(line), at + 1000 * later);
                }
            }
        }
        matches!(operation, Operation::Store | Operation::StreamStore | Operation::Atomic)
    }

    /// One operation that must be over in time.
    fn operate(&mut self, core: usize, operation: Operation) {
        let writes = self.bench.uncore.memory.counters.writes;
        let begin = self.bench.now + 10;
        let written = self.begin(core, operation, begin);
        self.bench.settle();
        assert!(self.bench.now < begin + 10_000, "never answered");
        // Nobody writes another line, so every line written back is this one; a store makes what memory has old again.
        self.fresh |= self.bench.uncore.memory.counters.writes > writes;
        self.fresh &= !written;
    }

    /// Operations of two cores, the second so many cycles after the first: nobody waits for the other's end.
    fn race(&mut self, first: (usize, Operation), second: (usize, Operation), later: u64) {
        let writes = self.bench.uncore.memory.counters.writes;
        let begin = self.bench.now + 10;
        let mut written = self.begin(first.0, first.1, begin);
        written |= self.begin(second.0, second.1, begin + later);
        self.bench.settle();
        assert!(self.bench.now < begin + 10_000, "never answered");
        // Memory may have got what was there before the write: only a write without any write-back is surely not there.
        self.fresh &= !written;
        self.fresh |= self.bench.uncore.memory.counters.writes > writes;
    }

    fn seen(&mut self) -> Seen {
        let copies = std::array::from_fn(|core| {
            let caches = &self.bench.cores[core].shared.caches;
            let l1 = caches.l1.find(LINE).map(|slot| caches.l1.bits(slot));
            Copy {
                l1: l1.map(|bits| (bits & Tags::WRITABLE != 0, bits & Tags::DIRTY != 0)),
                l2: caches.l2.find(LINE).map_or(State::I, |slot| State::from_bits(caches.l2.bits(slot))),
            }
        });
        let (record, pool) = self.bench.uncore.directory.record(LINE);
        let mut sharers = Vec::new();
        record.sharers.for_each(pool, |core| sharers.push(core));
        sharers.sort_unstable();
        Seen { copies, owner: record.sharers.owner(), sharers, fresh: self.fresh }
    }
}

/// What must hold in every state.
fn check(seen: &Seen) {
    let holders: Vec<u32> =
        (0..CORES as u32).filter(|core| seen.copies[*core as usize].l2 != State::I).collect();
    let owners: Vec<u32> =
        holders.iter().copied().filter(|core| seen.copies[*core as usize].l2.is_owner()).collect();
    assert!(owners.is_empty() || holders.len() == 1, "one writer or many readers");
    assert_eq!(seen.sharers, holders, "the directory knows every copy and no other");
    assert_eq!(seen.owner, owners.first().copied(), "the directory knows the owner");
    for copy in &seen.copies {
        if let Some((writable, dirty)) = copy.l1 {
            assert!(copy.l2 != State::I, "the L2 includes the L1");
            assert!(
                writable == copy.l2.is_owner() && (writable || !dirty),
                "the L1 may write what the L2 owns"
            );
        }
    }
    let newest = |copy: &Copy| copy.l2 == State::M || copy.l1.is_some_and(|(_, dirty)| dirty);
    assert!(seen.fresh || seen.copies.iter().any(newest), "what was written last is lost");
}

type Path = Vec<(usize, Operation)>;

fn path_to(setting: Setting, path: &Path) -> Bench {
    let mut bench = Bench::new(setting);
    path.iter().for_each(|(core, operation)| bench.operate(*core, *operation));
    bench
}

/// All states that can be reached by one operation after the other, checked, and a way to each; panics in the first that is
/// wrong.
fn explore(setting: Setting) -> Vec<Path> {
    let mut paths = BTreeMap::from([(path_to(setting, &Path::new()).seen(), Path::new())]);
    let mut open: Vec<Path> = vec![Path::new()];
    while let Some(path) = open.pop() {
        for core in 0..CORES {
            for operation in OPERATIONS {
                let mut bench = path_to(setting, &path);
                bench.operate(core, operation);
                let seen = bench.seen();
                check(&seen);
                let mut longer = path.clone();
                longer.push((core, operation));
                if let std::collections::btree_map::Entry::Vacant(entry) = paths.entry(seen) {
                    entry.insert(longer.clone());
                    open.push(longer);
                }
            }
        }
    }
    paths.into_values().collect()
}

/// All settings without a fault.
fn settings() -> impl Iterator<Item = Setting> {
    Order::ALL
        .into_iter()
        .flat_map(|order| [false, true].map(|posted| Setting { order, fault: None, posted }))
}

#[test]
fn every_reachable_state_of_three_caches_and_the_directory_is_sound() {
    let counts: Vec<usize> = settings()
        .map(|setting| {
            let states = explore(setting).len();
            println!("three caches, one line, {setting:?}: {states} states");
            assert!(states > 40, "{states} states");
            states
        })
        .collect();
    assert_eq!(counts[..2], counts[2..], "both orders reach the same states");
}

#[test]
fn every_race_of_two_operations_ends_in_a_sound_state() {
    for setting in settings() {
        for path in explore(setting) {
            for (first, second) in (0..OPERATIONS.len() * OPERATIONS.len())
                .map(|i| (OPERATIONS[i / OPERATIONS.len()], OPERATIONS[i % OPERATIONS.len()]))
            {
                for (core, later) in [(0, 7), (1, 0), (2, 90)] {
                    let mut bench = path_to(setting, &path);
                    bench.race((0, first), (core, second), later);
                    let seen = bench.seen();
                    let caught = catch_unwind(AssertUnwindSafe(|| check(&seen)));
                    assert!(
                        caught.is_ok(),
                        "{setting:?}, after {path:?}: {first:?} of core 0 and {second:?} of core {core}, {later} later: {seen:?}"
                    );
                }
            }
        }
    }
}

/// Whether a defect of the protocol is noticed.
pub(crate) fn notices(fault: Fault) -> bool {
    Order::ALL.into_iter().all(|order| {
        let setting = Setting { order, fault: Some(fault), posted: true };
        catch_unwind(AssertUnwindSafe(|| explore(setting))).is_err()
    })
}

#[test]
fn every_fault_of_the_protocol_is_caught() {
    for fault in Fault::PROTOCOL {
        assert!(notices(fault), "{fault:?} was not noticed");
    }
}

/// Machines that differ in everything that the path of an access asks.
fn machines() -> Vec<MachineConfig> {
    let mut machines = Vec::new();
    for (name, cores, l1_ways, l2_ways) in
        [("larrabee-24", 5, 2, 4), ("knc-5110p", 9, 2, 4), ("knc-5110p", 70, 1, 2), ("larrabee-24", 33, 4, 8)]
    {
        let mut config = shipped(name);
        config.cores = cores;
        (config.l1d.capacity_bytes, config.l1d.ways) = (u64::from(l1_ways) * 256, l1_ways);
        (config.l2.capacity_bytes, config.l2.ways) = (u64::from(l2_ways) * 512, l2_ways);
        (config.l1d.mshrs, config.l2.mshrs) = (2, 3);
        config.prefetcher.mshrs_spared = 0;
        machines.push(config);
    }
    machines
}

#[test]
fn random_traffic_keeps_every_line_sound_on_every_machine() {
    for (config, order) in
        machines().into_iter().flat_map(|config| Order::ALL.map(|order| (config.clone(), order)))
    {
        let spec = config.validate().expect("sound");
        let mut bench = bench::Bench::new(&spec, order, None);
        let mut random = Random::new(u64::from(config.cores));
        let lines = 96;
        // What was written last, and whether memory has it, cannot be told apart line by line here: only the protocol is.
        for round in 0..30_000_u32 {
            let core = random.below(if round % 3 == 0 { config.cores } else { 3 }) as usize;
            let line = random.below(if round % 4 == 0 { 6 } else { lines });
            let intent =
                [Intent::Read, Intent::Read, Intent::Write, Intent::Stream][random.below(4) as usize];
            let wish = match random.below(16) {
                0 | 1 => Wish::PrefetchL2 { line },
                2 => Wish::Lock { line },
                _ => Wish::Access { line, intent },
            };
            bench.wish(core, wish, bench.now + u64::from(random.below(200)));
            if round % 8 == 0 {
                bench.run_until(bench.now + 100);
            }
            if round % 300 == 0 {
                bench.settle();
                super::tests::check(&mut bench, lines);
            }
        }
        bench.settle();
        super::tests::check(&mut bench, lines);
    }
}

#[test]
fn random_races_from_random_states_end_in_sound_states() {
    for (seed, order) in (1..400).flat_map(|seed| Order::ALL.map(|order| (seed, order))) {
        let mut random = Random::new(seed);
        let config = {
            let mut config = machines().swap_remove(random.below(4) as usize);
            config.cores = 3 + random.below(4);
            config
        };
        let spec = config.validate().expect("sound");
        let mut bench = bench::Bench::new(&spec, order, None);
        let lines = 48;
        for race in 0..40 {
            let mut wishes = Vec::new();
            let most = [4, 12, 40][race % 3];
            for _ in 0..2 + random.below(most) {
                let line = [0, 8, 16, 24, 32, 40, 3][random.below(7) as usize];
                let wish = match random.below(8) {
                    0 => Wish::PrefetchL2 { line },
                    1 => Wish::Lock { line },
                    2 => Wish::Access { line, intent: Intent::Stream },
                    3 | 4 => Wish::Access { line, intent: Intent::Write },
                    _ => Wish::Access { line, intent: Intent::Read },
                };
                let core = random.below(config.cores) as usize;
                let within = [50, 300, 1000][random.below(3) as usize];
                let at = bench.now + u64::from(random.below(within));
                bench.wish(core, wish, at);
                wishes.push((at, core, wish));
            }
            let caught = catch_unwind(AssertUnwindSafe(|| {
                bench.settle();
                super::tests::check(&mut bench, lines);
            }));
            wishes.sort_by_key(|wish| wish.0);
            assert!(caught.is_ok(), "seed {seed}, {order:?}, race {race}: {wishes:?}");
        }
    }
}
