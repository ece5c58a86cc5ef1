//! Every joint's torque from F/T sensors, IMU and joint motion (D 2): no motor is asked.
//!
//! The F/T sensors cut the kinematic tree. A forward pass moves what the IMU measured to the root
//! and from there to every body; what lies beyond a sensor then yields the wrench that the
//! environment applies to it; a backward pass over the whole tree yields every joint's torque
//! and, at the root, the wrench that no sensor explains. If that wrench acts on another link
//! than the root, the joints between the two carry it.
//!
//! Signals that enter together must be late by the same time.

mod error;
mod layout;
mod sigma;

pub use error::WholeBodyError;

use dynamics::{
    Base, BaseMotion, Data, Force, ImuMotion, Model, Motion, Se3, base_motion_from_imu, propagate,
};
use layout::Layout;
use nalgebra::Vector3;
use robot_state::Wrench;
use sigma::Sigma;

/// A force/torque sensor that cuts the tree just before a link.
#[derive(Debug, Clone, PartialEq)]
pub struct FtSensorParameters {
    /// The sensor's name, for messages.
    pub name: String,
    /// The link in whose frame it measures; it and all beyond it is the end-effector.
    pub frame: String,
    /// The link beyond the sensor that the environment touches; the sensor's own if none is
    /// named. Only matters where joints lie beyond the sensor.
    pub contact_link: Option<String>,
    /// Standard deviation of each force axis as handed to `update`, N.
    pub sigma_force: f64,
    /// Standard deviation of each torque axis as handed to `update`, N·m.
    pub sigma_torque: f64,
}

/// The inertial measurement unit, on any link.
#[derive(Debug, Clone, PartialEq)]
pub struct ImuParameters {
    /// The link in whose frame it measures.
    pub frame: String,
    /// Standard deviation of each accelerometer axis as handed to `update`, m/s².
    pub sigma_accelerometer: f64,
}

/// What the whole-body estimator is to use.
#[derive(Debug, Clone, PartialEq)]
pub struct WholeBodyParameters {
    /// Names of the joints in the order of every per-joint slice here (config order).
    pub joints: Vec<String>,
    /// Standard deviation of each joint's acceleration as handed to `update`, rad/s², same order.
    pub sigma_ddq: Vec<f64>,
    /// The F/T sensors, in any order.
    pub ft_sensors: Vec<FtSensorParameters>,
    /// The IMU; a fixed base needs none, as gravity is known there.
    pub imu: Option<ImuParameters>,
    /// The link that an unknown wrench may act on (D 2.4); the root if none is named.
    pub unknown_wrench_link: Option<String>,
}

/// One cycle's signals, in the orders of [`WholeBodyParameters`].
#[derive(Debug, Clone, Copy)]
pub struct WholeBodyInput<'a> {
    /// q: joint angles, rad.
    pub q: &'a [f64],
    /// dq: joint velocities, rad/s.
    pub dq: &'a [f64],
    /// ddq: joint accelerations, rad/s².
    pub ddq: &'a [f64],
    /// Wrench that the part beyond each sensor applies to the part before it, in its frame.
    pub ft: &'a [Wrench],
    /// What the IMU measured; ignored with a fixed base.
    pub imu: ImuMotion,
}

/// What follows from one cycle's signals.
#[derive(Debug, Clone, PartialEq)]
pub struct WholeBodyEstimate {
    /// tau: joint torques, N·m, in the order of the parameters' joints.
    pub tau: Vec<f64>,
    /// sigma: their standard deviations, N·m.
    pub sigma: Vec<f64>,
    /// f_hat: wrench that the environment applies to what lies beyond each sensor, in its frame.
    pub contact: Vec<Wrench>,
    /// f_u: wrench that no sensor explains, at the unknown-wrench link's frame; with a fixed
    /// base, what its mounting applies.
    pub unknown_wrench: Wrench,
    /// Standard deviation of `unknown_wrench`, as the sensors' own would explain it.
    pub unknown_wrench_sigma: Wrench,
    /// Whether the last signals were finite; otherwise all of this is from the cycle before.
    pub valid: bool,
}

/// Estimates all joint torques of a robot (D 2, Algorithm 1).
#[derive(Debug, Clone)]
pub struct WholeBody {
    model: Model,
    data: Data,
    layout: Layout,
    sigma: Sigma,
    /// Joint motion in the model's order.
    q: Vec<f64>,
    dq: Vec<f64>,
    ddq: Vec<f64>,
    /// Per body: its inertial and gravity wrench, then less its contact wrenches, then with those of
    /// all bodies it carries; in the body's frame.
    wrench: Vec<Force>,
    /// Joint torques in the model's order.
    tau: Vec<f64>,
    estimate: WholeBodyEstimate,
}

impl WholeBody {
    /// Checks that the torques follow from the sensors, and prepares.
    ///
    /// # Errors
    /// Links or joints that the model lacks, and sensors from which the torques do not follow.
    pub fn new(model: &Model, parameters: &WholeBodyParameters) -> Result<Self, WholeBodyError> {
        let layout = Layout::new(model, parameters)?;
        let joints = model.joint_count();
        Ok(Self {
            data: Data::new(model),
            sigma: Sigma::new(model, parameters, &layout),
            q: vec![0.0; joints],
            dq: vec![0.0; joints],
            ddq: vec![0.0; joints],
            wrench: vec![Force::zero(); model.bodies().len()],
            tau: vec![0.0; joints],
            estimate: WholeBodyEstimate {
                tau: vec![0.0; layout.joints.len()],
                sigma: vec![0.0; layout.joints.len()],
                contact: vec![Wrench::default(); layout.sensors.len()],
                unknown_wrench: Wrench::default(),
                unknown_wrench_sigma: Wrench::default(),
                valid: false,
            },
            layout,
            model: model.clone(),
        })
    }

    /// Takes one cycle's signals. If any is not finite or a slice is too short, the last estimate
    /// stands, marked as not valid.
    pub fn update(&mut self, input: &WholeBodyInput) -> &WholeBodyEstimate {
        self.estimate.valid = self.accept(input);
        if self.estimate.valid {
            self.forward(&input.imu);
            self.contacts(input.ft);
            self.backward();
            self.sigma
                .update(&self.model, &self.data, &self.layout, &mut self.estimate);
        }
        &self.estimate
    }

    /// The last estimate.
    #[must_use]
    pub fn estimate(&self) -> &WholeBodyEstimate {
        &self.estimate
    }

    /// Twist and proper acceleration of the root, in its axes, as of the last valid signals.
    #[must_use]
    pub fn base_motion(&self) -> (Motion, Motion) {
        let first = |motions: &[Motion]| motions.first().copied().unwrap_or(Motion::zero());
        (
            first(self.data.velocities()),
            first(self.data.accelerations()),
        )
    }

    /// Brings the joints into the model's order; false if something is missing or not finite.
    fn accept(&mut self, input: &WholeBodyInput) -> bool {
        let imu = &input.imu;
        let mut finite = self.model.base() == Base::Fixed
            || [
                imu.angular_velocity,
                imu.angular_acceleration,
                imu.proper_acceleration,
            ]
            .iter()
            .all(|x| x.iter().all(|x| x.is_finite()));
        finite &= input.ft.len() >= self.layout.sensors.len()
            && input
                .ft
                .iter()
                .take(self.layout.sensors.len())
                .all(finite_wrench);
        for (i, &joint) in self.layout.joints.iter().enumerate() {
            let (Some(&q), Some(&dq), Some(&ddq)) =
                (input.q.get(i), input.dq.get(i), input.ddq.get(i))
            else {
                return false;
            };
            finite &= q.is_finite() && dq.is_finite() && ddq.is_finite();
            self.q[joint] = q;
            self.dq[joint] = dq;
            self.ddq[joint] = ddq;
        }
        finite
    }

    /// Motion of every body, from the root outwards, with gravity in every acceleration.
    fn forward(&mut self, imu: &ImuMotion) {
        let (q, dq, ddq) = (&self.q, &self.dq, &self.ddq);
        //= D Algorithm 1, lines 4-5: from the IMU to its link and from there to the root
        let base = match self.layout.imu_frame {
            Some(frame) => {
                base_motion_from_imu(&self.model, &mut self.data, frame, imu, q, dq, ddq)
            }
            None => BaseMotion {
                acceleration: Motion::new(-self.model.gravity(), Vector3::zeros()),
                ..BaseMotion::rest()
            },
        };
        // Only relative placements matter, so the root's frame serves as the world.
        let base = BaseMotion {
            placement: Se3::identity(),
            ..base
        };
        propagate(&self.model, &mut self.data, &base, q, dq, ddq);
        for (i, body) in self.model.bodies().iter().enumerate() {
            self.wrench[i] = body
                .inertia
                .wrench(self.data.velocities()[i], self.data.accelerations()[i]);
        }
    }

    /// f_hat of every sensor, and its effect on the body it acts on.
    fn contacts(&mut self, measured: &[Wrench]) {
        // The outermost sensors first: what they explain is not left to those nearer to the root.
        for &s in &self.layout.outermost_first {
            let sensor = &self.layout.sensors[s];
            let in_root = self.data.placements()[sensor.body].compose(&sensor.placement);
            let from_root = in_root.inverse();
            let velocity = sensor
                .placement
                .inverse_act_motion(self.data.velocities()[sensor.body]);
            let acceleration = sensor
                .placement
                .inverse_act_motion(self.data.accelerations()[sensor.body]);
            //= D 2.2: the wrench is estimated by compensating the weight and inertia
            let mut contact = force(&measured[s]) + sensor.beyond.wrench(velocity, acceleration);
            for &body in &sensor.bodies_beyond {
                let to_sensor = from_root.compose(&self.data.placements()[body]);
                contact += to_sensor.act_force(self.wrench[body]);
            }
            for &nested in &sensor.contacts_on_cut_body {
                let other = &self.layout.sensors[nested];
                let to_sensor = sensor.placement.inverse().compose(&other.placement);
                contact -= to_sensor.act_force(force(&self.estimate.contact[nested]));
            }
            self.estimate.contact[s] = wrench(contact);
            let body = sensor.contact_body;
            let to_contact = self.data.placements()[body].inverse().compose(&in_root);
            self.wrench[body] -= to_contact.act_force(contact);
        }
    }

    /// Joint torques and the unexplained wrench, from the leaves to the root (D Algorithm 1, line 8).
    fn backward(&mut self) {
        let bodies = self.model.bodies();
        let tau = &mut self.tau;
        tau.fill(0.0);
        for (i, body) in bodies.iter().enumerate().skip(1).rev() {
            let f = self.wrench[i];
            tau[body.joint] += body.ratio * body.along_axis(f);
            self.wrench[body.parent] += self.data.placements_in_parent()[i].act_force(f);
        }
        //= D 2.4: sum_i f_i + f_u = I dv_l + dI v_l, at the root, which the sums have reached
        let root = self.wrench[0];
        for &i in &self.layout.path {
            // Between root and unknown-wrench link the torque balances the other side of the tree.
            let f = self.data.placements()[i].inverse_act_force(root);
            tau[bodies[i].joint] -= bodies[i].ratio * bodies[i].along_axis(f);
        }
        let (body, placement) = (self.layout.unknown_body, &self.layout.unknown_placement);
        let in_root = self.data.placements()[body].compose(placement);
        self.estimate.unknown_wrench = wrench(in_root.inverse_act_force(root));
        for (out, &joint) in self.estimate.tau.iter_mut().zip(&self.layout.joints) {
            *out = tau[joint];
        }
    }
}

fn finite_wrench(w: &Wrench) -> bool {
    w.force.iter().chain(&w.torque).all(|x| x.is_finite())
}

fn force(w: &Wrench) -> Force {
    Force::new(Vector3::from(w.force), Vector3::from(w.torque))
}

fn wrench(f: Force) -> Wrench {
    Wrench {
        force: f.linear.into(),
        torque: f.angular.into(),
    }
}
