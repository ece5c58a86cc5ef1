//! What the motor's current shows of the drive: its stiffness and damping, and the integral of its velocity loop.

use super::drive_fit::DriveFit;
use super::observers::RotorStep;
use super::{LawParameters, PredictiveLaw, Sensed};

/// Quantities that follow from the drive's stiffness and damping.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Steps {
    /// Time within a period at which a command begins to act, and the rest of the period.
    pub(super) lag: RotorStep,
    pub(super) rest: RotorStep,
    /// Half a period: a command is computed for the middle of the time for which it acts.
    pub(super) half: RotorStep,
    /// Command per torque of the drive, rad/(N·m) or A/(N·m).
    pub(super) per_torque: f64,
    /// Share of the foreseen friction by what a measured motion turns the rotor by in a period, 1/rad.
    pub(super) per_sliding_way: f64,
}

impl Steps {
    pub(super) fn new(p: &LawParameters) -> Self {
        let (dt, (_, lag)) = (p.sample_period, p.delay_in_cycles());
        let step = |time: f64| RotorStep::new(p, time);
        Self {
            lag: step(lag),
            rest: step(dt - lag),
            half: step(0.5 * dt),
            per_torque: p.command_per_torque(),
            per_sliding_way: p.per_sliding_way(),
        }
    }
}

impl PredictiveLaw {
    /// The drive's stiffness and damping follow what its current shows of them.
    pub(super) fn fit_drive(&mut self, sensed: &Sensed) {
        let Some(fit) = &mut self.drive_fit else {
            return;
        };
        // `advance` leaves what acted until this sample in the place of the oldest command.
        let acts = self.commands.first().copied().unwrap_or(self.before);
        let drive = match sensed.motor_torque.filter(|_| sensed.fresh) {
            Some(torque) => fit.update(sensed.theta, torque - self.integral, acts.command),
            None => {
                fit.interrupt();
                None
            }
        };
        if let Some(drive) = drive {
            self.parameters.drive = drive;
            self.steps = Steps::new(&self.parameters);
        }
    }

    /// Staggers the corrections: of many joints, each with its index, not all correct their drives in the same cycle.
    #[must_use]
    pub fn staggered(mut self, index: usize) -> Self {
        if let Some(fit) = &mut self.drive_fit {
            fit.stagger(index);
        }
        self
    }

    /// Shares by which the drive's stiffness and damping differ from the configured ones, as its currents
    /// show.
    #[must_use]
    pub fn drive_correction(&self) -> [f64; 2] {
        self.drive_fit.map_or([0.0; 2], |fit| fit.applied())
    }

    /// z: torque of the integral in the drive's velocity loop, N·m; 0 of a drive without one.
    #[must_use]
    pub fn drive_integral_torque(&self) -> f64 {
        self.integral
    }

    /// The drive makes torque without a lead: its velocity loop has an integral that is not configured.
    #[must_use]
    pub fn drive_integrates(&self) -> bool {
        self.drive_fit.as_ref().is_some_and(DriveFit::integrates)
    }

    /// Model mismatch: for some seconds the currents have shown a drive that no correction of the configured one
    /// explains.
    #[must_use]
    pub fn drive_is_unlike(&self) -> bool {
        self.drive_fit.as_ref().is_some_and(DriveFit::is_unlike)
    }
}
