//! From a robot's configuration and the loop's records to what the identification of a drive takes.

use super::{DriveKnowledge, DriveLog, DriveStretch};
use crate::motor::MotorRow;
use control::predictive::DriveLoop;
use estimators::compliance::ComplianceParameters;
use estimators::kinematic_error::KinematicErrorParameters;
use robot_config::{JointParameters, Sampled};
use robot_state::{CycleRecord, command_flags, measured_flags};

/// Standard deviation of a torque constant, as a share of it: data sheets allow a few per cent.
const TORQUE_CONSTANT_SIGMA: f64 = 0.02;
/// Samples with one of these are not used.
const NOT_USED: u32 = measured_flags::NEVER
    | measured_flags::MISSED
    | measured_flags::STALE
    | measured_flags::JUMP
    | measured_flags::IMPLAUSIBLE;
/// A step longer than this many periods is a gap.
const GAP: f64 = 1.5;
/// Shortest stretch that is used, s.
const SHORTEST_S: f64 = 0.5;

/// Configured parameters of a joint's drive.
#[must_use]
pub fn knowledge(joint: &JointParameters) -> DriveKnowledge {
    let n = joint.encoders.gear_ratio;
    let motor = &joint.estimator.wave_generator;
    let (takes_position, stiffness, damping, dead_zone) = match joint.law.drive {
        DriveLoop::Position {
            stiffness,
            damping,
            dead_zone,
            ..
        } => (true, stiffness, damping, dead_zone),
        DriveLoop::Current { .. } => (false, 0.0, 0.0, 0.0),
    };
    // Samples that are late show every effect later by as much.
    let latency = match joint.sampling.sampled {
        Sampled::AtSync => joint.sampling.latency,
        Sampled::WhenSent { .. } => 0.0,
    };
    DriveKnowledge {
        gear_ratio: n,
        torque_constant: motor.torque_constant,
        torque_constant_sigma: TORQUE_CONSTANT_SIGMA,
        takes_position,
        stiffness,
        damping,
        dead_zone,
        integral: joint.law.drive_integral(),
        inertia: joint.rotor_inertia * n * n,
        gear_stiffness: joint.estimator.compliance.k_fs0,
        coulomb: motor.friction * n,
        viscous: motor.viscous_friction * n * n,
        delay: joint.law.delay,
        lag: joint.drive_lag,
        latency,
        motor_resolution: joint.estimator.motor_resolution,
    }
}

/// What a drive's log takes from a joint's records of one cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriveSample {
    /// Flags of what was measured, and of what was commanded.
    pub flags: [u32; 2],
    /// theta, q, torsion, rad; current, A.
    pub measured: [f64; 4],
    /// Position, rad, and current, A, that were sent.
    pub sent: [f64; 2],
    /// Age of the measured sample at the record's SYNC, s: negative for one that was taken later.
    pub age: f64,
}

impl DriveSample {
    /// Numbers of [`Self::to_array`].
    pub const LEN: usize = 9;

    /// A joint's sample of a record; `since_sync`: the time from SYNC to the record's now, s.
    #[must_use]
    pub fn of(record: &CycleRecord, joint: usize, since_sync: f64) -> Option<Self> {
        let measured = record.measured.joints.get(joint)?;
        let commanded = record.commanded.joints.get(joint)?;
        Some(Self {
            flags: [measured.flags, commanded.flags],
            measured: [
                measured.theta,
                measured.q,
                measured.torsion,
                measured.current,
            ],
            sent: [commanded.q_c, commanded.current_c],
            age: measured.age_s - since_sync,
        })
    }

    /// As numbers, exactly.
    #[must_use]
    pub fn to_array(&self) -> [f64; Self::LEN] {
        let ([a, b], [c, d, e, f], [g, h]) = (self.flags.map(f64::from), self.measured, self.sent);
        [a, b, c, d, e, f, g, h, self.age]
    }

    /// From what [`Self::to_array`] gave.
    #[must_use]
    pub fn from_array([a, b, c, d, e, f, g, h, age]: [f64; Self::LEN]) -> Self {
        Self {
            flags: [a as u32, b as u32],
            measured: [c, d, e, f],
            sent: [g, h],
            age,
        }
    }
}

/// Gathers a joint's log from records, in their order.
pub struct Gather {
    takes_position: bool,
    torque_limit: f64,
    gear_ratio: f64,
    compliance: ComplianceParameters,
    kinematic_error: KinematicErrorParameters,
    when_sent: Option<f64>,
    log: DriveLog,
    /// Ages of the samples of the present stretch, where they have a clock of their own.
    ages: Vec<f64>,
    last_t: f64,
    interrupted: bool,
}

impl Gather {
    /// For a joint.
    #[must_use]
    pub fn new(joint: &JointParameters, period: f64) -> Self {
        let known = joint.calibration.as_ref();
        let kinematic_error = known.map(|calibration| {
            let file = calibration.file();
            let error = file.kinematic_error_parameters();
            file.joint
                .radius
                .map_or(error.clone(), |r| error.at_radius(r))
        });
        Self {
            takes_position: joint.takes_position(),
            torque_limit: joint.limits.torque,
            gear_ratio: joint.encoders.gear_ratio,
            compliance: joint.estimator.compliance,
            kinematic_error: kinematic_error.unwrap_or(joint.estimator.kinematic_error.clone()),
            when_sent: match joint.sampling.sampled {
                Sampled::AtSync => None,
                Sampled::WhenSent { .. } => Some(joint.sampling.latency),
            },
            log: DriveLog {
                period,
                stretches: Vec::new(),
            },
            ages: Vec::new(),
            last_t: f64::NEG_INFINITY,
            interrupted: true,
        }
    }

    /// Takes a cycle: the instant of its SYNC, s, and the joint's sample.
    pub fn take(&mut self, t: f64, sample: &DriveSample) {
        let gap = t - std::mem::replace(&mut self.last_t, t) > GAP * self.log.period;
        let [theta, q, torsion, current] = sample.measured;
        let engaged = sample.flags[1] & command_flags::ENGAGED != 0;
        let measured = sample.flags[0] & NOT_USED == 0;
        if gap || !engaged || !measured {
            self.interrupted = true;
            if gap || !engaged {
                // This cycle itself begins nothing: without its set-point the next ones cannot be explained.
                return;
            }
        }
        if !measured {
            return;
        }
        if self.interrupted {
            self.finish_stretch();
            self.log.stretches.push(DriveStretch::default());
            self.interrupted = false;
        }
        let error = self.kinematic_error.error(q, theta);
        let torque = gear_torque(
            &self.compliance,
            self.gear_ratio,
            torsion - error,
            2.0 * self.torque_limit,
        );
        if let Some(stretch) = self.log.stretches.last_mut() {
            stretch.sent.push(if self.takes_position {
                sample.sent[0]
            } else {
                sample.sent[1]
            });
            stretch.theta.push(theta);
            stretch.q.push(q);
            stretch.current.push(current);
            stretch.torque.push(torque);
            if let Some(latency) = self.when_sent {
                self.ages.push(sample.age + latency);
            }
        }
    }

    fn finish_stretch(&mut self) {
        let ages = std::mem::take(&mut self.ages);
        let period = self.log.period;
        if let Some(s) = self.log.stretches.last_mut()
            && !ages.is_empty()
        {
            let t: Vec<f64> = (0..ages.len()).map(|k| k as f64 * period).collect();
            for values in [&mut s.theta, &mut s.q, &mut s.current, &mut s.torque] {
                at_sync(&t, &ages, values);
            }
        }
    }

    /// The log: its stretches that are long enough.
    #[must_use]
    pub fn end(mut self) -> DriveLog {
        self.finish_stretch();
        let shortest = (SHORTEST_S / self.log.period) as usize;
        self.log.stretches.retain(|s| s.theta.len() > shortest);
        self.log
    }
}

/// Torque that twists the gear by `torsion`, at first up to `limit`: flexspline and wave generator in
/// series, without friction (Z8-15), for a gear of ratio `n`.
#[must_use]
pub fn gear_torque(c: &ComplianceParameters, n: f64, torsion: f64, limit: f64) -> f64 {
    let twist = |tau: f64| c.flexspline_torsion(tau) + c.wave_generator_torsion(tau / n) / n;
    let (mut low, mut high) = (-limit, limit);
    if torsion <= twist(low) || torsion >= twist(high) {
        // Beyond: straight on, so that a zero that is wrong does not cut the signal.
        let end = limit.copysign(torsion);
        return end + (torsion - twist(end)) * c.k_fs0;
    }
    let mut tau = torsion * c.k_fs0 * 0.5;
    for _ in 0..60 {
        if !(low..=high).contains(&tau) {
            tau = 0.5 * (low + high);
        }
        let (here, step) = (twist(tau), 1e-6 * limit);
        if here < torsion {
            low = tau
        } else {
            high = tau
        }
        let next = tau - (here - torsion) * step / (twist(tau + step) - here);
        if (next - tau).abs() < 1e-9 * limit {
            return next;
        }
        tau = next;
    }
    tau
}

/// Rows for D's motor identification: command that acts, torque and velocity by centred filters, at most
/// so many rows.
#[must_use]
pub fn motor_rows(log: &DriveLog, known: &DriveKnowledge, most: usize) -> Vec<MotorRow> {
    /// Samples either side that torque and velocity are averaged over, s.
    const HALF_S: f64 = 5e-3;
    let half = ((HALF_S / log.period) as usize).max(1);
    // In whole periods, as D's model knows no finer delay.
    let delay = ((known.delay - known.lag) / log.period).round() as usize + 1;
    let samples: usize = log.stretches.iter().map(|s| s.theta.len()).sum();
    let step = samples.div_ceil(most).max(1);
    let mut rows = Vec::new();
    for s in &log.stretches {
        let (first, last) = (half.max(delay), s.theta.len().saturating_sub(half));
        for k in (first..last.max(first)).step_by(step) {
            let window = |x: &[f64]| x[k - half..=k + half].iter().sum::<f64>();
            let n = (2 * half + 1) as f64;
            // Slope of the line through the window (D 3.4.3).
            let moment = |x: &[f64]| -> f64 {
                let offsets = (0..=2 * half).map(|i| i as f64 - half as f64);
                offsets
                    .zip(&x[k - half..])
                    .map(|(o, x)| o * (x - s.q[k]))
                    .sum()
            };
            let spread = n * (n * n - 1.0) / 12.0;
            rows.push(MotorRow {
                tau: window(&s.torque) / n,
                dq: moment(&s.q) / (spread * log.period),
                command: if known.takes_position {
                    s.sent[k - delay] - s.q[k]
                } else {
                    s.current[k]
                },
            });
        }
    }
    rows
}

/// Samples that were taken `ages` before the instants `t`, by straight lines at `t`; the newest sample
/// holds where a later one is not there yet.
pub fn at_sync(t: &[f64], ages: &[f64], values: &mut [f64]) {
    let taken: Vec<f64> = t.iter().zip(ages).map(|(t, age)| t - age).collect();
    let samples = values.to_vec();
    let mut next = 0;
    for (i, value) in values.iter_mut().enumerate() {
        while next + 1 < taken.len() && taken[next] < t[i] {
            next += 1;
        }
        let Some(before) = next.checked_sub(1) else {
            continue;
        };
        let step = taken[next] - taken[before];
        if step > 0.0 && taken[next] >= t[i] {
            let share = (t[i] - taken[before]) / step;
            *value = samples[before] + share * (samples[next] - samples[before]);
        } else {
            *value = samples[next];
        }
    }
}
