//! Cores without threads and an uncore, driven by hand in the order of either level.

use super::{Fault, Peers, State, Uncore};
use crate::Cycle;
use crate::cache::{Access, AccessRules, Again, Intent, WINDOW_MAX};
use crate::config::MachineSpec;
use crate::core::{Core, CoreTables};
use crate::exchange::Message;
use crate::when::When;

/// In which order requests are served.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Order {
    /// Those of a window by time, core and number, each whole.
    Windowed,
    /// Leg by leg.
    Cycle,
}

impl Order {
    pub(crate) const ALL: [Order; 2] = [Order::Windowed, Order::Cycle];
}

/// What a core is to do, and when at the earliest.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Wish {
    Access { line: u32, intent: Intent },
    Lock { line: u32 },
    PrefetchL2 { line: u32 },
}

/// Some cores and their uncore.
pub(crate) struct Bench {
    pub(crate) cores: Vec<Core>,
    pub(crate) uncore: Uncore,
    tables: CoreTables,
    rules: AccessRules,
    atomic_cycles: Cycle,
    order: Order,
    window: Cycle,
    /// Everything before has been simulated.
    pub(crate) now: Cycle,
    /// Wishes that are not granted: time, core.
    open: Vec<(Cycle, usize, Wish)>,
    /// What the cores asked for, and what they were told.
    pub(crate) requests: u64,
    pub(crate) answers: u64,
    /// When the last answer so far arrives.
    pub(crate) last_answer: Cycle,
}

/// The cores as peers; counts answers.
struct AsPeers<'a> {
    cores: &'a mut [Core],
    answers: &'a mut u64,
    last_answer: &'a mut Cycle,
}

impl Peers for AsPeers<'_> {
    fn state(&mut self, core: u32, line: u32) -> State {
        self.cores[core as usize].shared.caches.state_of(line)
    }

    fn unlocked(&mut self, core: u32, line: u32, now: Cycle) -> Cycle {
        self.cores[core as usize].shared.caches.locks.free(line, now)
    }

    fn tell(&mut self, core: u32, message: Message) {
        if VERBOSE {
            println!("  tell {core} {message:?}");
        }
        if let Message::Answer { fill, .. } = &message {
            *self.answers += 1;
            *self.last_answer = fill.at().max(*self.last_answer);
        }
        self.cores[core as usize].tell(message);
    }
}

impl Bench {
    pub(crate) fn new(spec: &MachineSpec, order: Order, fault: Option<Fault>) -> Bench {
        let mut uncore = Uncore::new(spec, order == Order::Cycle);
        uncore.fault = fault;
        let mut cores: Vec<Core> = (0..spec.cores as usize).map(|index| Core::new(index, spec)).collect();
        for core in &mut cores {
            core.shared.caches.fault = fault;
        }
        Bench {
            cores,
            window: if order == Order::Cycle { 1 } else { uncore.answer_cycles_min().min(WINDOW_MAX) },
            uncore,
            tables: CoreTables::new(spec),
            rules: AccessRules::new(spec),
            atomic_cycles: spec.atomic_cycles,
            order,
            now: 0,
            open: Vec::new(),
            requests: 0,
            answers: 0,
            last_answer: 0,
        }
    }

    /// Has `core` do something at `at`, or as soon as it can after that.
    pub(crate) fn wish(&mut self, core: usize, wish: Wish, at: Cycle) {
        assert!(at >= self.now, "in the past");
        self.open.push((at, core, wish));
    }

    /// Has `core` access `line` right now.
    pub(crate) fn access(
        &mut self,
        core: usize,
        line: u32,
        intent: Intent,
        at: Cycle,
    ) -> Result<Access, Again> {
        self.cores[core].shared.caches.access(&self.rules, line, intent, at)
    }

    /// Simulates until all wishes are granted and nothing is under way.
    pub(crate) fn settle(&mut self) {
        let begin = self.now;
        while !self.open.is_empty() || !self.is_quiet() {
            assert!(self.now < begin + 1_000_000, "never comes to rest: {:?}", self.open);
            self.turn();
        }
        for core in &mut self.cores {
            core.read_inbox(&self.tables, self.now, Cycle::MAX);
        }
        assert_eq!(self.requests, self.answers, "every request is answered once");
        // Lines that are on their way arrive before anybody asks again.
        self.now = self.now.max(self.last_answer);
    }

    /// Simulates until all wishes for times before `until` are granted, and no further.
    pub(crate) fn run_until(&mut self, until: Cycle) {
        while self.next() < until {
            self.turn();
        }
    }

    fn is_quiet(&self) -> bool {
        let told = self.cores.iter().any(|core| !core.inbox.is_empty());
        self.requests == self.answers && !told && self.uncore.next_due() == Cycle::MAX
    }

    /// When the next thing happens.
    fn next(&self) -> Cycle {
        let wished = self.open.iter().map(|(at, ..)| *at).min().unwrap_or(Cycle::MAX);
        let told = if self.cores.iter().any(|core| !core.inbox.is_empty()) { self.now } else { Cycle::MAX };
        wished.min(self.uncore.next_due()).min(told).max(self.now)
    }

    /// A window or a cycle.
    fn turn(&mut self) {
        let start = self.next();
        let end = start + self.window;
        let mut peers = AsPeers {
            cores: &mut self.cores,
            answers: &mut self.answers,
            last_answer: &mut self.last_answer,
        };
        self.uncore.run_until(start, &mut peers);
        for core in &mut self.cores {
            core.read_inbox(&self.tables, start, start);
        }
        // Each core its own wishes, in order of time.
        self.open.sort_by_key(|(at, core, _)| (*core, *at));
        let mut open = std::mem::take(&mut self.open);
        for (at, core, wish) in &mut open {
            while *at < end {
                match self.grant(*core, *wish, *at) {
                    Ok(()) => {
                        if VERBOSE {
                            println!("done {at} {core} {wish:?}");
                        }
                        *at = Cycle::MAX
                    }
                    Err(again) if again.at >= When::NEVER.at() => *at = end,
                    Err(again) => {
                        assert!(again.at > *at, "asked to come back in the past");
                        *at = again.at;
                    }
                }
            }
        }
        open.retain(|(at, ..)| *at < Cycle::MAX);
        self.open = open;
        self.serve(start);
        self.now = end;
    }

    fn grant(&mut self, core: usize, wish: Wish, at: Cycle) -> Result<(), Again> {
        let caches = &mut self.cores[core].shared.caches;
        match wish {
            Wish::Access { line, intent } => {
                let access = caches.access(&self.rules, line, intent, at)?;
                assert!(access.ready.at() > at, "core {core} line {line}: ready before it was asked for");
            }
            Wish::Lock { line } => {
                let access = caches.access(&self.rules, line, Intent::Write, at)?;
                if access.ready != When::NEVER {
                    caches.locks.lock(line, access.ready.at(), self.atomic_cycles, at);
                }
            }
            // A refused prefetch is dropped.
            Wish::PrefetchL2 { line } => drop(caches.prefetch_l2(&self.rules, line, at)),
        }
        Ok(())
    }

    fn serve(&mut self, base: Cycle) {
        let mut requests = Vec::new();
        for core in &mut self.cores {
            let of_core = core.shared.caches.outbox.drain(..).enumerate();
            requests
                .extend(of_core.map(|(number, request)| (request.time, core.index as u32, number, request)));
        }
        self.requests += requests.len() as u64;
        requests.sort_by_key(|(time, core, number, _)| (*time, *core, *number));
        for (_, core, _, request) in requests {
            if VERBOSE {
                println!("{core} {request:?}");
            }
            let mut peers = AsPeers {
                cores: &mut self.cores,
                answers: &mut self.answers,
                last_answer: &mut self.last_answer,
            };
            match self.order {
                Order::Windowed => self.uncore.serve(core, &request, base, &mut peers),
                Order::Cycle => self.uncore.accept(core, &request),
            }
        }
    }
}

const VERBOSE: bool = false;
