//! The lease of the command: one session commands at a time, decided from arguments alone.
//!
//! ```text
//!           asks for hold                       another asks for hold, of higher priority
//!   free ───────────────────► held by a session ────────────────────────────────────────┐
//!    ▲                          │            ▲                                           │
//!    └──────────────────────────┘            └───────────────────────────────────────────┘
//!      gives it back, or has sent nothing for longer than the time-out
//! ```
//!
//! A session is one tenure: a session that has lost the lease, in whatever way, never gets it again,
//! and neither does any that began before it. A client that wants to command again begins a new
//! session. Sessions that merely wait for the lease do not exist: a refused one has to ask again.

use robot_state::{Mode, Reference, lease_refusal};

/// The session that has the lease.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Holder {
    /// Session.
    pub session: u64,
    /// Instant at which it began, ns.
    pub began_ns: u64,
    /// Process of the commander.
    pub pid: u32,
    /// Priority.
    pub priority: u32,
    /// Instant at which it got the lease, ns.
    pub since_ns: u64,
    sequence: u64,
    /// Instant of sending of its newest reference, ns.
    sent_ns: u64,
}

/// The verdict on a reference. All but `Refused` have it followed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// The lease was free; the session has it now.
    Granted,
    /// The session has taken the lease over by its priority.
    TakenOver,
    /// The next reference of the session that has the lease.
    Renewed,
    /// The last reference of the session that had the lease, which is free now.
    GivenBack,
    /// Not to be followed, for one of [`lease_refusal`].
    Refused(u32),
}

/// The lease of one robot's command.
#[derive(Debug, Clone)]
pub struct Lease {
    timeout_ns: u64,
    holder: Option<Holder>,
    /// When the youngest session that has had the lease began, ns.
    youngest_began_ns: Option<u64>,
}

impl Lease {
    /// A free lease; `timeout_ns`: longest time without a reference, ns.
    #[must_use]
    pub fn new(timeout_ns: u64) -> Self {
        Self {
            timeout_ns,
            holder: None,
            youngest_began_ns: None,
        }
    }

    /// The session that has the lease.
    #[must_use]
    pub fn holder(&self) -> Option<&Holder> {
        self.holder.as_ref()
    }

    /// Frees the lease if its holder has sent nothing for longer than the time-out; `true` then. To
    /// be called in each cycle after the references that have arrived were offered, so that a late
    /// cycle costs nobody the lease.
    pub fn expire(&mut self, now_ns: u64) -> bool {
        let silent = |holder: &Holder| now_ns.saturating_sub(holder.sent_ns) > self.timeout_ns;
        let expired = self.holder.as_ref().is_some_and(silent);
        if expired {
            self.holder = None;
        }
        expired
    }

    /// Decides on a reference that arrived at `now_ns`.
    pub fn offer(&mut self, reference: &Reference, now_ns: u64) -> Verdict {
        // A clock that is ahead does not make a reference younger than its arrival.
        let sent_ns = reference.sent_ns.min(now_ns);
        let session = (reference.session, reference.session_began_ns);
        if reference.session == 0 || reference.session_began_ns > sent_ns {
            return Verdict::Refused(lease_refusal::INVALID);
        }
        if now_ns - sent_ns > self.timeout_ns {
            return Verdict::Refused(lease_refusal::TOO_OLD);
        }
        match self.holder {
            Some(holder) if (holder.session, holder.began_ns) == session => {
                self.renew(&holder, reference, sent_ns)
            }
            holder => self.claim(holder.as_ref(), reference, [now_ns, sent_ns]),
        }
    }

    fn renew(&mut self, holder: &Holder, reference: &Reference, sent_ns: u64) -> Verdict {
        if reference.sequence <= holder.sequence || sent_ns < holder.sent_ns {
            return Verdict::Refused(lease_refusal::NOT_ADVANCED);
        }
        if reference.gives_back != 0 {
            self.holder = None;
            return Verdict::GivenBack;
        }
        self.holder = Some(Holder {
            sequence: reference.sequence,
            sent_ns,
            ..*holder
        });
        Verdict::Renewed
    }

    fn claim(
        &mut self,
        holder: Option<&Holder>,
        reference: &Reference,
        [now_ns, sent_ns]: [u64; 2],
    ) -> Verdict {
        let began_ns = reference.session_began_ns;
        if holder.is_some_and(|holder| reference.priority <= holder.priority) {
            return Verdict::Refused(lease_refusal::HELD);
        }
        if self.youngest_began_ns.is_some_and(|ns| began_ns <= ns) {
            return Verdict::Refused(lease_refusal::OLD_SESSION);
        }
        if reference.mode != Mode::Hold.number() || reference.gives_back != 0 {
            return Verdict::Refused(lease_refusal::HOLD_FIRST);
        }
        self.youngest_began_ns = Some(began_ns);
        self.holder = Some(Holder {
            session: reference.session,
            began_ns,
            pid: reference.pid,
            priority: reference.priority,
            since_ns: now_ns,
            sequence: reference.sequence,
            sent_ns,
        });
        match holder {
            Some(_) => Verdict::TakenOver,
            None => Verdict::Granted,
        }
    }
}
