//! Sensors with latency or a clock of their own, compared with the same robot with all sensors at
//! SYNC.

use crate::common;

use can_codec::{Frame, Frames};
use common::Bench;
use cycle::ClientInput;
use estimators::filter_bank::FilterBank;
use estimators::matched_filter::MatchedFilterParameters;
use robot_config::slots::{self, Source};
use robot_state::{Event, measured_flags};
use std::f64::consts::TAU;
use test_support::read_with_drives_always_on;

/// The humanoid with texts in its files replaced: `("FILE: OLD", "NEW")`.
fn humanoid(edits: &[(&str, &str)]) -> Bench {
    Bench::reading("humanoid", &|path| {
        let mut text = read_with_drives_always_on(path)?;
        for (mark, keys) in edits {
            let (file, mark) = mark.split_once(": ").unwrap();
            if path.ends_with(file) {
                assert!(text.contains(mark), "{path} lacks {mark}");
                text = text.replace(mark, keys);
            }
        }
        Ok(text)
    })
}

/// Every joint's torque from F/T sensors and IMU, and the true one at the same instant, N·m, in
/// each cycle in which the robot squats and swings its arms; one row a joint.
struct Run {
    estimated: Vec<Vec<f64>>,
    truth: Vec<Vec<f64>>,
    /// Missed and rejected samples meanwhile.
    rejected: u64,
}

impl Run {
    fn new(bench: &mut Bench) -> Self {
        let n = bench.robot.parameters.joints.len();
        let start: Vec<f64> = (0..n).map(|j| bench.plant.robot().set_point(j)).collect();
        let mut truth = vec![Vec::new(); n];
        let mut run = Self {
            estimated: vec![Vec::new(); n],
            truth: vec![Vec::new(); n],
            rejected: 0,
        };
        for k in 0..5000 {
            bench.gather();
            bench.tx.clear();
            let at = bench.instants();
            (bench.cycle).step(at, &bench.rx, &ClientInput::default(), &mut bench.tx);
            move_on(bench, &start, 1e-3 * f64::from(k));
            if k == 1000 {
                run.rejected = rejected(bench);
            }
            let record = bench.cycle.record();
            let late = record.measured.filter_delay_s / 1e-3;
            let (whole, part) = (late.floor() as usize, late.fract());
            for (j, joint) in bench.plant.truth().joints.iter().enumerate() {
                truth[j].push(joint.tau);
                if k >= 1000 {
                    let was = |back: usize| truth[j][truth[j].len() - 1 - back];
                    run.estimated[j].push(record.estimated.joints[j].tau_whole_body.tau);
                    run.truth[j].push(was(whole) * (1.0 - part) + was(whole + 1) * part);
                }
            }
        }
        run.rejected = rejected(bench) - run.rejected;
        run
    }
}

/// Gives the drives their set points at time `t`, without the daemon's control in between.
fn move_on(bench: &mut Bench, start: &[f64], t: f64) {
    let grown = (t / 0.8).min(1.0);
    let squat = 0.12 * grown * (1.0 - (TAU * 1.4 * t).cos());
    let swing = 0.35 * grown * (TAU * 1.9 * t).sin();
    let joints = &bench.robot.parameters.joints;
    let mut set_points = vec![f64::NAN; slots::command(joints.len())];
    for (j, joint) in joints.iter().enumerate() {
        set_points[slots::command(j)] = start[j]
            + match joint.name.as_str() {
                name if name.ends_with("hip_pitch") => -squat,
                name if name.ends_with("knee") => 2.0 * squat,
                name if name.ends_with("ankle_pitch") => -squat,
                "left_shoulder_pitch" => swing,
                "right_shoulder_pitch" => -swing,
                name if name.ends_with("elbow") => 0.5 * swing,
                _ => 0.0,
            };
    }
    let mut commands = Frames::default();
    bench.robot.send.encode_all(&set_points, &mut commands);
    let mut answers = Frames::default();
    bench.plant.exchange(&commands, bench.now, &mut answers);
    assert!(answers.is_empty(), "commands are not answered");
}

/// Root mean square of the difference of two signals.
fn difference(a: &[f64], b: &[f64]) -> f64 {
    let sum: f64 = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum();
    (sum / a.len() as f64).sqrt()
}

/// Savitzky-Golay filters in the place of the matched ones.
const PAPER: (&str, &str) = (
    "robot.toml: matched = 80",
    "encoder = { window = 80, order = 2 }\nsensor = { window = 80, order = 1 }",
);
const LATE_FT: (&str, &str) = (
    "sim.toml: [imu]",
    "[ft_sensor.sampling]\nlatency_us = 3000\n[imu]",
);
const OWN_IMU: (&str, &str) = (
    "sim.toml: [drive.hip_yaw]  #",
    "[imu.sampling]\nsampled = \"when_sent\"\nlatency_us = 1500\nclock_error_ppm = 2000\n\
     stamp_jitter_us = 120\n[drive.hip_yaw]  #",
);
const FT_KEY: (&str, &str) = ("robot.toml: sigma_N =", "latency_us = 3000\nsigma_N =");
const IMU_KEY: (&str, &str) = (
    "robot.toml: [imu]",
    "[imu]\nsampled = \"when_sent\"\nlatency_us = 1560",
);

const OWN_DRIVES: [(&str, &str); 2] = [
    (
        "sim.toml: motor_noise_counts =",
        "sampling = { sampled = \"when_sent\", latency_us = 250, clock_error_ppm = 2000 }\n\
         motor_noise_counts =",
    ),
    (
        "sim.toml: [imu]",
        "[ft_sensor.sampling]\nsampled = \"when_sent\"\nperiod_us = 2500\n[imu]",
    ),
];
const DRIVE_KEYS: [(&str, &str); 2] = [
    (
        "robot.toml: gear_ratio =",
        "sampled = \"when_sent\"\nlatency_us = 250\ngear_ratio =",
    ),
    (
        "robot.toml: sigma_N =",
        "sampled = \"when_sent\"\nperiod_us = 2500\nsigma_N =",
    ),
];

/// Counts of missed and rejected samples.
fn rejected(bench: &Bench) -> u64 {
    let events = &bench.cycle.record().events;
    let counted = [
        Event::SensorMissed,
        Event::JointMissed,
        Event::EncoderJump,
        Event::SignalNotFinite,
    ];
    counted.iter().map(|event| events[event.index()]).sum()
}

/// Each joint's difference to the robot that samples at SYNC, without and with the configuration's
/// keys, and its errors against the truth: at SYNC, without and with the keys.
fn compare(
    filter: Option<(&str, &str)>,
    plant: &[(&str, &str)],
    keys: &[(&str, &str)],
) -> Vec<Row> {
    let filter: Vec<_> = filter.into_iter().collect();
    let synced = Run::new(&mut humanoid(&filter));
    let late = [&filter, plant].concat();
    let ignored = Run::new(&mut humanoid(&late));
    let mut bench = humanoid(&[&late, keys].concat());
    let aligned = Run::new(&mut bench);
    assert_eq!(aligned.rejected, 0);
    let row = |j: usize| {
        let from_synced = |run: &Run| difference(&run.estimated[j], &synced.estimated[j]);
        let error = |run: &Run| difference(&run.estimated[j], &run.truth[j]);
        Row {
            joint: bench.robot.parameters.joints[j].name.clone(),
            from_synced: [from_synced(&ignored), from_synced(&aligned)],
            errors: [error(&synced), error(&ignored), error(&aligned)],
        }
    };
    (0..synced.truth.len()).map(row).collect()
}

#[derive(Debug)]
struct Row {
    joint: String,
    from_synced: [f64; 2],
    errors: [f64; 3],
}

/// Errors with the keys are those of the robot that samples at SYNC, apart from noise.
fn as_good_as_synced(rows: &[Row]) {
    for row in rows {
        let [synced, _, aligned] = row.errors;
        assert!(aligned < 1.05 * synced + 0.002, "{row:?}");
    }
}

#[test]
fn sensors_with_latency_or_own_clock_are_as_good_as_those_at_sync() {
    let late = [LATE_FT, OWN_IMU];
    for filter in [Some(PAPER), None] {
        let rows = compare(filter, &late, &[FT_KEY, IMU_KEY]);
        as_good_as_synced(&rows);
        for row in &rows {
            let [ignored, aligned] = row.from_synced;
            if filter.is_none() && ignored > 0.05 {
                // The IMU's noise, drawn anew, falsifies the chest's torques most.
                let share = if row.joint == "chest_pitch" {
                    0.25
                } else {
                    0.1
                };
                assert!(aligned < share * ignored, "{row:?}");
            }
            let [synced, ignored, _] = row.errors;
            if row.joint.ends_with("ankle_pitch") {
                assert!(ignored > 1.1 * synced, "{row:?}");
            }
        }
    }
}

#[test]
fn drives_with_own_clock_and_slow_sensors_are_as_good_as_those_at_sync() {
    let rows = compare(None, &OWN_DRIVES, &DRIVE_KEYS);
    as_good_as_synced(&rows);
    for row in &rows {
        let [ignored, aligned] = row.from_synced;
        if ignored > 0.5 {
            assert!(aligned < 0.15 * ignored, "{row:?}");
            assert!(row.errors[1] > 1.2 * row.errors[0], "{row:?}");
        }
    }
}

/// Readings of analytic sensors at time `t`: F/T sensor's force along x, N, gyro about x, rad/s,
/// accelerometer along x, m/s².
fn analytic(t: f64) -> [f64; 3] {
    [
        100.0 * (TAU * 1.5 * t).sin(),
        0.3 + 2.0 * (TAU * 1.1 * t).cos(),
        4.0 * (TAU * 0.9 * t + 1.0).sin(),
    ]
}

/// A cycle of the humanoid whose first F/T sensor and IMU are analytic: the plant's frames with
/// those values in them, sampled `age(k)` before SYNC k and stamped as they were sampled.
fn analytic_cycle(bench: &mut Bench, k: u32, age: f64) {
    bench.gather();
    let robot = &bench.robot;
    let mut values = vec![0.0; slots::receive_len(&robot.parameters)];
    let [force, gyro, accelerometer] = analytic(1e-3 * f64::from(k) - age);
    values[slots::ft(0, 0)] = force;
    values[slots::gyro(0, 0)] = gyro;
    values[slots::accelerometer(0, 0)] = accelerometer;
    let frames: Vec<Frame> = bench.rx.iter().copied().collect();
    bench.rx.clear();
    for mut frame in frames {
        let index = robot.receive.classify(&frame).unwrap();
        let first = robot.receive.slots(index).next().unwrap();
        if [Source::Imu(0), Source::Ft(0)].contains(&slots::source(first)) {
            if age.is_nan() {
                continue;
            }
            assert!(robot.receive.encode(index, &values, &mut frame));
            frame.stamp_ns = bench.now.wrapping_add_signed(-(age * 1e9).round() as i64);
        }
        bench.rx.push(frame);
    }
    bench.compute(&ClientInput::default());
}

#[test]
fn filtered_values_are_those_of_the_published_instant() {
    // The newest sample is up to a period old, or was sent after SYNC while others answered.
    let age = |k: u32| 1e-3 * ((f64::from(k) * 0.618).fract() * 1.3 - 0.3);
    let worst = |keys: &[(&str, &str)]| {
        let mut bench = humanoid(keys);
        let mut worst = [0.0f64; 4];
        for k in 0..1500 {
            analytic_cycle(&mut bench, k, age(k));
            let record = bench.cycle.record();
            let t = 1e-3 * f64::from(k) - record.measured.filter_delay_s;
            // The filter's output for samples taken at SYNC.
            let smooth = |i: usize, hz: f64| {
                let (h, w) = (1e-3, TAU * hz);
                let kernel = MatchedFilterParameters {
                    window: 80,
                    derivatives: 2,
                    sample_period: h,
                };
                let kernel = FilterBank::new(1, kernel).unwrap().kernel();
                let gain: f64 = (kernel.iter().enumerate())
                    .map(|(n, c)| c * (w * h * (n as f64 - 39.5)).cos())
                    .sum();
                let mean = if i == 1 { 0.3 } else { 0.0 };
                mean + gain * (analytic(t)[i] - mean)
            };
            let gain = (smooth(1, 1.1) - 0.3) / (analytic(t)[1] - 0.3);
            let rate = gain * -2.0 * (TAU * 1.1) * (TAU * 1.1 * t).sin();
            let errors = [
                record.measured.ft[0].wrench_hat.force[0] - smooth(0, 1.5),
                record.measured.imu.gyro_hat[0] - smooth(1, 1.1),
                record.measured.imu.accelerometer_hat[0] - smooth(2, 0.9),
                record.measured.imu.angular_acceleration_hat[0] - rate,
            ];
            if k > 200 {
                for (worst, error) in worst.iter_mut().zip(errors) {
                    *worst = worst.max(error.abs());
                }
            }
        }
        worst
    };
    let own = "sampled = \"when_sent\"\n";
    // The analytic signals have no noise.
    let flat = "flat_after_ms = 3600000\n";
    let ft = format!("{own}{flat}sigma_N =");
    let imu = format!("[imu]\n{own}{flat}");
    let ft_ignored = format!("{flat}sigma_N =");
    let imu_ignored = format!("[imu]\n{flat}");
    let aligned = worst(&[
        ("robot.toml: sigma_N =", ft.as_str()),
        ("robot.toml: [imu]", imu.as_str()),
    ]);
    let ignored = worst(&[
        ("robot.toml: sigma_N =", ft_ignored.as_str()),
        ("robot.toml: [imu]", imu_ignored.as_str()),
    ]);
    // As large as age times derivative, mean age 0.35 ms.
    assert!(ignored[0] > 0.3 * TAU * 1.5 * 100.0 * 0.9e-3, "{ignored:?}");
    for (aligned, ignored) in aligned.iter().zip(ignored) {
        assert!(10.0 * aligned < ignored, "{aligned} of {ignored}");
    }
}

#[test]
fn a_sensor_with_own_clock_is_missed_when_it_is_overdue() {
    let own = "[imu]\nsampled = \"when_sent\"\nperiod_us = 3000";
    let mut bench = humanoid(&[("robot.toml: [imu]", own)]);
    let missed = |bench: &Bench| bench.cycle.record().events[Event::SensorMissed.index()];
    for k in 0..300 {
        // A sample every third cycle.
        let age = if k % 3 == 0 { 0.4e-3 } else { f64::NAN };
        analytic_cycle(&mut bench, k, age);
        let imu = bench.cycle.record().measured.imu;
        let expected = 1e-3 * f64::from(k % 3) + 0.4e-3;
        assert!((imu.age_s - expected).abs() < 1e-9, "{}", imu.age_s);
        assert_eq!(imu.flags & measured_flags::MISSED, 0, "cycle {k}");
    }
    let before = missed(&bench);
    for (k, silent) in (300..).zip(3..10) {
        analytic_cycle(&mut bench, k, f64::NAN);
        let overdue = 1e-3 * f64::from(silent) + 0.4e-3 > 6e-3;
        let flagged = bench.cycle.record().measured.imu.flags & measured_flags::MISSED != 0;
        assert_eq!(flagged, overdue, "no sample for {silent} cycles");
    }
    assert!(missed(&bench) > before);
}
