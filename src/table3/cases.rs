//! What is measured of a method on the scenes of a quality.

use lrbsim_reports::table3::Quality;
use lrbsim_workloads::{EyeView, Scene};

use super::scenes::SLIGHT;

/// One picture that is asked for, and what is true of it.
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
    /// Which receivers are asked.
    asked: Vec<bool>,
}

impl Case {
    pub(super) fn new(quality: Quality, id: &str, asked: Vec<bool>, views: Vec<View>) -> Case {
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
        let dark = |values: &[f64]| values.iter().map(|visible| 1.0 - visible).sum::<f64>();
        match self.quality {
            Quality::InnerPenumbra => ours.iter().sum::<f64>() / truth.iter().sum::<f64>(),
            Quality::OuterPenumbra => dark(&ours) / dark(&truth),
            Quality::AccurateOverlap => mean(ours.iter().zip(&truth).map(|(a, b)| (a - b).abs())),
            Quality::NoAliasing => self.flicker(drawn),
            Quality::NoLightLeaks => ours.into_iter().fold(0.0, f64::max),
            Quality::AllFrequencies => deviation(&ours) / deviation(&truth),
        }
    }

    /// Root mean square of what the error changes by in a step, over receivers that are in the penumbra before it or after it.
    fn flicker(&self, drawn: &[Vec<f64>]) -> f64 {
        let mut changes = Vec::new();
        for (views, drawn) in self.views.windows(2).zip(drawn.windows(2)) {
            let [before, after] = [&views[0].truth, &views[1].truth];
            for i in 0..before.len() {
                let in_penumbra = |visible: f64| (SLIGHT..=1.0 - SLIGHT).contains(&visible);
                if in_penumbra(before[i]) || in_penumbra(after[i]) {
                    changes.push((drawn[1][i] - after[i]) - (drawn[0][i] - before[i]));
                }
            }
        }
        mean(changes.iter().map(|change| change * change)).sqrt()
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
