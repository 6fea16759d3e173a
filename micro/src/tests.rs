use super::*;
use lrbsim_isa::host::HostSimd;
use lrbsim_isa::program::{StepSource, TaskSource};
use lrbsim_isa::stream::Stream as Uops;
use lrbsim_isa::uop::Class;

const CORES: u32 = 4;

/// Uops of the long pass beyond those of the short one by class, the long one's lines in order, and the units.
fn measured(bench: Bench) -> ([i64; Class::COUNT], Vec<u32>, u64) {
    let mut prepared = bench.prepare(CORES);
    let (mut counts, mut lines) = ([0; Class::COUNT], Vec::new());
    let [.., short, long] = &prepared.passes[..] else { panic!("two passes are measured") };
    for (step, is_long) in [(short, false), (long, true)] {
        let source = StepSource::new(step, &mut prepared.arena, HostSimd::Portable, 1);
        let mut stream = Uops::default();
        for task in 0..source.tasks() {
            source.record(task, &mut stream);
            for (sum, count) in counts.iter_mut().zip(stream.count_classes()) {
                let count = i64::try_from(count).expect("few");
                *sum += if is_long { count } else { -count };
            }
            if is_long {
                lines.extend(stream.lines.iter().map(|line| line.bits()));
            }
        }
    }
    (counts, lines, prepared.units)
}

#[test]
fn a_chase_loads_as_often_as_it_says_and_in_its_order() {
    let order = Order::Stride { count: 8, stride_bytes: 4096 };
    let (counts, lines, units) = measured(Bench::Chase(Chase { order, warm_loads: 64, loads: 256 }));
    // The load of where the thread starts is in both passes.
    assert_eq!((counts[Class::ScalarLoad as usize], units), (192, 192));
    let distinct: std::collections::BTreeSet<u32> = lines[1..].iter().copied().collect();
    assert_eq!(distinct.len(), 8);
    assert_eq!((lines[2] - lines[1], lines[9] - lines[1]), (64, 0));
}

#[test]
fn a_random_chase_visits_every_line_once_a_lap() {
    let order = Order::Random { bytes: 64 * 256 };
    let (_, lines, _) = measured(Bench::Chase(Chase { order, warm_loads: 0, loads: 256 }));
    let distinct: std::collections::BTreeSet<u32> = lines[1..].iter().copied().collect();
    assert_eq!(distinct.len(), 256);
}

#[test]
fn a_stream_touches_what_it_counts() {
    for (reads, store) in [(1, Store::No), (0, Store::Ordinary), (2, Store::InPlace), (2, Store::Streaming)] {
        let stream = Stream {
            reads,
            store,
            prefetch: Prefetch::No,
            arrays: Arrays::Split { bytes: 1 << 20 },
            threads: Threads::Spread(3),
            extent: Extent::Onward { warm_lines: 8, lines: 64 },
        };
        let (counts, _, units) = measured(Bench::Stream(stream));
        let classes = [Class::VectorLoad, Class::VectorStore, Class::VectorStreamStore];
        let touched: i64 = classes.iter().map(|class| counts[*class as usize]).sum();
        assert_eq!(touched as u64 * 64, units, "{reads} {store:?}");
        let turns = i64::from(3 * (64 - 16) / Stream::UNROLL);
        let of_the_loop = counts[Class::ScalarAlu as usize] + counts[Class::Branch as usize];
        assert_eq!(of_the_loop, turns * i64::from(Stream::LOOP_UOPS), "{reads} {store:?}");
    }
}

#[test]
fn threads_on_one_core_are_tasks_that_many_cores_apart() {
    let issue = |threads| Issue { operation: Operation::Multiply, chains: 2, threads };
    for threads in [Threads::Spread(3), Threads::OnCore { core: 2, threads: 3 }] {
        let (counts, _, units) = measured(Bench::Issue(issue(threads)));
        assert_eq!(counts[Class::VectorMul as usize] as u64, units);
        assert_eq!(units, 3 * 2 * 64 * (256 - 64));
    }
    let prepared = Bench::Issue(issue(Threads::OnCore { core: 2, threads: 3 })).prepare(CORES);
    assert_eq!(prepared.passes[0].tasks(), 2 + 2 * CORES + 1);
}

#[test]
fn a_gather_touches_its_distinct_lines() {
    for lines in [1, 2, 4, 8, 16] {
        let (counts, touched, units) = measured(Bench::Gather(Gather { lines, table_bytes: 1 << 14 }));
        assert_eq!(counts[Class::Gather as usize] as u64, units);
        assert!(touched.len() as u64 >= units * u64::from(lines));
    }
}

#[test]
fn a_contended_line_is_one_line() {
    let (counts, _, units) =
        measured(Bench::Atomic(Atomic { line: LockedLine::Contended, operation: LineOperation::Add }));
    assert_eq!(counts[Class::Atomic as usize] as u64, units);
    assert_eq!(units, (256 - 64) * u64::from(CORES));
}
