//! Parts that methods share: prefix sums, the order of receivers.

use lrbsim_isa::{Arena, HostSimd, Phase, Runner, Step, run_functional};
use lrbsim_kernels::irregular::receivers::along_curve;
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

/// Place of a pixel on the Hilbert curve through a square; `side` is a power of two.
fn hilbert(side: u32, mut x: u32, mut y: u32) -> u64 {
    let mut place = 0;
    let mut half = side / 2;
    while half > 0 {
        let (right, upper) = (u32::from(x & half > 0), u32::from(y & half > 0));
        place = place << 2 | u64::from((3 * right) ^ upper);
        if upper == 0 {
            if right == 1 {
                (x, y) = (side - 1 - x, side - 1 - y);
            }
            (x, y) = (y, x);
        }
        half /= 2;
    }
    place
}

#[test]
fn the_curve_visits_every_pixel_of_a_picture_in_its_order_and_steps_to_a_neighbor() {
    for (width, height) in [(16, 16), (1, 1), (13, 7), (5, 32), (64, 1)] {
        let side = u32::max(width, height).next_power_of_two();
        let mut right: Vec<(u32, u32)> = (0..width * height).map(|i| (i % width, i / width)).collect();
        right.sort_by_key(|&(x, y)| hilbert(side, x, y));
        let mut curve = Vec::new();
        along_curve([width, height], [0, 0], side, [false; 2], &mut |x, y| curve.push((x, y)));
        assert_eq!(curve, right, "{width} x {height}");
        // In a square no pixel is left out.
        for pair in curve.windows(2).filter(|_| width == height) {
            let steps = pair[0].0.abs_diff(pair[1].0) + pair[0].1.abs_diff(pair[1].1);
            assert_eq!(steps, 1, "{pair:?}");
        }
    }
}
