//! What a node's transceiver has: a bus and a clock.

use can_codec::{Frame, Frames};

/// A node's way to its bus.
pub(super) struct Wire<'a> {
    pub(super) bus: u8,
    /// ns.
    pub(super) now: u64,
    pub(super) out: &'a mut Frames,
}

impl Wire<'_> {
    /// Sends a classic frame of at most 8 bytes.
    pub(super) fn send(&mut self, id: u32, data: &[u8]) {
        self.send_frame(id, data, false);
    }

    /// Sends a frame.
    pub(super) fn send_frame(&mut self, id: u32, data: &[u8], fd: bool) {
        let len = data.len().min(if fd { 64 } else { 8 });
        let mut frame = Frame::zeroed(self.bus, id, len as u8, fd);
        frame.data[..len].copy_from_slice(&data[..len]);
        frame.stamp_ns = self.now;
        self.out.push(frame);
    }
}
