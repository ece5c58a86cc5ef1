//! State machine of one drive: from its status word to its state, from a goal to its control word.
//!
//! ```text
//!  off ──► ready ──► on ──► enabled      goal enabled: one word a state, each with a time limit
//!   ▲        │       │         │
//!   └────────┴───────┴─────────┘         goal off: the disable word, from any state
//!   └──── stopping ◄───────────┘         goal stopped: the quick-stop word, where there is one, then off
//!  fault ──reset (rising edge)──► off    only when the operator has acknowledged
//! ```
//!
//! The words are data: [`DriveProfile::cia402`] is the preset of CiA 402 (IEC 61800-7-201), whose
//! state diagram is the one above; a drive with an enabled bit and a fault bit is another table.
//! A drive without a status signal has no states: it counts as enabled as long as it answers. One
//! without control words is only watched: its states determine whether it may be used.

use robot_state::DriveState;

/// One row of the table from status words to states: `word & mask == value`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StatusPattern {
    /// Bits that matter.
    pub mask: u32,
    /// Their values in this state.
    pub value: u32,
    /// The state.
    pub state: DriveState,
}

/// Bits of the status word: `word & mask == value`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StatusBits {
    /// Bits that matter.
    pub mask: u32,
    /// Their values.
    pub value: u32,
}

/// Control words, one for each step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ControlWords {
    /// From off to ready to switch on (CiA 402: shutdown).
    pub prepare: u32,
    /// From ready to switched on.
    pub switch_on: u32,
    /// From switched on to enabled; also sent while the drive is enabled.
    pub enable: u32,
    /// To off, from any state (CiA 402: disable voltage).
    pub disable: u32,
    /// Clears the drive's fault; acts by its rising edge after `disable`.
    pub reset: u32,
    /// The drive brakes its motor by itself, from enabled (CiA 402: quick stop); none: it has no such word.
    pub quick_stop: Option<u32>,
}

/// A drive's words as data.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DriveProfile {
    /// The first row that fits determines the state.
    pub status: Vec<StatusPattern>,
    /// Control words; none: the drive is only watched.
    pub control: Option<ControlWords>,
    /// Longest time for each step, cycles.
    pub step_limit: u32,
    /// A brake holds the joint while the drive is off.
    pub brake: bool,
    /// In its quick stop it bears its joint by torque for as long as it hears it, and may be enabled from there.
    pub bears: bool,
    /// Status bits of a drive that stops by itself when it hears no set-points; none: no bit
    /// indicates it.
    pub time_out_set: Option<StatusBits>,
}

impl DriveProfile {
    /// The profile of CiA 402, by the low byte of its status word, with a time limit for each step.
    #[must_use]
    pub fn cia402(step_limit: u32) -> Self {
        use DriveState as S;
        let row = |mask, value, state| StatusPattern { mask, value, state };
        Self {
            status: vec![
                row(0x4f, 0x00, S::Off),
                row(0x4f, 0x40, S::Off),
                row(0x6f, 0x21, S::ReadyToSwitchOn),
                row(0x6f, 0x23, S::SwitchedOn),
                row(0x6f, 0x27, S::Enabled),
                row(0x6f, 0x07, S::Stopping),
                row(0x4f, 0x0f, S::Stopping),
                row(0x4f, 0x08, S::Fault),
            ],
            control: Some(ControlWords {
                prepare: 0x06,
                switch_on: 0x07,
                enable: 0x0f,
                disable: 0x00,
                reset: 0x80,
                quick_stop: Some(0x02),
            }),
            step_limit,
            brake: false,
            bears: false,
            time_out_set: None,
        }
    }

    /// It is the preset, whatever its time limit and brake.
    #[must_use]
    pub fn is_cia402(&self) -> bool {
        let preset = Self::cia402(self.step_limit);
        (&self.status, &self.control) == (&preset.status, &preset.control)
    }

    /// The state that a status word indicates.
    #[must_use]
    pub fn state(&self, status: u32) -> DriveState {
        (self.status.iter())
            .find(|row| status & row.mask == row.value)
            .map_or(DriveState::Unknown, |row| row.state)
    }
}

/// The state that the robot needs a drive in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum DriveGoal {
    /// Whatever it is in: nothing is sent.
    #[default]
    Listen,
    /// No torque.
    Off,
    /// Brought to rest by the drive's own quick stop; off at once where it has none.
    Stopped,
    /// Following its set-points.
    Enabled,
}

/// Why a drive is not where it should be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DriveTrouble {
    /// A step took longer than the profile allows; the drive's state is where it stays.
    TimeOut(DriveState),
    /// The drive has latched a fault of its own.
    Fault,
    /// The drive would go on with its last set-point if it heard no other: its own time limit is off.
    Unguarded,
    /// The drive was enabled and is so no longer, though nobody asked for it.
    Lost(DriveState),
}

/// One drive, followed from cycle to cycle.
#[derive(Debug, Clone)]
pub struct Drive {
    profile: Option<DriveProfile>,
    state: DriveState,
    goal: DriveGoal,
    /// The operator has acknowledged the drive's fault: it is being reset.
    resetting: bool,
    /// The drive's own time limit for set-points is off.
    unguarded: bool,
    /// Cycles in this state while it is not that of the goal.
    waited: u32,
    /// The drive has reached `Enabled` since the goal was set.
    reached: bool,
    trouble: Option<DriveTrouble>,
    /// The last status word read that the drive, which is enabled, is so no longer: one word may be wrong.
    contradicted: bool,
}

impl Drive {
    /// A drive with these words; none: without states.
    #[must_use]
    pub fn new(profile: Option<DriveProfile>) -> Self {
        let state = match profile {
            Some(_) => DriveState::Unknown,
            None => DriveState::Enabled,
        };
        Self {
            profile,
            state,
            goal: DriveGoal::Listen,
            resetting: false,
            unguarded: false,
            waited: 0,
            reached: false,
            trouble: None,
            contradicted: false,
        }
    }

    /// The state by the last status word.
    #[must_use]
    pub fn state(&self) -> DriveState {
        self.state
    }

    /// The goal as it was set last.
    #[must_use]
    pub fn goal(&self) -> DriveGoal {
        self.goal
    }

    /// Sets the goal; time limits begin anew where it changes.
    pub fn pursue(&mut self, goal: DriveGoal) {
        if goal != self.goal {
            self.goal = goal;
            self.waited = 0;
            self.reached = false;
        }
    }

    /// The operator has understood the drive's fault: if it has one, it is reset.
    pub fn acknowledge(&mut self) {
        self.resetting = self.state == DriveState::Fault;
        self.waited = 0;
    }

    /// The drive follows set-points.
    #[must_use]
    pub fn is_enabled(&self) -> bool {
        self.state == DriveState::Enabled
    }

    /// The drive is where its goal wants it, and stays there without further control words.
    #[must_use]
    pub fn is_settled(&self) -> bool {
        match self.goal {
            DriveGoal::Listen => true,
            DriveGoal::Off => matches!(self.state, DriveState::Off | DriveState::Fault),
            DriveGoal::Stopped => !self.is_enabled(),
            DriveGoal::Enabled => self.is_enabled(),
        }
    }

    /// Takes the newest status word (none: no fresh sample) and checks the drive against its goal.
    /// A trouble is returned once, in the cycle in which it begins.
    pub fn update(&mut self, status: Option<u32>) -> Option<DriveTrouble> {
        let before = self.trouble;
        self.trouble = self.check(status);
        self.trouble.filter(|_| self.trouble != before)
    }

    fn check(&mut self, status: Option<u32>) -> Option<DriveTrouble> {
        let profile = self.profile.as_ref()?;
        let confirmed = status.filter(|&status| {
            let leaves = self.goal == DriveGoal::Enabled
                && self.state == DriveState::Enabled
                && profile.state(status) != DriveState::Enabled;
            let first = leaves && !self.contradicted;
            self.contradicted = leaves;
            !first
        });
        if let Some(status) = confirmed {
            let state = profile.state(status);
            if state != self.state {
                self.waited = 0;
            }
            self.state = state;
            let set = profile.time_out_set;
            self.unguarded = set.is_some_and(|bits| status & bits.mask != bits.value);
        }
        // A drive that sends nothing cannot confirm that it is off; that it is silent is known.
        let silent = status.is_none() && matches!(self.goal, DriveGoal::Off | DriveGoal::Stopped);
        self.waited = self.waited.saturating_add(u32::from(!silent));
        let in_time = self.waited <= profile.step_limit;
        if self.state == DriveState::Fault {
            self.resetting &= in_time;
            return (!self.resetting).then_some(DriveTrouble::Fault);
        }
        self.resetting = false;
        if self.goal == DriveGoal::Enabled && self.unguarded {
            return Some(DriveTrouble::Unguarded);
        }
        let arrived = match self.goal {
            DriveGoal::Listen => true,
            // Without control words nothing switches the drive off.
            DriveGoal::Off | DriveGoal::Stopped => {
                self.state != DriveState::Enabled || profile.control.is_none()
            }
            DriveGoal::Enabled => self.state == DriveState::Enabled,
        };
        if arrived {
            self.waited = 0;
            self.reached = self.goal == DriveGoal::Enabled;
            return None;
        }
        if self.reached {
            return Some(DriveTrouble::Lost(self.state));
        }
        (!in_time).then_some(DriveTrouble::TimeOut(self.state))
    }

    /// The control word of this cycle; none where nothing is sent.
    #[must_use]
    pub fn control_word(&self) -> Option<u32> {
        use DriveState as S;
        let words = self.profile.as_ref()?.control.as_ref()?;
        match (self.goal, self.state) {
            (DriveGoal::Listen, _) => None,
            // The edge: the word before was `disable`.
            (_, S::Fault) if self.resetting => Some(words.reset),
            (DriveGoal::Enabled, _) if self.unguarded => Some(words.disable),
            (DriveGoal::Enabled, S::Off | S::Unknown) => Some(words.prepare),
            (DriveGoal::Enabled, S::ReadyToSwitchOn) => Some(words.switch_on),
            (DriveGoal::Enabled, S::SwitchedOn | S::Enabled) => Some(words.enable),
            (DriveGoal::Enabled, S::Stopping) if self.bears() => Some(words.enable),
            (DriveGoal::Stopped, S::Enabled | S::Stopping) => {
                Some(words.quick_stop.unwrap_or(words.disable))
            }
            (DriveGoal::Off | DriveGoal::Stopped | DriveGoal::Enabled, _) => Some(words.disable),
        }
    }

    /// In its quick stop it bears its joint.
    #[must_use]
    pub fn bears(&self) -> bool {
        self.profile.as_ref().is_some_and(|profile| profile.bears)
    }

    /// It follows set-points, and its own quick stop can bring it to rest.
    #[must_use]
    pub fn can_stop(&self) -> bool {
        let words = (self.profile.as_ref()).and_then(|profile| profile.control.as_ref());
        self.is_enabled() && words.is_some_and(|words| words.quick_stop.is_some())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cia402_knows_each_state_whatever_the_other_bits_are() {
        use DriveState as S;
        let profile = DriveProfile::cia402(100);
        let words = [
            (0x00, S::Off),
            (0x40, S::Off),
            (0x50, S::Off),
            (0x31, S::ReadyToSwitchOn),
            (0x33, S::SwitchedOn),
            (0x37, S::Enabled),
            (0x17, S::Stopping),
            (0x1f, S::Stopping),
            (0x18, S::Fault),
        ];
        for (word, state) in words {
            assert_eq!(profile.state(word), state, "{word:#x}");
            assert_eq!(
                profile.state(word | 0x0280),
                state,
                "{word:#x} with a warning"
            );
        }
    }

    #[test]
    fn a_drive_stops_by_itself_before_it_is_off() {
        let enabled = |profile| {
            let mut drive = Drive::new(Some(profile));
            drive.pursue(DriveGoal::Enabled);
            assert_eq!(drive.update(Some(0x27)), None);
            drive
        };
        let mut drive = enabled(DriveProfile::cia402(3));
        assert!(drive.can_stop());
        drive.pursue(DriveGoal::Stopped);
        assert_eq!(drive.control_word(), Some(0x02));
        assert_eq!(drive.update(Some(0x07)), None);
        assert_eq!(
            (drive.state(), drive.control_word()),
            (DriveState::Stopping, Some(0x02))
        );
        drive.pursue(DriveGoal::Off);
        assert_eq!(drive.control_word(), Some(0x00));
        // One that goes on is a trouble.
        let mut deaf = enabled(DriveProfile::cia402(3));
        deaf.pursue(DriveGoal::Stopped);
        let troubles: Vec<_> = (0..5).filter_map(|_| deaf.update(Some(0x27))).collect();
        assert_eq!(troubles, [DriveTrouble::TimeOut(DriveState::Enabled)]);
        // One without the word is switched off.
        let mut profile = DriveProfile::cia402(3);
        profile.control.as_mut().expect("words").quick_stop = None;
        let mut drive = enabled(profile);
        assert!(!drive.can_stop());
        drive.pursue(DriveGoal::Stopped);
        assert_eq!(drive.control_word(), Some(0x00));
    }

    /// A drive that obeys each word one cycle later.
    fn obeys(state: u32, word: u32) -> u32 {
        match (state, word) {
            (0x08, 0x80) => 0x40,
            (0x08, _) => 0x08,
            (_, 0x00) => 0x40,
            (0x40, 0x06) => 0x21,
            (0x21, 0x07) => 0x23,
            (0x23 | 0x27, 0x0f) => 0x27,
            (state, _) => state,
        }
    }

    #[test]
    fn steps_lead_to_enabled_and_back() {
        let mut drive = Drive::new(Some(DriveProfile::cia402(10)));
        let mut status = 0x40;
        assert_eq!(drive.control_word(), None, "it listens");
        for (goal, state) in [
            (DriveGoal::Enabled, DriveState::Enabled),
            (DriveGoal::Off, DriveState::Off),
        ] {
            drive.pursue(goal);
            for _ in 0..6 {
                assert_eq!(drive.update(Some(status)), None);
                status = obeys(status, drive.control_word().unwrap());
            }
            assert_eq!(drive.state(), state);
            assert!(drive.is_settled());
        }
    }

    #[test]
    fn a_refusal_a_fault_and_a_loss_are_distinguished_and_reported_once() {
        let mut refuses = Drive::new(Some(DriveProfile::cia402(10)));
        refuses.pursue(DriveGoal::Enabled);
        let troubles: Vec<_> = (0..20).map(|_| refuses.update(Some(0x21))).collect();
        let waiting = DriveTrouble::TimeOut(DriveState::ReadyToSwitchOn);
        assert_eq!(troubles.iter().position(Option::is_some), Some(10));
        assert_eq!(
            troubles.into_iter().flatten().collect::<Vec<_>>(),
            [waiting]
        );

        let mut lost = Drive::new(Some(DriveProfile::cia402(10)));
        lost.pursue(DriveGoal::Enabled);
        assert_eq!(lost.update(Some(0x27)), None);
        let off = DriveTrouble::Lost(DriveState::Off);
        assert_eq!(lost.update(Some(0x40)), None, "one word may be wrong");
        assert_eq!(lost.update(Some(0x40)), Some(off));
        assert_eq!(lost.update(Some(0x08)), Some(DriveTrouble::Fault));
        lost.pursue(DriveGoal::Off);
        assert_eq!(lost.update(Some(0x08)), None);
        assert_eq!(lost.control_word(), Some(0x00), "not acknowledged");
        lost.acknowledge();
        assert_eq!(lost.update(None), None);
        assert_eq!(lost.control_word(), Some(0x80));
        let again: Vec<_> = (0..20).filter_map(|_| lost.update(Some(0x08))).collect();
        assert_eq!(again, [DriveTrouble::Fault], "the cause remains");
    }

    #[test]
    fn a_drive_that_stays_enabled_is_noticed() {
        let mut drive = Drive::new(Some(DriveProfile::cia402(10)));
        drive.pursue(DriveGoal::Off);
        let silent: Vec<_> = (0..20).filter_map(|_| drive.update(None)).collect();
        assert_eq!(silent, [], "it says nothing");
        let stays: Vec<_> = (0..20).filter_map(|_| drive.update(Some(0x27))).collect();
        assert_eq!(stays, [DriveTrouble::TimeOut(DriveState::Enabled)]);
    }
}
