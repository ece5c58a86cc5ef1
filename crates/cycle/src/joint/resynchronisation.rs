//! Resynchronisation: how a joint that its drive has braked in a gap of the loop gets back to its reference.
//!
//! In: by how much the joint is behind in position and velocity. Out: what the reference is set back by, which
//! begins as that, so that nothing pulls the joint, and ends at zero with its first two derivatives:
//!
//! ```text
//! o(s) = e (1 - 10 s³ + 15 s⁴ - 6 s⁵) + v T (s - 6 s³ + 8 s⁴ - 3 s⁵)      s = t / T
//! ```

/// Shortest T, s. Chosen on the simulated leg, lift-gripper and humanoid (docs/control-law.md, A gap of the loop).
const SHORTEST_S: f64 = 0.2;
/// Share of the velocity limit by which a joint catches up at most because of `e`. Chosen as [`SHORTEST_S`].
const CATCH_UP: f64 = 0.1;
/// Greatest slope of the first polynomial: `30 s² (1 - s)²` is 15/8 at s = 1/2.
const STEEPEST: f64 = 1.875;

/// Back to the reference.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Resynchronisation {
    /// e, rad, and v, rad/s.
    behind: [f64; 2],
    duration_s: f64,
    gone_s: f64,
}

impl Resynchronisation {
    /// From how far the joint is behind, rad and rad/s, with its velocity limit, rad/s.
    pub(super) fn from(behind: [f64; 2], velocity: f64) -> Self {
        let needed = STEEPEST * behind[0].abs() / (CATCH_UP * velocity);
        Self {
            behind,
            duration_s: needed.max(SHORTEST_S),
            gone_s: 0.0,
        }
    }

    /// The reference of this cycle, rad and rad/s, set back; none where it is reached.
    pub(super) fn set_back(&mut self, [q_d, dq_d]: [f64; 2], dt: f64) -> Option<[f64; 2]> {
        let (t, s) = (self.duration_s, self.gone_s / self.duration_s);
        self.gone_s += dt;
        // A distance that is not finite ends the re-synchronisation, too.
        let goes_on = s < 1.0 && self.behind.iter().all(|x| x.is_finite());
        let ([e, v], s2) = (self.behind, s * s);
        let position = e * (1.0 - s2 * s * (10.0 - s * (15.0 - 6.0 * s)))
            + v * t * s * (1.0 - s2 * (6.0 - s * (8.0 - 3.0 * s)));
        let velocity = -30.0 * e / t * s2 * (1.0 - s) * (1.0 - s)
            + v * (1.0 - s2 * (18.0 - s * (32.0 - 15.0 * s)));
        goes_on.then_some([q_d - position, dq_d - velocity])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_begins_where_the_joint_is_and_ends_on_the_reference_without_a_step() {
        let (dt, v_max) = (1e-4, 4.0);
        for behind in [[0.003, 0.3], [-0.05, 0.2], [0.2, -0.4]] {
            let mut resynchronisation = Resynchronisation::from(behind, v_max);
            let reference = [1.0, 0.5];
            let mut last: Option<[f64; 2]> = None;
            let mut fastest = 0.0_f64;
            while let Some(r) = resynchronisation.set_back(reference, dt) {
                let off = [reference[0] - r[0], reference[1] - r[1]];
                match last {
                    None => (0..2).for_each(|i| assert!((off[i] - behind[i]).abs() < 1e-12)),
                    Some([q, dq]) => {
                        let mean = 0.5 * (dq + off[1]);
                        assert!((off[0] - q - mean * dt).abs() < 1e-7, "{behind:?}");
                        assert!((off[1] - dq).abs() < 40.0 * dt, "{behind:?}");
                    }
                }
                fastest = fastest.max(off[1].abs());
                last = Some(off);
            }
            let end = last.unwrap();
            assert!(end[0].abs() < 1e-6 && end[1].abs() < 1e-3, "{end:?}");
            let most = CATCH_UP * v_max + 1.1 * behind[1].abs();
            assert!(fastest < most, "{behind:?}: {fastest}");
        }
    }

    #[test]
    fn what_is_no_number_sets_nothing_back() {
        let mut resynchronisation = Resynchronisation::from([f64::NAN, 0.0], 1.0);
        assert_eq!(resynchronisation.set_back([0.0; 2], 1e-3), None);
    }
}
