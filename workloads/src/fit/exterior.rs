//! Views of things, from outside.

use core::f64::consts::TAU;

use glam::DVec3;

use super::{FitInfo, Fitted, IMAGE, LIGHT_RADIUS, Subject, judge};
use crate::camera::Camera;
use crate::light::Light;
use crate::mesh::{Mesh, ObjectRange};

const FOV_Y_DEGREES: f64 = 40.0;
/// Eyes stand around the scene, so many of them, the first somewhat to the right of its front.
const EYES_AROUND: u32 = 8;
const FIRST_EYE_DEGREES: f64 = 19.0;
/// How high they stand.
const EYE_ELEVATIONS_DEGREES: [f64; 2] = [25.0, 42.0];
/// Lights to the left and right of the eye: above and in front.
const LIGHT_AZIMUTHS_DEGREES: [f64; 6] = [31.0, -31.0, 60.0, -60.0, 90.0, -90.0];
const LIGHT_ELEVATIONS_DEGREES: [f64; 3] = [54.0, 42.0, 30.0];
/// Distances of lights from the middle, as parts of the diagonal: clear of everything in the bounds.
const LIGHT_DISTANCES: [f64; 2] = [1.0, 0.7];
/// What speaks for the front of a thing, its back having none of it, and for the first of the lights.
const FRONT_BONUS: f64 = 0.4;
const FIRST_LIGHT_BONUS: f64 = 0.1;
/// Half the side of a floor that is added, as a part of the diagonal.
pub const FLOOR_REACH: f64 = 1.5;
/// A ground lies in this lowest part of the scene's height.
const GROUND_PART: f64 = 0.35;

/// Parts of a landscape's width and depth that must be in the picture; the rest may reach past its sides.
const LANDSCAPE_PARTS: [f64; 2] = [0.5, 0.3];
/// Nothing stands closer before the eye than this part of its distance from the middle.
const CLEAR_PART: f64 = 0.3;

/// The view that shows most of the whole scene from above one of its sides, the light higher. Of a landscape, a scene
/// on a ground of its own, the middle: its ground then fills the picture.
pub fn fit(mut subject: Subject) -> Fitted {
    let landscape = has_ground(&subject);
    subject.floor = (!landscape).then_some(subject.bounds.min.y);
    let parts: &[f64] = if landscape { &LANDSCAPE_PARTS } else { &[1.0] };

    let mut views = Vec::new();
    for around in 0..EYES_AROUND {
        let turn = f64::from(around) / f64::from(EYES_AROUND);
        let azimuth = FIRST_EYE_DEGREES + 360.0 * turn;
        let bonus = FRONT_BONUS * (0.5 + 0.5 * libm::cos(TAU * turn));
        for elevation in EYE_ELEVATIONS_DEGREES {
            for &part in parts {
                let camera = framed(&subject, direction(azimuth, elevation), part);
                let clear = (camera.eye - camera.target).length() * CLEAR_PART;
                // The whole of a scene has nothing before it.
                if part < 1.0 && judge::Picture::new(&subject, &camera, 12).distances().any(|d| d < clear) {
                    continue;
                }
                views.push((camera, lights(&subject, azimuth, bonus)));
            }
        }
    }
    // A landscape that leaves no place free in it is seen from farther off.
    if views.is_empty() {
        views.push((
            framed(&subject, direction(FIRST_EYE_DEGREES, EYE_ELEVATIONS_DEGREES[0]), 1.0),
            lights(&subject, FIRST_EYE_DEGREES, 0.0),
        ));
    }
    let (view, _) = judge::best(&subject, &views).expect("there is a view");
    Fitted {
        camera: view.camera,
        light: view.light,
        info: FitInfo { interior: false, floor_added: !landscape },
    }
}

/// Unit direction to the right of the scene's front, and above it.
fn direction(azimuth_degrees: f64, elevation_degrees: f64) -> DVec3 {
    let (azimuth, elevation) = (azimuth_degrees.to_radians(), elevation_degrees.to_radians());
    let level = libm::cos(elevation);
    DVec3::new(libm::sin(azimuth) * level, libm::sin(elevation), libm::cos(azimuth) * level)
}

/// Lights for an eye at `azimuth_degrees`, with what speaks for each.
fn lights(subject: &Subject, azimuth_degrees: f64, bonus: f64) -> Vec<(Light, f64)> {
    let radius = subject.diagonal * LIGHT_RADIUS;
    let mut lights = Vec::new();
    for elevation in LIGHT_ELEVATIONS_DEGREES {
        for beside in LIGHT_AZIMUTHS_DEGREES {
            for distance in LIGHT_DISTANCES {
                let to_light = direction(azimuth_degrees + beside, elevation) * distance;
                let center = subject.bounds.center() + to_light * subject.diagonal;
                let first = if lights.is_empty() { FIRST_LIGHT_BONUS } else { 0.0 };
                lights.push((Light::Sphere { center, radius }, bonus + first));
            }
        }
    }
    lights
}

/// A camera in direction `to_eye` of the scene, so far off that `part` of its width and depth is in the picture.
fn framed(subject: &Subject, to_eye: DVec3, part: f64) -> Camera {
    let (center, diagonal) = (subject.bounds.center(), subject.diagonal);
    let mut camera = Camera {
        eye: center + to_eye * diagonal,
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
    camera
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
    let (center, reach) = (bounds.center(), bounds.diagonal() * FLOOR_REACH);
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
