//! One daemon for each CAN interface: a lock that names its holder.
//!
//! The lock is an abstract Unix socket. Such names belong to the network namespace, as the
//! interfaces do: the lock holds between users and run directories, leaves no file, and is free as
//! soon as its holder has ended, however it ends.

use std::io::{self, ErrorKind};
use std::mem::{size_of, zeroed};
use std::os::fd::AsRawFd;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixListener, UnixStream};
use std::ptr;

/// Why an interface cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum LockError {
    /// Another process has it.
    #[error(
        "CAN interface {interface} is in use by another daemon, {holder}: two would command the \
         same drives. Next: end that process, or change the interface in the configuration"
    )]
    Held {
        /// The interface.
        interface: String,
        /// The other process, as far as the kernel names it.
        holder: String,
    },
    /// The kernel's answer.
    #[error("CAN interface {interface} cannot be locked: {error}")]
    System {
        /// The interface.
        interface: String,
        /// The answer.
        error: io::Error,
    },
}

/// Locked interfaces: no other daemon may use them while this value lives.
#[derive(Debug)]
pub struct InterfaceLocks {
    _sockets: Vec<UnixListener>,
}

impl InterfaceLocks {
    /// Takes the locks of the interfaces; several buses may share one.
    ///
    /// # Errors
    /// The first interface that is not free.
    pub fn take<'a>(interfaces: impl IntoIterator<Item = &'a str>) -> Result<Self, LockError> {
        let mut names: Vec<&str> = interfaces.into_iter().collect();
        names.sort_unstable();
        names.dedup();
        let sockets = names.into_iter().map(lock).collect::<Result<_, _>>()?;
        Ok(Self { _sockets: sockets })
    }
}

fn lock(interface: &str) -> Result<UnixListener, LockError> {
    let system = |error| LockError::System {
        interface: interface.to_owned(),
        error,
    };
    let name = format!("torqued/can/{interface}");
    let address = SocketAddr::from_abstract_name(name).map_err(system)?;
    UnixListener::bind_addr(&address).map_err(|error| match error.kind() {
        ErrorKind::AddrInUse => LockError::Held {
            interface: interface.to_owned(),
            holder: holder(&address),
        },
        _ => system(error),
    })
}

/// The process that listens at the address: `process 4711 (torqued)`.
fn holder(address: &SocketAddr) -> String {
    let Some(pid) = UnixStream::connect_addr(address)
        .ok()
        .and_then(|stream| peer_pid(&stream))
    else {
        return "whose process number is not known".to_owned();
    };
    let name = std::fs::read_to_string(format!("/proc/{pid}/comm")).unwrap_or_default();
    match name.trim() {
        "" => format!("process {pid}"),
        name => format!("process {pid} ({name})"),
    }
}

fn peer_pid(stream: &UnixStream) -> Option<i32> {
    // SAFETY: a plain C struct, for which zero is a valid value.
    let mut peer: libc::ucred = unsafe { zeroed() };
    let mut size = size_of::<libc::ucred>() as libc::socklen_t;
    // SAFETY: the struct and its size are alive during the call.
    let answer = unsafe {
        libc::getsockopt(
            stream.as_raw_fd(),
            libc::SOL_SOCKET,
            libc::SO_PEERCRED,
            ptr::from_mut(&mut peer).cast(),
            &raw mut size,
        )
    };
    (answer == 0 && peer.pid > 0).then_some(peer.pid)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_interface_is_locked_until_its_holder_ends() {
        let names = ["a", "b"].map(|name| format!("test{}{name}", std::process::id()));
        let [a, b] = names.each_ref().map(String::as_str);
        let first = InterfaceLocks::take([a, b, a]).expect("free");
        let refusal = InterfaceLocks::take([b]).expect_err("held").to_string();
        assert!(refusal.contains(b), "{refusal}");
        assert!(
            refusal.contains(&format!("process {} (", std::process::id())),
            "{refusal}"
        );
        drop(first);
        InterfaceLocks::take([b]).expect("free again");
    }
}
