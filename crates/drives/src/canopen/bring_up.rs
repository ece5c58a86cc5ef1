//! From power-on to operational: the set-up of one node, step by step, each checked.
//!
//! ```text
//! reset communication ──► boot-up ──► identity ──► objects ──► process data ──► start ──► operational
//! ```
//!
//! Nothing in it can move a drive: it is never told to switch on, and its set-point is set to where
//! it stands. A lost frame is sent again; anything else that is not as planned ends the set-up with
//! node, object, step and cure.

mod bound;
mod plan;
mod report;

use super::sdo::{Progress, Request, SdoError, Transfer};
use super::{Nmt, NodeState, Object, abort, pdo};
pub use bound::Bound;
use bound::Verdict;
use can_codec::Frame;
use core::fmt;
pub use plan::{Check, Limits, Plan, Step, Write};
pub use report::{Change, Done, Reading, Trouble};

/// Interval at which an awaited command is repeated, ns.
const AGAIN_NS: u64 = 500_000_000;
/// Time for which a second boot-up after a reset stands for a second node with the identifier, ns.
const SECOND_BOOT_NS: u64 = 100_000_000;
/// Interval at which an awaited object is read, ns.
const READ_AGAIN_NS: u64 = 10_000_000;

/// What the set-up waits for.
#[derive(Clone, Debug)]
enum Waiting {
    /// For its turn.
    Next,
    /// For the node's boot-up; then whether a second node answers.
    BootUp {
        until: u64,
        again: u64,
    },
    SecondBootUp {
        until: u64,
    },
    /// For an answer by SDO.
    Answer {
        transfer: Transfer,
        request: Request,
        purpose: Purpose,
        until: u64,
        repeats: u32,
    },
    /// To read an object again.
    Later {
        at: u64,
    },
    /// For the state operational.
    Operational {
        until: u64,
        again: u64,
    },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Purpose {
    Read,
    Write,
    ReadBack,
    CopyRead,
    /// Reading the COB-ID of a PDO that is to be off.
    Used,
    /// Old value of a write that is only shown.
    Old,
    /// Value of an object that cannot be written.
    Fixed,
}

/// State of a set-up.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Under way, in the step of that index.
    Working(usize),
    /// Over: the node is operational.
    Done,
    /// It has ended where it was.
    Failed(Box<Trouble>),
}

/// The set-up of a node under way.
#[derive(Clone, Debug)]
pub struct BringUp {
    plan: Plan,
    limits: Limits,
    dry: bool,
    step: usize,
    waiting: Waiting,
    outcome: Outcome,
    done: Done,
    /// End of the time for an object that takes a while.
    settle: Option<u64>,
    /// What a write or copy sends, for its read-back.
    copied: Vec<u8>,
    /// Two boot-ups have followed one reset before.
    twice: bool,
}

impl BringUp {
    /// The set-up by a plan.
    #[must_use]
    pub fn new(plan: Plan, limits: Limits) -> Self {
        Self {
            plan,
            limits,
            dry: false,
            step: 0,
            waiting: Waiting::Next,
            outcome: Outcome::Working(0),
            done: Done::default(),
            settle: None,
            copied: Vec::new(),
            twice: false,
        }
    }

    /// Only reads: what would be written is compared with what is there.
    #[must_use]
    pub fn dry(plan: Plan, limits: Limits) -> Self {
        Self {
            dry: true,
            ..Self::new(plan, limits)
        }
    }

    /// Where it stands.
    #[must_use]
    pub fn outcome(&self) -> &Outcome {
        &self.outcome
    }

    /// The plan.
    #[must_use]
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// What was read and written so far.
    #[must_use]
    pub fn done(&self) -> &Done {
        &self.done
    }

    /// Goes on as far as time allows; frames to send are appended to `out`.
    pub fn poll(&mut self, now: u64, out: &mut Vec<Frame>) {
        if !matches!(self.outcome, Outcome::Working(_)) {
            return;
        }
        let (bus, node) = (self.plan.bus, self.plan.node);
        match &mut self.waiting {
            Waiting::Next => self.begin(now, out),
            Waiting::BootUp { until, again } => {
                if now >= *until {
                    let cure =
                        "is it powered, is its node id and bit rate right, is the bus terminated?";
                    self.fail("no boot-up after a reset of its communication", cure);
                } else if now >= *again {
                    *again = now + AGAIN_NS;
                    out.push(Nmt::ResetCommunication.frame(bus, node));
                }
            }
            Waiting::SecondBootUp { until } if now >= *until => self.next(),
            Waiting::Later { at } if now >= *at => self.begin(now, out),
            Waiting::Operational { until, again } => {
                if now >= *until {
                    let cure = "its heartbeat (1017) or an emergency of the drive says more";
                    self.fail("it does not become operational", cure);
                } else if now >= *again {
                    *again = now + AGAIN_NS;
                    out.push(Nmt::Start.frame(bus, node));
                }
            }
            Waiting::Answer {
                transfer,
                request,
                until,
                repeats,
                ..
            } if now >= *until => {
                // A node that took the request must not answer it into the next one.
                out.push(transfer.give_up());
                if *repeats == 0 {
                    let cure = "is it still powered? is the bus overloaded or badly terminated?";
                    self.fail(SdoError::TimeOut, cure);
                } else {
                    *repeats -= 1;
                    let (again, first) = Transfer::start(bus, node, request.clone());
                    *transfer = again;
                    *until = now + self.limits.answer_ns;
                    out.push(first);
                }
            }
            Waiting::SecondBootUp { .. } | Waiting::Later { .. } | Waiting::Answer { .. } => {}
        }
        // A step that needs no frame ends at once.
        if matches!(self.waiting, Waiting::Next) && matches!(self.outcome, Outcome::Working(_)) {
            self.begin(now, out);
        }
    }

    /// Takes a frame of the bus.
    pub fn receive(&mut self, frame: &Frame, now: u64, out: &mut Vec<Frame>) {
        if frame.bus != self.plan.bus || !matches!(self.outcome, Outcome::Working(_)) {
            return;
        }
        if let Some((_, state)) = NodeState::of(frame).filter(|(node, _)| *node == self.plan.node) {
            self.heard(state, now);
            return;
        }
        let Waiting::Answer {
            transfer, purpose, ..
        } = &mut self.waiting
        else {
            return;
        };
        let purpose = *purpose;
        match transfer.receive(frame) {
            Progress::NotMine => {}
            Progress::Send(frame) => {
                self.extend(now);
                out.push(frame);
            }
            Progress::Done(result, told) => {
                out.extend(told);
                self.answered(purpose, result, now, out);
            }
        }
    }

    fn heard(&mut self, state: NodeState, now: u64) {
        match (&self.waiting, state) {
            (Waiting::BootUp { .. }, NodeState::BootUp) => {
                let until = now + SECOND_BOOT_NS;
                self.waiting = Waiting::SecondBootUp { until };
            }
            // The first may have been that of its power-on: it is reset once more.
            (Waiting::SecondBootUp { .. }, NodeState::BootUp) if !self.twice => {
                self.twice = true;
                self.waiting = Waiting::Next;
            }
            (Waiting::SecondBootUp { .. }, NodeState::BootUp) => self.fail(
                "two boot-ups after one reset, twice: two nodes have this id",
                "disconnect one of them, and give it another id with the maker's tool",
            ),
            (Waiting::Operational { .. }, NodeState::Operational) => self.next(),
            (_, NodeState::BootUp) if self.step > 0 && !self.dry => self.fail(
                "the node has started anew while it was set up",
                "look at its supply; then start again: nothing has moved",
            ),
            _ => {}
        }
    }

    fn extend(&mut self, now: u64) {
        if let Waiting::Answer { until, .. } = &mut self.waiting {
            *until = now + self.limits.answer_ns;
        }
    }

    /// Begins the step, or the end.
    fn begin(&mut self, now: u64, out: &mut Vec<Frame>) {
        let (bus, node) = (self.plan.bus, self.plan.node);
        let Some(step) = self.plan.steps.get(self.step).cloned() else {
            self.outcome = Outcome::Done;
            return;
        };
        self.outcome = Outcome::Working(self.step);
        match step {
            Step::ResetCommunication | Step::Start if self.dry => self.next(),
            Step::ResetCommunication => {
                let until = now + self.limits.boot_ns;
                self.waiting = Waiting::BootUp {
                    until,
                    again: now + AGAIN_NS,
                };
                out.push(Nmt::ResetCommunication.frame(bus, node));
            }
            Step::Start => {
                let until = now + self.limits.settle_ns;
                self.waiting = Waiting::Operational {
                    until,
                    again: now + AGAIN_NS,
                };
                out.push(Nmt::Start.frame(bus, node));
            }
            Step::Read(check) => self.ask(Request::Read(check.object), Purpose::Read, now, out),
            Step::Compare(bound) => self.ask(Request::Read(bound.object), Purpose::Read, now, out),
            Step::Write(write) if self.dry => {
                self.ask(Request::Read(write.object), Purpose::Old, now, out);
            }
            Step::Write(write) => {
                let request = Request::Write(write.object, write.value.clone());
                self.copied = write.value;
                self.ask(request, Purpose::Write, now, out);
            }
            Step::SwitchOff(index) => {
                self.ask(
                    Request::Read(Object::new(index, 1)),
                    Purpose::Used,
                    now,
                    out,
                );
            }
            Step::Copy(from, _) => self.ask(Request::Read(from), Purpose::CopyRead, now, out),
        }
    }

    fn ask(&mut self, request: Request, purpose: Purpose, now: u64, out: &mut Vec<Frame>) {
        let (transfer, first) = Transfer::start(self.plan.bus, self.plan.node, request.clone());
        self.waiting = Waiting::Answer {
            transfer,
            request,
            purpose,
            until: now + self.limits.answer_ns,
            repeats: self.limits.repeats,
        };
        out.push(first);
    }

    fn next(&mut self) {
        self.step += 1;
        self.settle = None;
        self.waiting = Waiting::Next;
        self.outcome = Outcome::Working(self.step);
    }

    /// An answer by SDO is there.
    fn answered(
        &mut self,
        purpose: Purpose,
        result: Result<Vec<u8>, SdoError>,
        now: u64,
        out: &mut Vec<Frame>,
    ) {
        let Some(step) = self.plan.steps.get(self.step).cloned() else {
            return;
        };
        let value = match (result, &step) {
            (Ok(value), _) => value,
            (Err(SdoError::Abort(abort::READ_ONLY)), Step::Write(write))
                if write.may_be_fixed && purpose == Purpose::Write =>
            {
                return self.ask(Request::Read(write.object), Purpose::Fixed, now, out);
            }
            (Err(error), _) => return self.refused(&step, purpose, error),
        };
        match (step, purpose) {
            (Step::Read(check), _) => self.check(&check, &value, now),
            (Step::Compare(bound), _) => self.compare(&bound, &value),
            (Step::Write(write), Purpose::Old) => {
                self.done.note_change(&write, Some(number(&value)));
                self.next();
            }
            (Step::Write(write), Purpose::Write) => {
                self.ask(Request::Read(write.object), Purpose::ReadBack, now, out);
            }
            (Step::Write(_), Purpose::Fixed) if number(&value) == 0 => {
                let cure = "the daemon would not notice that it starts anew: use other firmware";
                self.fail("it is zero, and can only be read", cure);
            }
            (Step::Write(write), Purpose::Fixed) => {
                self.done.note_fixed(&write, number(&value));
                self.next();
            }
            (Step::Write(write), _) => {
                self.done.note_change(&write, None);
                self.read_back(write.object, write.mask, &value);
            }
            (Step::SwitchOff(index), Purpose::Used) => {
                let id = number(&value);
                if self.dry || !pdo::is_used(id) {
                    return self.next();
                }
                self.copied = pdo::switched_off(id).to_le_bytes().to_vec();
                let request = Request::Write(Object::new(index, 1), self.copied.clone());
                self.ask(request, Purpose::Write, now, out);
            }
            (Step::Copy(_, to), Purpose::CopyRead) if !self.dry => {
                self.copied.clone_from(&value);
                self.ask(Request::Write(to, value), Purpose::Write, now, out);
            }
            (Step::Copy(_, to), Purpose::Write) => {
                self.ask(Request::Read(to), Purpose::ReadBack, now, out);
            }
            (Step::Copy(_, to), Purpose::ReadBack) => self.read_back(to, u32::MAX, &value),
            _ => self.next(),
        }
    }

    fn check(&mut self, check: &Check, value: &[u8], now: u64) {
        let read = number(value);
        // What follows from a write does not follow where nothing is written.
        if read & check.mask == check.value & check.mask || (self.dry && check.awaited) {
            self.done.note_reading(check, read);
            return self.next();
        }
        let until = *self.settle.get_or_insert(now + self.limits.settle_ns);
        if check.awaited && now < until {
            self.waiting = Waiting::Later {
                at: now + READ_AGAIN_NS,
            };
            return;
        }
        let what = format!(
            "{} is {read:#x} instead of {:#x}",
            check.meaning, check.value
        );
        self.fail(what, check.cure.clone());
    }

    fn compare(&mut self, bound: &Bound, value: &[u8]) {
        match bound.judge(value) {
            // A set-up that only reads has not written the objects that may raise the limit.
            Verdict::Less(what) if !self.dry => {
                let cure = format!(
                    "a command would be cut short, or end in a fault of the drive: lower {}, or raise the \
                     object with the maker's tool or `sdo`",
                    bound.key
                );
                return self.fail(what, cure);
            }
            Verdict::Less(what) | Verdict::More(what) => self.done.note_remark(bound, what),
            Verdict::Fits => {}
        }
        self.next();
    }

    fn read_back(&mut self, object: Object, mask: u32, value: &[u8]) {
        let (written, read) = (number(&self.copied), number(value));
        let long = self.copied.len() > 4 && self.copied != value;
        if (written ^ read) & mask != 0 || long {
            let what = format!("{object} reads back {read:#x} instead of {written:#x}");
            let cure =
                "the drive takes another value than it was sent: see the object in its manual";
            return self.fail(what, cure);
        }
        self.next();
    }

    fn refused(&mut self, step: &Step, purpose: Purpose, error: SdoError) {
        let missing = matches!(error, SdoError::Abort(code) if abort::is_missing(code));
        let optional = match step {
            Step::Read(check) => check.optional,
            Step::Write(write) => write.optional || self.dry,
            Step::Compare(_) => true,
            Step::SwitchOff(_) => purpose == Purpose::Used,
            _ => false,
        };
        // What can only be written cannot be read back.
        let unreadable = purpose == Purpose::ReadBack
            && matches!(error, SdoError::Abort(0x0601_0000 | 0x0601_0001));
        if let Step::Write(write) = step
            && (missing && optional)
        {
            self.done.note_missing(write);
        }
        if (missing && optional) || unreadable {
            return self.next();
        }
        self.fail(
            error,
            "see the object in the drive's manual, and its firmware's release notes",
        );
    }

    fn fail(&mut self, what: impl fmt::Display, cure: impl Into<String>) {
        let object = match &self.waiting {
            Waiting::Answer { transfer, .. } => Some(transfer.object()),
            _ => None,
        };
        let meaning = self.plan.steps.get(self.step).map_or("end", Step::meaning);
        self.outcome = Outcome::Failed(Box::new(Trouble {
            bus: self.plan.bus,
            node: self.plan.node,
            name: self.plan.name.clone(),
            step: meaning,
            object,
            what: what.to_string(),
            cure: cure.into(),
        }));
    }
}

/// The first four bytes as a number.
fn number(value: &[u8]) -> u32 {
    let bytes = value.iter().take(4).enumerate();
    bytes.fold(0, |number, (i, byte)| number | u32::from(*byte) << (8 * i))
}
