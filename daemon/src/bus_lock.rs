//! One daemon for each bus: a lock that names its holder.
//!
//! The lock is an abstract Unix socket. Such names belong to the network namespace, as CAN interfaces
//! and multicast groups do: the lock holds between users and run directories, leaves no file, and is
//! free as soon as its holder has ended, however it ends. It does not reach other machines.

use robot_config::Carrier;
use std::io::{self, ErrorKind};
use std::mem::{size_of, zeroed};
use std::os::fd::AsRawFd;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixListener, UnixStream};
use std::ptr;

/// Why a bus cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum LockError {
    /// Another process has it.
    #[error(
        "{bus} is in use by another daemon, {holder}: two would command the same drives. Next: end \
         that process, or change the bus in the configuration"
    )]
    Held {
        /// The CAN interface or multicast group.
        bus: String,
        /// The other process, as far as the kernel names it.
        holder: String,
    },
    /// The kernel's answer.
    #[error("{bus} cannot be locked: {error}")]
    System {
        /// The CAN interface or multicast group.
        bus: String,
        /// The answer.
        error: io::Error,
    },
}

/// Locked buses: no other daemon may use them while this value lives.
#[derive(Debug)]
pub struct BusLocks {
    _sockets: Vec<UnixListener>,
}

impl BusLocks {
    /// Takes the locks of the buses.
    ///
    /// # Errors
    /// The first bus that is not free.
    pub fn take<'a>(carriers: impl IntoIterator<Item = &'a Carrier>) -> Result<Self, LockError> {
        let sockets = carriers.into_iter().map(lock).collect::<Result<_, _>>()?;
        Ok(Self { _sockets: sockets })
    }
}

fn lock(carrier: &Carrier) -> Result<UnixListener, LockError> {
    let (kind, bus) = match carrier {
        Carrier::SocketCan(_) => ("can", format!("CAN interface {carrier}")),
        // Whatever the interface: a group's frames may reach one through another.
        Carrier::UdpMulticast(_) => ("udp", format!("UDP group {carrier}")),
    };
    let system = |error| LockError::System {
        bus: bus.clone(),
        error,
    };
    let name = format!("torqued/{kind}/{carrier}");
    let address = SocketAddr::from_abstract_name(name).map_err(system)?;
    UnixListener::bind_addr(&address).map_err(|error| match error.kind() {
        ErrorKind::AddrInUse => LockError::Held {
            bus: bus.clone(),
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
    use robot_config::UdpGroup;
    use std::net::Ipv4Addr;

    #[test]
    fn a_bus_is_locked_until_its_holder_ends() {
        let pid = std::process::id();
        let can = Carrier::SocketCan(format!("test{pid}a"));
        let group = Carrier::UdpMulticast(UdpGroup {
            group: Ipv4Addr::new(239, 1, 1, 1),
            port: pid as u16,
            interface: None,
            hop_limit: 0,
        });
        let first = BusLocks::take([&can, &group]).expect("free");
        for carrier in [&can, &group] {
            let refusal = BusLocks::take([carrier]).expect_err("held").to_string();
            for part in [carrier.to_string(), format!("process {pid} (")] {
                assert!(refusal.contains(&part), "{refusal}");
            }
        }
        drop(first);
        BusLocks::take([&group]).expect("free again");
    }
}
