//! Operations that touch memory or move lanes, against a vector of words.

use super::one_op::{DATA_WORDS, OPS, OneOp, Op, PROLOGUE};
use super::{Random, levels, observed};
use crate::arena::{Addr, Arena, Line};
use crate::emit::OpCounts;
use crate::functional::run_functional;
use crate::host::HostSimd;
use crate::kernel::{AnyKernel, Kernel};
use crate::program::{Step, StepSource, TaskSource};
use crate::stream::{Place, Stream, StreamLine};
use crate::uop::{Class, Uop};
use crate::vpu::Vpu;

struct Expected {
    data: Vec<u32>,
    out: Vec<u32>,
    /// Class and lines of each uop of the operation, lines counted from the data's first.
    uops: Vec<(Class, Vec<u32>)>,
}

fn distinct(lines: impl Iterator<Item = u32>) -> Vec<u32> {
    let mut seen = Vec::new();
    for line in lines {
        if !seen.contains(&line) {
            seen.push(line);
        }
    }
    seen
}

fn model(op: Op, input: &[u32], before: &[u32]) -> Expected {
    let (a, or, index, expected) = (&input[..16], &input[16..32], &input[32..48], &input[48..64]);
    let (k, at) = (input[64], input[65] as usize);
    let on: Vec<usize> = (0..16).filter(|i| k >> i & 1 == 1).collect();
    let (mut data, mut out, mut uops) = (before.to_vec(), or.to_vec(), Vec::new());
    let span = |lanes: &[usize]| distinct(lanes.iter().map(|i| ((at + i) / 16) as u32));
    // A span's first and last line; there is none between.
    let ends = |lanes: &[usize]| match lanes {
        [] => vec![],
        [.., last] => span(&[lanes[0], *last]),
    };
    let all: Vec<usize> = (0..16).collect();
    let packed: Vec<usize> = (0..on.len()).collect();
    let lines_of = |lanes: &[usize]| distinct(lanes.iter().map(|i| index[*i] / 16));
    match op {
        Op::Load => {
            out.copy_from_slice(&data[at..at + 16]);
            uops.push((Class::VectorLoad, ends(&all)));
        }
        Op::LoadOr => {
            on.iter().for_each(|i| out[*i] = data[at + i]);
            uops.push((Class::VectorLoad, ends(&on)));
        }
        Op::Broadcast => {
            out.fill(data[at]);
            uops.push((Class::VectorBroadcastLoad, span(&[0])));
        }
        Op::Store => {
            on.iter().for_each(|i| data[at + i] = a[*i]);
            uops.push((Class::VectorStore, ends(&on)));
        }
        Op::StoreStream => {
            data[..16].copy_from_slice(a);
            uops.push((Class::VectorStreamStore, vec![0]));
        }
        Op::Expand => {
            on.iter().enumerate().for_each(|(n, i)| out[*i] = data[at + n]);
            uops.push((Class::VectorExpand, ends(&packed)));
        }
        Op::Compress => {
            on.iter().enumerate().for_each(|(n, i)| data[at + n] = a[*i]);
            uops.push((Class::VectorCompress, ends(&packed)));
        }
        Op::Gather => {
            on.iter().for_each(|i| out[*i] = data[index[*i] as usize]);
            uops.push((Class::Gather, lines_of(&on)));
        }
        Op::Scatter => {
            on.iter().for_each(|i| data[index[*i] as usize] = a[*i]);
            uops.push((Class::Scatter, lines_of(&on)));
        }
        Op::AtomicAdd | Op::AtomicCompareExchange => {
            for i in &on {
                let word = &mut data[index[*i] as usize];
                out[*i] = *word;
                if op == Op::AtomicAdd {
                    *word = word.wrapping_add(a[*i]);
                } else if *word == expected[*i] {
                    *word = a[*i];
                }
            }
            let mut rest = on;
            while !rest.is_empty() {
                let round: Vec<usize> = rest
                    .iter()
                    .copied()
                    .filter(|i| !rest.iter().any(|j| j < i && index[*j] == index[*i]))
                    .collect();
                uops.push((Class::AtomicGather, lines_of(&round)));
                uops.push((Class::VectorAlu, vec![]));
                uops.push((Class::AtomicScatter, lines_of(&round)));
                uops.extend([(Class::Mask, vec![]), (Class::Mask, vec![]), (Class::Branch, vec![])]);
                rest.retain(|i| !round.contains(i));
            }
        }
        Op::ScalarAtomicAdd => {
            out = vec![data[at]];
            data[at] = data[at].wrapping_add(at as u32);
            uops.push((Class::Atomic, span(&[0])));
        }
        Op::ScalarCompareExchange => {
            out = vec![data[at]];
            if data[at] == at as u32 {
                data[at] = 0;
            }
            uops.push((Class::Atomic, span(&[0])));
        }
        Op::ScalarLoad => {
            out = vec![data[at]];
            uops.push((Class::ScalarLoad, span(&[0])));
        }
        Op::ScalarStore => {
            data[at] = at as u32;
            uops.push((Class::ScalarStore, span(&[0])));
        }
        Op::PrefetchL1 => uops.push((Class::PrefetchL1, span(&[0]))),
        Op::PrefetchL2 => uops.push((Class::PrefetchL2, span(&[0]))),
        Op::GatherPrefetch => uops.push((Class::GatherPrefetch, lines_of(&on))),
        Op::Extract => {
            out = vec![a[5]];
            uops.extend([(Class::VectorStore, vec![u32::MAX]), (Class::ScalarLoad, vec![u32::MAX])]);
        }
        Op::Splat => {
            out.fill(at as u32);
            uops.extend([(Class::ScalarStore, vec![u32::MAX]), (Class::VectorBroadcastLoad, vec![u32::MAX])]);
        }
        Op::Blend => {
            on.iter().for_each(|i| out[*i] = a[*i]);
            uops.push((Class::VectorAlu, vec![]));
        }
        Op::Bits => out = a.iter().map(|bits| observed(*bits)).collect(),
        Op::BranchAny => {
            if k != 0 {
                out.copy_from_slice(a);
            }
            uops.extend([(Class::Mask, vec![]), (Class::Branch, vec![])]);
        }
        Op::Cdab | Op::Badc | Op::QuadsCdab | Op::QuadsBadc => {
            let flip = match op {
                Op::Cdab => 1,
                Op::Badc => 2,
                Op::QuadsCdab => 4,
                _ => 8,
            };
            out = (0..16usize).map(|i| observed(a[i ^ flip])).collect();
            uops.push((Class::VectorShuffle, vec![]));
        }
        Op::PermuteFloat => {
            out = index.iter().map(|i| observed(or[(i & 15) as usize])).collect();
            uops.push((Class::VectorShuffle, vec![]));
        }
    }
    Expected { data, out, uops }
}

#[test]
fn memory_operations_agree_with_a_vector_of_words_on_every_back_end() {
    let mut random = Random(2);
    let mut arena = Arena::new();
    let input_at = arena.overwritten(5 * 16);
    let out = arena.overwritten(16);
    let data_at = arena.overwritten(DATA_WORDS as u64);
    let levels = levels();
    for round in 0..1500 {
        let op = OPS[round % OPS.len()];
        let mut input: Vec<u32> = (0..80).map(|_| random.lane()).collect();
        let k = u32::from(random.mask());
        // Few distinct indices make lanes conflict; lanes that are off point anywhere.
        let bound = [DATA_WORDS as u32, 3, 40][random.below(3) as usize];
        for i in 0..16 {
            if k >> i & 1 == 1 {
                input[32 + i] = random.below(bound);
            }
        }
        // Up to the arena's end, and past it where the lanes beyond are off.
        let reach = match op {
            Op::Load => 16,
            Op::LoadOr | Op::Store => 32 - k.leading_zeros(),
            Op::Expand | Op::Compress => k.count_ones(),
            _ => 1,
        };
        let last = DATA_WORDS as u32 - reach;
        (input[64], input[65]) = (k, if random.below(3) == 0 { last } else { random.below(last + 1) });
        let data: Vec<u32> =
            (0..DATA_WORDS as u32).map(|i| if i % 3 == 0 { i } else { random.lane() }).collect();
        for i in 0..16 {
            // Make some compare-exchanges succeed.
            if i % 2 == 0 && k >> i & 1 == 1 {
                input[48 + i] = data[input[32 + i] as usize];
            }
        }
        let right = model(op, &input, &data);
        let kernel = OneOp { op, input: input_at, data: data_at, out };
        let mut first: Option<Stream> = None;
        for &simd in &levels {
            for recording in [false, true] {
                arena.write_u32s(input_at, &input);
                arena.write_u32s(data_at, &data);
                let (mut stream, mut counts) = (Stream::default(), OpCounts::default());
                if recording {
                    kernel.record(simd, &arena, 0, &mut stream);
                } else {
                    AnyKernel::run(&kernel, simd, &arena, 0..1, false, &mut counts);
                }
                let at = format!("{op:?} on {simd}, recording {recording}, round {round}, input {input:x?}");
                assert_eq!(arena.read_u32s(data_at, DATA_WORDS), right.data, "memory of {at}");
                assert_eq!(arena.read_u32s(out, right.out.len()), right.out, "result of {at}");
                if recording {
                    check_stream(&stream, &right.uops, data_at, &at);
                    assert_eq!(stream, *first.get_or_insert(stream.clone()), "stream of {at}");
                }
                if let (false, Some(stream)) = (recording, &first) {
                    assert_eq!(counts.class_counts, stream.count_classes(), "{at}");
                    assert_eq!(counts.lanes_masked, stream.lanes_masked, "{at}");
                    assert_eq!(counts.lanes_active(), stream.lanes_active, "{at}");
                }
            }
        }
    }
}

/// The uops between prologue and final store are those expected, with their lines.
fn check_stream(stream: &Stream, expected: &[(Class, Vec<u32>)], data: Addr, at: &str) {
    assert_eq!(stream.uops.len(), PROLOGUE + expected.len() + 1, "uops of {at}");
    let mut lines = stream.lines.iter();
    for (i, uop) in stream.uops.iter().enumerate() {
        let uop = Uop(*uop);
        let own: Vec<StreamLine> = lines.by_ref().take(uop.lines()).copied().collect();
        let Some((class, right)) = i.checked_sub(PROLOGUE).and_then(|i| expected.get(i)) else { continue };
        assert_eq!(uop.class(), *class, "class of {at}");
        if right == &[u32::MAX] {
            assert!(
                matches!(own.as_slice(), [line] if matches!(line.place(), Place::Stack(_))),
                "stack line of {at}"
            );
            continue;
        }
        let right: Vec<StreamLine> =
            right.iter().map(|line| StreamLine::arena(Line(line + data.line().0))).collect();
        assert_eq!(own, right, "lines of {at}");
    }
    assert_eq!(lines.next(), None, "lines left over of {at}");
}

#[test]
fn lines_are_right_where_word_numbers_outgrow_32_bits() {
    let mut arena = Arena::new();
    let input = arena.alloc_u32(&[0; 80]);
    let out = arena.overwritten(16);
    let huge = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| arena.alloc_bytes(17 << 30)));
    if huge.is_err() {
        eprintln!("SKIPPED: this host reserves less than 17 GiB of address space");
        return;
    }
    let data = Addr((16 << 30) - 128);
    let mut words = vec![0; 80];
    (0..16).for_each(|i| words[32 + i] = 5 * i as u32);
    words[64] = 0xffff;
    arena.write_u32s(input, &words);
    (0..80).for_each(|i| arena.write_u32(data.plus(4 * i), i as u32));
    let kernel = OneOp { op: Op::Gather, input, data, out };
    for simd in levels() {
        let mut stream = Stream::default();
        kernel.record(simd, &arena, 0, &mut stream);
        check_stream(&stream, &[(Class::Gather, (0..5).collect())], data, "a gather across 16 GiB");
        assert_eq!(arena.read_u32s(out, 16), words[32..48], "{simd}");
    }
}

#[test]
fn an_active_lane_past_the_end_stops_the_run() {
    for simd in levels() {
        for bad in [DATA_WORDS as u32, 0x7fff_ffff, 0x8000_0000, u32::MAX] {
            let mut arena = Arena::new();
            let input = arena.alloc_u32(&[0; 80]);
            let out = arena.overwritten(16);
            let data = arena.overwritten(DATA_WORDS as u64);
            arena.write_u32(input.plus(4 * (32 + 7)), bad);
            arena.write_u32(input.plus(4 * 64), 1 << 7);
            for op in [Op::Gather, Op::Scatter, Op::AtomicAdd, Op::AtomicCompareExchange] {
                let kernel = OneOp { op, input, data, out };
                let ended = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
                    AnyKernel::run(&kernel, simd, &arena, 0..1, false, &mut OpCounts::default());
                }));
                assert!(ended.is_err(), "{op:?} at {bad:#x} on {simd}");
            }
            // A prefetch there asks for nothing.
            let mut stream = Stream::default();
            OneOp { op: Op::GatherPrefetch, input, data, out }.record(simd, &arena, 0, &mut stream);
            check_stream(&stream, &[(Class::GatherPrefetch, vec![])], data, "a prefetch past the end");
        }
    }
}

/// Writes word `task / 2`, or adds to it.
struct Pairs {
    words: Addr,
    add: bool,
}

impl Kernel for Pairs {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let one = v.s_imm(1);
        let pair = v.s_shr(task, one);
        if self.add {
            v.s_atomic_add(self.words, pair, one);
        } else {
            let first = v.kmov_from_scalar(one);
            let value = v.vset_i32(1);
            v.vstore_i32(first, self.words, pair, value);
        }
    }
}

/// Runs so many tasks of [`Pairs`], declared independent, on one host thread.
#[expect(unsafe_code, reason = "the tests are about steps that are declared independent")]
fn run_pairs(tasks: u32, add: bool) -> u32 {
    let mut arena = Arena::new();
    let words = arena.alloc_u32(&[0; 16]);
    // SAFETY: they run on one host thread, one after the other.
    let step = unsafe { Step::independent("pairs", tasks, Pairs { words, add }) };
    run_functional(&step, &mut arena, HostSimd::detect(), 1);
    arena.read_u32(words)
}

#[test]
#[cfg(debug_assertions)]
#[should_panic(expected = "is written by task 0 and by task 1 of a step that is declared independent")]
fn tasks_of_an_independent_step_that_write_one_word_are_caught() {
    run_pairs(2, false);
}

#[test]
fn tasks_of_an_independent_step_may_add_to_one_word() {
    assert_eq!((run_pairs(1, false), run_pairs(2, true)), (1, 2));
}

#[test]
#[should_panic(expected = "task 1 of step `pairs` is run twice")]
fn a_task_runs_once() {
    let mut arena = Arena::new();
    let words = arena.alloc_u32(&[0; 16]);
    let step = Step::ordered("pairs", 2, Pairs { words, add: true });
    let source = StepSource::new(&step, &mut arena, HostSimd::detect(), 1);
    source.skip(0..2, &mut OpCounts::default());
    source.record(1, &mut Stream::default());
}
