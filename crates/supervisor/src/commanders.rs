//! Commanders: of all references that arrive, the one that each cycle follows.
//!
//! The [`Lease`] picks the session; of its references the newest counts, but for one rule: a
//! reference that asks for hold is seen by a cycle before a later one that asks for a mode. So a
//! client may ask for hold and then for its mode within one cycle.
//!
//! A reference may name a [trajectory](BufferedTrajectory) whose pieces were sent ahead. Then each
//! cycle gets the trajectory's desired values of its own instant, as if the client had just sent them,
//! for as long as references go on renewing the lease. A reference that names a trajectory of which no
//! piece was taken waits: the one before it stands, and becomes too old where it asks for motion.

use control::{BufferedTrajectory, TrajectoryLimits};
use robot_state::{CommanderRecord, Mode, Reference, TrajectoryPiece, piece_refusal};

use crate::lease::{Lease, Verdict};

/// References of all clients in, the one to be followed out.
#[derive(Debug)]
pub struct Commanders {
    lease: Lease,
    /// The reference to be followed, while `is_present`.
    present: Reference,
    is_present: bool,
    /// A cycle has seen it.
    is_seen: bool,
    /// A newer one that waits until a cycle has seen that hold was asked for, or for the first piece
    /// of its trajectory.
    waiting: Option<Reference>,
    trajectory: BufferedTrajectory,
    /// Session and number of the buffered trajectory; zeros without one.
    buffered: (u64, u64),
    /// Session and sequence of the newest piece.
    newest_piece: (u64, u64),
    /// Instant of the last cycle, ns.
    last_cycle_ns: u64,
    record: CommanderRecord,
}

impl Commanders {
    /// Begins without a commander; `reference_timeout`: longest time without a reference, s.
    #[must_use]
    pub fn new(reference_timeout: f64) -> Self {
        Self {
            lease: Lease::new((reference_timeout * 1e9) as u64),
            present: Reference::default(),
            is_present: false,
            is_seen: false,
            waiting: None,
            trajectory: BufferedTrajectory::new([]),
            buffered: (0, 0),
            newest_piece: (0, 0),
            last_cycle_ns: 0,
            record: CommanderRecord::default(),
        }
    }

    /// Commanders with trajectories of joints that have these limits; without limits every piece is
    /// refused.
    #[must_use]
    pub fn with_trajectories(self, limits: impl IntoIterator<Item = TrajectoryLimits>) -> Self {
        let trajectory = BufferedTrajectory::new(limits);
        Self { trajectory, ..self }
    }

    /// Takes a reference that has arrived, of whichever client, as it came.
    pub fn offer(&mut self, reference: &Reference, now_ns: u64) -> Verdict {
        let verdict = self.lease.offer(reference, now_ns);
        match verdict {
            Verdict::Granted => self.follow(reference),
            Verdict::TakenOver => {
                self.record.replaced = self.record.replaced.wrapping_add(1);
                self.follow(reference);
            }
            Verdict::Renewed if self.has_to_wait(reference) => self.waiting = Some(*reference),
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

    /// Takes a piece of a trajectory that has arrived, of whichever client, as it came: to be called
    /// after the references that had arrived before it were offered.
    ///
    /// # Errors
    /// One of [`piece_refusal`]; what was buffered before stands.
    pub fn offer_piece(&mut self, piece: &TrajectoryPiece) -> Result<(), u32> {
        let verdict = self.take_piece(piece);
        if let Err(reason) = verdict {
            self.record.pieces_refused = self.record.pieces_refused.wrapping_add(1);
            self.record.refused_piece = piece.sequence;
            self.record.piece_refusal = reason;
        }
        verdict
    }

    fn take_piece(&mut self, piece: &TrajectoryPiece) -> Result<(), u32> {
        let session = self.lease.holder().map_or(0, |holder| holder.session);
        if session == 0 || piece.session != session {
            return Err(piece_refusal::SESSION);
        }
        let (of, newest) = self.newest_piece;
        if of == session && piece.sequence <= newest {
            return Err(piece_refusal::NOT_ADVANCED);
        }
        self.newest_piece = (session, piece.sequence);
        let number = (session, piece.trajectory);
        if self.buffered == number {
            return self.trajectory.take(piece);
        }
        if self.follows_trajectory() && self.trajectory.is_moving() {
            return Err(piece_refusal::BUSY);
        }
        self.forget_trajectory();
        self.trajectory.take(piece)?;
        self.buffered = number;
        Ok(())
    }

    /// Begins a cycle: to be called after all that have arrived were offered.
    pub fn begin_cycle(&mut self, now_ns: u64) {
        let expired = self.lease.expire(now_ns);
        let is_over = self.is_seen && self.lease.holder().is_none();
        if expired || is_over {
            (self.is_present, self.waiting) = (false, None);
        }
        if self.is_seen
            && let Some(reference) = self.waiting.take_if(|waiting| {
                !names_trajectory(waiting) || self.buffered == (waiting.session, waiting.trajectory)
            })
        {
            self.follow(&reference);
        }
        self.is_seen = true;
        let elapsed = now_ns.saturating_sub(self.last_cycle_ns);
        self.last_cycle_ns = now_ns;
        if self
            .lease
            .holder()
            .is_none_or(|holder| holder.session != self.buffered.0)
        {
            self.forget_trajectory();
        }
        if self.is_present && names_trajectory(&self.present) {
            self.go_on(elapsed, now_ns);
        }
    }

    /// The present reference gets the desired values of this instant.
    fn go_on(&mut self, elapsed: u64, now_ns: u64) {
        let joints = self.present.joints.iter_mut();
        if self.buffered == (self.present.session, self.present.trajectory) {
            for (joint, now) in joints.zip(self.trajectory.advance(elapsed)) {
                (joint.q_d, joint.dq_d, joint.ddq_d) = (now.q, now.dq, now.ddq);
            }
        } else {
            // The next trajectory is buffered already: this one stays at rest where it has ended.
            joints.for_each(|joint| (joint.dq_d, joint.ddq_d) = (0.0, 0.0));
        }
        self.present.sent_ns = now_ns;
    }

    fn forget_trajectory(&mut self) {
        self.trajectory.clear();
        self.buffered = (0, 0);
    }

    fn follows_trajectory(&self) -> bool {
        self.is_present && names_trajectory(&self.present)
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
            trajectory: self.buffered.1,
            piece: self.newest_piece.1,
            trajectory_s: self.trajectory.time_s(),
            trajectory_left_s: self.trajectory.left_s(),
            trajectories_ended: self.trajectory.ended(),
            ..self.record
        }
    }

    fn follow(&mut self, reference: &Reference) {
        let number = (reference.session, reference.trajectory);
        let same = names_trajectory(reference) && self.buffered == number;
        // A trajectory that was left is not gone on with.
        if !same && self.trajectory.has_begun() {
            self.forget_trajectory();
        }
        self.present = *reference;
        (self.is_present, self.is_seen) = (true, false);
        self.waiting = None;
    }

    /// Whether the reference asks for a mode before a cycle has seen that hold was asked for, or names a trajectory of
    /// which no piece was taken.
    fn has_to_wait(&self, reference: &Reference) -> bool {
        let early = self.is_present && !self.is_seen && asks_hold(&self.present);
        let number = (reference.session, reference.trajectory);
        early && !asks_hold(reference) || names_trajectory(reference) && self.buffered != number
    }
}

fn asks_hold(reference: &Reference) -> bool {
    reference.mode == Mode::Hold.number()
}

/// Whether the reference wants the desired values of its trajectory followed.
fn names_trajectory(reference: &Reference) -> bool {
    let mode = Mode::from_number(reference.mode);
    reference.trajectory != 0 && mode.is_some_and(Mode::follows_trajectories)
}
