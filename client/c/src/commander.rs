//! Commanding a robot.

use std::ptr;

use torqued_client::robot_state::{CommanderStatus, MAX_JOINTS, Mode, Reference};
use torqued_client::{Error, KeptCommander, LONGEST_BUSY};

use crate::client::Client;
use crate::code::{Code, Failure, guard};
use crate::words::{deref, time};

/// What the robot does while a program with a kept lease computes.
#[repr(u32)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Meanwhile {
    /// It holds: it comes to rest within its limits.
    Hold = 0,
    /// It goes on as the newest reference says: targets move on by their velocity and acceleration, torques
    /// and forces stay.
    Extrapolate = 1,
}

/// The right to command a robot, by lease: each reference renews it.
pub struct Commander {
    right: Right,
    /// What the caller changes.
    pub(crate) reference: Box<Reference>,
}

/// Who renews the lease.
enum Right {
    Caller(Box<torqued_client::Commander>),
    Thread(KeptCommander),
    /// Nobody: a thread for it could not be started.
    Lost,
}

impl Commander {
    /// Uses the commander and the reference that the caller has changed.
    pub(crate) fn with<T>(
        &mut self,
        use_it: impl FnOnce(&mut torqued_client::Commander, &mut Reference) -> Result<T, Error>,
    ) -> Result<T, Failure> {
        let Self { right, reference } = self;
        let use_it = |commander: &mut _| use_it(commander, reference);
        Ok(match right {
            Right::Caller(commander) => use_it(commander),
            Right::Thread(kept) => kept.with(use_it),
            Right::Lost => return Err(Failure::argument("the lease was lost in torqued_keep")),
        }?)
    }

    /// As [`with`](Self::with); what was sent last is where the caller goes on.
    pub(crate) fn lead<T>(
        &mut self,
        use_it: impl FnOnce(&mut torqued_client::Commander, &Reference) -> Result<T, Error>,
    ) -> Result<T, Failure> {
        self.with(|commander, reference| {
            let result = use_it(commander, reference);
            *reference = *commander.reference();
            result
        })
    }
}

/// Takes the command of the client's robot. References begin with mode hold and `q_d` at the measured pose.
/// Waits until the daemon has given the lease, also to a robot that cannot move yet. A commander of lower
/// `priority` is replaced. `commander` is to be closed by `torqued_give_back`.
///
/// # Safety
/// A handle; room for a handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn torqued_command(
    client: *mut Client,
    priority: u32,
    commander: *mut *mut Commander,
) -> Code {
    guard(|| {
        // SAFETY: the caller's promise.
        let (client, room) = unsafe { (deref(client, "client")?, deref(commander, "commander")?) };
        *room = ptr::null_mut();
        let commander = torqued_client::Commander::connect_with(&mut client.client, priority)?;
        let reference = Box::new(*commander.reference());
        *room = Box::into_raw(Box::new(Commander {
            right: Right::Caller(Box::new(commander)),
            reference,
        }));
        Ok(())
    })
}

/// Gives the lease back and closes the handle, also after an error: the robot holds, and another client may
/// command at once. Null is allowed.
///
/// # Safety
/// A handle that is not used again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn torqued_give_back(commander: *mut Commander) -> Code {
    if commander.is_null() {
        return Code::Ok;
    }
    // SAFETY: from `Box::into_raw`, and given back once.
    let commander = unsafe { Box::from_raw(commander) };
    guard(|| match commander.right {
        Right::Caller(commander) => Ok(commander.close()?),
        Right::Thread(kept) => Ok(kept.close()?),
        Right::Lost => Ok(()),
    })
}

/// The reference that `torqued_send` sends next, for the caller to change: it is the one sent last. Valid as
/// long as the commander; null if `commander` is. Its session, count, time of sending, priority and
/// process are set when it is sent.
///
/// # Safety
/// A handle, or null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn torqued_reference(commander: *mut Commander) -> *mut Reference {
    // SAFETY: the caller's promise.
    let commander = unsafe { commander.as_mut() };
    commander.map_or(ptr::null_mut(), |c| ptr::from_mut(&mut *c.reference))
}

/// Sends the reference. To be called at least every `loop.reference_timeout_ms`: each reference renews the
/// lease, and a program that hangs loses it. After it was lost, a reference that asks for mode hold
/// begins anew. An error is about earlier references; this one was sent but for
/// `TORQUED_CODE_ALREADY_COMMANDED` and `TORQUED_CODE_COMMAND_LOST`.
///
/// # Safety
/// A handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn torqued_send(commander: *mut Commander) -> Code {
    guard(|| {
        // SAFETY: the caller's promise.
        let commander = unsafe { deref(commander, "commander") }?;
        commander.lead(|own, wanted| own.send(|reference| *reference = *wanted))
    })
}

/// From now on a thread of the library keeps the lease while the program sends nothing for up to `busy_s`, at
/// most 1 s, and `meanwhile`, one of `TORQUED_MEANWHILE_...`, happens: for programs that compute for longer
/// than `loop.reference_timeout_ms` now and then. The thread has real-time priority where the process may. A
/// program that is silent for longer loses the lease as any other. Holds until `torqued_give_back`; after an
/// error of it the lease is lost, but for `TORQUED_CODE_ARGUMENT`.
///
/// # Safety
/// A handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn torqued_keep(
    commander: *mut Commander,
    busy_s: f64,
    meanwhile: u32,
) -> Code {
    guard(|| {
        // SAFETY: the caller's promise.
        let commander = unsafe { deref(commander, "commander") }?;
        let busy = time(busy_s, "busy_s")?;
        if busy > LONGEST_BUSY {
            let longest = LONGEST_BUSY.as_secs_f64();
            let words = format!("busy_s is {busy_s}; allowed: at most {longest} s");
            return Err(Failure::argument(words));
        }
        let meanwhile = match meanwhile {
            own if own == Meanwhile::Hold as u32 => torqued_client::Meanwhile::Hold,
            own if own == Meanwhile::Extrapolate as u32 => torqued_client::Meanwhile::Extrapolate,
            _ => {
                let words = format!("meanwhile is {meanwhile}; allowed: 0 hold, 1 extrapolate");
                return Err(Failure::argument(words));
            }
        };
        match std::mem::replace(&mut commander.right, Right::Lost) {
            Right::Caller(own) => {
                commander.right = Right::Thread((*own).keep(busy, meanwhile)?);
                Ok(())
            }
            kept => {
                commander.right = kept;
                Err(Failure::argument("a thread keeps the lease already"))
            }
        }
    })
}

/// Asks for mode hold until a mode would be followed, waiting at most `timeout_s`: for a robot that an
/// operator is about to enable, or after an error of `torqued_send`.
///
/// # Safety
/// A handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn torqued_hold_until_ready(
    commander: *mut Commander,
    timeout_s: f64,
) -> Code {
    guard(|| {
        // SAFETY: the caller's promise.
        let commander = unsafe { deref(commander, "commander") }?;
        let timeout = time(timeout_s, "timeout_s")?;
        commander.lead(|own, _| own.hold_until_ready(timeout))
    })
}

/// The daemon's report of this moment: who commands, the robot's state, and whether and why no mode is
/// followed.
///
/// # Safety
/// A handle; room for a report.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn torqued_status(
    commander: *mut Commander,
    status: *mut CommanderStatus,
) -> Code {
    guard(|| {
        // SAFETY: the caller's promise.
        let commander = unsafe { deref(commander, "commander") }?;
        // SAFETY: the caller's promise.
        let status = unsafe { deref(status, "status") }?;
        *status = commander.with(|own, _| own.status().copied())?;
        Ok(())
    })
}

/// Lets joints go, by mode passive: a hand can move them, the others hold. To be called as `torqued_send`.
///
/// # Safety
/// A handle; `count` indices of joints.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn torqued_let_go(
    commander: *mut Commander,
    joints: *const usize,
    count: usize,
) -> Code {
    guard(|| {
        // SAFETY: the caller's promise.
        let (commander, joints) = unsafe { (deref(commander, "commander")?, list(joints, count)?) };
        let wanted = &mut commander.reference;
        let let_go = joints.iter().filter(|&&joint| joint < MAX_JOINTS);
        wanted.held_joints = !let_go.fold(0, |bits, joint| bits | 1_u64 << joint);
        (wanted.mode, wanted.trajectory) = (Mode::Passive.number(), 0);
        for joint in &mut wanted.joints {
            (joint.dq_d, joint.ddq_d) = (0.0, 0.0);
        }
        commander.lead(|own, wanted| own.send(|reference| *reference = *wanted))
    })
}

/// Prepares mode Cartesian with these frames: the robot holds until their poses are shown, and the reference
/// asks for these poses, without stiffness or force. The caller goes on by setting stiffness, force and
/// mode. `client`: of the same robot; its records are taken.
///
/// # Safety
/// Two handles; `count` indices of frames.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn torqued_lead_frames(
    commander: *mut Commander,
    client: *mut Client,
    frames: *const usize,
    count: usize,
) -> Code {
    guard(|| {
        // SAFETY: the caller's promise.
        let (commander, frames) = unsafe { (deref(commander, "commander")?, list(frames, count)?) };
        // SAFETY: the caller's promise.
        let client = unsafe { deref(client, "client") }?;
        commander.lead(|own, _| own.lead_frames(&mut client.client, frames))
    })
}

unsafe fn list<'a>(indices: *const usize, count: usize) -> Result<&'a [usize], Failure> {
    match (indices.is_null(), count) {
        (_, 0) => Ok(&[]),
        (true, _) => Err(Failure::argument("the indices are a null pointer")),
        // SAFETY: the caller's promise.
        (false, _) => Ok(unsafe { std::slice::from_raw_parts(indices, count) }),
    }
}
