//! Standard deviations of contact wrenches, torques and residuals, from those of the sensors.
//!
//! Every output is linear in F/T signals, accelerometer, angular and joint accelerations. A joint's
//! torque is `S_j (f_j - r_j) + sum_g z_g b_g`: its axis `S_j`, the inertial wrench `f_j` and the
//! readings `r_j` that it carries in its part, the parts' net wrenches `b_g`, and the responses `z_g`
//! to them: by the contacts that it carries in its own part, and by the residuals of parts beyond,
//! where they are handed on. An acceleration `m` of the whole robot changes `f_j` by `C_j m` and the
//! inertial part of `b_g` by `C_g m`, with `C_j`, `C_g` the inertias that the joint carries in its
//! part and of the whole part. A mimic joint and its driver are one input and one output: their
//! responses add up before they are squared. Noise of angles, velocities and gyroscope is left out:
//! it enters by products with rates. The model's error is independent between parts.

use crate::contacts::ContactSet;
use crate::covariance::{Covariance, Six6};
use crate::layout::Layout;
use crate::mechanics::Mechanics;
use crate::parameters::{LastingErrors, MotionSource, Residual, WholeBodyParameters};
use crate::solution::{Hypotheses, about};
use dynamics::{Force, Model, Motion, Se3};
use nalgebra::Vector3;

/// Variances and the memory to compute them.
#[derive(Debug, Clone)]
pub(crate) struct Sigma {
    /// Per sensor: of force and torque.
    sensor: Vec<[f64; 2]>,
    /// Per sensor.
    lasting: Vec<LastingErrors>,
    accelerometer: f64,
    lasting_accelerometer: f64,
    angular_acceleration: f64,
    model: f64,
    /// Per model's joint.
    ddq: Vec<f64>,
    relations: Relations,
    /// Per body: `C_j S_j`, for the joint's own part.
    lever: Vec<Force>,
    /// Per pair of bodies, the carrying one first: `S_k C_j S_j`, the response of either joint's
    /// torque to the other one's acceleration, for the carried joint's own part.
    coupling: Vec<f64>,
    /// Per model's joint: effect of its acceleration on a part's net wrench.
    effect: Vec<Force>,
    /// Per part: its origin.
    origin: Vec<Vector3<f64>>,
    response: Response,
    /// Per part: covariance of `b` about the part's origin.
    pub(crate) covariance: Vec<Six6>,
    /// Per model's joint.
    pub(crate) variance: Vec<f64>,
    /// Per model's joint: variance by what lasts of the errors of sensors.
    pub(crate) lasting_variance: Vec<f64>,
}

/// Relations of joints and parts that follow from the tree.
#[derive(Debug, Clone)]
struct Relations {
    /// Per part: bodies of other parts whose joints carry all of it.
    movers: Vec<Vec<usize>>,
    /// Per part: the model's joints whose acceleration changes its net wrench.
    accelerating: Vec<Vec<usize>>,
    /// Per body: those of its part that its joint carries, itself too.
    carried: Vec<Vec<usize>>,
    /// Per body: all bodies whose joints carry it, without itself.
    carrying: Vec<Vec<usize>>,
    /// Per body: sensors that its joint carries in its own part.
    sensors: Vec<Vec<usize>>,
    /// Per body: parts beyond its own whose residuals its joint takes.
    beyond: Vec<Vec<usize>>,
    /// Per model's joint: its body, and those of its mimic joints.
    bodies: Vec<Vec<usize>>,
    /// Per body: its joint.
    joint: Vec<usize>,
    /// Per body: its joint carries a contact of its own part.
    touching: Vec<bool>,
}

impl Relations {
    fn new(model: &Model, layout: &Layout, residual: Residual, sets: &[ContactSet]) -> Self {
        let bodies = model.bodies().len();
        let part_count = layout.parts.len();
        let all = |keep: &dyn Fn(usize) -> bool| -> Vec<usize> {
            (1..bodies).filter(|&b| keep(b)).collect()
        };
        let movers: Vec<Vec<usize>> = (0..part_count)
            .map(|part| {
                let root = layout.pieces[layout.parts[part].root_piece].body;
                all(&|b| layout.joint_part[b] != part && model.supports(b, root))
            })
            .collect();
        let accelerating = (0..part_count).map(|part| {
            let (own, source) = (&layout.parts[part].joints, &layout.source_path);
            let influential = own.iter().chain(&movers[part]).chain(source);
            let mut joints: Vec<usize> = influential.map(|&b| model.bodies()[b].joint).collect();
            joints.sort_unstable();
            joints.dedup();
            joints
        });
        let own_sensors = |b: usize| -> Vec<usize> {
            let carries = |s: &usize| layout.sensors[*s].carriers.contains(&b);
            (0..layout.sensors.len()).filter(carries).collect()
        };
        let sensors: Vec<Vec<usize>> = (0..bodies).map(own_sensors).collect();
        let beyond = |b: usize| -> Vec<usize> {
            if residual == Residual::Stays {
                return Vec::new();
            }
            let takes = |part: &usize| {
                let chain = |s: &usize| layout.sensors[*s].before.checked_sub(1);
                std::iter::successors(part.checked_sub(1), chain).any(|s| sensors[b].contains(&s))
            };
            (1..part_count).filter(takes).collect()
        };
        let same_part = |b: usize, k: usize| layout.joint_part[b] == layout.joint_part[k];
        let touches = |b: usize| {
            let mut contacts = sets.iter().flat_map(|set| &set.contacts);
            contacts.any(|contact| contact.path.contains(&b))
        };
        Self {
            accelerating: accelerating.collect(),
            joint: model.bodies().iter().map(|body| body.joint).collect(),
            touching: (0..bodies).map(touches).collect(),
            carried: (0..bodies)
                .map(|b| all(&|k| same_part(b, k) && model.supports(b, k)))
                .collect(),
            carrying: (0..bodies)
                .map(|b| all(&|k| k != b && model.supports(k, b)))
                .collect(),
            beyond: (0..bodies).map(beyond).collect(),
            bodies: (0..model.joint_count())
                .map(|joint| all(&|b| model.bodies()[b].joint == joint))
                .collect(),
            movers,
            sensors,
        }
    }
}

/// Responses of one torque to every input.
#[derive(Debug, Clone)]
struct Response {
    /// Per sensor: to its reading, about the root's origin.
    sensors: Vec<Motion>,
    /// To an acceleration of the whole robot.
    uniform: Force,
    /// Per model's joint: to its acceleration.
    joints: Vec<f64>,
    /// Per part: to an error of the model's masses.
    masses: Vec<f64>,
}

impl Response {
    fn clear(&mut self) {
        self.sensors.fill(Motion::zero());
        self.uniform = Force::zero();
        self.joints.fill(0.0);
        self.masses.fill(0.0);
    }
}

impl Sigma {
    pub(crate) fn new(
        model: &Model,
        layout: &Layout,
        p: &WholeBodyParameters,
        sets: &[ContactSet],
    ) -> Self {
        let (joints, bodies) = (model.joint_count(), model.bodies().len());
        let (sensors, parts) = (layout.sensors.len(), layout.parts.len());
        let mut ddq = vec![0.0; joints];
        for (&joint, sigma) in layout.joints.iter().zip(&p.sigma_ddq) {
            ddq[joint] = sigma * sigma;
        }
        let [accelerometer, angular_acceleration, lasting_accelerometer] = match &p.source {
            MotionSource::Imu(imu) => [
                imu.sigma_accelerometer.powi(2),
                imu.sigma_angular_acceleration.powi(2),
                imu.lasting_accelerometer.powi(2),
            ],
            MotionSource::Fixed { .. } => [0.0; 3],
        };
        let of_sensor = |s: &crate::layout::Sensor| {
            let s = &p.ft_sensors[s.input];
            [s.sigma_force.powi(2), s.sigma_torque.powi(2)]
        };
        Self {
            sensor: layout.sensors.iter().map(of_sensor).collect(),
            lasting: (layout.sensors.iter())
                .map(|s| p.ft_sensors[s.input].lasting)
                .collect(),
            accelerometer,
            lasting_accelerometer,
            angular_acceleration,
            model: p.sigma_model.powi(2),
            ddq,
            relations: Relations::new(model, layout, p.residual, sets),
            lever: vec![Force::zero(); bodies],
            coupling: vec![0.0; bodies * bodies],
            effect: vec![Force::zero(); joints],
            origin: vec![Vector3::zeros(); parts],
            response: Response {
                sensors: vec![Motion::zero(); sensors],
                uniform: Force::zero(),
                joints: vec![0.0; joints],
                masses: vec![0.0; parts],
            },
            covariance: vec![[[0.0; 6]; 6]; parts],
            variance: vec![0.0; joints],
            lasting_variance: vec![0.0; joints],
        }
    }

    /// Levers, couplings and origins of this pose, on which all else depends.
    pub(crate) fn prepare(&mut self, model: &Model, layout: &Layout, m: &Mechanics) {
        for (g, origin) in self.origin.iter_mut().enumerate() {
            *origin = m.origin(model, layout, g);
        }
        for b in 1..m.axis.len() {
            // Nothing of the part lies beyond a joint that a sensor cuts.
            self.lever[b] = match layout.cut_at_joint[b] {
                None => m.composite[b].mul_motion(m.axis[b]),
                Some(_) => Force::zero(),
            };
            let lever = self.lever[b];
            for &k in self.relations.carrying[b].iter().chain(&[b]) {
                self.coupling[k * m.axis.len() + b] = m.axis[k].dot(lever);
            }
        }
    }

    /// Covariances of the net wrenches of these parts; after `prepare`.
    pub(crate) fn net_wrenches(
        &mut self,
        layout: &Layout,
        m: &Mechanics,
        parts: impl Fn(usize) -> bool,
    ) {
        for (g, part) in layout.parts.iter().enumerate().filter(|(g, _)| parts(*g)) {
            let origin = self.origin[g];
            let whole = m.composite[part.root_piece];
            let mut sum = Covariance::default();
            for &(s, _) in &part.boundary {
                let p = m.sensor_frame[s].translation - origin;
                let [force, torque] = self.sensor[s];
                sum.add_force(force, &p);
                sum.add_torque(torque);
            }
            let centre = whole.center() - origin;
            sum.add_force(self.accelerometer * whole.mass.powi(2), &centre);
            if self.angular_acceleration > 0.0 {
                let source = source_origin(layout, m);
                for axis in 0..3 {
                    let turn = unit_rotation(axis, &source);
                    let f = about(whole.mul_motion(turn), &origin);
                    sum.add(self.angular_acceleration, &f);
                }
            }
            sum.add(self.model, &about(m.inertial[part.root_piece], &origin));
            self.add_joints(layout, m, g, &mut sum);
            self.covariance[g] = sum.whole();
        }
    }

    /// Share of the joints' accelerations in the covariance of a part's net wrench.
    fn add_joints(&mut self, layout: &Layout, m: &Mechanics, g: usize, sum: &mut Covariance) {
        let part = &layout.parts[g];
        let (origin, whole) = (self.origin[g], m.composite[part.root_piece]);
        let joint = &self.relations.joint;
        for &j in &self.relations.accelerating[g] {
            self.effect[j] = Force::zero();
        }
        for &b in &part.joints {
            self.effect[joint[b]] += self.lever[b];
        }
        for &b in &self.relations.movers[g] {
            self.effect[joint[b]] += whole.mul_motion(m.axis[b]);
        }
        for &b in &layout.source_path {
            self.effect[joint[b]] -= whole.mul_motion(m.axis[b]);
        }
        for &j in &self.relations.accelerating[g] {
            sum.add(self.ddq[j], &about(self.effect[j], &origin));
        }
    }

    /// Variances of the joint torques, by the shares of the hypotheses; after `prepare`.
    pub(crate) fn torques(&mut self, layout: &Layout, m: &Mechanics, hypotheses: Hypotheses<'_>) {
        let source = source_origin(layout, m);
        for joint in 0..self.variance.len() {
            self.response.clear();
            for i in 0..self.relations.bodies[joint].len() {
                let b = self.relations.bodies[joint][i];
                self.carried_by(b, layout, m);
                self.through_net_wrenches(b, layout, m, hypotheses);
            }
            let response = &mut self.response;
            for &k in &layout.source_path {
                response.joints[self.relations.joint[k]] -= m.axis[k].dot(response.uniform);
            }
            self.variance[joint] = self.squares(m, &source);
            self.lasting_variance[joint] = self.lasting_squares(m);
        }
    }

    /// Adds the responses of `S_j (f_j - r_j)`.
    fn carried_by(&mut self, b: usize, layout: &Layout, m: &Mechanics) {
        let (relations, response) = (&self.relations, &mut self.response);
        let joint = &relations.joint;
        let axis = m.axis[b];
        for &s in &relations.sensors[b] {
            response.sensors[s] -= axis;
        }
        if layout.cut_at_joint[b].is_some() {
            return;
        }
        response.uniform += self.lever[b];
        response.masses[layout.joint_part[b]] += axis.dot(m.inertial[b]);
        let bodies = m.axis.len();
        for &k in &relations.carried[b] {
            response.joints[joint[k]] += self.coupling[b * bodies + k];
        }
        for &k in &relations.carrying[b] {
            response.joints[joint[k]] += self.coupling[k * bodies + b];
        }
    }

    /// Adds the responses of `sum_g z_g b_g`.
    fn through_net_wrenches(
        &mut self,
        b: usize,
        layout: &Layout,
        m: &Mechanics,
        hypotheses: Hypotheses<'_>,
    ) {
        let (relations, response) = (&self.relations, &mut self.response);
        let joint = &relations.joint;
        let own = layout.joint_part[b];
        for &g in std::iter::once(&own).chain(&relations.beyond[b]) {
            let part = &layout.parts[g];
            let origin = self.origin[g];
            let z = match g == own {
                true if !relations.touching[b] => None,
                true => hypotheses.contacts_response(g, b, m.axis[b], &origin),
                false => hypotheses.residual_response(g, m.axis[b], &origin),
            };
            let Some(z) = z else { continue };
            // Back about the root's origin, like all other vectors.
            let z = Motion::new(z.linear + origin.cross(&z.angular), z.angular);
            let whole = m.composite[part.root_piece].mul_motion(z);
            response.uniform += whole;
            response.masses[g] += z.dot(m.inertial[part.root_piece]);
            for &k in &part.joints {
                response.joints[joint[k]] += z.dot(self.lever[k]);
            }
            for &k in &relations.movers[g] {
                response.joints[joint[k]] += m.axis[k].dot(whole);
            }
            for &(s, sign) in &part.boundary {
                // A reading acts on the part before its sensor, and enters `b` with a minus.
                response.sensors[s] -= z * sign;
            }
        }
    }

    /// Variance of an output by what lasts of the errors of F/T sensors and accelerometer. The share of what a sensor
    /// bears is independent between sensors and axes: nobody knows the signs of its gains and cross-talk.
    fn lasting_squares(&self, m: &Mechanics) -> f64 {
        let sensors = (self.response.sensors.iter()).zip(m.sensor_frame.iter().zip(&m.reading));
        let sensor =
            |((motion, (frame, reading)), errors): ((&Motion, (&Se3, &Force)), &LastingErrors)| {
                let p = &frame.translation;
                let linear = motion.linear + motion.angular.cross(p);
                let torque = reading.angular - p.cross(&reading.linear);
                let share = errors.share.powi(2);
                let force = errors.force.powi(2) + share * reading.linear.norm_squared();
                let torque = errors.torque.powi(2) + share * torque.norm_squared();
                force * linear.norm_squared() + torque * motion.angular.norm_squared()
            };
        let by_sensors: f64 = sensors.zip(&self.lasting).map(sensor).sum();
        let whole = self.response.uniform.linear.norm_squared();
        by_sensors + self.lasting_accelerometer * whole
    }

    /// Variance of an output from its responses.
    fn squares(&self, m: &Mechanics, source: &Vector3<f64>) -> f64 {
        let r = &self.response;
        let mut variance = 0.0;
        for ((motion, frame), [force, torque]) in
            r.sensors.iter().zip(&m.sensor_frame).zip(&self.sensor)
        {
            let linear = motion.linear + motion.angular.cross(&frame.translation);
            variance += force * linear.norm_squared() + torque * motion.angular.norm_squared();
        }
        let turn = r.uniform.angular - source.cross(&r.uniform.linear);
        variance += self.accelerometer * r.uniform.linear.norm_squared()
            + self.angular_acceleration * turn.norm_squared();
        // Four sums side by side: one would wait for itself.
        let ((xs, x_rest), (ddqs, ddq_rest)) =
            (r.joints.as_chunks::<4>(), self.ddq.as_chunks::<4>());
        let mut sums = [0.0; 4];
        for (x, ddq) in xs.iter().zip(ddqs) {
            for k in 0..4 {
                sums[k] += ddq[k] * x[k] * x[k];
            }
        }
        for (x, ddq) in x_rest.iter().zip(ddq_rest) {
            variance += ddq * x * x;
        }
        variance += sums.iter().sum::<f64>();
        variance + self.model * r.masses.iter().map(|x| x * x).sum::<f64>()
    }
}

/// Origin of the IMU or of the stand's link.
fn source_origin(layout: &Layout, m: &Mechanics) -> Vector3<f64> {
    m.in_root[layout.source_body].act_point(layout.source_placement.translation)
}

/// Unit angular acceleration about an axis through a point, as a motion of the root's frame.
fn unit_rotation(axis: usize, point: &Vector3<f64>) -> Motion {
    let mut turn = Vector3::zeros();
    turn[axis] = 1.0;
    Motion::new(point.cross(&turn), turn)
}
