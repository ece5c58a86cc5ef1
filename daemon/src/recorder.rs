//! The recorder: the last seconds of the loop in memory, black boxes and recordings on the disk.
//!
//! ```text
//!  loop thread              recorder thread
//!  Tap ──► ring of bytes ──► History ──► black box: 2 s before a fault to 0.5 s after it
//!                                   └──► recording, while somebody asks for it
//! ```
//!
//! The loop writes the message of every cycle, as the file will hold it, into a ring; it never waits,
//! and a full ring drops the cycle and counts it. This thread moves the messages into the history,
//! and every file is written from there: a disk that stalls for a second loses nothing. The ring is
//! another one than the publisher's, which carries records alone: a publisher that hangs, as with a
//! full /dev/shm, is one of the things that a black box must show.

mod always;
mod black_box;
mod history;
mod output;
mod tap;

use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use recording::{Counts, Encoder, Glance, Header};
use robot_config::Robot;
use robot_state::Event;
use rtrb::{Consumer, RingBuffer};

pub use always::{Always, RECORDINGS};
pub use black_box::{BlackBoxes, FOLDER, KEPT};
use history::History;
use output::Output;
pub use output::{Contents, RecordingRequest, RecordingStatus};
pub use tap::Tap;
use tap::{Shared, Slot};

/// Time that the ring between the loop and this thread holds, s.
const RING_S: f64 = 1.0;
/// Time that the history holds, s: a black box, and as much again for a disk that stalls.
pub const HISTORY_S: f64 = 5.0;
/// A black box begins this long before the fault, ns.
pub const BEFORE_NS: u64 = 2_000_000_000;
/// A black box ends this long after the fault, ns.
pub const AFTER_NS: u64 = 500_000_000;
/// A loop from which nothing has come for so long has stopped: its black box is not waited with.
const SILENCE: Duration = Duration::from_secs(1);
/// Polling period of the thread.
const POLL: Duration = Duration::from_millis(5);
/// Most messages that are written to a file before the ring is emptied again.
const BATCH: usize = 64;

/// Both ends of the recorder of one robot's loop, before they are given to their threads.
pub struct Ends {
    /// The loop's end.
    pub tap: Tap,
    /// The other end.
    pub recorder: Recorder,
    /// For requests to record.
    pub handle: RecorderHandle,
}

/// For other threads: requests to record, and what became of them.
#[derive(Debug, Clone)]
pub struct RecorderHandle {
    requests: Sender<RecordingRequest>,
    shared: Arc<Shared>,
}

impl RecorderHandle {
    /// Asks the recorder for something; its status shows what became of it.
    pub fn ask(&self, request: RecordingRequest) {
        // Without a recorder the status stays as it is, and whoever waits gives up in time.
        let _ = self.requests.send(request);
    }

    /// Cycles that the loop could not hand over since its start.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.shared.dropped()
    }

    /// Counts up while the recorder takes or writes something.
    #[must_use]
    pub fn progress(&self) -> u64 {
        self.shared.progress()
    }

    /// The state of the recording that a client asked for, or of the last one.
    #[must_use]
    pub fn status(&self) -> RecordingStatus {
        self.shared.status(Slot::Client)
    }

    /// The state of the file that the recording of the configuration is writing.
    #[must_use]
    pub fn status_always(&self) -> RecordingStatus {
        self.shared.status(Slot::Always)
    }

    /// The state of the recording that the daemon was started with.
    #[must_use]
    pub fn status_from_start(&self) -> RecordingStatus {
        self.shared.status(Slot::Start)
    }
}

/// A recorder for a robot, with its memory; nothing is written before a fault or a request.
/// `boxes`: where black boxes are kept, if anywhere.
#[must_use]
pub fn create(robot: &Robot, header: Header, boxes: Option<BlackBoxes>) -> Ends {
    let counts: Counts = header.counts();
    let encoder = Encoder::new(counts);
    let frames = [&robot.receive, &robot.send].into_iter().flat_map(|table| {
        let entries = (0..table.message_count()).filter_map(|m| table.message(m));
        entries.map(|entry| usize::from(entry.len))
    });
    let message = encoder.size(frames);
    let rate = 1.0 / header.period_s;
    let bytes = |seconds: f64| (seconds * rate).ceil() as usize * (message + size_of::<u32>());
    let (mut producer, mut consumer) = RingBuffer::new(bytes(RING_S));
    // Every page is written once now, so that the loop's first round through the ring faults none.
    while producer.push(0).is_ok() {}
    while consumer.pop().is_ok() {}
    let shared = Arc::new(Shared::default());
    let (requests, received) = channel();
    Ends {
        tap: Tap::new(encoder, producer, Arc::clone(&shared)),
        recorder: Recorder {
            ring: consumer,
            history: History::new(bytes(HISTORY_S), (HISTORY_S * rate).ceil() as usize),
            last_fault: header.start.fault.map_or(0, Event::number),
            header,
            boxes,
            always: None,
            pending: None,
            recordings: Vec::new(),
            requests: received,
            shared: Arc::clone(&shared),
            heard: Instant::now(),
            ended: false,
            message: Vec::with_capacity(message),
        },
        handle: RecorderHandle { requests, shared },
    }
}

/// The recorder; its thread calls [`poll`](Self::poll) over and over.
pub struct Recorder {
    ring: Consumer<u8>,
    history: History,
    header: Header,
    boxes: Option<BlackBoxes>,
    /// The recording that always runs.
    always: Option<Always>,
    /// The black box that is being waited for or written.
    pending: Option<Pending>,
    recordings: Vec<(Slot, Output)>,
    requests: Receiver<RecordingRequest>,
    shared: Arc<Shared>,
    last_fault: u32,
    /// When the last message came.
    heard: Instant,
    /// The loop has ended, and everything that it sent is in the history.
    ended: bool,
    message: Vec<u8>,
}

/// A black box on its way.
struct Pending {
    event: Event,
    /// The first entry of the history that it holds.
    from: u64,
    until_ns: u64,
    /// It is being written; none while its end is waited for.
    output: Option<Output>,
}

impl Recorder {
    /// Runs on a thread of its own until the loop has ended and everything is written.
    ///
    /// # Errors
    /// The thread cannot be started.
    pub fn start(mut self) -> std::io::Result<JoinHandle<()>> {
        let thread = thread::Builder::new().name("recorder".to_owned());
        thread.spawn(move || {
            crate::real_time::run_as_ordinary_thread();
            while !self.is_over() {
                if !self.poll(Instant::now()) {
                    thread::sleep(POLL);
                }
            }
        })
    }

    /// Everything is written, and nothing more will come.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.ended && self.pending.is_none() && self.recordings.is_empty()
    }

    /// Takes what has come and writes a part of what is to be written; `false` if there was nothing
    /// to do.
    pub fn poll(&mut self, now: Instant) -> bool {
        // Looked at before the ring is emptied, so that its last messages are taken too.
        let gone = self.ring.is_abandoned();
        let taken = self.drain(now);
        if gone && !taken && !self.ended {
            self.end();
        }
        self.serve(now);
        let wrote_box = self.advance_black_box(now);
        self.advance_always(now);
        let wrote = self.advance_recordings(now);
        let any = taken || wrote_box || wrote;
        if any {
            self.shared.note_progress();
        }
        any
    }

    /// Moves messages from the ring into the history.
    fn drain(&mut self, now: Instant) -> bool {
        let mut any = false;
        while let Some(length) = self.next_length() {
            self.message.resize(length, 0);
            let mut head = [0; size_of::<u32>()];
            let whole = self.ring.pop_entire_slice(&mut head).is_ok()
                && self.ring.pop_entire_slice(&mut self.message).is_ok();
            if !whole {
                break;
            }
            any = true;
            self.heard = now;
            if let Some(glance) = Glance::at(&self.message) {
                let number = self.history.push(&self.message, glance.stamp_ns);
                self.look_for_fault(&glance, number);
            }
        }
        any
    }

    /// Length of the next message, if the whole of it is in the ring.
    fn next_length(&mut self) -> Option<usize> {
        let slots = self.ring.slots();
        let head = self.ring.read_chunk(size_of::<u32>()).ok()?;
        let (first, second) = head.as_slices();
        let mut bytes = [0; size_of::<u32>()];
        let both = first.iter().chain(second);
        bytes
            .iter_mut()
            .zip(both)
            .for_each(|(to, from)| *to = *from);
        let length = u32::from_le_bytes(bytes) as usize;
        (slots >= length + bytes.len()).then_some(length)
    }

    fn look_for_fault(&mut self, glance: &Glance, number: u64) {
        let last = std::mem::replace(&mut self.last_fault, glance.fault);
        let Some(event) = Event::from_number(glance.fault) else {
            return;
        };
        // A fault that follows within the time of a black box stands in it.
        if glance.fault != last && self.boxes.is_some() && self.pending.is_none() {
            self.pending = Some(Pending {
                event,
                from: self
                    .history
                    .since(glance.stamp_ns.saturating_sub(BEFORE_NS), number),
                until_ns: glance.stamp_ns + AFTER_NS,
                output: None,
            });
        }
    }

    /// The loop's thread is gone: without having said so, by a defect.
    fn end(&mut self) {
        self.ended = true;
        let (Some((number, stamp_ns)), Some(_)) = (self.history.newest(), &self.boxes) else {
            return;
        };
        if !self.shared.ended_as_asked() && self.pending.is_none() {
            self.pending = Some(Pending {
                event: Event::LoopEnded,
                from: self
                    .history
                    .since(stamp_ns.saturating_sub(BEFORE_NS), number),
                until_ns: stamp_ns,
                output: None,
            });
        }
    }

    fn advance_black_box(&mut self, now: Instant) -> bool {
        let (Some(pending), Some(boxes)) = (&mut self.pending, &self.boxes) else {
            return false;
        };
        let silent = self.ended || now.duration_since(self.heard) > SILENCE;
        let newest = self.history.newest();
        let complete = newest.is_some_and(|(_, stamp_ns)| stamp_ns >= pending.until_ns);
        if pending.output.is_none() {
            if !complete && !silent {
                return false;
            }
            match boxes.begin(&self.header, pending.event, pending.from, pending.until_ns) {
                Ok(output) => pending.output = Some(output),
                Err(why) => {
                    tracing::warn!("the black box cannot be written: {why}");
                    self.pending = None;
                    return true;
                }
            }
        }
        let Some(output) = &mut pending.output else {
            return false;
        };
        let done = match output.advance(&self.history, BATCH) {
            Ok(written) => written == 0 || output.is_at_end(),
            Err(why) => {
                tracing::warn!("the black box cannot be written: {why}");
                boxes.abandon(output);
                self.pending = None;
                return true;
            }
        };
        if done && let Some(output) = pending.output.take() {
            match boxes.finish(output) {
                Ok(path) => tracing::info!("black box: {}", path.display()),
                Err(why) => tracing::warn!("the black box cannot be written: {why}"),
            }
            self.pending = None;
        }
        true
    }

    fn serve(&mut self, now: Instant) {
        while let Ok(request) = self.requests.try_recv() {
            match request {
                RecordingRequest::Begin {
                    path,
                    seconds,
                    last_s,
                    contents,
                    overwrite,
                    unattended,
                } => {
                    let slot = if unattended {
                        Slot::Start
                    } else {
                        Slot::Client
                    };
                    let running = self.find(slot).is_some();
                    let begun = if running {
                        Err("another recording is running".to_owned())
                    } else {
                        self.begin(&path, seconds, last_s, contents, overwrite)
                    };
                    match begun {
                        Ok(mut output) => {
                            if !unattended {
                                output.renew(now);
                            }
                            self.shared.begin(slot, &path);
                            self.recordings.push((slot, output));
                        }
                        Err(why) => {
                            if unattended {
                                tracing::info!("{}: nothing is recorded: {why}", path.display());
                            }
                            self.shared.refuse(slot, &path, &why, running);
                        }
                    }
                }
                RecordingRequest::Renew => {
                    if let Some(output) = self.find(Slot::Client) {
                        output.renew(now);
                    }
                }
                RecordingRequest::End => {
                    let newest = self.history.newest();
                    if let Some(output) = self.find(Slot::Client) {
                        output.end_after(newest.map_or(0, |(_, stamp_ns)| stamp_ns));
                    }
                }
            }
        }
    }

    fn find(&mut self, slot: Slot) -> Option<&mut Output> {
        let mut recordings = self.recordings.iter_mut();
        recordings.find_map(|(own, output)| (*own == slot).then_some(output))
    }

    fn begin(
        &self,
        path: &std::path::Path,
        seconds: Option<f64>,
        last_s: f64,
        contents: Contents,
        overwrite: bool,
    ) -> Result<Output, String> {
        let newest = self.history.newest();
        let (next, stamp_ns) = newest.map_or((0, None), |(n, stamp)| (n + 1, Some(stamp)));
        let begin_ns = stamp_ns.map(|stamp| stamp.saturating_sub((last_s * 1e9) as u64));
        let from = match begin_ns {
            Some(begin_ns) if last_s > 0.0 => self.history.since(begin_ns, next),
            _ => next,
        };
        let until_ns = match (seconds, stamp_ns) {
            (None, _) => u64::MAX,
            (Some(seconds), stamp) => stamp.unwrap_or(0) + (seconds * 1e9) as u64,
        };
        let header = self.header_with(contents);
        let output = Output::create(path, overwrite, &header, from, until_ns);
        output.map_err(|why| why.to_string())
    }

    /// The header of a recording with these contents.
    fn header_with(&self, contents: Contents) -> Header {
        Header {
            content: contents.content,
            every: contents.every,
            ..self.header.clone()
        }
    }

    fn advance_recordings(&mut self, now: Instant) -> bool {
        let mut any = false;
        for (slot, mut output) in std::mem::take(&mut self.recordings) {
            let written = output.advance(&self.history, BATCH);
            self.shared.report(slot, &output, self.shared.dropped());
            let count = match written {
                Ok(count) => count,
                Err(why) => {
                    let path = output.path().to_owned();
                    let why = output.give_up(why);
                    tracing::warn!("{}: the recording ends: {why}", path.display());
                    self.shared.fail(slot, &why.to_string());
                    continue;
                }
            };
            any |= count > 0;
            let abandoned = output.is_expired(now);
            if abandoned {
                tracing::warn!("nobody asks for the recording any more: it ends");
                output.end_after(self.history.newest().map_or(0, |(_, stamp_ns)| stamp_ns));
            }
            let over = output.is_at_end() || (self.ended && count == 0);
            if over {
                match output.finish() {
                    Ok(_) => self.shared.finish(slot),
                    Err(why) => {
                        tracing::warn!("the recording ends: {why}");
                        self.shared.fail(slot, &why.to_string());
                    }
                }
            } else {
                self.recordings.push((slot, output))
            }
        }
        any
    }
}
