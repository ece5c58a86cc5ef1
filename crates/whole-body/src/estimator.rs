//! The estimator: one update a cycle.

mod publish;
mod sensors;
mod signals;

pub use signals::{ContactEstimate, PartEstimate, WholeBodyEstimate, WholeBodyInput};

use crate::contacts::ContactSet;
use crate::error::WholeBodyError;
use crate::layout::Layout;
use crate::least_squares::whitening;
use crate::mechanics::Mechanics;
use crate::parameters::{Residual, Weighting, WholeBodyParameters};
use crate::sigma::Sigma;
use crate::solution::{Solution, about, unit_wrenches};
use dynamics::{Force, ImuMotion, Model, Motion, Random};
use nalgebra::{Matrix6, Vector3};
use robot_state::Wrench;

/// Extent of an update.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Extent {
    Whole,
    Torques,
}

/// When covariances are computed anew.
#[derive(Debug, Clone)]
struct Refreshing {
    /// Updates from one computation to the next, and the place of this one among them.
    every: u32,
    place: u32,
    /// Shares of the hypotheses by which they were computed, and whether in a valid update.
    weights: Vec<f64>,
    known: bool,
}

impl Refreshing {
    /// Whether it is time to, in an update with these shares.
    fn is_due(&mut self, weights: &[f64]) -> bool {
        self.place = match self.place + 1 {
            next if next < self.every => next,
            _ => 0,
        };
        let due = self.place == 0 || !self.known || self.weights != weights;
        if due {
            self.weights.copy_from_slice(weights);
        }
        due
    }
}

/// Estimates all joint torques and contact wrenches of a robot (D 2, Algorithm 1, in general form).
#[derive(Debug, Clone)]
pub struct WholeBody {
    model: Model,
    layout: Layout,
    mechanics: Mechanics,
    sigma: Sigma,
    names: Vec<String>,
    sets: Vec<ContactSet>,
    solutions: Vec<Solution>,
    /// Share of each hypothesis in the torques; they add up to one.
    weights: Vec<f64>,
    refreshing: Refreshing,
    chosen: usize,
    weighting: Weighting,
    /// Per part: a hypothesis has contacts on it whose wrenches depend on weights.
    weighted: Vec<bool>,
    residual: Residual,
    part_labels: Vec<String>,
    /// Index of each part in the estimate: the caller's index of its sensor + 1.
    part_output: Vec<usize>,
    /// Joint motion in the model's order.
    motion: [Vec<f64>; 3],
    /// Joint torques by bodies, and in the model's order.
    tau: Vec<f64>,
    by_joint: Vec<f64>,
    estimate: WholeBodyEstimate,
    /// The estimate of this cycle, until it is known to be finite.
    next: WholeBodyEstimate,
}

impl WholeBody {
    /// Checks that the torques follow from the sensors under every hypothesis, and prepares.
    ///
    /// # Errors
    /// Links or joints that the model lacks, and sensors or contacts from which the torques do not
    /// follow.
    pub fn new(model: &Model, p: &WholeBodyParameters) -> Result<Self, WholeBodyError> {
        let layout = Layout::new(model, p)?;
        let mut sets = Vec::new();
        for (i, hypothesis) in p.hypotheses.iter().enumerate() {
            if p.hypotheses[..i].iter().any(|h| h.name == hypothesis.name) {
                let name = hypothesis.name.clone();
                return Err(WholeBodyError::HypothesisNamedTwice(name));
            }
            sets.push(ContactSet::new(model, &layout, p, hypothesis)?);
        }
        if sets.is_empty() {
            return Err(WholeBodyError::NoHypothesis);
        }
        let mut sigma = Sigma::new(model, &layout, p, &sets);
        if p.weighting == Weighting::Expected {
            weights_follow(model, &layout, p, &sets, &mut sigma)?;
        }
        let joints = model.joint_count();
        let longest = p.hypotheses.iter().map(|h| h.contacts.len()).max();
        let mut weights = vec![0.0; sets.len()];
        weights[0] = 1.0;
        let sensors = layout.sensors.iter().map(|s| s.input + 1);
        let part_output: Vec<usize> = std::iter::once(0).chain(sensors).collect();
        let parts = layout.parts.len();
        let mut part_labels = vec![String::new(); parts];
        for (part, &output) in part_output.iter().enumerate() {
            part_labels[output] = layout.describe(model, p, part);
        }
        let estimate = WholeBodyEstimate {
            tau: vec![0.0; layout.joints.len()],
            sigma: vec![0.0; layout.joints.len()],
            lasting_sigma: vec![0.0; layout.joints.len()],
            contacts: vec![ContactEstimate::default(); longest.unwrap_or(0)],
            parts: vec![PartEstimate::default(); parts],
            valid: false,
        };
        Ok(Self {
            mechanics: Mechanics::new(model, &layout),
            sigma,
            names: p.hypotheses.iter().map(|h| h.name.clone()).collect(),
            solutions: sets.iter().map(Solution::new).collect(),
            refreshing: Refreshing {
                every: 1,
                place: 0,
                weights: weights.clone(),
                known: false,
            },
            weights,
            chosen: 0,
            weighting: p.weighting,
            weighted: (0..parts)
                .map(|part| {
                    // With as many unknowns as equations weights change nothing.
                    let depends = |set: &ContactSet| (1..6).contains(&set.parts[part].1);
                    p.weighting == Weighting::Expected && sets.iter().any(depends)
                })
                .collect(),
            residual: p.residual,
            part_labels,
            part_output,
            motion: [(); 3].map(|()| vec![0.0; joints]),
            tau: vec![0.0; model.bodies().len()],
            by_joint: vec![0.0; joints],
            next: estimate.clone(),
            estimate,
            sets,
            layout,
            model: model.clone(),
        })
    }

    /// The same, but covariances of torques, contacts and residuals are computed anew in one of `every`
    /// updates, in the `place`-th of these, and where the shares of the hypotheses have changed. They
    /// follow from pose and acceleration, which change little within milliseconds, and take half of an
    /// update's time; estimators with places of their own do not take it in the same cycle.
    /// Covariances that the torques depend on ([`Weighting::Expected`]) are always those of the update.
    #[must_use]
    pub fn with_covariances_every(mut self, every: u32, place: u32) -> Self {
        self.refreshing.every = every.max(1);
        self.refreshing.place = place;
        self
    }

    /// Takes one cycle's signals. If any is not finite or a slice is too short, a result overflows,
    /// or the contacts depend on one another at this pose, the last estimate stands, marked as not
    /// valid.
    pub fn update(&mut self, input: &WholeBodyInput) -> &WholeBodyEstimate {
        self.advance(input, Extent::Whole)
    }

    /// [`Self::update`] of `tau` and `sigma` alone, in half the time: contacts, and net wrenches and
    /// residuals of the parts, are not of these signals.
    pub fn update_torques(&mut self, input: &WholeBodyInput) -> &WholeBodyEstimate {
        self.advance(input, Extent::Torques)
    }

    fn advance(&mut self, input: &WholeBodyInput, extent: Extent) -> &WholeBodyEstimate {
        let refresh = self.refreshing.is_due(&self.weights);
        self.estimate.valid = self.accept(input);
        if self.estimate.valid {
            let source = match self.layout.fixed_gravity {
                Some(gravity) => ImuMotion {
                    angular_velocity: Vector3::zeros(),
                    angular_acceleration: Vector3::zeros(),
                    proper_acceleration: -gravity,
                },
                None => input.imu,
            };
            let [q, dq, ddq] = &self.motion;
            let motion = [q.as_slice(), dq, ddq];
            (self.mechanics).update(&self.model, &self.layout, motion, &source, input.ft);
            if refresh || self.weighted.contains(&true) {
                self.mechanics.carry(&self.layout);
                (self.sigma).prepare(&self.model, &self.layout, &self.mechanics);
            }
            let parts = |part: usize| refresh && extent == Extent::Whole || self.weighted[part];
            (self.sigma).net_wrenches(&self.layout, &self.mechanics, parts);
            self.estimate.valid = self.solve();
        }
        if self.estimate.valid {
            self.publish_torques();
            if refresh {
                self.publish_sigmas()
            } else {
                (self.next.lasting_sigma).clone_from(&self.estimate.lasting_sigma);
                self.next.sigma.clone_from(&self.estimate.sigma)
            }
            if extent == Extent::Whole {
                self.publish_contacts();
                self.publish_parts();
            }
            self.estimate.valid = self.next.is_finite();
        }
        self.refreshing.known = self.estimate.valid && (refresh || self.refreshing.known);
        if self.estimate.valid {
            self.next.valid = true;
            std::mem::swap(&mut self.estimate, &mut self.next);
        }
        &self.estimate
    }

    /// The last estimate.
    #[must_use]
    pub fn estimate(&self) -> &WholeBodyEstimate {
        &self.estimate
    }

    /// Names of the hypotheses.
    #[must_use]
    pub fn hypotheses(&self) -> &[String] {
        &self.names
    }

    /// Index of the chosen hypothesis.
    #[must_use]
    pub fn chosen(&self) -> usize {
        self.chosen
    }

    /// Chooses a hypothesis from the next update on, without blending. None of that index: false.
    pub fn choose(&mut self, hypothesis: usize) -> bool {
        if hypothesis >= self.sets.len() {
            return false;
        }
        self.chosen = hypothesis;
        self.weights.fill(0.0);
        self.weights[hypothesis] = 1.0;
        true
    }

    /// Shares of the hypotheses in the torques from the next update on; the contact wrenches are those
    /// of the hypothesis with the largest share. Values that are not finite or negative count as zero.
    pub fn blend(&mut self, weights: &[f64]) {
        let clean = |w: f64| if w.is_finite() { w.max(0.0) } else { 0.0 };
        let known = &weights[..weights.len().min(self.weights.len())];
        let sum: f64 = known.iter().map(|w| clean(*w)).sum();
        if sum.is_nan() || sum <= 0.0 {
            return;
        }
        self.weights.fill(0.0);
        for (own, w) in self.weights.iter_mut().zip(known) {
            *own = clean(*w) / sum;
        }
        self.chosen = largest(&self.weights);
    }

    /// The parts in words, in the order of [`WholeBodyEstimate::parts`].
    #[must_use]
    pub fn part_labels(&self) -> &[String] {
        &self.part_labels
    }

    /// Names of each part's links, first link first, in the order of [`WholeBodyEstimate::parts`].
    #[must_use]
    pub fn part_links(&self) -> Vec<Vec<String>> {
        let mut links = vec![Vec::new(); self.layout.parts.len()];
        for (part, &output) in self.part_output.iter().enumerate() {
            let first = self.layout.parts[part].first_link;
            let others = (0..self.layout.part_of_link.len()).filter(|&l| l != first);
            let own = others.filter(|&l| self.layout.part_of_link[l] == part);
            links[output] = std::iter::once(first)
                .chain(own)
                .map(|l| self.model.frames()[l].name.clone())
                .collect();
        }
        links
    }

    /// Twist and proper spatial acceleration of the root, in its axes, as of the last valid signals.
    #[must_use]
    pub fn base_motion(&self) -> (Motion, Motion) {
        (self.mechanics.velocity[0], self.mechanics.acceleration[0])
    }

    /// How many contacts each hypothesis has.
    #[must_use]
    pub fn contact_counts(&self) -> Vec<usize> {
        self.sets.iter().map(|set| set.contacts.len()).collect()
    }

    /// Adds the wrench of every contact of the chosen hypothesis, as estimated last, to the forces
    /// on the model's bodies, each in its body's frame.
    pub fn add_contact_forces(&self, forces: &mut [Force]) {
        let (set, solution) = (&self.sets[self.chosen], &self.solutions[self.chosen]);
        for (contact, wrench) in set.contacts.iter().zip(&solution.local) {
            if let Some(force) = forces.get_mut(contact.body) {
                *force += contact.placement.act_force(*wrench);
            }
        }
    }

    /// Parts that nothing touches under the chosen hypothesis.
    pub(crate) fn untouched_parts(&self) -> Vec<usize> {
        let parts = self.sets[self.chosen].parts.iter().enumerate();
        parts
            .filter(|(_, (_, n))| *n == 0)
            .map(|(part, _)| part)
            .collect()
    }

    /// A part's net wrench about its origin, its covariance, and how each sensor at its ends (the
    /// caller's index) enters it: of the sensor's offset, in that sensor's components.
    pub(crate) fn tare_equations(&self, part: usize) -> TareEquations {
        let m = &self.mechanics;
        let origin = m.origin(&self.model, &self.layout, part);
        let covariance = self.sigma.covariance[part];
        let covariance = Matrix6::from_fn(|i, j| covariance[i][j]);
        let ends = self.layout.parts[part].boundary.iter().map(|&(s, sign)| {
            let columns = unit_wrenches(&m.sensor_frame[s], &origin) * sign;
            (self.layout.sensors[s].input, columns)
        });
        TareEquations {
            net: about(m.net[part], &origin),
            covariance,
            ends: ends.collect(),
        }
    }

    /// Brings the joints into the model's order; false if something is missing or not finite.
    fn accept(&mut self, input: &WholeBodyInput) -> bool {
        let imu = &input.imu;
        let vectors = [
            imu.angular_velocity,
            imu.angular_acceleration,
            imu.proper_acceleration,
        ];
        let mut finite = self.layout.fixed_gravity.is_some()
            || vectors.iter().all(|x| x.iter().all(|x| x.is_finite()));
        let n = self.layout.sensors.len();
        finite &= input.ft.len() >= n
            && (input.ft.iter().take(n)).all(|w| w.to_array().iter().all(|x| x.is_finite()));
        for (i, &joint) in self.layout.joints.iter().enumerate() {
            let signals = [input.q.get(i), input.dq.get(i), input.ddq.get(i)];
            for (own, signal) in self.motion.iter_mut().zip(signals) {
                let Some(&x) = signal else { return false };
                finite &= x.is_finite();
                own[joint] = x;
            }
        }
        finite
    }

    /// Every hypothesis that has a share; false if one cannot be solved at this pose.
    fn solve(&mut self) -> bool {
        let covariance = match self.weighting {
            Weighting::Unit => None,
            Weighting::Expected => Some(self.sigma.covariance.as_slice()),
        };
        let mut determined = true;
        self.tau.copy_from_slice(&self.mechanics.tau);
        for (h, &weight) in self.weights.iter().enumerate() {
            if weight == 0.0 && h != self.chosen {
                continue;
            }
            let (set, solution) = (&self.sets[h], &mut self.solutions[h]);
            solution.solve(&self.model, &self.layout, &self.mechanics, set, covariance);
            determined &= solution.determined(set);
            solution.add_torques(
                &self.layout,
                &self.mechanics,
                set,
                self.residual,
                weight,
                &mut self.tau,
            );
        }
        let (set, solution) = (&self.sets[self.chosen], &self.solutions[self.chosen]);
        for (part, &output) in self.part_output.iter().enumerate() {
            for estimate in [&mut self.estimate, &mut self.next] {
                let estimate = &mut estimate.parts[output];
                estimate.rank = solution.rank[part] as u32;
                estimate.unknowns = set.parts[part].1 as u32;
            }
        }
        determined
    }
}

/// Refuses expected errors that are singular at every pose; at a single pose the estimate is marked
/// as not valid.
fn weights_follow(
    model: &Model,
    layout: &Layout,
    p: &WholeBodyParameters,
    sets: &[ContactSet],
    sigma: &mut Sigma,
) -> Result<(), WholeBodyError> {
    const POSES: usize = 3;
    let mut random = Random::new(1);
    let mut mechanics = Mechanics::new(model, layout);
    let rest = vec![0.0; model.joint_count()];
    let readings = vec![Wrench::default(); layout.sensors.len()];
    let mut follows = vec![false; layout.parts.len()];
    for _ in 0..POSES {
        let q = random.vector(model.joint_count(), 1.5);
        let source = ImuMotion {
            angular_velocity: Vector3::zeros(),
            angular_acceleration: Vector3::zeros(),
            proper_acceleration: Vector3::from_column_slice(&random.vector(3, 10.0)),
        };
        mechanics.update(model, layout, [&q, &rest, &rest], &source, &readings);
        mechanics.carry(layout);
        sigma.prepare(model, layout, &mechanics);
        sigma.net_wrenches(layout, &mechanics, |_| true);
        for (follows, covariance) in follows.iter_mut().zip(&sigma.covariance) {
            *follows |= whitening(covariance, &mut [[0.0; 6]; 6]);
        }
    }
    for (part, follows) in follows.iter().enumerate() {
        let weighted = |set: &ContactSet| (1..6).contains(&set.parts[part].1);
        if !follows && sets.iter().any(weighted) {
            let part = layout.describe(model, p, part);
            return Err(WholeBodyError::SingularWeights(part));
        }
    }
    Ok(())
}

/// `net + sum ends offset = 0` for a part that nothing touches.
pub(crate) struct TareEquations {
    pub(crate) net: Force,
    pub(crate) covariance: Matrix6<f64>,
    pub(crate) ends: Vec<(usize, Matrix6<f64>)>,
}

/// Index of the largest; the first of equals.
fn largest(x: &[f64]) -> usize {
    let mut best = 0;
    for (i, value) in x.iter().enumerate() {
        if *value > x[best] {
            best = i;
        }
    }
    best
}

pub(crate) fn wrench(f: Force) -> Wrench {
    Wrench {
        force: f.linear.into(),
        torque: f.angular.into(),
    }
}
