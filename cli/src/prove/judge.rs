//! What a joint should show of a small motion.

use super::proof::Proven;
use robot_config::JointParameters;

/// Shares of the way within which an encoder shows it: the drive's stiffness under a changing load, friction and counts
/// take their part.
const LEAST: f64 = 0.4;
const GREATEST: f64 = 1.6;
/// Share of the way the other way that is no noise, and that another joint may move by.
const OPPOSITE: f64 = 0.25;
const OTHERS: f64 = 0.25;
/// Counts by which a mean may be wrong.
const COUNTS: f64 = 1.0;
/// Standard deviations by which a torque must differ from zero before its sign counts: the other sign is three away then.
const CARRIES: f64 = 1.5;
/// Least share of the model's torque that the current must show after a motion, where it carries more.
pub(super) const SHOWN: f64 = 0.3;

/// The motion that was asked for.
#[derive(Debug, Clone, Copy)]
pub(super) struct Asked {
    /// rad or m.
    pub(super) step: f64,
    /// Counts of motor and link, as ways of the joint.
    pub(super) counts: [f64; 2],
    pub(super) has_link: bool,
}

impl Asked {
    pub(super) fn new(joint: &JointParameters, step: f64) -> Self {
        let estimator = &joint.estimator;
        let motor = estimator.motor_resolution / joint.encoders.gear_ratio;
        Self {
            step,
            counts: [motor, estimator.link_resolution],
            has_link: joint.has_link_encoder,
        }
    }
}

/// What was seen of it.
#[derive(Debug, Clone, Default)]
pub(super) struct Seen {
    /// Way by the motor-side encoder over the gear ratio, and by the link-side one, rad or m.
    pub(super) moved: [f64; 2],
    /// The other joint that moved most, and its way as a share of its own threshold of the same step.
    pub(super) other: Option<(String, f64)>,
    /// Torques by current and by the model, N·m, and the sum of their sigmas.
    pub(super) torques: Option<[f64; 2]>,
    pub(super) sigma: f64,
}

impl Seen {
    /// Ways between two rests.
    pub(super) fn new(
        j: usize,
        joints: &[JointParameters],
        (before, after): (&[[f64; 2]], &[[f64; 2]]),
    ) -> Self {
        let way = |k: usize, side: usize| after[k][side] - before[k][side];
        let others = (0..joints.len()).filter(|k| *k != j);
        let ways = others.map(|k| {
            let of_kind = joints[k].kind.threshold(1.0);
            (
                joints[k].name.clone(),
                way(k, 0).abs().max(way(k, 1).abs()) / of_kind,
            )
        });
        Self {
            moved: [0, 1].map(|side| way(j, side)),
            other: ways
                .max_by(|a, b| a.1.total_cmp(&b.1))
                .map(|(name, way)| (name, way * joints[j].kind.threshold(1.0))),
            ..Self::default()
        }
    }

    pub(super) fn carrying(self, torques: Option<[f64; 2]>, sigma: f64) -> Self {
        Self {
            torques,
            sigma,
            ..self
        }
    }
}

/// What follows.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Outcome {
    Proven(Proven),
    /// It has hardly moved; more may be asked for.
    TooLittle(String),
    /// Why, in words that follow the joint's name.
    Wrong(String),
}

/// What is wrong with a motion that goes on, if that is clear already.
pub(super) fn runs_away(asked: &Asked, moved: [f64; 2]) -> Option<String> {
    let share = moved.map(|way| way / asked.step);
    let noise = asked
        .counts
        .map(|count| 4.0 * COUNTS * count / asked.step.abs());
    let opposite = [0, 1].map(|side| share[side] < -2.0 * OPPOSITE - noise[side]);
    let far = [0, 1].map(|side| share[side] > 2.0 * GREATEST + noise[side]);
    if opposite.contains(&true) || far.contains(&true) {
        return Some(words(asked, share));
    }
    None
}

/// Judges a motion that has ended.
pub(super) fn judge(asked: &Asked, seen: &Seen) -> Outcome {
    let share = seen.moved.map(|way| way / asked.step);
    let noise = asked.counts.map(|count| COUNTS * count / asked.step.abs());
    let sides = if asked.has_link { 2 } else { 1 };
    let wrong =
        |side: usize| share[side] < -OPPOSITE - noise[side] || share[side] > GREATEST + noise[side];
    if (0..sides).any(wrong) {
        return Outcome::Wrong(words(asked, share));
    }
    if let Some((other, way)) = &seen.other
        && *way > OTHERS * asked.step.abs() + 4.0 * COUNTS * asked.counts[1]
    {
        return Outcome::Wrong(format!(
            "was asked to move, and joint `{other}` moved: their wiring or identifiers are exchanged, or something \
             pushes"
        ));
    }
    if (0..sides).any(|side| share[side] < LEAST - noise[side]) {
        let words = format!(
            "did not move: {} of the way asked for by its motor-side encoder{}; a brake that is shut, a drive that \
             does not follow, friction, or a wrong gear ratio",
            per_cent(share[0]),
            if asked.has_link {
                format!(", {} by its link-side one", per_cent(share[1]))
            } else {
                String::new()
            }
        );
        // One that moves while the other does not is no friction.
        let parted = sides == 2 && (share[0] > LEAST) != (share[1] > LEAST);
        return if parted && asked.step.abs() > 0.0 && share[0].max(share[1]) > 0.9 {
            Outcome::Wrong(format!("{words}: its encoders disagree"))
        } else {
            Outcome::TooLittle(words)
        };
    }
    let current = match carried(seen.torques, seen.sigma, SHOWN) {
        Ok(current) => current,
        Err(words) => return Outcome::Wrong(words),
    };
    Outcome::Proven(Proven {
        asked: asked.step,
        motor: seen.moved[0],
        link: asked.has_link.then_some(seen.moved[1]),
        current,
    })
}

/// Words for the torque that a standing joint carries by current and model, N·m; or for their contradiction.
/// `sigma`: sum of both standard deviations; `least`: share of the model's torque that the current must show.
pub(super) fn carried(
    torques: Option<[f64; 2]>,
    sigma: f64,
    least: f64,
) -> Result<&'static str, String> {
    match torques {
        Some([current, model]) if model.abs() > CARRIES * sigma => {
            if current * model.signum() < least * model.abs() - sigma {
                return Err(format!(
                    "carries {model:.1} N·m by the model, and its current shows {current:.1}: the current's \
                     direction, the torque constant, or the whole joint's direction beside the URDF is wrong"
                ));
            }
            Ok("shows the torque")
        }
        _ => Ok("not shown: too little torque"),
    }
}

/// Directions and sizes that do not fit, in words.
fn words(asked: &Asked, share: [f64; 2]) -> String {
    let [motor, link] = share;
    let shown = format!(
        "(asked {:.4}, motor-side encoder {}, link-side encoder {})",
        asked.step,
        per_cent(motor),
        if asked.has_link {
            per_cent(link)
        } else {
            "none".to_owned()
        }
    );
    let cause = match (motor < 0.0, asked.has_link && link < 0.0) {
        (true, true) => {
            "moved the other way by both encoders: the direction of `set_point`, or of both angles, is wrong"
        }
        (true, false) if !asked.has_link => {
            "moved the other way: the direction of `set_point` or of `motor_angle` is wrong"
        }
        (true, false) => {
            "moved the other way by its motor-side encoder: the direction of `motor_angle` is wrong"
        }
        (false, true) => {
            "moved the other way by its link-side encoder: the direction of `link_angle` is wrong"
        }
        (false, false) => {
            "moved further than asked: a gear ratio, or counts of an encoder, are wrong"
        }
    };
    format!("{cause} {shown}")
}

fn per_cent(share: f64) -> String {
    format!("{:.0} %", 100.0 * share)
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP: f64 = 8.7e-4;

    fn seen_of(moved: [f64; 2]) -> Outcome {
        let asked = Asked {
            step: -STEP,
            counts: [1e-5, 1.2e-5],
            has_link: true,
        };
        let seen = Seen {
            moved: moved.map(|share| -STEP * share),
            ..Seen::default()
        };
        judge(&asked, &seen)
    }

    fn why(outcome: Outcome) -> String {
        match outcome {
            Outcome::Wrong(words) | Outcome::TooLittle(words) => words,
            Outcome::Proven(_) => "proven".to_owned(),
        }
    }

    #[test]
    fn directions_and_sizes_are_named() {
        for (moved, part) in [
            ([1.0, 0.9], "proven"),
            ([0.5, 0.45], "proven"),
            ([-1.0, -1.0], "the direction of `set_point`, or of both"),
            ([-1.0, 1.0], "the direction of `motor_angle`"),
            ([1.0, -1.0], "the direction of `link_angle`"),
            ([2.0, 1.0], "gear ratio"),
            ([0.02, 0.0], "did not move"),
            ([1.0, 0.0], "its encoders disagree"),
        ] {
            let words = why(seen_of(moved));
            assert!(words.contains(part), "{moved:?}: {words}");
        }
        assert!(matches!(seen_of([0.1, 0.05]), Outcome::TooLittle(_)));
    }

    #[test]
    fn a_run_away_is_seen_before_it_ends() {
        let asked = Asked {
            step: STEP,
            counts: [1e-5; 2],
            has_link: true,
        };
        assert_eq!(runs_away(&asked, [0.9 * STEP, 0.8 * STEP]), None);
        assert_eq!(runs_away(&asked, [-0.2 * STEP, -0.2 * STEP]), None);
        assert!(runs_away(&asked, [-0.8 * STEP, -0.7 * STEP]).is_some());
        assert!(runs_away(&asked, [4.0 * STEP, 4.0 * STEP]).is_some());
    }

    #[test]
    fn another_joint_and_a_current_of_the_other_sign_are_named() {
        let asked = Asked {
            step: STEP,
            counts: [1e-5; 2],
            has_link: true,
        };
        let sound = Seen {
            moved: [STEP; 2],
            ..Seen::default()
        };
        let other = Seen {
            other: Some(("hip".to_owned(), 0.5 * STEP)),
            ..sound.clone()
        };
        assert!(why(judge(&asked, &other)).contains("joint `hip` moved"));
        let carrying = |current| sound.clone().carrying(Some([current, 20.0]), 2.0);
        assert_eq!(why(judge(&asked, &carrying(17.0))), "proven");
        assert!(why(judge(&asked, &carrying(-17.0))).contains("the current's direction"));
        // Before a motion friction may carry the weight, but a current against it is wrong.
        assert!(carried(Some([-2.0, 20.0]), 2.0, -SHOWN).is_ok());
        assert!(carried(Some([-17.0, 20.0]), 2.0, -SHOWN).is_err());
        // Too little to tell.
        let little = sound.clone().carrying(Some([-2.0, 2.5]), 2.0);
        assert_eq!(why(judge(&asked, &little)), "proven");
    }
}
