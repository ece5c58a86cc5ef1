//! The drive's own control loop: PD on the motor's angle with a dead zone (D5, D 3.2.1).

use crate::drive::{Command, DriveSheet};
use crate::parameters::ControllerParameters;
use std::f64::consts::TAU;

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
        }
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
                    0.0 => 0.0,
                    k_4 => current / k_4,
                };
                self.angle / self.gear_ratio + error + self.parameters.dead_zone * error.signum()
            }
        };
    }

    /// From now on the set point is where the motor stands, or no current.
    pub fn begin(&mut self) {
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
        let desired = match self.command {
            Command::Current => self.set_point,
            Command::Position => {
                let error = self.set_point - angle / self.gear_ratio;
                let outside = error - error.clamp(-p.dead_zone, p.dead_zone);
                //= D5: i = K_4 (q_d - q) - K_5 dq
                p.k_4 * outside - p.k_5 * self.velocity / self.gear_ratio
            }
        };
        self.current = desired.clamp(-p.current_limit, p.current_limit);
    }

    fn interpolated(&self, theta: f64) -> f64 {
        let count = TAU / self.parameters.interpolated_counts_per_turn;
        (theta / count).round() * count
    }
}
