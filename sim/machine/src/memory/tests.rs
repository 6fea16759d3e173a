use super::*;
use crate::config::{MachineConfig, builtin_machine};

fn spec() -> MemorySpec {
    let config: MachineConfig =
        serde_json::from_str(builtin_machine("larrabee-24").expect("shipped")).expect("parses");
    config.validate().expect("sound").memory
}

#[test]
fn an_idle_read_takes_the_row_miss_latency_and_then_the_row_hit_latency() {
    let spec = spec();
    let mut memory = Memory::new(&spec);
    assert_eq!(memory.read(0, 1000), 1000 + spec.row_miss_cycles);
    assert_eq!(memory.read(spec.controllers, 2000), 2000 + spec.row_hit_cycles);
}

#[test]
fn streaming_reaches_the_peak_bandwidth_and_no_more() {
    let spec = spec();
    let mut memory = Memory::new(&spec);
    let lines = 1200;
    // All asked for at once: what counts is when the last leaves.
    let last = (0..lines).map(|line| memory.read(line, 0)).max().expect("lines");
    let cycles_at_peak = u64::from(lines / spec.controllers) * spec.line_interval_x256 / 256;
    assert!(last >= cycles_at_peak, "{last} cycles beat the peak, {cycles_at_peak}");
    assert!(
        last <= cycles_at_peak + spec.row_miss_cycles + spec.row_cycle_cycles,
        "{last} > {cycles_at_peak}"
    );
}

#[test]
fn one_bank_opens_one_row_in_a_row_cycle() {
    let mut spec = spec();
    spec.banks = 1;
    spec.controllers = 1;
    let mut memory = Memory::new(&spec);
    let first = memory.read(0, 0);
    let second = memory.read(spec.row_lines, 0);
    assert_eq!(second - first, spec.row_cycle_cycles);
}

#[test]
fn every_access_is_a_row_hit_or_a_row_miss() {
    let mut memory = Memory::new(&spec());
    for line in 0..5000_u32 {
        memory.read(line.wrapping_mul(2_654_435_761) >> 8, u64::from(line));
    }
    let counters = memory.counters;
    assert_eq!(counters.row_hits + counters.row_misses, counters.reads + counters.writes);
}
