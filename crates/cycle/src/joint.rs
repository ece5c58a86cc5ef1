//! Joint: the controllers of all joints, from tasks to commands.
//!
//! ```text
//!                 ┌───────────────┐  task: follow
//!   engaged ────► │ hold position │ ───────────────────────► ┌────────┐ ──┐
//!   (position-    │   or          │                          │ follow │   │ another mode
//!   commanded or  │ carry         │ ◄─────────────────────── └────────┘ ◄─┘
//!   current-      │   torque law  │  task: hold or stop
//!   commanded     └───────────────┘
//!   drive)
//! ```
//!
//! A joint knows its [task](crate::mode::Task) and no mode. One that is not engaged has no state and no command. A hold
//! depends on no single sensor: a position-commanded drive keeps its last command, brought to rest where the joint was
//! moving; a current-commanded one [carries](carry) its joint.
//!
//! A state owns its transition, and is made anew at each change of mode: nothing of an earlier visit survives.

mod carry;
mod constants;
mod controller;
mod enter;
mod followed;
mod hold_guard;
mod law;
mod level_correction;
mod rest;
mod resynchronisation;
mod sample_gap;
mod transition;

use problem::Problem;
use robot_config::{Robot, TorqueFeedback, TorqueLaw};
use robot_state::{
    CommandedRecord, EstimatedRecord, Event, JointMeasured, MeasuredRecord, TorqueEstimate,
    command_flags, torque_flags,
};
use supervisor::Deviation;

use crate::estimate::{FastTorque, GravityLoad};
use crate::events::{Counts, Subject};
use crate::judge::Soundness;
use crate::mode::{Feedback, Task};
use controller::Controller;
use level_correction::LevelCorrections;

/// Whether a joint's encoders can be relied on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Trust {
    Sound,
    /// The joint's encoders contradict each other.
    Distrusted,
}

/// Periods before a cycle in which the loop did not run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Gap {
    None,
    /// A gap so short that everything goes on.
    Bridged(u32),
    /// A gap in which the drive has braked the joint, and a mode goes on.
    Braked(u32),
    /// A gap so long that nothing goes on.
    Overslept(u32),
}

impl Gap {
    /// Periods in which the loop did not run.
    fn periods(self) -> u32 {
        match self {
            Self::None => 0,
            Self::Bridged(periods) | Self::Braked(periods) | Self::Overslept(periods) => periods,
        }
    }
}

/// All that a joint's command depends on in one cycle besides its task.
#[derive(Debug, Clone, Copy)]
struct JointInput<'a> {
    measured: &'a JointMeasured,
    trust: Trust,
    /// Motor-side and link-side angle as they were read, rad, link side, whether they are trusted or not.
    shown: [f64; 2],
    gap: Gap,
    /// Torque that carries the joint's weight, by no sensor of the last 0.1 s but encoders, N·m.
    weight: f64,
    /// Torque that the command may ask for at present, N·m.
    torque_limit: f64,
    tau_encoder: &'a TorqueEstimate,
    /// The torque that is fed back.
    tau_hat: &'a TorqueEstimate,
    /// The torque without delay that the predictive law feeds back, N·m.
    fast: Option<f64>,
    /// Sample period, s.
    dt: f64,
}

impl JointInput<'_> {
    /// The torque that is fed back, where it is valid, N·m.
    fn torque(&self) -> Option<f64> {
        let valid = self.tau_hat.flags & torque_flags::VALID != 0;
        valid.then_some(self.tau_hat.tau)
    }
}

/// What commands depend on besides tasks.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Inputs<'a> {
    pub(crate) measured: &'a MeasuredRecord,
    pub(crate) estimated: &'a EstimatedRecord,
    /// Torques without delay, one for each joint.
    pub(crate) fast: &'a [FastTorque],
    pub(crate) gravity: &'a GravityLoad,
    pub(crate) soundness: &'a Soundness,
}

/// The controllers of all joints.
#[derive(Debug)]
pub(crate) struct Joints {
    controllers: Vec<Controller>,
    level_corrections: LevelCorrections,
    torque_law: TorqueLaw,
    observed: Vec<Option<f64>>,
    sample_period: f64,
}

impl Joints {
    /// # Errors
    /// A filter that cannot be used.
    pub(crate) fn new(robot: &Robot) -> Result<Self, Problem> {
        let parameters = &robot.parameters;
        let joints = 0..parameters.joints.len();
        Ok(Self {
            observed: vec![None; parameters.joints.len()],
            controllers: joints
                .map(|j| Controller::new(j, parameters))
                .collect::<Result<_, _>>()?,
            level_corrections: LevelCorrections::new(parameters),
            torque_law: parameters.torque_law,
            sample_period: parameters.timing.sample_period,
        })
    }

    /// The last command of each joint, rad or A; none where none is sent.
    pub(crate) fn last(&self) -> impl Iterator<Item = Option<f64>> {
        self.controllers.iter().map(Controller::last)
    }

    /// Velocity of each link by its law's observer, as of the last cycle, rad/s; none where there is no observer.
    pub(crate) fn observed(&mut self) -> &[Option<f64>] {
        for (own, controller) in self.observed.iter_mut().zip(&self.controllers) {
            *own = controller.observed_velocity();
        }
        &self.observed
    }

    /// Withdraws the commands of joints that were formed in this cycle and did not leave: their joints begin
    /// where they stand when commands leave again, not where they were held.
    pub(crate) fn withdraw(
        &mut self,
        is_driven: impl Fn(usize) -> bool,
        commanded: &mut CommandedRecord,
    ) {
        let joints = self.controllers.iter_mut().zip(&mut commanded.joints);
        for (j, (joint, commanded)) in joints.enumerate() {
            if joint.last().is_some() && !is_driven(j) {
                joint.forget();
                commanded.flags &= !command_flags::ENGAGED;
            }
        }
    }

    /// The command of every engaged joint within all limits, with its contributions. Of one that is
    /// not finite the last one stands.
    pub(crate) fn update(
        &mut self,
        tasks: &[Task],
        is_engaged: impl Fn(usize) -> bool,
        inputs: &Inputs<'_>,
        commanded: &mut CommandedRecord,
        counts: &mut Counts,
    ) {
        let joints = tasks.iter().zip(&mut commanded.joints);
        for (j, (task, commanded)) in joints.enumerate() {
            let Some(measured) = inputs.measured.joints.get(j).filter(|_| is_engaged(j)) else {
                let q = inputs.measured.joints.get(j).map_or(0.0, |joint| joint.q);
                if let Some(joint) = self.controllers.get_mut(j) {
                    joint.release(q, commanded);
                }
                continue;
            };
            let fast = self.fast_torque(j, task.feedback, inputs);
            let Some(joint) = self.controllers.get_mut(j) else {
                continue;
            };
            let torques = &inputs.estimated.joints[j];
            let weight = inputs.gravity.torque(j);
            let input = JointInput {
                measured,
                trust: inputs.soundness.trust(j),
                shown: inputs.soundness.shown(j),
                gap: inputs.soundness.gap(),
                weight,
                torque_limit: joint.torque_limit(inputs.soundness.torque_share(j), weight),
                tau_encoder: &torques.tau_encoder,
                tau_hat: match self.torque_law {
                    _ if joint.is_motor_side_only() => &torques.tau_whole_body,
                    TorqueLaw::ProportionalIntegral(TorqueFeedback::WholeBody) => {
                        &torques.tau_whole_body
                    }
                    TorqueLaw::ProportionalIntegral(TorqueFeedback::Encoder) => {
                        &torques.tau_encoder
                    }
                    TorqueLaw::Predictive(_) => &torques.tau_hat,
                },
                fast,
                dt: self.sample_period,
            };
            if let Some((deviation, begins)) = joint.update(&task.goal, &input, commanded) {
                counts.lasting(event(deviation), Subject::Joint(j), begins);
            }
            if joint.begins_to_mismatch_model(&task.goal) {
                counts.add_of(Event::DriveUnlike, Subject::Joint(j));
            }
            if joint.begins_to_integrate() {
                counts.add_of(Event::DriveIntegrates, Subject::Joint(j));
            }
            if joint.begins_to_swing() {
                counts.add_of(Event::HoldSwings, Subject::Joint(j));
            }
            count_limits(j, commanded.flags, counts);
        }
    }

    /// The torque without delay that a joint's predictive law feeds back, N·m.
    fn fast_torque(&mut self, j: usize, feedback: Feedback, inputs: &Inputs<'_>) -> Option<f64> {
        let (fast, estimated) = (inputs.fast.get(j)?, inputs.estimated.joints.get(j)?);
        match feedback {
            Feedback::Torsion { offset } => fast.torsion.map(|torsion| torsion + offset),
            Feedback::Estimated { pressing } => {
                let torque = fast.fed_back(self.torque_law, estimated);
                (self.level_corrections).update(j, pressing, torque, &fast.by_sensors)
            }
        }
    }
}

fn event(deviation: Deviation) -> Event {
    match deviation {
        Deviation::Following => Event::FollowingError,
        Deviation::Overspeed => Event::Overspeed,
        Deviation::Doubtful => Event::FollowingDoubtful,
    }
}

/// Counts the limits of one joint that acted, but for a torque rate that trimmed noise.
fn count_limits(joint: usize, flags: u32, counts: &mut Counts) {
    use command_flags as f;
    let flags = if flags & f::RATE_TRIMMED != 0 {
        flags & !f::TORQUE_RATE_LIMITED
    } else {
        flags
    };
    let events = [
        (f::POSITION_LIMITED, Event::PositionLimit),
        (
            f::TORQUE_LIMITED | f::TORQUE_RATE_LIMITED | f::LEAD_LIMITED,
            Event::TorqueLimit,
        ),
        (f::VELOCITY_LIMITED | f::POWER_LIMITED, Event::VelocityLimit),
        (f::NOT_FINITE, Event::CommandNotFinite),
    ];
    for (bits, event) in events {
        if flags & bits != 0 {
            counts.add_of(event, Subject::Joint(joint));
        }
    }
}
