//! Speed of the ISA layer on this host, one thread: simulated uops a second and host nanoseconds a uop, counting
//! (functional fidelity) and recording (what every timed fidelity pays before it times anything).
//!
//! ```text
//! cargo bench -p lrbsim-isa [-- FILTER]      FILTER: part of "saxpy/counting/avx512"
//! ```
//!
//! Host instructions are counted from outside, where a counter or an instruction-level tool is at hand. With
//! `LRBSIM_BENCH_REPEATS=N` every selected case runs exactly N times, warm-up and clock left out, and prints its uops:
//! the difference of two runs over the difference of their uops is the figure,
//! `valgrind --tool=callgrind` or `perf stat -e instructions:u` being the tool.

use lrbsim_isa::examples::{Histogram, Saxpy, Transpose};
use lrbsim_isa::{Addr, Arena, Compare, HostSimd, Kernel, OpCounts, Step, Stream, Vpu};

/// Evaluates eight polynomials of degree 16 for each of 64 vectors of a task: seven uops in eight are `vmadd`.
struct Polynomials {
    x: Addr,
    coefficients: Addr,
}

impl Kernel for Polynomials {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let words = v.s_imm(1024);
        let step = v.s_imm(16);
        let all = v.mask_all();
        let mut i = v.s_mul(task, words);
        let end = v.s_add(i, words);
        let one = v.s_imm(1);
        while v.branch(Compare::Less, i, end) {
            let x = v.vload_f32(self.x, i);
            let mut sums = [x; 8];
            let mut term = v.s_imm(0);
            let terms = v.s_imm(16);
            while v.branch(Compare::Less, term, terms) {
                let c = v.vbroadcast_f32(self.coefficients, term);
                for sum in &mut sums {
                    *sum = v.vmadd(*sum, x, c);
                }
                term = v.s_add(term, one);
            }
            let mut total = sums[0];
            for sum in &sums[1..] {
                total = v.vadd(total, *sum);
            }
            v.vstore_f32(all, self.x, i, total);
            i = v.s_add(i, step);
        }
    }
}

fn polynomials(arena: &mut Arena) -> Step {
    let x = arena.overwritten(64 * 1024);
    let coefficients = arena.alloc_f32(&[0.5; 16]);
    Step::ordered("polynomials", 64, Polynomials { x, coefficients })
}

#[expect(clippy::disallowed_methods, reason = "a benchmark reads the clock")]
fn now() -> std::time::Instant {
    std::time::Instant::now()
}

/// Runs all tasks of a step once and says how many uops they were.
fn run_once(step: &Step, arena: &Arena, simd: HostSimd, recording: bool, stream: &mut Stream) -> u64 {
    if !recording {
        let mut counts = OpCounts::default();
        step.kernel().run(simd, arena, 0..step.tasks(), false, &mut counts);
        return counts.total();
    }
    let mut uops = 0;
    for task in 0..step.tasks() {
        stream.clear();
        step.kernel().record(simd, arena, task, stream);
        uops += stream.uops.len() as u64;
    }
    uops
}

fn main() {
    let filter = std::env::args().skip(1).find(|argument| !argument.starts_with('-')).unwrap_or_default();
    let repeats: Option<u64> = std::env::var("LRBSIM_BENCH_REPEATS").ok().map(|text| {
        text.parse().unwrap_or_else(|_| panic!("LRBSIM_BENCH_REPEATS is '{text}'; it must be a whole number"))
    });
    let mut arena = Arena::new();
    let steps = [
        Saxpy::new(&mut arena, 1 << 16).step(),
        Histogram::new(&mut arena, 1 << 16, 1024).step(),
        Transpose::new(&mut arena, 256, 256).step(),
        polynomials(&mut arena),
    ];
    let mut stream = Stream::default();
    if repeats.is_none() {
        println!("{:32} {:>10} {:>10} {:>10}", "case", "uops", "M uops/s", "ns/uop");
    }
    for step in &steps {
        for (recording, mode) in [(false, "counting"), (true, "recording")] {
            for simd in HostSimd::ALL {
                let case = format!("{}/{mode}/{simd}", step.name());
                if !case.contains(&filter) {
                    continue;
                }
                if !simd.is_available() {
                    println!("{case:32} skipped: this host has no {simd}");
                    continue;
                }
                if let Some(repeats) = repeats {
                    let uops: u64 =
                        (0..repeats).map(|_| run_once(step, &arena, simd, recording, &mut stream)).sum();
                    println!("{case:32} {uops:>10}");
                    continue;
                }
                // The best of several: everything else that runs on the host only ever adds time.
                let mut best = f64::INFINITY;
                let mut uops = run_once(step, &arena, simd, recording, &mut stream);
                let begin = now();
                while begin.elapsed().as_secs_f64() < 0.25 {
                    let start = now();
                    uops = run_once(step, &arena, simd, recording, &mut stream);
                    best = best.min(start.elapsed().as_secs_f64());
                }
                println!(
                    "{case:32} {uops:>10} {:>10.0} {:>10.2}",
                    uops as f64 / best / 1e6,
                    best * 1e9 / uops as f64
                );
            }
        }
    }
}
