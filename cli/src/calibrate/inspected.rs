//! Inspection of recorded runs: bad samples are bridged or left out before anything is fitted, each kind reported.

use super::sensors::AXES;
use super::stretch::Stretch;
use crate::spool::Column;
use inspection::{Channel, Quantity, Severity, inspect};
use problem::{Problem, Problems};
use robot_config::Robot;
use robot_state::JointKind;

/// Axes of an IMU, for messages.
const IMU: [&str; 6] = ["gx", "gy", "gz", "ax", "ay", "az"];

/// Mends the angles, F/T sensors and IMU of a stretch, and adds what was found to `notes`. Samples of an F/T sensor
/// that hold no measurement are NaN afterwards, so that nothing is fitted to them.
///
/// # Errors
/// Channels that are not what they claim to be.
pub(super) fn mend(
    robot: &Robot,
    stretch: &mut Stretch,
    notes: &mut Vec<String>,
) -> Result<(), Problems> {
    let signals = &mut stretch.signals;
    let (t, file) = (signals.t.read()?, &signals.file);
    let mut problems = Vec::new();
    let mut channel = |name: &str, quantity, column: &mut Column, leave_out: bool| {
        column.change(|values| {
            let found = inspect(
                &t,
                Channel {
                    name,
                    quantity,
                    values: values.as_slice(),
                },
            );
            for finding in &found.findings {
                if finding.severity == Severity::Refused {
                    problems.push(finding.problem(file, |_| 0));
                } else {
                    notes.push(finding.to_string());
                }
            }
            *values = found.values;
            for row in found.lost.into_iter().filter(|_| leave_out) {
                if let Some(value) = values.get_mut(row) {
                    *value = f64::NAN;
                }
            }
            Ok::<_, Problem>(())
        })
    };
    let p = &robot.parameters;
    for (joint, angle) in p.joints.iter().zip(&mut signals.angles) {
        let quantity = if joint.kind == JointKind::Prismatic {
            Quantity::Way
        } else {
            Quantity::Angle
        };
        channel(&format!("q of `{}`", joint.name), quantity, angle, false)?;
    }
    for (ft, axes) in p.ft_sensors.iter().zip(&mut signals.ft) {
        for (name, axis) in AXES.iter().zip(axes) {
            let name = format!("{name} of F/T sensor `{}`", ft.sensor.name);
            channel(&name, Quantity::Effort, axis, true)?;
        }
    }
    for (name, axis) in IMU.iter().zip(signals.imu.iter_mut().flatten()) {
        channel(&format!("{name} of the IMU"), Quantity::Effort, axis, false)?;
    }
    if problems.is_empty() {
        Ok(())
    } else {
        Err(Problems(problems))
    }
}

#[cfg(test)]
mod tests {
    use super::super::stretch::Drive;
    use super::*;
    use crate::reference::torques::Signals;
    use crate::spool::Spool;

    /// Two seconds of the leg: angles that swing, forces that follow.
    fn stretch(robot: &Robot) -> Stretch {
        let t: Vec<f64> = (0..2000).map(|k| 1e-3 * f64::from(k)).collect();
        let spool = Spool::new().unwrap();
        let of = |scale: f64, offset: f64| -> Column {
            let values = t.iter().map(|t| offset + scale * (3.0 * t).sin());
            Column::of(&spool, &values.collect::<Vec<_>>()).unwrap()
        };
        let p = &robot.parameters;
        let six = || std::array::from_fn(|k| of(5.0, 10.0 + k as f64));
        Stretch {
            signals: Signals {
                period: 1e-3,
                angles: p.joints.iter().map(|_| of(0.3, 0.5)).collect(),
                ft: p.ft_sensors.iter().map(|_| six()).collect(),
                imu: Some(six()),
                file: "run.mcap".to_owned(),
                t: Column::of(&spool, &t).unwrap(),
            },
            contact_set: 0,
            offsets: Vec::new(),
            drives: p.joints.iter().map(|_| Drive::new(&spool)).collect(),
        }
    }

    fn columns(stretch: &Stretch) -> Vec<Vec<f64>> {
        let signals = &stretch.signals;
        let all = signals.angles.iter().chain(signals.ft.iter().flatten());
        all.map(|column| column.read().unwrap()).collect()
    }

    /// Changes one sample.
    fn set(column: &mut Column, row: usize, change: impl Fn(f64) -> f64) {
        let set = |values: &mut Vec<f64>| {
            values[row] = change(values[row]);
            Ok(())
        };
        column.change(set).unwrap();
    }

    #[test]
    fn bad_samples_cost_themselves_and_are_reported() {
        let read = test_support::read_project_file;
        let robot = robot_config::load("config/leg/robot.toml", &read).unwrap();
        let sound = stretch(&robot);
        let (mut same, mut notes) = (stretch(&robot), Vec::new());
        mend(&robot, &mut same, &mut notes).unwrap();
        assert_eq!(notes, Vec::<String>::new());
        assert_eq!(columns(&same), columns(&sound));

        let mut bad = stretch(&robot);
        for k in [300, 700, 1100] {
            set(&mut bad.signals.ft[0][2], k, |_| 0.0);
            set(&mut bad.signals.angles[1], k + 50, |_| 0.0);
        }
        mend(&robot, &mut bad, &mut notes).unwrap();
        let of_force = bad.signals.ft[0][2].read().unwrap();
        let lost: Vec<usize> = (0..2000).filter(|&k| of_force[k].is_nan()).collect();
        assert_eq!(lost, [300, 700, 1100]);
        for (q, sound) in columns(&bad)[1].iter().zip(&columns(&sound)[1]) {
            assert!((q - sound).abs() < 1e-4, "{q} {sound}");
        }
        let of = |words: &str| notes.iter().filter(|note| note.contains(words)).count();
        assert_eq!(of("fz of F/T sensor `ankle`: 3 samples"), 1, "{notes:?}");
        assert_eq!(of("3 samples that no neighbour confirms"), 2, "{notes:?}");
    }

    #[test]
    fn an_encoder_that_lost_its_zero_is_refused_by_name() {
        let read = test_support::read_project_file;
        let robot = robot_config::load("config/leg/robot.toml", &read).unwrap();
        let mut bad = stretch(&robot);
        for row in 900..2000 {
            set(&mut bad.signals.angles[2], row, |q| q + 0.2);
        }
        let refused = mend(&robot, &mut bad, &mut Vec::new()).unwrap_err();
        let [problem] = &refused.0[..] else {
            panic!("{refused}")
        };
        let name = &robot.parameters.joints[2].name;
        assert!(
            problem
                .to_string()
                .contains(&format!("q of `{name}` steps by")),
            "{problem}"
        );
    }
}
