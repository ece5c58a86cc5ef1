//! Forces from outside: the floor under the soles' corners, a harness, pushes.
//!
//! Each is a spring-damper `-K x - C v` whose velocity is that at the end of the step: the part due
//! to the step's acceleration is left to the articulated-body method as an implicit part.

use crate::articulated::Dynamics;
use crate::parameters::{GroundParameters, HarnessParameters, PushParameters};
use crate::spatial::{split, stack, symmetric, wrench_of};
use crate::tree::Frame;
use nalgebra::{Matrix3, Matrix6, Rotation3, Vector3, Vector6};

/// A corner of a sole.
#[derive(Debug, Clone)]
pub struct Corner {
    body: usize,
    local: Vector3<f64>,
    /// Anchor of the friction, while the corner touches: x, y, m.
    anchor: Option<[f64; 2]>,
    /// Force on the corner in the current step without acceleration, and the implicit part.
    predicted: Vector3<f64>,
    implicit: Vector3<f64>,
    position: Vector3<f64>,
    /// The force that acted over the last step, in the world, N.
    force: Vector3<f64>,
}

impl Corner {
    /// A corner at `local` in a frame.
    #[must_use]
    pub fn new(frame: &Frame, local: &[f64; 3]) -> Self {
        Self {
            body: frame.body,
            local: frame.rotation * Vector3::from(*local) + frame.offset,
            anchor: None,
            predicted: Vector3::zeros(),
            implicit: Vector3::zeros(),
            position: Vector3::zeros(),
            force: Vector3::zeros(),
        }
    }

    /// Position in the world, from the last `kinematics`.
    #[must_use]
    pub fn place(&self, dynamics: &Dynamics) -> Vector3<f64> {
        dynamics.point(self.body, &self.local).0
    }

    /// The force that acted over the last step, as a wrench about the world's origin.
    #[must_use]
    pub fn wrench(&self) -> Vector6<f64> {
        wrench_of(&self.position, &self.force)
    }

    /// Clears the anchor of the friction.
    pub fn release(&mut self) {
        self.anchor = None;
    }

    /// Adds this step's force to the dynamics.
    pub fn prepare(&mut self, ground: &GroundParameters, dynamics: &mut Dynamics, dt: f64) {
        let (position, velocity) = dynamics.point(self.body, &self.local);
        self.position = position;
        self.predicted = Vector3::zeros();
        self.implicit = Vector3::zeros();
        let depth = ground.height - position.z;
        let normal_gain = ground.damping + dt * ground.stiffness;
        let normal = ground.stiffness * depth - normal_gain * velocity.z;
        if depth <= 0.0 || normal <= 0.0 {
            self.anchor = None;
            return;
        }
        self.predicted.z = normal;
        self.implicit.z = normal_gain;
        let anchor = self.anchor.get_or_insert([position.x, position.y]);
        let k = ground.tangential_stiffness;
        let gain = ground.tangential_damping + dt * k;
        let fx = -k * (position.x - anchor[0]) - gain * velocity.x;
        let fy = -k * (position.y - anchor[1]) - gain * velocity.y;
        let (sticking, limit) = (fx.hypot(fy), ground.friction * normal);
        if sticking <= limit {
            self.predicted.x = fx;
            self.predicted.y = fy;
            self.implicit.x = gain;
            self.implicit.y = gain;
        } else {
            // The corner slides: the anchor follows so that its spring alone carries the friction.
            self.predicted.x = fx * limit / sticking;
            self.predicted.y = fy * limit / sticking;
            anchor[0] = position.x + self.predicted.x / k;
            anchor[1] = position.y + self.predicted.y / k;
        }
        push_implicitly(
            dynamics,
            self.body,
            &position,
            &self.predicted,
            &Matrix3::from_diagonal(&(dt * self.implicit)),
        );
    }

    /// Records the force that follows from the solved accelerations.
    pub fn commit(&mut self, dynamics: &mut Dynamics, dt: f64) {
        let a = dynamics.acceleration(self.body);
        let (alpha, linear) = split(&a);
        let point = linear + alpha.cross(&self.position);
        self.force = self.predicted - dt * self.implicit.component_mul(&point);
        dynamics.note_external(self.body, &wrench_of(&self.position, &self.force));
    }
}

/// A force `force - matrix a` at a point of a body.
fn push_implicitly(
    dynamics: &mut Dynamics,
    body: usize,
    position: &Vector3<f64>,
    force: &Vector3<f64>,
    matrix: &Matrix3<f64>,
) {
    dynamics.push(body, &wrench_of(position, force));
    dynamics.resist(body, &at_origin(position, matrix));
}

/// A point's resistance seen from the world's origin: `J^T matrix J`, `J = [-[p]x, 1]`.
fn at_origin(position: &Vector3<f64>, matrix: &Matrix3<f64>) -> Matrix6<f64> {
    let p = position.cross_matrix();
    let coupling = p * matrix;
    symmetric(&(-coupling * p), &coupling, matrix)
}

/// A stand or harness between a frame and the world.
#[derive(Debug, Clone)]
pub struct Harness {
    parameters: HarnessParameters,
    frame: Frame,
    anchor: Vector3<f64>,
    orientation: Matrix3<f64>,
    position: Vector3<f64>,
    predicted: Vector6<f64>,
    implicit: [f64; 2],
    wrench: Vector6<f64>,
}

impl Harness {
    /// A harness on a frame, slack where the frame is now.
    #[must_use]
    pub fn new(parameters: &HarnessParameters, frame: &Frame, dynamics: &Dynamics) -> Self {
        let (orientation, anchor) = dynamics.placement(frame);
        Self {
            parameters: parameters.clone(),
            frame: frame.clone(),
            anchor,
            orientation,
            position: anchor,
            predicted: Vector6::zeros(),
            implicit: [0.0; 2],
            wrench: Vector6::zeros(),
        }
    }

    /// The wrench of the last step about the world's origin, `[torque; force]`.
    #[must_use]
    pub fn wrench(&self) -> Vector6<f64> {
        self.wrench
    }

    /// It holds nothing any more.
    pub fn release(&mut self) {
        (self.parameters.slack, self.parameters.angular_slack) = (f64::INFINITY, f64::INFINITY);
    }

    /// Adds this step's wrench to the dynamics.
    pub fn prepare(&mut self, dynamics: &mut Dynamics, dt: f64) {
        let p = &self.parameters;
        let (rotation, position) = dynamics.placement(&self.frame);
        let (_, velocity) = dynamics.point(self.frame.body, &self.frame.offset);
        let omega = dynamics.angular_velocity(self.frame.body);
        let turned = Rotation3::from_matrix_unchecked(rotation * self.orientation.transpose());
        let (force, gain) = spring(
            &(position - self.anchor),
            &velocity,
            [p.stiffness, p.damping, p.slack],
            dt,
        );
        let (torque, angular_gain) = spring(
            &turned.scaled_axis(),
            &omega,
            [p.angular_stiffness, p.angular_damping, p.angular_slack],
            dt,
        );
        self.position = position;
        self.predicted = stack(torque, force);
        self.implicit = [angular_gain, gain];
        let matrix = Matrix3::from_diagonal_element(dt * gain);
        push_implicitly(dynamics, self.frame.body, &position, &force, &matrix);
        dynamics.push(self.frame.body, &stack(torque, Vector3::zeros()));
        let angular = symmetric(
            &Matrix3::from_diagonal_element(dt * angular_gain),
            &Matrix3::zeros(),
            &Matrix3::zeros(),
        );
        dynamics.resist(self.frame.body, &angular);
    }

    /// Records the wrench that follows from the solved accelerations.
    pub fn commit(&mut self, dynamics: &mut Dynamics, dt: f64) {
        let (alpha, linear) = split(&dynamics.acceleration(self.frame.body));
        let point = linear + alpha.cross(&self.position);
        let change = stack(self.implicit[0] * alpha, self.implicit[1] * point);
        let (torque, force) = split(&(self.predicted - dt * change));
        self.wrench = stack(torque + self.position.cross(&force), force);
        dynamics.note_external(self.frame.body, &self.wrench);
    }
}

/// Force of a spring-damper with slack, and its slope in the velocity at the step's end.
fn spring(
    displacement: &Vector3<f64>,
    velocity: &Vector3<f64>,
    [stiffness, damping, slack]: [f64; 3],
    dt: f64,
) -> (Vector3<f64>, f64) {
    let length = displacement.norm();
    if length < slack {
        return (Vector3::zeros(), 0.0);
    }
    let taut = if length > 0.0 {
        1.0 - slack / length
    } else {
        1.0
    };
    let gain = damping + dt * stiffness;
    (-stiffness * taut * displacement - gain * velocity, gain)
}

/// A push on a frame.
#[derive(Debug, Clone)]
pub struct Push {
    frame: Frame,
    parameters: PushParameters,
    wrench: Vector6<f64>,
}

impl Push {
    /// A push on a frame.
    #[must_use]
    pub fn new(parameters: &PushParameters, frame: &Frame) -> Self {
        Self {
            frame: frame.clone(),
            parameters: parameters.clone(),
            wrench: Vector6::zeros(),
        }
    }

    /// The wrench of the last step about the world's origin, `[torque; force]`.
    #[must_use]
    pub fn wrench(&self) -> Vector6<f64> {
        self.wrench
    }

    /// Adds the wrench at `time` to the dynamics.
    pub fn prepare(&mut self, dynamics: &mut Dynamics, time: f64) {
        let p = &self.parameters;
        let phase = (time - p.start) / p.duration;
        let scale = if (0.0..1.0).contains(&phase) {
            (std::f64::consts::PI * phase).sin()
        } else {
            0.0
        };
        let (_, position) = dynamics.placement(&self.frame);
        let force = scale * Vector3::from(p.force);
        self.wrench =
            wrench_of(&position, &force) + stack(scale * Vector3::from(p.torque), Vector3::zeros());
        dynamics.push(self.frame.body, &self.wrench);
    }

    /// Records the wrench.
    pub fn commit(&self, dynamics: &mut Dynamics) {
        dynamics.note_external(self.frame.body, &self.wrench);
    }
}
