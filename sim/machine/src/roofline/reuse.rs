//! How far apart accesses to a line are, counted in other lines: whether a cache of any size would have kept it.

/// Bins of a histogram of distances: two for each power of two, the last for what never came before.
pub(super) const BINS: usize = 2 * 31 + 2;

/// The bin of what came never before.
pub(super) const NEVER: usize = BINS - 1;

/// The bin of a distance of `lines`.
pub(super) fn bin(lines: u64) -> usize {
    let above = lines.saturating_add(1);
    let power = above.ilog2() as usize;
    let is_upper_half = power > 0 && above >> (power - 1) & 1 == 1;
    (2 * power + usize::from(is_upper_half)).min(NEVER - 1)
}

/// The part of what lies in a bin that a cache of `lines` lines would have kept: all, none, or, in the bin where its capacity lies, some.
pub(super) fn kept(bin: usize, lines: f64) -> f64 {
    if bin == NEVER {
        return 0.0;
    }
    let start = |bin: usize| (1_u64 << (bin / 2)) as f64 * if bin % 2 == 1 { 1.5 } else { 1.0 } - 1.0;
    let (least, end) = (start(bin), start(bin + 1));
    ((lines - least) / (end - least)).clamp(0.0, 1.0)
}

/// Distances of the accesses of a few tasks, exact: the number of distinct lines since the last access to the same one [mattson70], by a tree
/// of counts over time [fenwick94].
#[derive(Debug, Default)]
pub(super) struct Distances {
    /// Line and time of its last access, by hash; `EMPTY` where there is none.
    slots: Vec<(u32, u32)>,
    /// Slots that are taken.
    used: usize,
    /// By time, in a tree, whether it is that of the last access of some line. A power of two long, or empty.
    tree: Vec<u32>,
    now: u32,
}

/// No line: above all that a stream has.
const EMPTY: u32 = u32::MAX;

impl Distances {
    /// Forgets all.
    pub(super) fn clear(&mut self) {
        self.slots.fill((EMPTY, 0));
        self.tree.fill(0);
        (self.used, self.now) = (0, 0);
    }

    /// Distinct lines so far.
    pub(super) fn distinct(&self) -> u64 {
        self.used as u64
    }

    /// How many other lines were accessed since `line` was; `None` where it was not.
    pub(super) fn access(&mut self, line: u32) -> Option<u64> {
        if self.used * 2 >= self.slots.len() {
            self.grow_slots();
        }
        if self.now as usize >= self.tree.len() {
            self.renumber();
        }
        let slot = self.slot(line);
        let (known, before) = self.slots[slot];
        let now = self.now;
        self.now += 1;
        self.slots[slot] = (line, now);
        if known == EMPTY {
            self.used += 1;
            self.add(now, 1);
            return None;
        }
        let distance = self.used as u64 - self.count_until(before);
        if distance > 0 {
            self.add(before, 1_u32.wrapping_neg());
            self.add(now, 1);
        } else {
            // The line before was the same: it stays where it is in time.
            self.slots[slot].1 = before;
            self.now = now;
        }
        Some(distance)
    }

    fn slot(&self, line: u32) -> usize {
        let mask = self.slots.len() - 1;
        let mut slot = (line.wrapping_mul(0x9e37_79b1) >> 7) as usize & mask;
        while self.slots[slot].0 != line && self.slots[slot].0 != EMPTY {
            slot = (slot + 1) & mask;
        }
        slot
    }

    fn grow_slots(&mut self) {
        let count = (self.slots.len() * 2).max(1024);
        let before = std::mem::replace(&mut self.slots, vec![(EMPTY, 0); count]);
        for entry in before.into_iter().filter(|entry| entry.0 != EMPTY) {
            let slot = self.slot(entry.0);
            self.slots[slot] = entry;
        }
    }

    /// Gives the last accesses the first times, in their order, and room for as many more at least.
    fn renumber(&mut self) {
        let mut last: Vec<usize> =
            (0..self.slots.len()).filter(|slot| self.slots[*slot].0 != EMPTY).collect();
        last.sort_unstable_by_key(|slot| self.slots[*slot].1);
        self.tree.clear();
        self.tree.resize((2 * last.len()).next_power_of_two().max(1024), 0);
        self.now = last.len() as u32;
        for (time, slot) in last.into_iter().enumerate() {
            self.slots[slot].1 = time as u32;
            self.add(time as u32, 1);
        }
    }

    fn add(&mut self, time: u32, count: u32) {
        let mut at = time as usize + 1;
        while at <= self.tree.len() {
            self.tree[at - 1] = self.tree[at - 1].wrapping_add(count);
            at += at & at.wrapping_neg();
        }
    }

    /// Last accesses up to `time`.
    fn count_until(&self, time: u32) -> u64 {
        let (mut at, mut sum) = (time as usize + 1, 0);
        while at > 0 {
            sum += u64::from(self.tree[at - 1]);
            at &= at - 1;
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::streams::Random;

    #[test]
    fn distances_are_those_of_a_stack_of_lines() {
        let mut distances = Distances::default();
        for seed in 0..4 {
            distances.clear();
            let mut random = Random::new(seed + 1);
            let mut stack: Vec<u32> = Vec::new();
            for _ in 0..6_000 {
                let line = random.below(1 + random.clone().below(4_000)) << seed;
                let at = stack.iter().rposition(|known| *known == line);
                let right = at.map(|at| {
                    stack.remove(at);
                    (stack.len() - at) as u64
                });
                stack.push(line);
                assert_eq!(distances.access(line), right);
                assert_eq!(distances.distinct(), stack.len() as u64);
            }
        }
    }

    #[test]
    fn bins_hold_what_a_cache_keeps() {
        for lines in 0..5_000_u64 {
            let bin = bin(lines);
            assert_eq!(kept(bin, (lines / 4) as f64 - 1.0), 0.0, "{lines}");
            assert_eq!(kept(bin, (2 * lines + 1) as f64), 1.0, "{lines}");
            assert!(bin <= super::bin(lines + 1) && bin < NEVER);
        }
        assert_eq!((bin(u64::MAX), kept(NEVER, 1e18)), (NEVER - 1, 0.0));
        // Over evenly spread distances, the part that is kept is that of the capacity.
        let all: f64 = (0..1024).map(|lines| kept(bin(lines), 300.0)).sum();
        assert!((all - 300.0).abs() < 2.0, "{all}");
    }
}
