//! Ink on paper: the few shapes that plots are made of, in units of the SVG.

use plotters::coord::Shift;
use plotters::element::DashedPathElement;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::FONT_NAME;

/// Width and height of a plot.
pub const SIZE: (u32, u32) = (900, 520);

/// Size of the letters.
const LETTERS: f64 = 15.0;

/// Okabe and Ito's colors, the darkest first, and a gray; yellow is left out: it vanishes on paper.
const PALETTE: [RGBColor; 8] = [
    RGBColor(0, 0, 0),
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(230, 159, 0),
    RGBColor(120, 120, 120),
];

/// Lines that help the eye.
pub const GRID: RGBColor = RGBColor(221, 221, 221);
/// Color of axes and words.
pub const INK: RGBColor = RGBColor(34, 34, 34);

/// The color of the `index`-th series.
pub fn color(index: usize) -> RGBColor {
    PALETTE[index % PALETTE.len()]
}

/// Where words stand beside their place.
#[derive(Debug, Clone, Copy)]
pub enum Anchor {
    Left,
    Middle,
    Right,
}

/// A drawing area in units of the SVG, whatever its pixels.
pub struct Canvas<'a, B: DrawingBackend> {
    area: &'a DrawingArea<B, Shift>,
    scale: f64,
}

impl<'a, B: DrawingBackend> Canvas<'a, B> {
    pub fn new(area: &'a DrawingArea<B, Shift>, scale: f64) -> Canvas<'a, B> {
        done(area.fill(&WHITE));
        Canvas { area, scale }
    }

    pub fn finish(&self) {
        done(self.area.present());
    }

    /// A line through points, dashed if asked for.
    pub fn line(&self, points: &[(f64, f64)], color: RGBColor, width: f64, dashed: bool) {
        let style = color.stroke_width((width * self.scale).round() as u32);
        let points: Vec<(i32, i32)> = points.iter().map(|point| self.pixel(*point)).collect();
        if dashed {
            let dash = (7.0 * self.scale) as i32;
            done(self.area.draw(&DashedPathElement::new(points, dash, dash, style)));
        } else {
            done(self.area.draw(&PathElement::new(points, style)));
        }
    }

    /// A filled rectangle between two corners.
    pub fn bar(&self, from: (f64, f64), to: (f64, f64), color: RGBColor) {
        done(self.area.draw(&Rectangle::new([self.pixel(from), self.pixel(to)], color.filled())));
    }

    /// The marker of the `index`-th series.
    pub fn marker(&self, at: (f64, f64), index: usize) {
        let (color, size) = (color(index).filled(), (4.5 * self.scale).round() as i32);
        let (x, y) = self.pixel(at);
        match index % 4 {
            0 => done(self.area.draw(&Circle::new((x, y), size, color))),
            1 => done(self.area.draw(&Rectangle::new([(x - size, y - size), (x + size, y + size)], color))),
            2 => done(self.area.draw(&TriangleMarker::new((x, y), size + size / 3, color))),
            _ => {
                let corners = vec![
                    (x, y - size * 4 / 3),
                    (x + size * 4 / 3, y),
                    (x, y + size * 4 / 3),
                    (x - size * 4 / 3, y),
                ];
                done(self.area.draw(&Polygon::new(corners, color)));
            }
        }
    }

    /// Words, centered on the height of their place.
    pub fn words(&self, text: &str, at: (f64, f64), anchor: Anchor, size: f64) {
        let horizontal = match anchor {
            Anchor::Left => HPos::Left,
            Anchor::Middle => HPos::Center,
            Anchor::Right => HPos::Right,
        };
        let font = (FONT_NAME, LETTERS * size * self.scale);
        let style = font.into_font().color(&INK).pos(Pos::new(horizontal, VPos::Center));
        done(self.area.draw(&Text::new(text.to_owned(), self.pixel(at), style)));
    }

    fn pixel(&self, (x, y): (f64, f64)) -> (i32, i32) {
        ((x * self.scale).round() as i32, (y * self.scale).round() as i32)
    }
}

/// A plot is drawn into memory, with a font that is inside the program.
fn done<T, E: std::error::Error + Send + Sync>(result: Result<T, DrawingAreaErrorKind<E>>) {
    if let Err(error) = result {
        panic!("a plot could not be drawn into memory: {error}");
    }
}
