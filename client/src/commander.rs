//! Commanding a robot: a client's references.

use robot_state::{Mode, Reference};

use crate::channel::{self, ReferenceMessage, Sender};
use crate::client::Client;
use crate::error::Error;

/// The right to command a robot. One client has it at a time. It ends when the commander is dropped
/// (the robot then holds its position) or its process dies (the robot holds its position after
/// `loop.reference_timeout_ms`).
///
/// After a restart of the daemon, references of a commander from before are not followed until it
/// has asked for mode hold: until then the records show mode hold.
#[derive(Debug)]
pub struct Commander {
    robot: String,
    references: Sender<ReferenceMessage>,
    newest: Reference,
}

impl Commander {
    /// Takes the command of the client's robot.
    ///
    /// # Errors
    /// [`Error::AlreadyCommanded`], [`Error::OtherLayout`], [`Error::NoDaemon`],
    /// [`Error::Transport`].
    pub fn connect(client: &Client) -> Result<Self, Error> {
        let robot = client.robot().to_owned();
        let service =
            channel::open::<ReferenceMessage>(&client.node, &robot, std::time::Duration::ZERO)?;
        let references =
            channel::sender(&client.node, &service)?.ok_or_else(|| Error::AlreadyCommanded {
                robot: robot.clone(),
            })?;
        let newest = Reference {
            joint_count: client.description().joint_count,
            ..Reference::default()
        };
        Ok(Self {
            robot,
            references,
            newest,
        })
    }

    /// Changes the reference and sends it. To be called at least every
    /// `loop.reference_timeout_ms`: a reference is a lease. `sequence` is counted here.
    ///
    /// # Errors
    /// [`Error::Gone`] if the daemon has ended. [`Error::Transport`].
    pub fn send(&mut self, change: impl FnOnce(&mut Reference)) -> Result<(), Error> {
        change(&mut self.newest);
        self.newest.sequence += 1;
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

impl Drop for Commander {
    fn drop(&mut self) {
        // If this does not arrive, the references time out.
        let _ = self.send(|reference| reference.mode = Mode::Hold.number());
    }
}
