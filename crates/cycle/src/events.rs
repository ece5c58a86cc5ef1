//! Counts of numbered events, and those of this cycle that await their reaction.

use robot_state::{EVENT_COUNT, Event, refusal};
use supervisor::Refusal;

const _: () = assert!(EVENT_COUNT <= u64::BITS as usize, "a bit for each event");

/// Subject of an event.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Subject {
    Joint(usize),
    FtSensor(usize),
    Imu(usize),
}

impl Subject {
    /// Its index among those of its kind.
    pub(crate) fn index(self) -> u32 {
        match self {
            Self::Joint(index) | Self::FtSensor(index) | Self::Imu(index) => index as u32,
        }
    }

    /// The number that records carry: the kind in the upper half, the index in the lower.
    pub(crate) fn code(self) -> u32 {
        let kind = match self {
            Self::Joint(_) => 1,
            Self::FtSensor(_) => 2,
            Self::Imu(_) => 3,
        };
        kind << 16 | self.index()
    }
}

/// Count of each event since start, in the order of `Event::ALL`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Counts {
    times: [u64; EVENT_COUNT],
    /// A bit for each event that occurred, or lasts, since reactions were taken.
    raised: u64,
    subjects: [Option<Subject>; EVENT_COUNT],
}

impl Counts {
    pub(crate) const fn new() -> Self {
        Self {
            times: [0; EVENT_COUNT],
            raised: 0,
            subjects: [None; EVENT_COUNT],
        }
    }

    pub(crate) fn add(&mut self, event: Event) {
        self.add_many(event, 1);
    }

    pub(crate) fn add_many(&mut self, event: Event, times: u64) {
        if times > 0 {
            self.raise(event, None);
            if let Some(count) = self.times.get_mut(event.index()) {
                *count = count.saturating_add(times);
            }
        }
    }

    pub(crate) fn add_about(&mut self, event: Event, subject: Option<Subject>) {
        self.add(event);
        self.raise(event, subject);
    }

    pub(crate) fn add_of(&mut self, event: Event, subject: Subject) {
        self.add_about(event, Some(subject));
    }

    /// A condition that lasts: counted in the cycle in which it begins, and reacted to in each.
    pub(crate) fn lasting(&mut self, event: Event, subject: Subject, begins: bool) {
        match begins {
            true => self.add_of(event, subject),
            false => self.raise(event, Some(subject)),
        }
    }

    fn raise(&mut self, event: Event, subject: Option<Subject>) {
        self.raised |= 1 << event.index();
        if let Some(of_event) = self.subjects.get_mut(event.index()) {
            *of_event = subject;
        }
    }

    /// An event that awaits its reaction, each once, with what it is about.
    pub(crate) fn take_raised(&mut self) -> Option<(Event, Option<Subject>)> {
        let index = self.raised.trailing_zeros() as usize;
        self.raised &= self.raised.wrapping_sub(1);
        let event = Event::ALL.get(index)?;
        Some((*event, self.subjects.get(index).copied().flatten()))
    }

    pub(crate) fn as_array(&self) -> [u64; EVENT_COUNT] {
        self.times
    }
}

/// A refusal as a number: the kind in the upper half, its subject in the lower.
pub(crate) fn refusal_code(reason: Refusal) -> u32 {
    match reason {
        Refusal::State(state) => refusal::STATE << 16 | state.number(),
        Refusal::Joint(joint) => refusal::JOINT << 16 | joint as u32,
        Refusal::Outside(joint) => refusal::OUTSIDE << 16 | joint as u32,
        Refusal::OtherFault(number) => refusal::OTHER_FAULT << 16 | number,
        Refusal::Drive(joint) => refusal::DRIVE << 16 | joint as u32,
    }
}
