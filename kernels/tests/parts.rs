//! Parts that methods share: prefix sums, the order of receivers.

use lrbsim_isa::{Arena, HostSimd, Phase, Runner, Step, run_functional};
use lrbsim_kernels::irregular::receivers::hilbert;
use lrbsim_kernels::scan::{Scan, padded};

#[test]
fn a_scan_equals_the_running_sum() {
    for count in [0u64, 1, 15, 16, 1023, 1024, 5000, 40_000] {
        let mut arena = Arena::new();
        let values: Vec<u32> = (0..count as u32).map(|i| i.wrapping_mul(2_654_435_761) >> 28).collect();
        let words = arena.overwritten(padded(count));
        arena.write_u32s(words, &values);
        let scan = Scan::new(&mut arena, words, count);
        let mut run_step = |_: &Phase, step: &Step, arena: &mut Arena| {
            run_functional(step, arena, HostSimd::detect(), 2);
            Ok(())
        };
        let mut runner = Runner::new(&mut arena, &mut run_step);
        runner.phase(&Phase { id: "scan", title: "prefix sum", in_paper_total: false });
        scan.run(&mut runner).expect("nothing stops it");
        let mut sum = 0;
        for (i, value) in values.iter().enumerate() {
            assert_eq!(arena.read_u32(words.plus_words(i as u64)), sum, "word {i} of {count}");
            sum += value;
        }
        assert_eq!(arena.read_u32(words.plus_words(count)), sum, "total of {count}");
    }
}

#[test]
fn the_curve_visits_every_pixel_and_steps_to_a_neighbor() {
    let side = 16;
    let mut curve: Vec<(u32, u32)> = (0..side * side).map(|i| (i % side, i / side)).collect();
    curve.sort_by_key(|&(x, y)| hilbert(side, x, y));
    let places: Vec<u64> = curve.iter().map(|&(x, y)| hilbert(side, x, y)).collect();
    assert_eq!(places, (0..u64::from(side * side)).collect::<Vec<_>>());
    for pair in curve.windows(2) {
        let steps = pair[0].0.abs_diff(pair[1].0) + pair[0].1.abs_diff(pair[1].1);
        assert_eq!(steps, 1, "{pair:?}");
    }
}
