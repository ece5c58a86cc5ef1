//! Margins of mode stand.

use control::margins::{Load, NEEDED, Point, StandingMargins, pendulum, standing};
use robot_config::Robot;
use robot_config::torque_loops::{LoopLaw, TorqueLoop, torque_loops, without_space};
use serde_json::{Value, json};
use std::fmt::Write;
use terminal::TextTable;

/// A body above its soles and stuck in its friction: what the legs of a standing robot have for a link.
const LOADS: [Load; 2] = [Load::Blocked, Load::Stuck];
const TASKS: [&str; 2] = ["centre of mass", "base's angle"];

/// A task of mode stand with the torque loop of the leg's joint that leaves it the least delay.
struct JudgedTask {
    name: &'static str,
    joint: String,
    load: Load,
    margins: StandingMargins,
}

/// Margins of a robot that has mode stand, by task.
pub(super) struct Stands(Vec<JudgedTask>);

/// Judges the tasks of mode stand; nothing of a robot that does not have it.
pub(super) fn judge(robot: &Robot) -> Option<Stands> {
    if robot.cannot_stand().is_some() {
        return None;
    }
    let feet = robot.parameters.ft_sensors.iter();
    let feet: Vec<_> = feet
        .filter_map(|ft| Some((robot.model.frame_index(&ft.sensor.frame)?, ft.sole?)))
        .collect();
    let pendulum = pendulum(&robot.model, &feet)?;
    let of_leg = |joint: usize| {
        let body = robot.model.joints().get(joint).map(|joint| joint.body);
        body.is_some_and(|body| {
            let frames = feet
                .iter()
                .filter_map(|(frame, _)| robot.model.frames().get(*frame));
            frames
                .into_iter()
                .any(|frame| robot.model.supports(body, frame.body))
        })
    };
    let mut tasks: [Option<JudgedTask>; 2] = [None, None];
    for (joint, of_joint) in robot.parameters.joints.iter().zip(torque_loops(robot)) {
        for load in LOADS.into_iter().filter(|_| of_leg(joint.model_index)) {
            let all = standing(pendulum, &response(&of_joint, load));
            for ((task, margins), name) in tasks.iter_mut().zip(all).zip(TASKS) {
                let least = task
                    .as_ref()
                    .map_or(f64::INFINITY, |task| task.margins.delay);
                if margins.delay < least {
                    *task = Some(JudgedTask {
                        name,
                        joint: joint.name.clone(),
                        load,
                        margins,
                    });
                }
            }
        }
    }
    Some(Stands(tasks.into_iter().flatten().collect()))
}

/// The torque of a joint over the desired one.
fn response(of_joint: &TorqueLoop, load: Load) -> Vec<Point> {
    match &of_joint.law {
        LoopLaw::Predictive(space) => without_space(space).with(load).torque_response(),
        LoopLaw::Late(space) => space.of_torque().torque_response(load),
    }
}

impl Stands {
    pub(super) fn table(&self) -> String {
        let head = [
            "task",
            "slowest joint",
            "at",
            "phase",
            "more delay",
            "torques, times those of the model",
        ];
        let mut rows = vec![head.map(str::to_owned).to_vec()];
        rows.extend(self.0.iter().map(|task| {
            let m = &task.margins;
            vec![
                task.name.to_owned(),
                task.joint.clone(),
                task.load.name().to_owned(),
                format!("{:.0} deg", m.margins.phase.to_degrees()),
                format!("{:.0} ms", 1e3 * m.delay),
                format!("{:.2} to {:.1}", 1.0 / m.margins.reduction, m.margins.gain),
            ]
        }));
        let mut text = TextTable(rows).to_string();
        for task in self
            .0
            .iter()
            .filter(|task| !task.margins.margins.keeps(&NEEDED))
        {
            let _ = writeln!(
                text,
                "{}: less than 30 degrees or 6 dB: it may sway in mode stand",
                task.name
            );
        }
        text
    }

    pub(super) fn objects(&self) -> Vec<Value> {
        let object = |task: &JudgedTask| {
            let m = &task.margins;
            json!({
                "task": task.name,
                "slowest_joint": task.joint,
                "load": task.load.name(),
                "phase_deg": m.margins.phase.to_degrees(),
                "delay_ms": 1e3 * m.delay,
                "least_torque": 1.0 / m.margins.reduction,
                "greatest_torque": m.margins.gain,
            })
        };
        self.0.iter().map(object).collect()
    }
}
