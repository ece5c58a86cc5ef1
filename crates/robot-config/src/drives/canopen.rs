//! `[drive.NAME.canopen]`: a drive of CiA 402 whose frames and set-up need no DBC file.

use super::Command;
use crate::reader::{Allowed, Section};
use crate::{Files, paths, unreadable};
use drives_of_makers::canopen::Object;
use drives_of_makers::canopen::eds::ObjectDictionary;
use drives_of_makers::canopen::pdo::Mapped;
use drives_of_makers::cia402::{Kind, Mode, Reported, Side};

/// A kind of CANopen drive.
#[derive(Clone)]
pub(crate) struct CanopenDrive {
    pub(crate) kind: Kind,
    /// Its objects, if a file describes them.
    pub(crate) dictionary: Option<ObjectDictionary>,
    /// Place of `eds` for messages.
    pub(crate) eds_place: String,
}

const OBJECT: &str = "an object as \"6065:00\", index and sub-index in hexadecimal";

/// Reads the table; `gear_ratio` and `torque_constant`, N·m/A, of the drive.
pub(super) fn read(
    section: Section<'_, '_>,
    command: Command,
    (gear_ratio, torque_constant): (f64, f64),
    files: &Files<'_>,
) -> Option<CanopenDrive> {
    let sides = [("motor", Side::Motor), ("link", Side::Link)];
    let side = section.choice("position", &sides);
    let other_angle = object(&section, "other_angle");
    if side == Side::Link && !section.has("other_angle") {
        let what = "the key is missing, and 6064 is the link's angle: nothing measures the motor's";
        section.problem("other_angle", what, OBJECT);
    }
    let rated_current = section.number("rated_current_A", Allowed::Positive);
    let rated_torque = section.optional_number("rated_torque_Nm", Allowed::Positive);
    let rated_torque = rated_torque.unwrap_or(rated_current * torque_constant);
    let number = |key| section.optional_integer(key, 0..1 << 32).map(|n| n as u32);
    let kind = Kind {
        mode: match command {
            Command::Current => Mode::Torque,
            Command::Position => Mode::Position,
        },
        side,
        other_angle,
        velocity_unit: section.optional_number("velocity_rpm_per_count", Allowed::Positive),
        rated_current,
        current_per_torque: rated_torque / torque_constant,
        rated_torque: rated_torque * gear_ratio,
        reported: reported(&section),
        heartbeat_ms: section
            .optional_integer("heartbeat_ms", 20..2001)
            .unwrap_or(100) as u16,
        vendor: number("vendor"),
        product: number("product"),
        sdo: section.list("sdo").into_iter().filter_map(sdo).collect(),
    };
    let dictionary = eds(&section, files);
    let eds_place = section.place_of("eds");
    section.finish();
    let counts = [kind.rated_current, kind.current_per_torque];
    let counts = counts.iter().all(|current| current.is_finite());
    if !counts || side == Side::Link && other_angle.is_none() {
        return None;
    }
    Some(CanopenDrive {
        kind,
        dictionary,
        eds_place,
    })
}

/// What it is to tell of itself.
fn reported(section: &Section<'_, '_>) -> Reported {
    let mut reported = Reported::default();
    const ALLOWED: &str = "a list of \"error\", \"torque\" and \"voltage\"";
    for text in section.optional_texts("reports", ALLOWED) {
        match text.value {
            "error" => reported.error = true,
            "torque" => reported.torque = true,
            "voltage" => reported.voltage = true,
            other => section.problem("reports", format!("{other:?} is not allowed"), ALLOWED),
        }
    }
    let object = object(section, "temperature");
    let count = section.number_or("temperature_C_per_count", 1.0, Allowed::Positive);
    let bits = section.choice_or("temperature_bits", 16, &[("8", 8), ("16", 16), ("32", 32)]);
    reported.temperature = object.map(|object| (Mapped { object, bits }, count));
    reported
}

fn object(section: &Section<'_, '_>, key: &'static str) -> Option<Object> {
    let text = section.optional_text(key, OBJECT)?;
    let object = parse(text.value);
    if object.is_none() {
        section.problem(key, format!("{:?} is not allowed", text.value), OBJECT);
    }
    object
}

/// `6065:00`, or `6065`.
fn parse(text: &str) -> Option<Object> {
    let (index, sub) = text.split_once(':').unwrap_or((text, "0"));
    let index = index.strip_prefix("0x").unwrap_or(index);
    let fits = (1..=4).contains(&index.len()) && (1..=2).contains(&sub.len());
    let index = u16::from_str_radix(index, 16).ok().filter(|_| fits)?;
    Some(Object::new(index, u8::from_str_radix(sub, 16).ok()?))
}

/// One object to write; what is wrong with it has been noted.
fn sdo(section: Section<'_, '_>) -> Option<(Object, Vec<u8>)> {
    let object = object(&section, "object");
    if !section.has("object") {
        section.problem("object", "the key is missing", OBJECT);
    }
    let bits = section.number("bits", Allowed::Positive);
    if ![8.0, 16.0, 32.0].contains(&bits) && bits > 0.0 {
        section.problem("bits", format!("{bits} is not allowed"), "8, 16 or 32");
        section.has("value");
        section.finish();
        return None;
    }
    let half = 2f64.powf(bits - 1.0);
    let value = section.number("value", Allowed::Within(-half, 2.0 * half - 1.0));
    if value.is_finite() && value.fract() != 0.0 {
        section.problem("value", format!("{value} is not allowed"), "an integer");
    }
    section.finish();
    let bytes = (value as i64).to_le_bytes();
    Some((object?, bytes[..bits as usize / 8].to_vec()))
}

fn eds(section: &Section<'_, '_>, files: &Files<'_>) -> Option<ObjectDictionary> {
    let text = section.optional_text(
        "eds",
        "the path of an EDS or DCF file, relative to this file",
    )?;
    let path = paths::resolved(files.config, text.value);
    let content = (files.read)(&path).map_err(|error| {
        let problem = unreadable(&path, &error);
        let what = format!("{} {}", problem.file, problem.reason);
        section.problem("eds", what, problem.allowed);
    });
    ObjectDictionary::parse(&content.ok()?, &paths::shown(&path))
        .map_err(|problems| {
            problems
                .0
                .into_iter()
                .for_each(|problem| section.note(problem))
        })
        .ok()
}
