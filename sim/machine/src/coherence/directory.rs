//! The directory: one record for each line that was ever asked for.

use super::sharers::{Pool, Sharers};
use crate::Cycle;
use lrbsim_isa::arena::STACK_BASE_LINE;

const PAGE_LINES: usize = 512;

/// What the home knows of a line.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Record {
    pub(crate) sharers: Sharers,
    /// When the last change of ownership is over: a transaction waits for it.
    pub(crate) read_after: Cycle,
    /// When the last transaction is over: one that changes ownership waits for it.
    pub(crate) write_after: Cycle,
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
    #[inline]
    pub(crate) fn record(&mut self, line: u32) -> (&mut Record, &mut Pool) {
        let (pages, index) = if line >= STACK_BASE_LINE {
            (&mut self.stacks, (line - STACK_BASE_LINE) as usize)
        } else {
            (&mut self.arena, line as usize)
        };
        let page = index / PAGE_LINES;
        if pages.len() <= page {
            pages.resize_with(page + 1, || None);
        }
        let page = pages[page].get_or_insert_with(|| Box::new([Record::default(); PAGE_LINES]));
        (&mut page[index % PAGE_LINES], &mut self.pool)
    }
}
