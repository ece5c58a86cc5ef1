//! A commander whose lease a thread of its own keeps, for programs that compute for longer than
//! `loop.reference_timeout_ms` now and then.
//!
//! The thread sends while the program does not, for as long as the program is allowed to be busy; a program that
//! hangs loses the command as any other does.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use nix::libc;
use robot_state::{Mode, Reference};

use super::{Commander, Standing};
use crate::error::Error;

/// Interval of the references that renew the lease.
const BEAT: Duration = Duration::from_millis(4);
/// SCHED_FIFO priority of the thread where the process may have one: below every loop, whose priority is 80 unless
/// configured, and above every ordinary program.
const PRIORITY: i32 = 10;
/// Longest time for which a program may be busy.
pub const LONGEST_BUSY: Duration = Duration::from_secs(1);

/// What the robot does while the program computes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Meanwhile {
    /// It holds: the thread asks for mode hold, and the robot comes to rest within its limits.
    Hold,
    /// It goes on as the newest reference says: targets move on by their velocity and acceleration, torques and
    /// forces stay.
    Extrapolate,
}

/// A commander and the thread that keeps its lease. Dropping it gives the lease back.
#[derive(Debug)]
pub struct KeptCommander {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Debug)]
struct Shared {
    commander: Mutex<Sent>,
    ended: AtomicBool,
}

#[derive(Debug)]
struct Sent {
    commander: Commander,
    /// The program's last reference.
    at: Instant,
}

impl Commander {
    /// Hands the lease to a thread that keeps it while the program sends nothing for up to `busy` (at most
    /// [`LONGEST_BUSY`]); `meanwhile`: what the robot does then. The thread has real-time priority where the process
    /// may.
    ///
    /// # Errors
    /// [`Error::Thread`] if the thread cannot be started.
    pub fn keep(self, busy: Duration, meanwhile: Meanwhile) -> Result<KeptCommander, Error> {
        let sent = Sent {
            commander: self,
            at: Instant::now(),
        };
        let shared = Arc::new(Shared {
            commander: Mutex::new(sent),
            ended: AtomicBool::new(false),
        });
        let of_thread = Arc::clone(&shared);
        let busy = busy.min(LONGEST_BUSY);
        let thread = thread::Builder::new().name("lease".to_owned());
        let thread = thread.spawn(move || of_thread.keep(busy, meanwhile));
        let thread = thread.map_err(|e| Error::Thread {
            reason: e.to_string(),
        })?;
        Ok(KeptCommander {
            shared,
            thread: Some(thread),
        })
    }

    /// Renews the lease by the newest reference, changed for this once. Never asks for a lease that was lost.
    fn renew(&mut self, change: impl FnOnce(&mut Reference)) {
        let _ = self.judge();
        if self.standing != Standing::Commanding {
            return;
        }
        let kept = self.newest;
        change(&mut self.newest);
        if self.newest.mode != kept.mode {
            // The program's mode begins anew with its next reference.
            self.mode_from = None;
        }
        // A daemon that has gone is an error of the program's next call.
        let _ = self.publish();
        self.newest = Reference {
            sequence: self.newest.sequence,
            sent_ns: self.newest.sent_ns,
            ..kept
        };
    }
}

impl KeptCommander {
    /// As [`Commander::send`], without the duty to call it in time.
    ///
    /// # Errors
    /// As [`Commander::send`].
    pub fn send(&self, change: impl FnOnce(&mut Reference)) -> Result<(), Error> {
        self.with(|commander| commander.send(change))
    }

    /// Any other use of the commander. The thread waits meanwhile: what takes longer than a cycle or two must renew
    /// the lease itself, as [`Commander::hold_until_ready`], [`Commander::go_to`] and [`Commander::follow`] do.
    pub fn with<T>(&self, use_it: impl FnOnce(&mut Commander) -> T) -> T {
        let mut sent = self.shared.lock();
        let result = use_it(&mut sent.commander);
        sent.at = Instant::now();
        result
    }

    /// Gives the lease back: the robot holds, and another client may command at once.
    ///
    /// # Errors
    /// As [`Commander::close`].
    pub fn close(mut self) -> Result<(), Error> {
        self.end();
        self.shared.lock().commander.give_back()
    }

    fn end(&mut self) {
        self.shared.ended.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl Drop for KeptCommander {
    fn drop(&mut self) {
        self.end();
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Sent> {
        self.commander
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }

    fn keep(&self, busy: Duration, meanwhile: Meanwhile) {
        run_before_ordinary_programs();
        while !self.ended.load(Ordering::Relaxed) {
            thread::sleep(BEAT);
            let mut sent = self.lock();
            let silent = sent.at.elapsed();
            if silent >= BEAT && silent <= busy {
                sent.commander
                    .renew(|reference| go_on(reference, meanwhile, silent));
            }
        }
    }
}

/// The reference after a while without a newer one.
fn go_on(reference: &mut Reference, meanwhile: Meanwhile, after: Duration) {
    if meanwhile == Meanwhile::Hold {
        reference.mode = Mode::Hold.number();
        return;
    }
    // Of a mode position or Cartesian, velocities are limits or unused: its targets stay.
    let moves = [
        Mode::InverseDynamics,
        Mode::TorqueFeedbackMotion,
        Mode::LowGainTracking,
    ];
    if !moves.iter().any(|mode| mode.number() == reference.mode) {
        return;
    }
    let t = after.as_secs_f64();
    for joint in &mut reference.joints {
        joint.q_d += t * (joint.dq_d + 0.5 * t * joint.ddq_d);
        joint.dq_d += t * joint.ddq_d;
    }
}

/// Gives the calling thread real-time priority (`SCHED_FIFO`, 10: below every loop, above every ordinary program), so
/// that a busy machine does not keep it from renewing its lease. Without the right the thread stays as it is. For
/// threads that mostly wait.
pub fn run_before_ordinary_programs() {
    // SAFETY: an all-zero `sched_param` is a valid one, of which the call only reads.
    unsafe {
        let mut parameters: libc::sched_param = std::mem::zeroed();
        parameters.sched_priority = PRIORITY;
        libc::sched_setscheduler(0, libc::SCHED_FIFO, &raw const parameters);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_trajectory_goes_on_and_other_targets_stay() {
        let mut reference = Reference {
            mode: Mode::InverseDynamics.number(),
            ..Reference::default()
        };
        (
            reference.joints[0].q_d,
            reference.joints[0].dq_d,
            reference.joints[0].ddq_d,
        ) = (1.0, 2.0, 4.0);
        let before = reference;
        go_on(
            &mut reference,
            Meanwhile::Extrapolate,
            Duration::from_millis(100),
        );
        let joint = reference.joints[0];
        assert!(
            (joint.q_d - 1.22).abs() < 1e-12 && (joint.dq_d - 2.4).abs() < 1e-12,
            "{joint:?}"
        );
        let mut position = Reference {
            mode: Mode::Position.number(),
            ..before
        };
        go_on(
            &mut position,
            Meanwhile::Extrapolate,
            Duration::from_millis(100),
        );
        assert_eq!(position.joints[0], before.joints[0]);
        let mut held = before;
        go_on(&mut held, Meanwhile::Hold, Duration::from_millis(100));
        assert_eq!(held.mode, Mode::Hold.number());
    }
}
