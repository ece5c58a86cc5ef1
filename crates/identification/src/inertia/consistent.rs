//! Link inertias that a body can have, nearest to the URDF's as far as the torques leave them open.
//!
//! Ten parameters belong to a body with mass at every point where its pseudo-inertia `J = [[S, h], [h', m]]`,
//! `S = 1/2 tr(I) 1 - I`, is positive definite (Wensing, Kim, Slotine 2018). The distance from the URDF's is Bregman's
//! divergence of `-log det J` (Lee, Wensing, Park 2020): it does not depend on frames or units, is convex in the
//! parameters, and is infinite at the boundary. So
//!
//! ```text
//! minimise  1/2 x'A x - m'x + lambda sum_bodies [ -log det J + tr(J0^-1 J) ]
//! ```
//!
//! is convex: Newton's method along the central path finds its one solution.

use super::robot::Robot;
use dynamics::{Inertia, PARAMETERS};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Matrix3, Matrix4, SMatrix, SVector, Vector3};

/// Ten parameters: `m, m c (3), Ixx, Ixy, Iyy, Ixz, Iyz, Izz` about the body frame's origin.
pub type Ten = SVector<f64, PARAMETERS>;
type TenByTen = SMatrix<f64, PARAMETERS, PARAMETERS>;

/// Smallest radius of gyration of a prior, m: thinner bodies would bind the fit too tightly.
const MIN_RADIUS: f64 = 0.01;
/// Radius of gyration where the URDF gives none that a body can have, m.
const GUESSED_RADIUS: f64 = 0.05;
/// Mass of a body where the URDF gives none at all, kg.
const GUESSED_MASS: f64 = 2.0;
/// Mass of a body without any on a robot that has masses, as a share of the mean of the others.
const SMALL_SHARE: f64 = 0.02;
/// Newton steps at each weight of the barrier at most.
const STEPS: usize = 50;
/// Factor from one weight of the barrier to the next.
const BARRIER_STEP: f64 = 0.2;
/// Smallest weight of `tr(J0^-1 J)` beside the barrier's.
const PULL_OF_BARRIER: f64 = 1e-4;

/// The URDF's inertias, as far as bodies can have them.
#[derive(Debug, Clone)]
pub struct Prior {
    /// phi0: parameters of all bodies.
    pub parameters: DVector<f64>,
    /// Curvature of the divergence there, per body: lambda times it is the prior's weight.
    pub curvature: Vec<TenByTen>,
    /// J0^-1 per body.
    inverse: Vec<Matrix4<f64>>,
    /// Bodies of which the URDF has a mass.
    pub weighed: Vec<bool>,
    /// True where the URDF has no masses: the prior is a guess.
    pub guessed: bool,
    /// Links whose inertia no body can have, or that have none.
    pub mended: Vec<String>,
}

impl Prior {
    /// Of the robot's URDF.
    #[must_use]
    pub fn new(robot: &Robot<'_>) -> Self {
        let bodies = &robot.model.bodies()[1..];
        let total: f64 = bodies.iter().map(|b| b.inertia.mass).sum();
        let guessed = total <= 1e-6;
        let small = SMALL_SHARE * total / bodies.len().max(1) as f64;
        let (mut mended, mut parameters) = (Vec::new(), DVector::zeros(PARAMETERS * bodies.len()));
        let (mut curvature, mut inverse, mut weighed) = (Vec::new(), Vec::new(), Vec::new());
        for (index, body) in bodies.iter().enumerate() {
            let least = if guessed { GUESSED_MASS } else { small };
            let towards = bodies.iter().find(|b| b.parent == index + 1);
            let middle = towards.map_or_else(Vector3::zeros, |b| 0.5 * b.placement.translation);
            let (ten, changed) = possible(&body.inertia, least, middle);
            if changed && !guessed {
                mended.push(robot.link(index).to_owned());
            }
            parameters
                .rows_mut(PARAMETERS * index, PARAMETERS)
                .copy_from(&ten);
            // Positive definite by construction.
            let inverted = pseudo(&ten).try_inverse().unwrap_or_else(Matrix4::identity);
            curvature.push(hessian(&inverted));
            weighed.push(body.inertia.mass >= least && !guessed);
            inverse.push(inverted);
        }
        Self {
            parameters,
            curvature,
            inverse,
            weighed,
            guessed,
            mended,
        }
    }

    /// True if every body of a solution can exist.
    #[must_use]
    pub fn admits(&self, x: &DVector<f64>) -> bool {
        (0..self.inverse.len()).all(|b| pseudo(&of_body(x, b)).cholesky().is_some())
    }
}

/// Parameters of an inertia.
#[must_use]
pub fn ten(inertia: &Inertia) -> Ten {
    let (h, i) = (&inertia.first_moment, &inertia.rotational);
    Ten::from_column_slice(&[
        inertia.mass,
        h.x,
        h.y,
        h.z,
        i[(0, 0)],
        i[(0, 1)],
        i[(1, 1)],
        i[(0, 2)],
        i[(1, 2)],
        i[(2, 2)],
    ])
}

/// The inertia of parameters.
#[must_use]
pub fn inertia(p: &Ten) -> Inertia {
    Inertia {
        mass: p[0],
        first_moment: Vector3::new(p[1], p[2], p[3]),
        rotational: Matrix3::new(p[4], p[5], p[7], p[5], p[6], p[8], p[7], p[8], p[9]),
    }
}

/// Parameters of a body in a solution.
#[must_use]
pub fn of_body(x: &DVector<f64>, body: usize) -> Ten {
    Ten::from_column_slice(x.rows(PARAMETERS * body, PARAMETERS).as_slice())
}

/// J: pseudo-inertia of parameters.
#[must_use]
pub fn pseudo(p: &Ten) -> Matrix4<f64> {
    let half = 0.5 * (p[4] + p[6] + p[9]);
    Matrix4::new(
        half - p[4],
        -p[5],
        -p[7],
        p[1],
        -p[5],
        half - p[6],
        -p[8],
        p[2],
        -p[7],
        -p[8],
        half - p[9],
        p[3],
        p[1],
        p[2],
        p[3],
        p[0],
    )
}

/// Parameters of a pseudo-inertia.
#[must_use]
pub fn from_pseudo(j: &Matrix4<f64>) -> Ten {
    let trace = j[(0, 0)] + j[(1, 1)] + j[(2, 2)];
    Ten::from_column_slice(&[
        j[(3, 3)],
        j[(0, 3)],
        j[(1, 3)],
        j[(2, 3)],
        trace - j[(0, 0)],
        -j[(0, 1)],
        trace - j[(1, 1)],
        -j[(0, 2)],
        -j[(1, 2)],
        trace - j[(2, 2)],
    ])
}

/// An inertia that a body of at least a mass can have, and whether it differs from the given one.
fn possible(given: &Inertia, least: f64, middle: Vector3<f64>) -> (Ten, bool) {
    if given.mass < least {
        let sphere = Matrix3::identity() * (0.4 * 2.5 * least * GUESSED_RADIUS.powi(2));
        return (ten(&Inertia::from_central(least, middle, sphere)), true);
    }
    let central = given.central();
    let second = Matrix3::from_diagonal_element(0.5 * central.trace()) - central;
    let eigen = second.symmetric_eigen();
    let smallest = eigen.eigenvalues.min();
    let floor = given.mass * MIN_RADIUS.powi(2);
    let changed = smallest < -1e-6 * eigen.eigenvalues.amax().max(floor);
    let bounded = eigen.eigenvalues.map(|x| x.max(floor));
    let second =
        eigen.eigenvectors * Matrix3::from_diagonal(&bounded) * eigen.eigenvectors.transpose();
    let central = Matrix3::from_diagonal_element(second.trace()) - second;
    (
        ten(&Inertia::from_central(given.mass, given.center(), central)),
        changed,
    )
}

/// Inertias of links, each about its own frame, that add up to those of their bodies.
///
/// The inertias of links that fixed joints hold to a body's first link stay, where the first link's rest is one that a
/// body can have. Otherwise all parts change alike, `J' = T J T^T`, with `T = U U0^-1` of the body's upper factors. Its last row
/// is `[0 0 0 t]`: parts are shifted and stretched alike, each stays possible, and one factor changes all masses.
#[must_use]
pub fn of_links(robot: &Robot<'_>, bodies: &[Inertia]) -> Vec<(String, Inertia)> {
    let mut out = Vec::new();
    for (index, whole) in bodies.iter().enumerate() {
        let frames = robot.model.frames().iter().filter(|f| f.body == index + 1);
        let (own, fixed): (Vec<_>, Vec<_>) = frames.partition(|f| !f.rigid);
        let Some(own) = own.first() else { continue };
        let rest = fixed
            .iter()
            .fold(*whole, |sum, f| sum - f.inertia.transformed(&f.placement));
        if pseudo(&ten(&rest)).cholesky().is_some() {
            out.push((own.name.clone(), rest));
            continue;
        }
        let before = robot.model.bodies()[index + 1].inertia;
        let factors = upper(&pseudo(&ten(whole))).zip(upper(&pseudo(&ten(&before))));
        let map = factors.and_then(|(new, old)| Some(new * old.try_inverse()?));
        let Some(map) = map else {
            out.push((own.name.clone(), *whole));
            out.extend(fixed.iter().map(|f| (f.name.clone(), Inertia::zero())));
            continue;
        };
        for frame in std::iter::once(own).chain(&fixed) {
            let part = pseudo(&ten(&frame.inertia.transformed(&frame.placement)));
            let moved = inertia(&from_pseudo(&(map * part * map.transpose())));
            out.push((
                frame.name.clone(),
                moved.transformed(&frame.placement.inverse()),
            ));
        }
    }
    out
}

/// U, upper triangular with `J = U U^T`; none where J is not positive definite.
fn upper(j: &Matrix4<f64>) -> Option<Matrix4<f64>> {
    let reversed = |m: &Matrix4<f64>| Matrix4::from_fn(|i, k| m[(3 - i, 3 - k)]);
    reversed(j).cholesky().map(|c| reversed(&c.l()))
}

/// Pseudo-inertias of the unit parameters.
fn units() -> [Matrix4<f64>; PARAMETERS] {
    std::array::from_fn(|k| {
        let mut unit = Ten::zeros();
        unit[k] = 1.0;
        pseudo(&unit)
    })
}

/// Second derivative of `-log det J` by the parameters: tr(J^-1 E_a J^-1 E_b).
fn hessian(inverse: &Matrix4<f64>) -> TenByTen {
    let products = units().map(|e| inverse * e);
    TenByTen::from_fn(|a, b| (products[a] * products[b]).trace())
}

/// The solution for normal equations `A x = m` of which the first unknowns are the bodies', from a start that the prior
/// admits. None where the equations are not finite.
///
/// The weight of `-log det J` falls to `lambda` in steps from one that keeps every body far from the boundary
/// (path-following, Nesterov and Nemirovskii 1994), while that of `tr(J0^-1 J)` is `lambda` or little more throughout:
/// pulled by it towards a prior of a much lighter body, Newton's steps would run into the boundary and creep along it.
#[must_use]
pub fn fit(
    a: &DMatrix<f64>,
    m: &DVector<f64>,
    prior: &Prior,
    lambda: f64,
    start: DVector<f64>,
) -> Option<DVector<f64>> {
    let mut x = start;
    let mut barrier = lambda.max(first_barrier(&(a * &x - m), prior));
    loop {
        // Without any pull, bodies that no torque determines would grow beyond what numbers hold.
        let pull = lambda.max(PULL_OF_BARRIER * barrier);
        x = minimum(a, m, prior, [pull, barrier], x)?;
        if barrier <= lambda {
            return Some(x);
        }
        barrier = (barrier * BARRIER_STEP).max(lambda);
    }
}

/// Weight of the barrier from which the first Newton step stays inside: the gradient's length in
/// the barrier's own metric.
fn first_barrier(gradient: &DVector<f64>, prior: &Prior) -> f64 {
    let bodies = prior.curvature.iter().enumerate();
    let square = bodies.map(|(body, curvature)| {
        let own = of_body(gradient, body);
        curvature
            .cholesky()
            .map_or(0.0, |c| c.solve(&own).dot(&own))
    });
    square.sum::<f64>().max(0.0).sqrt()
}

/// The minimum at weights of prior and barrier by Newton's method, from a start inside.
fn minimum(
    a: &DMatrix<f64>,
    m: &DVector<f64>,
    prior: &Prior,
    [lambda, barrier]: [f64; 2],
    start: DVector<f64>,
) -> Option<DVector<f64>> {
    let bodies = prior.inverse.len();
    let units = units();
    let value = |x: &DVector<f64>| -> Option<f64> {
        let mut sum = 0.5 * (a * x).dot(x) - m.dot(x);
        for body in 0..bodies {
            let j = pseudo(&of_body(x, body));
            let factor = j.cholesky()?;
            let log_det = 2.0 * factor.l_dirty().diagonal().map(f64::ln).sum();
            sum += lambda * (prior.inverse[body] * j).trace() - barrier * log_det;
        }
        Some(sum)
    };
    let mut x = start;
    let mut now = value(&x)?;
    for _ in 0..STEPS {
        let (mut gradient, mut curvature) = (a * &x - m, a.clone());
        for body in 0..bodies {
            let inverse = pseudo(&of_body(&x, body)).cholesky()?.inverse();
            let at = PARAMETERS * body;
            for (k, unit) in units.iter().enumerate() {
                let slope = (prior.inverse[body] * lambda - inverse * barrier) * unit;
                gradient[at + k] += slope.trace();
            }
            let mut block = curvature.view_mut((at, at), (PARAMETERS, PARAMETERS));
            block += hessian(&inverse) * barrier;
        }
        // Rounding at the boundary: the place reached is as good as it gets.
        let Some(factor) = Factor::new(&curvature) else {
            break;
        };
        let step = -factor.solve(&gradient);
        let decrement = -gradient.dot(&step);
        // A share of the barrier's own weight: less is not seen in any body.
        if decrement.is_nan() || decrement <= 1e-8 * barrier {
            break;
        }
        let mut length = 1.0;
        let lower = |length: f64| {
            let next = &x + &step * length;
            let lower = value(&next).filter(|f| *f <= now - 0.25 * length * decrement);
            lower.map(|f| (next, f))
        };
        let found = loop {
            match lower(length) {
                None if length > 1e-9 => length *= 0.5,
                found => break found,
            }
        };
        let Some(found) = found else {
            break;
        };
        (x, now) = found;
    }
    Some(x)
}

/// Ridges of a matrix scaled to a diagonal of ones, tried in turn until rounding leaves it positive.
const RIDGES: [f64; 4] = [1e-13, 1e-11, 1e-9, 1e-6];

/// A positive definite matrix whose unknowns have different units, scaled and factored.
#[derive(Debug, Clone)]
pub struct Factor {
    scale: DVector<f64>,
    factor: Cholesky<f64, Dyn>,
}

impl Factor {
    /// None where the matrix is not finite, or negative beyond rounding.
    #[must_use]
    pub fn new(a: &DMatrix<f64>) -> Option<Self> {
        let scale = a
            .diagonal()
            .map(|d| if d > 0.0 { d.sqrt().recip() } else { 1.0 });
        let scaled = DMatrix::from_fn(a.nrows(), a.ncols(), |i, j| a[(i, j)] * scale[i] * scale[j]);
        let with = |ridge: &f64| {
            let mut m = scaled.clone();
            (0..m.nrows()).for_each(|i| m[(i, i)] += ridge);
            m.cholesky()
        };
        let factor = RIDGES.iter().find_map(with)?;
        Some(Self { scale, factor })
    }

    /// `A^-1 b`.
    #[must_use]
    pub fn solve(&self, b: &DVector<f64>) -> DVector<f64> {
        self.factor
            .solve(&b.component_mul(&self.scale))
            .component_mul(&self.scale)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn body(seed: f64) -> Ten {
        let c = Vector3::new(0.1 * seed, -0.2, 0.05);
        let central = Matrix3::new(0.03, 0.002, 0.0, 0.002, 0.04, -0.003, 0.0, -0.003, 0.05) * seed;
        ten(&Inertia::from_central(2.0 * seed, c, central))
    }

    #[test]
    fn parameters_and_pseudo_inertia_are_two_forms_of_one() {
        let p = body(1.3);
        assert!((from_pseudo(&pseudo(&p)) - p).norm() < 1e-15);
        assert!((ten(&inertia(&p)) - p).norm() == 0.0);
        assert!(pseudo(&p).cholesky().is_some());
        let too_flat = Inertia::from_central(
            1.0,
            Vector3::zeros(),
            Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, 2.5)),
        );
        assert!(pseudo(&ten(&too_flat)).cholesky().is_none());
        let (mended, changed) = possible(&too_flat, 0.1, Vector3::zeros());
        assert!(changed && pseudo(&mended).cholesky().is_some());
    }

    #[test]
    fn the_upper_factor_scales_masses_alone() {
        let (a, b) = (pseudo(&body(1.3)), pseudo(&body(0.7)));
        let u = upper(&a).unwrap();
        assert!((u * u.transpose() - a).norm() < 1e-12);
        let map = upper(&b).unwrap() * u.try_inverse().unwrap();
        assert!((map * a * map.transpose() - b).norm() < 1e-12);
        assert!(map.row(3).columns(0, 3).norm() < 1e-12);
    }

    /// Gradient and curvature of the barrier against differences.
    #[test]
    fn the_curvature_is_that_of_the_divergence() {
        let p = body(0.7);
        let log_det = |p: &Ten| -pseudo(p).determinant().ln();
        let exact = hessian(&pseudo(&p).try_inverse().unwrap());
        let h = 1e-5;
        for a in 0..PARAMETERS {
            for b in 0..PARAMETERS {
                let at = |i: f64, j: f64| {
                    let mut x = p;
                    x[a] += i * h * 1e-1;
                    x[b] += j * h * 1e-1;
                    log_det(&x)
                };
                let found = (at(1.0, 1.0) - at(1.0, -1.0) - at(-1.0, 1.0) + at(-1.0, -1.0))
                    / (4.0 * h * h * 1e-2);
                let tolerance = 2e-2 * (exact[(a, a)] * exact[(b, b)]).sqrt();
                assert!(
                    (found - exact[(a, b)]).abs() < tolerance,
                    "{a} {b}: {found} {}",
                    exact[(a, b)]
                );
            }
        }
    }

    /// A body fifty times heavier than the prior's, and at another place: the minimum is reached.
    #[test]
    fn the_minimum_is_reached_from_afar() {
        let small = ten(&Inertia::from_central(
            0.2,
            Vector3::zeros(),
            Matrix3::identity() * 1e-5,
        ));
        let inverse = pseudo(&small).try_inverse().unwrap();
        let prior = Prior {
            parameters: DVector::from_column_slice(small.as_slice()),
            curvature: vec![hessian(&inverse)],
            inverse: vec![inverse],
            weighed: vec![true],
            guessed: false,
            mended: Vec::new(),
        };
        let centre = Vector3::new(0.1, 0.02, -0.15);
        let truth = ten(&Inertia::from_central(
            10.0,
            centre,
            Matrix3::identity() * 0.02,
        ));
        let truth = DVector::from_column_slice(truth.as_slice());
        // Torques feel moments a hundred times less than masses, and some sums hardly at all.
        let a = DMatrix::from_fn(10, 10, |i, j| {
            let own = if i == j {
                [1e6, 1e4][usize::from(i > 3)]
            } else {
                0.0
            };
            own + 1e3 * f64::from(u8::from(i > 3 && j > 3))
        });
        let m = &a * &truth;
        let found = fit(&a, &m, &prior, 1e-4, prior.parameters.clone()).unwrap();
        assert!(prior.admits(&found));
        let error = &found - &truth;
        assert!(error.norm() < 1e-3 * truth.norm(), "{found} {truth}");
        let [error, moments] = [&error, &truth].map(|x| x.rows(4, 6).norm());
        assert!(error < 1e-2 * moments, "{error} {moments}");
    }
}
