//! Records to clients, references and requests from them, without the loop's thread ever meeting iceoryx2:
//! iceoryx2 allocates when it sends, and maps files when a client connects, leaves or dies.
//!
//! ```text
//!  loop thread                        publisher thread                clients
//!  RecordSender ──► ring of records ──────────────────► DaemonPorts ──► every record
//!  ReferenceReceiver ◄── ring of references ◄───────────┤          ◄── references of all clients
//!                    ◄── ring of pieces ◄───────────────┤          ◄── pieces of trajectories
//!  SettingsReceiver ◄─── triple buffer ◄── RequestServer ◄── records ◄─► requests and answers
//!  OperatorReceiver ◄─── ring ◄───────────────────┘
//! ```
//!
//! Which client commands is decided by the loop ([`supervisor::Commanders`]), not by the publisher
//! thread.
//!
//! All ways are wait-free for the loop: it never waits for the publisher thread, not even when
//! that is interrupted half-way (a multi-producer queue's `push` would then spin). The publisher
//! looks into the ring every half millisecond instead of being woken, since waking it would cost
//! the loop a system call; so a record or a reference is late by half a millisecond at most, on
//! an idle machine.

mod bus_error;
mod connection;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc;
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use cycle::OperatorRequest;
use robot_state::{Description, Reference, Settings, SharedRecord, TrajectoryPiece};
use rtrb::{Consumer, Producer, RingBuffer};
use supervisor::Commanders;
use torqued_client::{DaemonPorts, Error, Location};

use crate::real_time::{monotonic_ns, run_before_ordinary_threads};
use crate::request_server::RequestServer;
use connection::Connection;

/// Largest backlog of the publisher thread, records: a quarter of a second at 1 kHz, 6 MB.
const RING: usize = 256;
/// References on their way to the loop, which takes all of them each cycle: several for each client
/// that can be connected.
const REFERENCE_RING: usize = 64;
/// Pieces of trajectories on their way to the loop: a client sends one every tenth of a second or so.
const PIECE_RING: usize = 4;
/// Operators' requests on their way to the loop: the request server hands over one at a time.
const OPERATOR_RING: usize = 4;
/// Age beyond which the loop no longer carries out a request that may start a motion: nobody
/// waits for it any more.
const OPERATOR_EXPIRY_NS: u64 = 200_000_000;
/// Polling period of the publisher thread.
const POLL: Duration = Duration::from_micros(500);
/// Most records published in one round: each may wake a client that takes the CPU for longer than a
/// cycle, and references, requests and the heartbeat do not wait for the end of a backlog.
const RECORDS: usize = 8;
/// Most requests begun in one round: a flood of requests takes no more of the thread's time.
const REQUESTS: usize = 4;
/// Longest time for the publisher thread to end.
const JOIN_LIMIT: Duration = Duration::from_secs(2);
/// Period of the cleaning up after dead clients.
const CLEANUP_INTERVAL: Duration = Duration::from_millis(250);

/// The loop's ends of the connection with clients.
#[derive(Debug)]
pub struct LoopEnds {
    /// For records.
    pub records: RecordSender,
    /// For references.
    pub references: ReferenceReceiver,
    /// For settings.
    pub settings: SettingsReceiver,
    /// For operators' requests.
    pub operator: OperatorReceiver,
}

/// The loop's end for records.
#[derive(Debug)]
pub struct RecordSender {
    records: Producer<SharedRecord>,
    shared: Arc<Shared>,
    overflow: u64,
    publisher: Option<JoinHandle<()>>,
    /// The publisher thread was parked at a SIGBUS.
    parked: &'static AtomicBool,
}

/// The loop's end for references.
#[derive(Debug)]
pub struct ReferenceReceiver {
    references: Consumer<Reference>,
    pieces: Consumer<TrajectoryPiece>,
    commanders: Commanders,
}

/// The loop's end for settings.
#[derive(Debug)]
pub struct SettingsReceiver {
    settings: triple_buffer::Output<Settings>,
}

/// The loop's end for operators' requests.
#[derive(Debug)]
pub struct OperatorReceiver {
    requests: Consumer<(OperatorRequest, u64)>,
}

#[derive(Debug, Default)]
struct Shared {
    stop: AtomicBool,
    failures: AtomicU64,
    /// Rounds of the publisher thread.
    heartbeat: AtomicU64,
}

/// Publishes `description` and starts the publisher thread, at which `server` serves requests, in that
/// run directory. The thread inherits the caller's CPUs: call it before the loop's thread is pinned to
/// its own. `commanders` decide whose references the loop follows.
///
/// # Errors
/// Obstacles to creating the robot's services, but for a lack of room, which may pass: see
/// [`DaemonPorts::create`].
pub fn start_at(
    location: &Location,
    description: &Description,
    server: RequestServer,
    commanders: Commanders,
) -> Result<LoopEnds, Error> {
    let connection = Connection::make(location, description)?;
    let (mut producer, mut consumer) = RingBuffer::new(RING);
    // Every page is written once now, so that the loop's first round through the ring faults none.
    while producer.push(SharedRecord::default()).is_ok() {}
    while consumer.pop().is_ok() {}
    let (mut arrived, mut references) = RingBuffer::new(REFERENCE_RING);
    while arrived.push(Reference::default()).is_ok() {}
    while references.pop().is_ok() {}
    let (mut sent_ahead, mut pieces) = RingBuffer::new(PIECE_RING);
    while sent_ahead.push(TrajectoryPiece::default()).is_ok() {}
    while pieces.pop().is_ok() {}
    let (input, settings) = triple_buffer::triple_buffer(server.settings());
    let (operator, requests) = RingBuffer::new(OPERATOR_RING);
    let shared = Arc::new(Shared::default());
    // For good: a thread that is parked is never left.
    let parked: &'static AtomicBool = Box::leak(Box::default());
    let publisher = Publisher {
        connection,
        server,
        settings: input,
        operator,
        records: consumer,
        arrived,
        just_read: Vec::with_capacity(REFERENCE_RING),
        sent_ahead,
        shared: Arc::clone(&shared),
    };
    let (started, wait_started) = mpsc::channel();
    let publisher = thread::Builder::new()
        .name("publisher".to_owned())
        .spawn(move || {
            run_before_ordinary_threads();
            bus_error::park_this_thread(parked);
            let _ = started.send(());
            publisher.run();
        })
        .map_err(|e| Error::Thread {
            reason: e.to_string(),
        })?;
    // The thread is on its own before the caller turns real-time.
    let _ = wait_started.recv();
    Ok(LoopEnds {
        records: RecordSender {
            records: producer,
            shared,
            overflow: 0,
            publisher: Some(publisher),
            parked,
        },
        references: ReferenceReceiver {
            references,
            pieces,
            commanders,
        },
        settings: SettingsReceiver { settings },
        operator: OperatorReceiver { requests },
    })
}

impl RecordSender {
    /// Hands a record over; `false` if the ring is full because the publisher thread does not get
    /// any time, and the record is lost to clients. Neither waits nor allocates nor calls the
    /// system.
    pub fn send(&mut self, record: &SharedRecord) -> bool {
        match self.records.write_chunk_uninit(1) {
            Ok(slot) => slot.fill_from_iter(std::iter::once(*record)) == 1,
            Err(_) => {
                self.overflow += 1;
                false
            }
        }
    }

    /// Number of records for which the ring had no room.
    #[must_use]
    pub fn overflow(&self) -> u64 {
        self.overflow
    }

    /// Rounds of the publisher thread so far: a count that stands still is a thread that does.
    #[must_use]
    pub fn heartbeat(&self) -> u64 {
        self.shared.heartbeat.load(Ordering::Relaxed)
    }

    /// Number of failures of shared memory in the publisher thread: clients that were not reached.
    #[must_use]
    pub fn failures(&self) -> u64 {
        self.shared.failures.load(Ordering::Relaxed)
    }
}

impl Drop for RecordSender {
    /// Publishes the records left in the ring, then removes the robot's services.
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Release);
        let until = Instant::now() + JOIN_LIMIT;
        while let Some(publisher) = &self.publisher {
            let given_up = self.parked.load(Ordering::Acquire) || Instant::now() > until;
            if publisher.is_finished() || given_up {
                return;
            }
            thread::sleep(POLL);
        }
    }
}

impl ReferenceReceiver {
    /// Takes all references that have arrived and one piece of a trajectory, and begins the cycle of
    /// `now_ns` on `CLOCK_MONOTONIC`. Neither waits nor allocates nor calls the system.
    pub fn next_command(&mut self, now_ns: u64) -> &Commanders {
        for _ in 0..REFERENCE_RING {
            let Ok(chunk) = self.references.read_chunk(1) else {
                break;
            };
            let (references, _) = chunk.as_slices();
            for reference in references {
                self.commanders.offer(reference, now_ns);
            }
            chunk.commit_all();
        }
        // One a cycle: checking it takes time, and clients may send any number.
        if let Ok(chunk) = self.pieces.read_chunk(1) {
            let (pieces, _) = chunk.as_slices();
            for piece in pieces {
                // A refusal is in the record.
                let _ = self.commanders.offer_piece(piece);
            }
            chunk.commit_all();
        }
        self.commanders.begin_cycle(now_ns);
        &self.commanders
    }
}

impl SettingsReceiver {
    /// The settings that hold now. Neither waits nor allocates nor calls the system.
    pub fn latest(&mut self) -> &Settings {
        self.settings.read()
    }
}

impl OperatorReceiver {
    /// The next request, for one cycle to carry out. Neither waits nor allocates nor calls the
    /// system.
    pub fn next_request(&mut self) -> Option<OperatorRequest> {
        use OperatorRequest::{Acknowledge, Enable};
        while let Ok((request, at_ns)) = self.requests.pop() {
            let expired = monotonic_ns().saturating_sub(at_ns) > OPERATOR_EXPIRY_NS;
            if !expired || !matches!(request, Enable | Acknowledge(_)) {
                return Some(request);
            }
        }
        None
    }
}

struct Publisher {
    connection: Connection,
    server: RequestServer,
    settings: triple_buffer::Input<Settings>,
    operator: Producer<(OperatorRequest, u64)>,
    records: Consumer<SharedRecord>,
    arrived: Producer<Reference>,
    /// Those of this round.
    just_read: Vec<Reference>,
    sent_ahead: Producer<TrajectoryPiece>,
    shared: Arc<Shared>,
}

impl Publisher {
    fn run(mut self) {
        let mut cleaned_up = Instant::now();
        loop {
            // Read before the ring is emptied, so that the last records are published too.
            let stop = self.shared.stop.load(Ordering::Acquire);
            self.shared.heartbeat.fetch_add(1, Ordering::Relaxed);
            let all_published = self.publish_records();
            if stop && all_published {
                return;
            }
            self.take_references();
            self.serve();
            if cleaned_up.elapsed() > CLEANUP_INTERVAL {
                self.connection.look_after();
                cleaned_up = Instant::now();
            }
            if all_published {
                thread::sleep(POLL);
            }
        }
    }

    /// Publishes waiting records, up to [`RECORDS`]; true if none is left.
    fn publish_records(&mut self) -> bool {
        for _ in 0..RECORDS {
            let Ok(slot) = self.records.read_chunk(1) else {
                return true;
            };
            let (records, _) = slot.as_slices();
            for record in records {
                if let Some(ports) = self.connection.ports() {
                    count_failure(&self.shared, &ports.publish(record));
                }
                self.server.observe(record, Instant::now());
            }
            slot.commit_all();
        }
        self.records.is_empty()
    }

    /// Requests and their answers; the loop gets new settings before a client gets the answer.
    fn serve(&mut self) {
        let mut answers = Vec::new();
        let ports = self.connection.ports();
        for _ in 0..REQUESTS {
            let Some(received) = ports.map(DaemonPorts::next_request) else {
                break;
            };
            count_failure(&self.shared, &received);
            let Ok(Some(asked)) = received else {
                break;
            };
            answers.push(self.server.serve(&asked, Instant::now()));
        }
        self.hand_over_operator_request();
        let now = Instant::now();
        answers.extend(std::iter::from_fn(|| self.server.advance(now)));
        if let Some(settings) = self.server.changed_settings() {
            self.settings.write(settings);
        }
        if let Some(ports) = self.connection.ports() {
            for answer in &answers {
                count_failure(&self.shared, &ports.answer(answer));
            }
        }
    }

    fn hand_over_operator_request(&mut self) {
        // Without room it waits; the request server limits the wait.
        if self.operator.slots() > 0
            && let Some(request) = self.server.next_operator_request(Instant::now())
        {
            let _ = self.operator.push((request, monotonic_ns()));
        }
    }

    /// As many as the rings have room for; the rest waits in the clients' buffers. A piece is read
    /// after the references and handed over before them: what was sent first arrives first.
    fn take_references(&mut self) {
        let Some(ports) = self.connection.ports() else {
            return;
        };
        for _ in 0..self.arrived.slots() {
            let received = ports.next_reference();
            count_failure(&self.shared, &received);
            let Ok(Some(reference)) = received else {
                break;
            };
            self.just_read.push(reference);
        }
        for _ in 0..self.sent_ahead.slots() {
            let received = ports.next_piece();
            count_failure(&self.shared, &received);
            let Ok(Some(piece)) = received else {
                break;
            };
            let _ = self.sent_ahead.push(piece);
        }
        for reference in self.just_read.drain(..) {
            let _ = self.arrived.push(reference);
        }
    }
}

fn count_failure<T>(shared: &Shared, result: &Result<T, Error>) {
    if result.is_err() {
        shared.failures.fetch_add(1, Ordering::Relaxed);
    }
}
