//! Approach: how fast a frame that is led by a force moves where nothing is to press on.
//!
//! In: of each joint of the limb the torque of the desired force, and how much of it the measured force does not
//! bear yet. Out: a damping. As long as no contact is felt, the force does nothing but accelerate the limb; with the
//! damping `d` it moves a joint no faster than `v_a`, whatever the force is:
//!
//! ```text
//! d = s c / v_a    s = |J^T (f_hat - f*)|    c: 0 where the torque is borne, 1 where a fifth of it is not
//! ```
//!
//! It acts on joints that move the way of that torque alone: what pushes the frame back meets none of it. It takes
//! energy only, and vanishes with the velocity, so that a contact that is made or lost makes no step.

/// Shares of the desired torque that no contact bears, from which on a contact counts as made, and as not there.
/// Chosen on the simulated leg, in free air and on 20 and 75 kN/m (docs/cartesian.md, Approach).
const SHORT: [f64; 2] = [0.05, 0.2];
/// Greatest share of the damping that a joint may have: 5 % stay for the posture (`posture_damping_per_cent`).
const MOST: f64 = 0.95;

/// All joints of a limb.
#[derive(Debug)]
pub(super) struct Approaches {
    joints: Vec<Approach>,
    /// Greatest K_s and K_d of each joint for springs and dampers of the frame, and what is left of them.
    bounds: Vec<[f64; 2]>,
    left: Vec<[f64; 2]>,
}

impl Approaches {
    /// `slow`: v_a of each joint, rad/s.
    pub(super) fn new(bounds: Vec<[f64; 2]>, slow: impl Iterator<Item = f64>) -> Self {
        Self {
            joints: (slow.zip(&bounds))
                .map(|(slow, [_, most])| Approach::new(slow, *most))
                .collect(),
            left: bounds.clone(),
            bounds,
        }
    }

    pub(super) fn restart(&mut self) {
        self.joints.iter_mut().for_each(Approach::restart);
    }

    /// Greatest stiffness and damping of each joint for the frame in this cycle: both dampings together stay within
    /// what the margins of the joint's loop were judged for.
    pub(super) fn left(&mut self) -> &[[f64; 2]] {
        let joints = self.bounds.iter().zip(&self.joints);
        for (left, ([k_s, k_d], joint)) in self.left.iter_mut().zip(joints) {
            *left = [*k_s, k_d - joint.damping];
        }
        &self.left
    }

    pub(super) fn joints(&mut self) -> impl Iterator<Item = &mut Approach> {
        self.joints.iter_mut()
    }
}

/// One joint of the limb.
#[derive(Debug, Clone, Copy)]
pub(super) struct Approach {
    /// v_a, rad/s.
    slow: f64,
    /// Greatest damping, N·m·s/rad.
    most: f64,
    /// d, N·m·s/rad, and the sign of the torque that is not borne.
    damping: f64,
    way: f64,
}

impl Approach {
    /// Approach at most at `slow` (rad/s), of a joint that may be damped by `most` (N·m·s/rad).
    fn new(slow: f64, most: f64) -> Self {
        Self {
            slow,
            most: MOST * most,
            damping: 0.0,
            way: 0.0,
        }
    }

    fn restart(&mut self) {
        (self.damping, self.way) = (0.0, 0.0);
    }

    /// Torque of the approach's damping at this velocity, N·m.
    pub(super) fn torque(&self, dq: f64) -> f64 {
        if dq * self.way > 0.0 {
            -self.damping * dq
        } else {
            0.0
        }
    }

    /// Sets the next cycle's values: the torque of the desired force, and the part of it that no contact bears, N·m.
    pub(super) fn follow(&mut self, asked: f64, short: f64) {
        let (size, asked) = (short.abs(), asked.abs());
        let [made, none] = SHORT;
        let share = if asked > 0.0 {
            ((size / asked - made) / (none - made)).clamp(0.0, 1.0)
        } else {
            0.0
        };
        let damping = (share * size / self.slow).min(self.most);
        (self.damping, self.way) = if damping.is_finite() {
            (damping, short)
        } else {
            (self.most, short)
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Greatest velocity of 0.5 kg·m² under a torque, that what it meets after 0.2 rad bears, and the end of it.
    fn fastest(torque: f64, meets: f64) -> (f64, f64) {
        let mut approach = Approach::new(0.3, 100.0);
        let (mut q, mut dq, mut fastest) = (0.0f64, 0.0f64, 0.0f64);
        for _ in 0..4000 {
            let borne = (meets * (q - 0.2) + 20.0 * dq).max(0.0) * f64::from(u8::from(q > 0.2));
            dq += 1e-3 / 0.5 * (torque - borne + approach.torque(dq) - 1.0 * dq);
            q += 1e-3 * dq;
            fastest = fastest.max(dq);
            approach.follow(torque, torque - borne);
        }
        (fastest, q)
    }

    #[test]
    fn in_free_air_no_force_is_faster_than_the_approach_and_a_contact_gets_all_of_it() {
        for torque in [0.5, 5.0, 25.0] {
            assert!(fastest(torque, 0.0).0 < 0.31);
            let (fast, q) = fastest(torque, 500.0);
            // Way that the last fifth of the torque adds.
            assert!(fast < 0.33, "{fast}");
            assert!((500.0 * (q - 0.2) / torque - 1.0).abs() < 0.02, "{q}");
        }
    }

    #[test]
    fn what_pushes_back_is_not_damped() {
        let mut approach = Approach::new(0.3, 100.0);
        approach.follow(10.0, 10.0);
        assert!(approach.torque(0.1) < 0.0);
        assert_eq!(approach.torque(-0.1), 0.0);
        approach.follow(10.0, 0.4);
        assert_eq!(approach.torque(0.1), 0.0);
    }
}
