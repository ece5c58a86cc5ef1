//! `torquectl check`: everything that a configuration says, judged without starting anything.

use crate::BAD_INPUT;
use crate::bus_load::{Bitrate, Shape};
use crate::output::finish;
use crate::text_table::TextTable;
use can_codec::{EXTENDED_ID, Frame, Table};
use control::MotorModel;
use dynamics::Base;
use robot_config::{JointParameters, Robot, TorqueFeedback};
use serde_json::{Value, json};
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  torquectl check config/leg/robot.toml
  torquectl check --json config/humanoid/robot.toml
  torquectl check --bitrate 500000 config/leg/robot.toml

Every problem is printed on stderr as FILE:LINE: what is wrong; allowed: what is allowed.
docs/configuration.md describes every key.

Exit codes:
  0  the configuration is complete
  2  something is wrong in it, its URDF or its DBC files, or one of them cannot be read";

/// Check a robot's configuration with its URDF and DBC files, and print what was understood.
///
/// Nothing is started: CAN interfaces need not exist.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct CheckArguments {
    /// The robot's configuration
    #[arg(value_name = "CONFIG")]
    config: String,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
    /// Bits a second of the buses, for the estimate of their load
    #[arg(long, value_name = "HZ", default_value_t = 1_000_000, value_parser = clap::value_parser!(u32).range(10_000..=20_000_000))]
    bitrate: u32,
    /// Bits a second of the data in CAN FD frames
    #[arg(long, value_name = "HZ", default_value_t = 5_000_000, value_parser = clap::value_parser!(u32).range(10_000..=20_000_000))]
    data_bitrate: u32,
}

pub(crate) fn run(arguments: &CheckArguments) -> ExitCode {
    let read = |path: &str| std::fs::read_to_string(path);
    let robot = match robot_config::load(&arguments.config, &read) {
        Ok(robot) => robot,
        Err(error) => {
            eprintln!("{error}");
            return ExitCode::from(BAD_INPUT);
        }
    };
    let rate = Bitrate {
        nominal: f64::from(arguments.bitrate),
        data: f64::from(arguments.data_bitrate),
    };
    let buses = buses(&robot, rate);
    let warnings = warnings(&robot, &buses);
    finish(&match arguments.json {
        true => format!("{:#}\n", as_json(&robot, &buses, &warnings)),
        false => as_text(&robot, &buses, &warnings),
    })
}

/// What a bus carries in a cycle.
struct BusLoad {
    received: usize,
    sent: usize,
    /// From SYNC to the last answer, s.
    answers_s: f64,
    /// Commands, s.
    commands_s: f64,
    /// Share of the period, 1.
    load: f64,
}

fn buses(robot: &Robot, rate: Bitrate) -> Vec<BusLoad> {
    let messages = |table: &Table, bus: usize| -> Vec<Shape> {
        (0..table.message_count())
            .filter_map(|index| table.message(index))
            .filter(|message| usize::from(message.bus) == bus)
            .map(|message| Shape {
                extended: message.id & EXTENDED_ID != 0,
                fd: message.fd,
                len: message.len,
            })
            .collect()
    };
    let sync_shape = |frame: &Frame| Shape {
        extended: frame.id & EXTENDED_ID != 0,
        fd: frame.fd,
        len: frame.len,
    };
    let total = |shapes: &[Shape]| shapes.iter().map(|s| s.worst_case_s(rate)).sum::<f64>();
    let of_bus = |(bus, sync): (usize, &Frame)| {
        let received = messages(&robot.receive, bus);
        let sent = messages(&robot.send, bus);
        let answers_s = sync_shape(sync).worst_case_s(rate) + total(&received);
        let commands_s = total(&sent);
        BusLoad {
            received: received.len(),
            sent: sent.len(),
            answers_s,
            commands_s,
            load: (answers_s + commands_s) / robot.parameters.timing.sample_period,
        }
    };
    robot.sync.iter().enumerate().map(of_bus).collect()
}

/// What is odd but does not keep the robot from running.
fn warnings(robot: &Robot, buses: &[BusLoad]) -> Vec<String> {
    let mut warnings: Vec<String> = robot.model.warnings().to_vec();
    let timing = &robot.parameters.timing;
    for (bus, load) in robot.parameters.buses.iter().zip(buses) {
        if load.load > 1.0 {
            warnings.push(format!(
                "bus {}: its frames take {:.0} us at worst, a cycle has {:.0} us",
                bus.name,
                (load.answers_s + load.commands_s) * 1e6,
                timing.sample_period * 1e6
            ));
        } else if load.answers_s > timing.gather_deadline {
            warnings.push(format!(
                "bus {}: SYNC and answers take {:.0} us at worst, loop.gather_deadline_us is {:.0}",
                bus.name,
                load.answers_s * 1e6,
                timing.gather_deadline * 1e6
            ));
        }
        if load.received == 0 && load.sent == 0 {
            warnings.push(format!("bus {}: no signal of it is used", bus.name));
        }
    }
    let feedback = robot.parameters.torque_feedback;
    if feedback == TorqueFeedback::WholeBody && robot.parameters.ft_sensors.is_empty() {
        warnings.push(
            "control.torque_feedback is whole_body and there is no F/T sensor: every contact \
             counts as joint torque"
                .to_owned(),
        );
    }
    warnings
}

/// Gains and their equivalents in the commanded position (D13-14): K8 is this factor times the
/// mass matrix, K9 this factor times the transposed contact Jacobian.
struct Gains {
    k6: f64,
    k7: f64,
    k8_per_m: f64,
    k9_per_jt: f64,
}

fn equivalent(joint: &JointParameters, k_f: f64) -> Option<Gains> {
    let MotorModel::Position { k_tau, .. } = joint.motor else {
        return None;
    };
    let k_p = joint.gains.k_p;
    let gains = joint.gains.equivalent(k_tau);
    Some(Gains {
        k6: gains.k6,
        k7: gains.k7,
        k8_per_m: k_tau * k_p,
        k9_per_jt: -k_tau * (k_p * (1.0 + k_f) + k_f),
    })
}

/// One count of the link-side encoder as torque, N·m: how fine torque from encoders can be.
fn torque_per_count(joint: &JointParameters) -> f64 {
    joint.estimator.compliance.k_fs0 * joint.estimator.link_resolution
}

fn row<const N: usize>(cells: [&str; N]) -> Vec<String> {
    cells.map(str::to_owned).to_vec()
}

fn as_text(robot: &Robot, buses: &[BusLoad], warnings: &[String]) -> String {
    let parameters = &robot.parameters;
    let base = match parameters.base {
        Base::Fixed => "fixed",
        Base::Floating => "floating",
    };
    let mut text = format!(
        "{}: {} joints, {} buses, {} F/T sensors, {}, {} base, {:.2} kg, {} Hz\n",
        parameters.name,
        parameters.joints.len(),
        buses.len(),
        parameters.ft_sensors.len(),
        parameters.imu.as_ref().map_or("no IMU", |_| "IMU"),
        base,
        robot.model.total_mass(),
        1.0 / parameters.timing.sample_period
    );
    text += "\nBuses: frames a cycle, time and load with the most stuff bits\n";
    text += &bus_table(robot, buses).to_string();
    text += "\nJoints: N gear ratio; count: one link-side count as torque\n";
    text += &joint_table(robot).to_string();
    text += "\nDrives\n";
    text += &drive_table(robot).to_string();
    text += "\nGains (D11-12) and the same in the commanded position (D13-14); K_f = ";
    text += &format!("{}\n", parameters.k_f);
    text += &gain_table(robot).to_string();
    if !parameters.ft_sensors.is_empty() {
        text += "\nF/T sensors\n";
        text += &sensor_table(robot).to_string();
    }
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
            bus.interface.clone(),
            if bus.fd { "FD" } else { "classic" }.to_owned(),
            load.received.to_string(),
            format!("{} + SYNC", load.sent),
            format!("{:.0} us", load.answers_s * 1e6),
            format!("{:.0} us", load.commands_s * 1e6),
            format!("{:.0} %", load.load * 100.0),
        ]
    }));
    TextTable(rows)
}

fn joint_table(robot: &Robot) -> TextTable {
    let mut rows = vec![row([
        "joint", "bus", "drive", "command", "N", "torque", "position", "delta_q", "count",
    ])];
    rows.extend(robot.parameters.joints.iter().map(|joint| {
        let limits = &joint.limits;
        vec![
            joint.name.clone(),
            robot.parameters.buses[joint.bus].name.clone(),
            joint.drive.clone(),
            command(joint).to_owned(),
            joint.encoders.gear_ratio.to_string(),
            format!("±{} N·m", limits.torque),
            format!(
                "{:.1} to {:.1} deg",
                limits.position_min.to_degrees(),
                limits.position_max.to_degrees()
            ),
            format!("±{:.2} deg", limits.delta_q.to_degrees()),
            format!("{:.3} N·m", torque_per_count(joint)),
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
        let motor = match joint.motor {
            MotorModel::Position {
                k_tau, k_v, k_c, ..
            } => {
                format!("K_tau {k_tau} rad/Nm, K_v {k_v} s, K_c {k_c} rad")
            }
            MotorModel::Current { k1, k2, k3, .. } => {
                format!("K_1 {k1} Nm/A, K_2 {k2} Nms/rad, K_3 {k3} Nm")
            }
        };
        vec![
            joint.drive.clone(),
            estimator.wave_generator.torque_constant.to_string(),
            format!("{:e}", joint.rotor_inertia),
            compliance.k_fs0.to_string(),
            compliance.c_fs.to_string(),
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
            format!("{:.1}", gains.k_s),
            format!("{:.2}", gains.k_d),
        ];
        match equivalent(joint, robot.parameters.k_f) {
            Some(same) => cells.extend([
                format!("{:.3}", same.k6),
                format!("{:.4}", same.k7),
                format!("{:.3e}", same.k8_per_m),
                format!("{:.3e}", same.k9_per_jt),
            ]),
            None => cells.extend(row(["-"; 4])),
        }
        cells
    }));
    TextTable(rows)
}

fn sensor_table(robot: &Robot) -> TextTable {
    let mut rows = vec![row(["sensor", "frame", "bus", "temperature", "sigma"])];
    rows.extend(robot.parameters.ft_sensors.iter().map(|ft| {
        vec![
            ft.sensor.name.clone(),
            ft.sensor.frame.clone(),
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

fn command(joint: &JointParameters) -> &'static str {
    if joint.takes_position() {
        "position"
    } else {
        "current"
    }
}

fn as_json(robot: &Robot, buses: &[BusLoad], warnings: &[String]) -> Value {
    let parameters = &robot.parameters;
    let bus = |(bus, load): (&robot_config::BusParameters, &BusLoad)| {
        json!({
            "name": bus.name,
            "interface": bus.interface,
            "fd": bus.fd,
            "frames_received_per_cycle": load.received,
            "frames_sent_per_cycle": load.sent + 1,
            "answers_us": load.answers_s * 1e6,
            "commands_us": load.commands_s * 1e6,
            "load_percent": load.load * 100.0,
        })
    };
    let joint = |joint: &JointParameters| {
        let same = equivalent(joint, parameters.k_f);
        json!({
            "name": joint.name,
            "bus": parameters.buses[joint.bus].name,
            "drive": joint.drive,
            "command": command(joint),
            "gear_ratio": joint.encoders.gear_ratio,
            "torque_limit_Nm": joint.limits.torque,
            "position_min_deg": joint.limits.position_min.to_degrees(),
            "position_max_deg": joint.limits.position_max.to_degrees(),
            "delta_q_limit_deg": joint.limits.delta_q.to_degrees(),
            "torque_per_count_Nm": torque_per_count(joint),
            "gains": {
                "K_p": joint.gains.k_p,
                "K_i_per_s": joint.gains.k_i,
                "K_s_Nm_per_rad": joint.gains.k_s,
                "K_d_Nms_per_rad": joint.gains.k_d,
                "K_f": parameters.k_f,
            },
            "equivalent_gains": same.map(|same| json!({
                "K6": same.k6,
                "K7_s": same.k7,
                "K8_per_M_rad_per_Nm": same.k8_per_m,
                "K9_per_JT_rad_per_Nm": same.k9_per_jt,
            })),
        })
    };
    json!({
        "robot": parameters.name,
        "urdf": parameters.urdf_path,
        "rate_hz": 1.0 / parameters.timing.sample_period,
        "total_mass_kg": robot.model.total_mass(),
        "buses": parameters.buses.iter().zip(buses).map(bus).collect::<Vec<_>>(),
        "joints": parameters.joints.iter().map(joint).collect::<Vec<_>>(),
        "ft_sensors": parameters.ft_sensors.iter().map(|ft| json!({
            "name": ft.sensor.name,
            "frame": ft.sensor.frame,
        })).collect::<Vec<_>>(),
        "imu_frame": parameters.imu.as_ref().map(|imu| &imu.frame),
        "warnings": warnings,
    })
}
