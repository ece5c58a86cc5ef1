//! Serves the requests of clients, an operator's, a tare or other contacts, on an ordinary thread.
//!
//! The request server observes every record and keeps the settings of the loop. A tare averages records
//! as they come; the offsets are computed and stored by a thread of their own, as a disk may take its
//! time, and hold from the moment they are stored.

mod fitness;
mod operator;
mod recording_requests;
mod tare_job;

use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use cycle::OperatorRequest;
use dynamics::Model;
use jiff::Timestamp;
use problem::Problem;
use robot_config::{Parameters, Robot, contact_names};
use robot_state::{
    Answer, JointTare, MAX_FT_SENSORS, Mode, Name, Request, Settings, SharedRecord, TaredSensor,
    Text, Wrench, answer_status, request,
};

use crate::offsets::{Offsets, SensorOffset, Store};
use crate::recorder::RecorderHandle;
use operator::{OperatorRequests, Outcome, operator_request};
use recording_requests::RecordingRequests;
use tare_job::TareJob;

/// Period of the answers to a client that waits.
const PROGRESS: Duration = Duration::from_millis(100);

/// Serves requests; see the module.
pub struct RequestServer {
    parameters: Parameters,
    model: Model,
    store: Result<Store, Problem>,
    offsets: Option<Offsets>,
    settings: Settings,
    changed: bool,
    /// The newest record, and its time of arrival.
    newest: Option<(Box<SharedRecord>, Instant)>,
    job: Option<Job>,
    operator: OperatorRequests,
    recording: RecordingRequests,
}

/// Work that takes longer than an answer.
struct Job {
    request: Request,
    stage: Stage,
    answered: Instant,
}

enum Stage {
    Taring(Box<TareJob>),
    /// The thread gives the offsets that hold from now on.
    Storing(JoinHandle<Result<Option<Offsets>, Problem>>),
    Failed(Problem),
}

impl RequestServer {
    /// The server of a robot whose offsets are kept in `store`; without one there are no tares.
    ///
    /// # Errors
    /// Stored offsets that cannot be used.
    pub fn new(robot: &Robot, store: Result<Store, Problem>) -> Result<Self, Problem> {
        let names = ft_names(&robot.parameters);
        let offsets = match &store {
            Ok(store) => store.load(&names)?,
            Err(_) => None,
        };
        let mut server = Self {
            parameters: robot.parameters.clone(),
            model: robot.model.clone(),
            store,
            offsets: None,
            settings: Settings::default(),
            changed: false,
            newest: None,
            job: None,
            operator: OperatorRequests::default(),
            recording: RecordingRequests::default(),
        };
        server.adopt(offsets);
        Ok(server)
    }

    /// Clients may ask this recorder for recordings.
    pub fn record_with(&mut self, recorder: RecorderHandle) {
        self.recording
            .record_with(recorder, self.parameters.timing.sample_period);
    }

    /// The settings that hold now.
    #[must_use]
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The settings, if they have changed since the last call.
    pub fn changed_settings(&mut self) -> Option<Settings> {
        std::mem::take(&mut self.changed).then_some(self.settings)
    }

    /// One line about the last tare.
    #[must_use]
    pub fn describe_tare(&self) -> String {
        match (&self.offsets, &self.store) {
            (Some(offsets), _) => format!("F/T offsets of {}", offsets.about(Timestamp::now())),
            (None, Ok(_)) => "no tare: F/T offsets are those of the configuration".to_owned(),
            (None, Err(why)) => format!(
                "no tare: F/T offsets are those of the configuration, and none can be kept ({why})"
            ),
        }
    }

    /// Observes a record; call it with every record, in order.
    pub fn observe(&mut self, record: &SharedRecord, now: Instant) {
        if let Some(job) = &mut self.job
            && let Stage::Taring(taring) = &mut job.stage
            && let Err(why) = taring.observe(record)
        {
            job.stage = Stage::Failed(why);
        }
        self.operator.observe(&self.parameters, &record.cycle);
        match &mut self.newest {
            Some((newest, at)) => (**newest, *at) = (*record, now),
            none => *none = Some((Box::new(*record), now)),
        }
    }

    /// Serves a request, whatever its contents, or begins to.
    pub fn serve(&mut self, asked: &Request, now: Instant) -> Answer {
        let served = match (asked.kind, operator_request(asked)) {
            (_, Some(request)) => self.begin_operator_request(asked, request, now),
            (request::TARE, _) => self.begin_tare(asked, now),
            (request::SHOW_TARE, _) => Ok(Some(self.describe_tare())),
            (request::FORGET_TARE, _) => self.begin_to_forget(asked, now),
            (request::TARE_JOINT, _) => self.tare_joint(asked, now),
            (request::CHOOSE_CONTACT_SET, _) => self.choose_contacts(asked.contact_set.as_str()),
            (request::AUTOMATIC_CONTACT_SET, _) => self.automatic_contacts(),
            (request::RECORD, _) => self.begin_recording(asked, now),
            (request::RECORDING, _) => return self.show_recording(asked),
            (request::END_RECORDING, _) => self.recording.end(asked, now).map(|()| None),
            (other, _) => Err(Problem::new(
                format!("requests of kind {other} are not known"),
                "",
            )),
        };
        match served {
            Ok(Some(text)) => self.answer(asked, answer_status::DONE, &text),
            Ok(None) => self.answer(asked, answer_status::WORKING, ""),
            Err(problem) => self.refusal(asked, &problem),
        }
    }

    /// The operator's request that the loop is to carry out next: to be handed to it at once.
    pub fn next_operator_request(&mut self, now: Instant) -> Option<OperatorRequest> {
        let (newest, _) = self.newest.as_ref()?;
        self.operator.hand_over(&newest.cycle, now)
    }

    /// Continues the work of requests; an answer if one is due. Call it at every poll, until none
    /// is due.
    pub fn advance(&mut self, now: Instant) -> Option<Answer> {
        self.advance_operator(now)
            .or_else(|| self.advance_tare(now))
            .or_else(|| self.advance_recording(now))
    }

    fn begin_recording(
        &mut self,
        asked: &Request,
        now: Instant,
    ) -> Result<Option<String>, Problem> {
        self.newest_record(now)?;
        self.recording.begin(asked, now).map(|()| None)
    }

    fn show_recording(&self, asked: &Request) -> Answer {
        match self.recording.show() {
            Ok((text, ended)) => Answer {
                progress: f64::from(u8::from(ended)),
                ..self.answer(asked, answer_status::DONE, &text)
            },
            Err(problem) => self.refusal(asked, &problem),
        }
    }

    fn advance_recording(&mut self, now: Instant) -> Option<Answer> {
        let (asked, result) = self.recording.advance(now)?;
        Some(match result {
            Ok(Some(text)) => self.answer(&asked, answer_status::DONE, &text),
            Ok(None) => self.answer(&asked, answer_status::WORKING, ""),
            Err(problem) => self.refusal(&asked, &problem),
        })
    }

    fn advance_operator(&mut self, now: Instant) -> Option<Answer> {
        let (newest, _) = self.newest.as_ref()?;
        let (parameters, record) = (&self.parameters, &newest.cycle);
        let (asked, outcome) = self.operator.advance(parameters, record, now)?;
        let (status, text) = match outcome {
            Outcome::Waiting(text) => (answer_status::WORKING, text),
            Outcome::Done(text) => (answer_status::DONE, text),
            Outcome::Refused(text) => (answer_status::REFUSED, text),
        };
        Some(self.answer(&asked, status, &text))
    }

    fn advance_tare(&mut self, now: Instant) -> Option<Answer> {
        let mut job = self.job.take()?;
        let asked = job.request;
        job.stage = match job.stage {
            Stage::Failed(problem) => return Some(self.refusal(&asked, &problem)),
            Stage::Taring(taring) if taring.complete() => self.store_tare(*taring),
            Stage::Taring(taring) => match taring.too_slow(now) {
                Some(why) => Stage::Failed(why),
                None => Stage::Taring(taring),
            },
            Stage::Storing(thread) if thread.is_finished() => {
                return Some(self.end(&asked, thread));
            }
            Stage::Storing(thread) => Stage::Storing(thread),
        };
        let due = now.duration_since(job.answered) >= PROGRESS;
        let progress = match &job.stage {
            Stage::Taring(taring) => taring.progress(),
            Stage::Storing(_) | Stage::Failed(_) => 1.0,
        };
        if due {
            job.answered = now;
        }
        self.job = Some(job);
        due.then(|| Answer {
            progress,
            ..self.answer(&asked, answer_status::WORKING, "")
        })
    }

    fn begin_operator_request(
        &mut self,
        asked: &Request,
        request: OperatorRequest,
        now: Instant,
    ) -> Result<Option<String>, Problem> {
        self.newest_record(now)?;
        self.operator.begin(asked, request, now);
        Ok(None)
    }

    fn begin_tare(&mut self, asked: &Request, now: Instant) -> Result<Option<String>, Problem> {
        if self.parameters.ft_sensors.is_empty() {
            return Err(Problem::new("the robot has no F/T sensor to tare", ""));
        }
        let set = self.contact_set(asked.contact_set.as_str())?;
        if let Err(why) = &self.store {
            return Err(why.clone().of("offsets could not be kept"));
        }
        self.free()?;
        let record = self.newest_record(now)?;
        fitness::judge(&self.parameters, record)?;
        let taring = TareJob::new(&self.parameters, &self.model, set, &self.settings, now)?;
        self.begin(asked, Stage::Taring(Box::new(taring)), now);
        Ok(None)
    }

    fn tare_joint(&mut self, asked: &Request, now: Instant) -> Result<Option<String>, Problem> {
        let cycle = &self.newest_record(now)?.cycle;
        let place = asked.joint as usize;
        fitness::judge_joint(&self.parameters, cycle, asked)?;
        let (joint, before) = (
            &self.parameters.joints[place],
            &cycle.estimated.joints[place],
        );
        let text = format!(
            "{}: {:.3} {unit} is taken to be {:.3} {unit}, within {:.3}",
            joint.name,
            before.tau_encoder.tau,
            asked.torque,
            asked.sigma,
            unit = joint.kind.units("N·m"),
        );
        self.change(|settings| {
            if let Some(tare) = settings.joint_tares.get_mut(place) {
                *tare = JointTare {
                    torque: asked.torque,
                    sigma: asked.sigma,
                    count: tare.count + 1,
                };
            }
        });
        Ok(Some(text))
    }

    fn begin_to_forget(
        &mut self,
        asked: &Request,
        now: Instant,
    ) -> Result<Option<String>, Problem> {
        let store = self.store.clone()?;
        self.free()?;
        let record = self.newest_record(now)?;
        if record.cycle.mode != Mode::Hold.number() {
            return Err(fitness::not_holding(record.cycle.mode));
        }
        let stage = in_a_thread(move || store.forget().map(|()| None));
        self.begin(asked, stage, now);
        Ok(None)
    }

    fn begin(&mut self, asked: &Request, stage: Stage, now: Instant) {
        self.job = Some(Job {
            request: *asked,
            stage,
            answered: now,
        });
    }

    fn choose_contacts(&mut self, name: &str) -> Result<Option<String>, Problem> {
        let set = self.contact_set(name)?;
        self.change(|settings| settings.contact_set = 1 + set as u32);
        Ok(Some(format!("contacts {name}")))
    }

    fn automatic_contacts(&mut self) -> Result<Option<String>, Problem> {
        if self.parameters.whole_body.load_rule.is_none() {
            return Err(Problem::new(
                "the configuration has no automatic rule",
                "one of the contact sets, or a rule in [whole_body.load]",
            ));
        }
        self.change(|settings| settings.contact_set = 0);
        Ok(Some("contacts are chosen by the automatic rule".to_owned()))
    }

    /// The index of a contact set.
    fn contact_set(&self, name: &str) -> Result<usize, Problem> {
        let names = contact_names(&self.parameters);
        let place = names.iter().position(|own| *own == name);
        place.ok_or_else(|| {
            let allowed = names.join(", ");
            Problem::new(format!("there is no contact set {name:?}"), allowed)
        })
    }

    fn free(&self) -> Result<(), Problem> {
        match self.job {
            Some(_) => Err(Problem::new(
                "another request is being served; try again when it is done",
                "",
            )),
            None => Ok(()),
        }
    }

    /// The newest record, if the loop runs.
    fn newest_record(&self, now: Instant) -> Result<&SharedRecord, Problem> {
        let newest = self.newest.as_ref();
        let fresh = newest.filter(|(_, at)| now.duration_since(*at) < Duration::from_secs(1));
        let record = fresh.map(|(record, _)| &**record);
        record.ok_or_else(|| Problem::new("no cycle has run for a second", ""))
    }

    fn store_tare(&self, taring: TareJob) -> Stage {
        let last: Vec<[f64; 6]> = self
            .settings
            .ft_offset
            .iter()
            .map(Wrench::to_array)
            .collect();
        let store = self.store.clone();
        in_a_thread(move || {
            let offsets = taring.finish(&last, Timestamp::now())?;
            store?.save(&offsets)?;
            Ok(Some(offsets))
        })
    }

    /// Takes over the result of the thread.
    fn end(
        &mut self,
        asked: &Request,
        thread: JoinHandle<Result<Option<Offsets>, Problem>>,
    ) -> Answer {
        let given = thread.join();
        let given =
            given.unwrap_or_else(|_| Err(Problem::new("the offsets could not be computed", "")));
        match given {
            Err(problem) => self.refusal(asked, &problem),
            Ok(offsets) => {
                let before = self.settings.ft_offset;
                self.adopt(offsets);
                let mut answer = self.answer(asked, answer_status::DONE, &self.describe_tare());
                answer.progress = 1.0;
                for (sensor, before) in answer.ft.iter_mut().zip(before) {
                    sensor.before = before;
                }
                answer
            }
        }
    }

    fn adopt(&mut self, offsets: Option<Offsets>) {
        let mut taken = [Wrench::default(); MAX_FT_SENSORS];
        for (wrench, sensor) in taken
            .iter_mut()
            .zip(offsets.iter().flat_map(|o| &o.sensors))
        {
            *wrench = Wrench::from_array(sensor.offset);
        }
        self.offsets = offsets;
        self.change(|settings| settings.ft_offset = taken);
    }

    fn change(&mut self, change: impl FnOnce(&mut Settings)) {
        change(&mut self.settings);
        self.settings.sequence += 1;
        self.changed = true;
    }

    fn refusal(&self, asked: &Request, problem: &Problem) -> Answer {
        self.answer(asked, answer_status::REFUSED, &problem.to_string())
    }

    fn answer(&self, asked: &Request, status: u32, text: &str) -> Answer {
        let mut answer = Answer {
            id: asked.id,
            status,
            ft_count: self.parameters.ft_sensors.len() as u32,
            text: Text::new(text),
            ..Answer::default()
        };
        if let Some(offsets) = &self.offsets {
            answer.date_unix_s = offsets.date.as_second() as f64;
            answer.contact_set = Name::new(&offsets.contacts);
            for (tared_sensor, sensor) in answer.ft.iter_mut().zip(&offsets.sensors) {
                *tared_sensor = tared(sensor);
            }
        }
        answer
    }
}

fn in_a_thread(work: impl FnOnce() -> Result<Option<Offsets>, Problem> + Send + 'static) -> Stage {
    let thread = std::thread::Builder::new().name("offsets".to_owned());
    match thread.spawn(work) {
        Ok(thread) => Stage::Storing(thread),
        Err(e) => Stage::Failed(Problem::new(
            format!("a thread cannot be started ({e})"),
            "",
        )),
    }
}

fn ft_names(parameters: &Parameters) -> Vec<&str> {
    let sensors = parameters.ft_sensors.iter();
    sensors.map(|ft| ft.sensor.name.as_str()).collect()
}

fn tared(sensor: &SensorOffset) -> TaredSensor {
    let bits = sensor.known.iter().enumerate();
    TaredSensor {
        offset: Wrench::from_array(sensor.offset),
        before: Wrench::from_array(sensor.offset),
        sigma: Wrench::from_array(sensor.sigma),
        known: bits.fold(0, |bits, (k, known)| bits | u32::from(*known) << k),
        ..TaredSensor::default()
    }
}
