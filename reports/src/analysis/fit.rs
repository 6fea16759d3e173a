//! Straight lines through points, and how well they are known.

/// A straight line by least squares.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    /// Value of y where the line crosses x = 0.
    pub intercept: f64,
    /// Slope of the line.
    pub slope: f64,
    /// Half of the 95 % confidence interval of the slope; `None` with two points, which leave no room for doubt.
    pub slope_half_interval: Option<f64>,
}

/// Quantiles of Student's t at 97.5 % for 1 to 30 degrees of freedom.
const STUDENT: [f64; 30] = [
    12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.160, 2.145, 2.131,
    2.120, 2.110, 2.101, 2.093, 2.086, 2.080, 2.074, 2.069, 2.064, 2.060, 2.056, 2.052, 2.048, 2.045, 2.042,
];

/// The line through `points`; `None` when they do not differ in x.
pub fn line(points: &[(f64, f64)]) -> Option<Line> {
    let n = points.len() as f64;
    let mean_x = points.iter().map(|point| point.0).sum::<f64>() / n;
    let mean_y = points.iter().map(|point| point.1).sum::<f64>() / n;
    let spread: f64 = points.iter().map(|point| (point.0 - mean_x).powi(2)).sum();
    if points.len() < 2 || spread <= 0.0 || !spread.is_finite() {
        return None;
    }
    let slope = points.iter().map(|point| (point.0 - mean_x) * (point.1 - mean_y)).sum::<f64>() / spread;
    let intercept = mean_y - slope * mean_x;
    let rest: f64 = points.iter().map(|point| (point.1 - intercept - slope * point.0).powi(2)).sum();
    let freedom = points.len() - 2;
    let slope_half_interval = (freedom > 0).then(|| {
        let quantile = STUDENT.get(freedom - 1).copied().unwrap_or(1.96 + 2.4 / freedom as f64);
        quantile * (rest / freedom as f64 / spread).sqrt()
    });
    Some(Line { intercept, slope, slope_half_interval })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_found_exactly() {
        let line = line(&[(0.0, 1.0), (1.0, 3.0), (2.0, 5.0)]).expect("three points");
        assert_eq!((line.intercept, line.slope, line.slope_half_interval), (1.0, 2.0, Some(0.0)));
    }

    #[test]
    fn the_interval_is_that_of_the_textbook() {
        // Slope 0.9, residuals of sum of squares 1.9 over 3 degrees of freedom, spread 10.
        let line = line(&[(1.0, 1.0), (2.0, 3.0), (3.0, 2.0), (4.0, 4.0), (5.0, 5.0)]).expect("five points");
        assert!((line.slope - 0.9).abs() < 1e-12);
        let expected = 3.182 * (1.9_f64 / 3.0 / 10.0).sqrt();
        assert!((line.slope_half_interval.expect("doubt") - expected).abs() < 1e-9);
    }

    #[test]
    fn points_at_one_place_have_no_line() {
        assert_eq!(line(&[(1.0, 1.0), (1.0, 2.0)]), None);
        assert_eq!(line(&[]), None);
        assert_eq!(line(&[(0.0, 0.0), (1.0, 1.0)]).expect("two points").slope_half_interval, None);
    }
}
