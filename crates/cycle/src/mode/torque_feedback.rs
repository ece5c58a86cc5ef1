//! Torque-feedback motion: the joints follow `q_d dq_d` without a model of the links (Z IV-B).
//!
//! The torque that a joint carries, as its torque without delay shows it, is fed back to its motor.

use control::predictive::LawParameters;
use control::{CarriedTorque, JointGains, largest_follow};
use robot_config::{Robot, TorqueLaw};
use robot_state::{Mode, Reference};

use super::{Asked, ClientMode, Follow, Made, ModeCycle, RigidBodyTorque, Unfit};

/// Time in which the bandwidth of the carried torque rises from nothing to its largest, s: that of an impedance
/// (`RAMP_S` of impedance.rs).
const RISE_S: f64 = 0.5;

#[derive(Debug)]
struct Joint {
    carried: CarriedTorque,
    /// Bandwidth in which the carried torque is fed back, rad/s: at present, and with the configured gains.
    follow: f64,
    largest_follow: f64,
    gains: JointGains,
    law: LawParameters,
    link_inertia: f64,
}

#[derive(Debug)]
struct TorqueFeedback {
    joints: Vec<Joint>,
}

pub(super) fn make(robot: &Robot) -> Made {
    let p = &robot.parameters;
    // Margins of the torque feedback are known of torque without delay alone.
    let predictive = matches!(p.torque_law, TorqueLaw::Predictive(_));
    if !predictive || p.joints.iter().any(|joint| !joint.has_link_encoder) {
        return Ok(None);
    }
    let joints = p.joints.iter().map(|joint| Joint {
        carried: CarriedTorque::default(),
        follow: 0.0,
        largest_follow: largest_follow(&joint.gains, &joint.law, joint.link_inertia),
        gains: joint.gains,
        law: joint.law,
        link_inertia: joint.link_inertia,
    });
    Ok(Some(Box::new(TorqueFeedback {
        joints: joints.collect(),
    })))
}

impl ClientMode for TorqueFeedback {
    fn needs(&self) -> u32 {
        0
    }

    fn set_tasks(&mut self, mut cycle: ModeCycle<'_>) -> Result<(), Unfit> {
        let (asked, seen) = (cycle.asked, cycle.seen);
        cycle.track(Mode::TorqueFeedbackMotion, asked, |j, follow| {
            let now = seen.fast_torque(j).filter(|now| now.is_finite());
            let carried = self.joints[j].carry(asked, j, now, seen.dt);
            Follow {
                torque: RigidBodyTorque::feedforward(carried),
                ..follow
            }
        });
        Ok(())
    }
}

impl Joint {
    /// The torque that the joint carries, N·m, of which `now` is the newest value.
    fn carry(&mut self, asked: &Asked<'_>, joint: usize, now: Option<f64>, dt: f64) -> f64 {
        let most = self.follow_with(asked.reference, joint);
        // A joint becomes stiffer within half a second, and no faster may this rise.
        self.follow = if asked.begins {
            most
        } else {
            most.min(self.follow + dt / RISE_S * self.largest_follow)
        };
        let now = now.unwrap_or(self.carried.value());
        if asked.begins {
            self.carried = CarriedTorque::at(now);
        }
        self.carried.follow(now, self.follow, dt)
    }

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
