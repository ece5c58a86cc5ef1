//! Writing a recorded run.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::{Seek, Write};

use mcap::records::{MessageHeader, Metadata};
use mcap::{Attachment, Compression, McapError, WriteOptions};
use robot_state::Content;

use crate::coder::Coder;
use crate::header::{Header, METADATA};
use crate::message::{CycleMessage, Decoder};
use crate::ros::{RosChannel, RosMessages};
use crate::schema::{self, OWN_ENCODING};

/// Bytes of a chunk before compression: what a crash can lose, some tens of milliseconds.
const CHUNK: u64 = 1 << 20;
/// The level that costs the recorder's thread least.
const LEVEL: u32 = 1;
/// Intervals of ROS 2's messages, s: beside frames for a glance by other people's tools, beside torques as
/// finely as a plot shows. Their 64-bit numbers at 1 kHz would take as much again as the torques do.
const ROS_BESIDE_FRAMES_S: f64 = 0.1;
const ROS_BESIDE_TORQUES_S: f64 = 0.01;

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

/// A file that is being written, cycle by cycle. It is never seeked in: what was flushed stays
/// readable, whatever happens later.
pub struct RunWriter<W: Write + Seek> {
    file: mcap::Writer<W>,
    header: Header,
    decoder: Decoder,
    coder: Coder,
    message: CycleMessage,
    own_bytes: Vec<u8>,
    own: u16,
    ros: RosMessages,
    ros_channels: Vec<u16>,
    sequence: u32,
    /// Cycles for each of ROS 2's messages.
    ros_every: u64,
}

/// Cycles for each of ROS 2's messages: a multiple of those for each of our own.
fn ros_every(header: &Header) -> u64 {
    let every = f64::from(header.every);
    let interval_s = match header.content {
        Content::All => 0.0,
        Content::Frames => ROS_BESIDE_FRAMES_S,
        Content::Torques => ROS_BESIDE_TORQUES_S,
    };
    let multiple = (interval_s / (every * header.period_s)).round().max(1.0);
    (every * multiple) as u64
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
        let schema = schema::own(header.content, header.counts());
        let (name, topic) = schema::own_names(header.content);
        let own = file.add_schema(name, OWN_ENCODING, schema.as_bytes())?;
        let own = file.add_channel(own, topic, OWN_ENCODING, &none)?;
        let ros = RosMessages::new(&header.joints, &header.sensors, &header.imus);
        let ros_channels = ros.channels().into_iter().map(|channel| {
            let schema = channel.schema.as_bytes();
            let encoding = RosChannel::SCHEMA_ENCODING;
            let schema = file.add_schema(channel.schema_name, encoding, schema)?;
            file.add_channel(schema, &channel.topic, RosChannel::ENCODING, &none)
        });
        let ros_channels = ros_channels.collect::<Result<_, McapError>>()?;
        Ok(Self {
            file,
            decoder: Decoder::new(header.counts()),
            coder: Coder::new(header.content, header.counts()),
            own_bytes: Vec::new(),
            ros_every: ros_every(header),
            header: header.clone(),
            message: CycleMessage::default(),
            own,
            ros,
            ros_channels,
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
        if !record.sequence.is_multiple_of(u64::from(self.header.every)) {
            return Ok(());
        }
        let offset_ns = self.header.start.unix_offset_ns;
        let stamp_ns = record.stamp_ns.saturating_add_signed(offset_ns);
        let sequence = self.sequence;
        self.sequence = sequence.wrapping_add(1);
        let header = |channel_id: u16| MessageHeader {
            channel_id,
            sequence,
            log_time: stamp_ns,
            publish_time: stamp_ns,
        };
        let own = self.coder.encode(bytes, &self.message, &mut self.own_bytes);
        self.file.write_to_known_channel(&header(self.own), own)?;
        if !record.sequence.is_multiple_of(self.ros_every) {
            return Ok(());
        }
        let (file, channels) = (&mut self.file, &self.ros_channels);
        self.ros.write(stamp_ns, record, |channel, bytes| {
            let channel = channels.get(channel).copied().unwrap_or_default();
            file.write_to_known_channel(&header(channel), bytes)
        })?;
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
