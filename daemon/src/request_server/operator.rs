//! Operators' requests: handed to the loop, answered by what its records show.
//!
//! The loop is the judge of every request; this file puts its refusals into words and waits, with
//! a limit, until the state that was asked for is reached. A later request takes the place of one
//! that still waits, so that stopping and disabling never wait for enabling.

use std::time::{Duration, Instant};

use cycle::OperatorRequest;
use robot_config::Parameters;
use robot_state::{
    CycleRecord, DriveState, Event, JointCommanded, JointMeasured, Request, RobotState,
    command_flags, refusal, request,
};

use super::PROGRESS;

/// Longest time in which the loop takes a request.
const TAKE: Duration = Duration::from_millis(500);
/// Time that a wait may last beyond the loop's own limit.
const MARGIN: Duration = Duration::from_secs(1);

/// The end of a request, or what is waited for, in words.
pub(super) enum Outcome {
    Waiting(String),
    Done(String),
    Refused(String),
}

/// The operators' requests that are being served.
#[derive(Default)]
pub(super) struct OperatorRequests {
    job: Option<Job>,
    /// Requests whose place another has taken.
    superseded: Vec<Request>,
    in_flight: Option<InFlight>,
}

struct Job {
    asked: Request,
    request: OperatorRequest,
    stage: Stage,
    since: Instant,
    answered: Instant,
}

enum Stage {
    /// To be handed to the loop.
    Queued,
    /// The loop is to take it.
    HandedOver,
    /// The loop has accepted it: its state is awaited.
    Accepted,
    /// The loop has refused it, for this reason.
    Refused(String),
}

/// A request that the loop has not taken yet; one at a time, so that refusals have one meaning.
struct InFlight {
    /// Count of requests in the records before it.
    before: u32,
    since: Instant,
}

/// The operator's request of that kind.
pub(super) fn operator_request(asked: &Request) -> Option<OperatorRequest> {
    match asked.kind {
        request::ENABLE => Some(OperatorRequest::Enable),
        request::DISABLE => Some(OperatorRequest::Disable),
        request::STOP => Some(OperatorRequest::Stop),
        request::ACKNOWLEDGE => Some(OperatorRequest::Acknowledge(asked.fault)),
        _ => None,
    }
}

impl OperatorRequests {
    /// Begins a request, in the place of an earlier one.
    pub(super) fn begin(&mut self, asked: &Request, request: OperatorRequest, now: Instant) {
        let job = Job {
            asked: *asked,
            request,
            stage: Stage::Queued,
            since: now,
            answered: now,
        };
        let earlier = self.job.replace(job);
        self.superseded.extend(earlier.map(|job| job.asked));
    }

    /// The request that the loop is to carry out next. `newest` is its newest record.
    pub(super) fn hand_over(
        &mut self,
        newest: &CycleRecord,
        now: Instant,
    ) -> Option<OperatorRequest> {
        if self.in_flight.is_some() {
            return None;
        }
        let job = self.job.as_mut()?;
        if !matches!(job.stage, Stage::Queued) {
            return None;
        }
        job.stage = Stage::HandedOver;
        self.in_flight = Some(InFlight {
            before: newest.requests,
            since: now,
        });
        Some(job.request)
    }

    /// Observes a record.
    pub(super) fn observe(&mut self, parameters: &Parameters, record: &CycleRecord) {
        let taken = |flying: &InFlight| record.requests != flying.before;
        if !self.in_flight.as_ref().is_some_and(taken) {
            return;
        }
        self.in_flight = None;
        if let Some(job) = &mut self.job
            && matches!(job.stage, Stage::HandedOver)
        {
            job.stage = match record.refusal {
                0 => Stage::Accepted,
                code => Stage::Refused(reason(parameters, code, job.request, record)),
            };
        }
    }

    /// An answer that is due.
    pub(super) fn advance(
        &mut self,
        parameters: &Parameters,
        newest: &CycleRecord,
        now: Instant,
    ) -> Option<(Request, Outcome)> {
        if let Some(asked) = self.superseded.pop() {
            let why = "a later request of an operator has taken this one's place".to_owned();
            return Some((asked, Outcome::Refused(why)));
        }
        let outcome = self.outcome(parameters, newest, now)?;
        let job = self.job.as_mut()?;
        let asked = job.asked;
        match outcome {
            Outcome::Waiting(_) if now.duration_since(job.answered) < PROGRESS => return None,
            Outcome::Waiting(_) => job.answered = now,
            Outcome::Done(_) | Outcome::Refused(_) => self.job = None,
        }
        Some((asked, outcome))
    }

    fn outcome(
        &mut self,
        parameters: &Parameters,
        newest: &CycleRecord,
        now: Instant,
    ) -> Option<Outcome> {
        let in_flight = self.in_flight.as_ref();
        let lost = in_flight.is_some_and(|flying| now.duration_since(flying.since) > TAKE);
        if lost {
            self.in_flight = None;
        }
        let job = self.job.as_mut()?;
        let outcome = match &mut job.stage {
            Stage::HandedOver if lost => Outcome::Refused(format!(
                "the loop has not taken the request for {TAKE:?}; look at torqued's log"
            )),
            Stage::Queued | Stage::HandedOver => {
                Outcome::Waiting("the loop is to take the request".to_owned())
            }
            Stage::Accepted => reached(parameters, job.request, newest),
            Stage::Refused(why) => Outcome::Refused(std::mem::take(why)),
        };
        let limit = Duration::from_secs_f64(parameters.safety.time_limit) + MARGIN;
        Some(match outcome {
            Outcome::Waiting(what) if now.duration_since(job.since) > limit => Outcome::Refused(
                format!("not reached within {limit:?}: {what}; look at `torquectl state`"),
            ),
            outcome => outcome,
        })
    }
}

/// Whether the record shows what an accepted request asked for.
fn reached(parameters: &Parameters, request: OperatorRequest, record: &CycleRecord) -> Outcome {
    use Outcome::{Done, Refused, Waiting};
    let state = RobotState::from_number(record.state).unwrap_or_default();
    let fault = || fault_name(record.fault);
    match (request, state) {
        (OperatorRequest::Enable, RobotState::Holding | RobotState::Active) => {
            Done("enabled: every joint is held; a client may command".to_owned())
        }
        (OperatorRequest::Enable, RobotState::Enabling) => Waiting(format!(
            "drives are being switched on: {}",
            drives(parameters, record, |commanded| !engaged(commanded))
        )),
        (OperatorRequest::Enable, RobotState::Fault) => {
            let cause = Event::from_number(record.fault).map_or("", Event::cause);
            Refused(format!(
                "fault {} ended enabling: {cause} Not enabled: {}. Next: mend the cause, then \
                 `torquectl acknowledge`",
                fault(),
                drives(parameters, record, |commanded| !engaged(commanded))
            ))
        }
        (OperatorRequest::Enable, RobotState::Stopping) => Waiting(moving(parameters, record)),
        (OperatorRequest::Enable, RobotState::Boot | RobotState::Ready) => Refused(format!(
            "enabling was broken off: {}",
            unready(parameters, record)
        )),
        (OperatorRequest::Disable, _) => {
            let left = names(parameters, record, |_, commanded| engaged(commanded));
            match (left.is_empty(), state) {
                (false, _) => Waiting(format!("drives are being switched off: {left}")),
                (true, RobotState::Fault) => Done(format!(
                    "disabled: no set-points are sent; fault {} is still latched",
                    fault()
                )),
                (true, _) => Done("disabled: no set-points are sent".to_owned()),
            }
        }
        (OperatorRequest::Stop, RobotState::Boot | RobotState::Ready) => {
            Done("no set-points are sent: there is no motion to stop".to_owned())
        }
        (OperatorRequest::Stop, RobotState::Fault) => {
            if moving_joints(parameters, record).is_empty() {
                Done(format!("at rest; fault {} is latched", fault()))
            } else {
                Waiting(moving(parameters, record))
            }
        }
        (OperatorRequest::Stop, RobotState::Stopping) => Waiting(moving(parameters, record)),
        (OperatorRequest::Stop, _) => Done("at rest: every joint is held".to_owned()),
        (OperatorRequest::Acknowledge(number), _) if record.fault == number && number != 0 => {
            Waiting(format!("fault {} is latched", fault()))
        }
        (OperatorRequest::Acknowledge(number), _) => {
            let then = match state {
                RobotState::Fault => format!("fault {} is latched now", fault()),
                RobotState::Ready => "drives are off. Next: `torquectl enable`".to_owned(),
                RobotState::Boot => unready(parameters, record),
                state => format!("the robot is in state {}", state.name()),
            };
            Done(format!(
                "fault {} is acknowledged; {then}",
                fault_name(number)
            ))
        }
    }
}

/// A refusal of the loop in words.
fn reason(
    parameters: &Parameters,
    code: u32,
    request: OperatorRequest,
    record: &CycleRecord,
) -> String {
    let (kind, subject) = (code >> 16, code & 0xffff);
    let index = subject as usize;
    let joint = parameters.joints.get(index);
    let name = joint.map_or("?", |joint| joint.name.as_str());
    let measured = record
        .measured
        .joints
        .get(index)
        .copied()
        .unwrap_or_default();
    match kind {
        refusal::STATE => match RobotState::from_number(subject) {
            Some(RobotState::Boot) => {
                format!(
                    "the robot is in state boot: {}",
                    unready(parameters, record)
                )
            }
            Some(RobotState::Fault) => format!(
                "fault {} is latched: acknowledge it first (`torquectl acknowledge`)",
                fault_name(record.fault)
            ),
            Some(RobotState::Stopping) => {
                format!(
                    "{}; try again when it is at rest",
                    moving(parameters, record)
                )
            }
            Some(state) => format!("not possible in state {}", state.name()),
            None => format!("not possible in state {subject}"),
        },
        refusal::JOINT => match measured.defect() {
            Some(defect) => format!("joint `{name}` {defect}"),
            None => format!("joint `{name}` has not been plausible for long enough"),
        },
        refusal::OUTSIDE => {
            let limits = joint.map(|joint| joint.limits);
            let kind = joint.map(|joint| joint.kind).unwrap_or_default();
            let unit = kind.units("deg");
            // To a tenth.
            let shown = |q: f64| (10.0 * kind.shown(q)).round() / 10.0;
            let allowed = limits.map_or_else(String::new, |limits| {
                let [min, max] = [limits.position_min, limits.position_max].map(shown);
                format!(", allowed {min} to {max} {unit}")
            });
            format!(
                "joint `{name}` stands outside its position limits: {:.1} {unit}{allowed}; move it \
                 inside by hand",
                kind.shown(measured.q)
            )
        }
        refusal::DRIVE => format!(
            "the drive of joint `{name}` reports a fault of its own, status word {:#x}: mend its \
             cause, then `torquectl acknowledge`",
            measured.status
        ),
        refusal::UNFIT => {
            let joints = &record.estimated.joints;
            let torques = joints.get(subject as usize).copied().unwrap_or_default();
            format!(
                "the gear of joint `{name}` shows {:.1}, F/T sensors and masses {:.1} N·m: an encoder has \
                 lost its zero, `gear_ratio` is another, or the joint bears what no sensor measures; see \
                 `torquectl watch`, set `offset_deg` of its encoders anew",
                torques.tau_encoder.tau, torques.tau_whole_body.tau
            )
        }
        refusal::OTHER_FAULT if subject == 0 => "no fault is latched".to_owned(),
        refusal::OTHER_FAULT => match request {
            OperatorRequest::Acknowledge(number) => format!(
                "fault {} is latched, not {}",
                fault_name(subject),
                fault_name(number)
            ),
            _ => format!("fault {} is latched", fault_name(subject)),
        },
        _ => format!("the loop refuses it, code {code:#x}"),
    }
}

/// Conditions that keep the robot from being ready or from being enabled.
fn unready(parameters: &Parameters, record: &CycleRecord) -> String {
    let joints = parameters.joints.iter().zip(&record.measured.joints);
    let defects = joints.filter_map(|(joint, measured)| {
        let defect = measured.defect()?;
        Some(format!("joint `{}` {defect}", joint.name))
    });
    let defects: Vec<String> = defects.collect();
    if defects.is_empty() {
        "joints are to be plausible for some time; try again".to_owned()
    } else {
        defects.join(", ")
    }
}

fn moving(parameters: &Parameters, record: &CycleRecord) -> String {
    let joints = moving_joints(parameters, record);
    format!("the robot is being brought to rest: {joints}")
}

/// The names of the joints that are not at rest.
fn moving_joints(parameters: &Parameters, record: &CycleRecord) -> String {
    let joints = parameters.joints.iter().zip(&record.measured.joints);
    let moving = joints.filter(|(joint, measured)| measured.dq.abs() >= joint.limits.rest);
    let named: Vec<&str> = moving.map(|(joint, _)| joint.name.as_str()).collect();
    named.join(", ")
}

fn engaged(joint: &JointCommanded) -> bool {
    joint.flags & command_flags::ENGAGED != 0
}

/// The joints whose drives are so, with the drives' states.
fn drives(
    parameters: &Parameters,
    record: &CycleRecord,
    so: impl Fn(&JointCommanded) -> bool,
) -> String {
    let joints = parameters.joints.iter().zip(&record.commanded.joints);
    let drives = joints.filter(|(_, commanded)| so(commanded));
    let drives = drives.map(|(joint, commanded)| {
        let state = DriveState::from_number(commanded.drive_state).unwrap_or_default();
        let bus = parameters.buses.get(joint.bus);
        let bus = bus.map_or("?", |bus| bus.name.as_str());
        format!("{} (bus {bus}, drive {})", joint.name, state.name())
    });
    drives.collect::<Vec<_>>().join(", ")
}

/// The names of the joints that are so.
fn names(
    parameters: &Parameters,
    record: &CycleRecord,
    so: impl Fn(&JointMeasured, &JointCommanded) -> bool,
) -> String {
    let values = record.measured.joints.iter().zip(&record.commanded.joints);
    let joints = parameters.joints.iter().zip(values);
    let named = joints.filter(|(_, (measured, commanded))| so(measured, commanded));
    let named: Vec<&str> = named.map(|(joint, _)| joint.name.as_str()).collect();
    named.join(", ")
}

fn fault_name(number: u32) -> String {
    let name = Event::from_number(number).map_or("unknown", Event::name);
    format!("{number} {name}")
}
