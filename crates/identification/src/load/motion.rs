//! Wrenches and torques that a robot's model predicts at F/T sensors and joints, and how they depend on
//! one link's inertia.

use super::{BODY, Sample};
use dynamics::{
    Data, Force, ImuMotion, Inertia, Model, Motion, ReferenceFrame,
    forward_kinematics_acceleration, frame_acceleration, frame_placement, frame_velocity, neutral,
};
use nalgebra::{Matrix3, Vector3};

/// Knowledge of the robot's motion in space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Source {
    /// A link stands still.
    Still {
        /// Index of the link's frame.
        frame: usize,
        /// g in its axes, m/s² (3).
        gravity: Vector3<f64>,
    },
    /// A link carries an inertial measurement unit in its frame.
    Imu {
        /// Index of the link's frame.
        frame: usize,
    },
}

/// Motion of all links, those of the root link's axes relative to it.
pub struct Moving<'a> {
    model: &'a Model,
    source: Source,
    data: Data,
    q: Vec<f64>,
    v: Vec<f64>,
    a: Vec<f64>,
    /// Twist and proper acceleration of the root link.
    root: [Motion; 2],
}

impl<'a> Moving<'a> {
    /// Of a robot at rest.
    #[must_use]
    pub fn new(model: &'a Model, source: Source) -> Self {
        Self {
            model,
            source,
            data: Data::new(model),
            q: neutral(model),
            v: vec![0.0; model.nv()],
            a: vec![0.0; model.nv()],
            root: [Motion::zero(); 2],
        }
    }

    /// Takes angles, velocities and accelerations of the joints, in the model's order; `imu` where the
    /// source is one.
    pub fn update(&mut self, q: &[f64], dq: &[f64], ddq: &[f64], imu: Option<&ImuMotion>) {
        let (bv, bq) = self.model.base_size();
        self.q[bq..].copy_from_slice(q);
        self.v[bv..].copy_from_slice(dq);
        self.a[bv..].copy_from_slice(ddq);
        forward_kinematics_acceleration(self.model, &mut self.data, &self.q, &self.v, &self.a);
        let (frame, twist, acceleration) = match (self.source, imu) {
            (Source::Imu { frame }, Some(imu)) => (
                frame,
                Motion::new(Vector3::zeros(), imu.angular_velocity),
                Motion::new(imu.proper_acceleration, imu.angular_acceleration),
            ),
            (Source::Still { frame, gravity }, _) => (
                frame,
                Motion::zero(),
                Motion::new(-gravity, Vector3::zeros()),
            ),
            (Source::Imu { frame }, None) => (frame, Motion::zero(), Motion::zero()),
        };
        let place = frame_placement(self.model, &self.data, frame);
        let [relative, rate] = self.relative(frame);
        // A twist of the whole robot changes no wrench: the source's origin is taken to be at rest.
        let root = place.act_motion(twist) - relative;
        self.root = [
            root,
            place.act_motion(acceleration) - rate - root.cross(relative),
        ];
    }

    /// Twist and acceleration of a link relative to the root link, in the latter's axes about its origin.
    fn relative(&self, frame: usize) -> [Motion; 2] {
        let world = ReferenceFrame::World;
        [
            frame_velocity(self.model, &self.data, frame, world),
            frame_acceleration(self.model, &self.data, frame, world),
        ]
    }

    /// Wrench that moves a part of this inertia with a link, in the link's axes about its origin.
    fn wrench(&self, frame: usize, inertia: &Inertia) -> Force {
        let [velocity, rate] = self.relative(frame);
        let [root, acceleration] = self.root;
        let place = frame_placement(self.model, &self.data, frame);
        let v = place.inverse_act_motion(root + velocity);
        let a = place.inverse_act_motion(acceleration + rate + root.cross(velocity));
        inertia.wrench(v, a)
    }

    /// Acceleration of a link's origin less gravity, in the link's axes, m/s² (3).
    #[must_use]
    pub fn up(&self, frame: usize) -> Vector3<f64> {
        let unit = Inertia {
            mass: 1.0,
            ..Inertia::zero()
        };
        self.wrench(frame, &unit).linear
    }

    /// [`Moving::wrench`] in the root link's axes about its origin.
    fn in_root(&self, frame: usize, inertia: &Inertia) -> Force {
        let place = frame_placement(self.model, &self.data, frame);
        place.act_force(self.wrench(frame, inertia))
    }
}

/// Where a robot is cut in thought: what passes there is measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Cut {
    at: At,
    /// Links beyond.
    beyond: Vec<usize>,
}

#[derive(Debug, Clone, PartialEq)]
enum At {
    /// At a link, in whose frame a sensor measures.
    Sensor(usize),
    /// At the bodies that a joint moves, with their ratios.
    Joint(Vec<usize>),
}

impl Cut {
    /// Just before a link.
    #[must_use]
    pub fn before_link(model: &Model, frame: usize) -> Self {
        let beyond = (0..model.frames().len()).filter(|&k| carries(model, frame, k));
        Self {
            at: At::Sensor(frame),
            beyond: beyond.collect(),
        }
    }

    /// At a joint.
    #[must_use]
    pub fn at_joint(model: &Model, joint: usize) -> Self {
        let bodies: Vec<usize> = (1..model.bodies().len())
            .filter(|&b| model.bodies()[b].joint == joint)
            .collect();
        let frames = model.frames().iter().enumerate();
        let beyond = frames.filter(|(_, f)| bodies.iter().any(|&b| model.supports(b, f.body)));
        Self {
            beyond: beyond.map(|(k, _)| k).collect(),
            at: At::Joint(bodies),
        }
    }

    /// Whether a link is beyond.
    #[must_use]
    pub fn has_beyond(&self, frame: usize) -> bool {
        self.beyond.contains(&frame)
    }

    /// Mass of the links beyond, kg.
    #[must_use]
    pub fn mass_beyond(&self, model: &Model) -> f64 {
        let links = self.beyond.iter();
        links.map(|&k| model.frames()[k].inertia.mass).sum()
    }

    /// Numbers that are measured here.
    #[must_use]
    pub fn channels(&self) -> usize {
        match self.at {
            At::Sensor(_) => 6,
            At::Joint(_) => 1,
        }
    }

    /// The model's prediction, and its derivatives by the inertia of `carrier`, appended to a sample.
    pub fn predict(&self, moving: &Moving<'_>, carrier: Option<usize>, into: &mut Sample) {
        let model = moving.model;
        match &self.at {
            At::Sensor(frame) => {
                let place = frame_placement(model, &moving.data, *frame);
                let links = self.beyond.iter();
                let own = |&k: &usize| moving.in_root(k, &model.frames()[k].inertia);
                let sum = links.map(own).fold(Force::zero(), |sum, f| sum + f);
                into.modelled
                    .extend(place.inverse_act_force(sum).to_array());
                let first = into.columns.len();
                into.columns.extend([[0.0; BODY]; 6]);
                let Some(carrier) = carrier.filter(|c| self.has_beyond(*c)) else {
                    return;
                };
                for (k, unit) in units().iter().enumerate() {
                    let f = place.inverse_act_force(moving.in_root(carrier, unit));
                    for (row, x) in into.columns[first..].iter_mut().zip(f.to_array()) {
                        row[k] = x;
                    }
                }
            }
            At::Joint(bodies) => {
                let mut torque = 0.0;
                let mut row = [0.0; BODY];
                for &b in bodies {
                    let body = &model.bodies()[b];
                    let place = moving.data.placements()[b];
                    let along = |f: Force| body.ratio * body.along_axis(place.inverse_act_force(f));
                    let supported = |k: &&usize| model.supports(b, model.frames()[**k].body);
                    for &k in self.beyond.iter().filter(supported) {
                        torque += along(moving.in_root(k, &model.frames()[k].inertia));
                    }
                    let carried = |c: &usize| model.supports(b, model.frames()[*c].body);
                    if let Some(carrier) = carrier.filter(carried) {
                        for (x, unit) in row.iter_mut().zip(units()) {
                            *x += along(moving.in_root(carrier, &unit));
                        }
                    }
                }
                into.modelled.push(torque);
                into.columns.push(row);
            }
        }
    }
}

/// Whether `frame` is `link` or a link beyond it.
fn carries(model: &Model, link: usize, mut frame: usize) -> bool {
    loop {
        if frame == link {
            return true;
        }
        match model.frames().get(frame).and_then(|f| f.parent) {
            Some(parent) => frame = parent,
            None => return false,
        }
    }
}

/// Links that fixed joints hold to a link, itself among them, on the same side of every cut at it.
#[must_use]
pub fn rigid_with(model: &Model, link: usize) -> Vec<usize> {
    let body = model.frames().get(link).map(|f| f.body);
    let frames = model.frames().iter().enumerate();
    let same = frames.filter(|(k, f)| Some(f.body) == body && carries(model, link, *k));
    same.map(|(k, _)| k).collect()
}

/// The inertia with each parameter 1 and the others 0.
fn units() -> [Inertia; BODY] {
    std::array::from_fn(|k| {
        let mut x = [0.0; BODY];
        x[k] = 1.0;
        inertia(&x)
    })
}

/// An inertia from its parameters.
#[must_use]
pub fn inertia(x: &[f64; BODY]) -> Inertia {
    let [mass, hx, hy, hz, xx, xy, yy, xz, yz, zz] = *x;
    Inertia {
        mass,
        first_moment: Vector3::new(hx, hy, hz),
        rotational: Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz),
    }
}

/// The parameters of an inertia.
#[must_use]
pub fn parameters(i: &Inertia) -> [f64; BODY] {
    let (h, r) = (&i.first_moment, &i.rotational);
    [
        i.mass,
        h.x,
        h.y,
        h.z,
        r[(0, 0)],
        r[(0, 1)],
        r[(1, 1)],
        r[(0, 2)],
        r[(1, 2)],
        r[(2, 2)],
    ]
}
