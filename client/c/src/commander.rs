//! Commanding a robot.

use std::ptr;

use torqued_client::robot_state::{CommanderStatus, MAX_JOINTS, Mode, Reference};

use crate::client::Client;
use crate::code::{Code, Failure, guard};
use crate::words::{deref, time};

/// The right to command a robot, by lease: each reference renews it.
pub struct Commander {
    pub(crate) commander: torqued_client::Commander,
    /// What the caller changes.
    pub(crate) reference: Box<Reference>,
}

impl Commander {
    /// What the commander has sent last is where the caller goes on.
    pub(crate) fn refresh(&mut self) {
        *self.reference = *self.commander.reference();
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
            commander,
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
    guard(|| Ok(commander.commander.close()?))
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
        let wanted = &commander.reference;
        let sent = commander.commander.send(|reference| *reference = **wanted);
        commander.refresh();
        Ok(sent?)
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
        let held = (commander.commander).hold_until_ready(time(timeout_s, "timeout_s")?);
        commander.refresh();
        Ok(held?)
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
        *unsafe { deref(status, "status") }? = *commander.commander.status()?;
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
        let wanted = &commander.reference;
        let sent = commander.commander.send(|reference| *reference = **wanted);
        commander.refresh();
        Ok(sent?)
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
        let led = (commander.commander).lead_frames(&mut client.client, frames);
        commander.refresh();
        Ok(led?)
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
