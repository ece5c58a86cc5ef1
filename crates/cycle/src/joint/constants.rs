//! Constants of one joint, and what its drive makes of its measured values, whatever its mode and law.

use control::predictive::TorqueTerms;
use control::{DriveModel, JointGains};
use robot_state::{JointCommanded, JointMeasured, torque_flags};
use supervisor::{Limits, Motion, Shown};

use super::JointInput;
use super::carry::{CarryParameters, smaller};
use super::sample_gap::Known;
use crate::mode::{Follow, Foresight, Impedance};

/// Share of the torque limit that a drive's damping must make of a velocity by which a filter is late, before an observer
/// is believed. Chosen on a simulated robot that shares no code (benches/drawn-joints): without it a hand at 0.5 rad/s is
/// held up until the check of encoders faults. With a quarter of it the simulated humanoid turns by 4.6 degrees as it
/// steps; with half of it a knee of the leg whose encoders both stop at 1 rad/s turns by 7.7 degrees.
const LATE_SHARE: f64 = 0.2;

#[derive(Debug, Clone)]
pub(super) struct Constants {
    pub(super) drive: DriveModel,
    pub(super) gains: JointGains,
    pub(super) limits: Limits,
    pub(super) gear_ratio: f64,
    /// Without an encoder on its link a joint is where its motor is: commands lead the motor-side angle.
    pub(super) has_link_encoder: bool,
    /// Motor torque per current, link side, N·m/A.
    pub(super) torque_per_current: f64,
    /// Way of the rotor within a sample period for a torque from rest, link side, rad/(N·m).
    pub(super) way_per_torque: f64,
    /// Greatest |dq| in mode torque, rad/s.
    pub(super) torque_velocity: f64,
    /// Friction that the loop adds in mode torque, N·m.
    pub(super) rest_friction: f64,
    /// Friction that the loop adds to a joint that is let go, N·m.
    pub(super) let_go_friction: f64,
    /// Standard deviations of the torque that it adds to that, as nothing has measured the level of this torque.
    pub(super) unknown_level: f64,
}

impl Constants {
    pub(super) fn motion(&self, input: &JointInput<'_>) -> Motion {
        let measured = input.measured;
        let (theta, omega) = (
            measured.theta / self.gear_ratio,
            measured.omega / self.gear_ratio,
        );
        let (q, dq) = if self.has_link_encoder {
            // The velocity that both encoders agree on.
            (measured.q, smaller(measured.dq, omega))
        } else {
            // By no torque of F/T sensors: a sensor that fails must not move the joint.
            (theta, omega)
        };
        Motion {
            q,
            theta,
            dq,
            weight: input.weight,
        }
    }

    /// The motion at velocities that no filter knows, after a gap of samples; that of drives that take currents is left,
    /// as their damping needs a smooth one.
    pub(super) fn moving_at(&self, known: Known, motion: Motion) -> Motion {
        let (Known::Before([link, motor]) | Known::After([link, motor])) = known else {
            return motion;
        };
        let dq = match (&self.drive, self.has_link_encoder) {
            (DriveModel::Current(_), _) => motion.dq,
            (DriveModel::Position(_), true) => smaller(link, motor),
            (DriveModel::Position(_), false) => motor,
        };
        Motion { dq, ..motion }
    }

    /// The drive's own signal: by each encoder the position plus the lead of torque and velocity, rad; of
    /// a drive that takes currents its current, A.
    pub(super) fn shown(
        &self,
        measured: &JointMeasured,
        motion: &Motion,
        after_gap: Option<[f64; 2]>,
        integral: f64,
        period: f64,
    ) -> Shown {
        let filtered = [measured.dq, measured.omega / self.gear_ratio];
        let [dq, omega] = after_gap.unwrap_or(filtered);
        let (set_points, lead, lag, torque_way) = match &self.drive {
            DriveModel::Position(drive) => {
                let tau = self.torque_per_current * measured.current - integral;
                let lead = drive.k_tau_motor * tau;
                //= D6: delta_q = K_tau tau + K_v dq + K_c sign(dq)
                let set_points = [
                    motion.theta + lead + drive.k_v * omega,
                    motion.q + drive.k_tau * tau + drive.k_v * self.velocity(dq, omega),
                ];
                (
                    set_points,
                    lead,
                    drive.k_v * omega,
                    self.way_per_torque * tau,
                )
            }
            DriveModel::Current(_) => ([measured.current; 2], 0.0, 0.0, 0.0),
        };
        Shown {
            set_points,
            velocity: motion.dq,
            motor_velocity: omega,
            lead,
            lag,
            angles: [motion.theta, motion.q],
            torque_way,
            period,
            followed: false,
            blind: false,
        }
    }

    /// The motor's velocity by an observer, rad/s, as far as its damping makes more than a share of the torque limit of
    /// what the filter is late by; none of a drive that takes currents. Less is the observer's noise.
    pub(super) fn quick_velocity(&self, observed: f64, motion: &Motion) -> Option<f64> {
        let DriveModel::Position(drive) = &self.drive else {
            return None;
        };
        let noise = LATE_SHARE * self.limits.torque * drive.k_tau_motor / drive.k_v.max(1e-9);
        let late = observed - motion.dq;
        Some(motion.dq + late - late.clamp(-noise, noise))
    }

    /// By the link side's encoder where there is one, else by the motor's, rad/s.
    pub(super) fn velocity(&self, dq: f64, omega: f64) -> f64 {
        if self.has_link_encoder { dq } else { omega }
    }

    /// The torque that the joint carries where it stands, as far as it is known, N·m.
    pub(super) fn load(&self, input: &JointInput<'_>) -> f64 {
        let tau = input.tau_encoder;
        match (&self.drive, tau.flags & torque_flags::VALID != 0) {
            // The lead that the drive holds already, whatever the torque is: none while it is off.
            (DriveModel::Position(_), _) if !self.has_link_encoder => {
                self.torque_per_current * input.measured.current
            }
            (DriveModel::Position(_), true) => tau.tau,
            _ => 0.0,
        }
    }

    pub(super) fn carry_parameters(&self) -> CarryParameters {
        let (k_1, damping) = match &self.drive {
            DriveModel::Current(drive) => (drive.k_1, self.limits.braking.damping),
            DriveModel::Position(_) => (1.0, 0.0),
        };
        CarryParameters {
            k_s: self.gains.k_s,
            k_d: self.gains.k_d,
            damping,
            k_1,
            torque: self.limits.torque,
            rest: self.limits.rest,
        }
    }

    pub(super) fn hold_position(
        &self,
        hold_q: f64,
        motion: &Motion,
        commanded: &mut JointCommanded,
    ) -> f64 {
        let delta_q = hold_q - motion.q;
        *commanded = JointCommanded {
            delta_q,
            feedback_position: delta_q,
            ..JointCommanded::default()
        };
        hold_q
    }

    /// Share of the desired motion that the joint is going to make.
    pub(super) fn foreseen_share(&self, foresight: Foresight, impedance: Impedance) -> f64 {
        match foresight {
            Foresight::None => 0.0,
            Foresight::All => 1.0,
            Foresight::ByDamping if self.gains.k_d > 0.0 => {
                (impedance.damping / self.gains.k_d).min(1.0)
            }
            Foresight::ByDamping => 0.0,
        }
    }

    /// Terms that follow a position and a velocity, rad and rad/s, by the torque of the rigid bodies; `dq`: velocity
    /// of the link, rad/s.
    pub(super) fn tracking_terms(
        &self,
        follow: &Follow,
        impedance: Impedance,
        [q_d, dq_d]: [f64; 2],
        (q, dq): (f64, f64),
    ) -> TorqueTerms {
        let torque = &follow.torque;
        // Position feedback uses the newest sample: docs/decisions, 3.
        TorqueTerms {
            feedforward: torque.feedforward,
            force: torque.force_feedback,
            position: impedance.stiffness * (q_d - q) + torque.frame_position,
            velocity: impedance.damping * (dq_d - dq) + torque.frame_velocity,
        }
    }
}
