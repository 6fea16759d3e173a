//! The write buffer of a controller.

use crate::Cycle;
use std::collections::BTreeMap;

/// How many entries are held at each time.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct WriteBuffer {
    lines: u32,
    /// Entries while they are few, in no order; those that have passed may be among them.
    few: Vec<(Cycle, Cycle)>,
    /// All entries once they are more: from each time on, until the next, how many are held. Neighbors differ, so that a long backlog is one stretch.
    held: BTreeMap<Cycle, u32>,
    #[cfg(test)]
    pub(super) fault: Option<crate::laws::Fault>,
}

impl WriteBuffer {
    pub(super) fn new(lines: u32) -> WriteBuffer {
        WriteBuffer {
            lines,
            few: Vec::new(),
            held: BTreeMap::new(),
            #[cfg(test)]
            fault: None,
        }
    }

    /// Whether an entry is free for certain from `from` on, for however long. Nobody asks for times before `floor`.
    #[inline]
    pub(super) fn has_room(&mut self, from: Cycle, floor: Cycle) -> bool {
        #[cfg(test)]
        if self.fault == Some(crate::laws::Fault::UnboundedWriteBuffer) {
            return true;
        }
        if self.few.len() >= self.few_max() {
            self.few.retain(|(_, to)| *to > floor);
        }
        let lines = self.lines as usize;
        self.held.is_empty()
            && (self.few.len() < lines || self.few.iter().filter(|(_, to)| *to > from).count() < lines)
    }

    /// So many entries are looked through faster than they are kept in order.
    fn few_max(&self) -> usize {
        8 * self.lines as usize
    }

    /// When to try again, if an entry cannot be held for all of `[from, to)`.
    pub(super) fn full(&self, from: Cycle, to: Cycle) -> Option<Cycle> {
        #[cfg(test)]
        if self.fault == Some(crate::laws::Fault::UnboundedWriteBuffer) {
            return None;
        }
        if self.held.is_empty() {
            return self.full_of_few(from, to);
        }
        let first = self.held.range(..=from).next_back().map_or(from, |(at, _)| *at);
        let (full, _) = self.held.range(first..to).find(|(_, held)| **held >= self.lines)?;
        // Behind the last entry the buffer is empty, so a full stretch always ends.
        self.held.range(full + 1..).next().map(|(end, _)| *end)
    }

    /// When to try again while the entries are few: perhaps too early, never too late.
    fn full_of_few(&self, from: Cycle, to: Cycle) -> Option<Cycle> {
        let lines = self.lines as usize;
        // Most often it is full from the first.
        let mut ends: Vec<Cycle> = self
            .few
            .iter()
            .filter(|(begin, end)| *begin <= from && *end > from)
            .map(|(_, end)| *end)
            .collect();
        if ends.len() >= lines {
            let place = ends.len() - lines;
            return Some(*ends.select_nth_unstable(place).1);
        }
        if self.few.iter().filter(|(begin, end)| *begin < to && *end > from).count() < lines {
            return None;
        }
        let mut borders = Vec::with_capacity(2 * self.few.len());
        for (begin, end) in self.few.iter().filter(|(begin, end)| *begin < to && *end > from) {
            borders.extend([(*begin.max(&from), true), (*end, false)]);
        }
        // Of equal times, ends first: an entry that is given back is free.
        borders.sort_unstable();
        let (mut held, mut full) = (0, false);
        for (at, begins) in borders {
            held = if begins { held + 1 } else { held - 1 };
            if held >= self.lines {
                full = true;
            } else if full && !begins {
                return Some(at);
            }
        }
        None
    }

    /// Holds an entry for `[from, to)`, which is not empty. Nobody asks for times before `floor`.
    pub(super) fn hold(&mut self, from: Cycle, to: Cycle, floor: Cycle) {
        if self.held.is_empty() && self.few.len() < self.few_max() {
            self.few.push((from, to));
            return;
        }
        self.know_by_time(floor);
        self.hold_by_time(from, to, floor);
    }

    /// Puts the few entries in the order of time, so that it can be told when the buffer is full.
    fn know_by_time(&mut self, floor: Cycle) {
        for (from, to) in std::mem::take(&mut self.few) {
            self.hold_by_time(from, to, floor);
        }
    }

    fn hold_by_time(&mut self, from: Cycle, to: Cycle, floor: Cycle) {
        for border in [from, to] {
            let before = self.held.range(..=border).next_back().map_or(0, |(_, held)| *held);
            self.held.entry(border).or_insert(before);
        }
        for (_, held) in self.held.range_mut(from..to) {
            *held += 1;
        }
        for border in [from, to] {
            let before = self.held.range(..border).next_back().map_or(0, |(_, held)| *held);
            if self.held.get(&border) == Some(&before) {
                self.held.remove(&border);
            }
        }
        // Forget what has passed: the stretch in which the floor lies is the first that counts.
        while self.held.keys().nth(1).is_some_and(|second| *second <= floor) {
            self.held.pop_first();
        }
        if self.held.len() == 1 {
            // Nothing is held any more.
            self.held.clear();
        }
    }
}
