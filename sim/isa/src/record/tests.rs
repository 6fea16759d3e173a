use super::buffers::IDS_AT_FIRST;
use super::*;
use crate::lanes::{LANES, Portable};
use crate::stream::{Stream, StreamLine};

#[test]
fn the_youngest_producers_are_kept() {
    let mut kept = youngest_three([5, 9, 1, 7, 8]);
    kept.sort_unstable();
    assert_eq!(kept, [7, 8, 9]);
    let mut kept = youngest_two([5, 1, 9, 7]);
    kept.sort_unstable();
    assert_eq!(kept, [7, 9]);
}

fn arena_lines(numbers: impl IntoIterator<Item = u32>) -> Vec<StreamLine> {
    numbers.into_iter().map(|number| StreamLine::arena(Line(number))).collect()
}

fn record_in(buffers: &mut Buffers, task: impl FnOnce(&mut Record<'_>)) -> Stream {
    let mut stream = Stream::default();
    assert!(buffers.prepare());
    let mut record = Record::new(buffers);
    task(&mut record);
    let recorded = record.recorded();
    buffers.finish::<Portable>(recorded, &mut stream);
    stream
}

fn record(task: impl FnOnce(&mut Record<'_>)) -> Stream {
    Buffers::with(|buffers| record_in(buffers, task))
}

#[test]
fn a_constant_and_a_far_producer_are_no_dependency() {
    let stream = record(|record| {
        let first = record.alu(Class::VectorAlu, [Record::NONE]);
        for _ in 0..DISTANCE_MAX - 1 {
            record.alu(Class::VectorAlu, []);
        }
        record.alu(Class::VectorAlu, [first, Record::NONE]);
        record.alu(Class::VectorAlu, [first]);
    });
    let distances: Vec<_> = stream.uops.iter().rev().take(2).map(|uop| uop >> 8 & 0xff).collect();
    assert_eq!(distances, [0, DISTANCE_MAX]);
    assert_eq!(stream.uops[0] >> 8, 0);
}

#[test]
fn tasks_do_not_see_what_earlier_ones_left() {
    let task = |record: &mut Record<'_>| {
        let made: [usize; 20] = core::array::from_fn(|_| record.alu(Class::VectorAlu, []));
        record.line(StreamLine::arena(Line(7)));
        made.into_iter().for_each(|id| record.reads([id]));
        record.alu(Class::VectorAlu, [made[0], made[1], made[19]]);
    };
    let first = record(task);
    assert_eq!(first, record(task));
    assert_eq!((first.live_vectors_max, first.lines), (20, arena_lines([7])));
}

#[test]
fn a_task_that_panics_leaves_nothing_behind() {
    let broken = std::panic::catch_unwind(|| {
        record(|record| {
            let made = record.alu(Class::VectorAlu, []);
            record.reads([made]);
            panic!("a defect of the kernel");
        })
    });
    assert!(broken.is_err());
    let stream = record(|record| {
        record.alu(Class::VectorAlu, []);
    });
    assert_eq!(stream.live_vectors_max, 0);
}

#[test]
#[should_panic(expected = "its loops must branch")]
fn a_run_without_a_branch_is_stopped_before_its_places_end() {
    record(|record| {
        for _ in 0..RUN_UOPS_MAX {
            record.alu(Class::ScalarAlu, []);
        }
    });
}

#[test]
fn the_longest_run_fits_behind_the_last_branch_that_asks_for_no_more() {
    let mut buffers = Buffers::new();
    let uops = IDS_AT_FIRST - FIRST_ID - 1 + RUN_UOPS_MAX;
    let stream = record_in(&mut buffers, |record| {
        for _ in 0..IDS_AT_FIRST - FIRST_ID - 1 {
            record.alu(Class::Branch, []);
        }
        for id in 0..RUN_UOPS_MAX {
            let (k, lines) = (u16::MAX, core::array::from_fn(|lane| (id * LANES + lane) as i32));
            assert_eq!(record.distinct_lines::<Portable>(k, lines), 16);
            // The last is a branch, which then asks for more.
            let class = if id == RUN_UOPS_MAX - 1 { Class::Branch } else { Class::Gather };
            record.memory(class, [], 16);
        }
    });
    assert_eq!(stream.uops.len(), uops);
    assert_eq!(stream.lines, arena_lines(0..(RUN_UOPS_MAX * LANES) as u32));
}

/// `uops` uops with a load at every thousandth, a branch after it, and each reading the one before.
fn chain(record: &mut Record<'_>, uops: u32) {
    let mut before = record.alu(Class::VectorAlu, []);
    let mut i = 1;
    while i < uops {
        record.reads([before]);
        if i % 1000 == 0 {
            record.line(StreamLine::arena(Line(i)));
            before = record.memory(Class::VectorLoad, [before], 1);
            record.alu(Class::Branch, [before]);
            i += 1;
        } else {
            before = record.alu(Class::VectorAlu, [before]);
        }
        i += 1;
    }
}

#[test]
fn a_task_of_ten_million_uops_is_recorded_whole() {
    const UOPS: u32 = 10_000_000;
    let stream = record(|record| chain(record, UOPS));
    assert!(!stream.cut_short);
    assert_eq!(stream.uops.len(), UOPS as usize);
    assert_eq!(stream.lines, arena_lines((1000..UOPS).step_by(1000)));
    let near = |uop: &u32| matches!(uop >> 8 & 0xff, 1 | 2);
    assert!(stream.uops[1..].iter().all(near));
    assert_eq!(stream.live_vectors_max, 1);
}

#[test]
fn a_task_past_all_bounds_is_said_to_be_cut_short_and_the_next_is_not() {
    let mut buffers = Buffers::new();
    buffers.ids_max = 4 * IDS_AT_FIRST;
    let short = |buffers: &mut Buffers| record_in(buffers, |record| chain(record, 5000));
    let before = short(&mut buffers);
    for uops in [4 * IDS_AT_FIRST, 4 * IDS_AT_FIRST + 1000, 20 * IDS_AT_FIRST] {
        let long = record_in(&mut buffers, |record| chain(record, uops as u32));
        assert!(long.cut_short, "{uops}");
        assert_eq!((long.uops.len(), long.lines.len(), long.lanes_active), (0, 0, 0));
        assert_eq!(short(&mut buffers), before, "after {uops}");
    }
    let long = record_in(&mut buffers, |record| chain(record, 3 * IDS_AT_FIRST as u32));
    assert_eq!((long.cut_short, long.uops.len()), (false, 3 * IDS_AT_FIRST));
}
