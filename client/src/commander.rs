//! Commanding a robot: a client's references.

pub(crate) mod keep;

use std::hash::{BuildHasher, Hasher, RandomState};
use std::thread::sleep;
use std::time::{Duration, Instant};

use nix::time::{ClockId, clock_gettime};
use robot_state::{
    CommanderStatus, FrameReference, Mode, Reference, TrajectoryPiece, frame_flags, lease_refusal,
    not_followed,
};

use crate::channel::{self, PieceMessage, Receiver, ReferenceMessage, Sender, StatusMessage};
use crate::client::{Client, newest};
use crate::error::Error;

/// Longest wait for the record that shows the measured pose.
const RECORD_TIMEOUT: Duration = Duration::from_secs(2);
/// Longest wait for the daemon's verdict on a new session, and longest silence of the daemon.
const SILENCE: Duration = Duration::from_secs(1);
/// Time in which a commander that has just vanished is noticed: as long, another one asks for its
/// lease again.
const HAND_OVER: Duration = Duration::from_millis(160);
/// Interval of references that ask for hold until there is a verdict; below every time-out.
const ASK_INTERVAL: Duration = Duration::from_millis(5);
/// Time for which a robot that has arrived at a target is led there.
pub(crate) const SETTLING: Duration = Duration::from_millis(300);
/// Interval between polls of shared memory.
const POLL: Duration = Duration::from_micros(250);

/// The right to command a robot. One client has it at a time, by lease: each reference renews it. It
/// ends when the commander is closed or dropped (the robot then holds its position), when its process
/// dies or is silent for `loop.reference_timeout_ms` (the same), or when a commander of higher
/// priority asks for it.
///
/// References that are not followed are an error of [`Commander::send`]: after a fault, an operator's
/// stop, a flaw in a reference, the loss of the lease or a restart of the daemon. In all these cases
/// a reference that asks for mode hold begins anew.
#[derive(Debug)]
pub struct Commander {
    robot: String,
    references: Sender<ReferenceMessage>,
    pieces: Sender<PieceMessage>,
    /// Pieces that its sessions have sent.
    piece_count: u64,
    statuses: Receiver<StatusMessage>,
    newest: Reference,
    status: CommanderStatus,
    /// The arrival of the newest status, or the begin of the session.
    heard: Instant,
    standing: Standing,
    /// Sequence of the first reference that asks for the present mode, if that is not hold.
    mode_from: Option<u64>,
}

/// Standing of a commander's session with the daemon.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Standing {
    /// It has asked for the lease.
    Asking,
    /// It has the lease.
    Commanding,
    /// It was refused, or has lost the lease.
    Over,
}

impl Commander {
    /// Takes the command of the client's robot, with priority 0. References begin with mode hold and
    /// `q_d` at the measured pose of the newest record, which is taken from the client. Waits until
    /// the daemon has given the lease, also to a robot that cannot move yet.
    ///
    /// # Errors
    /// [`Error::AlreadyCommanded`], [`Error::TooManyCommanders`], [`Error::OtherLayout`],
    /// [`Error::NoDaemon`], [`Error::NoRecord`], [`Error::Gone`], [`Error::Transport`].
    pub fn connect(client: &mut Client) -> Result<Self, Error> {
        Self::connect_with(client, 0)
    }

    /// [`Commander::connect`] with a priority: a commander of lower priority is replaced.
    ///
    /// # Errors
    /// As [`Commander::connect`].
    pub fn connect_with(client: &mut Client, priority: u32) -> Result<Self, Error> {
        let robot = client.robot().to_owned();
        let record = match client.latest()? {
            Some(record) => record,
            None => client.next_record(RECORD_TIMEOUT)?,
        };
        let service = channel::open::<StatusMessage>(&client.node, &robot, Duration::ZERO)?;
        let statuses = channel::receiver(&client.node, &service)?;
        let service = channel::open::<ReferenceMessage>(&client.node, &robot, Duration::ZERO)?;
        let references =
            channel::sender(&client.node, &service)?.ok_or_else(|| Error::TooManyCommanders {
                robot: robot.clone(),
            })?;
        let service = channel::open::<PieceMessage>(&client.node, &robot, Duration::ZERO)?;
        let pieces =
            channel::sender(&client.node, &service)?.ok_or_else(|| Error::TooManyCommanders {
                robot: robot.clone(),
            })?;
        let mut newest = Reference {
            joint_count: client.description().joint_count,
            mode: Mode::Hold.number(),
            priority,
            pid: std::process::id(),
            ..Reference::default()
        };
        let measured = record.cycle.measured.joints.iter();
        for (desired, joint) in newest.joints.iter_mut().zip(measured) {
            desired.q_d = joint.q;
        }
        let mut commander = Self {
            robot,
            references,
            pieces,
            piece_count: 0,
            statuses,
            newest,
            status: CommanderStatus::default(),
            heard: Instant::now(),
            standing: Standing::Over,
            mode_from: None,
        };
        commander.ask()?;
        Ok(commander)
    }

    /// The newest reference.
    #[must_use]
    pub fn reference(&self) -> &Reference {
        &self.newest
    }

    /// The daemon's report of this moment: who commands, the robot's state, and whether and why no
    /// mode is followed.
    ///
    /// # Errors
    /// [`Error::Transport`].
    pub fn status(&mut self) -> Result<&CommanderStatus, Error> {
        if let Some(message) = newest(&self.statuses)? {
            self.status = message.0;
            self.heard = Instant::now();
        }
        Ok(&self.status)
    }

    /// Changes the reference and sends it. To be called at least every
    /// `loop.reference_timeout_ms`: each reference renews the lease. Its session, count, time of
    /// sending, priority and process are set here. A reference that asks for mode hold after the
    /// lease was lost begins a new session.
    ///
    /// # Errors
    /// An error is about earlier references; this one was sent but for [`Error::AlreadyCommanded`] and
    /// [`Error::CommandLost`]. [`Error::NotFollowed`] if a mode is asked for that is not followed.
    /// [`Error::NoRecord`] if the daemon is silent, [`Error::Gone`] if it has ended.
    /// [`Error::Transport`].
    pub fn send(&mut self, change: impl FnOnce(&mut Reference)) -> Result<(), Error> {
        let own = self.newest;
        change(&mut self.newest);
        self.newest = Reference {
            session: own.session,
            session_began_ns: own.session_began_ns,
            sequence: own.sequence,
            priority: own.priority,
            pid: own.pid,
            gives_back: 0,
            ..self.newest
        };
        let asks_hold = self.newest.mode == Mode::Hold.number();
        let judged = self.judge();
        if self.standing == Standing::Over {
            if !asks_hold || matches!(judged, Err(Error::AlreadyCommanded { .. })) {
                return judged;
            }
            self.begin_session();
        }
        self.publish()?;
        if !asks_hold {
            self.mode_from.get_or_insert(self.newest.sequence);
            return judged;
        }
        self.mode_from = None;
        match judged {
            // Mended by this very reference.
            Err(Error::CommandLost { .. } | Error::NotFollowed { .. }) => Ok(()),
            judged => judged,
        }
    }

    /// Asks for mode hold until a mode would be followed, waiting at most `timeout`: for a robot that
    /// an operator is about to enable, or after an error of [`Commander::send`].
    ///
    /// # Errors
    /// [`Error::NotFollowed`] with the reason if it is not so in time; as [`Commander::connect`].
    pub fn hold_until_ready(&mut self, timeout: Duration) -> Result<(), Error> {
        let until = Instant::now() + timeout;
        self.newest.mode = Mode::Hold.number();
        self.mode_from = None;
        let hold = self.newest.sequence + 1;
        loop {
            self.ask()?;
            self.publish()?;
            sleep(ASK_INTERVAL);
            let status = *self.status()?;
            if self.status_shows(hold) && status.commander.not_followed == 0 {
                return Ok(());
            }
            if Instant::now() > until {
                let robot = self.robot.clone();
                let status = Box::new(status);
                return Err(Error::NotFollowed { robot, status });
            }
        }
    }

    /// Sends the robot to a pose, by mode position, and waits until it is there and stays there: the
    /// caller may go on with any mode. `change` sets the targets `q_d`, and `dq_d` where a joint is to
    /// be slower than configured. `going` is shown the time that the motion will still take and says
    /// whether it is to go on; if not, the robot is brought to rest. True if it has arrived.
    ///
    /// # Errors
    /// As [`Commander::send`].
    pub fn go_to(
        &mut self,
        change: impl FnOnce(&mut Reference),
        mut going: impl FnMut(Duration) -> bool,
    ) -> Result<bool, Error> {
        self.newest.trajectory = 0;
        for joint in &mut self.newest.joints {
            joint.dq_d = 0.0;
        }
        change(&mut self.newest);
        self.newest.mode = Mode::Position.number();
        let first = self.newest.sequence + 1;
        let mut arrived: Option<Instant> = None;
        loop {
            self.send(|_| {})?;
            sleep(ASK_INTERVAL);
            let status = *self.status()?;
            let follows = status.mode == Mode::Position.number();
            if !(follows && self.status_shows(first)) {
                continue;
            }
            let left = status.commander.motion_left_s;
            if left <= 0.0 && arrived.get_or_insert_with(Instant::now).elapsed() > SETTLING {
                return Ok(true);
            }
            if !going(Duration::try_from_secs_f64(left).unwrap_or_default()) {
                self.send(|reference| reference.mode = Mode::Hold.number())?;
                return Ok(false);
            }
        }
    }

    /// Prepares mode Cartesian with these frames, by their index: the robot holds until their poses are
    /// shown, and the reference asks for these poses and for the joints' angles, without stiffness or
    /// force, and damping ratio 1. The caller goes on by setting stiffness, force and mode. `client`: of the
    /// same robot; its records are taken.
    ///
    /// # Errors
    /// [`Error::NoFrame`]; as [`Commander::send`] and [`Client::next_record`].
    pub fn lead_frames(&mut self, client: &mut Client, frames: &[usize]) -> Result<(), Error> {
        let count = client.description().frame_count as usize;
        if let Some(&frame) = frames.iter().find(|&&frame| frame >= count) {
            let robot = self.robot.clone();
            return Err(Error::NoFrame {
                robot,
                frame,
                count,
            });
        }
        for (i, frame) in self.newest.frames.iter_mut().enumerate() {
            *frame = FrameReference {
                orientation: [1.0, 0.0, 0.0, 0.0],
                damping_ratio: 1.0,
                used: u32::from(frames.contains(&i)),
                ..FrameReference::default()
            };
        }
        let since = Instant::now();
        loop {
            self.send(|reference| reference.mode = Mode::Hold.number())?;
            sleep(ASK_INTERVAL);
            let Some(record) = client.latest()? else {
                continue;
            };
            let shown = &record.cycle.commanded.frames;
            if frames
                .iter()
                .all(|&i| shown[i].flags & frame_flags::VALID != 0)
            {
                let poses = self.newest.frames.iter_mut().zip(shown);
                for (frame, shown) in poses.filter(|(frame, _)| frame.used == 1) {
                    (frame.position, frame.orientation) = (shown.position, shown.orientation);
                }
                let joints = record.cycle.measured.joints.iter();
                for (desired, joint) in self.newest.joints.iter_mut().zip(joints) {
                    (desired.q_d, desired.dq_d, desired.ddq_d) = (joint.q, 0.0, 0.0);
                }
                (self.newest.gains_given, self.newest.trajectory) = (0, 0);
                return Ok(());
            }
            if since.elapsed() > SILENCE {
                return Err(self.silent());
            }
        }
    }

    /// Gives the lease back: the robot holds, and another client may command at once. Dropping the
    /// commander does the same, but cannot report an error.
    ///
    /// # Errors
    /// [`Error::Gone`], [`Error::Transport`].
    pub fn close(mut self) -> Result<(), Error> {
        self.give_back()
    }

    /// Has the lease, or asks for it until there is a verdict.
    fn ask(&mut self) -> Result<(), Error> {
        let since = Instant::now();
        let mut asked: Option<Instant> = None;
        loop {
            let judged = self.judge();
            let pause = match (self.standing, &judged) {
                (Standing::Commanding, _) => return judged,
                (Standing::Over, Err(Error::AlreadyCommanded { .. })) => HAND_OVER / 8,
                _ => ASK_INTERVAL,
            };
            if let (Standing::Over, Err(e), Some(_)) = (self.standing, &judged, asked) {
                let patience = match e {
                    Error::AlreadyCommanded { .. } => HAND_OVER,
                    _ => SILENCE,
                };
                if since.elapsed() > patience {
                    return judged;
                }
            } else if self.standing == Standing::Asking {
                judged?;
            }
            if asked.is_none_or(|at| at.elapsed() > pause) {
                if self.standing == Standing::Over {
                    self.begin_session();
                }
                self.publish()?;
                asked = Some(Instant::now());
            }
            sleep(POLL);
        }
    }

    fn begin_session(&mut self) {
        // Random, so different from that of any other session.
        self.newest.session = RandomState::new().build_hasher().finish().max(1);
        self.newest.session_began_ns = monotonic_ns();
        self.standing = Standing::Asking;
        self.heard = Instant::now();
        self.mode_from = None;
    }

    /// Meaning of the newest status for this session and its references.
    fn judge(&mut self) -> Result<(), Error> {
        let lease = self.status()?.commander;
        let own = self.newest.session;
        match self.standing {
            _ if lease.session == own && own != 0 => {
                self.standing = Standing::Commanding;
            }
            Standing::Asking if lease.refused_session == own => {
                self.standing = Standing::Over;
                // Not of this session: a reference of it, after it had lost the lease unseen.
                return Err(match lease.refused_reason {
                    lease_refusal::HELD => self.already_commanded(),
                    _ => self.lost(),
                });
            }
            Standing::Asking if self.age() > SILENCE => {
                return Err(match lease.session {
                    0 => self.silent(),
                    _ => self.already_commanded(),
                });
            }
            Standing::Asking => {}
            Standing::Commanding | Standing::Over => {
                self.standing = Standing::Over;
                return Err(self.lost());
            }
        }
        if self.heard.elapsed() > SILENCE {
            return Err(self.silent());
        }
        let counts = self.mode_from.is_some_and(|from| lease.sequence >= from);
        // Filters and sensors that are not ready are so for a moment only, or an event follows.
        let waits = match lease.not_followed {
            0 | not_followed::NOT_READY => true,
            not_followed::NOT_POSSIBLE => lease.cause == 0,
            _ => false,
        };
        if counts && self.standing == Standing::Commanding && !waits {
            return Err(Error::NotFollowed {
                robot: self.robot.clone(),
                status: Box::new(self.status),
            });
        }
        Ok(())
    }

    /// Age of the session.
    fn age(&self) -> Duration {
        Duration::from_nanos(monotonic_ns().saturating_sub(self.newest.session_began_ns))
    }

    /// Sends a piece of a trajectory as the session's next; gives its sequence.
    pub(crate) fn send_piece(&mut self, piece: &mut TrajectoryPiece) -> Result<u64, Error> {
        self.piece_count += 1;
        (piece.session, piece.sequence) = (self.newest.session, self.piece_count);
        self.pieces
            .send_copy(PieceMessage(*piece))
            .map_err(|e| Error::transport("trajectory", "publish on", &e))?;
        Ok(self.piece_count)
    }

    pub(crate) fn robot(&self) -> &str {
        &self.robot
    }

    fn status_shows(&self, sequence: u64) -> bool {
        let lease = &self.status.commander;
        lease.session == self.newest.session && lease.sequence >= sequence
    }

    fn already_commanded(&self) -> Error {
        let lease = &self.status.commander;
        Error::AlreadyCommanded {
            robot: self.robot.clone(),
            pid: lease.pid,
            session: lease.session,
            priority: lease.priority,
            held: Duration::from_nanos(monotonic_ns().saturating_sub(lease.since_ns)),
        }
    }

    fn lost(&self) -> Error {
        let lease = &self.status.commander;
        if lease.session != 0 && lease.priority >= self.newest.priority {
            return self.already_commanded();
        }
        Error::CommandLost {
            robot: self.robot.clone(),
            reason: "no reference came for longer than loop.reference_timeout_ms, or the daemon \
                     was started again",
        }
    }

    fn silent(&self) -> Error {
        Error::NoRecord {
            robot: self.robot.clone(),
            waited: self.heard.elapsed().max(SILENCE),
        }
    }

    fn give_back(&mut self) -> Result<(), Error> {
        if std::mem::replace(&mut self.standing, Standing::Over) == Standing::Over {
            return Ok(());
        }
        self.newest.mode = Mode::Hold.number();
        self.newest.gives_back = 1;
        self.publish()
    }

    fn publish(&mut self) -> Result<(), Error> {
        self.newest.sequence += 1;
        self.newest.sent_ns = monotonic_ns();
        let listeners = self
            .references
            .send_copy(ReferenceMessage(self.newest))
            .map_err(|e| Error::transport("reference", "publish on", &e))?;
        if listeners == 0 {
            return Err(Error::Gone {
                robot: self.robot.clone(),
            });
        }
        Ok(())
    }
}

fn monotonic_ns() -> u64 {
    // The clock exists on every Linux.
    clock_gettime(ClockId::CLOCK_MONOTONIC).map_or(0, |t| {
        t.tv_sec().unsigned_abs() * 1_000_000_000 + t.tv_nsec().unsigned_abs()
    })
}

impl Drop for Commander {
    fn drop(&mut self) {
        // If this does not arrive, the lease times out.
        let _ = self.give_back();
    }
}
