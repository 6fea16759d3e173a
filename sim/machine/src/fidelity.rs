//! How much of the machine is modeled.

use crate::chip::Chip;
use crate::config::MachineSpec;
use crate::timing::{Timing, Untimed};
use lrbsim_isa::options::{self, ChoiceError, Entry};
use std::fmt;
use std::str::FromStr;

/// A level of modeling; one that takes options carries them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Fidelity {
    /// Counts uops, lanes and tasks; no time.
    Functional,
    /// All uops; each core alone for a window, then what all of them asked for, each transaction timed whole.
    #[default]
    Windowed,
    /// The reference: one cycle at a time, a transaction a chain of legs, shared resources asked in global time order.
    Cycle,
}

/// What users choose a fidelity by, in the order of [`Fidelity::ALL`]: from the fastest to the most exact.
pub const LEVELS: [Entry; 3] = [
    Entry { name: "functional", about: "picture and operation counts, no time", options: &[] },
    Entry {
        name: "windowed",
        about: "all uops: cores alone for a window of time, then what they asked for",
        options: &[],
    },
    Entry { name: "cycle", about: "the reference: one cycle at a time, everything in order", options: &[] },
];

impl Fidelity {
    /// All levels, from the fastest to the most exact.
    pub const ALL: [Fidelity; 3] = [Fidelity::Functional, Fidelity::Windowed, Fidelity::Cycle];

    /// Whether results have times.
    pub fn is_timed(self) -> bool {
        self != Fidelity::Functional
    }

    /// What times steps at this level on a cold machine, with at most `host_threads` host threads. How many these are
    /// changes no result.
    pub fn timing(self, spec: &MachineSpec, host_threads: usize) -> Box<dyn Timing> {
        match self {
            Fidelity::Functional => Box::new(Untimed::new(host_threads)),
            Fidelity::Windowed | Fidelity::Cycle => Box::new(Chip::new(spec, self, host_threads)),
        }
    }
}

impl FromStr for Fidelity {
    type Err = ChoiceError;

    fn from_str(text: &str) -> Result<Fidelity, ChoiceError> {
        let (number, _) = options::choose("fidelity", text, LEVELS.into_iter())?;
        Ok(Fidelity::ALL[number])
    }
}

impl fmt::Display for Fidelity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(LEVELS[*self as usize].name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_level_is_read_as_it_is_shown() {
        for level in Fidelity::ALL {
            assert_eq!(level.to_string().parse(), Ok(level));
        }
        let error = "exact".parse::<Fidelity>().expect_err("no level");
        assert_eq!(
            error.to_string(),
            "`exact` is no fidelity; it must be `functional`, `windowed` or `cycle`"
        );
    }
}
