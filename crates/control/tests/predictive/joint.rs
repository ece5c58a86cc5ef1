//! A joint of its own in front of the law: continuous rotor, gear and drive, simulated at 20 us.

use control::predictive::{
    Design, DriveLoop, FrictionModel, GearStiffness, LawParameters, PredictiveLaw, Sensed,
    TorqueTerms,
};

pub(crate) const DT: f64 = 1e-3;

/// The knee of the leg.
pub(crate) fn knee() -> LawParameters {
    LawParameters {
        sample_period: DT,
        delay: 1.4e-3,
        drive: DriveLoop::Position {
            stiffness: 28_900.0,
            damping: 189.0,
            dead_zone: 0.0,
            integral: 0.0,
        },
        rotor_inertia: 1.5,
        gear: GearStiffness::constant(57_000.0),
        friction: FrictionModel::NONE,
        torque_limit: 233.0,
        disturbance_limit: 55.0,
        design: Design::default(),
    }
}

/// Friction on the rotor.
#[derive(Clone, Copy)]
pub(crate) enum Friction {
    None,
    /// Bristles of this stiffness that slide at this torque (N·m/rad, N·m): a resting rotor sticks.
    Bristles(f64, f64),
    /// This torque (N·m) against any motion, less of it below 1 mrad/s: a resting rotor creeps.
    Creep(f64),
}

/// A joint: rotor with friction, gear, drive, and a link that is blocked, moved or free.
pub(crate) struct Joint {
    pub(crate) p: LawParameters,
    pub(crate) friction: Friction,
    /// Bend of the bristles, rad.
    pub(crate) bend: f64,
    pub(crate) link_inertia: f64,
    pub(crate) theta: f64,
    pub(crate) omega: f64,
    pub(crate) q: f64,
    pub(crate) dq: f64,
    pub(crate) command: f64,
    pub(crate) on_the_way: Vec<f64>,
    /// Torque of the integral in the drive's velocity loop, N·m.
    pub(crate) wound: f64,
    /// Torque of the motor's current, N·m, and whether the drive reports it.
    pub(crate) motor: f64,
    pub(crate) reports: bool,
}

impl Joint {
    pub(crate) fn new(p: LawParameters, link_inertia: f64, delay_cycles: usize) -> Self {
        Self {
            p,
            friction: Friction::None,
            bend: 0.0,
            link_inertia,
            theta: 0.0,
            omega: 0.0,
            q: 0.0,
            dq: 0.0,
            command: 0.0,
            on_the_way: vec![0.0; delay_cycles],
            wound: 0.0,
            motor: 0.0,
            reports: false,
        }
    }

    pub(crate) fn torque(&self) -> f64 {
        self.p.gear.at(0.0) * (self.theta - self.q)
    }

    pub(crate) fn sensed(&self) -> Sensed {
        Sensed {
            theta: self.theta,
            q: self.q,
            torque: Some(self.torque()),
            motor_torque: self.reports.then_some(self.motor),
            fresh: true,
        }
    }

    /// A cascade: P on the angle asks for a velocity, of whose error PI makes torque.
    fn drive_loop(&mut self, [stiffness, damping, rate]: [f64; 3], error: f64, h: f64) -> f64 {
        let velocity_error = stiffness / damping * error - self.omega;
        self.wound += h * rate * damping * velocity_error;
        damping * velocity_error + self.wound
    }

    pub(crate) fn rotor_friction(&mut self, h: f64) -> f64 {
        match self.friction {
            Friction::None => 0.0,
            Friction::Bristles(stiffness, level) => {
                let share = stiffness * self.bend * self.omega.signum() / level;
                self.bend += h * self.omega * (1.0 - share).max(0.0);
                stiffness * self.bend + 40.0 * self.omega
            }
            Friction::Creep(level) => level * (self.omega / 1e-3).tanh(),
        }
    }

    /// A period after `command` was computed. The drive's own lag of 0.4 ms is the hold of its loop.
    pub(crate) fn advance(&mut self, command: f64) {
        self.on_the_way.push(command);
        let arriving = self.on_the_way.remove(0);
        let h = 2e-5;
        for k in 0..50 {
            if k == 20 {
                self.command = arriving;
            }
            let motor = match self.p.drive {
                DriveLoop::Position {
                    stiffness,
                    damping,
                    dead_zone,
                    integral,
                } => {
                    let error = self.command - self.theta;
                    let outside = error - error.clamp(-dead_zone, dead_zone);
                    self.drive_loop([stiffness, damping, integral], outside, h)
                }
                DriveLoop::Current {
                    torque_constant,
                    viscous,
                } => torque_constant * self.command - viscous * self.omega,
            };
            self.motor = motor;
            let friction = self.rotor_friction(h);
            self.omega += h * (motor - friction - self.torque()) / self.p.rotor_inertia;
            self.dq += h * self.torque() / self.link_inertia;
            self.theta += h * self.omega;
            self.q += h * self.dq;
        }
    }
}

/// Torques of a blocked joint after each period, under the law.
pub(crate) fn run(
    law: &mut PredictiveLaw,
    joint: &mut Joint,
    desired: impl Fn(usize) -> f64,
    n: usize,
) -> Vec<f64> {
    (0..n)
        .map(|k| {
            law.observe(&joint.sensed());
            let command = law.command(&feedforward(desired(k))).command;
            law.sent(command);
            joint.advance(command);
            joint.torque()
        })
        .collect()
}

pub(crate) fn feedforward(torque: f64) -> TorqueTerms {
    TorqueTerms {
        feedforward: torque,
        ..TorqueTerms::default()
    }
}

pub(crate) const BLOCKED: f64 = 1e12;
