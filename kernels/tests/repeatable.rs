//! One picture whatever computes it, and how long its tasks are.

mod common;

use common::{On, Run, TASK_UOPS, back_ends, shipped};
use lrbsim_isa::{HostSimd, VECTOR_REGISTERS};

#[test]
fn every_back_end_gives_the_same_picture() {
    let input = shipped("tiny", None).2;
    let mut all = back_ends();
    all.push(On::Host(HostSimd::detect(), 2));
    let bits = |on| -> Vec<u32> { Run::new(&input, on).visibility().into_iter().map(f32::to_bits).collect() };
    let first = bits(all[0]);
    for &on in &all[1..] {
        assert!(bits(on) == first, "{on:?} gives another picture than {:?}", all[0]);
    }
}

/// FNV-1a of the picture that all hosts must give, bit by bit. It changes with the scene, and with whatever in the kernels
/// moves a single bit of it: never by accident.
const SALOON_AT_80_BY_60: u64 = 0x5847_f3cd_6693_2aa2;

#[test]
fn a_scene_of_the_paper_has_one_picture_on_every_back_end_and_host() {
    let input = shipped("saloon", Some((80, 60))).2;
    for on in back_ends() {
        let bytes = Run::new(&input, on).visibility().into_iter().flat_map(f32::to_le_bytes);
        let hash = bytes
            .fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3));
        assert_eq!(hash, SALOON_AT_80_BY_60, "{on:?}: 0x{hash:016x}");
    }
}

/// Prints the longest task and the register pressure of each step, and holds them.
fn figures(name: &str, size: Option<(u32, u32)>) {
    let input = shipped(name, size).2;
    let run = Run::new(&input, On::Recording(HostSimd::detect()));
    for (phase, uops) in &run.phases {
        println!("{name} {phase:12} {uops:>10} uops");
    }
    for (step, figures) in &run.steps {
        println!(
            "{name} {step:18} {:>6} tasks {:>9} uops, longest {:>6}, live vectors {}",
            figures.tasks, figures.uops, figures.longest_task, figures.live_vectors_max
        );
        assert!(figures.longest_task < TASK_UOPS, "{step}: a task of {} uops", figures.longest_task);
        // Spills are charged; a few are the price of a kernel that holds its constants in registers.
        let most = VECTOR_REGISTERS + 8;
        assert!(figures.live_vectors_max <= most, "{step}: {} live vectors", figures.live_vectors_max);
    }
}

#[test]
fn tasks_of_tiny_are_short() {
    figures("tiny", None);
}

#[test]
fn tasks_of_the_small_saloon_are_short() {
    figures("saloon-small", None);
}
