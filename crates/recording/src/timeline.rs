//! Time line of a run: conditions that hold for a while, and changes.

mod cause;
mod concerned;

use std::collections::HashMap;

pub use cause::cause_of;
use robot_state::{
    CycleRecord, DriveState, Event, Mode, RobotState, command_flags, measured_flags,
};

use crate::message::CycleMessage;

/// A condition that comes back within this time has lasted, ns.
const JOIN_NS: u64 = 50_000_000;
/// Most happenings that are kept; a run of hours with a chattering limit has more.
const MAX_SPANS: usize = 100_000;

/// Events in the order of the pipeline: inputs stand before their consequences.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Happening {
    /// So many cycles are missing in the recording.
    Gap(u64),
    /// The loop left out so many cycles.
    Skipped(u64),
    /// Bus controllers reported errors; the subject is the bus.
    ErrorFrames,
    /// A bit of `measured_flags` of a joint, the subject.
    JointFlag(u32),
    /// A bit of `measured_flags` of an F/T sensor, the subject.
    SensorFlag(u32),
    /// A bit of `measured_flags` of an IMU, the subject.
    ImuFlag(u32),
    /// The status word of a joint's drive changed from, to; the subject is the joint.
    StatusWord(u32, u32),
    /// An operator's request: its kind and the fault that it acknowledges.
    Request(u32, u32),
    /// A client's references begin, or go over to another mode: its number.
    Reference(u32),
    /// References end.
    NoReference,
    /// A tare or a choice of contacts took effect.
    Settings,
    /// An event was counted: its number; the subjects are the joints that the records show.
    Event(u32),
    /// A fault was latched: its number; the subject is the joint concerned, if it is one.
    Fault(u32),
    /// The latched fault was acknowledged: its number.
    Acknowledged(u32),
    /// The last request was refused: `CycleRecord::refusal`.
    Refused(u32),
    /// The robot's state changed from, to.
    State(u32, u32),
    /// The mode changed from, to.
    Mode(u32, u32),
    /// The state of a joint's drive changed from, to; the subject is the joint.
    DriveState(u32, u32),
    /// Set-points of a joint, the subject, begin (true) or end.
    Engaged(bool),
    /// A bit of `command_flags` of a joint, the subject: a limit acted.
    Limited(u32),
}

/// Something that happened, from its begin to its end.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Span {
    /// What.
    pub what: Happening,
    /// Indices of the joints, sensors or buses that it happened to; empty: to the robot.
    pub subjects: Vec<usize>,
    /// Cycle of its begin.
    pub cycle: u64,
    /// Its begin and its end, ns on the clock of the cycles' stamps.
    pub begin_ns: u64,
    /// See `begin_ns`.
    pub end_ns: u64,
    /// How often, within.
    pub times: u64,
}

/// Follows a run.
#[derive(Debug, Default)]
pub struct Timeline {
    spans: Vec<Span>,
    open: HashMap<(Happening, usize), usize>,
    last: Option<Box<Before>>,
    overflow: u64,
}

/// Values that the next cycle is compared with.
#[derive(Debug)]
struct Before {
    record: CycleRecord,
    reference: Option<u32>,
    settings: Option<u64>,
}

/// Kind of subject in `CycleRecord::fault_subject`.
const SUBJECT_IS_JOINT: u32 = 1;
/// The subject of what happens to the robot as a whole.
const ROBOT: usize = usize::MAX;

impl Timeline {
    /// Takes the next cycle.
    pub fn observe(&mut self, message: &CycleMessage) {
        let record = &message.record.cycle;
        let last = self.last.take();
        self.observe_inputs(message, last.as_deref());
        self.observe_conditions(record);
        if let Some(last) = &last {
            self.observe_changes(record, &last.record);
        }
        let before = Before {
            record: *record,
            reference: message.reference().map(|reference| reference.mode),
            settings: message.settings().map(|settings| settings.sequence),
        };
        self.last = Some(match last {
            Some(mut last) => {
                *last = before;
                last
            }
            None => Box::new(before),
        });
    }

    /// Events in the order of time; the same at the same time to several joints is one.
    #[must_use]
    pub fn finish(mut self) -> Vec<Span> {
        self.spans.sort_by_key(|span| {
            let subject = span.subjects.first().copied();
            (span.begin_ns, span.what, span.end_ns, subject)
        });
        let mut grouped: Vec<Span> = Vec::new();
        for span in self.spans {
            let key = |span: &Span| (span.begin_ns, span.what, span.end_ns);
            match grouped.last_mut() {
                Some(group) if !span.subjects.is_empty() && key(group) == key(&span) => {
                    group.subjects.extend(span.subjects);
                }
                _ => grouped.push(span),
            }
        }
        grouped
    }

    /// Happenings that were too many to be kept.
    #[must_use]
    pub fn overflow(&self) -> u64 {
        self.overflow
    }

    fn observe_inputs(&mut self, message: &CycleMessage, last: Option<&Before>) {
        let record = &message.record.cycle;
        if let Some(last) = last {
            let missing = record.sequence.wrapping_sub(last.record.sequence + 1);
            if missing > 0 && record.sequence > last.record.sequence {
                self.change(Happening::Gap(missing), ROBOT, record);
            }
        }
        for frame in message.rx.iter().filter(|frame| frame.error) {
            self.hold(Happening::ErrorFrames, usize::from(frame.bus), record, 1);
        }
        for (event, times) in &message.notes {
            if *event == Event::SkippedCycle {
                self.change(Happening::Skipped(*times), ROBOT, record);
            }
        }
        if let Some(request) = message.request {
            let (kind, fault) = crate::message::request_numbers(request);
            self.change(Happening::Request(kind, fault), ROBOT, record);
        }
        let reference = message.reference().map(|reference| reference.mode);
        let before = last.and_then(|last| last.reference);
        match reference {
            _ if reference == before => {}
            Some(mode) => self.change(Happening::Reference(mode), ROBOT, record),
            None => self.change(Happening::NoReference, ROBOT, record),
        }
        let settings = message.settings().map(|settings| settings.sequence);
        if last.is_some_and(|last| last.settings != settings) {
            self.change(Happening::Settings, ROBOT, record);
        }
    }

    fn observe_conditions(&mut self, record: &CycleRecord) {
        let joints = record.measured.joints.iter().zip(&record.commanded.joints);
        for (j, (measured, commanded)) in joints.take(record.joint_count as usize).enumerate() {
            for bit in bits(measured.flags & !measured_flags::SETTLING) {
                self.hold(Happening::JointFlag(bit), j, record, 1);
            }
            let no_limits = command_flags::ENGAGED | command_flags::RATE_TRIMMED;
            for bit in bits(commanded.flags & !no_limits) {
                self.hold(Happening::Limited(bit), j, record, 1);
            }
        }
        let sensors = record.measured.ft.iter().take(record.ft_count as usize);
        for (s, sensor) in sensors.enumerate() {
            for bit in bits(sensor.flags & !measured_flags::SETTLING) {
                self.hold(Happening::SensorFlag(bit), s, record, 1);
            }
        }
        let further = &record.measured.further_imus;
        for (i, imu) in std::iter::once(&record.measured.imu)
            .chain(further)
            .enumerate()
        {
            for bit in bits(imu.flags & !measured_flags::SETTLING) {
                self.hold(Happening::ImuFlag(bit), i, record, 1);
            }
        }
    }

    fn observe_changes(&mut self, record: &CycleRecord, last: &CycleRecord) {
        let counts = record.events.iter().zip(&last.events);
        for (event, (now, before)) in Event::ALL.iter().zip(counts) {
            let times = now.saturating_sub(*before);
            if times > 0 {
                let what = Happening::Event(event.number());
                self.hold(what, ROBOT, record, times);
                self.name(what, concerned::joints(*event, record, last));
            }
        }
        if record.fault != last.fault {
            match record.fault {
                0 => self.change(Happening::Acknowledged(last.fault), ROBOT, record),
                fault => {
                    let joint = record.fault_subject >> 16 == SUBJECT_IS_JOINT;
                    let index = (record.fault_subject & 0xffff) as usize;
                    let subject = if joint { index } else { ROBOT };
                    self.change(Happening::Fault(fault), subject, record);
                }
            }
        }
        if record.refusal != 0 && (record.refusal, record.requests) != (last.refusal, last.requests)
        {
            self.change(Happening::Refused(record.refusal), ROBOT, record);
        }
        if record.state != last.state {
            self.change(Happening::State(last.state, record.state), ROBOT, record);
        }
        if record.mode != last.mode {
            self.change(Happening::Mode(last.mode, record.mode), ROBOT, record);
        }
        let joints = record.measured.joints.iter().zip(&last.measured.joints);
        for (j, (now, before)) in joints.take(record.joint_count as usize).enumerate() {
            if now.status != before.status {
                self.change(Happening::StatusWord(before.status, now.status), j, record);
            }
        }
        let joints = record.commanded.joints.iter().zip(&last.commanded.joints);
        for (j, (now, before)) in joints.take(record.joint_count as usize).enumerate() {
            if now.drive_state != before.drive_state {
                let what = Happening::DriveState(before.drive_state, now.drive_state);
                self.change(what, j, record);
            }
            if (now.flags ^ before.flags) & command_flags::ENGAGED != 0 {
                let engaged = now.flags & command_flags::ENGAGED != 0;
                self.change(Happening::Engaged(engaged), j, record);
            }
        }
    }

    /// A condition holds in this cycle.
    fn hold(&mut self, what: Happening, subject: usize, record: &CycleRecord, times: u64) {
        let now = record.stamp_ns;
        let open = self.open.get(&(what, subject));
        let open = open.and_then(|&index| self.spans.get_mut(index));
        match open {
            Some(span) if now.saturating_sub(span.end_ns) <= JOIN_NS => {
                span.end_ns = now;
                span.times += times;
            }
            _ => {
                self.open.insert((what, subject), self.spans.len());
                self.push(what, subject, record, times);
            }
        }
    }

    /// Joints that what holds in this cycle is about as well.
    fn name(&mut self, what: Happening, joints: impl Iterator<Item = usize>) {
        let open = self.open.get(&(what, ROBOT));
        let Some(span) = open.and_then(|&index| self.spans.get_mut(index)) else {
            return;
        };
        for joint in joints {
            if !span.subjects.contains(&joint) {
                span.subjects.push(joint);
                span.subjects.sort_unstable();
            }
        }
    }

    /// Something changes in this cycle.
    fn change(&mut self, what: Happening, subject: usize, record: &CycleRecord) {
        self.push(what, subject, record, 1);
    }

    fn push(&mut self, what: Happening, subject: usize, record: &CycleRecord, times: u64) {
        if self.spans.len() >= MAX_SPANS {
            self.overflow += 1;
            return;
        }
        self.spans.push(Span {
            what,
            subjects: (subject != ROBOT).then_some(subject).into_iter().collect(),
            cycle: record.sequence,
            begin_ns: record.stamp_ns,
            end_ns: record.stamp_ns,
            times,
        });
    }
}

fn bits(flags: u32) -> impl Iterator<Item = u32> {
    (0..32).map(|k| 1 << k).filter(move |bit| flags & bit != 0)
}

impl Span {
    /// The happening in words, with names of joints, sensors and buses.
    #[must_use]
    pub fn words(&self, header: &crate::Header) -> String {
        let names = match self.what {
            Happening::SensorFlag(_) => self.names("F/T sensor", &header.sensors),
            Happening::ErrorFrames => self.names("bus", &header.buses),
            _ => self.names("joint", &header.joints),
        };
        let what = self.what.words();
        if names.is_empty() {
            what
        } else {
            format!("{names}: {what}")
        }
    }

    fn names(&self, kind: &str, names: &[String]) -> String {
        let named = self.subjects.iter().filter_map(|&s| names.get(s));
        let named: Vec<&str> = named.map(String::as_str).collect();
        match named.len() {
            0 => String::new(),
            1 => format!("{kind} {}", named.join("")),
            n if n == names.len() => format!("all {n} {kind}s"),
            _ => format!("{kind}s {}", named.join(", ")),
        }
    }
}

impl Happening {
    fn words(self) -> String {
        match self {
            Self::Gap(cycles) => format!("{cycles} cycles are missing in the recording"),
            Self::Skipped(cycles) => format!("the loop left out {cycles} cycles"),
            Self::ErrorFrames => "the controller reported errors".to_owned(),
            Self::JointFlag(bit) | Self::SensorFlag(bit) => flag(bit).to_owned(),
            Self::ImuFlag(bit) => format!("IMU: {}", flag(bit)),
            Self::StatusWord(from, to) => format!("status word {from:#06x} -> {to:#06x}"),
            Self::Request(1, _) => "operator: enable".to_owned(),
            Self::Request(2, _) => "operator: disable".to_owned(),
            Self::Request(3, _) => "operator: stop".to_owned(),
            Self::Request(_, fault) => format!("operator: acknowledge {fault}"),
            Self::Reference(mode) => format!("references for mode {}", mode_name(mode)),
            Self::NoReference => "no references any more".to_owned(),
            Self::Settings => "a tare or a choice of contacts takes effect".to_owned(),
            Self::Event(number) => format!("event {}", event_name(number)),
            Self::Fault(number) => format!("FAULT {} is latched", event_name(number)),
            Self::Acknowledged(number) => format!("fault {} acknowledged", event_name(number)),
            Self::Refused(refusal) => {
                format!(
                    "request refused: kind {}, {}",
                    refusal >> 16,
                    refusal & 0xffff
                )
            }
            Self::State(from, to) => format!("state {} -> {}", state_name(from), state_name(to)),
            Self::Mode(from, to) => format!("mode {} -> {}", mode_name(from), mode_name(to)),
            Self::DriveState(from, to) => {
                format!("drive {} -> {}", drive_name(from), drive_name(to))
            }
            Self::Engaged(true) => "set-points begin".to_owned(),
            Self::Engaged(false) => "set-points end".to_owned(),
            Self::Limited(bit) => format!("command limited: {}", limit(bit)),
        }
    }

    /// Of the inputs, not of what the loop made of them.
    #[must_use]
    pub fn is_input(self) -> bool {
        self < Self::Event(0)
    }
}

fn flag(bit: u32) -> &'static str {
    match bit {
        measured_flags::MISSED => "no usable sample",
        measured_flags::STALE => "no sample for longer than allowed",
        measured_flags::JUMP => "encoder jumped",
        measured_flags::NEVER => "has never answered",
        measured_flags::IMPLAUSIBLE => "encoders contradict each other",
        measured_flags::STANDS_IN => "another one stands in",
        _ => "unknown flag",
    }
}

fn limit(bit: u32) -> &'static str {
    match bit {
        command_flags::POSITION_LIMITED => "position",
        command_flags::TORQUE_LIMITED => "torque",
        command_flags::LEAD_LIMITED => "lead",
        command_flags::VELOCITY_LIMITED => "velocity",
        command_flags::TORQUE_RATE_LIMITED => "torque rate",
        command_flags::POWER_LIMITED => "power",
        command_flags::NOT_FINITE => "not finite",
        _ => "unknown",
    }
}

fn event_name(number: u32) -> String {
    let name = Event::from_number(number).map_or("unknown", Event::name);
    format!("{number} {name}")
}

fn state_name(number: u32) -> &'static str {
    RobotState::from_number(number).map_or("unknown", RobotState::name)
}

fn mode_name(number: u32) -> &'static str {
    Mode::from_number(number).map_or("unknown", Mode::name)
}

fn drive_name(number: u32) -> &'static str {
    DriveState::from_number(number).map_or("unknown", DriveState::name)
}
