//! Footing: the feet on which mode stand counts, what each may bear, and where up is in its axes.
//!
//! A foot stands still, so up in its axes does too, and is not taken anew once it is known. A client lifts a foot: the
//! others take over what it bears, as the centre of mass comes over them, then it is free. It counts again when it bears
//! the robot, and the angles of the joints have it on the ground: an F/T sensor alone may err.

use control::MAX_FEET;
use nalgebra::Vector3;
use supervisor::time_in_a_row;

use crate::mode::{RigidBody, Unfit};

/// Time for which a foot may bear nothing, or something in the air, s: in a push it may be lighter than
/// [`control::Balance`] wants it. Chosen on the simulated humanoid, pushed by 60 N.
const LIFTED_S: f64 = 0.2;
/// Time for which a foot must have stood until where up is in its axes is not taken anew, s: up is a mean since then.
/// Chosen; no experiment recorded.
const KNOWN_S: f64 = 1.0;
/// Turn of up in the axes of every foot since it was taken at which the mode ends, rad: the IMU errs, or the ground tilts.
/// Chosen: 1 degree, the bound of what a fault may move. Pushes of 60 N turn it by less than 0.6 degrees in two worlds
/// (docs/results/standing.md).
const TILTED: f64 = core::f64::consts::PI / 180.0;

/// Turn of up under a foot that has come back at which the mode ends, rad: the floor sinks under the foot that showed where
/// up is, by 0.7 degrees on the simulated humanoid.
const TILTED_AFTER_A_STEP: f64 = 2.0 * TILTED;
/// Time constant with which up in the axes of a foot that has come back goes over to what the IMU shows since then, s: the
/// floor gives way under one foot otherwise than under two. Chosen on the simulated humanoid, whose angles alone were 1.4
/// degrees off after four steps.
const SINKS_S: f64 = 1.0;
/// Times in which a foot that is lifted gives its whole share of the weight away, and in which one that has come back
/// takes it, s. Chosen on the simulated humanoid (docs/results/standing.md).
const GIVES_S: f64 = 0.5;
const TAKES_S: f64 = 1.2;
/// Share of the weight, for each share that it may bear, that a foot must bear to be counted on more: two thirds of the least
/// that [`control::Balance`] asks it to bear. Chosen; in MuJoCo, whose joints stick, it made no clear difference.
const FELT: f64 = 0.08;
/// Share that a foot that has come back may bear at once. Chosen: of it [`control::Balance`] asks the foot to bear enough
/// to be felt.
const COMES_WITH: f64 = 0.25;
/// How far inside the other soles the capture point must be for a foot to give away more, m. Chosen on the simulated
/// humanoid, the middle of whose soles is 63 mm inside: with 10 mm the base turned by 3.6 degrees.
const RESERVE_M: f64 = 0.045;
/// Share of the weight on a foot from which on it touches the ground, and below which it touches it no more: above what F/T
/// sensors err by, and below what springs press a leg with that looks for the ground. Chosen on the simulated humanoid.
const TOUCHES: f64 = 0.03;
const TOUCHES_NO_MORE: f64 = 0.02;
/// Velocity with which a foot clears the ground, and looks for it when it is lifted no more, m/s; how far above its place
/// it is lifted in any case, and how far below it looks, m. Chosen; no experiment recorded.
const LOWERS: f64 = 0.03;
const CLEARS_M: f64 = 0.01;
const LOWEST_M: f64 = 0.04;
/// Distance of a sole from the ground by the joints' angles within which its sensor is believed to stand on it, m. Chosen:
/// five times what calibrated angles and a floor that gives way leave on the simulated humanoid.
const NEAR_M: f64 = 0.01;

/// Force, share of the weight, and moment over the weight, m, that F/T sensors may measure beside what carries the robot at
/// rest when the mode begins. More is a payload that the model does not know, something else that holds the robot, or a
/// sensor that errs. Chosen: sound simulated humanoids show at most 0.001 and 0.8 mm in two worlds, and one with a sensor
/// that is off by 50 N in each axis shows 0.09.
const FORCE_UNKNOWN: f64 = 0.06;
const MOMENT_UNKNOWN_M: f64 = 0.015;

#[derive(Debug, Clone, Copy, Default)]
struct Foot {
    sensor: usize,
    stands: bool,
    /// Greatest share of the weight that it may bear, 0 to 1.
    bears: f64,
    /// The client has lifted it, or lifts it.
    lifts: bool,
    /// It was lifted since the mode began.
    was_lifted: bool,
    /// Up in the axes of its sensor, and as it was first known.
    up: Vector3<f64>,
    first_up: Vector3<f64>,
    /// It was first known from the other feet, by the angles of the joints.
    by_others: bool,
    /// Time for which its sensor contradicts where it is, s: it stands, and bears nothing, or bears something in the air.
    contradicts_s: f64,
    /// How far below its place it is led in the air, m.
    below: f64,
}

#[derive(Debug)]
pub(super) struct Footing {
    feet: [Foot; MAX_FEET],
    count: usize,
}

impl Footing {
    /// Feet with these F/T sensors.
    pub(super) fn new(sensors: &[usize]) -> Self {
        let mut feet = [Foot::default(); MAX_FEET];
        for (foot, &sensor) in feet.iter_mut().zip(sensors) {
            foot.sensor = sensor;
        }
        let count = sensors.len().min(MAX_FEET);
        Self { feet, count }
    }

    fn feet(&self) -> &[Foot] {
        self.feet.get(..self.count).unwrap_or_default()
    }

    /// These are bits of feet, and not of all.
    pub(super) fn may_lift(&self, lifted: u32) -> bool {
        let all = self
            .feet()
            .iter()
            .fold(0, |bits, foot| bits | 1 << foot.sensor);
        lifted & !all == 0 && (lifted == 0 || lifted != all)
    }

    /// Begins on the feet that bear the robot.
    ///
    /// # Errors
    /// None does, or what the F/T sensors measure does not carry the robot.
    pub(super) fn begin(&mut self, body: &mut RigidBody) -> Result<(), Unfit> {
        let imbalance = body.imbalance();
        let mut all = 0;
        for foot in self.feet.iter_mut().take(self.count) {
            let under = body.ground_under(foot.sensor);
            let stands = under.is_some();
            *foot = Foot {
                sensor: foot.sensor,
                stands,
                bears: if stands { 1.0 } else { 0.0 },
                up: under.unwrap_or(Vector3::z()),
                first_up: under.unwrap_or(Vector3::z()),
                ..Foot::default()
            };
            all |= 1 << foot.sensor;
        }
        let balanced = imbalance.is_some_and(|imbalance| {
            imbalance.force < FORCE_UNKNOWN && imbalance.moment_m < MOMENT_UNKNOWN_M
        });
        if balanced && self.feet().iter().any(|foot| foot.stands) {
            Ok(())
        } else {
            Err(Unfit::FtSensors(all))
        }
    }

    /// A cycle passes, in which the client lifts feet (bits of sensors) and the capture point was so far inside the other
    /// soles, m. `near`: up in the axes of a foot and its height above the ground, by the angles.
    ///
    /// # Errors
    /// A foot that the client does not lift bears nothing, or one in the air something. Up turns under every foot.
    pub(super) fn update(
        &mut self,
        (lifted, reserve): (u32, f64),
        body: &RigidBody,
        near: impl Fn(usize) -> Option<(Vector3<f64>, f64)>,
        dt: f64,
    ) -> Result<(), Unfit> {
        let asked = |foot: &Foot| lifted >> foot.sensor & 1 == 1;
        let stays = self
            .feet()
            .iter()
            .any(|foot| foot.stands && foot.bears >= 1.0 && !asked(foot));
        let bears_all = self
            .feet()
            .iter()
            .any(|foot| foot.stands && foot.bears >= 1.0);
        let mut lost = 0;
        let mut least_turned = None;
        for (k, foot) in self.feet.iter_mut().enumerate().take(self.count) {
            let (under, load) = (body.ground_under(foot.sensor), body.load(foot.sensor));
            foot.lifts = asked(foot) && (stays || !foot.stands);
            foot.below = if foot.stands {
                0.0
            } else if foot.lifts {
                (foot.below - LOWERS * dt).max(-CLEARS_M)
            } else {
                (foot.below + LOWERS * dt).min(LOWEST_M)
            };
            if foot.stands {
                let touches = load > TOUCHES_NO_MORE;
                let contradicts_s = time_in_a_row(&mut foot.contradicts_s, !touches, dt);
                foot.stand(under, [reserve, load, body.stands_for(foot.sensor)], dt);
                if contradicts_s > LIFTED_S && !foot.lifts {
                    if foot.bears < 1.0 && bears_all {
                        // It has touched the ground, and does not stand on it yet.
                        (foot.stands, foot.bears) = (false, 0.0);
                    } else {
                        lost |= 1 << foot.sensor;
                    }
                }
            } else if foot.hang(near(k), load, dt) {
                lost |= 1 << foot.sensor;
            }
            if let Some(under) = under.filter(|_| foot.stands)
                && body.stands_for(foot.sensor) >= KNOWN_S
            {
                let most = if foot.by_others {
                    TILTED_AFTER_A_STEP
                } else {
                    TILTED
                };
                let turned = (under - foot.first_up).norm() / most;
                least_turned = Some(least_turned.map_or(turned, |least: f64| least.min(turned)));
            }
        }
        if lost != 0 {
            Err(Unfit::FtSensors(lost))
        } else if least_turned.is_some_and(|turned| turned > 1.0) {
            Err(Unfit::Imu)
        } else {
            Ok(())
        }
    }

    /// Up in the axes of each foot that stands.
    pub(super) fn up(&self) -> [Option<Vector3<f64>>; MAX_FEET] {
        self.feet.map(|foot| foot.stands.then_some(foot.up))
    }

    /// Greatest share of the weight that each foot may bear.
    pub(super) fn bears(&self) -> [f64; MAX_FEET] {
        self.feet.map(|foot| foot.bears)
    }

    /// Those that are about to leave the ground.
    pub(super) fn lifts(&self) -> [bool; MAX_FEET] {
        self.feet.map(|foot| foot.lifts)
    }

    /// A bit for the F/T sensor of each foot on which the robot stands.
    pub(super) fn stands_on(&self) -> u64 {
        let standing = self.feet().iter().filter(|foot| foot.stands);
        standing.fold(0, |bits, foot| bits | 1 << foot.sensor)
    }

    /// Feet in the air that the client has lifted in this mode, by their place in the list, and how far below their place
    /// they are led, m.
    pub(super) fn lifted(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        let feet = self.feet().iter().enumerate();
        let lifted = feet.filter(|(_, foot)| foot.was_lifted && !foot.stands);
        lifted.map(|(k, foot)| (k, foot.below))
    }
}

impl Foot {
    /// A cycle passes in which it does not stand: it may come down. Whether its sensor has felt the ground in the air.
    fn hang(&mut self, near: Option<(Vector3<f64>, f64)>, load: f64, dt: f64) -> bool {
        let Some((up, height)) = near else {
            return false;
        };
        let (touches, is_near) = (load > TOUCHES, height.abs() < NEAR_M);
        let in_air = self.was_lifted && touches && !is_near;
        let contradicts_s = time_in_a_row(&mut self.contradicts_s, in_air, dt);
        if touches && is_near && !self.lifts {
            (self.stands, self.bears, self.contradicts_s) = (true, COMES_WITH, 0.0);
            (self.up, self.first_up, self.by_others) = (up, up, true);
        }
        contradicts_s > LIFTED_S
    }

    /// A cycle passes in which it stands: with the reserve of the others, its share of the weight, and the time for which
    /// it bears.
    fn stand(&mut self, under: Option<Vector3<f64>>, [reserve, load, stands_s]: [f64; 3], dt: f64) {
        match under {
            Some(under) if self.by_others => {
                let share = dt / (dt + SINKS_S) * (stands_s / KNOWN_S).min(1.0);
                self.up = (self.up + (under - self.up) * share).normalize();
            }
            Some(under) if stands_s < KNOWN_S => (self.up, self.first_up) = (under, under),
            _ => {}
        }
        if !self.lifts {
            if load >= FELT * self.bears {
                self.bears = (self.bears + dt / TAKES_S).min(1.0);
            }
        } else if reserve > RESERVE_M {
            self.bears -= dt / GIVES_S;
            if self.bears <= 0.0 {
                (self.stands, self.bears, self.was_lifted) = (false, 0.0, true);
            }
        }
    }
}
