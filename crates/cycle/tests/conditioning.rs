//! F/T sensors: from raw signals on the bus to wrenches, and offsets that change while running.

use crate::common;

use common::{Bench, read};
use cycle::ClientInput;
use robot_state::{Settings, Wrench, measured_flags};

const ROBOT: &str = "config/leg/robot.toml";
const SIM: &str = "config/leg/sim.toml";
const DBC: &str = "robot-models/leg/drives.dbc";
const SENSOR: &str = "[[ft_sensor]]\nname = \"ankle\"\n";

/// The leg with texts replaced in its files.
fn leg(changes: &[(&str, &str, &str)]) -> Bench {
    Bench::reading("leg", &|path| {
        let mut text = read(path)?;
        for (file, from, to) in changes {
            if path.ends_with(file) {
                assert!(text.contains(from), "{file} lacks {from:?}");
                text = text.replace(from, to);
            }
        }
        Ok(text)
    })
}

fn worst(a: &Wrench, b: &Wrench) -> f64 {
    let pairs = a.to_array().into_iter().zip(b.to_array());
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// The plant's sensor sends raw signals by its calibration sheet, so the measured wrench is the same
/// for any sheet, apart from one count of the signals.
#[test]
fn calibration_sign_and_offset_are_undone() {
    let measured = |changes: &[(&str, &str, &str)]| {
        let mut bench = leg(changes);
        bench.run(50);
        bench.cycle.record().measured.ft[0].wrench
    };
    let plain = measured(&[]);
    assert!(plain.to_array()[2].abs() > 1.0, "the foot has a weight");
    let sheet = format!(
        "{SENSOR}calibration = [[1.1, 0.02, 0, 0, 0.3, 0], [0, 0.9, 0, 0.1, 0, 0], \
         [0.03, 0, 1.2, 0, 0, 0], [0, 0.01, 0, 1, 0, 0], [0, 0, 0, 0, -1, 0], [0, 0, 0, 0, 0, 2]]\n"
    );
    let offset = "offset = [3, -4, 5, 0.2, -0.3, 0.1]";
    let zeros = "offset = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]";
    // The plant's sensor has the configuration's offset, instead of one that a calibration is to find.
    let has_offset = (SIM, "ignores_offset = true", "ignores_offset = false");
    // Before the matrix the signals have other units than the sensor's range.
    let range = (ROBOT, "range_N = 1500.0\nrange_Nm = 90.0\n", "");
    for changes in [
        vec![range, (ROBOT, SENSOR, sheet.as_str())],
        vec![
            has_offset,
            (ROBOT, zeros, offset),
            (ROBOT, "sign = 1", "sign = -1"),
        ],
        vec![
            range,
            has_offset,
            (ROBOT, zeros, offset),
            (ROBOT, SENSOR, sheet.as_str()),
        ],
    ] {
        let same = measured(&changes);
        assert!(worst(&plain, &same) < 0.05, "{plain:?} {same:?}");
    }
}

/// A sensor that warms by 6 K within a second, with and without compensation in the configuration.
#[test]
fn warmth_is_compensated() {
    let drift = |compensated: bool| {
        let warm = "noise_N = 0.3\nwarmth_N_per_K = 2.0\nwarmth_Nm_per_K = -0.1\n\
                    neutral_temperature_C = 25\ntemperature_C = 25\nwarming_K_per_minute = 360";
        let force = "BO_ 385 ANKLE_FT_F: 6 SENSORS\n";
        let dbc = "BO_ 385 ANKLE_FT_F: 8 SENSORS\n SG_ warmth : 48|16@1- (0.01,0) \
                   [-327.68|327.67] \"degC\" TORQUED\n";
        let keys = format!(
            "{SENSOR}temperature = \"ANKLE_FT_F.warmth\"\nreference_temperature_C = 25\n\
             temperature_gain_per_K = [-2, -2, -2, 0.1, 0.1, 0.1]\n"
        );
        let mut changes = vec![(SIM, "noise_N = 0.3", warm)];
        if compensated {
            changes.push((DBC, force, dbc));
            changes.push((ROBOT, SENSOR, &keys));
        }
        let mut bench = leg(&changes);
        bench.run(150);
        let cold = bench.cycle.record().measured.ft[0].wrench_hat;
        bench.run(1000);
        let record = bench.cycle.record();
        if compensated {
            // 1.15 s after the start, apart from one count.
            let temperature = record.measured.ft[0].temperature;
            assert!((temperature - 31.9).abs() < 0.05, "{temperature} degC");
        }
        worst(&record.measured.ft[0].wrench_hat, &cold)
    };
    let (without, with) = (drift(false), drift(true));
    assert!(without > 10.0, "{without} N");
    assert!(with < 0.3, "{with} N");
}

/// With the offsets of the last tare known at the start, the first sample already has them.
#[test]
fn stored_offsets_hold_from_the_first_sample() {
    let mut bench = leg(&[]);
    let settings = shifted(10.0);
    bench.step(&with(&settings));
    let ft = bench.cycle.record().measured.ft[0];
    assert_eq!(ft.offset, settings.ft_offset[0]);
    assert!((bench.plant.truth().ft[0].force[2] - 10.0 - ft.wrench.force[2]).abs() < 3.0);
}

/// A change of offset while the robot stands is spread over a quarter of a second: from cycle to
/// cycle the torques change little more than without it, for any filters.
#[test]
fn a_new_offset_is_no_step_of_torque() {
    for filters in [
        "encoder = { window = 80, order = 2 }\nsensor = { window = 80, order = 1 }",
        // A short filter that is not read in its middle extrapolates.
        "encoder = { window = 80, order = 2 }\nsensor = { window = 60, order = 2 }",
    ] {
        let own = "encoder = { window = 80, order = 2 }\nsensor = { window = 80, order = 1 }";
        let mut bench = leg(&[(ROBOT, own, filters)]);
        bench.run(400);
        let mut last = bench.cycle.record().estimated.joints[2].tau_whole_body.tau;
        let mut largest = |bench: &mut Bench, settings: &Settings| {
            let mut most: f64 = 0.0;
            for _ in 0..600 {
                let tau = bench.step(&with(settings)).estimated.joints[2]
                    .tau_whole_body
                    .tau;
                most = most.max((tau - last).abs());
                last = tau;
            }
            (most, last)
        };
        let (quiet, before) = largest(&mut bench, &shifted(0.0));
        let (changing, after) = largest(&mut bench, &shifted(40.0));
        let moved = (after - before).abs();
        assert!(moved > 2.0, "{moved} N·m: the offset has no effect");
        assert!(
            changing < quiet + 0.015 * moved,
            "{changing} N·m in a cycle, {quiet} before, of {moved}"
        );
        let flags = bench.cycle.record().measured.ft[0].flags;
        assert_eq!(flags & measured_flags::SETTLING, 0, "filters go on");
    }
}

#[test]
fn an_offset_that_is_not_finite_is_not_taken() {
    let mut bench = leg(&[]);
    bench.run(100);
    let mut settings = shifted(4.0);
    settings.ft_offset[0].torque[1] = f64::NAN;
    for _ in 0..400 {
        bench.step(&with(&settings));
    }
    let ft = bench.cycle.record().measured.ft[0];
    assert_eq!(ft.offset, Wrench::default());
    assert!(ft.wrench_hat.to_array().iter().all(|x| x.is_finite()));
}

fn shifted(newtons: f64) -> Settings {
    let mut settings = Settings::default();
    settings.ft_offset[0].force = [0.5 * newtons, 0.0, newtons];
    settings
}

fn with(settings: &Settings) -> ClientInput<'_> {
    ClientInput {
        settings: Some(settings),
        ..ClientInput::default()
    }
}
