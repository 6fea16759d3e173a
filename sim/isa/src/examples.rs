//! Three small programs that know their own answer: what the tests of everything above run.
//!
//! Each is made from sizes alone, fills its inputs from a fixed sequence when its first step is made, and can check what
//! it left in the arena.

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use crate::arena::{Addr, Arena};
use crate::emit::OpCounts;
use crate::functional::run_functional;
use crate::host::HostSimd;
use crate::kernel::Kernel;
use crate::program::{Phase, Program, Step};
use crate::vpu::{Compare, Vpu};

/// Number of elements that one task handles.
const TASK_ELEMENTS: u32 = 1024;

/// Runs all steps of `program` on a new arena, without timing.
///
/// ```
/// use lrbsim_isa::{HostSimd, examples};
/// let mut program = examples::saxpy(1000);
/// let (arena, counts) = examples::run(&mut program, HostSimd::detect(), 2);
/// program.state.check(&arena).expect("saxpy is right");
/// assert!(counts.total() > 0);
/// ```
pub fn run<S>(program: &mut Program<S>, simd: HostSimd, host_threads: usize) -> (Arena, OpCounts) {
    let mut arena = Arena::new();
    let mut counts = OpCounts::default();
    for phase in &program.phases {
        for make_step in &phase.steps {
            let step = make_step(&mut program.state, &mut arena);
            counts.add(&run_functional(&step, &mut arena, simd, host_threads));
        }
    }
    (arena, counts)
}

/// Word `i` of the input sequence: a multiplicative hash, so that neighbours differ.
fn input(i: u32) -> u32 {
    let mixed = i.wrapping_add(1).wrapping_mul(2_654_435_761);
    (mixed ^ mixed >> 15).wrapping_mul(2_246_822_519)
}

/// Input `i` as a float of 8 bits, so that products and sums of two are exact.
fn small_float(i: u32) -> f32 {
    (input(i) >> 24) as f32
}

fn one_step<S>(
    id: &'static str,
    title: &'static str,
    state: S,
    step: fn(&mut S, &mut Arena) -> Step,
) -> Program<S> {
    Program { state, phases: vec![Phase { id, title, in_paper_total: false, steps: vec![step] }] }
}

/// What the steps of [`saxpy`] share.
#[derive(Debug, Clone, Copy, Default)]
pub struct Saxpy {
    /// Number of elements of either array.
    pub count: u32,
    /// The array that is read.
    pub x: Addr,
    /// The array that is read and written.
    pub y: Addr,
}

/// The factor of [`saxpy`].
const SAXPY_FACTOR: f32 = 3.0;

/// `y[i] = 3 * x[i] + y[i]` for `count` floats: one streaming pass, a task for every 1024 elements.
pub fn saxpy(count: u32) -> Program<Saxpy> {
    one_step("saxpy", "a x + y", Saxpy { count, ..Saxpy::default() }, |state, arena| {
        let x: Vec<f32> = (0..state.count).map(small_float).collect();
        let y: Vec<f32> = (0..state.count).map(|i| small_float(!i)).collect();
        state.x = arena.alloc_f32(&x);
        state.y = arena.alloc_f32(&y);
        // SAFETY: each task writes its own elements.
        unsafe {
            Step::independent(
                "saxpy",
                state.count.div_ceil(TASK_ELEMENTS),
                SaxpyKernel { count: state.count, x: state.x, y: state.y },
            )
        }
    })
}

impl Saxpy {
    /// Whether every element in `arena` is right; what is wrong otherwise.
    ///
    /// # Errors
    /// Says which element is the first that is wrong.
    pub fn check(&self, arena: &Arena) -> Result<(), String> {
        for i in 0..self.count {
            let found = arena.read_f32(self.y.plus(4 * u64::from(i)));
            let right = SAXPY_FACTOR * small_float(i) + small_float(!i);
            if found != right {
                return Err(format!("y[{i}] is {found}; it must be {right}"));
            }
        }
        Ok(())
    }
}

struct SaxpyKernel {
    count: u32,
    x: Addr,
    y: Addr,
}

/// First and last element (exclusive) of task `task`, whose last may be cut off by `count`.
#[inline(always)]
fn task_span<V: Vpu>(v: &mut V, task: V::S32, count: u32) -> (V::S32, V::S32) {
    let per_task = v.s_imm(TASK_ELEMENTS as i32);
    let start = v.s_mul(task, per_task);
    let end = v.s_add(start, per_task);
    let count = v.s_imm(count as i32);
    if v.branch(Compare::Less, count, end) { (start, count) } else { (start, end) }
}

/// The lanes of the 16 elements from `i` on that lie before `end`.
#[inline(always)]
fn lanes_before<V: Vpu>(v: &mut V, iota: V::I32, i: V::S32, end: V::S32) -> V::Mask {
    let left = v.s_sub(end, i);
    let left = v.vsplat(left);
    v.vicmp_lt(iota, left)
}

impl Kernel for SaxpyKernel {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let (start, end) = task_span(v, task, self.count);
        let step = v.s_imm(16);
        let all = v.mask_all();
        let factor = v.vset_f32(SAXPY_FACTOR);
        // Whole vectors.
        let mut i = start;
        let mut next = v.s_add(i, step);
        while v.branch(Compare::LessEqual, next, end) {
            let x = v.vload_f32(self.x, i);
            let y = v.vload_f32(self.y, i);
            let sum = v.vmadd(factor, x, y);
            v.vstore_f32(all, self.y, i, sum);
            i = next;
            next = v.s_add(next, step);
        }
        // What is left, under a mask.
        if v.branch(Compare::Less, i, end) {
            let iota = v.viota();
            let k = lanes_before(v, iota, i, end);
            let zero = v.vset_f32(0.0);
            let x = v.vload_f32_or(zero, k, self.x, i);
            let y = v.vload_f32_or(zero, k, self.y, i);
            let sum = v.vmadd_or(y, k, factor, x, y);
            v.vstore_f32(k, self.y, i, sum);
        }
    }
}

/// What the steps of [`histogram`] share.
#[derive(Debug, Clone, Copy, Default)]
pub struct Histogram {
    /// Values to be counted.
    pub count: u32,
    /// Number of bins, at least one.
    pub bins: u32,
    /// The values to be counted, each below `bins`.
    pub values: Addr,
    /// How many values fell into each bin.
    pub totals: Addr,
}

/// Counts `count` values in `bins` bins by vector atomics: few bins make lanes and cores conflict.
///
/// # Panics
/// When `bins` is 0.
pub fn histogram(count: u32, bins: u32) -> Program<Histogram> {
    assert!(bins > 0, "a histogram needs at least one bin");
    one_step("histogram", "histogram", Histogram { count, bins, ..Histogram::default() }, |state, arena| {
        let values: Vec<u32> = (0..state.count).map(|i| input(i) % state.bins).collect();
        state.values = arena.alloc_u32(&values);
        state.totals = arena.alloc(u64::from(state.bins));
        // SAFETY: tasks only add to the totals.
        unsafe {
            Step::independent(
                "histogram",
                state.count.div_ceil(TASK_ELEMENTS),
                HistogramKernel { count: state.count, values: state.values, totals: state.totals },
            )
        }
    })
}

impl Histogram {
    /// Whether every total in `arena` is right; what is wrong otherwise.
    ///
    /// # Errors
    /// Says which bin is the first that is wrong.
    pub fn check(&self, arena: &Arena) -> Result<(), String> {
        let mut right = vec![0u32; self.bins as usize];
        for i in 0..self.count {
            right[(input(i) % self.bins) as usize] += 1;
        }
        for (bin, right) in right.into_iter().enumerate() {
            let found = arena.read_u32(self.totals.plus(4 * bin as u64));
            if found != right {
                return Err(format!("bin {bin} holds {found}; it must hold {right}"));
            }
        }
        Ok(())
    }
}

struct HistogramKernel {
    count: u32,
    values: Addr,
    totals: Addr,
}

impl Kernel for HistogramKernel {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let (start, end) = task_span(v, task, self.count);
        let step = v.s_imm(16);
        let iota = v.viota();
        let zero = v.vset_i32(0);
        let one = v.vset_i32(1);
        let mut i = start;
        while v.branch(Compare::Less, i, end) {
            let k = lanes_before(v, iota, i, end);
            let bins = v.vload_i32_or(zero, k, self.values, i);
            v.vatomic_add_or(zero, k, self.totals, bins, one);
            i = v.s_add(i, step);
        }
    }
}

/// What the steps of [`transpose`] share.
#[derive(Debug, Clone, Copy, Default)]
pub struct Transpose {
    /// Rows of the matrix that is read.
    pub rows: u32,
    /// Columns of the matrix that is read.
    pub columns: u32,
    /// The matrix that is read, row-major.
    pub from: Addr,
    /// The transpose of the matrix, row-major: `columns` rows.
    pub to: Addr,
}

/// Transposes a matrix of `rows` x `columns` words: rows are loaded, columns scattered; a task for every row.
pub fn transpose(rows: u32, columns: u32) -> Program<Transpose> {
    one_step("transpose", "transpose", Transpose { rows, columns, ..Transpose::default() }, |state, arena| {
        let matrix: Vec<u32> = (0..state.rows * state.columns).map(input).collect();
        state.from = arena.alloc_u32(&matrix);
        state.to = arena.alloc(matrix.len() as u64);
        // SAFETY: each task writes its own column.
        unsafe {
            Step::independent(
                "transpose",
                state.rows,
                TransposeKernel { rows: state.rows, columns: state.columns, from: state.from, to: state.to },
            )
        }
    })
}

impl Transpose {
    /// Whether every word in `arena` is right; what is wrong otherwise.
    ///
    /// # Errors
    /// Says which word is the first that is wrong.
    pub fn check(&self, arena: &Arena) -> Result<(), String> {
        for column in 0..self.columns {
            for row in 0..self.rows {
                let found = arena.read_u32(self.to.plus(4 * u64::from(column * self.rows + row)));
                let right = input(row * self.columns + column);
                if found != right {
                    return Err(format!("row {column}, column {row} is {found:#x}; it must be {right:#x}"));
                }
            }
        }
        Ok(())
    }
}

struct TransposeKernel {
    rows: u32,
    columns: u32,
    from: Addr,
    to: Addr,
}

impl Kernel for TransposeKernel {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, row: V::S32) {
        let columns = v.s_imm(self.columns as i32);
        let step = v.s_imm(16);
        let iota = v.viota();
        let zero = v.vset_i32(0);
        // Where the 16 words from column 0 on go, and how far 16 columns are apart there.
        let rows = v.vset_i32(self.rows as i32);
        let at_row = v.vsplat(row);
        let to_column = v.vimul(iota, rows);
        let mut to = v.viadd(to_column, at_row);
        let to_step = v.vset_i32(self.rows.wrapping_mul(16) as i32);
        let mut from = v.s_mul(row, columns);
        let end = v.s_add(from, columns);
        while v.branch(Compare::Less, from, end) {
            let k = lanes_before(v, iota, from, end);
            let words = v.vload_i32_or(zero, k, self.from, from);
            v.vscatter_i32(k, self.to, to, words);
            to = v.viadd(to, to_step);
            from = v.s_add(from, step);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::program::{StepSource, TaskSource};
    use crate::stream::Stream;

    /// Runs a program on every back end, counting on 1 and 2 host threads and recording, and checks all against `check`.
    fn holds_everywhere<S>(make: impl Fn() -> Program<S>, check: impl Fn(&S, &Arena) -> Result<(), String>) {
        let mut streams: Option<Vec<Stream>> = None;
        let mut counted: Option<OpCounts> = None;
        for simd in HostSimd::ALL {
            if !simd.is_available() {
                eprintln!("SKIPPED on {simd}: this host lacks it");
                continue;
            }
            for threads in [1, 2] {
                let mut program = make();
                let (arena, counts) = run(&mut program, simd, threads);
                check(&program.state, &arena)
                    .unwrap_or_else(|wrong| panic!("{simd}, {threads} threads: {wrong}"));
                assert_eq!(counts, *counted.get_or_insert(counts.clone()), "{simd}, {threads} threads");
            }
            let mut program = make();
            let mut arena = Arena::new();
            let mut recorded = Vec::new();
            for phase in &program.phases {
                for make_step in &phase.steps {
                    let step = make_step(&mut program.state, &mut arena);
                    let source = StepSource::new(&step, &mut arena, simd, 1);
                    for task in 0..source.tasks() {
                        let mut stream = Stream::default();
                        source.record(task, &mut stream);
                        recorded.push(stream);
                    }
                }
            }
            check(&program.state, &arena).unwrap_or_else(|wrong| panic!("recording on {simd}: {wrong}"));
            let counted = counted.as_ref().expect("counted above");
            let masked: u64 = recorded.iter().map(|stream| stream.lanes_masked).sum();
            let active: u64 = recorded.iter().map(|stream| stream.lanes_active).sum();
            assert_eq!((masked, active), (counted.lanes_masked, counted.lanes_active()));
            assert!(recorded == *streams.get_or_insert(recorded.clone()), "the stream depends on {simd}");
        }
    }

    #[test]
    fn saxpy_is_right_on_every_back_end() {
        for count in [0, 1, 16, 1023, 1025, 5000] {
            holds_everywhere(|| saxpy(count), Saxpy::check);
        }
    }

    #[test]
    fn histogram_is_right_on_every_back_end() {
        for (count, bins) in [(0, 1), (17, 1), (5000, 3), (5000, 16), (5000, 4096)] {
            holds_everywhere(|| histogram(count, bins), Histogram::check);
        }
    }

    #[test]
    fn transpose_is_right_on_every_back_end() {
        for (rows, columns) in [(0, 0), (1, 1), (1, 40), (40, 1), (33, 65), (64, 64)] {
            holds_everywhere(|| transpose(rows, columns), Transpose::check);
        }
    }

    #[test]
    fn a_wrong_result_is_noticed() {
        let mut program = saxpy(20);
        let (mut arena, _) = run(&mut program, HostSimd::Portable, 1);
        arena.write_u32(program.state.y.plus(76), 1);
        let wrong = program.state.check(&arena).expect_err("word 19 was overwritten");
        assert!(wrong.starts_with("y[19] is"), "{wrong}");
    }
}
