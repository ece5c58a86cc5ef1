//! F/T sensors against the part beyond them that nothing touches: its weight and motion alone make the wrench.
//!
//! In: what a sensor reads and what the model expects there, row by row. Out: the residual in standard deviations
//! and, where it is too large, which single mistake would explain it: sign, axes of the base, another order of
//! the axes, axes that are turned, an offset, a scale, another reference point of the torques, a delay.

use super::checks::orders;
use super::spoilt;
use nalgebra::{Matrix3, Rotation3, SMatrix, Vector3};
use problem::Problem;

/// One instant of a sensor.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// Force that is read, N, and torque, N·m.
    pub measured: [Vector3<f64>; 2],
    /// The same by the model.
    pub expected: [Vector3<f64>; 2],
    /// Standard deviation of the difference, N and N·m (Euclidean norm).
    pub sigma: [f64; 2],
    /// Axes of the sensor's frame in those of the root link.
    pub axes: Matrix3<f64>,
}

/// What a sensor's rows show.
#[derive(Debug, Clone, PartialEq)]
pub struct Verdict {
    /// RMS of the difference, N and N·m.
    pub residual: [f64; 2],
    /// RMS of its standard deviation, N and N·m.
    pub sigma: [f64; 2],
    /// The mistake that explains most of a difference that is too large.
    pub cause: Option<String>,
    /// The mistake has no free number and leaves so little that it is certain, however small the difference.
    pub certain: bool,
}

/// Residual over its standard deviation that is no longer one of noise and masses.
const TOO_LARGE: f64 = 3.0;
/// Share of the squares that a named mistake may leave.
const EXPLAINED: f64 = 0.2;
/// Mistakes that leave up to so many times the least are named together, at most so many.
const ALIKE: f64 = 1.5;
/// Share of the squares that a mistake without a free number (a sign, an order, a delay) may leave to be certain
/// within [`TOO_LARGE`] deviations too: wrong masses and noise are not mended by any.
const CERTAIN: f64 = 0.25;
const NAMED: usize = 2;
/// Rows that are looked at, at most.
const MAX_ROWS: usize = 1500;
/// Longest delay that is tried, rows of those looked at.
const MAX_DELAY: usize = 30;
/// Smallest angle of turned axes that is named, rad.
const TURNED: f64 = 0.03;

impl Verdict {
    /// The residual in standard deviations: the larger of force and torque.
    #[must_use]
    pub fn ratio(&self) -> f64 {
        let of = |k: usize| self.residual[k] / self.sigma[k].max(1e-12);
        of(0).max(of(1))
    }

    /// Whether noise and masses do not explain the residual.
    #[must_use]
    pub fn is_contradiction(&self) -> bool {
        self.certain || self.ratio() > TOO_LARGE
    }

    /// One line about the residual.
    #[must_use]
    pub fn line(&self) -> String {
        let [force, torque] = self.residual;
        let [of_force, of_torque] = self.sigma;
        format!(
            "what nothing touches leaves {force:.3} N and {torque:.4} N·m RMS (sigma {of_force:.3} N, {of_torque:.4} N·m)"
        )
    }

    /// The refusal of a sensor whose residual is too large; none where it is not.
    #[must_use]
    pub fn problem(&self, sensor: &str) -> Option<Problem> {
        if !self.is_contradiction() {
            return None;
        }
        let cause = self.cause.as_deref().map_or(
            "no single mistake explains it: something touched the part, or the masses beyond are not the URDF's"
                .to_owned(),
            |cause| format!("explained if {cause}"),
        );
        let reason = format!(
            "F/T sensor {sensor}: {}, {:.1} times as much as noise and masses explain; {cause}",
            self.line(),
            self.ratio()
        );
        let allowed = "wrenches in the sensor's frame, tared, of the part beyond on the part before; contacts as they were; --accept takes them as they stand";
        Some(Problem::new(reason, allowed))
    }
}

/// Squares of what a sensor would leave, over its variance, forces and torques together.
fn rest<'a>(pairs: impl Iterator<Item = ([Vector3<f64>; 2], &'a Row)>, sigma: [f64; 2]) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for (read, row) in pairs {
        for k in 0..2 {
            sum += (read[k] - row.expected[k]).norm_squared() / (sigma[k] * sigma[k]);
        }
        count += 1.0;
    }
    sum / f64::max(count, 1.0)
}

/// A mistake: what a sound sensor would read instead, and its words.
pub(super) type Mistake = (Box<dyn Fn(usize, &Row) -> [Vector3<f64>; 2]>, String);

/// Judges the rows of one sensor, in the order of their stamps, `period` s apart.
#[must_use]
pub fn judge(all: &[Row], period: f64) -> Verdict {
    let step = all.len().div_ceil(MAX_ROWS).max(1);
    let rows: Vec<&Row> = all.iter().step_by(step).collect();
    let count = rows.len().max(1) as f64;
    let root = |of: &dyn Fn(&Row, usize) -> f64| {
        [0, 1].map(|k| (rows.iter().map(|r| of(r, k)).sum::<f64>() / count).sqrt())
    };
    let residual = root(&|r, k| (r.measured[k] - r.expected[k]).norm_squared());
    let sigma = root(&|r, k| r.sigma[k] * r.sigma[k]).map(|s| s.max(1e-9));
    let mut verdict = Verdict {
        residual,
        sigma,
        cause: None,
        certain: false,
    };
    let as_read = rest(rows.iter().map(|r| (r.measured, *r)), sigma);
    let tried = |(read, words): Mistake| {
        let pairs = rows.iter().enumerate().map(|(i, r)| (read(i, r), *r));
        (rest(pairs, sigma), words)
    };
    let mut found: Vec<(f64, String)> = fixed().into_iter().map(tried).collect();
    found.extend(delayed(&rows, sigma, period * step as f64));
    verdict.certain = found.iter().any(|(left, _)| *left < CERTAIN * as_read);
    if !verdict.is_contradiction() {
        return verdict;
    }
    found.extend(fitted(&rows, sigma).into_iter().map(tried));
    let least = found.iter().map(|(left, _)| *left).fold(f64::MAX, f64::min);
    // What leaves no more than noise and masses do is as good as any other.
    let bound = (EXPLAINED * as_read).min((ALIKE * least).max(2.0));
    found.retain(|(left, _)| *left <= bound);
    let words = found.into_iter().take(NAMED).map(|(_, words)| words);
    verdict.cause = words.reduce(|all, other| format!("{all}, or {other}"));
    verdict
}

/// The mistakes without a free number, simple ones first.
fn fixed() -> Vec<Mistake> {
    let mut all: Vec<Mistake> = vec![
        (
            Box::new(|_, r| r.measured.map(|x| -x)),
            "all six signs are reversed (the wrench of the part before on the part beyond; key `sign`)".into(),
        ),
        (
            Box::new(|_, r| r.measured.map(|x| r.axes.tr_mul(&x))),
            "the wrench is in axes of the base instead of the sensor's frame".into(),
        ),
        (
            Box::new(|_, r| r.measured.map(|x| -r.axes.tr_mul(&x))),
            "the wrench is in axes of the base, with all six signs reversed".into(),
        ),
    ];
    all.extend(spoilt::halves());
    for (order, name) in orders() {
        let words = format!("the axes come in another order: fx, fy, fz are {name}");
        all.push((
            Box::new(move |_, r| r.measured.map(|x| order.tr_mul(&x))),
            words,
        ));
    }
    for axis in 0..3 {
        for (of, what) in [
            ([true, false], "f"),
            ([false, true], "t"),
            ([true, true], ""),
        ] {
            let name = ["x", "y", "z"][axis];
            let words = match what {
                "" => format!("the signs of f{name} and t{name} are reversed"),
                _ => format!("the sign of {what}{name} alone is reversed"),
            };
            let turned = move |k: usize, x: Vector3<f64>| {
                let mut x = x;
                x[axis] *= if of[k] { -1.0 } else { 1.0 };
                x
            };
            let read =
                move |_: usize, r: &Row| [turned(0, r.measured[0]), turned(1, r.measured[1])];
            all.push((Box::new(read), words));
        }
    }
    all
}

/// Mistakes with numbers that follow from the rows.
fn fitted(rows: &[&Row], sigma: [f64; 2]) -> Vec<Mistake> {
    let mut all = vec![offset(rows)];
    all.extend(scale(rows, sigma));
    all.extend(turned(rows, sigma));
    all.extend(lever(rows));
    all.extend(spoilt::drift(rows));
    all.extend(spoilt::clipped(rows));
    all
}

fn offset(rows: &[&Row]) -> Mistake {
    let count = rows.len().max(1) as f64;
    let mean = [0, 1].map(|k| {
        let sum: Vector3<f64> = rows.iter().map(|r| r.measured[k] - r.expected[k]).sum();
        sum / count
    });
    let [f, t] = mean;
    let words = format!(
        "the sensor has an offset of {:.2}, {:.2}, {:.2} N and {:.3}, {:.3}, {:.3} N·m: it was not tared",
        f.x, f.y, f.z, t.x, t.y, t.z
    );
    (
        Box::new(move |_, r| [r.measured[0] - mean[0], r.measured[1] - mean[1]]),
        words,
    )
}

/// Forces and torques that are too large or too small by a factor each.
fn scale(rows: &[&Row], sigma: [f64; 2]) -> Option<Mistake> {
    let factor = [0, 1].map(|k| {
        let with: f64 = rows.iter().map(|r| r.measured[k].dot(&r.expected[k])).sum();
        let own: f64 = rows.iter().map(|r| r.measured[k].norm_squared()).sum();
        // What carries nothing shows no factor.
        if own > rows.len() as f64 * sigma[k] * sigma[k] {
            with / own
        } else {
            1.0
        }
    });
    let words = format!(
        "its forces are {:.3} and its torques {:.3} times what they should be: another unit, or another calibration",
        1.0 / factor[0],
        1.0 / factor[1]
    );
    let sound = factor.iter().all(|f| *f > 0.0 && f.is_finite());
    sound.then(|| -> Mistake {
        (
            Box::new(move |_, r| [factor[0] * r.measured[0], factor[1] * r.measured[1]]),
            words,
        )
    })
}

/// Axes that are turned: the rotation of least squares (W. Kabsch, Acta Crystallographica A 32, 1976).
fn turned(rows: &[&Row], sigma: [f64; 2]) -> Option<Mistake> {
    let mut with = Matrix3::zeros();
    for r in rows {
        for (k, sigma) in sigma.iter().enumerate() {
            with += r.expected[k] * r.measured[k].transpose() / (sigma * sigma);
        }
    }
    let svd = with.svd(true, true);
    let (u, v) = (svd.u?, svd.v_t?);
    let sign = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, (u * v).determinant().signum()));
    let rotation = Rotation3::from_matrix_unchecked(u * sign * v);
    let (axis, angle) = rotation.axis_angle()?;
    let words = format!(
        "its axes are turned by {:.1}° about ({:.2}, {:.2}, {:.2}) from the URDF's frame",
        angle.to_degrees(),
        axis.x,
        axis.y,
        axis.z
    );
    let found = *rotation.matrix();
    (angle > TURNED)
        .then(|| -> Mistake { (Box::new(move |_, r| r.measured.map(|x| found * x)), words) })
}

/// Torques about another point: t' = t + d x f.
fn lever(rows: &[&Row]) -> Option<Mistake> {
    let (mut gram, mut moment) = (SMatrix::<f64, 3, 3>::zeros(), Vector3::zeros());
    for r in rows {
        // expected - measured = d x f = -[f] d
        let by = -r.measured[0].cross_matrix();
        gram += by.tr_mul(&by);
        moment += by.tr_mul(&(r.expected[1] - r.measured[1]));
    }
    let d = gram.try_inverse()? * moment;
    let words = format!(
        "its torques are about a point {:.3}, {:.3}, {:.3} m from the URDF's frame",
        -d.x, -d.y, -d.z
    );
    Some((
        Box::new(move |_, r: &Row| [r.measured[0], r.measured[1] + d.cross(&r.measured[0])]),
        words,
    ))
}

/// Readings that come later or earlier than the angles.
fn delayed(rows: &[&Row], sigma: [f64; 2], period: f64) -> Option<(f64, String)> {
    let most = MAX_DELAY.min(rows.len() / 4);
    let shifted = |late: bool, k: usize| {
        let pairs = (k..rows.len()).map(|i| {
            let (read, row) = if late {
                (rows[i], rows[i - k])
            } else {
                (rows[i - k], rows[i])
            };
            (read.measured, row)
        });
        rest(pairs, sigma)
    };
    let all = [true, false]
        .into_iter()
        .flat_map(|late| (1..=most).map(move |k| (late, k)));
    let best = all
        .map(|(late, k)| (shifted(late, k), late, k))
        .min_by(|a, b| a.0.total_cmp(&b.0))?;
    let (left, late, k) = best;
    let way = if late { "after" } else { "before" };
    let ms = 1e3 * period * k as f64;
    Some((
        left,
        format!("its readings come some {ms:.0} ms {way} the angles"),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use test_support::Random;

    /// A tool of 1 kg at 0.08 m on a wrist that turns about two axes, in 400 rows.
    fn sound(seed: u64) -> Vec<Row> {
        let mut random = Random::new(seed);
        let centre = Vector3::new(0.02, -0.03, 0.08);
        (0..400)
            .map(|i| {
                let t = 0.02 * f64::from(i);
                let axes = Rotation3::from_euler_angles(
                    1.1 * (1.3 * t).sin(),
                    0.9 * (0.7 * t).cos(),
                    0.8 * t,
                );
                let weight = axes.inverse() * Vector3::new(0.0, 0.0, -9.81);
                let expected = [weight, centre.cross(&weight)];
                let mut noise = |x: f64| Vector3::from_fn(|_, _| x * random.normal());
                Row {
                    measured: [expected[0] + noise(0.05), expected[1] + noise(0.004)],
                    expected,
                    sigma: [0.2, 0.016],
                    axes: *axes.matrix(),
                }
            })
            .collect()
    }

    fn read(change: impl Fn(&Row) -> [Vector3<f64>; 2]) -> Verdict {
        let mut rows = sound(1);
        for row in &mut rows {
            row.measured = change(row);
        }
        judge(&rows, 0.02)
    }

    #[test]
    fn noise_and_masses_are_no_contradiction() {
        for seed in 0..20 {
            let mut rows = sound(seed);
            assert!(judge(&rows, 0.02).problem("wrist").is_none());
            // Masses that are off by 3 %.
            for row in &mut rows {
                row.measured = row.measured.map(|x| 1.03 * x);
            }
            assert!(judge(&rows, 0.02).problem("wrist").is_none());
        }
    }

    #[test]
    fn each_mistake_is_named() {
        let turn = Rotation3::from_axis_angle(&Vector3::y_axis(), 0.5);
        let order = |x: Vector3<f64>| Vector3::new(x.y, -x.x, x.z);
        let cases: [(&str, Verdict); 8] = [
            (
                "all six signs are reversed",
                read(|r| r.measured.map(|x| -x)),
            ),
            (
                "in axes of the base instead",
                read(|r| r.measured.map(|x| r.axes * x)),
            ),
            (
                "base, with all six signs",
                read(|r| r.measured.map(|x| -(r.axes * x))),
            ),
            ("fx, fy, fz are y, -x, z", read(|r| r.measured.map(order))),
            (
                "an offset of 2.00, ",
                read(|r| [r.measured[0] + Vector3::new(2.0, 0.0, -1.0), r.measured[1]]),
            ),
            (
                "its forces are 1.30",
                read(|r| [1.3 * r.measured[0], r.measured[1]]),
            ),
            (
                "its axes are turned by 28.",
                read(|r| r.measured.map(|x| turn * x)),
            ),
            (
                "about a point",
                read(|r| {
                    let arm = Vector3::new(0.0, 0.06, 0.0);
                    [r.measured[0], r.measured[1] + arm.cross(&r.measured[0])]
                }),
            ),
        ];
        for (expected, verdict) in cases {
            let text = verdict
                .problem("wrist")
                .map(|p| p.to_string())
                .unwrap_or_default();
            assert!(text.contains(expected), "{expected}: {text}");
        }
        let mut late = sound(2);
        for i in (20..late.len()).rev() {
            late[i].measured = late[i - 20].measured;
        }
        let text = judge(&late, 0.02).problem("wrist").unwrap().to_string();
        assert!(text.contains("400 ms after the angles"), "{text}");
        // Within three deviations of masses that are hardly known, still certain.
        for (seed, name) in [(4, "fy"), (5, "ty")] {
            let mut small = sound(seed);
            for row in &mut small {
                row.sigma = [6.0, 0.5];
                row.measured[usize::from(name == "ty")].y *= -1.0;
            }
            let text = judge(&small, 0.02).problem("wrist").unwrap().to_string();
            assert!(
                text.contains(&format!("the sign of {name} alone")),
                "{text}"
            );
        }
        let mut early = sound(6);
        for i in 0..early.len() - 8 {
            early[i].measured = early[i + 8].measured;
        }
        for row in &mut early {
            row.sigma = [6.0, 0.5];
        }
        let text = judge(&early, 0.02).problem("wrist").unwrap().to_string();
        assert!(text.contains("160 ms before the angles"), "{text}");
        // A hand that pushes now and then: no single mistake.
        let mut pushed = sound(3);
        for row in pushed.iter_mut().skip(100).take(80) {
            row.measured[0] += Vector3::new(0.0, 9.0, 0.0);
        }
        let text = judge(&pushed, 0.02).problem("wrist").unwrap().to_string();
        assert!(text.contains("something touched the part"), "{text}");
    }
}
