//! Who has a line, exactly, for any number of cores.

/// The cores that hold a line: packed in a word while they are few, a bit set in a pool beyond.
///
/// ```text
/// 0                                       nobody
/// bits 0..3 = count 1..=4                 that many cores, 15 bits each from bit 4
/// bits 0..3 = 5                           bits 4.. are an index into the pool
/// bit 3                                   the one core is the owner (E or M)
/// ```
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Sharers(u64);

const POOLED: u64 = 5;
const INLINE_MAX: u64 = 4;
const OWNED: u64 = 8;
const CORE_BITS: u32 = 15;

/// Bit sets of lines with many sharers.
#[derive(Debug, Default)]
pub(crate) struct Pool {
    sets: Vec<Vec<u64>>,
    free: Vec<usize>,
}

impl Sharers {
    /// Only `core`, in E or M.
    pub(crate) fn owned_by(core: u32) -> Sharers {
        Sharers(1 | OWNED | u64::from(core) << 4)
    }

    /// Makes `core` the owner, and takes everybody else out.
    #[inline]
    pub(crate) fn own(&mut self, core: u32, pool: &mut Pool) {
        self.clear(pool);
        *self = Sharers::owned_by(core);
    }

    pub(crate) fn owner(self) -> Option<u32> {
        (self.0 & OWNED != 0).then(|| self.inline_core(0))
    }

    fn count_code(self) -> u64 {
        self.0 & 7
    }

    fn inline_core(self, i: u32) -> u32 {
        (self.0 >> (4 + CORE_BITS * i)) as u32 & ((1 << CORE_BITS) - 1)
    }

    fn pool_index(self) -> usize {
        (self.0 >> 4) as usize
    }

    /// The cores, while they are few.
    #[inline(always)]
    pub(crate) fn few(self) -> Option<impl Iterator<Item = u32>> {
        (self.count_code() != POOLED).then(|| (0..self.count_code() as u32).map(move |i| self.inline_core(i)))
    }

    /// Adds `core` in S; the owner, if there is one, becomes a sharer.
    pub(crate) fn add(&mut self, core: u32, pool: &mut Pool) {
        if self.contains(core, pool) {
            self.0 &= !OWNED;
            return;
        }
        self.0 &= !OWNED;
        let count = self.count_code();
        if count < INLINE_MAX {
            self.0 = ((self.0 & !7) + count + 1) | u64::from(core) << (4 + CORE_BITS * count as u32);
        } else if count == INLINE_MAX {
            let index = pool.free.pop().unwrap_or_else(|| {
                pool.sets.push(Vec::new());
                pool.sets.len() - 1
            });
            let set = &mut pool.sets[index];
            for i in 0..INLINE_MAX as u32 {
                insert(set, self.inline_core(i));
            }
            insert(set, core);
            self.0 = POOLED | (index as u64) << 4;
        } else {
            insert(&mut pool.sets[self.pool_index()], core);
        }
    }

    /// Takes `core` out.
    #[inline]
    pub(crate) fn remove(&mut self, core: u32, pool: &mut Pool) {
        if self.count_code() == 1 {
            // The most frequent case. Another core may own the line by now: its notice comes late.
            if self.inline_core(0) == core {
                self.0 = 0;
            }
            return;
        }
        let mut rest = Sharers::default();
        if self.count_code() == POOLED {
            let set = &mut pool.sets[self.pool_index()];
            if let Some(word) = set.get_mut(core as usize / 64) {
                *word &= !(1 << (core % 64));
            }
            if set.iter().map(|word| u64::from(word.count_ones())).sum::<u64>() > INLINE_MAX {
                return;
            }
        }
        self.for_each(pool, |other| {
            if other != core {
                rest.0 = ((rest.0 & !7) + rest.count_code() + 1)
                    | u64::from(other) << (4 + CORE_BITS * rest.count_code() as u32);
            }
        });
        self.clear(pool);
        *self = rest;
    }

    /// Takes everybody out.
    pub(crate) fn clear(&mut self, pool: &mut Pool) {
        if self.count_code() == POOLED {
            pool.sets[self.pool_index()].fill(0);
            pool.free.push(self.pool_index());
        }
        self.0 = 0;
    }

    pub(crate) fn contains(self, core: u32, pool: &Pool) -> bool {
        if self.count_code() == POOLED {
            let word = pool.sets[self.pool_index()].get(core as usize / 64).copied().unwrap_or(0);
            return word >> (core % 64) & 1 == 1;
        }
        (0..self.count_code() as u32).any(|i| self.inline_core(i) == core)
    }

    /// Whether a core other than `me` is among them.
    #[inline(always)]
    pub(crate) fn has_other(self, me: u32) -> bool {
        match self.count_code() {
            0 => false,
            1 => self.inline_core(0) != me,
            _ => true,
        }
    }

    /// The core other than `me` whose number is nearest, hence on most machines the nearest on the ring.
    pub(crate) fn nearest(self, me: u32, pool: &Pool) -> Option<u32> {
        if let Some(few) = self.few() {
            return few.filter(|core| *core != me).min_by_key(|core| (core.abs_diff(me), *core));
        }
        // The first bit above `me` and the first below, a word at a time.
        let set = &pool.sets[self.pool_index()];
        let (word, bit) = (me as usize / 64, me % 64);
        let above = (word..set.len()).find_map(|i| {
            let bits = if i == word { set[i] & (u64::MAX << bit) & !(1 << bit) } else { set[i] };
            (bits != 0).then(|| i as u32 * 64 + bits.trailing_zeros())
        });
        let below = (0..set.len().min(word + 1)).rev().find_map(|i| {
            let bits = if i == word { set[i] & !(u64::MAX << bit) } else { set[i] };
            (bits != 0).then(|| i as u32 * 64 + 63 - bits.leading_zeros())
        });
        [below, above].into_iter().flatten().min_by_key(|core| core.abs_diff(me))
    }

    /// Calls `f` with every core: in order of arrival while they are few, in index order beyond.
    pub(crate) fn for_each(self, pool: &Pool, mut f: impl FnMut(u32)) {
        if let Some(few) = self.few() {
            few.for_each(f);
            return;
        }
        for (i, word) in pool.sets[self.pool_index()].iter().enumerate() {
            let mut word = *word;
            while word != 0 {
                f(i as u32 * 64 + word.trailing_zeros());
                word &= word - 1;
            }
        }
    }
}

fn insert(set: &mut Vec<u64>, core: u32) {
    let word = core as usize / 64;
    if set.len() <= word {
        set.resize(word + 1, 0);
    }
    set[word] |= 1 << (core % 64);
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn sharers_agree_with_a_plain_set_under_random_traffic() {
        let (mut pool, mut sharers, mut model) = (Pool::default(), Sharers::default(), BTreeSet::new());
        let mut random = 7_u64;
        for round in 0..20_000 {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(11);
            let core = (random >> 40) as u32 % 1024 % (3 + round % 97);
            if random >> 63 == 0 {
                sharers.add(core, &mut pool);
                model.insert(core);
            } else {
                // Whether it is among them or not: a notice may come late.
                sharers.remove(core, &mut pool);
                model.remove(&core);
            }
            let mut seen = BTreeSet::new();
            sharers.for_each(&pool, |core| assert!(seen.insert(core), "core {core} twice"));
            assert_eq!(seen, model);
            assert_eq!(sharers.has_other(core), model.iter().any(|other| *other != core));
            let nearest =
                model.iter().filter(|other| **other != core).min_by_key(|other| other.abs_diff(core));
            assert_eq!(sharers.nearest(core, &pool), nearest.copied());
        }
    }

    #[test]
    fn an_owner_that_is_joined_becomes_a_sharer() {
        let mut pool = Pool::default();
        let mut sharers = Sharers::owned_by(1023);
        assert_eq!(sharers.owner(), Some(1023));
        sharers.add(5, &mut pool);
        assert_eq!((sharers.owner(), sharers.contains(1023, &pool)), (None, true));
    }

    #[test]
    fn the_late_notice_of_a_core_that_has_lost_the_line_leaves_its_owner() {
        let mut sharers = Sharers::owned_by(3);
        sharers.remove(2, &mut Pool::default());
        assert_eq!(sharers.owner(), Some(3));
    }
}
