//! Motions that take their time: to a pose, and along a trajectory that is sent ahead.

use std::ffi::c_void;
use std::time::Duration;

use torqued_client::robot_state::{JointPoint, Mode};
use torqued_client::{Progress, Timing};

use crate::code::{Code, Failure, guard};
use crate::commander::Commander;
use crate::words::{deref, time};

/// Sends the robot to the pose `q_d` of the reference, by mode position, and waits until it is there and
/// stays there. `dq_d` of a joint is its greatest speed on the way, 0 for the configured one. `going`, if
/// not null, is shown the time that the motion will still take, and returns false to bring the robot to
/// rest. `arrived`, if not null: whether it has arrived.
///
/// # Safety
/// A handle; a function that returns; room for a flag, or null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn torqued_go_to(
    commander: *mut Commander,
    going: Option<unsafe extern "C" fn(context: *mut c_void, left_s: f64) -> bool>,
    context: *mut c_void,
    arrived: *mut bool,
) -> Code {
    guard(|| {
        // SAFETY: the caller's promise.
        let commander = unsafe { deref(commander, "commander") }?;
        let going = |left: Duration| match going {
            // SAFETY: the caller's function, with the caller's context.
            Some(going) => unsafe { going(context, left.as_secs_f64()) },
            None => true,
        };
        let moved =
            commander.lead(|own, wanted| own.go_to(|reference| *reference = *wanted, going))?;
        // SAFETY: the caller's promise.
        unsafe { report(moved, arrived) };
        Ok(())
    })
}

/// Follows a trajectory of `duration_s`, with points at most `spacing_s` apart (0.5 ms to 200 ms), from the
/// robot's present pose on, and waits until it has ended. `at` writes position, velocity and
/// acceleration of every joint at a time since the begin; it should begin at the present pose and end at
/// rest. `mode`: `TORQUED_MODE_INVERSE_DYNAMICS`, `..._TORQUE_FEEDBACK_MOTION` or `..._LOW_GAIN_TRACKING`.
///
/// A thread of its own renews the lease meanwhile, and half a second of the trajectory is buffered: `at` and
/// `going` may take a tenth of a second now and then. `going`, if not null, is shown the time on the
/// trajectory and how long the robot can go on with what was sent, and returns false to bring it to
/// rest. `arrived`, if not null: whether the end was reached. Both functions run in the caller's thread.
///
/// # Safety
/// A handle; functions that return; room for a flag, or null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn torqued_follow(
    commander: *mut Commander,
    mode: u32,
    duration_s: f64,
    spacing_s: f64,
    at: Option<
        unsafe extern "C" fn(context: *mut c_void, t: f64, joints: *mut JointPoint, count: usize),
    >,
    going: Option<unsafe extern "C" fn(context: *mut c_void, time_s: f64, buffered_s: f64) -> bool>,
    context: *mut c_void,
    arrived: *mut bool,
) -> Code {
    guard(|| {
        // SAFETY: the caller's promise.
        let commander = unsafe { deref(commander, "commander") }?;
        let mode = trajectory_mode(mode)?;
        let at = at.ok_or_else(|| Failure::argument("at is a null pointer"))?;
        let timing = Timing {
            duration: time(duration_s, "duration_s")?,
            spacing: time(spacing_s, "spacing_s")?,
        };
        let at = |t: f64, joints: &mut [JointPoint]| {
            // SAFETY: the caller's function, with the caller's context and room for `joints`.
            unsafe { at(context, t, joints.as_mut_ptr(), joints.len()) };
        };
        let going = |progress: Progress| match going {
            // SAFETY: the caller's function, with the caller's context.
            Some(going) => unsafe {
                let (time, buffered) = (progress.time, progress.buffered);
                going(context, time.as_secs_f64(), buffered.as_secs_f64())
            },
            None => true,
        };
        let followed = commander.lead(|own, wanted| {
            // Stiffness, damping and wrenches of the reference are those that hold on the way.
            own.send(|reference| {
                let (mode, trajectory) = (reference.mode, reference.trajectory);
                *reference = *wanted;
                (reference.mode, reference.trajectory) = (mode, trajectory);
            })?;
            own.follow_in(mode, timing, at, going)
        })?;
        // SAFETY: the caller's promise.
        unsafe { report(followed, arrived) };
        Ok(())
    })
}

fn trajectory_mode(number: u32) -> Result<Mode, Failure> {
    let mode = Mode::from_number(number).filter(|mode| mode.follows_trajectories());
    mode.ok_or_else(|| {
        let followed = Mode::ALL
            .into_iter()
            .filter(|mode| mode.follows_trajectories());
        let allowed = followed.map(Mode::name).collect::<Vec<_>>().join(", ");
        Failure::argument(format!(
            "mode {number} follows no trajectory; allowed: {allowed}"
        ))
    })
}

unsafe fn report(reached: bool, arrived: *mut bool) {
    // SAFETY: null, or room for a flag: the caller's promise.
    if let Some(arrived) = unsafe { arrived.as_mut() } {
        *arrived = reached;
    }
}
