//! What a view shows, by a coarse picture.

use glam::DVec3;
use rayon::prelude::*;

use super::{IMAGE, Subject};
use crate::camera::{Camera, ImageSize};
use crate::light::Light;
use crate::reference::Rays;

/// Columns of the picture by which a view is chosen for a closer look.
const GLANCE_COLUMNS: u32 = 24;
/// Columns of the picture that decides, and rays a receiver.
const LOOK_COLUMNS: u32 = 48;
const LOOK_RAYS: u32 = 8;
/// How many views get the closer look.
const LOOKS: usize = 12;
/// A closer look costs as many rays as so many glances.
const GLANCES_A_LOOK: usize = 32;
/// Tests that all glances may take together, a ray each: meshes whose triangles all lie over one another get fewer of
/// them.
const TESTS_MAX: f64 = 5e5;

/// A camera and a light.
#[derive(Debug, Clone, Copy)]
pub struct View {
    pub camera: Camera,
    pub light: Light,
    /// Added to the score: what speaks for the view besides what it shows.
    pub bonus: f64,
}

/// Parts of the receivers, but for the first.
#[derive(Debug, Clone, Copy)]
pub struct Shown {
    /// Part of the picture that receivers cover.
    covered: f64,
    /// Part of the picture that shows the mesh rather than a floor that is added.
    subject: f64,
    /// Standard deviation of the distance to the eye as a part of its mean.
    depth: f64,
    /// Turned away from the light.
    away: f64,
    /// Turned to the light and reached by all rays.
    pub lit: f64,
    /// Turned to the light and reached by none: shadows that are cast.
    pub shadow: f64,
    /// Reached by some rays and not by others.
    penumbra: f64,
}

impl Shown {
    /// How good a picture it is: each thing that should be seen counts up to the part that is enough of it.
    fn score(&self) -> f64 {
        let fair = |part: f64, enough: f64| (part / enough).min(1.0);
        let dark = 1.0 - self.lit - self.penumbra;
        2.0 * fair(self.shadow, 0.12)
            + fair(self.lit, 0.4)
            + fair(self.penumbra, 0.06)
            + 0.5 * (fair(self.depth, 0.3) + fair(self.covered, 0.9) + fair(self.subject, 0.5))
            - self.away
            - 4.0 * (dark - 0.5).max(0.0)
    }
}

/// What the eye sees: points, and what they lie on.
pub struct Picture {
    receivers: Vec<Receiver>,
    pixels: u32,
}

struct Receiver {
    point: DVec3,
    /// Unit normal, turned to the eye.
    normal: DVec3,
    distance: f64,
    /// `None`: on the floor that is added.
    triangle: Option<u32>,
}

impl Picture {
    pub fn new(subject: &Subject, camera: &Camera, columns: u32) -> Self {
        let size = ImageSize { width: columns, height: columns * IMAGE.height / IMAGE.width };
        let axes = camera.axes(size);
        let cast = |pixel: u32| {
            let direction = axes.direction(size, pixel % size.width, pixel / size.width).normalize();
            subject.receiver(camera.eye, direction)
        };
        let pixels = size.width * size.height;
        Self { receivers: (0..pixels).filter_map(cast).collect(), pixels }
    }

    /// Distances from the eye.
    pub fn distances(&self) -> impl Iterator<Item = f64> {
        self.receivers.iter().map(|receiver| receiver.distance)
    }

    /// Whether there is something at every pixel.
    pub fn is_full(&self) -> bool {
        self.receivers.len() == self.pixels as usize
    }

    /// What there is to see by `light`; with one ray there is no penumbra.
    pub fn shown(&self, subject: &Subject, light: &Light, rays: u32) -> Shown {
        let rays = Rays::new(light, rays);
        let (mut away, mut lit, mut shadow, mut penumbra) = (0, 0, 0, 0);
        for (receiver, number) in self.receivers.iter().zip(0_u32..) {
            if receiver.normal.dot(light.center() - receiver.point) <= 0.0 {
                away += 1;
                continue;
            }
            let own = receiver.triangle.unwrap_or(u32::MAX);
            match rays.visibility(&subject.bvh, receiver.point, own, Rays::turn(number)) {
                1.0 => lit += 1,
                0.0 => shadow += 1,
                _ => penumbra += 1,
            }
        }
        let count = self.receivers.len().max(1) as f64;
        let mean = self.distances().sum::<f64>() / count;
        let variance = self.distances().map(|d| (d - mean) * (d - mean)).sum::<f64>() / count;
        let on_mesh = self.receivers.iter().filter(|receiver| receiver.triangle.is_some()).count();
        Shown {
            covered: self.receivers.len() as f64 / f64::from(self.pixels),
            subject: on_mesh as f64 / count,
            depth: variance.sqrt() / mean.max(f64::MIN_POSITIVE),
            away: f64::from(away) / count,
            lit: f64::from(lit) / count,
            shadow: f64::from(shadow) / count,
            penumbra: f64::from(penumbra) / count,
        }
    }
}

impl Subject<'_> {
    /// What a ray of unit direction meets first: the mesh, or the floor that is added.
    fn receiver(&self, eye: DVec3, direction: DVec3) -> Option<Receiver> {
        let hit = self.bvh.closest(eye, direction, 0.0, f64::INFINITY);
        let to_floor = self.floor.map_or(f64::INFINITY, |y| (y - eye.y) / direction.y);
        let nearest = hit.map_or(f64::INFINITY, |hit| hit.t);
        if to_floor > 0.0 && to_floor < nearest {
            let point = eye + direction * to_floor;
            let off_middle = (point - self.bounds.center()).abs();
            let reach = self.diagonal * super::exterior::FLOOR_REACH;
            let on_floor = off_middle.x.max(off_middle.z) < reach;
            return on_floor.then_some(Receiver {
                point,
                normal: DVec3::Y,
                distance: to_floor,
                triangle: None,
            });
        }
        let hit = hit?;
        let normal = self.mesh.area_normal(hit.triangle as usize).normalize_or_zero();
        Some(Receiver {
            // A little before the surface, which is not exactly where rounding puts it.
            point: eye + direction * (hit.t * (1.0 - 1e-9)),
            normal: if normal.dot(direction) > 0.0 { -normal } else { normal },
            distance: hit.t,
            triangle: Some(hit.triangle),
        })
    }
}

/// The view that shows most: all are glanced at, the best are looked at. The first of equals.
pub fn best(subject: &Subject, views: &[(Camera, Vec<(Light, f64)>)]) -> Option<(View, Shown)> {
    let affordable = (TESTS_MAX / subject.bvh.expected_tests()) as usize;
    let lights_each = (affordable / views.len().max(1)).max(1);
    let mut glances: Vec<(f64, View)> = views
        .par_iter()
        .flat_map_iter(|(camera, lights)| {
            let picture = Picture::new(subject, camera, GLANCE_COLUMNS);
            lights.iter().take(lights_each).map(move |&(light, bonus)| {
                let score = picture.shown(subject, &light, 1).score() + bonus;
                (score, View { camera: *camera, light, bonus })
            })
        })
        .collect();
    glances.sort_by(|a, b| b.0.total_cmp(&a.0));
    glances.truncate((affordable / GLANCES_A_LOOK).clamp(1, LOOKS));
    let looks: Vec<(f64, View, Shown)> = glances
        .into_par_iter()
        .map(|(_, view)| {
            let picture = Picture::new(subject, &view.camera, LOOK_COLUMNS);
            let shown = picture.shown(subject, &view.light, LOOK_RAYS);
            (shown.score() + view.bonus, view, shown)
        })
        .collect();
    let best = looks.into_iter().reduce(|a, b| if b.0 > a.0 { b } else { a })?;
    Some((best.1, best.2))
}
