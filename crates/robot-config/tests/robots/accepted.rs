//! The repository's robots load, and their tables carry every configured signal.

use crate::files::Files;
use can_codec::Frames;
use estimators::filter_bank::FilterDesign;
use robot_config::{Robot, slots};

fn robots() -> Vec<Robot> {
    ["test-joint", "leg", "humanoid"]
        .map(|name| {
            let path = format!("config/{name}/robot.toml");
            Files::new()
                .load(&path)
                .unwrap_or_else(|error| panic!("{error}"))
        })
        .into()
}

#[test]
fn every_joint_and_sensor_is_wired() {
    for robot in robots() {
        let parameters = &robot.parameters;
        let mut filled = vec![false; slots::receive_len(parameters)];
        for message in 0..robot.receive.message_count() {
            for slot in robot.receive.slots(message) {
                filled[slot] = true;
            }
        }
        for (j, joint) in parameters.joints.iter().enumerate() {
            assert!(filled[slots::motor_angle(j)] && filled[slots::link_angle(j)]);
            assert!(filled[slots::current(j)]);
            assert_eq!(filled[slots::velocity(j)], joint.has_velocity);
            assert_eq!(filled[slots::status(j)], joint.has_status);
            let name = robot.model.joint_names().nth(joint.model_index);
            assert_eq!(name, Some(joint.name.as_str()));
        }
        for sensor in 0..parameters.ft_sensors.len() {
            assert!((0..6).all(|axis| filled[slots::ft(sensor, axis)]));
        }
        let imu = (0..3)
            .all(|axis| filled[slots::gyro(0, axis)] && filled[slots::accelerometer(0, axis)]);
        assert_eq!(imu, !parameters.imus.is_empty());
        assert_eq!(robot.send.slot_count(), slots::send_len(parameters));
        assert_eq!(robot.sync.len(), parameters.buses.len());
    }
}

#[test]
fn values_survive_the_bus_to_half_a_count() {
    for robot in robots() {
        let joints = &robot.parameters.joints;
        let mut sent = vec![0.0; slots::receive_len(&robot.parameters)];
        for (j, joint) in joints.iter().enumerate() {
            sent[slots::link_angle(j)] =
                0.3 * joint.limits.position_min + 0.7 * joint.limits.position_max;
            sent[slots::motor_angle(j)] = -3.0 - j as f64;
            sent[slots::current(j)] = 1.25 - 0.1 * j as f64;
        }
        let mut frames = Frames::default();
        assert_eq!(
            robot.receive.encode_all(&sent, &mut frames),
            robot.receive.message_count()
        );
        let mut received = vec![f64::NAN; sent.len()];
        for frame in &frames {
            assert!(robot.receive.decode(frame, &mut received).is_ok());
        }
        for (j, joint) in joints.iter().enumerate() {
            let half = 0.5 * joint.estimator.link_resolution + 1e-12;
            // Link angles lie within half a wrap of zero: the joint's range was checked.
            let link = slots::link_angle(j);
            let error = received[link] - sent[link];
            let wrap = joint.encoders.link_wrap;
            assert!(
                (error - wrap * (error / wrap).round()).abs() <= half,
                "{}",
                joint.name
            );
            let motor = slots::motor_angle(j);
            let error = received[motor] - sent[motor];
            let wrap = joint.encoders.motor_wrap;
            let half = 0.5 * joint.estimator.motor_resolution + 1e-9;
            assert!(
                (error - wrap * (error / wrap).round()).abs() <= half,
                "{}",
                joint.name
            );
            assert!(
                (received[slots::current(j)] - sent[slots::current(j)]).abs() <= 0.5e-3 + 1e-12
            );
        }
    }
}

#[test]
fn leg_has_the_parameters_of_its_configuration() {
    let leg = &robots()[1];
    let knee = &leg.parameters.joints[3];
    assert_eq!(knee.name, "knee");
    assert_eq!(knee.bus, 1);
    assert!((knee.encoders.motor_wrap - 16.0 * core::f64::consts::TAU).abs() < 1e-9);
    assert!((knee.encoders.link_wrap - core::f64::consts::TAU).abs() < 1e-12);
    // Without a key of its own the lead is the torque limit's.
    assert_eq!(knee.limits.lead, 0.000051 * 233.0);
    assert_eq!(
        (knee.limits.velocity, knee.limits.deceleration),
        (4.0, 20.0)
    );
    assert_eq!(leg.parameters.timing.sample_period, 1e-3);
    assert_eq!(leg.parameters.filters.window, 80);
    let FilterDesign::SavitzkyGolay(encoder) = leg.parameters.filters.long.encoder else {
        panic!("{:?}", leg.parameters.filters.long.encoder);
    };
    assert_eq!(encoder.delay_samples, 39.5);
    assert_eq!(leg.sync[1].bus, 1);
    assert_eq!(leg.sync[1].id, 0x80);
}

#[test]
fn every_slot_knows_whose_it_is() {
    use slots::Source::{Ft, Imu, Joint};
    for imu in 0..=robot_state::MAX_FURTHER_IMUS {
        for axis in 0..3 {
            assert_eq!(slots::source(slots::gyro(imu, axis)), Imu(imu));
            assert_eq!(slots::source(slots::accelerometer(imu, axis)), Imu(imu));
        }
    }
    for s in 0..robot_state::MAX_FT_SENSORS {
        for axis in 0..6 {
            assert_eq!(slots::source(slots::ft(s, axis)), Ft(s));
        }
        assert_eq!(slots::source(slots::ft_temperature(s)), Ft(s));
    }
    for j in 0..3 {
        assert_eq!(slots::source(slots::motor_angle(j)), Joint(j));
        assert_eq!(slots::source(slots::status(j)), Joint(j));
    }
}
