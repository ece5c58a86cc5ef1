//! Centre: how the centre of mass is led over the soles, as a linear inverted pendulum.

use super::floor::{Floor, Soles};
use super::observer::Observer;
use super::{Balance, BalanceInput, Balanced};
use crate::sole::{depth, nearest_within};
use dynamics::center_of_mass;
use nalgebra::{Vector2, Vector3};

/// The slower pole of the centre of mass is the pendulum's own, which leaves its stable part alone: all of the soles
/// is left to catch the other one. The other pole, as a multiple of it. Chosen on the simulated humanoid
/// (docs/results/standing.md).
pub(crate) const QUICKER: f64 = 2.5;
/// Frequency, critically damped, with which the place for the centre of mass is led to where it is asked for, rad/s.
/// Chosen: slower than the pendulum, so that leading it asks for a small part of the soles; no experiment recorded.
const LEADS: f64 = 2.0;
/// Share of the way from the middle of the soles to the edge of their hull within which a client may ask for the centre
/// of mass: the rest is left to catch it. Chosen; no experiment recorded.
const REACH: f64 = 0.5;

/// The place to which the centre of mass is led, on the floor.
#[derive(Debug, Clone, Copy)]
pub(super) struct Led {
    /// In the axes of this foot's floor.
    pub(super) foot: usize,
    pub(super) at: Vector2<f64>,
    pub(super) rate: Vector2<f64>,
    /// Forward as the base stood when it began.
    pub(super) forward: Vector2<f64>,
}

impl Balance {
    /// The place for the centre of mass in the axes of this floor: it was in those of a foot that has left the ground, or
    /// that was not the first.
    pub(super) fn take_along(&mut self, floor: &Floor) {
        let stand = self.feet.iter().enumerate().filter(|(_, foot)| foot.stands);
        let on = stand.fold(0, |bits, (k, _)| bits | 1 << k);
        if core::mem::replace(&mut self.observed_on, on) != on {
            // Other feet show it: where it is now, it is by them.
            (self.center, self.turned) = (None, None);
        }
        let Some(led) = self.led.filter(|led| led.foot != floor.foot) else {
            return;
        };
        self.led = self
            .floor_of(led.foot, &floor.axes.column(2).into())
            .map(|old| {
                let turn = floor.axes.tr_mul(&old.axes);
                let along = |x: &Vector2<f64>| (turn * x.push(0.0)).xy();
                Led {
                    foot: floor.foot,
                    at: floor.of(&(old.origin + old.axes * led.at.push(0.0))),
                    rate: along(&led.rate),
                    forward: along(&led.forward),
                }
            });
    }

    /// The acceleration of the centre of mass, on the floor, that leads it to its place, as far as the soles can hold it.
    pub(super) fn lead_center(
        &mut self,
        floor: &Floor,
        turn: &Vector3<f64>,
        input: &BalanceInput<'_>,
    ) -> Option<(Vector2<f64>, Vector3<f64>, Balanced)> {
        let center = center_of_mass(&self.model, &self.data);
        let height = floor.axes.column(2).dot(&(center - floor.origin));
        let m = self.data.mass_matrix();
        let mass = m[(0, 0)];
        let rate = Vector3::from_fn(|k, _| {
            let products = m.column(k).into_iter().zip(&self.v).map(|(m, v)| m * v);
            products.sum::<f64>() / mass
        });
        let (at, rate) = (floor.of(&center), floor.axes.tr_mul(&rate).xy());
        let observes = self.observes();
        let observed = self.center.get_or_insert(Observer {
            at,
            rate,
            disturbance: Vector2::zeros(),
            acceleration: Vector2::zeros(),
        });
        observed.update(&at, observes, input.dt);
        let rate = observed.rate;
        let pendulum = (self.gravity / height.max(0.05)).sqrt();

        let soles = Soles::new(&self.feet, floor)?;
        let capture = at + rate / pendulum;
        let reserve = depth(soles.lasting(), capture);
        let depth = depth(soles.hull(), capture);
        let led = self.lead(floor, (at, &soles), input);
        let (near, far) = (pendulum, QUICKER * pendulum);
        let wanted = near * far * (led.at - at) + (near + far) * (led.rate - rate);
        let pressure = at - wanted / (pendulum * pendulum);
        let pressure = soles.middle + nearest_within(soles.held(), 1.0, pressure - soles.middle);
        let balanced = Balanced {
            off: (at - led.at).into(),
            depth,
            reserve,
            solved: false,
        };
        let task = (at - pressure) * pendulum * pendulum;
        if let Some(center) = &mut self.center {
            center.acceleration = task;
        }
        let turn = self.within_soles(floor, &soles, pressure, turn);
        Some((task, turn, balanced))
    }

    /// Leads the place for the centre of mass towards the middle of the soles and what is asked for besides.
    pub(super) fn lead(
        &mut self,
        floor: &Floor,
        (at, soles): (Vector2<f64>, &Soles),
        input: &BalanceInput<'_>,
    ) -> Led {
        let led = self.led.get_or_insert_with(|| {
            let forward = floor.axes.tr_mul(&Vector3::x()).xy();
            Led {
                foot: floor.foot,
                at,
                rate: Vector2::zeros(),
                forward: forward.try_normalize(0.1).unwrap_or(Vector2::x()),
            }
        });
        let [forward, left] = input.offset;
        let offset = led.forward * forward + Vector2::new(-led.forward.y, led.forward.x) * left;
        let target = soles.middle + nearest_within(soles.held(), REACH, offset);
        let pull = LEADS * LEADS * (target - led.at) - 2.0 * LEADS * led.rate;
        led.rate += pull * input.dt;
        led.at += led.rate * input.dt;
        *led
    }
}
