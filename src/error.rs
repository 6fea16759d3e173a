//! Bad input: one message that says where, what was found and what would be right.

use std::ops::Range;
use std::path::Path;

use miette::{Diagnostic, LabeledSpan, NamedSource, SourceCode, SourceSpan};

/// Input that cannot be used: the user's to mend, never a defect of the program.
#[derive(Debug, thiserror::Error)]
#[error("{message}")]
pub struct BadInput {
    message: String,
    help: Option<String>,
    place: Option<Box<Place>>,
    is_passing: bool,
}

/// A place in a file.
#[derive(Debug)]
struct Place {
    source: NamedSource<String>,
    span: SourceSpan,
    label: String,
}

impl BadInput {
    /// Bad input without a place in a file.
    pub fn new(message: impl Into<String>) -> BadInput {
        BadInput { message: message.into(), help: None, place: None, is_passing: false }
    }

    /// This bad input with a second sentence: what to do about it.
    #[must_use]
    pub fn with_help(mut self, help: impl Into<String>) -> BadInput {
        self.help = Some(help.into());
        self
    }

    /// This bad input as one that the host is at fault for, and only for now: with a disk that is not full, or more memory,
    /// the same would do.
    #[must_use]
    pub fn passing(mut self) -> BadInput {
        self.is_passing = true;
        self
    }

    /// Whether the host is at fault, and only for now.
    pub fn is_passing(&self) -> bool {
        self.is_passing
    }

    /// This bad input with its place in the text of a file: shown with its line and column.
    #[must_use]
    pub fn at(mut self, file: &str, text: &str, span: Range<usize>, label: impl Into<String>) -> BadInput {
        self.place = Some(Box::new(Place {
            source: NamedSource::new(file, text.to_owned()),
            span: span.into(),
            label: label.into(),
        }));
        self
    }

    /// A file that could not be read.
    pub fn unreadable(path: &Path, error: &std::io::Error) -> BadInput {
        BadInput::new(format!("cannot read `{}`: {error}", path.display()))
    }
}

impl Diagnostic for BadInput {
    fn help<'a>(&'a self) -> Option<Box<dyn std::fmt::Display + 'a>> {
        self.help.as_ref().map(|help| Box::new(help) as Box<dyn std::fmt::Display>)
    }

    fn source_code(&self) -> Option<&dyn SourceCode> {
        self.place.as_ref().map(|place| &place.source as &dyn SourceCode)
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        let place = self.place.as_ref()?;
        let label = LabeledSpan::new_primary_with_span(Some(place.label.clone()), place.span);
        Some(Box::new(std::iter::once(label)))
    }
}

impl From<lrbsim_reports::files::FileError> for BadInput {
    fn from(error: lrbsim_reports::files::FileError) -> BadInput {
        BadInput::new(error.to_string()).passing()
    }
}
