//! Views of rooms, from inside.

use glam::DVec3;
use rayon::prelude::*;

use super::{FitInfo, Fitted, IMAGE, LIGHT_RADIUS, Subject, directions};
use crate::adjacency::Counting;
use crate::camera::Camera;
use crate::light::Light;
use crate::mesh::distance_to_triangle;

const FOV_Y_DEGREES: f64 = 60.0;
/// Eye height as a part of the room's height.
const EYE_PART: f64 = 0.4;
/// Height of what the eye looks at.
const TARGET_PART: f64 = 0.3;
/// Columns and rows of the coarse picture by which views are judged.
const COARSE: [u32; 2] = [24, 18];

/// Whether most of the scene's volume is enclosed space with something in it.
///
/// From inside a plain body every ray meets the back of that body; from inside a room many meet the front of
/// furniture or of thick walls.
pub fn is_room(subject: &Subject) -> bool {
    const PARTS: [f64; 3] = [0.25, 0.5, 0.75];
    let (mut enclosed, mut hits, mut fronts) = (0, 0, 0);
    for k in 0..27 {
        let part = DVec3::new(PARTS[k % 3], PARTS[k / 3 % 3] * 0.9, PARTS[k / 9]);
        let around = look_around(subject, subject.point(part));
        if around.enclosed {
            enclosed += 1;
            hits += around.hits;
            fronts += around.fronts;
        }
    }
    enclosed >= 12 && fronts * 20 >= hits
}

struct Around {
    enclosed: bool,
    hits: u32,
    /// Hits of the outer side of a body.
    fronts: u32,
}

fn look_around(subject: &Subject, from: DVec3) -> Around {
    const RAYS: u32 = 96;
    let (mut hits, mut fronts, mut up, mut up_hits) = (0, 0, 0, 0);
    for direction in directions(RAYS) {
        let hit = subject.bvh.closest(from, direction, 0.0, f64::INFINITY);
        up += u32::from(direction.y > 0.5);
        up_hits += u32::from(direction.y > 0.5 && hit.is_some());
        if let Some(hit) = hit {
            hits += 1;
            // Which side of a sheet is the outer one is not known.
            let body = subject.adjacency.counting[hit.triangle as usize] != Counting::Sheet;
            let front = subject.mesh.area_normal(hit.triangle as usize).dot(direction) < 0.0;
            fronts += u32::from(body && front);
        }
    }
    Around { enclosed: hits * 10 >= RAYS * 7 && up_hits * 10 >= up * 9, hits, fronts }
}

/// Camera and light inside the room; `None` if no place is free for them.
pub fn fit(subject: &Subject) -> Option<Fitted> {
    let camera = open_side(subject).or_else(|| inside(subject))?;
    let light = light(subject, &camera)?;
    Some(Fitted { camera, light, info: FitInfo { interior: true, floor_added: false } })
}

/// A camera outside, if one side of the room is open.
fn open_side(subject: &Subject) -> Option<Camera> {
    let center = subject.bounds.center();
    let size = subject.bounds.size();
    for direction in [DVec3::Z, DVec3::NEG_Z, DVec3::X, DVec3::NEG_X] {
        let across = DVec3::Y.cross(direction);
        let mut free = 0;
        for k in 0..25 {
            let part = |i: u32| (f64::from(i) - 2.0) * 0.17;
            let spread = across * part(k % 5) + DVec3::Y * part(k / 5);
            free += u32::from(subject.distance(center, (direction + spread).normalize()).is_none());
        }
        if free < 23 {
            continue;
        }
        // The opening fills the picture.
        let fov_y_degrees: f64 = 40.0;
        let tan = libm::tan(fov_y_degrees.to_radians() * 0.5);
        let aspect = f64::from(IMAGE.width) / f64::from(IMAGE.height);
        let half = (size.y * 0.5).max(size.dot(across.abs()) * 0.5 / aspect);
        let eye = center + direction * (size.dot(direction.abs()) * 0.5 + half * 1.04 / tan);
        return Some(Camera { eye, target: center, up: DVec3::Y, fov_y_degrees });
    }
    None
}

/// The camera inside from which most of the room is seen: a free place, a long view.
fn inside(subject: &Subject) -> Option<Camera> {
    const GRID: u32 = 10;
    let score = |k: u32| {
        let part = |i: u32| (f64::from(i) + 0.5) / f64::from(GRID);
        let camera = Camera {
            eye: subject.point(DVec3::new(part(k % GRID), EYE_PART, part(k / GRID))),
            target: subject.point(DVec3::new(0.5, TARGET_PART, 0.5)),
            up: DVec3::Y,
            fov_y_degrees: FOV_Y_DEGREES,
        };
        let level = DVec3::new(1.0, 0.0, 1.0);
        if ((camera.target - camera.eye) * level).length() < subject.diagonal * 0.1 {
            return None;
        }
        // Nothing close around the eye, and no way out.
        for direction in directions(48) {
            if subject.distance(camera.eye, direction)? < subject.diagonal * 0.025 {
                return None;
            }
        }
        // Long views are good; things right before the eye spoil the picture.
        let mut sum = 0.0;
        for distance in view_distances(subject, &camera) {
            let part = distance? / subject.diagonal;
            sum += if part < 0.08 { -0.3 } else { part.min(0.8) };
        }
        Some((sum, camera))
    };
    best((0..GRID * GRID).into_par_iter().filter_map(score).collect())
}

/// Distance to what each ray of a coarse picture meets.
fn view_distances(subject: &Subject, camera: &Camera) -> impl Iterator<Item = Option<f64>> {
    let size = crate::camera::ImageSize { width: COARSE[0], height: COARSE[1] };
    let axes = camera.axes(IMAGE);
    let eye = camera.eye;
    (0..COARSE[0] * COARSE[1]).map(move |k| {
        let direction = axes.direction(size, k % COARSE[0], k / COARSE[0]).normalize();
        subject.distance(eye, direction)
    })
}

/// A free place in the upper half of the room from which a good part, but not all, of the picture is lit.
fn light(subject: &Subject, camera: &Camera) -> Option<Light> {
    const GRID: u32 = 9;
    const HEIGHTS: [f64; 5] = [0.5, 0.6, 0.7, 0.8, 0.88];
    let radius = subject.diagonal * LIGHT_RADIUS;
    let size = crate::camera::ImageSize { width: COARSE[0], height: COARSE[1] };
    let axes = camera.axes(IMAGE);
    // What the camera sees, a little before the surface.
    let receivers: Vec<DVec3> = (0..COARSE[0] * COARSE[1])
        .filter_map(|k| {
            let direction = axes.direction(size, k % COARSE[0], k / COARSE[0]).normalize();
            let distance = subject.distance(camera.eye, direction)?;
            Some(camera.eye + direction * (distance * 0.9999))
        })
        .collect();

    let middle = subject.point(DVec3::new(0.5, 0.7, 0.5));
    let score = |k: u32| {
        let part = |i: u32| (f64::from(i) + 1.0) / f64::from(GRID + 1);
        let height = HEIGHTS[(k / (GRID * GRID)) as usize];
        let center = subject.point(DVec3::new(part(k % GRID), height, part(k / GRID % GRID)));
        // A light at the eye shows no shadows.
        if (center - camera.eye).length() < subject.diagonal * 0.2 {
            return None;
        }
        // In the room: no way up or down, nothing within the light.
        subject.distance(center, DVec3::Y)?;
        subject.distance(center, DVec3::NEG_Y)?;
        if directions(64).any(|d| subject.distance(center, d).is_some_and(|t| t < radius * 1.3)) {
            return None;
        }
        let lit = receivers.iter().filter(|&&p| !subject.bvh.any(p, center - p, 0.0, 1.0, |_| true)).count();
        let lit = lit as f64 / receivers.len().max(1) as f64;
        let off_middle = (center - middle).length() / subject.diagonal;
        Some((lit.min(0.85) - 0.5 * off_middle, center))
    };
    let mut places: Vec<(f64, DVec3)> =
        (0..GRID * GRID * HEIGHTS.len() as u32).into_par_iter().filter_map(score).collect();
    places.sort_by(|a, b| b.0.total_cmp(&a.0));
    // Rays can slip past thin things: look at every triangle before a place is taken.
    let free = |center: DVec3| {
        (0..subject.mesh.triangles.len())
            .all(|t| distance_to_triangle(center, subject.mesh.corners(t)) > radius * 1.1)
    };
    let center = places.iter().map(|p| p.1).find(|&c| free(c)).or_else(|| places.first().map(|p| p.1))?;
    Some(Light::Sphere { center, radius })
}

/// The value with the highest score; the first of equals.
fn best<T>(scored: Vec<(f64, T)>) -> Option<T> {
    scored.into_iter().reduce(|a, b| if b.0 > a.0 { b } else { a }).map(|(_, value)| value)
}
