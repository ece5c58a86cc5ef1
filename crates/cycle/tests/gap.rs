//! The loop leaves out ten cycles in motion: the drives brake at set-points that stand, and no joint's torque then
//! changes faster than by that.

use crate::common;

use common::motion::state;
use common::{Bench, client_input, read};
use robot_state::{JointKind, Reference, RobotState};
use std::f64::consts::PI;

/// Cycles in motion before the gap, and left out.
const BEFORE: usize = 380;
const GAP: usize = 10;
/// Cycles over which a step is taken, and which are looked at from the gap on.
const STEP: usize = 5;
const OBSERVED: usize = 300;

/// A robot in motion, 0.25 rad at 0.5 Hz.
struct Moving {
    bench: Bench,
    reference: Reference,
    q_0: Vec<f64>,
    ways: Vec<f64>,
    /// True torques and velocities of all joints, a row for each cycle.
    rows: Vec<Vec<[f64; 2]>>,
}

impl Moving {
    fn new(robot: &str, seed: u64) -> Self {
        let reseeded = |path: &str| {
            let text = read(path)?;
            let seed = format!("seed = {seed}");
            Ok(if path.ends_with("sim.toml") {
                text.replacen("seed = 1", &seed, 1)
            } else {
                text
            })
        };
        let mut bench = Bench::reading(robot, &reseeded);
        let reference = bench.follow();
        let joints = &bench.robot.parameters.joints;
        let ways = joints.iter().map(|joint| match joint.kind {
            JointKind::Revolute => 0.125,
            JointKind::Prismatic => 0.1 * joint.limits.velocity / PI,
        });
        Self {
            ways: ways.collect(),
            q_0: reference.joints.iter().map(|j| j.q_d).collect(),
            bench,
            reference,
            rows: Vec::new(),
        }
    }

    /// One cycle; the loop runs in it or not.
    fn step(&mut self, runs: bool) {
        let (w, t) = (PI, 1e-3 * self.rows.len() as f64);
        let joints = self.reference.joints.iter_mut();
        for ((joint, q_0), way) in joints.zip(&self.q_0).zip(&self.ways) {
            joint.q_d = q_0 + way * (1.0 - (w * t).cos());
            joint.dq_d = way * w * (w * t).sin();
            joint.ddq_d = way * w * w * (w * t).cos();
        }
        self.reference.sequence += 1;
        self.bench.gather();
        if runs {
            self.bench.compute(&client_input(&self.reference));
        }
        let truth = self.bench.plant.truth();
        (self.rows).push(truth.joints.iter().map(|j| [j.tau, j.dq]).collect());
    }

    fn run(mut self, runs: impl Fn(usize) -> bool) -> Self {
        (0..BEFORE + OBSERVED).for_each(|k| self.step(runs(k)));
        self
    }

    /// Greatest change of a torque within 5 ms, share of the joint's limit, beyond what it does without the gap.
    fn step_share(&self, without: &Self) -> f64 {
        let joints = &self.bench.robot.parameters.joints;
        let mut most = 0.0_f64;
        for k in BEFORE..self.rows.len() {
            for (j, joint) in joints.iter().enumerate() {
                let change = |rows: &[Vec<[f64; 2]>]| rows[k][j][0] - rows[k - STEP][j][0];
                let change = change(&self.rows) - change(&without.rows);
                most = most.max(change.abs() / joint.limits.torque);
            }
        }
        most
    }

    /// Greatest share of a velocity limit by which a joint is faster than ever without the gap.
    fn faster(&self, without: &Self) -> f64 {
        let joints = &self.bench.robot.parameters.joints;
        let of = |j: usize| {
            let fastest = |rows: &[Vec<[f64; 2]>]| {
                let speeds = rows.iter().skip(BEFORE).map(|row| row[j][1].abs());
                speeds.fold(0.0, f64::max)
            };
            (fastest(&self.rows) - fastest(&without.rows)) / joints[j].limits.velocity
        };
        (0..joints.len()).map(of).fold(0.0, f64::max)
    }
}

#[test]
fn the_loop_returns_without_a_greater_step_than_the_drives_made() {
    for (robot, seed) in [("leg", 2), ("leg", 3), ("lift-gripper", 4)] {
        let without = Moving::new(robot, seed).run(|_| true);
        let alone = Moving::new(robot, seed).run(|k| k < BEFORE);
        let returns = Moving::new(robot, seed).run(|k| !(BEFORE..BEFORE + GAP).contains(&k));
        let record = returns.bench.cycle.record();
        assert_eq!(
            (state(record), record.fault),
            (RobotState::Active, 0),
            "{robot}"
        );
        let [alone, step] = [&alone, &returns].map(|run| run.step_share(&without));
        assert!(alone > 0.05, "{robot}: {alone}");
        assert!(step <= 1.02 * alone, "{robot}, {seed}: {step} and {alone}");
        let faster = returns.faster(&without);
        assert!(faster < 0.1, "{robot}, {seed}: {faster}");
    }
}
