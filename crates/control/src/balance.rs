//! Balance: torques by which a robot stands on its feet, its centre of mass over them.
//!
//! In: newest angles and velocities of the joints, a desired pose, which feet stand on the ground and where up is in
//! their axes. Out: torques, and the wrenches of the ground that they count on. The feet stand still, so the joints
//! show how base and centre of mass move: nothing of it is late by a filter, and no wrench is measured. A gyroscope shows
//! how the feet roll where the ground gives way.
//!
//! 1. The centre of mass is to be over the middle of the soles: a linear inverted pendulum, whose centre of pressure
//!    stays within the soles. The base is to be turned as the desired pose has it.
//! 2. Least squares give the accelerations of all joints: feet that stand still, the two tasks, and a posture.
//! 3. Their dynamics give the wrench that the ground must apply, which the soles share as they can, and with it the
//!    torques.

mod center;
mod floor;
mod ground;
mod least_squares;
mod observer;
mod roll;
mod swing;
mod turn;

use crate::six::copy;
use crate::sole::Sole;
use center::Led;
pub(crate) use center::QUICKER;
use dynamics::{
    Base, Data, Model, Motion, ReferenceFrame, Se3, crba, forward_kinematics,
    forward_kinematics_acceleration, frame_acceleration, frame_jacobian, frame_placement, rnea,
};
use floor::Floor;
use ground::{Sharing, at_sensor, share};
use least_squares::LeastSquares;
pub use least_squares::MAX_FEET;
use nalgebra::{Matrix3, Matrix6xX, Vector2, Vector3, Vector6};
pub(crate) use observer::OBSERVES;
use observer::{OBSERVES_ON_ONE_FOOT, Observer};
use robot_state::Wrench;
use roll::Roll;
pub(crate) use turn::{FINDS, TURNS_BACK};

/// Frequency of the posture, critically damped, rad/s. Chosen on the simulated humanoid (docs/results/standing.md).
const POSTURE: f64 = 10.0;
/// Frequency of the low-pass of the joints' velocities, rad/s. Ground gives way under feet, which then turn against the
/// shanks though the body does not move. Chosen on the simulated humanoid, whose ankles rang without it, by 9 N·m at 33 Hz
/// on a floor of 150 N/mm under each corner: it takes 12 dB there, and 14° where the centre of mass is led.
const SMOOTH: f64 = 50.0;
/// Greatest angular acceleration that is asked for, of the base and of a joint, rad/s². Chosen; no experiment recorded.
const MOST_TURN: f64 = 30.0;
/// Weights of accelerations: of joints between the base and a foot that stands, of the others, which springs hold, and
/// of the base's. Chosen: legs balance, all else keeps its posture; no experiment recorded.
const WEIGHTS: [f64; 3] = [1.0, 100.0, 0.01];
/// Softness of feet that stand still, of the centre of mass and of the base's orientation, against these weights.
/// Chosen: each gives way a thousand times more than the one before; no experiment recorded.
const SOFTNESS: [f64; 3] = [1e-6, 1e-4, 1e-3];

/// A foot on which the robot may stand.
#[derive(Debug, Clone)]
struct Foot {
    frame: usize,
    sole: Sole,
    stands: bool,
    /// See [`BalanceInput`].
    bears: f64,
    lifts: bool,
    /// Up in its sensor's axes in this cycle, if it stands.
    up: Option<Vector3<f64>>,
    /// Up in its sensor's axes when it first stood, and its turn against the others when it was put down, rad.
    first_up: Option<Vector3<f64>>,
    put_down: Option<f64>,
    /// Joints between the base and the foot, in the order of the model.
    joints: Vec<usize>,
    /// Its sensor's frame in the base's axes, now and in the desired pose.
    at: Se3,
    desired: Se3,
    /// Twist of the foot in the base's axes for each component of the velocity.
    jacobian: Matrix6xX<f64>,
    /// Its acceleration in the base's axes without any of the joints'.
    bias: Motion,
    /// Wrench of the ground in the base's axes, about its origin.
    wrench: Vector6<f64>,
}

/// What the robot is to do in a cycle; of joints in the order of the model.
#[derive(Debug, Clone, Copy)]
pub struct BalanceInput<'a> {
    /// Newest angles, rad, and velocities, rad/s.
    pub q: &'a [f64],
    /// See `q`.
    pub dq: &'a [f64],
    /// Desired angles, rad, velocities, rad/s, and accelerations, rad/s².
    pub desired: [&'a [f64]; 3],
    /// Up in the axes of each foot's sensor, unit vectors, of the feet on which it stands; none for others.
    pub up: [Option<Vector3<f64>>; MAX_FEET],
    /// Greatest share of the weight that the ground may bear under each of these feet, 0 to 1: below 1 under a foot that
    /// is about to leave the ground, or has just come back to it.
    pub bears: [f64; MAX_FEET],
    /// Feet that are about to leave the ground: the centre of mass is to be over the middle of the others.
    pub lifts: [bool; MAX_FEET],
    /// Offset of the centre of mass from the middle of the soles, forward and to the left as the base stood when it
    /// began, m.
    pub offset: [f64; 2],
    /// Newest angular velocity by the gyroscope, rad/s, in its own axes, where one is sound.
    pub gyro: Option<Vector3<f64>>,
    /// Sample period, s.
    pub dt: f64,
}

/// How the robot stands, seen from above.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Balanced {
    /// The centre of mass from where it is to be in the end, m, along the first sole's axes.
    pub off: [f64; 2],
    /// How far inside the hull of the soles the capture point is, m: where the centre of mass would come to rest over a
    /// foot that is put there (J. Pratt et al., 2006). Outside, no torque brings it back.
    pub depth: f64,
    /// How far inside the soles that stay on the ground, off their edges, the capture point is, m.
    pub reserve: f64,
    /// The accelerations were found.
    pub solved: bool,
}

/// See the module.
#[derive(Debug, Clone)]
pub struct Balance {
    model: Model,
    data: Data,
    feet: Vec<Foot>,
    /// None without a gyroscope.
    roll: Option<Roll>,
    q: Vec<f64>,
    v: Vec<f64>,
    /// Velocities of the joints, low-passed, rad/s.
    dq: Vec<f64>,
    a: Vec<f64>,
    zeros: Vec<f64>,
    bias: Vec<f64>,
    torque: Vec<f64>,
    /// Joints between the base and a foot that stands.
    carries: Vec<bool>,
    equations: LeastSquares,
    led: Option<Led>,
    /// The centre of mass on the floor, and the base's rotation against the desired one, on the feet of these bits.
    center: Option<Observer<2>>,
    turned: Option<Observer<3>>,
    observed_on: u32,
    /// The floor of the last cycle, in the axes of the base.
    floor: Option<Floor>,
    /// Angular acceleration by which torques that are slightly wrong turn the base off, rad/s².
    found: Vector3<f64>,
    gravity: f64,
}

impl Balance {
    /// Balance on feet: the frames of their F/T sensors, and their soles; and the frame of the gyroscope, where there is one.
    /// A model with a fixed base, or without feet, does not balance; of more than four feet the first four count.
    #[must_use]
    pub fn new(model: &Model, feet: &[(usize, Sole)], gyro: Option<usize>) -> Option<Self> {
        let gravity = model.gravity().norm();
        if model.base() != Base::Floating || feet.is_empty() || gravity <= 0.0 {
            return None;
        }
        let mut model = model.clone();
        model.set_gravity(Vector3::zeros());
        let nv = model.nv();
        let foot = |&(frame, sole): &(usize, Sole)| {
            let body = model.frames().get(frame)?.body;
            let joints = model.joints().iter().enumerate();
            let joints = joints.filter(|(_, joint)| model.supports(joint.body, body));
            Some(Foot {
                frame,
                sole,
                stands: false,
                bears: 0.0,
                lifts: false,
                up: None,
                first_up: None,
                put_down: None,
                joints: joints.map(|(j, _)| j).collect(),
                at: Se3::identity(),
                desired: Se3::identity(),
                jacobian: Matrix6xX::zeros(nv),
                bias: Motion::zero(),
                wrench: Vector6::zeros(),
            })
        };
        let feet: Vec<Foot> = feet.iter().take(MAX_FEET).filter_map(foot).collect();
        let mut q = vec![0.0; model.nq()];
        q[6] = 1.0;
        Some(Self {
            data: Data::new(&model),
            feet,
            roll: gyro.map(Roll::new),
            q,
            v: vec![0.0; nv],
            dq: vec![0.0; model.joint_count()],
            a: vec![0.0; nv],
            zeros: vec![0.0; nv],
            bias: vec![0.0; nv],
            torque: vec![0.0; model.joint_count()],
            carries: vec![false; model.joint_count()],
            equations: LeastSquares::new(nv),
            led: None,
            center: None,
            turned: None,
            observed_on: 0,
            floor: None,
            found: Vector3::zeros(),
            gravity,
            model,
        })
    }

    /// It begins anew in the next cycle.
    pub fn restart(&mut self) {
        self.led = None;
        (self.center, self.turned) = (None, None);
        self.floor = None;
        if let Some(roll) = &mut self.roll {
            roll.restart();
        }
        for foot in &mut self.feet {
            (foot.first_up, foot.put_down) = (None, None);
        }
        self.found = Vector3::zeros();
    }

    /// The torques of this cycle, N·m, in the order of the model, and how the robot stands; none on no foot.
    pub fn update(&mut self, input: &BalanceInput<'_>) -> Option<(&[f64], Balanced)> {
        self.smooth(input);
        self.place(input);
        self.roll(input);
        let floor = self.floor()?;
        self.take_along(&floor);
        self.floor = Some(floor);
        self.move_base();
        let up: Vector3<f64> = floor.axes.column(2).into();
        self.set_dynamics(&up);
        let turn = self.turn(input);
        let (task, turn, mut balanced) = self.lead_center(&floor, &turn, input)?;
        self.set_equations(&floor, &task, &turn);
        self.a.fill(0.0);
        self.set_posture(input);
        balanced.solved = self.equations.solve(&mut self.a);
        if !balanced.solved {
            self.a.fill(0.0);
        }
        self.carry();
        Some((&self.torque, balanced))
    }

    /// The wrench of the ground on the sensor of a foot, in the sensor's axes, that the last torques count on.
    #[must_use]
    pub fn wrench(&self, foot: usize) -> Wrench {
        let foot = self.feet.get(foot).filter(|foot| foot.stands);
        foot.map_or(Wrench::default(), |foot| {
            Wrench::from_array(at_sensor(&foot.wrench, &foot.at).to_array())
        })
    }

    /// The joint (in the order of the model) is between the base and a foot that stands.
    #[must_use]
    pub fn carries(&self, joint: usize) -> bool {
        self.carries.get(joint).copied().unwrap_or(false)
    }

    /// Up in the axes of a foot's sensor, and how far the lowest corner of its sole is above the ground, m, by the angles
    /// of the joints and the feet that stand; none before the first update.
    #[must_use]
    pub fn above_ground(&self, foot: usize) -> Option<(Vector3<f64>, f64)> {
        let foot = self.feet.get(foot)?;
        let floor = self.floor.as_ref()?;
        let up: Vector3<f64> = floor.axes.column(2).into();
        let height = |corner: &Vector2<f64>| {
            let own = foot.sole.origin() + foot.sole.axes() * corner.push(0.0);
            up.dot(&(foot.at.act_point(own) - floor.origin))
        };
        let heights = foot.sole.corners().iter().map(height);
        let lowest = heights.fold(f64::INFINITY, f64::min);
        Some((foot.at.rotation.tr_mul(&up), lowest))
    }

    /// The joint (in the order of the model) is between the base and that foot.
    #[must_use]
    pub fn is_of(&self, joint: usize, foot: usize) -> bool {
        let foot = self.feet.get(foot);
        foot.is_some_and(|foot| foot.joints.contains(&joint))
    }

    fn smooth(&mut self, input: &BalanceInput<'_>) {
        let step = SMOOTH * input.dt;
        let share = if self.led.is_none() {
            1.0
        } else {
            step / (1.0 + step)
        };
        for (own, dq) in self.dq.iter_mut().zip(input.dq) {
            *own += share * (dq - *own);
        }
    }

    /// Frequency of the observers on the feet that stand, rad/s.
    fn observes(&self) -> f64 {
        if self.feet.iter().filter(|foot| foot.stands).count() > 1 {
            OBSERVES
        } else {
            OBSERVES_ON_ONE_FOOT
        }
    }

    /// Places the feet, in the desired pose and now, in the axes of the base.
    fn place(&mut self, input: &BalanceInput<'_>) {
        self.carries.fill(false);
        for (k, foot) in self.feet.iter_mut().enumerate() {
            foot.stands = input.up.get(k).is_some_and(Option::is_some);
            foot.bears = input
                .bears
                .get(k)
                .map_or(0.0, |bears| bears.clamp(0.0, 1.0));
            foot.lifts = input.lifts.get(k).copied().unwrap_or(false);
            foot.wrench = Vector6::zeros();
            foot.put_down = foot.put_down.filter(|_| foot.stands);
            for &joint in foot.joints.iter().filter(|_| foot.stands) {
                if let Some(carries) = self.carries.get_mut(joint) {
                    *carries = true;
                }
            }
        }
        for (k, pose) in [input.desired[0], input.q].into_iter().enumerate() {
            copy(self.q.iter_mut().skip(7), pose);
            forward_kinematics(&self.model, &mut self.data, &self.q);
            for foot in &mut self.feet {
                let at = frame_placement(&self.model, &self.data, foot.frame);
                if k == 0 {
                    foot.desired = at;
                } else {
                    foot.at = at;
                }
            }
        }
        for foot in self.feet.iter_mut().filter(|foot| foot.stands) {
            let (model, world) = (&self.model, ReferenceFrame::World);
            frame_jacobian(model, &self.data, foot.frame, world, &mut foot.jacobian);
        }
    }

    /// Up in the axes of the base.
    fn up(&self) -> Option<Vector3<f64>> {
        let feet = self.feet.iter();
        let up = feet.filter_map(|foot| foot.up.as_ref().map(|up| foot.at.rotation * up));
        up.sum::<Vector3<f64>>().try_normalize(0.1)
    }

    /// The floor in the axes of the base.
    fn floor(&self) -> Option<Floor> {
        let up = self.up()?;
        let first = self.feet.iter().position(|foot| foot.stands)?;
        self.floor_of(first, &up)
    }

    /// The floor as a foot has it.
    fn floor_of(&self, foot: usize, up: &Vector3<f64>) -> Option<Floor> {
        let own = self.feet.get(foot)?;
        Floor::under(foot, &own.sole, &own.at, up)
    }

    /// The velocity of the base: the mean of those with which each foot stands still.
    fn move_base(&mut self) {
        let mut base = Vector6::zeros();
        let mut feet = 0.0;
        for foot in self.feet.iter().filter(|foot| foot.stands) {
            for (column, dq) in foot.jacobian.column_iter().skip(6).zip(&self.dq) {
                base -= column * *dq;
            }
            feet += 1.0;
        }
        base /= f64::max(feet, 1.0);
        copy(&mut self.v, base.iter().chain(&self.dq));
    }

    /// Mass matrix, what gravity and velocities make, and the feet's accelerations without any of the joints'.
    fn set_dynamics(&mut self, up: &Vector3<f64>) {
        forward_kinematics_acceleration(&self.model, &mut self.data, &self.q, &self.v, &self.zeros);
        for foot in self.feet.iter_mut().filter(|foot| foot.stands) {
            let world = ReferenceFrame::World;
            foot.bias = frame_acceleration(&self.model, &self.data, foot.frame, world);
        }
        self.a.fill(0.0);
        for (a, up) in self.a.iter_mut().zip(up.iter()) {
            *a = self.gravity * up;
        }
        let bias = rnea(&self.model, &mut self.data, &self.q, &self.v, &self.a, None);
        copy(&mut self.bias, bias);
        crba(&self.model, &mut self.data, &self.q);
    }

    /// Feet stand still, the centre of mass is accelerated so, the base turns back.
    fn set_equations(&mut self, floor: &Floor, task: &Vector2<f64>, turn: &Vector3<f64>) {
        let [carrying, besides, of_base] = WEIGHTS;
        let (base, joints) = (self.equations.inverse_weights).split_at_mut(6);
        base.fill(1.0 / of_base);
        for (inverse, carries) in joints.iter_mut().zip(&self.carries) {
            *inverse = 1.0 / if *carries { carrying } else { besides };
        }
        let [still, center, softly] = SOFTNESS;
        self.equations.clear();
        for foot in self.feet.iter().filter(|foot| foot.stands) {
            let rows = foot.jacobian.row_iter();
            for (row, bias) in rows.zip(foot.bias.to_array()) {
                let own = self.equations.equation(-bias, still);
                own.iter_mut().zip(row.iter()).for_each(|(x, j)| *x = *j);
            }
        }
        let m = self.data.mass_matrix();
        let mass = m[(0, 0)];
        for (axis, wanted) in floor.axes.column_iter().zip(task.iter()) {
            let along = |momentum: &[f64]| -> f64 {
                let products = momentum.iter().zip(axis.iter()).map(|(p, t)| p * t);
                products.sum::<f64>() / mass
            };
            let bias = along(self.bias.get(..3).unwrap_or_default());
            let row = self.equations.equation(wanted - bias, center);
            for (x, column) in row.iter_mut().zip(m.column_iter()) {
                *x = along(&[column[0], column[1], column[2]]);
            }
        }
        for (k, wanted) in turn.iter().enumerate() {
            let row = self.equations.equation(*wanted, softly);
            if let Some(x) = row.get_mut(3 + k) {
                *x = 1.0;
            }
        }
    }

    /// The accelerations that the joints would have by their posture alone; those that springs hold, by their reference.
    fn set_posture(&mut self, input: &BalanceInput<'_>) {
        let [q_d, dq_d, ddq_d] = input.desired;
        let at = |x: &[f64], j: usize| x.get(j).copied().unwrap_or(0.0);
        for (j, (a, carries)) in self.a.iter_mut().skip(6).zip(&self.carries).enumerate() {
            let mut wanted = at(ddq_d, j);
            if *carries {
                wanted += POSTURE * POSTURE * (at(q_d, j) - at(input.q, j))
                    + 2.0 * POSTURE * (at(dq_d, j) - at(&self.dq, j));
            }
            *a = wanted.clamp(-MOST_TURN, MOST_TURN);
        }
    }

    /// The ground's wrenches and the torques at these accelerations.
    fn carry(&mut self) {
        let m = self.data.mass_matrix();
        let row = |k: usize, bias: f64| {
            // Symmetric: a column is a row.
            let products = m.column(k).into_iter().zip(&self.a).map(|(m, a)| m * a);
            bias + products.sum::<f64>()
        };
        let bias = |k: usize| self.bias.get(k).copied().unwrap_or(0.0);
        let total = Vector6::from_fn(|k, _| row(k, bias(k)));
        for (j, torque) in self.torque.iter_mut().enumerate() {
            *torque = row(6 + j, bias(6 + j));
        }
        let mut feet = [None; MAX_FEET];
        for (place, foot) in feet.iter_mut().zip(&self.feet) {
            let at = foot.at;
            *place = foot.stands.then_some(Sharing {
                sole: &foot.sole,
                at,
                bears: foot.bears,
                least: foot.least(),
            });
        }
        let wrenches = share(&total, &feet);
        for (foot, wrench) in self.feet.iter_mut().zip(wrenches) {
            foot.wrench = wrench;
            //= D12: tau = M ddq + h - J^T f
            for &j in foot.joints.iter().filter(|_| foot.stands) {
                if let Some(torque) = self.torque.get_mut(j) {
                    *torque -= foot.jacobian.column(6 + j).dot(&wrench);
                }
            }
        }
    }
}

/// A rotation by a small angle as a vector, rad.
fn small_turn(rotation: &Matrix3<f64>) -> Vector3<f64> {
    let r = rotation;
    0.5 * Vector3::new(r.m32 - r.m23, r.m13 - r.m31, r.m21 - r.m12)
}
