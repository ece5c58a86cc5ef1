//! The cross-check in the cycle, on the standing humanoid.

use crate::common;

use common::Bench;
use cycle::Cycle;
use robot_config::{CrossCheckSettings, Parameters};
use robot_state::Event;

const SETTINGS: CrossCheckSettings = CrossCheckSettings {
    encoder_share: 0.04,
    // Standing still loads the knees by a few per cent.
    current_load_share: 0.04,
    current_ratio: [0.3, 2.0],
    residual_ratio: 8.0,
    average: 0.25,
    hold: 0.4,
};

/// The events 204 to 208 that occur in two and a half seconds of standing, and the last warning with
/// its subject.
fn standing(change: impl Fn(&mut Parameters)) -> (Vec<Event>, u32, u32) {
    let mut bench = Bench::new("humanoid");
    bench.robot.parameters.cross_check = Some(SETTINGS);
    change(&mut bench.robot.parameters);
    bench.cycle = Cycle::new(&bench.robot).unwrap();
    bench.run(2500);
    let record = bench.cycle.record();
    let counted = Event::ALL.iter().filter(|e| record.events[e.index()] > 0);
    let own = counted.filter(|e| (204..=208).contains(&e.number()));
    (
        own.copied().collect(),
        record.estimated.warning,
        record.estimated.warning_subject,
    )
}

#[test]
fn a_healthy_robot_has_no_warning() {
    assert_eq!(standing(|_| {}), (vec![], 0, 0));
}

#[test]
fn a_wrong_sign_of_the_current_is_reported() {
    let reported = standing(|p| {
        let motor = &mut p.joints[3].estimator.wave_generator;
        motor.torque_constant = -motor.torque_constant;
    });
    let number = Event::TorqueSign.number();
    assert_eq!(reported, (vec![Event::TorqueSign], number, 3));
}

#[test]
fn a_slipped_encoder_is_reported() {
    // As if the encoder had slipped before the start: the calibration has another angle.
    let reported = standing(|p| p.joints[3].estimator.kinematic_error.a0 += 1e-3);
    let number = Event::EncoderSlip.number();
    assert_eq!(reported, (vec![Event::EncoderSlip], number, 3));
}
