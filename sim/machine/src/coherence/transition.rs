//! The protocol: what one core's copy of a line becomes, and what has to be done for that.

/// State of one core's copy.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u8)]
pub enum State {
    /// Invalid: the core has no copy.
    I = 0,
    /// Shared: may be read; others may hold it too; memory is up to date.
    S = 1,
    /// Exclusive: the only copy, same as memory.
    E = 2,
    /// Modified: the only copy, newer than memory.
    M = 3,
}

impl State {
    /// All states.
    pub const ALL: [State; 4] = [State::I, State::S, State::E, State::M];

    /// The state kept in the low two bits of `bits`.
    #[inline(always)]
    pub(crate) const fn from_bits(bits: u8) -> State {
        State::ALL[(bits & 3) as usize]
    }

    /// Whether the core may write without asking.
    #[inline(always)]
    pub const fn is_owner(self) -> bool {
        matches!(self, State::E | State::M)
    }
}

/// What the directory knows of the other cores.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Others {
    /// None has a copy.
    Nobody,
    /// One or more have it in S.
    Share,
    /// One other core has the line in E or M.
    Own,
}

/// What happens to a copy.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Event {
    /// The core of the copy reads.
    Read(Others),
    /// The core of the copy writes a part of the line.
    Write(Others),
    /// The core of the copy writes the whole line.
    Stream(Others),
    /// Another core reads and is served by this copy, or by this one among others.
    RemoteRead,
    /// Another core is about to write.
    RemoteWrite,
    /// The copy has to make room.
    Evict,
}

/// Where the data come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Source {
    /// No data are needed.
    Nowhere,
    /// The memory controller.
    Memory,
    /// The copy of another core.
    Peer,
}

/// What a transition asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Actions {
    /// Whether the home must be asked first.
    pub ask_home: bool,
    /// Where the data come from.
    pub data: Source,
    /// Whether every other copy gets [`Event::RemoteWrite`].
    pub invalidate_others: bool,
    /// Whether the owner gets [`Event::RemoteRead`].
    pub downgrade_owner: bool,
    /// Whether this copy's data go to memory.
    pub write_back: bool,
    /// Whether the home must be told that this copy is gone.
    pub notify_home: bool,
}

impl Actions {
    const NONE: Actions = Actions {
        ask_home: false,
        data: Source::Nowhere,
        invalidate_others: false,
        downgrade_owner: false,
        write_back: false,
        notify_home: false,
    };

    const fn fetch(data: Source) -> Actions {
        Actions { ask_home: true, data, ..Actions::NONE }
    }

    const fn invalidating(self) -> Actions {
        Actions { invalidate_others: true, ..self }
    }
}

/// What `event` makes of a copy in `state`; `None` where the two cannot meet, because there is one writer or many readers
/// and the directory knows them exactly.
#[inline]
pub const fn transition(state: State, event: Event) -> Option<(State, Actions)> {
    use Event::{Evict, Read, RemoteRead, RemoteWrite, Stream, Write};
    use Others::{Nobody, Own, Share};
    use State::{E, I, M, S};
    let downgrading = Actions { downgrade_owner: true, ..Actions::fetch(Source::Peer) };
    let gone = Actions { notify_home: true, ..Actions::NONE };
    match (state, event) {
        // No copy: the line comes from whoever has it.
        (I, Read(Nobody)) => Some((E, Actions::fetch(Source::Memory))),
        (I, Read(Share)) => Some((S, Actions::fetch(Source::Peer))),
        (I, Read(Own)) => Some((S, downgrading)),
        (I, Write(Nobody)) => Some((M, Actions::fetch(Source::Memory))),
        (I, Write(Share | Own)) => Some((M, Actions::fetch(Source::Peer).invalidating())),
        (I, Stream(Nobody)) => Some((M, Actions::fetch(Source::Nowhere))),
        (I, Stream(Share | Own)) => Some((M, Actions::fetch(Source::Nowhere).invalidating())),
        (I, RemoteRead | RemoteWrite | Evict) => None,

        // A copy among others, or alone after they left.
        (S, Read(Nobody | Share)) => Some((S, Actions::NONE)),
        (S, Write(Nobody) | Stream(Nobody)) => Some((M, Actions::fetch(Source::Nowhere))),
        (S, Write(Share) | Stream(Share)) => Some((M, Actions::fetch(Source::Nowhere).invalidating())),
        (S, Read(Own) | Write(Own) | Stream(Own)) => None,
        (S, RemoteRead) => Some((S, Actions::NONE)),
        (S, RemoteWrite) => Some((I, Actions::NONE)),
        (S, Evict) => Some((I, gone)),

        // The only copy.
        (E, Read(Nobody)) => Some((E, Actions::NONE)),
        (M, Read(Nobody)) => Some((M, Actions::NONE)),
        (E | M, Write(Nobody) | Stream(Nobody)) => Some((M, Actions::NONE)),
        (E | M, Read(Share | Own) | Write(Share | Own) | Stream(Share | Own)) => None,
        (E, RemoteRead) => Some((S, Actions::NONE)),
        (M, RemoteRead) => Some((S, Actions { write_back: true, ..Actions::NONE })),
        // The data go to the writer, which is the new owner: memory need not have them.
        (E | M, RemoteWrite) => Some((I, Actions::NONE)),
        (E, Evict) => Some((I, gone)),
        (M, Evict) => Some((I, Actions { write_back: true, ..gone })),
    }
}
