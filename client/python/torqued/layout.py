"""The records in shared memory: SI units, config order. Generated, do not edit:

    cargo run -p torqued-client --example generate_python_layout > client/python/torqued/layout.py
"""

import ctypes
from enum import IntEnum, IntFlag
from typing import NamedTuple

MAX_JOINTS = 64
MAX_FT_SENSORS = 8
MAX_FURTHER_IMUS = 3
MAX_POINTS = 32
MAX_FRAMES = 4
EVENT_COUNT = 64


class Mode(IntEnum):
    """Mode of the robot."""

    HOLD = 0
    TORQUE = 1
    INVERSE_DYNAMICS = 2
    POSITION = 3
    CARTESIAN = 4
    PASSIVE = 5
    TORQUE_FEEDBACK_MOTION = 6
    LOW_GAIN_TRACKING = 7
    VELOCITY = 8
    STAND = 9


class JointKind(IntEnum):
    """Kind of a joint: of a prismatic one m stands for rad and N for N·m on the link side."""

    REVOLUTE = 0
    PRISMATIC = 1


class TorqueSource(IntEnum):
    """Source of a torque estimate."""

    NONE = 0
    ENCODER = 1
    WHOLE_BODY = 2
    CURRENT = 3
    FUSED = 4


class MeasuredFlags(IntFlag):
    """Flag bits of measured values."""

    MISSED = 1
    STALE = 2
    JUMP = 4
    NEVER = 8
    SETTLING = 16
    IMPLAUSIBLE = 32
    FLAT = 64
    SATURATED = 128
    STANDS_IN = 256


class TorqueFlags(IntFlag):
    """Flag bits of a torque estimate."""

    VALID = 1
    SATURATED = 2
    DEGRADED = 4


class RobotState(IntEnum):
    """State of the robot."""

    BOOT = 0
    READY = 1
    ENABLING = 2
    HOLDING = 3
    ACTIVE = 4
    STOPPING = 5
    FAULT = 6


class CommandFlags(IntFlag):
    """Flag bits of a joint's command."""

    POSITION_LIMITED = 1
    TORQUE_LIMITED = 2
    LEAD_LIMITED = 4
    VELOCITY_LIMITED = 8
    TORQUE_RATE_LIMITED = 16
    POWER_LIMITED = 32
    NOT_FINITE = 64
    ENGAGED = 128
    RATE_TRIMMED = 256


class RequestKind(IntEnum):
    """Kind of a request."""

    TARE = 1
    SHOW_TARE = 2
    FORGET_TARE = 3
    CHOOSE_CONTACT_SET = 4
    AUTOMATIC_CONTACT_SET = 5
    ENABLE = 6
    DISABLE = 7
    STOP = 8
    ACKNOWLEDGE = 9


class AnswerStatus(IntEnum):
    """Progress of a request."""

    WORKING = 1
    DONE = 2
    REFUSED = 3


class LeaseRefusal(IntEnum):
    """Reason for which a reference was refused."""

    HELD = 1
    HOLD_FIRST = 2
    OLD_SESSION = 3
    NOT_ADVANCED = 4
    TOO_OLD = 5
    INVALID = 6


class FrameFlags(IntFlag):
    """Flag bits of a frame in mode Cartesian."""

    VALID = 1
    ACTIVE = 2
    WRENCH_LIMITED = 4
    GAINS_LIMITED = 8
    FORCE_KNOWN = 16
    LED = 32


class NotFollowed(IntEnum):
    """Reason for which no mode of the commander is followed."""

    FAULT = 1
    STATE = 2
    HOLD_FIRST = 3
    NOT_READY = 4
    NOT_POSSIBLE = 5


class PieceRefusal(IntEnum):
    """Reason for which a piece of a trajectory was refused."""

    SESSION = 1
    INVALID = 2
    LIMIT = 3
    NOT_ADVANCED = 4
    LATE = 5
    GAP = 6
    APART = 7
    TOO_FAR = 8
    BUSY = 9


class Event(NamedTuple):
    """A numbered event."""

    number: int
    name: str
    cause: str
    config_key: str
    reaction: str


#: In the order of `CycleRecord.events`.
EVENTS = (
    Event(101, "frame_unknown_id", "A frame arrived whose identifier is in no message of the DBC file.", "-", "warn"),
    Event(102, "frame_wrong_length", "A frame arrived whose length differs from that of its message in the DBC file.", "-", "warn"),
    Event(103, "joint_missed", "A joint's answer was not complete at the gather deadline; its angles were extrapolated for this cycle.", "loop.gather_deadline_us", "warn"),
    Event(104, "joint_stale", "A joint has sent no sample for longer than allowed.", "loop.stale_after_ms", "hold"),
    Event(105, "sensor_missed", "An F/T sensor or the IMU sent no sample by the gather deadline or, if it has a clock of its own, for two of its periods.", "loop.gather_deadline_us", "warn"),
    Event(106, "bus_error_frame", "The CAN controller reported an error frame.", "-", "warn"),
    Event(107, "send_failed", "A frame could not be sent on the bus.", "-", "warn"),
    Event(108, "receive_overflow", "More frames arrived in one cycle than the receive buffer holds; the rest was lost.", "-", "warn"),
    Event(109, "signal_not_finite", "A received signal was NaN or infinite; the sample was not used.", "-", "warn"),
    Event(110, "sensor_stale", "An F/T sensor or the IMU has sent no usable sample for longer than allowed.", "loop.stale_after_ms", "degrade"),
    Event(111, "frame_out_of_order", "A frame was received earlier than one of the same message that had been used already; it was not used.", "-", "warn"),
    Event(112, "bus_down", "A CAN controller went bus-off, or its interface is down or gone.", "-", "hold"),
    Event(113, "send_failing", "Frames could not be sent for longer than allowed.", "safety.send_failing_ms", "hold"),
    Event(114, "sensor_flat", "A value of an F/T sensor or the IMU has stayed the same for longer than its noise explains; its samples are not used.", "ft_sensor.flat_after_ms / imu.flat_after_ms", "degrade"),
    Event(115, "sensor_saturated", "A value of an F/T sensor or the IMU stands at an end of its range in the DBC file; such samples are not used.", "-", "warn"),
    Event(116, "datagram_refused", "A datagram on a UDP bus was no data frame of CAN, or came from another machine though the bus is limited to this one; it was not used.", "bus.hop_limit", "warn"),
    Event(117, "imu_lost", "An IMU beside the first one has sent no usable sample for longer than allowed: it neither checks the first one nor can stand in for it.", "loop.stale_after_ms / imu.flat_after_ms", "warn"),
    Event(118, "imu_disagrees", "An IMU disagrees with the first one about the base's motion, carried over by the joints between them, for longer than allowed: one of the two, or an encoder between them, errs.", "imu.disagreement_rad_per_s / imu.disagreement_m_per_s2", "warn"),
    Event(119, "imu_stands_in", "The first IMU has sent no usable sample for longer than allowed; one that agreed with it until then stands in for it.", "loop.stale_after_ms", "warn"),
    Event(201, "torque_saturated", "An estimated torque exceeded the joint's torque limit and was cut to it.", "joint.torque_limit_Nm", "warn"),
    Event(202, "encoder_jump", "An encoder moved further in one cycle than the joint can; the sample was not used.", "drive.max_velocity_rad_per_s", "warn"),
    Event(203, "estimate_not_finite", "An estimated torque was NaN or infinite; the last one was kept and marked as not valid.", "-", "warn"),
    Event(204, "encoder_slip", "The encoders of a joint disagree with F/T sensors and motor current for longer than allowed: an encoder has probably slipped.", "cross_check.encoder_per_cent", "warn"),
    Event(205, "ft_drift", "An F/T sensor disagrees with the encoders of all joints that depend on it: the sensor has probably drifted.", "cross_check.encoder_per_cent", "warn"),
    Event(206, "torque_constant", "Motor current and encoders disagree on the torque's size: the joint's torque constant is probably wrong.", "cross_check.current_ratio_min / cross_check.current_ratio_max", "warn"),
    Event(207, "torque_sign", "Motor current and encoders disagree on the torque's sign: the sign of the joint's current is probably wrong.", "cross_check.current_load_per_cent", "warn"),
    Event(208, "missing_contact", "Contact detected on the limb beyond an F/T sensor, where the contact set has none.", "cross_check.residual_sigmas", "warn"),
    Event(209, "external_contact", "A joint's external torque exceeds its upper threshold: contact where the contact set has none.", "external_torque.upper_ratio", "warn"),
    Event(210, "encoder_implausible", "The two encoders of a joint differ by more than its gear can wind up, or one of them has jumped: one of them is wrong.", "joint.torque_limit_Nm", "hold"),
    Event(211, "current_implausible", "The motor current of a joint whose drive is enabled has stayed the same for longer than its noise explains, or stands at an end of its range in the DBC file.", "drive.current_sigma_A / drive.flat_after_ms", "degrade"),
    Event(212, "sources_disagree", "For seconds the torques of a joint by torsion and by motor current have differed by more than their calibrations allow: a calibration no longer holds, or an encoder has slipped. The published sigma covers the difference.", "-", "warn"),
    Event(213, "ft_implausible", "The torque of a joint without a link-side encoder by F/T sensors and IMU has changed otherwise than its motor current, by more than friction explains: a sensor errs, or something touches the limb where no sensor measures it. The torque is not fed back until both agree again, or the sensor is tared.", "-", "warn"),
    Event(214, "torque_drift", "The torque by torsion and that from F/T sensors and IMU drift apart at a joint that stands and that only a torque holds. An encoder or an F/T sensor drifts, or something presses slowly where no sensor measures it.", "-", "release"),
    Event(301, "reference_not_finite", "A client's reference contained NaN or infinity.", "-", "release"),
    Event(302, "reference_stale", "The commanding client stopped sending references.", "loop.reference_timeout_ms", "release"),
    Event(303, "reference_rejected", "A client's reference had an unknown mode or the wrong number of joints, or let a joint go that bears a contact. Or a robot was to stand whose feet cannot hold it, or whose IMU shows the ground turning.", "-", "release"),
    Event(304, "reference_jump", "A client's desired position was far from the pose at its start, or moved faster than the joint may.", "joint.velocity_limit_rad_per_s", "release"),
    Event(305, "commander_refused", "A client's reference was refused: another client has the command, or it came from an older session, out of order or too late.", "loop.reference_timeout_ms", "warn"),
    Event(306, "commander_replaced", "A client of higher priority took the command over.", "-", "release"),
    Event(307, "reference_limit", "A client's reference asked for a value beyond what joint or sensor can have, or for a velocity that its positions do not make.", "joint.torque_limit_Nm / joint.velocity_limit_rad_per_s", "release"),
    Event(308, "trajectory_ended", "A client's trajectory ended in motion, as no further piece of it had come; the joints were brought to rest.", "-", "warn"),
    Event(309, "trajectory_refused", "A piece of a client's trajectory was refused; what was buffered before stands.", "joint.velocity_limit_rad_per_s / joint.torque_limit_Nm", "warn"),
    Event(401, "position_limit", "A commanded position, or its lead over the measured position, was limited.", "joint.position_min_deg / joint.position_max_deg", "warn"),
    Event(402, "torque_limit", "A commanded torque or current was limited, its rate by more than noise.", "joint.torque_limit_Nm", "warn"),
    Event(403, "command_not_finite", "A computed command was NaN or infinite; the last command was kept.", "-", "hold"),
    Event(404, "enable_time_out", "A drive did not reach the state that was asked of it within the time allowed.", "safety.time_limit_ms / drive.state.step_time_limit_ms", "off"),
    Event(405, "velocity_limit", "A command was limited to the joint's velocity or power.", "joint.velocity_limit_rad_per_s / joint.power_limit_W", "warn"),
    Event(406, "drive_fault", "A drive reports a fault of its own; its set-points are withdrawn.", "drive.state", "hold"),
    Event(407, "drive_lost", "A drive is no longer enabled though nobody switched it off (emergency stop, power); its set-points are withdrawn.", "drive.state", "hold"),
    Event(408, "following_error", "A drive does not follow its set-points: torque, velocity and position show another one. Its set-points are withdrawn: it is switched off or bears its joint.", "joint.following_error_deg / joint.following_error_A", "hold"),
    Event(409, "overspeed", "A joint moves at more than 1.25 times its velocity limit, by both encoders.", "joint.velocity_limit_rad_per_s", "stop"),
    Event(410, "following_doubtful", "While a client's torque was followed, a drive's torque, velocity and position showed another set-point than was sent: it does not follow, or both encoders of its joint err alike.", "-", "hold"),
    Event(411, "drive_unguarded", "A drive's own time limit for set-points is off: if the bus broke it would go on with the last one. It is not enabled.", "drive.state.time_out_set", "off"),
    Event(412, "command_delay", "The delay from a command to its effect, as measured, is another one than configured: torque control may ring.", "control.command_delay_us", "warn"),
    Event(413, "drive_unlike", "While a client's torque was followed, a drive's current showed another stiffness or damping of its position loop than configured, by more than torque control corrects: it may ring, and its margins are not those that were computed.", "drive.motor.K_tau_rad_per_Nm / drive.motor.K_v_s", "warn"),
    Event(414, "hold_swings", "A joint that is held swings, and its motor does the work: the hold's gains are too high for its inertia and the delay of its velocities. It is braked, no longer held by its gains, and left to its brake where it has one.", "joint.gains / filters.control", "hold"),
    Event(415, "drive_hot", "A drive is hot, or its current has been too high for too long: its joint's torque limit falls towards the torque of its continuous current.", "drive.thermal", "warn"),
    Event(416, "drive_overheated", "A drive is as hot as it may be, or its current has stayed above the continuous one.", "drive.thermal", "stop"),
    Event(417, "drive_integrates", "A drive makes torque without a lead of its set-point over its motor: its velocity loop has an integral, of which the configuration says nothing. Torque control would be wrong by as much.", "drive.motor.integral_time_ms", "hold"),
    Event(501, "late_cycle", "A cycle ended after the next one should have begun.", "loop.rate_hz", "warn"),
    Event(502, "skipped_cycle", "A cycle was left out because the one before it ended too late.", "loop.rate_hz", "warn"),
    Event(503, "lateness_lasts", "Within a second, a greater share of cycles was late or left out than allowed.", "safety.late_per_cent", "stop"),
    Event(504, "publisher_gone", "The thread that serves clients no longer runs: no client can be heard.", "safety.publisher_timeout_ms", "stop"),
    Event(505, "loop_ended", "The loop's thread ended by a defect of the program.", "-", "off"),
)


class CommanderRecord(ctypes.Structure):
    """120 bytes."""

    __slots__ = ()
    _fields_ = [
        # Session that has the lease, or 0.
        ("session", ctypes.c_uint64),
        # Instant at which it got the lease, ns on the machine's `CLOCK_MONOTONIC`.
        ("since_ns", ctypes.c_uint64),
        # Sequence of its newest reference that the cycle has seen.
        ("sequence", ctypes.c_uint64),
        # Session that was refused last, or 0.
        ("refused_session", ctypes.c_uint64),
        # Time until the robot is at the target of mode position, s; 0 in other modes.
        ("motion_left_s", ctypes.c_double),
        # Trajectory that is buffered or followed, or 0.
        ("trajectory", ctypes.c_uint64),
        # Sequence of its session's newest piece that was judged, or 0.
        ("piece", ctypes.c_uint64),
        # Sequence of the piece that was refused last, or 0.
        ("refused_piece", ctypes.c_uint64),
        # Time since the trajectory began, s; 0 before.
        ("trajectory_s", ctypes.c_double),
        # Time until its last buffered point, s; 0 at rest there.
        ("trajectory_left_s", ctypes.c_double),
        # Why session `refused_session` was refused: one of `lease_refusal`.
        ("refused_reason", ctypes.c_uint32),
        # References refused since start.
        ("refused", ctypes.c_uint32),
        # How often a session of higher priority has taken the lease over since start.
        ("replaced", ctypes.c_uint32),
        # Priority of the session that has the lease.
        ("priority", ctypes.c_uint32),
        # Its process.
        ("pid", ctypes.c_uint32),
        # Why no mode is followed, one of `not_followed`, or 0.
        ("not_followed", ctypes.c_uint32),
        # Number of the event that has caused it, or 0, e.g. for an operator's request.
        ("cause", ctypes.c_uint32),
        # Why the piece `refused_piece` was refused: one of `piece_refusal`.
        ("piece_refusal", ctypes.c_uint32),
        # Pieces of trajectories refused since start.
        ("pieces_refused", ctypes.c_uint32),
        # Trajectories that ended in motion since start: no further piece had come.
        ("trajectories_ended", ctypes.c_uint32),
    ]


class JointMeasured(ctypes.Structure):
    """120 bytes."""

    __slots__ = ()
    _fields_ = [
        # q: joint angle, rad, newest sample; without a link-side encoder theta/N less `torsion`.
        ("q", ctypes.c_double),
        # theta: motor-side angle, rad, unwrapped over many turns, newest sample.
        ("theta", ctypes.c_double),
        # torsion: theta/N - q, rad; positive when the motor drives the joint. Without a link-side encoder it is the one that the torque from F/T sensors and IMU explains.
        ("torsion", ctypes.c_double),
        # i: motor current, A, newest sample.
        ("current", ctypes.c_double),
        # dq: joint velocity, rad/s, from a short filter; used by control.
        ("dq", ctypes.c_double),
        # q_hat: filtered joint angle, rad, delayed by `filter_delay_s`.
        ("q_hat", ctypes.c_double),
        # dq_hat: filtered joint velocity, rad/s, delayed by `filter_delay_s`.
        ("dq_hat", ctypes.c_double),
        # ddq_hat: filtered joint acceleration, rad/s², delayed by `filter_delay_s`.
        ("ddq_hat", ctypes.c_double),
        # omega: motor-side velocity, rad/s: the drive's own, or from a short filter.
        ("omega", ctypes.c_double),
        # Temperature that the drive reports, of its winding where it reports more than one, °C; as long as `reported` has its bit, as the next three.
        ("temperature", ctypes.c_double),
        # Voltage of the drive's supply, V.
        ("voltage", ctypes.c_double),
        # The drive's own torque, N·m at the joint.
        ("tau_drive", ctypes.c_double),
        # Age of the newest sample, s.
        ("age_s", ctypes.c_double),
        # Status word of the drive, as received.
        ("status", ctypes.c_uint32),
        # Number of the drive's error; 0: none.
        ("drive_error", ctypes.c_uint32),
        # Bits of `reported_flags`.
        ("reported", ctypes.c_uint32),
        # Bits of `measured_flags`.
        ("flags", ctypes.c_uint32),
    ]


class Wrench(ctypes.Structure):
    """48 bytes."""

    __slots__ = ()
    _fields_ = [
        # f: force, N, x y z.
        ("force", ctypes.c_double * 3),
        # n: torque about the frame's origin, N·m, x y z.
        ("torque", ctypes.c_double * 3),
    ]


class FtMeasured(ctypes.Structure):
    """168 bytes."""

    __slots__ = ()
    _fields_ = [
        # Wrench that the part beyond the sensor applies to the part before it, newest sample, calibrated, `offset` subtracted.
        ("wrench", Wrench),
        # The same, filtered, delayed by `filter_delay_s`.
        ("wrench_hat", Wrench),
        # Offset that is subtracted from the calibrated reading: configuration and tare.
        ("offset", Wrench),
        # Temperature, °C; zero if the sensor does not measure it.
        ("temperature", ctypes.c_double),
        # Age of the newest sample, s.
        ("age_s", ctypes.c_double),
        # Bits of `measured_flags`.
        ("flags", ctypes.c_uint32),
        # Fills the record to a multiple of eight bytes.
        ("reserved", ctypes.c_uint32),
    ]


class ImuMeasured(ctypes.Structure):
    """136 bytes."""

    __slots__ = ()
    _fields_ = [
        # Angular velocity, rad/s, newest sample.
        ("gyro", ctypes.c_double * 3),
        # Acceleration minus gravity, m/s², newest sample.
        ("accelerometer", ctypes.c_double * 3),
        # Filtered angular velocity, rad/s, delayed by `filter_delay_s`.
        ("gyro_hat", ctypes.c_double * 3),
        # Filtered acceleration minus gravity, m/s², delayed by `filter_delay_s`.
        ("accelerometer_hat", ctypes.c_double * 3),
        # Angular acceleration from the filtered gyro, rad/s²; zero if it is neglected.
        ("angular_acceleration_hat", ctypes.c_double * 3),
        # Age of the newest sample, s.
        ("age_s", ctypes.c_double),
        # Bits of `measured_flags`.
        ("flags", ctypes.c_uint32),
        # Fills the record to a multiple of eight bytes.
        ("reserved", ctypes.c_uint32),
    ]


class MeasuredRecord(ctypes.Structure):
    """9576 bytes."""

    __slots__ = ()
    _fields_ = [
        # Delay of the filtered quantities, s.
        ("filter_delay_s", ctypes.c_double),
        # The joints, in config order.
        ("joints", JointMeasured * 64),
        # The F/T sensors, in config order.
        ("ft", FtMeasured * 8),
        # The first IMU, which shows the base's motion, or what stands in for it; zero if there is none.
        ("imu", ImuMeasured),
        # The other IMUs, in config order.
        ("further_imus", ImuMeasured * 3),
    ]


class TorqueEstimate(ctypes.Structure):
    """32 bytes."""

    __slots__ = ()
    _fields_ = [
        # tau: torque that the transmission applies to the child link along +q, N·m.
        ("tau", ctypes.c_double),
        # sigma: standard deviation of tau, N·m.
        ("sigma", ctypes.c_double),
        # Delay of the estimate against the newest sample, s.
        ("delay_s", ctypes.c_double),
        # One of `torque_source`.
        ("source", ctypes.c_uint32),
        # Bits of `torque_flags`.
        ("flags", ctypes.c_uint32),
    ]


class JointEstimated(ctypes.Structure):
    """168 bytes."""

    __slots__ = ()
    _fields_ = [
        # Torque from encoders and current (Z): without delay, but with slow errors of the deformation model. No source and never valid without a link-side encoder.
        ("tau_encoder", TorqueEstimate),
        # Torque from F/T sensors and IMU (D 2): independent of the joint's gear and motor, but delayed by the filters.
        ("tau_whole_body", TorqueEstimate),
        # Torque from the motor current less friction (D3), a third opinion for the cross-check; not valid without `[cross_check]`, but for joints without a link-side encoder.
        ("tau_current", TorqueEstimate),
        # tau_hat: delay-compensated torque: the present torque, from the changes of `tau_encoder` (without a link-side encoder `tau_current`) and the level of F/T sensors and rigid-body model.
        ("tau_hat", TorqueEstimate),
        # tau_ext: torque of the environment on the joint apart from the contact wrenches that the F/T sensors determine, N·m, by a momentum observer; zero without `[external_torque]`.
        ("tau_ext", ctypes.c_double),
        # Change of that torque within the last half second, N·m: much later known by `tau_ext`, here some 6 ms old.
        ("tau_ext_change", ctypes.c_double),
        # The greater of |tau_ext| and |tau_ext_change|, each over its lower threshold, 1: 1 sets `contact_flag`, `external_torque.upper_ratio` raises event 209.
        ("contact_ratio", ctypes.c_double),
        # Heat of the motor's winding by its current, as a share of what the continuous current makes in the end (I²t); zero without `[drive.NAME.thermal]`.
        ("thermal_load", ctypes.c_double),
        # 1: contact detected.
        ("contact_flag", ctypes.c_uint32),
        # Fills the record to a multiple of eight bytes.
        ("reserved", ctypes.c_uint32),
    ]


class FtEstimated(ctypes.Structure):
    """144 bytes."""

    __slots__ = ()
    _fields_ = [
        # f_hat: wrench that the environment applies to the end-effector, at the sensor's frame, inertia and weight of the end-effector removed (D 2.2).
        ("contact_wrench", Wrench),
        # Residual of the part beyond the sensor: the wrench that its contacts cannot explain, in the frame of the sensor's first link.
        ("residual", Wrench),
        # Expected standard deviation of `residual`; zero where the contacts explain any wrench.
        ("residual_sigma", Wrench),
    ]


class EstimatedRecord(ctypes.Structure):
    """12160 bytes."""

    __slots__ = ()
    _fields_ = [
        # The joints, in config order.
        ("joints", JointEstimated * 64),
        # The F/T sensors, in config order.
        ("ft", FtEstimated * 8),
        # f_u: wrench that no F/T sensor measures: that of the last contact of the contact set, by default at the unknown-wrench link (D 2.4).
        ("unknown_wrench", Wrench),
        # Expected standard deviation of `unknown_wrench`.
        ("unknown_wrench_sigma", Wrench),
        # Residual of the part with the root: the wrench that its contacts cannot explain, in the root's frame.
        ("residual", Wrench),
        # Expected standard deviation of `residual`; zero where the contacts explain any wrench.
        ("residual_sigma", Wrench),
        # Force of the environment at `external_torque.frame` that explains `tau_ext` best, in the root's axes, N; zero without a frame or while it does not follow from the torques.
        ("contact_force", ctypes.c_double * 3),
        # Standard deviation of `contact_force`, N; zero where that is.
        ("contact_force_sigma", ctypes.c_double * 3),
        # The contact set in use, an index of `Description::contact_set_names`.
        ("contact_set", ctypes.c_uint32),
        # 1: the automatic rule chooses the contact set; 0: a client or the configuration does.
        ("contact_set_automatic", ctypes.c_uint32),
        # Number of the first active event of the cross-check (204 to 208), or else of a hot drive (415), or 0.
        ("warning", ctypes.c_uint32),
        # The joint that `warning` is about, or the F/T sensor (events 205 and 208).
        ("warning_subject", ctypes.c_uint32),
    ]


class JointCommanded(ctypes.Structure):
    """136 bytes."""

    __slots__ = ()
    _fields_ = [
        # tau_d: desired torque, N·m (D12).
        ("tau_d", ctypes.c_double),
        # tau*: desired torque plus feedback on the estimated torque, N·m (D11).
        ("tau_star", ctypes.c_double),
        # delta_q: commanded offset to the measured position, rad (D10).
        ("delta_q", ctypes.c_double),
        # The command before all limits, rad or A; `flags` names the limits that changed it.
        ("asked", ctypes.c_double),
        # q_c: commanded position after all limits, rad (position-commanded drives).
        ("q_c", ctypes.c_double),
        # i_c: commanded current after all limits, A (current-commanded drives).
        ("current_c", ctypes.c_double),
        # Contribution to the command of the torque feed-forward, rad or A (D 5.5).
        ("feedforward_torque", ctypes.c_double),
        # Contribution to the command of the friction feed-forward, rad or A.
        ("feedforward_friction", ctypes.c_double),
        # Contribution to the command of the position error, rad or A.
        ("feedback_position", ctypes.c_double),
        # Contribution to the command of the velocity error, rad or A.
        ("feedback_velocity", ctypes.c_double),
        # Contribution to the command of the acceleration error, rad or A.
        ("feedback_acceleration", ctypes.c_double),
        # Contribution to the command of the contact force error, rad or A.
        ("feedback_force", ctypes.c_double),
        # Distance of the set-point that torque, velocity and position of the drive show from those sent last, rad or A; zero while no set-points are sent.
        ("following_error", ctypes.c_double),
        # Delay from the sample that a command is computed from to its effect in the motor's current, s, as measured while a client is followed; 0 until it is known.
        ("command_delay_s", ctypes.c_double),
        # Standard deviation of `command_delay_s`, s.
        ("command_delay_sigma_s", ctypes.c_double),
        # Torque that the command may ask for at present, N·m: the joint's limit, less while its drive is hot; zero while no set-points are sent.
        ("torque_limit", ctypes.c_double),
        # Bits of `command_flags`.
        ("flags", ctypes.c_uint32),
        # Number of the drive's `DriveState`; a drive without states counts as enabled.
        ("drive_state", ctypes.c_uint32),
    ]


class FrameCommanded(ctypes.Structure):
    """160 bytes."""

    __slots__ = ()
    _fields_ = [
        # x: position of the frame's origin in its base, m.
        ("position", ctypes.c_double * 3),
        # R: orientation of the frame in its base, a unit quaternion w x y z.
        ("orientation", ctypes.c_double * 4),
        # Wrench that the frame applies to its surroundings by springs, dampers and desired force, N and N·m.
        ("wrench", ctypes.c_double * 6),
        # f_hat: wrench that the environment applies to the frame, N and N·m.
        ("force_estimated", ctypes.c_double * 6),
        # Bits of `frame_flags`.
        ("flags", ctypes.c_uint32),
        # Fills the record to a multiple of eight bytes.
        ("reserved", ctypes.c_uint32),
    ]


class CommandedRecord(ctypes.Structure):
    """9352 bytes."""

    __slots__ = ()
    _fields_ = [
        # The joints, in config order.
        ("joints", JointCommanded * 64),
        # The frames of mode Cartesian, in config order; all zeros while a client uses none.
        ("frames", FrameCommanded * 4),
        # Mode stand: bit s is 1 where the robot stands on the foot of F/T sensor s; 0 in other modes.
        ("stands_on", ctypes.c_uint64),
    ]


class CycleRecord(ctypes.Structure):
    """31776 bytes."""

    __slots__ = ()
    _fields_ = [
        # Cycle number since start.
        ("sequence", ctypes.c_uint64),
        # Instant of the cycle, ns on the caller's clock.
        ("stamp_ns", ctypes.c_uint64),
        # Number of a `Mode`, that of this cycle: 0 hold, 1 torque, 2 inverse dynamics, 3 position, 4 Cartesian.
        ("mode", ctypes.c_uint32),
        # Number of the latched fault's event, or 0.
        ("fault", ctypes.c_uint32),
        # Number of a `RobotState`: 0 boot, 1 ready, 2 enabling, 3 holding, 4 active, 5 stopping, 6 fault.
        ("state", ctypes.c_uint32),
        # Operators' requests since start.
        ("requests", ctypes.c_uint32),
        # Why the last request was refused, or 0: its kind (1 state, 2 joint not plausible, 3 joint outside its limits, 4 another fault, 5 a drive's own fault) times 65536, plus the number of the state or fault, or the joint's index.
        ("refusal", ctypes.c_uint32),
        # The subject of the latched fault, or 0 if it has none: its kind (1 joint, 2 F/T sensor, 3 IMU) times 65536, plus its index.
        ("fault_subject", ctypes.c_uint32),
        # Modes that the sources allow at present, a bit for each number of a `Mode`.
        ("possible_modes", ctypes.c_uint32),
        # Fills the record to a multiple of eight bytes.
        ("reserved", ctypes.c_uint32),
        # The client that commands.
        ("commander", CommanderRecord),
        # Joints in use.
        ("joint_count", ctypes.c_uint32),
        # F/T sensors in use.
        ("ft_count", ctypes.c_uint32),
        # Measured values.
        ("measured", MeasuredRecord),
        # Torques and contact wrenches estimated from them.
        ("estimated", EstimatedRecord),
        # Commands to the drives.
        ("commanded", CommandedRecord),
        # Count of each event since start, in the order of `Event::ALL`.
        ("events", ctypes.c_uint64 * 64),
    ]


class LoopRecord(ctypes.Structure):
    """72 bytes."""

    __slots__ = ()
    _fields_ = [
        # Cycles run.
        ("cycles", ctypes.c_uint64),
        # Cycles that ended after the next one should have begun.
        ("late_cycles", ctypes.c_uint64),
        # Cycles that were left out because an earlier one ended too late.
        ("skipped_cycles", ctypes.c_uint64),
        # Lateness of the thread's wake-up, ns.
        ("wake_late_ns", ctypes.c_uint64),
        # Time from SYNC until every joint had answered or the deadline had passed, ns.
        ("gather_ns", ctypes.c_uint64),
        # Computing time of the cycle, ns.
        ("compute_ns", ctypes.c_uint64),
        # Time to hand the commands to the bus, ns.
        ("send_ns", ctypes.c_uint64),
        # Frames received since start.
        ("frames_received", ctypes.c_uint64),
        # Frames sent since start.
        ("frames_sent", ctypes.c_uint64),
    ]


class SharedRecord(ctypes.Structure):
    """31848 bytes."""

    __slots__ = ()
    _fields_ = [
        # The cycle.
        ("cycle", CycleRecord),
        # The loop around it.
        ("timing", LoopRecord),
    ]


class Description(ctypes.Structure):
    """6280 bytes."""

    __slots__ = ()
    _fields_ = [
        # The robot's name.
        ("robot", ctypes.c_uint8 * 48),
        # Cycles a second, Hz.
        ("rate_hz", ctypes.c_double),
        # Joints in use.
        ("joint_count", ctypes.c_uint32),
        # F/T sensors in use.
        ("ft_count", ctypes.c_uint32),
        # Names of the joints, in the order of every record's `joints`.
        ("joint_names", ctypes.c_uint8 * 48 * 64),
        # Names of the F/T sensors, in the order of every record's `ft`.
        ("ft_names", ctypes.c_uint8 * 48 * 8),
        # Kinds of the joints, numbers of `JointKind`. Of a prismatic joint every link-side quantity of every record is in m where its documentation has rad, and in N where it has N·m.
        ("joint_kinds", ctypes.c_uint32 * 64),
        # Torque limits of the joints, N·m.
        ("torque_limits", ctypes.c_double * 64),
        # Lower position limits of the joints, rad.
        ("position_min", ctypes.c_double * 64),
        # Upper position limits of the joints, rad.
        ("position_max", ctypes.c_double * 64),
        # Contact sets in use.
        ("contact_set_count", ctypes.c_uint32),
        # Frames that mode Cartesian can lead.
        ("frame_count", ctypes.c_uint32),
        # Names of the contact sets; the first is in use at the start.
        ("contact_set_names", ctypes.c_uint8 * 48 * 16),
        # Names of the frames, in the order of every record's `frames`.
        ("frame_names", ctypes.c_uint8 * 48 * 4),
    ]


class JointReference(ctypes.Structure):
    """48 bytes."""

    __slots__ = ()
    _fields_ = [
        # q_d: desired joint angle, rad, or the target (mode position).
        ("q_d", ctypes.c_double),
        # dq_d: desired velocity, rad/s, or the greatest speed on the way to the target, 0 for the configured one (mode position).
        ("dq_d", ctypes.c_double),
        # ddq_d: desired acceleration, rad/s² (modes inverse dynamics, Cartesian and low-gain tracking).
        ("ddq_d", ctypes.c_double),
        # tau_d: desired torque, N·m (mode torque).
        ("tau_d", ctypes.c_double),
        # K_s: stiffness, N·m/rad, at most the configured one; counts where `gains_given` is 1 (not in mode torque).
        ("stiffness", ctypes.c_double),
        # K_d: damping, N·m·s/rad, at most the configured one, and no smaller a share of it than `stiffness` is of the configured stiffness; counts as `stiffness` does.
        ("damping", ctypes.c_double),
    ]


class FrameReference(ctypes.Structure):
    """224 bytes."""

    __slots__ = ()
    _fields_ = [
        # x_d: desired position of the frame's origin in its base, m.
        ("position", ctypes.c_double * 3),
        # R_d: desired orientation of the frame in its base, a unit quaternion w x y z.
        ("orientation", ctypes.c_double * 4),
        # v_d: desired velocity, linear m/s and angular rad/s.
        ("velocity", ctypes.c_double * 6),
        # K: stiffness along and about each axis, N/m and N·m/rad.
        ("stiffness", ctypes.c_double * 6),
        # f_d: desired force and torque that the environment applies to the frame, N and N·m: a robot that presses down on a table gets an upward force.
        ("force", ctypes.c_double * 6),
        # zeta: damping ratio of the springs with the limb's inertia, 0.3 to 2.
        ("damping_ratio", ctypes.c_double),
        # 1: the frame is led; 0: it is not. Together with mode hold: its pose is shown.
        ("used", ctypes.c_uint32),
        # 1: stiffness, velocity and force are along the axes of the desired orientation; 0: along those of the base.
        ("own_axes", ctypes.c_uint32),
        # Axes on which K_f feeds the force back, a bit for each: x y z of force, x y z of torque; their stiffness must be 0.
        ("force_axes", ctypes.c_uint32),
        # Fills the record to a multiple of eight bytes.
        ("reserved", ctypes.c_uint32),
    ]


class Reference(ctypes.Structure):
    """4448 bytes."""

    __slots__ = ()
    _fields_ = [
        # Session of the commander: a random number other than 0, a new one whenever it asks for the lease.
        ("session", ctypes.c_uint64),
        # Instant at which the session began, ns on the machine's `CLOCK_MONOTONIC`. A session older than one that has had the lease never gets it.
        ("session_began_ns", ctypes.c_uint64),
        # Count of the session's references, this one included: it must advance.
        ("sequence", ctypes.c_uint64),
        # Instant of sending, ns on the machine's `CLOCK_MONOTONIC`: the reference's age counts from it.
        ("sent_ns", ctypes.c_uint64),
        # Trajectory whose points give `q_d dq_d ddq_d` of every cycle, or 0: those of this reference (modes inverse dynamics, torque-feedback motion and low-gain tracking). It counts from the trajectory's first piece on.
        ("trajectory", ctypes.c_uint64),
        # Mode passive: bit k is 1 where joint k is held at `q_d`, with its `stiffness` and `damping` or the configured ones; the other joints are let go.
        ("held_joints", ctypes.c_uint64),
        # Number of a `Mode`: 0 hold, 1 torque, 2 inverse dynamics, 3 position, 4 Cartesian, 5 passive, 6 torque-feedback motion, 7 low-gain tracking, 8 velocity, 9 stand.
        ("mode", ctypes.c_uint32),
        # Joints in use; must equal the robot's.
        ("joint_count", ctypes.c_uint32),
        # Priority of the session, that of its first reference: it takes the lease over from a session of lower priority.
        ("priority", ctypes.c_uint32),
        # Process of the commander, to be named to others.
        ("pid", ctypes.c_uint32),
        # 1: the last reference of its session, which gives the lease back; the robot holds.
        ("gives_back", ctypes.c_uint32),
        # 1: `contact_wrench` is followed; 0: what the ground carries in the desired motion is.
        ("contact_wrench_given", ctypes.c_uint32),
        # 1: the joints' `stiffness` and `damping` hold; 0: those of the configuration for the mode.
        ("gains_given", ctypes.c_uint32),
        # Mode stand: bit s is 1 where the client lifts the foot of F/T sensor s. The robot stands on the others alone before it is free (`stands_on` of the record), then its joints follow `q_d` from where they are.
        ("lifted_feet", ctypes.c_uint32),
        # The joints, in config order.
        ("joints", JointReference * 64),
        # f_d: desired wrench of the environment on each end-effector, at the frame of its F/T sensor, in config order (mode inverse dynamics).
        ("contact_wrench", Wrench * 8),
        # The frames, in config order (mode Cartesian).
        ("frames", FrameReference * 4),
        # Mode stand: horizontal offset of the centre of mass from the middle of the soles that bear the robot, forward and to the left as the base stood when the mode began, m.
        ("center_of_mass_offset", ctypes.c_double * 2),
    ]


class JointPoint(ctypes.Structure):
    """24 bytes."""

    __slots__ = ()
    _fields_ = [
        # q_d, rad.
        ("q_d", ctypes.c_double),
        # dq_d, rad/s.
        ("dq_d", ctypes.c_double),
        # ddq_d, rad/s².
        ("ddq_d", ctypes.c_double),
    ]


class TrajectoryPoint(ctypes.Structure):
    """1536 bytes."""

    __slots__ = ()
    _fields_ = [
        # The joints, in config order.
        ("joints", JointPoint * 64),
    ]


class TrajectoryPiece(ctypes.Structure):
    """49200 bytes."""

    __slots__ = ()
    _fields_ = [
        # Session of the commander.
        ("session", ctypes.c_uint64),
        # Number of the trajectory, of the client's choice, other than 0; references name it.
        ("trajectory", ctypes.c_uint64),
        # Count of the session's pieces, this one included: it must advance.
        ("sequence", ctypes.c_uint64),
        # Time of the first point since the trajectory's begin, ns. The trajectory begins in the cycle that first follows it; its first piece has 0 here.
        ("begins_ns", ctypes.c_uint64),
        # Time between two points, ns.
        ("spacing_ns", ctypes.c_uint64),
        # Joints in use; must equal the robot's.
        ("joint_count", ctypes.c_uint32),
        # Points in use, at least 2.
        ("point_count", ctypes.c_uint32),
        # The points.
        ("points", TrajectoryPoint * 32),
    ]


class CommanderStatus(ctypes.Structure):
    """136 bytes."""

    __slots__ = ()
    _fields_ = [
        # Cycle number since the daemon's start.
        ("cycle", ctypes.c_uint64),
        # The lease, and whether references are followed.
        ("commander", CommanderRecord),
        # Number of the robot's `RobotState`.
        ("state", ctypes.c_uint32),
        # Number of the robot's `Mode`.
        ("mode", ctypes.c_uint32),
    ]


class Request(ctypes.Structure):
    """1144 bytes."""

    __slots__ = ()
    _fields_ = [
        # Any number that no other request has: the answers repeat it.
        ("id", ctypes.c_uint64),
        # One of `request`.
        ("kind", ctypes.c_uint32),
        # Number of the fault to acknowledge; 0 in other requests.
        ("fault", ctypes.c_uint32),
        # Name of a contact set, for a tare and for the choice of a contact set.
        ("contact_set", ctypes.c_uint8 * 48),
        # Duration of a recording from now on, s; negative: until its end is asked for.
        ("seconds", ctypes.c_double),
        # Time before now that is recorded too, s.
        ("last_s", ctypes.c_double),
        # tau: torque that the joint is known to carry, N·m, and its standard deviation.
        ("torque", ctypes.c_double),
        # See `torque`.
        ("sigma", ctypes.c_double),
        # Messages a second of a recording of torques; 0: one for each cycle.
        ("rate_hz", ctypes.c_double),
        # Number of a recording's `Content`: 0 all, 1 frames, 2 torques.
        ("content", ctypes.c_uint32),
        # Fills the record to a multiple of eight bytes.
        ("reserved", ctypes.c_uint32),
        # 1: a recording may replace the file `path`.
        ("overwrite", ctypes.c_uint32),
        # Index of the joint to tare, in config order.
        ("joint", ctypes.c_uint32),
        # Absolute path of the file to record into, as the daemon sees it.
        ("path", ctypes.c_uint8 * 1024),
    ]


class TaredSensor(ctypes.Structure):
    """152 bytes."""

    __slots__ = ()
    _fields_ = [
        # Offset of the tare; it is subtracted from the reading in addition to the configuration's offset.
        ("offset", Wrench),
        # The same before this request.
        ("before", Wrench),
        # Standard deviation of `offset`; zero without a tare.
        ("sigma", Wrench),
        # Bit k: the tare's pose determined component k (fx fy fz tx ty tz) of `offset`.
        ("known", ctypes.c_uint32),
        # Fills the record to a multiple of eight bytes.
        ("reserved", ctypes.c_uint32),
    ]


class Answer(ctypes.Structure):
    """2320 bytes."""

    __slots__ = ()
    _fields_ = [
        # The request's `id`.
        ("id", ctypes.c_uint64),
        # One of `answer_status`.
        ("status", ctypes.c_uint32),
        # F/T sensors in use.
        ("ft_count", ctypes.c_uint32),
        # Share of the work that is done, 0 to 1.
        ("progress", ctypes.c_double),
        # Date of the last tare, seconds since 1970-01-01 UTC; zero if there is none.
        ("date_unix_s", ctypes.c_double),
        # Contact set of that tare.
        ("contact_set", ctypes.c_uint8 * 48),
        # A sentence about what is being done, was done, or was refused and why.
        ("text", ctypes.c_uint8 * 1024),
        # The F/T sensors, in config order; filled in answers about tares.
        ("ft", TaredSensor * 8),
    ]


# The types' names in shared memory: the layout's hash makes another version a stranger.
SharedRecord.type_name = staticmethod(lambda: "torqued::SharedRecord#009075959e0dee4a")
Description.type_name = staticmethod(lambda: "torqued::Description#e3c0c7d4efae2a39")
Reference.type_name = staticmethod(lambda: "torqued::Reference#de0a6dce8f317983")
TrajectoryPiece.type_name = staticmethod(lambda: "torqued::TrajectoryPiece#6db9275c3fdbb493")
CommanderStatus.type_name = staticmethod(lambda: "torqued::CommanderStatus#ca593c6c51e26f62")
Request.type_name = staticmethod(lambda: "torqued::Request#57192db3322973c9")
Answer.type_name = staticmethod(lambda: "torqued::Answer#275aafd2df77613d")
