//! The pixels of a picture that have receivers.

/// Pixels of receivers by the number of the receiver, `y * width + x`, ascending. Where every pixel of a picture has a receiver, as in a room,
/// nothing is stored.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Pixels {
    count: u32,
    /// The pixels; empty where receiver `i` is that of pixel `i`.
    listed: Vec<u32>,
}

impl Pixels {
    /// The pixels of `listed`.
    ///
    /// # Panics
    /// If there are more than 2^32 - 1.
    #[must_use]
    pub fn new(listed: &[u32]) -> Pixels {
        let count = u32::try_from(listed.len()).expect("a pixel's number has 32 bits");
        let are_all = (0..count).zip(listed).all(|(number, pixel)| number == *pixel);
        Pixels { count, listed: if are_all { Vec::new() } else { listed.to_vec() } }
    }

    /// How many there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.count as usize
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// The pixel of receiver `receiver`.
    ///
    /// # Panics
    /// If there is no such receiver.
    #[must_use]
    pub fn at(&self, receiver: usize) -> u32 {
        assert!(receiver < self.len(), "receiver {receiver} of {}", self.len());
        self.listed.get(receiver).copied().unwrap_or(receiver as u32)
    }

    /// All pixels, in the order of their receivers.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = u32> + '_ {
        (0..self.len()).map(|receiver| self.at(receiver))
    }

    /// Forgets all.
    pub fn clear(&mut self) {
        *self = Pixels::default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_are_told_as_they_were_listed() {
        for listed in [&[][..], &[0], &[0, 1, 2], &[1, 2], &[0, 1, 3], &[0, 2, 1]] {
            let pixels = Pixels::new(listed);
            assert_eq!(pixels.iter().collect::<Vec<u32>>(), listed);
            assert_eq!((pixels.len(), pixels.is_empty()), (listed.len(), listed.is_empty()));
            assert!((0..listed.len()).all(|receiver| pixels.at(receiver) == listed[receiver]));
        }
        assert!(Pixels::new(&[0, 1, 2]).listed.is_empty(), "they need no list");
    }
}
