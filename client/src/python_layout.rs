//! The Python mirror of the records, generated from their layout.

use std::fmt::Write;

use robot_state::{
    Answer, CommanderStatus, Description, EVENT_COUNT, Event, Layout, MAX_FRAMES, MAX_FT_SENSORS,
    MAX_FURTHER_IMUS, MAX_JOINTS, MAX_POINTS, Reference, Request, Shape, SharedRecord,
    TrajectoryPiece,
};

use crate::channel::type_name;
use crate::enumerations::{Enumeration, enumerations};

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
    for enumeration in enumerations() {
        write_enumeration(&mut out, &enumeration);
    }
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

fn write_enumeration(out: &mut String, enumeration: &Enumeration) {
    let Enumeration { name, doc, .. } = enumeration;
    let base = if enumeration.are_flags {
        "IntFlag"
    } else {
        "IntEnum"
    };
    let _ = write!(out, "\n\nclass {name}({base}):\n    \"\"\"{doc}\"\"\"\n\n");
    for (value_name, value) in &enumeration.values {
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
