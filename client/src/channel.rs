//! The services of a robot: their messages, their buffers, and how they are opened.
//!
//! | service                        | publisher | carries                           |
//! | ------------------------------ | --------- | --------------------------------- |
//! | `torqued/<robot>/description`  | daemon    | names and constants, once         |
//! | `torqued/<robot>/state`        | daemon    | every cycle's record              |
//! | `torqued/<robot>/reference`    | clients   | references; one session has the lease |
//! | `torqued/<robot>/trajectory`   | clients   | pieces of trajectories, sent ahead |
//! | `torqued/<robot>/commander`    | daemon    | every cycle: who commands, followed or not |
//! | `torqued/<robot>/request`      | clients   | requests: tare, contact set       |
//! | `torqued/<robot>/answer`       | daemon    | answers, with the request's id    |
//!
//! The daemon's services have at most one publisher: a second daemon is refused.

use std::fmt::Debug;
use std::thread::sleep;
use std::time::{Duration, Instant};

use iceoryx2::port::publisher::{Publisher, PublisherCreateError};
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;
use iceoryx2::service::builder::publish_subscribe::{
    PublishSubscribeOpenError, PublishSubscribeOpenOrCreateError,
};
use iceoryx2::service::port_factory::publish_subscribe::PortFactory as Factory;
use robot_state::{
    Answer, CommanderStatus, Description, Layout, Reference, Request, SharedRecord,
    TrajectoryPiece, layout_hash,
};

use crate::error::Error;
use crate::location::Location;
use crate::node_counter;
use crate::room;

/// Time limit of retries with back-off: dead processes are being cleaned up, or another process is
/// just creating the same service.
const RETRY_FOR: Duration = Duration::from_millis(500);
const BACK_OFF: std::ops::RangeInclusive<Duration> =
    Duration::from_millis(1)..=Duration::from_millis(50);

/// Programs that can be connected to one robot at the same time.
const MAX_CLIENTS: usize = 8;
/// Processes that can have a robot's services open, the daemon and those just dying included.
const MAX_NODES: usize = 2 * MAX_CLIENTS + 4;

/// Shared memory between the processes of one machine; the ports may move between threads.
pub(crate) type Transport = ipc_threadsafe::Service;

/// A message of one of the services.
pub(crate) trait Message: ZeroCopySend + Debug + Copy + 'static {
    /// Last part of the service's name.
    const CHANNEL: &'static str;
    /// Messages that wait for a slow subscriber before it loses the oldest.
    const BUFFER: usize;
    /// Earlier messages that a new subscriber receives.
    const HISTORY: usize;
    /// Messages that a subscriber can hold at once.
    const BORROWED: usize;
    /// Subscribers.
    const SUBSCRIBERS: usize;
    /// Publishers.
    const PUBLISHERS: usize;
}

macro_rules! message {
    ($name:ident, $payload:ident, $channel:literal, $($key:ident = $value:expr),*) => {
        #[doc = concat!("A [`", stringify!($payload), "`] in shared memory.")]
        #[repr(transparent)]
        #[derive(Debug, Clone, Copy)]
        pub(crate) struct $name(pub(crate) $payload);

        // SAFETY: `$payload` is a `#[repr(C)]` record of integers, floats and arrays of them: no
        // pointers or handles, any bytes are a valid value. Its type name carries the hash of its
        // layout, so a process with another layout is refused.
        unsafe impl ZeroCopySend for $name {
            unsafe fn type_name() -> &'static str {
                const NAME: [u8; TYPE_PREFIX.len() + stringify!($payload).len() + 17] =
                    type_name_bytes(stringify!($payload), layout_hash::<$payload>());
                const TEXT: &str = match std::str::from_utf8(&NAME) {
                    Ok(text) => text,
                    Err(_) => panic!("a type name is ASCII"),
                };
                TEXT
            }
        }

        impl Message for $name {
            const CHANNEL: &'static str = $channel;
            $(const $key: usize = $value;)*
        }
    };
}

message!(
    RecordMessage,
    SharedRecord,
    "state",
    BUFFER = 128,
    HISTORY = 1,
    BORROWED = 4,
    SUBSCRIBERS = MAX_CLIENTS,
    PUBLISHERS = 1
);
message!(
    DescriptionMessage,
    Description,
    "description",
    BUFFER = 1,
    HISTORY = 1,
    BORROWED = 1,
    SUBSCRIBERS = MAX_CLIENTS,
    PUBLISHERS = 1
);
// Without history: a restarted daemon must not follow an old reference. Each client has its own
// buffer, long enough that none of its references overtakes one that asked for hold.
message!(
    ReferenceMessage,
    Reference,
    "reference",
    BUFFER = 8,
    HISTORY = 0,
    BORROWED = 1,
    SUBSCRIBERS = 1,
    PUBLISHERS = MAX_CLIENTS
);
// A piece lasts longer than the daemon takes to fetch it.
message!(
    PieceMessage,
    TrajectoryPiece,
    "trajectory",
    BUFFER = 4,
    HISTORY = 0,
    BORROWED = 1,
    SUBSCRIBERS = 1,
    PUBLISHERS = MAX_CLIENTS
);
message!(
    StatusMessage,
    CommanderStatus,
    "commander",
    BUFFER = 1,
    HISTORY = 1,
    BORROWED = 1,
    SUBSCRIBERS = MAX_CLIENTS,
    PUBLISHERS = 1
);

// Each client has its own buffer: a client that sends too many loses its own requests.
message!(
    RequestMessage,
    Request,
    "request",
    BUFFER = 4,
    HISTORY = 0,
    BORROWED = 1,
    SUBSCRIBERS = 1,
    PUBLISHERS = MAX_CLIENTS
);
// Every client receives all answers, and takes those to its own requests.
message!(
    AnswerMessage,
    Answer,
    "answer",
    BUFFER = 64,
    HISTORY = 0,
    BORROWED = 1,
    SUBSCRIBERS = MAX_CLIENTS,
    PUBLISHERS = 1
);

const TYPE_PREFIX: &str = "torqued::";

/// The name under which a record's type is known in shared memory, e.g.
/// `torqued::Reference#0123456789abcdef`; clients in other languages must use the same.
pub(crate) fn type_name<T: Layout>(record: &str) -> String {
    format!("{TYPE_PREFIX}{record}#{:016x}", layout_hash::<T>())
}

/// [`type_name`] at compile time.
const fn type_name_bytes<const N: usize>(record: &str, hash: u64) -> [u8; N] {
    let mut out = [b'#'; N];
    let (prefix, record) = (TYPE_PREFIX.as_bytes(), record.as_bytes());
    let mut i = 0;
    while i < prefix.len() {
        out[i] = prefix[i];
        i += 1;
    }
    while i < prefix.len() + record.len() {
        out[i] = record[i - prefix.len()];
        i += 1;
    }
    let mut digit = 0;
    while digit < 16 {
        out[i + 1 + digit] = b"0123456789abcdef"[(hash >> (60 - 4 * digit)) as usize & 15];
        digit += 1;
    }
    out
}

/// A robot's service of message `M`, opened.
pub(crate) type Channel<M> = Factory<Transport, M, ()>;
/// The writing end.
pub(crate) type Sender<M> = Publisher<Transport, M, ()>;
/// The reading end.
pub(crate) type Receiver<M> = Subscriber<Transport, M, ()>;

/// The name of the robot's service of message `M`.
pub(crate) fn service_name<M: Message>(robot: &str) -> String {
    format!("torqued/{robot}/{}", M::CHANNEL)
}

/// A node: this program's registration in the run directory. Creating it also cleans up after
/// processes that died.
pub(crate) fn create_node(location: &Location) -> Result<Node<Transport>, Error> {
    let config = location.config()?;
    room::check()?;
    let refuse = |reason: String| match room::foreign_file(location) {
        Some((file, user)) => Error::ForeignFile {
            file,
            user,
            run_dir: location.path().to_owned(),
        },
        None => Error::RunDirectory {
            path: location.path().to_owned(),
            reason,
        },
    };
    node_counter::make_private(location)
        .map_err(|e| refuse(format!("its object in /dev/shm cannot be made ({e})")))?;
    let node = retry(RETRY_FOR, || {
        NodeBuilder::new()
            .config(&config)
            // Signals belong to the program, not to a library in it.
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<Transport>()
    })
    .map_err(|e| refuse(format!("no node can be created in it ({e:?})")))?;
    node_counter::close_to_others(location);
    Ok(node)
}

/// Opens the service that the daemon made; an error if there is none after `wait`.
pub(crate) fn open<M: Message>(
    node: &Node<Transport>,
    robot: &str,
    wait: Duration,
) -> Result<Channel<M>, Error> {
    let name = service_name::<M>(robot);
    let wait = wait.max(RETRY_FOR);
    let builder = node
        .service_builder(&parse_name(&name)?)
        .publish_subscribe::<M>();
    let until = Instant::now() + wait;
    let mut pause = *BACK_OFF.start();
    loop {
        match builder.clone().open() {
            Ok(service) => return Ok(service),
            Err(PublishSubscribeOpenError::IncompatibleTypes) => {
                return Err(other_layout::<M>(node, name));
            }
            Err(_) if Instant::now() < until => back_off(&mut pause),
            Err(PublishSubscribeOpenError::DoesNotExist) => {
                return Err(no_daemon(robot, node, name, wait));
            }
            Err(e) => return Err(Error::transport(&name, "open", &e)),
        }
    }
}

/// Opens the service, or makes it: the daemon's way.
pub(crate) fn create<M: Message>(node: &Node<Transport>, robot: &str) -> Result<Channel<M>, Error> {
    let name = service_name::<M>(robot);
    let builder = node
        .service_builder(&parse_name(&name)?)
        .publish_subscribe::<M>()
        // The publisher never waits for a slow subscriber, which loses its oldest messages.
        .enable_safe_overflow(true)
        .subscriber_max_buffer_size(M::BUFFER)
        .subscriber_max_borrowed_samples(M::BORROWED)
        .history_size(M::HISTORY)
        .max_publishers(M::PUBLISHERS)
        .max_subscribers(M::SUBSCRIBERS)
        .max_nodes(MAX_NODES);
    let until = Instant::now() + RETRY_FOR;
    let mut pause = *BACK_OFF.start();
    loop {
        use PublishSubscribeOpenError::IncompatibleTypes;
        match builder.clone().open_or_create() {
            Ok(service) => return Ok(service),
            Err(PublishSubscribeOpenOrCreateError::PublishSubscribeOpenError(
                IncompatibleTypes,
            )) => return Err(other_layout::<M>(node, name)),
            Err(_) if Instant::now() < until => back_off(&mut pause),
            Err(e) => return Err(Error::transport(&name, "create", &e)),
        }
    }
}

/// A publisher of the service; `None` if other living processes hold all its places.
pub(crate) fn sender<M: Message>(
    node: &Node<Transport>,
    service: &Channel<M>,
) -> Result<Option<Sender<M>>, Error> {
    let created = retry(RETRY_FOR, || {
        let created = service.publisher_builder().create();
        if created.is_err() {
            // The process that holds the place may have died a moment ago.
            node.try_cleanup_dead_nodes();
        }
        created
    });
    match created {
        Ok(sender) => {
            room::reserve(node)?;
            Ok(Some(sender))
        }
        Err(PublisherCreateError::ExceedsMaxSupportedPublishers) => Ok(None),
        Err(e) => Err(Error::transport(service.name(), "publish on", &e)),
    }
}

/// A subscriber of the service.
pub(crate) fn receiver<M: Message>(
    node: &Node<Transport>,
    service: &Channel<M>,
) -> Result<Receiver<M>, Error> {
    let created = retry(RETRY_FOR, || {
        let created = service.subscriber_builder().create();
        if created.is_err() {
            node.try_cleanup_dead_nodes();
        }
        created
    })
    .map_err(|e| Error::transport(service.name(), "subscribe to", &e))?;
    room::reserve(node)?;
    Ok(created)
}

/// The error where no daemon offers `service`.
pub(crate) fn no_daemon(
    robot: &str,
    node: &Node<Transport>,
    service: String,
    waited: Duration,
) -> Error {
    Error::NoDaemon {
        robot: robot.to_owned(),
        service,
        run_dir: node.config().global.root_path().to_string(),
        waited,
    }
}

fn parse_name(name: &str) -> Result<ServiceName, Error> {
    name.try_into()
        .map_err(|e| Error::transport(name, "name", &e))
}

fn other_layout<M: Message>(node: &Node<Transport>, service: String) -> Error {
    let details = parse_name(&service).ok().and_then(|name| {
        Transport::details(&name, node.config(), MessagingPattern::PublishSubscribe)
            .ok()
            .flatten()
    });
    let theirs = details.map_or_else(
        || "unknown".to_owned(),
        |d| {
            let types = d.static_details.publish_subscribe().message_type_details();
            types.payload.type_name().to_string()
        },
    );
    // SAFETY: only the text is used.
    let ours = unsafe { <M as ZeroCopySend>::type_name() }.to_owned();
    Error::OtherLayout {
        service,
        theirs,
        ours,
    }
}

fn back_off(pause: &mut Duration) {
    sleep(*pause);
    *pause = (*pause * 2).min(*BACK_OFF.end());
}

fn retry<T, E>(wait: Duration, mut step: impl FnMut() -> Result<T, E>) -> Result<T, E> {
    let until = Instant::now() + wait;
    let mut pause = *BACK_OFF.start();
    loop {
        match step() {
            Err(_) if Instant::now() < until => back_off(&mut pause),
            result => return result,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn type_names_are_the_same_at_compile_time_and_as_generated() {
        // SAFETY: only the texts are compared.
        let names = unsafe {
            [
                <RecordMessage as ZeroCopySend>::type_name(),
                <DescriptionMessage as ZeroCopySend>::type_name(),
                <ReferenceMessage as ZeroCopySend>::type_name(),
                <StatusMessage as ZeroCopySend>::type_name(),
                <PieceMessage as ZeroCopySend>::type_name(),
                <RequestMessage as ZeroCopySend>::type_name(),
                <AnswerMessage as ZeroCopySend>::type_name(),
            ]
        };
        assert_eq!(names[0], type_name::<SharedRecord>("SharedRecord"));
        assert_eq!(names[1], type_name::<Description>("Description"));
        assert_eq!(names[2], type_name::<Reference>("Reference"));
        assert_eq!(names[3], type_name::<CommanderStatus>("CommanderStatus"));
        assert_eq!(names[4], type_name::<TrajectoryPiece>("TrajectoryPiece"));
        assert_eq!(names[5], type_name::<Request>("Request"));
        assert_eq!(names[6], type_name::<Answer>("Answer"));
    }
}
