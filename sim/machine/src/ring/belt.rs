//! The slots of one direction of one ring.
//!
//! Seen from the ring, slots travel past the places on it, one a tick (cycle); seen from a slot, time passes. So a message
//! that boards at a tick takes *one* slot for as many ticks as its ride lasts, and all its links are a run of bits in that slot's row of ticks: one or two
//! words of the host, however far it goes.

const WORDS: usize = 16;
/// Ticks searched for a free slot before a message goes regardless: far past any backlog that finite MSHRs can build.
const SEARCH_MAX: u64 = 512;

/// Rows of ticks, one a slot.
#[derive(Debug)]
pub(super) struct Belt {
    places: u32,
    rows: Vec<Row>,
}

#[derive(Debug, Clone)]
struct Row {
    words: [u64; WORDS],
    /// Which stretch of 64 ticks a word stands for; older ones are forgotten.
    stretches: [u32; WORDS],
}

impl Row {
    /// Whether ticks `[first, first + count)` are free.
    #[inline]
    fn is_free(&self, first: u64, count: u32) -> bool {
        spans(first, count).all(|(stretch, bits)| {
            let word = stretch as usize % WORDS;
            self.stretches[word] != stretch || self.words[word] & bits == 0
        })
    }

    #[inline]
    fn take(&mut self, first: u64, count: u32) {
        for (stretch, bits) in spans(first, count) {
            let word = stretch as usize % WORDS;
            if self.stretches[word] < stretch {
                self.stretches[word] = stretch;
                self.words[word] = 0;
            }
            if self.stretches[word] == stretch {
                self.words[word] |= bits;
            }
        }
    }
}

/// Cuts a run of ticks at the borders of words.
#[inline]
fn spans(first: u64, count: u32) -> impl Iterator<Item = (u32, u64)> {
    let mut at = first;
    let end = first + u64::from(count);
    std::iter::from_fn(move || {
        if at >= end {
            return None;
        }
        let take = (64 - at % 64).min(end - at);
        let span = ((at / 64) as u32, (u64::MAX >> (64 - take)) << (at % 64));
        at += take;
        Some(span)
    })
}

impl Belt {
    pub(super) fn new(places: u32) -> Belt {
        Belt { places, rows: vec![Row { words: [0; WORDS], stretches: [0; WORDS] }; places as usize] }
    }

    /// Boards a message of `ride` ticks at place `from`, at `tick` or as soon after as a slot passes that is free all the way.
    /// Returns the tick.
    pub(super) fn board(&mut self, from: u32, ride: u32, direction: usize, tick: u64) -> u64 {
        let places = u64::from(self.places);
        // The slot now at `from`: slots move up in direction 0, down in direction 1.
        let phase = tick % places;
        let from = u64::from(from);
        let mut slot =
            if direction == 0 { (from + places - phase) % places } else { (from + phase) % places };
        for wait in 0..SEARCH_MAX {
            let row = &mut self.rows[slot as usize];
            if row.is_free(tick + wait, ride) {
                row.take(tick + wait, ride);
                return tick + wait;
            }
            slot = match direction {
                0 if slot == 0 => places - 1,
                0 => slot - 1,
                _ if slot + 1 == places => 0,
                _ => slot + 1,
            };
        }
        tick + SEARCH_MAX
    }
}
