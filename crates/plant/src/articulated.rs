//! Rigid-body forward dynamics by the articulated-body method in world coordinates.
//!
//! Every motion and force is a six-vector about the world's origin in the world's axes, `[angular;
//! linear]`. No quantity changes its frame along the tree: composite inertias, forces and
//! accelerations are plain sums. Base acceleration starts at minus gravity, so that all
//! accelerations here are proper (as an accelerometer measures them) and weight needs no term.
//!
//! Spring-dampers are integrated implicitly: one that acts on a body adds `dt (C + dt K)` to that
//! body's articulated inertia, one that acts on a joint adds the same to the joint's armature.

use crate::spatial::{cross_force, cross_motion, split, stack, symmetric, turn};
use crate::tree::{Body, Frame, Hinge, Mimic, State, Tree};
use nalgebra::{DMatrix, DVector, Matrix3, Matrix6, Vector3, Vector6};

/// Gravity, m/s², along the world's -z.
pub const GRAVITY: f64 = 9.81;

/// One body's quantities in the world's frame.
#[derive(Debug, Clone)]
struct Moving {
    rotation: Matrix3<f64>,
    position: Vector3<f64>,
    axis: Vector6<f64>,
    velocity: Vector6<f64>,
    bias: Vector6<f64>,
    inertia: Matrix6<f64>,
    articulated: Matrix6<f64>,
    /// Bias force: needed without acceleration, less the external wrenches.
    resistance: Vector6<f64>,
    u: Vector6<f64>,
    d: f64,
    drive: f64,
    acceleration: Vector6<f64>,
    external: Vector6<f64>,
    through: Vector6<f64>,
}

/// Work space of the forward dynamics.
#[derive(Debug, Clone)]
pub struct Dynamics {
    bodies: Vec<Moving>,
}

impl Dynamics {
    /// Work space for `tree`.
    #[must_use]
    pub fn new(tree: &Tree) -> Self {
        let moving = Moving {
            rotation: Matrix3::identity(),
            position: Vector3::zeros(),
            axis: Vector6::zeros(),
            velocity: Vector6::zeros(),
            bias: Vector6::zeros(),
            inertia: Matrix6::zeros(),
            articulated: Matrix6::zeros(),
            resistance: Vector6::zeros(),
            u: Vector6::zeros(),
            d: 1.0,
            drive: 0.0,
            acceleration: Vector6::zeros(),
            external: Vector6::zeros(),
            through: Vector6::zeros(),
        };
        Self {
            bodies: vec![moving; tree.bodies.len()],
        }
    }

    /// Placements and velocities of all bodies; clears all forces.
    pub fn kinematics(&mut self, tree: &Tree, state: &State) {
        for i in 0..tree.bodies.len() {
            let body = &tree.bodies[i];
            let (rotation, position, velocity) = match body.parent {
                None => (
                    state.orientation.to_rotation_matrix().into_inner(),
                    state.position,
                    state.twist,
                ),
                Some(parent) => {
                    let p = &self.bodies[parent];
                    (
                        p.rotation * body.rotation,
                        p.position + p.rotation * body.offset,
                        p.velocity,
                    )
                }
            };
            let m = &mut self.bodies[i];
            m.rotation = rotation;
            m.position = position;
            m.velocity = velocity;
            m.bias.fill(0.0);
            if let Some(Hinge { dof, axis, slides }) = body.hinge {
                let world = rotation * axis;
                if slides {
                    m.axis = stack(Vector3::zeros(), world);
                    m.position += state.q[dof] * world;
                } else {
                    m.axis = stack(world, position.cross(&world));
                    m.rotation *= turn(&axis, state.q[dof]);
                }
                m.velocity += m.axis * state.dq[dof];
                m.bias = cross_motion(&velocity, &m.axis) * state.dq[dof];
            }
            m.set_inertia(body);
            m.articulated = m.inertia;
            m.resistance = cross_force(&m.velocity, &(m.inertia * m.velocity));
        }
    }

    /// Applies a wrench about the world's origin to a body during the next `solve`.
    pub fn push(&mut self, body: usize, wrench: &Vector6<f64>) {
        self.bodies[body].resistance -= wrench;
    }

    /// Applies a wrench `-matrix a` to a body, `a` being its true acceleration: the implicit part
    /// of a spring-damper.
    pub fn resist(&mut self, body: usize, matrix: &Matrix6<f64>) {
        let m = &mut self.bodies[body];
        m.articulated += matrix;
        // The work space's accelerations are proper: a = proper - g upwards.
        m.resistance -= matrix * stack(Vector3::zeros(), GRAVITY * Vector3::z());
    }

    /// Joint and base accelerations from joint torques `tau - armature ddq` and the pushes, joints that
    /// follow others as their ratios demand. Returns the base's true spatial acceleration.
    ///
    /// The linkage between a joint and its driver transmits a force `f`: `f` on the follower, `-ratio f` on
    /// the driver. The accelerations are linear in these forces, so that as many solutions of the tree with
    /// a force of one as there are followers determine the forces that keep every `ddq_follower` at
    /// `ratio ddq_driver`.
    pub fn solve(
        &mut self,
        tree: &Tree,
        tau: &[f64],
        armature: &[f64],
        ddq: &mut [f64],
    ) -> Vector6<f64> {
        let mimics = tree.mimics();
        if mimics.is_empty() {
            return self.solve_tree(tree, tau, armature, ddq);
        }
        let apart = |ddq: &[f64]| -> Vec<f64> {
            let apart = |m: &Mimic| ddq[m.follower] - m.ratio * ddq[m.driver];
            mimics.iter().map(apart).collect()
        };
        let mut torques = tau.to_vec();
        self.clone().solve_tree(tree, &torques, armature, ddq);
        let free = apart(ddq);
        let mut answers = DMatrix::zeros(mimics.len(), mimics.len());
        for (k, mimic) in mimics.iter().enumerate() {
            torques.copy_from_slice(tau);
            transmit(&mut torques, mimic, 1.0);
            self.clone().solve_tree(tree, &torques, armature, ddq);
            for (i, (with, without)) in apart(ddq).iter().zip(&free).enumerate() {
                answers[(i, k)] = with - without;
            }
        }
        torques.copy_from_slice(tau);
        // Bodies have inertia, so that the matrix has an inverse; without one the joints go on freely.
        if let Some(forces) = answers.lu().solve(&-DVector::from_vec(free)) {
            for (mimic, force) in mimics.iter().zip(forces.iter()) {
                transmit(&mut torques, mimic, *force);
            }
        }
        self.solve_tree(tree, &torques, armature, ddq)
    }

    /// Accelerations of a tree every joint of which moves by itself.
    fn solve_tree(
        &mut self,
        tree: &Tree,
        tau: &[f64],
        armature: &[f64],
        ddq: &mut [f64],
    ) -> Vector6<f64> {
        for i in (1..tree.bodies.len()).rev() {
            let Some(parent) = tree.bodies[i].parent else {
                continue;
            };
            let (before, from) = self.bodies.split_at_mut(i);
            let (p, m) = (&mut before[parent], &mut from[0]);
            if let Some(Hinge { dof, .. }) = tree.bodies[i].hinge {
                m.u = m.articulated * m.axis;
                m.d = m.axis.dot(&m.u) + armature[dof];
                m.drive = tau[dof] - m.axis.dot(&m.resistance);
                m.resistance += m.articulated * m.bias + m.u * ((m.drive - m.u.dot(&m.bias)) / m.d);
                m.articulated.ger(-1.0 / m.d, &m.u, &m.u, 1.0);
            }
            p.articulated += m.articulated;
            p.resistance += m.resistance;
        }
        let up = stack(Vector3::zeros(), GRAVITY * Vector3::z());
        let base = &mut self.bodies[0];
        base.acceleration = if tree.floating() {
            match base.articulated.cholesky() {
                Some(cholesky) => -cholesky.solve(&base.resistance),
                None => up,
            }
        } else {
            up
        };
        let base_acceleration = base.acceleration - up;
        for i in 1..tree.bodies.len() {
            let parent = tree.bodies[i].parent.unwrap_or(0);
            let carried = self.bodies[parent].acceleration + self.bodies[i].bias;
            let m = &mut self.bodies[i];
            m.acceleration = carried;
            if let Some(Hinge { dof, .. }) = tree.bodies[i].hinge {
                ddq[dof] = (m.drive - m.u.dot(&carried)) / m.d;
                m.acceleration += m.axis * ddq[dof];
            }
        }
        base_acceleration
    }

    /// Clears the wrenches recorded by `note_external`.
    pub fn clear_external(&mut self) {
        for m in &mut self.bodies {
            m.external.fill(0.0);
        }
    }

    /// Records the external wrench that acted on a body, for `wrenches`.
    pub fn note_external(&mut self, body: usize, wrench: &Vector6<f64>) {
        self.bodies[body].external += wrench;
    }

    /// The wrench that each body's parent applies to it, from the accelerations of the last
    /// `solve` and the recorded external wrenches (Newton-Euler, leaves to base).
    pub fn wrenches(&mut self, tree: &Tree) {
        for m in &mut self.bodies {
            let momentum = m.inertia * m.velocity;
            m.through =
                m.inertia * m.acceleration + cross_force(&m.velocity, &momentum) - m.external;
        }
        for i in (1..tree.bodies.len()).rev() {
            if let Some(parent) = tree.bodies[i].parent {
                let through = self.bodies[i].through;
                self.bodies[parent].through += through;
            }
        }
    }

    /// Sets all true accelerations to zero.
    pub fn rest(&mut self) {
        for m in &mut self.bodies {
            m.acceleration = stack(Vector3::zeros(), GRAVITY * Vector3::z());
        }
    }

    /// Residual wrench on the base, from the last `wrenches` call: zero for a floating base whose
    /// accelerations are right.
    #[must_use]
    pub fn missing(&self) -> Vector6<f64> {
        self.bodies[0].through
    }

    /// Torque of a joint from the last `wrenches` call, N·m.
    #[must_use]
    pub fn torque(&self, tree: &Tree, dof: usize) -> f64 {
        (tree.bodies.iter().zip(&self.bodies))
            .find(|(b, _)| b.hinge.is_some_and(|hinge| hinge.dof == dof))
            .map_or(0.0, |(_, m)| m.axis.dot(&m.through))
    }

    /// The wrench that the parent of a frame's body applies to it, about the frame's origin in the
    /// frame's axes: force and torque.
    #[must_use]
    pub fn wrench_at(&self, frame: &Frame) -> (Vector3<f64>, Vector3<f64>) {
        let m = &self.bodies[frame.body];
        let (rotation, position) = self.placement(frame);
        let (torque, force) = split(&m.through);
        (
            rotation.tr_mul(&force),
            rotation.tr_mul(&(torque - position.cross(&force))),
        )
    }

    /// Rotation and origin of a frame in the world.
    #[must_use]
    pub fn placement(&self, frame: &Frame) -> (Matrix3<f64>, Vector3<f64>) {
        let m = &self.bodies[frame.body];
        (
            m.rotation * frame.rotation,
            m.position + m.rotation * frame.offset,
        )
    }

    /// A point given in a body's frame, and its velocity, in the world.
    #[must_use]
    pub fn point(&self, body: usize, local: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
        let m = &self.bodies[body];
        let position = m.position + m.rotation * local;
        let (omega, v) = split(&m.velocity);
        (position, v + omega.cross(&position))
    }

    /// Angular velocity of a body in the world, rad/s.
    #[must_use]
    pub fn angular_velocity(&self, body: usize) -> Vector3<f64> {
        split(&self.bodies[body].velocity).0
    }

    /// True spatial acceleration of a body about the world's origin.
    #[must_use]
    pub fn acceleration(&self, body: usize) -> Vector6<f64> {
        self.bodies[body].acceleration - stack(Vector3::zeros(), GRAVITY * Vector3::z())
    }

    /// Proper acceleration (acceleration minus gravity) of a world point on a body, m/s².
    #[must_use]
    pub fn proper_acceleration(&self, body: usize, position: &Vector3<f64>) -> Vector3<f64> {
        let m = &self.bodies[body];
        let (alpha, a) = split(&m.acceleration);
        let (omega, v) = split(&m.velocity);
        a + alpha.cross(position) + omega.cross(&(v + omega.cross(position)))
    }

    /// Momentum about the world's origin, `[angular; linear]`.
    #[must_use]
    pub fn momentum(&self) -> Vector6<f64> {
        (self.bodies.iter()).fold(Vector6::zeros(), |sum, m| sum + m.inertia * m.velocity)
    }

    /// Kinetic and potential energy, J.
    #[must_use]
    pub fn energy(&self) -> (f64, f64) {
        self.bodies
            .iter()
            .fold((0.0, 0.0), |(kinetic, potential), m| {
                (
                    kinetic + 0.5 * m.velocity.dot(&(m.inertia * m.velocity)),
                    potential + GRAVITY * m.first_moment().z,
                )
            })
    }

    /// Centre of mass of the whole robot, m.
    #[must_use]
    pub fn centre_of_mass(&self, tree: &Tree) -> Vector3<f64> {
        let sum = (self.bodies.iter()).fold(Vector3::zeros(), |s, m| s + m.first_moment());
        sum / tree.mass()
    }
}

/// The force of the linkage between a joint and the one that it follows.
fn transmit(torques: &mut [f64], mimic: &Mimic, force: f64) {
    torques[mimic.follower] += force;
    torques[mimic.driver] -= mimic.ratio * force;
}

impl Moving {
    /// The body's inertia about the world's origin.
    fn set_inertia(&mut self, body: &Body) {
        let (r, p, mass) = (&self.rotation, &self.position, body.mass);
        let first = r * (mass * body.com);
        // Steiner's rule from the body's origin: -[p][f] - [f][p] - m [p][p], [.] the cross matrix.
        let outer = first * p.transpose();
        let steiner = Matrix3::from_diagonal_element(p.dot(&(2.0 * first + mass * p)))
            - outer
            - outer.transpose()
            - mass * p * p.transpose();
        self.inertia = symmetric(
            &(r * body.inertia * r.transpose() + steiner),
            &(first + mass * p).cross_matrix(),
            &Matrix3::from_diagonal_element(mass),
        );
    }

    /// Mass times centre of mass in the world.
    fn first_moment(&self) -> Vector3<f64> {
        let i = &self.inertia;
        Vector3::new(i[(2, 4)], i[(0, 5)], i[(1, 3)])
    }
}
