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
                None => (false, tags.insert(tags.place_for(line), line, 0).map(|(victim, _)| victim)),
            };
            assert_eq!((hit, victim), model.access(line), "{sets} sets of {ways}");
        }
    }
}

#[test]
fn an_mshr_is_free_from_the_cycle_of_its_fill() {
    let mut mshrs = Mshrs::new(2);
    mshrs.hold(0, 7, When::new(100, Cause::Memory), 0);
    mshrs.hold(1, 8, When::new(50, Cause::L2), 0);
    assert_eq!((mshrs.free(49), mshrs.free(50)), (Err(50), Ok(1)));
    assert!(mshrs.in_flight(7, 99).is_some());
    assert!(mshrs.in_flight(7, 100).is_none());
    assert_eq!(mshrs.occupied(60).len(), 1);
}

#[test]
fn of_two_misses_of_a_line_the_later_counts() {
    // The line was lost before it had arrived, and asked for again; its first MSHR is still taken.
    let mut mshrs = Mshrs::new(3);
    mshrs.hold(0, 7, When::new(100, Cause::Memory), 0);
    mshrs.hold(1, 7, When::new(180, Cause::Remote), 0);
    assert_eq!(mshrs.in_flight(7, 50), Some(When::new(180, Cause::Remote)));
    assert_eq!(mshrs.free(50), Ok(2));
}
