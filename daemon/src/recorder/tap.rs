//! The loop's end of the recorder.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use can_codec::Frames;
use recording::{CycleInput, Encoder};
use robot_state::{Event, SharedRecord};
use rtrb::Producer;

use super::output::{Output, RecordingStatus};

/// State shared by both ends and the requests.
#[derive(Debug, Default)]
pub(super) struct Shared {
    dropped: AtomicU64,
    /// Counts up while something is being done.
    progress: AtomicU64,
    ended_as_asked: AtomicBool,
    /// Of each [`Slot`]; never taken by the loop.
    status: [Mutex<RecordingStatus>; 3],
}

/// Who wanted a recording; each may have one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Slot {
    /// A client.
    Client,
    /// Whoever started the daemon.
    Start,
    /// The configuration.
    Always,
}

impl Shared {
    pub(super) fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }

    pub(super) fn progress(&self) -> u64 {
        self.progress.load(Ordering::Relaxed)
    }

    pub(super) fn note_progress(&self) {
        self.progress.fetch_add(1, Ordering::Relaxed);
    }

    pub(super) fn ended_as_asked(&self) -> bool {
        self.ended_as_asked.load(Ordering::Acquire)
    }

    pub(super) fn status(&self, slot: Slot) -> RecordingStatus {
        self.lock(slot).clone()
    }

    pub(super) fn begin(&self, slot: Slot, path: &Path) {
        let mut status = self.lock(slot);
        *status = RecordingStatus {
            path: path.to_owned(),
            running: true,
            dropped_before: self.dropped(),
            generation: status.generation + 1,
            ..RecordingStatus::default()
        };
    }

    /// A request that was not begun; one that runs is not concerned.
    pub(super) fn refuse(&self, slot: Slot, path: &Path, why: &str, running: bool) {
        let mut status = self.lock(slot);
        status.generation += 1;
        status.refused = Some(format!("{}: {why}", path.display()));
        if !running {
            status.path = PathBuf::from(path);
        }
    }

    pub(super) fn report(&self, slot: Slot, output: &Output, dropped: u64) {
        let mut status = self.lock(slot);
        status.cycles = output.cycles();
        status.seconds = output.seconds();
        status.bytes = output.bytes();
        status.lost = output.lost() + dropped.saturating_sub(status.dropped_before);
    }

    pub(super) fn finish(&self, slot: Slot) {
        self.lock(slot).running = false;
    }

    pub(super) fn fail(&self, slot: Slot, why: &str) {
        let mut status = self.lock(slot);
        status.running = false;
        status.failed = Some(why.to_owned());
    }

    fn lock(&self, slot: Slot) -> MutexGuard<'_, RecordingStatus> {
        let [client, start, always] = &self.status;
        let status = match slot {
            Slot::Client => client,
            Slot::Start => start,
            Slot::Always => always,
        };
        status.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The loop's end: takes every cycle. Nothing in it allocates, waits or calls the system.
#[derive(Debug)]
pub struct Tap {
    encoder: Encoder,
    ring: Producer<u8>,
    shared: Arc<Shared>,
}

impl Tap {
    pub(super) fn new(encoder: Encoder, ring: Producer<u8>, shared: Arc<Shared>) -> Self {
        Self {
            encoder,
            ring,
            shared,
        }
    }

    /// Notes an event that is reported to the cycle before its next `step`.
    pub fn note(&mut self, event: Event, times: u64) {
        self.encoder.note(event, times);
    }

    /// Takes a cycle: what it was given and what it gave. A full ring loses it, and counts it.
    pub fn take(&mut self, input: &CycleInput<'_>, record: &SharedRecord, tx: &Frames) {
        let message = self.encoder.encode(input, record, tx);
        let length = (message.len() as u32).to_le_bytes();
        let fits = self.ring.slots() >= length.len() + message.len()
            && self.ring.push_entire_slice(&length).is_ok()
            && self.ring.push_entire_slice(message).is_ok();
        if !fits {
            self.shared.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// The loop ends because it was asked to: without this, its end is a defect.
    pub fn end_as_asked(&self) {
        self.shared.ended_as_asked.store(true, Ordering::Release);
    }

    /// Cycles that were lost to a full ring.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.shared.dropped()
    }
}
