//! Which slots of a shared resource are taken.
//!
//! A resource that serves one request in so many cycles is a row of slots of that length. A request takes the first free
//! slot at or after its time. Requests may come out of time order, as they do when cores are simulated in turn: an early
//! request that is asked for late finds the gap that later ones left. In time order this is exactly a queue.
//!
//! Whoever asks also names the *floor*, a time before which nobody will ever ask again and which never goes back. What lies
//! before it is forgotten, and nothing else: a slot is given once. So over any stretch a resource serves at most its peak.

use crate::Cycle;
use crate::division::Divisor;
use crate::pages::{Far, Hints, Near, Page, far_from};

/// Slots of one resource.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Slots {
    /// By stretch of 64 slots, a bit a slot.
    near: Near<u64, 32>,
    /// Length of a slot in 1/256 cycles.
    interval_x256: Divisor,
    far: Far<u64>,
    full: Hints<()>,
    #[cfg(test)]
    pub(crate) fault: Option<crate::laws::Fault>,
}

impl Slots {
    /// # Panics
    /// When `interval_x256` is 0: no machine that was validated has such a resource.
    pub(crate) fn new(interval_x256: u64) -> Slots {
        Slots {
            near: Near::EMPTY,
            interval_x256: Divisor::new(interval_x256),
            far: Far::new(),
            full: Hints::new(),
            #[cfg(test)]
            fault: None,
        }
    }

    /// Takes the first free slot at or after `now`; returns when it begins, but not before `now`.
    #[inline(always)]
    pub(crate) fn take(&mut self, now: Cycle, floor: Cycle) -> Cycle {
        debug_assert!(floor <= now, "asked for {now}, which lies before the floor, {floor}");
        let by = self.interval_x256;
        let wanted = by.div_rem(now << 8).0;
        let slot = match self.near.here(wanted / 64, || by.div_rem(floor << 8).0 / 64, &self.far) {
            Some(taken) if !*taken & (u64::MAX << (wanted % 64)) != 0 => {
                let bit = (!*taken & (u64::MAX << (wanted % 64))).trailing_zeros();
                *taken |= 1 << bit;
                wanted / 64 * 64 + u64::from(bit)
            }
            _ => self.wait(wanted, floor),
        };
        now.max(self.begin(slot))
    }

    /// Takes the first free slot at or after slot `wanted`, whose stretch is full or not at hand.
    #[inline(never)]
    fn wait(&mut self, wanted: u64, floor: Cycle) -> u64 {
        let floor = self.interval_x256.div_rem(floor << 8).0;
        let slot = self.free_from(wanted);
        *self.near.page(0, slot / 64, floor / 64, &mut self.far) |= 1 << (slot % 64);
        self.full.learn((), wanted, slot, floor);
        #[cfg(test)]
        if self.fault == Some(crate::laws::Fault::SlotsForget) {
            self.far.clear();
            self.full = Hints::new();
        }
        slot
    }

    /// The first free slot at or after slot `wanted`.
    fn free_from(&self, wanted: u64) -> u64 {
        let mut slot = self.full.skip((), wanted);
        loop {
            let free = !self.near.get(0, slot / 64, &self.far) & (u64::MAX << (slot % 64));
            if free != 0 {
                return slot / 64 * 64 + u64::from(free.trailing_zeros());
            }
            slot = (slot / 64 + 1) * 64;
        }
    }

    /// When a slot begins. Rounded up: no slot begins before the one before it has ended.
    #[inline(always)]
    fn begin(&self, slot: u64) -> Cycle {
        (slot * self.interval_x256.get()).div_ceil(256)
    }

    /// Slots taken that begin at or after `from`, which is not before the floor. A request that came in the middle of a slot
    /// was served then, but its slot counts from its beginning.
    pub(crate) fn taken_from(&self, from: Cycle) -> u64 {
        let first = match from {
            0 => 0,
            from => self.interval_x256.div_rem((from - 1) << 8).0 + 1,
        };
        let pages = self.near.from(first / 64).chain(far_from(&self.far, first / 64));
        pages.map(|page| taken_from(page, first)).sum()
    }

    /// Most requests that can be served in `cycles` cycles in a row: one more than the slots that are as long, since a slot
    /// may be served late, up to its end.
    pub(crate) fn peak(&self, cycles: Cycle) -> u64 {
        (cycles << 8).div_ceil(self.interval_x256.get()) + 1
    }
}

/// Bits of a page that are taken, from bit `first` of the row on.
fn taken_from(page: Page<u64>, first: u64) -> u64 {
    let before = first.saturating_sub(page.number * 64);
    if before >= 64 { 0 } else { (page.marks >> before).count_ones().into() }
}

/// When each row of a resource is taken, a bit a tick, for runs of ticks of any length.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Ticks<const PAGES: usize> {
    rows: Vec<Near<u64, PAGES>>,
    far: Far<u64>,
}

impl<const PAGES: usize> Ticks<PAGES> {
    pub(crate) fn new(rows: u32) -> Ticks<PAGES> {
        Ticks { rows: vec![Near::EMPTY; rows as usize], far: Far::new() }
    }

    /// Takes ticks `[first, first + count)` of `row`, at least one, if all are free. Nobody asks for ticks before `floor`.
    #[inline(always)]
    pub(crate) fn take(&mut self, row: u32, first: u64, count: u32, floor: u64) -> bool {
        let (number, shift) = (first / 64, (first % 64) as u32);
        let pages = &mut self.rows[row as usize].0;
        let [index, next] = [number, number + 1].map(Near::<u64, PAGES>::index);
        let nothing_far = self.far.is_empty();
        // What is taken of a page, if that is known here.
        let taken_in = |page: Page<u64>, number| match page.number == number {
            true => Some(page.marks),
            false => (page.number < floor / 64 && nothing_far).then_some(0),
        };
        let known = (taken_in(pages[index], number), taken_in(pages[next], number + 1));
        let (Some(taken), Some(taken_next)) = known else { return self.take_runs(row, first, count, floor) };
        if count > 64 {
            return self.take_runs(row, first, count, floor);
        }
        // The common case: the ticks lie in two pages at most.
        let bits = u64::MAX >> (64 - count);
        let (low, high) = (bits << shift, bits >> 1 >> (63 - shift));
        let free = taken & low | taken_next & high == 0;
        if free {
            pages[index] = Page { marks: taken | low, number };
            if high != 0 {
                pages[next] = Page { marks: taken_next | high, number: number + 1 };
            }
        }
        free
    }

    /// Takes `count` ticks of `row` from `first` on, wherever they lie; false, and nothing taken, where one is taken already.
    #[inline(never)]
    fn take_runs(&mut self, row: u32, first: u64, count: u32, floor: u64) -> bool {
        let free = self.last_taken(row, first, count).is_none();
        if free {
            for (number, bits) in runs(first, count) {
                *self.rows[row as usize].page(row, number, floor / 64, &mut self.far) |= bits;
            }
        }
        free
    }

    /// The last tick of `row` that is taken of the `count` from `first` on.
    pub(crate) fn last_taken(&self, row: u32, first: u64, count: u32) -> Option<u64> {
        let taken_in = |(number, bits): (u64, u64)| {
            let taken = self.rows[row as usize].get(row, number, &self.far) & bits;
            (taken != 0).then(|| number * 64 + 63 - u64::from(taken.leading_zeros()))
        };
        runs(first, count).filter_map(taken_in).last()
    }

    /// Ticks taken from tick `first` on, of all rows.
    pub(crate) fn taken_from(&self, first: u64) -> u64 {
        let near = self.rows.iter().flat_map(|row| row.from(first / 64));
        near.chain(far_from(&self.far, first / 64)).map(|page| taken_from(page, first)).sum()
    }
}

/// Cuts a run of ticks at the borders of words.
#[inline]
fn runs(first: u64, count: u32) -> impl Iterator<Item = (u64, u64)> {
    let mut at = first;
    let end = first + u64::from(count);
    std::iter::from_fn(move || {
        if at >= end {
            return None;
        }
        let take = (64 - at % 64).min(end - at);
        let run = (at / 64, (u64::MAX >> (64 - take)) << (at % 64));
        at += take;
        Some(run)
    })
}

#[cfg(test)]
mod tests;
