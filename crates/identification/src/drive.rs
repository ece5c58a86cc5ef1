//! A joint's drive from a recording of its own motion: stiffness and damping of its position loop, dead
//! zone, rotor inertia, friction, and the delay from a command to its torque.
//!
//! In: set-points sent, motor angle, measured current and the gear's torque at the loop's rate, and what the
//! configuration states. Out: values with their standard deviations, from two equations of the same rotor,
//! all link side (`x = theta/N`):
//!
//! ```text
//! K_t N i = k_d zone(u(t - D) - x) - d_d x'           what the drive makes of its set-point
//! K_t N i = J x'' + T + friction(x, x', T)            what the rotor makes of its current
//! ```
//! A velocity loop with an integral (P-PI) makes more of it, which its current alone shows.
//! The first holds no friction and no load, so that k_d, d_d and the dead zone do not depend on a model
//! of either (regressing the torque on the set-point's error, as D 3.1.3 does, mixes them). The second
//! takes the measured current, so that J and friction do not depend on the drive's law.
//!
//! Samples show a set-point's step only in whole periods. Where within a period the current rises,
//! the rotor's motion between two samples shows: a coefficient of the second equation. Nothing
//! here is tuned to a kind of drive: scales follow from the encoder's count, the loop's period and the data.

pub mod chirp;
mod integral;
mod position_loop;
pub mod recorded;
mod rotor;
mod smooth;

use crate::blocks::Posterior;
use problem::{Problem, Problems};

/// One joint's signals at the loop's rate, in stretches without a gap.
#[derive(Debug, Clone, Default)]
pub struct DriveLog {
    /// T: time between samples, s.
    pub period: f64,
    /// Stretches without a gap.
    pub stretches: Vec<DriveStretch>,
}

/// Samples without a gap; all of the same length.
#[derive(Debug, Clone, Default)]
pub struct DriveStretch {
    /// u: set-point computed from this sample and sent, rad (link side) or A.
    pub sent: Vec<f64>,
    /// theta: motor angle, rad.
    pub theta: Vec<f64>,
    /// q: link angle, rad.
    pub q: Vec<f64>,
    /// i: measured current, A.
    pub current: Vec<f64>,
    /// T: torque of the gear on the link, N·m: of its torsion, or of the F/T sensors.
    pub torque: Vec<f64>,
}

/// Knowledge of the drive before the recording: data sheet and configuration, link side.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriveKnowledge {
    /// N: gear ratio.
    pub gear_ratio: f64,
    /// K_t: torque constant, motor side, N·m/A, taken as it is up to `torque_constant_sigma`.
    pub torque_constant: f64,
    /// Standard deviation of K_t, as a share of it.
    pub torque_constant_sigma: f64,
    /// The drive takes positions, not currents.
    pub takes_position: bool,
    /// k_d: stiffness of the position loop, N·m/rad.
    pub stiffness: f64,
    /// d_d: damping of the position loop, N·m·s/rad.
    pub damping: f64,
    /// Errors below it make no torque, rad.
    pub dead_zone: f64,
    /// 1/T_i: rate of the velocity loop's integral, 1/s; 0: it has none.
    pub integral: f64,
    /// J: rotor inertia, kg·m².
    pub inertia: f64,
    /// k: stiffness of the gear at rest, N·m/rad.
    pub gear_stiffness: f64,
    /// Coulomb friction, N·m.
    pub coulomb: f64,
    /// Viscous friction, N·m·s/rad.
    pub viscous: f64,
    /// D: time from a sample until the command computed from it makes torque, s.
    pub delay: f64,
    /// Part of it in which the drive's own loop answers, s: the age of the angle behind its current.
    pub lag: f64,
    /// Age of the samples of angles and current, s.
    pub latency: f64,
    /// One count of the motor encoder, motor side, rad.
    pub motor_resolution: f64,
}

/// A parameter after the recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Value {
    /// Most probable value.
    pub value: f64,
    /// Its standard deviation, what the data sheet leaves open included.
    pub sigma: f64,
    /// The configuration's value.
    pub configured: f64,
    /// Whether the recording determines it: otherwise it stays at the configured one, with that one's width.
    pub determined: bool,
}

/// Width of the 95 % interval in standard deviations.
const INTERVAL: f64 = 1.96;

impl Value {
    /// Ends of the 95 % interval.
    #[must_use]
    pub fn interval(&self) -> [f64; 2] {
        [-INTERVAL, INTERVAL].map(|width| self.value + width * self.sigma)
    }

    /// The same, or the configured value with a width of its own where the data leave more open than a share
    /// of that, or where they are not `enough`.
    fn or_configured(self, prior_sigma: f64, enough: bool) -> Self {
        let determined = enough && self.sigma < NARROWER * prior_sigma.max(self.value.abs());
        if determined {
            Self { determined, ..self }
        } else {
            Self {
                value: self.configured,
                sigma: prior_sigma,
                determined,
                ..self
            }
        }
    }

    /// The configured value lies outside of the interval, and by more than a share of it.
    #[must_use]
    pub fn disagrees(&self, share: f64) -> bool {
        let [least, most] = self.interval();
        let away = (self.value - self.configured).abs() > share * self.configured.abs();
        self.determined && away && !(least..=most).contains(&self.configured)
    }
}

/// A drive as its recording shows it, link side.
#[derive(Debug, Clone, PartialEq)]
pub struct Drive {
    /// k_d, N·m/rad; none of a drive that takes currents.
    pub stiffness: Option<Value>,
    /// d_d, N·m·s/rad.
    pub damping: Option<Value>,
    /// Dead zone, rad.
    pub dead_zone: Option<Value>,
    /// 1/T_i: rate of the integral in the velocity loop (P-PI), 1/s; zero where none shows.
    pub integral: Option<Value>,
    /// Measured over commanded current, of a drive that takes currents.
    pub gain: Option<Value>,
    /// J, kg·m².
    pub inertia: Value,
    /// Coulomb friction, N·m.
    pub coulomb: Value,
    /// Growth of the friction with the torque carried, 1.
    pub load: Value,
    /// Viscous friction, N·m·s/rad.
    pub viscous: Value,
    /// Viscous friction forwards less that backwards, halved, N·m·s/rad.
    pub asymmetry: Value,
    /// D: mean time from a sample until the command computed from it makes torque, s.
    pub delay: Value,
    /// Shares of the samples whose current was made by the set-point of so many periods before.
    pub arrivals: Vec<f64>,
    /// Root mean square of the current, and of what the drive's law leaves of it, A.
    pub current: [f64; 2],
    /// Root mean square of the torque on the rotor, and of what the rotor's equation leaves, N·m.
    pub torque: [f64; 2],
    /// Time used, s.
    pub seconds: f64,
    /// Remarks about what the recording does not determine or the model does not explain.
    pub notes: Vec<String>,
}

/// Shortest recording, s.
const SHORTEST_S: f64 = 2.0;
/// Least motion in counts of the motor's encoder.
const LEAST_COUNTS: f64 = 50.0;
/// A parameter is determined where its interval is narrower than this share of the prior's.
const NARROWER: f64 = 0.3;
/// Width of a prior as a share of the configured value: a factor of two and more is allowed for.
const PRIOR_WIDTH: f64 = 1.0;
/// Share of the current that a sound model may leave beside the sensor's noise.
const UNEXPLAINED: f64 = 0.1;
/// Time of a block of the jackknife, s: longer than what friction and gear remember.
const BLOCK_S: f64 = 0.5;

/// Identifies a drive.
///
/// # Errors
/// Every reason why the log cannot be that of this drive in motion.
pub fn identify(known: &DriveKnowledge, log: &DriveLog) -> Result<Drive, Problems> {
    check(known, log)?;
    let lost = || Problem::new("no model of the drive fits", "a recording of it in motion");
    let (law, rate) = integral::fit(known, log).ok_or_else(lost)?;
    let rotor = rotor::fit(known, log, &law).ok_or_else(lost)?;
    let mut notes = law.notes.clone();
    notes.extend(rotor.notes.iter().cloned());
    let constant = known.torque_constant * known.gear_ratio;
    let scaled = |value: Value| Value {
        value: constant * value.value,
        // The torque's scale is that of the torque constant.
        sigma: constant * value.sigma.hypot(known.torque_constant_sigma * value.value),
        configured: constant * value.configured,
        ..value
    };
    let of_position = |value: Value| known.takes_position.then_some(value);
    let drive = Drive {
        stiffness: of_position(scaled(law.gain)),
        damping: of_position(scaled(law.damping)),
        dead_zone: of_position(law.dead_zone),
        integral: of_position(rate),
        gain: (!known.takes_position).then_some(law.gain),
        inertia: rotor.inertia,
        coulomb: rotor.coulomb,
        load: rotor.load,
        viscous: rotor.viscous,
        asymmetry: rotor.asymmetry,
        delay: delay(known, log, &law, &rotor),
        arrivals: law.shares.clone(),
        current: law.rms,
        torque: rotor.rms,
        seconds: seconds(log),
        notes,
    };
    Ok(with_remarks(drive))
}

/// The delay: the set-point's periods by the current, and its part of a period by the rotor.
fn delay(
    known: &DriveKnowledge,
    log: &DriveLog,
    law: &position_loop::Law,
    rotor: &rotor::Rotor,
) -> Value {
    let later = rotor.later;
    // A set-point that shows from the sample `periods` later on acts up to one period before; between
    // these two samples a straight line puts its step into the middle, and `later` corrects that.
    let value = log.period * (law.periods.value - 0.5 - later.value) - known.latency;
    let sigma = log.period * law.periods.sigma.hypot(later.sigma);
    Value {
        value,
        sigma,
        configured: known.delay,
        determined: true,
    }
    .or_configured(
        log.period,
        law.gain.determined && rotor.enough && sigma < 0.5 * log.period,
    )
}

fn with_remarks(mut drive: Drive) -> Drive {
    let named = [
        ("stiffness", drive.stiffness),
        ("damping", drive.damping),
        ("dead zone", drive.dead_zone),
        ("inertia", Some(drive.inertia)),
        ("Coulomb friction", Some(drive.coulomb)),
        ("viscous friction", Some(drive.viscous)),
        ("delay", Some(drive.delay)),
    ];
    let open = named.into_iter().filter_map(|(name, value)| {
        let value = value?;
        (!value.determined).then_some(name)
    });
    let open: Vec<&str> = open.collect();
    if !open.is_empty() {
        drive.notes.push(format!(
            "the recording does not determine: {}; the configuration's values stand",
            open.join(", ")
        ));
    }
    let [current, rest] = drive.current;
    if rest > UNEXPLAINED * current {
        drive.notes.push(format!(
            "{:.0} % of the current is not explained: its sensor is noisy, or the drive's law is another",
            100.0 * rest / current
        ));
    }
    drive
}

fn seconds(log: &DriveLog) -> f64 {
    let samples = log.stretches.iter().map(|s| s.theta.len());
    samples.sum::<usize>() as f64 * log.period
}

/// A coefficient with a prior, as the configuration states it.
fn value(posterior: &Posterior, column: usize, configured: f64, prior_sigma: f64) -> Value {
    let sigma = posterior.covariance[(column, column)].max(0.0).sqrt();
    Value {
        value: posterior.x[column],
        sigma,
        configured,
        determined: sigma < NARROWER * prior_sigma,
    }
}

/// Marks that no drive with these data can leave.
fn check(known: &DriveKnowledge, log: &DriveLog) -> Result<(), Problems> {
    let mut problems = Vec::new();
    let mut refuse = |reason: String, allowed: &str| problems.push(Problem::new(reason, allowed));
    if seconds(log) < SHORTEST_S {
        let reason = format!("{:.2} s of commanded motion without a gap", seconds(log));
        let allowed = format!("at least {SHORTEST_S} s");
        return Err(Problem::new(reason, allowed).into());
    }
    let all = |of: fn(&DriveStretch) -> &[f64]| {
        let list = log
            .stretches
            .iter()
            .flat_map(move |s| of(s).iter().copied());
        list.collect::<Vec<f64>>()
    };
    let (theta, current, sent) = (all(|s| &s.theta), all(|s| &s.current), all(|s| &s.sent));
    let (q, torque) = (all(|s| &s.q), all(|s| &s.torque));
    for (name, list) in [
        ("theta", &theta),
        ("current", &current),
        ("set-point", &sent),
        ("q", &q),
        ("torque", &torque),
    ] {
        if list.iter().any(|x| !x.is_finite()) {
            refuse(
                format!("{name} has values that are no numbers"),
                "finite ones",
            );
        }
        if list.len() != theta.len() {
            refuse(format!("{name} has another length than theta"), "the same");
        }
    }
    let counts = range(&theta) / known.motor_resolution;
    if counts < LEAST_COUNTS {
        refuse(
            format!("the motor moves by {counts:.0} counts"),
            "at least 50: a motion of this joint, e.g. the planned chirp",
        );
    }
    if range(&current) == 0.0 {
        refuse("the current never changes".to_owned(), "a measured current");
    }
    if range(&sent) == 0.0 {
        refuse(
            "the set-point never changes".to_owned(),
            "a commanded motion",
        );
    }
    if known.takes_position && problems.is_empty() {
        let n = known.gear_ratio;
        let slope = slope(&theta, &sent) * n;
        let away = sent
            .iter()
            .zip(&theta)
            .map(|(u, theta)| (u - theta / n).abs());
        let away = median(away.collect());
        if !(0.3..3.0).contains(&slope) || away > 0.2 {
            problems.push(Problem::new(
                format!(
                    "the angle follows its set-point by a factor of {:.2}, {:.1} degrees away",
                    1.0 / slope,
                    away.to_degrees()
                ),
                "set-points of this joint, in its unit and direction",
            ));
        }
    }
    if known.takes_position && problems.is_empty() {
        // Through stiffness and damping, friction and load the current rises with the error.
        let error = |s: &DriveStretch| -> Vec<f64> {
            let late = s.sent.iter().zip(s.theta.iter().skip(2));
            late.map(|(u, theta)| u - theta / known.gear_ratio)
                .collect()
        };
        let errors: Vec<f64> = log.stretches.iter().flat_map(error).collect();
        let late = |s: &DriveStretch| s.current.iter().skip(2).copied().collect::<Vec<f64>>();
        let currents: Vec<f64> = log.stretches.iter().flat_map(late).collect();
        if self::slope(&errors, &currents) <= 0.0 {
            let reason =
                "the current does not follow the set-point's error, or with the opposite sign";
            let allowed = "a drive whose positive current drives its angle up";
            problems.push(Problem::new(reason, allowed));
        }
    }
    if problems.is_empty() {
        Ok(())
    } else {
        Err(Problems(problems))
    }
}

fn range(x: &[f64]) -> f64 {
    let most = x.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    most - x.iter().copied().fold(f64::INFINITY, f64::min)
}

fn median(mut x: Vec<f64>) -> f64 {
    x.sort_by(f64::total_cmp);
    x.get(x.len() / 2).copied().unwrap_or(0.0)
}

/// Slope of y over x.
fn slope(x: &[f64], y: &[f64]) -> f64 {
    let n = x.len().max(1) as f64;
    let mean = |x: &[f64]| x.iter().sum::<f64>() / n;
    let (mx, my) = (mean(x), mean(y));
    let moment: f64 = x.iter().zip(y).map(|(x, y)| (x - mx) * (y - my)).sum();
    moment / x.iter().map(|x| (x - mx).powi(2)).sum::<f64>()
}

fn rms(x: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = x.fold((0.0, 0.0), |(sum, n), x| (sum + x * x, n + 1.0));
    (sum / f64::max(n, 1.0)).sqrt()
}

/// Standard deviation of a motor encoder's sample, link side, rad: rounding, and as much noise.
fn angle_sigma(known: &DriveKnowledge) -> f64 {
    0.4 * known.motor_resolution / known.gear_ratio
}

/// A derivative of the angle shows where it exceeds the noise of the encoder's by this factor: noise in
/// a term makes its coefficient smaller by one over its square.
const ENOUGH: f64 = 5.0;

/// Blocks of the jackknife for a log of this length.
fn blocks(log: &DriveLog) -> usize {
    ((seconds(log) / BLOCK_S) as usize).clamp(6, 60)
}
