//! Which shadow algorithm runs, as `-a` takes it: `NAME` or `NAME:KEY=VALUE,…`.

use std::fmt;
use std::str::FromStr;

use crate::error::BadInput;

/// A shadow algorithm with its options.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Algorithm {
    /// Soft irregular shadow mapping in its exact form.
    #[default]
    Sism,
}

/// Algorithms that have a name and no kernels yet.
const PLANNED: [&str; 8] =
    ["hard", "shadow-map", "pcss", "heidrich", "atty", "penumbra-map", "raytrace", "sintorn"];

impl Algorithm {
    /// Name without options, as in the default name of a result folder.
    pub fn name(self) -> &'static str {
        match self {
            Algorithm::Sism => "sism",
        }
    }
}

impl fmt::Display for Algorithm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Algorithm::Sism => f.write_str("sism:form=exact"),
        }
    }
}

impl FromStr for Algorithm {
    type Err = BadInput;

    fn from_str(text: &str) -> Result<Algorithm, BadInput> {
        let (name, options) = text.split_once(':').unwrap_or((text, ""));
        if PLANNED.contains(&name) {
            return Err(BadInput::new(format!("algorithm `{name}` is not in this version"))
                .with_help("this version has `sism`"));
        }
        if name != "sism" {
            return Err(BadInput::new(format!("`{name}` is no algorithm; it must be `sism`")));
        }
        for option in options.split(',').filter(|option| !option.is_empty()) {
            match option.split_once('=') {
                Some(("form", "exact")) => {}
                Some(("form", "printed")) | Some(("overlap", "sum")) => {
                    return Err(BadInput::new(format!(
                        "`{option}` of algorithm `sism` is not in this version"
                    ))
                    .with_help("this version has `sism:form=exact`"));
                }
                Some(("form", value)) => {
                    return Err(BadInput::new(format!(
                        "`form` of algorithm `sism` is `{value}`; it must be `exact`"
                    )));
                }
                _ => {
                    return Err(BadInput::new(format!(
                        "`{option}` is no option of algorithm `sism`; it must be `form=exact`"
                    )));
                }
            }
        }
        Ok(Algorithm::Sism)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_shown_can_be_read() {
        let shown = Algorithm::default().to_string();
        assert_eq!(shown.parse::<Algorithm>().expect("own text"), Algorithm::default());
        assert_eq!("sism".parse::<Algorithm>().expect("a name"), Algorithm::default());
    }

    #[test]
    fn what_is_planned_says_so() {
        for text in ["atty", "hard", "sism:form=printed"] {
            let error = text.parse::<Algorithm>().expect_err("not built");
            assert!(error.to_string().contains("not in this version"), "{error}");
        }
    }

    #[test]
    fn what_is_nothing_is_refused() {
        for text in ["", "sims", "sism:form=round", "sism:colour=red", "sism:form"] {
            assert!(text.parse::<Algorithm>().is_err(), "{text}");
        }
    }
}
