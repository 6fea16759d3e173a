//! How far one visibility picture is from another.

/// Differences between a tested picture and the truth, over all receivers.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ErrorMetrics {
    /// Sum of |test - truth| over all receivers, divided by the number with truth below 1; 0 if there are none.
    /// [algorithms, §0; Atty 2006, §5.2.1]
    pub atty_mae: f64,
    /// Mean of |test - truth| over all receivers.
    pub mean: f64,
    /// Largest |test - truth|.
    pub max: f64,
    /// The 99th percentile of |test - truth|.
    pub p99: f64,
    /// Receivers that are off by more than 0.25.
    pub off_by_quarter: usize,
    /// Mean of test - truth: above 0, the test is too light.
    pub bias: f64,
    /// Receivers with truth below 1.
    pub shadowed: usize,
}

impl ErrorMetrics {
    /// Compares two pictures of the same receivers, in the same order. Panics if their sizes differ.
    #[must_use]
    pub fn new(truth: &[f64], test: &[f64]) -> Self {
        assert_eq!(truth.len(), test.len(), "pictures of the same receivers");
        let mut off: Vec<f64> = truth.iter().zip(test).map(|(a, b)| (b - a).abs()).collect();
        // Sums in receiver order, before sorting: the same bytes on every host.
        let sum: f64 = off.iter().sum();
        let signed: f64 = truth.iter().zip(test).map(|(a, b)| b - a).sum();
        let shadowed = truth.iter().filter(|&&v| v < 1.0).count();
        let count = off.len().max(1) as f64;
        off.sort_unstable_by(f64::total_cmp);
        // Nearest rank.
        let rank = (off.len() * 99).div_ceil(100).saturating_sub(1);
        Self {
            atty_mae: if shadowed == 0 { 0.0 } else { sum / shadowed as f64 },
            mean: sum / count,
            max: off.last().copied().unwrap_or(0.0),
            p99: off.get(rank).copied().unwrap_or(0.0),
            off_by_quarter: off.iter().filter(|&&x| x > 0.25).count(),
            bias: signed / count,
            shadowed,
        }
    }
}
