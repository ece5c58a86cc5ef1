//! The message of one cycle: bytes that the loop writes and replay reads.
//!
//! ```text
//! offset  little-endian
//!      0  u32 flags: 1 a reference, 2 settings, 4 an operator's request, 8 notes were lost
//!      4  u32 notes    8 u32 frames received    12 u32 frames sent
//!     16  u64 instant of SYNC, ns    24 u64 now, ns
//!     32  f64 age of the reference, s    40 u64 received frames that found no room
//!     48  u32 kind of the operator's request    52 u32 the fault that it acknowledges
//!     56  notes: u32 number of the event, u32 0, u64 times
//!         the record of the cycle and of the loop around it, in its compact layout
//!         the reference, the settings: compact, if there are any
//!         frames received, then sent: u64 stamp, u32 identifier, u8 bus, u8 length,
//!         u8 flags: 1 CAN FD, 2 error, u8 0, then the data, filled with zeros to eight bytes
//! ```

use can_codec::{Frame, Frames, MAX_DATA, MAX_FRAMES};
use cycle::{ClientInput, Instants, OperatorRequest, Stamp};
use robot_state::{Event, Reference, Settings, SharedRecord, Zero};
use zerocopy::IntoBytes;

use crate::compact::{Compact, Counts};

const HEAD: usize = 56;
const NOTE: usize = 16;
const FRAME_HEAD: usize = 16;

pub(crate) const HAS_REFERENCE: u32 = 1;
pub(crate) const HAS_SETTINGS: u32 = 2;
pub(crate) const HAS_REQUEST: u32 = 4;
pub(crate) const NOTES_LOST: u32 = 8;

/// Most notes of one cycle that are recorded; the loop makes at most eight.
const MAX_NOTES: usize = 32;

/// An event that was reported to the cycle before its `step`, and how often.
pub type Note = (Event, u64);

/// Everything that one call of `Cycle::step` takes.
#[derive(Debug, Clone, Copy)]
pub struct CycleInput<'a> {
    /// The instants of SYNC and of the end of the collection of frames.
    pub at: Instants,
    /// The frames received.
    pub rx: &'a Frames,
    /// References of clients and requests of operators.
    pub client: ClientInput<'a>,
}

/// Writes messages; all memory is taken at construction.
#[derive(Debug, Clone)]
pub struct Encoder {
    record: Compact,
    reference: Compact,
    settings: Compact,
    notes: Vec<Note>,
    notes_lost: bool,
    bytes: Vec<u8>,
}

impl Encoder {
    /// For a robot of so many joints and sensors.
    #[must_use]
    pub fn new(counts: Counts) -> Self {
        let mut encoder = Self {
            record: Compact::new::<SharedRecord>(counts),
            reference: Compact::new::<Reference>(counts),
            settings: Compact::new::<Settings>(counts),
            notes: Vec::with_capacity(MAX_NOTES),
            notes_lost: false,
            bytes: Vec::new(),
        };
        let frames = core::iter::repeat_n(MAX_DATA, 2 * MAX_FRAMES);
        let largest = encoder.size(frames) + MAX_NOTES * NOTE;
        // Filled once, so that no page is touched for the first time in the loop.
        encoder.bytes.resize(largest, 0);
        encoder
    }

    /// Bytes of a message with frames of these lengths, without notes.
    #[must_use]
    pub fn size(&self, frames: impl IntoIterator<Item = usize>) -> usize {
        let records = self.record.len() + self.reference.len() + self.settings.len();
        let frames = frames.into_iter();
        let frames = frames.map(|data| FRAME_HEAD + data.next_multiple_of(8));
        HEAD + records + frames.sum::<usize>()
    }

    /// Notes an event that is reported to the cycle before its next `step`.
    pub fn note(&mut self, event: Event, times: u64) {
        if times == 0 {
            return;
        }
        if self.notes.len() < MAX_NOTES {
            self.notes.push((event, times))
        } else {
            self.notes_lost = true
        }
    }

    /// The message of a cycle; the notes since the last one belong to it.
    pub fn encode(&mut self, input: &CycleInput<'_>, record: &SharedRecord, tx: &Frames) -> &[u8] {
        let Self { bytes, .. } = self;
        bytes.clear();
        let client = &input.client;
        let flag = |set: bool, bit: u32| if set { bit } else { 0 };
        let flags = flag(client.reference.is_some(), HAS_REFERENCE)
            | flag(client.settings.is_some(), HAS_SETTINGS)
            | flag(client.request.is_some(), HAS_REQUEST)
            | flag(self.notes_lost, NOTES_LOST);
        let (kind, fault) = client.request.map_or((0, 0), request_numbers);
        for number in [
            flags,
            self.notes.len() as u32,
            input.rx.len() as u32,
            tx.len() as u32,
        ] {
            bytes.extend_from_slice(&number.to_le_bytes());
        }
        bytes.extend_from_slice(&input.at.sync.0.to_le_bytes());
        bytes.extend_from_slice(&input.at.now.0.to_le_bytes());
        bytes.extend_from_slice(&client.age_s.to_le_bytes());
        bytes.extend_from_slice(&input.rx.overflow().to_le_bytes());
        bytes.extend_from_slice(&kind.to_le_bytes());
        bytes.extend_from_slice(&fault.to_le_bytes());
        for (event, times) in &self.notes {
            bytes.extend_from_slice(&u64::from(event.number()).to_le_bytes());
            bytes.extend_from_slice(&times.to_le_bytes());
        }
        self.notes.clear();
        self.notes_lost = false;
        self.record.put(record.as_bytes(), bytes);
        if let Some(reference) = client.reference {
            self.reference.put(reference.as_bytes(), bytes);
        }
        if let Some(settings) = client.settings {
            self.settings.put(settings.as_bytes(), bytes);
        }
        for frame in input.rx.iter().chain(tx) {
            put_frame(frame, bytes);
        }
        bytes
    }
}

pub(crate) fn put_frame(frame: &Frame, bytes: &mut Vec<u8>) {
    const ZEROS: [u8; 8] = [0; 8];
    let data = frame.payload();
    let flags = u8::from(frame.fd) | u8::from(frame.error) << 1;
    bytes.extend_from_slice(&frame.stamp_ns.to_le_bytes());
    bytes.extend_from_slice(&frame.id.to_le_bytes());
    bytes.extend_from_slice(&[frame.bus, data.len() as u8, flags, 0]);
    bytes.extend_from_slice(data);
    let fill = data.len().next_multiple_of(8) - data.len();
    bytes.extend_from_slice(ZEROS.get(..fill).unwrap_or_default());
}

/// The kind and the fault of an operator's request.
pub(crate) fn request_numbers(request: OperatorRequest) -> (u32, u32) {
    match request {
        OperatorRequest::Enable => (1, 0),
        OperatorRequest::Disable => (2, 0),
        OperatorRequest::Stop => (3, 0),
        OperatorRequest::Acknowledge(fault) => (4, fault),
    }
}

pub(crate) fn operator_request(kind: u32, fault: u32) -> Option<OperatorRequest> {
    match kind {
        1 => Some(OperatorRequest::Enable),
        2 => Some(OperatorRequest::Disable),
        3 => Some(OperatorRequest::Stop),
        4 => Some(OperatorRequest::Acknowledge(fault)),
        _ => None,
    }
}

/// The message of one cycle, read; the memory is taken once.
#[derive(Debug, Clone)]
pub struct CycleMessage {
    /// The instants of SYNC and of the end of the collection of frames.
    pub at: Instants,
    /// Age of the reference, s.
    pub age_s: f64,
    /// An operator's request.
    pub request: Option<OperatorRequest>,
    /// Events that were reported before the step.
    pub notes: Vec<Note>,
    /// More events were reported than a message holds.
    pub notes_lost: bool,
    /// The frames received.
    pub rx: Frames,
    /// The frames sent, without SYNC.
    pub tx: Frames,
    /// The cycle's output, and the loop around it.
    pub record: Box<SharedRecord>,
    /// Of a recording of frames: CRC-32 of the cycle's record and of the frames sent, which are not
    /// recorded.
    pub check: Option<u32>,
    pub(crate) reference: Option<Reference>,
    pub(crate) settings: Option<Settings>,
}

impl Default for CycleMessage {
    fn default() -> Self {
        Self {
            at: Instants::default(),
            age_s: 0.0,
            request: None,
            notes: Vec::new(),
            notes_lost: false,
            rx: Frames::default(),
            tx: Frames::default(),
            record: Box::new(SharedRecord::ZERO),
            check: None,
            reference: None,
            settings: None,
        }
    }
}

impl CycleMessage {
    /// References and requests that reached the cycle.
    #[must_use]
    pub fn client(&self) -> ClientInput<'_> {
        ClientInput {
            reference: self.reference.as_ref(),
            age_s: self.age_s,
            // The cycle fills in again what it has added.
            commander: self.record.cycle.commander,
            settings: self.settings.as_ref(),
            request: self.request,
        }
    }

    /// The reference, if a client commanded.
    #[must_use]
    pub fn reference(&self) -> Option<&Reference> {
        self.reference.as_ref()
    }

    /// The settings.
    #[must_use]
    pub fn settings(&self) -> Option<&Settings> {
        self.settings.as_ref()
    }
}

/// Reads messages.
#[derive(Debug, Clone)]
pub struct Decoder {
    record: Compact,
    reference: Compact,
    settings: Compact,
}

impl Decoder {
    /// For a robot of so many joints and sensors.
    #[must_use]
    pub fn new(counts: Counts) -> Self {
        Self {
            record: Compact::new::<SharedRecord>(counts),
            reference: Compact::new::<Reference>(counts),
            settings: Compact::new::<Settings>(counts),
        }
    }

    /// Reads a message into `message`; `None` if the bytes are none: they are too short or too long,
    /// or name what does not exist.
    #[must_use]
    pub fn decode(&self, bytes: &[u8], message: &mut CycleMessage) -> Option<()> {
        let mut rest = bytes;
        let flags = take_u32(&mut rest)?;
        let [notes, rx, tx] = [
            take_u32(&mut rest)?,
            take_u32(&mut rest)?,
            take_u32(&mut rest)?,
        ];
        message.at.sync = Stamp(take_u64(&mut rest)?);
        message.at.now = Stamp(take_u64(&mut rest)?);
        message.age_s = f64::from_bits(take_u64(&mut rest)?);
        let overflow = take_u64(&mut rest)?;
        let (kind, fault) = (take_u32(&mut rest)?, take_u32(&mut rest)?);
        message.request = match flags & HAS_REQUEST {
            0 => None,
            _ => Some(operator_request(kind, fault)?),
        };
        message.notes_lost = flags & NOTES_LOST != 0;
        message.check = None;
        message.notes.clear();
        for _ in 0..notes {
            let number = u32::try_from(take_u64(&mut rest)?).ok()?;
            let times = take_u64(&mut rest)?;
            message.notes.push((Event::from_number(number)?, times));
        }
        take_record(&self.record, &mut rest, message.record.as_mut_bytes())?;
        message.reference = match flags & HAS_REFERENCE {
            0 => None,
            _ => Some(self.take_reference(&mut rest)?),
        };
        message.settings = match flags & HAS_SETTINGS {
            0 => None,
            _ => Some(self.take_settings(&mut rest)?),
        };
        take_frames(&mut rest, rx, overflow, &mut message.rx)?;
        take_frames(&mut rest, tx, 0, &mut message.tx)?;
        rest.is_empty().then_some(())
    }

    fn take_reference(&self, rest: &mut &[u8]) -> Option<Reference> {
        let mut reference = Reference::ZERO;
        take_record(&self.reference, rest, reference.as_mut_bytes())?;
        Some(reference)
    }

    fn take_settings(&self, rest: &mut &[u8]) -> Option<Settings> {
        let mut settings = Settings::ZERO;
        take_record(&self.settings, rest, settings.as_mut_bytes())?;
        Some(settings)
    }
}

/// Head of a message, read without decoding the rest.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Glance {
    /// Number of the cycle.
    pub sequence: u64,
    /// Instant of the cycle, ns.
    pub stamp_ns: u64,
    /// Number of the latched fault, or 0.
    pub fault: u32,
}

impl Glance {
    /// At these bytes; `None` if they are no message.
    #[must_use]
    pub fn at(bytes: &[u8]) -> Option<Self> {
        use core::mem::offset_of;
        use robot_state::CycleRecord;
        let notes = take_u32(&mut bytes.get(4..)?)? as usize;
        let record = bytes.get(HEAD + notes.checked_mul(NOTE)?..)?;
        let at = |offset: usize| record.get(offset..);
        Some(Self {
            sequence: take_u64(&mut at(offset_of!(CycleRecord, sequence))?)?,
            stamp_ns: take_u64(&mut at(offset_of!(CycleRecord, stamp_ns))?)?,
            fault: take_u32(&mut at(offset_of!(CycleRecord, fault))?)?,
        })
    }
}

fn take_record(compact: &Compact, rest: &mut &[u8], record: &mut [u8]) -> Option<()> {
    compact.take(take(rest, compact.len())?, record);
    Some(())
}

fn take_frames(rest: &mut &[u8], count: u32, overflow: u64, frames: &mut Frames) -> Option<()> {
    frames.clear();
    if count as usize > MAX_FRAMES {
        return None;
    }
    for _ in 0..count {
        frames.push(take_frame(rest)?);
    }
    frames.count_overflow(overflow);
    Some(())
}

fn take_frame(rest: &mut &[u8]) -> Option<Frame> {
    let (stamp_ns, id) = (take_u64(rest)?, take_u32(rest)?);
    let &[bus, len, flags, _] = take(rest, 4)? else {
        return None;
    };
    let used = usize::from(len);
    let data = take(rest, used.next_multiple_of(8))?.get(..used)?;
    let mut frame = Frame::zeroed(bus, id, len, flags & 1 != 0);
    frame.error = flags & 2 != 0;
    frame.stamp_ns = stamp_ns;
    frame.data.get_mut(..used)?.copy_from_slice(data);
    Some(frame)
}

pub(crate) fn take<'a>(rest: &mut &'a [u8], len: usize) -> Option<&'a [u8]> {
    let (taken, left) = rest.split_at_checked(len)?;
    *rest = left;
    Some(taken)
}

pub(crate) fn take_u32(rest: &mut &[u8]) -> Option<u32> {
    Some(u32::from_le_bytes(take(rest, 4)?.try_into().ok()?))
}

pub(crate) fn take_u64(rest: &mut &[u8]) -> Option<u64> {
    Some(u64::from_le_bytes(take(rest, 8)?.try_into().ok()?))
}
