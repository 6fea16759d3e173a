use super::*;
use crate::config::{MachineConfig, shipped};
use crate::laws::{self, Fault, LOAD_CYCLES, Model, Resource};
use crate::streams::Random;
use std::collections::{BTreeMap, BTreeSet};

/// Rings as `cycle` has them, and as `windowed` does.
fn both(cores: u32, edit: impl FnOnce(&mut MachineConfig)) -> [Rings; 2] {
    let mut config = shipped("larrabee-24");
    config.cores = cores;
    edit(&mut config);
    let spec = config.validate().expect("sound");
    [Rings::new(&spec, true), Rings::new(&spec, false)]
}

fn rings(cores: u32, edit: impl FnOnce(&mut MachineConfig)) -> Rings {
    let [exact, _] = both(cores, edit);
    exact
}

#[test]
fn an_idle_message_arrives_after_its_hops_and_not_a_cycle_off() {
    for (cores, mut rings) in
        [1, 2, 3, 12, 16, 17, 24, 100, 1024].into_iter().flat_map(|n| both(n, |_| ()).map(|rings| (n, rings)))
    {
        let mut now = 7;
        for (from, to) in [(0, cores - 1), (cores / 2, 0), (cores / 3, cores / 2)] {
            for message in [Message::Address, Message::Line] {
                // Long after the last message has left the ring.
                now += 10_001;
                let idle = rings.idle_cycles(from, to, message);
                let sent = rings.send(from, to, message, now, now);
                assert_eq!(sent, Sent { at: now + idle, waited: 0 }, "{cores} cores, {from} to {to}");
            }
        }
    }
}

#[test]
fn ways_are_never_longer_than_half_a_ring() {
    let rings = rings(12, |_| ());
    for from in 0..12 {
        for to in 0..12 {
            let hops = rings.idle_cycles(from, to, Message::Address);
            let apart = u64::from(from.abs_diff(to));
            assert_eq!(hops, apart.min(12 - apart));
        }
    }
}

#[test]
fn a_narrow_ring_sends_a_line_in_parts() {
    for mut rings in both(12, |config| config.ring.bytes_per_cycle = 16) {
        assert_eq!(rings.send(0, 3, Message::Line, 100, 0).at, 100 + 3 + 3);
        assert_eq!(rings.send(0, 3, Message::Address, 100, 0).at, 100 + 3);
    }
}

#[test]
fn a_link_carries_one_line_a_cycle_and_no_more() {
    let mut rings = rings(12, |_| ());
    let mut arrivals: Vec<Cycle> = (0..100).map(|_| rings.send(0, 1, Message::Line, 50, 0).at).collect();
    arrivals.sort_unstable();
    assert_eq!(arrivals, (51..151).collect::<Vec<_>>());
}

#[test]
fn a_counted_link_carries_32_lines_in_32_cycles_and_no_more() {
    let [_, mut rings] = both(12, |_| ());
    let arrivals: Vec<Cycle> = (0..100).map(|_| rings.send(0, 1, Message::Line, 70, 0).at).collect();
    let of_window = |first: Cycle| arrivals.iter().filter(|at| (first + 1..=first + 32).contains(at)).count();
    assert_eq!([64, 96, 128, 160].map(of_window), [32, 32, 32, 4]);
}

#[test]
fn messages_on_disjoint_links_do_not_disturb_each_other() {
    for mut rings in both(12, |_| ()) {
        for stop in 0..12 {
            assert_eq!(rings.send(stop, (stop + 1) % 12, Message::Line, 9, 0).at, 10);
        }
        assert_eq!(rings.take_counters().wait_cycles, 0);
    }
}

#[test]
fn counted_links_fill_exactly_where_rides_pass() {
    // A model of plain numbers, for rides of any length round the ring in both directions.
    let [_, mut rings] = both(12, |_| ());
    let mut model = BTreeMap::<(u64, usize, u32), u32>::new();
    let mut random = Random::new(11);
    for round in 0..4000 {
        let (from, to) = (random.below(12), random.below(12));
        let now = round / 5;
        let up = (to + 12 - from) % 12;
        let direction = usize::from(up > 6 || up == 6 && now % 2 == 1);
        let hops = up.min(12 - up);
        let first = if direction == 0 { from } else { to };
        let links: Vec<u32> = (first..first + hops).map(|link| link % 12).collect();
        let mut window = now / 32;
        while links.iter().any(|link| model.get(&(window, direction, *link)) == Some(&32)) {
            window += 1;
        }
        for link in links {
            *model.entry((window, direction, link)).or_default() += 1;
        }
        let expected = now.max(window * 32) * u64::from(hops > 0) + now * u64::from(hops == 0);
        assert_eq!(rings.send(from, to, Message::Address, now, 0).at, expected + u64::from(hops));
    }
}

#[test]
fn every_core_has_its_own_stop() {
    for cores in [1, 5, 16, 17, 24, 33, 1000] {
        let rings = rings(cores, |_| ());
        let mut places: Vec<_> = rings.places.clone();
        for Place { ring, stop } in &places {
            assert!(*stop < rings.loops[*ring as usize].stops);
        }
        places.dedup();
        assert_eq!(places.len(), cores as usize);
    }
}

/// Lines over one link, from stop 0 to stop 1.
#[derive(Debug, Clone, PartialEq)]
struct Link(Rings);

impl Resource for Link {
    fn ask(&mut self, _: u32, at: Cycle, floor: Cycle) -> Cycle {
        self.0.send(0, 1, Message::Line, at, floor).at - 1
    }

    fn peak(&self, cycles: Cycle) -> u64 {
        // Twelve stops, two directions, two strands.
        self.0.peak_slot_hops(cycles) / 48
    }
}

/// Short messages between any two of twelve stops.
#[derive(Debug, Clone, PartialEq)]
struct Ring(Rings);

fn pair(request: u32) -> (u32, u32) {
    let mixed = request.wrapping_mul(2_654_435_761) >> 8;
    (mixed % 12, mixed / 12 % 12)
}

impl Resource for Ring {
    fn ask(&mut self, request: u32, at: Cycle, floor: Cycle) -> Cycle {
        let (from, to) = pair(request);
        let sent = self.0.send(from, to, Message::Address, at, floor);
        let idle = self.0.idle_cycles(from, to, Message::Address);
        assert_eq!(sent.at, at + sent.waited + idle, "what is not on the way is waiting");
        at + sent.waited
    }

    /// As if all went to the next stop only.
    fn peak(&self, cycles: Cycle) -> u64 {
        self.0.peak_slot_hops(cycles) / 2
    }
}

/// Direction and links of a ride on twelve stops.
fn ride(from: u32, to: u32, now: Cycle) -> (usize, Vec<u32>) {
    let up = (to + 12 - from) % 12;
    let direction = usize::from(up > 6 || up == 6 && now % 2 == 1);
    let links = match direction {
        0 => (0..up).map(|i| (from + i) % 12).collect(),
        _ => (0..12 - up).map(|i| (from + 23 - i) % 12).collect(),
    };
    (direction, if from == to { Vec::new() } else { links })
}

/// Every link in every cycle.
fn exact_model() -> Model {
    let mut taken = BTreeSet::new();
    Box::new(move |request, now| {
        let (from, to) = pair(request);
        let (direction, links) = ride(from, to, now);
        let on_link = |board: Cycle| (board..).zip(links.iter().map(move |link| (direction, *link)));
        let board = (now..).find(|board| on_link(*board).all(|at| !taken.contains(&at))).expect("endless");
        taken.extend(on_link(board));
        board
    })
}

/// Every link in every window of 32 cycles.
fn counted_model() -> Model {
    let mut taken = BTreeMap::<(u64, usize, u32), u32>::new();
    Box::new(move |request, now| {
        let (from, to) = pair(request);
        let (direction, links) = ride(from, to, now);
        let is_free =
            |window: u64| links.iter().all(|link| taken.get(&(window, direction, *link)) < Some(&32));
        let window = (now / 32..).find(|window| is_free(*window)).expect("endless");
        for link in links {
            *taken.entry((window, direction, link)).or_default() += 1;
        }
        now.max(window * 32)
    })
}

#[test]
fn rings_obey_the_laws() {
    let models = [exact_model, counted_model];
    for (rings, model) in both(12, |_| ()).into_iter().zip(models) {
        let link = Link(rings.clone());
        laws::never_early_nor_above_peak(&link, LOAD_CYCLES / 4).expect("kept");
        laws::serves_as_asked(&link).expect("kept");
        let ring = Ring(rings);
        laws::serves_as_asked(&ring).expect("kept");
        laws::agrees_with(&ring, model).expect("kept");
    }
}

#[test]
fn links_that_forget_are_caught() {
    let [_, mut rings] = both(12, |_| ());
    rings.tracks.counts.fault = Some(Fault::LinksForget);
    laws::never_early_nor_above_peak(&Link(rings.clone()), 20_000).expect_err("above the peak");
    laws::agrees_with(&Ring(rings), counted_model).expect_err("served for free");
}

#[test]
fn a_line_in_parts_takes_a_slot_of_a_link_for_each() {
    for mut rings in both(12, |config| config.ring.bytes_per_cycle = 1) {
        let last = (0..100).map(|_| rings.send(0, 1, Message::Line, 0, 0).at).max();
        let waited = rings.take_counters().wait_cycles;
        assert!((6400..6500).contains(&last.expect("a hundred")), "{last:?}");
        assert!(waited > 0);
    }
}

#[test]
fn slots_that_are_taken_ahead_are_counted() {
    for [mut exact, mut counted] in [both(12, |_| ()), both(100, |config| config.ring.hop_cycles = 3)] {
        for rings in [&mut exact, &mut counted] {
            let (mut random, cores) = (Random::new(2), rings.places.len() as u32);
            for i in 0..5000_u32 {
                rings.send(random.below(cores), random.below(cores), Message::Line, (i / 8).into(), 0);
            }
            let hops = rings.take_counters().slot_hops;
            assert_eq!(rings.slot_hops_from(0), hops);
            assert_eq!(rings.slot_hops_from(1_000_000), 0);
            let later = rings.slot_hops_from(320);
            assert!(later < hops && hops - later <= rings.peak_slot_hops(320), "{later} of {hops}");
        }
    }
}

#[test]
fn kinds_of_message_take_turns_of_their_own() {
    let [mut rings, _] = both(12, |config| config.ring.address_rings = 2);
    // Two at once find two strands, whatever else is sent between them.
    for _ in 0..2 {
        assert_eq!(rings.send(0, 1, Message::Address, 10, 0).waited, 0);
        rings.send(4, 7, Message::Line, 10, 0);
    }
    assert_eq!(rings.send(0, 1, Message::Address, 10, 0).waited, 1);
}

#[test]
fn tables_of_a_big_machine_grow_with_its_cores() {
    let [_, rings] = both(1024, |_| ());
    let counted = rings.loops.iter().filter(|ring| matches!(ring.track, Track::Counts(..))).count();
    assert_eq!((counted, rings.loops.len(), rings.tracks.belts.len()), (64, 65, 4));
}
