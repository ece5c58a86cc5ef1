//! The robot's bodies as a tree, and the state that they are in.

use crate::spatial::split;
use crate::urdf::{Joint, Urdf};
use nalgebra::{Matrix3, UnitQuaternion, Vector3, Vector6};
use problem::Problem;

/// A moving joint between a body and its parent.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Hinge {
    /// Index into `State::q`.
    pub(crate) dof: usize,
    pub(crate) axis: Vector3<f64>,
    /// The body moves along the axis, not about it.
    pub(crate) slides: bool,
}

/// A joint that follows another: `q_follower = ratio q_driver + offset`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Mimic {
    pub(crate) follower: usize,
    pub(crate) driver: usize,
    pub(crate) ratio: f64,
    pub(crate) offset: f64,
}

/// A rigid body: a URDF link with all links fixed to it.
#[derive(Debug, Clone)]
pub(crate) struct Body {
    pub(crate) parent: Option<usize>,
    /// The joint to the parent; `None` for the base and for the far side of an F/T sensor.
    pub(crate) hinge: Option<Hinge>,
    pub(crate) rotation: Matrix3<f64>,
    pub(crate) offset: Vector3<f64>,
    pub(crate) mass: f64,
    pub(crate) com: Vector3<f64>,
    /// Inertia about the body's origin, in its axes, kg·m².
    pub(crate) inertia: Matrix3<f64>,
}

/// Where a URDF link sits on its body.
#[derive(Debug, Clone)]
pub struct Frame {
    /// The link's name.
    pub name: String,
    /// Index of the body that carries it.
    pub body: usize,
    /// Rotation in the body's frame.
    pub rotation: Matrix3<f64>,
    /// Origin in the body's frame, m.
    pub offset: Vector3<f64>,
}

/// The robot's bodies, parents before children.
#[derive(Debug, Clone)]
pub struct Tree {
    pub(crate) bodies: Vec<Body>,
    frames: Vec<Frame>,
    /// Of all moving joints, those that follow others last.
    joint_names: Vec<String>,
    mimics: Vec<Mimic>,
    slides: Vec<bool>,
    floating: bool,
}

/// Positions and velocities.
#[derive(Debug, Clone)]
pub struct State {
    /// Base position in the world, m.
    pub position: Vector3<f64>,
    /// Base orientation in the world.
    pub orientation: UnitQuaternion<f64>,
    /// Base twist about the world's origin, `[omega; v]`, rad/s and m/s.
    pub twist: Vector6<f64>,
    /// q: joint angles, rad; of prismatic joints m. Those that follow others last.
    pub q: Vec<f64>,
    /// dq: joint velocities, rad/s or m/s.
    pub dq: Vec<f64>,
}

impl Tree {
    /// Builds the tree from a URDF; links named in `cuts` (F/T sensors) start bodies of their own,
    /// so that the wrench through them can be determined.
    ///
    /// # Errors
    /// Links that are not all connected, or a cut that names no link.
    pub fn new(urdf: &Urdf, floating: bool, cuts: &[&str]) -> Result<Self, Problem> {
        for cut in cuts {
            if urdf.links.iter().all(|l| l.name != *cut) {
                return Err(Problem::new(format!("there is no link {cut}"), ""));
            }
        }
        let moving = || urdf.joints.iter().filter(|joint| joint.axis.is_some());
        let followers = moving().filter(|joint| joint.mimic.is_some());
        let drivers = moving().filter(|joint| joint.mimic.is_none());
        let ordered: Vec<_> = drivers.chain(followers).collect();
        let mut tree = Self {
            bodies: Vec::new(),
            frames: Vec::new(),
            joint_names: ordered.iter().map(|joint| joint.name.clone()).collect(),
            slides: ordered.iter().map(|joint| joint.slides).collect(),
            mimics: Vec::new(),
            floating,
        };
        for (follower, joint) in ordered.iter().enumerate() {
            if joint.mimic.is_some() {
                tree.mimics.push(tree.follow(&ordered, follower)?);
            }
        }
        tree.start_body(None, None, Matrix3::identity(), Vector3::zeros());
        tree.attach(
            urdf,
            urdf.root,
            0,
            Matrix3::identity(),
            Vector3::zeros(),
            cuts,
        );
        if tree.frames.len() != urdf.links.len() {
            return Err(Problem::new("the links form a loop", ""));
        }
        Ok(tree)
    }

    fn start_body(
        &mut self,
        parent: Option<usize>,
        hinge: Option<Hinge>,
        rotation: Matrix3<f64>,
        offset: Vector3<f64>,
    ) -> usize {
        self.bodies.push(Body {
            parent,
            hinge,
            rotation,
            offset,
            mass: 0.0,
            com: Vector3::zeros(),
            inertia: Matrix3::zeros(),
        });
        self.bodies.len() - 1
    }

    /// Adds link `link` to `body` at the given placement, and all links beyond it.
    fn attach(
        &mut self,
        urdf: &Urdf,
        link: usize,
        body: usize,
        rotation: Matrix3<f64>,
        offset: Vector3<f64>,
        cuts: &[&str],
    ) {
        let part = &urdf.links[link];
        self.frames.push(Frame {
            name: part.name.clone(),
            body,
            rotation,
            offset,
        });
        self.bodies[body].add(
            part.mass,
            rotation * part.com + offset,
            rotation * part.inertia * rotation.transpose(),
        );
        for joint in urdf.joints.iter().filter(|j| j.parent == link) {
            let r = rotation * joint.rotation;
            let p = rotation * joint.offset + offset;
            let dof = self.joint_names.iter().position(|name| *name == joint.name);
            if let (Some(axis), Some(dof)) = (joint.axis, dof) {
                let slides = joint.slides;
                let hinge = Hinge { dof, axis, slides };
                let new = self.start_body(Some(body), Some(hinge), r, p);
                self.attach(
                    urdf,
                    joint.child,
                    new,
                    Matrix3::identity(),
                    Vector3::zeros(),
                    cuts,
                );
            } else if cuts.contains(&urdf.links[joint.child].name.as_str()) {
                let new = self.start_body(Some(body), None, r, p);
                self.attach(
                    urdf,
                    joint.child,
                    new,
                    Matrix3::identity(),
                    Vector3::zeros(),
                    cuts,
                );
            } else {
                self.attach(urdf, joint.child, body, r, p, cuts);
            }
        }
    }

    /// The joint at the end of the chain of joints that one follows.
    fn follow(&self, joints: &[&Joint], follower: usize) -> Result<Mimic, Problem> {
        let (mut driver, mut ratio, mut offset) = (follower, 1.0, 0.0);
        for _ in 0..=joints.len() {
            let Some((name, multiplier, by)) = &joints[driver].mimic else {
                return Ok(Mimic {
                    follower,
                    driver,
                    ratio,
                    offset,
                });
            };
            let next = self.joint_names.iter().position(|other| other == name);
            driver = next.ok_or_else(|| {
                let own = &joints[follower].name;
                Problem::new(
                    format!("joint {own} mimics {name}, which is no moving joint"),
                    "",
                )
            })?;
            offset += ratio * by;
            ratio *= multiplier;
        }
        let own = &joints[follower].name;
        Err(Problem::new(
            format!("joint {own} mimics itself in the end"),
            "",
        ))
    }

    /// Names of the moving joints, in the order of `State::q`.
    #[must_use]
    pub fn joint_names(&self) -> &[String] {
        &self.joint_names
    }

    /// Names of the joints that move by themselves, the first of `State::q`.
    #[must_use]
    pub fn driven_names(&self) -> &[String] {
        &self.joint_names[..self.joint_names.len() - self.mimics.len()]
    }

    /// For each moving joint: true if it is prismatic.
    #[must_use]
    pub fn slides(&self) -> &[bool] {
        &self.slides
    }

    pub(crate) fn mimics(&self) -> &[Mimic] {
        &self.mimics
    }

    /// Puts the joints that follow others where they belong.
    pub(crate) fn place_followers(&self, state: &mut State) {
        for mimic in &self.mimics {
            state.q[mimic.follower] = mimic.ratio * state.q[mimic.driver] + mimic.offset;
            state.dq[mimic.follower] = mimic.ratio * state.dq[mimic.driver];
        }
    }

    /// True for a base that moves freely.
    #[must_use]
    pub fn floating(&self) -> bool {
        self.floating
    }

    /// The frame of the link with that name.
    #[must_use]
    pub fn frame(&self, name: &str) -> Option<&Frame> {
        self.frames.iter().find(|f| f.name == name)
    }

    /// The frame of the link that a key of a file names.
    pub(crate) fn frame_of(&self, key: &str, link: &str) -> Result<&Frame, Problem> {
        let reason = || Problem::new(format!("{key}: the URDF has no link {link}"), "");
        self.frame(link).ok_or_else(reason)
    }

    /// Total mass, kg.
    #[must_use]
    pub fn mass(&self) -> f64 {
        self.bodies.iter().map(|b| b.mass).sum()
    }

    /// A state at rest with all angles zero, but for joints that follow others.
    #[must_use]
    pub fn rest(&self) -> State {
        let mut state = State {
            position: Vector3::zeros(),
            orientation: UnitQuaternion::identity(),
            twist: Vector6::zeros(),
            q: vec![0.0; self.joint_names.len()],
            dq: vec![0.0; self.joint_names.len()],
        };
        self.place_followers(&mut state);
        state
    }
}

impl Body {
    /// Adds a part given by its mass, centre of mass and inertia about that, in body axes.
    fn add(&mut self, mass: f64, com: Vector3<f64>, inertia: Matrix3<f64>) {
        let c = com.cross_matrix();
        self.inertia += inertia - mass * c * c;
        if self.mass + mass > 0.0 {
            self.com = (self.mass * self.com + mass * com) / (self.mass + mass);
        }
        self.mass += mass;
    }
}

/// Advances the state by `dt`, velocities first (semi-implicit Euler).
pub fn integrate(
    tree: &Tree,
    state: &mut State,
    base_acceleration: &Vector6<f64>,
    ddq: &[f64],
    dt: f64,
) {
    for ((q, dq), ddq) in state.q.iter_mut().zip(&mut state.dq).zip(ddq) {
        *dq += dt * ddq;
        *q += dt * *dq;
    }
    tree.place_followers(state);
    if tree.floating {
        state.twist += dt * base_acceleration;
        let (omega, v) = split(&state.twist);
        state.position += dt * (v + omega.cross(&state.position));
        state.orientation = UnitQuaternion::from_scaled_axis(dt * omega) * state.orientation;
        state.orientation.renormalize_fast();
    }
}
