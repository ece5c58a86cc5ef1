//! Tare of the humanoid plant standing on one foot: nothing else touches it.

use crate::walk;

use plant::SimParameters;
use std::cell::Cell;
use walk::station::Station;
use walk::{CHEST, OURS, contact, largest, simulation};
use whole_body::{ContactKind, ContactParameters, Tare, TareParameters, TareResult};

/// Samples of which errors are averages.
const AVERAGED: usize = 200;

/// Sideways lean of the legs, rad.
const SHIFT: f64 = 0.15;

thread_local! {
    /// How far the robot has shifted its weight to the left foot, and drawn the right one up.
    static STAGE: Cell<[f64; 2]> = const { Cell::new([0.0; 2]) };
}

/// The stance on the left foot, as far as the stage has come.
fn on_the_left(joint: &str) -> f64 {
    let [shifted, drawn] = STAGE.get();
    match joint {
        "left_hip_roll" | "right_hip_roll" => -SHIFT * shifted,
        "left_ankle_roll" | "right_ankle_roll" => SHIFT * shifted,
        "right_hip_pitch" | "right_ankle_pitch" => -0.25 * drawn,
        "right_knee" => 0.5 * drawn,
        _ => 0.0,
    }
}

/// Runs while one of the stages rises to 1.
fn rise(station: &mut Station, stage: usize, seconds: f64) {
    let steps = (seconds / walk::PERIOD) as usize;
    for k in 1..=steps {
        let share = k as f64 / steps as f64;
        let mut at = STAGE.get();
        // Begins and ends at rest.
        at[stage] = share * share * (3.0 - 2.0 * share);
        STAGE.set(at);
        station.advance();
    }
}

fn one_foot() -> Vec<ContactParameters> {
    vec![
        contact(CHEST, ContactKind::Nothing),
        contact("left_foot", ContactKind::FullWrench),
        contact("right_foot", ContactKind::Nothing),
        contact("left_hand", ContactKind::Nothing),
        contact("right_hand", ContactKind::Nothing),
    ]
}

/// A humanoid on its left foot, its sensors not yet tared.
fn standing(seed: u64) -> Station {
    STAGE.set([0.0; 2]);
    let mut sim: SimParameters = simulation(seed);
    (sim.harness, sim.start.on_ground) = (None, true);
    let mut station = Station::new(&sim, OURS);
    station.walk.pose = on_the_left;
    station.run(0.5);
    rise(&mut station, 0, 3.0);
    station.run(0.5);
    rise(&mut station, 1, 1.5);
    station.run(5.0);
    let feet = &station.walk.truth().external;
    let [left, right] = [0, 1].map(|f| largest(&feet[f].wrench.force));
    assert!(
        left > 200.0 && right < 1e-9,
        "on one foot: {left} N, {right} N"
    );
    station
}

/// Errors of all sensors' readings, sensor by sensor, averaged.
fn errors(station: &mut Station) -> Vec<[f64; 6]> {
    let mut sums = vec![[0.0; 6]; station.front.conditioning.len()];
    for _ in 0..AVERAGED {
        station.advance();
        let (readings, truth) = (station.walk.robot.readings(), station.walk.truth());
        for (s, sum) in sums.iter_mut().enumerate() {
            let (shown, true_) = (&readings.ft[s], &truth.ft[s]);
            let offset = &station.front.conditioning[s].offset;
            for k in 0..3 {
                sum[k] += (shown.force[k] - offset[k] - true_.force[k]) / AVERAGED as f64;
                sum[3 + k] += (shown.torque[k] - offset[3 + k] - true_.torque[k]) / AVERAGED as f64;
            }
        }
    }
    sums
}

/// Takes the offsets over that a tare of two seconds finds: the robot sways, once a second.
fn tare(station: &mut Station) -> Vec<TareResult> {
    let mut p = station.parameters.clone();
    p.hypotheses[0].contacts = one_foot();
    let parameters = TareParameters {
        samples: 2000,
        ..TareParameters::default()
    };
    let mut tare = Tare::new(&station.model, &p, parameters).unwrap();
    for _ in 0..2000 {
        let readings = station.walk.advance().clone();
        tare.add(&station.front.update(&readings)).unwrap();
    }
    let results = tare.finish().unwrap();
    for (c, result) in station.front.conditioning.iter_mut().zip(&results) {
        c.correct(&result.correction);
    }
    results
}

#[test]
fn a_tare_on_one_foot_knows_every_sensor() {
    for seed in [1, 4] {
        let mut station = standing(seed);
        let before = errors(&mut station);
        let results = tare(&mut station);
        let after = errors(&mut station);
        for (s, result) in results.iter().enumerate() {
            let name = &result.sensor;
            assert!(result.known.iter().all(|k| *k), "{name}: {result:?}");
            let load = &station.walk.truth().ft[s];
            for (k, sigma) in result.sigma.iter().enumerate() {
                let axes = if k < 3 { &load.force } else { &load.torque };
                // Forces of one axis are felt by the others, and no tare can know that.
                let cross_talk = 0.002 * largest(axes);
                let one: f64 = if k < 3 { 0.3 } else { 0.02 };
                let noise = one / f64::sqrt(AVERAGED as f64);
                let limit = 3.0 * sigma.hypot(noise) + cross_talk;
                let error = after[s][k].abs();
                assert!(error < limit, "{name}[{k}]: {error}, at most {limit}");
            }
            // 10 N and 1 N·m of bias are drawn.
            let share = if s == 0 { 0.3 } else { 0.05 };
            let [was, is] = [&before[s], &after[s]].map(|e| largest(&e[..3]));
            assert!(is < share * was, "{name}: {is} N after {was} N");
        }
    }
}
