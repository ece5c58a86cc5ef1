//! Floor: the ground under the robot, seen from above.

use super::ground::{EDGE, LOAD};
use super::{Foot, MAX_FEET};
use crate::sole::{Sole, convex_hull};
use dynamics::Se3;
use nalgebra::{Matrix3, Vector2, Vector3};

/// Axes on the ground: along the first sole, to the left of it, up; from that sole's middle.
#[derive(Debug, Clone, Copy)]
pub(super) struct Floor {
    /// That foot's place in the list of feet.
    pub(super) foot: usize,
    pub(super) origin: Vector3<f64>,
    pub(super) axes: Matrix3<f64>,
}

impl Floor {
    /// The floor under a sole that stands, whose sensor is there and has up so, both in the axes of the base.
    pub(super) fn under(foot: usize, sole: &Sole, at: &Se3, up: &Vector3<f64>) -> Option<Self> {
        let along = at.rotation * sole.axes().column(0);
        let forward = (along - up * up.dot(&along)).try_normalize(0.1)?;
        Some(Self {
            foot,
            origin: at.act_point(sole.origin()),
            axes: Matrix3::from_columns(&[forward, up.cross(&forward), *up]),
        })
    }

    pub(super) fn of(&self, point: &Vector3<f64>) -> Vector2<f64> {
        self.axes.tr_mul(&(point - self.origin)).xy()
    }
}

impl Foot {
    /// Least share of the weight that it bears: none in the end of one that is about to leave the ground. One that has just
    /// come back is pressed down by as much as one that stands, or it would not be felt.
    pub(super) fn least(&self) -> f64 {
        if self.lifts {
            LOAD * self.bears
        } else {
            LOAD.min(self.bears)
        }
    }

    /// How much its middle counts for where the centre of mass is to be: a foot that has come back takes part by and by.
    fn counts(&self) -> f64 {
        if self.lifts {
            0.0
        } else {
            self.bears * self.bears * (3.0 - 2.0 * self.bears)
        }
    }
}

/// Corners of all soles, and one that closes their hull.
const PLACES: usize = 8 * MAX_FEET + 1;

/// The soles on which the robot stands, on the floor.
#[derive(Debug, Clone, Copy)]
pub(super) struct Soles {
    /// Mean of the middles of those that stay on the ground.
    pub(super) middle: Vector2<f64>,
    /// Their hull, counter-clockwise.
    hull: [Vector2<f64>; PLACES],
    /// Where the centre of pressure may be, from the middle: off the edges, and every foot bears its least load.
    held: [Vector2<f64>; PLACES],
    /// Hull of the soles that stay on the ground, off their edges.
    lasting: [Vector2<f64>; PLACES],
    counts: [usize; 3],
}

impl Soles {
    /// The soles on which the robot stands, on the floor.
    pub(super) fn new(feet: &[Foot], floor: &Floor) -> Option<Self> {
        let standing = || feet.iter().filter(|foot| foot.stands);
        let middle_of = |foot: &Foot| floor.of(&foot.at.act_point(foot.sole.origin()));
        // Middle of the soles but one, each as far as it counts, and by how much they count.
        let middle = |without: Option<&Foot>, counts: fn(&Foot) -> f64| {
            let others =
                standing().filter(|foot| without.is_none_or(|own| !core::ptr::eq(own, *foot)));
            let (sum, all) = others.fold((Vector2::zeros(), 0.0), |(sum, all), foot| {
                (sum + middle_of(foot) * counts(foot), all + counts(foot))
            });
            (sum / f64::max(all, f64::MIN_POSITIVE), all)
        };
        let (of_lasting, lasting) = middle(None, Foot::counts);
        let mut soles = Self {
            middle: if lasting > 0.0 {
                of_lasting
            } else {
                middle(None, |_| 1.0).0
            },
            hull: [Vector2::zeros(); PLACES],
            held: [Vector2::zeros(); PLACES],
            lasting: [Vector2::zeros(); PLACES],
            counts: [0; 3],
        };
        let mut corners = [[Vector2::zeros(); PLACES]; 3];
        let [mut count, mut stay] = [0; 2];
        for foot in standing() {
            let own_middle = middle_of(foot);
            let (of_others, others) = middle(Some(foot), |foot| foot.bears);
            let least: f64 = standing()
                .filter(|other| !core::ptr::eq(foot, *other))
                .map(Foot::least)
                .sum();
            // This foot bears all that the others need not, as far as it may.
            let shares = if others > 0.0 {
                [foot.bears, foot.bears.min(1.0 - least)]
            } else {
                [1.0; 2]
            };
            for corner in foot.sole.corners() {
                let own = foot.sole.origin() + foot.sole.axes() * corner.push(0.0);
                let corner = floor.of(&foot.at.act_point(own));
                let pressed = own_middle + (corner - own_middle) * (1.0 - EDGE);
                corners[0][count] = corner * shares[0] + of_others * (1.0 - shares[0]);
                corners[1][count] =
                    pressed * shares[1] + of_others * (1.0 - shares[1]) - soles.middle;
                count += 1;
                if !foot.lifts {
                    corners[2][stay] = pressed;
                    stay += 1;
                }
            }
        }
        let [all, pressed, lasting] = &mut corners;
        soles.counts[0] = convex_hull(all.get_mut(..count)?, &mut soles.hull);
        soles.counts[1] = convex_hull(pressed.get_mut(..count)?, &mut soles.held);
        soles.counts[2] = convex_hull(lasting.get_mut(..stay)?, &mut soles.lasting);
        Some(soles)
    }

    pub(super) fn hull(&self) -> &[Vector2<f64>] {
        self.hull.get(..self.counts[0]).unwrap_or_default()
    }

    pub(super) fn lasting(&self) -> &[Vector2<f64>] {
        self.lasting.get(..self.counts[2]).unwrap_or_default()
    }

    pub(super) fn held(&self) -> &[Vector2<f64>] {
        self.held.get(..self.counts[1]).unwrap_or_default()
    }
}
