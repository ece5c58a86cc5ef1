//! Numbered events: deviations, limits and faults while the loop runs.

/// The loop's reaction to an event; later ones are stronger. The last three latch a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Reaction {
    /// Counted; the cycle goes on with a bridged or limited value.
    Warn,
    /// The client's reference is no longer followed: the robot holds until the client has asked
    /// for hold once.
    Release,
    /// Every joint keeps its last command until the operator acknowledges the fault.
    Hold,
    /// Every joint is brought to rest by damping, then held.
    Stop,
    /// Commands end at once; drives that have states are switched off.
    Off,
}

impl Reaction {
    /// The fault is latched.
    #[must_use]
    pub fn latches(self) -> bool {
        self >= Self::Hold
    }
}

macro_rules! events {
    ($( $name:ident = $number:literal, $snake:literal, $reaction:ident, $key:literal, $cause:literal; )*) => {
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

            /// The loop's reaction.
            #[must_use]
            pub const fn reaction(self) -> Reaction {
                match self { $( Event::$name => Reaction::$reaction, )* }
            }
        }
    };
}

events! {
    FrameUnknownId = 101, "frame_unknown_id", Warn, "-", "A frame arrived whose identifier is in no message of the DBC file.";
    FrameWrongLength = 102, "frame_wrong_length", Warn, "-", "A frame arrived whose length differs from that of its message in the DBC file.";
    JointMissed = 103, "joint_missed", Warn, "loop.gather_deadline_us", "A joint's answer was not complete at the gather deadline; its angles were extrapolated for this cycle.";
    JointStale = 104, "joint_stale", Hold, "loop.stale_after_ms", "A joint has sent no sample for longer than allowed.";
    SensorMissed = 105, "sensor_missed", Warn, "loop.gather_deadline_us", "An F/T sensor or the IMU sent no sample by the gather deadline or, if it has a clock of its own, for two of its periods.";
    BusErrorFrame = 106, "bus_error_frame", Warn, "-", "The CAN controller reported an error frame.";
    SendFailed = 107, "send_failed", Warn, "-", "A frame could not be sent on the bus.";
    ReceiveOverflow = 108, "receive_overflow", Warn, "-", "More frames arrived in one cycle than the receive buffer holds; the rest was lost.";
    SignalNotFinite = 109, "signal_not_finite", Warn, "-", "A received signal was NaN or infinite; the sample was not used.";
    SensorStale = 110, "sensor_stale", Release, "loop.stale_after_ms", "An F/T sensor or the IMU has sent no usable sample for longer than allowed; a mode that needs it ends.";
    FrameOutOfOrder = 111, "frame_out_of_order", Warn, "-", "A frame was received earlier than one of the same message that had been used already; it was not used.";
    BusDown = 112, "bus_down", Hold, "-", "A CAN controller went bus-off, or its interface is down or gone.";
    SendFailing = 113, "send_failing", Hold, "safety.send_failing_ms", "Frames could not be sent for longer than allowed.";
    TorqueSaturated = 201, "torque_saturated", Warn, "joint.torque_limit_Nm", "An estimated torque exceeded the joint's torque limit and was cut to it.";
    EncoderJump = 202, "encoder_jump", Warn, "drive.max_velocity_rad_per_s", "An encoder moved further in one cycle than the joint can; the sample was not used.";
    EstimateNotFinite = 203, "estimate_not_finite", Warn, "-", "An estimated torque was NaN or infinite; the last one was kept and marked as not valid.";
    EncoderSlip = 204, "encoder_slip", Warn, "cross_check.encoder_per_cent", "The encoders of a joint disagree with F/T sensors and motor current for longer than allowed: an encoder has probably slipped.";
    FtDrift = 205, "ft_drift", Warn, "cross_check.encoder_per_cent", "An F/T sensor disagrees with the encoders of all joints that depend on it: the sensor has probably drifted.";
    TorqueConstant = 206, "torque_constant", Warn, "cross_check.current_ratio_min / cross_check.current_ratio_max", "Motor current and encoders disagree on the torque's size: the joint's torque constant is probably wrong.";
    TorqueSign = 207, "torque_sign", Warn, "cross_check.current_load_per_cent", "Motor current and encoders disagree on the torque's sign: the sign of the joint's current is probably wrong.";
    MissingContact = 208, "missing_contact", Warn, "cross_check.residual_sigmas", "Contact detected on the limb beyond an F/T sensor, where the contact set has none.";
    ExternalContact = 209, "external_contact", Warn, "external_torque.threshold_per_cent", "Contact detected by a joint's external torque, where the contact set has none.";
    EncoderImplausible = 210, "encoder_implausible", Hold, "joint.torque_limit_Nm", "The two encoders of a joint differ by more than its gear can wind up, or one of them has jumped: one of them is wrong.";
    ReferenceNotFinite = 301, "reference_not_finite", Release, "-", "A client's reference contained NaN or infinity.";
    ReferenceStale = 302, "reference_stale", Release, "loop.reference_timeout_ms", "The commanding client stopped sending references.";
    ReferenceRejected = 303, "reference_rejected", Release, "-", "A client's reference had an unknown mode or the wrong number of joints.";
    ReferenceJump = 304, "reference_jump", Release, "joint.velocity_limit_rad_per_s", "A client's desired position was far from the pose at its start, or moved faster than the joint may.";
    PositionLimit = 401, "position_limit", Warn, "joint.position_min_deg / joint.position_max_deg", "A commanded position, or its lead over the measured position, was limited.";
    TorqueLimit = 402, "torque_limit", Warn, "joint.torque_limit_Nm", "A commanded torque or current was limited.";
    CommandNotFinite = 403, "command_not_finite", Hold, "-", "A computed command was NaN or infinite; the last command was kept.";
    EnableTimeOut = 404, "enable_time_out", Off, "safety.time_limit_ms / drive.state.step_time_limit_ms", "A drive did not reach the state that was asked of it within the time allowed.";
    VelocityLimit = 405, "velocity_limit", Warn, "joint.velocity_limit_rad_per_s / joint.power_limit_W", "A command was limited to the joint's velocity or power.";
    DriveFault = 406, "drive_fault", Hold, "drive.state", "A drive reports a fault of its own; its set-points are withdrawn.";
    DriveLost = 407, "drive_lost", Hold, "drive.state", "A drive is no longer enabled though nobody switched it off (emergency stop, power); its set-points are withdrawn.";
    LateCycle = 501, "late_cycle", Warn, "loop.rate_hz", "A cycle ended after the next one should have begun.";
    SkippedCycle = 502, "skipped_cycle", Warn, "loop.rate_hz", "A cycle was left out because the one before it ended too late.";
    LatenessLasts = 503, "lateness_lasts", Stop, "safety.late_per_cent", "Within a second, a greater share of cycles was late or left out than allowed.";
    PublisherGone = 504, "publisher_gone", Stop, "safety.publisher_timeout_ms", "The thread that serves clients no longer runs: no client can be heard.";
    LoopEnded = 505, "loop_ended", Off, "-", "The loop's thread ended by a defect of the program.";
}

/// Number of events: the length of a record's counts.
pub const EVENT_COUNT: usize = Event::ALL.len();

#[cfg(test)]
mod tests {
    use super::Event;

    #[test]
    fn numbers_are_unique_and_indices_run_in_order() {
        for (i, event) in Event::ALL.iter().enumerate() {
            assert_eq!(event.index(), i);
            assert_eq!(Event::from_number(event.number()), Some(*event));
        }
        assert_eq!(Event::from_number(0), None);
    }
}
