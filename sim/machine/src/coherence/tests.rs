use super::bench::{Bench, Order, Wish};
use super::*;
use crate::cache::{Intent, Tags};
use crate::config::{MachineConfig, MachineSpec, shipped};
use crate::core::Core;
use crate::streams::Random;
use std::collections::BTreeSet;

const EVENTS: [Event; 12] = [
    Event::Read(Others::Nobody),
    Event::Read(Others::Share),
    Event::Read(Others::Own),
    Event::Write(Others::Nobody),
    Event::Write(Others::Share),
    Event::Write(Others::Own),
    Event::Stream(Others::Nobody),
    Event::Stream(Others::Share),
    Event::Stream(Others::Own),
    Event::RemoteRead,
    Event::RemoteWrite,
    Event::Evict,
];

fn others(copies: &[State], me: usize) -> Others {
    let rest = || copies.iter().enumerate().filter(|(core, _)| *core != me).map(|(_, state)| *state);
    if rest().any(State::is_owner) {
        Others::Own
    } else if rest().any(|state| state == State::S) {
        Others::Share
    } else {
        Others::Nobody
    }
}

#[test]
fn every_reachable_state_of_four_cores_has_one_writer_or_many_readers() {
    // A state: the four copies, and whether memory is up to date.
    let start = ([State::I; 4], true);
    let (mut seen, mut open) = (BTreeSet::from([start]), vec![start]);
    while let Some((copies, fresh)) = open.pop() {
        let owners = copies.iter().filter(|state| state.is_owner()).count();
        let sharers = copies.iter().filter(|state| **state == State::S).count();
        assert!(owners <= 1 && (owners == 0 || sharers == 0), "{copies:?}");
        // What is newest is somewhere: in memory, or in a modified copy.
        assert_eq!(fresh, !copies.contains(&State::M), "{copies:?}");
        for me in 0..4 {
            let kinds = [Event::Read as fn(Others) -> Event, Event::Write, Event::Stream];
            let mut events: Vec<Event> = kinds.map(|kind| kind(others(&copies, me))).into();
            if copies[me] != State::I {
                events.push(Event::Evict);
            }
            for event in events {
                let (next, actions) = transition(copies[me], event).expect("reachable, so defined");
                let (mut copies, mut fresh) = (copies, fresh);
                let needs_data = copies[me] == State::I && !matches!(event, Event::Stream(_));
                assert_eq!(actions.data != Source::Nowhere, needs_data, "{copies:?} {me} {event:?}");
                if actions.data == Source::Memory {
                    assert!(fresh, "stale data from memory: {copies:?} {me} {event:?}");
                }
                for peer in (0..4).filter(|peer| *peer != me) {
                    let remote = match copies[peer] {
                        State::I => continue,
                        _ if actions.invalidate_others => Event::RemoteWrite,
                        _ if actions.downgrade_owner => Event::RemoteRead,
                        _ => continue,
                    };
                    let (state, peer_actions) = transition(copies[peer], remote).expect("a copy can be lost");
                    copies[peer] = state;
                    fresh |= peer_actions.write_back;
                }
                copies[me] = next;
                fresh = (fresh || actions.write_back) && next != State::M;
                if seen.insert((copies, fresh)) {
                    open.push((copies, fresh));
                }
            }
        }
    }
    assert_eq!(seen.len(), 1 + 4 + 4 + 15, "nobody, E, M, any non-empty set of sharers");
}

#[test]
fn impossible_meetings_are_named_and_no_others() {
    let defined = State::ALL
        .iter()
        .flat_map(|state| EVENTS.iter().map(move |event| transition(*state, *event)))
        .filter(Option::is_some)
        .count();
    // I: 9 own events. S: 6 + 3. E and M: 3 + 3 each.
    assert_eq!(defined, 9 + 9 + 6 + 6);
}

/// Checks every copy against the directory and the two levels against each other, once nothing is under way.
pub(super) fn check(bench: &mut Bench, lines: u32) {
    for line in 0..lines {
        let mut copies = Vec::new();
        for core in &bench.cores {
            let (core, caches) = (core.index, &core.shared.caches);
            let l1 = caches.l1.find(line);
            match caches.l2.find(line) {
                Some(slot) => {
                    let state = State::from_bits(caches.l2.bits(slot));
                    assert_ne!(state, State::I, "core {core} line {line}");
                    assert!(!caches.l2.is_reserved(slot), "core {core} line {line}: no fill is on its way");
                    if let Some(l1) = l1 {
                        let writable = caches.l1.bits(l1) & Tags::WRITABLE != 0;
                        assert_eq!(writable, state.is_owner(), "core {core} line {line}");
                    }
                    copies.push((core as u32, state));
                }
                None => assert!(l1.is_none(), "core {core} line {line}: in L1 and not in L2"),
            }
        }
        let owners = copies.iter().filter(|(_, state)| state.is_owner()).count();
        assert!(owners == 0 || copies.len() == 1, "line {line}: {copies:?}");
        let (record, pool) = bench.uncore.directory.record(line);
        let mut known = Vec::new();
        record.sharers.for_each(pool, |core| known.push(core));
        known.sort_unstable();
        assert_eq!(known, copies.iter().map(|(core, _)| *core).collect::<Vec<_>>(), "line {line}");
        assert_eq!(record.sharers.owner().is_some(), owners == 1, "line {line}");
    }
}

fn spec(edit: impl Fn(&mut MachineConfig)) -> MachineSpec {
    let mut config = shipped("larrabee-24");
    edit(&mut config);
    config.validate().expect("sound")
}

#[test]
fn directory_and_caches_agree_under_random_traffic() {
    let spec = spec(|config| {
        config.cores = 70;
        (config.l1d.capacity_bytes, config.l1d.ways) = (512, 2);
        (config.l2.capacity_bytes, config.l2.ways) = (2048, 4);
    });
    for order in Order::ALL {
        let mut bench = Bench::new(&spec, order, None);
        let mut random = Random::new(5);
        let lines = 100;
        let rounds = 60_000_u32;
        for round in 0..rounds {
            // Mostly a few cores, at times all of them, so that lines have few sharers and many.
            let core = random.below(if round % 4 == 0 { 70 } else { 4 }) as usize;
            let line = random.below(if round % 3 == 0 { 8 } else { lines });
            let intent = match random.below(10) {
                0 => Intent::Stream,
                1 | 2 => Intent::Write,
                _ => Intent::Read,
            };
            bench.wish(core, Wish::Access { line, intent }, bench.now + u64::from(random.below(100)));
            // A handful in the same window.
            if round % 5 == 0 {
                bench.run_until(bench.now + 60);
            }
            if round % 500 == 0 {
                bench.settle();
                check(&mut bench, lines);
            }
        }
        bench.settle();
        check(&mut bench, lines);
        let counted = |core: &Core| {
            let counters = core.shared.caches.l1_counters;
            counters.hits + counters.misses + counters.merged
        };
        assert_eq!(bench.cores.iter().map(counted).sum::<u64>(), u64::from(rounds), "{order:?}");
    }
}

#[test]
fn second_miss_to_a_line_in_flight_fetches_once() {
    let spec = spec(|_| ());
    for order in Order::ALL {
        let mut bench = Bench::new(&spec, order, None);
        for at in [0, 10] {
            bench.wish(3, Wish::Access { line: 99, intent: Intent::Read }, at);
        }
        bench.settle();
        assert_eq!((bench.uncore.memory.counters.reads, bench.requests), (1, 1));
        let fill = bench.last_answer;
        let third = bench.access(3, 99, Intent::Read, fill).expect("free MSHRs");
        assert_eq!((third.ready.at(), third.missed), (fill + spec.l1d.hit_cycles, false));
    }
}
