//! What the page gets of each record: a row of numbers.

use torqued_client::robot_state::{SharedRecord, TorqueEstimate, torque_flags};

/// Signals of each joint, in the row's order; the page names and draws them.
pub(super) const JOINT_SIGNALS: [&str; 16] = [
    "q",
    "dq",
    "torsion",
    "current",
    "tau",
    "sigma",
    "tau_encoder",
    "tau_whole_body",
    "tau_current",
    "tau_d",
    "tau_ext",
    "contact_ratio",
    "tau_residual",
    "q_c",
    "current_c",
    "following_error",
];

/// Signals of the loop, before those of the joints.
pub(super) const LOOP_SIGNALS: [&str; 6] = [
    "compute_us",
    "wake_late_us",
    "gather_us",
    "send_us",
    "state",
    "mode",
];

/// Numbers of an F/T sensor's contact wrench, behind those of the joints.
pub(super) const WRENCH: usize = 6;

/// Numbers in a row.
pub(super) fn width(joints: usize, sensors: usize) -> usize {
    LOOP_SIGNALS.len() + joints * JOINT_SIGNALS.len() + sensors * WRENCH
}

/// Appends a record's row. A number that is not valid is NaN: the page leaves a gap.
pub(super) fn append(row: &mut Vec<f32>, record: &SharedRecord, (joints, sensors): (usize, usize)) {
    let (cycle, timing) = (&record.cycle, &record.timing);
    let us = |ns: u64| (ns as f64 * 1e-3) as f32;
    row.extend([
        us(timing.compute_ns),
        us(timing.wake_late_ns),
        us(timing.gather_ns),
        us(timing.send_ns),
        cycle.state as f32,
        cycle.mode as f32,
    ]);
    for j in 0..joints {
        let measured = &cycle.measured.joints[j];
        let estimated = &cycle.estimated.joints[j];
        let commanded = &cycle.commanded.joints[j];
        let best = best(&[
            estimated.tau_hat,
            estimated.tau_encoder,
            estimated.tau_whole_body,
            estimated.tau_current,
        ]);
        let signals: [f64; JOINT_SIGNALS.len()] = [
            measured.q,
            measured.dq,
            measured.torsion,
            measured.current,
            best.map_or(f64::NAN, |best| best.tau),
            best.map_or(f64::NAN, |best| best.sigma),
            valid(&estimated.tau_encoder),
            valid(&estimated.tau_whole_body),
            valid(&estimated.tau_current),
            commanded.tau_d,
            estimated.tau_ext,
            estimated.contact_ratio,
            valid(&estimated.tau_encoder) - valid(&estimated.tau_whole_body),
            commanded.q_c,
            commanded.current_c,
            commanded.following_error,
        ];
        row.extend(signals.map(|x| x as f32));
    }
    for sensor in &cycle.estimated.ft[..sensors] {
        row.extend(sensor.contact_wrench.to_array().map(|x| x as f32));
    }
}

fn is_valid(estimate: &TorqueEstimate) -> bool {
    estimate.flags & torque_flags::VALID != 0
}

fn valid(estimate: &TorqueEstimate) -> f64 {
    if is_valid(estimate) {
        estimate.tau
    } else {
        f64::NAN
    }
}

/// The first that is valid: the delay-compensated torque where there is one.
fn best(estimates: &[TorqueEstimate]) -> Option<TorqueEstimate> {
    estimates.iter().copied().find(is_valid)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_has_every_signal_and_gaps_where_a_torque_is_not_valid() {
        let mut record = SharedRecord::default();
        record.timing.compute_ns = 81_500;
        let joint = &mut record.cycle.estimated.joints[1];
        (joint.tau_hat.tau, joint.tau_encoder.tau) = (7.0, 2.5);
        (joint.tau_encoder.sigma, joint.tau_encoder.flags) = (0.5, torque_flags::VALID);
        record.cycle.estimated.ft[0].contact_wrench.force[2] = 9.0;
        let mut row = Vec::new();
        append(&mut row, &record, (2, 1));
        assert_eq!(row.len(), width(2, 1));
        assert_eq!(row[0], 81.5);
        let of = |joint: usize, name: &str| {
            let signal = JOINT_SIGNALS.iter().position(|s| *s == name).unwrap();
            row[LOOP_SIGNALS.len() + joint * JOINT_SIGNALS.len() + signal]
        };
        // tau_hat is not valid: the torque shown is the next best.
        assert_eq!((of(1, "tau"), of(1, "sigma")), (2.5, 0.5));
        assert!(of(0, "tau").is_nan() && of(1, "tau_whole_body").is_nan());
        assert!(of(1, "tau_residual").is_nan());
        assert_eq!(row[row.len() - 4], 9.0);
    }
}
