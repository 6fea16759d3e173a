//! What came out of a study, gathered from the cache point by point: all reports at once may be more than fit in memory.

use std::path::{Path, PathBuf};

use lrbsim_reports::analysis::{Finding, findings, markdown};
use lrbsim_reports::files::ResultDir;
use lrbsim_reports::study::{
    PointHost, STUDY_SCHEMA_VERSION, StudyHosts, StudyPoint, StudyReport, StudyWriter,
};
use lrbsim_reports::{Digest, page};
use serde_json::Value;

use super::cache::Cache;
use super::file::Study;
use super::ledger::Outcome;
use super::run::Status;
use super::work::Work;
use crate::error::BadInput;
use crate::frame::SEMANTICS;

/// What came out of a study.
#[derive(Debug)]
pub struct StudyOutput {
    /// The study without its points.
    pub head: StudyReport,
    /// How the study went.
    pub status: Status,
    points: Vec<Ended>,
    /// Where the reports are.
    cache: Cache,
}

/// A point that is over.
#[derive(Debug)]
struct Ended {
    values: Vec<Value>,
    key: String,
    error: Option<String>,
}

impl StudyOutput {
    /// The points of `work`, which are all of `study`, with how each ended.
    pub(super) fn new(
        study: &Study,
        work: &Work,
        outcomes: Vec<Outcome>,
        cache: Cache,
        status: Status,
    ) -> StudyOutput {
        let head = StudyReport {
            schema_version: STUDY_SCHEMA_VERSION,
            lrbsim_version: env!("CARGO_PKG_VERSION").to_owned(),
            semantics: SEMANTICS,
            study: study.file.clone(),
            points: Vec::new(),
        };
        let points = study.points.iter().zip(&work.tasks).zip(outcomes);
        let points = points.map(|((values, task), outcome)| Ended {
            values: values.clone(),
            key: task.as_ref().map(|task| task.key.clone()).unwrap_or_default(),
            error: outcome.err(),
        });
        StudyOutput { head, status, points: points.collect(), cache }
    }

    /// A point with its report, and what it cost the host that ran it.
    fn point(&self, ended: &Ended) -> (StudyPoint, Option<PointHost>) {
        let Ended { values, key, error } = ended;
        let entry = error.is_none().then(|| self.cache.get(key)).flatten();
        let gone =
            || format!("its result is gone from {}; run the study again", self.cache.folder().display());
        let error = error.clone().or_else(|| entry.is_none().then(gone));
        let (host, report, pictures) = match entry {
            Some(entry) => {
                let host = PointHost { key: entry.key, build: entry.build, host: entry.host };
                (Some(host), Some(entry.report), entry.pictures)
            }
            None => (None, None, None),
        };
        (StudyPoint { values: values.clone(), key: key.clone(), error, report, pictures }, host)
    }

    /// Writes the results of the study to `dir`, `study.json` last, in place of the results there. Tells their paths,
    /// what of the study is still to be shown, and how many builds of lrbsim have run its points.
    pub fn write(&self, dir: &Path) -> Result<(Vec<PathBuf>, Digest, usize), BadInput> {
        let mut dir = ResultDir::open(dir)?;
        let mut digest = Digest::new(&self.head);
        let mut hosts = StudyHosts::default();
        dir.stage_with("study.json", |file| {
            let mut writer = StudyWriter::begin(file, &self.head)?;
            for ended in &self.points {
                let (point, host) = self.point(ended);
                writer.point(&point)?;
                digest.add(point);
                hosts.points.extend(host);
            }
            writer.end()
        })?;
        dir.stage("host.json", hosts.to_json().as_bytes())?;
        for (name, bytes) in drawings(&digest) {
            dir.stage(&name, &bytes)?;
        }
        dir.first_goes_last();
        Ok((dir.replace()?, digest, hosts.builds()))
    }
}

/// The files of a study that are drawn from `study.json`: names and bytes.
pub fn drawings(study: &Digest) -> Vec<(String, Vec<u8>)> {
    let findings = findings(study);
    let mut files = vec![("table.md".to_owned(), markdown(&study.study.study, &findings).into_bytes())];
    files.extend(findings.iter().flat_map(Finding::files));
    files.push(("report.html".to_owned(), page::of_study(study).into_bytes()));
    files
}
