//! Laws that every timed resource obeys, and defects that break them.
//!
//! A component's tests implement [`Resource`] for it, write down a [`Model`] that is too simple to be wrong and too slow to
//! be used, and ask [`obeys`]. A law that is broken is an `Err` that says where, so that a seeded [`Fault`] can be seen to
//! be caught.

use crate::Cycle;
use crate::streams::Random;
use std::fmt::Debug;

/// A defect to be seeded, for tests that show that the laws notice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Fault {
    /// Slots that are not near are forgotten.
    SlotsForget,
    /// Windows of links that are not near are forgotten.
    LinksForget,
    /// The write buffer takes whatever comes.
    UnboundedWriteBuffer,
}

/// What is kept, or where it is broken.
pub(crate) type Verdict = Result<(), String>;

/// Something that serves so many requests in so much time, and is always asked until it serves.
pub(crate) trait Resource: Clone + PartialEq + Debug {
    /// Asks, at `at`, on behalf of request number `request`, by which lines and places may differ; returns when it is
    /// served. Nobody asks for times before `floor` from then on.
    fn ask(&mut self, request: u32, at: Cycle, floor: Cycle) -> Cycle;

    /// Most requests that may be served in `cycles` cycles in a row.
    fn peak(&self, cycles: Cycle) -> u64;
}

/// What a resource should answer: a function of the requests so far.
pub(crate) type Model = Box<dyn FnMut(u32, Cycle) -> Cycle>;

/// Cycles of load without throttle.
pub(crate) const LOAD_CYCLES: Cycle = 10_000_000;

/// All laws of one resource.
pub(crate) fn obeys(resource: &impl Resource, model: impl Fn() -> Model) -> Verdict {
    never_early_nor_above_peak(resource, LOAD_CYCLES)?;
    serves_as_asked(resource)?;
    agrees_with(resource, model)
}

/// Under load without throttle nothing is served before it is asked for, and no stretch holds more than its peak.
pub(crate) fn never_early_nor_above_peak(resource: &impl Resource, cycles: Cycle) -> Verdict {
    let requests = resource.peak(cycles);
    // All at one time; and about twice as fast as they can be served, a little out of order.
    for rising in [false, true] {
        let (mut resource, mut random) = (resource.clone(), Random::new(7));
        let mut served = Vec::with_capacity(requests as usize);
        for request in 0..requests {
            let floor = if rising { request * (cycles / 2) / requests } else { 0 };
            let at = if rising { floor + Cycle::from(random.below(500)) } else { 0 };
            let time = resource.ask(request as u32, at, floor);
            if time < at {
                return Err(format!("request {request}, made at {at}, is served at {time}"));
            }
            served.push(time);
        }
        within_peak(&resource, served)?;
    }
    Ok(())
}

/// Looks at all stretches of some lengths.
fn within_peak(resource: &impl Resource, mut served: Vec<Cycle>) -> Verdict {
    served.sort_unstable();
    for cycles in [1, 2, 31, 64, 1000, 65_536, 1_000_000, LOAD_CYCLES] {
        // One request more than the peak takes longer than that.
        let peak = resource.peak(cycles) as usize;
        let early = served.windows(peak + 1).find(|row| row[peak] - row[0] < cycles);
        if let Some(row) = early {
            let (first, last) = (row[0], row[peak]);
            return Err(format!("{} served from {first} to {last}: at most {peak} in {cycles}", peak + 1));
        }
    }
    Ok(())
}

/// Equal requests are served in the order in which they are made, and the same requests at the same times.
pub(crate) fn serves_as_asked(resource: &impl Resource) -> Verdict {
    let (mut one, mut two) = (resource.clone(), resource.clone());
    let mut last = 0;
    for turn in 0..1000 {
        let [time, again] = [&mut one, &mut two].map(|resource| resource.ask(3, 5000, 100));
        if time < last || again != time {
            return Err(format!("turn {turn} at {time} and {again}, after {last}"));
        }
        last = time;
    }
    if one != two {
        return Err("the same requests leave different states".to_owned());
    }
    Ok(())
}

/// Requests out of time order, some of them far ahead, are served as the model says: so nothing is forgotten, and what is
/// far ahead holds nothing up that is near.
pub(crate) fn agrees_with(resource: &impl Resource, model: impl Fn() -> Model) -> Verdict {
    agrees_ahead(resource, Ahead::Some, model)
}

/// Which requests come far ahead of the others.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Ahead {
    /// One in 16.
    Some,
    /// None does.
    None,
}

/// As [`agrees_with`], for a resource that is asked for times far ahead or is not.
pub(crate) fn agrees_ahead(resource: &impl Resource, ahead: Ahead, model: impl Fn() -> Model) -> Verdict {
    let cost_x256 = (256 * 100_000 / resource.peak(100_000)) as u32;
    let near = (200 * cost_x256 / 256).max(64);
    let far = (20 * near).max(200_000);
    // Below, at and above what can be served.
    for load_percent in [70, 100, 160] {
        let (mut resource, mut model, mut random) =
            (resource.clone(), model(), Random::new(load_percent.into()));
        let mut base_x256 = 0_u64;
        for request in 0..2500 {
            base_x256 += u64::from(random.below(2 * cost_x256 * 100 / load_percent));
            let floor = base_x256 / 256;
            let is_far = random.below(16) == 0 && ahead == Ahead::Some;
            let at = floor + Cycle::from(random.below(if is_far { far } else { near }));
            let (time, expected) = (resource.ask(request, at, floor), model(request, at));
            if time != expected {
                return Err(format!(
                    "load {load_percent} %, request {request} at {at}: {time} instead of {expected}"
                ));
            }
        }
    }
    Ok(())
}

/// At no time are more than `most` of some things held, each from a time to another.
pub(crate) fn never_holds_more_than(most: usize, held: &[(Cycle, Cycle)]) -> Verdict {
    // What is given back at a time can be held anew from then on.
    let mut changes: Vec<(Cycle, i32)> = held.iter().flat_map(|(from, to)| [(*from, 1), (*to, -1)]).collect();
    changes.sort_unstable();
    let mut sum = 0;
    for (at, change) in changes {
        sum += change;
        if sum > most as i32 {
            return Err(format!("{sum} held at {at}: at most {most}"));
        }
    }
    Ok(())
}

/// What refuses a request is left as it was. `ask` says whether the request was served.
pub(crate) fn refuses_without_a_trace<R: Clone + PartialEq + Debug>(
    resource: &R,
    mut ask: impl FnMut(&mut R, u32) -> bool,
) -> Verdict {
    let (mut resource, mut refused) = (resource.clone(), 0);
    for request in 0..2000 {
        let before = resource.clone();
        if !ask(&mut resource, request) {
            refused += 1;
            if resource != before {
                return Err(format!("request {request} is refused and changes the state"));
            }
        }
    }
    if refused == 0 { Err("nothing was refused".to_owned()) } else { Ok(()) }
}
