//! Counts of numbered events, and those of this cycle that await their reaction.

use robot_state::{EVENT_COUNT, Event, MAX_JOINTS, refusal};
use supervisor::Refusal;

const _: () = assert!(EVENT_COUNT <= u64::BITS as usize, "a bit for each event");
const _: () = assert!(MAX_JOINTS <= u64::BITS as usize, "a bit for each joint");

/// Subject of an event.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Subject {
    Joint(usize),
    FtSensor(usize),
    Imu(usize),
}

impl Subject {
    /// Index of the subject among those of its kind.
    pub(crate) fn index(self) -> u32 {
        match self {
            Self::Joint(index) | Self::FtSensor(index) | Self::Imu(index) => index as u32,
        }
    }

    /// Each kind, in the order of [`Subject::kind`].
    const KINDS: [fn(usize) -> Self; 3] = [Self::Joint, Self::FtSensor, Self::Imu];

    fn kind(self) -> u32 {
        match self {
            Self::Joint(_) => 0,
            Self::FtSensor(_) => 1,
            Self::Imu(_) => 2,
        }
    }

    /// The number that records carry: the kind, from 1 on, in the upper half, the index in the lower.
    pub(crate) fn code(self) -> u32 {
        (self.kind() + 1) << 16 | self.index()
    }
}

/// All that one event is about in one cycle: each subject gets its own reaction, as what errs at once
/// errs for a common reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Subjects {
    /// The one named last, which is reacted to first.
    last: Option<Subject>,
    /// A bit for each joint, F/T sensor and IMU.
    bits: [u64; 3],
}

impl Subjects {
    fn add(&mut self, subject: Option<Subject>) {
        let Some(subject) = subject else {
            return;
        };
        self.last = Some(subject);
        if let Some(bits) = self.bits.get_mut(subject.kind() as usize) {
            *bits |= 1_u64.checked_shl(subject.index()).unwrap_or(0);
        }
    }

    /// One of them, each once.
    fn take(&mut self) -> Option<Subject> {
        let subject = self.last.take().or_else(|| {
            let mut kinds = self.bits.iter().zip(Subject::KINDS);
            let (bits, of_kind) = kinds.find(|(bits, _)| **bits != 0)?;
            Some(of_kind(bits.trailing_zeros() as usize))
        })?;
        if let Some(bits) = self.bits.get_mut(subject.kind() as usize) {
            *bits &= !1_u64.checked_shl(subject.index()).unwrap_or(0);
        }
        Some(subject)
    }

    fn is_empty(&self) -> bool {
        self.last.is_none() && self.bits == [0; 3]
    }
}

/// Count of each event since start, in the order of `Event::ALL`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Counts {
    times: [u64; EVENT_COUNT],
    /// A bit for each event that occurred, or lasts, since reactions were taken.
    raised: u64,
    subjects: [Subjects; EVENT_COUNT],
}

impl Counts {
    pub(crate) const fn new() -> Self {
        Self {
            times: [0; EVENT_COUNT],
            raised: 0,
            subjects: [Subjects {
                last: None,
                bits: [0; 3],
            }; EVENT_COUNT],
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
        if begins {
            self.add_of(event, subject)
        } else {
            self.raise(event, Some(subject))
        }
    }

    fn raise(&mut self, event: Event, subject: Option<Subject>) {
        self.raised |= 1 << event.index();
        if let Some(subjects) = self.subjects.get_mut(event.index()) {
            subjects.add(subject);
        }
    }

    /// An event that awaits its reaction, once for each of its subjects, or once without one.
    pub(crate) fn take_raised(&mut self) -> Option<(Event, Option<Subject>)> {
        let index = self.raised.trailing_zeros() as usize;
        let event = Event::ALL.get(index)?;
        let subjects = self.subjects.get_mut(index)?;
        let subject = subjects.take();
        if subjects.is_empty() {
            self.raised &= self.raised.wrapping_sub(1);
        }
        Some((*event, subject))
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
        Refusal::Unfit(joint) => refusal::UNFIT << 16 | joint as u32,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_subject_of_an_event_awaits_its_own_reaction_and_the_last_one_comes_first() {
        let mut counts = Counts::new();
        let subjects = [
            Subject::Joint(3),
            Subject::Joint(63),
            Subject::FtSensor(1),
            Subject::Imu(0),
            Subject::Joint(5),
        ];
        for subject in subjects {
            counts.add_of(Event::FollowingError, subject);
            counts.add_of(Event::FollowingError, subject);
        }
        counts.add(Event::SendFailed);
        let mut taken: Vec<_> = core::iter::from_fn(|| counts.take_raised()).collect();
        assert_eq!(counts.take_raised(), None);
        taken.retain(|(event, _)| *event == Event::FollowingError);
        let taken: Vec<_> = taken
            .into_iter()
            .filter_map(|(_, subject)| subject)
            .collect();
        assert_eq!(taken[0], Subject::Joint(5));
        assert_eq!(taken.len(), subjects.len());
        assert!(subjects.iter().all(|subject| taken.contains(subject)));
    }
}
