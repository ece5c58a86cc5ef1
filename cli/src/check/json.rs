//! The configuration as JSON.

use super::bus_load::BusLoad;
use super::frames;
use super::gains::equivalent;
use super::stand;
use super::{command, mass_beyond, torque_per_count};
use crate::margins::{self, JudgedJoint};
use robot_config::{BusParameters, Carrier, JointParameters, Robot};
use serde_json::{Value, json};
use torqued_client::robot_state::JointKind;

pub(super) fn object(
    robot: &Robot,
    buses: &[BusLoad],
    judged: &[JudgedJoint],
    warnings: &[String],
) -> Value {
    let parameters = &robot.parameters;
    let bus = |(bus, load): (&BusParameters, &BusLoad)| {
        let time = load.time.as_ref();
        let kind = match bus.carrier {
            Carrier::SocketCan(_) => "socketcan",
            Carrier::UdpMulticast(_) => "udp_multicast",
        };
        json!({
            "name": bus.name,
            "kind": kind,
            "interface": bus.carrier.to_string(),
            "fd": bus.fd,
            "frames_received_per_cycle": load.received,
            "frames_sent_per_cycle": load.sent + 1,
            "answers_us": time.map(|time| time.answers_s * 1e6),
            "commands_us": time.map(|time| time.commands_s * 1e6),
            "load_percent": time.map(|time| time.load * 100.0),
        })
    };
    let joint = |joint: &JointParameters| {
        let same = equivalent(joint, parameters.k_f);
        let kind = joint.kind;
        let gear_ratio = match kind {
            JointKind::Revolute => "gear_ratio",
            JointKind::Prismatic => "gear_ratio_rad_per_m",
        };
        let object = json!({
            "name": joint.name,
            "kind": kind.name(),
            "bus": parameters.buses[joint.bus].name,
            "drive": joint.drive,
            "command": command(joint),
            "link_encoder": joint.has_link_encoder,
            (gear_ratio): joint.encoders.gear_ratio,
            "torque_limit_Nm": joint.limits.torque,
            "position_min_deg": kind.shown(joint.limits.position_min),
            "position_max_deg": kind.shown(joint.limits.position_max),
            "delta_q_limit_deg": kind.shown(joint.limits.lead),
            "velocity_limit_rad_per_s": joint.limits.velocity,
            "deceleration_rad_per_s2": joint.limits.deceleration,
            "torque_rate_Nm_per_s": joint.limits.torque_rate,
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
        });
        crate::units::keys(kind, object)
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
            "mass_beyond_kg": mass_beyond(&robot.model, &ft.sensor.frame),
        })).collect::<Vec<_>>(),
        "imu_frame": parameters.imus.first().map(|imu| &imu.frame),
        "further_imu_frames": parameters.imus.iter().skip(1).map(|imu| &imu.frame).collect::<Vec<_>>(),
        "frames": frames::objects(robot),
        "torque_loops": margins::objects(judged),
        "mode_stand": stand::judge(robot).map(|stands| stands.objects()),
        "warnings": warnings,
    })
}
