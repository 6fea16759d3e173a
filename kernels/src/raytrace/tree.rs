//! The tree: a binary hierarchy of boxes over the triangles in the order of the curve.
//!
//! It is complete: node n has the children 2n and 2n + 1, the leaves are the last half of the nodes, and each holds four
//! triangles that follow one another. So no node says where its children are, and what comes after a node in depth first order is
//! arithmetic: a ray that misses a box goes on without a stack. Leaves beyond the last triangle have boxes that nothing hits.

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Addr, Compare, Kernel, Runner, Step, Stopped, Vpu};

use crate::columns::{lanes_below, task_range};
use crate::expression::{each, int, scalar};
use crate::field;
use crate::irregular::FAR;
use crate::plane::{PLANE_SLACK, cross, plane_slack, sub};
use crate::record::{Records, words};
use crate::scene::{Scene, Triangle};

/// Triangles of a leaf.
pub const LEAF: u32 = 4;

/// Triangles of a task that makes leaves.
const TASK: u32 = 256;

/// Nodes of a level up to which one task makes it and all levels above.
const TOP: u32 = 512;

/// A box: half a line, so that both children of a node lie in one.
#[repr(C)]
pub struct Node {
    /// Its corner with the least coordinates.
    pub low: [f32; 3],
    /// Its corner with the greatest.
    pub high: [f32; 3],
    padding: [u32; 2],
}

/// A triangle as rays are tested against it: one line.
#[repr(C, align(64))]
pub struct RayTriangle {
    /// Its first corner.
    pub corner: [f32; 3],
    /// The sides from there to the second and to the third.
    pub sides: [[f32; 3]; 2],
    /// How far from the triangle's plane, times the length of its normal, a receiver must lie to be shadowed by it:
    /// [`plane_slack`].
    pub slack: f32,
    /// Its number; `u32::MAX` where the leaf has fewer triangles.
    pub number: u32,
}

/// The tree of a frame.
#[derive(Clone, Copy)]
pub struct Tree {
    /// Nodes; the root is number 1.
    pub nodes: Records<Node>,
    /// Number of leaves, a power of two; the number of the first of them, too.
    pub leaves: u32,
    /// Triangles in the order of the leaves, four each.
    pub triangles: Records<RayTriangle>,
}

impl Tree {
    /// Builds the tree over triangles in the `order` of their numbers. `largest`: the largest coordinate.
    pub(super) fn build(
        scene: &Scene,
        order: Addr,
        largest: f32,
        runner: &mut Runner<'_>,
    ) -> Result<Tree, Stopped> {
        let leaves = scene.triangle_count.div_ceil(LEAF).max(2).next_power_of_two();
        let nodes = Records::overwritten(runner.arena, u64::from(2 * leaves) + 16);
        let triangles = Records::overwritten(runner.arena, u64::from((LEAF * leaves).next_multiple_of(16)));
        let tree = Tree { nodes, leaves, triangles };
        let kernel = Leaves { scene: *scene, order, slack: largest * PLANE_SLACK, tree };
        // SAFETY: each task writes its own triangles, and the boxes of its own leaves.
        runner.run(&unsafe { Step::independent("leaves", (LEAF * leaves).div_ceil(TASK), kernel) })?;
        let mut level = leaves / 2;
        while level > TOP {
            let kernel = Level { tree, level };
            // SAFETY: each task writes its own nodes of the level, and reads those of the level below.
            runner.run(&unsafe { Step::independent("tree level", level.div_ceil(TASK), kernel) })?;
            level /= 2;
        }
        runner.run(&Step::ordered("tree top", 1, Top { tree, level }))?;
        Ok(tree)
    }
}

/// Makes the leaves: triangles as rays are tested against them, and boxes of four each.
struct Leaves {
    scene: Scene,
    order: Addr,
    /// How much larger boxes are than their triangles, for the rounding of rays.
    slack: f32,
    tree: Tree,
}

impl Kernel for Leaves {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let Leaves { scene, order, tree, .. } = self;
        let (mut i, end) = task_range(v, task, TASK, LEAF * tree.leaves);
        let lane = v.viota();
        let none = v.vset_i32(0);
        let count = v.s_imm(scene.triangle_count as i32);
        let record_words = v.vset_i32(words::<RayTriangle>() as i32);
        let node_words = v.vset_i32(words::<Node>() as i32);
        let first_leaf = v.vset_i32(tree.leaves as i32);
        let leaf_log2 = v.vset_i32(LEAF.trailing_zeros() as i32);
        let (far, slack) = (v.vset_f32(FAR), v.vset_f32(self.slack));
        let minus_far = v.vset_f32(-FAR);
        let no_number = v.vset_i32(-1);
        let firsts = v.s_imm(0x1111);
        let firsts = v.kmov_from_scalar(firsts);
        while v.branch(Compare::Less, i, end) {
            let all = lanes_below(v, i, end);
            let is_past = v.branch(Compare::LessEqual, count, i);
            let live = if is_past { v.mask_none() } else { lanes_below(v, i, count) };
            let number = v.vload_i32_or(none, live, *order, i);
            let corners = each!(k in [0, 1, 2] => {
                v.vgather_i32_or(none, live, scene.triangles.column(field!(Triangle.corners[k])), number)
            });
            let [a, b, c] = each!(k in [0, 1, 2] => scene.positions(v, live, corners[k]));
            let sides = [sub(v, b, a), sub(v, c, a)];
            let normal = cross(v, sides[0], sides[1]);
            let plane_slack = plane_slack(v, [a, b, c], normal);
            let place = v.vsplat(i);
            let place = int!(v, place + lane);
            let at = int!(v, place * record_words);
            let triangles = tree.triangles;
            for axis in 0..3 {
                v.vscatter_f32(all, triangles.field(field!(RayTriangle.corner[axis])), at, a[axis]);
                for (k, side) in sides.iter().enumerate() {
                    v.vscatter_f32(all, triangles.field(field!(RayTriangle.sides[k][axis])), at, side[axis]);
                }
            }
            v.vscatter_f32(all, triangles.field(field!(RayTriangle.slack)), at, plane_slack);
            let named = v.vblend_i32(live, number, no_number);
            v.vscatter_i32(all, triangles.field(field!(RayTriangle.number)), at, named);

            let leaf = int!(v, (first_leaf + (place >> leaf_log2)) * node_words);
            let boxes = v.kand(all, firsts);
            for axis in 0..3 {
                let low = v.vmin(a[axis], b[axis]);
                let low = v.vmin(low, c[axis]);
                let low = v.vsub_or(far, live, low, slack);
                let other = v.vswizzle_cdab(low);
                let low = v.vmin(low, other);
                let other = v.vswizzle_badc(low);
                let low = v.vmin(low, other);
                v.vscatter_f32(boxes, tree.nodes.field(field!(Node.low[axis])), leaf, low);
                let high = v.vmax(a[axis], b[axis]);
                let high = v.vmax(high, c[axis]);
                let high = v.vadd_or(minus_far, live, high, slack);
                let other = v.vswizzle_cdab(high);
                let high = v.vmax(high, other);
                let other = v.vswizzle_badc(high);
                let high = v.vmax(high, other);
                v.vscatter_f32(boxes, tree.nodes.field(field!(Node.high[axis])), leaf, high);
            }
            i = scalar!(v, i + 16);
        }
    }
}

/// Makes the nodes of a level from those below.
struct Level {
    tree: Tree,
    /// Number of nodes of the level; the number of the first of them, too.
    level: u32,
}

impl Kernel for Level {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let (first, end) = task_range(v, task, TASK, self.level);
        let level = v.s_imm(self.level as i32);
        self.tree.unite(v, level, first, end);
    }
}

/// Makes the nodes of a level and of all above it.
struct Top {
    tree: Tree,
    /// Number of nodes of the lowest of these levels.
    level: u32,
}

impl Kernel for Top {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, first: V::S32) {
        let mut level = v.s_imm(self.level as i32);
        while v.branch(Compare::Less, first, level) {
            self.tree.unite(v, level, first, level);
            level = scalar!(v, level >> 1);
        }
    }
}

impl Tree {
    /// Makes nodes `first..end` of the level that has `level` nodes.
    #[inline(always)]
    fn unite<V: Vpu>(&self, v: &mut V, level: V::S32, first: V::S32, end: V::S32) {
        let lane = v.viota();
        let zero = v.vset_f32(0.0);
        let one = v.vset_i32(1);
        let node_words = v.vset_i32(words::<Node>() as i32);
        let mut i = first;
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let node = scalar!(v, level + i);
            let node = v.vsplat(node);
            let node = int!(v, node + lane);
            let to = int!(v, node * node_words);
            let left = int!(v, to << one);
            let right = int!(v, left + node_words);
            for axis in 0..3 {
                let low = self.nodes.field(field!(Node.low[axis]));
                let [a, b] = each!(child in [left, right] => v.vgather_f32_or(zero, live, low, child));
                let least = v.vmin(a, b);
                v.vscatter_f32(live, low, to, least);
                let high = self.nodes.field(field!(Node.high[axis]));
                let [a, b] = each!(child in [left, right] => v.vgather_f32_or(zero, live, high, child));
                let greatest = v.vmax(a, b);
                v.vscatter_f32(live, high, to, greatest);
            }
            i = scalar!(v, i + 16);
        }
    }
}
