//! Random channels with one defect each are named and mended; sound ones are left as they are.

use inspection::{Channel, Defect, Inspected, Quantity, Severity, inspect, range_of_wraps, unwrap};
use std::f64::consts::{PI, TAU};
use test_support::Random;

const ROWS: usize = 1500;

/// A motion of some sines with an encoder's steps, and now and then a rest.
fn angle(random: &mut Random) -> Vec<f64> {
    let waves: Vec<[f64; 3]> = (1..4)
        .map(|k| {
            let k = f64::from(k);
            [
                (0.5 + random.unit()) / k,
                0.0015 * k * (0.7 + 0.6 * random.unit()),
                TAU * random.unit(),
            ]
        })
        .collect();
    let step = [1e-6, 1e-5, 1e-4][random.below(3)];
    let rests = random.below(2) == 1;
    let mut time = 0.0;
    (0..ROWS)
        .map(|row| {
            // The motion slows down, rests and sets off again.
            let pace = if rests && (300..900).contains(&row) {
                (1.0 - (row - 300).min(899 - row) as f64 / 40.0).max(0.0)
            } else {
                1.0
            };
            time += pace;
            let row: f64 = time;
            let sum = |w: &[f64; 3]| w[0] * (TAU * w[1] * row + w[2]).sin();
            let q: f64 = waves.iter().map(sum).sum::<f64>() + 2e-5 * random.normal();
            (q / step).round() * step
        })
        .collect()
}

/// A torque: gravity of that motion, friction that changes its sign, noise.
fn torque(q: &[f64], random: &mut Random) -> Vec<f64> {
    let coulomb = 2.0 * random.unit();
    let each = (0..q.len()).map(|k| {
        let k = k.clamp(2, q.len() - 3);
        let v = q[k + 2] - q[k - 2];
        20.0 * q[k].sin() + coulomb * (v / 4e-3).tanh() + 0.05 * random.normal()
    });
    each.collect()
}

fn inspected(quantity: Quantity, values: &[f64]) -> Inspected {
    let t: Vec<f64> = (0..values.len()).map(|k| k as f64 / 100.0).collect();
    let name = "q of `elbow`";
    inspect(
        &t,
        Channel {
            name,
            quantity,
            values,
        },
    )
}

fn has(found: &Inspected, defect: Defect) -> bool {
    found.findings.iter().any(|f| f.defect == defect)
}

#[test]
fn sound_channels_are_left_as_they_are() {
    let mut wrong = 0;
    for seed in 0..400 {
        let mut random = Random::new(seed);
        let q = angle(&mut random);
        let tau = torque(&q, &mut random);
        for (quantity, values) in [(Quantity::Angle, &q), (Quantity::Effort, &tau)] {
            let found = inspected(quantity, values);
            wrong += usize::from(!found.findings.is_empty() || found.values != *values);
        }
    }
    assert!(wrong <= 8, "{wrong} of 800 sound channels have findings");
}

#[test]
fn wraps_are_taken_out() {
    for seed in 0..200 {
        let mut random = Random::new(seed);
        let whole: Vec<f64> = angle(&mut random).iter().map(|q| q + PI).collect();
        let wrapped: Vec<f64> = whole.iter().map(|q| q - TAU * (q / TAU).round()).collect();
        let found = inspected(Quantity::Angle, &wrapped);
        let wraps = wrapped.windows(2).any(|w| (w[1] - w[0]).abs() > PI);
        assert_eq!(has(&found, Defect::Wrapped), wraps, "seed {seed}");
        let shift = whole[0] - found.values[0];
        let off = whole
            .iter()
            .zip(&found.values)
            .map(|(a, b)| (a - b - shift).abs());
        let off = off.fold(0.0, f64::max);
        assert!(off < 1e-9, "seed {seed}: {off} {:?}", found.findings);
        let notes = found.findings.iter().all(|f| f.severity == Severity::Note);
        assert!(notes, "seed {seed}: {:?}", found.findings);
    }
}

/// A current whose register is too short: nobody has named its range.
#[test]
fn a_range_that_nobody_named_is_found() {
    for seed in 0..100 {
        let mut random = Random::new(seed);
        let size = 40.0 + 10.0 * random.unit();
        let pace = 0.015 * (0.8 + 0.4 * random.unit());
        let whole: Vec<f64> = (0..ROWS)
            .map(|k| size * (pace * k as f64).sin() + 0.02 * random.normal())
            .collect();
        let range = 47.2;
        let mut wrapped: Vec<f64> = whole
            .iter()
            .map(|x| x - range * (x / range).round())
            .collect();
        let found = range_of_wraps(&wrapped).unwrap();
        assert!((found / range - 1.0).abs() < 0.03, "seed {seed}: {found}");
        assert_eq!(range_of_wraps(&whole), None, "seed {seed}");
        unwrap(&mut wrapped, range);
        let off = whole.iter().zip(&wrapped).map(|(a, b)| (a - b).abs());
        assert!(off.fold(0.0, f64::max) < 1e-9);
    }
}

/// Noise at a bound takes wraps back and repeats them; spikes to one value do so too, but nothing stays across.
#[test]
fn noise_at_a_bound_hides_no_wraps() {
    for seed in 0..100 {
        let mut random = Random::new(seed);
        let (range, pace) = (47.2, 0.015 * (0.8 + 0.4 * random.unit()));
        let whole: Vec<f64> = (0..ROWS)
            .map(|k| 30.0 * (pace * k as f64).sin() + 0.6 * random.normal())
            .collect();
        let wrapped: Vec<f64> = whole
            .iter()
            .map(|x| x - range * (x / range).round())
            .collect();
        let found = range_of_wraps(&wrapped).unwrap_or(0.0);
        assert!((found / range - 1.0).abs() < 0.04, "seed {seed}: {found}");
        let mut spiked: Vec<f64> = (0..ROWS).map(|_| 0.2 * random.normal()).collect();
        (0..6).for_each(|k| spiked[100 + 200 * k + random.below(150)] = -30.0);
        assert_eq!(range_of_wraps(&spiked), None, "seed {seed}");
    }
}

#[test]
fn bad_samples_cost_as_many_samples() {
    for seed in 0..200 {
        let mut random = Random::new(seed);
        let q: Vec<f64> = angle(&mut random).iter().map(|q| q + 4.0).collect();
        let tau = torque(&q, &mut random);
        for (quantity, sound) in [(Quantity::Angle, q), (Quantity::Effort, tau)] {
            let mut bad = sound.clone();
            let rows: Vec<usize> = (0..4).map(|k| 100 + 330 * k + random.below(200)).collect();
            for &row in &rows {
                bad[row] = if random.below(2) == 0 { -90.0 } else { 90.0 };
            }
            let found = inspected(quantity, &bad);
            assert_eq!(
                found.lost, rows,
                "seed {seed}, {quantity:?} {:?}",
                found.findings
            );
            let finding = &found.findings[0];
            assert_eq!((finding.defect, finding.rows), (Defect::Spikes, 4));
            assert_eq!(finding.row, rows.first().copied());
        }
    }
}

#[test]
fn frozen_stretches_and_steps_are_named_by_their_row() {
    let (mut frozen, mut stepped, mut stills, runs) = (0, 0, 0, 200);
    for seed in 0..runs {
        let mut random = Random::new(seed);
        let sound = angle(&mut random);
        let start = 350 + random.below(300);
        let mut still = sound.clone();
        still[start..start + 150].fill(sound[start]);
        let found = inspected(Quantity::Angle, &still);
        let named = found.findings.iter().find(|f| f.defect == Defect::Frozen);
        // A reading that was kept shows where it differs from the one that follows.
        let leap = (sound[start + 150] - sound[start]).abs();
        if leap < 0.2 {
            continue;
        }
        stills += 1;
        frozen += usize::from(named.is_some_and(|f| f.row.is_some_and(|r| r.abs_diff(start) < 3)));
        let mut moved = sound;
        let step = 0.4 + 0.5 * random.unit();
        moved[start..].iter_mut().for_each(|q| *q += step);
        let found = inspected(Quantity::Angle, &moved);
        let named = found.findings.iter().find(|f| f.defect == Defect::Stepped);
        stepped += usize::from(named.is_some_and(|f| f.row == Some(start)));
    }
    assert!(
        stills > 60 && frozen * 100 >= 90 * stills,
        "{frozen} of {stills}"
    );
    assert!(stepped * 100 >= 95 * stills, "{stepped} of {stills}");
}

/// 9999 and the largest number of a register where a reading is missing.
#[test]
fn marks_for_missing_readings_cost_their_rows() {
    for seed in 0..40 {
        let mut random = Random::new(seed);
        let q = angle(&mut random);
        let tau = torque(&q, &mut random);
        for (quantity, values, mark) in [
            (Quantity::Angle, &q, 9999.0),
            (Quantity::Effort, &tau, f64::from(f32::MAX)),
        ] {
            let mut bad = values.clone();
            bad[500..530].fill(mark);
            let found = inspected(quantity, &bad);
            assert!(has(&found, Defect::Spikes), "{seed} {:?}", found.findings);
            assert!((500..530).all(|row| found.lost.contains(&row)), "{seed}");
            assert!(found.values.iter().all(|x| x.abs() < 1e3), "{seed}");
        }
    }
}

#[test]
fn samples_of_two_sources_and_held_readings_are_refused() {
    let refused = |found: &Inspected, words: &str| {
        found
            .findings
            .iter()
            .any(|f| f.severity == Severity::Refused && f.text.contains(words))
    };
    for seed in 0..40 {
        let mut random = Random::new(seed);
        let q = angle(&mut random);
        let other = angle(&mut random);
        let every = 2 + random.below(3);
        let both: Vec<f64> = (0..ROWS)
            .map(|k| if k % every == 0 { other[k] + 0.7 } else { q[k] })
            .collect();
        let found = inspected(Quantity::Angle, &both);
        assert!(
            refused(&found, "sources"),
            "{seed} {every}: {:?}",
            found.findings
        );
        // A motion that never rests: at rest readings are held by right.
        let (swing, phase) = (0.02 + 0.01 * random.unit(), TAU * random.unit());
        let moving = |k: usize| (swing * k as f64 + phase).sin() + 1e-4 * (k as f64).cos();
        let held: Vec<f64> = (0..ROWS).map(|k| moving(k - k % 20)).collect();
        let found = inspected(Quantity::Angle, &held);
        assert!(
            refused(&found, "sampled more slowly"),
            "{seed}: {:?}",
            found.findings
        );
    }
}
