//! From axes to points.

use lrbsim_reports::study::{Draw, Sampling, StudyAxis, StudyFile};
use serde_json::Value;

use super::recipe::Recipe;
use crate::error::BadInput;

/// A value for each axis, in their order.
pub type Point = Vec<Value>;

/// How many points a study has before any is left out.
pub fn count(file: &StudyFile) -> u64 {
    let lengths = file.axes.iter().map(|axis| axis.values.len() as u64);
    match file.sampling {
        Sampling::Grid => lengths.fold(1, u64::saturating_mul),
        Sampling::List => lengths.max().unwrap_or(0),
        Sampling::OneAtATime => 1 + lengths.sum::<u64>(),
        Sampling::Random { points, .. } => u64::from(points),
    }
}

/// Values of an axis to try: all of them, or the ends of its range, as whole numbers if it is drawn `whole`.
pub fn examples(axis: &StudyAxis, whole: bool) -> Vec<Value> {
    if !axis.values.is_empty() {
        return axis.values.clone();
    }
    let (min, max) = (axis.min.unwrap_or(0.0), axis.max.unwrap_or(0.0));
    let ends = if whole { [min.ceil(), max.floor()] } else { [min, max] };
    ends.into_iter().map(|end| number(end, whole)).collect()
}

/// Whether the range of an axis that is drawn whole has nothing to draw.
pub fn holds_no_whole(axis: &StudyAxis) -> bool {
    let Some((min, max)) = axis.min.zip(axis.max) else { return false };
    match axis.draw {
        Draw::PowerOfTwo => min.log2().ceil() > max.log2().floor(),
        Draw::Linear | Draw::Log | Draw::Integer => min.ceil() > max.floor(),
    }
}

/// All points of a study, those left out left out, none twice. `whole` says of each axis whether it is drawn whole.
pub fn expand(file: &StudyFile, base: &Recipe, whole: &[bool]) -> Result<Vec<Point>, BadInput> {
    let all = match file.sampling {
        Sampling::Grid => grid(&file.axes),
        Sampling::List => {
            let length = file.axes.first().map_or(0, |axis| axis.values.len());
            (0..length).map(|i| file.axes.iter().map(|axis| axis.values[i].clone()).collect()).collect()
        }
        Sampling::OneAtATime => one_at_a_time(file, base)?,
        Sampling::Random { points, seed } => random(&file.axes, whole, points, seed),
    };
    let excluded = |point: &Point| {
        file.exclude.iter().any(|exclusion| {
            exclusion.iter().all(|(path, value)| {
                file.axes
                    .iter()
                    .position(|axis| axis.path == *path)
                    .is_some_and(|axis| named(value).iter().any(|value| same(&point[axis], value)))
            })
        })
    };
    let mut seen = std::collections::BTreeSet::new();
    let mut kept: Vec<Point> = all;
    kept.retain(|point| !excluded(point) && seen.insert(Value::from(point.clone()).to_string()));
    Ok(kept)
}

pub use lrbsim_reports::study::{named, same};

fn grid(axes: &[StudyAxis]) -> Vec<Point> {
    axes.iter().fold(vec![Vec::new()], |points, axis| {
        points
            .iter()
            .flat_map(|point| {
                axis.values.iter().map(move |value| point.iter().cloned().chain([value.clone()]).collect())
            })
            .collect()
    })
}

/// The base, then every value of every axis alone.
fn one_at_a_time(file: &StudyFile, base: &Recipe) -> Result<Vec<Point>, BadInput> {
    let middle: Point = file.axes.iter().map(|axis| base.value(&axis.path)).collect::<Result<_, _>>()?;
    let mut points = vec![middle.clone()];
    for (index, axis) in file.axes.iter().enumerate() {
        for value in axis.values.iter().filter(|value| !same(value, &middle[index])) {
            let mut point = middle.clone();
            point[index] = value.clone();
            points.push(point);
        }
    }
    Ok(points)
}

fn random(axes: &[StudyAxis], whole: &[bool], points: u32, seed: u64) -> Vec<Point> {
    let mut random = SplitMix(seed);
    let mut point = || axes.iter().zip(whole).map(|(axis, whole)| drawn(axis, *whole, &mut random)).collect();
    (0..points).map(|_| point()).collect()
}

fn drawn(axis: &StudyAxis, whole: bool, random: &mut SplitMix) -> Value {
    if !axis.values.is_empty() {
        let index = (random.unit() * axis.values.len() as f64) as usize;
        return axis.values[index.min(axis.values.len() - 1)].clone();
    }
    let (min, max) = (axis.min.unwrap_or(0.0), axis.max.unwrap_or(0.0));
    let at = random.unit();
    let value = match axis.draw {
        Draw::Linear | Draw::Integer if whole => {
            (min.ceil() + (at * (max.floor() - min.ceil() + 1.0)).floor()).min(max.floor())
        }
        Draw::Linear | Draw::Integer => min + at * (max - min),
        Draw::Log => {
            let value = min * (max / min).powf(at);
            if whole { value.round().clamp(min.ceil(), max.floor()) } else { value }
        }
        Draw::PowerOfTwo => {
            let (low, high) = (min.log2().ceil(), max.log2().floor());
            (low + (at * (high - low + 1.0)).floor()).min(high).exp2()
        }
    };
    number(value, whole)
}

/// A number as JSON has it: whole ones without a fraction.
fn number(value: f64, whole: bool) -> Value {
    if whole { Value::from(value.round() as i64) } else { Value::from(value) }
}

/// Numbers by lot, the same ones for the same seed on every host: Steele, Lea and Flood's SplitMix64.
#[derive(Debug, Clone)]
pub struct SplitMix(pub u64);

impl SplitMix {
    /// A number in [0, 1).
    pub fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut bits = self.0;
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((bits ^ (bits >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn file(text: Value) -> StudyFile {
        serde_json::from_value(text).expect("a sound study")
    }

    fn points(text: Value) -> Vec<Value> {
        let file = file(text);
        let base = Recipe::of_base(&file.base, std::path::Path::new("")).expect("a sound base");
        let whole: Vec<bool> = file.axes.iter().map(|axis| axis.draw != Draw::Log).collect();
        expand(&file, &base, &whole).expect("sound").into_iter().map(Value::from).collect()
    }

    fn two_axes(sampling: Value, exclude: Value) -> Value {
        json!({"name": "x", "sampling": sampling, "exclude": exclude, "base": {"scene": "tiny"}, "axes": [
            {"path": "cores", "values": [24, 1]}, {"path": "l2.ways", "values": [8, 4]}
        ]})
    }

    #[test]
    fn a_grid_has_every_combination_and_the_last_axis_is_fastest() {
        let all = json!([[24, 8], [24, 4], [1, 8], [1, 4]]);
        assert_eq!(Value::from(points(two_axes(json!("grid"), json!([])))), all);
        assert_eq!(count(&file(two_axes(json!("grid"), json!([])))), 4);
    }

    #[test]
    fn a_list_takes_one_of_each() {
        assert_eq!(Value::from(points(two_axes(json!("list"), json!([])))), json!([[24, 8], [1, 4]]));
    }

    #[test]
    fn one_at_a_time_starts_from_the_base() {
        let all = json!([[24, 8], [1, 8], [24, 4]]);
        assert_eq!(Value::from(points(two_axes(json!("one_at_a_time"), json!([])))), all);
    }

    #[test]
    fn exclusions_agree_in_all_that_they_name() {
        let left = json!([[24, 8], [1, 8], [1, 4]]);
        assert_eq!(
            Value::from(points(two_axes(json!("grid"), json!([{"cores": 24.0, "l2.ways": 4}])))),
            left
        );
        assert_eq!(
            Value::from(points(two_axes(json!("grid"), json!([{"cores": 24}, {"l2.ways": 4}])))),
            json!([[1, 8]])
        );
        assert_eq!(
            Value::from(points(two_axes(json!("grid"), json!([{"cores": [24], "l2.ways": [4, 8.0]}])))),
            json!([[1, 8], [1, 4]])
        );
    }

    #[test]
    fn random_points_repeat_with_their_seed_and_stay_in_range() {
        let text = |seed: u64| {
            json!({"name": "x", "sampling": {"random": {"points": 40, "seed": seed}}, "axes": [
                {"path": "cores", "min": 1, "max": 64, "draw": "integer"},
                {"path": "l2.capacity_bytes", "min": 65536, "max": 1048576, "draw": "power_of_two"},
                {"path": "memory.bandwidth_gb_per_s", "min": 10, "max": 100, "draw": "log"},
                {"path": "l2.ways", "values": [4, 8]}
            ]})
        };
        let drawn = points(text(7));
        assert_eq!(drawn, points(text(7)));
        assert_ne!(drawn, points(text(8)));
        for point in &drawn {
            assert!((1..=64).contains(&point[0].as_u64().expect("whole")));
            assert!(point[1].as_u64().expect("whole").is_power_of_two());
            assert!((10.0..=100.0).contains(&point[2].as_f64().expect("a number")));
            assert!(point[3] == 4 || point[3] == 8);
        }
    }

    #[test]
    fn counting_a_grid_does_not_make_it() {
        let values: Vec<u32> = (0..1000).collect();
        let axes: Vec<Value> = (0..9).map(|i| json!({"path": format!("p{i}"), "values": values})).collect();
        assert_eq!(count(&file(json!({"name": "x", "axes": axes}))), u64::MAX);
    }
}
