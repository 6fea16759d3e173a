//! How much of the machine is modeled.

use crate::chip::Chip;
use crate::config::MachineSpec;
use crate::roofline::Roofline;
use crate::sampled::{Sampled, Sampling};
use crate::timing::{Timing, Untimed};
use lrbsim_isa::options::{self, ChoiceError, Entry, OptionSpec, Options, Values};
use std::fmt;
use std::str::FromStr;

/// A level of modeling; one that takes options carries them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Fidelity {
    /// Counts uops, lanes and tasks; no time.
    Functional,
    /// Counts all uops, reads a part of the tasks, and takes each step for what limits it most; microseconds a machine.
    Roofline,
    /// Some chunks of the tasks of each step as at [`Fidelity::Windowed`], all others run and counted; times are extrapolated.
    Sampled(Sampling),
    /// All uops; each core alone for a window, then what all of them asked for, each transaction timed whole.
    #[default]
    Windowed,
    /// The reference: one cycle at a time, a transaction a chain of legs, shared resources asked in global time order.
    Cycle,
}

/// The options of [`Fidelity::Sampled`].
const SAMPLING: &[OptionSpec] = &[
    OptionSpec {
        name: "error",
        about: "how much the choice of tasks may add to the ± of a step, as a part of all time until its end; where it would be more, more tasks are timed",
        values: Values::Percent(1, 50),
        default: "5%",
        tacit: false,
    },
    OptionSpec {
        name: "seed",
        about: "which tasks are chosen",
        values: Values::Whole(0, u32::MAX),
        default: "0",
        tacit: true,
    },
];

impl Fidelity {
    /// All levels, from the fastest to the most exact; those that take options with the defaults.
    pub const ALL: [Fidelity; 5] = [
        Fidelity::Functional,
        Fidelity::Roofline,
        Fidelity::Sampled(Sampling::DEFAULT),
        Fidelity::Windowed,
        Fidelity::Cycle,
    ];

    /// What users choose this level by: its name, and the options that it takes.
    pub fn entry(self) -> Entry {
        let (name, about) = match self {
            Fidelity::Functional => ("functional", "picture and operation counts, no time"),
            Fidelity::Roofline => {
                ("roofline", "what limits each step most, from counts: to rank machines by")
            }
            Fidelity::Sampled(_) => {
                ("sampled", "some tasks as `windowed`, times extrapolated, with an interval")
            }
            Fidelity::Windowed => {
                ("windowed", "all uops: cores alone for a window of time, then what they asked for")
            }
            Fidelity::Cycle => ("cycle", "the reference: one cycle at a time, everything in order"),
        };
        let options = match self {
            Fidelity::Sampled(_) => SAMPLING,
            Fidelity::Functional | Fidelity::Roofline | Fidelity::Windowed | Fidelity::Cycle => &[],
        };
        Entry { name, about, options }
    }

    /// This level as `options`, which are those of its entry, set it.
    fn with(self, options: &Options) -> Fidelity {
        match self {
            Fidelity::Sampled(_) => Fidelity::Sampled(Sampling {
                error_percent: options.whole("error"),
                seed: options.whole("seed"),
            }),
            Fidelity::Functional | Fidelity::Roofline | Fidelity::Windowed | Fidelity::Cycle => self,
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
            Fidelity::Roofline => Box::new(Roofline::new(spec, host_threads)),
            Fidelity::Sampled(sampling) => Box::new(Sampled::new(spec, sampling, host_threads)),
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
        let entry = self.entry();
        f.write_str(entry.name)?;
        match self {
            Fidelity::Sampled(Sampling { error_percent, seed }) => {
                let options = entry.options(&format!("error={error_percent},seed={seed}"));
                write!(f, ":{}", options.map_err(|_| fmt::Error)?)
            }
            Fidelity::Functional | Fidelity::Roofline | Fidelity::Windowed | Fidelity::Cycle => Ok(()),
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
            assert_eq!(level.entry().name.parse(), Ok(level));
        }
        for (written, shown) in [
            ("sampled", "sampled:error=5%"),
            ("sampled:error=2", "sampled:error=2%"),
            ("sampled:seed=7,error=50%", "sampled:error=50%,seed=7"),
        ] {
            let level: Fidelity = written.parse().expect("a level");
            assert_eq!((level.to_string().as_str(), shown.parse()), (shown, Ok(level)));
        }
        let error = "exact".parse::<Fidelity>().expect_err("no level");
        assert_eq!(
            error.to_string(),
            "`exact` is no fidelity; it must be `functional`, `roofline`, `sampled`, `windowed` or `cycle`"
        );
    }
}
