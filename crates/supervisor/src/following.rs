//! Whether a drive follows its set-points, and a joint its velocity limit.
//!
//! A drive that follows shows it: from where its motor stands, how it moves and what current it
//! draws follows the set-point that it must have. For a position-commanded drive that is the
//! position plus the lead that this torque and velocity need (D6), friction and inertia included,
//! as the motor's current drives them too; for a current-commanded one it is the current. A
//! *following error* is the distance of that set-point from those sent in the last cycles, as long
//! as a drive may take to act on one. Both encoders show a set-point; the nearer one counts, so that
//! an encoder that fails makes no following error.
//!
//! While a joint's samples cannot be used, the position that is known of it stands. What a drive is sent
//! meanwhile it is taken to follow, with the lag that its velocity had, so that a set-point that comes to rest
//! makes no following error; its current still shows a drive that does not.
//!
//! One sample is not believed by itself, as a frame may have been corrupted. Where it has three witnesses it is: a
//! torque that has changed, a rotor that this change has accelerated away from every set-point sent, by as much as
//! its inertia allows, and a link that has not left its rotor. No impact is taken for that, as a drive pushes back.
//!
//! A following error that is smaller, but more than the drive's model explains, is *doubtful*: either
//! the drive does not follow, or both encoders err alike. It matters where what the encoders show
//! moves the joint, as every torque law adds its torque to the position that it believes in.

/// Cycles after which a drive has acted on a set-point.
const ACTS_WITHIN: usize = 4;

/// Share of the cycles for which one counts at most. An error that is a multiple of the limit is found the sooner by
/// its square, as what a position drive does with it grows so. With half of the cycles two samples are needed, never
/// one alone.
const MOST: f64 = 0.5;

/// Least and greatest way that a witnessed sample shows, over the way that the change of torque makes within a sample
/// period. Torque may have changed anywhere within that period, and the gear and friction take a share of it. Chosen; no
/// experiment recorded.
const WITNESSED: [f64; 2] = [0.05, 1.5];
/// Least change in such a sample of the lead that the drive's torque needs, over the limit of the following error, which
/// is half the lead of the torque limit where none is given. Less may be noise. Chosen; no experiment recorded.
const WITNESSED_CHANGE: f64 = 0.5;

/// Limits of a joint's following error and velocity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FollowingParameters {
    /// Greatest following error at rest, rad or A.
    pub limit: f64,
    /// Further following error allowed per velocity, s or A·s/rad.
    pub per_velocity: f64,
    /// Greatest |dq|, rad/s.
    pub velocity: f64,
    /// Cycles for which an excess must last; a greater following error counts for several.
    pub samples: u32,
    /// Following error at rest without torque from which on it is doubtful, rad or A; infinite where
    /// it is not judged.
    pub doubt: f64,
    /// Further one per lead that the drive's torque needs, 1.
    pub doubt_per_lead: f64,
    /// Cycles for which that must last.
    pub doubt_samples: u32,
    /// Cycles for which one of them counts at most, by the square of the error over what is explained.
    pub doubt_counts: f64,
}

/// Motion of a drive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shown {
    /// The set-points that motor-side and link-side encoder show, rad or A.
    pub set_points: [f64; 2],
    /// The velocity that both show, rad/s.
    pub velocity: f64,
    /// The motor's velocity, rad/s: where the link stands it winds the gear up.
    pub motor_velocity: f64,
    /// The lead over its motor that the drive's torque needs, rad.
    pub lead: f64,
    /// The lead that its velocity needs, rad.
    pub lag: f64,
    /// Angles that motor and link side show, rad.
    pub angles: [f64; 2],
    /// Way that the drive's torque makes of a rotor at rest within a sample period, rad; 0 where the rotor's way says
    /// nothing.
    pub torque_way: f64,
    /// Sample period, s.
    pub period: f64,
    /// The joint is moved by the motion that its encoders show.
    pub followed: bool,
    /// The joint's samples cannot be used: the position shown stands.
    pub blind: bool,
}

/// Error of a drive's motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Deviation {
    /// The drive does not follow its set-points.
    Following,
    /// The drive does not follow its set-points, or both encoders err alike.
    Doubtful,
    /// The joint moves faster than it may.
    Overspeed,
}

/// Follows one drive.
#[derive(Debug, Clone)]
pub struct Following {
    parameters: FollowingParameters,
    sent: [f64; ACTS_WITHIN],
    count: usize,
    error: f64,
    /// The samples cannot be used; the last set-point, and the way of those since then, rad or A.
    blind: bool,
    last: f64,
    unseen: f64,
    /// The last lag that was seen, rad.
    lag: f64,
    /// The sample before, where it can be used.
    before: Option<Shown>,
    /// Cycles of excess in a row: of the following error, by its square, and of the velocity.
    over: [f64; 2],
    /// Cycles in a row with a doubtful following error; a greater one counts for several.
    doubtful: f64,
}

impl Following {
    /// Watch of a drive that has been sent nothing.
    #[must_use]
    pub fn new(parameters: FollowingParameters) -> Self {
        Self {
            parameters,
            sent: [0.0; ACTS_WITHIN],
            count: 0,
            error: 0.0,
            blind: false,
            last: 0.0,
            unseen: 0.0,
            lag: 0.0,
            before: None,
            over: [0.0; 2],
            doubtful: 0.0,
        }
    }

    /// Set-points end, or begin anew.
    pub fn restart(&mut self) {
        *self = Self::new(self.parameters);
    }

    /// Notes the set-point that has just been sent, rad or A.
    pub fn note_sent(&mut self, set_point: f64) {
        if self.blind && self.count > 0 {
            self.unseen += set_point - self.last;
        }
        self.last = set_point;
        if let Some(sent) = self.sent.get_mut(self.count % ACTS_WITHIN) {
            *sent = set_point - self.unseen;
        }
        self.count = self.count.wrapping_add(1).max(1);
    }

    /// A sample stays away: the way from the one before to the next is no way of a sample period.
    pub fn miss(&mut self) {
        self.before = None;
    }

    /// The last following error, rad or A.
    #[must_use]
    pub fn error(&self) -> f64 {
        self.error
    }

    /// A following error beyond its limit is being counted.
    #[must_use]
    pub fn exceeds(&self) -> bool {
        self.over[0] > 0.0
    }

    /// Takes what the drive shows. A deviation is returned for as long as it lasts, with whether it begins:
    /// a reaction that was missed once is not lost.
    pub fn update(&mut self, shown: &Shown) -> Option<(Deviation, bool)> {
        if !shown.blind && std::mem::take(&mut self.blind) {
            // Where the drive went meanwhile is known again.
            self.restart();
        }
        self.blind = shown.blind;
        if !shown.blind {
            self.lag = shown.lag;
        }
        let before = self.before.replace(*shown).filter(|before| !before.blind);
        let set_points = shown.set_points.map(|x| x - shown.lag + self.lag);
        if self.count < ACTS_WITHIN {
            return None;
        }
        let velocity = shown.velocity;
        let low = self.sent.iter().copied().fold(f64::INFINITY, f64::min);
        let high = self.sent.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let [motor, link] = set_points.map(|x| (x - high).max(0.0) + (x - low).min(0.0));
        self.error = if motor.abs() < link.abs() {
            motor
        } else {
            link
        };
        let p = &self.parameters;
        let ratios = [
            self.error.abs() / (p.limit + p.per_velocity * velocity.abs()),
            velocity.abs() / p.velocity,
        ];
        let samples = f64::from(p.samples);
        let least_change = WITNESSED_CHANGE * p.limit;
        let runs = |before: Shown| runs_away(&before, shown, (self.error, least_change));
        let counted = if before.is_some_and(runs) {
            samples
        } else {
            (ratios[0] * ratios[0]).min((MOST * samples).max(1.0))
        };
        let counted = [counted, 1.0];
        let before = self.over;
        for (over, (ratio, counted)) in self.over.iter_mut().zip(ratios.iter().zip(counted)) {
            *over = if *ratio > 1.0 { *over + counted } else { 0.0 };
        }
        let lasts = |i: usize| self.over[i] >= samples;
        let begins = |i: usize| before[i] < samples;
        let turns = velocity.abs().max(shown.motor_velocity.abs());
        let explained = p.doubt + p.doubt_per_lead * shown.lead.abs() + p.per_velocity * turns;
        let doubt = self.error.abs() / explained;
        let doubtful_before = self.doubtful;
        self.doubtful = if shown.followed && doubt > 1.0 {
            self.doubtful + (doubt * doubt).min(p.doubt_counts)
        } else {
            0.0
        };
        let doubt_samples = f64::from(p.doubt_samples);
        if lasts(0) {
            Some((Deviation::Following, begins(0)))
        } else if lasts(1) {
            Some((Deviation::Overspeed, begins(1)))
        } else if self.doubtful >= doubt_samples {
            Some((Deviation::Doubtful, doubtful_before < doubt_samples))
        } else {
            None
        }
    }
}

/// Whether a change of the drive's torque since the sample `before` has accelerated its rotor in the direction of the
/// following error, by a way that fits the torque, while the link has not gone further than that. `least_change`: of the
/// lead that counts as one, rad.
fn runs_away(before: &Shown, now: &Shown, (error, least_change): (f64, f64)) -> bool {
    let [motor, link] = [0, 1].map(|side| now.angles[side] - before.angles[side]);
    let expected = before.motor_velocity * now.period;
    let (way, of_link) = ((motor - expected) * error.signum(), (link - expected).abs());
    let by_torque = (now.torque_way - before.torque_way) * error.signum();
    let [least, most] = WITNESSED.map(|share| share * by_torque);
    let changes = (now.lead - before.lead) * error.signum() > least_change;
    changes && (least..most).contains(&way) && of_link < most
}

#[cfg(test)]
mod tests {
    use super::*;

    const PARAMETERS: FollowingParameters = FollowingParameters {
        limit: 0.01,
        per_velocity: 0.005,
        velocity: 5.0,
        samples: 20,
        doubt: 0.003,
        doubt_per_lead: 0.3,
        doubt_samples: 5,
        doubt_counts: 1.0,
    };

    fn shown(set_points: [f64; 2], velocity: f64) -> Shown {
        Shown {
            set_points,
            velocity,
            motor_velocity: velocity,
            lead: 0.0,
            lag: 0.0,
            angles: [0.0; 2],
            torque_way: 0.0,
            period: 1e-3,
            followed: false,
            blind: false,
        }
    }

    /// The cycle in which a drive is found to deviate that shows these set-points for a set-point
    /// that moves at 1 rad/s.
    fn found(drive: impl Fn(f64) -> [f64; 2], velocity: f64) -> Option<(usize, Deviation)> {
        let mut following = Following::new(PARAMETERS);
        (0..1000).find_map(|k| {
            let sent = 1e-3 * k as f64;
            let found = following.update(&shown(drive(sent), velocity));
            following.note_sent(sent);
            found.map(|(deviation, _)| (k, deviation))
        })
    }

    #[test]
    fn a_drive_that_follows_late_is_no_fault_and_a_deaf_one_is() {
        assert_eq!(found(|sent| [sent - 0.004, sent - 0.004], 1.0), None);
        let (after, deviation) = found(|_| [0.0, 0.0], 0.0).unwrap();
        assert_eq!(deviation, Deviation::Following);
        // 10 ms until the set-point has left by the limit, four cycles, and less than 20 ms.
        assert!((20..30).contains(&after), "{after}");
    }

    #[test]
    fn a_deviation_is_reported_for_as_long_as_it_lasts_and_begins_once() {
        let mut following = Following::new(PARAMETERS);
        let found: Vec<_> = (0..100)
            .map(|k| {
                following.note_sent(0.2);
                let deaf = if k < 60 { 0.5 } else { 0.2 };
                following.update(&shown([deaf; 2], 0.0))
            })
            .collect();
        let begins = (found.iter())
            .filter(|x| matches!(x, Some((_, true))))
            .count();
        let first = found.iter().position(Option::is_some).unwrap();
        assert_eq!(begins, 1);
        assert!(found[first..60].iter().all(Option::is_some));
        assert!(found[60..].iter().all(Option::is_none));
    }

    #[test]
    fn one_encoder_that_fails_is_no_following_error() {
        assert_eq!(found(|sent| [sent, 5.0], 0.0), None);
        assert_eq!(found(|sent| [f64::NAN, sent], 0.0), None);
        assert!(found(|_| [5.0, 4.0], 0.0).is_some());
    }

    #[test]
    fn a_position_that_is_not_known_any_more_is_no_following_error_and_a_current_is() {
        let found = |lead: f64| {
            let mut following = Following::new(PARAMETERS);
            (0..1000).find_map(|k| {
                // At 1 rad/s, and after half a second nothing is seen any more.
                let sent = 1e-3 * k as f64;
                let blind = k >= 500;
                let known = 1e-3 * (k.min(500) as f64) - 0.004;
                let seen = known + if blind { lead } else { 0.0 };
                let found = following.update(&Shown {
                    blind,
                    ..shown([seen; 2], 1.0)
                });
                following.note_sent(sent);
                found.map(|(deviation, _)| (k, deviation))
            })
        };
        assert_eq!(found(0.0), None);
        let (after, deviation) = found(0.03).unwrap();
        assert_eq!(deviation, Deviation::Following);
        assert!((504..525).contains(&after), "{after}");
    }

    #[test]
    fn a_smaller_error_is_doubtful_where_encoders_move_the_joint() {
        let found = |error: f64, lead: f64, followed: bool| {
            let mut following = Following::new(PARAMETERS);
            (0..100).find_map(|k| {
                following.note_sent(0.2);
                let set_points = [0.2 + error, 0.2 + 1.5 * error];
                following
                    .update(&Shown {
                        lead,
                        followed,
                        ..shown(set_points, 0.0)
                    })
                    .map(|(deviation, _)| (k, deviation))
            })
        };
        // Four cycles until a set-point must have acted, and five.
        assert_eq!(found(0.005, 0.0, true), Some((7, Deviation::Doubtful)));
        assert_eq!(found(-0.005, 0.006, true), Some((7, Deviation::Doubtful)));
        assert_eq!(found(0.005, 0.007, true), None, "an error of the stiffness");
        assert_eq!(found(0.005, 0.0, false), None);
    }

    #[test]
    fn where_one_encoder_alone_decides_a_great_error_is_doubtful_sooner() {
        let found = |error: f64| {
            let mut following = Following::new(FollowingParameters {
                doubt_counts: 2.5,
                ..PARAMETERS
            });
            (0..100).find(|_| {
                following.note_sent(0.2);
                let found = following.update(&Shown {
                    followed: true,
                    ..shown([0.2 + error; 2], 0.0)
                });
                // A very great one is no longer doubtful.
                matches!(
                    found,
                    Some((Deviation::Doubtful | Deviation::Following, true))
                )
            })
        };
        // Four cycles until a set-point must have acted; never by a single sample.
        assert_eq!(found(0.0031), Some(7));
        assert_eq!(found(0.009), Some(4));
        assert_eq!(found(0.1), Some(4));
    }

    #[test]
    fn one_sample_is_enough_where_torque_rotor_and_link_bear_witness() {
        let found = |torque_way: f64, angles: [f64; 2]| {
            let lead = 20.0 * torque_way;
            let mut following = Following::new(PARAMETERS);
            (0..100).find(|k| {
                following.note_sent(0.2);
                let found = following.update(&if *k < 50 {
                    shown([0.2; 2], 0.0)
                } else {
                    Shown {
                        torque_way,
                        lead,
                        angles: if *k == 50 { angles } else { [f64::NAN; 2] },
                        ..shown([0.23; 2], 0.0)
                    }
                });
                found.is_some()
            })
        };
        assert_eq!(found(1e-3, [8e-4, 0.0]), Some(50), "a drive that runs away");
        let (two, three) = (Some(51), Some(52));
        let cases = [
            ("no way", 1e-3, [0.0, 0.0]),
            ("a way that no torque makes", 1e-3, [0.1, 0.0]),
            ("a link that jumps", 1e-3, [8e-4, 0.1]),
            ("an impact: the drive pushes back", -1e-3, [8e-4, 0.0]),
            ("towards the set-point", -1e-3, [-8e-4, 0.0]),
            ("a change that may be noise", 2e-4, [1e-4, 0.0]),
            ("no number", f64::NAN, [f64::NAN; 2]),
        ];
        for (name, torque_way, angles) in cases {
            let found = found(torque_way, angles);
            assert!(found == two || found == three, "{name}: {found:?}");
        }
    }

    #[test]
    fn a_velocity_beyond_the_limit_is_a_fault_when_it_lasts() {
        let (after, deviation) = found(|sent| [sent, sent], -5.1).unwrap();
        assert_eq!((after, deviation), (23, Deviation::Overspeed));
        assert_eq!(found(|sent| [sent, sent], 4.9), None);
    }
}
