//! A record for other programs. Units stand in the keys; a number that is not finite is `null`.

use crate::words;
use serde_json::{Map, Value, json};
use torqued_client::robot_state::{
    CycleRecord, Description, Event, ImuMeasured, LoopRecord, TorqueEstimate, Wrench, frame_flags,
    reported_flags,
};
use torqued_client::{Record, why_not_followed, why_refused};

pub(super) fn object(description: &Description, record: &Record) -> Value {
    let cycle = &record.cycle;
    let joints = description.joint_names.iter().enumerate();
    let joints = joints.take(cycle.joint_count as usize);
    let sensors = description.ft_names.iter().enumerate();
    let sensors = sensors.take(cycle.ft_count as usize);
    let events: Map<String, Value> = words::occurred(&cycle.events)
        .map(|(event, count)| (event.name().to_owned(), count.into()))
        .collect();
    json!({
        "robot": description.robot.as_str(),
        "rate_Hz": description.rate_hz,
        "sequence": cycle.sequence,
        "stamp_ns": cycle.stamp_ns,
        "state": words::state(cycle.state),
        "mode": words::mode(cycle.mode),
        "possible_modes": words::possible_modes(cycle),
        "fault": fault(description, cycle),
        "commander": commander(cycle),
        "references_refused": cycle.commander.refused,
        "reference_refused_as": why_refused(cycle.commander.refused_reason),
        "warning": warning(description, cycle),
        "contact_set": words::contact_set(description, cycle),
        "contact_set_automatic": cycle.estimated.contact_set_automatic == 1,
        "filter_delay_s": cycle.measured.filter_delay_s,
        "joints": joints.map(|(j, name)| {
            let kind = description.joint_kind(j);
            crate::units::keys(kind, joint(name.as_str(), cycle, j))
        }).collect::<Vec<_>>(),
        "ft": sensors.map(|(s, name)| ft_sensor(name.as_str(), cycle, s)).collect::<Vec<_>>(),
        "imu": imu(&cycle.measured.imu),
        "further_imus": further_imus(cycle),
        "unknown_wrench": wrench(&cycle.estimated.unknown_wrench),
        "unknown_wrench_sigma": wrench(&cycle.estimated.unknown_wrench_sigma),
        "residual": wrench(&cycle.estimated.residual),
        "residual_sigma": wrench(&cycle.estimated.residual_sigma),
        "frames": frames(description, cycle),
        "events": events,
        "timing": timing(&record.timing),
    })
}

fn fault(description: &Description, cycle: &CycleRecord) -> Value {
    let number = cycle.fault;
    if number == 0 {
        return Value::Null;
    }
    let event = Event::from_number(number);
    json!({
        "number": number,
        "name": event.map(|e| e.name()),
        "subject": words::fault_subject(description, cycle),
        "cause": event.map(|e| e.cause()),
        "config_key": event.map(|event| words::config_key(description, cycle, event)),
    })
}

fn commander(cycle: &CycleRecord) -> Value {
    let lease = &cycle.commander;
    if lease.session == 0 {
        return Value::Null;
    }
    json!({
        // In text: a JSON number does not hold 64 bits.
        "session": format!("{:016x}", lease.session),
        "pid": lease.pid,
        "priority": lease.priority,
        "since_ns": lease.since_ns,
        "sequence": lease.sequence,
        "not_followed": why_not_followed(lease, cycle.state),
    })
}

fn warning(description: &Description, cycle: &CycleRecord) -> Value {
    match words::warning(description, cycle) {
        None => Value::Null,
        Some((event, subject)) => json!({
            "number": event.number(),
            "name": event.name(),
            "cause": event.cause(),
            "subject": subject,
        }),
    }
}

fn joint(name: &str, cycle: &CycleRecord, joint: usize) -> Value {
    let measured = &cycle.measured.joints[joint];
    let estimated = &cycle.estimated.joints[joint];
    let commanded = &cycle.commanded.joints[joint];
    let reported = |bit| measured.reported & bit != 0;
    let known = commanded.command_delay_sigma_s > 0.0;
    json!({
        "name": name,
        "q_rad": measured.q,
        "theta_rad": measured.theta,
        "torsion_rad": measured.torsion,
        "current_A": measured.current,
        "dq_rad_per_s": measured.dq,
        "q_hat_rad": measured.q_hat,
        "dq_hat_rad_per_s": measured.dq_hat,
        "ddq_hat_rad_per_s2": measured.ddq_hat,
        "omega_rad_per_s": measured.omega,
        "age_s": measured.age_s,
        "status": measured.status,
        "drive": {
            "temperature_C": reported(reported_flags::TEMPERATURE).then_some(measured.temperature),
            "supply_V": reported(reported_flags::VOLTAGE).then_some(measured.voltage),
            "tau_Nm": reported(reported_flags::TORQUE).then_some(measured.tau_drive),
            "error": reported(reported_flags::ERROR).then_some(measured.drive_error),
            "thermal_load": estimated.thermal_load,
            "torque_limit_Nm": commanded.torque_limit,
        },
        "flags": words::measured(measured.flags),
        "tau_encoder": estimate(&estimated.tau_encoder),
        "tau_whole_body": estimate(&estimated.tau_whole_body),
        "tau_current": estimate(&estimated.tau_current),
        "tau_hat": estimate(&estimated.tau_hat),
        "tau_ext_Nm": estimated.tau_ext,
        "tau_ext_change_Nm": estimated.tau_ext_change,
        "contact_ratio": estimated.contact_ratio,
        "contact_flag": estimated.contact_flag == 1,
        "commanded": {
            "tau_d_Nm": commanded.tau_d,
            "tau_star_Nm": commanded.tau_star,
            "delta_q_rad": commanded.delta_q,
            "q_c_rad": commanded.q_c,
            "current_c_A": commanded.current_c,
            "flags": words::command(commanded.flags),
            "delay_s": known.then_some(commanded.command_delay_s),
            "delay_sigma_s": known.then_some(commanded.command_delay_sigma_s),
        },
    })
}

fn estimate(estimate: &TorqueEstimate) -> Value {
    json!({
        "tau_Nm": estimate.tau,
        "sigma_Nm": estimate.sigma,
        "delay_s": estimate.delay_s,
        "source": words::source(estimate.source),
        "flags": words::torque(estimate.flags),
    })
}

fn wrench(wrench: &Wrench) -> Value {
    json!({ "force_N": wrench.force, "torque_Nm": wrench.torque })
}

fn ft_sensor(name: &str, cycle: &CycleRecord, sensor: usize) -> Value {
    let (measured, estimated) = (&cycle.measured.ft[sensor], &cycle.estimated.ft[sensor]);
    json!({
        "name": name,
        "wrench": wrench(&measured.wrench),
        "wrench_hat": wrench(&measured.wrench_hat),
        "contact_wrench": wrench(&estimated.contact_wrench),
        "offset": wrench(&measured.offset),
        "residual": wrench(&estimated.residual),
        "residual_sigma": wrench(&estimated.residual_sigma),
        "temperature_C": measured.temperature,
        "age_s": measured.age_s,
        "flags": words::measured(measured.flags),
    })
}

/// The frames that a client uses.
fn frames(description: &Description, cycle: &CycleRecord) -> Vec<Value> {
    let named = description.frame_names.iter().zip(&cycle.commanded.frames);
    let used = named.filter(|(_, frame)| frame.flags & frame_flags::VALID != 0);
    used.map(|(name, frame)| {
        let known = frame.flags & frame_flags::FORCE_KNOWN != 0;
        json!({
            "name": name.as_str(),
            "position_m": frame.position,
            "orientation_wxyz": frame.orientation,
            "wrench": frame.wrench,
            "force_estimated": known.then_some(frame.force_estimated),
            "flags": words::frame(frame.flags),
        })
    })
    .collect()
}

/// Those that have ever sent a sample, or are missed: places that the robot does not use are all zero.
fn further_imus(cycle: &CycleRecord) -> Vec<Value> {
    let used = |imu: &&ImuMeasured| imu.flags != 0 || imu.age_s > 0.0;
    (cycle.measured.further_imus.iter().take_while(used).map(imu)).collect()
}

fn imu(imu: &ImuMeasured) -> Value {
    json!({
        "gyro_rad_per_s": imu.gyro,
        "accelerometer_m_per_s2": imu.accelerometer,
        "age_s": imu.age_s,
        "flags": words::measured(imu.flags),
    })
}

fn timing(timing: &LoopRecord) -> Value {
    json!({
        "cycles": timing.cycles,
        "late_cycles": timing.late_cycles,
        "skipped_cycles": timing.skipped_cycles,
        "wake_late_ns": timing.wake_late_ns,
        "gather_ns": timing.gather_ns,
        "compute_ns": timing.compute_ns,
        "send_ns": timing.send_ns,
        "frames_received": timing.frames_received,
        "frames_sent": timing.frames_sent,
    })
}
