//! What a scene file must keep.

use glam::DVec3;

use super::error::SceneError;
use super::file::{MeshSource, SceneFile};
use crate::camera::{Camera, ImageSize};
use crate::light::Light;
use crate::mesh::{Mesh, length};

/// Largest side of a picture, in pixels.
const SIDE_MAX: u32 = 16384;
/// Sine of the least angle between view and up.
const UP_SINE_MIN: f64 = 1e-6;
/// Sine of the least angle between the sides of a rectangle; twice the least area of a triangle, over the square of its longest side.
const RECT_SINE_MIN: f64 = 1e-3;
/// Least diagonal of a scene: its cube is still a normal f64.
const DIAGONAL_MIN: f64 = 1e-100;
/// Largest radius of a light as a multiple of the scene's diagonal: kernels square it in f32, twice.
const LIGHT_RADIUS_MAX: f64 = 1e9;

/// Checks every value: what passes can be rendered.
///
/// # Errors
/// [`SceneError::Value`] for the first value that is unsound.
pub fn validate(file: &SceneFile) -> Result<(), SceneError> {
    if let MeshSource::Procedural(p) = &file.mesh {
        if !(1..=16).contains(&p.detail) {
            return Err(value("mesh.detail", p.detail, "in 1..=16"));
        }
        if p.procedural != "plates" && p.pieces != 1 {
            return Err(value("mesh.pieces", p.pieces, "1: only `plates` is cut into pieces"));
        }
        if ![1, 2, 4, 8, 16].contains(&p.pieces) {
            return Err(value("mesh.pieces", p.pieces, "1, 2, 4, 8 or 16"));
        }
    }
    camera(&file.camera)?;
    image(file.image)?;
    light(&file.light)?;
    file.motion.as_ref().map_or(Ok(()), |motion| motion.validate())
}

/// Checks what motion changes.
pub(super) fn validate_view(view: &Camera, lamp: &Light) -> Result<(), SceneError> {
    camera(view)?;
    light(lamp)
}

/// Checks that `mesh` has triangles, and that its vertices do not all lie at one point; `name` is how errors call it.
pub(super) fn validate_mesh(mesh: &Mesh, name: &str) -> Result<(), SceneError> {
    if mesh.triangles.is_empty() {
        return Err(SceneError::NoTriangles { mesh: name.to_owned() });
    }
    if mesh.bounds().diagonal() < DIAGONAL_MIN {
        return Err(SceneError::NoExtent { mesh: name.to_owned() });
    }
    Ok(())
}

/// Checks that `light` is not so large beside `mesh` that f32 cannot hold both.
///
/// # Errors
/// [`SceneError::Value`] if it is.
pub fn validate_light_size(light: &Light, mesh: &Mesh) -> Result<(), SceneError> {
    let (radius, diagonal) = (light.radius(), mesh.bounds().diagonal());
    if radius <= LIGHT_RADIUS_MAX * diagonal {
        return Ok(());
    }
    let expected = format!("at most {LIGHT_RADIUS_MAX:e} times the scene's diagonal of {diagonal}");
    Err(value("light.radius", format_args!("{radius:e}"), &expected))
}

fn value(at: &str, found: impl ToString, expected: &str) -> SceneError {
    SceneError::Value { at: at.to_owned(), found: found.to_string(), expected: expected.to_owned() }
}

fn camera(camera: &Camera) -> Result<(), SceneError> {
    point("camera.eye", camera.eye)?;
    point("camera.target", camera.target)?;
    point("camera.up", camera.up)?;
    if camera.eye == camera.target {
        return Err(value("camera.target", "the same as `camera.eye`", "another point"));
    }
    if camera.up == DVec3::ZERO {
        return Err(value("camera.up", "[0, 0, 0]", "a direction"));
    }
    let unit = |v: DVec3| v / length(v);
    if length(unit(camera.target - camera.eye).cross(unit(camera.up))) < UP_SINE_MIN {
        return Err(value("camera.up", "parallel to the view", "across it"));
    }
    let fov = camera.fov_y_degrees;
    if !(fov > 0.0 && fov < 180.0) {
        return Err(value("camera.fov_y_degrees", fov, "between 0 and 180, both excluded"));
    }
    Ok(())
}

fn image(image: ImageSize) -> Result<(), SceneError> {
    for (at, side) in [("image.width", image.width), ("image.height", image.height)] {
        if !(1..=SIDE_MAX).contains(&side) {
            return Err(value(at, side, "in 1..=16384"));
        }
    }
    Ok(())
}

fn light(light: &Light) -> Result<(), SceneError> {
    match *light {
        Light::Rect { center, half_u, half_v } => {
            point("light.center", center)?;
            point("light.half_u", half_u)?;
            point("light.half_v", half_v)?;
            let area = length(half_u.cross(half_v));
            if area > RECT_SINE_MIN * length(half_u) * length(half_v) {
                return Ok(());
            }
            Err(value(
                "light.half_v",
                half_v,
                "across `light.half_u`, neither of them 0; a `linear` light has no width",
            ))
        }
        Light::Linear { p0, p1 } => {
            point("light.p0", p0)?;
            point("light.p1", p1)
        }
        Light::Triangle { p0, p1, p2 } => {
            point("light.p0", p0)?;
            point("light.p1", p1)?;
            point("light.p2", p2)?;
            let sides = [p1 - p0, p2 - p1, p0 - p2];
            let longest = sides.map(length).into_iter().fold(0.0, f64::max);
            if length(sides[0].cross(sides[1])) > RECT_SINE_MIN * longest * longest {
                return Ok(());
            }
            Err(value(
                "light.p2",
                p2,
                "far from the line through `light.p0` and `light.p1`, and these apart; a `linear` light has no width",
            ))
        }
        Light::Sphere { center, radius } => {
            point("light.center", center)?;
            size("light.radius", radius)
        }
        Light::Disc { center, normal, radius } => {
            point("light.center", center)?;
            direction("light.normal", normal)?;
            size("light.radius", radius)
        }
        Light::Point { center } => point("light.center", center),
    }
}

/// Finite, in f32 too.
fn point(at: &str, p: DVec3) -> Result<(), SceneError> {
    if p.as_vec3().is_finite() { Ok(()) } else { Err(value(at, p, "three finite numbers below 3.4e38")) }
}

fn direction(at: &str, v: DVec3) -> Result<(), SceneError> {
    point(at, v)?;
    if v == DVec3::ZERO { Err(value(at, "[0, 0, 0]", "a direction")) } else { Ok(()) }
}

fn size(at: &str, radius: f64) -> Result<(), SceneError> {
    if radius >= 0.0 && (radius as f32).is_finite() {
        Ok(())
    } else {
        Err(value(at, radius, "0 or more, and finite"))
    }
}
