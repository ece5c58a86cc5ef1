//! Mistakes of a whole half of a wrench, and readings that drift or end at a bound.

use super::untouched::{Mistake, Row};
use nalgebra::Vector3;

/// Rows in which more is expected than a bound, as a share, from which the bound shows, and by how much more.
const MIN_BEYOND: f64 = 0.05;
const BEYOND: f64 = 1.1;
/// Deviation of the readings in these rows, as a share of the bound.
const FLAT: f64 = 0.05;
/// Axes of a wrench.
const AXES: [&str; 6] = ["fx", "fy", "fz", "tx", "ty", "tz"];

/// Signs of the forces or of the torques alone, forces and torques exchanged.
pub(super) fn halves() -> Vec<Mistake> {
    vec![
        (
            Box::new(|_, r| [-r.measured[0], r.measured[1]]),
            "the signs of its three forces alone are reversed".into(),
        ),
        (
            Box::new(|_, r| [r.measured[0], -r.measured[1]]),
            "the signs of its three torques alone are reversed".into(),
        ),
        (
            Box::new(|_, r| [r.measured[1], r.measured[0]]),
            "its forces and its torques are exchanged".into(),
        ),
    ]
}

/// An offset that grows evenly with time.
pub(super) fn drift(rows: &[&Row]) -> Option<Mistake> {
    let count = rows.len() as f64;
    let place = move |i: usize| i as f64 - 0.5 * (count - 1.0);
    let spread: f64 = (0..rows.len()).map(|i| place(i).powi(2)).sum();
    if spread == 0.0 {
        return None;
    }
    let difference = |i: usize, k: usize| rows[i].measured[k] - rows[i].expected[k];
    let line = [0, 1].map(|k| {
        let each = (0..rows.len()).map(|i| (difference(i, k), place(i)));
        let (mut mean, mut slope) = (Vector3::zeros(), Vector3::zeros());
        each.for_each(|(x, t)| {
            mean += x / count;
            slope += x * t / spread;
        });
        (mean, slope)
    });
    let [force, torque] = line.map(|(_, slope)| slope * (count - 1.0));
    let words = format!(
        "its zero drifts by {:.2}, {:.2}, {:.2} N and {:.3}, {:.3}, {:.3} N·m within the log",
        force.x, force.y, force.z, torque.x, torque.y, torque.z
    );
    let read =
        move |i: usize, r: &Row| [0, 1].map(|k| r.measured[k] - line[k].0 - line[k].1 * place(i));
    Some((Box::new(read), words))
}

/// Axes that stay at one reading where more is expected.
pub(super) fn clipped(rows: &[&Row]) -> Option<Mistake> {
    let mut bounds = [f64::INFINITY; 6];
    for (axis, bound) in bounds.iter_mut().enumerate() {
        let (half, axis) = (axis / 3, axis % 3);
        let most = rows
            .iter()
            .map(|r| r.measured[half][axis].abs())
            .fold(0.0, f64::max);
        let beyond = rows
            .iter()
            .filter(|r| r.expected[half][axis].abs() > BEYOND * most);
        let read: Vec<f64> = beyond.map(|r| r.measured[half][axis].abs()).collect();
        if read.is_empty() || (read.len() as f64) < MIN_BEYOND * rows.len() as f64 {
            continue;
        }
        let mean = read.iter().sum::<f64>() / read.len() as f64;
        let variance = read.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / read.len() as f64;
        if mean > (1.0 - 2.0 * FLAT) * most && variance.sqrt() < FLAT * most {
            *bound = mean;
        }
    }
    let named: Vec<String> = (bounds.iter().zip(AXES))
        .filter(|(bound, _)| bound.is_finite())
        .map(|(bound, name)| format!("{name} at {bound:.2}"))
        .collect();
    let words = format!("readings end at a bound: {}", named.join(", "));
    let read = move |_: usize, r: &Row| {
        let mut out = r.measured;
        for (axis, bound) in bounds.iter().enumerate() {
            let (half, axis) = (axis / 3, axis % 3);
            if r.expected[half][axis].abs() > (1.0 - FLAT) * bound {
                out[half][axis] = r.expected[half][axis];
            }
        }
        out
    };
    (!named.is_empty()).then(|| -> Mistake { (Box::new(read), words) })
}

#[cfg(test)]
mod tests {
    use super::super::untouched::{Row, judge};
    use nalgebra::{Matrix3, Vector3};
    use test_support::Random;

    /// A weight of 10 N whose direction goes about, 400 rows.
    fn rows(change: impl Fn(usize, [Vector3<f64>; 2]) -> [Vector3<f64>; 2]) -> String {
        let mut random = Random::new(7);
        let rows: Vec<Row> = (0..400)
            .map(|i| {
                let t = 0.02 * i as f64;
                let (a, b) = (1.1 * (1.3 * t).sin(), 0.9 * (0.7 * t).cos() + 0.4 * t);
                let weight = 10.0 * Vector3::new(a.sin() * b.cos(), a.sin() * b.sin(), -a.cos());
                let expected = [weight, Vector3::new(0.02, -0.03, 0.08).cross(&weight)];
                let mut noise = |x: f64| Vector3::from_fn(|_, _| x * random.normal());
                let [force, torque] = change(i, expected);
                Row {
                    measured: [force + noise(0.05), torque + noise(0.004)],
                    expected,
                    sigma: [0.2, 0.016],
                    axes: Matrix3::identity(),
                }
            })
            .collect();
        let problem = judge(&rows, 0.02).problem("wrist");
        problem.map(|p| p.to_string()).unwrap_or_default()
    }

    #[test]
    fn halves_drifts_and_bounds_are_named() {
        assert_eq!(rows(|_, read| read), "");
        let cases = [
            (rows(|_, [f, t]| [-f, t]), "three forces alone are reversed"),
            (
                rows(|_, [f, t]| [f, -t]),
                "three torques alone are reversed",
            ),
            (
                rows(|_, [f, t]| [t, f]),
                "forces and its torques are exchanged",
            ),
            (
                rows(|i, [f, t]| [f + Vector3::x() * (0.01 * i as f64), t]),
                "its zero drifts by 3.99, ",
            ),
            (
                rows(|_, [f, t]| [f.map(|x| x.clamp(-6.0, 6.0)), t]),
                // fx is beyond it in too few rows to show.
                "readings end at a bound: fy at 6.00, fz at 6.00",
            ),
        ];
        for (text, expected) in cases {
            assert!(text.contains(expected), "{expected}: {text}");
        }
    }
}
