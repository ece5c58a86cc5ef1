//! Preallocated message headers: many frames in one system call.

use can_codec::Frame;
use libc::{c_int, c_void};
use std::mem::{size_of, zeroed};
use std::os::fd::{AsRawFd, BorrowedFd};
use std::ptr;

/// Frames that one system call takes.
pub(super) const BATCH: usize = 64;
/// Room for the control messages: a time stamp and a count of drops, 32 bytes or less each.
const CONTROL_WORDS: usize = 16;
/// Data of a classic frame, bytes.
const CLASSIC_DATA: usize = 8;

/// Memory of one message: address, frame, and control messages of the kernel.
#[repr(C)]
#[derive(Clone, Copy)]
struct Message {
    address: libc::sockaddr_can,
    frame: libc::canfd_frame,
    vector: libc::iovec,
    control: [u64; CONTROL_WORDS],
}

/// Memory for [`BATCH`] messages and the headers that point at it.
pub(super) struct Messages {
    messages: Box<[Message]>,
    headers: Box<[libc::mmsghdr]>,
}

// SAFETY: the pointers in headers and vectors point into `messages`, which moves along with them;
// they are written anew before each system call and not followed after it.
unsafe impl Send for Messages {}

/// Metadata of a received frame.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Origin {
    /// Index of the interface.
    pub(super) interface: c_int,
    /// The kernel's receive time on CLOCK_REALTIME, ns; 0 if it gave none.
    pub(super) real_ns: u64,
    /// Frames that this socket has lost so far, if any.
    pub(super) dropped: Option<u32>,
}

impl Messages {
    pub(super) fn new() -> Self {
        // SAFETY: both are plain C structs of integers and pointers: zero is a valid value.
        let (message, header) = unsafe { (zeroed::<Message>(), zeroed::<libc::mmsghdr>()) };
        Self {
            messages: vec![message; BATCH].into_boxed_slice(),
            headers: vec![header; BATCH].into_boxed_slice(),
        }
    }

    /// Reads waiting frames, up to [`BATCH`], without blocking; an errno if there is none.
    pub(super) fn receive(&mut self, socket: BorrowedFd<'_>) -> Result<usize, c_int> {
        for at in 0..BATCH {
            self.point(at, size_of::<libc::canfd_frame>(), true);
        }
        // SAFETY: every header points to one address, vector, frame and control buffer of the
        // sizes it states, all alive and not otherwise borrowed during the call.
        let count = unsafe {
            libc::recvmmsg(
                socket.as_raw_fd(),
                self.headers.as_mut_ptr(),
                BATCH as libc::c_uint,
                libc::MSG_DONTWAIT,
                ptr::null_mut(),
            )
        };
        usize::try_from(count).map_err(|_| errno())
    }

    /// The message `at` of those just received; `None` if it is neither a CAN nor a CAN FD frame.
    pub(super) fn received(&self, at: usize) -> Option<(Frame, Origin)> {
        let (message, header) = (self.messages.get(at)?, self.headers.get(at)?);
        let fd = match header.msg_len as usize {
            libc::CANFD_MTU => true,
            libc::CAN_MTU => false,
            _ => return None,
        };
        let raw = &message.frame;
        let error = raw.can_id & libc::CAN_ERR_FLAG != 0;
        let capacity = if fd { raw.data.len() } else { CLASSIC_DATA };
        let mut frame = Frame::zeroed(0, raw.can_id, raw.len.min(capacity as u8), fd);
        frame.error = error;
        if error {
            frame.id &= libc::CAN_ERR_MASK;
        }
        // A remote frame (RTR) has a length but no data. Its flag stays in the id, so that it is
        // unknown to every table, not decoded as a message of zeros.
        let used = usize::from(frame.len);
        if let (Some(to), Some(from)) = (frame.data.get_mut(..used), raw.data.get(..used)) {
            to.copy_from_slice(from);
        }
        let mut head = header.msg_hdr;
        head.msg_control = ptr::from_ref(&message.control).cast_mut().cast();
        let mut origin = control(&head);
        origin.interface = message.address.can_ifindex;
        Some((frame, origin))
    }

    /// Writes the frame as message `at`, for the interface; false if no interface can carry it.
    pub(super) fn write(&mut self, at: usize, frame: &Frame, interface: c_int) -> bool {
        let capacity = if frame.fd {
            can_codec::MAX_DATA
        } else {
            CLASSIC_DATA
        };
        let used = usize::from(frame.len);
        let Some(message) = self.messages.get_mut(at) else {
            return false;
        };
        if frame.error || used > capacity {
            return false;
        }
        message.address.can_family = libc::AF_CAN as libc::sa_family_t;
        message.address.can_ifindex = interface;
        message.frame.can_id = frame.id;
        message.frame.len = frame.len;
        // Data bytes at the data bit rate; the flag means nothing in a classic frame.
        message.frame.flags = if frame.fd { libc::CANFD_BRS as u8 } else { 0 };
        message.frame.data = frame.data;
        let size = if frame.fd {
            libc::CANFD_MTU
        } else {
            libc::CAN_MTU
        };
        self.point(at, size, false);
        true
    }

    /// Sends the messages `from..to` without blocking: the number that the kernel took, or the
    /// errno of the first.
    pub(super) fn send(
        &mut self,
        socket: BorrowedFd<'_>,
        from: usize,
        to: usize,
    ) -> Result<usize, c_int> {
        let Some(headers) = self.headers.get_mut(from..to) else {
            return Ok(0);
        };
        // SAFETY: the headers `from..to` were set by `write` since the last `receive` or `send`,
        // and point to memory that is alive and not otherwise borrowed during the call.
        let count = unsafe {
            libc::sendmmsg(
                socket.as_raw_fd(),
                headers.as_mut_ptr(),
                headers.len() as libc::c_uint,
                libc::MSG_DONTWAIT,
            )
        };
        usize::try_from(count).map_err(|_| errno())
    }

    /// Points header `at` to its message; the kernel has overwritten the lengths.
    fn point(&mut self, at: usize, size: usize, with_control: bool) {
        let (Some(message), Some(header)) = (self.messages.get_mut(at), self.headers.get_mut(at))
        else {
            return;
        };
        message.vector.iov_base = ptr::from_mut(&mut message.frame).cast::<c_void>();
        message.vector.iov_len = size;
        header.msg_len = 0;
        let head = &mut header.msg_hdr;
        head.msg_name = ptr::from_mut(&mut message.address).cast::<c_void>();
        head.msg_namelen = size_of::<libc::sockaddr_can>() as libc::socklen_t;
        head.msg_iov = &raw mut message.vector;
        head.msg_iovlen = 1;
        (head.msg_control, head.msg_controllen) = if with_control {
            let room = size_of::<[u64; CONTROL_WORDS]>();
            (ptr::from_mut(&mut message.control).cast::<c_void>(), room)
        } else {
            (ptr::null_mut(), 0)
        };
        head.msg_flags = 0;
    }
}

/// Time stamp and drop count among the control messages of a received header.
fn control(header: &libc::msghdr) -> Origin {
    let mut origin = Origin::default();
    // SAFETY: `header` points to a control buffer that is alive, that the kernel has filled and
    // whose filled length it has set; the CMSG functions stay within it, and each payload is read
    // unaligned and only if its kind, and so its size, is known.
    unsafe {
        let mut next = libc::CMSG_FIRSTHDR(header);
        while let Some(it) = next.as_ref() {
            if it.cmsg_level == libc::SOL_SOCKET && it.cmsg_type == libc::SCM_TIMESTAMPNS {
                let time = ptr::read_unaligned(libc::CMSG_DATA(it).cast::<libc::timespec>());
                origin.real_ns =
                    time.tv_sec.unsigned_abs() * 1_000_000_000 + time.tv_nsec.unsigned_abs();
            } else if it.cmsg_level == libc::SOL_SOCKET && it.cmsg_type == libc::SO_RXQ_OVFL {
                origin.dropped = Some(ptr::read_unaligned(libc::CMSG_DATA(it).cast::<u32>()));
            }
            next = libc::CMSG_NXTHDR(header, it);
        }
    }
    origin
}

/// The calling thread's last error.
pub(super) fn errno() -> c_int {
    std::io::Error::last_os_error().raw_os_error().unwrap_or(0)
}
