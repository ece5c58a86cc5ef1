//! Requests for recordings: checked, handed to the recorder, answered when it has carried them out.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use problem::{Allowed, Problem};
use robot_state::{Content, Request, request};

use super::PROGRESS;
use crate::recorder::{Contents, HISTORY_S, RecorderHandle, RecordingRequest, RecordingStatus};

/// Longest time for the recorder to begin or end a file.
const LIMIT: Duration = Duration::from_secs(20);
/// Longest recording that can be asked for, s: a day. Without a duration there is no limit.
const MAX_SECONDS: f64 = 86_400.0;

/// The recorder, and the request that it is carrying out.
#[derive(Debug, Default)]
pub(super) struct RecordingRequests {
    recorder: Option<RecorderHandle>,
    /// The loop's, s.
    period_s: f64,
    waiting: Option<Waiting>,
}

/// A request whose outcome is waited for.
#[derive(Debug)]
struct Waiting {
    asked: Request,
    /// The status's count before the request.
    generation: u64,
    since: Instant,
    answered: Instant,
}

/// The last answer's text, or none if another follows.
type Outcome = Result<Option<String>, Problem>;

impl RecordingRequests {
    pub(super) fn record_with(&mut self, recorder: RecorderHandle, period_s: f64) {
        self.recorder = Some(recorder);
        self.period_s = period_s;
    }

    /// Begins a recording; its outcome follows.
    pub(super) fn begin(&mut self, asked: &Request, now: Instant) -> Result<(), Problem> {
        let path = PathBuf::from(asked.path.as_str());
        if !path.is_absolute() {
            return Err(Problem::new(
                format!("{path:?} is no place to record to"),
                "an absolute path",
            ));
        }
        let last = Allowed::Within(0.0, HISTORY_S);
        if !last.admits(asked.last_s) {
            return Err(Problem::new(
                format!("{} s back cannot be recorded", asked.last_s),
                format!("{last} s: what the daemon's memory holds"),
            ));
        }
        if asked.seconds.is_nan() || asked.seconds > MAX_SECONDS {
            return Err(Problem::new(
                format!("{} s cannot be recorded", asked.seconds),
                format!("up to {MAX_SECONDS} s; negative: until its end is asked for"),
            ));
        }
        let content = Content::from_number(asked.content).ok_or_else(|| {
            let reason = format!("there is no content {} of a recording", asked.content);
            Problem::new(reason, "0 all, 1 frames, 2 torques")
        })?;
        let rate_hz = (asked.rate_hz != 0.0).then_some(asked.rate_hz);
        let contents = Contents::new(content, rate_hz, self.period_s)?;
        let begin = RecordingRequest::Begin {
            path,
            seconds: (asked.seconds >= 0.0).then_some(asked.seconds),
            last_s: asked.last_s,
            contents,
            overwrite: asked.overwrite == 1,
            unattended: false,
        };
        self.hand_over(asked, begin, now)
    }

    /// Ends the recording; its outcome follows.
    pub(super) fn end(&mut self, asked: &Request, now: Instant) -> Result<(), Problem> {
        self.hand_over(asked, RecordingRequest::End, now)
    }

    /// The recording in a sentence, and whether it has ended; whoever asks wants it to go on.
    pub(super) fn show(&self) -> Result<(String, bool), Problem> {
        let recorder = self.recorder()?;
        recorder.ask(RecordingRequest::Renew);
        let status = recorder.status();
        Ok((describe(&status)?, !status.running))
    }

    /// The outcome of what is waited for, if there is something to answer.
    pub(super) fn advance(&mut self, now: Instant) -> Option<(Request, Outcome)> {
        let mut waiting = self.waiting.take()?;
        let status = self.recorder.as_ref()?.status();
        let asked = waiting.asked;
        let begun = status.generation != waiting.generation;
        let outcome = match asked.kind {
            request::RECORD if begun => Some(outcome_of_begin(&status)),
            request::END_RECORDING if !status.running => Some(describe(&status)),
            _ if now.duration_since(waiting.since) > LIMIT => Some(Err(Problem::new(
                "the recorder does not answer: the disk may hang",
                "",
            ))),
            _ => None,
        };
        if let Some(outcome) = outcome {
            return Some((asked, outcome.map(Some)));
        }
        let due = now.duration_since(waiting.answered) >= PROGRESS;
        if due {
            waiting.answered = now;
        }
        self.waiting = Some(waiting);
        due.then_some((asked, Ok(None)))
    }

    fn hand_over(
        &mut self,
        asked: &Request,
        request: RecordingRequest,
        now: Instant,
    ) -> Result<(), Problem> {
        if self.waiting.is_some() {
            return Err(Problem::new(
                "another request to record is being served",
                "",
            ));
        }
        let recorder = self.recorder()?;
        let generation = recorder.status().generation;
        recorder.ask(request);
        self.waiting = Some(Waiting {
            asked: *asked,
            generation,
            since: now,
            answered: now,
        });
        Ok(())
    }

    fn recorder(&self) -> Result<&RecorderHandle, Problem> {
        let recorder = self.recorder.as_ref();
        recorder.ok_or_else(|| Problem::new("this daemon has no recorder", ""))
    }
}

fn outcome_of_begin(status: &RecordingStatus) -> Result<String, Problem> {
    match &status.refused {
        Some(why) => Err(Problem::new(why, "")),
        None => Ok(format!("recording into {}", status.path.display())),
    }
}

fn describe(status: &RecordingStatus) -> Result<String, Problem> {
    let contents = format!(
        "{:.1} s, {} cycles, {} lost, {:.1} MB before compression",
        status.seconds,
        status.cycles,
        status.lost,
        status.bytes as f64 * 1e-6
    );
    match &status.failed {
        Some(why) => Err(Problem::new(
            format!(
                "{}: the recording ended: {why}; until then {contents}",
                status.path.display()
            ),
            "",
        )),
        None if status.generation == 0 => Err(Problem::new("nothing has been recorded", "")),
        None => Ok(contents),
    }
}
