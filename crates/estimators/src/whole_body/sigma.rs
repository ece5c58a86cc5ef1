//! How well torques and unexplained wrench are known, from the sensors' own standard deviations.
//!
//! Every output is linear in F/T signals, accelerometer and joint accelerations. The sensors cut
//! the tree into segments: 0 holds the root, `s + 1` what lies beyond sensor `s` up to the next
//! ones. A joint's torque depends on the accelerations of its own segment only, and on the sensors
//! that bound it: what lies beyond a sensor cancels, as the sensor has measured its effect.
//!
//! With `C` the inertia of a part, `S` joint axes, `a` the accelerometer's axes, per joint:
//! `var(tau_j) = sum_s |S_j|^2 sigma_s^2 + |C_j S_j|^2 sigma_a^2 + sum_k (S_j C_jk S_k)^2 sigma_k^2`.
//! Noise of angles, velocities and gyroscope is left out: it enters by products with rates.

use super::layout::Layout;
use super::{WholeBodyEstimate, WholeBodyParameters};
use dynamics::{Data, Force, Inertia, Model, Motion, Se3};
use nalgebra::Vector3;

/// Variances and the memory to compute them.
#[derive(Debug, Clone)]
pub(super) struct Sigma {
    /// Per body: the part of it that its joint's segment holds, in the body's frame.
    own_part: Vec<Inertia>,
    /// Parts of bodies that lie beyond a sensor: segment, body, inertia in the body's frame.
    parts_beyond: Vec<(usize, usize, Inertia)>,
    /// Per body: the segment its joint belongs to.
    segment: Vec<usize>,
    /// Which sensors enter which body's joint torque.
    sensor_terms: Vec<(usize, usize)>,
    /// Which joint acceleration enters which body's joint torque, through which inertia.
    acceleration_terms: Vec<AccelerationTerm>,
    /// The same for the unexplained wrench: body, inertia, inertia to subtract.
    unknown_terms: Vec<(usize, [Option<Part>; 2])>,
    /// Per body: the torque is balanced by the other side of its segment.
    on_path: Vec<bool>,
    /// Sensors that bound the root's segment.
    root_sensors: Vec<usize>,
    sensor_variance: Vec<[f64; 2]>,
    accelerometer_variance: f64,
    /// Per model's joint.
    ddq_variance: Vec<f64>,
    /// In the root's frame, per body: joint axis and inertia of its side of the segment.
    axis: Vec<Motion>,
    composite: Vec<Inertia>,
    /// In the root's frame, per segment: inertia.
    total: Vec<Inertia>,
    /// Per model's joint: variance of the torque.
    variance: Vec<f64>,
}

/// An inertia in the root's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Part {
    /// A body's side of its segment.
    Body(usize),
    /// A whole segment.
    Segment(usize),
}

/// `S_j (sum of plus - sum of minus) S_k`.
#[derive(Debug, Clone)]
struct AccelerationTerm {
    of: usize,
    by: usize,
    plus: [Option<Part>; 2],
    minus: [Option<Part>; 2],
}

impl Sigma {
    pub(super) fn new(model: &Model, p: &WholeBodyParameters, layout: &Layout) -> Self {
        let bodies = model.bodies().len();
        let parts = Parts::new(model, layout);
        let mut ddq_variance = vec![0.0; model.joint_count()];
        for (&joint, sigma) in layout.joints.iter().zip(&p.sigma_ddq) {
            ddq_variance[joint] = sigma * sigma;
        }
        let accelerometer = match (&p.imu, layout.imu_frame) {
            (Some(imu), Some(_)) => imu.sigma_accelerometer.powi(2),
            _ => 0.0,
        };
        let variances =
            |s: &super::FtSensorParameters| [s.sigma_force, s.sigma_torque].map(|x| x * x);
        Self {
            sensor_terms: parts.sensor_terms(model, layout),
            acceleration_terms: parts.acceleration_terms(model, layout),
            unknown_terms: parts.unknown_terms(model, layout),
            root_sensors: (0..layout.sensors.len())
                .filter(|&s| parts.bounds(s) == 0)
                .collect(),
            own_part: parts.own,
            parts_beyond: parts.beyond,
            segment: parts.segment,
            on_path: parts.on_path,
            sensor_variance: p.ft_sensors.iter().map(variances).collect(),
            accelerometer_variance: accelerometer,
            ddq_variance,
            axis: vec![Motion::zero(); bodies],
            composite: vec![Inertia::zero(); bodies],
            total: vec![Inertia::zero(); layout.sensors.len() + 1],
            variance: vec![0.0; model.joint_count()],
        }
    }

    /// Standard deviations at the motion that `data` holds.
    pub(super) fn update(
        &mut self,
        model: &Model,
        data: &Data,
        layout: &Layout,
        out: &mut WholeBodyEstimate,
    ) {
        self.inertias(model, data);
        self.variance.fill(0.0);
        for &(body, s) in &self.sensor_terms {
            let sensor = &layout.sensors[s];
            let in_root = data.placements()[sensor.body].compose(&sensor.placement);
            let axis = in_root.inverse_act_motion(self.axis[body]);
            let [force, torque] = self.sensor_variance[s];
            self.variance[model.bodies()[body].joint] +=
                force * axis.linear.norm_squared() + torque * axis.angular.norm_squared();
        }
        for (i, body) in model.bodies().iter().enumerate().skip(1) {
            let mut part = self.composite[i];
            if self.on_path[i] {
                part = part - self.total[self.segment[i]];
            }
            let lever = part.mul_motion(self.axis[i]).linear;
            self.variance[body.joint] += self.accelerometer_variance * lever.norm_squared();
        }
        for term in &self.acceleration_terms {
            let mut f = Force::zero();
            let motion = self.axis[term.by];
            term.plus
                .iter()
                .flatten()
                .for_each(|&p| f += self.part(p).mul_motion(motion));
            term.minus
                .iter()
                .flatten()
                .for_each(|&p| f -= self.part(p).mul_motion(motion));
            let [of, by] = [term.of, term.by].map(|b| model.bodies()[b].joint);
            self.variance[of] += self.ddq_variance[by] * self.axis[term.of].dot(f).powi(2);
        }
        for (sigma, &joint) in out.sigma.iter_mut().zip(&layout.joints) {
            *sigma = self.variance[joint].sqrt();
        }
        self.unknown_wrench(model, data, layout, out);
    }

    fn part(&self, part: Part) -> Inertia {
        match part {
            Part::Body(body) => self.composite[body],
            Part::Segment(segment) => self.total[segment],
        }
    }

    /// Joint axes and inertias in the root's frame, where inertias simply add up.
    fn inertias(&mut self, model: &Model, data: &Data) {
        self.total.fill(Inertia::zero());
        for (segment, body, inertia) in &self.parts_beyond {
            self.total[*segment] += inertia.transformed(&data.placements()[*body]);
        }
        for (i, body) in model.bodies().iter().enumerate() {
            let placement = &data.placements()[i];
            self.axis[i] = placement.act_motion(body.subspace() * body.ratio);
            self.composite[i] = self.own_part[i].transformed(placement);
        }
        for (i, body) in model.bodies().iter().enumerate().skip(1).rev() {
            let part = self.composite[i];
            if body.parent > 0 && self.segment[body.parent] == self.segment[i] {
                self.composite[body.parent] += part;
            } else {
                self.total[self.segment[i]] += part;
            }
        }
        self.total[0] += self.composite[0];
    }

    /// Standard deviation of f_u, axis by axis.
    fn unknown_wrench(
        &self,
        model: &Model,
        data: &Data,
        layout: &Layout,
        out: &mut WholeBodyEstimate,
    ) {
        let root_in_link = data.placements()[layout.unknown_body]
            .compose(&layout.unknown_placement)
            .inverse();
        let (mut force, mut torque) = (Vector3::zeros(), Vector3::zeros());
        // Isotropic noise of a force turns into a torque by its lever, square by square.
        let lever = |p: &Vector3<f64>| p.map(|x| p.norm_squared() - x * x);
        for &s in &self.root_sensors {
            let sensor = &layout.sensors[s];
            let in_root: Se3 = data.placements()[sensor.body].compose(&sensor.placement);
            let in_link = root_in_link.compose(&in_root);
            let [f, n] = self.sensor_variance[s];
            force.add_scalar_mut(f);
            torque += lever(&in_link.translation) * f;
            torque.add_scalar_mut(n);
        }
        let all = self.total[0].transformed(&root_in_link);
        force.add_scalar_mut(self.accelerometer_variance * all.mass.powi(2));
        torque += lever(&all.first_moment) * self.accelerometer_variance;
        for (by, [plus, minus]) in &self.unknown_terms {
            let mut f = Force::zero();
            plus.iter()
                .for_each(|&p| f += self.part(p).mul_motion(self.axis[*by]));
            minus
                .iter()
                .for_each(|&p| f -= self.part(p).mul_motion(self.axis[*by]));
            let f = root_in_link.act_force(f);
            let variance = self.ddq_variance[model.bodies()[*by].joint];
            force += f.linear.map(|x| x * x) * variance;
            torque += f.angular.map(|x| x * x) * variance;
        }
        out.unknown_wrench_sigma.force = force.map(f64::sqrt).into();
        out.unknown_wrench_sigma.torque = torque.map(f64::sqrt).into();
    }
}

/// The tree cut into segments.
struct Parts {
    own: Vec<Inertia>,
    beyond: Vec<(usize, usize, Inertia)>,
    segment: Vec<usize>,
    on_path: Vec<bool>,
    /// Per sensor: the segment it bounds from outside.
    sensor_segment: Vec<usize>,
    /// Whether the IMU moves with a body's joint.
    moves_imu: Vec<bool>,
}

impl Parts {
    fn new(model: &Model, layout: &Layout) -> Self {
        let bodies = model.bodies().len();
        let frames = model.frames();
        let segment_of_link = |link: usize| {
            let mut carriers = std::iter::successors(Some(link), |&f| frames[f].parent);
            carriers
                .find_map(|f| layout.sensors.iter().position(|s| s.frame == f))
                .map_or(0, |s| s + 1)
        };
        let mut segment = vec![0; bodies];
        for link in frames.iter().filter(|link| !link.rigid) {
            segment[link.body] = link.parent.map_or(0, segment_of_link);
        }
        let mut own = vec![Inertia::zero(); bodies];
        let mut beyond = Vec::new();
        for (i, link) in frames.iter().enumerate() {
            let inertia = link.inertia.transformed(&link.placement);
            let of_link = segment_of_link(i);
            if of_link == segment[link.body] {
                own[link.body] += inertia;
            } else {
                beyond.push((of_link, link.body, inertia));
            }
        }
        let on_path = |body: usize| {
            let end = match segment[body] {
                0 => layout.unknown_body,
                s => layout.sensors[s - 1].contact_body,
            };
            body > 0 && model.supports(body, end)
        };
        let imu_body = layout.imu_frame.map_or(0, |frame| frames[frame].body);
        let sensor_segment =
            |s: &super::layout::Sensor| frames[s.frame].parent.map_or(0, segment_of_link);
        Self {
            own,
            beyond,
            on_path: (0..bodies).map(on_path).collect(),
            sensor_segment: layout.sensors.iter().map(sensor_segment).collect(),
            moves_imu: (0..bodies)
                .map(|b| b > 0 && model.supports(b, imu_body))
                .collect(),
            segment,
        }
    }

    /// The segment that sensor `s` bounds from outside.
    fn bounds(&self, s: usize) -> usize {
        self.sensor_segment[s]
    }

    fn sensor_terms(&self, model: &Model, layout: &Layout) -> Vec<(usize, usize)> {
        let mut terms = Vec::new();
        for body in 1..model.bodies().len() {
            for (s, sensor) in layout.sensors.iter().enumerate() {
                let bounds_outside = self.bounds(s) == self.segment[body];
                let bounds_inside = s + 1 == self.segment[body];
                let beyond = model.supports(body, sensor.body);
                if (bounds_outside && beyond != self.on_path[body])
                    || (bounds_inside && self.on_path[body])
                {
                    terms.push((body, s));
                }
            }
        }
        terms
    }

    /// The part of segment `g` that moves with body `k`'s joint.
    fn moved(&self, model: &Model, layout: &Layout, g: usize, k: usize) -> Option<Part> {
        if self.segment[k] == g {
            return Some(Part::Body(k));
        }
        let carries_all = g > 0 && model.supports(k, layout.sensors[g - 1].body);
        carries_all.then_some(Part::Segment(g))
    }

    fn acceleration_terms(&self, model: &Model, layout: &Layout) -> Vec<AccelerationTerm> {
        let bodies = 1..model.bodies().len();
        let mut terms = Vec::new();
        for of in bodies.clone() {
            let g = self.segment[of];
            for by in bodies.clone() {
                // Bodies beyond `by` accelerate; if the IMU is there too, the others do backwards.
                let shared = if model.supports(by, of) {
                    Some(Part::Body(of))
                } else if model.supports(of, by) && self.segment[by] == g {
                    Some(Part::Body(by))
                } else {
                    None
                };
                let backwards = self.moves_imu[by];
                let mut plus = [shared, None];
                let mut minus = [backwards.then_some(Part::Body(of)), None];
                if self.on_path[of] {
                    plus[1] = backwards.then_some(Part::Segment(g));
                    minus[1] = self.moved(model, layout, g, by);
                }
                for p in &mut plus {
                    if let Some(m) = minus.iter_mut().find(|m| p.is_some() && **m == *p) {
                        (*p, *m) = (None, None);
                    }
                }
                if plus.iter().chain(&minus).any(Option::is_some) {
                    terms.push(AccelerationTerm {
                        of,
                        by,
                        plus,
                        minus,
                    });
                }
            }
        }
        terms
    }

    fn unknown_terms(&self, model: &Model, layout: &Layout) -> Vec<(usize, [Option<Part>; 2])> {
        let term = |by: usize| {
            let backwards = self.moves_imu[by].then_some(Part::Segment(0));
            (by, [self.moved(model, layout, 0, by), backwards])
        };
        (1..model.bodies().len())
            .map(term)
            .filter(|(_, parts)| parts.iter().any(Option::is_some))
            .collect()
    }
}
