//! The cycle and a simulated robot in lock-step, frame by frame, with a fault between them.

use can_codec::{Frame, Frames, MAX_FRAMES};
use cycle::{ClientInput, Cycle, Instants, OperatorRequest, Stamp};
use plant::CanRobot;
use problem::Problem;
use robot_config::{Robot, slots};
use robot_state::{
    CommanderRecord, CycleRecord, Event, FrameReference, JointReference, Mode, Reference,
    RobotState, Settings, frame_flags, torque_flags,
};

use crate::digest::Digest;
use crate::robots::Prepared;

/// Time between cycles, ns.
const PERIOD_NS: u64 = 1_000_000;
/// Time in which a drive that is in order takes a step of its states, s.
const STEP_TIME_S: f64 = 2e-3;

/// The places of one cycle at which a fault may act.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum At {
    /// Before SYNC leaves: the robot itself, the clock, cycles that are left out.
    Before,
    /// The answers in `rx` have not reached the loop yet.
    Answers,
    /// The client's input has not been read yet.
    Client,
    /// The commands in `sent` have not reached the robot yet.
    Commands,
}

/// Acts in every cycle from the fault's first one, number 0, on.
pub type Fault = Box<dyn FnMut(At, &mut Rig, usize)>;

/// The client, its own view of one cycle.
#[derive(Debug, Clone)]
pub struct Client {
    /// The newest reference.
    pub reference: Reference,
    /// It sends references.
    pub speaks: bool,
    /// Age of the newest one, s.
    pub age_s: f64,
    /// An operator's request in this cycle.
    pub request: Option<OperatorRequest>,
    /// Settings.
    pub settings: Option<Settings>,
}

/// The loop and the robot.
pub struct Rig {
    /// The configuration.
    pub robot: Robot,
    /// The loop's computation.
    pub cycle: Cycle,
    /// The simulated robot.
    pub plant: CanRobot,
    /// The loop's clock at SYNC, ns.
    pub now: u64,
    /// Answers of this cycle.
    pub rx: Vec<Frame>,
    /// Commands of this cycle on their way to the robot.
    pub sent: Vec<Frame>,
    /// The client.
    pub client: Client,
    /// Time from SYNC to the computation in this cycle, ns.
    pub late_ns: u64,
    /// The loop does not run in this cycle: answers are lost, and no command leaves.
    pub asleep: bool,
    /// The loop does not compute in this cycle: the last set-points are repeated.
    pub frozen: bool,
    /// All records and commands so far.
    pub digest: Digest,
    sync: Frames,
    received: Frames,
    computed: Frames,
}

impl Rig {
    /// A robot that has just been switched on.
    ///
    /// # Errors
    /// A robot that the cycle cannot run.
    pub fn new(prepared: &Prepared) -> Result<Self, Problem> {
        Self::before(prepared, &prepared.plant)
    }

    /// The same, its first frame held by something stiff, if it has one.
    ///
    /// # Errors
    /// A robot that the cycle cannot run.
    pub fn clamped(prepared: &Prepared) -> Result<Self, Problem> {
        Self::before(
            prepared,
            prepared.clamped.as_ref().unwrap_or(&prepared.plant),
        )
    }

    fn before(prepared: &Prepared, plant: &CanRobot) -> Result<Self, Problem> {
        let mut sync = Frames::default();
        for frame in &prepared.robot.sync {
            sync.push(*frame);
        }
        Ok(Self {
            cycle: Cycle::new(&prepared.robot)?,
            robot: prepared.robot.clone(),
            plant: plant.clone(),
            now: 1_000_000_000,
            rx: Vec::new(),
            sent: Vec::new(),
            client: Client {
                reference: Reference::default(),
                speaks: false,
                age_s: 0.001,
                request: None,
                settings: None,
            },
            late_ns: 0,
            asleep: false,
            frozen: false,
            digest: Digest::default(),
            sync,
            received: Frames::new(MAX_FRAMES),
            computed: Frames::new(MAX_FRAMES),
        })
    }

    /// One cycle, the fault's `k`-th if there is one.
    pub fn step(&mut self, fault: Option<(&mut Fault, usize)>) -> &CycleRecord {
        let mut none: Fault = Box::new(|_, _, _| {});
        let (act, k) = fault.unwrap_or((&mut none, 0));
        (self.late_ns, self.asleep) = (0, false);
        act(At::Before, self, k);
        self.answer();
        if self.asleep {
            // The client goes on.
            self.rx.clear();
            self.client.reference.sequence += 1;
            act(At::Client, self, k);
            return self.cycle.record();
        }
        act(At::Answers, self, k);
        (self.client.age_s, self.client.request) = (0.001, None);
        self.client.reference.sequence += 1;
        act(At::Client, self, k);
        if !self.frozen {
            self.compute();
        }
        act(At::Commands, self, k);
        self.deliver();
        self.cycle.record()
    }

    fn answer(&mut self) {
        self.now += PERIOD_NS;
        self.received.clear();
        self.plant
            .exchange(&self.sync, self.now, &mut self.received);
        self.rx.clear();
        self.rx.extend(self.received.iter());
    }

    fn compute(&mut self) {
        self.received.clear();
        for frame in &self.rx {
            self.received.push(*frame);
        }
        self.computed.clear();
        let at = Instants {
            sync: Stamp(self.now),
            now: Stamp(self.now + self.late_ns),
        };
        let client = ClientInput {
            reference: self.client.speaks.then_some(&self.client.reference),
            age_s: self.client.age_s,
            commander: CommanderRecord::default(),
            settings: self.client.settings.as_ref(),
            request: self.client.request,
        };
        let record = self
            .cycle
            .step(at, &self.received, &client, &mut self.computed);
        self.digest.take_record(record);
        self.digest.take_frames(&self.computed);
        self.sent.clear();
        self.sent.extend(self.computed.iter());
    }

    fn deliver(&mut self) {
        let mut heard = Frames::new(MAX_FRAMES);
        for frame in &self.sent {
            heard.push(*frame);
        }
        let mut answers = Frames::default();
        self.plant.exchange(&heard, self.now, &mut answers);
    }

    /// Drives that refuse to be enabled, or are slow, do so no more.
    pub fn mend_drives(&mut self) {
        for joint in 0..self.robot.parameters.joints.len() {
            if let Some(states) = self.plant.drive_states(joint) {
                states.set_refuses(false);
                states.set_step_time(STEP_TIME_S);
            }
        }
    }

    /// Cycles without a client.
    pub fn run(&mut self, cycles: usize) {
        (0..cycles).for_each(|_| _ = self.step(None));
    }

    /// One cycle with an operator's request.
    pub fn ask(&mut self, request: OperatorRequest) -> CycleRecord {
        let mut fault: Fault = Box::new(move |at, rig, _| {
            if at == At::Client {
                rig.client.request = Some(request);
            }
        });
        *self.step(Some((&mut fault, 0)))
    }

    /// The client asks for `mode` where the robot stands, with the torques that it carries, from the
    /// next cycle on.
    pub fn follow(&mut self, mode: Mode) {
        let record = self.cycle.record();
        let mut reference = Reference {
            sequence: self.client.reference.sequence + 1,
            mode: mode.number(),
            joint_count: record.joint_count,
            ..Reference::default()
        };
        let by_sensors = self.robot.parameters.torque_law.uses_sensors();
        for (j, desired) in reference.joints.iter_mut().enumerate() {
            let torques = &record.estimated.joints[j];
            let tau = if by_sensors {
                &torques.tau_whole_body
            } else {
                &torques.tau_encoder
            };
            let valid = tau.flags & torque_flags::VALID != 0;
            *desired = JointReference {
                q_d: record.measured.joints[j].q,
                tau_d: if valid { tau.tau } else { 0.0 },
                ..JointReference::default()
            };
        }
        if mode == Mode::Cartesian {
            reference.frames[0] = self.frame();
        }
        (self.client.reference, self.client.speaks) = (reference, true);
    }

    /// The first frame where it is, with springs of some stiffness; of one that is not shown yet, what
    /// makes the loop show it.
    #[must_use]
    pub fn frame(&self) -> FrameReference {
        let shown = &self.cycle.record().commanded.frames[0];
        let mut asked = FrameReference {
            orientation: [1.0, 0.0, 0.0, 0.0],
            damping_ratio: 1.0,
            used: 1,
            ..FrameReference::default()
        };
        let frames = &self.robot.parameters.frames;
        if let Some(frame) = frames
            .first()
            .filter(|_| shown.flags & frame_flags::VALID != 0)
        {
            (asked.position, asked.orientation) = (shown.position, shown.orientation);
            asked.stiffness = std::array::from_fn(|axis| 0.6 * frame.limits.stiffness[axis / 3]);
        }
        asked
    }

    /// The client asks for the same with a force instead of springs: the environment's on the frame, N, in
    /// the base's axes.
    pub fn press(&mut self, force: [f64; 3]) {
        let asked = &mut self.client.reference.frames[0];
        asked.stiffness[..3].fill(0.0);
        asked.force[..3].copy_from_slice(&force);
        asked.force_axes = 0b111;
    }

    /// The state of the robot.
    #[must_use]
    pub fn state(&self) -> RobotState {
        RobotState::from_number(self.cycle.record().state).unwrap_or(RobotState::Fault)
    }

    /// Number of events of one kind so far.
    #[must_use]
    pub fn count(&self, event: Event) -> u64 {
        self.cycle.record().events[event.index()]
    }

    /// Changes the received values in every answer that carries the slot for which `is_its` is true.
    pub fn spoil(&mut self, is_its: impl Fn(usize) -> bool, change: impl Fn(&mut [f64])) {
        let table = &self.robot.receive;
        let mut values = vec![0.0; slots::receive_len(&self.robot.parameters)];
        for frame in &mut self.rx {
            let Ok(Some(message)) = table.decode(frame, &mut values) else {
                continue;
            };
            if table.slots(message).any(&is_its) {
                let stamp_ns = frame.stamp_ns;
                change(&mut values);
                assert!(
                    table.encode(message, &values, frame),
                    "a value that no frame can carry"
                );
                frame.stamp_ns = stamp_ns;
            }
        }
    }

    /// The answers carry a slot for which `is_its` is true.
    #[must_use]
    pub fn carries(&self, frame: &Frame, is_its: impl Fn(usize) -> bool) -> bool {
        let table = &self.robot.receive;
        let message = table.classify(frame);
        message.is_some_and(|message| table.slots(message).any(is_its))
    }

    /// Loses the answers that carry a slot for which `is_its` is true; they are returned.
    pub fn lose(&mut self, is_its: impl Fn(usize) -> bool) -> Vec<Frame> {
        let all = std::mem::take(&mut self.rx);
        let (lost, kept) = (all.into_iter()).partition(|frame| self.carries(frame, &is_its));
        self.rx = kept;
        lost
    }

    /// Changes the sent values in every command that carries a slot for which `is_its` is true.
    pub fn alter(&mut self, is_its: impl Fn(usize) -> bool, change: impl Fn(&mut [f64])) {
        let table = &self.robot.send;
        let mut values = vec![0.0; slots::send_len(&self.robot.parameters)];
        for frame in &mut self.sent {
            let Ok(Some(message)) = table.decode(frame, &mut values) else {
                continue;
            };
            if table.slots(message).any(&is_its) {
                change(&mut values);
                assert!(
                    table.encode(message, &values, frame),
                    "a value that no frame can carry"
                );
            }
        }
    }
}
