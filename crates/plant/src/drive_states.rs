//! States of a simulated drive by CiA 402 (IEC 61800-7-201), its holding brake, and its failures.
//!
//! ```text
//!  switch on disabled ─shutdown─► ready ─switch on─► switched on ─enable─► operation enabled
//!     0x40      ▲                 0x21                 0x23                   0x27
//!               └──────────── disable voltage, quick stop, loss of power ◄─────┘
//!  fault 0x08 ◄── over-current, set-points missing …;  fault ── rising edge of bit 7 ──► 0x40
//! ```
//! The words' other bits: 4 of the status word is on while the motor has power; 7, a warning, while
//! the drive has no time limit for set-points; 8 to 12 hold the
//! number of the last error.

use crate::parameters::StateParameters;

/// Status word of a drive without states: operation enabled.
pub(crate) const ALWAYS_ON: u32 = 0x37;

/// Errors of a drive, as bits 8 to 12 of its status word number them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DriveError {
    /// Too much current.
    OverCurrent = 1,
    /// Too hot.
    OverTemperature = 2,
    /// An encoder failed.
    Encoder = 3,
    /// It does not follow its target.
    Following = 4,
    /// No set-point for longer than the drive's own time limit.
    SetPointTimeOut = 5,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    SwitchOnDisabled = 0x40,
    Ready = 0x21,
    SwitchedOn = 0x23,
    Enabled = 0x27,
    Fault = 0x08,
}

/// Request of a control word.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Asked {
    DisableVoltage,
    QuickStop,
    Shutdown,
    SwitchOn,
    Enable,
}

/// The states of one drive.
#[derive(Debug, Clone)]
pub struct DriveStates {
    parameters: StateParameters,
    state: State,
    word: u32,
    /// A rising edge of the reset bit has come.
    reset: bool,
    /// Time since a step was asked for, s.
    waited: f64,
    /// Time since the drive was enabled or disabled, s.
    since_change: f64,
    since_set_point: f64,
    powered: bool,
    refuses: bool,
    /// The brake stays closed (true) or open (false) whatever the drive does.
    stuck_brake: Option<bool>,
    cause: Option<DriveError>,
    last_error: u32,
}

impl DriveStates {
    /// A drive that has just got its power.
    #[must_use]
    pub fn new(parameters: &StateParameters) -> Self {
        Self {
            parameters: parameters.clone(),
            state: State::SwitchOnDisabled,
            word: 0,
            reset: false,
            waited: 0.0,
            since_change: f64::INFINITY,
            since_set_point: 0.0,
            powered: true,
            refuses: false,
            stuck_brake: None,
            cause: None,
            last_error: 0,
        }
    }

    /// The status word.
    #[must_use]
    pub fn status(&self) -> u32 {
        let voltage = if self.powered { 0x10 } else { 0 };
        let endless = match self.parameters.command_timeout {
            Some(_) => 0,
            None => 0x80,
        };
        self.state as u32 | voltage | endless | self.last_error << 8
    }

    /// Number of the last error; 0: none since it was reset.
    #[must_use]
    pub fn error(&self) -> u32 {
        self.last_error
    }

    /// The motor makes torque.
    #[must_use]
    pub fn is_enabled(&self) -> bool {
        self.state == State::Enabled
    }

    /// The brake holds the rotor.
    #[must_use]
    pub fn is_braked(&self) -> bool {
        let p = &self.parameters;
        if let Some(closed) = self.stuck_brake {
            return closed;
        }
        p.brake
            && if self.is_enabled() {
                self.since_change < p.brake_release
            } else {
                self.since_change >= p.brake_engage
            }
    }

    /// Whether the motor has power: an emergency stop takes it away.
    pub fn set_power(&mut self, powered: bool) {
        self.powered = powered;
    }

    /// The cause of a fault, present until it is set to none.
    pub fn set_cause(&mut self, cause: Option<DriveError>) {
        self.cause = cause;
    }

    /// Whether the drive stays switched on instead of being enabled.
    pub fn set_refuses(&mut self, refuses: bool) {
        self.refuses = refuses;
    }

    /// Whether the brake is stuck, and if so closed (true) or open.
    pub fn set_stuck_brake(&mut self, closed: Option<bool>) {
        self.stuck_brake = closed;
    }

    /// Time that each step takes, s.
    pub fn set_step_time(&mut self, step: f64) {
        self.parameters.step = step;
    }

    /// Longest time without a set-point, s; none: for ever.
    pub fn set_command_timeout(&mut self, timeout: Option<f64>) {
        self.parameters.command_timeout = timeout;
    }

    /// A control word arrives.
    pub(crate) fn control(&mut self, word: u32) {
        const RESET: u32 = 0x80;
        self.reset |= word & RESET != 0 && self.word & RESET == 0;
        self.word = word;
    }

    /// The drive is switched on or off at once: of one that knows no steps.
    pub(crate) fn switch(&mut self, on: bool) {
        let on = on && self.powered && self.state != State::Fault;
        self.word = if on { 0x0F } else { 0x00 };
        match self.state {
            State::Fault => {}
            _ if on => {
                self.enter(State::Enabled);
            }
            _ => {
                self.enter(State::SwitchOnDisabled);
            }
        }
    }

    /// Its error is cleared, if its cause is gone.
    pub(crate) fn clear(&mut self) {
        if self.cause.is_none() && self.state == State::Fault {
            self.last_error = 0;
            self.word = 0;
            self.enter(State::SwitchOnDisabled);
        }
    }

    /// A set-point arrives.
    pub(crate) fn note_set_point(&mut self) {
        self.since_set_point = 0.0;
    }

    /// Time passes. True if the drive is enabled from now on.
    pub(crate) fn tick(&mut self, dt: f64) -> bool {
        self.since_change += dt;
        self.since_set_point += dt;
        let limit = self.parameters.command_timeout;
        if self.is_enabled() && limit.is_some_and(|limit| self.since_set_point > limit) {
            self.fail(DriveError::SetPointTimeOut);
        }
        if let Some(cause) = self.cause {
            self.fail(cause);
            self.reset = false;
        } else if self.state == State::Fault {
            if self.reset {
                self.last_error = 0;
                self.enter(State::SwitchOnDisabled);
            }
        } else if !self.powered {
            self.enter(State::SwitchOnDisabled);
        } else if let Some(next) = self.next() {
            self.waited += dt;
            if self.waited >= self.parameters.step {
                return self.enter(next) && self.is_enabled();
            }
        } else {
            self.waited = 0.0;
        }
        self.reset &= self.state == State::Fault;
        false
    }

    /// The state that the control word leads to; none: it stays.
    fn next(&self) -> Option<State> {
        use State as S;
        match (self.state, asked(self.word)?) {
            (S::SwitchOnDisabled, Asked::DisableVoltage | Asked::QuickStop) => None,
            (_, Asked::DisableVoltage | Asked::QuickStop) => Some(S::SwitchOnDisabled),
            (S::SwitchOnDisabled | S::SwitchedOn | S::Enabled, Asked::Shutdown) => Some(S::Ready),
            (S::Ready | S::Enabled, Asked::SwitchOn) => Some(S::SwitchedOn),
            (S::SwitchedOn, Asked::Enable) if !self.refuses => Some(S::Enabled),
            _ => None,
        }
    }

    /// The drive switches itself off by an error.
    pub(crate) fn fail(&mut self, error: DriveError) {
        self.last_error = error as u32;
        self.enter(State::Fault);
    }

    /// True if the state changes.
    fn enter(&mut self, state: State) -> bool {
        let changes = state != self.state;
        if changes {
            if self.is_enabled() || state == State::Enabled {
                self.since_change = 0.0;
                self.since_set_point = 0.0;
            }
            self.state = state;
            self.waited = 0.0;
        }
        changes
    }
}

/// CiA 402, commands by the bits of the control word.
fn asked(word: u32) -> Option<Asked> {
    match word {
        w if w & 0x82 == 0x00 => Some(Asked::DisableVoltage),
        w if w & 0x86 == 0x02 => Some(Asked::QuickStop),
        w if w & 0x87 == 0x06 => Some(Asked::Shutdown),
        w if w & 0x8f == 0x07 => Some(Asked::SwitchOn),
        w if w & 0x8f == 0x0f => Some(Asked::Enable),
        _ => None,
    }
}
