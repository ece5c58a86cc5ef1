//! Signals of any program's messages, in MCAP files or from elsewhere: JointState, WrenchStamped and Imu of ROS 2, as columns.

use std::collections::BTreeMap;
use std::io::Read;

use mcap::records::Record;
use mcap::sans_io::linear_reader::LinearReader;

use crate::reader::{Ending, ReadError, next_record, options};

/// One signal.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Signal {
    /// Time since the file's earliest stamp, s, increasing; by the message's own stamp, or by that of
    /// its recording where it has none.
    pub t: Vec<f64>,
    /// Values, in the message's unit.
    pub values: Vec<f64>,
}

/// The signals of a file.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Signals {
    /// By name: `TOPIC:JOINT.position`, `.velocity` and `.effort`; `TOPIC:fx` to `tz`; `TOPIC:gx` to
    /// `gz` and `ax` to `az`.
    pub columns: BTreeMap<String, Signal>,
    /// Topics of other kinds of message, with their schema.
    pub others: BTreeMap<String, String>,
    /// Messages that are not what their schema says.
    pub broken: u64,
    /// Messages that came after a later one of their topic; they are put in order.
    pub late: u64,
    /// Values that are left out, because their signal has one of that very stamp.
    pub repeated: u64,
    /// Values that are left out, because they are not finite.
    pub not_finite: u64,
    /// Messages that are compressed one by one (rosbag2 with zstd).
    pub compressed: u64,
    /// A topic whose messages name a joint twice, and that joint.
    pub twice: Option<(String, String)>,
}

/// Kinds of message that are read.
pub const READ_SCHEMAS: [&str; 3] = [
    "sensor_msgs/msg/JointState",
    "geometry_msgs/msg/WrenchStamped",
    "sensor_msgs/msg/Imu",
];

/// Reads the signals of an MCAP file, up to its end or to where it is damaged.
///
/// # Errors
/// The file is no MCAP file, or of the file system.
pub fn read_signals<R: Read>(mut source: R) -> Result<(Signals, Ending), ReadError> {
    let mut reader = LinearReader::new_with_options(options());
    let mut schemas = BTreeMap::new();
    let mut collector = SignalCollector::default();
    let mut started = false;
    loop {
        let step = next_record(&mut source, &mut reader, started, |record| {
            take(record, &mut schemas, &mut collector);
        })?;
        if let Err(ending) = step {
            return Ok((collector.finish(), ending));
        }
        started = true;
    }
}

fn take(record: Record<'_>, schemas: &mut BTreeMap<u16, String>, to: &mut SignalCollector) {
    match record {
        Record::Schema { header, .. } => {
            schemas.insert(header.id, header.name);
        }
        Record::Channel(channel) => {
            let schema = schemas.get(&channel.schema_id).map_or("", String::as_str);
            let id = i64::from(channel.id);
            to.topic(id, &channel.topic, schema, &channel.message_encoding);
        }
        Record::Message { header, data } => {
            to.message(i64::from(header.channel_id), header.log_time, &data);
        }
        _ => {}
    }
}

/// Signals of messages that come one by one, in any order, from whatever file.
#[derive(Debug, Default)]
pub struct SignalCollector {
    topics: BTreeMap<i64, Topic>,
    first_ns: Option<u64>,
    signals: Signals,
}

#[derive(Debug)]
struct Topic {
    name: String,
    /// Index in `READ_SCHEMAS`, of those that are read.
    kind: Option<usize>,
    last_ns: u64,
}

impl SignalCollector {
    /// Makes a topic known by the number that its messages carry, with its schema and encoding.
    pub fn topic(&mut self, id: i64, topic: &str, schema: &str, encoding: &str) {
        let full = full_name(schema);
        let kind = READ_SCHEMAS.iter().position(|known| *known == full);
        let kind = kind.filter(|_| encoding == "cdr");
        if kind.is_none() {
            let what = format!("{schema} as {encoding}");
            self.signals.others.insert(topic.to_owned(), what);
        }
        let name = topic.to_owned();
        let topic = Topic {
            name,
            kind,
            last_ns: 0,
        };
        self.topics.insert(id, topic);
    }

    /// Takes a message; those of topics that are not read are passed over.
    pub fn message(&mut self, topic: i64, recorded_ns: u64, data: &[u8]) {
        let Some(topic) = self.topics.get_mut(&topic) else {
            return;
        };
        let Some(kind) = topic.kind else {
            return;
        };
        let signals = &mut self.signals;
        if data.starts_with(&ZSTD) {
            signals.compressed += 1;
            return;
        }
        let Some((stamp_ns, values)) = decode(kind, data) else {
            signals.broken += 1;
            return;
        };
        let at = if stamp_ns > 0 { stamp_ns } else { recorded_ns };
        signals.late += u64::from(at < topic.last_ns);
        topic.last_ns = topic.last_ns.max(at);
        let first = *self.first_ns.get_or_insert(at);
        let t = (i128::from(at) - i128::from(first)) as f64 * 1e-9;
        let twice = (1..values.len()).find(|&k| values[..k].iter().any(|(n, _)| *n == values[k].0));
        if let Some((name, _)) = twice.and_then(|k| values.get(k)) {
            let joint = name
                .rsplit_once('.')
                .map_or(name.as_str(), |(joint, _)| joint);
            let found = (topic.name.clone(), joint.to_owned());
            signals.twice.get_or_insert(found);
        }
        for (name, value) in values {
            if value.is_finite() {
                let name = format!("{}:{name}", topic.name);
                let signal = signals.columns.entry(name).or_default();
                signal.t.push(t);
                signal.values.push(value);
            } else {
                signals.not_finite += 1;
            }
        }
    }

    /// The signals in the order of their stamps; of several values of one stamp the first.
    #[must_use]
    pub fn finish(self) -> Signals {
        let mut signals = self.signals;
        let starts = signals.columns.values().flat_map(|signal| &signal.t);
        let start = starts.copied().fold(f64::INFINITY, f64::min);
        for signal in signals.columns.values_mut() {
            let before = signal.t.len();
            signal.put_in_order(start);
            signals.repeated += (before - signal.t.len()) as u64;
        }
        signals
    }
}

impl Signal {
    fn put_in_order(&mut self, start: f64) {
        // First, for it may round two stamps to one.
        self.t.iter_mut().for_each(|t| *t -= start);
        if !self.t.is_sorted_by(|a, b| a < b) {
            let mut order: Vec<usize> = (0..self.t.len()).collect();
            order.sort_by(|a, b| self.t[*a].total_cmp(&self.t[*b]));
            order.dedup_by(|later, kept| self.t[*later] == self.t[*kept]);
            self.values = order.iter().map(|k| self.values[*k]).collect();
            self.t = order.iter().map(|k| self.t[*k]).collect();
        }
    }
}

/// Beginning of data that zstd has compressed.
const ZSTD: [u8; 4] = [0x28, 0xB5, 0x2F, 0xFD];

/// The name of a kind of message as ROS 2 writes it, from ROS 1's (`sensor_msgs/Imu`) or DDS's
/// (`sensor_msgs::msg::dds_::Imu_`).
fn full_name(schema: &str) -> String {
    let slashes = schema.replace("::dds_::", "::").replace("::", "/");
    let bare = slashes.trim_end_matches('_');
    match bare.split_once('/') {
        Some((package, name)) if !name.contains('/') => format!("{package}/msg/{name}"),
        _ => bare.to_owned(),
    }
}

/// Stamp in ns, and named values.
fn decode(kind: usize, data: &[u8]) -> Option<(u64, Vec<(String, f64)>)> {
    let mut cdr = Cdr::new(data)?;
    let seconds = cdr.u32()?;
    let stamp_ns = u64::from(seconds) * 1_000_000_000 + u64::from(cdr.u32()?);
    cdr.text()?;
    let named = |names: [&str; 3], values: [f64; 3]| {
        names
            .into_iter()
            .map(str::to_owned)
            .zip(values)
            .collect::<Vec<_>>()
    };
    let values = match kind {
        0 => {
            let names: Vec<String> = (0..cdr.length(5)?)
                .map(|_| cdr.text())
                .collect::<Option<_>>()?;
            let mut values = Vec::new();
            for quantity in ["position", "velocity", "effort"] {
                let numbers = cdr.sequence()?;
                // A quantity may be left out for all joints.
                if !numbers.is_empty() && numbers.len() != names.len() {
                    return None;
                }
                let named = names.iter().zip(numbers);
                values.extend(named.map(|(name, x)| (format!("{name}.{quantity}"), x)));
            }
            values
        }
        1 => {
            let mut values = named(["fx", "fy", "fz"], cdr.three()?);
            values.extend(named(["tx", "ty", "tz"], cdr.three()?));
            values
        }
        _ => {
            // Orientation and its covariance.
            cdr.skip(4 + 9)?;
            let mut values = named(["gx", "gy", "gz"], cdr.three()?);
            cdr.skip(9)?;
            values.extend(named(["ax", "ay", "az"], cdr.three()?));
            values
        }
    };
    Some((stamp_ns, values))
}

/// A message in CDR of either byte order, from front to back.
struct Cdr<'a> {
    body: &'a [u8],
    at: usize,
    big_endian: bool,
}

impl<'a> Cdr<'a> {
    fn new(data: &'a [u8]) -> Option<Self> {
        let (encoding, body) = data.split_at_checked(4)?;
        let big_endian = match encoding {
            [0, 0, ..] => true,
            [0, 1, ..] => false,
            _ => return None,
        };
        Some(Self {
            body,
            at: 0,
            big_endian,
        })
    }

    fn take(&mut self, size: usize, count: usize) -> Option<&'a [u8]> {
        let from = self.at.checked_next_multiple_of(size)?;
        let to = from.checked_add(size.checked_mul(count)?)?;
        let bytes = self.body.get(from..to)?;
        self.at = to;
        Some(bytes)
    }

    fn u32(&mut self) -> Option<u32> {
        let bytes = self.take(4, 1)?.try_into().ok()?;
        let read = if self.big_endian {
            u32::from_be_bytes
        } else {
            u32::from_le_bytes
        };
        Some(read(bytes))
    }

    fn f64(&mut self) -> Option<f64> {
        let bytes = self.take(8, 1)?.try_into().ok()?;
        let read = if self.big_endian {
            f64::from_be_bytes
        } else {
            f64::from_le_bytes
        };
        Some(read(bytes))
    }

    fn three(&mut self) -> Option<[f64; 3]> {
        Some([self.f64()?, self.f64()?, self.f64()?])
    }

    fn skip(&mut self, numbers: usize) -> Option<()> {
        self.take(8, numbers).map(|_| ())
    }

    /// Number of elements, each of at least `least` bytes: a broken one must not take the memory.
    fn length(&mut self, least: usize) -> Option<usize> {
        let length = self.u32()? as usize;
        let left = self.body.len().checked_sub(self.at)?;
        (length.checked_mul(least)? <= left).then_some(length)
    }

    fn text(&mut self) -> Option<String> {
        let length = self.length(1)?;
        let bytes = self.take(1, length)?;
        let text = bytes.strip_suffix(&[0]).unwrap_or(bytes);
        String::from_utf8(text.to_vec()).ok()
    }

    fn sequence(&mut self) -> Option<Vec<f64>> {
        (0..self.length(8)?).map(|_| self.f64()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::{SignalCollector, full_name};

    /// A JointState of two joints without velocities and efforts, in either byte order.
    fn joint_state(names: [&str; 2], big_endian: bool) -> Vec<u8> {
        let mut bytes = vec![0, u8::from(!big_endian), 0, 0];
        let number = |bytes: &mut Vec<u8>, x: u32| {
            bytes.resize(bytes.len().next_multiple_of(4), 0);
            bytes.extend(if big_endian {
                x.to_be_bytes()
            } else {
                x.to_le_bytes()
            });
        };
        for x in [7, 0, 1] {
            number(&mut bytes, x);
        }
        bytes.push(0);
        number(&mut bytes, 2);
        for name in names {
            number(&mut bytes, 2);
            bytes.extend(name.as_bytes());
            bytes.push(0);
        }
        number(&mut bytes, 2);
        for x in [0.5f64, -1.5] {
            let at = 4 + (bytes.len() - 4).next_multiple_of(8);
            bytes.resize(at, 0);
            bytes.extend(if big_endian {
                x.to_be_bytes()
            } else {
                x.to_le_bytes()
            });
        }
        number(&mut bytes, 0);
        number(&mut bytes, 0);
        bytes
    }

    #[test]
    fn either_byte_order_and_every_name_of_the_schema_are_read() {
        let schemas = [
            "sensor_msgs/msg/JointState",
            "sensor_msgs/JointState",
            "sensor_msgs::msg::dds_::JointState_",
        ];
        for (schema, big_endian) in schemas.into_iter().zip([false, true, false]) {
            assert_eq!(full_name(schema), schemas[0]);
            let mut collector = SignalCollector::default();
            collector.topic(1, "/j", schema, "cdr");
            collector.message(1, 0, &joint_state(["a", "b"], big_endian));
            let signals = collector.finish();
            assert_eq!(signals.broken, 0, "{schema}");
            assert_eq!(signals.columns["/j:a.position"].values, [0.5]);
            assert_eq!(signals.columns["/j:b.position"].values, [-1.5]);
        }
    }

    #[test]
    fn compressed_messages_and_joints_named_twice_are_noticed() {
        let mut collector = SignalCollector::default();
        collector.topic(1, "/j", "sensor_msgs/msg/JointState", "cdr");
        collector.message(1, 0, &[0x28, 0xB5, 0x2F, 0xFD, 1, 2]);
        collector.message(1, 0, &joint_state(["a", "a"], false));
        let signals = collector.finish();
        assert_eq!((signals.compressed, signals.broken), (1, 0));
        assert_eq!(signals.twice, Some(("/j".into(), "a".into())));
    }
}
