//! How much of the machine is modeled.

use crate::chip::Chip;
use crate::config::MachineSpec;
use crate::timing::{Timing, Untimed};
use lrbsim_isa::options::{self, ChoiceError, Entry, Options};
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

impl Fidelity {
    /// All levels, from the fastest to the most exact; those that take options with the defaults.
    pub const ALL: [Fidelity; 3] = [Fidelity::Functional, Fidelity::Windowed, Fidelity::Cycle];

    /// What users choose this level by: its name, and the options that it takes.
    pub fn entry(self) -> Entry {
        let (name, about) = match self {
            Fidelity::Functional => ("functional", "picture and operation counts, no time"),
            Fidelity::Windowed => {
                ("windowed", "all uops: cores alone for a window of time, then what they asked for")
            }
            Fidelity::Cycle => ("cycle", "the reference: one cycle at a time, everything in order"),
        };
        Entry { name, about, options: &[] }
    }

    /// This level as `options`, which are those of its entry, set it.
    fn with(self, _options: &Options) -> Fidelity {
        match self {
            Fidelity::Functional | Fidelity::Windowed | Fidelity::Cycle => self,
        }
    }

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
        let entries = Fidelity::ALL.into_iter().map(Fidelity::entry);
        let (number, options) = options::choose("fidelity", text, entries)?;
        Ok(Fidelity::ALL[number].with(&options))
    }
}

/// The level with all of its options, as `--fidelity` takes it.
impl fmt::Display for Fidelity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Fidelity::Functional | Fidelity::Windowed | Fidelity::Cycle => f.write_str(self.entry().name),
        }
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
