//! Motions from point to point: limits, arrival, new targets, numbers that are none.

use control::{MotionLimits, PlannedMotion, PointToPoint};
use proptest::prelude::*;
use rsruckig::error::IgnoreErrorHandler;
use rsruckig::prelude::{InputParameter, Ruckig, Trajectory};
use test_support::{Random, allocations};

const PERIOD: f64 = 1e-3;

fn limits(random: &mut Random) -> MotionLimits {
    let velocity = 0.2 + 5.0 * random.unit();
    let acceleration = velocity * (0.5 + 10.0 * random.unit());
    let jerk = acceleration * (2.0 + 30.0 * random.unit());
    MotionLimits {
        velocity,
        acceleration,
        jerk,
    }
}

/// Within limits, and each point follows from the one before.
fn assert_follows(before: &[PlannedMotion], now: &[PlannedMotion], limits: &[MotionLimits]) {
    for ((a, b), limits) in before.iter().zip(now).zip(limits) {
        assert!(
            b.dq.abs() <= limits.velocity * (1.0 + 1e-9),
            "{b:?} {limits:?}"
        );
        assert!(
            b.ddq.abs() <= limits.acceleration * (1.0 + 1e-9),
            "{b:?} {limits:?}"
        );
        assert!(
            (b.ddq - a.ddq).abs() <= limits.jerk * PERIOD * (1.0 + 1e-6),
            "{a:?} {b:?}"
        );
        // The trapezoidal rule is off by the jerk's third of a period.
        let way = 0.5 * (a.dq + b.dq) * PERIOD;
        let error = limits.jerk * PERIOD.powi(3);
        assert!((b.q - a.q - way).abs() <= error + 1e-12, "{a:?} {b:?}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(100))]

    /// Targets that come at any time: the motion stays within its limits, does not step, and ends
    /// at the last target, at rest, for all joints at once.
    #[test]
    fn targets_at_any_time(seed in any::<u64>(), joints in 1usize..9, targets in 1usize..6) {
        let mut random = Random::new(seed);
        let limits: Vec<_> = (0..joints).map(|_| limits(&mut random)).collect();
        let mut motion = PointToPoint::new(joints);
        let place = |random: &mut Random| -> Vec<f64> {
            (0..joints).map(|_| 3.0 * random.symmetric()).collect()
        };
        let start = place(&mut random);
        motion.start(start.iter().map(|&q| PlannedMotion { q, ..Default::default() }));
        let mut now = motion.advance(PERIOD).to_vec();
        let mut target = start;
        for _ in 0..targets {
            target = place(&mut random);
            prop_assert!(motion.go_to(target.iter().copied().zip(limits.iter().copied())));
            for _ in 0..random.below(1500) {
                let before = std::mem::replace(&mut now, motion.advance(PERIOD).to_vec());
                assert_follows(&before, &now, &limits);
            }
        }
        let cycles = (motion.left_s() / PERIOD) as usize;
        for cycle in 0..cycles + 2 {
            let before = std::mem::replace(&mut now, motion.advance(PERIOD).to_vec());
            assert_follows(&before, &now, &limits);
            // All are on their way until nearly the end.
            if cycle + 20 == cycles && cycles > 300 && targets == 1 {
                let moving = now.iter().all(|joint| joint.dq != 0.0);
                prop_assert!(moving, "{now:?}");
            }
        }
        prop_assert_eq!(motion.left_s(), 0.0);
        for (joint, target) in now.iter().zip(target) {
            prop_assert!((joint.q - target).abs() < 1e-8, "{joint:?} {target}");
            prop_assert!(joint.dq == 0.0 && joint.ddq == 0.0);
        }
    }
}

/// Joints in any motion: each one planned by itself, they take the time and the ways that the library
/// finds for all of them together.
#[test]
fn the_motion_is_that_of_all_joints_together() {
    let mut random = Random::new(3);
    for _ in 0..3000 {
        let joints = 2 + random.below(7);
        let limits: Vec<_> = (0..joints).map(|_| limits(&mut random)).collect();
        // Ways of all sizes beside the way that a joint takes to stop.
        let size = 10_f64.powf(-3.0 * random.unit());
        let mut input = InputParameter::<0>::new(Some(joints));
        let mut starts = Vec::new();
        for (j, limits) in limits.iter().enumerate() {
            let mut start = PlannedMotion {
                q: random.symmetric(),
                dq: 0.9 * limits.velocity * random.symmetric(),
                ddq: 0.9 * limits.acceleration * random.symmetric(),
            };
            let target = start.q + size * random.symmetric();
            if random.unit() < 0.5 {
                (start.dq, start.ddq) = (0.0, 0.0);
            }
            input.current_position[j] = start.q;
            input.current_velocity[j] = start.dq;
            input.current_acceleration[j] = start.ddq;
            input.target_position[j] = target;
            input.max_velocity[j] = limits.velocity;
            input.max_acceleration[j] = limits.acceleration;
            input.max_jerk[j] = limits.jerk;
            starts.push(start);
        }
        let mut together = Trajectory::<0>::new(Some(joints));
        let mut library = Ruckig::<0, IgnoreErrorHandler>::new(Some(joints), 0.0);
        library.calculate(&input, &mut together).unwrap();
        let mut motion = PointToPoint::new(joints);
        motion.start(starts);
        let targets = (0..joints).map(|j| (input.target_position[j], limits[j]));
        assert!(motion.go_to(targets));
        let duration = together.duration;
        assert!(
            (motion.left_s() - duration).abs() < 1e-9,
            "{} {duration}",
            motion.left_s()
        );
        for _ in 0..3 {
            let now = motion.advance(duration / 4.0).to_vec();
            let time = duration - motion.left_s();
            together.state_to_integrate_from(time, &mut 0, |j, t, p, v, a, jerk| {
                let (q, ..) = rsruckig::util::integrate(t, p, v, a, jerk);
                assert!((q - now[j].q).abs() < 1e-7, "joint {j} at {time}");
            });
        }
    }
}

/// Targets of many joints that change in every cycle: planned on the way, without a step, within
/// limits, and to the last of them.
#[test]
fn new_targets_in_every_cycle_are_planned_on_the_way() {
    const JOINTS: usize = 32;
    let mut random = Random::new(11);
    let limits: Vec<_> = (0..JOINTS).map(|_| limits(&mut random)).collect();
    let mut motion = PointToPoint::new(JOINTS);
    motion.start([PlannedMotion::default(); JOINTS]);
    let mut target: Vec<f64> = (0..JOINTS).map(|_| random.symmetric()).collect();
    let mut now = motion.advance(PERIOD).to_vec();
    let (mut plans, mut newer) = (0, true);
    let allocated = allocations();
    let mut wait = 0;
    for cycle in 0..12_000 {
        // Streamed in the first part, jumps in the second, then one to rest at.
        let changes = match cycle {
            0..3000 => true,
            3000..6000 => cycle % 250 == 0,
            _ => false,
        };
        if changes {
            let step = if cycle < 3000 { 2e-3 } else { 1.0 };
            target
                .iter_mut()
                .for_each(|q| *q += step * random.symmetric());
            newer = true;
        }
        if newer && !motion.is_planning() {
            let ways = target.iter().copied().zip(limits.iter().copied());
            assert!(motion.go_on_to(ways, PERIOD));
            (newer, wait) = (false, 0);
            plans += 1;
        }
        assert!(cycle >= 3000 || motion.left_s() > 0.0, "cycle {cycle}");
        let mut before = [PlannedMotion::default(); JOINTS];
        before.copy_from_slice(&now);
        now.copy_from_slice(motion.advance(PERIOD));
        wait += usize::from(motion.is_planning());
        assert!(wait <= 3, "cycle {cycle}");
        assert_follows(&before, &now, &limits);
    }
    assert_eq!(allocations() - allocated, 0);
    assert_eq!(plans, 3000 / 4 + 12);
    assert_eq!(motion.left_s(), 0.0);
    for (joint, target) in now.iter().zip(target) {
        assert!((joint.q - target).abs() < 1e-8, "{joint:?} {target}");
        assert!(joint.dq == 0.0 && joint.ddq == 0.0);
    }
}

#[test]
fn a_target_that_is_no_number_changes_nothing() {
    let limits = MotionLimits {
        velocity: 1.0,
        acceleration: 5.0,
        jerk: 50.0,
    };
    let mut motion = PointToPoint::new(2);
    motion.start([PlannedMotion::default(); 2]);
    assert!(motion.go_to([(1.0, limits), (-1.0, limits)]));
    let left = motion.left_s();
    for bad in [f64::NAN, f64::INFINITY] {
        assert!(!motion.go_to([(0.5, limits), (bad, limits)]));
        let slow = MotionLimits {
            velocity: bad,
            ..limits
        };
        assert!(!motion.go_to([(0.5, slow), (0.0, limits)]));
    }
    assert_eq!(motion.left_s(), left);
    for _ in 0..3000 {
        motion.advance(PERIOD);
    }
    let [a, b] = motion.advance(PERIOD) else {
        panic!("two joints");
    };
    assert!((a.q - 1.0).abs() < 1e-9 && (b.q + 1.0).abs() < 1e-9);
}

/// A joint that is faster than its limit when a motion begins is braked, not refused.
#[test]
fn begins_faster_than_allowed() {
    let limits = MotionLimits {
        velocity: 0.5,
        acceleration: 2.0,
        jerk: 20.0,
    };
    let mut motion = PointToPoint::new(1);
    motion.start([PlannedMotion {
        q: 0.0,
        dq: 1.0,
        ddq: 0.0,
    }]);
    assert!(motion.go_to([(0.1, limits)]));
    for _ in 0..(motion.left_s() / PERIOD) as usize + 2 {
        motion.advance(PERIOD);
    }
    assert!((motion.advance(PERIOD)[0].q - 0.1).abs() < 1e-9);
}

#[test]
fn a_new_target_in_every_cycle_allocates_nothing() {
    const JOINTS: usize = 32;
    let mut random = Random::new(7);
    let mut motion = PointToPoint::new(JOINTS);
    motion.start([PlannedMotion::default(); JOINTS]);
    let limits: Vec<_> = (0..JOINTS).map(|_| limits(&mut random)).collect();
    let target: Vec<f64> = (0..JOINTS).map(|_| random.symmetric()).collect();
    let before = allocations();
    let mut found = 0;
    for cycle in 0..2000 {
        let shift = 0.1 * (1e-2 * f64::from(cycle)).sin();
        let targets = target.iter().map(|q| q + shift);
        found += u32::from(motion.go_to(targets.zip(limits.iter().copied())));
        motion.advance(PERIOD);
    }
    assert_eq!(allocations() - before, 0);
    assert_eq!(found, 2000);
}
