//! A toy of a method, all of it: its name, an option, a phase, a kernel and what comes out. `docs/adding-a-method.md` walks
//! through a larger one.
//!
//! Every receiver begins with the whole light, which is halved until no receiver sees more than `floor`: a phase of as many
//! steps as the data wants.

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::options::{Entry, OptionSpec, Options, Values};
use lrbsim_isa::{Addr, Compare, Kernel, Phase, Runner, Step, Stopped, Vpu};
use lrbsim_kernels::clear;
use lrbsim_kernels::columns::{lanes_below, task_range};
use lrbsim_kernels::method::{Method, Shadows};
use lrbsim_workloads::ShadowInput;

/// The method.
pub struct Toy;

const HALVE: Phase = Phase { id: "halve", title: "halving", in_paper_total: false };

/// Receivers of a task.
const TASK: u32 = 256;

impl Method for Toy {
    fn entry(&self) -> Entry {
        Entry {
            name: "toy",
            about: "half the light, again and again",
            options: &[OptionSpec {
                name: "floor",
                about: "the light at which it is dark enough",
                values: Values::Number(0.001, 1.0),
                default: "0.1",
                tacit: false,
            }],
        }
    }

    fn phases(&self) -> &'static [Phase] {
        &[HALVE]
    }

    fn run(
        &self,
        options: &Options,
        input: &mut ShadowInput,
        runner: &mut Runner<'_>,
    ) -> Result<Shadows, Stopped> {
        // What the host may do untimed: put the input there, allocate, read totals between steps.
        let count = input.receivers.len() as u32;
        let light = runner.arena.alloc_f32(&vec![1.0; count.next_multiple_of(16) as usize]);
        let floor = options.number("floor") as f32;

        runner.phase(&HALVE);
        loop {
            let [too_bright] = clear::zeroed(runner, [1])?;
            let kernel = Halve { light, too_bright, floor, count };
            // SAFETY: each task halves the light of its own receivers, and all add to the counter.
            runner.run(&unsafe { Step::independent("halve", count.div_ceil(TASK), kernel) })?;
            if runner.arena.read_u32(too_bright) == 0 {
                break;
            }
        }
        let visibility = (0..count).map(|i| runner.arena.read_f32(light.plus_words(u64::from(i))));
        Ok(Shadows { visibility: visibility.collect(), silhouette_edges: None })
    }
}

/// Halves the light of receivers, and counts those that see more than `floor` of it still.
struct Halve {
    light: Addr,
    too_bright: Addr,
    floor: f32,
    count: u32,
}

impl Kernel for Halve {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let (mut i, end) = task_range(v, task, TASK, self.count);
        let zero = v.vset_f32(0.0);
        let half = v.vset_f32(0.5);
        let floor = v.vset_f32(self.floor);
        let step = v.s_imm(16);
        let mut bright = v.s_imm(0);
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let light = v.vload_f32_or(zero, live, self.light, i);
            let light = v.vmul(light, half);
            v.vstore_f32(live, self.light, i, light);
            let above = v.vcmp_gt_masked(live, light, floor);
            let bits = v.kmov_to_scalar(above);
            let more = v.s_popcnt(bits);
            bright = v.s_add(bright, more);
            i = v.s_add(i, step);
        }
        let at = v.s_imm(0);
        v.s_atomic_add(self.too_bright, at, bright);
    }
}
