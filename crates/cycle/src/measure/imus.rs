//! IMUs: the first one shows the base's motion; the others check it, and stand in for it.
//!
//! The motion that the first IMU shows is carried over by the joints to each of the others, and compared with
//! what that one shows. A mean difference beyond its limit is an event; which of the two errs, or whether an
//! encoder between them does, is not known, so that nothing else follows from it. Where the first one is
//! lost, the next one that was sound and agreed with it for the last second is carried over to its place.
//! It stands in until the first one is sound and agrees with it for a second, and passes on without a step.
//! Of several that agreed with the first one, those that are left must agree with each other: where none bears out
//! the one that stands in, it is not known which of them errs, and no motion of the base is.

use dynamics::ImuMotion;
use nalgebra::Vector3;
use problem::{Problem, listed};
use robot_config::Robot;
use robot_state::{Event, MAX_FURTHER_IMUS, measured_flags};
use supervisor::time_in_a_row;
use whole_body::{CarriedImu, WholeBodyInput};

use super::filtered::Filtered;
use crate::events::{Counts, Subject};

/// Time constant of the mean differences, s: impacts and steps of the joints are shorter.
/// Chosen; no experiment recorded.
const MEAN_S: f64 = 0.5;
/// Time constant of the mean differences that count before an IMU stands in, s. One that has begun to err at the same
/// time as the first one is not in the longer mean yet. Chosen on the simulated humanoid, by pairs of faults
/// (docs/safety-limits.md, Two faults at once).
const QUICK_S: f64 = 0.05;
/// Factor of the limits of the mean differences over [`QUICK_S`]. Chosen as [`QUICK_S`].
const QUICK_FACTOR: f64 = 2.0;
/// Part of the limits below which a disagreement ends. Chosen; no experiment recorded.
const AGREES: f64 = 0.7;
/// Time of agreement before an IMU may stand in for another, s. Chosen; no experiment recorded.
const TRUSTED_S: f64 = 1.0;
/// Time over which one IMU passes on to the other, s. Chosen; no experiment recorded.
const BLEND_S: f64 = 0.05;

/// No motion was shown yet.
const STILL: ImuMotion = ImuMotion {
    angular_velocity: Vector3::new(0.0, 0.0, 0.0),
    angular_acceleration: Vector3::new(0.0, 0.0, 0.0),
    proper_acceleration: Vector3::new(0.0, 0.0, 0.0),
};
/// Samples with one of these are not compared.
const UNSOUND: u32 = measured_flags::NEVER
    | measured_flags::MISSED
    | measured_flags::STALE
    | measured_flags::IMPLAUSIBLE
    | measured_flags::FLAT
    | measured_flags::SATURATED;
/// The IMU is lost: samples that are bridged for a while are not.
pub(super) const LOST: u32 =
    measured_flags::STALE | measured_flags::FLAT | measured_flags::SATURATED;

/// One IMU beside the first one.
#[derive(Debug)]
struct Further {
    /// Index of the IMU among all.
    index: usize,
    /// The first IMU's motion at its place, and its motion at the first one's.
    there: CarriedImu,
    back: CarriedImu,
    agreement: Agreement,
    /// The IMU was trusted when it was last compared with the first one itself.
    trusted_by_first: bool,
    sound: bool,
    /// Time without a usable sample, s.
    silent: f64,
}

/// Whether two ways to one motion agree.
#[derive(Debug, Clone)]
struct Agreement {
    /// Mean differences of angular velocity, rad/s, and proper acceleration, m/s², and their limits.
    means: [Vector3<f64>; 2],
    limits: [f64; 2],
    disagrees: bool,
    /// Mean differences over [`QUICK_S`], and whether they are beyond their limits.
    quick: [Vector3<f64>; 2],
    parts: bool,
    /// Time of agreement, s.
    agreed: f64,
}

impl Agreement {
    fn new(limits: [f64; 2]) -> Self {
        Self {
            means: [Vector3::zeros(); 2],
            limits,
            disagrees: false,
            quick: [Vector3::zeros(); 2],
            parts: false,
            agreed: 0.0,
        }
    }

    /// Compares for `dt`, s.
    fn compare(&mut self, a: &ImuMotion, b: &ImuMotion, dt: f64) {
        let differences = [
            a.angular_velocity - b.angular_velocity,
            a.proper_acceleration - b.proper_acceleration,
        ];
        let part = if self.disagrees { AGREES } else { 1.0 };
        let limits = self.limits;
        self.disagrees = average(
            &mut self.means,
            differences,
            dt / MEAN_S,
            limits.map(|l| part * l),
        );
        let limits = limits.map(|l| QUICK_FACTOR * l);
        self.parts = average(&mut self.quick, differences, dt / QUICK_S, limits);
        time_in_a_row(&mut self.agreed, !self.disagrees, dt);
    }

    fn is_trusted(&self) -> bool {
        self.agrees() && self.agreed >= TRUSTED_S
    }

    fn agrees(&self) -> bool {
        !(self.disagrees || self.parts)
    }
}

/// Takes differences into their means; whether one of them is beyond its limit.
fn average(
    means: &mut [Vector3<f64>; 2],
    differences: [Vector3<f64>; 2],
    share: f64,
    limits: [f64; 2],
) -> bool {
    let mut beyond = false;
    for ((mean, difference), limit) in means.iter_mut().zip(differences).zip(limits) {
        *mean += (difference - *mean) * share.min(1.0);
        // A mean that is not finite is beyond every limit.
        let within = mean.norm() <= limit;
        beyond |= !within;
    }
    if means.iter().any(|mean| !mean.norm().is_finite()) {
        *means = [Vector3::zeros(); 2];
    }
    beyond
}

/// Two IMUs beside the first one, by their places among those.
#[derive(Debug)]
struct Between {
    places: [usize; 2],
    agreement: Agreement,
}

/// Substitute of the first IMU.
#[derive(Debug)]
struct StandIn {
    /// Index of the IMU among the further ones.
    place: usize,
    /// Share of the IMU in the motion, 0 to 1.
    share: f64,
    /// The first one is sound again and trusted: the part fades.
    ends: bool,
    /// Agreement of the first IMU with the one that stands in.
    agreement: Agreement,
}

/// The IMUs beside the first one of a robot.
#[derive(Debug)]
pub(super) struct Imus {
    further: Vec<Further>,
    /// Motion of the first one's place by each of them, and every two of them beside each other.
    shown: Vec<ImuMotion>,
    between: Vec<Between>,
    stand_in: Option<StandIn>,
    stale_after: f64,
    /// Nothing stood in for the first one, or would have, in the last cycle.
    alone: bool,
    /// The first one was lost, and has not agreed with another since.
    first_doubted: bool,
    /// Time for which the robot has held meanwhile, s.
    held: f64,
}

impl Imus {
    pub(super) fn new(robot: &Robot) -> Result<Self, Problem> {
        let parameters = &robot.parameters;
        let joints = parameters.joints.iter().map(|joint| joint.name.as_str());
        let joints: Vec<&str> = joints.collect();
        let mut imus = parameters.imus.iter().enumerate();
        let first = imus.next().map_or("", |(_, imu)| imu.frame.as_str());
        let carried = |from: &str, to: &str| {
            CarriedImu::new(&robot.model, &joints, from, to).ok_or_else(|| {
                let links = robot.model.frames().iter().map(|link| link.name.as_str());
                let reason = format!("imu.frame: the URDF has no link {from} or no link {to}");
                Problem::new(reason, listed(links))
            })
        };
        let further = imus.map(|(index, imu)| {
            Ok(Further {
                index,
                there: carried(first, &imu.frame)?,
                back: carried(&imu.frame, first)?,
                agreement: Agreement::new(imu.disagreement),
                trusted_by_first: false,
                sound: false,
                silent: 0.0,
            })
        });
        let further: Vec<Further> = further.collect::<Result<_, Problem>>()?;
        let n = further.len();
        let pairs = (0..n).flat_map(|a| (a + 1..n).map(move |b| [a, b]));
        let between = pairs.map(|places| Between {
            places,
            agreement: Agreement::new(further[places[0]].agreement.limits),
        });
        Ok(Self {
            between: between.collect(),
            shown: vec![STILL; n],
            further,
            stand_in: None,
            stale_after: parameters.timing.stale_after,
            alone: true,
            first_doubted: false,
            held: 0.0,
        })
    }

    /// Whether no IMU stands in for the first one or would if that were lost: in this cycle, and in the last one.
    pub(super) fn is_alone(&mut self) -> [bool; 2] {
        let stands_in = self.stand_in.as_ref().is_some_and(|s| !s.ends);
        let alone = !stands_in && self.candidate().is_none();
        [alone, std::mem::replace(&mut self.alone, alone)]
    }

    /// Place of the IMU that stands in for the first one, among all of them.
    pub(super) fn standing_in(&self) -> Option<usize> {
        let place = self.stand_in.as_ref().filter(|s| !s.ends)?.place;
        self.further.get(place).map(|further| further.index)
    }

    /// Compares the IMUs of this cycle, `dt` (s) after the last one, and chooses which one shows the base's
    /// motion; `flags`: `measured_flags` of each.
    pub(super) fn update(
        &mut self,
        flags: [u32; 1 + MAX_FURTHER_IMUS],
        signals: &Filtered,
        dt: f64,
        counts: &mut Counts,
    ) {
        let sound = |imu: usize| {
            let flags = flags.get(imu).copied().unwrap_or(UNSOUND);
            flags & UNSOUND == 0 && !signals.imu_settling(imu)
        };
        let input = signals.input();
        let shown = |imu: usize| signals.imus().get(imu).copied().unwrap_or(input.imu);
        let base_known = self.stand_in.is_some() || sound(0);
        for (place, further) in self.further.iter_mut().enumerate() {
            let subject = Subject::Imu(further.index);
            further.sound = sound(further.index);
            let usable = flags.get(further.index).is_some_and(|f| f & UNSOUND == 0);
            let lost_before = further.silent > self.stale_after;
            if time_in_a_row(&mut further.silent, !usable, dt) > self.stale_after {
                counts.lasting(Event::ImuLost, subject, !lost_before);
            }
            let stands_in = self.stand_in.as_ref().is_some_and(|s| s.place == place);
            if !further.sound || !base_known || stands_in {
                continue;
            }
            let before = further.agreement.disagrees;
            let expected = carried(&further.there, &input, &input.imu);
            let own = shown(further.index);
            further.agreement.compare(&own, &expected, dt);
            if self.stand_in.is_none() {
                further.trusted_by_first = further.agreement.is_trusted();
            }
            if further.agreement.disagrees {
                counts.lasting(Event::ImuDisagrees, subject, !before);
            }
        }
        self.compare_further(signals, dt, counts);
        self.choose(flags.first().copied().unwrap_or(0), dt, counts);
        self.pass_on(sound(0), &shown(0), &input.imu, dt, counts);
    }

    /// Compares the IMUs beside the first one with each other.
    fn compare_further(&mut self, signals: &Filtered, dt: f64, counts: &mut Counts) {
        if self.between.is_empty() {
            return;
        }
        let input = signals.input();
        for (shown, further) in self.shown.iter_mut().zip(&self.further) {
            if let (true, Some(own)) = (further.sound, signals.imus().get(further.index)) {
                *shown = carried(&further.back, &input, own);
            }
        }
        for pair in &mut self.between {
            let both = pair.places.map(|place| self.further.get(place));
            let [Some(a), Some(b)] = both else { continue };
            let shown = pair.places.map(|place| self.shown.get(place));
            let ([Some(by_a), Some(by_b)], true) = (shown, a.sound && b.sound) else {
                continue;
            };
            let before = pair.agreement.disagrees;
            pair.agreement.compare(by_a, by_b, dt);
            // Beside the first one each of them is compared with that.
            if pair.agreement.disagrees && self.stand_in.is_some() {
                counts.lasting(Event::ImuDisagrees, Subject::Imu(b.index), !before);
            }
        }
    }

    /// Whether the others that agreed with the first one bear out this one: one of them does, or there is none.
    fn is_borne_out(&self, place: usize) -> bool {
        let trusted = |place: &usize| {
            (self.further.get(*place)).is_some_and(|f| f.sound && f.trusted_by_first)
        };
        let mut others = self.between.iter().filter(|pair| {
            let other = pair.places.iter().find(|its| **its != place);
            pair.places.contains(&place) && other.is_some_and(trusted)
        });
        match others.next() {
            None => true,
            Some(first) => first.agreement.agrees() || others.any(|pair| pair.agreement.agrees()),
        }
    }

    /// The next IMU that may stand in for the first one.
    fn candidate(&self) -> Option<usize> {
        let fit = |f: &Further| f.sound && f.agreement.is_trusted();
        let mut places = self.further.iter().enumerate();
        let found = places.find(|(place, f)| fit(f) && self.is_borne_out(*place));
        found.map(|(place, _)| place)
    }

    /// Whether nothing shows the base's motion although the first one seems sound: it was lost, and what stood in for
    /// it is gone before they agreed. That is over when another one has agreed with it, or nothing has depended on it,
    /// for a second.
    pub(super) fn is_doubted(&mut self, holds: bool, dt: f64) -> bool {
        let doubted = self.first_doubted && self.stand_in.is_none();
        let held = time_in_a_row(&mut self.held, doubted && holds, dt);
        if held > TRUSTED_S || doubted && self.candidate().is_some() {
            self.first_doubted = false;
        }
        doubted && self.first_doubted
    }

    /// Lets another IMU stand in where the first one, or the one that does, is lost.
    fn choose(&mut self, first: u32, dt: f64, counts: &mut Counts) {
        let lost = first & LOST != 0;
        let sound = |s: &StandIn| {
            self.further.get(s.place).is_some_and(|f| f.sound) && self.is_borne_out(s.place)
        };
        let gone = self.stand_in.as_ref().is_some_and(|s| !sound(s));
        if gone {
            self.stand_in = None;
            if !lost || self.candidate().is_none() {
                // What agreed with the first one before it was lost says nothing of it now.
                (self.further.iter_mut()).for_each(|further| further.agreement.agreed = 0.0);
            }
        }
        if let Some(stand_in) = &mut self.stand_in {
            stand_in.ends &= !lost;
            stand_in.share += if stand_in.ends { -dt } else { dt } / BLEND_S;
            if stand_in.share <= 0.0 {
                self.stand_in = None;
                self.first_doubted = false;
            }
        } else if lost {
            let Some(place) = self.candidate() else {
                return;
            };
            let limits = (self.further.get(place)).map_or([0.0; 2], |f| f.agreement.limits);
            self.stand_in = Some(StandIn {
                place,
                share: if gone { 1.0 } else { dt / BLEND_S },
                ends: false,
                agreement: Agreement::new(limits),
            });
            self.first_doubted = true;
            counts.add_of(Event::ImuStandsIn, Subject::Imu(0));
        }
        if let Some(stand_in) = &mut self.stand_in {
            stand_in.share = stand_in.share.min(1.0);
        }
    }

    /// Compares a first IMU that is sound again with the one that stands in for it.
    fn pass_on(
        &mut self,
        sound: bool,
        first: &ImuMotion,
        base: &ImuMotion,
        dt: f64,
        counts: &mut Counts,
    ) {
        let Some(stand_in) = &mut self.stand_in else {
            return;
        };
        if stand_in.ends {
            return;
        }
        counts.lasting(Event::ImuStandsIn, Subject::Imu(0), false);
        if !sound {
            stand_in.agreement.agreed = 0.0;
            return;
        }
        let before = stand_in.agreement.disagrees;
        stand_in.agreement.compare(first, base, dt);
        stand_in.ends = stand_in.agreement.is_trusted();
        if stand_in.agreement.disagrees {
            counts.lasting(Event::ImuDisagrees, Subject::Imu(0), !before);
        }
    }

    /// Replaces the first IMU's motion in these signals by what stands in for it.
    pub(super) fn stand_in(&self, signals: &mut Filtered) {
        let Some(stand_in) = &self.stand_in else {
            return;
        };
        if let Some(further) = self.further.get(stand_in.place)
            && let Some(own) = signals.imus().get(further.index)
        {
            let carried = carried(&further.back, &signals.input(), own);
            signals.show_base(&carried, stand_in.share);
        }
    }
}

/// An IMU's motion at another link, by the joints' motion of the same instant.
fn carried(way: &CarriedImu, input: &WholeBodyInput<'_>, imu: &ImuMotion) -> ImuMotion {
    way.motion(input.q, input.dq, input.ddq, imu)
}
