//! What is measured of a method on the scenes of a quality.

use lrbsim_reports::table3::Quality;
use lrbsim_workloads::{EyeView, Scene};

use super::scenes::in_penumbra;

/// One picture that is asked for, and what is true of it.
#[derive(Clone)]
pub struct View {
    /// The scene, with the lamp in its place.
    pub scene: Scene,
    /// The receivers: those that are judged, and four more at the corners of the floor.
    pub eye: EyeView,
    /// Visibility of those that are judged.
    pub truth: Vec<f64>,
}

/// One case of a quality: a scene, or one that moves.
pub struct Case {
    /// The quality that the case is of.
    pub quality: Quality,
    /// Name of the case among those of its quality.
    pub id: String,
    /// The pictures: one, or one for each step of a motion.
    pub views: Vec<View>,
    /// For each receiver that is judged, whether it counts in the figure.
    asked: Vec<bool>,
}

impl Case {
    pub(super) fn new(quality: Quality, id: &str, asked: Vec<bool>, views: Vec<View>) -> Case {
        assert!(asked.contains(&true), "{id}: nothing is measured");
        Case { quality, id: id.to_owned(), views, asked }
    }

    /// What the pictures `drawn` of the case's views come out as, see [`Quality::measured`]: visibilities of the receivers that are
    /// judged.
    ///
    /// # Panics
    /// If there is not one picture for each view.
    pub fn figure(&self, drawn: &[Vec<f64>]) -> f64 {
        assert_eq!(drawn.len(), self.views.len(), "{}", self.id);
        let asked = |values: &[f64]| -> Vec<f64> {
            values.iter().zip(&self.asked).filter(|(_, asked)| **asked).map(|(value, _)| *value).collect()
        };
        let (ours, truth) = (asked(&drawn[0]), asked(&self.views[0].truth));
        let shades = |values: &[f64]| values.iter().map(|visible| visible.min(1.0 - visible)).sum::<f64>();
        match self.quality {
            Quality::InnerPenumbra | Quality::OuterPenumbra => shades(&ours) / shades(&truth),
            Quality::AccurateOverlap => mean(ours.iter().zip(&truth).map(|(a, b)| (a - b).abs())),
            Quality::NoAliasing => self.flicker(drawn),
            Quality::NoLightLeaks => ours.into_iter().fold(0.0, f64::max),
            Quality::AllFrequencies => deviation(&ours) / deviation(&truth),
        }
    }

    /// Root mean square of what changes in a step, over receivers that are in the penumbra before it and after it, of what is
    /// drawn beyond a [`Profile`]: a penumbra of another shape is wrong, and neither saws nor flickers.
    fn flicker(&self, drawn: &[Vec<f64>]) -> f64 {
        let pairs = self.views.iter().zip(drawn).flat_map(|(view, drawn)| view.truth.iter().zip(drawn));
        let profile = Profile::new(pairs.map(|(x, y)| (*x, *y)).filter(|(x, _)| in_penumbra(*x)).collect());
        let mut changes = Vec::new();
        for (views, drawn) in self.views.windows(2).zip(drawn.windows(2)) {
            let [before, after] = [&views[0].truth, &views[1].truth];
            for i in (0..before.len()).filter(|i| in_penumbra(before[*i]) && in_penumbra(after[*i])) {
                let beyond = |truth: f64, drawn: f64| drawn - profile.at(truth);
                changes.push(beyond(after[i], drawn[1][i]) - beyond(before[i], drawn[0][i]));
            }
        }
        mean(changes.iter().map(|change| change * change)).sqrt()
    }
}

/// What a method draws of a straight edge, as a smooth function of what is true: at each place a line that fits what is drawn
/// where the truth is little else.
struct Profile {
    /// Places, in ascending order.
    places: Vec<f64>,
    /// Sums over the places before each: 1, x, y, x x, x y.
    sums: Vec<[f64; 5]>,
}

impl Profile {
    /// How far a line is fitted to each side: 2 levels of 64, 4 in all, so that neither they nor noise are part of the profile. Nor is a
    /// step, which is what makes a border without width aliased.
    const REACH: f64 = 1.0 / 32.0;

    fn new(mut pairs: Vec<(f64, f64)>) -> Profile {
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let mut sum = [0.0; 5];
        let mut sums = vec![sum];
        for (x, y) in &pairs {
            for (sum, term) in sum.iter_mut().zip([1.0, *x, *y, x * x, x * y]) {
                *sum += term;
            }
            sums.push(sum);
        }
        Profile { places: pairs.iter().map(|pair| pair.0).collect(), sums }
    }

    fn at(&self, x: f64) -> f64 {
        let before = |limit: f64| self.sums[self.places.partition_point(|place| *place < limit)];
        let (low, high) = (before(x - Self::REACH), before(x + Self::REACH));
        let [count, sum_x, sum_y, sum_xx, sum_xy]: [f64; 5] = core::array::from_fn(|i| high[i] - low[i]);
        let (middle_x, middle_y) = (sum_x / count, sum_y / count);
        let (spread, together) = (sum_xx / count - middle_x * middle_x, sum_xy / count - middle_x * middle_y);
        // Of one place alone there is no slope.
        let slope = if spread > 1e-9 { together / spread } else { 0.0 };
        middle_y + slope * (x - middle_x)
    }
}

fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len() as f64;
    values.sum::<f64>() / count
}

fn deviation(values: &[f64]) -> f64 {
    let middle = mean(values.iter().copied());
    mean(values.iter().map(|value| (value - middle).powi(2))).sqrt()
}
