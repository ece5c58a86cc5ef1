//! The daemon's end of shared memory, also while there is no room for it.
//!
//! `/dev/shm` is open to all users: one who fills it must not keep a daemon from starting. Without
//! room the loop runs, no client can connect, and the room is asked for again every second. A stop by
//! signal needs none.

use std::thread::{self, JoinHandle};
use std::time::Duration;

use robot_state::Description;
use torqued_client::{DaemonPorts, Error, Location};

/// Interval between two attempts.
const RETRY: Duration = Duration::from_secs(1);

/// The daemon's ports, or what is needed to make them.
pub(super) struct Connection {
    ports: Option<DaemonPorts>,
    /// Tries to make them: not the publisher's thread, whose pulse the loop watches.
    maker: Option<JoinHandle<DaemonPorts>>,
}

impl Connection {
    /// Makes the robot's services; goes on without them where shared memory is full.
    pub(super) fn make(location: &Location, description: &Description) -> Result<Self, Error> {
        match DaemonPorts::create(location, description) {
            Ok(ports) => Ok(Self {
                ports: Some(ports),
                maker: None,
            }),
            Err(full @ (Error::NoRoom { .. } | Error::NoFiles { .. })) => {
                let (location, description) = (location.clone(), Box::new(*description));
                let maker = thread::Builder::new().name("connection".to_owned());
                let maker = maker.spawn(move || keep_trying(&location, &description, &full));
                Ok(Self {
                    ports: None,
                    maker: Some(maker.map_err(|e| Error::Thread {
                        reason: e.to_string(),
                    })?),
                })
            }
            Err(other) => Err(other),
        }
    }

    /// The ports, once there is room for them.
    pub(super) fn ports(&self) -> Option<&DaemonPorts> {
        self.ports.as_ref()
    }

    /// Cleans up after dead clients, sees that other users cannot spoil anything, and tries again
    /// where there was no room.
    pub(super) fn look_after(&mut self) {
        if let Some(ports) = &self.ports {
            for file in ports.cleanup_dead_clients() {
                tracing::info!(
                    "other users could write into {}: no longer; a program with another \
                     version of iceoryx2 has made it",
                    file.display()
                );
            }
        } else if self.maker.as_ref().is_some_and(JoinHandle::is_finished)
            && let Some(Ok(ports)) = self.maker.take().map(JoinHandle::join)
        {
            tracing::info!("there is room in shared memory: clients can connect");
            self.ports = Some(ports);
        }
    }
}

/// Tries until there is room; prints each reason once.
fn keep_trying(location: &Location, description: &Description, first: &Error) -> DaemonPorts {
    let mut said = String::new();
    let mut report = |why: &Error| {
        let text = why.to_string();
        if said != text {
            tracing::warn!(
                "no client can connect yet: {text}. Until then `torquectl stop` works by a \
                 signal, and `systemctl stop` ends the daemon"
            );
            said = text;
        }
    };
    report(first);
    loop {
        thread::sleep(RETRY);
        // The directory's names may be others by now.
        let made = Location::at(location.path())
            .and_then(|location| DaemonPorts::create(&location, description));
        match made {
            Ok(ports) => return ports,
            Err(why) => report(&why),
        }
    }
}
