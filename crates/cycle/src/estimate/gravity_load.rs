//! Gravity load: the torques that carry the joints' weight, and what loads the robot besides its own mass.
//!
//! In: proper acceleration of the root, contact wrenches, angles. Out: the loads of some time ago, and the torques of
//! the model at rest under them where both encoders showed the joints last.
//!
//! A sensor is found to have failed some time after it did. What a reaction to it relies on must be
//! older: gravity in the axes of the base (IMU) and the contact wrenches (F/T sensors) are means over
//! blocks of time, of which the last but one counts. Nothing is added while a sensor or a joint is
//! known not to be sound.

use control::InverseDynamics;
use dynamics::Motion;
use robot_config::{JointParameters, Robot};
use robot_state::{EstimatedRecord, MAX_FT_SENSORS, MeasuredRecord, Wrench, measured_flags};

/// Length of a block, s: what counts is 0.1 to 0.3 s old, so that a fault that is found within 0.1 s is not in it.
const BLOCK: f64 = 0.1;
/// Signals with one of these say nothing about loads.
const UNSOUND: u32 = measured_flags::NEVER
    | measured_flags::MISSED
    | measured_flags::JUMP
    | measured_flags::STALE
    | measured_flags::SETTLING
    | measured_flags::IMPLAUSIBLE
    | measured_flags::FLAT
    | measured_flags::SATURATED;

/// Every joint and sensor of this cycle is sound.
fn is_sound(measured: &MeasuredRecord) -> bool {
    // Places that the robot does not use have no flags.
    let joints = measured
        .joints
        .iter()
        .fold(0, |all, joint| all | joint.flags);
    let sensors = (measured.ft.iter()).fold(measured.imu.flags, |all, ft| all | ft.flags);
    // A sensor with a clock of its own misses cycles rightly.
    (joints | sensors & !measured_flags::MISSED) & UNSOUND == 0
}

/// Proper acceleration of the root, m/s², and the contact wrench at each F/T sensor.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Loads {
    pub(crate) acceleration: [f64; 3],
    pub(crate) contact: [Wrench; MAX_FT_SENSORS],
}

impl Loads {
    /// `self + share other`.
    fn plus(&self, other: &Self, share: f64) -> Self {
        let wrench = |s: usize| {
            let (a, b) = (self.contact[s].to_array(), other.contact[s].to_array());
            Wrench::from_array(std::array::from_fn(|i| a[i] + share * b[i]))
        };
        let (a, b) = (self.acceleration, other.acceleration);
        Self {
            acceleration: std::array::from_fn(|i| a[i] + share * b[i]),
            contact: std::array::from_fn(wrench),
        }
    }
}

/// The loads over the last blocks.
#[derive(Debug, Default)]
struct Past {
    cycles_of_block: u32,
    cycles: u32,
    now: Loads,
    sum: Loads,
    /// Means of the last block and of the one before.
    blocks: [Option<Loads>; 2],
}

impl Past {
    fn new(sample_period: f64) -> Self {
        Self {
            cycles_of_block: (BLOCK / sample_period).ceil().max(1.0) as u32,
            ..Self::default()
        }
    }

    fn update(&mut self, now: Loads, sound: bool) {
        self.now = now;
        if !sound {
            return;
        }
        self.sum = self.sum.plus(&now, 1.0);
        self.cycles += 1;
        if self.cycles >= self.cycles_of_block {
            let mean = Loads::default().plus(&self.sum, f64::from(self.cycles).recip());
            self.blocks = [Some(mean), self.blocks[0]];
            (self.sum, self.cycles) = (Loads::default(), 0);
        }
    }

    /// The loads some time ago; after a start the oldest ones known.
    fn loads(&self) -> &Loads {
        let [last, before] = &self.blocks;
        before.as_ref().or(last.as_ref()).unwrap_or(&self.now)
    }
}

#[derive(Debug)]
pub(crate) struct GravityLoad {
    past: Past,
    /// Model of the limbs' weight; none where every drive has a position loop, which carries its joint by itself, and
    /// no drive is watched for its heat.
    model: Option<Model>,
}

/// The robot as rigid bodies at rest.
#[derive(Debug)]
struct Model {
    inverse_dynamics: InverseDynamics,
    /// Place of each joint, in config order, in the model.
    model_index: Vec<usize>,
    q: Vec<f64>,
    still: Vec<f64>,
    /// Torques that carry the joints' weight, N·m, model order.
    torques: Vec<f64>,
}

impl GravityLoad {
    pub(crate) fn new(robot: &Robot) -> Self {
        let p = &robot.parameters;
        // A joint whose drive is hot keeps what carries its weight.
        let needed = |joint: &JointParameters| !joint.takes_position() || joint.thermal.is_some();
        Self {
            past: Past::new(p.timing.sample_period),
            model: p.joints.iter().any(needed).then(|| Model::new(robot)),
        }
    }

    /// What loads the robot besides its own mass, of some time before.
    pub(crate) fn loads(&self) -> &Loads {
        self.past.loads()
    }

    /// The torque that carries a joint's weight, N·m; 0 where nothing asks for it.
    pub(crate) fn torque(&self, joint: usize) -> f64 {
        self.model.as_ref().map_or(0.0, |model| model.torque(joint))
    }

    /// Takes a cycle; `acceleration`: proper acceleration of the root.
    pub(super) fn update(
        &mut self,
        acceleration: &Motion,
        measured: &MeasuredRecord,
        estimated: &EstimatedRecord,
    ) {
        let now = Loads {
            acceleration: acceleration.linear.into(),
            contact: std::array::from_fn(|s| estimated.ft[s].contact_wrench),
        };
        self.past.update(now, is_sound(measured));
        if let Some(model) = &mut self.model {
            model.update(self.past.loads(), measured);
        }
    }
}

impl Model {
    fn new(robot: &Robot) -> Self {
        let parameters = &robot.parameters;
        let frames = parameters.ft_sensors.iter();
        let frames = frames.filter_map(|ft| robot.model.frame_index(&ft.sensor.frame));
        let n = robot.model.joint_count();
        Self {
            inverse_dynamics: InverseDynamics::new(&robot.model, &frames.collect::<Vec<_>>()),
            model_index: parameters.joints.iter().map(|j| j.model_index).collect(),
            q: vec![0.0; n],
            still: vec![0.0; n],
            torques: vec![0.0; n],
        }
    }

    fn torque(&self, joint: usize) -> f64 {
        let place = self.model_index.get(joint);
        let torque = place.and_then(|&place| self.torques.get(place));
        torque.copied().unwrap_or(0.0)
    }

    fn update(&mut self, loads: &Loads, measured: &MeasuredRecord) {
        for (&place, joint) in self.model_index.iter().zip(&measured.joints) {
            if let Some(q) = self.q.get_mut(place) {
                *q = joint.q;
            }
        }
        let at_rest = Motion {
            linear: loads.acceleration.into(),
            ..Motion::zero()
        };
        let base = (Motion::zero(), at_rest);
        (self.inverse_dynamics).set_motion(base, &self.q, &self.still, &self.still);
        let torques = self.inverse_dynamics.torque(&loads.contact);
        for (own, torque) in self.torques.iter_mut().zip(torques) {
            *own = *torque;
        }
    }
}
