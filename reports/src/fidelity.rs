//! Results of the study of fidelity: what each level of modeling costs the host, and how far its times are off.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::analysis::{Finding, document, paragraphs};
use crate::plot::{Axis, Lines, Look, Plot, Series};
use crate::sheet::{Cell, Sheet, short};

/// Version of the layout of [`FidelityReport`].
pub const FIDELITY_SCHEMA_VERSION: u32 = 1;

/// A phase counts from this share of the frame's time at the reference level on.
pub const SHARE_MIN: f64 = 0.1;

/// Everything that came out of the study: `fidelity.json`. Seconds are those of the host that ran it; all else is the same on every host.
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
    /// Host threads that ran it.
    pub host_threads: u32,
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
    /// Seconds of the host in the kernels and the model.
    pub seconds: f64,
    /// Simulated time of the whole, less that of the reference, divided by it; null at levels without time.
    pub error: Option<f64>,
    /// The greatest such error, either way, of the phases that take at least a tenth of the time; null at levels without time.
    pub phase_error: Option<f64>,
    /// The phase that has it.
    pub phase: Option<String>,
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

    /// What the study is about, for somebody who reads of it for the first time: paragraphs.
    pub fn introduction(&self) -> Vec<String> {
        let mut paragraphs = vec![
            format!(
                "A simulation can be cheap or exact. Each level of modeling (`--fidelity`) ran the same programs on {}, the scenes of Johnson et al. 2009 in \
                 small pictures and two microbenchmarks; `{}`, the most exact, is what the others are compared with. Seconds are those in the kernels and the \
                 model, with {} host {}: what scene, eye view and pictures take is the same at every level.",
                self.machine,
                self.reference,
                self.host_threads,
                if self.host_threads == 1 { "thread" } else { "threads" },
            ),
            "Detailed simulators in wide use run 0.04 to 2 million instructions a second on a core of the host.".to_owned(),
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
                self.reference,
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
                 phases by {} %, each with an interval. On pictures as small as these most steps are timed whole; the longer a run, the more it saves.",
                short(best.speed),
                self.reference,
                best.level,
                short(100.0 * whole),
                short(100.0 * phase)
            ));
        }
        if let Some(roofline) = of("roofline") {
            let [whole, phase] = roofline.errors.unwrap_or_default();
            advice.push(format!(
                "`roofline` is for the order of machines and for what limits them, not for times: {} times as fast as `{}`, and off by up to {} % of a phase, \
                 {} % of a whole. In a study a further machine costs next to nothing.",
                short(roofline.speed),
                self.reference,
                short(100.0 * phase),
                short(100.0 * whole)
            ));
        }
        advice
    }

    fn summaries(&self) -> Vec<Summary> {
        let Some(first) = self.subjects.first() else { return Vec::new() };
        let summary = |(place, level): (usize, &FidelityLevel)| {
            let rows =
                || self.subjects.iter().filter_map(|subject| Some((subject, subject.levels.get(place)?)));
            let reference =
                |subject: &FidelitySubject| subject.levels.last().map_or(0.0, |level| level.seconds);
            let speeds = rows().map(|(subject, row)| (reference(subject) / row.seconds.max(1e-9)).ln());
            let worst = |error: fn(&FidelityLevel) -> Option<f64>| {
                rows().filter_map(|(_, row)| error(row)).map(f64::abs).reduce(f64::max)
            };
            let seconds: f64 = rows().map(|(_, row)| row.seconds).sum();
            let instructions: u64 = rows().map(|(subject, _)| subject.instructions).sum();
            Summary {
                level: level.level.clone(),
                speed: (speeds.sum::<f64>() / self.subjects.len() as f64).exp(),
                rate: instructions as f64 / seconds.max(1e-9),
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
            .chain(self.subjects.iter().map(|subject| self.finding(subject)))
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
        let point = |summary: &Summary| summary.errors.map(|[_, phase]| (summary.speed, 100.0 * phase));
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
                self.reference,
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
                x: Axis::new(format!("times as fast as {}", self.reference), true),
                y: Axis::new("greatest error of a phase, %", false),
                series: series.collect(),
            })),
        }
    }

    fn finding(&self, subject: &FidelitySubject) -> Finding {
        let percent = |error: Option<f64>| Cell::maybe(error.map(|error| 100.0 * error));
        let rows = subject.levels.iter().map(|level| {
            vec![
                Cell::Text(level.level.clone()),
                Cell::Number(level.seconds),
                Cell::Number(subject.instructions as f64 / level.seconds.max(1e-9) / 1e6),
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

    /// The study as one Markdown text.
    pub fn markdown(&self) -> String {
        let about = std::iter::repeat(String::new());
        document("fidelity", &paragraphs(&self.introduction()), &self.findings(), about)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report() -> FidelityReport {
        let level = |level: &str, seconds: f64, error: Option<f64>| FidelityLevel {
            level: level.to_owned(),
            seconds,
            error,
            phase_error: error.map(|error| 2.0 * error),
            phase: error.map(|_| "soft".to_owned()),
        };
        let subject = |name: &str, factor: f64| FidelitySubject {
            name: name.to_owned(),
            about: "a picture".to_owned(),
            instructions: 8_000_000,
            levels: vec![
                level("functional", 0.1, None),
                level("windowed", factor, Some(-0.01 * factor)),
                level("cycle", 8.0, Some(0.0)),
            ],
        };
        FidelityReport {
            schema_version: FIDELITY_SCHEMA_VERSION,
            lrbsim_version: String::new(),
            semantics: 1,
            machine: "larrabee-24".to_owned(),
            host_threads: 2,
            reference: "cycle".to_owned(),
            subjects: vec![subject("palm", 1.0), subject("fern", 4.0)],
        }
    }

    #[test]
    fn speeds_are_geometric_means_and_errors_the_greatest() {
        let report = report();
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
}
