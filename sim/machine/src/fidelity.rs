//! How much of the machine is modeled.

use std::fmt;
use std::str::FromStr;

/// A level of modeling.
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

/// A fidelity that cannot be had.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum FidelityError {
    /// A level of the design that has no implementation yet.
    #[error("fidelity `{0}` is planned and not built yet; use functional, windowed or cycle")]
    NotBuilt(String),
    /// No level at all.
    #[error("`{0}` is no fidelity; use functional, windowed or cycle")]
    Unknown(String),
}

impl FromStr for Fidelity {
    type Err = FidelityError;

    fn from_str(text: &str) -> Result<Fidelity, FidelityError> {
        match text {
            "functional" => Ok(Fidelity::Functional),
            "windowed" => Ok(Fidelity::Windowed),
            "cycle" => Ok(Fidelity::Cycle),
            _ if text == "roofline" || text == "sampled" || text.starts_with("sampled:") => {
                Err(FidelityError::NotBuilt(text.to_owned()))
            }
            _ => Err(FidelityError::Unknown(text.to_owned())),
        }
    }
}

impl fmt::Display for Fidelity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Fidelity::Functional => "functional",
            Fidelity::Windowed => "windowed",
            Fidelity::Cycle => "cycle",
        })
    }
}
