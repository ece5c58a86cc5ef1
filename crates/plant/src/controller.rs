//! The drive's own control loop: PD on the motor's angle with a dead zone (D5, D 3.2.1), or a cascade of P on the angle
//! and PI on the velocity, as most drives of cyclic synchronous positions close it.

use crate::drive::{Command, DriveSheet};
use crate::parameters::ControllerParameters;
use std::f64::consts::TAU;

/// What a drive is asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SetPoint {
    /// Position, rad (link side), or current, A.
    Value(f64),
    /// A spring and a damper about a position, and a current besides.
    Impedance(Impedance),
}

/// `current = stiffness (position - q) + damping (velocity - dq) + feed_forward`, link side.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Impedance {
    /// Position, rad.
    pub position: f64,
    /// Velocity, rad/s.
    pub velocity: f64,
    /// A/rad.
    pub stiffness: f64,
    /// A·s/rad.
    pub damping: f64,
    /// A.
    pub feed_forward: f64,
}

/// A drive's control loop.
#[derive(Debug, Clone)]
pub struct Controller {
    parameters: ControllerParameters,
    command: Command,
    gear_ratio: f64,
    /// Desired position, rad (link side), or desired current, A.
    pub set_point: f64,
    angle: f64,
    velocity: f64,
    current: f64,
    /// Current of the velocity loop's integral, A.
    integral: f64,
    /// Of a drive that takes these instead.
    impedance: Option<Impedance>,
    /// Its limit of current, A, before anybody lowered it.
    own_limit: f64,
}

impl Controller {
    /// The loop at rest.
    #[must_use]
    pub fn new(sheet: &DriveSheet, parameters: &ControllerParameters) -> Self {
        Self {
            parameters: parameters.clone(),
            command: sheet.command,
            gear_ratio: sheet.gear_ratio,
            set_point: 0.0,
            angle: 0.0,
            velocity: 0.0,
            current: 0.0,
            integral: 0.0,
            impedance: None,
            own_limit: parameters.current_limit,
        }
    }

    /// Follows a spring and a damper from now on.
    pub fn follow(&mut self, impedance: Impedance) {
        self.impedance = Some(impedance);
    }

    /// Its current stays below its own limit and this one, A.
    pub fn limit(&mut self, current: f64) {
        self.parameters.current_limit = self.own_limit.min(current);
    }

    /// Settles the loop at motor angle `theta`, with the set point that commands `current`, A.
    pub fn settle(&mut self, theta: f64, current: f64) {
        self.angle = self.interpolated(theta);
        self.velocity = 0.0;
        self.current = current;
        self.set_point = match self.command {
            Command::Current => current,
            Command::Position => {
                let error = match self.parameters.k_4 {
                    _ if self.parameters.integral_time.is_some() => {
                        self.integral = current;
                        0.0
                    }
                    0.0 => 0.0,
                    k_4 => current / k_4,
                };
                self.angle / self.gear_ratio + error + self.parameters.dead_zone * error.signum()
            }
        };
    }

    /// The drive is switched on: its integral begins anew.
    pub fn wake(&mut self) {
        self.integral = 0.0;
    }

    /// From now on the set point is where the motor stands, or no current.
    pub fn begin(&mut self) {
        self.wake();
        self.set_point = match self.command {
            Command::Current => 0.0,
            Command::Position => self.angle / self.gear_ratio,
        };
    }

    /// Commanded current, A.
    #[must_use]
    pub fn current(&self) -> f64 {
        self.current
    }

    /// Filtered motor velocity, rad/s.
    #[must_use]
    pub fn velocity(&self) -> f64 {
        self.velocity
    }

    /// One period of the loop, `dt` after the last, at motor angle `theta`.
    pub fn tick(&mut self, theta: f64, dt: f64) {
        let p = &self.parameters;
        let angle = self.interpolated(theta);
        let raw = (angle - self.angle) / dt;
        self.velocity += (raw - self.velocity) * dt / (dt + p.velocity_filter);
        self.angle = angle;
        let desired = match (self.impedance, self.command) {
            (Some(x), _) => {
                let (q, dq) = (angle / self.gear_ratio, self.velocity / self.gear_ratio);
                x.stiffness * (x.position - q) + x.damping * (x.velocity - dq) + x.feed_forward
            }
            (None, Command::Current) => self.set_point,
            (None, Command::Position) => {
                let error = self.set_point - angle / self.gear_ratio;
                let outside = error - error.clamp(-p.dead_zone, p.dead_zone);
                let velocity = self.velocity / self.gear_ratio;
                match p.integral_time {
                    //= D5: i = K_4 (q_d - q) - K_5 dq
                    None => p.k_4 * outside - p.k_5 * velocity,
                    Some(time) => self.cascade(outside, velocity, dt / time),
                }
            }
        };
        let p = &self.parameters;
        self.current = desired.clamp(-p.current_limit, p.current_limit);
    }

    /// P on the position's error, rad, and PI on the error of the velocity that it asks for, `share` of which its
    /// integral takes up in a period, A. At the current's limit the integral stands.
    fn cascade(&mut self, error: f64, velocity: f64, share: f64) -> f64 {
        let p = &self.parameters;
        let position_gain = p.k_4 / p.k_5;
        let velocity_error = position_gain * error - velocity;
        let proportional = p.k_5 * velocity_error;
        let wound = self.integral + share * proportional;
        let saturates = (proportional + wound).abs() > p.current_limit;
        if !saturates || proportional * self.integral < 0.0 {
            self.integral = wound;
        }
        proportional + self.integral
    }

    fn interpolated(&self, theta: f64) -> f64 {
        let count = TAU / self.parameters.interpolated_counts_per_turn;
        (theta / count).round() * count
    }
}
