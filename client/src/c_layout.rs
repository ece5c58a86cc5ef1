//! The C mirror of the records, generated from their layout.

use std::fmt::Write;

use robot_state::{
    Answer, CommanderStatus, Description, EVENT_COUNT, Layout, MAX_CONTACT_SETS, MAX_FRAMES,
    MAX_FT_SENSORS, MAX_FURTHER_IMUS, MAX_JOINTS, MAX_POINTS, Reference, Request, Shape,
    SharedRecord, TrajectoryPiece,
};

use crate::enumerations::{Enumeration, enumerations};

const HEAD: &str = "\
/* The records in shared memory: SI units, config order. Generated, do not edit:
 *
 *     cargo run -p torqued-client --example generate_c_layout > client/c/include/torqued/records.h
 *
 * Texts are UTF-8, padded with zero bytes; one that fills its array has no zero at its end. */

#ifndef TORQUED_RECORDS_H
#define TORQUED_RECORDS_H

#include <stdint.h>

#ifdef __cplusplus
#define TORQUED_SIZE(type, size) static_assert(sizeof(type) == (size), #type)
#else
#define TORQUED_SIZE(type, size) _Static_assert(sizeof(type) == (size), #type)
#endif
";

/// The text of `c/include/torqued/records.h`.
#[must_use]
pub fn c_layout() -> String {
    let mut out = String::from(HEAD);
    out.push('\n');
    for (name, number) in [
        ("JOINTS", MAX_JOINTS),
        ("FT_SENSORS", MAX_FT_SENSORS),
        ("FURTHER_IMUS", MAX_FURTHER_IMUS),
        ("POINTS", MAX_POINTS),
        ("FRAMES", MAX_FRAMES),
        ("CONTACT_SETS", MAX_CONTACT_SETS),
    ] {
        let _ = writeln!(out, "#define TORQUED_MAX_{name} {number}");
    }
    let _ = writeln!(out, "#define TORQUED_EVENT_COUNT {EVENT_COUNT}");
    for enumeration in enumerations() {
        write_enumeration(&mut out, &enumeration);
    }
    let mut done = Vec::new();
    for shape in [
        &SharedRecord::SHAPE,
        &Description::SHAPE,
        &Reference::SHAPE,
        &TrajectoryPiece::SHAPE,
        &CommanderStatus::SHAPE,
        &Request::SHAPE,
        &Answer::SHAPE,
    ] {
        record(&mut out, &mut done, shape);
    }
    out.push_str("\n#undef TORQUED_SIZE\n\n#endif\n");
    out
}

fn write_enumeration(out: &mut String, enumeration: &Enumeration) {
    let Enumeration { name, doc, .. } = enumeration;
    let prefix = constant(name);
    let _ = write!(out, "\n/** {doc} */\nenum Torqued{name} {{\n");
    for (value, number) in &enumeration.values {
        let _ = writeln!(out, "  {prefix}_{} = {number},", value.to_uppercase());
    }
    out.push_str("};\n");
}

/// `TORQUED_ROBOT_STATE` for `RobotState`.
fn constant(name: &str) -> String {
    let mut constant = String::from("TORQUED");
    for letter in name.chars() {
        if letter.is_uppercase() {
            constant.push('_');
        }
        constant.push(letter.to_ascii_uppercase());
    }
    constant
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
            let _ = writeln!(out, "\ntypedef struct Torqued{name} {{");
            for field in *fields {
                let doc = field.doc.split_whitespace().collect::<Vec<_>>().join(" ");
                let (kind, counts) = declaration(&field.shape);
                let _ = writeln!(out, "  /** {doc} */\n  {kind} {}{counts};", field.name);
            }
            let _ = writeln!(
                out,
                "}} Torqued{name};\nTORQUED_SIZE(Torqued{name}, {size});"
            );
        }
        _ => {}
    }
}

/// Type of an element, and the counts in brackets behind the field's name.
fn declaration(shape: &Shape) -> (String, String) {
    match shape {
        Shape::U8 => ("char".to_owned(), String::new()),
        Shape::U32 => ("uint32_t".to_owned(), String::new()),
        Shape::U64 => ("uint64_t".to_owned(), String::new()),
        Shape::F64 => ("double".to_owned(), String::new()),
        Shape::Array(element, count) => {
            let (kind, counts) = declaration(element);
            (kind, format!("[{count}]{counts}"))
        }
        Shape::Record(name, ..) => (format!("Torqued{name}"), String::new()),
    }
}
