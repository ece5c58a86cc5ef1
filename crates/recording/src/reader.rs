//! Reading a recorded run, cycle by cycle, from a file that may be damaged.

use std::io::{self, Read};

use mcap::McapError;
use mcap::records::Record;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

use problem::Problems;
use robot_state::Content;

use crate::coder::Coder;
use crate::header::{Header, METADATA};
use crate::message::CycleMessage;
use crate::replay::{Replay, Replayed};
use crate::schema::own_names;

/// Longest record of a file that is read, bytes: a broken length must not take the memory.
const MAX_RECORD: usize = 1 << 28;

/// Why a file cannot be read as a recorded run.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// Of the file system.
    #[error("cannot be read: {0}")]
    Io(#[from] io::Error),
    /// Something else.
    #[error("is not an MCAP file; allowed: a run that torqued has recorded")]
    NotMcap,
    /// Another program's.
    #[error(
        "is an MCAP file, but no recorded run: it has no metadata {METADATA:?}; allowed: a run that \
         torqued has recorded"
    )]
    NotARun,
    /// Another version's.
    #[error(
        "was recorded by version {version} with another layout of records (its {found:016x}, ours {own:016x}); allowed: a run of this version; what it holds for other tools can be read by \
         them"
    )]
    OtherVersion {
        /// Version of the program that recorded.
        version: String,
        /// Hash of its layout.
        found: u64,
        /// Hash of ours.
        own: u64,
    },
    /// The file ends or is damaged before the first cycle.
    #[error("holds no whole cycle: {0}")]
    NoCycle(String),
}

impl ReadError {
    fn of_version(version: String, found: u64) -> Self {
        Self::OtherVersion {
            version,
            found,
            own: Header::layout(),
        }
    }
}

/// How a file ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Ending {
    /// As it should.
    Complete,
    /// Before its end, as after a crash or with a full disk; what was there has been read.
    Truncated,
    /// At a damage; what stood before it has been read.
    Damaged(String),
}

/// A recorded run that is being read.
pub struct Run<R> {
    source: R,
    reader: LinearReader,
    header: Header,
    coder: Coder,
    channel: u16,
    /// The first cycle's message, read with the header.
    first: Option<Vec<u8>>,
    ending: Option<Ending>,
    /// Computes what a recording of frames does not hold.
    replay: Option<Box<Replay>>,
}

/// Result of one step of reading.
enum Found {
    Metadata(Box<Header>, u64),
    OtherVersion(Option<String>),
    Attachment(String, Vec<u8>),
    Channel(u16, String),
    Message(u16, Vec<u8>),
    Other,
    End(Ending),
}

impl<R: Read> Run<R> {
    /// Reads the header, up to the first cycle.
    ///
    /// # Errors
    /// The file is not a recorded run of this version, or holds no cycle.
    pub fn open(mut source: R) -> Result<Self, ReadError> {
        let mut reader = LinearReader::new_with_options(options());
        let (mut header, mut channel) = (None, None);
        let mut started = false;
        loop {
            match next(&mut source, &mut reader, started)? {
                Found::Metadata(found, layout) if layout == Header::layout() => {
                    header = Some(*found);
                }
                Found::Metadata(found, layout) => {
                    return Err(ReadError::of_version(found.version, layout));
                }
                Found::OtherVersion(version) => {
                    let version = version.unwrap_or_else(|| "unknown".to_owned());
                    return Err(ReadError::of_version(version, 0));
                }
                Found::Attachment(path, data) => attach(header.as_mut(), &path, data),
                Found::Channel(id, topic) if is_own(&topic, header.as_ref()) => channel = Some(id),
                Found::Message(..) if header.is_none() => return Err(ReadError::NotARun),
                Found::Message(id, data) if Some(id) == channel => {
                    let (Some(header), Some(channel)) = (header, channel) else {
                        return Err(ReadError::NotARun);
                    };
                    return Ok(Self {
                        coder: Coder::new(header.content, header.counts()),
                        source,
                        reader,
                        header,
                        channel,
                        first: Some(data),
                        ending: None,
                        replay: None,
                    });
                }
                Found::Channel(..) | Found::Message(..) | Found::Other => {}
                Found::End(_) if header.is_none() && started => return Err(ReadError::NotARun),
                Found::End(Ending::Complete) => {
                    return Err(ReadError::NoCycle("nothing was recorded".to_owned()));
                }
                Found::End(Ending::Truncated) => {
                    return Err(ReadError::NoCycle("the file ends too early".to_owned()));
                }
                Found::End(Ending::Damaged(why)) => return Err(ReadError::NoCycle(why)),
            }
            started = true;
        }
    }

    /// Origin of the run.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// Reads the next cycle; `false`: there is none, and [`ending`](Self::ending) shows why.
    ///
    /// # Errors
    /// Of the file system.
    pub fn next_cycle(&mut self, message: &mut CycleMessage) -> Result<bool, ReadError> {
        while self.ending.is_none() {
            let found = match self.first.take() {
                Some(data) => Found::Message(self.channel, data),
                None => next(&mut self.source, &mut self.reader, true)?,
            };
            match found {
                Found::Message(id, data) if id == self.channel => {
                    if self.coder.decode(&data, message).is_some() {
                        if let Some(replay) = &mut self.replay {
                            replay.restore(message);
                        }
                        return Ok(true);
                    }
                    let why = "a message of a cycle is not what it should be";
                    self.ending = Some(Ending::Damaged(why.to_owned()));
                }
                Found::End(ending) => self.ending = Some(ending),
                _ => {}
            }
        }
        Ok(false)
    }

    /// Computes from now on what a recording of frames does not hold of each cycle; of any other one
    /// nothing changes. To be called before the first cycle is read.
    ///
    /// # Errors
    /// The configuration in the recording cannot be loaded.
    pub fn restore(&mut self) -> Result<(), Problems> {
        if self.header.content == Content::Frames {
            let robot = self.header.load_robot()?;
            self.replay = Some(Box::new(Replay::new(&robot, &self.header)?));
        }
        Ok(())
    }

    /// What became of the computation of a recording of frames.
    pub fn restored(&self) -> Option<&Replayed> {
        self.replay.as_ref().map(|replay| replay.result())
    }

    /// How the file ended; none before its end.
    pub fn ending(&self) -> Option<&Ending> {
        self.ending.as_ref()
    }
}

fn is_own(topic: &str, header: Option<&Header>) -> bool {
    header.is_some_and(|header| own_names(header.content).1 == topic)
}

fn attach(header: Option<&mut Header>, path: &str, data: Vec<u8>) {
    let files = header.into_iter().flat_map(|header| &mut header.files);
    for file in files.filter(|file| file.path == path) {
        file.text = String::from_utf8_lossy(&data).into_owned();
    }
}

/// How every file is read.
pub(crate) fn options() -> LinearReaderOptions {
    LinearReaderOptions::default()
        .with_prevalidate_chunk_crcs(true)
        .with_record_length_limit(MAX_RECORD)
}

fn next<R: Read>(
    source: &mut R,
    reader: &mut LinearReader,
    started: bool,
) -> Result<Found, ReadError> {
    Ok(next_record(source, reader, started, found)?.unwrap_or_else(Found::End))
}

/// Meaning of `found` for the next record of the file, or how that has ended; `started`: it has begun
/// as an MCAP file does.
pub(crate) fn next_record<R: Read, T>(
    source: &mut R,
    reader: &mut LinearReader,
    started: bool,
    found: impl FnOnce(Record<'_>) -> T,
) -> Result<Result<T, Ending>, ReadError> {
    loop {
        match reader.next_event() {
            None if read_some(source, &mut [0])? > 0 => {
                let why = "more follows the end of its recording, as where files were joined";
                return Ok(Err(Ending::Damaged(why.to_owned())));
            }
            None => return Ok(Err(Ending::Complete)),
            Some(Ok(LinearReadEvent::ReadRequest(wanted))) => {
                let wanted = wanted.min(MAX_RECORD);
                let read = read_some(source, reader.insert(wanted))?;
                reader.notify_read(read);
            }
            Some(Ok(LinearReadEvent::Record { data, opcode })) => {
                return Ok(match mcap::parse_record(opcode, data) {
                    Ok(record) => Ok(found(record)),
                    Err(error) => Err(Ending::Damaged(error.to_string())),
                });
            }
            Some(Err(McapError::UnexpectedEof)) => return Ok(Err(Ending::Truncated)),
            Some(Err(McapError::BadMagic)) if !started => return Err(ReadError::NotMcap),
            Some(Err(error)) => return Ok(Err(Ending::Damaged(error.to_string()))),
        }
    }
}

fn read_some<R: Read>(source: &mut R, buffer: &mut [u8]) -> io::Result<usize> {
    loop {
        match source.read(buffer) {
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            other => return other,
        }
    }
}

fn found(record: Record<'_>) -> Found {
    match record {
        Record::Metadata(metadata) if metadata.name == METADATA => {
            match Header::from_metadata(&metadata.metadata) {
                Some((header, layout)) => Found::Metadata(Box::new(header), layout),
                // Ours by name, but not by its contents.
                None => Found::OtherVersion(metadata.metadata.get("version").cloned()),
            }
        }
        Record::Attachment { header, data, .. } => {
            Found::Attachment(header.name, data.into_owned())
        }
        Record::Channel(channel) => Found::Channel(channel.id, channel.topic),
        Record::Message { header, data } => Found::Message(header.channel_id, data.into_owned()),
        _ => Found::Other,
    }
}
