//! Horizontal bars from a common start: what each change does.

use plotters::prelude::DrawingBackend;

use super::canvas::{Anchor, Canvas, GRID, INK, SIZE, color};
use super::scale::Scale;
use crate::sheet::short;

/// Left, top, right, bottom of the bars; their names stand to the left.
const FRAME: (f64, f64, f64, f64) = (330.0, 60.0, 850.0, 460.0);

/// Characters of a name that fit there.
const NAME_MAX: usize = 46;

/// Bars at most: more cannot be read.
const BARS_MAX: usize = 30;

/// Horizontal bars from 0.
#[derive(Debug, Clone, PartialEq)]
pub struct Bars {
    /// What the plot shows.
    pub title: String,
    /// What the bars measure, and its unit.
    pub label: String,
    /// The bars, from top to bottom.
    pub bars: Vec<Bar>,
}

/// One bar: from the least to the greatest change that one thing makes.
#[derive(Debug, Clone, PartialEq)]
pub struct Bar {
    /// The thing that was changed.
    pub name: String,
    /// Value at one end of the bar.
    pub from: f64,
    /// Value at the other end of the bar.
    pub to: f64,
}

impl Bars {
    pub(super) fn draw<B: DrawingBackend>(&self, canvas: &Canvas<'_, B>) {
        let (left, top, right, bottom) = FRAME;
        let bars = &self.bars[..self.bars.len().min(BARS_MAX)];
        // Some room for the numbers beside the bars.
        let ends = bars.iter().flat_map(|bar| [bar.from, bar.to]).map(|end| end * 1.15).chain([0.0]);
        let scale = Scale::of(ends, false);
        let place = |value: f64| left + scale.place(value) * (right - left);

        canvas.words(&self.title, (20.0, 22.0), Anchor::Left, 1.15);
        for (value, label) in scale.ticks() {
            canvas.line(&[(place(value), top), (place(value), bottom)], GRID, 1.0, false);
            canvas.words(&label, (place(value), bottom + 16.0), Anchor::Middle, 0.9);
        }
        let foot = f64::from(SIZE.1) - 18.0;
        canvas.words(&self.label, (right, foot), Anchor::Right, 1.0);
        if bars.len() < self.bars.len() {
            let shown = format!("the first {} of {}", bars.len(), self.bars.len());
            canvas.words(&shown, (20.0, foot), Anchor::Left, 0.9);
        }

        let height = (bottom - top) / bars.len().max(4) as f64;
        for (row, bar) in bars.iter().enumerate() {
            let middle = top + (row as f64 + 0.5) * height;
            canvas.words(&shortened(&bar.name), (left - 10.0, middle), Anchor::Right, 0.9);
            // Below and above the start are told apart by color and by side.
            for (end, index) in [(bar.from.min(bar.to), 1), (bar.from.max(bar.to), 2)] {
                let half = (height * 0.32).min(14.0);
                canvas.bar((place(0.0), middle - half), (place(end), middle + half), color(index));
            }
            let widest = if bar.from.abs() > bar.to.abs() { bar.from } else { bar.to };
            let (beside, anchor) = if widest < 0.0 { (-6.0, Anchor::Right) } else { (6.0, Anchor::Left) };
            canvas.words(&short(widest), (place(widest) + beside, middle), anchor, 0.8);
        }
        canvas.line(&[(place(0.0), top), (place(0.0), bottom)], INK, 1.5, false);
    }
}

/// A name that fits beside its bar: both of its ends tell names apart, what lies between them less.
fn shortened(name: &str) -> String {
    let count = name.chars().count();
    if count <= NAME_MAX {
        return name.to_owned();
    }
    let head = (NAME_MAX - 1) / 2;
    let tail = NAME_MAX - 1 - head;
    name.chars().take(head).chain(['\u{2026}']).chain(name.chars().skip(count - tail)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_names_keep_both_ends() {
        assert_eq!(shortened("palm: grid, ms"), "palm: grid, ms");
        let name = shortened("saloon, sism:form=printed,overlap=sum: paper's total, ms");
        assert_eq!(name, "saloon, sism:form=prin\u{2026}=sum: paper's total, ms");
        assert_eq!(name.chars().count(), NAME_MAX);
    }
}
