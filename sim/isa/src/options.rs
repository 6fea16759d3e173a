//! What users choose by name, with options: `NAME` or `NAME:KEY=VALUE,…`, as methods and fidelities are.
//!
//! An [`Entry`] says once what there is to choose and what is allowed. Parsing, help, schemas and pages of documentation are
//! made from it.

use core::fmt;

/// Something that users choose by its name.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Entry {
    /// The name, as users write it.
    pub name: &'static str,
    /// What it is, in a few words without a full stop.
    pub about: &'static str,
    /// The options that it takes, in the order in which they are shown.
    pub options: &'static [OptionSpec],
}

/// An option of an [`Entry`]: its name, what it does and which values it takes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OptionSpec {
    /// The name before the `=`.
    pub name: &'static str,
    /// What the option decides, in a few words without a full stop.
    pub about: &'static str,
    /// The values that the option takes.
    pub values: Values,
    /// The value where users give none, as they would write it.
    pub default: &'static str,
    /// Whether results leave the option unsaid where it has its default: what they have been told by before there was such an
    /// option still holds then, and they need not be run again.
    pub tacit: bool,
}

/// The values that an option takes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Values {
    /// One of several words.
    OneOf(&'static [Word]),
    /// A whole number between two limits, both allowed.
    Whole(u32, u32),
    /// A number between two limits, both allowed.
    Number(f64, f64),
    /// A whole number of percent between two limits, both allowed; users may leave out the sign.
    Percent(u32, u32),
}

/// A word that an option takes, and what it means.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Word {
    /// The word, as users write it.
    pub name: &'static str,
    /// What it means, in a few words without a full stop.
    pub about: &'static str,
}

/// The options of an [`Entry`] with a value for each.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    specs: &'static [OptionSpec],
    /// The value of each option.
    values: Vec<Value>,
}

/// The value of an option.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Value {
    /// The number of the word in its list.
    Word(usize),
    Whole(u32),
    Number(f64),
}

/// A choice that cannot be had: says what was written, and what would be right.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ChoiceError(String);

impl fmt::Display for ChoiceError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl core::error::Error for ChoiceError {}

/// The entry that `text` chooses among `entries`, by its number, with its options. `kind` says in messages what is chosen.
///
/// # Errors
/// [`ChoiceError`] where there is no such entry, or it does not take these options.
pub fn choose(
    kind: &'static str,
    text: &str,
    entries: impl Iterator<Item = Entry> + Clone,
) -> Result<(usize, Options), ChoiceError> {
    let (name, options) = match text.split_once(':') {
        Some((name, options)) => (name, Some(options)),
        None => (text, None),
    };
    let found = entries.clone().enumerate().find(|(_, entry)| entry.name == name);
    let Some((number, entry)) = found else {
        let names: Vec<&str> = entries.map(|entry| entry.name).collect();
        return Err(ChoiceError(format!("`{name}` is no {kind}; it must be {}", list(&names))));
    };
    if options == Some("") {
        let right = match entry.options {
            [] => String::new(),
            specs => format!(", or {} after it", forms(specs)),
        };
        return Err(ChoiceError(format!(
            "`{text}` has no option after its colon; it must be `{name}`{right}"
        )));
    }
    Ok((number, entry.options(options.unwrap_or_default())?))
}

impl Entry {
    /// The options that `text` gives, `KEY=VALUE,…`, and the defaults of all others.
    ///
    /// # Errors
    /// [`ChoiceError`] where the entry does not take these options.
    pub fn options(&self, text: &str) -> Result<Options, ChoiceError> {
        let mut values: Vec<Option<Value>> = vec![None; self.options.len()];
        // No text is no options; an option that is no text is a slip.
        for written in text.split(',').filter(|_| !text.is_empty()) {
            if written.is_empty() {
                let right = self.right();
                return Err(ChoiceError(format!(
                    "`{text}` has a comma without an option beside it; {right}"
                )));
            }
            let (number, value) = self.option(written)?;
            if values[number].replace(value).is_some() {
                let (option, of) = (self.options[number].name, self.name);
                return Err(ChoiceError(format!("`{option}` of `{of}` is there twice")));
            }
        }
        let or_default = |(value, spec): (Option<Value>, &OptionSpec)| {
            value
                .or_else(|| spec.values.parse(spec.default))
                .expect("a default is a value that the option takes")
        };
        Ok(Options {
            specs: self.options,
            values: values.into_iter().zip(self.options).map(or_default).collect(),
        })
    }

    /// These `options` of the entry with the one that `written`, `KEY=VALUE`, gives in place of what it was.
    ///
    /// # Errors
    /// [`ChoiceError`] where the entry does not take this option.
    pub fn with_option(&self, mut options: Options, written: &str) -> Result<Options, ChoiceError> {
        let (number, value) = self.option(written)?;
        options.values[number] = value;
        Ok(options)
    }

    /// The number of the option that `written`, `KEY=VALUE`, gives, and its value.
    fn option(&self, written: &str) -> Result<(usize, Value), ChoiceError> {
        let of = self.name;
        let (name, value) = written.split_once('=').unwrap_or((written, ""));
        let Some(number) = self.options.iter().position(|spec| spec.name == name) else {
            let right = self.right();
            return Err(ChoiceError(format!("`{written}` is no option of `{of}`; {right}")));
        };
        let right = self.options[number].values;
        if value.is_empty() {
            return Err(ChoiceError(format!(
                "`{name}` of `{of}` has no value; `{name}=` must be followed by {right}"
            )));
        }
        let parsed = right.parse(value);
        let wrong = || ChoiceError(format!("`{name}` of `{of}` is `{value}`; it must be {right}"));
        Ok((number, parsed.ok_or_else(wrong)?))
    }

    /// Which options there are, as a clause: "it must be `form=…` or `lights=…`".
    fn right(&self) -> String {
        match self.options {
            [] => "it takes none".to_owned(),
            specs => format!("it must be {}", forms(specs)),
        }
    }
}

impl Values {
    /// The value that `text` is; `None` where it is none of these.
    fn parse(&self, text: &str) -> Option<Value> {
        match *self {
            Values::OneOf(words) => words.iter().position(|word| word.name == text).map(Value::Word),
            Values::Whole(least, most) => {
                text.parse().ok().filter(|x| (least..=most).contains(x)).map(Value::Whole)
            }
            Values::Number(least, most) => {
                text.parse().ok().filter(|x| (least..=most).contains(x)).map(Value::Number)
            }
            Values::Percent(least, most) => {
                Values::Whole(least, most).parse(text.strip_suffix('%').unwrap_or(text))
            }
        }
    }
}

impl fmt::Display for Values {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Values::OneOf(words) => {
                f.write_str(&list(&words.iter().map(|word| word.name).collect::<Vec<_>>()))
            }
            Values::Whole(least, most) => write!(f, "a whole number from {least} to {most}"),
            Values::Number(least, most) => write!(f, "a number from {least} to {most}"),
            Values::Percent(least, most) => write!(f, "a whole number from {least}% to {most}%"),
        }
    }
}

impl Options {
    /// The number of the word that `option` has, in the list of its words.
    ///
    /// # Panics
    /// Where there is no such option or it takes no words: a slip of who asks, not of users.
    pub fn word(&self, option: &str) -> usize {
        match self.value(option) {
            Value::Word(number) => number,
            other => panic!("option `{option}` is {other:?} and no word"),
        }
    }

    /// The whole number, of percent too, that `option` has.
    ///
    /// # Panics
    /// Where there is no such option or it takes no whole number: a slip of who asks, not of users.
    pub fn whole(&self, option: &str) -> u32 {
        match self.value(option) {
            Value::Whole(number) => number,
            other => panic!("option `{option}` is {other:?} and no whole number"),
        }
    }

    /// The number that `option` has.
    ///
    /// # Panics
    /// Where there is no such option or it takes no number: a slip of who asks, not of users.
    pub fn number(&self, option: &str) -> f64 {
        match self.value(option) {
            Value::Number(number) => number,
            other => panic!("option `{option}` is {other:?} and no number"),
        }
    }

    /// The name of each option and its value, as users write them.
    pub fn written(&self) -> impl Iterator<Item = (&'static str, String)> {
        self.specs.iter().zip(&self.values).map(|(spec, value)| {
            let text = match (*value, spec.values) {
                (Value::Word(number), Values::OneOf(words)) => words[number].name.to_owned(),
                (Value::Word(number), _) => unreachable!("word {number} of an option without words"),
                (Value::Whole(number), Values::Percent(..)) => format!("{number}%"),
                (Value::Whole(number), _) => number.to_string(),
                (Value::Number(number), _) => number.to_string(),
            };
            (spec.name, text)
        })
    }

    fn value(&self, option: &str) -> Value {
        let number = self.specs.iter().position(|spec| spec.name == option);
        self.values[number.unwrap_or_else(|| panic!("there is no option `{option}`"))]
    }
}

/// All options with their values, as they can be written: `form=exact,lights=4`. Tacit ones only where they are not what they
/// would be if unsaid.
impl fmt::Display for Options {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let is_said = |spec: &OptionSpec, value: &str| !spec.tacit || value != spec.default;
        let each: Vec<String> = self
            .specs
            .iter()
            .zip(self.written())
            .filter(|(spec, (_, value))| is_said(spec, value))
            .map(|(_, (name, value))| format!("{name}={value}"))
            .collect();
        f.write_str(&each.join(","))
    }
}

/// Options as a sentence lists them: "`form=…` or `lights=…`".
fn forms(specs: &[OptionSpec]) -> String {
    list(&specs.iter().map(|spec| format!("{}=…", spec.name)).collect::<Vec<_>>())
}

/// Names as a sentence lists them: "`a`, `b` or `c`".
fn list(names: &[impl fmt::Display]) -> String {
    let mut text = String::new();
    for (i, name) in names.iter().enumerate() {
        let before = match (i, i + 1 == names.len()) {
            (0, _) => "",
            (_, true) => " or ",
            (_, false) => ", ",
        };
        text.push_str(&format!("{before}`{name}`"));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    const BREW: Entry = Entry {
        name: "brew",
        about: "boils water",
        options: &[
            OptionSpec {
                name: "leaf",
                about: "what is in it",
                values: Values::OneOf(&[
                    Word { name: "green", about: "steamed" },
                    Word { name: "black", about: "oxidized" },
                ]),
                default: "black",
                tacit: false,
            },
            OptionSpec {
                name: "cups",
                about: "how many",
                values: Values::Whole(1, 12),
                default: "2",
                tacit: false,
            },
            OptionSpec {
                name: "heat",
                about: "how hot",
                values: Values::Number(0.5, 1.0),
                default: "0.9",
                tacit: false,
            },
            OptionSpec {
                name: "milk",
                about: "how much of it is milk",
                values: Values::Percent(0, 50),
                default: "0%",
                tacit: true,
            },
        ],
    };
    const REST: Entry = Entry { name: "rest", about: "does nothing", options: &[] };

    fn chosen(text: &str) -> Result<(usize, Options), ChoiceError> {
        choose("way", text, [REST, BREW].into_iter())
    }

    #[test]
    fn what_is_not_written_has_its_default_and_what_is_shown_can_be_read() {
        let (number, options) = chosen("brew:cups=3").expect("a choice");
        assert_eq!((number, options.word("leaf"), options.whole("cups")), (1, 1, 3));
        assert_eq!(options.number("heat"), 0.9);
        assert_eq!(options.to_string(), "leaf=black,cups=3,heat=0.9");
        assert_eq!(chosen(&format!("brew:{options}")), Ok((number, options.clone())));
        assert_eq!(
            chosen("rest").map(|(number, options)| (number, options.to_string())),
            Ok((0, String::new()))
        );
        let more = BREW.with_option(options, "cups=4").expect("an option");
        assert_eq!(more.to_string(), "leaf=black,cups=4,heat=0.9");
        for written in ["milk=20", "milk=20%"] {
            let more = BREW.with_option(more.clone(), written).expect("an option");
            assert_eq!(
                (more.whole("milk"), more.to_string()),
                (20, "leaf=black,cups=4,heat=0.9,milk=20%".to_owned())
            );
        }
    }

    #[test]
    fn a_tacit_option_is_shown_where_it_is_not_what_it_would_be_unsaid() {
        const STEEP: Entry = Entry {
            name: "steep",
            about: "waits",
            options: &[OptionSpec {
                name: "minutes",
                about: "how long",
                values: Values::Whole(1, 9),
                default: "4",
                tacit: true,
            }],
        };
        for (written, shown) in [("", ""), ("minutes=4", ""), ("minutes=5", "minutes=5")] {
            let options = STEEP.options(written).expect("an option");
            assert_eq!(options.to_string(), shown);
            assert_eq!(STEEP.options(shown), Ok(options));
        }
    }

    #[test]
    fn what_cannot_be_had_is_refused_with_what_would_be_right() {
        for (text, message) in [
            ("", "`` is no way; it must be `rest` or `brew`"),
            ("brow:cups=3", "`brow` is no way; it must be `rest` or `brew`"),
            ("rest:", "`rest:` has no option after its colon; it must be `rest`"),
            (
                "brew:",
                "`brew:` has no option after its colon; it must be `brew`, or `leaf=…`, `cups=…`, `heat=…` or `milk=…` after it",
            ),
            (
                "brew:,,",
                "`,,` has a comma without an option beside it; it must be `leaf=…`, `cups=…`, `heat=…` or `milk=…`",
            ),
            (
                "brew:cups=3,",
                "`cups=3,` has a comma without an option beside it; it must be `leaf=…`, `cups=…`, `heat=…` or `milk=…`",
            ),
            ("rest:long", "`long` is no option of `rest`; it takes none"),
            (
                "brew:cup=3",
                "`cup=3` is no option of `brew`; it must be `leaf=…`, `cups=…`, `heat=…` or `milk=…`",
            ),
            ("brew:milk=60%", "`milk` of `brew` is `60%`; it must be a whole number from 0% to 50%"),
            ("brew:leaf", "`leaf` of `brew` has no value; `leaf=` must be followed by `green` or `black`"),
            (
                "brew:cups=",
                "`cups` of `brew` has no value; `cups=` must be followed by a whole number from 1 to 12",
            ),
            ("brew:leaf=red", "`leaf` of `brew` is `red`; it must be `green` or `black`"),
            ("brew:cups=0", "`cups` of `brew` is `0`; it must be a whole number from 1 to 12"),
            ("brew:heat=nan", "`heat` of `brew` is `nan`; it must be a number from 0.5 to 1"),
            ("brew:cups=3,cups=4", "`cups` of `brew` is there twice"),
        ] {
            assert_eq!(chosen(text).expect_err("refused").to_string(), message);
        }
    }
}
