//! One joint on the plant's rig under a law, with every disturbance and one cycle of transport delay.

use crate::robots::load;
use crate::variant::{Conditions, Draw, Law, apply};
use control::predictive::{PredictiveLaw, Sensed, TorqueTerms};
use control::{DriveModel, JointGains, TorqueLoop};
use estimators::compliance::{ComplianceEstimator, JointEstimatorParameters};
use estimators::filter_bank::FilterBank;
use estimators::joint::{JointSample, JointTorqueEstimator};
use estimators::savitzky_golay::SavitzkyGolayParameters;
use plant::{
    Command, DriveSheet, JointRig, KinematicError, RigLoad, RigSample, RigTiming, SimParameters,
};
use robot_config::{JointParameters, Robot};
use std::collections::VecDeque;
use std::f64::consts::TAU;
use whole_body::{DelayCompensator, DelayCompensatorParameters, DelayedTorque};

pub(crate) const DT: f64 = 1e-3;

/// Robot and joint, and its rated torque, N·m.
pub(crate) const JOINTS: [(&str, &str, f64); 7] = [
    ("test-joint", "joint", 16.0),
    ("leg", "hip_yaw", 28.0),
    ("leg", "hip_roll", 110.0),
    ("leg", "hip_pitch", 55.0),
    ("leg", "knee", 110.0),
    ("leg", "ankle_pitch", 55.0),
    ("leg", "ankle_roll", 28.0),
];

/// Samples of D's window, through which F/T sensors are filtered.
const WINDOW: usize = 80;
/// An inertia that nothing moves, kg·m².
const WORLD: f64 = 1e9;

const BLOCKED: RigLoad = RigLoad {
    inertia: WORLD,
    mass: 0.0,
    arm: 0.0,
};
const TIMING: RigTiming = RigTiming {
    period: DT,
    substeps: 10,
};
/// Where a joint begins, rad.
pub(crate) const START: f64 = 0.3;

/// Reference of a cycle.
pub(crate) enum Wish {
    /// A torque, N·m.
    Torque(f64),
    /// A set-point of the drive's own position loop, rad.
    Position(f64),
}

/// A joint whose motor makes no torque, its link moved by a hand: its drive takes currents, and gets zero.
///
/// # Errors
/// Files that cannot be read.
pub(crate) fn unpowered(index: usize, conditions: &Conditions) -> Result<JointRig, String> {
    let (name, joint, _) = JOINTS[index];
    let (mut robot, mut sim) = load(name)?;
    apply(conditions, &mut robot, &mut sim);
    let own = robot.parameters.joints.iter().find(|own| own.name == joint);
    let own = own.ok_or_else(|| format!("no joint {joint}"))?;
    let drive = sim.drives.get(&own.drive).ok_or("no such drive")?;
    let sheet = DriveSheet {
        command: Command::Current,
        ..sheet(own)
    };
    let mut rig = JointRig::new(&sheet, drive, BLOCKED, TIMING, START, sim.seed);
    rig.command(0.0);
    Ok(rig)
}

enum Controller {
    D {
        torque_loop: TorqueLoop,
        gains: JointGains,
        velocity: Box<FilterBank>,
    },
    Predictive(Box<PredictiveLaw>),
}

/// Signals that a client of the joint sees in a cycle.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Seen {
    /// q, rad.
    pub(crate) q: f64,
    /// dq by the law's observer, rad/s.
    pub(crate) dq: f64,
    /// The torque that is fed back, N·m.
    pub(crate) torque: f64,
}

/// A joint under a law.
pub(crate) struct Bench {
    rig: JointRig,
    pub(crate) joint: JointParameters,
    pub(crate) rated: f64,
    controller: Controller,
    fast: ComplianceEstimator,
    compensator: DelayCompensator,
    quick: FilterBank,
    late: VecDeque<f64>,
    on_the_way: VecDeque<f64>,
    noise: Draw,
    sample: RigSample,
    cycle: usize,
}

impl Bench {
    /// The joint of `JOINTS[index]` with a blocked link, under these conditions.
    ///
    /// # Errors
    /// Files that cannot be read.
    pub(crate) fn new(index: usize, conditions: &Conditions) -> Result<Self, String> {
        Self::with_load(index, conditions, |_| BLOCKED)
    }

    /// The same with a load on its link, by the joint's parameters.
    ///
    /// # Errors
    /// Files that cannot be read.
    pub(crate) fn with_load(
        index: usize,
        conditions: &Conditions,
        load_of: impl Fn(&JointParameters) -> RigLoad,
    ) -> Result<Self, String> {
        let (name, joint, rated) = JOINTS[index];
        let (mut robot, mut sim) = load(name)?;
        apply(conditions, &mut robot, &mut sim);
        let mut bench = Self::of(&robot, &sim, (joint, rated), conditions.law, load_of)?;
        for _ in 0..conditions.delay_cycles as usize {
            bench.on_the_way.push_back(bench.rig.set_point());
        }
        Ok(bench)
    }

    fn of(
        robot: &Robot,
        sim: &SimParameters,
        (name, rated): (&str, f64),
        law: Law,
        load_of: impl Fn(&JointParameters) -> RigLoad,
    ) -> Result<Self, String> {
        let joint = (robot.parameters.joints.iter()).find(|joint| joint.name == name);
        let joint = joint.ok_or_else(|| format!("no joint {name}"))?.clone();
        let drive = sim.drives.get(&joint.drive).ok_or("no such drive")?;
        let load = load_of(&joint);
        let mut rig = JointRig::new(&sheet(&joint), drive, load, TIMING, START, sim.seed);
        let sample = rig.advance(0.0);
        let short = robot.parameters.filters.short.sensor;
        let quick = FilterBank::new(1, short).map_err(|e| e.to_string())?;
        let c = &joint.estimator.compliance;
        let e = &joint.estimator;
        let counts = (e.motor_resolution / e.gear_ratio).hypot(e.link_resolution);
        let controller = match law {
            Law::D { .. } => Controller::D {
                torque_loop: TorqueLoop::default(),
                gains: JointGains {
                    k_p: 2.0,
                    ..JointGains::default()
                },
                velocity: Box::new(
                    FilterBank::new(1, SavitzkyGolayParameters::centred(16, 2, 1, DT))
                        .map_err(|e| e.to_string())?,
                ),
            },
            Law::Predictive { .. } => {
                Controller::Predictive(Box::new(PredictiveLaw::new(joint.law)))
            }
        };
        Ok(Self {
            fast: ComplianceEstimator::new(JointEstimatorParameters {
                low_pass_pole: 0.0,
                ..joint.estimator.clone()
            }),
            compensator: DelayCompensator::new(DelayCompensatorParameters {
                sample_period: DT,
                kernel: quick.kernel(),
                fast_sigma: c.k_fs0 * counts / 12_f64.sqrt(),
                torque_limit: joint.limits.torque,
                stands_within: joint.limits.gives_way,
                gain: 1.0,
                error_per_angle: 600.0,
            }),
            quick,
            controller,
            rated,
            rig,
            joint,
            late: VecDeque::from(vec![0.0; WINDOW]),
            on_the_way: VecDeque::new(),
            noise: Draw(77),
            sample,
            cycle: 0,
        })
    }

    /// Time since the start, s.
    pub(crate) fn time(&self) -> f64 {
        self.cycle as f64 * DT
    }

    /// The link moves at this velocity, rad/s, whatever the torque.
    pub(crate) fn move_link(&mut self, dq: f64) {
        self.rig.set_velocity(dq);
    }

    /// One cycle with this desired torque; the true torque one period later.
    pub(crate) fn step(&mut self, tau_d: f64) -> f64 {
        self.step_by(|_| Wish::Torque(tau_d))
    }

    /// q of the link, rad.
    pub(crate) fn angle(&self) -> f64 {
        self.sample.truth.q
    }

    /// One cycle with what is wished for by what is seen; the true torque one period later.
    pub(crate) fn step_by(&mut self, wish: impl FnOnce(&Seen) -> Wish) -> f64 {
        let n = self.joint.estimator.gear_ratio;
        let per_current = n * self.joint.estimator.wave_generator.torque_constant;
        let reading = self.sample.reading;
        let compliance = self.fast.update(&JointSample {
            q: reading.q,
            theta: reading.theta,
            dq: self.sample.truth.dq,
            omega: self.sample.truth.omega,
            current: reading.current,
            feed_forward: None,
            flags: 0,
        });
        // As the delay compensation of the cycle.
        let fast = self.fast.undelayed().unwrap_or(compliance.tau);
        // F/T sensors and the robot's model: half a per cent wrong, and noisy.
        let noise = 0.0036 * self.rated * self.noise.normal();
        let late = self.sample.truth.tau * 1.005 + noise;
        self.late.push_back(late);
        self.late.pop_front();
        self.quick.update(&[late]);
        let delayed = DelayedTorque {
            tau: self.quick.values()[0],
            sigma: 0.0015 * self.rated,
        };
        let filled = self.cycle >= 30;
        let _ = (self.compensator).update(Some(fast), filled.then_some(delayed));
        let torque = self.compensator.levelled(0.0).unwrap_or(fast);
        let limit = self.joint.limits;
        let drive: &DriveModel = &self.joint.drive_model;
        // As the limiter of the cycle: beyond the lead of a torque that of a velocity.
        let lead = limit.lead + drive.friction_part(self.sample.truth.dq).abs();
        let command = match &mut self.controller {
            Controller::Predictive(law) => {
                law.observe(&Sensed {
                    theta: reading.theta / n,
                    q: reading.q,
                    torque: Some(torque),
                    motor_torque: Some(per_current * reading.current),
                    fresh: true,
                });
                let wish = wish(&Seen {
                    q: reading.q,
                    dq: law.link_velocity(),
                    torque: law.torque(),
                });
                let command = match wish {
                    Wish::Torque(feedforward) => {
                        let terms = TorqueTerms {
                            feedforward,
                            ..TorqueTerms::default()
                        };
                        let asked = law.command(&terms).command;
                        reading.q + (asked - reading.q).clamp(-lead, lead)
                    }
                    Wish::Position(command) => command,
                };
                law.sent(command);
                command
            }
            Controller::D {
                torque_loop,
                gains,
                velocity,
            } => {
                velocity.update(&[reading.q]);
                let dq = velocity.first_derivatives()[0];
                let torque = compliance.tau;
                let wish = wish(&Seen {
                    q: reading.q,
                    dq,
                    torque,
                });
                let tau_d = match wish {
                    Wish::Torque(tau_d) => tau_d,
                    // The drive's own loop.
                    Wish::Position(_) => 0.0,
                };
                let tau_hat = self.late.iter().sum::<f64>() / WINDOW as f64;
                let tau_star = torque_loop.update(tau_d, Some(tau_hat), gains, limit.torque, DT);
                let delta = drive.torque_part(tau_star) + drive.friction_part(dq);
                reading.q + delta.clamp(-lead, lead)
            }
        };
        self.on_the_way.push_back(command);
        if let Some(arriving) = self.on_the_way.pop_front() {
            self.rig.command(arriving);
        }
        self.sample = self.rig.advance(0.0);
        self.cycle += 1;
        self.sample.truth.tau
    }
}

fn sheet(joint: &JointParameters) -> DriveSheet {
    let e = &joint.estimator;
    let known = &e.kinematic_error;
    let pairs = |list: &[(f64, f64)]| list.iter().map(|(a, b)| [*a, *b]).collect();
    DriveSheet {
        kind: joint.kind,
        gear_ratio: e.gear_ratio,
        torque_constant: e.wave_generator.torque_constant,
        rotor_inertia: joint.rotor_inertia,
        motor_counts_per_turn: TAU / e.motor_resolution,
        link_counts_per_turn: TAU / e.link_resolution,
        command: Command::Position,
        kinematic_error: KinematicError {
            constant: known.a0,
            link: pairs(&known.link),
            link_frequency: known.w_link,
            motor: pairs(&known.motor),
            motor_frequency: known.w_motor,
        },
    }
}
