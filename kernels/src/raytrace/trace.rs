//! Packets of 16 shadow rays through the tree, one a receiver.
//!
//! Receivers of a packet are neighbors in the picture and aim at neighbors on the light, so that their rays visit much the same
//! nodes. A packet visits a node that any of its rays needs; rays that have hit something are masked off.

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use core::f64::consts::TAU;

use lrbsim_isa::{Addr, Arena, Compare, Kernel, Runner, Step, Stopped, Vpu, math};
use lrbsim_workloads::Outline;
use lrbsim_workloads::glam::DVec2;

use super::tree::{LEAF, Node, RayTriangle, Tree};
use crate::clear;
use crate::columns::{Columns, lanes_below};
use crate::expression::{each, int, scalar};
use crate::field;
use crate::irregular::primitives::LightConstants;
use crate::irregular::receivers::{Receiver, Receivers};
use crate::light::View;
use crate::plane::{Vec3, dot, sub};
use crate::record::Record;
use crate::samples::{TRIANGLE_OFFSET, resolve, rotated, turn_of};
use crate::scene::fill;
use crate::segment::Vec2;

/// Directions that the pattern of rays is turned to, from pixel to pixel.
const TURNS: u32 = 256;

/// Least component of a ray's direction: what is less is taken for it, since boxes are met by dividing.
const COMPONENT_MIN: f32 = 1e-18;

/// A ray of the pattern: the direction of its place on a disc; its place in the unit square on other lights.
#[repr(C)]
struct PatternRay {
    place: [f32; 2],
}

/// A direction that the pattern is turned to.
#[repr(C)]
struct Turn {
    direction: [f32; 2],
}

/// The rays to a light.
#[derive(Clone, Copy)]
pub struct Rays {
    light: LightConstants,
    /// Number of rays of a receiver.
    count: u32,
    pattern: Columns<PatternRay>,
    turns: Columns<Turn>,
}

impl Rays {
    /// Puts the pattern of `count` rays into the arena, untimed: constants of the program.
    pub fn new(arena: &mut Arena, light: &LightConstants, count: u32) -> Rays {
        let golden = core::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
        let even = |k: u32| f64::from(k) / f64::from(count);
        let reversed = |k: u32| f64::from(k.reverse_bits()) / 4_294_967_296.0;
        let places = (0..count).map(|k| match light.shape.outline() {
            Outline::Disc => DVec2::from_angle(f64::from(k) * golden),
            Outline::Square | Outline::Triangle => DVec2::new(even(k), reversed(k)),
            Outline::Line => DVec2::new(even(k), 0.0),
        });
        let directions = (0..TURNS).map(|k| DVec2::from_angle(TAU * f64::from(k) / f64::from(TURNS)));
        let pattern = Columns::overwritten(arena, count);
        let turns = Columns::overwritten(arena, TURNS);
        let bits = |x: f64| (x as f32).to_bits();
        for axis in 0..2 {
            fill(
                arena,
                pattern.column(field!(PatternRay.place[axis])),
                places.clone().map(|p| bits(p[axis])),
            );
            fill(
                arena,
                turns.column(field!(Turn.direction[axis])),
                directions.clone().map(|p| bits(p[axis])),
            );
        }
        Rays { light: *light, count, pattern, turns }
    }

    /// Where ray `number` of 16 receivers meets the light, in radii or half sides: rings of equal areas, or strips. `random`: two
    /// numbers in [0, 1) and a direction for each receiver.
    #[inline(always)]
    fn place<V: Vpu>(&self, v: &mut V, number: V::S32, random: &Random<V>) -> Vec2<V> {
        let [x, y] = each!(axis in [0, 1] => v.vbroadcast_f32(self.pattern.column(field!(PatternRay.place[axis])), number));
        let per_count = v.vset_f32(1.0 / self.count as f32);
        match self.light.shape.outline() {
            Outline::Disc => {
                let number = v.vsplat(number);
                let number = v.vcvt_i32_f32(number);
                let part = v.vadd(number, random.parts[0]);
                let part = v.vmul(part, per_count);
                let radius = math::sqrt(v, part);
                let turned = rotated(v, [x, y], random.turn);
                each!(axis in [0, 1] => v.vmul(turned[axis], radius))
            }
            outline => {
                let (one, two) = (v.vset_f32(1.0), v.vset_f32(2.0));
                let shift = if outline == Outline::Line {
                    v.vmul(random.parts[0], per_count)
                } else {
                    random.parts[0]
                };
                let shifts = [shift, random.parts[1]];
                let shifted = each!(axis in [0, 1] => {
                    let place = [x, y][axis];
                    let place = v.vadd(place, shifts[axis]);
                    let whole = v.vfloor(place);
                    let part = v.vsub(place, whole);
                    v.vmsub(part, two, one)
                });
                match outline {
                    Outline::Triangle => folded(v, shifted),
                    Outline::Line => [shifted[0], v.vset_f32(0.0)],
                    _ => shifted,
                }
            }
        }
    }
}

/// The places on a triangle of those on a square, about whose middle the half that does not belong to the triangle is folded over.
#[inline(always)]
fn folded<V: Vpu>(v: &mut V, [x, y]: Vec2<V>) -> Vec2<V> {
    let (zero, offset) = (v.vset_f32(0.0), v.vset_f32(TRIANGLE_OFFSET as f32));
    let sum = v.vadd(x, y);
    let outside = v.vcmp_gt(sum, zero);
    each!(axis in [0, 1] => {
        let place = v.vsub_or([x, y][axis], outside, zero, [x, y][axis]);
        v.vadd(place, offset)
    })
}

/// What is drawn by lot for 16 receivers, by their pixels.
struct Random<V: Vpu> {
    parts: [V::F32; 2],
    turn: Vec2<V>,
}

/// Traces all rays: visible part of the light by pixel to `visibility`.
pub(super) fn trace(
    tree: &Tree,
    receivers: Receivers,
    rays: Rays,
    visibility: Addr,
    runner: &mut Runner<'_>,
) -> Result<(), Stopped> {
    let [hidden] = clear::zeroed(runner, [u64::from(receivers.count) + 16])?;
    // A task is a packet, tens of thousands of uops among as many triangles, as long as packets can be numbered.
    let groups = receivers.count.div_ceil(16);
    let tasks_log2 = tasks_log2(groups, rays.count);
    let kernel = Trace { tree: *tree, receivers, rays, tasks_log2, hidden };
    // SAFETY: all tasks of a receiver add to its count, in any order.
    runner.run(&unsafe { Step::independent("trace", groups << tasks_log2, kernel) })?;
    resolve(receivers, rays.count, hidden, visibility, runner)
}

/// Tasks of each of `groups` groups of receivers that have `rays` rays each, by their logarithm: as many as rays, if all can be numbered.
pub fn tasks_log2(groups: u32, rays: u32) -> u32 {
    rays.next_power_of_two().ilog2().min(groups.leading_zeros().saturating_sub(1))
}

/// Traces rays of 16 receivers, one of each after the other.
struct Trace {
    tree: Tree,
    receivers: Receivers,
    rays: Rays,
    /// Tasks of the same receivers, by their logarithm: each has every so many-th ray.
    tasks_log2: u32,
    /// Rays of each receiver that have hit something.
    hidden: Addr,
}

/// Sixteen rays.
pub struct Packet<V: Vpu> {
    /// Where the rays begin, light-centred.
    origin: Vec3<V>,
    /// From there to the light, as far as it is.
    direction: Vec3<V>,
    /// One over its components.
    inverse: Vec3<V>,
    /// The origin times these.
    offset: Vec3<V>,
    /// Rays that run down each axis: they enter a box at its high side.
    down: [V::Mask; 3],
    /// Triangles that the rays begin on.
    own: V::I32,
}

impl Kernel for Trace {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let Trace { rays, receivers, .. } = self;
        let i = scalar!(v, (task >> { self.tasks_log2 as i32 }) << 4);
        let mut ray = scalar!(v, task & { (1 << self.tasks_log2) - 1 });
        let count = v.s_imm(rays.count as i32);
        if v.branch(Compare::LessEqual, count, ray) {
            return;
        }
        let end = v.s_imm(receivers.count as i32);
        let live = lanes_below(v, i, end);
        let one = v.vset_f32(1.0);
        let none = v.vset_i32(0);
        let columns = receivers.columns;
        let origin = each!(axis in [0, 1, 2] => {
            v.vload_f32_or(one, live, columns.column(field!(Receiver.position[axis])), i)
        });
        let own = v.vload_i32_or(none, live, columns.column(field!(Receiver.triangle)), i);
        loop {
            let target = if rays.light.is_soft() {
                let per_radius = v.vset_f32(1.0 / rays.light.radius);
                let view = View::new(v, &rays.light.shape, origin, per_radius);
                let random = self.random(v, live, i);
                let place = rays.place(v, ray, &random);
                view.point(v, place, rays.light.radius)
            } else {
                let middle = v.vset_f32(0.0);
                [middle; 3]
            };
            let packet = packet(v, origin, target, own);
            let hits = self.hits(v, live, &packet);
            if v.branch_any(hits) {
                let one = v.vset_i32(1);
                let lane = v.viota();
                let receiver = v.vsplat(i);
                let receiver = int!(v, receiver + lane);
                v.vatomic_add_or(none, hits, self.hidden, receiver, one);
            }
            if rays.count <= 1 << self.tasks_log2 {
                break;
            }
            ray = scalar!(v, ray + { 1 << self.tasks_log2 });
            if v.branch(Compare::LessEqual, count, ray) {
                break;
            }
        }
    }
}

/// Rays from `origin` to `target`, light-centred, that begin on the triangles of the numbers `own`.
#[inline(always)]
pub fn packet<V: Vpu>(v: &mut V, origin: Vec3<V>, target: Vec3<V>, own: V::I32) -> Packet<V> {
    let direction = sub(v, target, origin);
    let least = v.vset_f32(COMPONENT_MIN);
    let inverse = each!(axis in [0, 1, 2] => {
        let size = v.vabs(direction[axis]);
        let is_least = v.vcmp_lt(size, least);
        let component = v.vblend_f32(is_least, least, direction[axis]);
        v.vrcp(component)
    });
    let offset = each!(axis in [0, 1, 2] => v.vmul(origin[axis], inverse[axis]));
    let zero = v.vset_f32(0.0);
    let down = each!(axis in [0, 1, 2] => v.vcmp_lt(inverse[axis], zero));
    Packet { origin, direction, inverse, offset, down, own }
}

impl Trace {
    /// What is drawn by lot for the 16 receivers from `i` on.
    #[inline(always)]
    fn random<V: Vpu>(&self, v: &mut V, live: V::Mask, i: V::S32) -> Random<V> {
        let none = v.vset_i32(0);
        let zero = v.vset_f32(0.0);
        let pixel = v.vload_i32_or(none, live, self.receivers.columns.column(field!(Receiver.pixel)), i);
        // Two sequences of the plastic number, one of the golden section: all by the pixel.
        let eight = v.vset_i32(8);
        let unit = v.vset_f32(1.0 / (1 << 24) as f32);
        let parts = each!(factor in [0xc13f_a9a9_u32, 0x91e1_0da5_u32] => {
            let factor = v.vset_i32(factor as i32);
            let bits = int!(v, (pixel * factor) >> eight);
            let part = v.vcvt_i32_f32(bits);
            v.vmul(part, unit)
        });
        let turn = turn_of(v, pixel, TURNS);
        let turn = each!(axis in [0, 1] => {
            v.vgather_f32_or(zero, live, self.rays.turns.column(field!(Turn.direction[axis])), turn)
        });
        Random { parts, turn }
    }

    /// The rays of `live` that hit something. Depth first through the tree; a node's successor is known by its number.
    #[inline(always)]
    fn hits<V: Vpu>(&self, v: &mut V, live: V::Mask, packet: &Packet<V>) -> V::Mask {
        let tree = &self.tree;
        let root = v.s_imm(1);
        let first_leaf = v.s_imm(tree.leaves as i32);
        let ones = v.s_imm(-1);
        let mut searching = live;
        let mut node = root;
        loop {
            let record = tree.nodes.record(v, node);
            let meets = meets(v, searching, packet, record);
            let is_met = v.branch_any(meets);
            if is_met && v.branch(Compare::Less, node, first_leaf) {
                node = scalar!(v, node << 1);
                continue;
            }
            if is_met {
                let mut at = scalar!(v, (node - first_leaf) << { LEAF.trailing_zeros() as i32 });
                let end = scalar!(v, at + { LEAF as i32 });
                while v.branch(Compare::Less, at, end) {
                    let triangle = tree.triangles.record(v, at);
                    let hit = hit(v, meets, packet, triangle);
                    searching = v.kandn(hit, searching);
                    at = scalar!(v, at + 1);
                }
                if !v.branch_any(searching) {
                    break;
                }
            }
            // Up as long as it is a right child, then to the right: the root comes after the last.
            let left_bits = v.s_xor(node, ones);
            let levels = v.s_tzcnt(left_bits);
            node = scalar!(v, (node >> levels) + 1);
            if v.branch(Compare::Equal, node, root) {
                break;
            }
        }
        v.kandn(searching, live)
    }
}

/// The rays of `live` that meet a box between their ends. None meets a box whose low side is above its high side.
#[inline(always)]
fn meets<V: Vpu>(v: &mut V, live: V::Mask, packet: &Packet<V>, node: Record<V, Node>) -> V::Mask {
    let low = node.vec3(v, field!(Node.low));
    let high = node.vec3(v, field!(Node.high));
    let (mut enter, mut leave) = (v.vset_f32(0.0), v.vset_f32(1.0));
    for axis in 0..3 {
        let first = v.vblend_f32(packet.down[axis], high[axis], low[axis]);
        let last = v.vblend_f32(packet.down[axis], low[axis], high[axis]);
        let first = v.vmsub(first, packet.inverse[axis], packet.offset[axis]);
        let last = v.vmsub(last, packet.inverse[axis], packet.offset[axis]);
        enter = v.vmax(enter, first);
        leave = v.vmin(leave, last);
    }
    v.vcmp_le_masked(live, enter, leave)
}

/// The rays of `live` that hit a triangle between their ends (Möller and Trumbore 1997), without a division. 52 operations.
#[inline(always)]
pub fn hit<V: Vpu>(
    v: &mut V,
    live: V::Mask,
    packet: &Packet<V>,
    triangle: Record<V, RayTriangle>,
) -> V::Mask {
    let corner = triangle.vec3(v, field!(RayTriangle.corner));
    let side = triangle.vec3(v, field!(RayTriangle.sides[0]));
    let other = triangle.vec3(v, field!(RayTriangle.sides[1]));
    let zero = v.vset_f32(0.0);
    let across = cross(v, packet.direction, other);
    let volume = dot(v, side, across);
    let from = sub(v, packet.origin, corner);
    let along_side = dot(v, from, across);
    let over = cross(v, from, side);
    let along_other = dot(v, packet.direction, over);
    let distance = dot(v, other, over);
    // All four have the sign of the side that the ray comes from.
    let sign_bit = v.vset_i32(i32::MIN);
    let sign = v.bits_of(volume);
    let sign = v.vand(sign, sign_bit);
    let [along_side, along_other, distance] = each!(x in [along_side, along_other, distance] => {
        let bits = v.bits_of(x);
        let bits = v.vxor(bits, sign);
        v.from_bits(bits)
    });
    let volume = v.vabs(volume);
    let inside = v.vcmp_ge_masked(live, along_side, zero);
    let inside = v.vcmp_ge_masked(inside, along_other, zero);
    let both = v.vadd(along_side, along_other);
    let inside = v.vcmp_le_masked(inside, both, volume);
    let slack = triangle.float(v, field!(RayTriangle.slack));
    let inside = v.vcmp_gt_masked(inside, distance, slack);
    let inside = v.vcmp_lt_masked(inside, distance, volume);
    let number = triangle.number(v, field!(RayTriangle.number));
    v.vicmp_neq_masked(inside, number, packet.own)
}

/// The cross product `a x b` in every lane, with fused operations.
#[inline(always)]
fn cross<V: Vpu>(v: &mut V, a: Vec3<V>, b: Vec3<V>) -> Vec3<V> {
    each!(axis in [0, 1, 2] => {
        let (j, k) = ((axis + 1) % 3, (axis + 2) % 3);
        let right = v.vmul(a[k], b[j]);
        v.vmsub(a[j], b[k], right)
    })
}
