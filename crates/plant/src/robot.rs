//! The simulated robot: bodies, drives, surroundings and sensors together.

use crate::articulated::Dynamics;
use crate::contact::{Corner, Harness, Push};
use crate::joint::{DriveReading, DriveSheet, Joint};
use crate::parameters::SimParameters;
use crate::random::Random;
use crate::sampling::{Clock, Clocks, Sent, steps_kept};
use crate::sensors::{FtSensor, Imu};
use crate::tree::{Frame, State, Tree, integrate};
use crate::truth::{ExternalTruth, Truth};
use crate::urdf::Urdf;
use nalgebra::{UnitQuaternion, Vector3, Vector6};
use robot_config::slots::Source;
use robot_state::Wrench;

/// A joint as its user knows it.
#[derive(Debug, Clone)]
pub struct JointPlan {
    /// The joint's name in the URDF.
    pub name: String,
    /// The kind of drive, `[drive.NAME]` in `sim.toml`.
    pub drive: String,
    /// The drive's data sheet.
    pub sheet: DriveSheet,
}

/// The robot as its user knows it.
#[derive(Debug, Clone)]
pub struct Plan {
    /// Whether the base moves freely.
    pub floating: bool,
    /// Joints in the user's order.
    pub joints: Vec<JointPlan>,
    /// Frames of the F/T sensors.
    pub ft_sensors: Vec<String>,
    /// Frame of the IMU.
    pub imu: Option<String>,
    /// Time between two samples of the sensors, s.
    pub period: f64,
}

/// All sensors as last sampled: at the end of a period, or before it by their own clocks.
#[derive(Debug, Clone)]
pub struct Readings {
    /// Drives, in the plan's order.
    pub joints: Vec<DriveReading>,
    /// F/T sensors: the wrench that what lies beyond applies to what lies before.
    pub ft: Vec<Wrench>,
    /// Temperatures of the F/T sensors, °C.
    pub ft_temperature: Vec<f64>,
    /// Gyro, rad/s.
    pub gyro: [f64; 3],
    /// Accelerometer, m/s².
    pub accelerometer: [f64; 3],
    /// Samples of sensors with clocks of their own, up to the next period.
    pub sent: Vec<Sent>,
}

/// The simulated robot.
#[derive(Debug, Clone)]
pub struct SimRobot {
    pub(crate) tree: Tree,
    pub(crate) dynamics: Dynamics,
    pub(crate) state: State,
    /// In the tree's order.
    pub(crate) joints: Vec<Joint>,
    /// The tree's index of each joint of the plan.
    pub(crate) order: Vec<usize>,
    pub(crate) surroundings: Surroundings,
    pub(crate) ft: Vec<FtSensor>,
    pub(crate) imu: Option<Imu>,
    pub(crate) clocks: Clocks,
    pub(crate) dt: f64,
    substeps: usize,
    /// Steps between two turns of each drive's control loop.
    control_every: Vec<u64>,
    steps_done: u64,
    tau: Vec<f64>,
    armature: Vec<f64>,
    pub(crate) ddq: Vec<f64>,
    pub(crate) readings: Readings,
    truth: Truth,
}

/// All that touches the robot.
#[derive(Debug, Clone)]
pub(crate) struct Surroundings {
    pub(crate) ground: Option<crate::parameters::GroundParameters>,
    /// Corners with the foot they belong to.
    pub(crate) corners: Vec<(usize, Corner)>,
    pub(crate) feet: Vec<Frame>,
    pub(crate) harness: Option<(Frame, Harness)>,
    pub(crate) pushes: Vec<(Frame, Push)>,
}

impl SimRobot {
    /// A robot in balance at the pose of `[start]`.
    ///
    /// # Errors
    /// What does not fit together, with the key that says so.
    pub fn new(
        plan: &Plan,
        urdf_text: &str,
        urdf_file: &str,
        sim: &SimParameters,
    ) -> Result<Self, String> {
        let mut urdf = Urdf::parse(urdf_text, urdf_file)?;
        urdf.perturb(sim.inertia_error, &mut Random::new(sim.seed, 1));
        let cuts: Vec<&str> = plan.ft_sensors.iter().map(String::as_str).collect();
        let tree =
            Tree::new(&urdf, plan.floating, &cuts).map_err(|e| format!("{urdf_file}: {e}"))?;
        let (order, joints) = build_joints(plan, &tree, sim)?;
        let mut state = tree.rest();
        place(&mut state, &tree, sim)?;
        let mut dynamics = Dynamics::new(&tree);
        dynamics.kinematics(&tree, &state);
        let surroundings = Surroundings::new(&tree, &dynamics, sim)?;
        let (sensors, imu) = build_sensors(plan, &tree, sim)?;
        let substeps = (plan.period / sim.substep).round().max(1.0) as usize;
        let dt = plan.period / substeps as f64;
        let control_every = joints.iter().map(|j| j.control_every(dt)).collect();
        let n = joints.len();
        let external = surroundings.feet.len()
            + usize::from(surroundings.harness.is_some())
            + surroundings.pushes.len();
        let mut robot = Self {
            readings: Readings {
                joints: vec![
                    DriveReading {
                        theta: 0.0,
                        q: 0.0,
                        current: 0.0,
                        omega: 0.0
                    };
                    n
                ],
                ft: vec![Wrench::default(); sensors.len()],
                ft_temperature: vec![sim.ft_sensor.temperature; sensors.len()],
                gyro: [0.0; 3],
                accelerometer: [0.0; 3],
                sent: Vec::new(),
            },
            truth: Truth::new(n, sensors.len(), external),
            tree,
            dynamics,
            state,
            joints,
            order,
            surroundings,
            ft: sensors,
            imu,
            clocks: Clocks::new(plan, sim),
            dt,
            substeps,
            control_every,
            steps_done: 0,
            tau: vec![0.0; n],
            armature: vec![0.0; n],
            ddq: vec![0.0; n],
        };
        robot.balance(sim)?;
        Ok(robot)
    }

    /// Gives a drive a new set point: rad link side or A. `joint` counts in the plan's order.
    pub fn command(&mut self, joint: usize, set_point: f64) {
        debug_assert!(set_point.is_finite());
        if let Some(&dof) = self.order.get(joint)
            && set_point.is_finite()
        {
            self.joints[dof].command(set_point);
        }
    }

    /// The set point that a drive follows. `joint` counts in the plan's order.
    #[must_use]
    pub fn set_point(&self, joint: usize) -> f64 {
        (self.order.get(joint)).map_or(0.0, |&dof| self.joints[dof].set_point())
    }

    /// Lets one period pass and samples all sensors at its end.
    pub fn advance(&mut self) -> &Readings {
        let start = self.time();
        self.readings.sent.retain(|sent| sent.stamp > start);
        for k in 1..=self.substeps {
            self.step(k == self.substeps);
        }
        &self.readings
    }

    /// Time since the start, s.
    #[must_use]
    pub fn time(&self) -> f64 {
        self.steps_done as f64 * self.dt
    }

    /// The source answers SYNC; others send by their own clocks.
    #[must_use]
    pub fn answers(&self, source: Source) -> bool {
        let clock = match source {
            Source::Imu => Some(&self.clocks.imu),
            Source::Ft(s) => self.clocks.ft.get(s),
            Source::Joint(j) => self.clocks.joints.get(j),
        };
        clock.is_none_or(Clock::at_sync)
    }

    /// The sensors as last sampled.
    #[must_use]
    pub fn readings(&self) -> &Readings {
        &self.readings
    }

    /// What is really so, over the last step of the last period.
    #[must_use]
    pub fn truth(&self) -> &Truth {
        &self.truth
    }

    /// Total mass as it truly is, kg.
    #[must_use]
    pub fn mass(&self) -> f64 {
        self.tree.mass()
    }

    fn step(&mut self, last: bool) {
        let dt = self.dt;
        let time = self.steps_done as f64 * dt;
        self.dynamics.kinematics(&self.tree, &self.state);
        self.surroundings.prepare(&mut self.dynamics, time, dt);
        for (i, joint) in self.joints.iter_mut().enumerate() {
            if self.steps_done.is_multiple_of(self.control_every[i]) {
                joint.control(self.control_every[i] as f64 * dt);
            }
            (self.tau[i], self.armature[i]) = joint.prepare(self.state.q[i], self.state.dq[i], dt);
        }
        let base = (self.dynamics).solve(&self.tree, &self.tau, &self.armature, &mut self.ddq);
        for (i, joint) in self.joints.iter_mut().enumerate() {
            joint.commit(self.state.q[i], self.state.dq[i], self.ddq[i], dt);
        }
        self.surroundings.commit(&mut self.dynamics, dt);
        if last || self.clocks.all_steps {
            self.dynamics.wrenches(&self.tree);
            self.ft.iter_mut().for_each(|ft| ft.feel(&self.dynamics));
            self.imu.iter_mut().for_each(|imu| imu.feel(&self.dynamics));
        }
        if last {
            self.tell_truth(time, &base);
        }
        integrate(&self.tree, &mut self.state, &base, &self.ddq, dt);
        self.steps_done += 1;
        self.sample_own(time);
        if last {
            self.sample(time);
        }
    }

    fn tell_truth(&mut self, time: f64, base: &Vector6<f64>) {
        let truth = &mut self.truth;
        truth.time = time;
        for (t, &dof) in truth.joints.iter_mut().zip(&self.order) {
            *t = self.joints[dof].truth(self.state.q[dof], self.state.dq[dof], self.ddq[dof]);
        }
        truth.set_base(&self.state, base);
        truth.centre_of_mass = self.dynamics.centre_of_mass(&self.tree).into();
        for (wrench, sensor) in truth.ft.iter_mut().zip(&self.ft) {
            *wrench = sensor.truth(&self.dynamics);
        }
        self.surroundings.tell(&self.dynamics, &mut truth.external);
    }
}

impl Surroundings {
    fn new(tree: &Tree, dynamics: &Dynamics, sim: &SimParameters) -> Result<Self, String> {
        let (mut feet, mut corners) = (Vec::new(), Vec::new());
        for (i, foot) in sim.feet.iter().enumerate() {
            let frame = find(tree, &foot.link, "foot.link")?;
            feet.push(frame.clone());
            corners.extend(foot.corners.iter().map(|c| (i, Corner::new(frame, c))));
        }
        let harness = match &sim.harness {
            Some(p) => {
                let frame = find(tree, &p.link, "harness.link")?;
                Some((frame.clone(), Harness::new(p, frame, dynamics)))
            }
            None => None,
        };
        let mut pushes = Vec::new();
        for push in &sim.pushes {
            let frame = find(tree, &push.link, "push.link")?;
            pushes.push((frame.clone(), Push::new(push, frame)));
        }
        Ok(Self {
            ground: sim.ground.clone(),
            corners,
            feet,
            harness,
            pushes,
        })
    }

    pub(crate) fn prepare(&mut self, dynamics: &mut Dynamics, time: f64, dt: f64) {
        if let Some(ground) = &self.ground {
            for (_, corner) in &mut self.corners {
                corner.prepare(ground, dynamics, dt);
            }
        }
        if let Some((_, harness)) = &mut self.harness {
            harness.prepare(dynamics, dt);
        }
        for (_, push) in &mut self.pushes {
            push.prepare(dynamics, time);
        }
    }

    pub(crate) fn commit(&mut self, dynamics: &mut Dynamics, dt: f64) {
        dynamics.clear_external();
        for (_, corner) in &mut self.corners {
            corner.commit(dynamics, dt);
        }
        if let Some((_, harness)) = &mut self.harness {
            harness.commit(dynamics, dt);
        }
        for (_, push) in &self.pushes {
            push.commit(dynamics);
        }
    }

    /// Wrenches from outside at the links' origins in the links' axes: feet, harness, pushes.
    fn tell(&self, dynamics: &Dynamics, external: &mut [ExternalTruth]) {
        let feet = self.feet.iter().enumerate().map(|(i, frame)| {
            let corners = self.corners.iter().filter(move |(foot, _)| *foot == i);
            let sum = corners.fold(Vector6::zeros(), |sum, (_, c)| sum + c.wrench());
            (frame, sum)
        });
        let harness = (self.harness.iter()).map(|(frame, h)| (frame, h.wrench()));
        let pushes = self.pushes.iter().map(|(frame, p)| (frame, p.wrench()));
        for (told, (frame, wrench)) in external.iter_mut().zip(feet.chain(harness).chain(pushes)) {
            told.set(frame, dynamics, &wrench);
        }
    }
}

fn find<'a>(tree: &'a Tree, name: &str, key: &str) -> Result<&'a Frame, String> {
    (tree.frame(name)).ok_or_else(|| format!("{key}: the URDF has no link {name}"))
}

fn build_joints(
    plan: &Plan,
    tree: &Tree,
    sim: &SimParameters,
) -> Result<(Vec<usize>, Vec<Joint>), String> {
    let mut order = Vec::new();
    let mut joints: Vec<Option<Joint>> = vec![None; tree.joint_names().len()];
    for (i, joint) in plan.joints.iter().enumerate() {
        let dof = (tree.joint_names().iter().position(|n| *n == joint.name))
            .ok_or_else(|| format!("joint {}: not a moving joint of the URDF", joint.name))?;
        let drive = sim.drives.get(&joint.drive).ok_or_else(|| {
            let known: Vec<&str> = sim.drives.keys().map(String::as_str).collect();
            format!(
                "drive.{}: missing, joint {} uses it; present: {}",
                joint.drive,
                joint.name,
                known.join(", ")
            )
        })?;
        let random = Random::new(sim.seed, 100 + i as u64);
        joints[dof] = Some(Joint::new(&joint.sheet, drive, random));
        order.push(dof);
    }
    let missing = joints.iter().position(Option::is_none);
    if let Some(dof) = missing {
        let name = &tree.joint_names()[dof];
        return Err(format!("joint {name} of the URDF has no drive"));
    }
    Ok((order, joints.into_iter().flatten().collect()))
}

fn build_sensors(
    plan: &Plan,
    tree: &Tree,
    sim: &SimParameters,
) -> Result<(Vec<FtSensor>, Option<Imu>), String> {
    let sensors = (plan.ft_sensors.iter().zip(2_u64..))
        .map(|(name, stream)| {
            let random = Random::new(sim.seed, stream);
            Ok(FtSensor::new(
                find(tree, name, "ft_sensor.frame")?,
                &sim.ft_sensor,
                random,
                steps_kept(&sim.ft_sensor.sampling, sim),
            ))
        })
        .collect::<Result<Vec<_>, String>>()?;
    let imu = match &plan.imu {
        Some(name) => {
            let random = Random::new(sim.seed, 50);
            let steps = steps_kept(&sim.imu.sampling, sim);
            Some(Imu::new(
                find(tree, name, "imu.frame")?,
                &sim.imu,
                random,
                steps,
            ))
        }
        None => None,
    };
    Ok((sensors, imu))
}

fn place(state: &mut State, tree: &Tree, sim: &SimParameters) -> Result<(), String> {
    state.position = Vector3::from(sim.start.base_position);
    let [roll, pitch, yaw] = sim.start.base_rpy;
    state.orientation = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
    for (name, angle) in &sim.start.joints {
        let dof = (tree.joint_names().iter().position(|n| n == name))
            .ok_or_else(|| format!("start.joints_deg.{name}: no moving joint of the URDF"))?;
        state.q[dof] = *angle;
    }
    Ok(())
}
