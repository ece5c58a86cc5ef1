//! SDO client (CiA 301, 7.2.4): one transfer at a time with one node, expedited and segmented.

use super::{Object, SDO_ANSWER_ID, SDO_REQUEST_ID, abort, node_of, with_data};
use can_codec::Frame;
use core::fmt;

/// Longest value that is read, bytes: no object of a drive's set-up is longer.
const MAX_VALUE: usize = 4096;

/// A transfer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Request {
    /// Reads an object (upload).
    Read(Object),
    /// Writes an object (download), little endian.
    Write(Object, Vec<u8>),
}

impl Request {
    /// The object that is read or written.
    #[must_use]
    pub fn object(&self) -> Object {
        match self {
            Self::Read(object) | Self::Write(object, _) => *object,
        }
    }
}

/// Why a transfer ended without a result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SdoError {
    /// The node refused, with its abort code.
    Abort(u32),
    /// No answer in time.
    TimeOut,
    /// An answer that does not follow the protocol.
    Protocol,
}

impl fmt::Display for SdoError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Abort(code) => write!(f, "the node refuses: {} ({code:08X})", abort::text(*code)),
            Self::TimeOut => f.write_str("no answer in time"),
            Self::Protocol => f.write_str("an answer that does not follow the protocol"),
        }
    }
}

/// What a frame has done to a transfer.
#[derive(Clone, Debug, PartialEq)]
pub enum Progress {
    /// The frame was not for it.
    NotMine,
    /// It goes on with this frame.
    Send(Frame),
    /// It is over; of a read, with the value. A frame tells the node where the client gave up.
    Done(Result<Vec<u8>, SdoError>, Option<Frame>),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    Initiated,
    Segments { toggle: bool, expected: usize },
}

/// A transfer under way.
#[derive(Clone, Debug)]
pub struct Transfer {
    bus: u8,
    node: u8,
    request: Request,
    stage: Stage,
    /// Bytes read so far, or the number written.
    value: Vec<u8>,
    written: usize,
}

impl Transfer {
    /// A transfer with a node, and its first frame.
    #[must_use]
    pub fn start(bus: u8, node: u8, request: Request) -> (Self, Frame) {
        let transfer = Self {
            bus,
            node,
            request,
            stage: Stage::Initiated,
            value: Vec::new(),
            written: 0,
        };
        let object = transfer.request.object();
        let first = match &transfer.request {
            Request::Read(_) => transfer.initiate(0x40, object, [0; 4]),
            Request::Write(_, value) => match *value.as_slice() {
                [a] => transfer.initiate(0x2F, object, [a, 0, 0, 0]),
                [a, b] => transfer.initiate(0x2B, object, [a, b, 0, 0]),
                [a, b, c] => transfer.initiate(0x27, object, [a, b, c, 0]),
                [a, b, c, d] => transfer.initiate(0x23, object, [a, b, c, d]),
                _ => transfer.initiate(0x21, object, (value.len() as u32).to_le_bytes()),
            },
        };
        (transfer, first)
    }

    /// The object that is read or written.
    #[must_use]
    pub fn object(&self) -> Object {
        self.request.object()
    }

    /// Gives up, and tells the node so.
    #[must_use]
    pub fn give_up(&self) -> Frame {
        self.abort(0x0504_0000)
    }

    /// Takes a frame of the bus.
    pub fn receive(&mut self, frame: &Frame) -> Progress {
        let from = node_of(frame, SDO_ANSWER_ID).filter(|_| frame.bus == self.bus);
        if from != Some(self.node) {
            return Progress::NotMine;
        }
        let Ok(data) = <[u8; 8]>::try_from(frame.payload()) else {
            return self.fail(SdoError::Protocol);
        };
        if data[0] == 0x80 {
            // An abort of another object is that of a transfer that was given up before.
            if self.names_object(&data) {
                return Progress::Done(Err(SdoError::Abort(last_four(&data))), None);
            }
            return Progress::NotMine;
        }
        match (&self.request, self.stage) {
            (Request::Read(_), Stage::Initiated) => self.read_initiated(&data),
            (Request::Read(_), Stage::Segments { toggle, expected }) => {
                self.read_segment(&data, toggle, expected)
            }
            (Request::Write(..), Stage::Initiated) => {
                if data[0] != 0x60 || !self.names_object(&data) {
                    return Progress::NotMine;
                }
                self.write_segment(false)
            }
            (Request::Write(..), Stage::Segments { toggle, .. }) => {
                if data[0] != 0x20 | u8::from(toggle) << 4 {
                    return self.fail(SdoError::Protocol);
                }
                self.write_segment(!toggle)
            }
        }
    }

    fn read_initiated(&mut self, data: &[u8; 8]) -> Progress {
        if data[0] & 0xE0 != 0x40 || !self.names_object(data) {
            // A late answer to a transfer that was given up.
            return Progress::NotMine;
        }
        let (expedited, sized) = (data[0] & 2 != 0, data[0] & 1 != 0);
        if expedited {
            let unused = if sized {
                usize::from(data[0] >> 2 & 3)
            } else {
                0
            };
            return Progress::Done(Ok(data[4..8 - unused].to_vec()), None);
        }
        let expected = if sized {
            last_four(data) as usize
        } else {
            MAX_VALUE
        };
        if expected > MAX_VALUE {
            return self.fail(SdoError::Protocol);
        }
        self.stage = Stage::Segments {
            toggle: false,
            expected,
        };
        Progress::Send(self.request_frame([0x60, 0, 0, 0, 0, 0, 0, 0]))
    }

    fn read_segment(&mut self, data: &[u8; 8], toggle: bool, expected: usize) -> Progress {
        if data[0] & 0xF0 != u8::from(toggle) << 4 {
            return self.fail(SdoError::Protocol);
        }
        let used = 7 - usize::from(data[0] >> 1 & 7);
        self.value.extend_from_slice(&data[1..=used]);
        if self.value.len() > expected {
            return self.fail(SdoError::Protocol);
        }
        if data[0] & 1 != 0 {
            return Progress::Done(Ok(core::mem::take(&mut self.value)), None);
        }
        let toggle = !toggle;
        self.stage = Stage::Segments { toggle, expected };
        Progress::Send(self.request_frame([0x60 | u8::from(toggle) << 4, 0, 0, 0, 0, 0, 0, 0]))
    }

    /// The next segment of a value that is longer than four bytes, or the end.
    fn write_segment(&mut self, toggle: bool) -> Progress {
        let Request::Write(_, value) = &self.request else {
            return self.fail(SdoError::Protocol);
        };
        let expedited = (1..=4).contains(&value.len());
        let (total, expected) = (value.len(), 0);
        // An empty value has one empty segment.
        let over = self.written == total && (self.stage != Stage::Initiated || total > 0);
        if expedited || over {
            return Progress::Done(Ok(Vec::new()), None);
        }
        let part = &value[self.written..total.min(self.written + 7)];
        let mut data = [0; 8];
        data[1..=part.len()].copy_from_slice(part);
        self.written += part.len();
        let last = u8::from(self.written == total);
        data[0] = u8::from(toggle) << 4 | (7 - part.len() as u8) << 1 | last;
        self.stage = Stage::Segments { toggle, expected };
        Progress::Send(self.request_frame(data))
    }

    fn fail(&self, error: SdoError) -> Progress {
        Progress::Done(Err(error), Some(self.abort(0x0504_0001)))
    }

    fn abort(&self, code: u32) -> Frame {
        self.initiate(0x80, self.request.object(), code.to_le_bytes())
    }

    fn names_object(&self, data: &[u8; 8]) -> bool {
        let object = self.request.object();
        data[1..3] == object.index.to_le_bytes() && data[3] == object.sub
    }

    fn initiate(&self, command: u8, object: Object, rest: [u8; 4]) -> Frame {
        let [low, high] = object.index.to_le_bytes();
        let [a, b, c, d] = rest;
        self.request_frame([command, low, high, object.sub, a, b, c, d])
    }

    fn request_frame(&self, data: [u8; 8]) -> Frame {
        with_data(self.bus, SDO_REQUEST_ID + u32::from(self.node), &data)
    }
}

fn last_four(data: &[u8; 8]) -> u32 {
    u32::from_le_bytes([data[4], data[5], data[6], data[7]])
}
