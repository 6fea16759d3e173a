//! Which shadow algorithm runs, as `-a` takes it: `NAME` or `NAME:KEY=VALUE,…`.

use std::fmt;
use std::str::FromStr;

use lrbsim_isa::options::{self, ChoiceError, Options};
use lrbsim_isa::{Phase, Runner, Stopped};
use lrbsim_kernels::method::{METHODS, Method, Shadows};
use lrbsim_workloads::{Light, ShadowInput};

use crate::error::BadInput;

/// A shadow algorithm: a method with its options.
#[derive(Clone)]
pub struct Algorithm {
    method: &'static dyn Method,
    options: Options,
}

impl Algorithm {
    /// `method`, which need not be one of the shipped [`METHODS`], with the options that `options` gives, `KEY=VALUE,…`, and
    /// the defaults of all others.
    pub fn new(method: &'static dyn Method, options: &str) -> Result<Algorithm, BadInput> {
        Algorithm { method, options: method.entry().options(options)? }.checked()
    }

    /// This algorithm, unless its method has something against its options together.
    fn checked(self) -> Result<Algorithm, BadInput> {
        self.method.objection(&self.options).map_or(Ok(self), |message| Err(BadInput::new(message)))
    }

    /// An error where the algorithm cannot draw `light`.
    pub fn check_light(&self, light: &Light) -> Result<(), BadInput> {
        self.method
            .objection_to_light(&self.options, light)
            .map_or(Ok(()), |message| Err(BadInput::new(message)))
    }

    /// Name without options, as in the default name of a result folder.
    pub fn name(&self) -> &'static str {
        self.method.entry().name
    }

    /// What the algorithm is, for people, with all of its options.
    pub fn title(&self) -> String {
        let about = self.method.entry().about;
        match self.options.to_string() {
            options if options.is_empty() => about.to_owned(),
            options => format!("{about}, {options}"),
        }
    }

    /// The options of the algorithm, each with its value as users write it.
    pub fn options(&self) -> impl Iterator<Item = (&'static str, String)> {
        self.options.written()
    }

    /// This algorithm with the options that `written` gives, each `KEY=VALUE`, in place of what they were.
    pub fn with_options(self, written: impl IntoIterator<Item = String>) -> Result<Algorithm, BadInput> {
        let Algorithm { method, mut options } = self;
        for written in written {
            options = method.entry().with_option(options, &written)?;
        }
        // All of them together: one alone may not go with what another replaces.
        Algorithm { method, options }.checked()
    }

    /// All phases that the algorithm can have, in order.
    pub fn phases(&self) -> &'static [Phase] {
        self.method.phases()
    }

    /// How many lights the light of a frame is split into.
    pub fn lights(&self) -> u32 {
        self.method.lights(&self.options)
    }

    /// Runs the program of one frame, see [`Method::run`]: the receivers of `input` are gone then but for their pixels, and so may its
    /// other lights be.
    pub fn run(&self, input: &mut ShadowInput, runner: &mut Runner<'_>) -> Result<Shadows, Stopped> {
        self.method.run(&self.options, input, runner)
    }
}

/// What runs where users name nothing: the first method with its defaults.
impl Default for Algorithm {
    fn default() -> Algorithm {
        Algorithm::new(METHODS[0], "").expect("defaults are values that options take")
    }
}

/// The algorithm with all of its options, as `-a` takes it.
impl fmt::Display for Algorithm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.options.to_string() {
            options if options.is_empty() => f.write_str(self.name()),
            options => write!(f, "{}:{options}", self.name()),
        }
    }
}

impl fmt::Debug for Algorithm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Algorithm({self})")
    }
}

impl FromStr for Algorithm {
    type Err = BadInput;

    fn from_str(text: &str) -> Result<Algorithm, BadInput> {
        let entries = METHODS.iter().map(|method| method.entry());
        let (number, options) = options::choose("algorithm", text, entries)?;
        Algorithm { method: METHODS[number], options }.checked()
    }
}

impl From<ChoiceError> for BadInput {
    fn from(error: ChoiceError) -> BadInput {
        BadInput::new(error.to_string())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_method_is_read_as_it_is_shown_and_has_phases_of_its_own() {
        for method in METHODS {
            let algorithm = Algorithm::new(method, "").expect("defaults");
            let read = algorithm.to_string().parse::<Algorithm>().expect("own text");
            assert_eq!(read.to_string(), algorithm.to_string());
            let mut ids: Vec<&str> = algorithm.phases().iter().map(|phase| phase.id).collect();
            let count = ids.len();
            ids.sort_unstable();
            ids.dedup();
            assert!(count > 0 && ids.len() == count, "{algorithm}: phases must have ids of their own");
        }
        assert_eq!(Algorithm::default().to_string(), "sism:form=exact,overlap=bits:64,lights=1");
        assert_eq!(
            "sism".parse::<Algorithm>().expect("a name").to_string(),
            Algorithm::default().to_string()
        );
    }

    #[test]
    fn what_is_nothing_is_refused() {
        for text in [
            "",
            "sims",
            "sism:",
            "sism:,,",
            "sism:form=exact,",
            "sism:form=round",
            "sism:colour=red",
            "sism:form",
            "wyman",
        ] {
            assert!(text.parse::<Algorithm>().is_err(), "{text}");
        }
    }
}
