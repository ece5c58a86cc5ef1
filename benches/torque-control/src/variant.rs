//! Laws and errors under which a robot is judged.

use control::predictive::DriveLoop;
use control::{DriveModel, EquivalentGains, JointGains};
use plant::SimParameters;
use plant::parameters::PushParameters;
use robot_config::{FastTorqueFeedback, Robot, TorqueFeedback, TorqueLaw};

/// A law with its feedback.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Law {
    /// D10-D12.
    D {
        /// K6; none: the gains at which the robot is quiet.
        k6: Option<f64>,
    },
    /// The predictive law.
    Predictive {
        /// Torque that it feeds back.
        feedback: FastTorqueFeedback,
        /// K6: K_s times K_tau.
        k6: f64,
    },
}

/// Conditions of a run.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Conditions {
    /// The law.
    pub(crate) law: Law,
    /// Transport delay of the simulated robot, cycles.
    pub(crate) delay_cycles: f64,
    /// Cycles of delay that the law expects.
    pub(crate) expected_cycles: f64,
    /// Seed of the simulated robot.
    pub(crate) seed: u64,
    /// Errors of the law's parameters are drawn within plus or minus this share, by `draw`.
    pub(crate) error: f64,
    /// Number of the draw.
    pub(crate) draw: u64,
    /// Friction that the law foresees over that of robot.toml.
    pub(crate) friction: f64,
    /// Bristles of the drives' friction; none: those of sim.toml, which robot.toml does not have.
    pub(crate) bristles: Option<Bristles>,
    /// Share of lost commands.
    pub(crate) lost: f64,
    /// Disturbance of the joint.
    pub(crate) happens: Happens,
}

/// Bristles of friction, by the way of the motor over which they bend before they slide, rad.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Bristles {
    /// The plant's.
    pub(crate) way: f64,
    /// The law's over the plant's; none: it is not configured.
    pub(crate) known: Option<f64>,
}

/// Disturbance of a robot in its motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Happens {
    /// Nothing.
    Nothing,
    /// Pushes of 60 N for 0.3 s.
    Pushes,
    /// The contact set is changed while it stands, and changed back.
    Contacts,
}

impl Conditions {
    /// One cycle of delay, seed 1, no errors of parameters.
    pub(crate) fn new(law: Law) -> Self {
        Self {
            law,
            delay_cycles: 1.0,
            expected_cycles: 1.0,
            seed: 1,
            error: 0.0,
            draw: 0,
            friction: 1.0,
            bristles: None,
            lost: 0.0,
            happens: Happens::Nothing,
        }
    }
}

/// The new law as it is shipped.
pub(crate) fn shipped() -> Law {
    Law::Predictive {
        feedback: FastTorqueFeedback::Levelled,
        k6: 0.5,
    }
}

/// Links that are pushed.
const CHEST: &str = "chest_pitch_link";
const FOOT: &str = "foot";

/// K7 of the predictive law, s: K_d = 5 ms / K_tau.
const K7: f64 = 0.005;

/// Gives a robot and its simulation the conditions.
pub(crate) fn apply(conditions: &Conditions, robot: &mut Robot, sim: &mut SimParameters) {
    let p = &mut robot.parameters;
    let dt = p.timing.sample_period;
    sim.seed = conditions.seed;
    sim.transport.delay = Some(conditions.delay_cycles * dt);
    sim.transport.lost = conditions.lost;
    let humanoid = p.joints.len() > 6;
    if conditions.happens == Happens::Pushes {
        let link = if humanoid { CHEST } else { FOOT };
        for (start, force) in [(3.0, [60.0, 0.0, 0.0]), (5.0, [0.0, 60.0, 0.0])] {
            sim.pushes.push(PushParameters {
                link: link.to_owned(),
                start,
                duration: 0.3,
                force,
                torque: [0.0; 3],
            });
        }
    }
    if let Some(bristles) = conditions.bristles {
        bend(bristles, robot, sim);
    }
    let p = &mut robot.parameters;
    let by_sensors = !p.ft_sensors.is_empty();
    p.torque_law = match conditions.law {
        Law::D { .. } if by_sensors => TorqueLaw::ProportionalIntegral(TorqueFeedback::WholeBody),
        Law::D { .. } => TorqueLaw::ProportionalIntegral(TorqueFeedback::Encoder),
        Law::Predictive { .. } if !by_sensors => TorqueLaw::Predictive(FastTorqueFeedback::Torsion),
        Law::Predictive { feedback, .. } => TorqueLaw::Predictive(feedback),
    };
    for (j, joint) in p.joints.iter_mut().enumerate() {
        let mut random = Draw(conditions.draw * 1000 + j as u64 + 1);
        let mut error = || 1.0 + conditions.error * random.symmetric();
        let DriveModel::Position(drive) = &mut joint.drive_model else {
            continue;
        };
        let equivalent = |k6: f64, k7: f64, k_p: f64| {
            let gains = EquivalentGains { k6, k7 };
            JointGains::from_equivalent(gains, drive.k_tau, k_p, 0.0)
        };
        match conditions.law {
            // Decision 0006: the standing humanoid was quiet with half of K_v and these gains.
            Law::D { k6: None } if humanoid => {
                joint.gains = equivalent(0.5, 0.01, 1.0);
                drive.k_v *= 0.5;
            }
            Law::D { k6 } => joint.gains = equivalent(k6.unwrap_or(1.0), 0.01, 2.0),
            Law::Predictive { k6, .. } => {
                joint.gains = equivalent(k6, K7, 0.0);
                let law = &mut joint.law;
                law.delay += (conditions.expected_cycles - 1.0) * dt;
                law.rotor_inertia *= error();
                law.gear.k_fs0 *= error();
                law.gear.k_wg0 *= error();
                law.friction.level *= conditions.friction * error();
                law.friction.stiffness *= error();
                if let DriveLoop::Position {
                    stiffness,
                    damping,
                    dead_zone,
                    ..
                } = &mut law.drive
                {
                    *stiffness *= error();
                    *damping *= error();
                    *dead_zone *= error();
                }
            }
        }
    }
}

/// Gives the plant's friction its bristles, and the law what it knows of them.
fn bend(bristles: Bristles, robot: &mut Robot, sim: &mut SimParameters) {
    for joint in &mut robot.parameters.joints {
        let Some(friction) = (sim.drives.get_mut(&joint.drive)).map(|drive| &mut drive.friction)
        else {
            continue;
        };
        friction.presliding = bristles.way;
        if let Some(share) = bristles.known {
            let known = &mut joint.law.friction;
            known.stiffness = known.level * joint.estimator.gear_ratio / (share * bristles.way);
        }
    }
}

/// Random numbers that a seed repeats.
pub(crate) struct Draw(pub(crate) u64);

impl Draw {
    /// Uniform in (0, 1).
    pub(crate) fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn symmetric(&mut self) -> f64 {
        2.0 * self.unit() - 1.0
    }

    /// Normal with standard deviation 1.
    pub(crate) fn normal(&mut self) -> f64 {
        (-2.0 * self.unit().max(1e-300).ln()).sqrt() * (std::f64::consts::TAU * self.unit()).cos()
    }
}
