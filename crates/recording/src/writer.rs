//! Writing a recorded run.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::{Seek, Write};

use mcap::records::{MessageHeader, Metadata};
use mcap::{Attachment, Compression, McapError, WriteOptions};

use crate::cdr::Cdr;
use crate::header::{Header, METADATA};
use crate::message::{CycleMessage, Decoder};
use crate::schema::{self, OWN_ENCODING, OWN_NAME, OWN_TOPIC, ROS_MESSAGE, ROS_SCHEMA};

/// Bytes of a chunk before compression: what a crash can lose, some tens of milliseconds.
const CHUNK: u64 = 1 << 20;
/// The level that costs the recorder's thread least.
const LEVEL: u32 = 1;

/// Writing failed.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// Of the file system, e.g. a full disk.
    #[error("{0}")]
    Io(#[from] std::io::Error),
    /// Of the format.
    #[error("{0}")]
    Format(McapError),
    /// Bytes that are no message.
    #[error("a message of {0} bytes could not be read")]
    Message(usize),
}

impl From<McapError> for WriteError {
    fn from(error: McapError) -> Self {
        match error {
            McapError::Io(error) => Self::Io(error),
            other => Self::Format(other),
        }
    }
}

/// Channels of the messages that other people's tools know.
#[derive(Debug, Default)]
struct RosChannels {
    joints: u16,
    wrenches: Vec<u16>,
    imus: Vec<u16>,
}

/// A file that is being written, cycle by cycle. It is never seeked in: what was flushed stays
/// readable, whatever happens later.
pub struct RunWriter<W: Write + Seek> {
    file: mcap::Writer<W>,
    header: Header,
    decoder: Decoder,
    message: CycleMessage,
    cdr: Cdr,
    own: u16,
    ros: RosChannels,
    sequence: u32,
}

impl<W: Write + Seek> RunWriter<W> {
    /// Begins a file with its header and the configuration's files.
    ///
    /// # Errors
    /// As [`write`](Self::write).
    pub fn new(file: W, header: &Header) -> Result<Self, WriteError> {
        let options = WriteOptions::new()
            .profile("ros2")
            .library(format!("torqued {}", header.version))
            .compression(Some(Compression::Zstd))
            .compression_level(LEVEL)
            .compression_threads(0)
            .chunk_size(Some(CHUNK))
            .disable_seeking(true);
        let mut file = mcap::Writer::with_options(file, options)?;
        file.write_metadata(&Metadata {
            name: METADATA.to_owned(),
            metadata: header.to_metadata(),
        })?;
        for attached in &header.files {
            file.attach(&Attachment {
                log_time: 0,
                create_time: 0,
                name: attached.path.clone(),
                media_type: "text/plain".to_owned(),
                data: Cow::Borrowed(attached.text.as_bytes()),
            })?;
        }
        let none = BTreeMap::new();
        let schema = schema::own(header.counts());
        let own = file.add_schema(OWN_NAME, OWN_ENCODING, schema.as_bytes())?;
        let own = file.add_channel(own, OWN_TOPIC, OWN_ENCODING, &none)?;
        let mut ros_channel = |name: &str, schema: &str, topic: &str| {
            let schema = file.add_schema(name, ROS_SCHEMA, schema.as_bytes())?;
            file.add_channel(schema, topic, ROS_MESSAGE, &none)
        };
        let (name, text) = ("sensor_msgs/msg/JointState", schema::joint_state());
        let joints = ros_channel(name, &text, "/joint_states")?;
        let (name, text) = ("geometry_msgs/msg/WrenchStamped", schema::wrench());
        let wrenches = header.sensors.iter();
        let wrenches =
            wrenches.map(|sensor| ros_channel(name, &text, &format!("/wrench/{sensor}")));
        let wrenches = wrenches.collect::<Result<_, _>>()?;
        // The first one shows the base's motion.
        let topics = header.imus.iter().skip(1);
        let topics = std::iter::once("/imu".to_owned()).chain(topics.map(|f| format!("/imu/{f}")));
        let imus = topics.map(|topic| ros_channel("sensor_msgs/msg/Imu", &schema::imu(), &topic));
        let imus = imus.collect::<Result<_, _>>()?;
        Ok(Self {
            file,
            decoder: Decoder::new(header.counts()),
            header: header.clone(),
            message: CycleMessage::default(),
            cdr: Cdr::default(),
            own,
            ros: RosChannels {
                joints,
                wrenches,
                imus,
            },
            sequence: 0,
        })
    }

    /// Writes the message of a cycle, and what follows from it for other people's tools.
    ///
    /// # Errors
    /// Of the file system; nothing more can be written then.
    pub fn write(&mut self, bytes: &[u8]) -> Result<(), WriteError> {
        let decoded = self.decoder.decode(bytes, &mut self.message);
        decoded.ok_or(WriteError::Message(bytes.len()))?;
        let record = &self.message.record.cycle;
        let offset_ns = self.header.start.unix_offset_ns;
        let stamp_ns = record.stamp_ns.saturating_add_signed(offset_ns);
        let header = |channel_id: u16| MessageHeader {
            channel_id,
            sequence: self.sequence,
            log_time: stamp_ns,
            publish_time: stamp_ns,
        };
        self.file.write_to_known_channel(&header(self.own), bytes)?;
        self.cdr.joint_state(stamp_ns, &self.header.joints, record);
        (self.file).write_to_known_channel(&header(self.ros.joints), self.cdr.bytes())?;
        let sensors = self.header.sensors.iter().zip(&record.measured.ft);
        for ((sensor, measured), channel) in sensors.zip(&self.ros.wrenches) {
            self.cdr.wrench(stamp_ns, sensor, measured);
            (self.file).write_to_known_channel(&header(*channel), self.cdr.bytes())?;
        }
        let further = &record.measured.further_imus;
        let imus = std::iter::once(&record.measured.imu).chain(further);
        let frames =
            std::iter::once("imu").chain(self.header.imus.iter().skip(1).map(String::as_str));
        for ((imu, frame), channel) in imus.zip(frames).zip(&self.ros.imus) {
            self.cdr.imu(stamp_ns, frame, imu);
            (self.file).write_to_known_channel(&header(*channel), self.cdr.bytes())?;
        }
        self.sequence = self.sequence.wrapping_add(1);
        Ok(())
    }

    /// Writes out what has been collected: a crash from now on does not lose it.
    ///
    /// # Errors
    /// As [`write`](Self::write).
    pub fn flush(&mut self) -> Result<(), WriteError> {
        Ok(self.file.flush()?)
    }

    /// Ends the file, with its index.
    ///
    /// # Errors
    /// As [`write`](Self::write).
    pub fn finish(mut self) -> Result<W, WriteError> {
        self.end()?;
        Ok(self.into_inner())
    }

    /// Writes the file's end, with its index; nothing can be written after it.
    ///
    /// # Errors
    /// As [`write`](Self::write).
    pub fn end(&mut self) -> Result<(), WriteError> {
        self.file.finish()?;
        Ok(())
    }

    /// The destination, whether the file is whole or not.
    pub fn into_inner(self) -> W {
        self.file.into_inner()
    }
}
