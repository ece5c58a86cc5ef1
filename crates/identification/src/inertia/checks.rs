//! Logs that cannot be of this robot, or not in SI units, are refused with the likely cause.

use super::alternatives::Fitting;
use super::friction::{Friction, TERMS};
use super::robot::{Robot, RobotLog};
use super::rows::Rows;
use super::signals::{Recording, Smoothing, Source, instants};
use dynamics::{Data, rnea};
use problem::{Problem, Problems};

/// Rates that logs of a robot have, Hz.
const RATES: std::ops::RangeInclusive<f64> = 10.0..=20_000.0;
/// Shortest motion that anything is learnt from, s.
const MIN_DURATION: f64 = 4.0;
/// Samples outside of a joint's limits, as a share, that make its unit doubtful.
const OUTSIDE: f64 = 0.05;
/// No joint of a robot turns as far from zero without limits, rad.
const FAR: f64 = 40.0;
/// A velocity column must follow the angle's derivative: correlation and slope.
const MIN_CORRELATION: f64 = 0.7;
const SLOPES: std::ops::RangeInclusive<f64> = 0.8..=1.25;
/// Share of a joint's torque that the URDF's must explain before its sign or unit is judged by it.
const EXPLAINED: f64 = 0.5;
/// Share of the torques' squares that the best model must explain on held-out blocks.
pub const MIN_EXPLAINED: f64 = 0.2;

/// How joints move.
#[derive(Debug, Clone, Default)]
pub struct Motion {
    /// Speed that is exceeded for a twentieth of the time, per measured joint.
    pub speed: Vec<f64>,
    /// Largest acceleration of the smoothed signal but for a hundredth of the time.
    pub acceleration: Vec<f64>,
    /// Angles between which the joint moves.
    pub range: Vec<(f64, f64)>,
    /// True if a joint moves.
    pub moves: Vec<bool>,
    /// Mean frequency of the fastest joint's velocity, Hz.
    pub frequency: f64,
}

/// Columns of a log are complete.
///
/// # Errors
/// Columns of different lengths.
pub fn columns(log: &RobotLog) -> Result<(), Problem> {
    let n = log.t.len();
    for joint in log.joints.iter().flatten() {
        let of = |c: &Vec<f64>, may_lack: bool| c.len() == n || may_lack && c.is_empty();
        if !(of(&joint.q, false)
            && of(&joint.tau, false)
            && of(&joint.dq, true)
            && of(&joint.ddq, true))
        {
            return Err(
                Problem::new("columns of different lengths", "one value a row").at(&log.name, 0),
            );
        }
    }
    Ok(())
}

/// Rate and duration are those of a robot's log.
///
/// # Errors
/// Stamps in another unit, or too short a log.
pub fn stamps(recording: &Recording) -> Result<(), Problem> {
    let rate = recording.rate;
    if !RATES.contains(&rate) {
        let units = [("ms", 1e3), ("us", 1e6), ("ns", 1e9)];
        let likely = units
            .iter()
            .find(|(_, k)| (20.0..=10_000.0).contains(&(rate * k)));
        let hint = likely.map_or(String::new(), |(unit, _)| format!(": is t in {unit}?"));
        let reason = format!("t: {rate:.3} samples a second{hint}");
        return Err(Problem::new(reason, "stamps in seconds, 10 Hz to 20 kHz"));
    }
    let duration = recording.duration();
    if duration < MIN_DURATION {
        let reason = format!("the logs hold {duration:.2} s of motion without gaps");
        return Err(Problem::new(
            reason,
            format!("at least {MIN_DURATION} s; 30 s and more are good"),
        ));
    }
    Ok(())
}

/// Speeds, ranges and frequency of the motion; units of angle and velocity.
///
/// # Errors
/// Every joint whose columns cannot be rad and rad/s, or no joint that moves.
pub fn motion(robot: &Robot<'_>, recording: &Recording) -> Result<Motion, Problems> {
    let joints = robot.measured.len();
    let (mut q, mut dq, mut ddq, mut logged) = (
        vec![Vec::new(); joints],
        vec![Vec::new(); joints],
        vec![Vec::new(); joints],
        vec![Vec::new(); joints],
    );
    let smoothing = Smoothing {
        cut_off: (0.2 * recording.rate).min(10.0),
        source: Source::Angle,
    };
    let half = super::signals::half_width(smoothing.cut_off, recording.rate);
    let grid = recording.rate.min(50.0);
    for segment in &recording.segments {
        instants(segment, recording.rate, grid, smoothing, half, |now| {
            let Some(now) = now else { return };
            let near = segment
                .t
                .partition_point(|t| *t < now.t)
                .min(segment.t.len() - 1);
            for k in 0..joints {
                q[k].push(now.q[k]);
                dq[k].push(now.dq[k]);
                ddq[k].push(now.ddq[k].abs());
                logged[k].extend(segment.columns[k][1].get(near));
            }
        });
    }
    let mut motion = Motion::default();
    let mut problems = Vec::new();
    for k in 0..joints {
        let mut speeds: Vec<f64> = dq[k].iter().map(|x| x.abs()).collect();
        speeds.sort_by(f64::total_cmp);
        let mut accelerations = ddq[k].clone();
        accelerations.sort_by(f64::total_cmp);
        let at = |sorted: &[f64], share: f64| {
            sorted
                .get((share * sorted.len() as f64) as usize)
                .copied()
                .unwrap_or(0.0)
        };
        let low = q[k].iter().copied().fold(f64::INFINITY, f64::min);
        let high = q[k].iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let speed = at(&speeds, 0.95);
        let moves = high - low > 0.01 && speed > 2e-3;
        motion.speed.push(speed);
        motion.acceleration.push(at(&accelerations, 0.99));
        motion.range.push((low, high));
        motion.moves.push(moves);
        let square = |x: &[f64]| x.iter().map(|x| x * x).sum::<f64>();
        if moves {
            let frequency = (square(&ddq[k]) / square(&dq[k])).sqrt() / std::f64::consts::TAU;
            motion.frequency = motion.frequency.max(frequency);
            problems.extend(velocity(robot.name(k), &dq[k], &logged[k]));
        }
        problems.extend(angle(robot, k, &q[k], speed));
    }
    if problems.is_empty() && !motion.moves.contains(&true) {
        problems.push(Problem::new(
            "no joint moves by more than 0.01 rad or m",
            "motion of every joint that shall be identified",
        ));
    }
    if problems.is_empty() {
        Ok(motion)
    } else {
        Err(Problems(problems))
    }
}

/// A logged velocity that is not the angle's derivative.
fn velocity(name: &str, derivative: &[f64], logged: &[f64]) -> Option<Problem> {
    if logged.len() != derivative.len() {
        return None;
    }
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
    let (own, other) = (dot(derivative, derivative), dot(logged, logged));
    let slope = dot(derivative, logged) / own.max(1e-30);
    let correlation = dot(derivative, logged) / (own * other).sqrt().max(1e-30);
    if correlation.abs() >= MIN_CORRELATION && SLOPES.contains(&slope) {
        return None;
    }
    let near = |k: f64| (0.85..1.18).contains(&(slope / k));
    let degrees = 1f64.to_degrees();
    let cause = match () {
        () if correlation.abs() < MIN_CORRELATION => "are columns swapped?",
        () if slope < 0.0 => "its sign is opposite to that of q",
        () if near(degrees) => "is it in deg/s, and q in rad?",
        () if near(1.0 / degrees) => "is q in degrees, and dq in rad/s?",
        () if near(1e3) => "is t in ms, or dq in mrad/s?",
        () if near(1e-3) => "is q in mrad or mm?",
        () => "do both belong to the same joint and side of the gear?",
    };
    let reason = format!(
        "dq of `{name}` is {slope:.3} times the derivative of its q (correlation {correlation:.2}): {cause}"
    );
    Some(Problem::new(
        reason,
        "dq of the same joint in rad/s (m/s), or no dq columns: q is differentiated",
    ))
}

/// An angle that cannot be in rad.
fn angle(robot: &Robot<'_>, joint: usize, q: &[f64], speed: f64) -> Option<Problem> {
    let own = &robot.model.joints()[robot.measured[joint]];
    let (lower, upper) = (own.limits.lower, own.limits.upper);
    let room = 0.05 * (upper - lower).abs().min(10.0) + 0.02;
    let outside = |scale: f64| {
        let out = q
            .iter()
            .filter(|x| **x * scale < lower - room || **x * scale > upper + room);
        out.count() as f64 / q.len().max(1) as f64
    };
    let far = q.iter().any(|x| x.abs() > FAR);
    let fast = speed > 3.0 * own.limits.velocity.clamp(1.0, 10.0);
    let revolute = own.kind.is_revolute();
    if outside(1.0) <= OUTSIDE && !(revolute && far && fast) {
        return None;
    }
    let (small, unit, whole) = if revolute {
        (1f64.to_radians(), "degrees", "rad")
    } else {
        (1e-3, "mm", "m")
    };
    let low = q.iter().copied().fold(f64::INFINITY, f64::min);
    let high = q.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let likely =
        outside(small) <= OUTSIDE && (high - low) * small < 13.0 && high.abs().max(low.abs()) > 6.3;
    let name = robot.name(joint);
    let cause = if likely {
        format!("is it in {unit}?")
    } else {
        "another joint's column, another zero, or another robot's URDF?".to_owned()
    };
    let reason = format!(
        "q of `{name}` goes from {low:.3} to {high:.3}, its limits in the URDF are {lower:.3} to {upper:.3}: {cause}"
    );
    Some(Problem::new(
        reason,
        format!("q in {whole}, in the URDF's direction and zero"),
    ))
}

/// Torques that stand still, or are those of the URDF with another sign or unit.
///
/// # Errors
/// Every such joint.
pub fn torques(
    robot: &Robot<'_>,
    rows: &Rows,
    friction: &[Friction],
    urdf_has_masses: bool,
    fitting: &Fitting,
) -> Result<Vec<String>, Problems> {
    let (mut problems, mut notes, mut slopes) = (Vec::new(), Vec::new(), Vec::new());
    let model = model_torques(robot, rows);
    for (joint, own) in rows.of.iter().enumerate() {
        let name = robot.name(joint);
        let first = own.raw.first().copied().unwrap_or(0.0);
        if own.raw.iter().all(|tau| *tau == first) {
            let reason = format!("tau of `{name}` is {first} in every row");
            problems.push(Problem::new(reason, "its measured torque, N·m (N)"));
            continue;
        }
        if !urdf_has_masses || !friction[joint].moves {
            continue;
        }
        if let Some((slope, explained)) = slope(own, &model[joint]).filter(|(_, e)| *e > EXPLAINED)
        {
            slopes.push((joint, slope, explained));
        }
    }
    // One joint's may be of another sign by what the URDF lacks; all of them are so by the log's convention.
    let all_opposite = slopes.len() > 1 && slopes.iter().all(|(_, slope, _)| *slope < 0.0);
    for &(joint, slope, explained) in &slopes {
        let name = robot.name(joint);
        // A small torque may have another sign by an error of a centimetre in a centre of mass.
        if slope < 0.0 && (all_opposite || fitting.contradicts()) {
            let reason = format!(
                "tau of `{name}` is {slope:.2} times the URDF's torque, which explains {:.0} % of it: its sign is opposite (positive torque moves towards positive q), or q's is",
                100.0 * explained
            );
            problems.push(Problem::new(
                reason,
                "torque in the direction of the URDF's axis; --negate-torque where all are those of the load",
            ));
        }
    }
    let mut sizes: Vec<f64> = slopes.iter().map(|(_, s, _)| s.abs()).collect();
    sizes.sort_by(f64::total_cmp);
    let middle = sizes.get(sizes.len() / 2).copied().unwrap_or(1.0);
    if (300.0..3000.0).contains(&middle) || (3e-4..3e-3).contains(&middle) {
        let unit = if middle > 1.0 { "mN·m" } else { "kN·m" };
        let reason = format!("tau is {middle:.2e} times the URDF's torques: is it in {unit}?");
        problems.push(Problem::new(reason, "N·m (N for prismatic joints)"));
    } else if !(0.2..5.0).contains(&middle) {
        notes.push(format!("tau is {middle:.2} times the URDF's torques: is it a motor current, or is the URDF's mass a guess?"));
    }
    if problems.is_empty() {
        Ok(notes)
    } else {
        Err(Problems(problems))
    }
}

/// The URDF's torques at every sample, `[joint][sample]`.
pub(super) fn model_torques(robot: &Robot<'_>, rows: &Rows) -> Vec<Vec<f64>> {
    let mut data = Data::new(robot.model);
    let n = robot.model.joint_count();
    let mut out = vec![Vec::new(); rows.joints];
    let mut state = [robot.rest.clone(), vec![0.0; n], vec![0.0; n]];
    for sample in 0..rows.len() {
        for (own, &joint) in rows.of.iter().zip(&robot.measured) {
            (0..3).for_each(|k| state[k][joint] = own.state[sample][k]);
        }
        let tau = rnea(
            robot.model,
            &mut data,
            &state[0],
            &state[1],
            &state[2],
            None,
        );
        (0..rows.joints).for_each(|k| out[k].push(tau[robot.measured[k]]));
    }
    out
}

/// Factor of the model's torque in a joint's, beside Coulomb, viscous friction and offset, and the
/// share of the torque's square that the model's part explains.
fn slope(own: &super::rows::JointRows, model: &[f64]) -> Option<(f64, f64)> {
    let n = own.place.len() - TERMS.len();
    let mut batch = crate::least_squares::Batch::new(4);
    let mut without = crate::least_squares::Batch::new(4);
    for (sample, (tau, model)) in own.tau.iter().zip(model).enumerate() {
        let friction = &own.row(sample)[n..n + 3];
        let row = [*model, friction[0], friction[1], friction[2]];
        batch.add(&row, *tau);
        without.add(&row, *tau);
    }
    let with = batch.solve(1e-9)?;
    let without = without.solve_columns(1e-9, |k| k > 0)?;
    let explained = 1.0 - (with.rms / without.rms.max(1e-30)).powi(2);
    Some((with.x[0], explained))
}

/// Share of the torques' squares about their means that residuals leave unexplained is small
/// enough for the URDF to be this robot's.
///
/// # Errors
/// Torques that no parameters explain.
pub fn explained(share: f64) -> Result<(), Problem> {
    if share >= MIN_EXPLAINED {
        return Ok(());
    }
    let reason = format!(
        "with any parameters the URDF's bodies and friction explain {:.0} % of the torques of parts that were held out: columns of other joints, q in degrees or with other zeros, torques of another time, or another robot's log?",
        100.0 * share.max(0.0)
    );
    Err(Problem::new(
        reason,
        "logs of this robot: q with the URDF's zeros and directions",
    ))
}
