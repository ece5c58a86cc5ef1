//! Commanding a robot: a client's references.

use std::thread::sleep;
use std::time::Duration;

use nix::time::{ClockId, clock_gettime};
use robot_state::{Mode, Reference};

use crate::channel::{self, ReferenceMessage, Sender};
use crate::client::Client;
use crate::error::Error;

/// Longest wait for the record that shows the measured pose.
const RECORD_TIMEOUT: Duration = Duration::from_secs(2);
/// Shortest and longest time that the daemon is given to see the first reference, s.
const SEEN_S: (f64, f64) = (0.005, 0.1);

/// The right to command a robot. One client has it at a time. It ends when the commander is dropped
/// (the robot then holds its position) or its process dies (the robot holds its position after
/// `loop.reference_timeout_ms`).
///
/// After a restart of the daemon, references of a commander from before are not followed until it
/// has asked for mode hold: until then the records show mode hold. The same holds after a flaw in a
/// reference, a fault, and an operator's stop.
#[derive(Debug)]
pub struct Commander {
    robot: String,
    references: Sender<ReferenceMessage>,
    newest: Reference,
}

impl Commander {
    /// Takes the command of the client's robot. The first reference is sent here: it asks for mode
    /// hold, with `q_d` at the measured pose of the newest record, which is taken from the client.
    ///
    /// # Errors
    /// [`Error::AlreadyCommanded`], [`Error::OtherLayout`], [`Error::NoDaemon`],
    /// [`Error::NoRecord`], [`Error::Gone`], [`Error::Transport`].
    pub fn connect(client: &mut Client) -> Result<Self, Error> {
        let robot = client.robot().to_owned();
        let record = match client.latest()? {
            Some(record) => record,
            None => client.next_record(RECORD_TIMEOUT)?,
        };
        let service = channel::open::<ReferenceMessage>(&client.node, &robot, Duration::ZERO)?;
        let references =
            channel::sender(&client.node, &service)?.ok_or_else(|| Error::AlreadyCommanded {
                robot: robot.clone(),
            })?;
        let description = client.description();
        let mut newest = Reference {
            joint_count: description.joint_count,
            mode: Mode::Hold.number(),
            ..Reference::default()
        };
        let measured = record.cycle.measured.joints.iter();
        for (desired, joint) in newest.joints.iter_mut().zip(measured) {
            desired.q_d = joint.q;
        }
        let mut commander = Self {
            robot,
            references,
            newest,
        };
        commander.send(|_| ())?;
        // The daemon sees the newest reference only: none follows before it has seen this one.
        let cycles = 2.0 / description.rate_hz;
        sleep(Duration::from_secs_f64(cycles.clamp(SEEN_S.0, SEEN_S.1)));
        Ok(commander)
    }

    /// The newest reference.
    #[must_use]
    pub fn reference(&self) -> &Reference {
        &self.newest
    }

    /// Changes the reference and sends it. To be called at least every
    /// `loop.reference_timeout_ms`: a reference is a lease. `sequence` and `sent_ns` are set here.
    ///
    /// # Errors
    /// [`Error::Gone`] if the daemon has ended. [`Error::Transport`].
    pub fn send(&mut self, change: impl FnOnce(&mut Reference)) -> Result<(), Error> {
        change(&mut self.newest);
        self.newest.sequence += 1;
        self.newest.sent_ns = monotonic_ns();
        let listeners = self
            .references
            .send_copy(ReferenceMessage(self.newest))
            .map_err(|e| Error::transport("reference", "publish on", &e))?;
        if listeners == 0 {
            return Err(Error::Gone {
                robot: self.robot.clone(),
            });
        }
        Ok(())
    }
}

fn monotonic_ns() -> u64 {
    // The clock exists on every Linux; 0 lets the age count from the arrival.
    clock_gettime(ClockId::CLOCK_MONOTONIC).map_or(0, |t| {
        t.tv_sec().unsigned_abs() * 1_000_000_000 + t.tv_nsec().unsigned_abs()
    })
}

impl Drop for Commander {
    fn drop(&mut self) {
        // If this does not arrive, the references time out.
        let _ = self.send(|reference| reference.mode = Mode::Hold.number());
    }
}
