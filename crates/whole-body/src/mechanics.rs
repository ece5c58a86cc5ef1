//! Motion of every piece and the wrench that it needs, before any contact is known.
//!
//! In: motion of joints and IMU, readings of F/T sensors. Out: per part, the wrench that its contacts
//! must apply. Method: D's algorithm 1. All spatial vectors are in the root link's axes, about the
//! root link's origin, at one instant: vectors of different bodies then add up. The velocity of the
//! whole robot has no effect on any wrench and is set to zero at the root's origin.

use crate::layout::Layout;
use crate::pieces::Pieces;
use crate::placements::Placements;
use dynamics::{Force, ImuMotion, Inertia, Model, Motion, Se3};
use nalgebra::Vector3;
use robot_state::Wrench;

/// See the module. Vectors have one element per body, piece, sensor or part.
#[derive(Debug, Clone)]
pub(crate) struct Mechanics {
    placements: Placements,
    pieces: Pieces,
    /// Per body: placement, joint axis (times a mimic joint's ratio), twist, proper acceleration.
    pub(crate) in_root: Vec<Se3>,
    pub(crate) axis: Vec<Motion>,
    pub(crate) velocity: Vec<Motion>,
    pub(crate) acceleration: Vec<Motion>,
    /// Per piece: its own inertia, and its own inertial and gravity wrench.
    inertia: Vec<Inertia>,
    own: Vec<Force>,
    /// Per piece: inertia with all that it carries in its part.
    pub(crate) composite: Vec<Inertia>,
    /// Per piece: inertial and gravity wrench with all that it carries in its part.
    pub(crate) inertial: Vec<Force>,
    /// Per piece: the same, less the measured wrenches of the parts beyond it.
    pub(crate) needed: Vec<Force>,
    /// Per sensor: frame, and reading (wrench of the part beyond on the part before).
    pub(crate) sensor_frame: Vec<Se3>,
    pub(crate) reading: Vec<Force>,
    /// Per body: torque of its joint without contact wrenches on the part.
    pub(crate) tau: Vec<f64>,
    /// Per part: `b`, the wrench that contacts must apply to it.
    pub(crate) net: Vec<Force>,
}

impl Mechanics {
    pub(crate) fn new(model: &Model, layout: &Layout) -> Self {
        let (bodies, pieces) = (model.bodies().len(), layout.pieces.len());
        let sensors = layout.sensors.len();
        Self {
            placements: Placements::new(model),
            pieces: Pieces::new(&layout.pieces),
            in_root: vec![Se3::identity(); bodies],
            axis: vec![Motion::zero(); bodies],
            velocity: vec![Motion::zero(); bodies],
            acceleration: vec![Motion::zero(); bodies],
            inertia: vec![Inertia::zero(); pieces],
            own: vec![Force::zero(); pieces],
            composite: vec![Inertia::zero(); pieces],
            inertial: vec![Force::zero(); pieces],
            needed: vec![Force::zero(); pieces],
            sensor_frame: vec![Se3::identity(); sensors],
            reading: vec![Force::zero(); sensors],
            tau: vec![0.0; bodies],
            net: vec![Force::zero(); sensors + 1],
        }
    }

    /// Placements and joint axes.
    pub(crate) fn place(&mut self, q: &[f64]) {
        (self.placements).update(q, &mut self.in_root, &mut self.axis);
    }

    /// Origin of a part's first link.
    pub(crate) fn origin(&self, model: &Model, layout: &Layout, part: usize) -> Vector3<f64> {
        let part = &layout.parts[part];
        let body = model.frames()[part.first_link].body;
        self.in_root[body].act_point(part.placement.translation)
    }

    /// A part's first link in the root's frame.
    pub(crate) fn part_frame(&self, model: &Model, layout: &Layout, part: usize) -> Se3 {
        let part = &layout.parts[part];
        let body = model.frames()[part.first_link].body;
        self.in_root[body].compose(&part.placement)
    }

    /// All but [`Self::carry`], from the joints' motion, that of the source's frame, and the sensors'
    /// readings.
    pub(crate) fn update(
        &mut self,
        model: &Model,
        layout: &Layout,
        [q, dq, ddq]: [&[f64]; 3],
        source: &ImuMotion,
        ft: &[Wrench],
    ) {
        self.place(q);
        self.base(model, layout, dq, ddq, source);
        for (i, body) in model.bodies().iter().enumerate().skip(1) {
            let rate = self.axis[i] * dq[body.joint];
            //= D Algorithm 1: v_i = v_p + S_i dq_i; a_i = a_p + S_i ddq_i + v_i x S_i dq_i
            let velocity = self.velocity[body.parent] + rate;
            self.acceleration[i] = self.acceleration[body.parent]
                + self.axis[i] * ddq[body.joint]
                + velocity.cross(rate);
            self.velocity[i] = velocity;
        }
        self.pieces.update(
            &self.in_root,
            &self.velocity,
            &self.acceleration,
            &mut self.inertia,
            &mut self.own,
        );
        self.needed.copy_from_slice(&self.own);
        self.read(layout, ft);
        self.sum(layout);
    }

    /// Twist and proper acceleration of the root that make the source's frame move as measured.
    fn base(
        &mut self,
        model: &Model,
        layout: &Layout,
        dq: &[f64],
        ddq: &[f64],
        source: &ImuMotion,
    ) {
        let bodies = model.bodies();
        let frame = self.in_root[layout.source_body].compose(&layout.source_placement);
        let omega = frame.rotation * source.angular_velocity;
        let rates = layout.source_path.iter();
        let relative = rates.fold(Vector3::zeros(), |sum, &b| {
            sum + self.axis[b].angular * dq[bodies[b].joint]
        });
        //= D Algorithm 1, lines 4-5: v_0, a_0 from the IMU and the joints between
        let base = Motion::new(Vector3::zeros(), omega - relative);
        let (mut velocity, mut acceleration) = (base, Motion::zero());
        for &b in &layout.source_path {
            let rate = self.axis[b] * dq[bodies[b].joint];
            velocity += rate;
            acceleration += self.axis[b] * ddq[bodies[b].joint] + velocity.cross(rate);
        }
        let alpha = frame.rotation * source.angular_acceleration;
        let p = frame.translation;
        let point_velocity = velocity.linear + velocity.angular.cross(&p);
        let linear = frame.rotation * source.proper_acceleration
            - alpha.cross(&p)
            - velocity.angular.cross(&point_velocity);
        self.velocity[0] = base;
        self.acceleration[0] = Motion::new(linear, alpha) - acceleration;
    }

    fn read(&mut self, layout: &Layout, ft: &[Wrench]) {
        for (s, sensor) in layout.sensors.iter().enumerate() {
            let frame = self.in_root[sensor.body].compose(&sensor.placement);
            let w = &ft[sensor.input];
            let reading = Force::new(Vector3::from(w.force), Vector3::from(w.torque));
            self.sensor_frame[s] = frame;
            self.reading[s] = frame.act_force(reading);
            self.needed[sensor.before_piece] -= self.reading[s];
        }
    }

    /// Inertias and inertial wrenches with all that each piece carries in its part, which standard
    /// deviations alone need; after `update`.
    pub(crate) fn carry(&mut self, layout: &Layout) {
        self.composite.copy_from_slice(&self.inertia);
        self.inertial.copy_from_slice(&self.own);
        for i in (1..self.in_root.len()).rev() {
            if layout.cut_at_joint[i].is_none() {
                let carrier = layout.carrier[i];
                let (inertial, composite) = (self.inertial[i], self.composite[i]);
                self.inertial[carrier] += inertial;
                self.composite[carrier] += composite;
            }
        }
    }

    /// Sums from the leaves to each part's root.
    fn sum(&mut self, layout: &Layout) {
        for i in (1..self.in_root.len()).rev() {
            if let Some(s) = layout.cut_at_joint[i] {
                self.tau[i] = -self.axis[i].dot(self.reading[s]);
                continue;
            }
            let needed = self.needed[i];
            //= D Algorithm 1: tau_i = S_i^T f_i; f_p = f_p + f_i
            self.tau[i] = self.axis[i].dot(needed);
            self.needed[layout.carrier[i]] += needed;
        }
        for (g, part) in layout.parts.iter().enumerate() {
            self.net[g] = self.needed[part.root_piece];
            if let Some(s) = g.checked_sub(1) {
                self.net[g] += self.reading[s];
            }
        }
    }
}
