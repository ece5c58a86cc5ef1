//! Standard deviations of contact wrenches, torques and residuals, from those of the sensors.
//!
//! Every output is linear in F/T signals, accelerometer, angular and joint accelerations. With `b`
//! a part's net wrench, `S_j` a joint's axis, `y_j` the response of its torque to `b` by the contacts
//! it carries ([`Solution::share`]), and `C_j`, `C` the inertias that the joint carries in its part
//! and of the whole part: `d tau_j = S_j db_j - y_j db`, and an acceleration `m` of the whole robot
//! makes `db_j = C_j m`, `db = C m`. Parts beyond a sensor cancel: the sensor measures their wrench.
//! Noise of angles, velocities and gyroscope is left out: it enters by products with rates. Mimic
//! joints count as if they moved by themselves.

use crate::contacts::ContactSet;
use crate::layout::Layout;
use crate::least_squares::Six;
use crate::mechanics::Mechanics;
use crate::parameters::{MotionSource, WholeBodyParameters};
use crate::solution::{Solution, about};
use dynamics::{Force, Inertia, Model, Motion, Se3};
use nalgebra::{Matrix3, Vector3};

/// Variances and the memory to compute them.
#[derive(Debug, Clone)]
pub(crate) struct Sigma {
    /// Per sensor: of force and torque.
    sensor: Vec<[f64; 2]>,
    accelerometer: f64,
    angular_acceleration: f64,
    model: f64,
    /// Per model's joint.
    ddq: Vec<f64>,
    /// Per part: joints of other parts whose acceleration moves all of it against the source's
    /// link, with the sign.
    outside: Vec<Vec<(usize, f64)>>,
    /// Per body: its relation to the other joints of its part.
    inside: Vec<Inside>,
    /// Per body: `C_j S_j`, for the joint's own part.
    lever: Vec<Force>,
    /// Per part: covariance of `b` about the part's origin.
    pub(crate) covariance: Vec<[Six; 6]>,
    /// Per model's joint.
    pub(crate) variance: Vec<f64>,
}

impl Sigma {
    pub(crate) fn new(model: &Model, layout: &Layout, p: &WholeBodyParameters) -> Self {
        let mut ddq = vec![0.0; model.joint_count()];
        for (&joint, sigma) in layout.joints.iter().zip(&p.sigma_ddq) {
            ddq[joint] = sigma * sigma;
        }
        let (accelerometer, angular_acceleration) = match &p.source {
            MotionSource::Imu(imu) => (
                imu.sigma_accelerometer.powi(2),
                imu.sigma_angular_acceleration.powi(2),
            ),
            MotionSource::Fixed { .. } => (0.0, 0.0),
        };
        let bodies = model.bodies().len();
        let outside = (0..layout.parts.len()).map(|part| {
            let root = layout.pieces[layout.parts[part].root_piece].body;
            let others = (1..bodies).filter(|&b| layout.joint_part[b] != part);
            let factor = |b: usize| {
                let one = |yes: bool| if yes { 1.0 } else { 0.0 };
                one(model.supports(b, root)) - one(layout.moves_source[b])
            };
            let moving = others.map(|b| (b, factor(b)));
            moving.filter(|(_, f)| *f != 0.0).collect()
        });
        let inside = (0..bodies).map(|j| {
            let own = |k: &usize| *k > 0 && layout.joint_part[*k] == layout.joint_part[j];
            let apart = |k: &usize| !model.supports(j, *k) && !model.supports(*k, j);
            let carried = (j..bodies).filter(own).filter(|&k| model.supports(j, k));
            let carrying = (1..j).filter(own).filter(|&k| model.supports(k, j));
            let apart: Vec<usize> = (1..bodies).filter(own).filter(apart).collect();
            Inside {
                carried: carried.collect(),
                carrying: carrying.collect(),
                source: (apart.iter().copied())
                    .filter(|&k| layout.moves_source[k])
                    .collect(),
                apart,
            }
        });
        Self {
            sensor: layout
                .sensors
                .iter()
                .map(|s| {
                    let s = &p.ft_sensors[s.input];
                    [s.sigma_force.powi(2), s.sigma_torque.powi(2)]
                })
                .collect(),
            accelerometer,
            angular_acceleration,
            model: p.sigma_model.powi(2),
            ddq,
            outside: outside.collect(),
            inside: inside.collect(),
            lever: vec![Force::zero(); bodies],
            covariance: vec![[[0.0; 6]; 6]; layout.parts.len()],
            variance: vec![0.0; model.joint_count()],
        }
    }

    /// Covariances of every part's net wrench.
    pub(crate) fn prepare(&mut self, model: &Model, layout: &Layout, m: &Mechanics) {
        for b in 1..m.axis.len() {
            // Nothing of the part lies beyond a joint that a sensor cuts.
            self.lever[b] = match layout.cut_at_joint[b] {
                None => m.composite[b].mul_motion(m.axis[b]),
                Some(_) => Force::zero(),
            };
        }
        for (g, part) in layout.parts.iter().enumerate() {
            let origin = m.origin(model, layout, g);
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
                let source = self.source_origin(layout, m);
                for axis in 0..3 {
                    let turn = unit_rotation(axis, &source);
                    let f = about(whole.mul_motion(turn), &origin);
                    sum.add(self.angular_acceleration, &f);
                }
            }
            sum.add(self.model, &about(m.inertial[part.root_piece], &origin));
            for &b in &part.joints {
                let mut f = self.lever[b];
                if layout.moves_source[b] {
                    f -= whole.mul_motion(m.axis[b]);
                }
                sum.add(self.ddq[model.bodies()[b].joint], &about(f, &origin));
            }
            for &(b, factor) in &self.outside[g] {
                let f = whole.mul_motion(m.axis[b]) * factor;
                sum.add(self.ddq[model.bodies()[b].joint], &about(f, &origin));
            }
            self.covariance[g] = sum.whole();
        }
    }

    fn source_origin(&self, layout: &Layout, m: &Mechanics) -> Vector3<f64> {
        m.in_root[layout.source_body].act_point(layout.source_placement.translation)
    }

    /// Variances of the joint torques under one hypothesis; after `prepare`.
    pub(crate) fn torques(
        &mut self,
        model: &Model,
        layout: &Layout,
        m: &Mechanics,
        set: &ContactSet,
        solution: &Solution,
    ) {
        self.variance.fill(0.0);
        let source = self.source_origin(layout, m);
        for (g, part) in layout.parts.iter().enumerate() {
            let origin = m.origin(model, layout, g);
            let whole = m.composite[part.root_piece];
            for &j in &part.joints {
                let y = solution.share(m, set, g, j, &origin);
                // Back about the root's origin, like all other vectors.
                let y = y.map(|y| Motion::new(y.linear + origin.cross(&y.angular), y.angular));
                let joint = Joint { j, y, whole, m };
                let variance = self.sensors(layout, part, &joint)
                    + self.motions(model, layout, g, &joint, &source);
                self.variance[model.bodies()[j].joint] += variance;
            }
        }
    }

    fn sensors(&self, layout: &Layout, part: &crate::layout::Part, joint: &Joint<'_>) -> f64 {
        let mut variance = 0.0;
        for &(s, sign) in &part.boundary {
            let beyond = sign > 0.0 && layout.sensors[s].carriers.contains(&joint.j);
            let mut motion = match beyond {
                true => joint.m.axis[joint.j],
                false => Motion::zero(),
            };
            match joint.y {
                Some(y) => motion -= y,
                None if !beyond => continue,
                None => {}
            }
            let p = joint.m.sensor_frame[s].translation;
            let [force, torque] = self.sensor[s];
            variance += force * (motion.linear + motion.angular.cross(&p)).norm_squared()
                + torque * motion.angular.norm_squared();
        }
        variance
    }

    fn motions(
        &self,
        model: &Model,
        layout: &Layout,
        part: usize,
        joint: &Joint<'_>,
        source: &Vector3<f64>,
    ) -> f64 {
        let &Joint { j, y, whole, m } = joint;
        let (axis, cut) = (m.axis[j], layout.cut_at_joint[j].is_some());
        // Response to an acceleration of the whole robot.
        let mut all = self.lever[j];
        let mut weight = if cut { 0.0 } else { axis.dot(m.inertial[j]) };
        if let Some(y) = y {
            all -= whole.mul_motion(y);
            weight -= y.dot(m.inertial[layout.parts[part].root_piece]);
        }
        let turn = all.angular - source.cross(&all.linear);
        let mut variance = self.accelerometer * all.linear.norm_squared()
            + self.angular_acceleration * turn.norm_squared()
            + self.model * weight * weight;
        let mut add = |k: usize, response: f64| {
            variance += self.ddq[model.bodies()[k].joint] * response * response;
        };
        let backwards = |k: usize| match layout.moves_source[k] {
            true => m.axis[k].dot(all),
            false => 0.0,
        };
        let inside = &self.inside[j];
        let through = |k: usize| y.map_or(0.0, |y| y.dot(self.lever[k]));
        for &k in &inside.carried {
            let own = if cut { 0.0 } else { axis.dot(self.lever[k]) };
            add(k, own - through(k) - backwards(k));
        }
        for &k in &inside.carrying {
            add(k, m.axis[k].dot(self.lever[j]) - through(k) - backwards(k));
        }
        // Joints apart matter by contacts or by the source's link only.
        let apart = match y {
            Some(_) => &inside.apart,
            None => &inside.source,
        };
        for &k in apart {
            add(k, -through(k) - backwards(k));
        }
        for &(k, factor) in &self.outside[part] {
            add(k, factor * m.axis[k].dot(all));
        }
        variance
    }
}

/// Relation of a joint to the other joints of its part.
#[derive(Debug, Clone)]
struct Inside {
    /// Those it carries, itself too.
    carried: Vec<usize>,
    /// Those that carry it.
    carrying: Vec<usize>,
    /// All others, and those of them that move the source's link.
    apart: Vec<usize>,
    source: Vec<usize>,
}

/// A joint of a part.
struct Joint<'a> {
    j: usize,
    /// About the root's origin.
    y: Option<Motion>,
    whole: Inertia,
    m: &'a Mechanics,
}

/// Unit angular acceleration about an axis through a point, as a motion of the root's frame.
fn unit_rotation(axis: usize, point: &Vector3<f64>) -> Motion {
    let mut turn = Vector3::zeros();
    turn[axis] = 1.0;
    Motion::new(point.cross(&turn), turn)
}

/// Sum of covariances of a wrench.
#[derive(Default)]
struct Covariance {
    force: Matrix3<f64>,
    /// Torque by force.
    mixed: Matrix3<f64>,
    torque: Matrix3<f64>,
}

impl Covariance {
    /// Of `variance` along a wrench.
    fn add(&mut self, variance: f64, f: &Force) {
        if variance > 0.0 {
            let (linear, angular) = (f.linear * variance, f.angular * variance);
            self.force += linear * f.linear.transpose();
            self.mixed += angular * f.linear.transpose();
            self.torque += angular * f.angular.transpose();
        }
    }
    /// Of a force at `p`, of equal variance in all directions.
    fn add_force(&mut self, variance: f64, p: &Vector3<f64>) {
        let arm = p.cross_matrix();
        self.force += Matrix3::from_diagonal_element(variance);
        self.mixed += arm * variance;
        // [p][p]^T = (p·p) 1 - p p^T
        self.torque += (Matrix3::from_diagonal_element(p.dot(p)) - p * p.transpose()) * variance;
    }
    /// Of a torque, of equal variance in all directions.
    fn add_torque(&mut self, variance: f64) {
        self.torque += Matrix3::from_diagonal_element(variance);
    }
    fn whole(&self) -> [Six; 6] {
        std::array::from_fn(|i| {
            std::array::from_fn(|j| match (i < 3, j < 3) {
                (true, true) => self.force[(i, j)],
                (true, false) => self.mixed[(j - 3, i)],
                (false, true) => self.mixed[(i - 3, j)],
                (false, false) => self.torque[(i - 3, j - 3)],
            })
        })
    }
}

/// Rows that take a part's `b` (about its origin, root's axes) to a contact's wrench at its frame.
pub(crate) fn contact_rows(
    frame: &Se3,
    origin: &Vector3<f64>,
    residual_free: bool,
    rows: &[Six],
) -> [Six; 6] {
    let mut out = [[0.0; 6]; 6];
    if !residual_free {
        for (out, row) in out.iter_mut().zip(rows) {
            *out = *row;
        }
        return out;
    }
    // b about the contact's point, in the contact's axes.
    let p = frame.translation - origin;
    for k in 0..3 {
        let e = frame.rotation.column(k).into_owned();
        out[k] = Force::new(e, Vector3::zeros()).to_array();
        // e · (n - p × f) = n · e - f · (e × p)
        out[3 + k] = Force::new(-e.cross(&p), e).to_array();
    }
    out
}
