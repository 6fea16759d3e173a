//! The directory: one record for each line that was ever asked for.

use super::sharers::{Pool, Sharers};
use crate::Cycle;
use lrbsim_isa::arena::STACK_BASE_LINE;
use lrbsim_isa::host::prefetch;

/// 64 KiB of the host.
const PAGE_LINES: usize = 4096;

/// What the home knows of a line: a quarter of a line of the host's cache, since most records are far from it.
#[derive(Debug, Clone, Copy, Default)]
#[repr(align(16))]
pub(crate) struct Record {
    pub(crate) sharers: Sharers,
    pub(crate) busy: Busy,
}

/// Until when a line is busy, in one word of the host: when the last transaction is over, and how long before that the last
/// change of ownership was.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Busy(u64);

impl Busy {
    /// Bits of the second part. It is full after 4 million cycles, longer than a transaction can last: later requests
    /// wait for neither.
    const EARLIER_BITS: u32 = 22;
    const EARLIER_MAX: u64 = (1 << Busy::EARLIER_BITS) - 1;

    /// When the last change of ownership is over: every transaction waits for it.
    #[inline(always)]
    pub(crate) fn read_after(self) -> Cycle {
        self.write_after() - (self.0 & Busy::EARLIER_MAX)
    }

    /// When the last transaction is over: one that changes ownership waits for it.
    #[inline(always)]
    pub(crate) fn write_after(self) -> Cycle {
        self.0 >> Busy::EARLIER_BITS
    }

    /// Busy until `done` too, for a transaction that changes ownership or does not.
    #[inline(always)]
    pub(crate) fn extended(self, done: Cycle, changes_owner: bool) -> Busy {
        let write_after = self.write_after().max(done);
        let read_after = self.read_after().max(if changes_owner { done } else { 0 });
        let earlier = (write_after - read_after).min(Busy::EARLIER_MAX).min(write_after);
        Busy(write_after << Busy::EARLIER_BITS | earlier)
    }
}

type Page = Option<Box<[Record; PAGE_LINES]>>;

/// Records in pages, since line numbers are dense: storage follows the lines touched. One table serves all slices.
#[derive(Debug, Default)]
pub(crate) struct Directory {
    arena: Vec<Page>,
    stacks: Vec<Page>,
    pub(crate) pool: Pool,
}

impl Directory {
    /// The record of `line`, and the pool that its sharers may lie in.
    #[inline(always)]
    pub(crate) fn record(&mut self, line: u32) -> (&mut Record, &mut Pool) {
        let (pages, index) = if line >= STACK_BASE_LINE {
            (&mut self.stacks, (line - STACK_BASE_LINE) as usize)
        } else {
            (&mut self.arena, line as usize)
        };
        if pages.get(index / PAGE_LINES).is_none_or(Option::is_none) {
            add_page(pages, index / PAGE_LINES);
        }
        let Some(Some(page)) = pages.get_mut(index / PAGE_LINES) else { unreachable!("added") };
        (&mut page[index % PAGE_LINES], &mut self.pool)
    }

    /// What is known of `line` as things stand: its sharers may lie in the pool.
    #[inline(always)]
    pub(crate) fn known(&self, line: u32) -> Record {
        let (pages, index) = self.place(line);
        match pages.get(index / PAGE_LINES) {
            Some(Some(page)) => page[index % PAGE_LINES],
            _ => Record::default(),
        }
    }

    #[inline(always)]
    fn place(&self, line: u32) -> (&Vec<Page>, usize) {
        if line >= STACK_BASE_LINE {
            (&self.stacks, (line - STACK_BASE_LINE) as usize)
        } else {
            (&self.arena, line as usize)
        }
    }

    /// Asks the host for the record of `line`, ahead of its use.
    #[inline(always)]
    pub(crate) fn prefetch(&self, line: u32) {
        let (pages, index) = self.place(line);
        if let Some(Some(page)) = pages.get(index / PAGE_LINES) {
            prefetch(&page[index % PAGE_LINES]);
        }
    }
}

#[cold]
fn add_page(pages: &mut Vec<Page>, index: usize) {
    if pages.len() <= index {
        pages.resize_with(index + 1, || None);
    }
    let page = vec![Record::default(); PAGE_LINES].into_boxed_slice();
    pages[index] = Some(page.try_into().expect("as long as a page"));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::streams::Random;

    #[test]
    fn busy_times_are_the_latest_of_all_and_of_all_changes_of_ownership() {
        let (mut busy, mut read_after, mut write_after) = (Busy::default(), 0, 0);
        let mut random = Random::new(3);
        let mut now = 0;
        for _ in 0..100_000 {
            now += u64::from(random.below(2000));
            let done = now + u64::from(random.below(5000));
            let changes_owner = random.below(3) == 0;
            busy = busy.extended(done, changes_owner);
            write_after = done.max(write_after);
            read_after = if changes_owner { done.max(read_after) } else { read_after };
            assert_eq!((busy.read_after(), busy.write_after()), (read_after, write_after));
        }
    }

    #[test]
    fn an_old_change_of_ownership_is_over() {
        let busy = Busy::default().extended(10, true).extended(1 << 40, false);
        assert!((10..(1 << 40) - 4_000_000).contains(&busy.read_after()));
    }
}
