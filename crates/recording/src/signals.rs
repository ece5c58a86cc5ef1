//! Signals of any program's MCAP file: JointState, WrenchStamped and Imu of ROS 2, as columns.

use std::collections::BTreeMap;
use std::io::Read;

use mcap::records::Record;
use mcap::sans_io::linear_reader::LinearReader;

use crate::reader::{Ending, ReadError, next_record, options};

/// One signal.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Signal {
    /// Time since the file's first message, s, increasing; by the message's own stamp, or by that of
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
    /// Messages that are not what their schema says, or older than the one before.
    pub passed_over: u64,
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
    let mut file = File::default();
    let mut started = false;
    loop {
        let step = next_record(&mut source, &mut reader, started, |record| {
            file.take(record)
        })?;
        if let Err(ending) = step {
            return Ok((file.signals, ending));
        }
        started = true;
    }
}

#[derive(Default)]
struct File {
    schemas: BTreeMap<u16, String>,
    /// Topic, kind and encoding of each channel.
    channels: BTreeMap<u16, (String, Option<usize>)>,
    first_ns: Option<u64>,
    signals: Signals,
}

impl File {
    fn take(&mut self, record: Record<'_>) {
        match record {
            Record::Schema { header, .. } => {
                self.schemas.insert(header.id, header.name);
            }
            Record::Channel(channel) => {
                let schema = self.schemas.get(&channel.schema_id).cloned();
                let schema = schema.unwrap_or_default();
                let kind = READ_SCHEMAS.iter().position(|known| *known == schema);
                let kind = kind.filter(|_| channel.message_encoding == "cdr");
                if kind.is_none() {
                    let what = format!("{schema} as {}", channel.message_encoding);
                    self.signals.others.insert(channel.topic.clone(), what);
                }
                self.channels.insert(channel.id, (channel.topic, kind));
            }
            Record::Message { header, data } => {
                let Some((topic, Some(kind))) = self.channels.get(&header.channel_id) else {
                    return;
                };
                let found = decode(*kind, &data);
                let kept = found.is_some_and(|(stamp_ns, values)| {
                    let at = if stamp_ns > 0 {
                        stamp_ns
                    } else {
                        header.log_time
                    };
                    let first = *self.first_ns.get_or_insert(at);
                    let t = (at as i128 - first as i128) as f64 * 1e-9;
                    self.signals.add(topic, t, values)
                });
                self.signals.passed_over += u64::from(!kept);
            }
            _ => {}
        }
    }
}

impl Signals {
    /// False if time does not advance.
    fn add(&mut self, topic: &str, t: f64, values: Vec<(String, f64)>) -> bool {
        values.into_iter().fold(true, |all, (name, value)| {
            let signal = self.columns.entry(format!("{topic}:{name}")).or_default();
            let advances = signal.t.last().is_none_or(|last| t > *last);
            if advances {
                signal.t.push(t);
                signal.values.push(value);
            }
            all && advances
        })
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
    let finite = values.iter().all(|(_, x)| x.is_finite());
    finite.then_some((stamp_ns, values))
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
