//! Lines and points over two axes.

use plotters::prelude::DrawingBackend;

use super::canvas::{Anchor, Canvas, GRID, INK, SIZE, color};
use super::scale::Scale;

/// Left, top, right, bottom of the paper between the axes; names of the series stand to the right of it.
const FRAME: (f64, f64, f64, f64) = (70.0, 72.0, 660.0, 460.0);

/// Room for the name of each series, which many series share out.
const NAME_ROOM: f64 = 22.0;

/// Letters of a name at most.
const NAME_MAX: usize = 27;

/// Lines and points over two axes.
#[derive(Debug, Clone, PartialEq)]
pub struct Lines {
    /// What the plot shows.
    pub title: String,
    /// The axis that runs to the right.
    pub x: Axis,
    /// The axis that runs upwards.
    pub y: Axis,
    /// The lines and clouds of points, in the order of their colors.
    pub series: Vec<Series>,
}

/// An axis of a plot.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Axis {
    /// What the axis measures, and its unit.
    pub label: String,
    /// Logarithmic, if all values allow it.
    pub log: bool,
    /// Values that are labeled with these names, instead of numbers: such as the place of 0 on a logarithmic axis.
    pub named: Vec<(f64, String)>,
}

impl Axis {
    /// An axis of what `label` says, whose values are labeled with numbers.
    pub fn new(label: impl Into<String>, log: bool) -> Axis {
        Axis { label: label.into(), log, named: Vec::new() }
    }
}

/// One line or cloud of points.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Name of the series, as the legend has it.
    pub name: String,
    /// How the series is drawn.
    pub look: Look,
    /// Points of the series, x and y of each.
    pub points: Vec<(f64, f64)>,
}

/// How a series is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Look {
    /// Points that a line joins.
    Line,
    /// A dashed line without points: a reference.
    Dashed,
    /// A dashed line without points, in the color of the series before it: what fits that.
    Fit,
    /// The series is drawn as points alone.
    Dots,
}

impl Lines {
    pub(super) fn draw<B: DrawingBackend>(&self, canvas: &Canvas<'_, B>) {
        let (left, top, right, bottom) = FRAME;
        let all = self.series.iter().flat_map(|series| &series.points);
        let x = Scale::of(all.clone().map(|point| point.0), self.x.log);
        let y = Scale::of(all.map(|point| point.1), self.y.log);
        let place = |(px, py): (f64, f64)| {
            (left + x.place(px) * (right - left), bottom - y.place(py) * (bottom - top))
        };

        // Axes.
        canvas.words(&self.title, (left, 22.0), Anchor::Left, 1.15);
        let values = self.series.iter().flat_map(|series| &series.points).map(|point| point.0);
        for (value, label) in x.ticks_at(values, &self.x.named) {
            let at = left + x.place(value) * (right - left);
            canvas.line(&[(at, top), (at, bottom)], GRID, 1.0, false);
            canvas.words(&label, (at, bottom + 16.0), Anchor::Middle, 0.9);
        }
        for (value, label) in y.ticks_beside(&self.y.named) {
            let at = bottom - y.place(value) * (bottom - top);
            canvas.line(&[(left, at), (right, at)], GRID, 1.0, false);
            canvas.words(&label, (left - 8.0, at), Anchor::Right, 0.9);
        }
        canvas.line(&[(left, top), (left, bottom), (right, bottom)], INK, 1.0, false);
        canvas.words(&self.x.label, (right, f64::from(SIZE.1) - 18.0), Anchor::Right, 1.0);
        canvas.words(&self.y.label, (left - 50.0, top - 18.0), Anchor::Left, 1.0);

        // Series, and their names in the same order.
        let room = (f64::from(SIZE.1) - top - 16.0) / self.series.len().max(1) as f64;
        let mut index = 0;
        for (row, series) in self.series.iter().enumerate() {
            if row > 0 && series.look != Look::Fit {
                index += 1;
            }
            let points: Vec<(f64, f64)> = series.points.iter().map(|point| place(*point)).collect();
            let name = (right + 22.0, top + 8.0 + row as f64 * room.min(NAME_ROOM));
            let sample = [name, (name.0 + 26.0, name.1)];
            if series.look != Look::Dots {
                let dashed = matches!(series.look, Look::Dashed | Look::Fit);
                canvas.line(&points, color(index), 2.0, dashed);
                canvas.line(&sample, color(index), 2.0, dashed);
            }
            if matches!(series.look, Look::Line | Look::Dots) {
                points.iter().for_each(|point| canvas.marker(*point, index));
                canvas.marker((name.0 + 13.0, name.1), index);
            }
            canvas.words(&clipped(&series.name), (name.0 + 34.0, name.1), Anchor::Left, 0.85);
        }
    }
}

/// A name that fits beside the plot: its end tells more names apart than its start.
pub(super) fn clipped(name: &str) -> String {
    if name.chars().count() <= NAME_MAX {
        return name.to_owned();
    }
    let skipped = name.chars().count() - (NAME_MAX - 1);
    ['…'].into_iter().chain(name.chars().skip(skipped)).collect()
}
