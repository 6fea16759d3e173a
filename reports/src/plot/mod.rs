//! Plots, as SVG and PNG with the font inside: readable in print and by color-blind people.
//!
//! Series differ in color (Okabe and Ito's palette), in marker and in dash, so that no reader depends on one of them.

mod bars;
mod canvas;
mod lines;
mod scale;

pub use bars::{Bar, Bars};
pub use lines::{Axis, Lines, Look, Series};

use canvas::{Canvas, SIZE};
use plotters::prelude::*;

use crate::base64;

/// A subset of DejaVu Sans; its license lies beside it.
const FONT: &[u8] = include_bytes!("../../fonts/sans.ttf");

/// What the font is called inside of plots.
const FONT_NAME: &str = "lrbsim sans";

/// Pixels of a PNG for each unit of an SVG: sharp in print.
const PNG_SCALE: u32 = 2;

/// Something that can be drawn.
#[derive(Debug, Clone, PartialEq)]
pub enum Plot {
    /// Lines and points over two axes.
    Lines(Lines),
    /// Horizontal bars.
    Bars(Bars),
}

impl Plot {
    /// The plot as a text that stands alone: the font is inside.
    pub fn svg(&self) -> String {
        let plain = self.svg_without_font();
        let start = plain.find("<svg").expect("plotters begins with its root");
        let end = start + plain[start..].find('>').expect("the root is complete") + 1;
        let font = base64::encode(FONT);
        format!(
            "{}<style>@font-face{{font-family:\"{FONT_NAME}\";src:url(data:font/ttf;base64,{font})}}</style>{}",
            &plain[..end],
            &plain[end..]
        )
    }

    /// The plot as an SVG image for a page that brings the font of its words.
    pub fn svg_without_font(&self) -> String {
        let mut text = String::new();
        self.draw(SVGBackend::with_string(&mut text, SIZE).into_drawing_area(), 1.0);
        text
    }

    /// The plot as pixels.
    pub fn png(&self) -> Vec<u8> {
        let (width, height) = (SIZE.0 * PNG_SCALE, SIZE.1 * PNG_SCALE);
        let mut rgb = vec![0; 3 * width as usize * height as usize];
        let backend = BitMapBackend::with_buffer(&mut rgb, (width, height));
        self.draw(backend.into_drawing_area(), f64::from(PNG_SCALE));
        crate::picture::rgb_png(width, height, &rgb)
    }

    fn draw<B: DrawingBackend>(&self, area: DrawingArea<B, plotters::coord::Shift>, scale: f64) {
        // Asked for again and again: the first wins, and all are the same.
        let _ = plotters::style::register_font(FONT_NAME, FontStyle::Normal, FONT);
        let canvas = Canvas::new(&area, scale);
        match self {
            Plot::Lines(lines) => lines.draw(&canvas),
            Plot::Bars(bars) => bars.draw(&canvas),
        }
        canvas.finish();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plot() -> Plot {
        let series = |name: &str, look, points: &[(f64, f64)]| Series {
            name: name.to_owned(),
            look,
            points: points.to_vec(),
        };
        Plot::Lines(Lines {
            title: "time over cores".to_owned(),
            x: Axis::new("cores", true),
            y: Axis::new("ms", true),
            series: vec![
                series("total", Look::Line, &[(1.0, 90.0), (2.0, 47.0), (64.0, 3.5)]),
                series("ideal", Look::Dashed, &[(1.0, 90.0), (64.0, 90.0 / 64.0)]),
            ],
        })
    }

    #[test]
    fn a_plot_stands_alone() {
        let svg = plot().svg();
        assert!(svg.contains("@font-face") && svg.contains("cores") && svg.contains("total"), "{svg}");
        assert!(!svg.replace("http://www.w3.org/2000/svg", "").contains("http"), "nothing is fetched");
        assert!(!svg.contains("NaN"), "{svg}");
    }

    #[test]
    fn a_fit_has_the_color_of_what_it_fits_and_every_name_its_place() {
        let series = |look, y: f64| Series {
            name: format!("series {y}"),
            look,
            points: vec![(1.0, y), (2.0, y + 1.0)],
        };
        let pair = |i| [series(Look::Dots, f64::from(i)), series(Look::Fit, f64::from(i) + 0.5)];
        let axis = Axis::default();
        let svg = |count: i32| {
            let series = (0..count).flat_map(pair).collect();
            Plot::Lines(Lines { title: String::new(), x: axis.clone(), y: axis.clone(), series })
                .svg_without_font()
        };
        // The second pair is blue, and there is no third color.
        assert!(svg(2).contains("#0072B2") && !svg(2).contains("#D55E00"), "{}", svg(2));
        let many = svg(40);
        let heights = many.split("<text ").skip(1).filter(|text| text.contains("series")).map(|text| {
            let (_, rest) = text.split_once(" y=\"").expect("a place");
            rest.split('"').next().and_then(|y| y.parse::<f64>().ok()).expect("a number")
        });
        assert!(heights.fold(0.0, f64::max) < f64::from(SIZE.1), "a name is below the plot");
    }

    #[test]
    fn pixels_have_ink_and_paper() {
        let picture = image::load_from_memory(&plot().png()).expect("a PNG").to_luma8();
        assert_eq!(picture.dimensions(), (SIZE.0 * PNG_SCALE, SIZE.1 * PNG_SCALE));
        let dark = picture.pixels().filter(|pixel| pixel[0] < 96).count();
        assert!(dark > 1000 && picture.get_pixel(0, 0)[0] == 255, "{dark}");
    }

    #[test]
    fn a_plot_is_the_same_twice() {
        assert_eq!(plot().svg(), plot().svg());
        assert_eq!(plot().png(), plot().png());
    }

    #[test]
    fn nothing_to_draw_is_drawn_too() {
        let empty =
            Lines { title: String::new(), x: Axis::default(), y: Axis::default(), series: Vec::new() };
        assert!(!Plot::Lines(empty).svg().contains("NaN"));
        let point = Series { name: "p".to_owned(), look: Look::Dots, points: vec![(0.0, 0.0)] };
        for log in [false, true] {
            let axis = Axis::new("", log);
            let lines = Lines { title: String::new(), x: axis.clone(), y: axis, series: vec![point.clone()] };
            assert!(!Plot::Lines(lines).svg().contains("NaN"));
        }
        let bars = Bars { title: String::new(), label: String::new(), bars: Vec::new() };
        assert!(!Plot::Bars(bars).svg().contains("NaN"));
    }
}
