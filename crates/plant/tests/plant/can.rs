//! The robot behind its buses: frames in, frames out.

use crate::common::{can_robot, parameters, robot, send_slots};
use can_codec::{Frame, Frames};
use plant::CanRobot;
use plant::parameters::Sampled;
use robot_config::slots::Source;
use robot_config::{Robot, slots};

struct Rig {
    robot: Robot,
    can: CanRobot,
}

impl Rig {
    fn new(name: &str) -> Self {
        Self {
            robot: robot(name),
            can: can_robot(name, &parameters(name)).unwrap(),
        }
    }

    /// SYNCs of the buses in the given order; the answers.
    fn cycle(&mut self, buses: &[usize]) -> Frames {
        let mut frames = Frames::new(64);
        for bus in buses {
            frames.push(self.robot.sync[*bus]);
        }
        self.send(&frames)
    }

    fn send(&mut self, frames: &Frames) -> Frames {
        let mut out = Frames::new(can_codec::MAX_FRAMES);
        self.can.exchange(frames, 42, &mut out);
        out
    }

    fn command(&mut self, set_points: &[f64]) -> Frames {
        let mut frames = Frames::new(64);
        let values = send_slots(set_points);
        self.robot.send.encode_all(&values, &mut frames);
        self.send(&frames)
    }

    fn time(&self) -> f64 {
        self.can.truth().time
    }
}

#[test]
fn every_message_of_a_bus_answers_its_sync() {
    let mut rig = Rig::new("humanoid");
    let n = rig.robot.receive.message_count();
    let out = rig.cycle(&[0, 1, 2, 3]);
    let mut seen = vec![0; n];
    let mut values = vec![f64::NAN; slots::receive_len(&rig.robot.parameters)];
    for frame in out.iter() {
        assert_eq!(frame.stamp_ns, 42);
        let index = rig
            .robot
            .receive
            .decode(frame, &mut values)
            .unwrap()
            .unwrap();
        assert_eq!(rig.robot.receive.message(index).unwrap().bus, frame.bus);
        seen[index] += 1;
    }
    assert!(seen.iter().all(|count| *count == 1), "{seen:?}");
    let truth = rig.can.truth();
    let wrapped = |angle: f64, wrap: f64| angle - wrap * (angle / wrap).round();
    for (j, joint) in rig.robot.parameters.joints.iter().enumerate() {
        let e = &joint.encoders;
        let q = wrapped(
            values[slots::link_angle(j)] - truth.joints[j].q,
            e.link_wrap,
        );
        assert!(
            q.abs() < 5.0 * joint.estimator.link_resolution,
            "{}: {q}",
            joint.name
        );
        let theta = wrapped(
            values[slots::motor_angle(j)] - truth.joints[j].theta,
            e.motor_wrap,
        );
        assert!(
            theta.abs() < 5.0 * joint.estimator.motor_resolution,
            "{}: {theta}",
            joint.name
        );
        let current = values[slots::current(j)] - truth.joints[j].current;
        let limit = joint.limits.torque / (e.gear_ratio * 0.03);
        assert!(current.abs() < 0.05 * limit, "{}: {current} A", joint.name);
    }
    for (s, ft) in truth.ft.iter().enumerate() {
        for (axis, f) in ft.force.iter().enumerate() {
            assert!(
                (values[slots::ft(s, axis)] - f).abs() < 2.5,
                "ft {s} axis {axis}"
            );
        }
    }
    let acceleration: f64 = (0..3)
        .map(|a| values[slots::accelerometer(0, a)].powi(2))
        .sum();
    assert!((acceleration.sqrt() - 9.81).abs() < 0.3, "{acceleration}");
}

#[test]
fn time_passes_once_a_cycle_whatever_the_order_of_the_syncs() {
    let mut rig = Rig::new("leg");
    let start = rig.time();
    for buses in [[0, 1], [1, 0], [1, 0], [0, 1]] {
        assert!(!rig.cycle(&buses).is_empty());
    }
    assert!(
        (rig.time() - start - 0.004).abs() < 1e-9,
        "{}",
        rig.time() - start
    );
    // The other bus's SYNC is lost: time goes on.
    for _ in 0..3 {
        rig.cycle(&[0]);
    }
    assert!((rig.time() - start - 0.007).abs() < 1e-9);
    // No SYNC: no answer, no time.
    assert!(rig.command(&[0.0; 6]).is_empty());
    assert!((rig.time() - start - 0.007).abs() < 1e-9);
}

#[test]
fn drives_hold_until_commanded_and_then_follow() {
    let mut rig = Rig::new("leg");
    let start: Vec<f64> = rig.can.truth().joints.iter().map(|j| j.q).collect();
    for _ in 0..500 {
        rig.cycle(&[0, 1]);
    }
    let held: Vec<f64> = rig.can.truth().joints.iter().map(|j| j.q).collect();
    for (a, b) in start.iter().zip(&held) {
        assert!((a - b).abs() < 5e-4, "moved by {}", a - b);
    }
    let mut set_points: Vec<f64> = (0..6).map(|j| rig.can.robot().set_point(j)).collect();
    for k in 0..1000 {
        set_points[0] += if k < 500 { 2e-4 } else { 0.0 };
        rig.command(&set_points);
        rig.cycle(&[0, 1]);
    }
    let moved = rig.can.truth().joints[0].q - held[0];
    assert!((moved - 0.1).abs() < 2e-3, "moved by {moved} rad");
    for _ in 0..300 {
        rig.cycle(&[0, 1]);
    }
    let later = rig.can.truth().joints[0].q - held[0];
    assert!(
        (later - moved).abs() < 1e-3,
        "does not hold its last set point"
    );
}

/// Set-points are sent this far apart, rad: twice their resolution on the bus.
const STEP: f64 = 6e-6;

/// Cycles after which the drives follow each of `sent` set-points of hip yaw, in the order of
/// arrival, with a `sim.toml` that has this `[transport]`.
fn arrivals(transport: &str, sent: usize) -> Vec<(usize, f64)> {
    let text = test_support::read_project_file("config/leg/sim.toml").unwrap() + transport;
    let sim = plant::SimParameters::parse(&text, "sim.toml").unwrap();
    let mut rig = Rig {
        robot: robot("leg"),
        can: can_robot("leg", &sim).unwrap(),
    };
    let mut last = rig.can.robot().set_point(0);
    let held: Vec<f64> = (0..6).map(|j| rig.can.robot().set_point(j)).collect();
    let mut arrived = Vec::new();
    for k in 0..sent + 20 {
        let step = STEP * (k + 1) as f64;
        if k < sent {
            let set_points: Vec<f64> = held.iter().map(|held| held + step).collect();
            rig.command(&set_points);
        }
        rig.cycle(&[0, 1]);
        let now = rig.can.robot().set_point(0);
        if now != last {
            arrived.push((k, now - held[0]));
        }
        last = now;
    }
    arrived
}

/// The command of cycle k is the drive's set-point at the end of period k + delay.
#[test]
fn set_points_act_one_cycle_after_their_sample_unless_said() {
    for (transport, delay) in [
        ("", 1),
        ("[transport]\ndelay_us = 0\n", 0),
        ("[transport]\ndelay_us = 2000\n", 2),
    ] {
        let arrived = arrivals(transport, 10);
        assert_eq!(arrived.len(), 10, "{transport}");
        for (k, (cycle, step)) in arrived.iter().enumerate() {
            assert_eq!(*cycle, k + delay, "{transport}");
            assert!(
                (step - STEP * (k + 1) as f64).abs() < 0.5 * STEP,
                "{transport}"
            );
        }
    }
}

#[test]
fn jitter_keeps_the_order_and_lost_frames_stay_away() {
    let arrived = arrivals("[transport]\njitter_us = 1500\nlost_per_cent = 20\n", 1000);
    assert!(arrived.windows(2).all(|pair| pair[0].1 < pair[1].1));
    // A set-point that the next one catches up is not seen at the end of a period either.
    assert!((600..800).contains(&arrived.len()), "{}", arrived.len());
    let late = (arrived.iter()).map(|(cycle, step)| cycle - ((step / STEP).round() as usize - 1));
    let late: Vec<usize> = late.collect();
    assert!(late.iter().all(|late| (1..=2).contains(late)));
    assert!(late.contains(&1) && late.contains(&2));
}

#[test]
fn the_same_frames_give_the_same_bytes() {
    let record = |seed: u64| {
        let mut sim = parameters("leg");
        sim.seed = seed;
        let mut rig = Rig {
            robot: robot("leg"),
            can: can_robot("leg", &sim).unwrap(),
        };
        let mut all: Vec<Frame> = Vec::new();
        for k in 0..100 {
            rig.command(&[1e-3 * f64::from(k), 0.0, -0.4, 0.8, -0.4, 0.0]);
            all.extend(rig.cycle(&[0, 1]).iter());
        }
        all
    };
    let first = record(1);
    assert_eq!(first, record(1));
    assert_ne!(first, record(2));
}

#[test]
fn unknown_frames_are_counted_and_nothing_moves() {
    let mut rig = Rig::new("leg");
    let before: Vec<f64> = (0..6).map(|j| rig.can.robot().set_point(j)).collect();
    let mut frames = Frames::new(8);
    frames.push(Frame::zeroed(0, 0x7FF, 8, false));
    let mut short = Frames::new(8);
    let values = send_slots(&[1.0; 6]);
    rig.robot.send.encode_all(&values, &mut short);
    let mut cut = short.as_slice()[0];
    cut.len = 3;
    frames.push(cut);
    frames.push(Frame::zeroed(9, rig.robot.sync[0].id, 0, false));
    assert!(rig.send(&frames).is_empty());
    assert_eq!(rig.can.unknown_frames(), 3);
    let after: Vec<f64> = (0..6).map(|j| rig.can.robot().set_point(j)).collect();
    assert_eq!(before, after);
}

#[test]
fn sensors_with_clocks_of_their_own_stamp_their_frames() {
    let mut sim = parameters("humanoid");
    sim.imu.sampling.sampled = Sampled::WhenSent;
    sim.imu.sampling.period = Some(0.7e-3);
    sim.imu.sampling.clock_error = 0.02;
    let robot = robot("humanoid");
    let mut can = can_robot("humanoid", &sim).unwrap();
    let its = |frame: &Frame| {
        let message = robot.receive.classify(frame).unwrap();
        let mut slots = robot.receive.slots(message);
        slots.any(|slot| slots::source(slot) == Source::Imu(0))
    };
    let mut sync = Frames::new(8);
    for frame in &robot.sync {
        sync.push(*frame);
    }
    let (mut stamps, mut others) = (Vec::new(), 0);
    for k in 1..=1000_u64 {
        let now_ns = 1_000_000 * k;
        let mut out = Frames::new(can_codec::MAX_FRAMES);
        can.exchange(&sync, now_ns, &mut out);
        for frame in &out {
            if its(frame) {
                assert!((now_ns - 1_000_000..=now_ns).contains(&frame.stamp_ns));
                stamps.push(frame.stamp_ns);
            } else {
                assert_eq!(frame.stamp_ns, now_ns);
                others += 1;
            }
        }
    }
    assert_eq!(others, 1000 * (robot.receive.message_count() - 1));
    // Neither lost nor doubled at SYNCs: an even pace, which the seed has drawn.
    let pace = (stamps[stamps.len() - 1] - stamps[0]) as f64 / (stamps.len() - 1) as f64;
    assert!(
        (pace / 0.7e6 - 1.0).abs() < 0.02 && (pace - 0.7e6).abs() > 100.0,
        "{pace}"
    );
    for pair in stamps.windows(2) {
        assert!(((pair[1] - pair[0]) as f64 - pace).abs() < 2.0, "{pair:?}");
    }
}

#[test]
fn late_sensors_measure_the_past() {
    let mut sim = parameters("humanoid");
    let latency = 4e-3;
    sim.ft_sensor.sampling.latency = latency;
    sim.drives
        .values_mut()
        .for_each(|d| d.sensors.sampling.latency = latency);
    let robot = robot("humanoid");
    let mut can = can_robot("humanoid", &sim).unwrap();
    let mut sync = Frames::new(8);
    for frame in &robot.sync {
        sync.push(*frame);
    }
    let start: Vec<f64> = (0..robot.parameters.joints.len())
        .map(|j| can.robot().set_point(j))
        .collect();
    let knee = robot
        .parameters
        .joints
        .iter()
        .position(|j| j.name == "left_knee");
    let knee = knee.unwrap();
    // Differences of the left ankle's vertical force and the knee's angle to the truth now and
    // `latency` before.
    let mut sums = [[0.0; 2]; 2];
    let mut past = Vec::new();
    for k in 0..1500 {
        let squat = 0.15 * (1.0 - (9.0 * 1e-3 * f64::from(k)).cos());
        let mut set_points = start.clone();
        for (x, joint) in set_points.iter_mut().zip(&robot.parameters.joints) {
            match joint.name.rsplit_once('_') {
                Some((name, "knee")) if !name.is_empty() => *x += 2.0 * squat,
                Some((_, "pitch")) if !joint.name.contains("shoulder") => *x -= squat,
                _ => {}
            }
        }
        let mut commands = sync.clone();
        robot
            .send
            .encode_all(&send_slots(&set_points), &mut commands);
        can.exchange(
            &commands,
            1_000_000_000,
            &mut Frames::new(can_codec::MAX_FRAMES),
        );
        past.push([can.truth().ft[0].force[2], can.truth().joints[knee].q]);
        let readings = can.robot().readings();
        let read = [readings.ft[0].force[2], readings.joints[knee].q];
        if k > 100 {
            for (i, sums) in sums.iter_mut().enumerate() {
                for (sum, ago) in sums.iter_mut().zip([0, 4]) {
                    *sum += (read[i] - past[past.len() - 1 - ago][i]).powi(2);
                }
            }
        }
    }
    for [now, then] in sums {
        assert!(then < 0.2 * now, "{then} {now}");
    }
}
