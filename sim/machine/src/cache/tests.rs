use super::*;
use crate::counters::Cause;
use crate::streams::Random;
use crate::when::When;

/// The dumb model: ways as plain options, marks as plain bools.
struct Model {
    sets: Vec<Vec<(Option<u32>, bool)>>,
}

impl Model {
    /// Touches or inserts `line`; returns whether it was there, and the victim.
    fn access(&mut self, line: u32) -> (bool, Option<u32>) {
        let index = line as usize % self.sets.len();
        let set = &mut self.sets[index];
        let found = set.iter().position(|(held, _)| *held == Some(line));
        let way = found
            .or_else(|| set.iter().position(|(held, _)| held.is_none()))
            .or_else(|| set.iter().position(|(_, recent)| !recent))
            .unwrap_or(0);
        let victim = if found.is_some() { None } else { set[way].0 };
        set[way] = (Some(line), true);
        if set.iter().all(|(_, recent)| *recent) {
            set.iter_mut().for_each(|(_, recent)| *recent = false);
            set[way].1 = true;
        }
        (found.is_some(), victim)
    }
}

#[test]
fn tags_agree_with_a_dumb_model_under_random_traffic() {
    for (sets, ways) in [(1, 1), (4, 2), (3, 5), (64, 8), (5, 12), (2, 16)] {
        let mut tags = Tags::new(sets, ways);
        let mut model = Model { sets: vec![vec![(None, false); ways as usize]; sets as usize] };
        let mut random = Random::new(u64::from(sets * 100 + ways));
        for _ in 0..20_000 {
            let line = random.below(sets * ways * 2);
            let (hit, victim) = match tags.find(line) {
                Some(slot) => {
                    tags.touch(slot);
                    (true, None)
                }
                None => {
                    let place = tags.place_for(line).expect("nothing is reserved");
                    (false, tags.insert(place, line, 0).map(|(victim, _)| victim))
                }
            };
            assert_eq!((hit, victim), model.access(line), "{sets} sets of {ways}");
        }
    }
}

#[test]
fn a_way_that_a_fill_is_on_its_way_to_is_no_victim() {
    let mut tags = Tags::new(1, 4);
    let mut slots = Vec::new();
    for line in 0..4 {
        let place = tags.place_for(line).expect("empty");
        tags.insert(place, line, 0);
        slots.push(place);
    }
    for slot in &slots[..3] {
        tags.reserve(*slot);
    }
    for line in 10..20 {
        assert_eq!(tags.place_for(line), Some(slots[3]), "the only way that is not reserved");
        tags.insert(slots[3], line, 0);
    }
    tags.reserve(slots[3]);
    assert_eq!(tags.place_for(20), None);
    tags.release(slots[1]);
    assert_eq!(tags.place_for(20), Some(slots[1]));
}

#[test]
fn an_mshr_is_free_from_the_cycle_of_its_fill() {
    let mut mshrs = Mshrs::new(2);
    mshrs.hold(0, 7, When::new(100, Cause::Memory));
    mshrs.hold(1, 8, When::new(50, Cause::L2));
    assert_eq!((mshrs.free(49), mshrs.free(50)), (Err(50), Ok(1)));
    assert!(mshrs.in_flight(7, 99).is_some());
    assert!(mshrs.in_flight(7, 100).is_none());
    assert_eq!(mshrs.occupied(60).len(), 1);
}

#[test]
fn of_two_misses_of_a_line_the_later_counts() {
    // The line was lost before it had arrived, and asked for again; its first MSHR is still taken.
    let mut mshrs = Mshrs::new(3);
    mshrs.hold(0, 7, When::new(100, Cause::Memory));
    mshrs.hold(1, 7, When::new(180, Cause::Remote));
    assert_eq!(mshrs.in_flight(7, 50), Some((1, When::new(180, Cause::Remote))));
    assert_eq!(mshrs.free(50), Ok(2));
}

#[test]
fn an_mshr_without_an_answer_is_free_at_no_time() {
    let mut mshrs = Mshrs::new(1);
    mshrs.ask(0, 7, Slot::FIRST, 3, 24);
    assert!(mshrs.awaits(7) && !mshrs.awaits(8));
    assert_eq!((mshrs.free(1_000_000), mshrs.in_flight(7, 1_000_000)), (Err(NEVER), Some((0, When::NEVER))));
    mshrs.answer(0, When::new(90, Cause::Memory), false);
    assert!(!mshrs.awaits(7));
    assert_eq!((mshrs.free(89), mshrs.free(90)), (Err(90), Ok(0)));
}

#[test]
fn an_mshr_whose_victim_is_not_safe_stays_taken_when_its_line_is_there() {
    let mut mshrs = Mshrs::new(1);
    mshrs.ask(0, 7, Slot::FIRST, 0, 0);
    mshrs.answer(0, When::new(90, Cause::Memory), true);
    assert_eq!((mshrs.free(90), mshrs.in_flight(7, 90)), (Err(NEVER), None));
    mshrs.release(0, 130);
    assert_eq!((mshrs.free(129), mshrs.free(130)), (Err(130), Ok(0)));
}

#[test]
fn all_that_wait_for_one_line_below_are_answered_at_once_and_none_too_early() {
    let mut mshrs = Mshrs::new(3);
    mshrs.ask(0, 7, Slot::FIRST, 5, 24);
    mshrs.ask(1, 7, Slot::FIRST, 5, 200);
    mshrs.ask(2, 8, Slot::FIRST, 6, 24);
    assert!(mshrs.answer_all(5, When::new(100, Cause::Memory)));
    let fills = [0, 1, 2].map(|place| mshrs.fill(place).at());
    assert_eq!(fills, [100, 200, NEVER]);
    assert!(!mshrs.answer_all(5, When::new(300, Cause::Memory)), "nobody waits any more");
}

/// The time of what is not known yet.
const NEVER: u64 = When::NEVER.at();
