//! The configuration as text.

use super::bus_load::{BusLoad, WireTime};
use super::frames;
use super::gains::equivalent;
use super::stand;
use super::{command, lacking, mass_beyond, torque_per_count};
use crate::margins::{self, JudgedJoint};
use crate::units::cell;
use control::{CurrentDrive, DriveModel, PositionDrive};
use dynamics::Base;
use robot_config::{JointParameters, Robot};
use terminal::TextTable;
use torqued_client::robot_state::JointKind;

fn row<const N: usize>(cells: [&str; N]) -> Vec<String> {
    cells.map(str::to_owned).to_vec()
}

pub(super) fn page(
    robot: &Robot,
    buses: &[BusLoad],
    judged: &[JudgedJoint],
    warnings: &[String],
) -> String {
    let parameters = &robot.parameters;
    let base = match parameters.base {
        Base::Fixed => "fixed",
        Base::Floating => "floating",
    };
    let imus = match parameters.imus.len() {
        0 => "no IMU".to_owned(),
        1 => "IMU".to_owned(),
        imus => format!("{imus} IMUs"),
    };
    let mut text = format!(
        "{}: {} joints, {} buses, {} F/T sensors, {}, {} base, {:.2} kg, {} Hz\n",
        parameters.name,
        parameters.joints.len(),
        buses.len(),
        parameters.ft_sensors.len(),
        imus,
        base,
        robot.model.total_mass(),
        1.0 / parameters.timing.sample_period
    );
    text += "\nBuses: frames a cycle, time and load with the most stuff bits\n";
    text += &bus_table(robot, buses).to_string();
    text += "\nJoints: N gear ratio; count: one link-side count as torque\n";
    text += &joint_table(robot).to_string();
    if let Some(lacking) = lacking(robot) {
        text += &format!("\n{lacking}\n");
    }
    text += "\nDrives\n";
    text += &drive_table(robot).to_string();
    text += "\nGains (D11-12) and the same in the commanded position (D13-14); K_f = ";
    text += &format!("{}\n", parameters.k_f);
    text += &gain_table(robot).to_string();
    if !judged.is_empty() {
        text += "\nTorque loops\n";
        text += &margins::table(judged);
        text += margins::NOTE;
        text += &margins::designs(judged);
    }
    if !parameters.frames.is_empty() {
        text += "\nFrames of mode Cartesian: stiffness and damping as far as the joints bear them in the middle of \
                 their ranges\n";
        text += &frames::table(robot).to_string();
    }
    if !parameters.ft_sensors.is_empty() {
        text += "\nF/T sensors\n";
        text += &sensor_table(robot).to_string();
    }
    text += &match robot.cannot_stand() {
        None => stand::judge(robot).map_or(String::new(), |stands| {
            format!(
                "\nMode stand: on the feet whose soles are given\n{}",
                stands.table()
            )
        }),
        Some(problem) => format!("\nNo {problem}\n"),
    };
    for warning in warnings {
        text += &format!("\nwarning: {warning}");
    }
    if !warnings.is_empty() {
        text.push('\n');
    }
    text
}

fn bus_table(robot: &Robot, buses: &[BusLoad]) -> TextTable {
    let mut rows = vec![row([
        "bus",
        "interface",
        "kind",
        "received",
        "sent",
        "SYNC to last answer",
        "commands",
        "load",
    ])];
    rows.extend(robot.parameters.buses.iter().zip(buses).map(|(bus, load)| {
        vec![
            bus.name.clone(),
            bus.carrier.to_string(),
            if bus.fd { "FD" } else { "classic" }.to_owned(),
            load.received.to_string(),
            format!("{} + SYNC", load.sent),
            of_time(load, |time| format!("{:.0} us", time.answers_s * 1e6)),
            of_time(load, |time| format!("{:.0} us", time.commands_s * 1e6)),
            of_time(load, |time| format!("{:.0} %", time.load * 100.0)),
        ]
    }));
    TextTable(rows)
}

/// A figure of a bus whose frames take time on a wire.
fn of_time(load: &BusLoad, show: impl Fn(&WireTime) -> String) -> String {
    load.time.as_ref().map_or_else(|| "-".to_owned(), show)
}

fn joint_table(robot: &Robot) -> TextTable {
    let mut rows = vec![row([
        "joint", "bus", "drive", "command", "N", "torque", "position", "velocity", "lead", "count",
    ])];
    rows.extend(robot.parameters.joints.iter().map(|joint| {
        let (limits, kind) = (&joint.limits, joint.kind);
        let unit = |unit| kind.units(unit);
        vec![
            joint.name.clone(),
            robot.parameters.buses[joint.bus].name.clone(),
            joint.drive.clone(),
            command(joint).to_owned(),
            match kind {
                JointKind::Revolute => joint.encoders.gear_ratio.to_string(),
                JointKind::Prismatic => format!("{:.4} rad/m", joint.encoders.gear_ratio),
            },
            format!("±{} {}", limits.torque, unit("N·m")),
            format!(
                "{:.1} to {:.1} {}",
                kind.shown(limits.position_min),
                kind.shown(limits.position_max),
                unit("deg")
            ),
            format!("±{} {}", limits.velocity, unit("rad/s")),
            if limits.lead.is_finite() {
                format!("±{:.3} {}", kind.shown(limits.lead), unit("deg"))
            } else {
                "-".to_owned()
            },
            torque_per_count(joint)
                .map_or_else(|| "-".to_owned(), |tau| format!("{tau:.3} {}", unit("N·m"))),
        ]
    }));
    TextTable(rows)
}

/// The drives that joints use, each once.
fn drives(robot: &Robot) -> Vec<&JointParameters> {
    let mut drives: Vec<&JointParameters> = Vec::new();
    for joint in &robot.parameters.joints {
        if !drives.iter().any(|other| other.drive == joint.drive) {
            drives.push(joint);
        }
    }
    drives
}

fn drive_table(robot: &Robot) -> TextTable {
    let mut rows = vec![row([
        "drive",
        "K_t Nm/A",
        "rotor kg·m²",
        "K_fs0 Nm/rad",
        "C_fs 1/Nm",
        "K_wg0 Nm/rad",
        "C_wg 1/Nm",
        "friction Nm",
        "motor model",
    ])];
    rows.extend(drives(robot).iter().map(|joint| {
        let estimator = &joint.estimator;
        let compliance = &estimator.compliance;
        let motor = match joint.drive_model {
            DriveModel::Position(PositionDrive {
                k_tau, k_v, k_c, ..
            }) => {
                let text = format!("K_tau {k_tau} rad/Nm, K_v {k_v} s, K_c {k_c} rad");
                joint.kind.units(&text).into_owned()
            }
            DriveModel::Current(CurrentDrive { k_1, k_2, k_3, .. }) => {
                let text = format!("K_1 {k_1} Nm/A, K_2 {k_2} Nms/rad, K_3 {k_3} Nm");
                joint.kind.units(&text).into_owned()
            }
        };
        vec![
            joint.drive.clone(),
            estimator.wave_generator.torque_constant.to_string(),
            format!("{:e}", joint.rotor_inertia),
            cell(joint.kind, compliance.k_fs0.to_string(), "Nm/rad"),
            cell(joint.kind, compliance.c_fs.to_string(), "1/Nm"),
            compliance.k_wg0.to_string(),
            compliance.c_wg.to_string(),
            estimator.wave_generator.friction.to_string(),
            motor,
        ]
    }));
    TextTable(rows)
}

fn gain_table(robot: &Robot) -> TextTable {
    let mut rows = vec![row([
        "joint",
        "K_p",
        "K_i 1/s",
        "K_s Nm/rad",
        "K_d Nms/rad",
        "K6",
        "K7 s",
        "K8/M rad/Nm",
        "K9/J^T rad/Nm",
    ])];
    rows.extend(robot.parameters.joints.iter().map(|joint| {
        let gains = &joint.gains;
        let mut cells = vec![
            joint.name.clone(),
            gains.k_p.to_string(),
            gains.k_i.to_string(),
            cell(joint.kind, format!("{:.1}", gains.k_s), "Nm/rad"),
            cell(joint.kind, format!("{:.2}", gains.k_d), "Nms/rad"),
        ];
        match equivalent(joint, robot.parameters.k_f) {
            Some(same) => cells.extend([
                format!("{:.3}", same.k6),
                format!("{:.4}", same.k7),
                cell(joint.kind, format!("{:.3e}", same.k8_per_m), "rad/Nm"),
                cell(joint.kind, format!("{:.3e}", same.k9_per_jt), "rad/Nm"),
            ]),
            None => cells.extend(row(["-"; 4])),
        }
        cells
    }));
    TextTable(rows)
}

fn sensor_table(robot: &Robot) -> TextTable {
    let mut rows = vec![row([
        "sensor",
        "frame",
        "mass beyond",
        "bus",
        "temperature",
        "sigma",
    ])];
    rows.extend(robot.parameters.ft_sensors.iter().map(|ft| {
        vec![
            ft.sensor.name.clone(),
            ft.sensor.frame.clone(),
            format!("{:.3} kg", mass_beyond(&robot.model, &ft.sensor.frame)),
            robot.parameters.buses[ft.bus].name.clone(),
            if ft.has_temperature {
                "compensated"
            } else {
                "-"
            }
            .to_owned(),
            format!(
                "{} N, {} N·m",
                ft.sensor.sigma_force, ft.sensor.sigma_torque
            ),
        ]
    }));
    TextTable(rows)
}
