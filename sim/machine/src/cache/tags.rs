//! A set-associative array of tags with a few bits a line.

const GROUP: usize = 8;
const NO_LINE: u32 = u32::MAX;

/// Up to eight ways of a set, in one line of the host's cache.
#[derive(Debug, Clone)]
#[repr(align(64))]
struct Group {
    tags: [u32; GROUP],
    bits: [u8; GROUP],
    /// Ways of the whole set used since all others were; kept in the set's first group.
    recent: u16,
}

/// Where a line sits: valid until the set changes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Slot {
    group: u32,
    way: u32,
}

/// The array.
///
/// Replacement is bit pseudo-LRU: a touched way is marked recent; when all are, the others are unmarked; the victim is the
/// first way not marked. Knights Corner is pseudo-LRU too [SSDG], of a kind that is not published.
#[derive(Debug, Clone)]
pub(crate) struct Tags {
    groups: Vec<Group>,
    sets: u32,
    ways: u32,
    groups_per_set: u32,
    /// `sets - 1` when the number of sets is a power of two.
    mask: Option<u32>,
}

impl Tags {
    /// Line state in the low two bits: see [`crate::coherence::State`]; the L1 uses [`Tags::WRITABLE`] and
    /// [`Tags::DIRTY`] instead.
    pub(crate) const STATE: u8 = 3;
    /// L1: the core owns the line.
    pub(crate) const WRITABLE: u8 = 1;
    /// L1: the line was written since it came from the L2.
    pub(crate) const DIRTY: u8 = 2;
    /// The line may still be on its way: ask the MSHRs.
    pub(crate) const PENDING: u8 = 4;

    pub(crate) fn new(sets: u32, ways: u32) -> Tags {
        let groups_per_set = ways.div_ceil(GROUP as u32);
        let empty = Group { tags: [NO_LINE; GROUP], bits: [0; GROUP], recent: 0 };
        Tags {
            groups: vec![empty; (sets * groups_per_set) as usize],
            sets,
            ways,
            groups_per_set,
            mask: sets.is_power_of_two().then(|| sets - 1),
        }
    }

    pub(crate) fn absent() -> Tags {
        Tags { groups: Vec::new(), sets: 0, ways: 0, groups_per_set: 0, mask: None }
    }

    pub(crate) fn is_absent(&self) -> bool {
        self.groups.is_empty()
    }

    #[inline(always)]
    fn first_group(&self, line: u32) -> usize {
        let set = match self.mask {
            Some(mask) => line & mask,
            None => line % self.sets,
        };
        (set * self.groups_per_set) as usize
    }

    /// Finds `line`. Changes nothing.
    #[inline(always)]
    pub(crate) fn find(&self, line: u32) -> Option<Slot> {
        if self.is_absent() {
            return None;
        }
        let first = self.first_group(line);
        for group in first..first + self.groups_per_set as usize {
            let tags = &self.groups[group].tags;
            // One bit a way: the compiler makes this a vector compare.
            let mut equal = 0_u32;
            for (way, tag) in tags.iter().enumerate() {
                equal |= u32::from(*tag == line) << way;
            }
            if equal != 0 {
                return Some(Slot { group: group as u32, way: equal.trailing_zeros() });
            }
        }
        None
    }

    /// Marks a slot as used.
    #[inline(always)]
    pub(crate) fn touch(&mut self, slot: Slot) {
        if self.groups_per_set == 1 {
            let group = &mut self.groups[slot.group as usize];
            let recent = group.recent | 1 << slot.way;
            group.recent = if recent == all_ways(self.ways) { 1 << slot.way } else { recent };
        } else {
            let first = slot.group - slot.group % self.groups_per_set;
            let way = (slot.group - first) * GROUP as u32 + slot.way;
            let group = &mut self.groups[first as usize];
            let recent = group.recent | 1 << way;
            group.recent = if recent == all_ways(self.ways) { 1 << way } else { recent };
        }
    }

    /// The bits of a slot.
    #[inline(always)]
    pub(crate) fn bits(&self, slot: Slot) -> u8 {
        self.groups[slot.group as usize].bits[slot.way as usize]
    }

    /// Sets the bits of a slot.
    #[inline(always)]
    pub(crate) fn set_bits(&mut self, slot: Slot, bits: u8) {
        self.groups[slot.group as usize].bits[slot.way as usize] = bits;
    }

    /// Puts `line`, which is not here, in its set and touches it. Returns the victim and its bits.
    pub(crate) fn insert(&mut self, line: u32, bits: u8) -> Option<(u32, u8)> {
        let first = self.first_group(line);
        let mut chosen = None;
        for way in 0..self.ways as usize {
            if self.groups[first + way / GROUP].tags[way % GROUP] == NO_LINE {
                chosen = Some(way);
                break;
            }
        }
        // With one way the only line is always the victim.
        let way =
            chosen.unwrap_or((!self.groups[first].recent).trailing_zeros() as usize % self.ways as usize);
        let slot = Slot { group: (first + way / GROUP) as u32, way: (way % GROUP) as u32 };
        let group = &mut self.groups[slot.group as usize];
        let old = (group.tags[slot.way as usize], group.bits[slot.way as usize]);
        group.tags[slot.way as usize] = line;
        group.bits[slot.way as usize] = bits;
        self.touch(slot);
        (old.0 != NO_LINE).then_some(old)
    }

    /// Empties a slot.
    pub(crate) fn remove(&mut self, slot: Slot) {
        let group = &mut self.groups[slot.group as usize];
        group.tags[slot.way as usize] = NO_LINE;
        group.bits[slot.way as usize] = 0;
    }
}

#[inline(always)]
fn all_ways(ways: u32) -> u16 {
    ((1_u32 << ways) - 1) as u16
}
