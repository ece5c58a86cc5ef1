//! A CAN frame and a list of frames of fixed capacity.

/// Frames that a cycle can receive or send.
pub const MAX_FRAMES: usize = 512;

/// Bytes that a CAN FD frame can carry.
pub const MAX_DATA: usize = 64;

/// The bit of [`Frame::id`] that marks a 29-bit identifier, as in DBC files and SocketCAN.
pub const EXTENDED_ID: u32 = 1 << 31;

/// One CAN or CAN FD frame.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Index of the bus, in config order.
    pub bus: u8,
    /// A CAN FD frame.
    pub fd: bool,
    /// An error frame of the CAN controller: it carries no data of a message.
    pub error: bool,
    /// Bytes of `data` in use, at most 64.
    pub len: u8,
    /// Identifier; bit 31 marks an extended (29-bit) one.
    pub id: u32,
    /// Time of reception, ns on the clock of the cycle's stamps.
    pub stamp_ns: u64,
    /// The frame's bytes; those from `len` on are zero.
    pub data: [u8; MAX_DATA],
}

impl Frame {
    /// A frame of `len` zero bytes.
    #[must_use]
    pub fn zeroed(bus: u8, id: u32, len: u8, fd: bool) -> Self {
        Self {
            bus,
            fd,
            error: false,
            len: len.min(MAX_DATA as u8),
            id,
            stamp_ns: 0,
            data: [0; MAX_DATA],
        }
    }

    /// The bytes in use.
    #[must_use]
    pub fn payload(&self) -> &[u8] {
        &self.data[..usize::from(self.len).min(MAX_DATA)]
    }
}

/// Frames in the order of their arrival or sending; the memory is taken once.
#[derive(Clone, Debug)]
pub struct Frames {
    frames: Vec<Frame>,
    capacity: usize,
    overflow: u64,
}

impl Frames {
    /// An empty list with room for `capacity` frames.
    #[must_use]
    pub fn new(capacity: usize) -> Self {
        Self {
            frames: Vec::with_capacity(capacity),
            capacity,
            overflow: 0,
        }
    }

    /// Appends a frame; false, and counted, if the list is full.
    pub fn push(&mut self, frame: Frame) -> bool {
        let fits = self.frames.len() < self.capacity;
        if fits {
            self.frames.push(frame);
        } else {
            self.overflow += 1;
        }
        fits
    }

    /// Empties the list and zeroes the count of frames that found no room.
    pub fn clear(&mut self) {
        self.frames.clear();
        self.overflow = 0;
    }

    /// The frames in order.
    #[must_use]
    pub fn as_slice(&self) -> &[Frame] {
        &self.frames
    }

    /// The frames in order.
    pub fn iter(&self) -> core::slice::Iter<'_, Frame> {
        self.frames.iter()
    }

    /// Number of frames.
    #[must_use]
    pub fn len(&self) -> usize {
        self.frames.len()
    }

    /// No frame is in the list.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.frames.is_empty()
    }

    /// No further frame fits.
    #[must_use]
    pub fn is_full(&self) -> bool {
        self.frames.len() >= self.capacity
    }

    /// Counts frames that found no room somewhere else, as in a list that was recorded.
    pub fn count_overflow(&mut self, frames: u64) {
        self.overflow += frames;
    }

    /// Frames that found no room since the last [`clear`](Self::clear).
    #[must_use]
    pub fn overflow(&self) -> u64 {
        self.overflow
    }
}

impl Default for Frames {
    /// Room for [`MAX_FRAMES`] frames.
    fn default() -> Self {
        Self::new(MAX_FRAMES)
    }
}

impl<'a> IntoIterator for &'a Frames {
    type Item = &'a Frame;
    type IntoIter = core::slice::Iter<'a, Frame>;

    fn into_iter(self) -> Self::IntoIter {
        self.iter()
    }
}
