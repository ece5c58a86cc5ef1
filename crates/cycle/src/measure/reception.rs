//! Reception: the newest signals of all messages, and the age of each sample.

use can_codec::{Frames, Table};
use robot_config::{Robot, Sampled, Sampling, slots};
use robot_state::{Event, measured_flags};

use supervisor::{Liveness, SignalMonitor, SignalParameters};

use super::align::OVERDUE;
use crate::events::{Counts, Subject};
use crate::time::{Instants, SECONDS_PER_NS, Stamp};

/// Error of a frame's stamp against the instant of SYNC, ns: both are read on one clock, but by
/// kernel and process.
const STAMP_ERROR_NS: u64 = 20_000;

/// The messages that bring one joint's or sensor's sample.
#[derive(Debug)]
pub(crate) struct Source {
    messages: Vec<usize>,
    /// Slots whose values must be finite.
    slots: Vec<usize>,
    sampling: Sampling,
    /// Instant of the last usable sample's oldest message; none before the first.
    used: Option<u64>,
    /// Judge of the first slots' values.
    monitor: SignalMonitor,
    liveness: Liveness,
    /// A sample with a flat or saturated value is not usable.
    needs_all: bool,
}

impl Source {
    /// Instant of the last usable sample's oldest message, ns; none before the first.
    pub(crate) fn last_used(&self) -> Option<u64> {
        self.used
    }
}

/// A source's sample in one cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Reading {
    /// The sample is complete, finite and not overdue.
    pub(crate) usable: bool,
    /// Age of the last usable sample, by its oldest message, s; infinite before the first.
    pub(crate) age_s: f64,
    /// Bits of `measured_flags`.
    pub(crate) flags: u32,
}

/// Decoded signals and the instants at which their messages arrived.
#[derive(Debug)]
pub(crate) struct Reception {
    table: Table,
    slots: Vec<f64>,
    /// Instant of each message's last frame; none before the first.
    stamps: Vec<Option<u64>>,
    /// The message has arrived since the last cycle.
    fresh: Vec<bool>,
    stale_after_s: f64,
}

impl Reception {
    pub(crate) fn new(robot: &Robot) -> Self {
        let table = robot.receive.clone();
        Self {
            slots: vec![0.0; slots::receive_len(&robot.parameters)],
            stamps: vec![None; table.message_count()],
            fresh: vec![false; table.message_count()],
            stale_after_s: robot.parameters.timing.stale_after,
            table,
        }
    }

    /// The source of the signals in these slots, of which the first have these parameters.
    /// `needs_all`: a sample with a flat or saturated value among those is not usable.
    pub(crate) fn source(
        &self,
        slots: Vec<usize>,
        sampling: Sampling,
        signals: &[SignalParameters],
        needs_all: bool,
    ) -> Source {
        let table = &self.table;
        Source {
            messages: (0..table.message_count())
                .filter(|&m| table.slots(m).any(|slot| slots.contains(&slot)))
                .collect(),
            slots,
            sampling,
            used: None,
            monitor: SignalMonitor::new(signals),
            liveness: Liveness::Live,
            needs_all,
        }
    }

    /// The message that carries a slot's signal.
    pub(crate) fn message_of(&self, slot: usize) -> Option<usize> {
        let mut messages = 0..self.table.message_count();
        messages.find(|&m| self.table.slots(m).any(|own| own == slot))
    }

    /// Instant of each message's last frame, ns.
    pub(crate) fn stamps(&self) -> &[Option<u64>] {
        &self.stamps
    }

    /// The newest value of a signal.
    pub(crate) fn slot(&self, slot: usize) -> f64 {
        self.slots[slot]
    }

    /// Takes the frames of one cycle.
    pub(crate) fn decode(&mut self, rx: &Frames, now: Stamp, counts: &mut Counts) {
        self.fresh.fill(false);
        counts.add_many(Event::ReceiveOverflow, rx.overflow());
        for frame in rx {
            if frame.error {
                counts.add(Event::BusErrorFrame);
                continue;
            }
            let Some(message) = self.table.find(frame) else {
                counts.add(Event::FrameUnknownId);
                continue;
            };
            let stamp = self.stamps.get_mut(message);
            let last = stamp.as_ref().and_then(|stamp| **stamp);
            // Received before one of the same message that has been taken already.
            if last.is_some_and(|last| last <= now.0 && frame.stamp_ns < last) {
                counts.add(Event::FrameOutOfOrder);
                continue;
            }
            if self
                .table
                .decode_as(message, frame, &mut self.slots)
                .is_err()
            {
                counts.add(Event::FrameWrongLength);
                continue;
            }
            if let Some((stamp, fresh)) = stamp.zip(self.fresh.get_mut(message)) {
                *fresh = true;
                // A clock that was set back must not make later frames look old.
                *stamp = Some(frame.stamp_ns.min(now.0));
            }
        }
    }

    /// The source's sample of this cycle.
    pub(crate) fn reading(
        &self,
        source: &mut Source,
        at: Instants,
        counts: &mut Counts,
    ) -> Reading {
        let stamps = source
            .messages
            .iter()
            .map(|&m| self.stamps.get(m).copied().flatten());
        // The oldest message counts: the sample is complete only with all of them.
        let oldest = (stamps.clone()).try_fold(u64::MAX, |oldest, stamp| Some(oldest.min(stamp?)));
        let Some(oldest) = oldest else {
            return Reading {
                usable: false,
                age_s: f64::INFINITY,
                flags: measured_flags::NEVER | measured_flags::MISSED,
            };
        };
        let all_fresh = source
            .messages
            .iter()
            .all(|&m| self.fresh.get(m).copied().unwrap_or(false));
        let finite = source
            .slots
            .iter()
            .all(|&slot| self.slots.get(slot).is_some_and(|x| x.is_finite()));
        if all_fresh && !finite {
            counts.add(Event::SignalNotFinite);
        }
        let present = match source.sampling.sampled {
            // An answer to an earlier SYNC that came too late is a sample of that SYNC.
            Sampled::AtSync => all_fresh && oldest.saturating_add(STAMP_ERROR_NS) >= at.sync.0,
            // A source with a clock of its own: the last sample serves, at its age, until the next
            // one is overdue.
            Sampled::WhenSent { period } => {
                at.sync.0.abs_diff(oldest) as f64 * SECONDS_PER_NS <= OVERDUE * period
            }
        };
        if all_fresh && present && finite {
            let values = source.slots.iter().filter_map(|&slot| self.slots.get(slot));
            source.liveness = source.monitor.update(values.copied());
        }
        let live = source.liveness == Liveness::Live || !source.needs_all;
        let usable = present && finite && live;
        if usable {
            source.used = Some(oldest);
        }
        let flags = match source.liveness {
            Liveness::Live => 0,
            Liveness::Saturated => measured_flags::SATURATED,
            Liveness::Flat => measured_flags::FLAT,
        };
        self.aged(source, at, usable, flags)
    }

    /// Age from which on a sample is stale, s.
    pub(super) fn stale_after_s(&self) -> f64 {
        self.stale_after_s
    }

    /// The reading of a sample that cannot be right: the one that was used `before` still counts.
    pub(crate) fn reject(
        &self,
        source: &mut Source,
        before: Option<u64>,
        at: Instants,
        reading: &Reading,
    ) -> Reading {
        source.used = before;
        let flags = reading.flags | measured_flags::IMPLAUSIBLE;
        self.aged(source, at, false, flags)
    }

    fn aged(&self, source: &Source, at: Instants, usable: bool, mut flags: u32) -> Reading {
        let age_s = source.used.map_or(f64::INFINITY, |used| {
            at.now.0.saturating_sub(used) as f64 * SECONDS_PER_NS
        });
        if !usable {
            flags |= measured_flags::MISSED;
        }
        match source.used {
            None => flags |= measured_flags::NEVER,
            Some(_) if age_s > self.stale_after_s => flags |= measured_flags::STALE,
            Some(_) => {}
        }
        Reading {
            usable,
            age_s,
            flags,
        }
    }
}

/// Counts a sensor that is stale, flat or saturated, once each time; `before`: its flags.
pub(super) fn note_unsound(before: u32, reading: &Reading, subject: Subject, counts: &mut Counts) {
    for (flag, event) in [
        (measured_flags::STALE, Event::SensorStale),
        (measured_flags::FLAT, Event::SensorFlat),
        (measured_flags::SATURATED, Event::SensorSaturated),
    ] {
        if reading.flags & flag != 0 {
            counts.lasting(event, subject, before & flag == 0);
        }
    }
}
