//! Results of the study of fidelity: what each level of modeling costs the host, and how far its times are off.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::analysis::{Finding, document, paragraphs};
use crate::picture::sha256;
use crate::plot::{Axis, Lines, Look, Plot, Series};
use crate::sheet::{Cell, Sheet, short};

/// Version of the layout of [`FidelityReport`].
pub const FIDELITY_SCHEMA_VERSION: u32 = 2;

/// Version of the layout of [`FidelitySeconds`].
pub const PRICES_SCHEMA_VERSION: u32 = 2;

/// A phase counts from this share of the frame's time at the reference level on.
pub const SHARE_MIN: f64 = 0.1;

/// The errors that came out of the study: `fidelity.json`, the same on every host.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FidelityReport {
    /// Version of this layout.
    pub schema_version: u32,
    /// Version of the simulator.
    pub lrbsim_version: String,
    /// Version of what the simulator's numbers mean.
    pub semantics: u32,
    /// Name of the machine that is simulated.
    pub machine: String,
    /// The level that the others are compared with.
    pub reference: String,
    /// What is run at every level.
    pub subjects: Vec<FidelitySubject>,
}

/// A program that is run at every level.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FidelitySubject {
    /// Name of the scene or of the microbenchmark.
    pub name: String,
    /// What is run, in words.
    pub about: String,
    /// Simulated instructions at the reference level.
    pub instructions: u64,
    /// The levels, from the cheapest to the reference.
    pub levels: Vec<FidelityLevel>,
}

/// A level of modeling, measured on a subject.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FidelityLevel {
    /// The level with its options, as `--fidelity` takes it.
    pub level: String,
    /// Simulated time of the whole, less that of the reference, divided by it; null at levels without time.
    pub error: Option<f64>,
    /// The greatest such error, either way, of the phases that take at least a tenth of the time; null at levels without time.
    pub phase_error: Option<f64>,
    /// The phase that has it.
    pub phase: Option<String>,
}

/// What the study took of the host that ran it: `prices.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FidelitySeconds {
    /// Version of this layout.
    pub schema_version: u32,
    /// SHA-256 of the `fidelity.json` that came of the same runs.
    pub errors: String,
    /// Host threads that ran it.
    pub host_threads: u32,
    /// Names of the subjects.
    pub subjects: Vec<String>,
    /// The levels with their options, from the cheapest to the reference.
    pub levels: Vec<String>,
    /// By subject and level, seconds of the host in the kernels and the model.
    pub seconds: Vec<Vec<f64>>,
}

/// Errors and seconds side by side: the study as it is read.
#[derive(Debug, Clone, PartialEq)]
pub struct PriceList {
    /// How far the levels are off.
    pub errors: FidelityReport,
    /// What they take.
    pub host: FidelitySeconds,
}

/// What a level came to over all subjects.
struct Summary {
    level: String,
    /// Times as fast as the reference, the geometric mean.
    speed: f64,
    /// Simulated instructions a second of the host, all together.
    rate: f64,
    /// Greatest error of a whole and of a phase, either way; `None` without time.
    errors: Option<[f64; 2]>,
}

impl FidelityReport {
    /// The bytes of `fidelity.json`.
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).expect("a report has string keys and finite numbers") + "\n"
    }

    /// SHA-256 of [`FidelityReport::to_json`], by which its seconds know it.
    pub fn sha256(&self) -> String {
        sha256(self.to_json().as_bytes())
    }
}

impl FidelitySeconds {
    /// The bytes of `prices.json`.
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).expect("seconds are finite numbers") + "\n"
    }
}

impl PriceList {
    /// Both, if they are of one study: its errors, by their hash, and a time for each subject at each of the levels, the same for all.
    pub fn new(errors: FidelityReport, host: FidelitySeconds) -> Option<PriceList> {
        let levels = |subject: &FidelitySubject| {
            subject.levels.iter().map(|row| row.level.clone()).collect::<Vec<_>>()
        };
        let subjects = errors.subjects.iter().map(|subject| &subject.name).eq(&host.subjects);
        let levels = errors.subjects.iter().all(|subject| levels(subject) == host.levels);
        let seconds = host.seconds.len() == host.subjects.len()
            && host.seconds.iter().all(|seconds| seconds.len() == host.levels.len());
        let is_one = subjects && levels && seconds && host.errors == errors.sha256();
        is_one.then_some(PriceList { errors, host })
    }

    /// The subjects, each with its seconds by level.
    fn subjects(&self) -> impl Iterator<Item = (&FidelitySubject, &[f64])> {
        self.errors.subjects.iter().zip(self.host.seconds.iter().map(Vec::as_slice))
    }

    /// What the study is about, for somebody who reads of it for the first time: paragraphs.
    pub fn introduction(&self) -> Vec<String> {
        let mut paragraphs = vec![
            format!(
                "A simulation can be cheap or exact. Each level of modeling (`--fidelity`) ran the same programs on {}: {}, scenes in \
                 small pictures and microbenchmarks. `{}`, the most exact, is what the others are compared with. Seconds are those in the kernels and the model, with {} host {}: what scene, eye view and pictures take \
                 is the same at every level.",
                self.errors.machine,
                self.host.subjects.join(", "),
                self.errors.reference,
                self.host.host_threads,
                if self.host.host_threads == 1 { "thread" } else { "threads" },
            ),
            "Others: a detailed simulator of an out-of-order processor commonly runs 0.1 million instructions a second, a simplified one 1 to 10 million \
             (Sandberg et al. 2015); one of the fastest, of a thousand cores, runs up to 300 million with detailed cores and 1500 million with simple ones on a \
             host of 16 cores (Sanchez and Kozyrakis 2013).".to_owned(),
        ];
        paragraphs.extend(self.advice());
        paragraphs
    }

    /// Which level to use when, by what was measured: sentences.
    pub fn advice(&self) -> Vec<String> {
        let all = self.summaries();
        let of = |name: &str| all.iter().find(|summary| summary.level.split(':').next() == Some(name));
        let mut advice = Vec::new();
        if let Some(windowed) = of("windowed") {
            let [whole, phase] = windowed.errors.unwrap_or_default();
            advice.push(format!(
                "`windowed` is the default: {} times as fast as `{}`, and no phase that matters is off by more than {} %, no whole by more than {} %.",
                short(windowed.speed),
                self.errors.reference,
                short(100.0 * phase),
                short(100.0 * whole)
            ));
        }
        let sampled: Vec<&Summary> =
            all.iter().filter(|summary| summary.level.starts_with("sampled")).collect();
        if let Some(best) = sampled.iter().max_by(|a, b| a.speed.total_cmp(&b.speed)) {
            let [whole, phase] = best.errors.unwrap_or_default();
            advice.push(format!(
                "`sampled` is for long runs of which a few per cent are enough: here up to {} times as fast as `{}` (`{}`), wholes off by up to {} % and \
                 phases by {} %. It is a sample of `windowed`, for whose times it gives intervals: of these its wholes are off by up to {} %. On pictures as \
                 small as these most steps are timed whole; the longer a run, the more it saves.",
                short(best.speed),
                self.errors.reference,
                best.level,
                short(100.0 * whole),
                short(100.0 * phase),
                short(100.0 * self.greatest_difference(&best.level, "windowed"))
            ));
        }
        if let Some(roofline) = of("roofline") {
            let [whole, phase] = roofline.errors.unwrap_or_default();
            advice.push(format!(
                "`roofline` is for the order of machines and for what limits them, not for times: {} times as fast as `{}`, and off by up to {} % of a phase, \
                 {} % of a whole. In a study a further machine costs next to nothing.",
                short(roofline.speed),
                self.errors.reference,
                short(100.0 * phase),
                short(100.0 * whole)
            ));
        }
        advice
    }

    /// The greatest part, either way, by which the whole of any subject at one level is off that at another.
    fn greatest_difference(&self, level: &str, other: &str) -> f64 {
        let error = |subject: &FidelitySubject, name: &str| {
            subject.levels.iter().find(|row| row.level == name).and_then(|row| row.error)
        };
        let difference = |subject: &FidelitySubject| {
            Some(((1.0 + error(subject, level)?) / (1.0 + error(subject, other)?) - 1.0).abs())
        };
        self.errors.subjects.iter().filter_map(difference).fold(0.0, f64::max)
    }

    fn summaries(&self) -> Vec<Summary> {
        let Some(first) = self.errors.subjects.first() else { return Vec::new() };
        let summary = |(place, level): (usize, &FidelityLevel)| {
            let subjects = || self.errors.subjects.iter();
            let seconds = || self.host.seconds.iter().map(|seconds| seconds[place]);
            let reference = self.host.seconds.iter().filter_map(|seconds| seconds.last());
            let speeds =
                reference.zip(seconds()).map(|(reference, seconds)| (reference / seconds.max(1e-9)).ln());
            let worst = |error: fn(&FidelityLevel) -> Option<f64>| {
                subjects().filter_map(|subject| error(&subject.levels[place])).map(f64::abs).reduce(f64::max)
            };
            let instructions: u64 = subjects().map(|subject| subject.instructions).sum();
            Summary {
                level: level.level.clone(),
                speed: (speeds.sum::<f64>() / self.errors.subjects.len() as f64).exp(),
                rate: instructions as f64 / seconds().sum::<f64>().max(1e-9),
                errors: worst(|row| row.error)
                    .zip(worst(|row| row.phase_error))
                    .map(|(whole, phase)| [whole, phase]),
            }
        };
        first.levels.iter().enumerate().map(summary).collect()
    }

    /// The price list, and then each subject.
    pub fn findings(&self) -> Vec<Finding> {
        std::iter::once(self.price_list())
            .chain(self.subjects().map(|(subject, seconds)| finding(subject, seconds)))
            .collect()
    }

    fn price_list(&self) -> Finding {
        let summaries = self.summaries();
        let percent = |error: f64| Cell::Number(100.0 * error);
        let rows = summaries.iter().map(|summary| {
            let [whole, phase] =
                summary.errors.map_or([Cell::Missing, Cell::Missing], |errors| errors.map(percent));
            vec![
                Cell::Text(summary.level.clone()),
                Cell::Number(summary.speed),
                Cell::Number(summary.rate / 1e6),
                whole,
                phase,
            ]
        });
        // The reference, whose error is none, has no place among logarithms.
        let point = |summary: &Summary| {
            summary.errors.filter(|[_, phase]| *phase > 0.0).map(|[_, phase]| (summary.speed, 100.0 * phase))
        };
        let series = summaries.iter().filter_map(|summary| {
            let points = vec![point(summary)?];
            Some(Series { name: summary.level.clone(), look: Look::Dots, points })
        });
        Finding {
            name: "prices".to_owned(),
            title: "The price list".to_owned(),
            notes: vec![format!(
                "Speeds are geometric means over all subjects, as multiples of that of `{}`; errors are the greatest of any subject, either way, of wholes and of \
                 the phases that take at least {} % of the time.",
                self.errors.reference,
                short(100.0 * SHARE_MIN)
            )],
            sheet: Sheet {
                columns: [
                    "level",
                    "times as fast",
                    "million instructions/s",
                    "error of a whole, %",
                    "error of a phase, %",
                ]
                .map(str::to_owned)
                .to_vec(),
                rows: rows.collect(),
            },
            plot: Some(Plot::Lines(Lines {
                title: "what is gained, and what it costs".to_owned(),
                x: Axis::new(format!("times as fast as {}", self.errors.reference), true),
                y: Axis::new("greatest error of a phase, %", true),
                series: series.collect(),
            })),
        }
    }

    /// The study as one Markdown text.
    pub fn markdown(&self) -> String {
        let about = std::iter::repeat(String::new());
        document("fidelity", &paragraphs(&self.introduction()), &self.findings(), about)
    }
}

/// What the levels take and give on one subject.
fn finding(subject: &FidelitySubject, seconds: &[f64]) -> Finding {
    let percent = |error: Option<f64>| Cell::maybe(error.map(|error| 100.0 * error));
    let rows = subject.levels.iter().zip(seconds).map(|(level, seconds)| {
        vec![
            Cell::Text(level.level.clone()),
            Cell::Number(*seconds),
            Cell::Number(subject.instructions as f64 / seconds.max(1e-9) / 1e6),
            percent(level.error),
            percent(level.phase_error),
            level.phase.clone().map_or(Cell::Missing, Cell::Text),
        ]
    });
    Finding {
        name: subject.name.clone(),
        title: subject.name.clone(),
        notes: vec![format!(
            "{}; {} million instructions.",
            subject.about,
            short(subject.instructions as f64 / 1e6)
        )],
        sheet: Sheet {
            columns: [
                "level",
                "seconds",
                "million instructions/s",
                "error, %",
                "error of a phase, %",
                "phase",
            ]
            .map(str::to_owned)
            .to_vec(),
            rows: rows.collect(),
        },
        plot: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn list() -> PriceList {
        let level = |level: &str, error: Option<f64>| FidelityLevel {
            level: level.to_owned(),
            error,
            phase_error: error.map(|error| 2.0 * error),
            phase: error.map(|_| "soft".to_owned()),
        };
        let subject = |name: &str, factor: f64| FidelitySubject {
            name: name.to_owned(),
            about: "a picture".to_owned(),
            instructions: 8_000_000,
            levels: vec![
                level("functional", None),
                level("windowed", Some(-0.01 * factor)),
                level("cycle", Some(0.0)),
            ],
        };
        let errors = FidelityReport {
            schema_version: FIDELITY_SCHEMA_VERSION,
            lrbsim_version: String::new(),
            semantics: 1,
            machine: "larrabee-24".to_owned(),
            reference: "cycle".to_owned(),
            subjects: vec![subject("palm", 1.0), subject("fern", 4.0)],
        };
        let host = FidelitySeconds {
            schema_version: PRICES_SCHEMA_VERSION,
            errors: errors.sha256(),
            host_threads: 2,
            subjects: ["palm", "fern"].map(str::to_owned).into(),
            levels: ["functional", "windowed", "cycle"].map(str::to_owned).into(),
            seconds: vec![vec![0.1, 1.0, 8.0], vec![0.1, 4.0, 8.0]],
        };
        PriceList::new(errors, host).expect("seconds for each")
    }

    #[test]
    fn speeds_are_geometric_means_and_errors_the_greatest() {
        let report = list();
        let all = report.summaries();
        assert_eq!(all[0].errors, None);
        assert!((all[1].speed - 4.0).abs() < 1e-9, "8 and 2 times as fast: {}", all[1].speed);
        assert_eq!(all[1].errors, Some([0.04, 0.08]));
        assert_eq!((all[1].rate, all[2].speed), (16e6 / 5.0, 1.0));
        let said = report.introduction().join(" ");
        assert!(
            said.contains("4 times as fast as `cycle`, and no phase that matters is off by more than 8 %"),
            "{said}"
        );
        assert!(report.markdown().contains("| windowed | 4 | 3.200 | 4 | 8 |"), "{}", report.markdown());
    }

    #[test]
    fn seconds_of_another_study_are_told_apart() {
        let PriceList { errors, host } = list();
        let is_list =
            |errors: &FidelityReport, host: FidelitySeconds| PriceList::new(errors.clone(), host).is_some();
        assert!(is_list(&errors, host.clone()));
        let mut short = host.clone();
        short.seconds[1].pop();
        assert!(!is_list(&errors, short));
        // A subject that lacks a level, with as few seconds.
        let (mut ragged, mut short) = (errors.clone(), host.clone());
        ragged.subjects[1].levels.pop();
        short.seconds[1].pop();
        short.errors = ragged.sha256();
        assert!(!is_list(&ragged, short));
        // Other errors of the same subjects at the same levels.
        let mut other = errors.clone();
        other.subjects[0].levels[1].error = Some(0.5);
        assert!(!is_list(&other, host));
    }
}
