//! From values to places on an axis, and where the axis is labeled.

use crate::sheet::{round, short};

/// Labels on an axis, about.
const TICKS: f64 = 6.0;

/// Values that are labels themselves, at most.
const VALUES_MAX: usize = 24;

/// Part of an axis that a letter of a label takes where it lies, and that a label takes where it stands.
const LETTER: f64 = 0.015;
const LINE: f64 = 0.05;

/// One axis: linear, or logarithmic when all values are above 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale {
    low: f64,
    high: f64,
    log: bool,
}

impl Scale {
    /// Holds all finite `values`, with some room; a linear axis of values that are not below 0 begins at 0.
    pub fn of(values: impl Iterator<Item = f64> + Clone, log: bool) -> Scale {
        let log = log && values.clone().all(|value| value > 0.0);
        let (low, high) = values
            .filter(|value| value.is_finite())
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
        if low > high {
            return Scale { low: 0.0, high: 1.0, log: false };
        }
        if log {
            let room = (high / low).powf(0.04).max(1.05);
            return Scale { low: low / room, high: high * room, log };
        }
        let room = if high > low { (high - low) * 0.05 } else { high.abs().max(1.0) * 0.5 };
        Scale { low: if low >= 0.0 { 0.0 } else { low - room }, high: high + room, log }
    }

    /// Place of a value: 0 at the low end, 1 at the high end.
    pub fn place(&self, value: f64) -> f64 {
        if self.log {
            (value / self.low).ln() / (self.high / self.low).ln()
        } else {
            (value - self.low) / (self.high - self.low)
        }
    }

    /// Where to label the axis: at the `values` themselves, if these are few and two or more have room, else at round
    /// numbers. Those of `named` have names instead. A label that would run into the one before it is left out.
    pub fn ticks_at(&self, values: impl Iterator<Item = f64>, named: &[(f64, String)]) -> Vec<(f64, String)> {
        let mut values: Vec<f64> = values.filter(|value| value.is_finite()).collect();
        values.sort_by(f64::total_cmp);
        values.dedup();
        let wide = |label: &str| (label.chars().count() + 2) as f64 * LETTER;
        let own = (2..=VALUES_MAX).contains(&values.len()).then(|| {
            let labels = values.into_iter().map(|value| (value, label(value)));
            self.with_room(labels.collect(), named, wide)
        });
        own.filter(|ticks| ticks.len() > 1).unwrap_or_else(|| self.with_room(self.ticks(), named, wide))
    }

    /// Where to label an axis that stands: at round numbers that are not too near to those of `named`, which have names.
    pub fn ticks_beside(&self, named: &[(f64, String)]) -> Vec<(f64, String)> {
        self.with_room(self.ticks(), named, |_| LINE)
    }

    /// The labels that have room beside those before them, where `width` is the part of the axis that one takes; a value of
    /// `named` has its name for a label.
    fn with_room(
        &self,
        ticks: Vec<(f64, String)>,
        named: &[(f64, String)],
        width: impl Fn(&str) -> f64,
    ) -> Vec<(f64, String)> {
        let others = ticks.into_iter().filter(|(value, _)| named.iter().all(|(other, _)| other != value));
        let mut kept: Vec<(f64, String)> = named.to_vec();
        for (value, label) in others {
            let apart = |(other, name): &(f64, String)| {
                (self.place(value) - self.place(*other)).abs() > (width(&label) + width(name)) / 2.0
            };
            if kept.iter().all(apart) {
                kept.push((value, label));
            }
        }
        kept
    }

    /// Where to label the axis, and with what.
    pub fn ticks(&self) -> Vec<(f64, String)> {
        let values = if self.log { self.log_ticks() } else { self.linear_ticks() };
        values.into_iter().map(|value| (value, label(value))).collect()
    }

    fn linear_ticks(&self) -> Vec<f64> {
        let rough = (self.high - self.low) / TICKS;
        let power = 10_f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0].map(|digit| digit * power).into_iter().find(|step| *step >= rough);
        let step = step.unwrap_or(rough);
        let (first, last) = ((self.low / step).ceil() as i64, (self.high / step).floor() as i64);
        // Rounded, as 3 * 0.1 is not 0.3.
        (first..=last).map(|n| (n as f64 * step * 1e12 / power).round() * power / 1e12).collect()
    }

    fn log_ticks(&self) -> Vec<f64> {
        let decades = (self.high / self.low).log10();
        let digits: &[f64] = match decades {
            _ if decades < 0.7 => {
                return self.linear_ticks().into_iter().filter(|tick| *tick > 0.0).collect();
            }
            _ if decades < 2.5 => &[1.0, 2.0, 5.0],
            _ => &[1.0],
        };
        let (first, last) = (self.low.log10().floor() as i32, self.high.log10().ceil() as i32);
        let every = ((last - first) / 8).max(1);
        (first..=last)
            .filter(|power| (power - first) % every == 0)
            .flat_map(|power| digits.iter().map(move |digit| digit * 10_f64.powi(power)))
            .filter(|tick| (self.low..=self.high).contains(tick))
            .collect()
    }
}

/// Four digits of a number, without the zeros at their end.
fn label(value: f64) -> String {
    short(value).parse().map_or_else(|_| short(value), round)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(values: &[f64], log: bool) -> Vec<String> {
        Scale::of(values.iter().copied(), log).ticks().into_iter().map(|(_, label)| label).collect()
    }

    #[test]
    fn ticks_are_round_numbers() {
        assert_eq!(labels(&[0.0, 9.0], false), ["0", "2", "4", "6", "8"]);
        assert_eq!(labels(&[0.1, 0.29], false), ["0", "0.05", "0.1", "0.15", "0.2", "0.25"]);
        assert_eq!(labels(&[1.0, 64.0], true), ["1", "2", "5", "10", "20", "50"]);
        assert_eq!(labels(&[1.0, 1e6], true).len(), 7);
    }

    #[test]
    fn labels_stand_apart_and_named_values_have_their_names() {
        let values = [1e-13, 1e-12, 1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1];
        let scale = Scale::of(values.into_iter(), true);
        let ticks = scale.ticks_at(values.into_iter(), &[(1e-13, "0".to_owned())]);
        let names: Vec<&str> = ticks.iter().map(|(_, name)| name.as_str()).collect();
        assert!(names.starts_with(&["0", "1e-12", "1e-9"]), "{names:?}");
        let few = Scale::of([1.0, 2.0, 64.0].into_iter(), true).ticks_at([1.0, 2.0, 64.0].into_iter(), &[]);
        assert_eq!(few, [(1.0, "1".to_owned()), (2.0, "2".to_owned()), (64.0, "64".to_owned())]);
    }

    #[test]
    fn the_ends_lie_inside() {
        for log in [false, true] {
            let scale = Scale::of([3.0, 50.0].into_iter(), log);
            assert!(
                scale.place(3.0) > 0.0 && scale.place(50.0) < 1.0 && scale.place(20.0) > scale.place(3.0)
            );
        }
    }

    #[test]
    fn a_logarithm_of_nothing_is_not_taken() {
        assert!(!Scale::of([0.0, 1.0].into_iter(), true).log);
    }
}
