//! Vectors of six numbers, a linear and an angular part, and of joints.

use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};

/// A linear and an angular part in one vector.
pub(crate) fn six(linear: &Vector3<f64>, angular: &Vector3<f64>) -> Vector6<f64> {
    let (l, a) = (linear, angular);
    Vector6::new(l.x, l.y, l.z, a.x, a.y, a.z)
}

/// From a wrench in axes that are turned so, about a point, to one at the origin: linear part first.
pub(crate) fn wrench_map(rotation: &Matrix3<f64>, point: &Vector3<f64>) -> Matrix6<f64> {
    let mut map = Matrix6::zeros();
    let mut block = |row, column, part: &Matrix3<f64>| {
        map.fixed_view_mut::<3, 3>(row, column).copy_from(part);
    };
    block(0, 0, rotation);
    block(3, 0, &(point.cross_matrix() * rotation));
    block(3, 3, rotation);
    map
}

/// Copies as much as there is, and as there is room for.
pub(crate) fn copy<'a>(
    to: impl IntoIterator<Item = &'a mut f64>,
    from: impl IntoIterator<Item = &'a f64>,
) {
    for (to, from) in to.into_iter().zip(from) {
        *to = *from;
    }
}
