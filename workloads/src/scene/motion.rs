//! What moves in a scene: its light, its camera and named objects, over time from 0 to 1.

use std::collections::BTreeMap;

use glam::{DMat3, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Scene;
use super::error::SceneError;
use crate::adjacency::prepare;
use crate::light::Light;
use crate::mesh::Mesh;

/// How a scene changes from time 0 to time 1. What is not named stays.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Motion {
    /// How the light moves; it does not turn.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub light: Option<Track>,
    /// How the eye of the camera moves.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub eye: Option<Track>,
    /// How the point moves that the camera looks at.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub target: Option<Track>,
    /// How objects and groups of the mesh move, by their name; all that go by a name move as one.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub objects: BTreeMap<String, Track>,
}

/// A way: `{"path": [[x, y, z], …]}` or `{"around": [x, y, z], "axis": [x, y, z], "degrees": D}`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(
    untagged,
    deny_unknown_fields,
    expecting = "a way is {\"path\": [[x, y, z], ...]} or {\"around\": [x, y, z], \"axis\": [x, y, z], \"degrees\": D}"
)]
pub enum Track {
    /// Along straight lines from displacement to displacement, in equal times; `[0, 0, 0]` is where the scene has it.
    Path {
        /// Displacements at equally spaced times, at least two.
        #[schemars(with = "Vec<[f64; 3]>")]
        path: Vec<DVec3>,
    },
    /// Around an axis; objects turn with it.
    Orbit {
        /// A point of the axis.
        #[schemars(with = "[f64; 3]")]
        around: DVec3,
        /// Direction of the axis, any length but 0.
        #[schemars(with = "[f64; 3]")]
        axis: DVec3,
        /// Angle at time 1, counterclockwise as seen against the axis.
        degrees: f64,
    },
}

/// Where a way leads at some time: a turn about a point, then a displacement.
struct Move {
    turn: DMat3,
    about: DVec3,
    by: DVec3,
}

impl Move {
    fn apply(&self, point: DVec3) -> DVec3 {
        self.turn * (point - self.about) + self.about + self.by
    }
}

impl Track {
    fn at(&self, time: f64) -> Move {
        match self {
            Track::Path { path } => {
                let place = time * (path.len() - 1) as f64;
                let first = (place.floor() as usize).min(path.len() - 2);
                let part = place - first as f64;
                let by = path[first] * (1.0 - part) + path[first + 1] * part;
                Move { turn: DMat3::IDENTITY, about: DVec3::ZERO, by }
            }
            Track::Orbit { around, axis, degrees } => {
                Move { turn: turn(*axis, degrees.to_radians() * time), about: *around, by: DVec3::ZERO }
            }
        }
    }

    /// The first value that is unsound: its name, what was found, what would be right.
    fn check(&self) -> Option<(&'static str, String, &'static str)> {
        let far = |point: &DVec3| !point.as_vec3().is_finite();
        match self {
            Track::Path { path } if path.len() < 2 => {
                Some(("path", format!("a list of {}", path.len()), "a list of two or more"))
            }
            Track::Path { path } => {
                path.iter().find(|p| far(p)).map(|p| ("path", p.to_string(), "of numbers below 3.4e38"))
            }
            Track::Orbit { around, .. } if far(around) => {
                Some(("around", around.to_string(), "three numbers below 3.4e38"))
            }
            Track::Orbit { axis, .. } if *axis == DVec3::ZERO || far(axis) => {
                Some(("axis", axis.to_string(), "a direction"))
            }
            Track::Orbit { degrees, .. } if degrees.is_nan() || degrees.abs() > 1e6 => {
                Some(("degrees", degrees.to_string(), "from -1e6 to 1e6"))
            }
            Track::Orbit { .. } => None,
        }
    }
}

/// Rodrigues' rotation. With `libm`: the same bytes on every host.
fn turn(axis: DVec3, angle: f64) -> DMat3 {
    let (x, y, z) = axis.normalize().into();
    let (sin, cos) = (libm::sin(angle), libm::cos(angle));
    let rest = 1.0 - cos;
    DMat3::from_cols(
        DVec3::new(cos + x * x * rest, y * x * rest + z * sin, z * x * rest - y * sin),
        DVec3::new(x * y * rest - z * sin, cos + y * y * rest, z * y * rest + x * sin),
        DVec3::new(x * z * rest + y * sin, y * z * rest - x * sin, cos + z * z * rest),
    )
}

impl Motion {
    /// Checks every way; names of objects are checked against the mesh by [`Motion::check_objects`].
    ///
    /// # Errors
    /// [`SceneError::Value`] for the first value that is unsound.
    pub fn validate(&self) -> Result<(), SceneError> {
        let named = [("light", &self.light), ("eye", &self.eye), ("target", &self.target)];
        let fixed = named.into_iter().filter_map(|(name, way)| Some((name.to_owned(), way.as_ref()?)));
        let objects = self.objects.iter().map(|(name, way)| (format!("objects.{name}"), way));
        for (name, way) in fixed.chain(objects) {
            if let Some((field, found, expected)) = way.check() {
                let at = format!("motion.{name}.{field}");
                return Err(SceneError::Value { at, found, expected: expected.to_owned() });
            }
        }
        Ok(())
    }

    /// Checks that every object or group that moves is in the mesh.
    ///
    /// # Errors
    /// [`SceneError::Value`] for the first that is not, with the names that are.
    pub fn check_objects(&self, mesh: &Mesh) -> Result<(), SceneError> {
        let known = |name: &str| mesh.objects.iter().any(|object| object.is_called(name));
        let Some(name) = self.objects.keys().find(|name| !known(name)) else { return Ok(()) };
        let mut names: Vec<&str> = mesh.objects.iter().flat_map(|object| object.names()).collect();
        names.sort_unstable();
        names.dedup();
        Err(SceneError::Value {
            at: format!("motion.objects.{name}"),
            found: "no object or group of this name".to_owned(),
            expected: format!("one of: {}", names.join(", ")),
        })
    }
}

impl Scene {
    /// The scene at `time`, from 0 to 1: the same scene without motion where nothing moves.
    ///
    /// # Errors
    /// If the camera has moved to where it cannot look.
    ///
    /// # Panics
    /// When `time` is not in [0, 1].
    pub fn at(&self, time: f64) -> Result<Scene, SceneError> {
        assert!((0.0..=1.0).contains(&time), "time {time} is not in [0, 1]");
        let mut scene = self.clone();
        let Some(motion) = scene.motion.take() else { return Ok(scene) };
        if let Some(way) = &motion.light {
            scene.light = moved(scene.light, &way.at(time));
        }
        for (way, point) in [(&motion.eye, &mut scene.camera.eye), (&motion.target, &mut scene.camera.target)]
        {
            if let Some(way) = way {
                *point = way.at(time).apply(*point);
            }
        }
        for (name, way) in &motion.objects {
            move_objects(&mut scene.mesh, name, &way.at(time));
        }
        if !motion.objects.is_empty() {
            prepare(&mut scene.mesh);
        }
        super::validate::validate_view(&scene.camera, &scene.light)?;
        Ok(scene)
    }
}

/// The light with its place moved; its shape keeps its direction.
fn moved(light: Light, way: &Move) -> Light {
    match light {
        Light::Sphere { center, radius } => Light::Sphere { center: way.apply(center), radius },
        Light::Disc { center, normal, radius } => Light::Disc { center: way.apply(center), normal, radius },
        Light::Rect { center, half_u, half_v } => Light::Rect { center: way.apply(center), half_u, half_v },
        Light::Point { center } => Light::Point { center: way.apply(center) },
        Light::Linear { p0, p1 } => {
            let by = way.apply(light.center()) - light.center();
            Light::Linear { p0: p0 + by, p1: p1 + by }
        }
        Light::Triangle { p0, p1, p2 } => {
            let by = way.apply(light.center()) - light.center();
            Light::Triangle { p0: p0 + by, p1: p1 + by, p2: p2 + by }
        }
    }
}

/// Moves all objects and groups called `name`. Vertices that they share with others are their own from here on.
fn move_objects(mesh: &mut Mesh, name: &str, way: &Move) {
    let mut copies: BTreeMap<u32, u32> = BTreeMap::new();
    let ranges: Vec<_> = mesh.objects.iter().filter(|object| object.is_called(name)).cloned().collect();
    for range in ranges {
        for triangle in range.first..range.last {
            for corner in 0..3 {
                let old = mesh.triangles[triangle as usize][corner];
                let new = *copies.entry(old).or_insert_with(|| {
                    mesh.positions.push(way.apply(mesh.positions[old as usize]));
                    (mesh.positions.len() - 1) as u32
                });
                mesh.triangles[triangle as usize][corner] = new;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{SceneName, builtin_scene};

    fn scene(motion: &str) -> Result<Scene, SceneError> {
        let text = builtin_scene("tiny").expect("shipped");
        let end = text.rfind('}').expect("an object");
        SceneName::Shipped("tiny").scene_of_text(&format!("{}, \"motion\": {motion}}}", &text[..end]))
    }

    fn near(a: DVec3, b: DVec3) -> bool {
        (a - b).length() < 1e-12
    }

    #[test]
    fn a_light_follows_its_path() {
        let moving = scene(r#"{"light": {"path": [[0, 0, 0], [2, 0, 0], [2, 4, 0]]}}"#).expect("sound");
        let start = moving.light.center();
        for (time, by) in [(0.0, [0.0, 0.0]), (0.25, [1.0, 0.0]), (0.75, [2.0, 2.0]), (1.0, [2.0, 4.0])] {
            let scene = moving.at(time).expect("sound");
            assert!(near(scene.light.center() - start, DVec3::new(by[0], by[1], 0.0)), "{time}");
            assert_eq!((scene.mesh, scene.motion), (moving.mesh.clone(), None));
        }
    }

    #[test]
    fn a_quarter_turn_is_counterclockwise() {
        let way = Track::Orbit { around: DVec3::new(1.0, 0.0, 0.0), axis: DVec3::Y * 3.0, degrees: 360.0 };
        assert!(near(way.at(0.25).apply(DVec3::new(2.0, 5.0, 0.0)), DVec3::new(1.0, 5.0, -1.0)));
        assert!(near(way.at(1.0).apply(DVec3::X * 2.0), DVec3::X * 2.0));
    }

    #[test]
    fn an_object_moves_and_the_others_stay() {
        let still = scene("{}").expect("sound");
        let name = still.mesh.objects.last().expect("objects").name.clone();
        let text = format!(r#"{{"objects": {{"{name}": {{"path": [[0, 0, 0], [0, 3, 0]]}}}}}}"#);
        let moved = scene(&text).expect("sound").at(1.0).expect("sound");
        assert_eq!(moved.mesh.triangles.len(), still.mesh.triangles.len());
        for object in &still.mesh.objects {
            let by = if object.name == name { DVec3::Y * 3.0 } else { DVec3::ZERO };
            for triangle in object.first as usize..object.last as usize {
                let corners = |mesh: &Mesh| {
                    let mut points = mesh.triangles[triangle].map(|v| mesh.positions[v as usize].to_array());
                    // Which corner comes first is not the point.
                    points.sort_by(|a, b| a.partial_cmp(b).expect("finite"));
                    points.map(DVec3::from_array)
                };
                let pairs = corners(&still.mesh).into_iter().zip(corners(&moved.mesh));
                assert!(pairs.into_iter().all(|(a, b)| near(a + by, b)), "{}", object.name);
            }
        }
    }

    #[test]
    fn unsound_motions_name_their_place() {
        let cases = [
            (r#"{"light": {"path": [[0, 0, 0]]}}"#, "motion.light.path"),
            (r#"{"eye": {"around": [0, 0, 0], "axis": [0, 0, 0], "degrees": 1}}"#, "motion.eye.axis"),
            (r#"{"objects": {"nobody": {"path": [[0, 0, 0], [1, 0, 0]]}}}"#, "motion.objects.nobody"),
            (r#"{"light": {"path": [[0, 0, 0], [1e39, 0, 0]]}}"#, "motion.light.path"),
        ];
        for (motion, at) in cases {
            let error = scene(motion).expect_err(motion);
            assert!(matches!(&error, SceneError::Value { at: found, .. } if found == at), "{error}");
        }
        assert!(scene(r#"{"light": {"along": []}}"#).is_err());
    }
}
