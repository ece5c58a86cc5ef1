//! Numbered events: deviations, limits and faults while the loop runs.

/// The loop's reaction to an event; later ones are stronger. The last five latch a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Reaction {
    /// Counted; the cycle goes on with a bridged or limited value.
    Warn,
    /// The modes that need the sources which the event speaks against end, and are not possible while
    /// it lasts; other modes go on.
    Degrade,
    /// The client's reference is no longer followed: the robot holds until the client has asked
    /// for hold once.
    Release,
    /// The limb that a contact was detected on goes soft: weight compensated, motion damped, no
    /// stiffness; all other joints are brought to rest.
    Comply,
    /// That limb goes back on the way on which it came, away from the contact, and holds; all other
    /// joints are brought to rest.
    Retract,
    /// Every joint keeps its last command until the operator acknowledges the fault.
    Hold,
    /// Every joint is brought to rest by damping, then held.
    Stop,
    /// Commands end at once; drives that have states are switched off.
    Off,
}

impl Reaction {
    /// All reactions, the weakest first.
    pub const ALL: [Self; 8] = [
        Self::Warn,
        Self::Degrade,
        Self::Release,
        Self::Comply,
        Self::Retract,
        Self::Hold,
        Self::Stop,
        Self::Off,
    ];

    /// The name in lower case, as configurations write it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Warn => "warn",
            Self::Degrade => "degrade",
            Self::Release => "release",
            Self::Comply => "comply",
            Self::Retract => "retract",
            Self::Hold => "hold",
            Self::Stop => "stop",
            Self::Off => "off",
        }
    }

    /// The fault is latched.
    #[must_use]
    pub fn latches(self) -> bool {
        self >= Self::Comply
    }

    /// The limb yields to a contact, so that the event must be one.
    #[must_use]
    pub fn yields(self) -> bool {
        matches!(self, Self::Comply | Self::Retract)
    }
}

/// Bits of the sources that a mode may need and an event may speak against.
pub mod source {
    /// Torque from encoders and current (Z).
    pub const ENCODER_TORQUE: u32 = 1;
    /// F/T sensors, IMU and contact set, and what follows from them: the torque of D 2 and the
    /// motion of the base.
    pub const WHOLE_BODY: u32 = 1 << 1;
}

/// The bits of some sources.
macro_rules! bits {
    ($( $source:ident )*) => { 0 $( | source::$source )* };
}

/// The least reaction, which is the default one where none is given.
macro_rules! least {
    ($default:ident) => {
        Reaction::$default
    };
    ($default:ident $least:ident) => {
        Reaction::$least
    };
}

macro_rules! events {
    ($(
        $name:ident = $number:literal, $snake:literal,
        $reaction:ident $(from $least:ident)? $(against $($source:ident)+)?,
        $key:literal, $cause:literal;
    )*) => {
        /// A numbered event. Hundreds: 1 bus, 2 estimation, 3 client, 4 control, 5 timing.
        #[repr(u32)]
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
        pub enum Event {
            $( #[doc = concat!($cause, " Config key: `", $key, "`.")] $name = $number, )*
        }

        impl Event {
            /// Every event, in the order of their indices in a record's counts.
            pub const ALL: &'static [Event] = &[$( Event::$name, )*];

            /// The event's index in a record's counts.
            #[must_use]
            pub const fn index(self) -> usize {
                let mut i = 0;
                while i < Self::ALL.len() {
                    if Self::ALL[i] as u32 == self as u32 {
                        return i;
                    }
                    i += 1;
                }
                0
            }

            /// The event's number, as shown to operators.
            #[must_use]
            pub const fn number(self) -> u32 {
                self as u32
            }

            /// The event with that number.
            #[must_use]
            pub fn from_number(number: u32) -> Option<Self> {
                Self::ALL.iter().copied().find(|e| e.number() == number)
            }

            /// The event's name in snake case.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self { $( Event::$name => $snake, )* }
            }

            /// The occurrence, in a sentence for the operator.
            #[must_use]
            pub const fn cause(self) -> &'static str {
                match self { $( Event::$name => $cause, )* }
            }

            /// The config key that sets the event's limit, or `-`.
            #[must_use]
            pub const fn config_key(self) -> &'static str {
                match self { $( Event::$name => $key, )* }
            }

            /// The loop's reaction, where the configuration names no other.
            #[must_use]
            pub const fn reaction(self) -> Reaction {
                match self { $( Event::$name => Reaction::$reaction, )* }
            }

            /// The weakest reaction that a configuration may choose.
            #[must_use]
            pub const fn least_reaction(self) -> Reaction {
                match self { $( Event::$name => least!($reaction $($least)?), )* }
            }

            /// Bits of the sources ([`source`]) that the event speaks against.
            #[must_use]
            pub const fn against(self) -> u32 {
                match self { $( Event::$name => bits!($($($source)+)?), )* }
            }
        }
    };
}

events! {
    FrameUnknownId = 101, "frame_unknown_id", Warn, "-", "A frame arrived whose identifier is in no message of the DBC file.";
    FrameWrongLength = 102, "frame_wrong_length", Warn, "-", "A frame arrived whose length differs from that of its message in the DBC file.";
    JointMissed = 103, "joint_missed", Warn, "loop.gather_deadline_us", "A joint's answer was not complete at the gather deadline; its angles were extrapolated for this cycle.";
    JointStale = 104, "joint_stale", Hold, "loop.stale_after_ms", "A joint has sent no sample for longer than allowed.";
    SensorMissed = 105, "sensor_missed", Warn against WHOLE_BODY, "loop.gather_deadline_us", "An F/T sensor or the IMU sent no sample by the gather deadline or, if it has a clock of its own, for two of its periods.";
    BusErrorFrame = 106, "bus_error_frame", Warn, "-", "The CAN controller reported an error frame.";
    SendFailed = 107, "send_failed", Warn, "-", "A frame could not be sent on the bus.";
    ReceiveOverflow = 108, "receive_overflow", Warn, "-", "More frames arrived in one cycle than the receive buffer holds; the rest was lost.";
    SignalNotFinite = 109, "signal_not_finite", Warn, "-", "A received signal was NaN or infinite; the sample was not used.";
    SensorStale = 110, "sensor_stale", Degrade against WHOLE_BODY, "loop.stale_after_ms", "An F/T sensor or the IMU has sent no usable sample for longer than allowed.";
    FrameOutOfOrder = 111, "frame_out_of_order", Warn, "-", "A frame was received earlier than one of the same message that had been used already; it was not used.";
    BusDown = 112, "bus_down", Hold, "-", "A CAN controller went bus-off, or its interface is down or gone.";
    SendFailing = 113, "send_failing", Hold, "safety.send_failing_ms", "Frames could not be sent for longer than allowed.";
    SensorFlat = 114, "sensor_flat", Degrade against WHOLE_BODY, "ft_sensor.flat_after_ms / imu.flat_after_ms", "A value of an F/T sensor or the IMU has stayed the same for longer than its noise explains; its samples are not used.";
    SensorSaturated = 115, "sensor_saturated", Warn against WHOLE_BODY, "-", "A value of an F/T sensor or the IMU stands at an end of its range in the DBC file; such samples are not used.";
    DatagramRefused = 116, "datagram_refused", Warn, "bus.hop_limit", "A datagram on a UDP bus was no data frame of CAN, or came from another machine though the bus is limited to this one; it was not used.";
    ImuLost = 117, "imu_lost", Warn, "loop.stale_after_ms / imu.flat_after_ms", "An IMU beside the first one has sent no usable sample for longer than allowed: it neither checks the first one nor can stand in for it.";
    ImuDisagrees = 118, "imu_disagrees", Warn, "imu.disagreement_rad_per_s / imu.disagreement_m_per_s2", "An IMU disagrees with the first one about the base's motion, carried over by the joints between them, for longer than allowed: one of the two, or an encoder between them, errs.";
    ImuStandsIn = 119, "imu_stands_in", Warn, "loop.stale_after_ms", "The first IMU has sent no usable sample for longer than allowed; one that agreed with it until then stands in for it.";
    TorqueSaturated = 201, "torque_saturated", Warn against ENCODER_TORQUE WHOLE_BODY, "joint.torque_limit_Nm", "An estimated torque exceeded the joint's torque limit and was cut to it.";
    EncoderJump = 202, "encoder_jump", Warn, "drive.max_velocity_rad_per_s", "An encoder moved further in one cycle than the joint can; the sample was not used.";
    EstimateNotFinite = 203, "estimate_not_finite", Warn against ENCODER_TORQUE WHOLE_BODY, "-", "An estimated torque was NaN or infinite; the last one was kept and marked as not valid.";
    EncoderSlip = 204, "encoder_slip", Warn against ENCODER_TORQUE, "cross_check.encoder_per_cent", "The encoders of a joint disagree with F/T sensors and motor current for longer than allowed: an encoder has probably slipped.";
    FtDrift = 205, "ft_drift", Warn against WHOLE_BODY, "cross_check.encoder_per_cent", "An F/T sensor disagrees with the encoders of all joints that depend on it: the sensor has probably drifted.";
    TorqueConstant = 206, "torque_constant", Warn against ENCODER_TORQUE, "cross_check.current_ratio_min / cross_check.current_ratio_max", "Motor current and encoders disagree on the torque's size: the joint's torque constant is probably wrong.";
    TorqueSign = 207, "torque_sign", Warn against ENCODER_TORQUE, "cross_check.current_load_per_cent", "Motor current and encoders disagree on the torque's sign: the sign of the joint's current is probably wrong.";
    MissingContact = 208, "missing_contact", Warn against WHOLE_BODY, "cross_check.residual_sigmas", "Contact detected on the limb beyond an F/T sensor, where the contact set has none.";
    ExternalContact = 209, "external_contact", Warn, "external_torque.upper_ratio", "A joint's external torque exceeds its upper threshold: contact where the contact set has none.";
    EncoderImplausible = 210, "encoder_implausible", Hold, "joint.torque_limit_Nm", "The two encoders of a joint differ by more than its gear can wind up, or one of them has jumped: one of them is wrong.";
    CurrentImplausible = 211, "current_implausible", Degrade against ENCODER_TORQUE, "drive.current_sigma_A / drive.flat_after_ms", "The motor current of a joint whose drive is enabled has stayed the same for longer than its noise explains, or stands at an end of its range in the DBC file.";
    SourcesDisagree = 212, "sources_disagree", Warn against ENCODER_TORQUE, "-", "For seconds the torques of a joint by torsion and by motor current have differed by more than their calibrations allow: a calibration no longer holds, or an encoder has slipped. The published sigma covers the difference.";
    FtImplausible = 213, "ft_implausible", Warn against WHOLE_BODY, "-", "The torque of a joint without a link-side encoder by F/T sensors and IMU has changed otherwise than its motor current, by more than friction explains: a sensor errs, or something touches the limb where no sensor measures it. The torque is not fed back until both agree again, or the sensor is tared.";
    TorqueDrift = 214, "torque_drift", Release from Warn, "-", "The torque by torsion and that from F/T sensors and IMU drift apart at a joint that stands and that only a torque holds. An encoder or an F/T sensor drifts, or something presses slowly where no sensor measures it.";
    ReferenceNotFinite = 301, "reference_not_finite", Release, "-", "A client's reference contained NaN or infinity.";
    ReferenceStale = 302, "reference_stale", Release, "loop.reference_timeout_ms", "The commanding client stopped sending references.";
    ReferenceRejected = 303, "reference_rejected", Release, "-", "A client's reference had an unknown mode or the wrong number of joints, or let a joint go that bears a contact. Or a robot was to stand whose feet cannot hold it, or whose IMU shows the ground turning.";
    ReferenceJump = 304, "reference_jump", Release, "joint.velocity_limit_rad_per_s", "A client's desired position was far from the pose at its start, or moved faster than the joint may.";
    CommanderRefused = 305, "commander_refused", Warn, "loop.reference_timeout_ms", "A client's reference was refused: another client has the command, or it came from an older session, out of order or too late.";
    CommanderReplaced = 306, "commander_replaced", Release, "-", "A client of higher priority took the command over.";
    ReferenceLimit = 307, "reference_limit", Release, "joint.torque_limit_Nm / joint.velocity_limit_rad_per_s", "A client's reference asked for a value beyond what joint or sensor can have, or for a velocity that its positions do not make.";
    TrajectoryEnded = 308, "trajectory_ended", Warn, "-", "A client's trajectory ended in motion, as no further piece of it had come; the joints were brought to rest.";
    TrajectoryRefused = 309, "trajectory_refused", Warn, "joint.velocity_limit_rad_per_s / joint.torque_limit_Nm", "A piece of a client's trajectory was refused; what was buffered before stands.";
    PositionLimit = 401, "position_limit", Warn, "joint.position_min_deg / joint.position_max_deg", "A commanded position, or its lead over the measured position, was limited.";
    TorqueLimit = 402, "torque_limit", Warn, "joint.torque_limit_Nm", "A commanded torque or current was limited, its rate by more than noise.";
    CommandNotFinite = 403, "command_not_finite", Hold, "-", "A computed command was NaN or infinite; the last command was kept.";
    EnableTimeOut = 404, "enable_time_out", Off, "safety.time_limit_ms / drive.state.step_time_limit_ms", "A drive did not reach the state that was asked of it within the time allowed.";
    VelocityLimit = 405, "velocity_limit", Warn, "joint.velocity_limit_rad_per_s / joint.power_limit_W", "A command was limited to the joint's velocity or power.";
    DriveFault = 406, "drive_fault", Hold, "drive.state", "A drive reports a fault of its own; its set-points are withdrawn.";
    DriveLost = 407, "drive_lost", Hold, "drive.state", "A drive is no longer enabled though nobody switched it off (emergency stop, power); its set-points are withdrawn.";
    FollowingError = 408, "following_error", Hold, "joint.following_error_deg / joint.following_error_A", "A drive does not follow its set-points: torque, velocity and position show another one. Its set-points are withdrawn: it is switched off or bears its joint.";
    Overspeed = 409, "overspeed", Stop from Hold, "joint.velocity_limit_rad_per_s", "A joint moves at more than 1.25 times its velocity limit, by both encoders.";
    FollowingDoubtful = 410, "following_doubtful", Hold, "-", "While a client's torque was followed, a drive's torque, velocity and position showed another set-point than was sent: it does not follow, or both encoders of its joint err alike.";
    DriveUnguarded = 411, "drive_unguarded", Off, "drive.state.time_out_set", "A drive's own time limit for set-points is off: if the bus broke it would go on with the last one. It is not enabled.";
    CommandDelay = 412, "command_delay", Warn, "control.command_delay_us", "The delay from a command to its effect, as measured, is another one than configured: torque control may ring.";
    DriveUnlike = 413, "drive_unlike", Warn, "drive.motor.K_tau_rad_per_Nm / drive.motor.K_v_s", "While a client's torque was followed, a drive's current showed another stiffness or damping of its position loop than configured, by more than torque control corrects: it may ring, and its margins are not those that were computed.";
    HoldSwings = 414, "hold_swings", Hold, "joint.gains / filters.control", "A joint that is held swings, and its motor does the work: the hold's gains are too high for its inertia and the delay of its velocities. It is braked, no longer held by its gains, and left to its brake where it has one.";
    DriveHot = 415, "drive_hot", Warn, "drive.thermal", "A drive is hot, or its current has been too high for too long: its joint's torque limit falls towards the torque of its continuous current.";
    DriveOverheated = 416, "drive_overheated", Stop from Warn, "drive.thermal", "A drive is as hot as it may be, or its current has stayed above the continuous one.";
    DriveIntegrates = 417, "drive_integrates", Hold, "drive.motor.integral_time_ms", "A drive makes torque without a lead of its set-point over its motor: its velocity loop has an integral, of which the configuration says nothing. Torque control would be wrong by as much.";
    LateCycle = 501, "late_cycle", Warn, "loop.rate_hz", "A cycle ended after the next one should have begun.";
    SkippedCycle = 502, "skipped_cycle", Warn, "loop.rate_hz", "A cycle was left out because the one before it ended too late.";
    LatenessLasts = 503, "lateness_lasts", Stop, "safety.late_per_cent", "Within a second, a greater share of cycles was late or left out than allowed.";
    PublisherGone = 504, "publisher_gone", Stop, "safety.publisher_timeout_ms", "The thread that serves clients no longer runs: no client can be heard.";
    LoopEnded = 505, "loop_ended", Off, "-", "The loop's thread ended by a defect of the program.";
}

/// Number of events: the length of a record's counts.
pub const EVENT_COUNT: usize = Event::ALL.len();

impl Event {
    /// The reactions that a configuration may choose: none weaker than the least one, `degrade` only
    /// where the event speaks against a source, and those that yield only where it is a contact.
    pub fn allowed_reactions(self) -> impl Iterator<Item = Reaction> {
        let strong = move |reaction: &Reaction| *reaction >= self.least_reaction();
        let possible = move |reaction: &Reaction| match reaction {
            Reaction::Degrade => self.against() != 0,
            Reaction::Comply | Reaction::Retract => self == Self::ExternalContact,
            _ => true,
        };
        let all = Reaction::ALL.into_iter();
        all.filter(strong).filter(possible)
    }
}

/// The reaction to each event.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Reactions([Reaction; EVENT_COUNT]);

impl Default for Reactions {
    fn default() -> Self {
        let mut reactions = [Reaction::Warn; EVENT_COUNT];
        for (reaction, event) in reactions.iter_mut().zip(Event::ALL) {
            *reaction = event.reaction();
        }
        Self(reactions)
    }
}

impl Reactions {
    /// The reaction to an event.
    #[must_use]
    pub fn of(&self, event: Event) -> Reaction {
        self.0
            .get(event.index())
            .copied()
            .unwrap_or(event.reaction())
    }

    /// Chooses the reaction to an event; false if it is not among those that are allowed.
    #[must_use]
    pub fn choose(&mut self, event: Event, reaction: Reaction) -> bool {
        let allowed = event.allowed_reactions().any(|r| r == reaction);
        if let Some(chosen) = self.0.get_mut(event.index()).filter(|_| allowed) {
            *chosen = reaction;
        }
        allowed
    }
}

#[cfg(test)]
mod tests {
    use super::{Event, Reaction, Reactions, source};

    /// The table of events as the safety page has it.
    fn table() -> String {
        let head = "| event | reaction | least | speaks against | occurrence | set by |\n\
                    | --- | --- | --- | --- | --- | --- |\n";
        let rows = Event::ALL.iter().map(|event| {
            let key = match event.config_key() {
                "-" => String::new(),
                key => format!("`{key}`"),
            };
            let sources = [
                (source::ENCODER_TORQUE, "torque from encoders"),
                (source::WHOLE_BODY, "F/T sensors and IMU"),
            ];
            let against = sources
                .into_iter()
                .filter(|(bit, _)| event.against() & bit != 0);
            let against: Vec<&str> = against.map(|(_, name)| name).collect();
            format!(
                "| {} `{}` | {} | {} | {} | {} | {key} |\n",
                event.number(),
                event.name(),
                event.reaction().name(),
                event.least_reaction().name(),
                against.join("; "),
                event.cause(),
            )
        });
        head.to_owned() + &rows.collect::<String>()
    }

    #[test]
    fn the_safety_page_has_the_table_of_events() {
        let page = include_str!("../../../docs/safety.md");
        let table = table();
        assert!(
            page.contains(&table),
            "docs/safety.md is to contain:\n{table}"
        );
    }

    #[test]
    fn a_reaction_is_never_weaker_than_the_least_one() {
        let mut reactions = Reactions::default();
        for &event in Event::ALL {
            assert!(event.reaction() >= event.least_reaction(), "{event:?}");
            assert!(
                event.allowed_reactions().any(|r| r == event.reaction()),
                "{event:?}"
            );
            for reaction in Reaction::ALL {
                let chosen = reactions.choose(event, reaction);
                assert!(!chosen || reaction >= event.least_reaction());
                assert!(reactions.of(event) >= event.least_reaction());
            }
            assert_eq!(
                reactions.of(event),
                Reaction::Off,
                "the strongest, chosen last"
            );
        }
    }

    #[test]
    fn numbers_are_unique_and_indices_run_in_order() {
        for (i, event) in Event::ALL.iter().enumerate() {
            assert_eq!(event.index(), i);
            assert_eq!(Event::from_number(event.number()), Some(*event));
        }
        assert_eq!(Event::from_number(0), None);
    }
}
