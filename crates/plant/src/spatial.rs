//! Motions and forces as six-vectors about the world's origin in the world's axes, `[angular;
//! linear]`.

use nalgebra::{Matrix3, Matrix6, Rotation3, Unit, Vector3, Vector6};

/// `[angular; linear]` from its halves.
#[must_use]
pub fn stack(angular: Vector3<f64>, linear: Vector3<f64>) -> Vector6<f64> {
    Vector6::new(
        angular.x, angular.y, angular.z, linear.x, linear.y, linear.z,
    )
}

/// The halves of `[angular; linear]`.
#[must_use]
pub fn split(v: &Vector6<f64>) -> (Vector3<f64>, Vector3<f64>) {
    (
        Vector3::new(v[0], v[1], v[2]),
        Vector3::new(v[3], v[4], v[5]),
    )
}

/// The wrench about the world's origin of a force at a point.
#[must_use]
pub fn wrench_of(position: &Vector3<f64>, force: &Vector3<f64>) -> Vector6<f64> {
    stack(position.cross(force), *force)
}

/// Rotation by an angle about a unit axis.
#[must_use]
pub fn turn(axis: &Vector3<f64>, angle: f64) -> Matrix3<f64> {
    Rotation3::from_axis_angle(&Unit::new_unchecked(*axis), angle).into_inner()
}

/// Rate of a motion vector `m` carried along by `v`.
#[must_use]
pub fn cross_motion(v: &Vector6<f64>, m: &Vector6<f64>) -> Vector6<f64> {
    let ((w, l), (mw, ml)) = (split(v), split(m));
    stack(w.cross(&mw), w.cross(&ml) + l.cross(&mw))
}

/// Rate of a force vector `f` carried along by `v`.
#[must_use]
pub fn cross_force(v: &Vector6<f64>, f: &Vector6<f64>) -> Vector6<f64> {
    let ((w, l), (n, f)) = (split(v), split(f));
    stack(w.cross(&n) + l.cross(&f), w.cross(&f))
}

/// A symmetric six by six matrix from its blocks; `coupling` stands right of `angular`.
#[must_use]
pub fn symmetric(
    angular: &Matrix3<f64>,
    coupling: &Matrix3<f64>,
    linear: &Matrix3<f64>,
) -> Matrix6<f64> {
    let mut whole = Matrix6::zeros();
    let mut put = |i: usize, j: usize, block: &Matrix3<f64>| {
        whole.fixed_view_mut::<3, 3>(i, j).copy_from(block);
    };
    put(0, 0, angular);
    put(0, 3, coupling);
    put(3, 0, &coupling.transpose());
    put(3, 3, linear);
    whole
}
