//! Names of the numbers that records carry: what mirrors of the records in other languages show.

use robot_state::{
    JointKind, Mode, RobotState, answer_status, command_flags, frame_flags, lease_refusal,
    measured_flags, not_followed, piece_refusal, request, torque_flags, torque_source,
};

/// Numbers with names.
pub(crate) struct Enumeration {
    pub(crate) name: &'static str,
    /// A sentence.
    pub(crate) doc: &'static str,
    /// The numbers are bits, of which several may be set.
    pub(crate) are_flags: bool,
    pub(crate) values: Vec<(&'static str, u32)>,
}

/// All of them.
pub(crate) fn enumerations() -> Vec<Enumeration> {
    vec![
        Enumeration {
            name: "Mode",
            doc: "Mode of the robot.",
            are_flags: false,
            values: Mode::ALL.map(|mode| (mode.name(), mode.number())).to_vec(),
        },
        Enumeration {
            name: "JointKind",
            doc: "Kind of a joint: of a prismatic one m stands for rad and N for N·m on the link side.",
            are_flags: false,
            values: JointKind::ALL
                .map(|kind| (kind.name(), kind.number()))
                .to_vec(),
        },
        Enumeration {
            name: "TorqueSource",
            doc: "Source of a torque estimate.",
            are_flags: false,
            values: vec![
                ("NONE", torque_source::NONE),
                ("ENCODER", torque_source::ENCODER),
                ("WHOLE_BODY", torque_source::WHOLE_BODY),
                ("CURRENT", torque_source::CURRENT),
                ("FUSED", torque_source::FUSED),
            ],
        },
        Enumeration {
            name: "MeasuredFlags",
            doc: "Flag bits of measured values.",
            are_flags: true,
            values: vec![
                ("MISSED", measured_flags::MISSED),
                ("STALE", measured_flags::STALE),
                ("JUMP", measured_flags::JUMP),
                ("NEVER", measured_flags::NEVER),
                ("SETTLING", measured_flags::SETTLING),
                ("IMPLAUSIBLE", measured_flags::IMPLAUSIBLE),
                ("FLAT", measured_flags::FLAT),
                ("SATURATED", measured_flags::SATURATED),
                ("STANDS_IN", measured_flags::STANDS_IN),
            ],
        },
        Enumeration {
            name: "TorqueFlags",
            doc: "Flag bits of a torque estimate.",
            are_flags: true,
            values: vec![
                ("VALID", torque_flags::VALID),
                ("SATURATED", torque_flags::SATURATED),
                ("DEGRADED", torque_flags::DEGRADED),
            ],
        },
        Enumeration {
            name: "RobotState",
            doc: "State of the robot.",
            are_flags: false,
            values: vec![
                ("BOOT", RobotState::Boot.number()),
                ("READY", RobotState::Ready.number()),
                ("ENABLING", RobotState::Enabling.number()),
                ("HOLDING", RobotState::Holding.number()),
                ("ACTIVE", RobotState::Active.number()),
                ("STOPPING", RobotState::Stopping.number()),
                ("FAULT", RobotState::Fault.number()),
            ],
        },
        Enumeration {
            name: "CommandFlags",
            doc: "Flag bits of a joint's command.",
            are_flags: true,
            values: vec![
                ("POSITION_LIMITED", command_flags::POSITION_LIMITED),
                ("TORQUE_LIMITED", command_flags::TORQUE_LIMITED),
                ("LEAD_LIMITED", command_flags::LEAD_LIMITED),
                ("VELOCITY_LIMITED", command_flags::VELOCITY_LIMITED),
                ("TORQUE_RATE_LIMITED", command_flags::TORQUE_RATE_LIMITED),
                ("POWER_LIMITED", command_flags::POWER_LIMITED),
                ("NOT_FINITE", command_flags::NOT_FINITE),
                ("ENGAGED", command_flags::ENGAGED),
                ("RATE_TRIMMED", command_flags::RATE_TRIMMED),
            ],
        },
        Enumeration {
            name: "RequestKind",
            doc: "Kind of a request.",
            are_flags: false,
            values: vec![
                ("TARE", request::TARE),
                ("SHOW_TARE", request::SHOW_TARE),
                ("FORGET_TARE", request::FORGET_TARE),
                ("CHOOSE_CONTACT_SET", request::CHOOSE_CONTACT_SET),
                ("AUTOMATIC_CONTACT_SET", request::AUTOMATIC_CONTACT_SET),
                ("ENABLE", request::ENABLE),
                ("DISABLE", request::DISABLE),
                ("STOP", request::STOP),
                ("ACKNOWLEDGE", request::ACKNOWLEDGE),
            ],
        },
        Enumeration {
            name: "AnswerStatus",
            doc: "Progress of a request.",
            are_flags: false,
            values: vec![
                ("WORKING", answer_status::WORKING),
                ("DONE", answer_status::DONE),
                ("REFUSED", answer_status::REFUSED),
            ],
        },
        Enumeration {
            name: "LeaseRefusal",
            doc: "Reason for which a reference was refused.",
            are_flags: false,
            values: vec![
                ("HELD", lease_refusal::HELD),
                ("HOLD_FIRST", lease_refusal::HOLD_FIRST),
                ("OLD_SESSION", lease_refusal::OLD_SESSION),
                ("NOT_ADVANCED", lease_refusal::NOT_ADVANCED),
                ("TOO_OLD", lease_refusal::TOO_OLD),
                ("INVALID", lease_refusal::INVALID),
            ],
        },
        Enumeration {
            name: "FrameFlags",
            doc: "Flag bits of a frame in mode Cartesian.",
            are_flags: true,
            values: vec![
                ("VALID", frame_flags::VALID),
                ("ACTIVE", frame_flags::ACTIVE),
                ("WRENCH_LIMITED", frame_flags::WRENCH_LIMITED),
                ("GAINS_LIMITED", frame_flags::GAINS_LIMITED),
                ("FORCE_KNOWN", frame_flags::FORCE_KNOWN),
                ("LED", frame_flags::LED),
            ],
        },
        Enumeration {
            name: "NotFollowed",
            doc: "Reason for which no mode of the commander is followed.",
            are_flags: false,
            values: vec![
                ("FAULT", not_followed::FAULT),
                ("STATE", not_followed::STATE),
                ("HOLD_FIRST", not_followed::HOLD_FIRST),
                ("NOT_READY", not_followed::NOT_READY),
                ("NOT_POSSIBLE", not_followed::NOT_POSSIBLE),
            ],
        },
        Enumeration {
            name: "PieceRefusal",
            doc: "Reason for which a piece of a trajectory was refused.",
            are_flags: false,
            values: vec![
                ("SESSION", piece_refusal::SESSION),
                ("INVALID", piece_refusal::INVALID),
                ("LIMIT", piece_refusal::LIMIT),
                ("NOT_ADVANCED", piece_refusal::NOT_ADVANCED),
                ("LATE", piece_refusal::LATE),
                ("GAP", piece_refusal::GAP),
                ("APART", piece_refusal::APART),
                ("TOO_FAR", piece_refusal::TOO_FAR),
                ("BUSY", piece_refusal::BUSY),
            ],
        },
    ]
}
