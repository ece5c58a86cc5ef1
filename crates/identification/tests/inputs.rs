//! Wrong logs are refused with their cause, right ones pass: the plant's joint on its bench, and
//! what users do to its logs.

use crate::bench;

use identification::excitation::Quantity;
use identification::inputs::{Inspection, LogKind, inspect};
use identification::log::LogRow;
use joint_file::JointFile;
use problem::Problems;
use std::f64::consts::{PI, TAU};
use std::sync::LazyLock;

static TURN: LazyLock<Vec<LogRow>> = LazyLock::new(bench::turn);
static TRAIN: LazyLock<Vec<LogRow>> = LazyLock::new(|| bench::training(40.0, 0.6));

/// The training log with every row changed.
fn changed(change: impl FnMut(&mut LogRow)) -> Vec<LogRow> {
    let mut rows = TRAIN.clone();
    rows.iter_mut().for_each(change);
    rows
}

/// The training log with every row changed by its place.
fn placed(change: impl Fn(usize, &mut LogRow)) -> Vec<LogRow> {
    let mut rows = TRAIN.clone();
    rows.iter_mut()
        .enumerate()
        .for_each(|(i, row)| change(i, row));
    rows
}

fn training(rows: &[LogRow]) -> Result<Inspection, Problems> {
    inspect(&bench::joint(), rows, LogKind::Training)
}

/// The log is refused, and one of the reasons contains `expected`.
fn refused(name: &str, found: Result<Inspection, Problems>, expected: &str) {
    match found {
        Ok(inspection) => panic!("{name}: accepted\n{}", inspection.lines().join("\n")),
        Err(problems) => {
            let text = problems.to_string();
            assert!(text.contains(expected), "{name}: {expected}\n{text}");
        }
    }
}

#[test]
fn right_logs_pass() {
    inspect(&bench::joint(), &TURN, LogKind::NoLoad).unwrap();
    let inspection = training(&TRAIN).unwrap();
    let excitation = inspection.excitation.unwrap();
    for quantity in [
        Quantity::Compliance,
        Quantity::Skew,
        Quantity::TorqueConstant,
    ] {
        assert!(excitation.determines(quantity), "{quantity:?}");
    }
    let k = 1.0 / excitation.measured(Quantity::Compliance).unwrap().value;
    assert!((6000.0..12_000.0).contains(&k), "{k}");
    for (name, rows) in bench::scenarios() {
        let lines = training(&rows)
            .unwrap_or_else(|p| panic!("{name}: {p}"))
            .lines();
        assert!(lines[1].starts_with("torque"), "{name}");
    }
}

#[test]
fn units_and_signs() {
    let deg = 180.0 / PI;
    let cases: [(&str, Vec<LogRow>, &str); 15] = [
        ("t in ms", changed(|r| r.t *= 1e3), "`t` is in ms"),
        ("t in us", changed(|r| r.t *= 1e6), "`t` is in us"),
        (
            "theta reversed",
            changed(|r| r.theta = -r.theta),
            "reversed",
        ),
        ("q reversed", changed(|r| r.q = -r.q), "reversed"),
        (
            "both reversed",
            changed(|r| (r.theta, r.q) = (-r.theta, -r.q)),
            "`theta` and `q` together",
        ),
        (
            "theta in degrees",
            changed(|r| r.theta *= deg),
            "`theta` is in degrees",
        ),
        ("q in degrees", changed(|r| r.q *= deg), "`q` is in degrees"),
        (
            "both in degrees",
            changed(|r| (r.theta, r.q) = (r.theta * deg, r.q * deg)),
            "degrees",
        ),
        (
            "theta in counts",
            changed(|r| r.theta *= 4096.0 / TAU),
            "`theta` is in counts",
        ),
        (
            "theta on the link side",
            changed(|r| r.theta /= 100.0),
            "already divided",
        ),
        (
            "swapped",
            changed(|r| (r.theta, r.q) = (r.q, r.theta)),
            "swapped",
        ),
        ("i in mA", changed(|r| r.current *= 1e3), "unit of `i`"),
        (
            "i reversed",
            changed(|r| r.current = -r.current),
            "reversed",
        ),
        (
            "tau reversed",
            changed(|r| r.tau_sensor = -r.tau_sensor),
            "reversed",
        ),
        (
            "tau in N mm",
            changed(|r| r.tau_sensor *= 1e3),
            "another unit",
        ),
    ];
    for (name, rows, expected) in cases {
        refused(name, training(&rows), expected);
    }
}

#[test]
fn channels() {
    let first = TRAIN[0];
    let held = |n: usize| placed(move |i, r| r.q = TRAIN[i / n * n].q);
    let cases: [(&str, Vec<LogRow>, &str); 15] = [
        (
            "i constant",
            changed(|r| r.current = first.current),
            "`i` is constant",
        ),
        ("q constant", changed(|r| r.q = first.q), "`q` is constant"),
        (
            "theta constant",
            changed(|r| r.theta = first.theta),
            "`theta` is constant",
        ),
        (
            "tau constant",
            changed(|r| r.tau_sensor = 2.0),
            "`tau_sensor` is constant",
        ),
        (
            "no tau",
            changed(|r| r.tau_sensor = f64::NAN),
            "stiffness is not determined",
        ),
        (
            "i and tau swapped",
            changed(|r| (r.current, r.tau_sensor) = (r.tau_sensor, r.current)),
            "columns swapped",
        ),
        (
            "q of another joint",
            changed(|r| r.q = 0.8 * (0.7 * r.t).sin()),
            "same link",
        ),
        ("q held", held(8), "sampled more slowly"),
        (
            "i clipped",
            changed(|r| r.current = r.current.clamp(-1.5, 1.5)),
            "`i` is clipped at",
        ),
        (
            "tau clipped",
            changed(|r| r.tau_sensor = r.tau_sensor.clamp(-5.0, 5.0)),
            "`tau_sensor` is clipped",
        ),
        (
            "joined",
            placed(|i, r| {
                if i > 20_000 {
                    r.theta += 5.0
                }
            }),
            "joined",
        ),
        (
            "scaled copy",
            changed(|r| r.tau_sensor = 4.7 * r.current - 0.2),
            "computed from the current",
        ),
        (
            "late copy",
            placed(|i, r| r.tau_sensor = 5.0 * TRAIN[i.saturating_sub(10)].current),
            "computed from",
        ),
        (
            "feed-forward as reference",
            changed(|r| r.feed_forward = 1.1 * r.tau_sensor + 0.3),
            "computed from the feed-forward",
        ),
        (
            "current as feed-forward",
            changed(|r| r.feed_forward = 5.0 * r.current),
            "`tau_feedforward` is computed from the current",
        ),
    ];
    for (name, rows, expected) in cases {
        refused(name, training(&rows), expected);
    }
}

/// What has one mending is mended, and said.
#[test]
fn wraps_and_bad_samples_are_mended() {
    let wrapped = training(&changed(|r| r.theta = r.theta.rem_euclid(TAU))).unwrap();
    let said = wrapped.notes.join("\n");
    assert!(
        said.contains("`theta` wraps") && said.contains("unwrapped"),
        "{said}"
    );
    let shift = wrapped.mended[0].theta - TRAIN[0].theta;
    assert!(
        (shift / TAU - (shift / TAU).round()).abs() < 1e-9,
        "{shift}"
    );
    for (a, b) in wrapped.mended.iter().zip(&*TRAIN) {
        assert!((a.theta - shift - b.theta).abs() < 1e-9);
    }
    let zeros = training(&placed(|i, r| {
        if i % 9001 == 4000 {
            r.tau_sensor = 400.0;
        }
    }));
    let zeros = zeros.unwrap();
    assert_eq!(zeros.mended.len(), TRAIN.len());
    let said = zeros.notes.join("\n");
    assert!(
        said.contains("`tau_sensor`: 4 samples that no neighbour confirms"),
        "{said}"
    );
    assert!(
        zeros
            .mended
            .iter()
            .zip(&*TRAIN)
            .all(|(a, b)| (a.tau_sensor - b.tau_sensor).abs() < 2.0)
    );
    let kept = training(&placed(|i, r| {
        if (12_000..16_000).contains(&i) {
            r.tau_sensor = TRAIN[12_000].tau_sensor;
        }
    }));
    let kept = kept.unwrap();
    assert_eq!(kept.mended.len(), TRAIN.len() - 4000, "{:?}", kept.notes);
}

#[test]
fn stamps_and_joint_file() {
    let irregular = placed(|i, r| r.t += 4e-4 * ((i * i) as f64).sin());
    refused("irregular", training(&irregular), "irregular");
    let lost: Vec<LogRow> = TRAIN
        .iter()
        .enumerate()
        .filter(|(i, _)| i * i % 7 < 2)
        .map(|(_, r)| *r)
        .collect();
    refused("lost rows", training(&lost), "missing");
    refused("a few rows", training(&TRAIN[..20]), "the log has 20 rows");
    refused(
        "loaded turn",
        inspect(&bench::joint(), &TRAIN, LogKind::NoLoad),
        "the turn is loaded",
    );
    let other = |change: fn(&mut JointFile)| {
        let mut joint = bench::joint();
        change(&mut joint);
        inspect(&joint, &TRAIN, LogKind::Training)
    };
    refused(
        "rate",
        other(|j| j.joint.sample_rate = 500.0),
        "1000.000 Hz are not",
    );
    refused(
        "ratio",
        other(|j| j.joint.gear_ratio = 101.0),
        "gear ratio of 100.0",
    );
    refused(
        "constant",
        other(|j| j.joint.torque_constant = 0.5),
        "`torque_constant_Nm_per_A`",
    );
    refused(
        "rated torque",
        other(|j| j.joint.rated_torque = 16e3),
        "rated torque",
    );
}

#[test]
fn a_log_without_motion_does_not_determine_the_skew() {
    // The first second brings the joint to its place.
    let rest = bench::scenarios().pop().unwrap().1.split_off(1500);
    let excitation = training(&rest).unwrap().excitation.unwrap();
    assert!(!excitation.determines(Quantity::Skew));
    assert!(!excitation.determines(Quantity::Friction));
    let lines = excitation.lines().join("\n");
    assert!(
        lines.contains("skew: not determined by this log; prior 0.0 ± 2.0 ms"),
        "{lines}"
    );
}

/// A current in another unit shows by its size, also where no torque is known.
#[test]
fn a_current_in_ma_is_refused_without_a_reference() {
    let run = |factor: f64| {
        let rows = changed(|r| (r.current, r.tau_sensor) = (factor * r.current, f64::NAN));
        inspect(&bench::joint(), &rows, LogKind::Run)
    };
    run(1.0).unwrap();
    refused("i in mA", run(1e3), "is `i` in mA?");
    refused("i in uA", run(1e7), "unit of `i`");
}

/// Which channel changes its sign, and when: the torsion tells the current from the reference.
#[test]
fn a_changed_sign_is_placed() {
    let behind = TRAIN.len() / 3;
    let at = TRAIN[behind].t;
    type Turn = (&'static str, fn(&mut LogRow));
    let turned: [Turn; 2] = [
        ("i", |r| r.current = -r.current),
        ("tau_sensor", |r| r.tau_sensor = -r.tau_sensor),
    ];
    for (name, turn) in turned {
        let rows = placed(|k, r| {
            if k >= behind {
                turn(r);
            }
        });
        let text = training(&rows).unwrap_err().to_string();
        let expected = format!("the sign of `{name}` changes within the log (t = ");
        let (_, rest) = text
            .split_once(&expected)
            .unwrap_or_else(|| panic!("{name}: {text}"));
        let said: f64 = rest.split_once(' ').unwrap().0.parse().unwrap();
        assert!((said - at).abs() < 0.2, "{name}: {said} for {at}");
    }
}

/// A current that lost its sign spoils an estimate too; a reference that did not keep its own does not.
#[test]
fn a_current_without_its_sign_is_refused_in_every_log() {
    for kind in [LogKind::Training, LogKind::Current, LogKind::Run] {
        let inspected = |rows: &[LogRow]| inspect(&bench::joint(), rows, kind);
        inspected(&TRAIN).unwrap();
        let sizes = changed(|r| r.current = r.current.abs());
        refused(&format!("{kind:?}"), inspected(&sizes), "`i` has no sign");
    }
    let half = TRAIN.len() / 2;
    let rows = placed(|k, r| {
        if k >= half {
            r.tau_sensor = -r.tau_sensor;
        }
    });
    let notes = inspect(&bench::joint(), &rows, LogKind::Run).unwrap().notes;
    let said = "the sign of `tau_sensor` changes within the log";
    assert!(notes.iter().any(|note| note.contains(said)), "{notes:?}");
}
