//! Floor: the ground under the robot, seen from above.

use super::ground::{EDGE, LOAD};
use super::{Foot, MAX_FEET};
use crate::sole::convex_hull;
use nalgebra::{Matrix3, Vector2, Vector3};

/// Axes on the ground: along the first sole, to the left of it, up; from that sole's middle.
#[derive(Debug, Clone, Copy)]
pub(super) struct Floor {
    pub(super) origin: Vector3<f64>,
    pub(super) axes: Matrix3<f64>,
}

impl Floor {
    pub(super) fn of(&self, point: &Vector3<f64>) -> Vector2<f64> {
        self.axes.tr_mul(&(point - self.origin)).xy()
    }
}

/// Corners of all soles, and one that closes their hull.
const PLACES: usize = 8 * MAX_FEET + 1;

/// The soles on which the robot stands, on the floor.
#[derive(Debug, Clone, Copy)]
pub(super) struct Soles {
    /// Mean of their middles.
    pub(super) middle: Vector2<f64>,
    /// Their hull, counter-clockwise.
    hull: [Vector2<f64>; PLACES],
    /// Where the centre of pressure may be, from the middle: off the edges, and every foot bears its least load.
    held: [Vector2<f64>; PLACES],
    counts: [usize; 2],
}

impl Soles {
    /// The soles on which the robot stands, on the floor.
    pub(super) fn new(feet: &[Foot], floor: &Floor) -> Option<Self> {
        let standing = || feet.iter().filter(|foot| foot.stands);
        let middle_of = |foot: &Foot| floor.of(&foot.at.act_point(foot.sole.origin()));
        let count_of_feet = standing().count() as f64;
        let middles: Vector2<f64> = standing().map(middle_of).sum();
        let mut soles = Self {
            middle: middles / f64::max(count_of_feet, 1.0),
            hull: [Vector2::zeros(); PLACES],
            held: [Vector2::zeros(); PLACES],
            counts: [0; 2],
        };
        let mut corners = [[Vector2::zeros(); PLACES]; 2];
        let mut count = 0;
        for foot in standing() {
            let own_middle = middle_of(foot);
            for corner in foot.sole.corners() {
                let own = foot.sole.origin() + foot.sole.axes() * corner.push(0.0);
                let corner = floor.of(&foot.at.act_point(own));
                corners[0][count] = corner;
                // This foot bears all that the others need not.
                let pressed = own_middle + (corner - own_middle) * (1.0 - EDGE);
                let rest = LOAD * (middles - own_middle);
                corners[1][count] =
                    pressed * (1.0 - LOAD * (count_of_feet - 1.0)) + rest - soles.middle;
                count += 1;
            }
        }
        let [all, pressed] = &mut corners;
        soles.counts[0] = convex_hull(all.get_mut(..count)?, &mut soles.hull);
        soles.counts[1] = convex_hull(pressed.get_mut(..count)?, &mut soles.held);
        Some(soles)
    }

    pub(super) fn hull(&self) -> &[Vector2<f64>] {
        self.hull.get(..self.counts[0]).unwrap_or_default()
    }

    pub(super) fn held(&self) -> &[Vector2<f64>] {
        self.held.get(..self.counts[1]).unwrap_or_default()
    }
}
