//! Streamed velocities: a joint that follows desired velocities within limits of acceleration and jerk (K), planned by
//! the library rsruckig, and comes to rest before its position limits.
//!
//! In each cycle the next state on the way to the desired velocity is tried. It is taken if the joint could still be
//! stopped from it, jerk-limited, within its position limits; else the joint is stopped from where it is, which the
//! cycle before has made sure of. A joint that has been stopped so stays until it is asked to go the other way.

use core::ops::RangeInclusive;

use rsruckig::prelude::ControlInterface;

use crate::point_to_point::{MotionLimits, PlannedMotion, Planner, Way, at};

/// Velocity below which a joint that is stopped counts as standing, of its limit. Chosen; no experiment recorded.
const STANDS: f64 = 1e-6;

/// One joint that follows velocities.
#[derive(Debug)]
pub struct VelocityStream {
    limits: MotionLimits,
    range: RangeInclusive<f64>,
    now: PlannedMotion,
    /// The direction in which a position limit stopped it, 1 or -1.
    stopped: Option<f64>,
}

/// Plans the joints' motions: one for all of them, as it is large.
#[derive(Debug)]
pub struct VelocityPlanner(Planner);

impl Default for VelocityPlanner {
    fn default() -> Self {
        Self::new()
    }
}

impl VelocityPlanner {
    /// A planner; allocates.
    #[must_use]
    pub fn new() -> Self {
        Self(Planner::new())
    }

    /// The state `dt` (s) later on the way from `from` to a velocity that stays, and where that way ends, rad.
    fn plan(
        &mut self,
        from: PlannedMotion,
        velocity: f64,
        limits: MotionLimits,
        dt: f64,
    ) -> Option<(PlannedMotion, f64)> {
        let way = Way {
            from,
            to: velocity,
            limits,
        };
        let trajectory = self.0.plan_once(ControlInterface::Velocity, &way)?;
        let next = at(trajectory, dt);
        let end = at(trajectory, trajectory.duration);
        let numbers = [next.q, next.dq, next.ddq, end.q];
        numbers
            .iter()
            .all(|x| x.is_finite())
            .then_some((next, end.q))
    }
}

impl VelocityStream {
    /// A joint with its limits, and the positions within which it comes to rest, rad.
    #[must_use]
    pub fn new(limits: MotionLimits, range: RangeInclusive<f64>) -> Self {
        Self {
            limits,
            range,
            now: PlannedMotion::default(),
            stopped: None,
        }
    }

    /// The joint is here.
    pub fn start(&mut self, now: PlannedMotion) {
        (self.now, self.stopped) = (now, None);
    }

    /// The joint `dt` (s) later, on the way to the desired velocity, rad/s. A velocity that is not finite is zero.
    pub fn advance(
        &mut self,
        planner: &mut VelocityPlanner,
        velocity: f64,
        dt: f64,
    ) -> PlannedMotion {
        let most = self.limits.velocity;
        let asked = if velocity.is_finite() {
            velocity.max(-most).min(most)
        } else {
            0.0
        };
        if self
            .stopped
            .is_some_and(|direction| direction * asked <= 0.0)
        {
            self.stopped = None;
        }
        let next = match self.stopped {
            None => self.towards(planner, asked, dt),
            Some(_) => None,
        };
        self.now = match next {
            Some(next) => next,
            None => self.stop(planner, asked, dt),
        };
        self.now
    }

    /// The next state towards a velocity; none where the joint could not be stopped from it within its limits.
    fn towards(&self, planner: &mut VelocityPlanner, asked: f64, dt: f64) -> Option<PlannedMotion> {
        let now = self.now;
        let next = if now.dq == asked && now.ddq == 0.0 {
            PlannedMotion {
                q: now.q + asked * dt,
                ..now
            }
        } else {
            planner.plan(now, asked, self.limits, dt)?.0
        };
        let way = self.longest_stop(&next);
        let is_far = self.range.contains(&(next.q - way)) && self.range.contains(&(next.q + way));
        if is_far {
            return Some(next);
        }
        let (_, end) = planner.plan(next, 0.0, self.limits, dt)?;
        let ahead = if end > next.q {
            self.range.end()
        } else {
            self.range.start()
        };
        // Beyond a limit a joint may come back, as slowly as it likes.
        let comes_back =
            (end - ahead).abs() <= (now.q - ahead).abs() && !self.range.contains(&now.q);
        (self.range.contains(&end) || comes_back).then_some(next)
    }

    fn stop(&mut self, planner: &mut VelocityPlanner, asked: f64, dt: f64) -> PlannedMotion {
        let now = self.now;
        if asked != 0.0 {
            self.stopped = Some(asked.signum());
        }
        let stands = now.dq.abs() <= STANDS * self.limits.velocity && now.ddq == 0.0;
        let next = planner.plan(now, 0.0, self.limits, dt).filter(|_| !stands);
        // A joint without a way to stop stays where it is.
        next.map_or(
            PlannedMotion {
                q: now.q,
                ..PlannedMotion::default()
            },
            |(next, _)| next,
        )
    }

    /// More than the way on which the joint can be stopped, rad: the acceleration is led to nothing first, which adds
    /// to the velocity, and then the velocity is.
    fn longest_stop(&self, from: &PlannedMotion) -> f64 {
        let MotionLimits {
            acceleration, jerk, ..
        } = self.limits;
        let lead = from.ddq.abs() / jerk;
        let fastest = from.dq.abs() + from.ddq.abs() * lead;
        fastest
            * (lead
                + fastest / acceleration
                + 2.0 * (acceleration / jerk + (fastest / jerk).sqrt()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: MotionLimits = MotionLimits {
        velocity: 2.0,
        acceleration: 10.0,
        jerk: 200.0,
    };
    const DT: f64 = 1e-3;

    fn joint() -> (VelocityStream, VelocityPlanner) {
        (
            VelocityStream::new(LIMITS, -1.0..=1.0),
            VelocityPlanner::new(),
        )
    }

    /// Follows velocities; each step is within the limits.
    fn run(
        joint: &mut VelocityStream,
        planner: &mut VelocityPlanner,
        cycles: usize,
        velocity: impl Fn(usize) -> f64,
    ) -> PlannedMotion {
        let mut last = joint.now;
        for k in 0..cycles {
            let now = joint.advance(planner, velocity(k), DT);
            assert!(now.dq.abs() <= LIMITS.velocity + 1e-9, "{k}: {now:?}");
            assert!(now.ddq.abs() <= LIMITS.acceleration + 1e-9, "{k}: {now:?}");
            let jerk = (now.ddq - last.ddq) / DT;
            assert!(jerk.abs() <= LIMITS.jerk * 1.0001, "{k}: {jerk}");
            let mean = 0.5 * (last.dq + now.dq);
            assert!((now.q - last.q - mean * DT).abs() < 1e-6, "{k}: a jump");
            assert!((-1.0 - 1e-9..=1.0 + 1e-9).contains(&now.q), "{k}: {now:?}");
            last = now;
        }
        last
    }

    #[test]
    fn a_velocity_is_reached_and_kept() {
        let (mut joint, mut planner) = joint();
        let now = run(&mut joint, &mut planner, 300, |_| 0.8);
        assert!((now.dq - 0.8).abs() < 1e-9 && now.ddq == 0.0, "{now:?}");
    }

    #[test]
    fn it_comes_to_rest_just_before_a_limit_and_leaves_it_again() {
        for velocity in [0.01, 0.3, 2.0, 50.0, -2.0] {
            let (mut joint, mut planner) = joint();
            let now = run(&mut joint, &mut planner, 150_000, |_| velocity);
            assert!(now.dq.abs() < 1e-6, "{velocity}: {now:?}");
            let left = 1.0 - now.q.abs();
            assert!((0.0..0.01).contains(&left), "{velocity}: {left}");
            let now = run(&mut joint, &mut planner, 500, |_| -velocity.signum());
            assert!((now.dq + velocity.signum()).abs() < 1e-6, "{now:?}");
        }
    }

    #[test]
    fn velocities_that_jump_in_every_cycle_break_no_limit() {
        let (mut joint, mut planner) = joint();
        let mut random = test_support::Random::new(7);
        for _ in 0..2000 {
            let cycles = (40.0 * random.unit()) as usize;
            let velocity = 6.0 * random.symmetric();
            run(&mut joint, &mut planner, cycles, |_| velocity);
        }
    }

    #[test]
    fn what_is_no_number_stops_the_joint() {
        let (mut joint, mut planner) = joint();
        run(&mut joint, &mut planner, 100, |_| 1.0);
        let now = run(&mut joint, &mut planner, 500, |_| f64::NAN);
        assert!(now.dq.abs() < 1e-6, "{now:?}");
    }

    #[test]
    fn a_joint_beyond_its_limit_only_comes_back() {
        let (mut joint, mut planner) = joint();
        joint.start(PlannedMotion {
            q: 1.2,
            ..PlannedMotion::default()
        });
        (0..500).for_each(|_| _ = joint.advance(&mut planner, 1.0, DT));
        assert!((joint.now.q - 1.2).abs() < 1e-3, "{:?}", joint.now);
        (0..3000).for_each(|_| _ = joint.advance(&mut planner, -0.5, DT));
        assert!(joint.now.q < 0.0, "{:?}", joint.now);
    }
}
