//! The bytes of a record that are in use: of its arrays of joints, F/T sensors and IMUs only as many
//! elements as the robot has.

use core::ops::Range;
use robot_state::{Layout, MAX_FT_SENSORS, MAX_FURTHER_IMUS, MAX_JOINTS, Shape};

/// Joints and sensors of a robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// Joints.
    pub joints: usize,
    /// F/T sensors.
    pub sensors: usize,
    /// IMUs beside the first one.
    pub further_imus: usize,
}

/// The parts of one type of record that are in use, in order.
#[derive(Debug, Clone)]
pub(crate) struct Compact {
    parts: Vec<Range<usize>>,
    len: usize,
}

impl Compact {
    pub(crate) fn new<T: Layout>(counts: Counts) -> Self {
        let mut parts = Vec::new();
        collect(&T::SHAPE, 0, counts, &mut parts);
        let len = parts.iter().map(Range::len).sum();
        Self { parts, len }
    }

    /// Bytes of the parts together.
    pub(crate) fn len(&self) -> usize {
        self.len
    }

    /// Appends the parts of a record's bytes.
    pub(crate) fn put(&self, record: &[u8], out: &mut Vec<u8>) {
        for part in &self.parts {
            out.extend_from_slice(record.get(part.clone()).unwrap_or_default());
        }
    }

    /// Writes the parts into a record's bytes; the others keep their value. `bytes` must be
    /// [`len`](Self::len) long.
    pub(crate) fn take(&self, mut bytes: &[u8], record: &mut [u8]) {
        for part in &self.parts {
            let Some((from, rest)) = bytes.split_at_checked(part.len()) else {
                return;
            };
            if let Some(to) = record.get_mut(part.clone()) {
                to.copy_from_slice(from);
            }
            bytes = rest;
        }
    }
}

/// How many elements of an array are in use.
pub(crate) fn used(element: &Shape, count: usize, counts: Counts) -> usize {
    match (element, count) {
        // Only arrays of records: a text or a list of counts may happen to be as long.
        (Shape::Record(..), MAX_JOINTS) => counts.joints.min(count),
        (Shape::Record(..), MAX_FT_SENSORS) => counts.sensors.min(count),
        (Shape::Record("ImuMeasured", ..), MAX_FURTHER_IMUS) => counts.further_imus.min(count),
        _ => count,
    }
}

/// Size of a shape, bytes.
pub(crate) fn size(shape: &Shape) -> usize {
    match shape {
        Shape::U8 => 1,
        Shape::U32 => 4,
        Shape::U64 | Shape::F64 => 8,
        Shape::Array(element, count) => size(element) * count,
        Shape::Record(_, _, size) => *size,
    }
}

fn collect(shape: &Shape, at: usize, counts: Counts, parts: &mut Vec<Range<usize>>) {
    match shape {
        Shape::Record(_, fields, _) => {
            for field in *fields {
                collect(&field.shape, at + field.offset, counts, parts);
            }
        }
        Shape::Array(element, count) => {
            let len = size(element) * used(element, *count, counts);
            append(at..at + len, parts);
        }
        single => append(at..at + size(single), parts),
    }
}

fn append(part: Range<usize>, parts: &mut Vec<Range<usize>>) {
    match parts.last_mut() {
        _ if part.is_empty() => {}
        Some(last) if last.end == part.start => last.end = part.end,
        _ => parts.push(part),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use robot_state::{SharedRecord, Zero};
    use zerocopy::{FromBytes, IntoBytes};

    #[test]
    fn a_record_survives_but_for_what_is_not_in_use() {
        let counts = Counts {
            joints: 30,
            sensors: 4,
            further_imus: 1,
        };
        let compact = Compact::new::<SharedRecord>(counts);
        let bytes: Vec<u8> = (0..size_of::<SharedRecord>())
            .map(|i| (i % 251) as u8)
            .collect();
        let record = SharedRecord::read_from_bytes(&bytes).expect("the record's size");
        let mut short = Vec::new();
        compact.put(record.as_bytes(), &mut short);
        assert_eq!(short.len(), compact.len());
        assert!(short.len() < bytes.len() * 6 / 10);
        let mut back = SharedRecord::ZERO;
        compact.take(&short, back.as_mut_bytes());
        let in_use = |record: &SharedRecord| {
            let cycle = &record.cycle;
            let [measured, estimated, commanded] = [
                cycle.measured.joints[29].as_bytes().to_vec(),
                cycle.estimated.ft[3].as_bytes().to_vec(),
                cycle.commanded.joints[29].as_bytes().to_vec(),
            ];
            (
                measured,
                estimated,
                commanded,
                cycle.events,
                record.timing.as_bytes().to_vec(),
            )
        };
        assert_eq!(in_use(&back), in_use(&record));
        assert!(
            back.cycle.measured.joints[30]
                .as_bytes()
                .iter()
                .all(|b| *b == 0)
        );
    }
}
