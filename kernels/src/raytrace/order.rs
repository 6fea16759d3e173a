//! Triangles along a Morton curve: codes of their centers, and a stable radix sort of these.
//!
//! ```text
//! centers        each task: centers of its triangles, and bounds of these
//! bounds         one task: bounds of all
//! codes          each task: 24 bits for each of its triangles, 8 an axis, interleaved
//! three times, for 8 bits each, the lowest first:
//!   count        each task: how many of its keys have each digit
//!   scan         where the keys of each task with each digit go
//!   move         each task: its keys, in their order, to their places
//! ```
//!
//! Counts are the tasks' own, so that the order does not depend on which task comes first.

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Addr, Compare, Kernel, Runner, Step, Stopped, Vpu, math};

use crate::clear;
use crate::columns::{Columns, lanes_below, task_range};
use crate::expression::{each, int, scalar};
use crate::field;
use crate::irregular::FAR;
use crate::record::{Records, words};
use crate::scan::{self, Scan};
use crate::scene::{Scene, Triangle};

/// Number of triangles that a task handles.
const TASK: u32 = 512;

/// Bits of a code along each axis.
const BITS: u32 = 8;

/// Digits that keys are sorted by: 8 bits.
const DIGITS: u32 = 256;

/// The center of a triangle, times 3.
#[repr(C)]
struct Center {
    sum: [f32; 3],
}

/// Bounds of some centers: one line. Maxima are negated, so that one minimum serves all.
#[repr(C, align(64))]
struct Bounds {
    /// Least x, -x, y, -y, z, -z.
    least: [f32; 6],
}

/// A triangle that is to be sorted.
#[repr(C)]
struct Key {
    code: u32,
    triangle: u32,
}

/// Numbers of all triangles in the order of their codes.
pub(super) fn along_curve(scene: &Scene, runner: &mut Runner<'_>) -> Result<Addr, Stopped> {
    let count = scene.triangle_count;
    let tasks = count.div_ceil(TASK);
    let centers = Columns::overwritten(runner.arena, count);
    let of_tasks = Records::overwritten(runner.arena, u64::from(tasks.max(1)));
    let of_all = Records::overwritten(runner.arena, 1);
    let kernel = Centers { scene: *scene, centers, of_tasks };
    // SAFETY: each task writes the centers of its own triangles, and its own bounds.
    runner.run(&unsafe { Step::independent("centers", tasks, kernel) })?;
    runner.run(&Step::ordered("center bounds", 1, AllBounds { tasks, of_tasks, of_all }))?;

    let mut keys = [(); 2].map(|()| Columns::overwritten(runner.arena, count));
    let kernel = Codes { count, centers, bounds: of_all, keys: keys[0] };
    // SAFETY: each task writes the keys of its own triangles.
    runner.run(&unsafe { Step::independent("codes", tasks, kernel) })?;

    let table_words = u64::from(DIGITS * tasks);
    for pass in 0..3 {
        let [table] = clear::zeroed(runner, [scan::padded(table_words)])?;
        let scan = Scan::new(runner.arena, table, table_words);
        let by_digit = |to| ByDigit { count, tasks, shift: 8 * pass, table, from: keys[0], to };
        // SAFETY: each task writes the words of the table that are its own.
        runner.run(&unsafe { Step::independent("count digits", tasks, by_digit(None)) })?;
        scan.run(runner)?;
        // SAFETY: each task adds to its own words of the table, so that what the atomics return depends on no other task, and
        // writes to the places that these give its keys.
        runner.run(&unsafe { Step::independent("move keys", tasks, by_digit(Some(keys[1]))) })?;
        keys.swap(0, 1);
    }
    Ok(keys[0].column(field!(Key.triangle)))
}

/// Finds the centers of triangles, and the bounds of each task's.
struct Centers {
    scene: Scene,
    centers: Columns<Center>,
    of_tasks: Records<Bounds>,
}

impl Kernel for Centers {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let Centers { scene, centers, of_tasks } = self;
        let (mut i, end) = task_range(v, task, TASK, scene.triangle_count);
        let zero = v.vset_f32(0.0);
        let far = v.vset_f32(FAR);
        let mut least = [far; 6];
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let corners =
                each!(k in [0, 1, 2] => v.vload_i32(scene.triangles.column(field!(Triangle.corners[k])), i));
            let [a, b, c] = each!(k in [0, 1, 2] => scene.positions(v, live, corners[k]));
            for axis in 0..3 {
                let sum = v.vadd(a[axis], b[axis]);
                let sum = v.vadd(sum, c[axis]);
                v.vstore_f32(live, centers.column(field!(Center.sum[axis])), i, sum);
                let minus = v.vsub(zero, sum);
                least[2 * axis] = v.vmin_or(least[2 * axis], live, least[2 * axis], sum);
                least[2 * axis + 1] = v.vmin_or(least[2 * axis + 1], live, least[2 * axis + 1], minus);
            }
            i = scalar!(v, i + 16);
        }
        let to = scalar!(v, task * { words::<Bounds>() as i32 });
        for (bound, least) in least.into_iter().enumerate() {
            let least = math::reduce_min(v, least);
            let bit = v.s_imm(1 << bound);
            let lane = v.kmov_from_scalar(bit);
            v.vstore_f32(lane, of_tasks.field(field!(Bounds.least)), to, least);
        }
    }
}

/// Finds the bounds of all centers.
struct AllBounds {
    tasks: u32,
    of_tasks: Records<Bounds>,
    of_all: Records<Bounds>,
}

impl Kernel for AllBounds {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, only: V::S32) {
        let line = words::<Bounds>() as i32;
        let mut i = only;
        let end = v.s_imm(line * self.tasks as i32);
        let mut least = v.vset_f32(FAR);
        while v.branch(Compare::Less, i, end) {
            let other = v.vload_f32(self.of_tasks.field(field!(Bounds.least)), i);
            least = v.vmin(least, other);
            i = scalar!(v, i + { line });
        }
        let all = v.mask_all();
        v.vstore_f32(all, self.of_all.field(field!(Bounds.least)), only, least);
    }
}

/// Makes the keys of triangles.
struct Codes {
    /// Number of triangles.
    count: u32,
    centers: Columns<Center>,
    bounds: Records<Bounds>,
    keys: Columns<Key>,
}

impl Kernel for Codes {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let (mut i, end) = task_range(v, task, TASK, self.count);
        let lane = v.viota();
        let zero = v.vset_f32(0.0);
        let most = v.vset_f32(((1 << BITS) - 1) as f32);
        let tiny = v.vset_f32(1e-30);
        let only = v.s_imm(0);
        let bounds = self.bounds.at(only);
        let axes = each!(axis in [0, 1, 2] => {
            let low = bounds.float(v, field!(Bounds.least[2 * axis]));
            let minus_high = bounds.float(v, field!(Bounds.least[2 * axis + 1]));
            let high = v.vsub(zero, minus_high);
            let extent = v.vsub(high, low);
            let extent = v.vmax(extent, tiny);
            [low, math::div(v, most, extent)]
        });
        // Each bit of an axis is followed by two of the others.
        let spreading = [[8, 0x0000_f00f], [4, 0x000c_30c3], [2, 0x0024_9249]];
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let [x, y, z] = each!(axis in [0, 1, 2] => {
                let center = v.vload_f32(self.centers.column(field!(Center.sum[axis])), i);
                let [low, per_unit] = axes[axis];
                let from = v.vsub(center, low);
                let place = v.vmul(from, per_unit);
                let place = v.vmax(place, zero);
                let place = v.vmin(place, most);
                let mut bits = v.vcvt_f32_i32(place);
                for [by, keep] in spreading {
                    let by = v.vset_i32(by);
                    let keep = v.vset_i32(keep);
                    bits = int!(v, (bits | (bits << by)) & keep);
                }
                bits
            });
            let (one, two) = (v.vset_i32(1), v.vset_i32(2));
            let code = int!(v, ((x << two) | (y << one)) | z);
            v.vstore_i32(live, self.keys.column(field!(Key.code)), i, code);
            let number = v.vsplat(i);
            let number = int!(v, number + lane);
            v.vstore_i32(live, self.keys.column(field!(Key.triangle)), i, number);
            i = scalar!(v, i + 16);
        }
    }
}

/// Counts the keys of each digit, each task its own, or moves them to their places.
struct ByDigit {
    /// Number of keys.
    count: u32,
    tasks: u32,
    /// Lowest bit of the digit.
    shift: i32,
    /// Keys of each digit and task, then where they go: all tasks of digit 0, then those of digit 1.
    table: Addr,
    from: Columns<Key>,
    /// Where the keys are moved; `None` where they are counted.
    to: Option<Columns<Key>>,
}

impl ByDigit {
    /// Words of the table for the digits of 16 codes.
    #[inline(always)]
    fn words<V: Vpu>(&self, v: &mut V, code: V::I32, task: V::I32) -> V::I32 {
        let shift = v.vset_i32(self.shift);
        let last = v.vset_i32(DIGITS as i32 - 1);
        let tasks = v.vset_i32(self.tasks as i32);
        int!(v, (((code >> shift) & last) * tasks) + task)
    }
}

impl Kernel for ByDigit {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let (mut i, end) = task_range(v, task, TASK, self.count);
        let none = v.vset_i32(0);
        let one = v.vset_i32(1);
        let task = v.vsplat(task);
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let code = v.vload_i32_or(none, live, self.from.column(field!(Key.code)), i);
            let at = self.words(v, code, task);
            let place = v.vatomic_add_or(none, live, self.table, at, one);
            if let Some(to) = self.to {
                let triangle = v.vload_i32_or(none, live, self.from.column(field!(Key.triangle)), i);
                v.vscatter_i32(live, to.column(field!(Key.code)), place, code);
                v.vscatter_i32(live, to.column(field!(Key.triangle)), place, triangle);
            }
            i = scalar!(v, i + 16);
        }
    }
}
