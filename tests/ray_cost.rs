//! What a packet of 16 rays against a triangle costs on the machine, beside what was published for the chip.

mod common;

use lrbsim_isa::program::StepSource;
use lrbsim_isa::{Addr, Arena, Compare, HostSimd, Kernel, Step, Vpu};
use lrbsim_kernels::raytrace::trace::{hit, packet};
use lrbsim_kernels::raytrace::tree::RayTriangle;
use lrbsim_kernels::record::Records;
use lrbsim_machine::{Chip, Fidelity};

/// Cycles of a core for 16 rays against a triangle on Larrabee [seiler08, §6.4].
const PUBLISHED: f64 = 47.0;

/// Triangles that rays are tested against: they fit in L1 beside each other.
const TRIANGLES: u32 = 64;

/// Tasks, one for each of the four threads of a core.
const TASKS: u32 = 4;

/// Tests a packet of 16 rays against all triangles, so many times.
struct Tests {
    triangles: Records<RayTriangle>,
    times: u32,
    hits: Addr,
}

impl Kernel for Tests {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let (zero, one) = (v.vset_f32(0.0), v.vset_f32(1.0));
        let own = v.vset_i32(-1);
        let rays = packet(v, [one, zero, one], [zero, zero, zero], own);
        let mut left = v.mask_all();
        let step = v.s_imm(1);
        let (times, triangles) = (v.s_imm(self.times as i32), v.s_imm(TRIANGLES as i32));
        let mut time = v.s_imm(0);
        while v.branch(Compare::Less, time, times) {
            let mut number = v.s_imm(0);
            while v.branch(Compare::Less, number, triangles) {
                let triangle = self.triangles.record(v, number);
                let hits = hit(v, left, &rays, triangle);
                left = v.kandn(hits, left);
                number = v.s_add(number, step);
            }
            time = v.s_add(time, step);
        }
        let bits = v.kmov_to_scalar(left);
        v.s_store(self.hits, task, bits);
    }
}

/// Cycles of a core that tests `times` times.
fn cycles(fidelity: Fidelity, times: u32) -> u64 {
    let spec = common::machine(&["cores=1"]).spec;
    let mut chip = Chip::new(&spec, fidelity, 1);
    let mut arena = Arena::new();
    let hits = arena.overwritten(16);
    // Triangles of no area, which nothing hits: all rays are tested against all.
    let words = TRIANGLES as usize * size_of::<RayTriangle>() / 4;
    let triangles = Records::from_base(arena.alloc_f32(&vec![0.0; words]));
    let step = Step::ordered("rays", TASKS, Tests { triangles, times, hits });
    let cycles =
        chip.run_step(&StepSource::new(&step, &mut arena, HostSimd::detect(), 1)).expect("moves").cycles;
    assert_eq!(arena.read_u32(hits), 0xffff, "no ray hits");
    cycles
}

#[test]
fn sixteen_rays_against_a_triangle_cost_what_was_published() {
    for fidelity in [Fidelity::Windowed, Fidelity::Cycle] {
        let more = cycles(fidelity, 24) - cycles(fidelity, 8);
        let each = more as f64 / f64::from(16 * TRIANGLES * TASKS);
        println!(
            "{fidelity}: {each:.1} cycles of a core for 16 rays against a triangle, {PUBLISHED} published"
        );
        assert!((each / PUBLISHED - 1.0).abs() < 0.15, "{fidelity}: {each:.1} cycles, {PUBLISHED} published");
    }
}
