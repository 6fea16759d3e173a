//! Camera, light and, where there is none, a floor for a bare mesh. Up is +y.
//!
//! `interior` and `exterior` make candidates, cameras and lights that are clear of everything; `judge` takes the ones
//! that show most: light, shadow and penumbra each in a fair part of the picture, near things and far ones.

mod exterior;
mod interior;
mod judge;

#[cfg(test)]
mod tests;

use core::f64::consts::TAU;

use glam::DVec3;

use crate::adjacency::{Adjacency, prepare};
use crate::bvh::Bvh;
use crate::camera::{Camera, ImageSize};
use crate::light::Light;
use crate::mesh::{Bounds, Mesh};
use crate::scene::Scene;

/// Radius of a fitted light as a part of the scene's diagonal.
const LIGHT_RADIUS: f64 = 0.03;
/// Picture size of a scene that names none.
const IMAGE: ImageSize = ImageSize { width: 640, height: 480 };

/// What was fitted to a bare mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FitInfo {
    /// The mesh is a room: the light is inside it, and the camera too unless one side is open.
    pub interior: bool,
    /// Whether a floor was added to the mesh.
    pub floor_added: bool,
}

/// A fitted view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fitted {
    /// Where the mesh is seen from.
    pub camera: Camera,
    /// The fitted light, a sphere.
    pub light: Light,
    /// What was fitted besides camera and light.
    pub info: FitInfo,
}

/// What the fit looks at: a prepared mesh that can be asked by rays.
struct Subject<'a> {
    mesh: &'a Mesh,
    adjacency: Adjacency,
    bvh: Bvh,
    bounds: Bounds,
    diagonal: f64,
    /// Height of a floor that is to be added.
    floor: Option<f64>,
}

impl Subject<'_> {
    /// Distance along a unit direction to the first triangle; `None` if the ray leaves the scene.
    fn distance(&self, from: DVec3, direction: DVec3) -> Option<f64> {
        self.bvh.closest(from, direction, 0.0, f64::INFINITY).map(|hit| hit.t)
    }

    /// Point at `part` of the bounds along each axis.
    fn point(&self, part: DVec3) -> DVec3 {
        self.bounds.min + self.bounds.size() * part
    }
}

/// Fits camera and light to a prepared mesh with at least one triangle.
#[must_use]
pub fn fit_view(mesh: &Mesh) -> Fitted {
    let bounds = mesh.bounds();
    let diagonal = bounds.diagonal().max(f64::MIN_POSITIVE);
    let subject =
        Subject { mesh, adjacency: Adjacency::new(mesh), bvh: Bvh::new(mesh), bounds, diagonal, floor: None };
    if interior::is_room(&subject)
        && let Some(fitted) = interior::fit(&subject)
    {
        return fitted;
    }
    exterior::fit(subject)
}

/// Makes a scene of a bare mesh with at least one triangle; prepares it and adds a floor if it has none.
#[must_use]
pub fn fit_scene(mut mesh: Mesh) -> Scene {
    prepare(&mut mesh);
    let fitted = fit_view(&mesh);
    if fitted.info.floor_added {
        exterior::add_floor(&mut mesh);
        prepare(&mut mesh);
    }
    Scene {
        name: String::new(),
        mesh,
        camera: fitted.camera,
        image: IMAGE,
        light: fitted.light,
        source: String::new(),
        motion: None,
        fit: Some(fitted.info),
        left_out: Vec::new(),
    }
}

/// `count` unit directions spread evenly over the sphere, from the top down (a golden-angle spiral).
fn directions(count: u32) -> impl Iterator<Item = DVec3> {
    const GOLDEN: f64 = 0.381_966_011_250_105;
    (0..count).map(move |k| {
        let y = 1.0 - (f64::from(k) + 0.5) * 2.0 / f64::from(count);
        let (radius, angle) = ((1.0 - y * y).sqrt(), (f64::from(k) * GOLDEN).fract() * TAU);
        DVec3::new(radius * libm::cos(angle), y, radius * libm::sin(angle))
    })
}
