//! The simulated robot: bodies, drives, surroundings and sensors together.

mod sampling;
mod start;

use crate::articulated::Dynamics;
use crate::clock::{Clock, Clocks, steps_kept};
use crate::controller::SetPoint;
use crate::drive::{DriveReading, DriveReport, DriveSheet};
use crate::drive_faults::DriveFaults;
use crate::drive_states::DriveStates;
use crate::joint::Joint;
use crate::parameters::SimParameters;
use crate::plan::Plan;
use crate::random::Random;
use crate::readings::Readings;
use crate::sensors::{FtSensor, Imu};
use crate::surroundings::Surroundings;
use crate::transport::OnTheWay;
use crate::tree::{State, Tree, integrate};
use crate::truth::Truth;
use crate::urdf::Urdf;
use nalgebra::{UnitQuaternion, Vector3, Vector6};
use problem::Problem;
use robot_config::slots::Source;
use robot_state::Wrench;

/// First stream of the random numbers by which gears have a past.
const PASTS: u64 = 10_000;

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
    pub(crate) imus: Vec<Imu>,
    pub(crate) clocks: Clocks,
    pub(crate) dt: f64,
    substeps: usize,
    /// Steps in a period of each drive's control loop.
    control_every: Vec<u64>,
    steps_done: u64,
    /// In the tree's order.
    on_the_way: Vec<OnTheWay<SetPoint>>,
    tau: Vec<f64>,
    /// External torque about each joint's axis, between the links that it connects, N·m.
    load: Vec<f64>,
    armature: Vec<f64>,
    pub(crate) ddq: Vec<f64>,
    pub(crate) readings: Readings,
    truth: Truth,
}

impl SimRobot {
    /// A robot in balance at the pose of `[start]`.
    ///
    /// # Errors
    /// Parts that do not fit together, with their key.
    pub fn new(
        plan: &Plan,
        urdf_text: &str,
        urdf_file: &str,
        sim: &SimParameters,
    ) -> Result<Self, Problem> {
        let mut urdf = Urdf::parse(urdf_text, urdf_file)?;
        urdf.perturb(sim.inertia_error, &mut Random::new(sim.seed, 1));
        let cuts: Vec<&str> = plan.ft_sensors.iter().map(String::as_str).collect();
        let tree =
            Tree::new(&urdf, plan.floating, &cuts).map_err(|problem| problem.at(urdf_file, 0))?;
        let (order, joints) = build_joints(plan, &tree, sim)?;
        let mut state = tree.rest();
        place(&mut state, &tree, sim)?;
        let mut dynamics = Dynamics::new(&tree);
        dynamics.kinematics(&tree, &state);
        let surroundings = Surroundings::new(&tree, &dynamics, sim)?;
        let (sensors, imus) = build_sensors(plan, &tree, sim)?;
        let substeps = (plan.period / sim.substep).round().max(1.0) as usize;
        let dt = plan.period / substeps as f64;
        let control_every = joints.iter().map(|j| j.control_every(dt)).collect();
        let (n, moving) = (joints.len(), tree.joint_names().len());
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
                        omega: 0.0,
                        status: 0,
                        report: DriveReport::default(),
                    };
                    n
                ],
                ft: vec![Wrench::default(); sensors.len()],
                ft_temperature: vec![sim.ft_sensor.temperature; sensors.len()],
                imus: vec![[0.0; 6]; imus.len()],
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
            imus,
            clocks: Clocks::new(plan, sim),
            dt,
            substeps,
            control_every,
            steps_done: 0,
            on_the_way: vec![OnTheWay::default(); n],
            tau: vec![0.0; moving],
            load: vec![0.0; n],
            armature: vec![0.0; moving],
            ddq: vec![0.0; moving],
        };
        robot.balance(sim)?;
        Ok(robot)
    }

    /// Sets a drive's set point at once: rad (link side) or A. `joint` counts in the plan's order.
    pub fn command(&mut self, joint: usize, set_point: f64) {
        self.command_after(joint, set_point, 0.0);
    }

    /// The same after a `delay`, s, and not before an earlier set point.
    pub fn command_after(&mut self, joint: usize, set_point: f64, delay: f64) {
        debug_assert!(set_point.is_finite());
        if set_point.is_finite() {
            self.follow_after(joint, SetPoint::Value(set_point), delay);
        }
    }

    /// The same of any set point.
    pub(crate) fn follow_after(&mut self, joint: usize, set_point: SetPoint, delay: f64) {
        if let Some(&dof) = self.order.get(joint) {
            let due = self.steps_done + (delay / self.dt).round() as u64;
            self.on_the_way[dof].send(due, set_point);
            self.receive(dof);
        }
    }

    /// Gives a drive the set points that have arrived.
    fn receive(&mut self, dof: usize) {
        while let Some(set_point) = self.on_the_way[dof].arrive(self.steps_done) {
            self.joints[dof].command(set_point);
        }
    }

    /// The states of a drive, if it has any. `joint` counts in the plan's order.
    #[must_use]
    pub fn drive_states(&mut self, joint: usize) -> Option<&mut DriveStates> {
        let dof = *self.order.get(joint)?;
        self.joints[dof].states()
    }

    /// The data sheet of a joint's drive. `joint` counts in the plan's order.
    pub(crate) fn sheet(&self, joint: usize) -> &DriveSheet {
        self.joints[self.order[joint]].sheet()
    }

    /// The greatest current of a joint's drive, A. `joint` counts in the plan's order.
    pub(crate) fn current_limit(&self, joint: usize) -> f64 {
        self.joints[self.order[joint]].current_limit()
    }

    /// Lowers the greatest current of a joint's drive, A. `joint` counts in the plan's order.
    pub(crate) fn limit_current(&mut self, joint: usize, limit: f64) {
        self.joints[self.order[joint]].limit_current(limit);
    }

    /// Sets the temperature of a drive's winding, °C. `joint` counts in the plan's order.
    pub fn set_temperature(&mut self, joint: usize, temperature: f64) {
        if let Some(&dof) = self.order.get(joint) {
            self.joints[dof].set_temperature(temperature);
        }
    }

    /// What is wrong with a joint's drive, to change it. `joint` counts in the plan's order.
    #[must_use]
    pub fn drive_faults(&mut self, joint: usize) -> Option<&mut DriveFaults> {
        let dof = *self.order.get(joint)?;
        Some(self.joints[dof].faults())
    }

    /// Sets an external torque about a joint's axis between the links that it connects, N·m: a weight
    /// that hangs there, a hand that pushes. It is no part of the true joint torque. `joint` counts in
    /// the plan's order.
    pub fn set_load(&mut self, joint: usize, torque: f64) {
        if let Some(&dof) = self.order.get(joint) {
            self.load[dof] = torque;
        }
    }

    /// The harness, if there is one, lets go: what it held is free from now on.
    pub fn release_harness(&mut self) {
        if let Some((_, harness)) = &mut self.surroundings.harness {
            harness.release();
        }
    }

    /// The teeth of a joint's gear slip by an angle, link side, rad. `joint` counts in the plan's order.
    pub fn slip_gear(&mut self, joint: usize, angle: f64) {
        if let Some(&dof) = self.order.get(joint) {
            self.joints[dof].slip_gear(angle);
        }
    }

    /// An ideal source makes this torque from now on instead of a joint's drive and gear, N·m: what
    /// perfect control of the torque would do. `joint` counts in the plan's order.
    pub fn drive_ideally(&mut self, joint: usize, torque: f64) {
        if let Some(&dof) = self.order.get(joint) {
            self.joints[dof].drive_ideally(torque);
        }
    }

    /// Torque of a joint's motor over the current that its sensor reads, N·m/A. `joint` counts in the
    /// plan's order.
    #[must_use]
    pub fn torque_of_current(&self, joint: usize) -> f64 {
        (self.order.get(joint)).map_or(0.0, |&dof| self.joints[dof].torque_of_current())
    }

    /// The set point that a drive follows. `joint` counts in the plan's order.
    #[must_use]
    pub fn set_point(&self, joint: usize) -> f64 {
        (self.order.get(joint)).map_or(0.0, |&dof| self.joints[dof].set_point())
    }

    /// Advances by one period and samples all sensors at its end.
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

    /// True for a source that answers SYNC; others send by their own clocks.
    #[must_use]
    pub fn answers(&self, source: Source) -> bool {
        let clock = match source {
            Source::Imu(i) => self.clocks.imus.get(i),
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

    /// The true quantities over the last step of the last period.
    #[must_use]
    pub fn truth(&self) -> &Truth {
        &self.truth
    }

    /// True total mass, kg.
    #[must_use]
    pub fn mass(&self) -> f64 {
        self.tree.mass()
    }

    fn step(&mut self, last: bool) {
        let dt = self.dt;
        let time = self.steps_done as f64 * dt;
        self.dynamics.kinematics(&self.tree, &self.state);
        self.surroundings.prepare(&mut self.dynamics, time, dt);
        (0..self.joints.len()).for_each(|dof| self.receive(dof));
        for (i, joint) in self.joints.iter_mut().enumerate() {
            if self.steps_done.is_multiple_of(self.control_every[i]) {
                joint.control(self.control_every[i] as f64 * dt);
            }
            (self.tau[i], self.armature[i]) = joint.prepare(self.state.q[i], self.state.dq[i], dt);
            self.tau[i] += self.load[i];
        }
        let base = (self.dynamics).solve(&self.tree, &self.tau, &self.armature, &mut self.ddq);
        for (i, joint) in self.joints.iter_mut().enumerate() {
            joint.commit(self.state.q[i], self.state.dq[i], self.ddq[i], dt);
        }
        self.surroundings.commit(&mut self.dynamics, dt);
        if last || self.clocks.all_steps {
            self.dynamics.wrenches(&self.tree);
            self.ft.iter_mut().for_each(|ft| ft.record(&self.dynamics));
            self.imus
                .iter_mut()
                .for_each(|imu| imu.record(&self.dynamics));
        }
        if last {
            self.record_truth(time, &base);
        }
        integrate(&self.tree, &mut self.state, &base, &self.ddq, dt);
        self.steps_done += 1;
        self.sample_own(time);
        if last {
            self.sample(time);
        }
    }

    fn record_truth(&mut self, time: f64, base: &Vector6<f64>) {
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
        self.surroundings
            .record(&self.dynamics, &mut truth.external);
    }
}

fn no_joint(place: &str) -> Problem {
    let what = format!("{place}: not a joint of the URDF that moves by itself");
    Problem::new(what, "")
}

fn build_joints(
    plan: &Plan,
    tree: &Tree,
    sim: &SimParameters,
) -> Result<(Vec<usize>, Vec<Joint>), Problem> {
    let mut order = Vec::new();
    let driven = tree.driven_names();
    let mut joints: Vec<Option<Joint>> = vec![None; driven.len()];
    for (i, joint) in plan.joints.iter().enumerate() {
        let dof = (driven.iter().position(|n| *n == joint.name))
            .ok_or_else(|| no_joint(&format!("joint {}", joint.name)))?;
        let drive = sim.drives.get(&joint.drive).ok_or_else(|| {
            let known: Vec<&str> = sim.drives.keys().map(String::as_str).collect();
            let (drive, joint, known) = (&joint.drive, &joint.name, known.join(", "));
            let reason = format!("drive.{drive}: missing, joint {joint} uses it; present: {known}");
            Problem::new(reason, "")
        })?;
        if drive.kind != joint.sheet.kind {
            let what = format!("drive.{}: of {} joints", joint.drive, drive.kind.name());
            let allowed = format!(
                "keys of {} joints, as {}",
                joint.sheet.kind.name(),
                joint.name
            );
            return Err(Problem::new(what, allowed));
        }
        let random = Random::new(sim.seed, 100 + i as u64);
        let past = if sim.start.gear_past {
            Random::new(sim.seed, PASTS + i as u64).symmetric()
        } else {
            0.0
        };
        let made = Joint::new(&joint.sheet, drive, random).with_gear_past(past);
        joints[dof] = Some(if joint.states {
            made.with_states()
        } else {
            made
        });
        order.push(dof);
    }
    let missing = joints.iter().position(Option::is_none);
    if let Some(dof) = missing {
        let name = &driven[dof];
        let reason = format!("joint {name} of the URDF has no drive");
        return Err(Problem::new(reason, ""));
    }
    Ok((order, joints.into_iter().flatten().collect()))
}

fn build_sensors(
    plan: &Plan,
    tree: &Tree,
    sim: &SimParameters,
) -> Result<(Vec<FtSensor>, Vec<Imu>), Problem> {
    let sensors = (plan.ft_sensors.iter().zip(2_u64..))
        .map(|(name, stream)| {
            let random = Random::new(sim.seed, stream);
            Ok(FtSensor::new(
                tree.frame_of("ft_sensor.frame", name)?,
                &sim.ft_sensor,
                random,
                steps_kept(&sim.ft_sensor.sampling, sim),
            ))
        })
        .collect::<Result<Vec<_>, Problem>>()?;
    let imus = (plan.imus.iter().zip(50_u64..))
        .map(|(name, stream)| {
            let random = Random::new(sim.seed, stream);
            let steps = steps_kept(&sim.imu.sampling, sim);
            let frame = tree.frame_of("imu.frame", name)?;
            Ok(Imu::new(frame, &sim.imu, random, steps))
        })
        .collect::<Result<Vec<_>, Problem>>()?;
    Ok((sensors, imus))
}

fn place(state: &mut State, tree: &Tree, sim: &SimParameters) -> Result<(), Problem> {
    state.position = Vector3::from(sim.start.base_position);
    let [roll, pitch, yaw] = sim.start.base_rpy;
    state.orientation = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
    let keys = [
        ("joints_deg", false, &sim.start.joints),
        ("joints_mm", true, &sim.start.ways),
    ];
    for (key, slides, joints) in keys {
        for (name, position) in joints {
            let place = format!("start.{key}.{name}");
            let dof = tree.driven_names().iter().position(|n| n == name);
            let dof = dof.ok_or_else(|| no_joint(&place))?;
            if tree.slides()[dof] != slides {
                let (is, other) = if slides {
                    ("revolute", "joints_deg")
                } else {
                    ("prismatic", "joints_mm")
                };
                let what = format!("{place}: the joint is {is}");
                return Err(Problem::new(what, format!("start.{other}.{name}")));
            }
            state.q[dof] = *position;
        }
    }
    tree.place_followers(state);
    Ok(())
}
