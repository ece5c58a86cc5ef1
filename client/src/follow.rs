//! Following a trajectory that is sent ahead, so that a client which computes or waits for a while
//! makes no difference to the robot.
//!
//! A thread of its own renews the lease every few milliseconds and sends the pieces; the caller's
//! thread computes them. If the process dies, the loop notices the lost lease as always; if the
//! caller's thread hangs, the motion comes to rest at the end of what is buffered. And the opposite of
//! following: joints that are let go.

use std::hash::{BuildHasher, Hasher, RandomState};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::thread;
use std::time::{Duration, Instant};

use robot_state::{JointPoint, MAX_JOINTS, MAX_POINTS, Mode, TrajectoryPiece};

use crate::commander::{Commander, SETTLING};
use crate::error::Error;

/// Interval of the references that renew the lease.
const BEAT: Duration = Duration::from_millis(4);
/// Greatest length of a piece.
const PIECE_NS: u64 = 200_000_000;
/// So far ahead is sent; less where points are dense, for want of room.
const AHEAD_NS: u64 = 600_000_000;
const AHEAD_POINTS: u64 = 90;
/// Interval at which the caller is shown the progress.
const SHOWN: Duration = Duration::from_millis(10);

/// Duration and spacing of a trajectory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Timing {
    /// From the first point to the last.
    pub duration: Duration,
    /// Greatest time between two points: 0.5 ms to 200 ms.
    pub spacing: Duration,
}

/// Place on a trajectory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// Time since its begin.
    pub time: Duration,
    /// Time for which the robot can go on with what has been sent.
    pub buffered: Duration,
}

/// Words between the two threads.
#[derive(Debug, Default)]
struct Shared {
    time_ns: AtomicU64,
    /// The caller has sent everything.
    complete: AtomicBool,
    stop: AtomicBool,
}

impl Commander {
    /// Follows a trajectory by mode inverse dynamics, from the robot's present pose on, and waits until
    /// it has ended: the caller may go on with any mode. `at` computes position, velocity and acceleration of every
    /// joint, in config order, at a time since the begin in s; the loop interpolates between its
    /// points. It should begin at the present pose and end at rest. `going` is shown the progress and
    /// says whether it is to go on; if not, the robot is brought to rest. True if the end was reached.
    ///
    /// Stiffness, damping and contact wrenches of the reference hold. While this runs, a thread of its
    /// own renews the lease, and half a second of the trajectory is buffered: `at` and `going` may take
    /// a tenth of a second now and then.
    ///
    /// # Errors
    /// As [`Commander::send`]; [`Error::PieceRefused`] if points are beyond limits;
    /// [`Error::TrajectoryEnded`] if the last point is in motion, or `at` took too long;
    /// [`Error::Thread`]. The robot is at rest, or brought there, in each of these cases.
    pub fn follow(
        &mut self,
        timing: Timing,
        at: impl FnMut(f64, &mut [JointPoint]),
        going: impl FnMut(Progress) -> bool,
    ) -> Result<bool, Error> {
        self.follow_in(Mode::InverseDynamics, timing, at, going)
    }

    /// The same by another mode that follows trajectories: torque-feedback motion or low-gain tracking.
    ///
    /// # Errors
    /// As [`Commander::follow`].
    pub fn follow_in(
        &mut self,
        mode: Mode,
        timing: Timing,
        mut at: impl FnMut(f64, &mut [JointPoint]),
        mut going: impl FnMut(Progress) -> bool,
    ) -> Result<bool, Error> {
        let grid = Grid::new(timing);
        let joint_count = self.reference().joint_count;
        let trajectory = RandomState::new().build_hasher().finish().max(1);
        let shared = Shared::default();
        let (pieces, sent) = mpsc::channel();
        thread::scope(|threads| {
            let (of, words) = (&grid, &shared);
            let beat = move || self.keep_sending((mode, trajectory), of, &sent, words);
            let beating = thread::Builder::new()
                .name("heartbeat".to_owned())
                .spawn_scoped(threads, beat)
                .map_err(|e| Error::Thread {
                    reason: e.to_string(),
                })?;
            let mut next = 0;
            while !beating.is_finished() {
                let time = shared.time_ns.load(Ordering::Relaxed);
                while next < grid.last && grid.at(next).saturating_sub(time) < grid.ahead {
                    let mut piece = Box::<TrajectoryPiece>::default();
                    let end = (next + grid.piece).min(grid.last);
                    (piece.trajectory, piece.joint_count) = (trajectory, joint_count);
                    (piece.begins_ns, piece.spacing_ns) = (grid.at(next), grid.spacing);
                    piece.point_count = (end - next + 1) as u32;
                    for (k, point) in (next..=end).zip(&mut piece.points) {
                        let joints = point.joints.get_mut(..joint_count as usize);
                        at(grid.at(k) as f64 * 1e-9, joints.unwrap_or_default());
                    }
                    next = end;
                    // Without a receiver that thread has ended.
                    let _ = pieces.send(piece);
                }
                shared.complete.store(next == grid.last, Ordering::Relaxed);
                let time = shared.time_ns.load(Ordering::Relaxed);
                let progress = Progress {
                    time: Duration::from_nanos(time),
                    buffered: Duration::from_nanos(grid.at(next).saturating_sub(time)),
                };
                if !going(progress) {
                    shared.stop.store(true, Ordering::Relaxed);
                    break;
                }
                thread::sleep(SHOWN);
            }
            beating.join().unwrap_or_else(|_| {
                Err(Error::Thread {
                    reason: "the thread that renews the lease has panicked".to_owned(),
                })
            })
        })
    }

    /// Lets joints go, by mode passive: a hand can move them, the others hold where they stood when they
    /// were let go first. Where joints are held anew, they are held where the client's reference has
    /// them. To be called as [`Commander::send`].
    ///
    /// # Errors
    /// As [`Commander::send`].
    pub fn let_go(&mut self, joints: &[usize]) -> Result<(), Error> {
        let let_go = joints.iter().filter(|&&joint| joint < MAX_JOINTS);
        let bits = let_go.fold(0, |bits, joint| bits | 1_u64 << joint);
        self.send(|reference| {
            (reference.mode, reference.trajectory) = (Mode::Passive.number(), 0);
            reference.held_joints = !bits;
            for joint in &mut reference.joints {
                (joint.dq_d, joint.ddq_d) = (0.0, 0.0);
            }
        })
    }

    /// Lets the robot stand on its feet, by mode stand, in the pose of the client's reference: its centre of mass so far
    /// from the middle of the soles, to the front and to the left, m. To be called as [`Commander::send`].
    ///
    /// # Errors
    /// As [`Commander::send`].
    pub fn stand(&mut self, center_of_mass_offset: [f64; 2]) -> Result<(), Error> {
        self.send(|reference| {
            (reference.mode, reference.trajectory) = (Mode::Stand.number(), 0);
            reference.center_of_mass_offset = center_of_mass_offset;
            reference.lifted_feet = 0;
            for joint in &mut reference.joints {
                (joint.dq_d, joint.ddq_d) = (0.0, 0.0);
            }
        })
    }

    /// Sends pieces as they come, and references in between, until the end of the trajectory.
    fn keep_sending(
        &mut self,
        (mode, trajectory): (Mode, u64),
        grid: &Grid,
        pieces: &Receiver<Box<TrajectoryPiece>>,
        shared: &Shared,
    ) -> Result<bool, Error> {
        let before = self.status()?.commander;
        let (mut first, mut arrived) = (None, None::<Instant>);
        let mut last = [JointPoint::default(); MAX_JOINTS];
        loop {
            match pieces.recv_timeout(BEAT) {
                Ok(mut piece) => {
                    let sequence = self.send_piece(&mut piece)?;
                    first.get_or_insert(sequence);
                    if let Some(point) = piece.points.get(piece.point_count as usize - 1) {
                        last = point.joints;
                    }
                }
                Err(RecvTimeoutError::Timeout) => {}
                // The caller has gone.
                Err(RecvTimeoutError::Disconnected) => thread::sleep(BEAT),
            }
            if shared.stop.load(Ordering::Relaxed) {
                return self.hold().map(|()| false);
            }
            self.send(|reference| {
                if first.is_some() {
                    reference.mode = mode.number();
                    reference.trajectory = trajectory;
                }
            })?;
            let status = *self.status()?;
            let (lease, own) = (status.commander, self.reference().session);
            let ours = |sequence: u64| first.is_some_and(|first| sequence >= first);
            if lease.session != own {
                continue;
            }
            if lease.pieces_refused != before.pieces_refused && ours(lease.refused_piece) {
                self.hold()?;
                return Err(Error::PieceRefused {
                    robot: self.robot().to_owned(),
                    reason: lease.piece_refusal,
                });
            }
            if lease.trajectory != trajectory {
                continue;
            }
            if lease.trajectories_ended != before.trajectories_ended {
                return Err(Error::TrajectoryEnded {
                    robot: self.robot().to_owned(),
                });
            }
            let time = (1e9 * lease.trajectory_s) as u64;
            shared.time_ns.store(time, Ordering::Relaxed);
            let is_there = time >= grid.at(grid.last) && shared.complete.load(Ordering::Relaxed);
            if is_there && arrived.get_or_insert_with(Instant::now).elapsed() > SETTLING {
                // The caller may go on from here, by references of its own.
                self.send(|reference| {
                    reference.trajectory = 0;
                    for (joint, last) in reference.joints.iter_mut().zip(&last) {
                        (joint.q_d, joint.dq_d, joint.ddq_d) = (last.q_d, 0.0, 0.0);
                    }
                })?;
                return Ok(true);
            }
        }
    }

    fn hold(&mut self) -> Result<(), Error> {
        self.send(|reference| {
            reference.mode = Mode::Hold.number();
            reference.trajectory = 0;
        })
    }
}

/// The points of a trajectory in time.
#[derive(Debug, Clone, Copy)]
struct Grid {
    spacing: u64,
    /// Index of the last point.
    last: u64,
    /// Intervals of a piece.
    piece: u64,
    ahead: u64,
}

impl Grid {
    fn new(timing: Timing) -> Self {
        let duration = timing.duration.as_nanos().min(u128::from(u64::MAX / 4)) as u64;
        let most = timing.spacing.as_nanos().clamp(1, 1_000_000_000) as u64;
        let last = duration.div_ceil(most).max(1);
        let spacing = (duration / last).max(1);
        Self {
            spacing,
            last,
            piece: (PIECE_NS / spacing).clamp(1, MAX_POINTS as u64 - 1),
            ahead: AHEAD_NS.min(AHEAD_POINTS * spacing),
        }
    }

    fn at(&self, point: u64) -> u64 {
        point * self.spacing
    }
}
