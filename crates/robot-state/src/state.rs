//! States of the robot and of its drives, as an operator sees them.

/// An enum whose variants have a number, which records carry, and a name, which operators read.
macro_rules! states {
    (
        $(#[$about:meta])*
        $states:ident { $($(#[$doc:meta])* $state:ident = $number:literal, $name:literal;)* }
    ) => {
        $(#[$about])*
        #[repr(u32)]
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash)]
        pub enum $states {
            $($(#[$doc])* $state = $number,)*
        }

        impl $states {
            /// All states, in the order of their numbers.
            pub const ALL: &'static [Self] = &[$(Self::$state,)*];

            /// The number that records carry.
            #[must_use]
            pub const fn number(self) -> u32 {
                self as u32
            }

            /// The state of that number.
            #[must_use]
            pub fn from_number(number: u32) -> Option<Self> {
                Self::ALL.iter().copied().find(|state| state.number() == number)
            }

            /// The name in snake case, as operators and configurations have it.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$state => $name,)*
                }
            }
        }
    };
}

states! {
    /// State of the robot.
    RobotState {
        /// Listening: not every joint has sent plausible samples yet.
        #[default]
        Boot = 0, "boot";
        /// All joints are plausible; drives are off, no set-points are sent.
        Ready = 1, "ready";
        /// Drives are being switched on.
        Enabling = 2, "enabling";
        /// Every joint is held where it stands.
        Holding = 3, "holding";
        /// A client's mode is active.
        Active = 4, "active";
        /// The robot is being brought to rest.
        Stopping = 5, "stopping";
        /// A fault is latched; it is held, stopped or off, as the fault demands.
        Fault = 6, "fault";
    }
}

states! {
    /// State of a drive, by its status word.
    DriveState {
        /// No status word has arrived, or none that the drive's profile knows.
        #[default]
        Unknown = 0, "unknown";
        /// No power, or not initialised (CiA 402: not ready to switch on, switch on disabled).
        Off = 1, "off";
        /// CiA 402: ready to switch on.
        ReadyToSwitchOn = 2, "ready_to_switch_on";
        /// CiA 402: switched on; no torque yet.
        SwitchedOn = 3, "switched_on";
        /// CiA 402: operation enabled; the drive follows its set-points.
        Enabled = 4, "enabled";
        /// The drive stops by itself (CiA 402: quick stop active, fault reaction active).
        Stopping = 5, "stopping";
        /// The drive has latched a fault of its own.
        Fault = 6, "fault";
    }
}
