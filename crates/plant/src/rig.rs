//! A test bench for one joint: a pendulum on the gear's output, with an external torque on it.

use crate::articulated::GRAVITY;
use crate::controller::SetPoint;
use crate::drive::{DriveReading, DriveSheet};
use crate::joint::Joint;
use crate::parameters::DriveParameters;
use crate::random::Random;
use crate::truth::JointTruth;

/// The pendulum on the gear's output; at q = 0 it hangs straight down.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RigLoad {
    /// Inertia about the joint's axis, kg·m².
    pub inertia: f64,
    /// Mass, kg.
    pub mass: f64,
    /// Distance of the centre of mass from the axis, m.
    pub arm: f64,
}

/// Time steps of the bench.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RigTiming {
    /// Time between samples, s.
    pub period: f64,
    /// Steps of the simulation in a period.
    pub substeps: usize,
}

/// One sample of the bench.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RigSample {
    /// Readings of the drive's sensors.
    pub reading: DriveReading,
    /// The true quantities.
    pub truth: JointTruth,
}

/// A joint on its test bench.
#[derive(Debug, Clone)]
pub struct JointRig {
    joint: Joint,
    load: RigLoad,
    timing: RigTiming,
    control_every: u64,
    steps_done: u64,
    q: f64,
    dq: f64,
    /// External torque at the end of the last period, N·m.
    external: f64,
    /// Between world and link: stiffness, N·m/rad, damping, N·m·s/rad, angle at rest, rad.
    spring: [f64; 3],
}

impl JointRig {
    /// A joint at rest at `q`, holding its load.
    #[must_use]
    pub fn new(
        sheet: &DriveSheet,
        drive: &DriveParameters,
        load: RigLoad,
        timing: RigTiming,
        q: f64,
        seed: u64,
    ) -> Self {
        let mut joint = Joint::new(sheet, drive, Random::new(seed, 0));
        let timing = RigTiming {
            substeps: timing.substeps.max(1),
            ..timing
        };
        let dt = timing.period / timing.substeps as f64;
        joint.settle(q, load.weight(q));
        Self {
            control_every: joint.control_every(dt),
            joint,
            load,
            timing,
            steps_done: 0,
            q,
            dq: 0.0,
            external: 0.0,
            spring: [0.0; 3],
        }
    }

    /// Sets the drive's set point: rad (link side) or A.
    pub fn command(&mut self, set_point: f64) {
        self.joint.command(SetPoint::Value(set_point));
    }

    /// The set point that the drive follows.
    #[must_use]
    pub fn set_point(&self) -> f64 {
        self.joint.set_point()
    }

    /// Puts a spring (N·m/rad) and a damper (N·m·s/rad) between world and link, at rest at `q`.
    pub fn set_spring(&mut self, stiffness: f64, damping: f64, q: f64) {
        self.spring = [stiffness, damping, q];
    }

    /// Gives the link a velocity, rad/s: with a very large inertia a hand that moves it.
    pub fn set_velocity(&mut self, dq: f64) {
        self.dq = dq;
    }

    /// Advances by one period, over which the external torque on the link along +q goes linearly
    /// to `external`, N·m.
    pub fn advance(&mut self, external: f64) -> RigSample {
        let dt = self.timing.period / self.timing.substeps as f64;
        let before = self.external;
        let mut truth = JointTruth::default();
        for k in 1..=self.timing.substeps {
            let part = k as f64 / self.timing.substeps as f64;
            truth = self.step(before + part * (external - before), dt);
        }
        self.external = external;
        RigSample {
            reading: self.joint.sense(0.0, dt),
            truth,
        }
    }

    fn step(&mut self, external: f64, dt: f64) -> JointTruth {
        if self.steps_done.is_multiple_of(self.control_every) {
            self.joint.control(self.control_every as f64 * dt);
        }
        self.steps_done += 1;
        let (q, dq) = (self.q, self.dq);
        let (tau, armature) = self.joint.prepare(q, dq, dt);
        let [stiffness, damping, rest] = self.spring;
        let outside = external - stiffness * (q + dt * dq - rest) - damping * dq;
        let inertia = self.load.inertia + armature + dt * (damping + dt * stiffness);
        let ddq = (tau + outside - self.load.weight(q)) / inertia;
        self.joint.commit(q, dq, ddq, dt);
        self.dq += dt * ddq;
        self.q += dt * self.dq;
        self.joint.truth(q, dq, ddq)
    }
}

impl RigLoad {
    /// Torque that holds the load at `q`, N·m.
    #[must_use]
    pub fn weight(&self, q: f64) -> f64 {
        self.mass * GRAVITY * self.arm * q.sin()
    }
}
