//! Command: from the client's reference to each drive's command (D10-D12), within limits.
//!
//! Parts: `decide` settles the mode and whether a client is followed, `reference` whether the robot
//! can do what it asks for; `joint` computes each joint's command in that mode, on which
//! [`supervisor::Limiter`] has the last word; `emit` makes the frames.

mod approach;
mod borne;
mod carry;
mod cartesian;
mod decide;
mod delay;
mod emit;
mod felt_level;
mod frame_check;
mod impedance;
mod inputs;
mod joint;
mod late;
mod law;
mod modes;
mod motion;
mod predictive;
mod reference;
mod rejoin;
mod rest;
mod transition;
mod unheld;
mod weight;
mod yielding;

use control::InverseDynamics;
use dynamics::Motion;
use problem::Problem;
use robot_config::{FastTorqueFeedback, Robot, TorqueFeedback, TorqueLaw};
use robot_state::{
    CommandedRecord, EstimatedRecord, Event, JointEstimated, JointReference, MAX_FT_SENSORS,
    MeasuredRecord, Mode, Reference, Wrench, command_flags, torque_flags,
};

use supervisor::Deviation;

use crate::estimate::FastTorque;
use crate::events::{Counts, Subject};
use crate::measure::JointReadiness;
use cartesian::Frames;
use delay::CommandDelay;
use felt_level::FeltLevels;
use impedance::Impedance;
use joint::JointController;
use law::{InverseDynamicsTorque, JointInput};
use modes::Modes;
use motion::Motions;
use reference::Goal;
use weight::{Loads, Past};
use yielding::Yielding;

pub(crate) use decide::Supervisor;
pub(crate) use emit::Emit;
pub use inputs::ClientInput;
pub(crate) use inputs::Known;

/// Inputs of commands besides the goal.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Input<'a> {
    pub(crate) measured: &'a MeasuredRecord,
    /// Whether each joint's samples can be relied on.
    pub(crate) readiness: &'a [JointReadiness],
    pub(crate) estimated: &'a EstimatedRecord,
    /// Torques without delay, one for each joint.
    pub(crate) fast: &'a [FastTorque],
    /// Twist and proper acceleration of the root.
    pub(crate) base_motion: (Motion, Motion),
    /// The client's newest reference, unchecked: frames that it uses are shown in any mode.
    pub(crate) client: Option<&'a Reference>,
    /// Its age, s.
    pub(crate) age_s: f64,
    /// Periods before this cycle in which the loop did not run.
    pub(crate) skipped: u32,
    /// They were so many that nothing goes on.
    pub(crate) overslept: bool,
}

/// The controllers of all joints, and the inverse dynamics that they share.
#[derive(Debug)]
pub(crate) struct Command {
    joints: Vec<JointController>,
    inverse_dynamics: InverseDynamics,
    motions: Motions,
    yielding: Yielding,
    frames: Frames,
    felt_levels: FeltLevels,
    modes: Modes,
    delay: CommandDelay,
    loads: Past,
    /// Torques that carry the joints' weight, N·m, model order.
    weights: Vec<f64>,
    /// Place of each joint, in config order, in the model.
    model_index: Vec<usize>,
    q_hat: Vec<f64>,
    dq_hat: Vec<f64>,
    ddq_d: Vec<f64>,
    torques: Vec<InverseDynamicsTorque>,
    torque_law: TorqueLaw,
    k_f: f64,
    sample_period: f64,
}

impl Command {
    pub(crate) fn new(robot: &Robot) -> Result<Self, Problem> {
        let parameters = &robot.parameters;
        let n = parameters.joints.len();
        let frames: Vec<usize> = parameters
            .ft_sensors
            .iter()
            .filter_map(|ft| robot.model.frame_index(&ft.sensor.frame))
            .collect();
        Ok(Self {
            joints: (0..parameters.joints.len())
                .map(|j| JointController::new(j, parameters))
                .collect::<Result<_, _>>()?,
            inverse_dynamics: InverseDynamics::new(&robot.model, &frames),
            motions: Motions::new(parameters),
            yielding: Yielding::new(robot),
            frames: Frames::new(robot),
            felt_levels: FeltLevels::new(parameters),
            modes: Modes::new(robot)?,
            delay: CommandDelay::new(robot),
            loads: Past::new(parameters.timing.sample_period),
            weights: vec![0.0; robot.model.joint_count()],
            model_index: parameters.joints.iter().map(|j| j.model_index).collect(),
            q_hat: vec![0.0; robot.model.joint_count()],
            dq_hat: vec![0.0; robot.model.joint_count()],
            ddq_d: vec![0.0; robot.model.joint_count()],
            torques: vec![InverseDynamicsTorque::default(); n],
            torque_law: parameters.torque_law,
            k_f: parameters.k_f,
            sample_period: parameters.timing.sample_period,
        })
    }

    /// The last command of each joint, rad or A; none where none is sent.
    pub(crate) fn last(&self) -> impl Iterator<Item = Option<f64>> {
        self.joints.iter().map(JointController::last)
    }

    /// Withdraws the commands of joints that were formed in this cycle and did not leave: their joints begin
    /// where they stand when commands leave again, not where they were held.
    pub(crate) fn withdraw(
        &mut self,
        is_driven: impl Fn(usize) -> bool,
        commanded: &mut CommandedRecord,
    ) {
        for (j, (joint, commanded)) in
            (self.joints.iter_mut().zip(&mut commanded.joints)).enumerate()
        {
            if joint.last().is_some() && !is_driven(j) {
                joint.forget();
                commanded.flags &= !command_flags::ENGAGED;
            }
        }
    }

    /// Time until the robot is at the target of a planned motion, s; 0 without one.
    pub(crate) fn motion_left_s(&self) -> f64 {
        self.motions.left_s()
    }

    /// The command of every engaged joint within all limits, with its contributions. Of one that is
    /// not finite the last one stands.
    pub(crate) fn update(
        &mut self,
        goal: &Goal<'_>,
        is_engaged: impl Fn(usize) -> bool,
        input: &Input<'_>,
        commanded: &mut CommandedRecord,
        counts: &mut Counts,
    ) {
        let Input {
            measured,
            readiness,
            estimated,
            fast,
            base_motion,
            client,
            age_s,
            skipped,
            overslept,
        } = *input;
        self.weigh(base_motion, measured, estimated);
        let loads = self.loads.loads();
        let law = self.torque_law;
        let offset = |j: usize| {
            let torque = fast_torque(law, estimated.joints.get(j)?, fast.get(j))?;
            Some(torque - fast.get(j)?.torsion?)
        };
        (self.yielding).update(goal, loads, (measured, estimated), offset, &self.motions);
        // A limb that goes back is a motion to a target.
        let (anew, dt) = (self.yielding.is_new(), self.sample_period);
        let planned = match self.yielding.target() {
            Some(target) => (self.motions).follow(&Goal::Position(target), anew, measured, dt),
            None => (self.motions).follow(goal, false, measured, dt),
        };
        let planned = planned.or_else(|| self.yielding.soft().copied());
        let (goal, age_s) = match (&planned, goal) {
            (Some(planned), _) => (&Goal::InverseDynamics(planned), 0.0),
            (None, Goal::Contact { .. }) => (&Goal::Stop, age_s),
            (None, goal) => (goal, age_s),
        };
        let reference = goal.reference();
        // Desired accelerations and contact forces are those of inverse dynamics alone.
        let moved = match goal.mode() {
            Mode::InverseDynamics | Mode::Cartesian | Mode::LowGainTracking => reference,
            _ => None,
        };
        let contact = match self.yielding.loads() {
            // The contact itself is to move the limb.
            Some(loads) => loads.contact,
            None => std::array::from_fn(|s| estimated.ft[s].contact_wrench),
        };
        self.inverse_dynamics(moved, base_motion, measured, &contact);
        match goal {
            Goal::Cartesian(reference) => {
                let dq = |j: usize| self.joints[j].velocity(&measured.joints[j]);
                let torques = &mut self.torques;
                let known = cartesian::Known {
                    measured,
                    estimated,
                };
                (self.frames).lead((reference, age_s), known, dq, torques, commanded);
            }
            _ => self.frames.show(client, measured, commanded),
        }
        let goal = match self.of_mode((goal, age_s), (measured, estimated, fast), counts) {
            true => goal,
            false => &Goal::Stop,
        };
        let none = JointReference::default();
        for (j, joint) in self.joints.iter_mut().enumerate() {
            if !is_engaged(j) {
                joint.release(measured.joints[j].q, &mut commanded.joints[j]);
                continue;
            }
            let torques = &estimated.joints[j];
            let yields = self.yielding.yields(j);
            let goal = match self.yielding.is_on() && !yields {
                true => &Goal::Stop,
                false => goal,
            };
            let input = JointInput {
                reference: self.modes.asked(
                    goal,
                    j,
                    reference
                        .and_then(|r| r.joints.get(j))
                        .map_or(none, |asked| {
                            // A reference is for the time at which it was sent.
                            JointReference {
                                q_d: asked.q_d + asked.dq_d * age_s,
                                ..*asked
                            }
                        }),
                ),
                impedance: self.frames.posture(
                    j,
                    self.modes.impedance(
                        goal,
                        j,
                        reference
                            .filter(|r| r.gains_given == 1)
                            .and_then(|r| r.joints.get(j))
                            .map(Impedance::of),
                    ),
                ),
                inverse_dynamics: self.torques[j],
                measured: &measured.joints[j],
                trusted: !readiness.get(j).is_some_and(|joint| joint.distrusted),
                weight: self.weights[self.model_index[j]],
                tau_encoder: &torques.tau_encoder,
                tau_hat: match self.torque_law {
                    _ if joint.is_late() => &torques.tau_whole_body,
                    TorqueLaw::ProportionalIntegral(TorqueFeedback::WholeBody) => {
                        &torques.tau_whole_body
                    }
                    TorqueLaw::ProportionalIntegral(TorqueFeedback::Encoder) => {
                        &torques.tau_encoder
                    }
                    TorqueLaw::Predictive(_) => &torques.tau_hat,
                },
                fast: match self.yielding.torque_offset(j) {
                    Some(offset) => (fast.get(j).and_then(|fast| fast.torsion)).map(|t| t + offset),
                    None => {
                        let torque = fast_torque(law, torques, fast.get(j));
                        let presses = self.frames.force_share(j);
                        (self.felt_levels).update(j, presses, torque, &torques.tau_hat)
                    }
                },
                yields,
                led: self.frames.leads(j) || goal.lets_go(j),
                yields_anew: yields && self.yielding.is_new(),
                in_contact: self.yielding.concerns(j),
                dt: self.sample_period,
                skipped,
                overslept,
                resumes: false,
            };
            if let Some((deviation, begins)) = joint.update(goal, &input, &mut commanded.joints[j])
            {
                let event = match deviation {
                    Deviation::Following => Event::FollowingError,
                    Deviation::Overspeed => Event::Overspeed,
                    Deviation::Doubtful => Event::FollowingDoubtful,
                };
                counts.lasting(event, Subject::Joint(j), begins);
            }
            if joint.finds_another_drive(goal.mode()) {
                counts.add_of(Event::DriveUnlike, Subject::Joint(j));
            }
            count_limits(j, commanded.joints[j].flags, counts);
        }
        let gap = skipped > 0 || overslept;
        (self.delay).update(goal.mode(), gap, measured, commanded, counts);
    }

    /// Torques that carry the joints' weight where both encoders showed them last, by the model at
    /// rest under the loads of some time ago. Only drives without a position loop need them.
    fn weigh(
        &mut self,
        (_, acceleration): (Motion, Motion),
        measured: &MeasuredRecord,
        estimated: &EstimatedRecord,
    ) {
        let now = Loads {
            acceleration: acceleration.linear.into(),
            contact: std::array::from_fn(|s| estimated.ft[s].contact_wrench),
        };
        self.loads.update(now, weight::is_sound(measured));
        if !self.joints.iter().any(JointController::takes_current) {
            return;
        }
        let loads = self.loads.loads();
        for (&place, joint) in self.model_index.iter().zip(&measured.joints) {
            self.q_hat[place] = joint.q;
        }
        self.dq_hat.fill(0.0);
        self.ddq_d.fill(0.0);
        let at_rest = Motion {
            linear: loads.acceleration.into(),
            ..Motion::zero()
        };
        let base = (Motion::zero(), at_rest);
        self.inverse_dynamics
            .set_motion(base, &self.q_hat, &self.dq_hat, &self.ddq_d);
        let torques = self.inverse_dynamics.torque(&loads.contact);
        for (weight, torque) in self.weights.iter_mut().zip(torques) {
            *weight = *torque;
        }
    }

    /// The torques that the goal's mode makes of those of inverse dynamics; false: the joints must stop.
    fn of_mode(
        &mut self,
        (goal, age_s): (&Goal<'_>, f64),
        (measured, estimated, fast): (&MeasuredRecord, &EstimatedRecord, &[FastTorque]),
        counts: &mut Counts,
    ) -> bool {
        let law = self.torque_law;
        let carried = |j: usize| fast_torque(law, estimated.joints.get(j)?, fast.get(j));
        let free = match goal {
            Goal::Passive(_) | Goal::LowGainTracking(_) => self
                .inverse_dynamics
                .torque(&[Wrench::default(); MAX_FT_SENSORS]),
            _ => &[],
        };
        let free = |j: usize| {
            let place = self.model_index.get(j);
            place
                .and_then(|&place| free.get(place))
                .copied()
                .unwrap_or(0.0)
        };
        let (torques, dt) = (&mut self.torques, self.sample_period);
        let angle = |j: usize| measured.joints.get(j).map_or(f64::NAN, |joint| joint.q);
        (self.modes).update((goal, age_s), carried, (free, angle), dt, torques, counts)
    }

    /// `M ddq_d + h_hat - J^T f` for the desired contact wrenches and for the estimated ones `f_hat`.
    fn inverse_dynamics(
        &mut self,
        reference: Option<&Reference>,
        base_motion: (Motion, Motion),
        measured: &MeasuredRecord,
        f_hat: &[Wrench; MAX_FT_SENSORS],
    ) {
        for (j, (&place, joint)) in self.model_index.iter().zip(&measured.joints).enumerate() {
            self.q_hat[place] = joint.q_hat;
            self.dq_hat[place] = joint.dq_hat;
            self.ddq_d[place] = reference.map_or(0.0, |r| r.joints[j].ddq_d);
        }
        self.inverse_dynamics
            .set_motion(base_motion, &self.q_hat, &self.dq_hat, &self.ddq_d);
        let with_estimated = self.inverse_dynamics.torque(f_hat);
        for (torque, &place) in self.torques.iter_mut().zip(&self.model_index) {
            *torque = InverseDynamicsTorque {
                feedforward: with_estimated[place],
                ..InverseDynamicsTorque::default()
            };
        }
        let given =
            |r: &&Reference| r.contact_wrench_given == 1 && r.mode != Mode::Cartesian.number();
        let Some(reference) = reference.filter(given) else {
            return;
        };
        let with_desired = self.inverse_dynamics.torque(&reference.contact_wrench);
        for (torque, &place) in self.torques.iter_mut().zip(&self.model_index) {
            // All other terms are equal: the difference is -J^T (f_d - f_hat).
            let contact_error = with_desired[place] - torque.feedforward;
            *torque = InverseDynamicsTorque {
                feedforward: with_desired[place],
                //= D12: f* = f_d + K_f (f_d - f_hat)
                force_feedback: self.k_f * contact_error,
                contact_error,
                ..InverseDynamicsTorque::default()
            };
        }
    }
}

/// The torque that the predictive law feeds back, N·m.
fn fast_torque(
    law: TorqueLaw,
    estimated: &JointEstimated,
    fast: Option<&FastTorque>,
) -> Option<f64> {
    use FastTorqueFeedback::{DelayCompensated, Levelled, Torsion};
    let TorqueLaw::Predictive(feedback) = law else {
        return None;
    };
    let fast = fast?;
    match feedback {
        Torsion => fast.torsion,
        // Until the level is known torsion alone.
        Levelled => fast.levelled.or(fast.torsion),
        DelayCompensated => {
            let valid = estimated.tau_hat.flags & torque_flags::VALID != 0;
            valid.then_some(estimated.tau_hat.tau).or(fast.torsion)
        }
    }
}

/// Counts the limits of one joint that acted, but for a torque rate that trimmed noise.
fn count_limits(joint: usize, flags: u32, counts: &mut Counts) {
    use command_flags as f;
    let flags = match flags & f::RATE_TRIMMED != 0 {
        true => flags & !f::TORQUE_RATE_LIMITED,
        false => flags,
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
