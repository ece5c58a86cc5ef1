//! Stepping: steps in place by mode stand, as a client leads them.
//!
//! In: a pose in which the robot stands, its feet, and the feet on which it stands in each cycle. Out: the reference of
//! the next cycle. Of each step the client lifts the foot, waits until it is free, bends the leg so that the foot rises
//! along the base's axis and comes back, and waits until it stands again.

use dynamics::{
    Data, Model, ReferenceFrame, Se3, forward_kinematics, frame_jacobian, frame_placement,
};
use nalgebra::{DVector, Matrix6, Matrix6xX, Vector3};
use robot_state::{Mode, Reference};

use crate::cartesian::pose_error;

/// Time in which a foot rises and comes back, s. Chosen: a tenth of the humanoid's velocity limits at 30 mm.
const SWING_S: f64 = 1.0;
/// Time between two steps, s. Chosen; no experiment recorded.
const REST_S: f64 = 0.5;
/// Longest time for which a foot is awaited to be free, or to stand, s: several times what the centre of mass takes.
const PATIENCE_S: f64 = 8.0;
/// Damping, rounds and accuracy (m, rad) of the search of a leg's angles. Chosen: a knee that is bent is found in less
/// than ten rounds.
const DAMPING: f64 = 1e-4;
const ROUNDS: usize = 100;
const ACCURATE: f64 = 1e-6;

/// A leg whose foot is lifted.
#[derive(Debug, Clone)]
struct Leg {
    /// Bit of the foot's F/T sensor.
    bit: u32,
    /// Joints, in config order, and their way from standing to lifted, rad.
    ways: Vec<(usize, f64)>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    Rests,
    Gives,
    Swings,
    Comes,
}

/// See the module.
#[derive(Debug, Clone)]
pub struct Stepping {
    legs: Vec<Leg>,
    /// Angles in which the robot stands, rad, in config order.
    pose: Vec<f64>,
    phase: Phase,
    since_s: f64,
    steps: u64,
}

impl Stepping {
    /// Steps of a robot that stands at `pose` (rad, config order; `places` are the joints' in the model), in turn of the
    /// feet: index of the F/T sensor and its frame. Each rises by `height`, m. None where less than two feet can.
    #[must_use]
    pub fn new(
        model: &Model,
        places: &[usize],
        feet: &[(usize, usize)],
        pose: &[f64],
        height: f64,
    ) -> Option<Self> {
        let legs = feet.iter().map(|&(sensor, frame)| {
            let ways = leg_ways(model, places, frame, pose, height)?;
            Some(Leg {
                bit: 1u32.checked_shl(sensor as u32)?,
                ways,
            })
        });
        let legs: Vec<Leg> = legs.collect::<Option<_>>()?;
        (legs.len() > 1).then(|| Self {
            legs,
            pose: pose.to_vec(),
            phase: Phase::Rests,
            since_s: 0.0,
            steps: 0,
        })
    }

    /// Steps that have ended.
    #[must_use]
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// Sets the reference of a cycle that is `dt` (s) after the last one, in which the robot stood on the feet of
    /// `stands_on`. False: a foot has been awaited in vain, and the reference asks to stand.
    pub fn update(&mut self, stands_on: u64, reference: &mut Reference, dt: f64) -> bool {
        (reference.mode, reference.lifted_feet) = (Mode::Stand.number(), 0);
        for (joint, q) in reference.joints.iter_mut().zip(&self.pose) {
            (joint.q_d, joint.dq_d, joint.ddq_d) = (*q, 0.0, 0.0);
        }
        self.since_s += dt;
        let all = self
            .legs
            .iter()
            .fold(0, |bits, leg| bits | u64::from(leg.bit));
        if self.phase == Phase::Rests && stands_on & all != all && self.steps > 0 {
            // It has left the ground again.
            (self.phase, self.steps) = (Phase::Comes, self.steps - 1);
        }
        let turn = (self.steps % self.legs.len() as u64) as usize;
        let Some(leg) = self.legs.get(turn) else {
            return false;
        };
        let stands = stands_on & u64::from(leg.bit) != 0;
        let next = match self.phase {
            Phase::Rests => (self.since_s >= REST_S).then_some(Phase::Gives),
            Phase::Gives => (!stands).then_some(Phase::Swings),
            Phase::Swings => (self.since_s >= SWING_S).then_some(Phase::Comes),
            Phase::Comes => stands.then_some(Phase::Rests),
        };
        if let Some(next) = next {
            self.steps += u64::from(next == Phase::Rests);
            (self.phase, self.since_s) = (next, 0.0);
        }
        // On its way down it may stand whenever it meets the ground.
        let rises = self.phase == Phase::Swings && self.since_s < 0.8 * SWING_S;
        if self.phase == Phase::Gives || rises {
            reference.lifted_feet = leg.bit;
        }
        let motion = if self.phase == Phase::Swings {
            let [share, rate, acceleration] = rise_and_fall(self.since_s / SWING_S);
            [share, rate / SWING_S, acceleration / (SWING_S * SWING_S)]
        } else {
            [0.0; 3]
        };
        self.lead(turn, motion, reference);
        self.since_s < PATIENCE_S
    }

    /// Adds a share of a leg's way, and its derivatives.
    fn lead(&self, leg: usize, [share, rate, acceleration]: [f64; 3], reference: &mut Reference) {
        for &(j, way) in self.legs.get(leg).map_or(&[][..], |leg| &leg.ways) {
            if let Some(joint) = reference.joints.get_mut(j) {
                joint.q_d += way * share;
                joint.dq_d += way * rate;
                joint.ddq_d += way * acceleration;
            }
        }
    }
}

/// From 0 to 1 and back while `t` goes from 0 to 1, with its two derivatives: `(4 t (1 - t))^3`, which begins and ends
/// without velocity and acceleration.
fn rise_and_fall(t: f64) -> [f64; 3] {
    let t = t.clamp(0.0, 1.0);
    let (x, rate) = (4.0 * t * (1.0 - t), 4.0 - 8.0 * t);
    [
        x.powi(3),
        3.0 * x * x * rate,
        6.0 * x * rate * rate - 24.0 * x * x,
    ]
}

/// Ways of the joints between the base and a frame (config order, rad) that lift it along the base's z axis.
fn leg_ways(
    model: &Model,
    places: &[usize],
    frame: usize,
    pose: &[f64],
    height: f64,
) -> Option<Vec<(usize, f64)>> {
    let body = model.frames().get(frame)?.body;
    let first = model.base_size();
    let mut q = vec![0.0; model.nq()];
    if first.1 == 7 {
        q[6] = 1.0;
    }
    for (&place, angle) in places.iter().zip(pose) {
        *q.get_mut(first.1 + place)? = *angle;
    }
    let is_of = |place: usize| {
        let joint = model.joints().get(place);
        joint.is_some_and(|joint| model.supports(joint.body, body))
    };
    let joints = places
        .iter()
        .enumerate()
        .filter(|(_, place)| is_of(**place));
    let joints: Vec<(usize, usize)> = joints.map(|(j, place)| (j, *place)).collect();
    let mut data = Data::new(model);
    let mut jacobian = Matrix6xX::zeros(model.nv());
    let mut target: Option<Se3> = None;
    for _ in 0..ROUNDS {
        forward_kinematics(model, &mut data, &q);
        let at = frame_placement(model, &data, frame);
        let target = target.get_or_insert_with(|| Se3 {
            translation: at.translation + Vector3::z() * height,
            ..at
        });
        let error = pose_error(target, &at);
        if error.amax() < ACCURATE {
            let ways = joints.iter().map(|&(j, place)| {
                let angle = q.get(first.1 + place)?;
                Some((j, angle - pose.get(j)?))
            });
            return ways.collect();
        }
        let aligned = ReferenceFrame::LocalWorldAligned;
        frame_jacobian(model, &data, frame, aligned, &mut jacobian);
        let columns: Vec<_> = (joints.iter())
            .map(|(_, place)| jacobian.column(first.0 + place).into_owned())
            .collect();
        let own = Matrix6xX::from_columns(&columns);
        let damped = &own * own.transpose() + Matrix6::identity() * DAMPING * DAMPING;
        let step: DVector<f64> = own.transpose() * damped.cholesky()?.solve(&error);
        for ((_, place), step) in joints.iter().zip(step.iter()) {
            *q.get_mut(first.1 + place)? += step.clamp(-0.2, 0.2);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stepping() -> Stepping {
        let legs = [1, 2].map(|bit| Leg {
            bit,
            ways: vec![(bit as usize, 0.3)],
        });
        Stepping {
            legs: legs.into(),
            pose: vec![0.1; 4],
            phase: Phase::Rests,
            since_s: 0.0,
            steps: 0,
        }
    }

    #[test]
    fn a_rise_ends_as_it_begins_and_its_derivatives_are_its_own() {
        for t in [0.0, 1.0] {
            assert_eq!(rise_and_fall(t), [0.0; 3]);
        }
        assert_eq!(rise_and_fall(0.5)[0], 1.0);
        let h = 1e-5;
        for t in [0.1, 0.3, 0.5, 0.8] {
            let [before, now, after] = [t - h, t, t + h].map(rise_and_fall);
            assert!((now[1] - (after[0] - before[0]) / (2.0 * h)).abs() < 1e-6);
            assert!((now[2] - (after[1] - before[1]) / (2.0 * h)).abs() < 1e-6);
        }
    }

    #[test]
    fn a_leg_moves_only_while_its_foot_is_free_and_feet_take_turns() {
        let (mut stepping, mut reference) = (stepping(), Reference::default());
        let mut on = 3;
        for _ in 0..6000 {
            assert!(stepping.update(on, &mut reference, 1e-3));
            for (j, joint) in reference.joints.iter().enumerate().take(4) {
                let lifted = joint.q_d != 0.1;
                assert!(!lifted || on & j as u64 == 0, "joint {j} on {on}");
            }
            // A foot is free as soon as it is lifted, and stands again when its leg is back.
            let back = reference
                .joints
                .iter()
                .take(4)
                .all(|joint| joint.q_d == 0.1);
            let lands = back && reference.lifted_feet == 0;
            on = if lands {
                3
            } else {
                on & !u64::from(reference.lifted_feet)
            };
        }
        assert!(stepping.steps() >= 3, "{}", stepping.steps());
    }

    #[test]
    fn a_foot_is_not_awaited_for_ever() {
        let (mut stepping, mut reference) = (stepping(), Reference::default());
        let cycles = (0..20_000).find(|_| !stepping.update(3, &mut reference, 1e-3));
        let seconds = 1e-3 * cycles.expect("given up") as f64;
        assert!((seconds - REST_S - PATIENCE_S).abs() < 0.01, "{seconds}");
    }
}
