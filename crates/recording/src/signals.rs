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
        let kind = READ_SCHEMAS.iter().position(|known| *known == schema);
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
        let Some((stamp_ns, values)) = decode(kind, data) else {
            signals.broken += 1;
            return;
        };
        let at = if stamp_ns > 0 { stamp_ns } else { recorded_ns };
        signals.late += u64::from(at < topic.last_ns);
        topic.last_ns = topic.last_ns.max(at);
        let first = *self.first_ns.get_or_insert(at);
        let t = (i128::from(at) - i128::from(first)) as f64 * 1e-9;
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

/// A message in little-endian CDR, from front to back.
struct Cdr<'a> {
    body: &'a [u8],
    at: usize,
}

impl<'a> Cdr<'a> {
    fn new(data: &'a [u8]) -> Option<Self> {
        let (encoding, body) = data.split_at_checked(4)?;
        (encoding.get(1) == Some(&1)).then_some(Self { body, at: 0 })
    }

    fn take(&mut self, size: usize, count: usize) -> Option<&'a [u8]> {
        let from = self.at.checked_next_multiple_of(size)?;
        let to = from.checked_add(size.checked_mul(count)?)?;
        let bytes = self.body.get(from..to)?;
        self.at = to;
        Some(bytes)
    }

    fn u32(&mut self) -> Option<u32> {
        let bytes = self.take(4, 1)?;
        Some(u32::from_le_bytes(bytes.try_into().ok()?))
    }

    fn f64(&mut self) -> Option<f64> {
        let bytes = self.take(8, 1)?;
        Some(f64::from_le_bytes(bytes.try_into().ok()?))
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
