use super::*;
use crate::config::{MachineConfig, builtin_machine};

fn rings(cores: u32, edit: impl FnOnce(&mut MachineConfig)) -> Rings {
    let mut config: MachineConfig =
        serde_json::from_str(builtin_machine("larrabee-24").expect("shipped")).expect("parses");
    config.cores = cores;
    edit(&mut config);
    Rings::new(&config.validate().expect("sound"))
}

#[test]
fn an_idle_message_arrives_after_its_hops_and_not_a_cycle_off() {
    for cores in [1, 2, 3, 12, 16, 17, 24, 100, 1024] {
        let mut rings = rings(cores, |_| ());
        let mut now = 7;
        for (from, to) in [(0, cores - 1), (cores / 2, 0), (cores / 3, cores / 2)] {
            for message in [Message::Address, Message::Line] {
                // Long after the last message has left the ring.
                now += 10_001;
                let idle = rings.idle_cycles(from, to, message);
                assert_eq!(rings.send(from, to, message, now), now + idle, "{cores} cores, {from} to {to}");
            }
        }
    }
}

#[test]
fn ways_are_never_longer_than_half_a_ring() {
    let rings = rings(12, |_| ());
    for from in 0..12 {
        for to in 0..12 {
            let hops = rings.idle_cycles(from, to, Message::Address);
            let apart = u64::from(from.abs_diff(to));
            assert_eq!(hops, apart.min(12 - apart));
        }
    }
}

#[test]
fn a_narrow_ring_sends_a_line_in_pieces() {
    let mut rings = rings(12, |config| config.ring.bytes_per_cycle = 16);
    assert_eq!(rings.send(0, 3, Message::Line, 100), 100 + 3 + 3);
    assert_eq!(rings.send(0, 3, Message::Address, 100), 100 + 3);
}

#[test]
fn a_link_carries_one_line_a_cycle_and_no_more() {
    let mut rings = rings(12, |_| ());
    let mut arrivals: Vec<Cycle> = (0..100).map(|_| rings.send(0, 1, Message::Line, 50)).collect();
    arrivals.sort_unstable();
    assert_eq!(arrivals, (51..151).collect::<Vec<_>>());
}

#[test]
fn messages_on_disjoint_links_do_not_disturb_each_other() {
    let mut rings = rings(12, |_| ());
    for stop in 0..12 {
        assert_eq!(rings.send(stop, (stop + 1) % 12, Message::Line, 9), 10);
    }
    assert_eq!(rings.wait_cycles(), 0);
}

#[test]
fn every_core_has_its_own_stop() {
    for cores in [1, 5, 16, 17, 24, 33, 1000] {
        let rings = rings(cores, |_| ());
        let mut places: Vec<_> = rings.places.clone();
        for Place { ring, stop } in &places {
            assert!(*stop < rings.rings[*ring as usize].stops);
        }
        places.dedup();
        assert_eq!(places.len(), cores as usize);
    }
}
