//! All estimators on the humanoid plant, whose model and sensors are not theirs: stepping in a
//! harness, with contact changes, bias, noise, hysteresis and friction. docs/results/whole-body.md
//! has the figures; here stand bounds that hold for other seeds too.

#[allow(dead_code)] // the results page uses the rest
mod walk;

use plant::SimParameters;
use walk::station::{Fault, Station, deviation, error, first_cause, in_the_air, lag};
use walk::{CHEST, WINDOW, contact, largest, rms, simulation};
use whole_body::{
    ContactKind, ContactSwitch, ContactSwitchParameters, Hypothesis, LoadRule, Tare, TareError,
    TareParameters, WholeBody,
};

/// Joints of both legs.
const LEGS: std::ops::Range<usize> = 0..12;

fn tared(seed: u64, window: usize) -> Station {
    let mut station = Station::new(&simulation(seed), window);
    station.run(1.5);
    station.tare(in_the_air());
    station.run(0.5);
    station
}

#[test]
fn torques_while_stepping() {
    let mut station = tared(2, WINDOW);
    let rest = station.record(0.7);
    station.walk.stepping_since = Some(station.walk.time());
    station.run(3.0);
    let t = station.record(5.0);
    for j in LEGS {
        let name = &station.walk.joints[j];
        let (truth, most) = (&t.truth[j], largest(&t.truth[j]));
        let late_now = error(&t.late[j], truth, 0.0);
        let now = error(&t.now[j], truth, 0.0);
        assert!(error(&t.late[j], truth, 39.5) < 0.06 * most, "{name}");
        assert!(
            now < 0.06 * most && now < 0.7 * late_now,
            "{name}: {now} of {most}"
        );
        assert!(
            now < 1.05 * error(&t.fast[j], truth, 0.0),
            "{name}: worse than encoders"
        );
        assert!(lag(&t.late[j], truth) > 30.0, "{name}");
        assert!(lag(&t.now[j], truth) < 4.0, "{name}");
        assert!(
            deviation(&rest.now[j]) < 2.0 * deviation(&rest.late[j]),
            "{name}"
        );
    }
    // With shorter filters: no more than the model's errors.
    let mut station = tared(2, 30);
    station.walk.stepping_since = Some(station.walk.time());
    station.run(3.0);
    let t = station.record(5.0);
    for j in LEGS {
        let e = error(&t.late[j], &t.truth[j], 14.5) / largest(&t.truth[j]);
        assert!(e < 0.03, "{}: {e}", station.walk.joints[j]);
    }
}

#[test]
fn a_tare_in_the_air_holds_in_other_poses() {
    let run = |pose: fn(&str) -> f64, tare: bool| {
        let mut station = Station::new(&simulation(3), 30);
        station.walk.pose = pose;
        station.run(2.5);
        if tare {
            station.tare(in_the_air());
        }
        station.walk.pose = |_| 0.0;
        station.run(1.0);
        let t = station.record(0.5);
        let legs: Vec<f64> = LEGS.map(|j| error(&t.late[j], &t.truth[j], 14.5)).collect();
        rms(&legs)
    };
    let same = run(|_| 0.0, true);
    let other = run(walk::bent, true);
    assert!(other < 1.2 * same, "{other} after {same}");
    assert!(same < 0.2 * run(|_| 0.0, false), "{same}: no use");
}

#[test]
fn a_moving_robot_is_not_tared() {
    let mut station = tared(1, WINDOW);
    station.walk.stepping_since = Some(station.walk.time());
    station.run(1.0);
    let mut p = station.parameters.clone();
    p.hypotheses[0].contacts = in_the_air();
    let mut tare = Tare::new(&station.model, &p, TareParameters::default()).unwrap();
    let refused = (0..600).find_map(|_| {
        let readings = station.walk.advance().clone();
        tare.add(&station.front.update(&readings)).err()
    });
    assert!(matches!(refused, Some(TareError::Moving(_))), "{refused:?}");
    assert!(matches!(tare.finish(), Err(TareError::TooFew(..))));
}

/// Standing on both feet, without a harness: the sum of the feet's wrenches becomes right, and how
/// they push against one another stays unknown and is told so.
#[test]
fn a_tare_on_both_feet() {
    let mut sim: SimParameters = simulation(1);
    (sim.harness, sim.start.on_ground) = (None, true);
    let mut station = Station::new(&sim, WINDOW);
    station.run(2.0);
    let standing = vec![
        contact(CHEST, ContactKind::Nothing),
        contact("left_foot", ContactKind::FullWrench),
        contact("right_foot", ContactKind::FullWrench),
        contact("left_hand", ContactKind::Nothing),
        contact("right_hand", ContactKind::Nothing),
    ];
    // Feet are parallel: their sensors' axes too.
    let vertical = |station: &Station| -> f64 {
        let corrected = station.walk.robot.readings().ft[..2]
            .iter()
            .zip(&station.front.conditioning);
        let mean = corrected.map(|(raw, c)| raw.force[2] - c.offset[2]);
        let truth: f64 = station.walk.truth().ft[..2]
            .iter()
            .map(|w| w.force[2])
            .sum();
        mean.sum::<f64>() - truth
    };
    let before = vertical(&station).abs();
    let results = station.tare(standing);
    let after: Vec<f64> = (0..200)
        .map(|_| {
            station.advance();
            vertical(&station)
        })
        .collect();
    let after = (after.iter().sum::<f64>() / 200.0).abs();
    // The masses are off by 1 %, so the weight is off by a few newtons at most.
    assert!(after < 4.0 && after < before, "{after} N after {before} N");
    assert!(
        results[..2].iter().all(|r| !r.known[2]),
        "how should it know?"
    );
    assert!(results[2..].iter().all(|r| r.known.iter().all(|k| *k)));
}

#[test]
fn faults_are_named_and_health_is_not() {
    let mut station = tared(2, WINDOW);
    station.walk.stepping_since = Some(station.walk.time());
    for _ in 0..6_000 {
        station.advance();
        let found = station.check.found();
        assert!(found.is_empty(), "{found:?} at {} s", station.walk.time());
    }
    let fault = |fault: Fault, expected: &str| {
        let (cause, after) = first_cause(fault, None);
        assert_eq!(cause, expected);
        assert!(
            after.parse::<f64>().unwrap() < 2.0,
            "{cause} after {after} s"
        );
    };
    let slip = Some((3, 9e-4));
    fault(
        Fault {
            slip,
            ..Fault::default()
        },
        "EncoderSlip { joint: 3 }",
    );
    let drift = Some((0, [20.0, -20.0, 30.0, 4.0, 6.0, 1.0]));
    fault(
        Fault {
            drift,
            ..Fault::default()
        },
        "FtDrift { sensor: 0 }",
    );
    let constant = Some((3, -1.0));
    fault(
        Fault {
            constant,
            ..Fault::default()
        },
        "TorqueSign { joint: 3 }",
    );
    let (cause, _) = first_cause(Fault::default(), Some(("right_hand", [0.0, 30.0, 0.0])));
    assert_eq!(cause, "MissingContact { sensor: 3 }");
}

/// Hypotheses that explain the harness by different links give different torques of the trunk;
/// the change from one to the other, at every foot-fall, is spread over the blending time.
#[test]
fn contacts_change_without_a_step() {
    let mut station = tared(1, 30);
    let mut p = station.parameters.clone();
    let mut other = p.hypotheses[0].contacts.clone();
    other[0] = contact("chest_yaw_link", ContactKind::FullWrench);
    p.hypotheses[0].name = "left foot down".into();
    p.hypotheses.push(Hypothesis {
        name: "left foot up".into(),
        contacts: other,
    });
    let mut blended = WholeBody::new(&station.model, &p).unwrap();
    let mut abrupt = blended.clone();
    let switch = |blend: f64| {
        ContactSwitch::new(
            2,
            4,
            ContactSwitchParameters {
                sample_period: walk::PERIOD,
                blend,
                rule: Some(LoadRule {
                    on: 60.0,
                    off: 30.0,
                    hold: 0.02,
                }),
                loaded: vec![vec![(0, true)], vec![(0, false)]],
            },
        )
    };
    let (mut smooth, mut hard) = (switch(0.3), switch(0.0));
    station.walk.stepping_since = Some(station.walk.time());
    let (mut last, mut steps, mut jumps) = (Vec::<[f64; 3]>::new(), [0.0f64; 3], 0);
    let mut wrong = 0;
    for k in 0..8_000 {
        let readings = station.walk.advance().clone();
        let input = station.front.update(&readings);
        let reference = station.whole_body.update(&input).tau.clone();
        blended.update(&input);
        abrupt.update(&input);
        let before = hard.target();
        smooth.update(&mut blended);
        hard.update(&mut abrupt);
        jumps += usize::from(hard.target() != before);
        let tau = |j: usize| {
            [
                reference[j],
                blended.estimate().tau[j],
                abrupt.estimate().tau[j],
            ]
        };
        let now: Vec<[f64; 3]> = (0..reference.len()).map(tau).collect();
        if k > 3000 {
            // Chest pitch carries what the two hypotheses do not agree on.
            for (step, (a, b)) in steps.iter_mut().zip(now[13].iter().zip(&last[13])) {
                *step = step.max((a - b).abs());
            }
            let down = station.walk.truth().external[0].wrench.force[2] > 100.0;
            wrong += usize::from(down != smooth.loaded(0));
        }
        last = now;
    }
    assert!((3..16).contains(&jumps), "{jumps} changes in three cycles");
    // Filters, hysteresis and hold make it late by some 40 ms a change.
    assert!(
        wrong < 100 * jumps,
        "{wrong} ms wrong about the foot in {jumps} changes"
    );
    let [alone, smooth, hard] = steps;
    let limit = 0.02 * 110.0;
    assert!(
        smooth < alone + limit,
        "step of {smooth} N·m, {alone} without a change"
    );
    assert!(
        hard > 3.0 * smooth,
        "{hard} N·m at once: nothing was blended"
    );
}
