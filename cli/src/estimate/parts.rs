//! A log of any length, inspected and mended part by part.

use identification::inputs::{LogKind, check_rate, inspect};
use identification::log::{LogReader, LogRow};
use joint_file::JointFile;
use problem::Problems;
use std::collections::VecDeque;
use std::f64::consts::TAU;
use std::io::BufRead;
use std::path::Path;

/// Rows of a part: some minutes at 1 kHz.
const PART: usize = 200_000;
/// Fewest rows that are inspected by themselves.
const LEAST: usize = 50;

/// Rows of a log after inspection.
pub(super) struct Parts<'a> {
    joint: &'a JointFile,
    file: String,
    accept: bool,
    rows: VecDeque<LogRow>,
    /// The last row that was given, as it was mended.
    last: Option<LogRow>,
    /// Every remark, each once.
    said: Vec<String>,
    steps: Vec<f64>,
}

impl<'a> Parts<'a> {
    pub(super) fn new(joint: &'a JointFile, log: &Path, accept: bool) -> Self {
        Self {
            joint,
            file: log.display().to_string(),
            accept,
            rows: VecDeque::new(),
            last: None,
            said: Vec::new(),
            steps: Vec::new(),
        }
    }

    /// The next row, mended; none at the end.
    ///
    /// # Errors
    /// As [`LogReader::next_row`]; a part that is not what it claims to be, unless that is accepted.
    pub(super) fn next_row<R: BufRead>(
        &mut self,
        log: &mut LogReader<R>,
    ) -> Result<Option<LogRow>, Problems> {
        if self.rows.is_empty() {
            self.read(log)?;
        }
        let row = self.rows.pop_front();
        self.last = row.or(self.last);
        Ok(row)
    }

    fn read<R: BufRead>(&mut self, log: &mut LogReader<R>) -> Result<(), Problems> {
        let mut rows = Vec::new();
        while rows.len() < PART
            && let Some(row) = log.next_row()?
        {
            rows.push(row);
        }
        if self.steps.is_empty() {
            self.steps = rows.windows(2).map(|w| w[1].t - w[0].t).collect();
        }
        if rows.len() >= LEAST {
            rows = self.inspected(rows)?;
        }
        // A part that begins behind a wrap goes on where the last one ended.
        if let (Some(last), Some(first)) = (self.last, rows.first().copied()) {
            let turns = |by: f64| TAU * (by / TAU).round();
            let q = turns(last.q - first.q);
            let moved = self.joint.joint.gear_ratio * (first.q + q - last.q);
            let theta = -turns(first.theta - last.theta - moved);
            for row in &mut rows {
                row.theta += theta;
                row.q += q;
            }
        }
        self.rows = rows.into();
        Ok(())
    }

    fn inspected(&mut self, rows: Vec<LogRow>) -> Result<Vec<LogRow>, Problems> {
        match inspect(self.joint, &rows, LogKind::Run) {
            Ok(found) => {
                found.notes.iter().for_each(|note| self.say("note", note));
                Ok(found.mended)
            }
            Err(problems) if self.accept => {
                problems
                    .0
                    .iter()
                    .for_each(|p| self.say("accepted", &p.to_string()));
                Ok(rows)
            }
            Err(problems) => {
                let placed = problems.0.into_iter().map(|p| p.or_at(&self.file, 0));
                Err(Problems(placed.collect()))
            }
        }
    }

    fn say(&mut self, how: &str, what: &str) {
        let line = format!("{how}: {}: {what}", self.file);
        if !self.said.contains(&line) {
            eprintln!("{line}");
            self.said.push(line);
        }
    }

    /// Judges the rate of a log that was too short to be inspected.
    ///
    /// # Errors
    /// Another rate than the joint's.
    pub(super) fn finish(&self) -> Result<(), Problems> {
        check_rate(&self.steps, self.joint.sample_period())
            .map_err(|p| p.or_at(&self.file, 0).into())
    }
}
