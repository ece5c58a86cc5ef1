//! Cross-check of three independent torques of every joint: from encoders, from F/T sensors, from
//! motor current. A lasting disagreement is reported with its likely cause.
//!
//! All three are brought to one instant by a filter of the F/T sensors' delay, and averaged. Then
//!
//! - the encoders' torque differs from the F/T sensors' on one joint of a limb alone, the current
//!   is nearer to the latter, and exact enough to choose between them: an encoder has slipped;
//! - the F/T sensors' differs on several joints that carry one sensor, those nearest to it among
//!   them: the sensor has drifted;
//! - it differs on joints farther in, but not on those nearest to the sensor: something touches the
//!   limb between; or a part's residual exceeds its standard deviation while the joints nearest
//!   to it agree: something touches a part that was declared untouched;
//! - under load the current's torque is another multiple of the F/T sensors', which the encoders
//!   about confirm: its torque constant is wrong, or its sign.

use crate::estimator::WholeBody;

/// The likely cause of a disagreement.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cause {
    /// The encoders of a joint disagree with F/T sensors and current.
    EncoderSlip {
        /// The joint.
        joint: usize,
    },
    /// An F/T sensor disagrees with the encoders of the joints that carry it.
    FtDrift {
        /// The sensor.
        sensor: usize,
    },
    /// Motor current disagrees with encoders and F/T sensors on the torque's size.
    TorqueConstant {
        /// The joint.
        joint: usize,
    },
    /// Motor current disagrees with encoders and F/T sensors on the torque's sign.
    TorqueSign {
        /// The joint.
        joint: usize,
    },
    /// Something touches the limb of an F/T sensor, and no contact was declared there.
    MissingContact {
        /// The sensor.
        sensor: usize,
    },
}

/// Normal differences between the sources, and times.
#[derive(Debug, Clone, PartialEq)]
pub struct CrossCheckParameters {
    /// T: time between updates, s.
    pub sample_period: f64,
    /// Samples that the F/T sensors' filters average.
    pub window: usize,
    /// Time over which differences are averaged, s.
    pub average: f64,
    /// How long a disagreement must last, s.
    pub hold: f64,
    /// Per joint: differences of encoders and F/T sensors that are normal, N·m.
    pub encoder_threshold: Vec<f64>,
    /// Per joint: torque from which on the size of the current's can be judged, N·m: several times
    /// the friction. From half of it on its sign can.
    pub current_load: Vec<f64>,
    /// Smallest and largest ratio of the current's torque to the F/T sensors' that are normal.
    pub current_ratio: [f64; 2],
    /// Residual of a part that is normal, in its standard deviations.
    pub residual_ratio: f64,
    /// Standard deviation of residuals in addition to the estimated one, N and N·m: vibration that
    /// the filters pass.
    pub residual_floor: [f64; 2],
}

/// One joint's torques in one cycle, N·m; none where a source is not valid.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Sources {
    /// From encoders, undelayed.
    pub encoder: Option<f64>,
    /// From F/T sensors, delayed by their filters.
    pub whole_body: Option<f64>,
    /// From motor current, undelayed; none also while the drive is off, when a brake may carry the torque.
    pub current: Option<f64>,
    /// Standard deviation of `current`; not read where that has none.
    pub current_sigma: f64,
}

/// One joint's averages.
#[derive(Debug, Clone)]
struct Joint {
    /// Encoder's and current's torque over the F/T sensors' window.
    rings: [Vec<f64>; 2],
    sums: [f64; 2],
    filled: usize,
    /// Samples of the current's torque since the last one without.
    currents: usize,
    newest: usize,
    /// Encoder - F/T.
    difference: f64,
    /// |current - F/T| - |current - encoder| / 2: below zero if the current clearly sides with the
    /// F/T sensors.
    aside: f64,
    /// Standard deviation of the current's torque. It is an error of friction, above all: averages
    /// do not lessen it.
    current_sigma: f64,
    /// The current's torque, for its size and for its sign.
    current: [Ratio; 2],
}

/// Regression of the current's torque on the F/T sensors'.
#[derive(Debug, Clone, Copy, Default)]
struct Ratio {
    /// Average product of both torques, and average square of the F/T sensors', under load.
    product: f64,
    square: f64,
    loaded: bool,
}

/// See the module.
#[derive(Debug, Clone)]
pub struct CrossCheck {
    parameters: CrossCheckParameters,
    joints: Vec<Joint>,
    /// Per sensor: joints that carry it and neither another sensor nor a contact, nearest first.
    carriers: Vec<Vec<usize>>,
    /// Per sensor: residual of the part beyond and its variance, averaged.
    residual: Vec<[[f64; 6]; 2]>,
    /// Causes and how long each has lasted.
    suspects: Vec<(Cause, f64)>,
    found: Vec<Cause>,
    age: f64,
}

/// Ratio of torques below which the sign is wrong, not the size.
const OPPOSITE_SIGN_RATIO: f64 = -0.25;
/// Index of the ratio by which the current's size is judged.
const SIZE: usize = 0;
/// Index of the ratio by which its sign is judged.
const SIGN: usize = 1;
/// Smallest load for each, as a share of `current_load`: error of the friction model hides a size
/// before it hides a sign.
const MIN_LOAD_SHARES: [f64; 2] = [1.0, 0.5];
/// Difference of encoders and F/T sensors from which on the current can choose between them, in its
/// standard deviations: with a smaller one it is near either by chance.
const SURE_SIGMAS: f64 = 3.0;
/// Number of joints nearest to a sensor that must agree for its drift to be ruled out.
const NEAREST_JOINTS: usize = 2;

impl CrossCheck {
    /// For the joints and sensors of an estimator, in their order.
    #[must_use]
    pub fn new(whole_body: &WholeBody, parameters: CrossCheckParameters) -> Self {
        let joints = whole_body.estimate().tau.len();
        let carriers = whole_body.sensor_limbs();
        let window = parameters.window.max(1);
        let joint = Joint {
            rings: [vec![0.0; window], vec![0.0; window]],
            sums: [0.0; 2],
            filled: 0,
            currents: 0,
            newest: 0,
            difference: 0.0,
            aside: 0.0,
            current_sigma: 0.0,
            current: [Ratio::default(); 2],
        };
        let mut suspects = Vec::new();
        for j in 0..joints {
            suspects.push((Cause::EncoderSlip { joint: j }, 0.0));
            suspects.push((Cause::TorqueConstant { joint: j }, 0.0));
            suspects.push((Cause::TorqueSign { joint: j }, 0.0));
        }
        for s in 0..carriers.len() {
            suspects.push((Cause::FtDrift { sensor: s }, 0.0));
            suspects.push((Cause::MissingContact { sensor: s }, 0.0));
        }
        Self {
            found: Vec::with_capacity(suspects.len()),
            suspects,
            joints: vec![joint; joints],
            residual: vec![[[0.0; 6]; 2]; carriers.len()],
            carriers,
            parameters,
            age: 0.0,
        }
    }

    /// Takes one cycle's torques; returns the causes that have lasted long enough.
    pub fn update(&mut self, sources: &[Sources], whole_body: &WholeBody) -> &[Cause] {
        let p = &self.parameters;
        let share = (p.sample_period / p.average.max(p.sample_period)).min(1.0);
        for (joint, (s, load)) in (self.joints.iter_mut()).zip(sources.iter().zip(&p.current_load))
        {
            joint.update(s, share, *load);
        }
        let parts = whole_body.estimate().parts.iter().skip(1);
        for (mean, part) in self.residual.iter_mut().zip(parts) {
            let free = part.unknowns < 6;
            let wrenches = [&part.residual, &part.residual_sigma];
            for (k, (mean, w)) in mean.iter_mut().zip(wrenches).enumerate() {
                for (mean, x) in mean.iter_mut().zip(w.force.iter().chain(&w.torque)) {
                    let x = if k == 0 { *x } else { x * x };
                    *mean += share * (if free { x } else { 0.0 } - *mean);
                }
            }
        }
        self.age += p.sample_period;
        self.found.clear();
        // The averages must have forgotten the start.
        if self.age < 3.0 * p.average {
            return &self.found;
        }
        for k in 0..self.suspects.len() {
            let (cause, lasted) = self.suspects[k];
            let lasted = match self.suspected(cause) {
                Some(true) => lasted + self.parameters.sample_period,
                Some(false) => 0.0,
                None => lasted,
            };
            self.suspects[k].1 = lasted;
            if lasted > self.parameters.hold {
                self.found.push(cause);
            }
        }
        &self.found
    }

    /// Forgets all samples: after a tare, which changes the F/T sensors' readings.
    pub fn reset(&mut self) {
        self.age = 0.0;
        self.residual.fill([[0.0; 6]; 2]);
        self.suspects.iter_mut().for_each(|s| s.1 = 0.0);
        self.found.clear();
        for joint in &mut self.joints {
            (joint.filled, joint.sums) = (0, [0.0; 2]);
            (joint.difference, joint.aside, joint.current_sigma) = (0.0, 0.0, 0.0);
            joint.current = [Ratio::default(); 2];
        }
    }

    /// Averaged difference of a joint's torques from encoders and F/T sensors, N·m.
    #[must_use]
    pub fn difference(&self, joint: usize) -> f64 {
        self.joints.get(joint).map_or(0.0, |j| j.difference)
    }

    /// The causes that stand.
    #[must_use]
    pub fn found(&self) -> &[Cause] {
        &self.found
    }

    /// Whether encoders and F/T sensors differ by more than a share of the joint's threshold.
    fn differs(&self, joint: usize, share: f64) -> bool {
        let all = &self.parameters.encoder_threshold;
        let threshold = all.get(joint).copied().unwrap_or(f64::INFINITY);
        (self.joints.get(joint)).is_some_and(|j| j.difference.abs() > share * threshold)
    }

    /// Joints of a sensor's limb whose encoders and F/T torque differ.
    fn differing(&self, sensor: usize) -> usize {
        let carriers = self.carriers[sensor].iter();
        carriers.filter(|&&j| self.differs(j, 1.0)).count()
    }

    fn near_differs(&self, sensor: usize, share: f64) -> bool {
        let near = self.carriers[sensor].iter().take(NEAREST_JOINTS);
        near.into_iter().any(|&j| self.differs(j, share))
    }

    /// Whether the joint's disagreement is due to a sensor, as other joints of its limb disagree too.
    fn of_a_limb(&self, joint: usize) -> bool {
        (0..self.carriers.len()).any(|s| self.carriers[s].contains(&joint) && self.differing(s) > 1)
    }

    /// None while the cause cannot be judged.
    fn suspected(&self, cause: Cause) -> Option<bool> {
        Some(match cause {
            Cause::EncoderSlip { joint } => {
                self.differs(joint, 1.0)
                    && !self.of_a_limb(joint)
                    && self.joints[joint].current_sides_with_ft()
            }
            Cause::FtDrift { sensor } => {
                self.differing(sensor) > 1 && self.near_differs(sensor, 1.0)
            }
            Cause::MissingContact { sensor } => {
                // Half the threshold: a drift just below it must not pass for a contact.
                let near = self.near_differs(sensor, 0.5);
                !near && (self.residual_stands_out(sensor) || self.differing(sensor) > 1)
            }
            Cause::TorqueConstant { joint } => {
                let [min, max] = self.parameters.current_ratio;
                let ratio = self.current_ratio(joint, SIZE)?;
                ratio >= OPPOSITE_SIGN_RATIO && !(min..=max).contains(&ratio)
            }
            Cause::TorqueSign { joint } => self.current_ratio(joint, SIGN)? < OPPOSITE_SIGN_RATIO,
        })
    }

    fn residual_stands_out(&self, sensor: usize) -> bool {
        let p = &self.parameters;
        let [residual, variance] = &self.residual[sensor];
        let pairs = residual.iter().zip(variance).enumerate();
        let mut ratios = pairs.map(|(k, (r, v))| {
            let floor = p.residual_floor[usize::from(k >= 3)];
            r.abs() / (v + floor * floor).sqrt().max(f64::MIN_POSITIVE)
        });
        ratios.any(|ratio| ratio > p.residual_ratio)
    }

    /// Ratio of the current's torque to the F/T sensors', if those are trustworthy and there is load.
    fn current_ratio(&self, joint: usize, kind: usize) -> Option<f64> {
        let ratio = self.joints.get(joint)?.current[kind];
        // A current that is wrong moves the encoders' torque too, by the wave generator's term.
        let judged = ratio.loaded
            && ratio.square > 0.0
            && !self.differs(joint, 3.0)
            && !self.of_a_limb(joint);
        judged.then(|| ratio.product / ratio.square)
    }
}

impl Joint {
    /// The current is clearly nearer to the F/T sensors' torque than to the encoders', and not by
    /// chance.
    fn current_sides_with_ft(&self) -> bool {
        self.aside < 0.0 && self.difference.abs() > SURE_SIGMAS * self.current_sigma
    }

    fn update(&mut self, s: &Sources, share: f64, load: f64) {
        let (Some(e), Some(w)) = (s.encoder, s.whole_body) else {
            // Averages need every sample of a window; differences stay as they are.
            (self.filled, self.sums) = (0, [0.0; 2]);
            return;
        };
        self.currents = s.current.map_or(0, |_| self.currents.saturating_add(1));
        let (c, sigma) = s.current.map_or((0.0, 0.0), |c| (c, s.current_sigma));
        if ![e, w, c, sigma].iter().all(|x| x.is_finite()) {
            (self.filled, self.sums) = (0, [0.0; 2]);
            return;
        }
        let window = self.rings[0].len();
        self.newest = (self.newest + 1) % window;
        for (k, x) in [e, c].into_iter().enumerate() {
            if self.filled == window {
                self.sums[k] -= self.rings[k][self.newest];
            }
            self.rings[k][self.newest] = x;
            self.sums[k] += x;
        }
        self.filled = (self.filled + 1).min(window);
        if self.filled < window {
            return;
        }
        if self.newest == 0 {
            // Once per window summed anew, without the accumulated rounding.
            self.sums = [0, 1].map(|k| self.rings[k].iter().sum());
        }
        let [e, c] = self.sums.map(|s| s / window as f64);
        self.difference += share * (e - w - self.difference);
        if self.currents < window {
            // Without the current's torque nothing is known of it, and it sides with nobody.
            (self.aside, self.current) = (0.0, [Ratio::default(); 2]);
            return;
        }
        let nearer = (c - w).abs() - 0.5 * (c - e).abs();
        self.aside += share * (nearer - self.aside);
        self.current_sigma += share * (s.current_sigma - self.current_sigma);
        for (ratio, part) in self.current.iter_mut().zip(MIN_LOAD_SHARES) {
            ratio.loaded = w.abs() > part * load;
            if ratio.loaded {
                ratio.product += share * (c * w - ratio.product);
                ratio.square += share * (w * w - ratio.square);
            }
        }
    }
}
