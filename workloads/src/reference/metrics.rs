//! How far one visibility picture is from another.

/// Differences between a tested picture and the truth, over sets of receivers that each number names.
///
/// Lit receivers, of which a picture may have any number, would dilute a mean. So receivers are *shadowed* if the truth has
/// them in shadow or penumbra (below 1), and *in question* if the truth or the picture has.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ErrorMetrics {
    /// Sum of |test - truth| over all receivers, divided by the number of shadowed ones; 0 if there are none.
    /// [algorithms, §0; atty06, §5.2.1]
    pub atty_mae: f64,
    /// Mean of |test - truth| over all receivers.
    pub mean: f64,
    /// Root of the mean of (test - truth)² over the receivers in question.
    pub rmse: f64,
    /// Largest |test - truth| of any receiver.
    pub max: f64,
    /// The 99th percentile of |test - truth| over the receivers in question, by nearest rank.
    pub p99: f64,
    /// Receivers that are off by more than 0.25.
    pub off_by_quarter: usize,
    /// Sum of test - truth over all receivers, divided by the number of shadowed ones: above 0, the test is too light.
    pub bias: f64,
    /// What of [`ErrorMetrics::atty_mae`] is of receivers that see nothing of the light, some of it, and all of it, by the truth: they
    /// add up to it.
    pub places: [f64; 3],
    /// Receivers with truth below 1.
    pub shadowed: usize,
    /// Receivers with truth or test below 1.
    pub in_question: usize,
}

impl ErrorMetrics {
    /// Compares two pictures of the same receivers, in the same order. Panics if their sizes differ.
    #[must_use]
    pub fn new(truth: &[f64], test: &[f64]) -> Self {
        assert_eq!(truth.len(), test.len(), "pictures of the same receivers");
        // Sums in receiver order, before sorting: the same bytes on every host.
        let pairs = || truth.iter().zip(test);
        let sum: f64 = pairs().map(|(a, b)| (b - a).abs()).sum();
        let signed: f64 = pairs().map(|(a, b)| b - a).sum();
        let place = |truth: f64| if truth <= 0.0 { 0 } else { 1 + usize::from(truth >= 1.0) };
        let in_place = |at: usize| -> f64 {
            pairs().filter(|(truth, _)| place(**truth) == at).map(|(a, b)| (b - a).abs()).sum()
        };
        let squares: f64 = pairs().map(|(a, b)| (b - a) * (b - a)).sum();
        let shadowed = truth.iter().filter(|&&v| v < 1.0).count();
        // All others are off by 0.
        let mut off: Vec<f64> =
            pairs().filter(|(a, b)| **a < 1.0 || **b < 1.0).map(|(a, b)| (b - a).abs()).collect();
        off.sort_unstable_by(f64::total_cmp);
        let rank = (off.len() * 99).div_ceil(100).saturating_sub(1);
        let over_shadowed = |sum: f64| if shadowed == 0 { 0.0 } else { sum / shadowed as f64 };
        Self {
            atty_mae: over_shadowed(sum),
            mean: sum / truth.len().max(1) as f64,
            rmse: (squares / off.len().max(1) as f64).sqrt(),
            max: off.last().copied().unwrap_or(0.0),
            p99: off.get(rank).copied().unwrap_or(0.0),
            off_by_quarter: off.iter().filter(|&&x| x > 0.25).count(),
            bias: over_shadowed(signed),
            places: [0, 1, 2].map(|at| over_shadowed(in_place(at))),
            shadowed,
            in_question: off.len(),
        }
    }
}
