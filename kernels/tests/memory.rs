//! What arrays hold before somebody writes them: nothing that a kernel may rely on, unless a step has cleared it.

mod common;

use std::hash::{DefaultHasher, Hash, Hasher};

use common::{On, light_for, options_with_small_map, run_step, shipped};
use lrbsim_isa::arena::POISON;
use lrbsim_isa::{Addr, Arena, HostSimd, Kernel, Phase, Runner, Step, StepSource, Stream, TaskSource, Vpu};
use lrbsim_kernels::clear;
use lrbsim_kernels::irregular::receivers::Receivers;
use lrbsim_kernels::method::{METHODS, Method};
use lrbsim_kernels::sism::Sism;
use lrbsim_workloads::{Adjacency, ShadowInput};

const PHASE: Phase = Phase { id: "memory", title: "memory", in_paper_total: false };

/// Copies a line.
struct Copy {
    from: Addr,
    to: Addr,
}

impl Kernel for Copy {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let all = v.mask_all();
        let line = v.vload_i32(self.from, task);
        v.vstore_i32(all, self.to, task, line);
    }
}

#[test]
#[cfg(debug_assertions)]
fn a_kernel_that_reads_what_nobody_wrote_sees_poison() {
    let mut arena = Arena::new();
    let (from, to) = (arena.overwritten(16), arena.overwritten(16));
    let step = Step::ordered("copy", 1, Copy { from, to });
    run_step(&step, &mut arena, On::Host(HostSimd::detect(), 1));
    assert_eq!(arena.read_u32s(to, 16), [POISON; 16]);
}

#[test]
fn zeroed_arrays_are_cleared_by_one_step_that_takes_uops() {
    let mut arena = Arena::new();
    arena.poison_with(POISON);
    let mut steps = Vec::new();
    let mut run = |_: &Phase, step: &Step, arena: &mut Arena| {
        steps.push((step.name(), run_step(step, arena, On::Recording(HostSimd::detect()))));
        Ok(())
    };
    let mut runner = Runner::new(&mut arena, &mut run);
    runner.phase(&PHASE);
    let before = runner.arena.overwritten(1);
    let [few, many] = clear::zeroed(&mut runner, [1, 10_000]).expect("nothing stops it");
    let after = runner.arena.overwritten(1);

    assert_eq!(arena.read_u32s(few, 16), [0; 16]);
    assert_eq!(arena.read_u32s(many, 10_000), [0; 10_000]);
    assert_eq!([arena.read_u32(before), arena.read_u32(after)], [POISON; 2], "nothing else is cleared");
    let [(name, figures)] = steps[..] else { panic!("one step, not {}", steps.len()) };
    // A store a line.
    assert_eq!((name, figures.uops > 626), ("clear", true));
}

/// The streams of all steps, hashed, and the picture of `method`, where arrays hold `word` before they are written.
fn frame(
    method: &dyn Method,
    options: &str,
    input: &ShadowInput,
    word: u32,
) -> (Vec<(&'static str, u64)>, Vec<u32>) {
    let mut arena = Arena::new();
    arena.poison_with(word);
    let mut steps = Vec::new();
    let mut stream = Stream::default();
    let mut run = |_: &Phase, step: &Step, arena: &mut Arena| {
        let source = StepSource::new(step, arena, HostSimd::detect(), 1);
        let mut hasher = DefaultHasher::new();
        for task in 0..step.tasks() {
            source.record(task, &mut stream);
            stream.uops.hash(&mut hasher);
            stream.lines.iter().for_each(|line| line.bits().hash(&mut hasher));
            stream.lanes_masked.hash(&mut hasher);
        }
        steps.push((step.name(), hasher.finish()));
        Ok(())
    };
    let options = method.entry().options(options).expect("the method takes these");
    let shadows = method
        .run(&options, &mut input.clone(), &mut Runner::new(&mut arena, &mut run))
        .expect("nothing stops it");
    (steps, shadows.visibility.into_iter().map(f32::to_bits).collect())
}

#[test]
fn what_nobody_wrote_changes_neither_picture_nor_figures() {
    let each = METHODS.into_iter().map(|method| ("tiny", method, options_with_small_map(method)));
    let of_sism = ["overlap=sum", "overlap=product", "overlap=max", "lights=2", "form=printed,overlap=sum"];
    let of_sism = of_sism.map(|options| ("tiny", &Sism as &dyn Method, options));
    // The light is a point: it has no silhouettes and no parts.
    let palm = ["", "overlap=sum"].map(|options| ("palm", &Sism as &dyn Method, options));
    for (scene, method, options) in each.chain(of_sism).chain(palm) {
        let case = format!("{scene} by {} with {options:?}", method.entry().name);
        let (mut scene, eye, _) = shipped(scene, Some((96, 64)));
        scene.light = light_for(method, scene.light);
        let input = ShadowInput::new(&scene, &Adjacency::new(&scene.mesh), &eye);
        let (steps, picture) = frame(method, options, &input, 0);
        for word in [POISON, 1.0_f32.to_bits(), u32::MAX] {
            let (other_steps, other_picture) = frame(method, options, &input, word);
            for (step, other) in steps.iter().zip(&other_steps) {
                assert_eq!(step, other, "{case} and {word:#x}: the streams of a step");
            }
            assert_eq!(steps.len(), other_steps.len());
            assert!(picture == other_picture, "{case} and {word:#x}: the picture");
        }
        assert_eq!(picture.len(), input.receivers.len(), "{case}");
    }
}

#[test]
#[should_panic(expected = "the receivers of a frame are moved once")]
fn receivers_are_moved_and_their_pixels_stay() {
    let (_, _, mut input) = shipped("tiny", Some((16, 12)));
    let pixels = input.receiver_pixel.clone();
    let mut arena = Arena::new();
    let receivers = Receivers::new(&mut input, &mut arena);
    assert_eq!(receivers.count as usize, pixels.len());
    assert!(input.receivers.is_empty() && input.receiver_triangle.is_empty());
    assert_eq!(input.receiver_pixel, pixels);
    Receivers::new(&mut input, &mut arena);
}
