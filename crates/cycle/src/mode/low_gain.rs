//! Low-gain tracking: the joints follow `q_d dq_d ddq_d` by a low stiffness and a learned feed-forward (G V-B).
//!
//! The torque is that of inverse dynamics and what was learned to be missing; stiffness and damping are the shares
//! `low_gain_*_per_cent` of the configured ones, unless the client gives others.

use dynamics::Model;
use estimators::local_gp::LocalGp;
use problem::Problem;
use robot_config::feed_forward::{motion_inputs, neighbours};
use robot_config::{JointParameters, Robot};
use robot_state::{Mode, Reference};

use super::{
    Asked, ClientMode, Follow, Foresight, Impedance, Made, ModeCycle, RigidBodyTorque, Speed,
    Spring, Unfit,
};

/// Largest learned torque, of the limit: beside a model more is an error of the file. Chosen; no experiment recorded.
const LEARNED_MOST: f64 = 0.5;

#[derive(Debug)]
struct Joint {
    learned: Option<Learned>,
    torque_limit: f64,
    impedance: Impedance,
}

#[derive(Debug)]
struct Learned {
    torque: LocalGp,
    neighbours: [Option<usize>; 2],
}

#[derive(Debug)]
struct LowGain {
    joints: Vec<Joint>,
}

pub(super) fn make(robot: &Robot) -> Made {
    let p = &robot.parameters;
    if p.joints.iter().all(|joint| joint.feed_forward.is_none()) {
        return Ok(None);
    }
    let joints = p.joints.iter().enumerate().map(|(j, joint)| {
        Ok(Joint {
            learned: Learned::new(&robot.model, &p.joints, j)?,
            torque_limit: joint.limits.torque,
            impedance: Impedance {
                stiffness: p.modes.low_stiffness * joint.gains.k_s,
                damping: p.modes.low_damping * joint.gains.k_d,
            },
        })
    });
    Ok(Some(Box::new(LowGain {
        joints: joints.collect::<Result<_, Problem>>()?,
    })))
}

impl ClientMode for LowGain {
    fn set_tasks(&mut self, mut cycle: ModeCycle<'_>) -> Result<(), Unfit> {
        let asked = cycle.asked;
        cycle.body.follow(asked.reference, cycle.seen);
        cycle.track(Mode::LowGainTracking, asked, |j, follow| {
            let own = &self.joints[j];
            let feedforward = follow.torque.feedforward + own.learned(asked, j);
            let impedance = asked.impedance(j).unwrap_or(own.impedance);
            Follow {
                torque: RigidBodyTorque {
                    feedforward,
                    ..follow.torque
                },
                spring: follow.spring.map(|spring| Spring {
                    impedance: Some(impedance),
                    foresight: Foresight::All,
                    ..spring
                }),
                speed: Speed::TorqueBeside(asked.of_joint(j).dq_d.abs()),
                ..follow
            }
        });
        Ok(())
    }
}

impl Joint {
    /// The torque that was learned to be missing, N·m.
    fn learned(&self, asked: &Asked<'_>, joint: usize) -> f64 {
        let most = LEARNED_MOST * self.torque_limit;
        let learned = self.learned.as_ref();
        learned.map_or(0.0, |l| l.torque(joint, asked.reference, asked.age_s, most))
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
        if mean.is_finite() {
            mean.max(-most).min(most)
        } else {
            0.0
        }
    }
}
