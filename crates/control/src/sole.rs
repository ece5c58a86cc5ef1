//! Sole: the flat underside of a foot, by its corners, in the axes of the F/T sensor above it.

use nalgebra::{Matrix3, Vector2, Vector3};

/// Most corners of a sole.
const MAX_CORNERS: usize = 8;
/// Greatest distance of a corner from the plane of all, m. Chosen: a sole's profile; no experiment recorded.
const FLAT_M: f64 = 5e-3;
/// Least distance of the sensor's origin from that plane, m: it shows which side is up. Chosen; no experiment recorded.
const ABOVE_M: f64 = 1e-3;
/// Least area of a sole, m². Chosen; no experiment recorded.
const LEAST_AREA_M2: f64 = 1e-4;

/// A convex sole.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sole {
    /// Its middle, in the sensor's axes, m.
    origin: Vector3<f64>,
    /// Its axes (columns) in the sensor's: x and y along the sole, z from the ground to the robot.
    axes: Matrix3<f64>,
    /// Corners of its hull along x and y from the middle, counter-clockwise, m.
    corners: [Vector2<f64>; MAX_CORNERS],
    count: usize,
}

impl Sole {
    /// What corners must be, in words.
    pub const ALLOWED: &'static str = "3 to 8 corners of a sole that lie in one plane to within 5 mm, at least 1 mm off the sensor's origin";

    /// The sole with these corners, m, in the axes of the F/T sensor; their order does not matter.
    ///
    /// # Errors
    /// What is wrong with the corners.
    pub fn new(corners: &[[f64; 3]]) -> Result<Self, String> {
        if !(3..=MAX_CORNERS).contains(&corners.len()) {
            return Err(format!("{} corners make no sole", corners.len()));
        }
        let points = || corners.iter().map(|corner| Vector3::from(*corner));
        let middle = points().sum::<Vector3<f64>>() / corners.len() as f64;
        // The normal is that of the greatest triangle with the middle.
        let spans = points().flat_map(|a| points().map(move |b| (a - middle).cross(&(b - middle))));
        let normal = spans.fold(Vector3::zeros(), |most: Vector3<f64>, span| {
            if span.norm() > most.norm() {
                span
            } else {
                most
            }
        });
        let Some(normal) = normal.try_normalize(LEAST_AREA_M2) else {
            return Err("the corners lie on a line".to_owned());
        };
        let off = points().map(|point| (point - middle).dot(&normal).abs());
        let off = off.fold(0.0, f64::max);
        if off > FLAT_M {
            return Err(format!(
                "a corner is {:.1} mm off the plane of all",
                1e3 * off
            ));
        }
        let above = -middle.dot(&normal);
        if above.abs() < ABOVE_M {
            return Err("the sole's plane goes through the sensor's origin".to_owned());
        }
        let z = normal * above.signum();
        let x = (Vector3::x() - z * z.x).try_normalize(0.5);
        let x = x.unwrap_or_else(|| (Vector3::y() - z * z.y).normalize());
        let axes = Matrix3::from_columns(&[x, z.cross(&x), z]);
        let flat = points().map(|point| axes.tr_mul(&(point - middle)).xy());
        let mut flat: Vec<Vector2<f64>> = flat.collect();
        let mut hull = [Vector2::zeros(); MAX_CORNERS];
        let count = convex_hull(&mut flat, &mut hull);
        let area = area(&hull[..count]);
        if area < LEAST_AREA_M2 {
            return Err(format!("an area of {:.1} cm² is no sole", 1e4 * area));
        }
        Ok(Self {
            origin: middle,
            axes,
            corners: hull,
            count,
        })
    }

    /// Its middle, in the sensor's axes, m.
    #[must_use]
    pub fn origin(&self) -> Vector3<f64> {
        self.origin
    }

    /// Its axes (columns) in the sensor's: x and y along the sole, z from the ground to the robot.
    #[must_use]
    pub fn axes(&self) -> &Matrix3<f64> {
        &self.axes
    }

    /// Corners of its hull along x and y from the middle, counter-clockwise, m.
    #[must_use]
    pub fn corners(&self) -> &[Vector2<f64>] {
        self.corners.get(..self.count).unwrap_or_default()
    }

    /// The nearest point to `point` of the sole made smaller by `margin` (share of the distance from the middle).
    #[must_use]
    pub fn nearest(&self, point: Vector2<f64>, margin: f64) -> Vector2<f64> {
        nearest_within(self.corners(), 1.0 - margin, point)
    }
}

/// Twice the area of the triangle `a b c`, positive counter-clockwise.
fn turn(a: Vector2<f64>, b: Vector2<f64>, c: Vector2<f64>) -> f64 {
    (b - a).perp(&(c - a))
}

fn area(hull: &[Vector2<f64>]) -> f64 {
    let next = hull.iter().cycle().skip(1);
    hull.iter().zip(next).map(|(a, b)| 0.5 * a.perp(b)).sum()
}

/// Convex hull of `points`, counter-clockwise (A. M. Andrew, 1979); sorts them, returns the number of corners in `hull`.
pub(crate) fn convex_hull(points: &mut [Vector2<f64>], hull: &mut [Vector2<f64>]) -> usize {
    let order = |a: &Vector2<f64>, b: &Vector2<f64>| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y));
    points.sort_unstable_by(order);
    let mut count = 0;
    let mut chain = |point: Vector2<f64>, first: usize, count: &mut usize| {
        while *count >= first + 2 && turn(hull[*count - 2], hull[*count - 1], point) <= 0.0 {
            *count -= 1;
        }
        if let Some(place) = hull.get_mut(*count) {
            *place = point;
            *count += 1;
        }
    };
    for &point in points.iter() {
        chain(point, 0, &mut count);
    }
    let lower = count.saturating_sub(1);
    for &point in points.iter().rev().skip(1) {
        chain(point, lower, &mut count);
    }
    // The first corner closes the chain.
    count.saturating_sub(1).max(points.len().min(1))
}

/// How far a point is inside a convex polygon (counter-clockwise), m: the distance from the nearest edge, negative
/// outside.
pub(crate) fn depth(hull: &[Vector2<f64>], point: Vector2<f64>) -> f64 {
    let next = hull.iter().cycle().skip(1);
    let edges = hull.iter().zip(next).map(|(a, b)| {
        let edge = b - a;
        edge.perp(&(point - a)) / edge.norm().max(f64::MIN_POSITIVE)
    });
    edges.fold(f64::INFINITY, f64::min)
}

/// The nearest point to `point` of a convex polygon (counter-clockwise, around its origin) times `scale`.
pub(crate) fn nearest_within(
    hull: &[Vector2<f64>],
    scale: f64,
    point: Vector2<f64>,
) -> Vector2<f64> {
    let mut nearest = point;
    let mut least = f64::INFINITY;
    let mut inside = true;
    let next = hull.iter().cycle().skip(1);
    for (a, b) in hull.iter().zip(next) {
        let (a, edge) = (a * scale, (b - a) * scale);
        if edge.perp(&(point - a)) >= 0.0 {
            continue;
        }
        inside = false;
        let along = edge.dot(&(point - a)) / edge.norm_squared().max(f64::MIN_POSITIVE);
        let at = a + edge * along.clamp(0.0, 1.0);
        let distance = (point - at).norm_squared();
        if distance < least {
            (nearest, least) = (at, distance);
        }
    }
    if inside { point } else { nearest }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const FOOT: [[f64; 3]; 4] = [
        [0.14, 0.07, -0.055],
        [0.14, -0.07, -0.055],
        [-0.1, 0.07, -0.055],
        [-0.1, -0.07, -0.055],
    ];

    #[test]
    fn corners_in_any_order_make_the_sole_below_the_sensor() {
        for order in [[0, 1, 2, 3], [3, 0, 2, 1], [2, 3, 1, 0]] {
            let sole = Sole::new(&order.map(|k| FOOT[k])).unwrap();
            assert!((sole.origin() - Vector3::new(0.02, 0.0, -0.055)).norm() < 1e-12);
            assert!((sole.axes() - Matrix3::identity()).norm() < 1e-12);
            assert_eq!(sole.corners().len(), 4);
            assert!((area(sole.corners()) - 0.24 * 0.14).abs() < 1e-12);
        }
        // A sensor that is mounted upside down has its sole above.
        let turned = FOOT.map(|[x, y, z]| [x, -y, -z]);
        let sole = Sole::new(&turned).unwrap();
        assert!((sole.axes().column(2) + Vector3::z()).norm() < 1e-12);
        assert!((sole.axes().determinant() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn what_is_no_sole_is_refused_in_words() {
        let wrong = |corners: &[[f64; 3]]| Sole::new(corners).unwrap_err();
        assert!(wrong(&FOOT[..2]).contains("2 corners"));
        assert!(wrong(&FOOT.map(|[x, _, z]| [x, 0.0, z])).contains("line"));
        assert!(wrong(&FOOT.map(|[x, y, _]| [x, y, 0.0])).contains("origin"));
        let mut bent = FOOT;
        bent[0][2] = -0.02;
        assert!(wrong(&bent).contains("plane"));
    }

    proptest! {
        #[test]
        fn the_nearest_point_is_none_farther_than_any_other(x in -0.5..0.5, y in -0.5..0.5, margin in 0.0..0.5) {
            let sole = Sole::new(&FOOT).unwrap();
            let point = Vector2::new(x, y);
            let nearest = sole.nearest(point, margin);
            let scale = 1.0 - margin;
            // The sole is a rectangle: of each coordinate alone.
            let by_axis = Vector2::new(x.clamp(-0.12 * scale, 0.12 * scale), y.clamp(-0.07 * scale, 0.07 * scale));
            prop_assert!((nearest - by_axis).norm() < 1e-9, "{nearest} {by_axis}");
            prop_assert_eq!(depth(sole.corners(), point) >= 0.0, x.abs() <= 0.12 && y.abs() <= 0.07);
        }

        #[test]
        fn a_hull_is_convex_and_holds_every_point(xs in prop::collection::vec((-1.0..1.0, -1.0..1.0), 3..16)) {
            let mut points: Vec<Vector2<f64>> = xs.iter().map(|(x, y)| Vector2::new(*x, *y)).collect();
            let all = points.clone();
            let mut hull = [Vector2::zeros(); 32];
            let count = convex_hull(&mut points, &mut hull);
            let hull = &hull[..count];
            prop_assert!(count >= 3);
            for k in 0..count {
                prop_assert!(turn(hull[k], hull[(k + 1) % count], hull[(k + 2) % count]) > 0.0);
            }
            prop_assert!(all.iter().all(|point| depth(hull, *point) > -1e-12));
        }
    }
}
