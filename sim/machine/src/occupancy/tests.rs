use super::*;
use crate::laws::{self, Fault, Model, Resource};
use crate::streams::Random;
use std::collections::BTreeSet;

#[test]
fn requests_at_one_time_are_served_one_interval_apart() {
    let mut slots = Slots::new(4 * 256);
    let starts: Vec<Cycle> = (0..5).map(|_| slots.take(8, 0)).collect();
    assert_eq!(starts, [8, 12, 16, 20, 24]);
}

#[test]
fn a_fraction_of_a_cycle_adds_up() {
    let mut slots = Slots::new(256 * 4 / 3);
    let last = (0..300).map(|_| slots.take(0, 0)).max().expect("300 requests");
    assert!((397..=399).contains(&last), "300 requests of 4/3 cycles end at {last}");
}

#[test]
fn a_late_asker_finds_the_gap_before_an_early_one() {
    let mut slots = Slots::new(256);
    assert_eq!(slots.take(100, 0), 100);
    assert_eq!(slots.take(50, 0), 50);
    assert_eq!(slots.take(100, 0), 101);
}

#[test]
fn slots_that_begin_later_are_counted_near_and_far() {
    let mut slots = Slots::new(384);
    let starts: Vec<Cycle> = (0..10_000).map(|i| slots.take(i % 7 * 900, 0)).collect();
    for from in [0, 1, 2, 3, 4, 899, 6000, 14_000, 15_001, 20_000] {
        // The last request of those at one time may stand within a slot that began before.
        let model = starts.iter().filter(|start| **start >= from).count() as u64;
        assert!((model.saturating_sub(1)..=model).contains(&slots.taken_from(from)), "from {from}");
    }
}

#[test]
fn ticks_of_far_pages_are_taken_once_and_counted() {
    let mut ticks = Ticks::<2>::new(2);
    for i in 0..100 {
        assert!(ticks.take(1, i * 97, 90, 0), "{i}");
        assert!(!ticks.take(1, i * 97 + 89, 8, 0), "{i}");
    }
    assert_eq!(ticks.taken_from(0), 9000);
    assert_eq!(ticks.taken_from(50 * 97 + 10), 4490);
    // Far pages come back when the floor has passed the near ones, and then are gone from the map.
    assert!(ticks.take(1, 20_000, 90, 20_000));
    assert_eq!((ticks.taken_from(20_000), ticks.far.len()), (90, 0));
}

impl Resource for Slots {
    fn ask(&mut self, _: u32, at: Cycle, floor: Cycle) -> Cycle {
        self.take(at, floor)
    }

    fn peak(&self, cycles: Cycle) -> u64 {
        Slots::peak(self, cycles)
    }
}

/// Slots as a set of numbers.
fn model(interval_x256: u64) -> Model {
    let mut taken = BTreeSet::new();
    Box::new(move |_, at| {
        let slot = (at * 256 / interval_x256..).find(|slot| !taken.contains(slot)).expect("endless");
        taken.insert(slot);
        at.max((slot * interval_x256).div_ceil(256))
    })
}

#[test]
fn slots_obey_the_laws() {
    for interval_x256 in [512, 1365, 70_000, 9 * 65_536 + 17] {
        laws::obeys(&Slots::new(interval_x256), || model(interval_x256))
            .unwrap_or_else(|broken| panic!("{interval_x256}/256 cycles: {broken}"));
    }
    // One in a cycle, and several.
    for interval_x256 in [256, 85] {
        let slots = Slots::new(interval_x256);
        laws::never_early_nor_above_peak(&slots, 300_000).expect("kept");
        laws::agrees_with(&slots, || model(interval_x256)).expect("kept");
    }
}

#[test]
fn slots_that_forget_are_caught() {
    let mut slots = Slots::new(512);
    slots.fault = Some(Fault::SlotsForget);
    laws::never_early_nor_above_peak(&slots, 100_000).expect_err("above the peak");
    laws::agrees_with(&slots, || model(512)).expect_err("served for free");
}

#[test]
fn ticks_refuse_without_a_trace() {
    let mut random = Random::new(9);
    let ask = |ticks: &mut Ticks<4>, request: u32| {
        let floor = u64::from(request) * 20;
        let (ahead, count) = (random.below(2000), 1 + random.below(100));
        ticks.take(request % 3, floor + u64::from(ahead), count, floor)
    };
    laws::refuses_without_a_trace(&Ticks::new(3), ask).expect("kept");
}
