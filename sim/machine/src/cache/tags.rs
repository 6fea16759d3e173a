//! A set-associative array of tags with a few bits a line.

/// Tags that are searched at once.
pub(super) const GROUP: usize = 8;
/// No line has this number.
pub(super) const NO_LINE: u32 = u32::MAX;

/// Up to eight ways of a set, in one line of the host's cache.
#[derive(Debug, Clone, PartialEq, Eq)]
#[repr(align(64))]
struct Group {
    tags: [u32; GROUP],
    bits: [u8; GROUP],
    /// Ways that hold a line.
    held: u8,
    /// Ways that a fill is on its way to: their lines are no victims.
    reserved: u8,
    /// Ways of the whole set used since all others were; kept in the set's first group.
    recent: u16,
}

impl Group {
    /// The first way that holds `line`.
    #[inline(always)]
    fn first_way_with(&self, line: u32) -> Option<u32> {
        let equal = equal_ways(&self.tags, line);
        (equal != 0).then(|| equal.trailing_zeros())
    }
}

/// A bit for every tag that is `line`.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
pub(super) fn equal_ways(tags: &[u32; GROUP], line: u32) -> u32 {
    use core::arch::x86_64::{
        _mm_cmpeq_epi32, _mm_movemask_epi8, _mm_packs_epi16, _mm_packs_epi32, _mm_set1_epi32, _mm_setr_epi32,
    };
    // The most frequent search of all: a third of what the compiler makes of the plain loop.
    let [a, b, c, d, e, f, g, h] = tags.map(u32::cast_signed);
    #[expect(unsafe_code, reason = "host SIMD on values, no memory")]
    // SAFETY: every x86-64 host has SSE2.
    unsafe {
        let line = _mm_set1_epi32(line.cast_signed());
        let low = _mm_cmpeq_epi32(_mm_setr_epi32(a, b, c, d), line);
        let high = _mm_cmpeq_epi32(_mm_setr_epi32(e, f, g, h), line);
        let halves = _mm_packs_epi32(low, high);
        let bytes = _mm_packs_epi16(halves, halves);
        (_mm_movemask_epi8(bytes) & 0xff).cast_unsigned()
    }
}

/// A bit for every tag that is `line`.
#[cfg(not(target_arch = "x86_64"))]
#[inline(always)]
pub(super) fn equal_ways(tags: &[u32; GROUP], line: u32) -> u32 {
    tags.iter().zip(0..).map(|(tag, way)| u32::from(*tag == line) << way).sum()
}

/// Where a line sits: valid until the set changes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Slot {
    group: u32,
    way: u32,
}

impl Slot {
    /// Some slot.
    pub(crate) const FIRST: Slot = Slot { group: 0, way: 0 };
}

/// The array.
///
/// Replacement is bit pseudo-LRU: a touched way is marked recent; when all are, the others are unmarked; the victim is the
/// first way not marked. Knights Corner is pseudo-LRU too [SSDG], of a kind that is not published.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Tags {
    groups: Vec<Group>,
    sets: u32,
    ways: u32,
    /// A bit for every way.
    all_ways: u16,
    groups_per_set: u32,
    /// `sets - 1` when the number of sets is a power of two, else 0.
    mask: u32,
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
        let empty = Group { tags: [NO_LINE; GROUP], bits: [0; GROUP], held: 0, reserved: 0, recent: 0 };
        Tags {
            groups: vec![empty; (sets * groups_per_set) as usize],
            sets,
            ways,
            all_ways: ((1_u32 << ways) - 1) as u16,
            groups_per_set,
            mask: if sets.is_power_of_two() { sets - 1 } else { 0 },
        }
    }

    pub(crate) fn absent() -> Tags {
        Tags { groups: Vec::new(), sets: 1, ways: 0, all_ways: 0, groups_per_set: 0, mask: 0 }
    }

    #[inline(always)]
    fn first_group(&self, line: u32) -> usize {
        let set = if self.mask != 0 { line & self.mask } else { line % self.sets };
        (set * self.groups_per_set) as usize
    }

    /// Finds `line`. Changes nothing.
    #[inline(always)]
    pub(crate) fn find(&self, line: u32) -> Option<Slot> {
        let first = self.first_group(line);
        // A core that has not run has no groups.
        if let Some(way) = self.groups.get(first)?.first_way_with(line) {
            return Some(Slot { group: first as u32, way });
        }
        if self.groups_per_set > 1 {
            let way = self.groups[first + 1].first_way_with(line)?;
            return Some(Slot { group: first as u32 + 1, way });
        }
        None
    }

    /// Uses `line` if it is here and its bits are `wanted` as far as `mask` goes: touches it and adds `bits`. Otherwise
    /// changes nothing and returns where it is, if it is here.
    #[inline(always)]
    pub(crate) fn use_if(&mut self, line: u32, mask: u8, wanted: u8, bits: u8) -> Result<(), Option<Slot>> {
        let Some(slot) = self.find(line) else { return Err(None) };
        let old = self.bits(slot);
        if old & mask != wanted {
            return Err(Some(slot));
        }
        self.set_bits(slot, old | bits);
        self.touch(slot);
        Ok(())
    }

    /// Asks the host for the set of `line`.
    #[inline(always)]
    pub(crate) fn prefetch(&self, line: u32) {
        if let Some(group) = self.groups.get(self.first_group(line)) {
            lrbsim_isa::host::prefetch(group);
        }
    }

    /// Marks a slot as used.
    #[inline(always)]
    pub(crate) fn touch(&mut self, slot: Slot) {
        if self.groups_per_set == 1 {
            let group = &mut self.groups[slot.group as usize];
            let recent = group.recent | 1 << slot.way;
            group.recent = if recent == self.all_ways { 1 << slot.way } else { recent };
        } else {
            let first = slot.group - slot.group % self.groups_per_set;
            let way = (slot.group - first) * GROUP as u32 + slot.way;
            let group = &mut self.groups[first as usize];
            let recent = group.recent | 1 << way;
            group.recent = if recent == self.all_ways { 1 << way } else { recent };
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

    /// Where `line`, which is not here, goes: the first empty way, or the first not marked; `None` when fills are on their way
    /// to all ways of its set.
    #[inline(always)]
    pub(crate) fn place_for(&self, line: u32) -> Option<Slot> {
        let first = self.first_group(line);
        let mut held = u32::from(self.groups[first].held);
        let mut reserved = u32::from(self.groups[first].reserved);
        if self.groups_per_set > 1 {
            held |= u32::from(self.groups[first + 1].held) << GROUP;
            reserved |= u32::from(self.groups[first + 1].reserved) << GROUP;
        }
        let all = u32::from(self.all_ways);
        let empty = !held & all;
        let unmarked = !(u32::from(self.groups[first].recent) | reserved) & all;
        let unreserved = !reserved & all;
        let candidates = if empty != 0 {
            empty
        } else if unmarked != 0 {
            unmarked
        } else {
            unreserved
        };
        let way = candidates.trailing_zeros();
        (candidates != 0).then(|| Slot { group: first as u32 + way / GROUP as u32, way: way % GROUP as u32 })
    }

    /// Keeps the line in `slot` from being a victim until [`Tags::release`].
    #[inline(always)]
    pub(crate) fn reserve(&mut self, slot: Slot) {
        self.groups[slot.group as usize].reserved |= 1 << slot.way;
    }

    /// Lets the line in `slot` be a victim again.
    #[inline(always)]
    pub(crate) fn release(&mut self, slot: Slot) {
        self.groups[slot.group as usize].reserved &= !(1 << slot.way);
    }

    /// Whether a fill is on its way to `slot`.
    #[inline(always)]
    pub(crate) fn is_reserved(&self, slot: Slot) -> bool {
        self.groups[slot.group as usize].reserved >> slot.way & 1 == 1
    }

    /// The line at `slot`.
    #[inline(always)]
    pub(crate) fn line_at(&self, slot: Slot) -> Option<u32> {
        let group = &self.groups[slot.group as usize];
        (group.held >> slot.way & 1 == 1).then(|| group.tags[slot.way as usize])
    }

    /// Puts `line`, which is not here, at `place`, which [`Tags::place_for`] gave, and touches it. Returns the victim and
    /// its bits.
    #[inline(always)]
    pub(crate) fn insert(&mut self, place: Slot, line: u32, bits: u8) -> Option<(u32, u8)> {
        let victim = self.line_at(place);
        let group = &mut self.groups[place.group as usize];
        let way = place.way as usize;
        let old = victim.map(|victim| (victim, group.bits[way]));
        group.tags[way] = line;
        group.bits[way] = bits;
        group.held |= 1 << way;
        self.touch(place);
        old
    }

    /// Empties a slot.
    pub(crate) fn remove(&mut self, slot: Slot) {
        let group = &mut self.groups[slot.group as usize];
        group.tags[slot.way as usize] = NO_LINE;
        group.bits[slot.way as usize] = 0;
        group.held &= !(1 << slot.way);
    }
}
