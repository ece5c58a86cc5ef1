//! One joint's drive: motor, friction, gear, encoders and the drive's own control loop.
//!
//! ```text
//! J_m domega/dt = K_t i - friction(theta, omega, load) - T/N        rotor, motor side
//! T             = gear(theta/N - q - kinematic error) + damping     between gear and bearing
//! tau           = T - bearing(dq)                                   torque on the child link
//! ```
//! `tau` is the true torque: only gear and bearing act between parent and child about the axis.
//! An estimator from torsion determines `T`; one from external wrenches determines `tau`.

use crate::controller::{Controller, SetPoint};
use crate::drive::{DriveReading, DriveReport, DriveSheet};
use crate::drive_faults::DriveFaults;
use crate::drive_states::{self, DriveStates};
use crate::friction::{Bristle, BristleConstants, stribeck};
use crate::parameters::DriveParameters;
use crate::past::Past;
use crate::random::Random;
use crate::transmission::Transmission;
use crate::truth::JointTruth;
use std::f64::consts::TAU;

/// A joint's drive and gear.
#[derive(Debug, Clone)]
pub struct Joint {
    sheet: DriveSheet,
    parameters: DriveParameters,
    random: Random,
    /// This joint's own errors, drawn once.
    torque_constant: f64,
    current_offset: f64,
    current_gain: f64,
    ripple_phase: [f64; 2],
    motor_bristle: BristleConstants,
    bearing_bristle: BristleConstants,

    theta: f64,
    omega: f64,
    current: f64,
    torsion: f64,
    transmission: Transmission,
    /// Stretch of the gear's springs when the joint is put at rest, of their limits: what a past left.
    gear_past: f64,
    /// Angle by which the gear has slipped, link side, rad.
    slipped: f64,
    friction: Bristle,
    bearing: Bristle,
    controller: Controller,
    /// None: always on.
    states: Option<DriveStates>,
    /// Temperature of the winding, °C.
    winding: f64,
    /// What is wrong with the drive.
    faults: DriveFaults,
    /// Past theta and q as the encoders turned, one pair a step.
    past: Past<2>,

    step: Step,
    gear_torque: f64,
    tau: f64,
    /// Torque that an ideal source makes instead of motor, friction and gear, N·m.
    ideal: Option<f64>,
}

/// Results of `prepare` that `commit` needs.
#[derive(Debug, Clone, Copy, Default)]
struct Step {
    gear_torque: f64,
    gear_slope: f64,
    friction_level: f64,
    /// Torque on the rotor without acceleration, and its effective inertia over the step.
    drive: f64,
    rotor: f64,
    bearing_torque: f64,
    bearing_slope: f64,
}

/// Steps kept, for encoders that are sampled earlier or at different instants.
const PAST: usize = 256;

impl Joint {
    /// A joint with errors of its own drawn from `random`.
    #[must_use]
    pub fn new(sheet: &DriveSheet, parameters: &DriveParameters, mut random: Random) -> Self {
        let p = parameters;
        let stiffness = p.friction.coulomb * p.friction.static_ratio / p.friction.presliding;
        let bearing_stiffness = p.bearing.coulomb / sheet.kind.threshold(1e-4);
        Self {
            torque_constant: sheet.torque_constant
                * (1.0 + p.sensors.torque_constant * random.symmetric()),
            current_offset: p.sensors.current_offset * random.symmetric(),
            current_gain: 1.0 + p.sensors.current_gain * random.symmetric(),
            ripple_phase: [TAU * random.unit(), TAU * random.unit()],
            motor_bristle: BristleConstants {
                stiffness,
                damping: (stiffness * sheet.rotor_inertia).sqrt(),
                viscous: p.friction.viscous,
            },
            bearing_bristle: BristleConstants {
                stiffness: bearing_stiffness,
                damping: 1e-3 * bearing_stiffness,
                viscous: p.bearing.viscous,
            },
            theta: 0.0,
            omega: 0.0,
            current: 0.0,
            torsion: 0.0,
            transmission: Transmission::new(&p.transmission),
            gear_past: 0.0,
            slipped: 0.0,
            friction: Bristle::default(),
            bearing: Bristle::default(),
            controller: Controller::new(sheet, &p.controller),
            states: None,
            winding: p.winding.ambient,
            faults: DriveFaults::default(),
            past: Past::new(PAST),
            step: Step::default(),
            gear_torque: 0.0,
            tau: 0.0,
            ideal: None,
            sheet: sheet.clone(),
            parameters: p.clone(),
            random,
        }
    }

    /// Gives the gear a past: the stretch of its springs at the start, -1 to 1 of their limits.
    #[must_use]
    pub fn with_gear_past(mut self, past: f64) -> Self {
        self.gear_past = past;
        self
    }

    /// Gives the drive states: it is switched off, its brake is closed.
    #[must_use]
    pub fn with_states(mut self) -> Self {
        self.states = Some(DriveStates::new(&self.parameters.states));
        self
    }

    /// What is wrong with the drive, to change it.
    #[must_use]
    pub fn faults(&mut self) -> &mut DriveFaults {
        &mut self.faults
    }

    /// The drive's states, if it has any.
    #[must_use]
    pub fn states(&mut self) -> Option<&mut DriveStates> {
        self.states.as_mut()
    }

    /// The gear's teeth slip by an angle, link side, rad: the link goes on at `q` lower by it.
    pub fn slip_gear(&mut self, angle: f64) {
        self.slipped += angle;
    }

    /// An ideal source makes this torque from now on, N·m, instead of motor, friction and gear; only
    /// the bearing remains.
    pub fn drive_ideally(&mut self, torque: f64) {
        self.ideal = Some(torque);
    }

    /// The drive's data sheet.
    #[must_use]
    pub fn sheet(&self) -> &DriveSheet {
        &self.sheet
    }

    /// The greatest current of the drive, A.
    #[must_use]
    pub fn current_limit(&self) -> f64 {
        self.parameters.controller.current_limit
    }

    /// Lowers the greatest current that the drive asks for, A.
    pub fn limit_current(&mut self, limit: f64) {
        self.controller.limit(limit);
    }

    fn is_on(&self) -> bool {
        self.states.as_ref().is_none_or(DriveStates::is_enabled)
    }

    /// Puts the joint at rest at `q`, carrying `tau`: torsion, current and set point in balance.
    pub fn settle(&mut self, q: f64, tau: f64) {
        let n = self.sheet.gear_ratio;
        self.torsion = self.transmission.settle(tau, self.gear_past);
        self.theta = n * (q + self.torsion);
        for _ in 0..20 {
            self.theta = n * (q + self.torsion + self.kinematic_error(q, self.theta));
        }
        self.omega = 0.0;
        let current = tau / (n * self.torque_constant);
        self.current = if self.is_on() { current } else { 0.0 };
        (self.gear_torque, self.tau) = (tau, tau);
        self.past = Past::new(PAST);
        let DriveFaults { motor, link, .. } = &self.faults;
        self.past.push([motor.shown(self.theta), link.shown(q)]);
        let measured = current * self.current_gain + self.current_offset;
        self.controller.settle(self.theta, measured);
    }

    /// Sets the drive's set point; ignored while the drive is off.
    pub fn command(&mut self, set_point: SetPoint) {
        if let Some(states) = &mut self.states {
            states.note_set_point();
        }
        if self.is_on() || self.faults.keeps_target {
            let fault = &self.faults.set_point;
            match set_point {
                SetPoint::Value(x) => self.controller.set_point = fault.followed(x),
                SetPoint::Impedance(mut x) => {
                    x.position = fault.followed(x.position);
                    self.controller.follow(x);
                }
            }
        }
    }

    /// One period of the drive's own control loop, `dt` after the last.
    pub fn control(&mut self, dt: f64) {
        let enabled = self.states.as_mut().is_some_and(|states| states.tick(dt));
        match enabled {
            true if self.faults.keeps_target => self.controller.wake(),
            true => self.controller.begin(),
            false => {}
        }
        self.controller
            .tick(self.faults.motor.shown(self.theta), dt);
    }

    fn kinematic_error(&self, q: f64, theta: f64) -> f64 {
        let known = self.sheet.kinematic_error.at(q, theta);
        known + self.parameters.kinematic_error.at(q, theta) + self.slipped
    }

    /// Starts a step of `dt` with the link at `q`, `dq`. The torque on the link over the step is
    /// `tau - armature ddq`; returns both.
    pub fn prepare(&mut self, q: f64, dq: f64, dt: f64) -> (f64, f64) {
        if let Some(torque) = self.ideal {
            let (bearing_torque, bearing_slope) =
                (self.bearing).torque(&self.bearing_bristle, self.bearing_level(), dq, dt);
            self.step = Step {
                gear_torque: torque,
                bearing_torque,
                bearing_slope: dt * bearing_slope,
                ..Step::default()
            };
            return (torque - bearing_torque, dt * bearing_slope);
        }
        let n = self.sheet.gear_ratio;
        self.run_current_loop(dt);
        // Implicit step: forces at the predicted velocities, and their slopes.
        let (q_next, theta_next) = (q + dt * dq, self.theta + dt * self.omega);
        let torsion = theta_next / n - q_next - self.kinematic_error(q_next, theta_next);
        let (elastic, stiffness) = self.transmission.torque(torsion, torsion - self.torsion);
        let damping = self.transmission.damping();
        let gear_torque = elastic + damping * (self.omega / n - dq);
        let gear_slope = dt * (dt * stiffness + damping);

        let level = self.friction_level(q);
        let (friction, friction_slope) =
            (self.friction).torque(&self.motor_bristle, level, self.omega, dt);
        let drive = self.torque_constant * self.current - friction - gear_torque / n;
        let rotor = self.sheet.rotor_inertia + dt * friction_slope + gear_slope / (n * n);
        let (brake, brake_slope) = self.brake(drive, dt);
        let (drive, rotor) = (drive - brake, rotor + dt * brake_slope);

        let (bearing_torque, bearing_slope) =
            (self.bearing).torque(&self.bearing_bristle, self.bearing_level(), dq, dt);
        let bearing_slope = dt * bearing_slope;
        self.step = Step {
            gear_torque,
            gear_slope,
            friction_level: level,
            drive,
            rotor,
            bearing_torque,
            bearing_slope,
        };
        // The rotor's acceleration (drive + slope/N ddq) / rotor is eliminated from the link's equation.
        let through = gear_slope / n / rotor;
        (
            gear_torque + through * drive - bearing_torque,
            gear_slope - through * gear_slope / n + bearing_slope,
        )
    }

    /// Ends the step begun by `prepare`, the link having accelerated by `ddq`.
    pub fn commit(&mut self, q: f64, dq: f64, ddq: f64, dt: f64) {
        let (n, s) = (self.sheet.gear_ratio, self.step);
        let alpha = match self.ideal {
            // The rotor turns with the link.
            Some(_) => (n * (dq + dt * ddq) - self.omega) / dt,
            None => (s.drive + s.gear_slope / n * ddq) / s.rotor,
        };
        self.gear_torque = s.gear_torque + s.gear_slope * (alpha / n - ddq);
        self.tau = self.gear_torque - s.bearing_torque - s.bearing_slope * ddq;
        self.omega += dt * alpha;
        self.theta += dt * self.omega;
        let dq_next = dq + dt * ddq;
        let q_next = q + dt * dq_next;
        let torsion = self.theta / n - q_next - self.kinematic_error(q_next, self.theta);
        self.transmission.advance(torsion - self.torsion);
        self.torsion = torsion;
        (self.friction).advance(&self.motor_bristle, s.friction_level, self.omega, dt);
        let bearing_level = self.bearing_level();
        (self.bearing).advance(&self.bearing_bristle, bearing_level, dq_next, dt);
        self.faults.advance(dt);
        let DriveFaults { motor, link, .. } = &self.faults;
        self.past
            .push([motor.shown(self.theta), link.shown(q_next)]);
    }

    fn run_current_loop(&mut self, dt: f64) {
        // The drive regulates the reading of its sensor.
        let desired = if self.is_on() {
            (self.controller.current() - self.current_offset) / self.current_gain
        } else {
            0.0
        };
        let lag = self.parameters.controller.current_loop;
        self.current += (desired - self.current) * dt / (dt + lag);
        let p = &self.parameters.winding;
        let warm = p.ambient + p.rise * self.current * self.current;
        self.winding += (warm - self.winding) * dt / (dt + p.time_constant);
    }

    /// Torque of the brake against the rotor's motion, on which `others` acts, and its slope.
    fn brake(&self, others: f64, dt: f64) -> (f64, f64) {
        if !self.states.as_ref().is_some_and(DriveStates::is_braked) {
            return (0.0, 0.0);
        }
        // It holds twice what the motor can do; a brake that holds creeps by its slope.
        let limit = 2.0 * self.sheet.torque_constant * self.parameters.controller.current_limit;
        let slope = limit / 1e-3;
        let needed = self.sheet.rotor_inertia * self.omega / dt + others;
        if needed.abs() < limit {
            (slope * self.omega, slope)
        } else {
            (limit.copysign(needed), 0.0)
        }
    }

    fn friction_level(&self, q: f64) -> f64 {
        let f = &self.parameters.friction;
        let ripple = 1.0
            + 0.5
                * f.ripple
                * ((2.0 * self.theta + self.ripple_phase[0]).sin()
                    + (3.0 * q / self.sheet.kind.threshold(1.0) + self.ripple_phase[1]).sin());
        let sliding =
            f.coulomb * ripple + f.meshing * self.gear_torque.abs() / self.sheet.gear_ratio;
        stribeck(sliding, f.static_ratio * sliding, self.omega, f.stribeck)
    }

    fn bearing_level(&self) -> f64 {
        self.parameters.bearing.coulomb.max(1e-12)
    }

    /// Readings of the angles `ago` steps of `dt` before the last one, encoders quantised.
    pub fn sense(&mut self, ago: f64, dt: f64) -> DriveReading {
        let (s, random) = (&self.parameters.sensors, &mut self.random);
        let [earlier, _] = self.past.ago(ago + s.motor_lead / dt);
        let [_, q] = self.past.ago(ago);
        let round = |angle: f64, counts: f64, noise: f64| {
            (angle * counts / TAU + noise).round() * TAU / counts
        };
        DriveReading {
            theta: round(
                earlier,
                self.sheet.motor_counts_per_turn,
                s.motor_noise_counts * random.normal(),
            ),
            q: round(
                q,
                self.sheet.link_counts_per_turn,
                s.link_noise_counts * random.normal(),
            ),
            current: {
                let sensed = self.current * self.current_gain
                    + self.current_offset
                    + s.current_noise * random.normal();
                self.faults.current_reads.unwrap_or(sensed)
            },
            omega: self.controller.velocity(),
            status: (self.states.as_ref()).map_or(drive_states::ALWAYS_ON, DriveStates::status),
            report: self.report(),
        }
    }

    /// What the drive reports of itself besides.
    fn report(&self) -> DriveReport {
        let per_current = self.sheet.gear_ratio * self.sheet.torque_constant;
        DriveReport {
            temperature: self.winding.round(),
            voltage: self.parameters.winding.supply,
            torque: per_current * (self.current * self.current_gain + self.current_offset),
            error: self.states.as_ref().map_or(0, DriveStates::error),
        }
    }

    /// Sets the temperature of the winding, °C.
    pub fn set_temperature(&mut self, temperature: f64) {
        self.winding = temperature;
    }

    /// The true quantities over the last step, which the link began at `q`, `dq`.
    #[must_use]
    pub fn truth(&self, q: f64, dq: f64, ddq: f64) -> JointTruth {
        JointTruth {
            tau: self.tau,
            gear_torque: self.gear_torque,
            q,
            dq,
            ddq,
            theta: self.theta,
            omega: self.omega,
            current: self.current,
        }
    }

    /// Torque of the motor over the current that its sensor reads without offset, N·m/A.
    #[must_use]
    pub fn torque_of_current(&self) -> f64 {
        self.torque_constant / self.current_gain
    }

    /// The set point that the drive follows: rad (link side) or A.
    #[must_use]
    pub fn set_point(&self) -> f64 {
        self.controller.set_point
    }

    /// Steps of `dt` in a period of the drive's control loop.
    #[must_use]
    pub fn control_every(&self, dt: f64) -> u64 {
        (1.0 / (self.parameters.controller.rate * dt))
            .round()
            .max(1.0) as u64
    }
}
