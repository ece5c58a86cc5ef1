//! Errors in the wiring of an F/T sensor, as far as the weight beyond it shows.

use super::Sample;
use nalgebra::{Matrix3, Vector3};
use problem::Problem;

/// Correlation of the forces with the weight that a sound sensor exceeds.
const SOUND: f64 = 0.8;
/// Correlation from which another order of the axes is named.
const CLEAR: f64 = 0.95;
/// It must be so much better than every other.
const BETTER: f64 = 0.02;
/// Standard deviations of a sample that the weight must vary by for any of this to be seen.
const VISIBLE: f64 = 3.0;
/// Ratio of the weight shown to the weight of the model that is taken for a mistake.
const RATIO: f64 = 3.0;
/// Share of the torques' variation that a lever explains, for that to be named.
const EXPLAINED: f64 = 0.8;
/// Furthest centre of mass from its link that a robot has, m.
const FURTHEST: f64 = 3.0;
const AXES: [&str; 3] = ["x", "y", "z"];
/// Newton in other units: a reading in such a unit is this many times too large.
const UNITS: [(&str, f64); 5] = [
    ("kN", 1e-3),
    ("kgf", 1.0 / 9.80665),
    ("lbf", 0.224_809),
    ("mN", 1e3),
    ("N, times 9.81", 9.80665),
];
/// Agreement that names a unit, parts.
const UNIT: f64 = 0.15;

/// Signals of a sensor against the weight of what is beyond: order, signs and unit of its axes.
///
/// `columns` of the samples must be those of a link beyond in every sample; `mass`: that of all links
/// beyond, kg, as far as it is known; `sigma`: of a force sample, N.
///
/// # Errors
/// Wiring that the signals show instead.
pub fn wiring(samples: &[Sample], mass: Option<f64>, sigma: f64) -> Result<(), Problem> {
    let weight = |s: &Sample| Vector3::from_fn(|k, _| s.columns[k][0]);
    let force = |s: &Sample| Vector3::from_fn(|k, _| s.measured[k]);
    let torque = |s: &Sample| Vector3::from_fn(|k, _| s.measured[3 + k]);
    let mean = |of: &dyn Fn(&Sample) -> Vector3<f64>| {
        samples.iter().map(of).sum::<Vector3<f64>>() / samples.len().max(1) as f64
    };
    let means = [mean(&weight), mean(&force), mean(&torque)];
    let (mut with_force, mut with_torque) = (Matrix3::zeros(), Matrix3::zeros());
    let mut squares = [0.0; 3];
    for s in samples {
        let [a, f, t] = [
            weight(s) - means[0],
            force(s) - means[1],
            torque(s) - means[2],
        ];
        with_force += f * a.transpose();
        with_torque += t * a.transpose();
        for (sum, x) in squares.iter_mut().zip([a, f, t]) {
            *sum += x.norm_squared();
        }
    }
    let per_sample = squares.map(|sum| sum / samples.len().max(1) as f64);
    // Variation of a mass that is known, and the one shown.
    let expected = mass.unwrap_or(0.0) * per_sample[0].sqrt();
    if per_sample[0].sqrt() < 0.1
        || (expected < VISIBLE * sigma && per_sample[1].sqrt() < VISIBLE * sigma)
    {
        return Ok(());
    }
    let share = |c: f64, x: f64| c / (squares[0] * x).sqrt().max(1e-300);
    let own = share(with_force.trace(), squares[1]);
    if own < SOUND {
        let mut orders: Vec<(f64, String)> = orders()
            .map(|(p, name)| (share(with_force.dot(&p), squares[1]), name))
            .collect();
        orders.sort_by(|a, b| b.0.total_cmp(&a.0));
        if let [(best, name), (second, _), ..] = orders.as_slice()
            && *best > CLEAR
            && best - second > BETTER
        {
            let reason = format!(
                "forces follow the weight beyond the sensor in another order of the axes: fx, fy, fz are {name}"
            );
            return Err(Problem::new(
                reason,
                "signals x, y, z in the axes of the frame; key `sign`",
            ));
        }
        if share(with_torque.trace(), squares[2]) > CLEAR {
            let reason =
                "the signals of the torque follow the weight beyond the sensor as forces do";
            return Err(Problem::new(reason, "`force` and `torque`, not exchanged"));
        }
        let reason =
            format!("the forces do not follow the weight beyond the sensor (correlation {own:.2})");
        let allowed = "a sensor with its frame's axes, nothing that touches the part beyond it, the URDF's angles";
        return Err(Problem::new(reason, allowed));
    }
    let shown = with_force.trace() / squares[0];
    match mass.filter(|mass| expected >= VISIBLE * sigma && *mass > 0.0) {
        Some(mass) if !(1.0 / RATIO..=RATIO).contains(&(shown / mass)) => {
            let ratio = shown / mass;
            let unit = UNITS.iter().find(|(_, u)| (ratio / u - 1.0).abs() < UNIT);
            let guess = unit.map_or(String::new(), |(unit, _)| {
                format!(", as readings in {unit} would be")
            });
            let reason = format!(
                "the forces show {shown:.3} kg beyond the sensor, the URDF has {mass:.3} kg: {ratio:.4} times as \
                 much{guess}"
            );
            let allowed = "signals in N; a URDF with all that is mounted beyond the sensor, within a factor of 3";
            Err(Problem::new(reason, allowed))
        }
        _ => lever(samples, [means[1], means[2]]),
    }
}

/// A centre of mass that no link has, from torques about the sensor: they are in another unit.
fn lever(samples: &[Sample], [of_force, of_torque]: [Vector3<f64>; 2]) -> Result<(), Problem> {
    // Deviations from the means: t = c x f, linear in c.
    let (mut gram, mut moment, mut square) = (Matrix3::zeros(), Vector3::zeros(), 0.0);
    for s in samples {
        let f = Vector3::from_fn(|k, _| s.measured[k]) - of_force;
        let t = Vector3::from_fn(|k, _| s.measured[3 + k]) - of_torque;
        let by_c = -f.cross_matrix();
        gram += by_c.tr_mul(&by_c);
        moment += by_c.tr_mul(&t);
        square += t.norm_squared();
    }
    let Some(c) = gram.try_inverse().map(|inverse| inverse * moment) else {
        return Ok(());
    };
    if c.norm() <= FURTHEST || c.dot(&moment) < EXPLAINED * square {
        return Ok(());
    }
    let unit = match c.norm() {
        far if far > 20.0 => "N·mm",
        _ => "N·cm, or lbf·in",
    };
    let reason = format!(
        "the torques show a centre of mass {:.1} m away from the sensor, as readings in {unit} would",
        c.norm()
    );
    Err(Problem::new(reason, "signals of the torque in N·m"))
}

/// All orders and signs of three axes but the right one, with the names of what is read.
pub(super) fn orders() -> impl Iterator<Item = (Matrix3<f64>, String)> {
    const ORDERS: [[usize; 3]; 6] = [
        [0, 1, 2],
        [0, 2, 1],
        [1, 0, 2],
        [1, 2, 0],
        [2, 0, 1],
        [2, 1, 0],
    ];
    let all = ORDERS
        .into_iter()
        .flat_map(|order| (0..8).map(move |signs| (order, signs)));
    all.filter(|(order, signs)| *order != ORDERS[0] || *signs != 0)
        .map(|(order, signs)| {
            let negative = |k: usize| signs >> k & 1 == 1;
            let mut p = Matrix3::zeros();
            for (k, &axis) in order.iter().enumerate() {
                p[(k, axis)] = if negative(k) { -1.0 } else { 1.0 };
            }
            let name = |k: usize| {
                let sign = if negative(k) { "-" } else { "" };
                format!("{sign}{}", AXES[order[k]])
            };
            (p, format!("{}, {}, {}", name(0), name(1), name(2)))
        })
}
