//! Exact division by a number that never changes, without the host's slow instruction for it.

/// A divisor, and its reciprocal in 1/2^64.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Divisor {
    divisor: u64,
    reciprocal: u64,
}

impl Divisor {
    /// # Panics
    /// When `divisor` is 0.
    pub(crate) const fn new(divisor: u64) -> Divisor {
        Divisor { divisor, reciprocal: u64::MAX / divisor }
    }

    pub(crate) const fn get(self) -> u64 {
        self.divisor
    }

    /// Quotient and remainder.
    #[inline(always)]
    pub(crate) const fn div_rem(self, number: u64) -> (u64, u64) {
        // The reciprocal is rounded down by at most one: the quotient is right or one too small.
        let quotient = ((number as u128 * self.reciprocal as u128) >> 64) as u64;
        let rest = number - quotient * self.divisor;
        if rest >= self.divisor { (quotient + 1, rest - self.divisor) } else { (quotient, rest) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_quotient_is_that_of_the_host() {
        let mut random = 5_u64;
        let mut next = || {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            random ^ random >> 29
        };
        for divisor in (1..300).chain([1 << 32, (1 << 32) + 1, u64::MAX / 2, u64::MAX - 1, u64::MAX]) {
            let by = Divisor::new(divisor);
            let edges = [0, 1, divisor - 1, divisor, divisor.saturating_add(1), u64::MAX - 1, u64::MAX];
            let multiples = (1..50).flat_map(|i| [divisor.saturating_mul(i), divisor.saturating_mul(i) - 1]);
            for number in edges.into_iter().chain(multiples).chain((0..500).map(|i| next() >> (i % 64))) {
                assert_eq!(by.div_rem(number), (number / divisor, number % divisor), "{number} / {divisor}");
            }
        }
    }
}
