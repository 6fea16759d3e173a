//! Views of rooms, from inside.

use core::f64::consts::TAU;

use glam::DVec3;
use rayon::prelude::*;

use super::{FitInfo, Fitted, IMAGE, LIGHT_RADIUS, Subject, directions, judge};
use crate::adjacency::Counting;
use crate::camera::Camera;
use crate::light::Light;

const FOV_Y_DEGREES: f64 = 60.0;
/// Eye height as a part of the room's height.
const EYE_PART: f64 = 0.4;
/// How far down it looks, as a part of how far ahead.
const DOWN: f64 = 0.15;
/// Directions to look from each place.
const EYE_DIRECTIONS: u32 = 12;
/// Cameras and lights that are tried with one another, at most.
const CAMERAS_MAX: usize = 10;
const LIGHTS_MAX: usize = 64;
/// Eye and light are no nearer than this part of the diagonal.
const EYE_FROM_LIGHT_PART: f64 = 0.2;
/// The light is clear of everything by this much of its radius.
const CLEAR_OF_LIGHT: f64 = 1.2;
/// Least parts of the picture that are in a cast shadow, and lit.
const SHADOW_PART_MIN: f64 = 0.03;
const LIT_PART_MIN: f64 = 0.2;

/// Whether most of the scene's volume is enclosed space with something in it, and most of the scene is seen from there.
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
    enclosed >= 12 && fronts * 20 >= hits && seen_from_outside(subject) < 0.5
}

/// Part of the triangles that can be seen from outside: from whose middle a good part of all directions leads out.
///
/// A vehicle has enclosed space too, but most of it is there to be seen from outside.
fn seen_from_outside(subject: &Subject) -> f64 {
    const TRIANGLES: usize = 400;
    const RAYS: u32 = 24;
    let triangles = subject.mesh.triangles.len();
    let is_seen = |&triangle: &usize| {
        let [a, b, c] = subject.mesh.corners(triangle);
        let (middle, normal) = ((a + b + c) / 3.0, subject.mesh.area_normal(triangle).normalize_or_zero());
        [1.0, -1.0].into_iter().any(|side| {
            let from = middle + normal * (side * subject.diagonal * 1e-4);
            let out = directions(RAYS).filter(|&d| subject.distance(from, d).is_none()).count();
            out as u32 * 4 >= RAYS
        })
    };
    let looked_at = (0..triangles).step_by(triangles.div_ceil(TRIANGLES));
    looked_at.clone().filter(is_seen).count() as f64 / looked_at.count() as f64
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

/// Camera and light inside the room; `None` if no place is free for them, or nothing in it casts a shadow worth seeing.
pub fn fit(subject: &Subject) -> Option<Fitted> {
    let cameras = match open_side(subject) {
        Some(camera) => vec![camera],
        None => inside(subject),
    };
    // Smaller where there is no room for the usual one.
    let places = [LIGHT_RADIUS, LIGHT_RADIUS * 0.5].map(|part| lights(subject, subject.diagonal * part));
    let places = places.into_iter().find(|places| !places.is_empty())?;
    let view = |camera: Camera| {
        // A light at the eye shows no shadows.
        let away = |light: &&(Light, f64)| {
            (light.0.center() - camera.eye).length() >= subject.diagonal * EYE_FROM_LIGHT_PART
        };
        (camera, places.iter().filter(away).copied().collect())
    };
    let views: Vec<_> = cameras.into_iter().map(view).collect();
    let (view, shown) = judge::best(subject, &views)?;
    let info = FitInfo { interior: true, floor_added: false };
    (shown.shadow >= SHADOW_PART_MIN && shown.lit >= LIT_PART_MIN).then_some(Fitted {
        camera: view.camera,
        light: view.light,
        info,
    })
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

/// Cameras inside from which much of the room is seen, best first: free places, long views.
fn inside(subject: &Subject) -> Vec<Camera> {
    const GRID: u32 = 10;
    let places = (0..GRID * GRID).into_par_iter().flat_map_iter(|k| {
        let part = |i: u32| (f64::from(i) + 0.5) / f64::from(GRID);
        let eye = subject.point(DVec3::new(part(k % GRID), EYE_PART, part(k / GRID)));
        let free = is_free(subject, eye);
        let around = (0..EYE_DIRECTIONS).map(move |k| f64::from(k) / f64::from(EYE_DIRECTIONS) * TAU);
        around.filter(move |_| free).filter_map(move |azimuth| {
            let ahead = DVec3::new(libm::cos(azimuth), -DOWN, libm::sin(azimuth));
            let target = eye + ahead * subject.diagonal * 0.25;
            let camera = Camera { eye, target, up: DVec3::Y, fov_y_degrees: FOV_Y_DEGREES };
            Some((length_of_view(subject, &camera)?, camera))
        })
    });
    let mut scored: Vec<(f64, Camera)> = places.collect();
    scored.sort_by(|a, b| b.0.total_cmp(&a.0));
    // Cameras that differ show different things.
    let mut cameras: Vec<Camera> = Vec::new();
    for (_, camera) in scored {
        let alike = |other: &Camera| {
            let turn = (camera.target - camera.eye).angle_between(other.target - other.eye);
            (camera.eye - other.eye).length() < subject.diagonal * 0.12 && turn < 1.0
        };
        if cameras.len() < CAMERAS_MAX && !cameras.iter().any(alike) {
            cameras.push(camera);
        }
    }
    cameras
}

/// Nothing close around the eye, and no way out.
fn is_free(subject: &Subject, eye: DVec3) -> bool {
    directions(48).all(|d| subject.distance(eye, d).is_some_and(|t| t >= subject.diagonal * 0.025))
}

/// How far the eye sees, as a part of the diagonal; `None` if it sees out. Long views are good; things right before the
/// eye spoil the picture.
fn length_of_view(subject: &Subject, camera: &Camera) -> Option<f64> {
    const COLUMNS: u32 = 12;
    let picture = judge::Picture::new(subject, camera, COLUMNS);
    let parts = picture.distances().map(|distance| match distance / subject.diagonal {
        near if near < 0.08 => -0.3,
        part => part.min(0.8),
    });
    let sum: f64 = parts.sum();
    picture.is_full().then_some(sum)
}

/// Places in the upper part of the room with nothing near, and what speaks for each: the nearer the middle, the better.
fn lights(subject: &Subject, radius: f64) -> Vec<(Light, f64)> {
    const GRID: u32 = 9;
    const HEIGHTS: [f64; 4] = [0.6, 0.7, 0.8, 0.88];
    let middle = subject.point(DVec3::new(0.5, 0.7, 0.5));
    let place = |k: u32| {
        let part = |i: u32| (f64::from(i) + 1.0) / f64::from(GRID + 1);
        let height = HEIGHTS[(k / (GRID * GRID)) as usize];
        let center = subject.point(DVec3::new(part(k % GRID), height, part(k / GRID % GRID)));
        // In the room: no way up or down, nothing within the light.
        subject.distance(center, DVec3::Y)?;
        subject.distance(center, DVec3::NEG_Y)?;
        let off_middle = (center - middle).length() / subject.diagonal;
        (!subject.bvh.any_within(center, radius * CLEAR_OF_LIGHT))
            .then_some((Light::Sphere { center, radius }, -0.5 * off_middle))
    };
    let places: Vec<(Light, f64)> =
        (0..GRID * GRID * HEIGHTS.len() as u32).into_par_iter().filter_map(place).collect();
    let step = places.len().div_ceil(LIGHTS_MAX).max(1);
    places.into_iter().step_by(step).collect()
}
