//! What the uncore has to do later, in the order of time: all of it in `cycle`, write-backs in `windowed`.

use super::transaction::{Leg, Transaction};
use crate::Cycle;
use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap, VecDeque};

/// Names a transaction that is under way.
pub(super) type TransactionId = u32;

/// A leg that is due. Legs that are due at one time are done in the order in which they were added.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Due {
    at: Cycle,
    number: u64,
    transaction: TransactionId,
    leg: Leg,
}

/// Transactions on one line.
#[derive(Debug, Default)]
struct OnLine {
    /// Those under way that leave the owner as it is.
    sharing: u32,
    /// Whether one that changes the owner is under way.
    changing: bool,
    waiting: VecDeque<TransactionId>,
}

/// All legs that are due, and the transactions they belong to.
#[derive(Debug, Default)]
pub(super) struct Agenda {
    due: BinaryHeap<Reverse<Due>>,
    added: u64,
    transactions: Vec<Transaction>,
    free: Vec<TransactionId>,
    lines: HashMap<u32, OnLine>,
}

impl Agenda {
    /// Keeps a transaction whose legs are going to be added.
    pub(super) fn keep(&mut self, transaction: Transaction) -> TransactionId {
        match self.free.pop() {
            Some(id) => {
                self.transactions[id as usize] = transaction;
                id
            }
            None => {
                self.transactions.push(transaction);
                (self.transactions.len() - 1) as TransactionId
            }
        }
    }

    /// Adds a leg of a transaction, due at `at`.
    pub(super) fn add(&mut self, transaction: TransactionId, leg: Leg, at: Cycle) {
        self.added += 1;
        self.due.push(Reverse(Due { at, number: self.added, transaction, leg }));
    }

    /// When the next leg is due; [`Cycle::MAX`] when there is none.
    #[inline(always)]
    pub(super) fn next(&self) -> Cycle {
        self.due.peek().map_or(Cycle::MAX, |Reverse(due)| due.at)
    }

    /// The next leg that is due by `now`.
    #[inline(always)]
    pub(super) fn pop(&mut self, now: Cycle) -> Option<(TransactionId, Leg, Cycle)> {
        if self.next() > now { None } else { self.pop_first() }
    }

    #[inline(never)]
    fn pop_first(&mut self) -> Option<(TransactionId, Leg, Cycle)> {
        self.due.pop().map(|Reverse(due)| (due.transaction, due.leg, due.at))
    }

    pub(super) fn transaction(&mut self, id: TransactionId) -> &mut Transaction {
        &mut self.transactions[id as usize]
    }

    /// Forgets a transaction that has no legs left.
    pub(super) fn forget(&mut self, id: TransactionId) {
        self.free.push(id);
    }

    /// Whether transaction `id` may go on with `line`, at its home; if not, it waits its turn. One that changes the owner goes
    /// alone, and none overtakes another.
    pub(super) fn enter(&mut self, id: TransactionId, line: u32, changes_owner: bool) -> bool {
        let on_line = self.lines.entry(line).or_default();
        let busy = on_line.changing || changes_owner && on_line.sharing > 0;
        if busy || !on_line.waiting.is_empty() {
            on_line.waiting.push_back(id);
            return false;
        }
        on_line.admit(changes_owner);
        true
    }

    /// A transaction on `line` is over, which changed the line's owner or did not.
    pub(super) fn leave(&mut self, line: u32, changed_owner: bool) {
        let on_line = self.lines.get_mut(&line).expect("it has entered");
        if changed_owner {
            on_line.changing = false;
        } else {
            on_line.sharing -= 1;
        }
    }

    /// The first transaction that waits for `line`, taken off the queue and admitted, if it may go on; `changes_owner` says
    /// what it is about to do.
    pub(super) fn admit_next(
        &mut self,
        line: u32,
        changes_owner: impl Fn(&Transaction) -> bool,
    ) -> Option<TransactionId> {
        let on_line = self.lines.get_mut(&line)?;
        let Some(id) = on_line.waiting.front().copied() else {
            if on_line.sharing == 0 && !on_line.changing {
                self.lines.remove(&line);
            }
            return None;
        };
        let changes = changes_owner(&self.transactions[id as usize]);
        if on_line.changing || changes && on_line.sharing > 0 {
            return None;
        }
        on_line.waiting.pop_front();
        on_line.admit(changes);
        Some(id)
    }
}

impl OnLine {
    fn admit(&mut self, changes_owner: bool) {
        if changes_owner {
            self.changing = true;
        } else {
            self.sharing += 1;
        }
    }
}
