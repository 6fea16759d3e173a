//! How right one picture is.

use lrbsim_kernels::method::Shadows;
use lrbsim_reports::base64;
use lrbsim_reports::picture::shaded_png;
use lrbsim_reports::stability::{Measured, Off, OffRays};
use lrbsim_workloads::glam::Vec3;
use lrbsim_workloads::reference::{ErrorMetrics, Occluders, Truth};
use lrbsim_workloads::{Adjacency, EyeView, Pixels, Scene, ShadowInput};

use crate::algorithm::Algorithm;
use crate::error::BadInput;
use crate::frame::{Frame, HostOptions, cosines, view};
use crate::made::{draw, number};

/// Shadow rays of a receiver.
pub(super) const SAMPLES: u32 = 256;

/// Receivers times triangles and edges that brute force looks at; of more receivers it takes every so-manyth.
const PAIRS_MAX: usize = 60_000_000;

/// Receivers that brute force looks at where there are so many, whatever it costs.
const RECEIVERS_MIN: usize = 64;

/// Receivers that shadow rays are cast from; of more they take every so-manyth.
const RAY_RECEIVERS_MAX: usize = 16_384;

/// Parts of the light from which on a receiver counts as off.
const SLIGHT: f64 = 1e-3;

/// Pixels of a side up to which a picture is kept to be looked at.
const LOOKED_AT_MAX: u32 = 128;

/// Draws `scene` with `algorithm`, and compares the picture with shadow rays; and with `sums`, and compares that with brute
/// force.
pub(super) fn judge(
    scene: &Scene,
    algorithm: &Algorithm,
    sums: &Algorithm,
    host: HostOptions,
) -> Result<Measured, BadInput> {
    let eye = view(scene);
    let adjacency = Adjacency::new(&scene.mesh);
    let input = ShadowInput::new(scene, &adjacency, &eye);
    let drawn = draw(algorithm, input.clone(), host)?.visibility;
    let Shadows { visibility: summed, silhouette_edges } = draw(sums, input.clone(), host)?;
    let no_part = |visibility: &[f32]| visibility.iter().filter(|part| !(0.0..=1.0).contains(*part)).count();

    // By brute force, of the scene in f64 and of the f32 numbers that kernels get.
    let receivers = summed.len();
    let pairs = receivers * (scene.mesh.triangles.len() + silhouette_edges.unwrap_or(0) as usize);
    let step = pairs.div_ceil(PAIRS_MAX).min(receivers / RECEIVERS_MIN).max(1);
    let some = every(step, &eye);
    let ours: Vec<f64> = every_number(step, &summed);
    let of_scene =
        Occluders::from_mesh(&scene.mesh, &adjacency, &scene.light).visibility_of_view(&adjacency, &some);
    let of_input = Occluders::from_input(&input);
    let rounded: Vec<f64> = {
        let few = ShadowInput {
            receivers: input.receivers.iter().step_by(step).copied().collect(),
            receiver_triangle: input.receiver_triangle.iter().step_by(step).copied().collect(),
            receiver_pixel: Pixels::new(&input.receiver_pixel.iter().step_by(step).collect::<Vec<u32>>()),
            ..input
        };
        of_input.visibility(&few)
    };

    // By shadow rays.
    let step = receivers.div_ceil(RAY_RECEIVERS_MAX).max(1);
    let truth = Truth::new(&scene.mesh, &scene.light, &every(step, &eye), SAMPLES, &|| ());
    let mut warnings: Vec<String> =
        scene.warnings(&adjacency).iter().map(|warning| warning.to_string()).collect();
    if receivers == 0 {
        warnings.push("the camera sees no surface".to_owned());
    }
    Ok(Measured {
        triangles: scene.mesh.triangles.len() as u64,
        receivers: receivers as u64,
        no_part: no_part(&drawn).max(no_part(&summed)) as u64,
        brute_force: off(&of_scene, &ours),
        rounded: off(&rounded, &ours),
        rays: off_rays(&truth, &every_number(step, &drawn)),
        rays_of_sums: off_rays(&truth, &every_number(step, &summed)),
        picture: picture(scene, &eye, &drawn),
        warnings,
    })
}

/// The picture as PNG in base 64, if it is small enough to be looked at.
fn picture(scene: &Scene, eye: &EyeView, visibility: &[f32]) -> Option<String> {
    let (width, height) = (eye.width, eye.height);
    (width.max(height) <= LOOKED_AT_MAX).then(|| {
        let frame = Frame::new(scene.image, &Pixels::new(&eye.pixels), &cosines(scene, eye), visibility);
        base64::encode(&shaded_png(width, height, &frame.visibility, &frame.cosine))
    })
}

/// Every `step`th visibility.
fn every_number(step: usize, visibility: &[f32]) -> Vec<f64> {
    visibility.iter().step_by(step).copied().map(number).collect()
}

/// Every `step`th receiver of a view.
fn every(step: usize, eye: &EyeView) -> EyeView {
    EyeView {
        width: eye.width,
        height: eye.height,
        points: eye.points.iter().step_by(step).copied().collect(),
        normals: eye.normals.iter().step_by(step).copied().collect::<Vec<Vec3>>(),
        triangles: eye.triangles.iter().step_by(step).copied().collect(),
        pixels: eye.pixels.iter().step_by(step).copied().collect(),
    }
}

fn off(truth: &[f64], ours: &[f64]) -> Off {
    let differences = || truth.iter().zip(ours).map(|(a, b)| (a - b).abs());
    Off {
        receivers: truth.len() as u64,
        max: differences().fold(0.0, f64::max),
        mean: differences().sum::<f64>() / truth.len().max(1) as f64,
        off: differences().filter(|difference| *difference > SLIGHT).count() as u64,
    }
}

fn off_rays(truth: &Truth, ours: &[f64]) -> OffRays {
    let metrics = ErrorMetrics::new(&truth.visibility(), ours);
    let doubt: f64 = truth.doubt().iter().sum();
    let part = |sum: f64, count: usize| if count == 0 { 0.0 } else { sum / count as f64 };
    OffRays {
        receivers: ours.len() as u64,
        shadowed: metrics.shadowed as u64,
        mean: metrics.atty_mae,
        max: metrics.max,
        off_by_quarter: part(metrics.off_by_quarter as f64, metrics.in_question),
        reference_mean: part(doubt, metrics.shadowed),
    }
}
