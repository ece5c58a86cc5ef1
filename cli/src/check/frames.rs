//! Frames of mode Cartesian: what springs and dampers the joints bear in the middle of their ranges.

use control::{CartesianLaw, CartesianTarget, Limb};
use dynamics::{
    Data, ReferenceFrame, Se3, crba, forward_kinematics, frame_jacobian, frame_placement, neutral,
};
use nalgebra::{DMatrix, Matrix3, Matrix6, Matrix6xX, Vector6};
use robot_config::{FrameParameters, Robot};
use serde_json::{Value, json};
use terminal::TextTable;

/// Shares of the greatest stiffness and of its damping that the joints bear, up to 1.
fn borne(robot: &Robot, frame: &FrameParameters) -> Option<[f64; 2]> {
    let (model, joints) = (&robot.model, &robot.parameters.joints);
    let (nv, nq) = model.base_size();
    let mut q = neutral(model);
    for joint in joints {
        let limits = &joint.limits;
        q[nq + joint.model_index] = 0.5 * (limits.position_min + limits.position_max);
    }
    let mut data = Data::new(model);
    let mass = crba(model, &mut data, &q).clone();
    forward_kinematics(model, &mut data, &q);
    let mut jacobian = Matrix6xX::zeros(model.nv());
    let axes = ReferenceFrame::LocalWorldAligned;
    frame_jacobian(model, &data, frame.link, axes, &mut jacobian);
    let places: Vec<usize> = (frame.joints.iter())
        .map(|&j| nv + joints[j].model_index)
        .collect();
    let columns: Vec<Vector6<f64>> = (places.iter())
        .map(|&place| jacobian.column(place).into_owned())
        .collect();
    let n = places.len();
    let felt = |i: usize| joints[frame.joints[i]].law.effective_inertia();
    let mass = DMatrix::from_fn(n, n, |i, k| {
        mass[(places[i], places[k])] + if i == k { felt(i) } else { 0.0 }
    });
    let inverse = mass.try_inverse()?;
    let mut mobility = Matrix6::zeros();
    for (i, one) in columns.iter().enumerate() {
        for (k, other) in columns.iter().enumerate() {
            mobility += one * other.transpose() * inverse[(i, k)];
        }
    }
    let [k, turning] = frame.limits.stiffness;
    let pose: Se3 = frame_placement(model, &data, frame.link);
    let target = CartesianTarget {
        pose,
        velocity: Vector6::zeros(),
        stiffness: Vector6::new(k, k, k, turning, turning, turning),
        force: Vector6::zeros(),
        damping_ratio: 1.0,
        feedback: [false; 6],
        axes: Matrix3::identity(),
    };
    let bounds: Vec<[f64; 2]> = (frame.joints.iter())
        .map(|&j| {
            let gains = &joints[j].gains;
            [
                (1.0 - frame.posture_stiffness) * gains.k_s,
                (1.0 - frame.posture_damping) * gains.k_d,
            ]
        })
        .collect();
    let mut law = CartesianLaw::new(frame.limits);
    law.start(&pose, None, &target);
    let limb = Limb {
        pose,
        jacobian: &columns,
        mobility,
        dq: &vec![0.0; n],
        bounds: &bounds,
        force: None,
        late: 0.0,
    };
    let wrench = law.wrench(&target, &limb, robot.parameters.timing.sample_period);
    Some(wrench.shares)
}

/// Source of the force on the frame.
fn source(robot: &Robot, frame: &FrameParameters) -> String {
    let sensor = frame
        .sensor
        .and_then(|s| robot.parameters.ft_sensors.get(s));
    match (sensor, &robot.parameters.external_torque) {
        (Some(ft), _) => ft.sensor.name.clone(),
        (None, Some(_)) => "external torques".to_owned(),
        (None, None) => "none".to_owned(),
    }
}

fn link(robot: &Robot, frame: usize) -> &str {
    let frame = robot.model.frames().get(frame);
    frame.map_or("?", |frame| frame.name.as_str())
}

pub(super) fn table(robot: &Robot) -> TextTable {
    let heading = [
        "frame",
        "link",
        "base",
        "joints",
        "force",
        "at most",
        "stiffness at most",
        "borne of it",
        "of its damping",
    ];
    let mut rows = vec![heading.map(str::to_owned).to_vec()];
    rows.extend(robot.parameters.frames.iter().map(|frame| {
        let ([force, torque], [k, turning]) = (frame.limits.wrench, frame.limits.stiffness);
        let [stiff, damp] = borne(robot, frame).unwrap_or_default();
        vec![
            frame.name.clone(),
            link(robot, frame.link).to_owned(),
            link(robot, frame.base).to_owned(),
            frame.joints.len().to_string(),
            source(robot, frame),
            format!("{force} N, {torque} N·m"),
            format!("{k} N/m, {turning} N·m/rad"),
            format!("{:.0} %", 100.0 * stiff),
            format!("{:.0} %", 100.0 * damp),
        ]
    }));
    TextTable(rows)
}

pub(super) fn objects(robot: &Robot) -> Vec<Value> {
    let frames = robot.parameters.frames.iter();
    frames
        .map(|frame| {
            let [stiffness, damping] = borne(robot, frame).unwrap_or_default();
            json!({
                "name": frame.name,
                "link": link(robot, frame.link),
                "base": link(robot, frame.base),
                "joints": frame.joints.iter().map(|&j| &robot.parameters.joints[j].name)
                    .collect::<Vec<_>>(),
                "force_by": source(robot, frame),
                "force_limit_N": frame.limits.wrench[0],
                "torque_limit_Nm": frame.limits.wrench[1],
                "stiffness_N_per_m": frame.limits.stiffness[0],
                "stiffness_Nm_per_rad": frame.limits.stiffness[1],
                "stiffness_borne": stiffness,
                "damping_borne": damping,
            })
        })
        .collect()
}
