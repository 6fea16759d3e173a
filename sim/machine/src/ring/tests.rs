use super::*;
use crate::config::{MachineConfig, builtin_machine};

/// Rings as `cycle` has them, and as `windowed` does.
fn both(cores: u32, edit: impl FnOnce(&mut MachineConfig)) -> [Rings; 2] {
    let mut config: MachineConfig =
        serde_json::from_str(builtin_machine("larrabee-24").expect("shipped")).expect("parses");
    config.cores = cores;
    edit(&mut config);
    let spec = config.validate().expect("sound");
    [Rings::new(&spec, true), Rings::new(&spec, false)]
}

fn rings(cores: u32, edit: impl FnOnce(&mut MachineConfig)) -> Rings {
    let [exact, _] = both(cores, edit);
    exact
}

#[test]
fn an_idle_message_arrives_after_its_hops_and_not_a_cycle_off() {
    for (cores, mut rings) in
        [1, 2, 3, 12, 16, 17, 24, 100, 1024].into_iter().flat_map(|n| both(n, |_| ()).map(|rings| (n, rings)))
    {
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
    for mut rings in both(12, |config| config.ring.bytes_per_cycle = 16) {
        assert_eq!(rings.send(0, 3, Message::Line, 100), 100 + 3 + 3);
        assert_eq!(rings.send(0, 3, Message::Address, 100), 100 + 3);
    }
}

#[test]
fn a_link_carries_one_line_a_cycle_and_no_more() {
    let mut rings = rings(12, |_| ());
    let mut arrivals: Vec<Cycle> = (0..100).map(|_| rings.send(0, 1, Message::Line, 50)).collect();
    arrivals.sort_unstable();
    assert_eq!(arrivals, (51..151).collect::<Vec<_>>());
}

#[test]
fn a_counted_link_carries_32_lines_in_32_cycles_and_no_more() {
    let [_, mut rings] = both(12, |_| ());
    let arrivals: Vec<Cycle> = (0..100).map(|_| rings.send(0, 1, Message::Line, 70)).collect();
    let of_window = |first: Cycle| arrivals.iter().filter(|at| (first + 1..=first + 32).contains(at)).count();
    assert_eq!([64, 96, 128, 160].map(of_window), [32, 32, 32, 4]);
}

#[test]
fn messages_on_disjoint_links_do_not_disturb_each_other() {
    for mut rings in both(12, |_| ()) {
        for stop in 0..12 {
            assert_eq!(rings.send(stop, (stop + 1) % 12, Message::Line, 9), 10);
        }
        assert_eq!(rings.wait_cycles(), 0);
    }
}

#[test]
fn counted_links_fill_exactly_where_rides_pass() {
    // A model of plain numbers, for rides of any length round the ring in both directions.
    let [_, mut rings] = both(12, |_| ());
    let mut model = std::collections::BTreeMap::<(u64, usize, u32), u32>::new();
    let mut random = crate::streams::Random::new(11);
    for round in 0..4000 {
        let (from, to) = (random.below(12), random.below(12));
        let now = round / 5;
        let up = (to + 12 - from) % 12;
        let direction = usize::from(up > 6 || up == 6 && now % 2 == 1);
        let hops = up.min(12 - up);
        let first = if direction == 0 { from } else { to };
        let links: Vec<u32> = (first..first + hops).map(|link| link % 12).collect();
        let mut window = now / 32;
        while links.iter().any(|link| model.get(&(window, direction, *link)) == Some(&32)) {
            window += 1;
        }
        for link in links {
            *model.entry((window, direction, link)).or_default() += 1;
        }
        let expected = now.max(window * 32) * u64::from(hops > 0) + now * u64::from(hops == 0);
        assert_eq!(rings.send(from, to, Message::Address, now), expected + u64::from(hops));
    }
}

#[test]
fn every_core_has_its_own_stop() {
    for cores in [1, 5, 16, 17, 24, 33, 1000] {
        let rings = rings(cores, |_| ());
        let mut places: Vec<_> = rings.places.clone();
        for Place { ring, stop } in &places {
            assert!(*stop < rings.loops[*ring as usize].stops);
        }
        places.dedup();
        assert_eq!(places.len(), cores as usize);
    }
}
