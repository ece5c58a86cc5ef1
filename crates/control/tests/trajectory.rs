//! Trajectories sent ahead: exact at their points, smooth between and across them, whatever pieces
//! come; brought to rest where they end in motion.

use control::{BufferedTrajectory, MotionLimits, PlannedMotion, TrajectoryLimits, interpolate};
use proptest::prelude::*;
use robot_state::{JointPoint, TrajectoryPiece, piece_refusal};
use test_support::{Random, allocations};

const MS: u64 = 1_000_000;

const LIMITS: TrajectoryLimits = TrajectoryLimits {
    position_min: -2.0,
    position_max: 2.0,
    velocity: 4.0,
    acceleration: 100.0,
    stop: MotionLimits {
        velocity: 2.0,
        acceleration: 20.0,
        jerk: 400.0,
    },
};

/// A joint's motion that is no polynomial.
fn sine(joint: usize, t: f64) -> PlannedMotion {
    let (w, size) = (3.0 + joint as f64, 0.4 / (1.0 + joint as f64));
    PlannedMotion {
        q: size * (1.0 - (w * t).cos()),
        dq: size * w * (w * t).sin(),
        ddq: size * w * w * (w * t).cos(),
    }
}

fn piece(joints: usize, begins: u64, spacing: u64, count: usize) -> TrajectoryPiece {
    let mut piece = TrajectoryPiece {
        trajectory: 7,
        begins_ns: begins,
        spacing_ns: spacing,
        joint_count: joints as u32,
        point_count: count as u32,
        ..TrajectoryPiece::default()
    };
    for (k, point) in piece.points.iter_mut().enumerate().take(count) {
        for (j, joint) in point.joints.iter_mut().enumerate().take(joints) {
            let t = (begins + k as u64 * spacing) as f64 * 1e-9;
            let PlannedMotion { q, dq, ddq } = sine(j, t);
            *joint = JointPoint {
                q_d: q,
                dq_d: dq,
                ddq_d: ddq,
            };
        }
    }
    piece
}

fn buffered(joints: usize) -> BufferedTrajectory {
    BufferedTrajectory::new(vec![LIMITS; joints])
}

/// A polynomial of degree five is its own interpolation, whatever the interval.
#[test]
fn quintics_are_reproduced() {
    let mut random = Random::new(3);
    for _ in 0..200 {
        let c: [f64; 6] = std::array::from_fn(|_| random.symmetric());
        let at = |t: f64| PlannedMotion {
            q: (0..6).map(|n| c[n] * t.powi(n as i32)).sum(),
            dq: (1..6).map(|n| n as f64 * c[n] * t.powi(n as i32 - 1)).sum(),
            ddq: (2..6)
                .map(|n| (n * (n - 1)) as f64 * c[n] * t.powi(n as i32 - 2))
                .sum(),
        };
        let (from, h) = (random.symmetric(), 0.01 + random.unit());
        for s in [0.0, 0.2, 0.5, 0.9, 1.0] {
            let found = interpolate(&at(from), &at(from + h), h, s);
            let wanted = at(from + s * h);
            assert!((found.q - wanted.q).abs() < 1e-12);
            assert!((found.dq - wanted.dq).abs() < 1e-10 / h);
            assert!((found.ddq - wanted.ddq).abs() < 1e-9 / (h * h));
        }
        assert_eq!(interpolate(&at(from), &at(from + h), h, 0.0).q, at(from).q);
    }
}

/// Pieces sent ahead of time follow a sine, at points 20 ms apart, to a few micrometres of a radian;
/// without an allocation.
#[test]
fn pieces_in_a_row_follow_the_motion() {
    let joints = 3;
    let mut trajectory = buffered(joints);
    let before = allocations();
    trajectory.take(&piece(joints, 0, 20 * MS, 10)).unwrap();
    for ms in 0..1000u64 {
        if ms % 100 == 50 {
            let next = 20 * MS * (9 + 5 * (ms / 100));
            trajectory.take(&piece(joints, next, 20 * MS, 6)).unwrap();
        }
        let now = trajectory.advance(if ms == 0 { 77 } else { MS });
        for (j, now) in now.iter().enumerate() {
            let wanted = sine(j, ms as f64 * 1e-3);
            let exact = ms.is_multiple_of(20);
            let (q, dq, ddq) = match exact {
                // The points' own times are rounded.
                true => (1e-15, 1e-13, 1e-12),
                false => (1e-8, 5e-6, 2e-3),
            };
            assert!((now.q - wanted.q).abs() <= q, "{ms} {j}");
            assert!((now.dq - wanted.dq).abs() <= dq, "{ms} {j}");
            assert!((now.ddq - wanted.ddq).abs() <= ddq, "{ms} {j}");
        }
    }
    assert_eq!(allocations(), before);
    assert_eq!(trajectory.ended(), 0);
}

#[test]
fn points_that_end_in_motion_are_followed_by_a_stop() {
    let mut trajectory = buffered(2);
    trajectory.take(&piece(2, 0, 5 * MS, 20)).unwrap();
    let mut before = trajectory.advance(MS).to_vec();
    for ms in 1..95 {
        before = trajectory.advance(MS).to_vec();
        assert!(trajectory.is_moving(), "{ms}");
    }
    assert_eq!(trajectory.ended(), 0);
    assert!(before.iter().any(|joint| joint.dq.abs() > 0.3));
    let allocated = allocations();
    let mut longest = 0;
    for ms in 95..1500 {
        let mut now = [PlannedMotion::default(); 2];
        now.copy_from_slice(trajectory.advance(MS));
        for ((a, b), limits) in before.iter().zip(&now).zip([LIMITS; 2]) {
            let way = 0.5e-3 * (a.dq + b.dq);
            assert!((b.q - a.q - way).abs() < 1e-6, "{ms}: {a:?} {b:?}");
            assert!((b.ddq - a.ddq).abs() <= 1.01e-3 * limits.stop.jerk, "{ms}");
        }
        if trajectory.is_moving() {
            longest = ms;
        }
        before.copy_from_slice(&now);
    }
    assert_eq!(allocations(), allocated);
    assert_eq!(trajectory.ended(), 1);
    assert!(
        before
            .iter()
            .all(|joint| (joint.dq, joint.ddq) == (0.0, 0.0))
    );
    assert!((100..500).contains(&longest), "{longest} ms");
    // A piece that comes now is too late, and moves nothing.
    let late = trajectory.take(&piece(2, 95 * MS, 5 * MS, 20));
    assert_eq!(late, Err(piece_refusal::LATE));
    assert_eq!(trajectory.advance(MS), before);
}

#[test]
fn a_last_point_at_rest_ends_without_an_event() {
    let mut trajectory = buffered(1);
    let mut to_rest = piece(1, 0, 5 * MS, 9);
    for (k, point) in to_rest.points.iter_mut().enumerate() {
        // Along a polynomial from rest to rest.
        let ends = [
            PlannedMotion::default(),
            PlannedMotion {
                q: 0.01,
                ..Default::default()
            },
        ];
        let at = interpolate(&ends[0], &ends[1], 0.04, (k as f64 / 8.0).min(1.0));
        (point.joints[0].q_d, point.joints[0].dq_d) = (at.q, at.dq);
        point.joints[0].ddq_d = at.ddq;
    }
    trajectory.take(&to_rest).unwrap();
    for _ in 0..60 {
        trajectory.advance(MS);
    }
    assert_eq!(trajectory.ended(), 0);
    assert!(!trajectory.is_moving());
    assert!((trajectory.advance(MS)[0].q - 0.01).abs() < 1e-15);
}

#[test]
fn pieces_that_are_none_are_refused_and_change_nothing() {
    type Change = fn(&mut TrajectoryPiece);
    let wrong: [(Change, u32); 16] = [
        (|p| p.joint_count = 3, piece_refusal::INVALID),
        (|p| p.point_count = 1, piece_refusal::INVALID),
        (|p| p.point_count = u32::MAX, piece_refusal::INVALID),
        (|p| p.trajectory = 0, piece_refusal::INVALID),
        (|p| p.spacing_ns = 0, piece_refusal::INVALID),
        (|p| p.spacing_ns = u64::MAX, piece_refusal::INVALID),
        (|p| p.begins_ns = u64::MAX, piece_refusal::INVALID),
        (
            |p| p.points[3].joints[1].q_d = f64::NAN,
            piece_refusal::INVALID,
        ),
        (
            |p| p.points[9].joints[0].dq_d = f64::INFINITY,
            piece_refusal::INVALID,
        ),
        (|p| p.points[3].joints[1].q_d = 3.0, piece_refusal::LIMIT),
        (|p| p.points[3].joints[1].dq_d = -4.1, piece_refusal::LIMIT),
        (
            |p| p.points[3].joints[1].ddq_d = 101.0,
            piece_refusal::LIMIT,
        ),
        // As fast again by five.
        (|p| p.spacing_ns = MS, piece_refusal::LIMIT),
        (|p| p.begins_ns = 20 * MS, piece_refusal::LATE),
        (|p| p.begins_ns = 200 * MS, piece_refusal::GAP),
        (|p| p.points[0].joints[1].q_d += 4e-4, piece_refusal::APART),
    ];
    let mut trajectory = buffered(2);
    trajectory.take(&piece(2, 0, 5 * MS, 30)).unwrap();
    for ms in 0..31 {
        trajectory.advance(if ms == 0 { 0 } else { MS });
    }
    for (change, reason) in wrong {
        let mut spoilt = piece(2, 50 * MS, 5 * MS, 10);
        change(&mut spoilt);
        assert_eq!(trajectory.take(&spoilt), Err(reason));
    }
    let far = piece(2, 140 * MS, 100 * MS, 30);
    assert_eq!(trajectory.take(&far), Err(piece_refusal::TOO_FAR));
    let now = trajectory.advance(MS);
    assert!((now[0].q - sine(0, 0.031).q).abs() < 1e-9);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    /// Whatever pieces come, and however the cycles: what comes out is finite, does not step, and
    /// the acceleration steps by no more than joining may take.
    #[test]
    fn any_pieces(seed in any::<u64>()) {
        let mut random = Random::new(seed);
        let joints = 1 + random.below(4);
        let mut trajectory = buffered(joints);
        let spacing = MS * (1 + random.below(30) as u64);
        let first = trajectory.take(&piece(joints, 0, spacing, 2 + random.below(30)));
        prop_assert!(first.is_ok() || first == Err(piece_refusal::TOO_FAR));
        let mut before: Option<Vec<PlannedMotion>> = None;
        let mut now_ns = 0;
        for cycle in 0..800u64 {
            let mut next = piece(
                joints,
                now_ns + MS * random.below(80) as u64 + random.below(2) as u64 * 12_345,
                MS * (1 + random.below(40) as u64),
                2 + random.below(31),
            );
            match random.below(8) {
                0 => next.points[random.below(32)].joints[0].q_d = f64::NAN,
                1 => next.points[random.below(32)].joints[0].dq_d += random.symmetric(),
                2 => next.point_count = random.bits() as u32,
                3 => next.begins_ns = random.bits(),
                4 => next.spacing_ns = random.bits() >> random.below(64),
                _ => {}
            }
            // A little beside what is buffered.
            for point in &mut next.points {
                point.joints[0].q_d += 1e-6 * random.symmetric();
            }
            if random.below(20) == 0 {
                let _ = trajectory.take(&next);
            }
            let elapsed = if cycle == 0 { 0 } else { MS };
            now_ns += elapsed;
            let now = trajectory.advance(elapsed).to_vec();
            for (j, now) in now.iter().enumerate() {
                prop_assert!([now.q, now.dq, now.ddq].iter().all(|x| x.is_finite()));
                let Some(before) = before.as_ref().map(|before| before[j]) else {
                    continue;
                };
                // Within a millisecond the joint moves by its velocity; a point whose velocity was
                // shaken by 1 rad/s makes it up by as much on both sides.
                let way = 0.5e-3 * (before.dq + now.dq);
                prop_assert!((now.q - before.q - way).abs() < 1e-3, "{before:?} {now:?}");
            }
            before = Some(now);
        }
    }
}
