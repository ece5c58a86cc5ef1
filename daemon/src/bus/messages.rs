//! Preallocated messages of a socket, many in one system call, and what else every socket of a bus
//! needs: waiting, options, the kernel's time stamps and counts of losses.

use crate::real_time::monotonic_ns;
use libc::{c_int, c_void};
use std::io;
use std::mem::{size_of, zeroed};
use std::os::fd::{AsRawFd, BorrowedFd};
use std::ptr;

/// Messages that one system call takes.
pub(super) const BATCH: usize = 64;
/// Room for frames between two reads, bytes as the kernel counts them (about 800 a frame): some
/// 20 ms of eight buses at their fullest.
const RECEIVE_BUFFER: c_int = 4 * 1024 * 1024;
/// Room for the control messages: a time stamp and a count of drops, 32 bytes or less each.
const CONTROL_WORDS: usize = 16;
const NS_PER_S: u64 = 1_000_000_000;

/// Memory that the kernel may fill.
///
/// # Safety
/// Every pattern of bits is a valid value.
pub(super) unsafe trait Plain: Copy {}

// SAFETY: arrays of bytes, and C structs of integers.
unsafe impl<const N: usize> Plain for [u8; N] {}
// SAFETY: as above.
unsafe impl Plain for libc::sockaddr_can {}
// SAFETY: as above.
unsafe impl Plain for libc::canfd_frame {}
// SAFETY: as above.
unsafe impl Plain for libc::sockaddr_in {}

/// Memory of one message: address, content, and control messages of the kernel.
#[repr(C)]
#[derive(Clone, Copy)]
struct Message<A, D> {
    address: A,
    content: D,
    vector: libc::iovec,
    control: [u64; CONTROL_WORDS],
}

/// Memory for [`BATCH`] messages and the headers that point at it. `A`: the address of each, of no
/// bytes on a socket that is connected; `D`: room for its content.
pub(super) struct Messages<A, D> {
    messages: Box<[Message<A, D>]>,
    headers: Box<[libc::mmsghdr]>,
}

// SAFETY: the pointers in headers and vectors point into `messages`, which moves along with them;
// they are written anew before each system call and not followed after it.
unsafe impl<A: Send, D: Send> Send for Messages<A, D> {}

/// A message that was received.
#[derive(Debug, Clone, Copy)]
pub(super) struct Received<'a, A, D> {
    pub(super) address: &'a A,
    pub(super) content: &'a D,
    /// Bytes of the content.
    pub(super) length: usize,
    /// The message was longer than the room for its content.
    pub(super) cut: bool,
    /// The kernel's receive time on CLOCK_REALTIME, ns; 0 if it gave none.
    pub(super) real_ns: u64,
    /// Messages that this socket has lost so far, if any.
    pub(super) dropped: Option<u32>,
}

impl<A: Plain, D: Plain> Messages<A, D> {
    pub(super) fn new() -> Self {
        // SAFETY: integers and pointers, and memory of which every pattern of bits is valid.
        let (message, header) = unsafe { (zeroed::<Message<A, D>>(), zeroed::<libc::mmsghdr>()) };
        Self {
            messages: vec![message; BATCH].into_boxed_slice(),
            headers: vec![header; BATCH].into_boxed_slice(),
        }
    }

    /// Reads waiting messages, up to [`BATCH`], without blocking; an errno if there is none.
    pub(super) fn receive(&mut self, socket: BorrowedFd<'_>) -> Result<usize, c_int> {
        for at in 0..BATCH {
            self.point(at, size_of::<D>(), true);
        }
        // SAFETY: every header points to one address, vector, content and control buffer of the
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

    /// The message `at` of those just received.
    pub(super) fn received(&self, at: usize) -> Option<Received<'_, A, D>> {
        let (message, header) = (self.messages.get(at)?, self.headers.get(at)?);
        let (real_ns, dropped) = control(&header.msg_hdr);
        Some(Received {
            address: &message.address,
            content: &message.content,
            length: (header.msg_len as usize).min(size_of::<D>()),
            cut: header.msg_hdr.msg_flags & libc::MSG_TRUNC != 0,
            real_ns,
            dropped,
        })
    }

    /// Address and content of message `at`, to be written; then [`ready`](Self::ready).
    pub(super) fn at(&mut self, at: usize) -> Option<(&mut A, &mut D)> {
        let message = self.messages.get_mut(at)?;
        Some((&mut message.address, &mut message.content))
    }

    /// Message `at` is written, and `size` bytes of its content are to be sent.
    pub(super) fn ready(&mut self, at: usize, size: usize) {
        self.point(at, size.min(size_of::<D>()), false);
    }

    /// Sends the first `count` messages without blocking; returns the number that the kernel took. One
    /// that it refuses is passed over, as those behind it may have another way: `refused` is called
    /// with its index and the errno.
    pub(super) fn send(
        &mut self,
        socket: BorrowedFd<'_>,
        count: usize,
        mut refused: impl FnMut(usize, c_int),
    ) -> usize {
        let (mut at, mut accepted) = (0, 0);
        while at < count {
            match self.send_some(socket, at, count) {
                Ok(sent) if sent > 0 => {
                    at += sent;
                    accepted += sent;
                }
                Err(libc::EINTR) => {}
                answer => {
                    refused(at, answer.err().unwrap_or(0));
                    at += 1;
                }
            }
        }
        accepted
    }

    /// Sends the messages `from..to`: the number that the kernel took, or the errno of the first.
    fn send_some(
        &mut self,
        socket: BorrowedFd<'_>,
        from: usize,
        to: usize,
    ) -> Result<usize, c_int> {
        let Some(headers) = self.headers.get_mut(from..to) else {
            return Ok(0);
        };
        // SAFETY: the headers `from..to` were set by `ready` since the last `receive` or `send`,
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
        message.vector.iov_base = ptr::from_mut(&mut message.content).cast::<c_void>();
        message.vector.iov_len = size;
        header.msg_len = 0;
        let head = &mut header.msg_hdr;
        head.msg_name = match size_of::<A>() {
            0 => ptr::null_mut(),
            _ => ptr::from_mut(&mut message.address).cast::<c_void>(),
        };
        head.msg_namelen = size_of::<A>() as libc::socklen_t;
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
fn control(header: &libc::msghdr) -> (u64, Option<u32>) {
    let (mut real_ns, mut dropped) = (0, None);
    // SAFETY: `header` points to a control buffer that is alive, that the kernel has filled and
    // whose filled length it has set; the CMSG functions stay within it, and each payload is read
    // unaligned and only if its kind, and so its size, is known.
    unsafe {
        let mut next = libc::CMSG_FIRSTHDR(header);
        while let Some(it) = next.as_ref() {
            if it.cmsg_level == libc::SOL_SOCKET && it.cmsg_type == libc::SCM_TIMESTAMPNS {
                let time = ptr::read_unaligned(libc::CMSG_DATA(it).cast::<libc::timespec>());
                real_ns = time.tv_sec.unsigned_abs() * NS_PER_S + time.tv_nsec.unsigned_abs();
            } else if it.cmsg_level == libc::SOL_SOCKET && it.cmsg_type == libc::SO_RXQ_OVFL {
                dropped = Some(ptr::read_unaligned(libc::CMSG_DATA(it).cast::<u32>()));
            }
            next = libc::CMSG_NXTHDR(header, it);
        }
    }
    (real_ns, dropped)
}

/// A socket to wait for, until there is something to read.
pub(super) fn readable(socket: BorrowedFd<'_>) -> libc::pollfd {
    libc::pollfd {
        fd: socket.as_raw_fd(),
        events: libc::POLLIN,
        revents: 0,
    }
}

/// Waits for one of the sockets until `until_ns`; true if one has something to read.
pub(super) fn wait(sockets: &mut [libc::pollfd], until_ns: u64) -> bool {
    let left = until_ns.saturating_sub(monotonic_ns());
    let timeout = libc::timespec {
        tv_sec: (left / NS_PER_S) as libc::time_t,
        tv_nsec: (left % NS_PER_S) as libc::c_long,
    };
    let count = sockets.len() as libc::nfds_t;
    // SAFETY: so many pollfd and a timeout, all alive during the call; no signal mask.
    let ready =
        unsafe { libc::ppoll(sockets.as_mut_ptr(), count, &raw const timeout, ptr::null()) };
    ready > 0
}

/// Has the kernel stamp what the socket receives, count what it drops, and drop as little as may be.
pub(super) fn stamp_and_count(socket: BorrowedFd<'_>) -> Result<(), (&'static str, io::Error)> {
    let any = libc::SOL_SOCKET;
    let set = |name, value| set_option(socket, any, name, value);
    set(libc::SO_TIMESTAMPNS, 1).map_err(|e| ("SO_TIMESTAMPNS", e))?;
    set(libc::SO_RXQ_OVFL, 1).map_err(|e| ("SO_RXQ_OVFL", e))?;
    // Beyond the system's limit only for the privileged; the limit itself will do.
    set(libc::SO_RCVBUFFORCE, RECEIVE_BUFFER)
        .or_else(|_| set(libc::SO_RCVBUF, RECEIVE_BUFFER))
        .map_err(|e| ("SO_RCVBUF", e))
}

pub(super) fn set_option(
    socket: BorrowedFd<'_>,
    level: c_int,
    name: c_int,
    value: c_int,
) -> io::Result<()> {
    // SAFETY: the value is alive during the call and its size is stated.
    let answer = unsafe {
        libc::setsockopt(
            socket.as_raw_fd(),
            level,
            name,
            (&raw const value).cast(),
            size_of::<c_int>() as libc::socklen_t,
        )
    };
    if answer == 0 {
        Ok(())
    } else {
        Err(io::Error::last_os_error())
    }
}

/// The calling thread's last error.
pub(super) fn errno() -> c_int {
    io::Error::last_os_error().raw_os_error().unwrap_or(0)
}
