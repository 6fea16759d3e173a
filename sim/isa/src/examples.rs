//! Three small steps that know their own answer: what the tests of everything above run.
//!
//! Each is made from sizes alone: it fills its inputs in the arena from a fixed sequence, and can check what its step left
//! there.
//!
//! ```
//! use lrbsim_isa::{Arena, HostSimd, examples::Saxpy, run_functional};
//! let mut arena = Arena::new();
//! let saxpy = Saxpy::new(&mut arena, 1000);
//! let counts = run_functional(&saxpy.step(), &mut arena, HostSimd::detect(), 2);
//! saxpy.check(&arena).expect("saxpy is right");
//! assert!(counts.total() > 0);
//! ```

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use crate::arena::{Addr, Arena};
use crate::kernel::Kernel;
use crate::program::Step;
use crate::vpu::{Compare, Vpu};

/// Number of elements that one task handles.
const TASK_ELEMENTS: u32 = 1024;

/// Word `i` of the input sequence: a multiplicative hash, so that neighbours differ.
fn input(i: u32) -> u32 {
    let mixed = i.wrapping_add(1).wrapping_mul(2_654_435_761);
    (mixed ^ mixed >> 15).wrapping_mul(2_246_822_519)
}

/// Input `i` as a float of 8 bits, so that products and sums of two are exact.
fn small_float(i: u32) -> f32 {
    (input(i) >> 24) as f32
}

/// `y[i] = 3 * x[i] + y[i]` for `count` floats: one streaming pass, a task for every 1024 elements.
#[derive(Debug, Clone, Copy)]
pub struct Saxpy {
    /// Number of elements of either array.
    pub count: u32,
    /// The array that is read.
    pub x: Addr,
    /// The array that is read and written.
    pub y: Addr,
}

/// The factor of [`Saxpy`].
const SAXPY_FACTOR: f32 = 3.0;

impl Saxpy {
    /// Fills two arrays of `count` floats.
    pub fn new(arena: &mut Arena, count: u32) -> Saxpy {
        let x: Vec<f32> = (0..count).map(small_float).collect();
        let y: Vec<f32> = (0..count).map(|i| small_float(!i)).collect();
        Saxpy { count, x: arena.alloc_f32(&x), y: arena.alloc_f32(&y) }
    }

    /// The step that adds; to be run once.
    pub fn step(&self) -> Step {
        let kernel = SaxpyKernel { count: self.count, x: self.x, y: self.y };
        // SAFETY: each task writes its own elements.
        unsafe { Step::independent("saxpy", self.count.div_ceil(TASK_ELEMENTS), kernel) }
    }

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

/// Counts `count` values in `bins` bins by vector atomics: few bins make lanes and cores conflict.
#[derive(Debug, Clone, Copy)]
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

impl Histogram {
    /// Fills an array of `count` values, and makes room for the totals of `bins` bins.
    ///
    /// # Panics
    /// When `bins` is 0.
    pub fn new(arena: &mut Arena, count: u32, bins: u32) -> Histogram {
        assert!(bins > 0, "a histogram needs at least one bin");
        let values: Vec<u32> = (0..count).map(|i| input(i) % bins).collect();
        Histogram {
            count,
            bins,
            values: arena.alloc_u32(&values),
            totals: arena.alloc_u32(&vec![0; bins as usize]),
        }
    }

    /// The step that counts; to be run once.
    pub fn step(&self) -> Step {
        let kernel = HistogramKernel { count: self.count, values: self.values, totals: self.totals };
        // SAFETY: tasks only add to the totals.
        unsafe { Step::independent("histogram", self.count.div_ceil(TASK_ELEMENTS), kernel) }
    }

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

/// Transposes a matrix of `rows` x `columns` words: rows are loaded, columns scattered; a task for every row.
#[derive(Debug, Clone, Copy)]
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

impl Transpose {
    /// Fills a matrix, and makes room for its transpose.
    pub fn new(arena: &mut Arena, rows: u32, columns: u32) -> Transpose {
        let matrix: Vec<u32> = (0..rows * columns).map(input).collect();
        Transpose {
            rows,
            columns,
            from: arena.alloc_u32(&matrix),
            to: arena.overwritten(matrix.len() as u64),
        }
    }

    /// The step that transposes.
    pub fn step(&self) -> Step {
        let kernel = TransposeKernel { rows: self.rows, columns: self.columns, from: self.from, to: self.to };
        // SAFETY: each task writes its own column.
        unsafe { Step::independent("transpose", self.rows, kernel) }
    }

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
    use crate::emit::OpCounts;
    use crate::functional::run_functional;
    use crate::host::HostSimd;
    use crate::program::{StepSource, TaskSource};
    use crate::stream::Stream;

    /// What checks the arena after a step.
    type Check = Box<dyn Fn(&Arena) -> Result<(), String>>;

    /// Runs an example on every back end, counting on 1 and 2 host threads and recording, and checks all.
    fn holds_everywhere(make: impl Fn(&mut Arena) -> (Step, Check)) {
        let mut streams: Option<Vec<Stream>> = None;
        let mut counted: Option<OpCounts> = None;
        for simd in HostSimd::ALL {
            if !simd.is_available() {
                eprintln!("SKIPPED on {simd}: this host lacks it");
                continue;
            }
            for threads in [1, 2] {
                let mut arena = Arena::new();
                let (step, check) = make(&mut arena);
                let counts = run_functional(&step, &mut arena, simd, threads);
                check(&arena).unwrap_or_else(|wrong| panic!("{simd}, {threads} threads: {wrong}"));
                assert_eq!(counts, *counted.get_or_insert(counts.clone()), "{simd}, {threads} threads");
            }
            let mut arena = Arena::new();
            let (step, check) = make(&mut arena);
            let mut recorded = Vec::new();
            let source = StepSource::new(&step, &mut arena, simd, 1);
            for task in 0..source.tasks() {
                let mut stream = Stream::default();
                source.record(task, &mut stream);
                recorded.push(stream);
            }
            drop(source);
            check(&arena).unwrap_or_else(|wrong| panic!("recording on {simd}: {wrong}"));
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
            holds_everywhere(|arena| {
                let saxpy = Saxpy::new(arena, count);
                (saxpy.step(), Box::new(move |arena| saxpy.check(arena)))
            });
        }
    }

    #[test]
    fn histogram_is_right_on_every_back_end() {
        for (count, bins) in [(0, 1), (17, 1), (5000, 3), (5000, 16), (5000, 4096)] {
            holds_everywhere(|arena| {
                let histogram = Histogram::new(arena, count, bins);
                (histogram.step(), Box::new(move |arena| histogram.check(arena)))
            });
        }
    }

    #[test]
    fn transpose_is_right_on_every_back_end() {
        for (rows, columns) in [(0, 0), (1, 1), (1, 40), (40, 1), (33, 65), (64, 64)] {
            holds_everywhere(|arena| {
                let transpose = Transpose::new(arena, rows, columns);
                (transpose.step(), Box::new(move |arena| transpose.check(arena)))
            });
        }
    }

    #[test]
    fn a_wrong_result_is_noticed() {
        let mut arena = Arena::new();
        let saxpy = Saxpy::new(&mut arena, 20);
        run_functional(&saxpy.step(), &mut arena, HostSimd::Portable, 1);
        arena.write_u32(saxpy.y.plus(76), 1);
        let wrong = saxpy.check(&arena).expect_err("word 19 was overwritten");
        assert!(wrong.starts_with("y[19] is"), "{wrong}");
    }
}
