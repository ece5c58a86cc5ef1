//! Feed-forward as a source, on the plant's joint: it corrects what gear and current are wrong by, and hides no
//! contact.

use crate::bench;

use bench::{PENDULUM, SEED, joint, rig, smooth};
use estimators::joint::JointTorqueEstimator;
use identification::all::{Step, fit_one};
use identification::log::LogRow;
use joint_file::JointFile;

const T: f64 = 1e-3;
/// The controller's model has a payload that is 10 % lighter.
const MODEL: f64 = 0.9;

/// Load on the link: torque at a time, and a wall that appears at a time, elastic, N·m/rad.
struct Contact {
    torque: fn(f64) -> f64,
    wall: Option<(f64, f64)>,
}

const NONE: Contact = Contact {
    torque: |_| 0.0,
    wall: None,
};

/// A log of the joint that follows `q(t)`, with the feed-forward of a model of the pendulum on the planned way.
fn log(seconds: f64, q: impl Fn(f64) -> f64, contact: &Contact) -> Vec<LogRow> {
    let mut rig = rig(PENDULUM, SEED);
    let planned = |t: f64| smooth(t) * q(t);
    let mut walled = false;
    (0..(seconds / T) as usize)
        .map(|i| {
            let t = T * i as f64;
            rig.command(planned(t));
            if let Some((_, stiffness)) = contact.wall.filter(|(at, _)| t >= *at && !walled) {
                walled = true;
                let angle = rig.advance((contact.torque)(t)).truth.q;
                rig.set_spring(stiffness, 0.01 * stiffness, angle);
            }
            let s = rig.advance((contact.torque)(t));
            let h = 5e-3;
            let ddq = (planned(t + h) - 2.0 * planned(t) + planned(t - h)) / (h * h);
            let model = PENDULUM.inertia * ddq + PENDULUM.weight(planned(t));
            LogRow {
                t,
                theta: s.reading.theta,
                q: s.reading.q,
                current: s.reading.current,
                tau_sensor: s.truth.tau,
                feed_forward: MODEL * model,
            }
        })
        .collect()
}

fn motion(t: f64) -> f64 {
    0.8 * (0.7 * t).sin() + 0.25 * (1.9 * t).sin()
}

/// The joint by a short log without an unloaded turn: its gear is known to some per cent.
fn fitted() -> JointFile {
    let rows = log(
        20.0,
        |t| 0.9 * (0.8 * t).sin() + 0.2 * (2.3 * t).cos(),
        &NONE,
    );
    let steps = [
        Step::CURRENT,
        Step::FEED_FORWARD,
        Step::HYSTERESIS,
        Step::FUSION,
    ];
    steps.into_iter().fold(joint(), |file, step| {
        fit_one(&file, &step, &rows, &mut |_, _| ()).unwrap().joint
    })
}

/// Fused torques of a log, with and without its feed-forward: torque and sigma.
fn fused(file: &JointFile, rows: &[LogRow], with: bool) -> Vec<(f64, f64)> {
    let mut set = file.estimators().unwrap();
    let mut front_end = file.front_end().unwrap();
    rows.iter()
        .map(|row| {
            let row = LogRow {
                feed_forward: if with { row.feed_forward } else { f64::NAN },
                ..*row
            };
            let fused = set.update(&row.sample(&mut front_end));
            (fused.tau, fused.sigma)
        })
        .collect()
}

fn rms(errors: impl Iterator<Item = f64>) -> f64 {
    let (mut square, mut count) = (0.0, 0.0);
    for error in errors {
        square += error * error;
        count += 1.0;
    }
    f64::sqrt(square / count)
}

fn errors<'a>(
    estimates: &'a [(f64, f64)],
    rows: &'a [LogRow],
    from: f64,
) -> impl Iterator<Item = (f64, f64)> + 'a {
    let both = estimates
        .iter()
        .zip(rows)
        .filter(move |(_, row)| row.t > from);
    both.map(|((tau, sigma), row)| (tau - row.tau_sensor, *sigma))
}

#[test]
fn it_corrects_and_its_sigma_holds() {
    let file = fitted();
    let rows = log(12.0, motion, &NONE);
    let [with, without] = [true, false].map(|with| fused(&file, &rows, with));
    let error = |e: &[(f64, f64)]| rms(errors(e, &rows, 1.5).map(|(error, _)| error));
    let ratio = rms(errors(&with, &rows, 1.5).map(|(error, sigma)| error / sigma));
    // How much it takes off depends on how wrong the others are and on both sigmas: a fifth of their error here.
    assert!(
        error(&with) < 0.85 * error(&without),
        "{} {}",
        error(&with),
        error(&without)
    );
    assert!((0.3..2.0).contains(&ratio), "{ratio}");
}

/// Change of the torques from just before a time to some time after it.
fn change(values: impl Fn(usize) -> f64, at: f64, after: f64) -> f64 {
    let [before, after] = [at - 0.002, at + after].map(|t| (t / T) as usize);
    values(after) - values(before)
}

/// The share of a contact's change of the torque that is shown with the feed-forward, over that without it.
fn shown(file: &JointFile, rows: &[LogRow], at: f64, after: f64) -> f64 {
    let [with, without] = [true, false].map(|with| fused(file, rows, with));
    let truth = change(|i| rows[i].tau_sensor, at, after);
    assert!(truth.abs() > 0.3, "{truth}");
    change(|i| with[i].0, at, after) / change(|i| without[i].0, at, after)
}

#[test]
fn collisions_show_at_once_and_stay() {
    let file = fitted();
    // In motion: at 0.4 rad/s against a wall, and blows of a quarter of the rated torque.
    let wall = Contact {
        wall: Some((4.0, 400.0)),
        ..NONE
    };
    let rows = log(5.0, motion, &wall);
    for after in [0.01, 0.02, 0.05, 0.1, 0.3] {
        let share = shown(&file, &rows, 4.0, after);
        assert!((0.9..1.1).contains(&share), "wall, {after} s: {share}");
    }
    for [low, high] in [[4.0, 4.05], [6.5, 7.5], [8.0, 12.0]] {
        let blow = Contact {
            torque: match low as u32 {
                4 => |t| if (4.0..4.05).contains(&t) { 4.0 } else { 0.0 },
                6 => |t| if (6.5..7.5).contains(&t) { -4.0 } else { 0.0 },
                _ => |t| if t > 8.0 { 4.0 } else { 0.0 },
            },
            ..NONE
        };
        let rows = log(high, motion, &blow);
        for after in [0.01, 0.02, 0.04, 0.9, 1.9, 3.9] {
            if low + after < high - 2.0 * T {
                let with = fused(&file, &rows, true);
                let without = fused(&file, &rows, false);
                let i = ((low + after) / T) as usize;
                // Against the same log without the contact, of the same motion.
                let quiet = log(high, motion, &NONE);
                let added = |e: &[(f64, f64)], q: &[(f64, f64)]| e[i].0 - q[i].0;
                let share = added(&with, &fused(&file, &quiet, true))
                    / added(&without, &fused(&file, &quiet, false));
                assert!(
                    (0.8..1.2).contains(&share),
                    "{low} s, {after} s later: {share}"
                );
            }
        }
    }
}

/// A hand that leans on a joint at rest, ever more.
#[test]
fn a_slow_push_at_rest_is_not_taken_for_an_error() {
    let file = fitted();
    let push = Contact {
        torque: |t| 0.5 * (t - 4.0).clamp(0.0, 8.0),
        ..NONE
    };
    let rows = log(14.0, |t| 0.6 * smooth((t - 1.0) / 1.5), &push);
    let share = shown(&file, &rows, 4.0, 9.5);
    assert!((0.95..1.05).contains(&share), "{share}");
}

/// A payload that neither training nor model had.
#[test]
fn a_payload_is_not_hidden_by_a_model_that_lacks_it() {
    let file = fitted();
    let load = Contact {
        torque: |t| {
            if t > 3.0 {
                -6.0 * smooth((t - 3.0) / 0.3)
            } else {
                0.0
            }
        },
        ..NONE
    };
    let rows = log(12.0, motion, &load);
    let [with, without] = [true, false].map(|with| fused(&file, &rows, with));
    let error = |e: &[(f64, f64)]| rms(errors(e, &rows, 3.5).map(|(error, _)| error));
    assert!(
        error(&with) < 1.3 * error(&without) + 0.2,
        "{} {}",
        error(&with),
        error(&without)
    );
    let ratio = rms(errors(&with, &rows, 3.5).map(|(error, sigma)| error / sigma));
    assert!(ratio < 2.0, "{ratio}");
}
