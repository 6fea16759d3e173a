//! Every reachable state of one line in three cores' caches and the directory, through the code that is timed.
//!
//! A state is what can be seen of the line: both tags of each core, the directory's record, and whether memory has what
//! was written last. From each, every operation of every core is tried; a state is reached again by running the operations
//! that first led to it. Seeded faults show that the checks can fail.

use super::{Fault, Hierarchy, State};
use crate::cache::{Intent, Tags};
use crate::config::{MachineConfig, builtin_machine};
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
    /// The same for both.
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
    hierarchy: Hierarchy,
    now: u64,
    fresh: bool,
}

impl Bench {
    fn new(fault: Option<Fault>, posted: bool) -> Bench {
        let mut config: MachineConfig =
            serde_json::from_str(builtin_machine("larrabee-24").expect("shipped")).expect("parses");
        config.cores = CORES as u32;
        (config.l1d.capacity_bytes, config.l1d.ways) = (64, 1);
        (config.l2.capacity_bytes, config.l2.ways) = (128, 2);
        config.core.posted_streaming_stores = posted;
        config.memory.acknowledges_writes = posted;
        let spec = config.validate().expect("sound");
        let mut hierarchy = Hierarchy::new(&spec, true);
        hierarchy.fault = fault;
        for caches in &mut hierarchy.caches {
            caches.power_up(&spec);
        }
        Bench { hierarchy, now: 0, fresh: true }
    }

    /// One access that must be answered, and in time.
    fn access(&mut self, core: usize, line: u32, intent: Intent) {
        let mut at = self.now;
        let access = loop {
            match self.hierarchy.access(core, line, intent, at) {
                Ok(access) => break access,
                Err(retry) => {
                    assert!(retry > at && retry < self.now + 5_000, "never answered");
                    at = retry;
                }
            }
        };
        assert!(
            (self.now + 1..self.now + 5_000).contains(&access.ready.at()),
            "answered at {}",
            access.ready.at()
        );
    }

    fn operate(&mut self, core: usize, operation: Operation) {
        self.now += 10_000;
        let writes = self.hierarchy.memory.counters.writes;
        // Lines of its own, which nobody writes.
        let others = [1, 2].map(|i| 16 * (1 + core as u32) + i);
        let mut written = false;
        match operation {
            Operation::Load => self.access(core, LINE, Intent::Read),
            Operation::Store | Operation::Atomic | Operation::StreamStore => {
                written = true;
                let streams = operation == Operation::StreamStore;
                self.access(core, LINE, if streams { Intent::Stream } else { Intent::Write });
                if operation == Operation::Atomic {
                    self.hierarchy.caches[core].lock(LINE, self.now, 5);
                }
            }
            Operation::PrefetchL2 => {
                self.hierarchy.prefetch_l2(core, LINE, self.now).expect("MSHRs are free");
            }
            Operation::EvictL1 => self.access(core, others[0], Intent::Read),
            Operation::EvictL2 => {
                for line in [others[0], others[1], others[0], others[1]] {
                    self.access(core, line, Intent::Read);
                    self.now += 10_000;
                }
            }
        }
        // Nobody writes another line, so every line written back is this one; a store makes what memory has old again.
        self.fresh |= self.hierarchy.memory.counters.writes > writes;
        self.fresh &= !written;
    }

    fn seen(&mut self) -> Seen {
        let copies = std::array::from_fn(|core| {
            let caches = &self.hierarchy.caches[core];
            let l1 = caches.l1.find(LINE).map(|slot| caches.l1.bits(slot));
            Copy {
                l1: l1.map(|bits| (bits & Tags::WRITABLE != 0, bits & Tags::DIRTY != 0)),
                l2: caches.l2.find(LINE).map_or(State::I, |slot| State::from_bits(caches.l2.bits(slot))),
            }
        });
        let (record, pool) = self.hierarchy.directory.record(LINE);
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

/// All states that can be reached, checked; panics in the first that is wrong.
fn explore(fault: Option<Fault>, posted: bool) -> usize {
    let path_to = |path: &[(usize, Operation)]| {
        let mut bench = Bench::new(fault, posted);
        path.iter().for_each(|(core, operation)| bench.operate(*core, *operation));
        bench
    };
    let mut paths = BTreeMap::from([(path_to(&[]).seen(), Vec::new())]);
    let mut open: Vec<Vec<(usize, Operation)>> = vec![Vec::new()];
    while let Some(path) = open.pop() {
        for core in 0..CORES {
            for operation in OPERATIONS {
                let mut bench = path_to(&path);
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
    paths.len()
}

#[test]
fn every_reachable_state_of_three_caches_and_the_directory_is_sound() {
    for posted in [false, true] {
        let states = explore(None, posted);
        println!("three caches, one line, posted writes {posted}: {states} states");
        assert!(states > 40, "{states} states");
    }
}

#[test]
fn every_seeded_fault_is_caught() {
    for fault in Fault::ALL {
        let caught = catch_unwind(AssertUnwindSafe(|| explore(Some(fault), true))).is_err();
        assert!(caught, "{fault:?} was not noticed");
    }
}

/// Machines that differ in everything that the path of an access asks.
fn machines() -> Vec<MachineConfig> {
    let mut machines = Vec::new();
    for (name, cores, l1_ways, l2_ways) in
        [("larrabee-24", 5, 2, 4), ("knc-5110p", 9, 2, 4), ("knc-5110p", 70, 1, 2), ("larrabee-24", 33, 4, 8)]
    {
        let mut config: MachineConfig =
            serde_json::from_str(builtin_machine(name).expect("shipped")).expect("parses");
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
    for config in machines() {
        let spec = config.validate().expect("sound");
        let mut hierarchy = Hierarchy::new(&spec, false);
        for caches in &mut hierarchy.caches {
            caches.power_up(&spec);
        }
        let mut random = Random::new(u64::from(config.cores));
        let lines = 96;
        // What was written last, and whether memory has it, cannot be told apart line by line here: only the protocol is.
        let mut now = 0;
        for round in 0..30_000_u32 {
            let core = random.below(if round % 3 == 0 { config.cores } else { 3 }) as usize;
            let line = random.below(if round % 4 == 0 { 6 } else { lines });
            let intent =
                [Intent::Read, Intent::Read, Intent::Write, Intent::Stream][random.below(4) as usize];
            let mut at = now + u64::from(random.below(200));
            if random.below(8) == 0 {
                // A refused prefetch is dropped.
                let _ = hierarchy.prefetch_l2(core, line, at);
            } else {
                for tries in 0.. {
                    assert!(tries < 100, "core {core} line {line}: never answered");
                    match hierarchy.access(core, line, intent, at) {
                        Ok(access) => {
                            assert!(access.ready.at() > at);
                            break;
                        }
                        Err(retry) => {
                            assert!(retry > at);
                            at = retry;
                        }
                    }
                }
            }
            now += 30;
            if round % 300 == 0 {
                super::tests::check(&mut hierarchy, lines);
            }
        }
        super::tests::check(&mut hierarchy, lines);
    }
}
