//! Which times of a shared resource are taken, page by page, for as long as anybody may ask for them.
//!
//! A page is a stretch of time of fixed length. Those of the near future lie in a small table, tagged by number, where the
//! host finds them at once; a page whose place there is held by another that still lives lies in a sparse map. A page dies
//! when its time lies before the *floor*, the time before which nobody will ask again; until then nothing of it is
//! forgotten, so that no slot is ever given away twice, however long the backlog.

use std::collections::BTreeMap;
use std::fmt::Debug;

/// What is marked on one page.
pub(crate) trait Marks: Copy + PartialEq + Debug {
    /// A page on which everything is free.
    const NONE: Self;
}

impl Marks for u64 {
    const NONE: u64 = 0;
}

/// One page. Marks and number lie side by side: a request touches one line of the host's cache.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(align(16))]
pub(crate) struct Page<M> {
    pub(crate) marks: M,
    pub(crate) number: u64,
}

/// Pages whose place in the near table is taken, by number and by row of the resource.
pub(crate) type Far<M> = BTreeMap<(u64, u32), M>;

/// The near pages of one row of a resource.
#[derive(Debug, Clone, PartialEq, Eq)]
#[repr(align(64))]
pub(crate) struct Near<M, const PAGES: usize>(pub(crate) [Page<M>; PAGES]);

impl<M: Marks, const PAGES: usize> Near<M, PAGES> {
    pub(crate) const EMPTY: Near<M, PAGES> = Near([Page { marks: M::NONE, number: 0 }; PAGES]);

    #[inline(always)]
    pub(crate) fn index(number: u64) -> usize {
        (number % PAGES as u64) as usize
    }

    /// The marks of a page, if they are or can be here without looking anywhere else: the common case. `floor` is the page
    /// before which nobody asks.
    #[inline(always)]
    pub(crate) fn here(&mut self, number: u64, floor: impl FnOnce() -> u64, far: &Far<M>) -> Option<&mut M> {
        let page = &mut self.0[Self::index(number)];
        if page.number != number {
            if page.number >= floor() || !far.is_empty() {
                return None;
            }
            *page = Page { marks: M::NONE, number };
        }
        Some(&mut page.marks)
    }

    /// The marks of any page of row `row`, to be changed.
    pub(crate) fn page<'a>(
        &'a mut self,
        row: u32,
        number: u64,
        floor: u64,
        far: &'a mut Far<M>,
    ) -> &'a mut M {
        let page = &mut self.0[Self::index(number)];
        if page.number != number {
            while let Some(first) = far.first_entry().filter(|first| first.key().0 < floor) {
                first.remove();
            }
            if page.number >= floor && page.marks != M::NONE {
                return far.entry((number, row)).or_insert(M::NONE);
            }
            *page = Page { marks: far.remove(&(number, row)).unwrap_or(M::NONE), number };
        }
        &mut page.marks
    }

    /// The marks of any page of row `row`.
    #[inline]
    pub(crate) fn get(&self, row: u32, number: u64, far: &Far<M>) -> M {
        let page = self.0[Self::index(number)];
        if page.number == number { page.marks } else { far.get(&(number, row)).copied().unwrap_or(M::NONE) }
    }

    /// The near pages from page `first` on.
    pub(crate) fn from(&self, first: u64) -> impl Iterator<Item = Page<M>> {
        self.0.iter().copied().filter(move |page| page.number >= first)
    }
}

/// The far pages from page `first` on, of all rows.
pub(crate) fn far_from<M: Marks>(far: &Far<M>, first: u64) -> impl Iterator<Item = Page<M>> {
    far.range((first, 0)..).map(|(&(number, _), &marks)| Page { marks, number })
}

/// Times at which requests of a kind are known to find no room.
///
/// Only a hint, which spares a long backlog from being searched again by every request: as nothing is ever given back, what
/// found no room once finds none later.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Hints<K> {
    /// By kind and first time: the end. Stretches of a kind do not touch.
    stretches: BTreeMap<(K, u64), u64>,
    /// The last end of all: behind it nothing is known.
    end: u64,
    /// Number of stretches at which those that have passed are thrown away.
    prune_at: usize,
}

impl<K: Ord + Copy> Hints<K> {
    /// Length from which on a search is worth remembering.
    pub(crate) const LONG: u64 = 256;

    pub(crate) const fn new() -> Hints<K> {
        Hints { stretches: BTreeMap::new(), end: 0, prune_at: 16 }
    }

    /// The first time at or after `at` that is not known to be in vain.
    #[inline]
    pub(crate) fn skip(&self, kind: K, at: u64) -> u64 {
        if at >= self.end { at } else { self.skip_known(kind, at) }
    }

    #[inline(never)]
    fn skip_known(&self, kind: K, at: u64) -> u64 {
        let before = self.stretches.range((kind, 0)..=(kind, at)).next_back();
        before.map_or(at, |(_, &end)| end.max(at))
    }

    /// Notes that all times of `[from, to)` are in vain, if that is worth it. Nobody will ask for times before `floor`.
    pub(crate) fn learn(&mut self, kind: K, mut from: u64, mut to: u64, floor: u64) {
        if to - from < Self::LONG {
            return;
        }
        if self.stretches.len() >= self.prune_at {
            self.stretches.retain(|_, end| *end > floor);
            self.prune_at = 16 + 2 * self.stretches.len();
        }
        self.end = self.end.max(to);
        // All that touch become one.
        let before = self.stretches.range_mut((kind, 0)..=(kind, from)).next_back();
        match before.filter(|(_, end)| **end >= from) {
            Some((_, end)) if *end >= to => return,
            Some((key, end)) => (from, *end) = (key.1, to),
            None => _ = self.stretches.insert((kind, from), to),
        }
        while let Some((&key, &end)) = self.stretches.range((kind, from + 1)..=(kind, to)).next() {
            self.stretches.remove(&key);
            to = to.max(end);
            self.stretches.insert((kind, from), to);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::streams::Random;

    #[test]
    fn hints_are_the_union_of_what_was_learned() {
        let (mut hints, mut random, mut model) = (Hints::new(), Random::new(1), vec![false; 200_000]);
        for _ in 0..150 {
            let (from, length) = (random.below(190_000) as usize, 256 + random.below(2000) as usize);
            hints.learn(1, from as u64, (from + length) as u64, 0);
            model[from..from + length].fill(true);
            for _ in 0..50 {
                let at = random.below(195_000) as usize;
                let free = (at..).find(|at| !model[*at]).expect("the end is free");
                assert_eq!((hints.skip(1, at as u64), hints.skip(0, at as u64)), (free as u64, at as u64));
            }
        }
    }
}
