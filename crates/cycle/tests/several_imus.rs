//! Several IMUs: the others check the first one and stand in for it; none of them makes it worse.

use crate::common;

use can_codec::Frame;
use common::{Bench, client_input, read};
use robot_config::slots;
use robot_state::{CycleRecord, Event, Mode, Reference, measured_flags};

/// Places of the humanoid's IMUs beside the first one, which is in the chest.
const FURTHER: [&str; 2] = ["base_link", "head_pitch_link"];

/// The humanoid with an IMU in the chest, the pelvis and the head.
fn humanoid() -> Bench {
    Bench::reading("humanoid", &|path| {
        let text = read(path)?;
        Ok(if path.ends_with("humanoid/robot.toml") {
            with_further(&text)
        } else if path.ends_with("humanoid/drives.dbc") {
            let from = text.find("BO_ 401 IMU").unwrap();
            let end = from + text[from..].find("\n\n").unwrap() + 2;
            let copy = |id: usize| {
                let named = format!("BO_ {} IMU_{id}", 400 + id);
                text[from..end].replace("BO_ 401 IMU", &named)
            };
            format!("{}{}{}{}", &text[..end], copy(2), copy(3), &text[end..])
        } else {
            text
        })
    })
}

/// The configuration's `[imu]` as the first of a list.
fn with_further(text: &str) -> String {
    let from = text.find("[imu]").unwrap();
    let one = text[from..].replace("[imu]", "[[imu]]");
    let further = FURTHER.iter().zip(2..).map(|(frame, id)| {
        let signals = one.replace("IMU.", &format!("IMU_{id}."));
        signals.replace("\"imu_link\"", &format!("\"{frame}\""))
    });
    format!(
        "{}{one}\n{}",
        &text[..from],
        further.collect::<Vec<_>>().join("\n")
    )
}

/// Treatment of the IMUs' samples on their way.
#[derive(Debug, Clone, Copy, Default)]
struct Spoiled {
    silent: [bool; 3],
    /// Added to every accelerometer axis, m/s².
    offset: [f64; 3],
}

impl Spoiled {
    fn spoil(&self, bench: &mut Bench) {
        let table = bench.robot.receive.clone();
        let mut values = vec![0.0; slots::receive_len(&bench.robot.parameters)];
        let frames: Vec<Frame> = bench.rx.iter().copied().collect();
        bench.rx.clear();
        for mut frame in frames {
            let message = table.decode(&frame, &mut values).unwrap().unwrap();
            let imu = table
                .slots(message)
                .find_map(|slot| match slots::source(slot) {
                    slots::Source::Imu(i) => Some(i),
                    _ => None,
                });
            if let Some(i) = imu {
                if self.silent[i] {
                    continue;
                }
                (0..3).for_each(|axis| values[slots::accelerometer(i, axis)] += self.offset[i]);
                let stamp_ns = frame.stamp_ns;
                assert!(table.encode(message, &values, &mut frame));
                frame.stamp_ns = stamp_ns;
            }
            bench.rx.push(frame);
        }
    }
}

/// A standing robot that moves chest, head and arms.
struct Moving {
    bench: Bench,
    start: Reference,
    moving: Vec<(usize, f64)>,
    cycles: u64,
    /// Sum of squares of the errors of the torques from F/T sensors and IMU, (N·m)².
    square: f64,
    /// Largest change of a torque in one cycle, N·m.
    step: f64,
}

impl Moving {
    fn new() -> Self {
        let mut bench = humanoid();
        bench.run(600);
        let start = bench.reference(Mode::InverseDynamics.number(), 1);
        let joints = bench.robot.parameters.joints.iter().enumerate();
        let amplitude = |name: &str| match name {
            "chest_yaw" | "head_yaw" => 0.2,
            "chest_pitch" => 0.04,
            "left_shoulder_pitch" | "right_elbow" => 0.3,
            _ => 0.0,
        };
        let moving = joints.map(|(j, joint)| (j, amplitude(&joint.name)));
        Self {
            moving: moving.filter(|(_, a)| *a > 0.0).collect(),
            bench,
            start,
            cycles: 0,
            square: 0.0,
            step: 0.0,
        }
    }

    /// Moves on for some cycles, and gives the RMS error of the torques from F/T sensors and IMU, N·m.
    fn run(&mut self, cycles: u64, spoiled: Spoiled) -> f64 {
        (self.square, self.step) = (0.0, 0.0);
        let mut before: Option<CycleRecord> = None;
        for _ in 0..cycles {
            self.cycles += 1;
            let (t, omega) = (1e-3 * self.cycles as f64, 5.0);
            let mut reference = self.start;
            reference.sequence = 1 + self.cycles;
            for &(j, amplitude) in &self.moving {
                // The start is smooth.
                let (s, ds) = ((t / 2.0).min(1.0), if t < 2.0 { 0.5 } else { 0.0 });
                let a = amplitude * s * s * (3.0 - 2.0 * s);
                let da = amplitude * 6.0 * s * (1.0 - s) * ds;
                let joint = &mut reference.joints[j];
                let (sin, cos) = (omega * t).sin_cos();
                joint.q_d += a * sin;
                joint.dq_d = a * omega * cos + da * sin;
                joint.ddq_d = -a * omega * omega * sin + 2.0 * da * omega * cos;
            }
            self.bench.gather();
            spoiled.spoil(&mut self.bench);
            let record = *self.bench.compute(&client_input(&reference));
            self.take(&record, before.as_ref());
            before = Some(record);
        }
        let joints = self.start.joint_count as f64;
        (self.square / (cycles as f64 * joints)).sqrt()
    }

    fn take(&mut self, record: &CycleRecord, before: Option<&CycleRecord>) {
        let truth = &self.bench.plant.truth().joints;
        for (j, truth) in truth.iter().enumerate() {
            let tau = record.estimated.joints[j].tau_whole_body.tau;
            self.square += (tau - truth.tau).powi(2);
            if let Some(before) = before {
                let last = before.estimated.joints[j].tau_whole_body.tau;
                self.step = self.step.max((tau - last).abs());
            }
        }
    }

    fn record(&self) -> &CycleRecord {
        self.bench.cycle.record()
    }

    fn count(&self, event: Event) -> u64 {
        self.record().events[event.index()]
    }

    fn stands_in(&self) -> bool {
        self.record().measured.imu.flags & measured_flags::STANDS_IN != 0
    }
}

const SOUND: Spoiled = Spoiled {
    silent: [false; 3],
    offset: [0.0; 3],
};

#[test]
fn another_imu_stands_in_for_a_silent_one_and_passes_on_again() {
    let mut robot = Moving::new();
    robot.run(2500, SOUND);
    let sound = robot.run(2000, SOUND);
    let step = robot.step;
    for event in [Event::ImuLost, Event::ImuDisagrees, Event::ImuStandsIn] {
        assert_eq!(robot.count(event), 0, "{event:?}");
    }
    let silent = Spoiled {
        silent: [true, false, false],
        ..SOUND
    };
    let missing = robot.run(2000, silent);
    assert!(robot.stands_in());
    assert_eq!(robot.record().mode, Mode::InverseDynamics.number());
    assert_eq!(robot.count(Event::ImuStandsIn), 1);
    assert_eq!(robot.count(Event::SensorStale), 0);
    assert!(missing < 1.5 * sound, "{missing} instead of {sound} N·m");
    assert!(
        robot.step < 2.0 * step,
        "{} instead of {step} N·m",
        robot.step
    );
    let back = robot.run(3000, SOUND);
    assert!(!robot.stands_in());
    assert!(back < 1.5 * sound, "{back} instead of {sound} N·m");
    assert!(
        robot.step < 2.0 * step,
        "{} instead of {step} N·m",
        robot.step
    );
    assert_eq!(robot.record().mode, Mode::InverseDynamics.number());
}

#[test]
fn a_silent_or_lying_further_imu_is_noticed_and_changes_no_torque() {
    let lying = Spoiled {
        offset: [0.0, 1.0, 0.0],
        ..SOUND
    };
    let silent = Spoiled {
        silent: [false, false, true],
        ..SOUND
    };
    let mut reference = Moving::new();
    reference.run(2500, SOUND);
    reference.run(1500, SOUND);
    let torques = |robot: &Moving| {
        let joints = robot.record().estimated.joints.iter();
        let bits = joints.map(|j| [j.tau_whole_body.tau.to_bits(), j.tau_hat.tau.to_bits()]);
        bits.collect::<Vec<_>>()
    };
    for (spoiled, event) in [(lying, Event::ImuDisagrees), (silent, Event::ImuLost)] {
        let mut robot = Moving::new();
        robot.run(2500, SOUND);
        robot.run(1500, spoiled);
        assert_eq!(robot.count(event), 1, "{event:?}");
        assert_eq!(torques(&robot), torques(&reference), "{event:?}");
        assert_eq!(robot.record().mode, Mode::InverseDynamics.number());
        assert!(!robot.stands_in());
    }
}

/// Two that are left and part: it is not known which of them errs, and no motion of the base is.
#[test]
fn one_that_stands_in_and_that_the_third_contradicts_is_not_used() {
    let lying = |by: f64| Spoiled {
        silent: [true, false, false],
        offset: [0.0, by, 0.0],
    };
    let mut robot = Moving::new();
    robot.run(2500, SOUND);
    robot.run(300, lying(0.0));
    assert!(robot.stands_in());
    assert_eq!(robot.record().mode, Mode::InverseDynamics.number());
    robot.run(250, lying(1.75));
    assert!(!robot.stands_in());
    assert_eq!(robot.record().mode, Mode::Hold.number());
    // Both at once: the one that has begun to lie does not stand in at all.
    let mut robot = Moving::new();
    robot.run(2500, SOUND);
    robot.run(250, lying(1.75));
    assert_eq!(robot.record().mode, Mode::Hold.number());
}

/// A first one that seems sound again, but was lost and has agreed with none since, is not used where what stood in
/// for it is gone.
#[test]
fn a_first_imu_that_has_not_agreed_again_is_not_used() {
    let first_back = |by: f64| Spoiled {
        silent: [false; 3],
        offset: [2.5, by, 0.0],
    };
    let silent = Spoiled {
        silent: [true, false, false],
        ..SOUND
    };
    let mut robot = Moving::new();
    robot.run(2500, SOUND);
    robot.run(300, silent);
    robot.run(300, first_back(0.0));
    assert!(robot.stands_in());
    robot.run(250, first_back(1.75));
    assert!(!robot.stands_in());
    assert_eq!(robot.record().mode, Mode::Hold.number());
    assert_eq!(robot.count(Event::SensorStale), 1);
}

/// One that did not agree does not stand in: the next one does, and without any the modes end as with one IMU.
#[test]
fn an_imu_that_lies_does_not_stand_in() {
    let lying = |silent| Spoiled {
        silent,
        offset: [0.0, 1.0, 0.0],
    };
    let mut robot = Moving::new();
    robot.run(2500, lying([false; 3]));
    robot.run(500, lying([true, false, false]));
    assert!(robot.stands_in());
    let axes = robot.record().measured.imu.accelerometer_hat;
    let up = axes.iter().map(|a| a * a).sum::<f64>().sqrt();
    assert!((up - 9.81).abs() < 1.0, "by the head's: {up} m/s²");
    robot.run(200, lying([true, false, true]));
    assert!(!robot.stands_in());
    assert_eq!(robot.count(Event::SensorStale), 1);
    assert_eq!(robot.record().mode, Mode::Hold.number());
    assert_eq!(robot.record().possible_modes & 0b1100, 0);
}
