//! Alias-free shadow maps with samples of the light: sample by sample against rays in f64, and pictures.

mod common;

use common::{
    Lanewise, draw, evaluate, input, on, one_of_each_kind, random_scene, ray_hits, same_on_all_back_ends,
    shipped, sphere, turned, under_a_point,
};
use lrbsim_isa::Vpu;
use lrbsim_kernels::light::View;
use lrbsim_kernels::samples::{places, turns};
use lrbsim_kernels::sintorn::Sintorn;
use lrbsim_kernels::sism::Sism;
use lrbsim_workloads::glam::{DVec2, DVec3};
use lrbsim_workloads::reference::{ErrorMetrics, Truth};
use lrbsim_workloads::{Adjacency, Light, LightShape, Outline, ShadowInput};

/// The vectors along a light as receivers see it.
#[derive(Clone)]
struct Spans {
    shape: LightShape,
    radius: f32,
}

impl Lanewise<3, 6> for Spans {
    #[inline(always)]
    fn eval<V: Vpu>(&self, v: &mut V, receiver: [V::F32; 3]) -> [V::F32; 6] {
        let per_radius = v.vset_f32(1.0 / self.radius);
        let view = View::new(v, &self.shape, receiver, per_radius);
        let [[a, b, c], [d, e, f]] = view.spans(v, self.radius);
        [a, b, c, d, e, f]
    }
}

/// Compares the number of hidden samples of each receiver with rays to them, but for those that pass a border too closely; how many
/// receivers have some hidden and some not.
fn agree(what: &str, input: &ShadowInput) -> usize {
    let outline = input.light_shape.outline();
    let (places, turns) = (places(outline, 64), turns(outline));
    let spans = evaluate(&Spans { shape: input.light_shape, radius: input.light_radius }, &input.receivers);
    let drawn = draw(&Sintorn, "samples=64", input, on()).visibility;
    let (mut partly, mut untold) = (0, 0);
    for (receiver, visible) in drawn.iter().enumerate() {
        let [s, t] = [0, 3].map(|k| DVec3::from(core::array::from_fn(|i| f64::from(spans[receiver][k + i]))));
        let samples = turned(&places, &turns, input.receiver_pixel.at(receiver));
        let hits: Vec<Option<bool>> =
            samples.iter().map(|place| ray_hits(input, receiver, s * place.x + t * place.y)).collect();
        let least = hits.iter().filter(|hit| **hit == Some(true)).count();
        let doubts = hits.iter().filter(|hit| hit.is_none()).count();
        let hidden = (64.0 - visible * 64.0) as usize;
        assert!(
            (least..=least + doubts).contains(&hidden),
            "{what}, receiver {receiver}: {hidden} samples, by rays {least} and up to {doubts} more"
        );
        partly += usize::from(hidden > 0 && hidden < 64);
        untold += doubts;
    }
    assert!(untold * 10 < 64 * drawn.len(), "{what}: {untold} rays pass a border too closely to tell");
    partly
}

#[test]
fn samples_are_hidden_that_rays_to_them_say() {
    let mut partly = 0;
    for seed in 0..4 {
        let (mesh, receivers) = random_scene(seed, 200);
        for radius in [1e-3, 0.02, 0.1, 0.4, 2.0] {
            for light in one_of_each_kind(sphere(radius)) {
                let what = format!("seed {seed}, {light:?}");
                partly += agree(&what, &input(mesh.clone(), light, &receivers));
            }
        }
    }
    println!("{partly} receivers in penumbras");
    assert!(partly > 5_000, "{partly}");
}

#[test]
fn under_a_point_it_draws_the_hard_shadow_but_for_ties() {
    for name in ["tiny", "table", "saloon-small"] {
        let (scene, eye, _) = shipped(name, Some((160, 120)));
        let input = under_a_point(&scene, &eye);
        let ours = draw(&Sintorn, "", &input, on()).visibility;
        let hard = draw(&Sism, "", &input, on()).visibility;
        let off = ours.iter().zip(&hard).filter(|(a, b)| a != b).count();
        println!("{name}: {off} of {} differ", ours.len());
        assert!(off * 2000 <= ours.len(), "{name}: {off} of {} differ", ours.len());
    }
}

#[test]
fn its_error_is_that_of_its_samples() {
    let (mut scene, eye, _) = shipped("saloon-small", Some((64, 48)));
    let adjacency = Adjacency::new(&scene.mesh);
    // A light so large that silhouettes of its middle say little.
    scene.light = Light::Sphere { center: scene.light.center(), radius: 5.0 * scene.light.radius() };
    let truth = Truth::new(&scene.mesh, &scene.light, &eye, 2048, &|| ()).visibility();
    let input = ShadowInput::new(&scene, &adjacency, &eye);
    let errors = ["64", "256", "1024"].map(|samples| {
        let ours = draw(&Sintorn, &format!("samples={samples}"), &input, on()).visibility;
        let ours: Vec<f64> = ours.into_iter().map(f64::from).collect();
        let metrics = ErrorMetrics::new(&truth, &ours);
        println!("{samples}: {metrics:?}");
        assert!(metrics.bias.abs() < 0.2 * metrics.atty_mae, "{samples}: {metrics:?}");
        metrics.atty_mae
    });
    // 16 times the samples: less than a quarter of the error, which they would have if they were drawn by lot.
    assert!(errors[2] < errors[0] / 4.0 && errors[2] < 0.003, "{errors:?}");
}

#[test]
fn it_is_the_same_on_all_back_ends_and_its_tasks_are_short() {
    let (_, _, input) = shipped("tiny", Some((120, 90)));
    same_on_all_back_ends(&Sintorn, "samples=64", &input);
    same_on_all_back_ends(&Sintorn, "samples=256", &input);
}

#[test]
fn places_are_as_many_as_asked_for_and_lie_about_the_middle() {
    // Those of a triangle are half of a square's, whose bits are not the same about the diagonal.
    for (outline, most) in
        [(Outline::Disc, 0.25), (Outline::Square, 0.25), (Outline::Triangle, 0.6), (Outline::Line, 0.25)]
    {
        for count in [64, 128, 1024_u32] {
            let places = places(outline, count);
            assert_eq!(places.len(), count as usize, "{outline:?}");
            let mean = places.iter().sum::<DVec2>() / f64::from(count);
            println!("{outline:?}, {count}: middle off by {mean}");
            assert!(mean.length() < most / f64::from(count).sqrt(), "{outline:?}, {count}: {mean}");
            let reach2 = places.iter().map(|place| place.length_squared()).fold(0.0, f64::max);
            assert!(reach2 < f64::from(outline.reach2()), "{outline:?}, {count}: {reach2}");
            for (i, a) in places.iter().enumerate() {
                let apart = |b: &DVec2| a.distance(*b) > 0.1 / f64::from(count);
                assert!(places[..i].iter().all(apart), "{outline:?}: {a}");
            }
        }
    }
}
