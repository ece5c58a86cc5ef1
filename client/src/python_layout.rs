//! The Python mirror of the records, generated from their layout.

use std::fmt::Write;

use robot_state::{
    Answer, CommanderStatus, Description, EVENT_COUNT, Event, JointKind, Layout, MAX_FRAMES,
    MAX_FT_SENSORS, MAX_FURTHER_IMUS, MAX_JOINTS, MAX_POINTS, Mode, Reference, Request, RobotState,
    Shape, SharedRecord, TrajectoryPiece, answer_status, command_flags, frame_flags, lease_refusal,
    measured_flags, not_followed, piece_refusal, request, torque_flags, torque_source,
};

use crate::channel::type_name;

const HEAD: &str = "\
\"\"\"The records in shared memory: SI units, config order. Generated, do not edit:

    cargo run -p torqued-client --example generate_python_layout > client/python/torqued/layout.py
\"\"\"

import ctypes
from enum import IntEnum, IntFlag
from typing import NamedTuple
";

/// The text of `python/torqued/layout.py`.
#[must_use]
pub fn python_layout() -> String {
    let mut out = String::from(HEAD);
    let _ = write!(
        out,
        "\nMAX_JOINTS = {MAX_JOINTS}\nMAX_FT_SENSORS = {MAX_FT_SENSORS}\nMAX_FURTHER_IMUS = {MAX_FURTHER_IMUS}\nMAX_POINTS = {MAX_POINTS}\nMAX_FRAMES = {MAX_FRAMES}\nEVENT_COUNT = {EVENT_COUNT}\n"
    );
    enumeration(
        &mut out,
        "IntEnum",
        "Mode",
        "Mode of the robot.",
        &Mode::ALL.map(|mode| (mode.name(), mode.number())),
    );
    enumeration(
        &mut out,
        "IntEnum",
        "JointKind",
        "Kind of a joint: of a prismatic one m stands for rad and N for N·m on the link side.",
        &JointKind::ALL.map(|kind| (kind.name(), kind.number())),
    );
    enumeration(
        &mut out,
        "IntEnum",
        "TorqueSource",
        "Source of a torque estimate.",
        &[
            ("NONE", torque_source::NONE),
            ("ENCODER", torque_source::ENCODER),
            ("WHOLE_BODY", torque_source::WHOLE_BODY),
            ("CURRENT", torque_source::CURRENT),
            ("FUSED", torque_source::FUSED),
        ],
    );
    enumeration(
        &mut out,
        "IntFlag",
        "MeasuredFlags",
        "Flag bits of measured values.",
        &[
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
    );
    enumeration(
        &mut out,
        "IntFlag",
        "TorqueFlags",
        "Flag bits of a torque estimate.",
        &[
            ("VALID", torque_flags::VALID),
            ("SATURATED", torque_flags::SATURATED),
            ("DEGRADED", torque_flags::DEGRADED),
        ],
    );
    enumeration(
        &mut out,
        "IntEnum",
        "RobotState",
        "State of the robot.",
        &[
            ("BOOT", RobotState::Boot.number()),
            ("READY", RobotState::Ready.number()),
            ("ENABLING", RobotState::Enabling.number()),
            ("HOLDING", RobotState::Holding.number()),
            ("ACTIVE", RobotState::Active.number()),
            ("STOPPING", RobotState::Stopping.number()),
            ("FAULT", RobotState::Fault.number()),
        ],
    );
    enumeration(
        &mut out,
        "IntFlag",
        "CommandFlags",
        "Flag bits of a joint's command.",
        &[
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
    );
    enumeration(
        &mut out,
        "IntEnum",
        "RequestKind",
        "Kind of a request.",
        &[
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
    );
    enumeration(
        &mut out,
        "IntEnum",
        "AnswerStatus",
        "Progress of a request.",
        &[
            ("WORKING", answer_status::WORKING),
            ("DONE", answer_status::DONE),
            ("REFUSED", answer_status::REFUSED),
        ],
    );
    enumeration(
        &mut out,
        "IntEnum",
        "LeaseRefusal",
        "Reason for which a reference was refused.",
        &[
            ("HELD", lease_refusal::HELD),
            ("HOLD_FIRST", lease_refusal::HOLD_FIRST),
            ("OLD_SESSION", lease_refusal::OLD_SESSION),
            ("NOT_ADVANCED", lease_refusal::NOT_ADVANCED),
            ("TOO_OLD", lease_refusal::TOO_OLD),
            ("INVALID", lease_refusal::INVALID),
        ],
    );
    enumeration(
        &mut out,
        "IntFlag",
        "FrameFlags",
        "Flag bits of a frame in mode Cartesian.",
        &[
            ("VALID", frame_flags::VALID),
            ("ACTIVE", frame_flags::ACTIVE),
            ("WRENCH_LIMITED", frame_flags::WRENCH_LIMITED),
            ("GAINS_LIMITED", frame_flags::GAINS_LIMITED),
            ("FORCE_KNOWN", frame_flags::FORCE_KNOWN),
            ("LED", frame_flags::LED),
        ],
    );
    enumeration(
        &mut out,
        "IntEnum",
        "NotFollowed",
        "Reason for which no mode of the commander is followed.",
        &[
            ("FAULT", not_followed::FAULT),
            ("STATE", not_followed::STATE),
            ("HOLD_FIRST", not_followed::HOLD_FIRST),
            ("NOT_READY", not_followed::NOT_READY),
            ("NOT_POSSIBLE", not_followed::NOT_POSSIBLE),
        ],
    );
    enumeration(
        &mut out,
        "IntEnum",
        "PieceRefusal",
        "Reason for which a piece of a trajectory was refused.",
        &[
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
    );
    events(&mut out);
    let mut done = Vec::new();
    record(&mut out, &mut done, &SharedRecord::SHAPE);
    record(&mut out, &mut done, &Description::SHAPE);
    record(&mut out, &mut done, &Reference::SHAPE);
    record(&mut out, &mut done, &TrajectoryPiece::SHAPE);
    record(&mut out, &mut done, &CommanderStatus::SHAPE);
    record(&mut out, &mut done, &Request::SHAPE);
    record(&mut out, &mut done, &Answer::SHAPE);
    let _ = write!(
        out,
        "\n\n# The types' names in shared memory: the layout's hash makes another version a stranger.\n\
         SharedRecord.type_name = staticmethod(lambda: \"{}\")\n\
         Description.type_name = staticmethod(lambda: \"{}\")\n\
         Reference.type_name = staticmethod(lambda: \"{}\")\n\
         TrajectoryPiece.type_name = staticmethod(lambda: \"{}\")\n\
         CommanderStatus.type_name = staticmethod(lambda: \"{}\")\n\
         Request.type_name = staticmethod(lambda: \"{}\")\n\
         Answer.type_name = staticmethod(lambda: \"{}\")\n",
        type_name::<SharedRecord>("SharedRecord"),
        type_name::<Description>("Description"),
        type_name::<Reference>("Reference"),
        type_name::<TrajectoryPiece>("TrajectoryPiece"),
        type_name::<CommanderStatus>("CommanderStatus"),
        type_name::<Request>("Request"),
        type_name::<Answer>("Answer"),
    );
    out
}

fn enumeration(out: &mut String, base: &str, name: &str, doc: &str, values: &[(&str, u32)]) {
    let _ = write!(out, "\n\nclass {name}({base}):\n    \"\"\"{doc}\"\"\"\n\n");
    for (value_name, value) in values {
        let _ = writeln!(out, "    {} = {value}", value_name.to_uppercase());
    }
}

fn events(out: &mut String) {
    out.push_str(
        "\n\nclass Event(NamedTuple):\n    \"\"\"A numbered event.\"\"\"\n\n    number: int\n    \
         name: str\n    cause: str\n    config_key: str\n    reaction: str\n\n\n\
         #: In the order of `CycleRecord.events`.\nEVENTS = (\n",
    );
    for event in Event::ALL {
        let _ = writeln!(
            out,
            "    Event({}, {:?}, {:?}, {:?}, {:?}),",
            event.number(),
            event.name(),
            event.cause(),
            event.config_key(),
            format!("{:?}", event.reaction()).to_lowercase(),
        );
    }
    out.push_str(")\n");
}

/// Writes a record after those that it contains.
fn record(out: &mut String, done: &mut Vec<&'static str>, shape: &Shape) {
    match shape {
        Shape::Array(element, _) => record(out, done, element),
        Shape::Record(name, fields, size) if !done.contains(name) => {
            done.push(name);
            for field in *fields {
                record(out, done, &field.shape);
            }
            let _ = write!(out, "\n\nclass {name}(ctypes.Structure):\n");
            let _ = writeln!(
                out,
                "    \"\"\"{size} bytes.\"\"\"\n\n    __slots__ = ()\n    _fields_ = ["
            );
            for field in *fields {
                let doc = field.doc.split_whitespace().collect::<Vec<_>>().join(" ");
                let _ = writeln!(out, "        # {doc}");
                let _ = writeln!(
                    out,
                    "        (\"{}\", {}),",
                    field.name,
                    ctype(&field.shape)
                );
            }
            out.push_str("    ]\n");
        }
        _ => {}
    }
}

fn ctype(shape: &Shape) -> String {
    match shape {
        Shape::U8 => "ctypes.c_uint8".to_owned(),
        Shape::U32 => "ctypes.c_uint32".to_owned(),
        Shape::U64 => "ctypes.c_uint64".to_owned(),
        Shape::F64 => "ctypes.c_double".to_owned(),
        Shape::Array(element, count) => format!("{} * {count}", ctype(element)),
        Shape::Record(name, ..) => (*name).to_owned(),
    }
}
