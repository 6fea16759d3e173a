//! The data TLBs of a core: a first one for the page size in use, a second one whose entries cover 2 MB each.

use super::Tags;
use crate::Cycle;
use crate::config::{TlbLevelSpec, TlbSpec};

/// Lines that an entry of the second TLB covers.
const SECOND_LINES: u32 = (2 << 20) / 64;

/// Both TLBs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Tlb {
    page_lines: u32,
    /// The page that was last found translated, [`u32::MAX`] when it may have gone: most accesses go there again.
    last_page: u32,
    first: Level,
    second: Level,
    /// Pages whose translation somebody waits for or has just waited for, and when it is done: that access goes on though
    /// others have taken the place of the page, or two of them could throw one another out for ever.
    awaited: Vec<(u32, Cycle)>,
}

/// For how long after its translation an access may come.
const AWAITED_CYCLES: Cycle = 64;

#[derive(Debug, Clone, PartialEq, Eq)]
struct Level {
    entries: Tags,
    miss_cycles: Cycle,
}

impl Level {
    fn new(spec: &TlbLevelSpec) -> Level {
        Level { entries: Tags::new(spec.sets, spec.ways), miss_cycles: spec.miss_cycles }
    }

    /// Whether it has `page`.
    fn hit(&mut self, page: u32) -> bool {
        let found = self.entries.find(page);
        if let Some(slot) = found {
            self.entries.touch(slot);
        }
        found.is_some()
    }

    /// What it costs to find `page`, which is there afterwards.
    fn look_up(&mut self, page: u32) -> Cycle {
        if self.hit(page) {
            return 0;
        }
        let place = self.entries.place_for(page).expect("nothing is reserved in a TLB");
        self.entries.insert(place, page, 0);
        self.miss_cycles
    }
}

impl Tlb {
    /// `None`: translates nothing, and must not be asked.
    pub(crate) fn new(spec: Option<&TlbSpec>) -> Tlb {
        let none = || Level { entries: Tags::absent(), miss_cycles: 0 };
        match spec {
            None => {
                Tlb { page_lines: 1, last_page: u32::MAX, first: none(), second: none(), awaited: Vec::new() }
            }
            Some(spec) => Tlb {
                page_lines: spec.page_lines,
                last_page: u32::MAX,
                first: Level::new(&spec.first),
                second: Level::new(&spec.second),
                awaited: Vec::new(),
            },
        }
    }

    /// Whether the first TLB has the page of `line` at `now`: not while its translation is under way.
    #[inline]
    pub(crate) fn hit(&mut self, line: u32, now: Cycle) -> bool {
        let page = line / self.page_lines;
        if page == self.last_page {
            return true;
        }
        let done = self.awaited.iter().find(|(awaited, _)| *awaited == page).map_or(0, |(_, done)| *done);
        if done > now {
            return false;
        }
        let hit = self.first.hit(page);
        // Threads that run after this one may come before it, when the translation was under way.
        if hit && now >= done + AWAITED_CYCLES {
            self.last_page = page;
        }
        hit
    }

    /// Cycles that it takes from `now` on to translate the address of `line`, of whose page the first TLB has none; from then on
    /// it has it.
    pub(crate) fn translate(&mut self, line: u32, now: Cycle) -> Cycle {
        let page = line / self.page_lines;
        if let Some(place) = self.awaited.iter().position(|(awaited, _)| *awaited == page) {
            let (_, done) = self.awaited[place];
            if done > now {
                return done - now;
            }
            self.awaited.remove(place);
            if now <= done + AWAITED_CYCLES {
                return 0;
            }
        }
        let mut cycles = self.first.look_up(page);
        if cycles > 0 {
            cycles += self.second.look_up(line / SECOND_LINES);
            self.awaited.retain(|(_, done)| now <= *done + AWAITED_CYCLES);
            self.awaited.push((page, now + cycles));
            self.last_page = u32::MAX;
        }
        cycles
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tlb() -> Tlb {
        let level = |entries, ways, miss_cycles| TlbLevelSpec { sets: entries / ways, ways, miss_cycles };
        Tlb::new(Some(&TlbSpec { page_lines: 64, first: level(64, 4, 29), second: level(64, 4, 100) }))
    }

    #[test]
    fn a_miss_costs_its_cycles_once() {
        let mut tlb = tlb();
        assert!(!tlb.hit(5, 0));
        assert_eq!((tlb.translate(5, 0), tlb.translate(63, 200), tlb.translate(64, 300)), (129, 0, 29));
        assert!(tlb.hit(0, 400) && tlb.hit(127, 400) && !tlb.hit(128, 400));
    }

    #[test]
    fn a_page_is_not_found_while_it_is_being_translated() {
        let mut tlb = tlb();
        assert_eq!(tlb.translate(5, 1000), 129);
        // Whoever comes meanwhile waits for the same translation, in whichever order they ask.
        assert!(tlb.hit(6, 1129) && !tlb.hit(6, 1100) && !tlb.hit(6, 1128));
        assert_eq!(tlb.translate(6, 1100), 29);
        assert!(tlb.hit(6, 1300) && tlb.hit(5, 1301));
    }

    #[test]
    fn four_pages_of_a_set_stay_and_eight_do_not() {
        for (pages, cost) in [(4, 0), (8, 29)] {
            let mut tlb = tlb();
            let (mut last, mut now) = (0, 0);
            for lap in 0..4 {
                for page in 0..pages {
                    now += 1000;
                    last = tlb.translate(page * 16 * 64, now);
                    assert!(lap == 0 || last == cost, "{pages} pages, lap {lap}");
                }
            }
            assert_eq!(last, cost);
        }
    }

    #[test]
    fn an_access_goes_on_after_its_translation_though_its_page_is_gone() {
        let level = |miss_cycles| TlbLevelSpec { sets: 1, ways: 1, miss_cycles };
        let mut tlb = Tlb::new(Some(&TlbSpec { page_lines: 64, first: level(29), second: level(0) }));
        assert_eq!((tlb.translate(0, 100), tlb.translate(64, 110)), (29, 29));
        assert!(!tlb.hit(0, 115));
        assert_eq!((tlb.translate(0, 120), tlb.translate(0, 129), tlb.translate(0, 130)), (9, 0, 29));
    }
}
