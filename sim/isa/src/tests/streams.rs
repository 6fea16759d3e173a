//! Streams as a whole.

use super::levels;
use crate::arena::{Addr, Arena, CONSTANT_LINE, Line, STACK_BASE_LINE, STACK_LINES};
use crate::examples::{Histogram, Saxpy, Transpose};
use crate::host::HostSimd;
use crate::kernel::{AnyKernel, Kernel};
use crate::program::Step;
use crate::stream::{Place, Stream, StreamLine};
use crate::uop::{Class, Uop};
use crate::vpu::Vpu;

/// Makes `live` vectors, waits `apart` uops, then adds them up from the youngest on.
struct Live {
    live: usize,
    apart: usize,
}

impl Kernel for Live {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, _: V::S32) {
        let first = v.vset_f32(0.0);
        let mut made = [first; 40];
        for slot in &mut made[1..self.live] {
            *slot = v.vset_f32(1.0);
        }
        // Past 32, each value made is charged: those of the sum too, until no more than 32 are live.
        // Masks and values that nobody reads take no vector register.
        for _ in 0..self.apart {
            v.mask_all();
        }
        let mut sum = made[self.live - 1];
        for value in made[..self.live - 1].iter().rev() {
            sum = v.vadd(sum, *value);
        }
        v.bits_of(sum);
    }
}

#[test]
fn vectors_past_the_32nd_are_charged_as_spills() {
    for apart in [0, 10, 1000] {
        for (live, spills) in [(31, 0), (32, 0), (33, 1), (40, 8 + 7)] {
            for simd in levels() {
                let mut stream = Stream::default();
                Live { live, apart }.record(simd, &Arena::new(), 0, &mut stream);
                let counts = stream.count_classes();
                let charged = (counts[Class::SpillStore as usize], counts[Class::SpillLoad as usize]);
                assert_eq!(
                    (stream.live_vectors_max as usize, charged),
                    (live, (spills, spills)),
                    "{apart} apart"
                );
                let slots = 16 * (2 * live as u64 - 1 + 2 * spills);
                assert_eq!(stream.lanes_active, slots);
            }
        }
    }
}

#[test]
fn a_line_says_where_it_lies() {
    assert_eq!(StreamLine::TASK_COUNTER.place(), Place::Runtime(0));
    assert_eq!(StreamLine::CONSTANTS.place(), Place::Runtime(CONSTANT_LINE.0));
    assert_eq!(StreamLine::arena(Addr(0).line()).place(), Place::Runtime(0));
    let first = Arena::new().overwritten(1).line();
    assert_eq!(StreamLine::arena(first).place(), Place::Arena(first.0));
    let last = Line(STACK_BASE_LINE - 1);
    assert_eq!(StreamLine::arena(last).place(), Place::Arena(last.0));
    for slot in [0, STACK_LINES - 1] {
        assert_eq!(StreamLine::stack(slot).place(), Place::Stack(slot));
    }
}

#[test]
fn the_stacks_of_hardware_threads_follow_one_another_and_the_arena_is_of_all() {
    for thread in [0, 1, 95, 4095] {
        for line in [0, 63, 64, STACK_BASE_LINE - 1] {
            assert_eq!(StreamLine::arena(Line(line)).resolved(thread), line);
        }
        let end = StreamLine::stack(STACK_LINES - 1).resolved(thread);
        assert_eq!(StreamLine::stack(0).resolved(thread + 1), end + 1);
        assert_eq!(end + 1 - STACK_LINES, STACK_BASE_LINE + thread * STACK_LINES);
    }
}

/// Carries a value from lane to scalar and back, needs a register too many, and touches the arena.
struct Stacked {
    word: Addr,
}

impl Kernel for Stacked {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let lanes = v.vsplat(task);
        let scalar = v.vextract(lanes, 3);
        v.s_store(self.word, task, scalar);
        Kernel::run(&Live { live: 33, apart: 0 }, v, task);
    }
}

#[test]
fn every_class_that_touches_the_stack_touches_that_of_its_own_hardware_thread() {
    let mut arena = Arena::new();
    let word = arena.overwritten(1);
    let mut stream = Stream::default();
    Stacked { word }.record(HostSimd::Portable, &arena, 0, &mut stream);
    let mut on_stack = Vec::new();
    let mut lines = stream.lines.iter();
    for uop in stream.uops.iter().map(|uop| Uop(*uop)) {
        for line in lines.by_ref().take(uop.lines()) {
            let [here, there] = [7, 8].map(|thread| line.resolved(thread));
            if let Place::Stack(slot) = line.place() {
                assert_eq!([here, there], [7, 8].map(|thread| STACK_BASE_LINE + thread * STACK_LINES + slot));
                on_stack.push(uop.class());
            } else {
                assert_eq!((here, there), (line.bits(), line.bits()), "{:?}", uop.class());
            }
        }
    }
    let vsplat = [Class::ScalarStore, Class::VectorBroadcastLoad];
    let vextract = [Class::VectorStore, Class::ScalarLoad];
    let spill = [Class::SpillStore, Class::SpillLoad];
    assert_eq!(on_stack, [vsplat, vextract, spill].concat());
}

/// Streams of whole programs, frozen: what is recorded must not change with how it is recorded.
#[test]
fn recorded_programs_are_the_same_bytes_as_ever() {
    fn mix(hash: &mut u64, word: u64) {
        *hash = (*hash ^ word).wrapping_mul(0x0000_0100_0000_01b3).rotate_left(23);
    }
    fn hash(simd: HostSimd, make: impl Fn(&mut Arena) -> Step) -> u64 {
        let mut arena = Arena::new();
        let step = make(&mut arena);
        let mut stream = Stream::default();
        let mut hash = 1;
        for task in 0..step.tasks() {
            stream.clear();
            step.kernel().record(simd, &arena, task, &mut stream);
            let lines = stream.lines.iter().map(|line| line.bits());
            stream.uops.iter().copied().chain(lines).for_each(|word| mix(&mut hash, u64::from(word)));
            mix(&mut hash, stream.lanes_active);
            mix(&mut hash, stream.lanes_masked);
            mix(&mut hash, u64::from(stream.live_vectors_max));
        }
        hash
    }
    for simd in levels() {
        let hashes = [
            hash(simd, |arena| Saxpy::new(arena, 5001).step()),
            hash(simd, |arena| Histogram::new(arena, 3000, 70).step()),
            hash(simd, |arena| Transpose::new(arena, 48, 80).step()),
        ];
        let frozen = [0x9976_ff4d_d553_7b9c, 0x1c87_3619_7292_6f36, 0x9f4e_59fd_47e8_3731];
        assert_eq!(hashes, frozen, "{simd}: {hashes:#x?}");
    }
}
