//! A client's connection to the daemon: records and description.

use std::ops::Deref;
use std::thread::sleep;
use std::time::{Duration, Instant};

use iceoryx2::port::ReceiveError;
use iceoryx2::prelude::{Node, PortFactory};
use iceoryx2::sample::Sample;
use robot_state::{Description, SharedRecord};

use crate::channel::{self, DescriptionMessage, Message, Receiver, RecordMessage, Transport};
use crate::error::Error;
use crate::location::Location;

/// Time limit of [`Client::connect`].
const CONNECT_TIMEOUT: Duration = Duration::from_secs(2);
/// Interval between polls of shared memory: the largest delay until a record is received.
const POLL: Duration = Duration::from_micros(250);

/// A connection to a robot's daemon. It outlives the daemon: when a new one takes over, its records
/// follow.
#[derive(Debug)]
pub struct Client {
    robot: String,
    records: Receiver<RecordMessage>,
    descriptions: Receiver<DescriptionMessage>,
    description: Box<Description>,
    newest_sequence: Option<u64>,
    pub(crate) node: Node<Transport>,
}

/// A record in shared memory, read in place. A client can hold four; the daemon never waits for
/// them.
#[derive(Debug)]
pub struct Record {
    sample: Sample<Transport, RecordMessage, ()>,
    /// Records between this one and the last that this client had received, lost because it was
    /// too slow.
    pub lost: u64,
}

impl Deref for Record {
    type Target = SharedRecord;

    fn deref(&self) -> &SharedRecord {
        &self.sample.payload().0
    }
}

impl Client {
    /// Connects to the daemon that runs `robot`, waiting for it at most two seconds.
    ///
    /// # Errors
    /// [`Error::NoDaemon`], [`Error::OtherLayout`], [`Error::RunDirectory`], [`Error::Transport`].
    pub fn connect(robot: &str) -> Result<Self, Error> {
        Self::connect_at(&Location::find()?, robot, CONNECT_TIMEOUT)
    }

    /// [`Client::connect`] with another run directory or time limit.
    ///
    /// # Errors
    /// As [`Client::connect`].
    pub fn connect_at(location: &Location, robot: &str, timeout: Duration) -> Result<Self, Error> {
        let until = Instant::now() + timeout;
        let node = channel::create_node(location)?;
        let service = channel::open::<DescriptionMessage>(&node, robot, timeout)?;
        let descriptions = channel::receiver(&node, &service)?;
        let description = loop {
            match newest(&descriptions)? {
                Some(message) => break Box::new(message.0),
                None if Instant::now() < until => sleep(POLL),
                None => {
                    let service = service.name().to_string();
                    return Err(channel::no_daemon(robot, &node, service, timeout));
                }
            }
        };
        let service = channel::open::<RecordMessage>(&node, robot, timeout)?;
        let records = channel::receiver(&node, &service)?;
        Ok(Self {
            robot: robot.to_owned(),
            records,
            descriptions,
            description,
            newest_sequence: None,
            node,
        })
    }

    /// The robot's name.
    #[must_use]
    pub fn robot(&self) -> &str {
        &self.robot
    }

    /// Names and constants of the robot.
    #[must_use]
    pub fn description(&self) -> &Description {
        &self.description
    }

    /// The next record in order. 128 are kept for a client that is slower than the daemon; then
    /// the oldest are lost and counted.
    ///
    /// # Errors
    /// [`Error::NoRecord`] if none arrives within `timeout`; [`Error::TooManyRecordsHeld`];
    /// [`Error::Transport`].
    pub fn next_record(&mut self, timeout: Duration) -> Result<Record, Error> {
        let until = Instant::now() + timeout;
        loop {
            match self.receive()? {
                Some(record) => return Ok(record),
                None if Instant::now() < until => sleep(POLL),
                None => {
                    return Err(Error::NoRecord {
                        robot: self.robot.clone(),
                        waited: timeout,
                    });
                }
            }
        }
    }

    /// The newest record, if one has arrived since the last call; those before it are skipped and
    /// not counted as lost.
    ///
    /// # Errors
    /// [`Error::TooManyRecordsHeld`], [`Error::Transport`].
    pub fn latest(&mut self) -> Result<Option<Record>, Error> {
        let mut newest = None;
        let mut lost = 0;
        loop {
            // The record before is released first: at most one is held.
            match self.receive()? {
                Some(record) => {
                    lost += record.lost;
                    newest = Some(record);
                }
                None => {
                    return Ok(newest.map(|record| Record { lost, ..record }));
                }
            }
        }
    }

    /// The records in order, without end; each waits at most `timeout`.
    pub fn records(
        &mut self,
        timeout: Duration,
    ) -> impl Iterator<Item = Result<Record, Error>> + '_ {
        std::iter::from_fn(move || Some(self.next_record(timeout)))
    }

    fn receive(&mut self) -> Result<Option<Record>, Error> {
        let Some(sample) = take(&self.records)? else {
            return Ok(None);
        };
        let sequence = sample.payload().0.cycle.sequence;
        let lost = match self.newest_sequence {
            Some(last) if sequence > last => sequence - last - 1,
            Some(_) => {
                // The count restarted: another daemon took over, perhaps with another configuration.
                if let Some(message) = newest(&self.descriptions)? {
                    *self.description = message.0;
                }
                0
            }
            None => 0,
        };
        self.newest_sequence = Some(sequence);
        Ok(Some(Record { sample, lost }))
    }
}

type Held<M> = Sample<Transport, M, ()>;

pub(crate) fn take<M: Message>(receiver: &Receiver<M>) -> Result<Option<Held<M>>, Error> {
    receiver.receive().map_err(|e| match e {
        ReceiveError::ExceedsMaxBorrows => Error::TooManyRecordsHeld {
            allowed: M::BORROWED,
        },
        ReceiveError::ConnectionFailure(e) => Error::transport(M::CHANNEL, "receive from", &e),
    })
}

pub(crate) fn newest<M: Message>(receiver: &Receiver<M>) -> Result<Option<M>, Error> {
    let mut newest = None;
    while let Some(sample) = take(receiver)? {
        newest = Some(*sample.payload());
    }
    Ok(newest)
}
