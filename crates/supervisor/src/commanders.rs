//! Commanders: of all references that arrive, the one that each cycle follows.
//!
//! The [`Lease`] picks the session; of its references the newest counts, but for one rule: a
//! reference that asks for hold is seen by a cycle before a later one that asks for a mode. So a
//! client may ask for hold and then for its mode within one cycle.

use robot_state::{CommanderRecord, Mode, Reference};

use crate::lease::{Bid, Lease, Verdict};

/// References of all clients in, the one to be followed out.
#[derive(Debug, Clone)]
pub struct Commanders {
    lease: Lease,
    /// The reference to be followed, while `is_present`.
    present: Reference,
    is_present: bool,
    /// A cycle has seen it.
    is_seen: bool,
    /// A newer one that waits until a cycle has seen that hold was asked for.
    waiting: Option<Reference>,
    record: CommanderRecord,
}

impl Commanders {
    /// No commander; `reference_timeout`: longest time without a reference, s.
    #[must_use]
    pub fn new(reference_timeout: f64) -> Self {
        Self {
            lease: Lease::new((reference_timeout * 1e9) as u64),
            present: Reference::default(),
            is_present: false,
            is_seen: false,
            waiting: None,
            record: CommanderRecord::default(),
        }
    }

    /// Takes a reference that has arrived, of whichever client, as it came.
    pub fn offer(&mut self, reference: &Reference, now_ns: u64) -> Verdict {
        let verdict = self.lease.offer(&Bid::from(reference), now_ns);
        match verdict {
            Verdict::Granted => self.follow(reference),
            Verdict::TakenOver => {
                self.record.replaced = self.record.replaced.wrapping_add(1);
                self.follow(reference);
            }
            Verdict::Renewed if self.hold_is_unseen() && !asks_hold(reference) => {
                self.waiting = Some(*reference);
            }
            Verdict::Renewed => self.follow(reference),
            Verdict::GivenBack => self.follow(&Reference {
                mode: Mode::Hold.number(),
                ..*reference
            }),
            Verdict::Refused(reason) => {
                self.record.refused = self.record.refused.wrapping_add(1);
                self.record.refused_session = reference.session;
                self.record.refused_reason = reason;
            }
        }
        verdict
    }

    /// Begins a cycle: to be called after all that have arrived were offered.
    pub fn begin_cycle(&mut self, now_ns: u64) {
        let expired = self.lease.expire(now_ns);
        let is_over = self.is_seen && self.lease.holder().is_none();
        if expired || is_over {
            (self.is_present, self.waiting) = (false, None);
        }
        if self.is_seen
            && let Some(reference) = self.waiting.take()
        {
            self.present = reference;
        }
        self.is_seen = true;
    }

    /// The reference that the cycle is to follow.
    #[must_use]
    pub fn reference(&self) -> Option<&Reference> {
        self.is_present.then_some(&self.present)
    }

    /// Age of [`Self::reference`], s; 0 without one.
    #[must_use]
    pub fn age_s(&self, now_ns: u64) -> f64 {
        let age_ns = |reference: &Reference| now_ns.saturating_sub(reference.sent_ns);
        self.reference().map_or(0, age_ns) as f64 * 1e-9
    }

    /// The lease as records show it; what the cycle adds is left zero.
    #[must_use]
    pub fn record(&self) -> CommanderRecord {
        let lease = self.lease.holder();
        CommanderRecord {
            session: lease.map_or(0, |holder| holder.session),
            since_ns: lease.map_or(0, |holder| holder.since_ns),
            priority: lease.map_or(0, |holder| holder.priority),
            pid: lease.map_or(0, |holder| holder.pid),
            ..self.record
        }
    }

    fn follow(&mut self, reference: &Reference) {
        self.present = *reference;
        (self.is_present, self.is_seen) = (true, false);
        self.waiting = None;
    }

    fn hold_is_unseen(&self) -> bool {
        self.is_present && !self.is_seen && asks_hold(&self.present)
    }
}

fn asks_hold(reference: &Reference) -> bool {
    reference.mode == Mode::Hold.number()
}
