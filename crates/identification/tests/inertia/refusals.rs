//! Logs that are refused, each with its likely cause.

use super::*;

/// A bad log for each reason, and a part of the message.
#[test]
fn wrong_logs_are_refused_with_the_likely_cause() {
    let log = Recorded {
        seconds: 15.0,
        ..RECORDED
    }
    .log(&other(6));
    let with = |change: &dyn Fn(&mut RobotLog)| {
        let mut bad = log.clone();
        change(&mut bad);
        found(&[bad], &[]).map(|_| ()).unwrap_err().to_string()
    };
    let joint = |log: &mut RobotLog, k: usize| -> JointColumns { log.joints[k].clone().unwrap() };
    let set = |log: &mut RobotLog, k: usize, columns: JointColumns| log.joints[k] = Some(columns);
    let scaled = |x: &[f64], k: f64| x.iter().map(|x| x * k).collect::<Vec<f64>>();
    let derivative = |q: &[f64]| -> Vec<f64> {
        (0..q.len())
            .map(|k| 100.0 * (q[(k + 1).min(q.len() - 1)] - q[k.saturating_sub(1)]))
            .collect()
    };
    let cases: Vec<(String, &str)> = vec![
        (
            with(&|l| l.t.iter_mut().for_each(|t| *t *= 1e3)),
            "is t in ms?",
        ),
        (
            with(&|l| l.t.iter_mut().for_each(|t| *t *= 1e6)),
            "is t in us?",
        ),
        (with(&|l| l.t.reverse()), "t runs backwards"),
        (
            with(&|l| {
                (0..4).for_each(|k| {
                    let c = joint(l, k);
                    set(
                        l,
                        k,
                        JointColumns {
                            q: scaled(&c.q, 57.3),
                            ..c
                        },
                    );
                });
            }),
            "is it in degrees?",
        ),
        (
            with(&|l| {
                let c = joint(l, 1);
                set(
                    l,
                    1,
                    JointColumns {
                        tau: scaled(&c.tau, -1.0),
                        ..c
                    },
                );
            }),
            "its sign is opposite",
        ),
        (
            with(&|l| {
                (0..4).for_each(|k| {
                    let c = joint(l, k);
                    set(
                        l,
                        k,
                        JointColumns {
                            tau: scaled(&c.tau, 1e3),
                            ..c
                        },
                    );
                });
            }),
            "is it in mN·m?",
        ),
        (
            with(&|l| {
                (0..4).for_each(|k| {
                    let c = joint(l, k);
                    set(
                        l,
                        k,
                        JointColumns {
                            dq: scaled(&derivative(&c.q), 57.3),
                            ..c
                        },
                    );
                });
            }),
            "is it in deg/s",
        ),
        (
            with(&|l| {
                (0..4).for_each(|k| {
                    let c = joint(l, k);
                    let other = joint(l, (k + 1) % 4);
                    set(
                        l,
                        k,
                        JointColumns {
                            dq: derivative(&other.q),
                            ..c
                        },
                    );
                });
            }),
            "are columns swapped?",
        ),
        (
            with(&|l| {
                let c = joint(l, 2);
                set(
                    l,
                    2,
                    JointColumns {
                        tau: vec![0.0; c.tau.len()],
                        ..c
                    },
                );
            }),
            "tau of `extend` is 0 in every row",
        ),
        (
            with(&|l| {
                (0..4).for_each(|k| {
                    let c = joint(l, k);
                    set(
                        l,
                        k,
                        JointColumns {
                            q: vec![c.q[0]; c.q.len()],
                            ..c
                        },
                    );
                });
            }),
            "no joint moves",
        ),
        (
            with(&|l| {
                l.t.truncate(400);
                l.joints.iter_mut().flatten().for_each(|c| {
                    c.q.truncate(400);
                    c.tau.truncate(400);
                });
            }),
            "s of motion without gaps",
        ),
        (
            with(&|l| {
                // Torques of another time.
                l.joints
                    .iter_mut()
                    .flatten()
                    .for_each(|c| c.tau.rotate_left(1000));
            }),
            "the URDF's bodies and friction explain",
        ),
    ];
    for (message, part) in &cases {
        assert!(
            message.contains(part) && message.contains("run.csv"),
            "{part}: {message}"
        );
    }
}

/// Torques on the motor's side of one gear, torques that end at a bound, a log that runs backwards, gravity that a
/// controller has taken off: each by its cause.
#[test]
fn torques_that_are_none_of_the_joints_are_refused_with_the_cause() {
    let log = Recorded {
        seconds: 20.0,
        ..RECORDED
    }
    .log(&other(6));
    let with = |change: &dyn Fn(usize, &mut JointColumns)| {
        let mut bad = log.clone();
        let joints = bad.joints.iter_mut().flatten().enumerate();
        joints.for_each(|(k, columns)| change(k, columns));
        match found(&[bad], &[]) {
            Ok(calibration) => calibration.contradictions.join("; "),
            Err(problems) => problems.to_string(),
        }
    };
    let each = |x: &mut Vec<f64>, of: &dyn Fn(f64) -> f64| x.iter_mut().for_each(|x| *x = of(*x));
    let most = |x: &[f64]| x.iter().fold(0.0f64, |most, x| most.max(x.abs()));
    let cases = [
        (
            with(&|k, c| each(&mut c.tau, &|x| if k == 1 { x / 101.0 } else { x })),
            "on the motor's side of the gear",
        ),
        (
            with(&|_, c| each(&mut c.tau, &|x| x / 8.0)),
            "times the URDF's torques: a motor current",
        ),
        (
            with(&|k, c| {
                let bound = 0.6 * most(&c.tau);
                each(&mut c.tau, &|x| {
                    if k == 1 { x.clamp(-bound, bound) } else { x }
                });
            }),
            "while the joint moves: its measurement ends there",
        ),
        (
            with(&|_, c| {
                c.q.reverse();
                c.tau.reverse();
            }),
            "does the log run backwards in time?",
        ),
    ];
    for (message, part) in &cases {
        assert!(message.contains(part), "{part}: {message}");
    }
}
