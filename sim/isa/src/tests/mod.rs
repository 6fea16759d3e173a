//! Every operation on every back end against independent scalar expressions and a dumb model of memory.

use crate::arena::Arena;
use crate::emit::OpCounts;
use crate::host::HostSimd;
use crate::kernel::AnyKernel;
use crate::stream::Stream;

mod lanes;
mod math;
mod memory;
mod one_op;
mod rows;
mod streams;

/// A small seeded generator (splitmix64).
struct Random(u64);

impl Random {
    fn word(&mut self) -> u32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ z >> 31) >> 16) as u32
    }

    fn below(&mut self, bound: u32) -> u32 {
        self.word() % bound
    }

    /// A word that is often a special float, a shift count or an extreme.
    fn lane(&mut self) -> u32 {
        const SPECIAL: [u32; 32] = [
            0,
            0x8000_0000,
            1,
            0x8000_0001,
            0x007f_ffff,
            0x807f_ffff,
            0x0080_0000,
            0x8080_0000,
            0x7f7f_ffff,
            0xff7f_ffff,
            0x7f80_0000,
            0xff80_0000,
            0x7fc0_0000,
            0xffc0_0000,
            0x7f80_0001,
            0xff80_0001,
            0x7fff_ffff,
            0xffff_ffff,
            0x7fa5_5aa5,
            0x3f80_0000,
            0xbf80_0000,
            0x3f00_0000,
            0x4f00_0000,
            0xcf00_0000,
            0xcf00_0001,
            0x4eff_ffff,
            31,
            32,
            33,
            0x4b00_0001,
            0x3fc0_0000,
            0x7e96_7699,
        ];
        match self.below(4) {
            0 => SPECIAL[self.below(32) as usize],
            1 => (self.below(2000) as f32 / 16.0 - 60.0).to_bits(),
            2 => self.below(40),
            _ => self.word(),
        }
    }

    fn mask(&mut self) -> u16 {
        match self.below(5) {
            0 => 0,
            1 => 0xffff,
            2 => 1 << self.below(16),
            _ => self.word() as u16,
        }
    }
}

/// The SIMD levels of this host; says which it lacks.
fn levels() -> Vec<HostSimd> {
    HostSimd::ALL
        .into_iter()
        .filter(|simd| {
            if !simd.is_available() {
                eprintln!("SKIPPED on {simd}: this host lacks it");
            }
            simd.is_available()
        })
        .collect()
}

/// Runs tasks `0..tasks` counting or recording; returns the class counts and masked lane-slots either way.
fn run(kernel: &impl AnyKernel, simd: HostSimd, arena: &Arena, tasks: u32, recording: bool) -> OpCounts {
    let mut counts = OpCounts::default();
    if !recording {
        kernel.run(simd, arena, 0..tasks, false, &mut counts);
        return counts;
    }
    let mut stream = Stream::default();
    for task in 0..tasks {
        kernel.record(simd, arena, task, &mut stream);
    }
    assert_eq!(stream.live_vectors_max.max(32), 32, "spills would be counted below");
    OpCounts { class_counts: stream.count_classes(), lanes_masked: stream.lanes_masked }
}

/// What is seen of a float: NaN is one value.
fn observed(bits: u32) -> u32 {
    if f32::from_bits(bits).is_nan() { 0x7fc0_0000 } else { bits }
}
