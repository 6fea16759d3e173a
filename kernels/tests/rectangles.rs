//! Rectangular and linear lights: the kernel's parts of them against f64.

mod common;

use common::{Lanewise, Random, evaluate, power_of_ten};
use lrbsim_isa::Vpu;
use lrbsim_kernels::rectangle::{line, square};
use lrbsim_kernels::segment::or_nothing;
use lrbsim_workloads::glam::DVec2;
use lrbsim_workloads::reference::{line_beyond, square_beyond};

/// Parts of the square and of the line beyond an edge.
#[derive(Clone)]
struct Beyond;

impl Lanewise<4, 2> for Beyond {
    #[inline(always)]
    fn eval<V: Vpu>(&self, v: &mut V, [x0, y0, x1, y1]: [V::F32; 4]) -> [V::F32; 2] {
        let all = v.mask_all();
        let of_square = square(v, all, [x0, y0], [x1, y1]);
        let of_line = line(v, all, [x0, y0], [x1, y1]);
        [or_nothing(v, of_square).1, or_nothing(v, of_line).1]
    }
}

#[test]
fn parts_of_squares_and_lines_are_those_in_f64() {
    let mut random = Random(5);
    let mut edges: Vec<[f32; 4]> = Vec::new();
    for _ in 0..40_000 {
        let reach = power_of_ten(random.within(-6.0, 4.0));
        let mut place = || [random.within(-2.0, 2.0), random.within(-2.0, 2.0)].map(|x| (x * reach) as f32);
        let ([x0, y0], [x1, y1]) = (place(), place());
        edges.push([x0, y0, x1, y1]);
        // One that comes near the middle, from afar; level and upright ones.
        edges.push([x0, y0, -x0 + random.within(-2.0, 2.0) as f32, -y0 + random.within(-2.0, 2.0) as f32]);
        edges.push([x0, y0, x1, y0]);
        edges.push([x0, y0, x0, y1]);
    }
    edges.extend([
        [0.0; 4],
        [0.0, 0.0, 1.0, 1.0],
        [-1.0, 1.0, 1.0, 1.0],
        [1.0, 1.0, -1.0, -1.0],
        [3.0, 0.0, -3.0, 0.0],
    ]);
    let mut worst = [0.0_f64; 2];
    for (edge, found) in edges.iter().zip(evaluate(&Beyond, &edges)) {
        let [x0, y0, x1, y1] = edge.map(f64::from);
        let (a, b) = (DVec2::new(x0, y0), DVec2::new(x1, y1));
        for (k, part) in [square_beyond(a, b), line_beyond(a, b)].into_iter().enumerate() {
            let off = (f64::from(found[k]) - part).abs();
            worst[k] = worst[k].max(off);
            assert!(off < 4e-7, "{edge:?} {k}: {} and not {part}", found[k]);
        }
    }
    println!("square {:e}, line {:e}", worst[0], worst[1]);
}
