//! Limits of a joint: position, velocity, torque, power, lead of the command.

use super::Reader;
use crate::drives::Drive;
use crate::reader::Allowed;
use crate::wiring::Reach;
use control::DriveModel;
use dynamics::Model;
use supervisor::{Braking, FollowingParameters, Limits, PlausibilityParameters};

/// |dq| below which a joint counts as at rest, rad/s of a revolute joint.
const REST: f64 = 0.02;
/// Greatest angle by which a held set-point gives way, rad of a revolute joint: half of what counts as
/// motion.
const GIVES_WAY: f64 = 0.5 * core::f64::consts::PI / 180.0;
/// Default time in which a joint stops from its greatest velocity, s.
const STOPPING_TIME: f64 = 0.2;
/// Default time in which a torque may rise from zero to its limit, s.
const TORQUE_RISE_TIME: f64 = 0.05;
/// Sample periods in which braking takes a rotor's speed: as hard as the delay of the velocity's
/// filter, of 7.5 periods, allows.
const BRAKING_PERIODS: f64 = 12.0;
/// Greatest torsion over that of the torque limit: gears are softer than their catalogue.
const TORSION_MARGIN: f64 = 1.5;
/// Torsion that kinematic error, backlash and encoder offsets may add, rad of a revolute joint.
const TORSION_OFFSET: f64 = 0.1 * core::f64::consts::PI / 180.0;
/// A torque that appears from one sample to the next and stays is an encoder's step from this
/// share of the torque limit on.
const STEP_SHARE: f64 = 0.15;
/// Share of that from which on a sample alone is not used: a joint that nothing but a torque holds feels one of half
/// a step.
const BESIDE_SHARE: f64 = 0.4;
/// Period of samples for which that holds, s: an impact changes the velocities of the gear's ends, and with longer
/// periods the torsion by as much more until the next sample.
const STEP_PERIOD_S: f64 = 1e-3;
/// Torque that may act on a rotor at most, over the torque limit: a motor that pushes with its own
/// against a gear that is hit with twice as much.
const IMPACT: f64 = 3.0;
/// Counts of noise in the second difference of an angle.
const STEP_COUNTS: f64 = 6.0;
/// Share of the greatest way in a sample by which an angle is off its course after each reading that
/// jumped by more than that way, if it has stepped; the rest is what torque can make of its velocity.
const JUMP_SHARE: f64 = 0.5;
/// Share of the torque limit by which the torque of a motor that stands still may change beyond what
/// friction holds.
const STANDSTILL_SHARE: f64 = 0.05;
/// Following error from which on a drive does not follow: this share of the lead by which its
/// stiffness makes the torque limit, and of the lead by which it makes a velocity. What the model of
/// the drive and its friction explain stays below a third of it (measured, shipped robots); a drive
/// that does not act at all reaches the whole.
const FOLLOWING_SHARE: f64 = 0.5;
/// Following error that is doubtful while a client's torque is followed: this share of the torque
/// limit's lead, and this one of the lead that the drive's torque needs, for an error of the drive's
/// stiffness; for so many cycles.
const DOUBT_SHARE: f64 = 0.12;
const DOUBT_PER_LEAD: f64 = 0.35;
const DOUBT_SAMPLES: u32 = 5;
/// Cycles for which a doubtful error counts at most where the motor's encoder is the only one: it is the drive's
/// own, and an error of it sets the joint in motion.
const DOUBT_COUNTS_ALONE: f64 = 2.5;
/// The same of a current, as a share of the current limit, besides noise.
const CURRENT_SHARE: f64 = 0.1;
/// Standard deviations of the measured current that are noise.
const NOISE_SIGMAS: f64 = 6.0;
/// Velocity from which on a joint is too fast, as a share of its limit: braking at the limit may
/// overshoot it.
const OVERSPEED: f64 = 1.25;
/// Default velocity limit of mode torque, as a share of the joint's: a torque whose load is let go
/// accelerates the joint until something ends it.
const TORQUE_VELOCITY_SHARE: f64 = 0.25;
/// The same where nothing contradicts the motor's encoder, nor F/T sensors at once: an error of either moves the
/// joint at that velocity.
const TORQUE_VELOCITY_SHARE_ALONE: f64 = 0.07;
/// Torque that may brake a rotor without an impact: this share of the torque limit, and this many
/// times its friction.
const STOPS_BY: [f64; 2] = [0.5, 2.5];
/// Counts by which the noise of an encoder that stands moves its angle, of which it has one or two.
const STILL_COUNTS: f64 = 3.5;
/// Stiffness of a gear over K_fs0, as far as it stiffens up to its torque limit. Chosen; no experiment recorded.
const STIFFENS: f64 = 1.5;
/// Ways of an encoder's noise by which a set-point moves on before its motor has to turn. Chosen; no experiment recorded.
const ASKED_WAYS: f64 = 5.0;
/// Good samples in a row that make a joint plausible, and bad ones that make it implausible.
const SAMPLES: [u32; 2] = [100, 8];

impl Reader<'_, '_, '_> {
    pub(super) fn limits(
        &self,
        torque_limit: f64,
        drive: Option<&Drive>,
        (joint, inertia): (Option<(&Model, usize)>, f64),
    ) -> Option<Limits> {
        let section = self.section;
        let lead = section.optional_number("delta_q_limit_deg", Allowed::Positive);
        let velocity = section.optional_number("velocity_limit_rad_per_s", Allowed::Positive);
        let deceleration = section.optional_number("deceleration_rad_per_s2", Allowed::Positive);
        let torque_rate = section.optional_number("torque_rate_Nm_per_s", Allowed::Positive);
        let power = section.number_or("power_limit_W", f64::INFINITY, Allowed::Positive);
        let (min_deg, max_deg) = ("position_min_deg", "position_max_deg");
        // Without a model the limits cannot be checked, but the keys are known.
        let given = [min_deg, max_deg].map(|key| section.optional_number(key, Allowed::Finite));
        let (model, index) = joint?;
        let urdf = model.joint_limits(index)?;
        let kind = section.kind;
        let [min, max] = [(given[0], urdf.lower), (given[1], urdf.upper)]
            .map(|(given, urdf)| given.map_or(urdf, |given| kind.si(given)));
        // Limits in degrees or mm may exceed the URDF's by their rounding, rad or m.
        let rounding = 1e-6;
        let allowed = format!(
            "{:.3} to {:.3}, the URDF's limits",
            kind.shown(urdf.lower),
            kind.shown(urdf.upper)
        );
        for (key, value) in [(min_deg, min), (max_deg, max)] {
            if value < urdf.lower - rounding || value > urdf.upper + rounding {
                let what = format!("{:.3} is not allowed", kind.shown(value));
                section.problem(key, what, &allowed);
            }
        }
        if min >= max {
            let what = format!(
                "{:.3} is not above {}",
                kind.shown(max),
                kind.units(min_deg)
            );
            section.problem(max_deg, what, allowed);
        }
        let drive = drive?;
        let torque = torque_limit.min(urdf.effort);
        // Some programs write 0 for limits that nobody has entered: such a joint could not even be held.
        let limits = [
            ("torque_limit_Nm", "effort", urdf.effort),
            ("velocity_limit_rad_per_s", "velocity", urdf.velocity),
        ];
        for (key, attribute, _) in limits.into_iter().filter(|(.., limit)| *limit <= 0.0) {
            let what = format!("the URDF's {attribute} is 0");
            let allowed = format!("a <limit> whose {attribute} is above 0");
            section.problem(key, what, allowed);
        }
        let most = drive.max_velocity.min(urdf.velocity);
        let velocity = match velocity {
            Some(limit) if limit > most => {
                let what = format!("{limit} is not allowed");
                let unit = kind.units("rad/s");
                let whose = if most < drive.max_velocity {
                    "URDF"
                } else {
                    "drive"
                };
                let allowed = format!("at most the {whose}'s {most} {unit}");
                section.problem("velocity_limit_rad_per_s", what, allowed);
                limit
            }
            limit => limit.unwrap_or(most),
        };
        Some(Limits {
            position_min: min,
            position_max: max,
            velocity,
            deceleration: deceleration.unwrap_or(velocity / STOPPING_TIME),
            torque,
            torque_rate: torque_rate.unwrap_or(torque / TORQUE_RISE_TIME),
            power,
            lead: self.lead(lead, torque, drive),
            rest: kind.threshold(REST),
            gives_way: kind.threshold(GIVES_WAY),
            braking: self.braking(drive, inertia),
        })
    }

    /// Greatest |dq| in mode torque, rad/s or m/s.
    pub(super) fn torque_velocity(&self, limits: &Limits) -> f64 {
        let key = "torque_velocity_limit_rad_per_s";
        let given = self.section.optional_number(key, Allowed::Positive);
        let share = if self.has_link {
            TORQUE_VELOCITY_SHARE
        } else {
            TORQUE_VELOCITY_SHARE_ALONE
        };
        let velocity = given.unwrap_or(share * limits.velocity);
        if velocity > limits.velocity {
            let what = format!("{velocity} is not allowed");
            let unit = self.section.kind.units("rad/s");
            let allowed = format!("at most the velocity limit of {} {unit}", limits.velocity);
            self.section.problem(key, what, allowed);
        }
        velocity
    }

    /// Greatest lead of a command: that of the torque limit, or less.
    fn lead(&self, given: Option<f64>, torque: f64, drive: &Drive) -> f64 {
        let DriveModel::Position(drive) = drive.model else {
            return f64::INFINITY;
        };
        let greatest = drive.k_tau * torque;
        let kind = self.section.kind;
        let given = given.map_or(greatest, |given| kind.si(given));
        // A rounded degree or mm may lie a hair above.
        if given > greatest + 1e-6 {
            let what = format!(
                "{:.3} lets a command ask for {:.0} {}",
                kind.shown(given),
                given / drive.k_tau,
                kind.units("N·m")
            );
            let allowed = format!(
                "at most K_tau times the torque limit of {torque} {}, {:.4}, or no such key",
                kind.units("N·m"),
                kind.shown(greatest)
            );
            self.section.problem("delta_q_limit_deg", what, allowed);
        }
        given
    }

    /// Limits of the following error, by default from what the drive can do, and of the velocity.
    pub(super) fn following(
        &self,
        limits: &Limits,
        drive: &Drive,
        current: Option<Reach>,
    ) -> FollowingParameters {
        let section = self.section;
        let (used, other, limit, per_velocity, doubt) = match drive.model {
            DriveModel::Position(model) => {
                let lead = (model.k_tau_motor * limits.torque).min(limits.lead);
                let given = section.optional_number("following_error_deg", Allowed::Positive);
                let limit = given.map_or(FOLLOWING_SHARE * lead, |given| section.kind.si(given));
                let names = ["following_error_deg", "following_error_A"];
                let doubt = (DOUBT_SHARE * lead).min(limit);
                (
                    names[0],
                    names[1],
                    limit,
                    FOLLOWING_SHARE * model.k_v,
                    doubt,
                )
            }
            DriveModel::Current(model) => {
                let resolution = current.map_or(0.0, |reach| reach.resolution);
                let noise = NOISE_SIGMAS * drive.current_sigma + resolution;
                let default = CURRENT_SHARE * model.current_limit + noise;
                let limit = section.number_or("following_error_A", default, Allowed::Positive);
                let infinite = f64::INFINITY;
                (
                    "following_error_A",
                    "following_error_deg",
                    limit,
                    0.0,
                    infinite,
                )
            }
        };
        if section.has(other) {
            let what = "the joint's drive takes another kind of command";
            section.problem(other, what, used);
        }
        FollowingParameters {
            limit,
            per_velocity,
            velocity: OVERSPEED * limits.velocity,
            samples: (self.timing.stale_after / self.timing.sample_period).ceil() as u32,
            doubt,
            doubt_per_lead: DOUBT_PER_LEAD,
            doubt_samples: DOUBT_SAMPLES,
            doubt_counts: if self.has_link {
                1.0
            } else {
                DOUBT_COUNTS_ALONE
            },
        }
    }

    /// How the limiter brakes the joint; `inertia`: the greatest at the joint, without the rotor, kg·m².
    fn braking(&self, drive: &Drive, inertia: f64) -> Braking {
        if drive.model.takes_position() {
            return Braking::BY_DRIVE;
        }
        let rotor = drive.rotor_inertia * drive.gear_ratio * drive.gear_ratio;
        let delay = BRAKING_PERIODS * self.timing.sample_period;
        let damping = rotor / delay;
        Braking {
            damping,
            time: 8.0 * (rotor + inertia) / damping + delay,
            return_time: 2.0 * delay,
        }
    }

    /// Notes a K_tau that is all the gear's: it leaves no stiffness to the drive's position loop.
    pub(super) fn check_stiffness(&self, drive: &Drive) {
        let DriveModel::Position(model) = drive.model else {
            return;
        };
        let (k_tau, gear) = (model.k_tau, 1.0 / drive.compliance.k_fs0);
        if !self.has_link || gear < k_tau {
            return;
        }
        let key = self.section.kind.units("K_tau_rad_per_Nm");
        let what =
            format!("{key} of its drive: {k_tau} leaves no stiffness to the drive's position loop");
        let allowed = format!("above 1/K_fs0, which is {gear:e}");
        self.section.problem("drive", what, allowed);
    }
}

/// Range and rate of the torsion that a joint's gear can reach; `inertia`: the greatest at the joint, without the rotor.
pub(super) fn plausibility(
    limits: &Limits,
    (drive, has_link, inertia): (&Drive, bool, f64),
    [motor_resolution, link_resolution]: [f64; 2],
    sample_period: f64,
) -> PlausibilityParameters {
    let rotor = drive.rotor_inertia * drive.gear_ratio * drive.gear_ratio;
    let gear = &drive.compliance;
    let wave_generator = 1.0 / (gear.c_wg * gear.k_wg0 * drive.gear_ratio);
    let wound_up = limits.torque / gear.k_fs0;
    let wave_generator = if wave_generator.is_finite() {
        wave_generator
    } else {
        0.0
    };
    let step = (STEP_SHARE * (sample_period / STEP_PERIOD_S).max(1.0)).min(1.0) * wound_up;
    let counts = motor_resolution / drive.gear_ratio + link_resolution;
    let friction = drive.gear_ratio * drive.wave_generator.friction;
    let still = [motor_resolution, link_resolution].map(|count| STILL_COUNTS * count);
    PlausibilityParameters {
        torsion: TORSION_MARGIN * (wound_up + wave_generator)
            + drive.kind.threshold(TORSION_OFFSET),
        step,
        beside: (BESIDE_SHARE * step).max(STEP_COUNTS * counts).min(step),
        motor_step: if drive.sampling.is_at_sync() {
            IMPACT * limits.torque / rotor * sample_period * sample_period
                + STEP_COUNTS * motor_resolution / drive.gear_ratio
        } else {
            f64::INFINITY
        },
        jump: JUMP_SHARE * drive.max_velocity * sample_period,
        stop_way: if drive.sampling.is_at_sync() {
            let torque = STOPS_BY[0] * limits.torque + STOPS_BY[1] * friction;
            drive.gear_ratio * torque / rotor * sample_period * sample_period
                + STEP_COUNTS * motor_resolution
        } else {
            f64::INFINITY
        },
        still,
        samples_to_trust: SAMPLES[0],
        samples_to_doubt: SAMPLES[1],
        friction,
        holds_itself: drive.model.takes_position(),
        torsion_shows: if has_link {
            STIFFENS * gear.k_fs0 * (still[0] / drive.gear_ratio + still[1])
        } else {
            f64::INFINITY
        },
        motor_shows: if has_link {
            f64::INFINITY
        } else {
            STIFFENS * gear.k_fs0 * still[0] / drive.gear_ratio
        },
        asked: ASKED_WAYS * still[0] / drive.gear_ratio,
        hidden: if has_link {
            0.0
        } else {
            let way = still[0] / drive.gear_ratio;
            way * (rotor + inertia) / (sample_period * sample_period)
        },
        torque_margin: STANDSTILL_SHARE * limits.torque
            + NOISE_SIGMAS
                * drive.current_sigma
                * drive.gear_ratio
                * drive.wave_generator.torque_constant,
    }
}
