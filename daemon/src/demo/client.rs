//! The demo's references, cycle by cycle, in place of a client's.

use robot_config::Robot;
use robot_state::{Mode, Reference, RobotState, SharedRecord, measured_flags};
use supervisor::OperatorRequest;

use super::motion::{Motion, MotionMode};
use super::stance::Stance;

/// Requests the demo's motion, in its mode, once the robot is ready.
#[derive(Debug)]
pub struct DemoClient {
    motion: Motion,
    stance: Option<Stance>,
    model_index: Vec<usize>,
    ft_names: Vec<String>,
    sample_period: f64,
    /// Cycles since the motion began; none before.
    cycle: Option<u64>,
    q_model: Vec<f64>,
    reference: Reference,
    /// An operator has to enable the robot, and has not been asked to yet.
    to_enable: bool,
    /// The same, and the motion waits for it.
    by_operator: bool,
    request: Option<OperatorRequest>,
}

impl DemoClient {
    /// A client of this robot.
    #[must_use]
    pub fn new(robot: &Robot, motion: Motion) -> Self {
        let parameters = &robot.parameters;
        let feet: Vec<(usize, usize)> = parameters
            .ft_sensors
            .iter()
            .enumerate()
            .filter(|(_, ft)| motion.stance.contains(&ft.sensor.name))
            .filter_map(|(s, ft)| Some((s, robot.model.frame_index(&ft.sensor.frame)?)))
            .collect();
        Self {
            stance: (!feet.is_empty()).then(|| Stance::new(&robot.model, feet)),
            model_index: parameters.joints.iter().map(|j| j.model_index).collect(),
            ft_names: parameters
                .ft_sensors
                .iter()
                .map(|ft| ft.sensor.name.clone())
                .collect(),
            sample_period: parameters.timing.sample_period,
            cycle: None,
            q_model: vec![0.0; robot.model.joint_count()],
            reference: Reference {
                mode: Mode::Hold.number(),
                joint_count: parameters.joints.len() as u32,
                contact_wrench_given: u32::from(motion.mode == MotionMode::InverseDynamics),
                ..Reference::default()
            },
            to_enable: !parameters.safety.automatic,
            by_operator: !parameters.safety.automatic,
            request: None,
            motion,
        }
    }

    /// The operator's request of the coming cycle: a simulated robot has nobody else to enable it.
    #[must_use]
    pub fn request(&self) -> Option<OperatorRequest> {
        self.request
    }

    /// Input of the coming cycle.
    #[must_use]
    pub fn reference(&self) -> &Reference {
        &self.reference
    }

    /// Reads the last cycle and prepares the next reference.
    pub fn observe(&mut self, record: &SharedRecord) {
        let n = self.model_index.len();
        let joints = &record.cycle.measured.joints[..n];
        let unready = measured_flags::NEVER | measured_flags::SETTLING;
        let settled = joints.iter().all(|j| j.flags & unready == 0);
        let state = RobotState::from_number(record.cycle.state);
        let enable = self.to_enable && settled && state == Some(RobotState::Ready);
        self.to_enable &= !enable;
        self.request = enable.then_some(OperatorRequest::Enable);
        let held = matches!(state, Some(RobotState::Holding | RobotState::Active));
        let ready = settled && (held || !self.by_operator);
        let Some(cycle) = self.cycle else {
            if ready {
                // The motion starts from the robot's present pose.
                let start: Vec<f64> = joints.iter().map(|j| j.q).collect();
                self.motion.start_from(&start);
                self.cycle = Some(0);
            }
            return;
        };
        let t = cycle as f64 * self.sample_period;
        self.cycle = Some(cycle + 1);
        self.reference.sequence += 1;
        let mode = match self.motion.mode {
            MotionMode::InverseDynamics => Mode::InverseDynamics,
            // Until F/T sensors have shown for a while which feet bear the robot, the daemon refuses to stand on them.
            MotionMode::Stand if t < self.motion.settle_s => Mode::Hold,
            MotionMode::Stand => Mode::Stand,
        };
        self.reference.mode = mode.number();
        for (j, &place) in self.model_index.iter().enumerate() {
            self.reference.joints[j] = self.motion.at(j, t);
            self.q_model[place] = self.reference.joints[j].q_d;
        }
        if let Some(stance) = &mut self.stance {
            stance.wrenches(&self.q_model, &mut self.reference.contact_wrench);
            for (wrench, name) in self.reference.contact_wrench.iter_mut().zip(&self.ft_names) {
                wrench.torque[2] += self.motion.contact_torque(name, t);
            }
        }
    }
}
