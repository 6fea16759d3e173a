//! The data TLBs of a core: a first one for the page size in use, a second one whose entries cover 2 MB each.

use super::Tags;
use crate::Cycle;
use crate::config::{TlbLevelSpec, TlbSpec};

/// Lines that an entry of the second TLB covers.
const SECOND_LINES: u32 = (2 << 20) / 64;

/// Both TLBs.
#[derive(Debug, Clone)]
pub(crate) struct Tlb {
    page_lines: u32,
    /// The page of the last translation: most accesses go there again.
    last_page: u32,
    first: Level,
    second: Level,
}

#[derive(Debug, Clone)]
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
        self.entries.insert(self.entries.place_for(page), page, 0);
        self.miss_cycles
    }
}

impl Tlb {
    /// `None`: translates nothing, and must not be asked.
    pub(crate) fn new(spec: Option<&TlbSpec>) -> Tlb {
        let none = || Level { entries: Tags::absent(), miss_cycles: 0 };
        match spec {
            None => Tlb { page_lines: 1, last_page: u32::MAX, first: none(), second: none() },
            Some(spec) => Tlb {
                page_lines: spec.page_lines,
                last_page: u32::MAX,
                first: Level::new(&spec.first),
                second: Level::new(&spec.second),
            },
        }
    }

    /// Whether the first TLB has the page of `line`.
    #[inline]
    pub(crate) fn hit(&mut self, line: u32) -> bool {
        let page = line / self.page_lines;
        if page == self.last_page {
            return true;
        }
        let hit = self.first.hit(page);
        if hit {
            self.last_page = page;
        }
        hit
    }

    /// Cycles that it takes to translate the address of `line`; from then on the first TLB has it.
    pub(crate) fn translate(&mut self, line: u32) -> Cycle {
        let page = line / self.page_lines;
        let mut cycles = self.first.look_up(page);
        if cycles > 0 {
            cycles += self.second.look_up(line / SECOND_LINES);
        }
        self.last_page = page;
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
        assert!(!tlb.hit(5));
        assert_eq!((tlb.translate(5), tlb.translate(63), tlb.translate(64)), (129, 0, 29));
        assert!(tlb.hit(0) && tlb.hit(127) && !tlb.hit(128));
    }

    #[test]
    fn four_pages_of_a_set_stay_and_eight_do_not() {
        for (pages, cost) in [(4, 0), (8, 29)] {
            let mut tlb = tlb();
            let mut last = 0;
            for lap in 0..4 {
                for page in 0..pages {
                    last = tlb.translate(page * 16 * 64);
                    assert!(lap == 0 || last == cost, "{pages} pages, lap {lap}");
                }
            }
            assert_eq!(last, cost);
        }
    }
}
