//! The numbers of a record by name: for tables, and to name what differs between two records.

use std::borrow::Cow;

use robot_state::{JointKind, Layout, Shape};

use crate::compact::{Counts, size, used};
use crate::header::Header;

/// Type of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// 8-bit unsigned integer.
    U8,
    /// 32-bit unsigned integer.
    U32,
    /// 64-bit unsigned integer.
    U64,
    /// 64-bit IEEE float.
    F64,
}

/// One number of a record.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Field {
    /// Its path, e.g. `measured.joints[3].q`.
    pub path: String,
    /// The joint that it is of.
    pub joint: Option<usize>,
    /// The F/T sensor that it is of.
    pub sensor: Option<usize>,
    /// Its type.
    pub kind: Kind,
    /// Bytes from the record's start.
    pub offset: usize,
    /// Its documentation: symbol, meaning, unit.
    pub doc: &'static str,
}

impl Field {
    /// The number's bytes in a record's bytes.
    pub(crate) fn bytes<'a>(&self, record: &'a [u8]) -> &'a [u8] {
        record.get(self.place()).unwrap_or_default()
    }

    /// The number's bytes in a record's bytes, to be written.
    pub(crate) fn bytes_mut<'a>(&self, record: &'a mut [u8]) -> Option<&'a mut [u8]> {
        record.get_mut(self.place())
    }

    fn place(&self) -> core::ops::Range<usize> {
        let len = match self.kind {
            Kind::U8 => 1,
            Kind::U32 => 4,
            Kind::U64 | Kind::F64 => 8,
        };
        self.offset..self.offset + len
    }

    /// The number in a record's bytes; large integers are rounded.
    #[must_use]
    pub fn value(&self, record: &[u8]) -> f64 {
        let bits = self.bits(record);
        match self.kind {
            Kind::F64 => f64::from_bits(bits),
            Kind::U8 | Kind::U32 | Kind::U64 => bits as f64,
        }
    }

    /// The number's bits, as the lowest of 64.
    #[must_use]
    pub fn bits(&self, record: &[u8]) -> u64 {
        let bytes = self.bytes(record);
        let mut eight = [0; 8];
        if let Some(low) = eight.get_mut(..bytes.len()) {
            low.copy_from_slice(bytes);
        }
        u64::from_le_bytes(eight)
    }

    /// The number as text: of a float as many digits as determine its bits.
    #[must_use]
    pub fn text(&self, record: &[u8]) -> String {
        let bytes = self.bytes(record);
        match (self.kind, <[u8; 8]>::try_from(bytes)) {
            (Kind::U64, Ok(bytes)) => u64::from_le_bytes(bytes).to_string(),
            _ => self.value(record).to_string(),
        }
    }

    /// Its unit, of a joint's field that of the joint's kind.
    #[must_use]
    pub fn unit(&self, header: &Header) -> Option<Cow<'static, str>> {
        unit_of(self.doc).map(|unit| self.kind(header).units(unit))
    }

    /// Its documentation, of a joint's field with the units of the joint's kind.
    #[must_use]
    pub fn meaning(&self, header: &Header) -> Cow<'static, str> {
        self.kind(header).units(self.doc.trim())
    }

    /// The kind of joint whose units it has.
    fn kind(&self, header: &Header) -> JointKind {
        // The motor's side is in rad whatever the joint is.
        let motor_side = self.doc.contains("motor-side");
        let joint = self.joint.filter(|_| !motor_side);
        joint.map_or(JointKind::Revolute, |joint| header.kind(joint))
    }

    /// The path, with joint or sensor by name.
    #[must_use]
    pub fn named(&self, header: &Header) -> String {
        let name =
            |names: &[String], index: Option<usize>| Some((index?, names.get(index?)?.clone()));
        let joint = name(&header.joints, self.joint);
        let Some((index, name)) = joint.or_else(|| name(&header.sensors, self.sensor)) else {
            return self.path.clone();
        };
        self.path
            .replacen(&format!("[{index}]"), &format!("[{name}]"), 1)
    }
}

/// All numbers of a type of record that are in use, in the order of their offsets.
#[derive(Debug, Clone)]
pub struct Fields(pub Vec<Field>);

impl Fields {
    /// The fields of the record `T` of a robot of so many joints and sensors.
    #[must_use]
    pub fn new<T: Layout>(counts: Counts) -> Self {
        let mut fields = Vec::new();
        let root = Field {
            path: String::new(),
            joint: None,
            sensor: None,
            kind: Kind::U8,
            offset: 0,
            doc: "",
        };
        collect(&T::SHAPE, &root, counts, &mut fields);
        Self(fields)
    }

    /// The first field whose bits differ between two records.
    #[must_use]
    pub fn first_difference(&self, one: &[u8], other: &[u8]) -> Option<&Field> {
        self.0
            .iter()
            .find(|field| field.bytes(one) != field.bytes(other))
    }
}

fn collect(shape: &Shape, here: &Field, counts: Counts, fields: &mut Vec<Field>) {
    let kind = match shape {
        Shape::U8 => Kind::U8,
        Shape::U32 => Kind::U32,
        Shape::U64 => Kind::U64,
        Shape::F64 => Kind::F64,
        Shape::Record(_, parts, _) => {
            for part in *parts {
                let dot = if here.path.is_empty() { "" } else { "." };
                let inner = Field {
                    path: format!("{}{dot}{}", here.path, part.name),
                    offset: here.offset + part.offset,
                    doc: part.doc,
                    ..here.clone()
                };
                collect(&part.shape, &inner, counts, fields);
            }
            return;
        }
        Shape::Array(element, count) => {
            let in_use = used(element, *count, counts);
            for index in 0..in_use {
                let mut inner = Field {
                    path: format!("{}[{index}]", here.path),
                    offset: here.offset + index * size(element),
                    ..here.clone()
                };
                if matches!(element, Shape::Record(..)) {
                    match *count {
                        robot_state::MAX_JOINTS => inner.joint = Some(index),
                        robot_state::MAX_FT_SENSORS => inner.sensor = Some(index),
                        _ => {}
                    }
                }
                collect(element, &inner, counts, fields);
            }
            return;
        }
    };
    fields.push(Field {
        kind,
        ..here.clone()
    });
}

/// Units as documentation writes them, longer ones first.
const UNITS: [&str; 13] = [
    "N·m·s/rad",
    "N·m/rad",
    "rad/s²",
    "m/s²",
    "rad/s",
    "N·m",
    "rad",
    "°C",
    "ns",
    "A",
    "N",
    "V",
    "s",
];

/// The unit that a field's documentation names: after a comma, before the next sign or word.
fn unit_of(doc: &str) -> Option<&'static str> {
    doc.split(", ").skip(1).find_map(|part| {
        UNITS.into_iter().find(|unit| {
            let rest = part.strip_prefix(unit);
            rest.is_some_and(|rest| {
                !rest.starts_with(|c: char| c.is_alphanumeric() || "/·".contains(c))
            })
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use robot_state::SharedRecord;

    #[test]
    fn fields_have_names_offsets_and_units() {
        let counts = Counts {
            joints: 3,
            sensors: 1,
            further_imus: 0,
        };
        let fields = Fields::new::<SharedRecord>(counts).0;
        let field = |path: &str| fields.iter().find(|f| f.path == path).expect(path);
        let q = field("cycle.measured.joints[2].q");
        assert_eq!(
            (q.joint, q.sensor, unit_of(q.doc)),
            (Some(2), None, Some("rad"))
        );
        let force = field("cycle.measured.ft[0].wrench.force[1]");
        assert_eq!((force.sensor, unit_of(force.doc)), (Some(0), Some("N")));
        let torque = field("cycle.measured.ft[0].wrench.torque[1]");
        assert_eq!(unit_of(torque.doc), Some("N·m"));
        assert_eq!(unit_of(field("cycle.stamp_ns").doc), Some("ns"));
        assert_eq!(unit_of("K_s: stiffness, N·m/rad, at most"), Some("N·m/rad"));
        assert_eq!(
            unit_of(field("cycle.measured.joints[0].current").doc),
            Some("A")
        );
        assert_eq!(
            unit_of(field("cycle.measured.joints[0].voltage").doc),
            Some("V")
        );
        assert_eq!(unit_of(field("cycle.measured.joints[0].flags").doc), None);
        assert!(fields.iter().all(|f| !f.path.contains("joints[3]")));
    }

    #[test]
    fn the_first_difference_is_named_by_its_bits() {
        use robot_state::Zero;
        use zerocopy::IntoBytes;
        let fields = Fields::new::<SharedRecord>(Counts {
            joints: 3,
            sensors: 1,
            further_imus: 0,
        });
        let (one, mut other) = (SharedRecord::ZERO, SharedRecord::ZERO);
        assert_eq!(
            fields.first_difference(one.as_bytes(), other.as_bytes()),
            None
        );
        other.cycle.commanded.joints[1].tau_d = -0.0;
        other.cycle.events[0] = 1;
        let found = fields.first_difference(one.as_bytes(), other.as_bytes());
        let found = found.expect("minus zero has other bits");
        assert_eq!(found.path, "cycle.commanded.joints[1].tau_d");
        assert_eq!(found.text(other.as_bytes()), "-0");
    }
}
