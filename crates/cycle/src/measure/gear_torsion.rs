//! Gear torsion: the torsion that the estimated torque explains, of joints without a link-side encoder.
//!
//! In: the torque from F/T sensors and IMU. Out: the torsion by which the angle of the next cycle,
//! `q = theta/N - torsion`, is less than the motor's. The torque itself follows from that angle and its
//! derivatives, so this closes a loop, and a torsion that took every change of the torque would ring at
//! the frequency of the links on their gears:
//!
//! ```text
//! tau = M (ddtheta/N - ddtorsion) + ...    torsion = F(s) K^-1 tau    loop: -F(s) s² K^-1 M
//! ```
//!
//! `F` is two low-passes in a row, `w²/(s + w)²`: then `|F s²| <= w²` at every frequency, whatever the
//! filters of the torque delay, as they amplify nothing. The greatest eigenvalue of `K^-1 M` is at most its
//! trace, the sum of `M_jj / K_j`, each of which is what a joint bears with the robot stretched out. So with
//!
//! ```text
//! w = 1 / (4 sqrt(sum of M_jj / K_j))
//! ```
//!
//! the loop's gain is at most 1/16 for the gears of the configuration, and 1/4 where gears are four times as
//! soft or links four times as heavy: no ringing, by the small-gain theorem. Gravity and contacts that turn
//! with the angle add their stiffness over the gear's, some hundredths. What remains unexplained are torques
//! that change faster than `w` (some Hz), by their torsion: of the greatest torque a few tenths of a degree.
//!
//! Where the torque is not valid, the torsion stays as it is: a sensor that fails moves no angle.

use estimators::compliance::ComplianceParameters;
use estimators::kinematic_error::KinematicErrorParameters;
use robot_config::{JointParameters, Robot};
use robot_state::{JointEstimated, JointMeasured};

use crate::estimate::valid;

/// One joint without a link-side encoder.
#[derive(Debug, Clone)]
struct Joint {
    index: usize,
    gear_ratio: f64,
    compliance: ComplianceParameters,
    kinematic_error: KinematicErrorParameters,
    torque_limit: f64,
    /// The torque behind the first and the second low-pass, N·m.
    slow: [f64; 2],
}

/// All joints of a robot that have no link-side encoder.
#[derive(Debug)]
pub(super) struct GearTorsion {
    joints: Vec<Joint>,
    /// Share of a step that a low-pass takes in a cycle.
    share: f64,
}

impl GearTorsion {
    pub(super) fn new(robot: &Robot) -> Self {
        let p = &robot.parameters;
        let joints = || {
            let alone = |(_, joint): &(usize, &JointParameters)| !joint.has_link_encoder;
            p.joints.iter().enumerate().filter(alone)
        };
        let slowest = 1.0 / p.torsion_bandwidth();
        Self {
            joints: joints()
                .map(|(index, joint)| Joint::new(index, joint))
                .collect(),
            share: p.timing.sample_period / (p.timing.sample_period + slowest),
        }
    }

    /// Takes the torques of a cycle; calls `explain` with each joint and its torsion, rad.
    pub(super) fn update(
        &mut self,
        measured: &[JointMeasured],
        estimated: &[JointEstimated],
        mut explain: impl FnMut(usize, f64),
    ) {
        for joint in &mut self.joints {
            let (Some(measured), Some(estimated)) =
                (measured.get(joint.index), estimated.get(joint.index))
            else {
                continue;
            };
            if let Some(torque) = valid(&estimated.tau_whole_body) {
                joint.follow(torque.tau, self.share);
            }
            explain(joint.index, joint.torsion(measured));
        }
    }
}

impl Joint {
    fn new(index: usize, joint: &JointParameters) -> Self {
        Self {
            index,
            gear_ratio: joint.encoders.gear_ratio,
            compliance: joint.estimator.compliance,
            kinematic_error: joint.estimator.kinematic_error.clone(),
            torque_limit: joint.limits.torque,
            slow: [0.0; 2],
        }
    }

    fn follow(&mut self, torque: f64, share: f64) {
        let [first, second] = &mut self.slow;
        *first += share * (torque - *first);
        *second += share * (*first - *second);
    }

    /// The torsion at the torque behind both low-passes, rad.
    fn torsion(&self, measured: &JointMeasured) -> f64 {
        let torque = self.slow[1].clamp(-self.torque_limit, self.torque_limit);
        let n = self.gear_ratio;
        //= Z8: torsion = torsion_fs + torsion_wg / N + err
        self.compliance.flexspline_torsion(torque)
            + self.compliance.wave_generator_torsion(torque / n) / n
            + self.kinematic_error.error(measured.q, measured.theta)
    }
}
