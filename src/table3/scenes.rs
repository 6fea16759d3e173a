//! The scenes that each quality is measured on, with what is true of them.
//!
//! Every scene is a floor of 4 by 4, a lamp [`LAMP`] over it and something between; receivers are a window of the floor.

use core::f64::consts::{FRAC_PI_2, PI};

use lrbsim_reports::table3::Quality;
use lrbsim_workloads::glam::{DVec2, DVec3, Vec3};
use lrbsim_workloads::reference::{Occluders, Truth};
use lrbsim_workloads::{Adjacency, Camera, EyeView, ImageSize, Light, Scene};

use super::cases::{Case, View};
use crate::algorithm::Algorithm;
use crate::made::{self, Parts};

/// Shadow rays of a receiver where they are the truth: their own error is 0.002.
pub(super) const SAMPLES: u32 = 1024;

/// Half of the floor's side.
const FLOOR: f64 = 2.0;

/// Distance from both axes of the four receivers that make maps as large as for a picture of all of the floor.
const PIN: f64 = 1.9;

/// Width on the floor of a texel of the largest default map, were it as wide as the pins.
const TEXEL: f64 = 2.0 * PIN / 1024.0;

/// Middle of the lamp, but for the scenes that move it: over nothing that is a round number.
const LAMP: DVec3 = DVec3::new(0.013, 3.0, -0.007);

/// Radius of the lamp, and half of its sides or its length; over a sheet at height 1, as wide is the penumbra on the floor.
const RADIUS: f64 = 0.25;

/// Angle of edges to the axes, along which texels lie.
const SLANT: f64 = 0.37;

/// Whether a receiver that sees this part of the light is in a penumbra: rounding is none.
pub(super) fn in_penumbra(visible: f64) -> bool {
    const SLIGHT: f64 = 1e-3;
    (SLIGHT..=1.0 - SLIGHT).contains(&visible)
}

/// Kinds of lamps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lamp {
    /// A ball.
    Ball,
    /// A level rectangle along the axes.
    Rectangle,
    /// A level line along an axis.
    Line,
}

impl Lamp {
    /// The first kind of lamp that an algorithm draws; `None` if it draws none of them.
    pub fn of(algorithm: &Algorithm) -> Option<Lamp> {
        let draws = |lamp: &Lamp| algorithm.check_light(&lamp.light(LAMP, RADIUS)).is_ok();
        [Lamp::Ball, Lamp::Rectangle, Lamp::Line].into_iter().find(draws)
    }

    /// What the kind is called.
    pub fn name(self) -> &'static str {
        match self {
            Lamp::Ball => "ball",
            Lamp::Rectangle => "rectangle",
            Lamp::Line => "line",
        }
    }

    fn light(self, center: DVec3, radius: f64) -> Light {
        let [x, z] = [DVec3::X * radius, DVec3::Z * radius];
        match self {
            Lamp::Ball => Light::Sphere { center, radius },
            Lamp::Rectangle => Light::Rect { center, half_u: x, half_v: z },
            Lamp::Line => Light::Linear { p0: center - x, p1: center + x },
        }
    }
}

/// Receivers of the floor: a square of `side` by `side`, row by row, and four at the corners of the floor.
#[derive(Clone, Copy)]
struct Window {
    center: DVec2,
    half: f64,
    side: u32,
}

impl Window {
    fn receivers(&self) -> EyeView {
        let Window { center, half, side } = *self;
        let at = |i: u32| 2.0 * f64::from(i) / f64::from(side - 1) - 1.0;
        let inside = (0..side * side).map(|i| center + DVec2::new(at(i % side), at(i / side)) * half);
        let pins = [[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]].map(|pin| DVec2::from(pin) * PIN);
        let places: Vec<DVec2> = inside.chain(pins).collect();
        EyeView {
            width: side,
            height: side + 1,
            points: places.iter().map(|p| DVec3::new(p.x, 0.0, p.y)).collect(),
            normals: vec![Vec3::Y; places.len()],
            // The floor's two triangles, the first of the mesh, meet on its diagonal.
            triangles: places.iter().map(|p| u32::from(p.x >= p.y)).collect(),
            pixels: (0..places.len() as u32).collect(),
        }
    }

    /// Which receivers have only dark ones around them, as far as `margin`; beyond the window all counts as dark.
    fn dark_around(&self, truth: &[f64], margin: f64) -> Vec<bool> {
        let side = self.side as usize;
        let reach = (margin * (side - 1) as f64 / (2.0 * self.half)).ceil() as usize;
        let range = |at: usize| at.saturating_sub(reach)..(at + reach + 1).min(side);
        let is_dark = |x: usize, y: usize| {
            range(y).all(|row| truth[row * side..][range(x)].iter().all(|visible| *visible == 0.0))
        };
        (0..side * side).map(|i| is_dark(i % side, i / side)).collect()
    }
}

/// How it is found out what is true.
#[derive(Clone, Copy)]
enum By {
    /// By closed forms, where nothing overlaps.
    Form,
    /// By shadow rays.
    Rays,
}

/// The scene of `parts` over the floor, with what is true of it.
fn view(id: &str, parts: Parts, light: Light, window: Window, by: By) -> View {
    let image = ImageSize { width: window.side, height: window.side + 1 };
    // Nobody looks through it: receivers are given.
    let camera = Camera { eye: LAMP * 2.0, target: DVec3::ZERO, up: DVec3::Z, fov_y_degrees: 45.0 };
    let scene = made::scene(super::NAME, id, parts.finish(), light, (camera, image)).expect("a sound scene");
    let eye = window.receivers();
    let mut truth = match by {
        By::Form => {
            let adjacency = Adjacency::new(&scene.mesh);
            Occluders::from_mesh(&scene.mesh, &adjacency, &light).visibility_of_view(&adjacency, &eye)
        }
        By::Rays => rays(&scene, &light, &eye, SAMPLES),
    };
    truth.truncate((window.side * window.side) as usize);
    View { scene, eye, truth }
}

fn rays(scene: &Scene, light: &Light, eye: &EyeView, samples: u32) -> Vec<f64> {
    Truth::new(&scene.mesh, light, eye, samples, &|| ()).visibility()
}

fn floor() -> Parts {
    Parts::default().level("floor", DVec3::ZERO, FLOOR)
}

/// The point that lies `height` over the place `at` of the floor.
fn raised(at: DVec2, height: f64) -> DVec3 {
    DVec3::new(at.x, height, at.y)
}

/// The place at this height from which on the lamp's middle is seen over the middle of the floor.
fn over_origin(height: f64) -> DVec2 {
    DVec2::new(LAMP.x, LAMP.z) * (height / LAMP.y)
}

/// How wide the penumbra of an edge at this height is on the floor.
fn penumbra(radius: f64, height: f64) -> f64 {
    2.0 * radius * height / (LAMP.y - height)
}

/// A level sheet whose edge casts its hard shadow across the middle of the floor, but for `gap` that it lies back.
#[derive(Clone, Copy)]
struct Half {
    name: &'static str,
    /// Angle to the side where nothing is.
    angle: f64,
    gap: f64,
    height: f64,
}

impl Half {
    fn add_to(self, parts: Parts) -> Parts {
        let out = DVec2::from_angle(self.angle);
        let edge = over_origin(self.height) - out * self.gap;
        let corners = [(0.0, -0.7), (0.0, 0.7), (-1.3, 0.7), (-1.3, -0.7)];
        let corner = |(s, t): (f64, f64)| raised(edge + out * s + out.perp() * t, self.height);
        parts.quad(self.name, corners.map(corner))
    }
}

const LOW: Half = Half { name: "low sheet", angle: SLANT, gap: 0.0, height: 1.0 };
const HIGH: Half = Half { name: "high sheet", angle: SLANT, gap: 0.0, height: 1.4 };

/// All cases under a kind of lamp, quality by quality; `quick` looks at fewer receivers and moves.
pub fn cases(lamp: Lamp, quick: bool) -> Vec<Case> {
    let side = |side: u32| if quick { side / 2 } else { side };
    let mut cases = edge(lamp, side(40));
    let apart = |gap: f64, height: f64| gap * RADIUS * height / LAMP.y;
    let pairs = [
        ("nested", LOW, HIGH),
        ("crossing", LOW, Half { angle: SLANT + FRAC_PI_2, ..HIGH }),
        (
            "apart",
            Half { gap: apart(0.5, 1.0), ..LOW },
            Half { gap: apart(0.5, 1.4), angle: SLANT + PI, ..HIGH },
        ),
        ("closing", Half { angle: SLANT + 0.3, ..LOW }, Half { angle: SLANT + PI - 0.3, ..HIGH }),
    ];
    cases.extend(pairs.map(|(id, low, high)| overlap(lamp, id, low, high, side(40))));
    let steps = if quick { 4 } else { 12 };
    cases.extend(
        [("large lamp", RADIUS), ("small lamp", RADIUS / 12.5)]
            .map(|(id, radius)| motion(lamp, id, radius, steps, side(40))),
    );
    cases.extend(dark(lamp, side(48)));
    cases.extend([8.0, 4.0, 2.0, 1.0, 0.5].map(|width| grating(lamp, width, side(64))));
    cases
}

/// Inner and outer penumbra of one edge.
fn edge(lamp: Lamp, side: u32) -> Vec<Case> {
    let light = lamp.light(LAMP, RADIUS);
    let window = Window { center: DVec2::ZERO, half: 0.75 * penumbra(RADIUS, LOW.height), side };
    let view = view("edge", LOW.add_to(floor()), light, window, By::Form);
    let hard = rays(&view.scene, &Light::Point { center: LAMP }, &view.eye, 1);
    let case = |quality: Quality, inner: bool| {
        let asked = view.truth.iter().zip(&hard).map(|(v, hard)| in_penumbra(*v) && (*hard == 0.0) == inner);
        Case::new(quality, "edge", asked.collect(), vec![view.clone()])
    };
    vec![case(Quality::InnerPenumbra, true), case(Quality::OuterPenumbra, false)]
}

/// Two sheets, each of which alone hides a part of the light from the receivers that are asked.
fn overlap(lamp: Lamp, id: &str, low: Half, high: Half, side: u32) -> Case {
    let light = lamp.light(LAMP, RADIUS);
    let window = Window { center: DVec2::ZERO, half: 0.55 * penumbra(RADIUS, low.height), side };
    let alone = [low, high].map(|sheet| view(id, sheet.add_to(floor()), light, window, By::Form).truth);
    let asked = alone[0].iter().zip(&alone[1]).map(|(a, b)| in_penumbra(*a) && in_penumbra(*b)).collect();
    let both = view(id, high.add_to(low.add_to(floor())), light, window, By::Rays);
    Case::new(Quality::AccurateOverlap, id, asked, vec![both])
}

/// A straight edge under a lamp that moves: its shadow goes half a texel a step.
fn motion(lamp: Lamp, id: &str, radius: f64, steps: u32, side: u32) -> Case {
    let height = LOW.height;
    let window = Window { center: DVec2::ZERO, half: 0.8 * penumbra(radius, height) + 4.0 * TEXEL, side };
    let step = DVec2::from_angle(1.1) * (0.5 * TEXEL * (LAMP.y - height) / height);
    let views = (0..=steps).map(|k| {
        let center = LAMP + raised(step * f64::from(k), 0.0);
        view(id, LOW.add_to(floor()), lamp.light(center, radius), window, By::Form)
    });
    Case::new(Quality::NoAliasing, id, vec![true; (side * side) as usize], views.collect())
}

/// Umbras that nothing breaks.
fn dark(lamp: Lamp, side: u32) -> Vec<Case> {
    /// Radius of the lamp in these scenes: smaller than elsewhere, so that umbras are large.
    const RADIUS: f64 = 0.1;
    /// Half of a window whose receivers are 0.7 texels apart, or 1.5 where a quick study looks at fewer.
    const NEAR: f64 = 16.0 * TEXEL;
    let case = |id: &str, parts: Parts, center: DVec3, window: Window, top: f64| {
        let view = view(id, parts, lamp.light(center, RADIUS), window, By::Rays);
        let asked = window.dark_around(&view.truth, RADIUS * top / (center.y - top));
        Case::new(Quality::NoLightLeaks, id, asked, vec![view])
    };
    let window = |x: f64, z: f64, half: f64| Window { center: DVec2::new(x, z), half, side };
    let out = DVec2::from_angle(SLANT);
    let slanted = |s: f64, t: f64| {
        let along = DVec2::from_angle(PI / 3.0) * s;
        raised(out * along.x + out.perp() * t, 1.1 + along.y)
    };
    let sheet = || {
        floor()
            .quad("sheet", [(-0.7, -0.6), (-0.7, 0.6), (0.7, 0.6), (0.7, -0.6)].map(|(s, t)| slanted(s, t)))
    };
    let seam_at = DVec3::new(0.1, 1.2, 0.0);
    let seam = || floor().seam(seam_at, 7);
    // Where the middle of the seam, which is one of its corners, throws its shadow.
    let below = LAMP + (seam_at - LAMP) * (LAMP.y / (LAMP.y - seam_at.y));
    let (low, high) = (DVec3::new(-0.25, 0.0, -0.18), DVec3::new(0.25, 0.6, 0.18));
    vec![
        case("round body", floor().ball("body", DVec3::Y * 0.9, 0.5, 40), LAMP, window(0.0, 0.0, 0.8), 1.4),
        case("slanted sheet", sheet(), LAMP, window(0.2 * out.x, 0.2 * out.y, 0.7), 1.71),
        case("slanted sheet, near by", sheet(), LAMP, window(0.2 * out.x, 0.2 * out.y, NEAR), 1.71),
        case("seam", seam(), LAMP, window(0.1, 0.0, 0.8), 1.4),
        case("seam, near by", seam(), LAMP, window(below.x, below.z, NEAR), 1.4),
        // The window begins where the block stands.
        case(
            "foot of a block",
            floor().block("block", low, high),
            DVec3::new(1.0, 2.0, 0.1),
            window(low.x - 0.002 - 0.35, 0.0, 0.35),
            high.y,
        ),
    ]
}

/// Bars whose shadows are `width` texels wide, and as far apart, under a lamp whose penumbra is a quarter of a texel.
fn grating(lamp: Lamp, width: f64, side: u32) -> Case {
    const HEIGHT: f64 = 1.0;
    let light = lamp.light(LAMP, 0.25 * TEXEL * (LAMP.y - HEIGHT) / (2.0 * HEIGHT));
    let on_floor = width * TEXEL;
    let window = Window { center: DVec2::ZERO, half: 6.4 * on_floor, side };
    // The bars reach beyond the corners of the window.
    let bar = on_floor * (LAMP.y - HEIGHT) / LAMP.y;
    let out = DVec2::from_angle(SLANT);
    let parts = (-6..6).fold(floor(), |parts, k| {
        let corner = |s: f64, t: f64| {
            raised(over_origin(HEIGHT) + (out * (f64::from(2 * k) + s) + out.perp() * t) * bar, HEIGHT)
        };
        let corners = [corner(0.0, -12.0), corner(0.0, 12.0), corner(1.0, 12.0), corner(1.0, -12.0)];
        parts.quad(&format!("bar {k}"), corners)
    });
    let asked = vec![true; (side * side) as usize];
    Case::new(
        Quality::AllFrequencies,
        &width.to_string(),
        asked,
        vec![view("grating", parts, light, window, By::Form)],
    )
}
