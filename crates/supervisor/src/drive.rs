//! State machine of one drive: from its status word to its state, from a goal to its control word.
//!
//! ```text
//!  off ──► ready ──► on ──► enabled            goal Enabled: one word a state, each with a time limit
//!   ▲        │       │         │
//!   └────────┴───────┴─────────┘               goal Off: the disable word, from any state
//!  fault ──reset (rising edge)──► off          only when the operator has acknowledged
//! ```
//!
//! The words are data: [`DriveProfile::CIA402`] is the preset of CiA 402 (IEC 61800-7-201), whose
//! state diagram is the one above; a drive with an enabled bit and a fault bit is another table.
//! A drive without a status signal has no states: it is taken as enabled as long as it answers.

/// State of a drive, by its status word.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum DriveState {
    /// No status word has come yet, or none that the profile knows.
    #[default]
    Unknown,
    /// Powered down or initialising (CiA 402: not ready to switch on, switch on disabled).
    Off,
    /// CiA 402: ready to switch on.
    ReadyToSwitchOn,
    /// CiA 402: switched on; no torque yet.
    SwitchedOn,
    /// CiA 402: operation enabled; the drive follows its set-points.
    Enabled,
    /// The drive stops by itself (CiA 402: quick stop active, fault reaction active).
    Stopping,
    /// The drive has latched a fault of its own.
    Fault,
}

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
    /// Stop by the drive's own ramp, then off.
    pub quick_stop: u32,
    /// Clears the drive's fault; acts by its rising edge after `disable`.
    pub reset: u32,
}

/// A drive's words as data.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DriveProfile {
    /// The first row that fits determines the state.
    pub status: Vec<StatusPattern>,
    /// Bits of the status word that warn; zero if there are none.
    pub warning_mask: u32,
    /// What is sent.
    pub control: ControlWords,
    /// Longest time for each step, cycles.
    pub step_limit: u32,
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
            warning_mask: 0x80,
            control: ControlWords {
                prepare: 0x06,
                switch_on: 0x07,
                enable: 0x0f,
                disable: 0x00,
                quick_stop: 0x02,
                reset: 0x80,
            },
            step_limit,
        }
    }

    /// The state that a status word indicates.
    #[must_use]
    pub fn state(&self, status: u32) -> DriveState {
        (self.status.iter())
            .find(|row| status & row.mask == row.value)
            .map_or(DriveState::Unknown, |row| row.state)
    }
}

/// What the robot needs of a drive.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum DriveGoal {
    /// No torque.
    #[default]
    Off,
    /// Following its set-points.
    Enabled,
    /// Stopping by its own ramp.
    QuickStop,
    /// Its fault cleared, then off.
    Reset,
}

/// Why a drive is not where it should be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DriveTrouble {
    /// A step took longer than the profile allows; the drive's state is where it stays.
    TimeOut(DriveState),
    /// The drive has latched a fault of its own.
    Fault,
    /// The drive was enabled and is so no longer, though nobody asked for it.
    Lost(DriveState),
}

/// One drive, followed from cycle to cycle.
#[derive(Debug, Clone)]
pub struct Drive {
    profile: Option<DriveProfile>,
    state: DriveState,
    goal: DriveGoal,
    /// Cycles in this state while it is not that of the goal.
    waited: u32,
    /// The drive has reached `Enabled` since the goal was set.
    reached: bool,
}

impl Drive {
    /// A drive with these words; none: without states.
    #[must_use]
    pub fn new(profile: Option<DriveProfile>) -> Self {
        let state = if profile.is_some() {
            DriveState::Unknown
        } else {
            DriveState::Enabled
        };
        Self {
            profile,
            state,
            goal: DriveGoal::Off,
            waited: 0,
            reached: false,
        }
    }

    /// The state by the last status word.
    #[must_use]
    pub fn state(&self) -> DriveState {
        self.state
    }

    /// Sets what the drive is to reach; the time limits begin anew where this changes.
    pub fn pursue(&mut self, goal: DriveGoal) {
        if goal != self.goal {
            self.goal = goal;
            self.waited = 0;
            self.reached = false;
        }
    }

    /// The drive follows set-points.
    #[must_use]
    pub fn is_enabled(&self) -> bool {
        self.state == DriveState::Enabled
    }

    /// Takes the newest status word (none: no fresh sample) and checks the drive against its goal.
    pub fn update(&mut self, status: Option<u32>) -> Result<(), DriveTrouble> {
        let Some(profile) = &self.profile else {
            return Ok(());
        };
        if let Some(status) = status {
            let state = profile.state(status);
            if state != self.state {
                self.waited = 0;
            }
            self.state = state;
        }
        let enabling = self.goal == DriveGoal::Enabled;
        if self.state == DriveState::Fault && enabling {
            return Err(DriveTrouble::Fault);
        }
        if enabling && self.state == DriveState::Enabled {
            self.reached = true;
        } else if enabling && self.reached {
            return Err(DriveTrouble::Lost(self.state));
        }
        let arrived = match self.goal {
            DriveGoal::Enabled => self.state == DriveState::Enabled,
            DriveGoal::QuickStop | DriveGoal::Off | DriveGoal::Reset => true,
        };
        if arrived {
            self.waited = 0;
            return Ok(());
        }
        self.waited = self.waited.saturating_add(1);
        if self.waited > profile.step_limit {
            return Err(DriveTrouble::TimeOut(self.state));
        }
        Ok(())
    }

    /// The control word of this cycle; none where the drive has no states.
    #[must_use]
    pub fn control_word(&self) -> Option<u32> {
        let words = &self.profile.as_ref()?.control;
        Some(match (self.goal, self.state) {
            (DriveGoal::Enabled, DriveState::Off | DriveState::Unknown) => words.prepare,
            (DriveGoal::Enabled, DriveState::ReadyToSwitchOn) => words.switch_on,
            (DriveGoal::Enabled, DriveState::SwitchedOn | DriveState::Enabled) => words.enable,
            (DriveGoal::QuickStop, DriveState::Enabled | DriveState::Stopping) => words.quick_stop,
            // The edge: the word before was `disable`.
            (DriveGoal::Reset, DriveState::Fault) => words.reset,
            _ => words.disable,
        })
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

    /// A drive that obeys each word one cycle later.
    fn obeys(state: u32, word: u32) -> u32 {
        match (state, word) {
            (0x08, 0x80) => 0x40,
            (0x08, _) => 0x08,
            (_, 0x00) => 0x40,
            (0x40, 0x06) => 0x21,
            (0x21, 0x07) => 0x23,
            (0x23 | 0x27, 0x0f) => 0x27,
            (0x27, 0x02) => 0x07,
            (0x07, 0x02) => 0x40,
            (state, _) => state,
        }
    }

    #[test]
    fn steps_lead_to_enabled_and_back() {
        let mut drive = Drive::new(Some(DriveProfile::cia402(10)));
        let mut status = 0x40;
        drive.pursue(DriveGoal::Enabled);
        for _ in 0..6 {
            drive.update(Some(status)).unwrap();
            status = obeys(status, drive.control_word().unwrap());
        }
        assert!(drive.is_enabled());
        drive.pursue(DriveGoal::QuickStop);
        for _ in 0..6 {
            drive.update(Some(status)).unwrap();
            status = obeys(status, drive.control_word().unwrap());
        }
        assert_eq!(drive.state(), DriveState::Off);
    }

    #[test]
    fn a_refusal_a_fault_and_a_loss_are_distinguished() {
        let mut refuses = Drive::new(Some(DriveProfile::cia402(10)));
        refuses.pursue(DriveGoal::Enabled);
        let outcome: Vec<_> = (0..12).map(|_| refuses.update(Some(0x21))).collect();
        assert!(outcome[..10].iter().all(Result::is_ok));
        let waiting = DriveTrouble::TimeOut(DriveState::ReadyToSwitchOn);
        assert_eq!(outcome[11], Err(waiting));

        let mut lost = Drive::new(Some(DriveProfile::cia402(10)));
        lost.pursue(DriveGoal::Enabled);
        lost.update(Some(0x27)).unwrap();
        assert_eq!(
            lost.update(Some(0x40)),
            Err(DriveTrouble::Lost(DriveState::Off))
        );
        assert_eq!(lost.update(Some(0x08)), Err(DriveTrouble::Fault));
        lost.pursue(DriveGoal::Reset);
        assert_eq!(lost.update(None), Ok(()));
        assert_eq!(lost.control_word(), Some(0x80));
    }
}
