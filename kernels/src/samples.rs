//! Samples of the light, each as much of it as any other, turned from pixel to pixel so that no pattern shows.

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Addr, Arena, Compare, Kernel, Runner, Step, Stopped, Vpu, math};
use lrbsim_workloads::Outline;
use lrbsim_workloads::glam::DVec2;
use lrbsim_workloads::reference::spiral;

use crate::columns::{Columns, lanes_below, task_range};
use crate::expression::{each, int, scalar};
use crate::field;
use crate::irregular::receivers::{Receiver, Receivers};
use crate::scene::fill;
use crate::segment::Vec2;

/// Directions that the samples are turned to.
const TURNS: u32 = 16;

/// Receivers of a task that resolves.
const TASK: u32 = 256;

/// Where the middle of the square that a triangle is half of lies, along either side of the triangle, in half sides from its middle.
pub const TRIANGLE_OFFSET: f64 = 1.0 / 3.0;

/// A sample of the light, in radii.
#[repr(C)]
struct LightSample {
    place: [f32; 2],
}

/// A direction that the samples are turned to.
#[repr(C)]
struct Turn {
    cos: f32,
    sin: f32,
}

/// The samples of the light, and the directions that they are turned to.
#[derive(Clone, Copy)]
pub struct LightSamples {
    /// Number of samples.
    pub count: u32,
    samples: Columns<LightSample>,
    turns: Columns<Turn>,
}

impl LightSamples {
    /// Puts `count` samples of a light of this outline into the arena, untimed: constants of the program.
    pub fn new(arena: &mut Arena, outline: Outline, count: u32) -> LightSamples {
        let samples = Columns::overwritten(arena, count);
        let places = places(outline, count);
        for axis in 0..2 {
            let values = places.iter().map(|place| (place[axis] as f32).to_bits());
            fill(arena, samples.column(field!(LightSample.place[axis])), values);
        }
        let turns = Columns::overwritten(arena, TURNS);
        let directions = self::turns(outline);
        fill(arena, turns.column(field!(Turn.cos)), directions.iter().map(|d| (d.x as f32).to_bits()));
        fill(arena, turns.column(field!(Turn.sin)), directions.iter().map(|d| (d.y as f32).to_bits()));
        LightSamples { count, samples, turns }
    }

    /// Number of groups of 16 samples.
    #[inline(always)]
    pub const fn groups(&self) -> usize {
        (self.count / 16) as usize
    }

    /// Cosine and sine of the angle that the samples of 16 receivers are turned by: by the pixel, so that a picture does not depend
    /// on the order of the receivers. `receiver`: their numbers.
    #[inline(always)]
    pub fn turn<V: Vpu>(
        &self,
        v: &mut V,
        receivers: Columns<Receiver>,
        live: V::Mask,
        receiver: V::I32,
    ) -> Vec2<V> {
        let none = v.vset_i32(0);
        let zero = v.vset_f32(0.0);
        let pixel = v.vgather_i32_or(none, live, receivers.column(field!(Receiver.pixel)), receiver);
        let turn = turn_of(v, pixel, TURNS);
        let cos = v.vgather_f32_or(zero, live, self.turns.column(field!(Turn.cos)), turn);
        let sin = v.vgather_f32_or(zero, live, self.turns.column(field!(Turn.sin)), turn);
        [cos, sin]
    }

    /// Group `group` of 16 samples of the light, one a lane, in radii.
    #[inline(always)]
    pub fn places<V: Vpu>(&self, v: &mut V, group: usize) -> Vec2<V> {
        let first = v.s_imm(group as i32 * 16);
        each!(axis in [0, 1] => v.vload_f32(self.samples.column(field!(LightSample.place[axis])), first))
    }

    /// Sample `number` of the light in every lane, in radii.
    #[inline(always)]
    pub fn place<V: Vpu>(&self, v: &mut V, number: V::S32) -> Vec2<V> {
        each!(axis in [0, 1] => {
            v.vbroadcast_f32(self.samples.column(field!(LightSample.place[axis])), number)
        })
    }
}

/// Turns how many of `count` samples are hidden from each receiver, word by word at `hidden`, into the visible parts of the light, by
/// pixel at `visibility`.
pub fn resolve(
    receivers: Receivers,
    count: u32,
    hidden: Addr,
    visibility: Addr,
    runner: &mut Runner<'_>,
) -> Result<(), Stopped> {
    let kernel = Resolve { receivers, count, hidden, visibility };
    // SAFETY: each task writes the pixels of its own receivers.
    runner.run(&unsafe { Step::independent("resolve", receivers.count.div_ceil(TASK), kernel) })
}

/// Turns counts into visible parts of the light.
struct Resolve {
    receivers: Receivers,
    /// Samples of the light.
    count: u32,
    /// Those that are hidden from each receiver.
    hidden: Addr,
    visibility: Addr,
}

impl Kernel for Resolve {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let (mut i, end) = task_range(v, task, TASK, self.receivers.count);
        let count = v.vset_f32(self.count as f32);
        let one = v.vset_f32(1.0);
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let hidden = v.vload_i32(self.hidden, i);
            let hidden = v.vcvt_i32_f32(hidden);
            let hidden = math::div(v, hidden, count);
            let visible = v.vsub(one, hidden);
            let pixel = v.vload_i32(self.receivers.columns.column(field!(Receiver.pixel)), i);
            v.vscatter_f32(live, self.visibility, pixel, visible);
            i = scalar!(v, i + 16);
        }
    }
}

/// Number of the turn of each pixel among `turns`, a power of two: by the golden section from one pixel to the next.
#[inline(always)]
pub fn turn_of<V: Vpu>(v: &mut V, pixel: V::I32, turns: u32) -> V::I32 {
    let golden = v.vset_i32(0x9e37_79b9_u32 as i32);
    let shift = v.vset_i32(32 - turns.trailing_zeros() as i32);
    int!(v, (pixel * golden) >> shift)
}

/// `place` turned by the angle of this cosine and sine.
#[inline(always)]
pub fn rotated<V: Vpu>(v: &mut V, [x, y]: Vec2<V>, [cos, sin]: Vec2<V>) -> Vec2<V> {
    let y_sin = v.vmul(y, sin);
    let y_cos = v.vmul(y, cos);
    [v.vmsub(x, cos, y_sin), v.vmadd(x, sin, y_cos)]
}

/// Places of `count` samples of a light: each stands for as much of it as any other. On a square and
/// a triangle their number must be a power of two.
pub fn places(outline: Outline, count: u32) -> Vec<DVec2> {
    let even = |i: u32| (2.0 * f64::from(i) + 1.0) / f64::from(count) - 1.0;
    match outline {
        Outline::Disc => spiral(count),
        // Even along one side, and along the other by the bits of the number read backward [hammersley60].
        Outline::Square => (0..count)
            .map(|i| DVec2::new(even(i), even(i.reverse_bits() >> (32 - count.trailing_zeros()))))
            .collect(),
        // The half of twice as many on a square that belongs to it. The other half is the same, turned about the middle.
        Outline::Triangle => places(Outline::Square, 2 * count)
            .into_iter()
            .filter(|place| place.x + place.y < 0.0 || place.x + place.y == 0.0 && place.x < 0.0)
            .map(|place| place + DVec2::splat(TRIANGLE_OFFSET))
            .collect(),
        Outline::Line => (0..count).map(|i| DVec2::new(even(i), 0.0)).collect(),
    }
}

/// Directions that the samples of a light are turned to, from pixel to pixel.
pub fn turns(outline: Outline) -> Vec<DVec2> {
    match outline {
        // Those of the spiral's own samples: no two alike, and evenly around.
        Outline::Disc => spiral(TURNS).into_iter().map(|place| place.normalize()).collect(),
        Outline::Square => [DVec2::X, DVec2::Y, DVec2::NEG_X, DVec2::NEG_Y].repeat(TURNS as usize / 4),
        // A triangle turns into itself by no turn, and a line by that of its ends, which changes nothing.
        Outline::Triangle | Outline::Line => vec![DVec2::X; TURNS as usize],
    }
}
