//! Modes: what passive mode, torque-feedback motion and low-gain tracking make of the torques of
//! inverse dynamics.
//!
//! | mode | torque beside stiffness and damping | stiffness, damping |
//! | --- | --- | --- |
//! | passive (Z IV-C) | of joints that are let go: weight and inertial forces, no contact's | none; the share `passive_damping_per_cent` |
//! | torque-feedback motion (Z IV-B) | what the joint carries, as its torque without delay shows it | the configured ones |
//! | low-gain tracking (G V-B) | inverse dynamics, and what was learned to be missing | the shares `low_gain_*_per_cent` |

use control::predictive::LawParameters;
use control::{CarriedTorque, JointGains, largest_follow};
use dynamics::Model;
use estimators::local_gp::LocalGp;
use problem::Problem;
use robot_config::feed_forward::{motion_inputs, neighbours};
use robot_config::{JointParameters, Robot};
use robot_state::{Event, JointReference, Mode, Reference};

use super::borne::Borne;
use super::impedance::Impedance;
use super::law::InverseDynamicsTorque;
use super::reference::Goal;
use crate::events::{Counts, Subject};

/// Torque of contacts on a joint, of its limit, from which on it bears: let go, its limb would give way.
const BEARS: f64 = 0.1;
/// Largest learned torque, of the limit: beside a model more is an error of the file.
const LEARNED_MOST: f64 = 0.5;

/// Time in which the bandwidth of the carried torque rises from nothing to its largest, s: that of an impedance.
const RISE_S: f64 = 0.5;

/// See the module.
#[derive(Debug)]
pub(super) struct Modes {
    joints: Vec<Joint>,
    /// The mode of the last cycle.
    mode: Mode,
}

#[derive(Debug)]
struct Joint {
    carried: CarriedTorque,
    /// Bandwidth in which the carried torque is fed back, rad/s: at present, and with the configured gains.
    follow: f64,
    largest_follow: f64,
    gains: JointGains,
    law: LawParameters,
    link_inertia: f64,
    learned: Option<Learned>,
    torque_limit: f64,
    /// It was let go in the last cycle.
    let_go: bool,
    /// q_d at which it was held last in passive mode, rad.
    held_at: f64,
    /// Way within which it counts as standing, rad, and what it bears in low-gain tracking.
    stands_within: f64,
    borne: Borne,
    passive: Impedance,
    low: Impedance,
}

#[derive(Debug)]
struct Learned {
    torque: LocalGp,
    neighbours: [Option<usize>; 2],
}

impl Modes {
    pub(super) fn new(robot: &Robot) -> Result<Self, Problem> {
        let p = &robot.parameters;
        let joints = p.joints.iter().enumerate();
        let joints = joints.map(|(j, joint)| {
            let share = |stiffness: f64, damping: f64| Impedance {
                stiffness: stiffness * joint.gains.k_s,
                damping: damping * joint.gains.k_d,
            };
            Ok(Joint {
                carried: CarriedTorque::default(),
                follow: 0.0,
                largest_follow: largest_follow(&joint.gains, &joint.law, joint.link_inertia),
                gains: joint.gains,
                law: joint.law,
                link_inertia: joint.link_inertia,
                learned: Learned::new(&robot.model, &p.joints, j)?,
                torque_limit: joint.limits.torque,
                let_go: false,
                held_at: 0.0,
                stands_within: joint.limits.gives_way,
                borne: Borne::at(0.0, 0.0),
                passive: share(0.0, p.modes.passive_damping),
                low: share(p.modes.low_stiffness, p.modes.low_damping),
            })
        });
        Ok(Self {
            joints: joints.collect::<Result<_, Problem>>()?,
            mode: Mode::Hold,
        })
    }

    /// Stiffness and damping of a joint where its mode has others than the configured ones; `asked`:
    /// those of the client.
    pub(super) fn impedance(
        &self,
        goal: &Goal<'_>,
        joint: usize,
        asked: Option<Impedance>,
    ) -> Option<Impedance> {
        let own = self.joints.get(joint)?;
        match goal {
            Goal::Passive(_) if goal.lets_go(joint) => Some(own.passive),
            Goal::LowGainTracking(_) if asked.is_none() => Some(own.low),
            _ => asked,
        }
    }

    /// Reference of a joint. One that was just let go goes soft at the place at which it was held: nobody
    /// has checked what its reference asks for now.
    pub(super) fn asked(
        &self,
        goal: &Goal<'_>,
        joint: usize,
        asked: JointReference,
    ) -> JointReference {
        match self.joints.get(joint) {
            Some(own) if goal.lets_go(joint) => JointReference {
                q_d: own.held_at,
                ..JointReference::default()
            },
            _ => asked,
        }
    }

    /// Changes the torques of the goal's mode. `age_s`: of the reference; `fast`: torque of a joint without
    /// delay; `free`: torque without any contact; `angle`: q. False where a joint that is to be let go bears a contact:
    /// it must not be, and an event has been counted.
    pub(super) fn update(
        &mut self,
        (goal, age_s): (&Goal<'_>, f64),
        fast: impl Fn(usize) -> Option<f64>,
        (free, angle): (impl Fn(usize) -> f64, impl Fn(usize) -> f64),
        dt: f64,
        torques: &mut [InverseDynamicsTorque],
        counts: &mut Counts,
    ) -> bool {
        let begins = std::mem::replace(&mut self.mode, goal.mode()) != goal.mode();
        let mut allowed = true;
        for (j, (own, torque)) in self.joints.iter_mut().zip(torques).enumerate() {
            let was_let_go = std::mem::replace(&mut own.let_go, goal.lets_go(j));
            match goal {
                Goal::Passive(_) if own.let_go => {
                    let free = free(j);
                    let bears = (torque.feedforward - free).abs() > BEARS * own.torque_limit;
                    if bears && !was_let_go {
                        counts.add_of(Event::ReferenceRejected, Subject::Joint(j));
                        allowed = false;
                    }
                    torque.feedforward = free;
                }
                Goal::Passive(reference) => {
                    own.held_at = reference
                        .joints
                        .get(j)
                        .map_or(own.held_at, |asked| asked.q_d);
                }
                Goal::TorqueFeedbackMotion(reference) => {
                    let most = own.follow_with(reference, j);
                    // A joint becomes stiffer within half a second, and no faster may this rise.
                    own.follow = match begins {
                        true => most,
                        false => most.min(own.follow + dt / RISE_S * own.largest_follow),
                    };
                    let now = fast(j).filter(|now| now.is_finite());
                    let now = now.unwrap_or(own.carried.value());
                    if begins {
                        own.carried = CarriedTorque::at(now);
                    }
                    *torque = InverseDynamicsTorque {
                        feedforward: own.carried.follow(now, own.follow, dt),
                        ..InverseDynamicsTorque::default()
                    };
                }
                Goal::LowGainTracking(reference) => {
                    let (free, angle) = (free(j), angle(j));
                    let shown = torque.feedforward - free;
                    if begins {
                        own.borne = Borne::at(angle, shown);
                    }
                    let stands = (own.stands_within, own.torque_limit);
                    let borne = own.borne.follow((angle, shown), stands, dt);
                    if reference.contact_wrench_given != 1 {
                        torque.feedforward = free + borne;
                    }
                    let learned = own.learned.as_ref();
                    let most = LEARNED_MOST * own.torque_limit;
                    torque.feedforward +=
                        learned.map_or(0.0, |learned| learned.torque(j, reference, age_s, most));
                }
                _ => {}
            }
        }
        allowed
    }
}

impl Joint {
    /// Bandwidth that the loop bears with the gains that the client asks for, rad/s.
    fn follow_with(&self, reference: &Reference, joint: usize) -> f64 {
        let asked = reference.joints.get(joint);
        let Some(asked) = asked.filter(|_| reference.gains_given == 1) else {
            return self.largest_follow;
        };
        let gains = JointGains {
            k_s: asked.stiffness,
            k_d: asked.damping,
            ..self.gains
        };
        largest_follow(&gains, &self.law, self.link_inertia).min(self.largest_follow)
    }
}

impl Learned {
    fn new(model: &Model, joints: &[JointParameters], j: usize) -> Result<Option<Self>, Problem> {
        let learned = joints.get(j).and_then(|joint| joint.feed_forward.as_ref());
        let torque = learned.map(LocalGp::new).transpose()?;
        Ok(torque.map(|torque| Self {
            torque,
            neighbours: neighbours(model, joints, j),
        }))
    }

    /// The learned torque at the desired motion, N·m: none beyond the motions that it was learned from.
    //= G Section V-B: u_FF = f(q_d, dq_d, ddq_d), u_FB = K_p e + K_v e'
    fn torque(&self, joint: usize, reference: &Reference, age_s: f64, most: f64) -> f64 {
        let motion = |j: usize| {
            let asked = reference.joints.get(j).copied().unwrap_or_default();
            [asked.q_d + asked.dq_d * age_s, asked.dq_d, asked.ddq_d]
        };
        let inputs = motion_inputs(joint, self.neighbours, motion);
        let mean = self.torque.predict(&inputs).mean;
        // max and min, not clamp: they cannot panic.
        match mean.is_finite() {
            true => mean.max(-most).min(most),
            false => 0.0,
        }
    }
}
