use super::*;
use serde_json::Value;
use std::collections::BTreeSet;

fn shipped(name: &str) -> MachineConfig {
    serde_json::from_str(builtin_machine(name).expect("shipped")).expect("parses")
}

/// Paths of all numbers in a machine's JSON, and of all its fields.
fn paths(value: &Value, at: &str, numbers: &mut BTreeSet<String>, fields: &mut BTreeSet<String>) {
    fields.insert(at.to_owned());
    match value {
        Value::Object(members) => {
            for (key, member) in members {
                if key != "sources" {
                    let path = if at.is_empty() { key.clone() } else { format!("{at}.{key}") };
                    paths(member, &path, numbers, fields);
                }
            }
        }
        Value::Number(_) => {
            numbers.insert(at.to_owned());
        }
        _ => {}
    }
}

#[test]
fn every_shipped_machine_is_sound_and_named_as_its_file() {
    for name in builtin_machine_names() {
        let config = shipped(name);
        assert_eq!(config.name, *name);
        config.validate().expect("sound");
    }
    assert_eq!(builtin_machine("larrabee-25"), None);
}

#[test]
fn every_number_has_a_source_and_every_source_a_field() {
    for name in builtin_machine_names() {
        let value: Value = serde_json::from_str(builtin_machine(name).expect("shipped")).expect("parses");
        let (mut numbers, mut fields) = (BTreeSet::new(), BTreeSet::new());
        paths(&value, "", &mut numbers, &mut fields);
        let sources = shipped(name).sources;
        for number in &numbers {
            assert!(sources.contains_key(number), "{name}: `{number}` has no source");
        }
        for (path, source) in &sources {
            assert!(fields.contains(path), "{name}: source of `{path}`, which does not exist");
            let kinds = ["published: ", "derived: ", "assumed: "];
            assert!(kinds.iter().any(|kind| source.starts_with(kind)), "{name}: `{path}`: {source}");
        }
    }
}

#[test]
fn unsound_numbers_are_refused_by_path() {
    type Edit = fn(&mut MachineConfig);
    let cases: [(&str, Edit); 22] = [
        ("name", |c| c.name = " ".to_owned()),
        ("cores", |c| c.cores = 0),
        ("threads_per_core", |c| c.threads_per_core = 0),
        ("clock_ghz", |c| c.clock_ghz = f64::NAN),
        ("clock_ghz", |c| c.clock_ghz = f64::INFINITY),
        ("clock_ghz", |c| c.clock_ghz = 1e-9),
        ("core.gather_lines_per_cycle", |c| c.core.gather_lines_per_cycle = 0.0),
        ("core.latency_cycles.mask", |c| c.core.latency_cycles.mask = 0),
        ("l1d.capacity_bytes", |c| c.l1d.capacity_bytes = 1000),
        ("l1d.ways", |c| c.l1d.ways = 0),
        ("l2.capacity_bytes", |c| c.l2.capacity_bytes = 0),
        ("l2.hit_cycles", |c| c.l2.hit_cycles = 3),
        ("l2.mshrs", |c| c.l2.mshrs = 0),
        ("ring.bytes_per_cycle", |c| c.ring.bytes_per_cycle = 0),
        ("ring.bytes_per_cycle", |c| c.ring.bytes_per_cycle = 63),
        ("ring.bytes_per_cycle", |c| c.ring.bytes_per_cycle = 128),
        ("ring.cores_per_ring", |c| c.ring.cores_per_ring = 0),
        ("core.l1_accesses_per_cycle", |c| c.core.l1_accesses_per_cycle = 5),
        ("memory.write_buffer_lines", |c| c.memory.write_buffer_lines = 0),
        ("memory.controllers", |c| c.memory.controllers = 0),
        ("memory.bandwidth_gb_per_s", |c| c.memory.bandwidth_gb_per_s = 0.0),
        ("memory.latency_ns", |c| c.memory.latency_ns = -1.0),
    ];
    for (path, edit) in cases {
        let mut config = shipped("larrabee-24");
        edit(&mut config);
        let error = config.validate().expect_err(path);
        assert_eq!(error.path, path, "{error}");
        assert!(error.to_string().contains("must be"), "{error}");
    }
}

#[test]
fn times_of_the_memory_are_bounded_in_cycles() {
    type Field = fn(&mut MemoryConfig) -> &mut f64;
    let fields: [(&str, Field); 2] =
        [("memory.latency_ns", |m| &mut m.latency_ns), ("memory.row_cycle_ns", |m| &mut m.row_cycle_ns)];
    for (path, field) in fields {
        let mut config = shipped("larrabee-24");
        config.clock_ghz = 100.0;
        *field(&mut config.memory) = 10_000.0;
        config.validate().expect("a million cycles");
        *field(&mut config.memory) = 100_000.0;
        let error = config.validate().expect_err(path);
        assert_eq!(error.path, path, "{error}");
        assert!(error.to_string().contains("at most 10000: 1000000 cycles at clock_ghz, 100"), "{error}");
    }
}

#[test]
fn a_cache_that_is_too_large_is_told_the_limit() {
    let mut config = shipped("larrabee-24");
    config.l2.capacity_bytes = 1 << 60;
    let error = config.validate().expect_err("2^60 bytes");
    assert!(error.expected.contains("from 512 to 1073741824"), "{error}");
}

#[test]
fn unknown_fields_are_refused() {
    let text =
        builtin_machine("ideal").expect("shipped").replacen("\"cores\"", "\"colour\": 1, \"cores\"", 1);
    let error = serde_json::from_str::<MachineConfig>(&text).expect_err("unknown field");
    assert!(error.to_string().contains("colour"), "{error}");
}
