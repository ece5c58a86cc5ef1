//! States of the robot and of its drives, as an operator sees them.

/// State of the robot.
#[repr(u32)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash)]
pub enum RobotState {
    /// Listening: not every joint has sent plausible samples yet.
    #[default]
    Boot = 0,
    /// All joints are plausible; drives are off, no set-points are sent.
    Ready = 1,
    /// Drives are being switched on.
    Enabling = 2,
    /// Every joint is held where it stands.
    Holding = 3,
    /// A client's mode is active.
    Active = 4,
    /// The robot is being brought to rest.
    Stopping = 5,
    /// A fault is latched; it is held, stopped or off, as the fault demands.
    Fault = 6,
}

impl RobotState {
    /// All states, in the order of their numbers.
    pub const ALL: [Self; 7] = [
        Self::Boot,
        Self::Ready,
        Self::Enabling,
        Self::Holding,
        Self::Active,
        Self::Stopping,
        Self::Fault,
    ];

    /// The number that records carry.
    #[must_use]
    pub const fn number(self) -> u32 {
        self as u32
    }

    /// The state of that number.
    #[must_use]
    pub fn from_number(number: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|state| state.number() == number)
    }

    /// The name in lower case, as shown to operators.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Boot => "boot",
            Self::Ready => "ready",
            Self::Enabling => "enabling",
            Self::Holding => "holding",
            Self::Active => "active",
            Self::Stopping => "stopping",
            Self::Fault => "fault",
        }
    }
}

/// State of a drive, by its status word.
#[repr(u32)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash)]
pub enum DriveState {
    /// No status word has arrived, or none that the drive's profile knows.
    #[default]
    Unknown = 0,
    /// No power, or not initialised (CiA 402: not ready to switch on, switch on disabled).
    Off = 1,
    /// CiA 402: ready to switch on.
    ReadyToSwitchOn = 2,
    /// CiA 402: switched on; no torque yet.
    SwitchedOn = 3,
    /// CiA 402: operation enabled; the drive follows its set-points.
    Enabled = 4,
    /// The drive stops by itself (CiA 402: quick stop active, fault reaction active).
    Stopping = 5,
    /// The drive has latched a fault of its own.
    Fault = 6,
}

impl DriveState {
    /// All states, in the order of their numbers.
    pub const ALL: [Self; 7] = [
        Self::Unknown,
        Self::Off,
        Self::ReadyToSwitchOn,
        Self::SwitchedOn,
        Self::Enabled,
        Self::Stopping,
        Self::Fault,
    ];

    /// The number that records carry.
    #[must_use]
    pub const fn number(self) -> u32 {
        self as u32
    }

    /// The state of that number.
    #[must_use]
    pub fn from_number(number: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|state| state.number() == number)
    }

    /// The name in snake case, as configurations write it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Unknown => "unknown",
            Self::Off => "off",
            Self::ReadyToSwitchOn => "ready_to_switch_on",
            Self::SwitchedOn => "switched_on",
            Self::Enabled => "enabled",
            Self::Stopping => "stopping",
            Self::Fault => "fault",
        }
    }
}
