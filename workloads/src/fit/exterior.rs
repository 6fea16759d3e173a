//! Views of things, from outside.

use glam::DVec3;

use super::{FitInfo, Fitted, IMAGE, LIGHT_RADIUS, Subject};
use crate::camera::Camera;
use crate::light::Light;
use crate::mesh::{Mesh, ObjectRange};

const FOV_Y_DEGREES: f64 = 40.0;
/// From the scene to the eye: somewhat from the side and from above.
const TO_EYE: DVec3 = DVec3::new(0.35, 0.5, 1.0);
/// From the scene to the light: above and in front.
const TO_LIGHT: DVec3 = DVec3::new(0.55, 1.0, 0.45);
/// A ground lies in this lowest part of the scene's height.
const GROUND_PART: f64 = 0.35;

/// Part of a landscape's width and depth that must be in the picture; the rest may reach past its sides.
const LANDSCAPE_PART: f64 = 0.5;

/// The whole scene from above its front, the light higher and nearer to the front. Of a landscape, a scene on a ground
/// of its own, the middle: its ground then fills the picture.
pub fn fit(subject: &Subject) -> Fitted {
    let (bounds, diagonal) = (subject.bounds, subject.diagonal);
    let center = bounds.center();
    let landscape = has_ground(subject);
    let part = if landscape { LANDSCAPE_PART } else { 1.0 };
    let mut camera = Camera {
        eye: center + TO_EYE.normalize() * diagonal,
        target: center,
        up: DVec3::Y,
        fov_y_degrees: FOV_Y_DEGREES,
    };
    // Go back until the eight corners of that part are in the picture.
    let axes = camera.axes(IMAGE);
    let (right, up) = (axes.right.length(), axes.up.length());
    let mut distance: f64 = diagonal * 0.1;
    for k in 0..8 {
        let pick = |axis: usize| {
            let side = f64::from(k >> axis & 1);
            if axis == 1 { side } else { 0.5 + (side - 0.5) * part }
        };
        let from_center = subject.point(DVec3::new(pick(0), pick(1), pick(2))) - center;
        let across = from_center.dot(axes.right / right).abs() / right;
        let above = from_center.dot(axes.up / up).abs() / up;
        distance = distance.max(across.max(above) * 1.04 - from_center.dot(axes.forward));
    }
    camera.eye = center - axes.forward * distance;
    let light =
        Light::Sphere { center: center + TO_LIGHT.normalize() * diagonal, radius: diagonal * LIGHT_RADIUS };
    Fitted { camera, light, info: FitInfo { interior: false, floor_added: !landscape } }
}

/// Whether the scene stands on a ground of its own: something low is under nearly all of it, and can be seen from
/// above beside what stands on it.
fn has_ground(subject: &Subject) -> bool {
    const GRID: u32 = 16;
    let height = subject.bounds.size().y;
    let (mut under, mut seen) = (0, 0);
    for k in 0..GRID * GRID {
        let part = |i: u32| (f64::from(i) + 0.5) / f64::from(GRID);
        let (x, z) = (part(k % GRID), part(k / GRID));
        let margin = DVec3::Y * (subject.diagonal * 0.01);
        let below = subject.point(DVec3::new(x, 0.0, z)) - margin;
        let above = subject.point(DVec3::new(x, 1.0, z)) + margin;
        let low = height * GROUND_PART + margin.y * 1.001;
        under += u32::from(subject.distance(below, DVec3::Y).is_some_and(|d| d <= low));
        let high = height * (1.0 - GROUND_PART) + margin.y * 0.999;
        seen += u32::from(subject.distance(above, DVec3::NEG_Y).is_some_and(|d| d >= high));
    }
    under >= GRID * GRID * 7 / 10 && seen >= GRID * GRID / 20
}

/// Adds a level quad under the mesh, large enough for its shadow.
pub fn add_floor(mesh: &mut Mesh) {
    let bounds = mesh.bounds();
    let (center, reach) = (bounds.center(), bounds.diagonal() * 1.5);
    let corner = |x: f64, z: f64| DVec3::new(center.x + x * reach, bounds.min.y, center.z + z * reach);
    let first = mesh.positions.len() as u32;
    mesh.positions.extend([corner(-1.0, -1.0), corner(-1.0, 1.0), corner(1.0, 1.0), corner(1.0, -1.0)]);
    let triangles = mesh.triangles.len() as u32;
    mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    mesh.objects.push(ObjectRange {
        name: "floor".to_owned(),
        groups: String::new(),
        first: triangles,
        last: triangles + 2,
    });
}
