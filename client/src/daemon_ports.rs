//! The daemon's end of the services.

use std::path::PathBuf;

use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::{Node, PortFactory};
use robot_state::{
    Answer, CommanderStatus, Description, Reference, Request, SharedRecord, TrajectoryPiece,
};

use crate::channel::{
    self, AnswerMessage, DescriptionMessage, Message, PieceMessage, Receiver, RecordMessage,
    ReferenceMessage, RequestMessage, Sender, StatusMessage, Transport,
};
use crate::error::Error;
use crate::location::Location;
use crate::node_counter;
use crate::process_file;

/// The daemon's end: publishes records, receives references. Not for a real-time thread: it
/// allocates and maps files as clients come and go.
#[derive(Debug)]
pub struct DaemonPorts {
    state: Sender<RecordMessage>,
    description: Sender<DescriptionMessage>,
    reference: Receiver<ReferenceMessage>,
    piece: Receiver<PieceMessage>,
    status: Sender<StatusMessage>,
    request: Receiver<RequestMessage>,
    answer: Sender<AnswerMessage>,
    node: Node<Transport>,
    location: Location,
}

impl DaemonPorts {
    /// Makes the robot's services, or takes those over that a killed daemon left behind, and
    /// publishes the description. Clients that were connected to the killed daemon go on.
    ///
    /// Where another user has taken a name in shared memory that is needed, and no other daemon runs
    /// in the run directory, the directory's objects get other names.
    ///
    /// # Errors
    /// [`Error::AlreadyRunning`], [`Error::OtherLayout`] if clients of another version are still
    /// connected, [`Error::RunDirectory`], [`Error::NoRoom`], [`Error::ForeignFile`],
    /// [`Error::Transport`].
    pub fn create(location: &Location, description: &Description) -> Result<Self, Error> {
        let first = Self::create_at(location, description);
        let taken = matches!(&first, Err(Error::ForeignFile { .. }));
        if !taken || process_file::others_run(location, description.robot.as_str()) {
            return first;
        }
        let mut location = location.clone();
        location.rename_objects()?;
        Self::create_at(&location, description)
    }

    fn create_at(location: &Location, description: &Description) -> Result<Self, Error> {
        let node = channel::create_node(location)?;
        let robot = description.robot.as_str();
        let taken = || Error::AlreadyRunning {
            robot: robot.to_owned(),
        };
        let state = channel::create::<RecordMessage>(&node, robot)?;
        let state = channel::sender(&node, &state)?.ok_or_else(taken)?;
        let service = channel::create::<DescriptionMessage>(&node, robot)?;
        let sender = channel::sender(&node, &service)?.ok_or_else(taken)?;
        sender
            .send_copy(DescriptionMessage(*description))
            .map_err(|e| Error::transport(service.name(), "publish on", &e))?;
        let status = channel::create::<StatusMessage>(&node, robot)?;
        let status = channel::sender(&node, &status)?.ok_or_else(taken)?;
        // Clients open it after the references': it is there then.
        let piece = channel::create::<PieceMessage>(&node, robot)?;
        let piece = channel::receiver(&node, &piece)?;
        let reference = channel::create::<ReferenceMessage>(&node, robot)?;
        let reference = channel::receiver(&node, &reference)?;
        // Answers first, so that every request can be answered.
        let answer = channel::create::<AnswerMessage>(&node, robot)?;
        let answer = channel::sender(&node, &answer)?.ok_or_else(taken)?;
        let request = channel::create::<RequestMessage>(&node, robot)?;
        let request = channel::receiver(&node, &request)?;
        Ok(Self {
            state,
            description: sender,
            reference,
            piece,
            status,
            request,
            answer,
            node,
            location: location.clone(),
        })
    }

    /// Sends a record to all clients, and what commanders need of it to all commanders; gives the
    /// number of clients.
    ///
    /// # Errors
    /// [`Error::Transport`] if a client could not be reached; the others have got the record.
    pub fn publish(&self, record: &SharedRecord) -> Result<usize, Error> {
        // New clients receive the description; if that fails, it is tried again next time.
        let _ = self.description.update_connections();
        let cycle = &record.cycle;
        let status = CommanderStatus {
            cycle: cycle.sequence,
            commander: cycle.commander,
            state: cycle.state,
            mode: cycle.mode,
        };
        let seen = self.status.send_copy(StatusMessage(status));
        seen.map_err(|e| Error::transport(StatusMessage::CHANNEL, "publish on", &e))?;
        self.state
            .send_copy(RecordMessage(*record))
            .map_err(|e| Error::transport("state", "publish on", &e))
    }

    /// The next reference of any client, as it came: unchecked. Each client's come in order.
    ///
    /// # Errors
    /// [`Error::Transport`] if a commanding client could not be reached.
    pub fn next_reference(&self) -> Result<Option<Reference>, Error> {
        let received = self.reference.receive();
        received
            .map(|message| message.map(|message| message.0))
            .map_err(|e| Error::transport(ReferenceMessage::CHANNEL, "receive from", &e))
    }

    /// The next piece of a trajectory of any client, as it came: unchecked. To be asked for after the
    /// references, and handed over before those: then a reference never overtakes a piece that was
    /// sent before it.
    ///
    /// # Errors
    /// [`Error::Transport`] if a commanding client could not be reached.
    pub fn next_piece(&self) -> Result<Option<TrajectoryPiece>, Error> {
        let received = self.piece.receive();
        received
            .map(|message| message.map(|message| message.0))
            .map_err(|e| Error::transport(PieceMessage::CHANNEL, "receive from", &e))
    }

    /// The next request of any client, as it came: unchecked.
    ///
    /// # Errors
    /// [`Error::Transport`] if an asking client could not be reached.
    pub fn next_request(&self) -> Result<Option<Request>, Error> {
        let received = self.request.receive();
        received
            .map(|message| message.map(|message| message.0))
            .map_err(|e| Error::transport(RequestMessage::CHANNEL, "receive from", &e))
    }

    /// Answers a request; gives the number of clients that receive answers.
    ///
    /// # Errors
    /// [`Error::Transport`] if a client could not be reached; the others have got the answer.
    pub fn answer(&self, answer: &Answer) -> Result<usize, Error> {
        self.answer
            .send_copy(AnswerMessage(*answer))
            .map_err(|e| Error::transport(AnswerMessage::CHANNEL, "publish on", &e))
    }

    /// Frees the resources of dead clients, and connects new ones even if nothing is published. To be
    /// called a few times a second; takes milliseconds when a client has died. Gives the files that
    /// other users could have written into, and no longer can.
    pub fn cleanup_dead_clients(&self) -> Vec<PathBuf> {
        self.node.try_cleanup_dead_nodes();
        let _ = self.description.update_connections();
        let _ = self.state.update_connections();
        let _ = self.status.update_connections();
        let _ = self.answer.update_connections();
        node_counter::close_to_others(&self.location)
    }
}
