//! Trajectories that are sent ahead in pieces: points of all joints, and between them the quintic
//! polynomial that has position, velocity and acceleration of both its ends (Hermite). So the motion
//! is exact at the points and continuous up to the acceleration.
//!
//! A new piece takes the place of what lies after its first point, where it has to agree with what it
//! joins. A trajectory whose points end in motion is brought to rest by a motion of its own.

use std::collections::VecDeque;

use robot_state::{JointPoint, MAX_POINTS, TrajectoryPiece, TrajectoryPoint, piece_refusal};

use crate::point_to_point::{MotionLimits, PlannedMotion, PointToPoint};

/// Furthest that a trajectory may be buffered, ns: so long it goes on where its client hangs.
const FURTHEST_NS: u64 = 1_000_000_000;
/// Most points that are buffered: those of four pieces, and where two are joined.
const MOST_KNOTS: usize = 4 * MAX_POINTS + 2;
/// Spacings of points that a piece may have, ns. Chosen; no experiment recorded.
const SPACINGS_NS: std::ops::RangeInclusive<u64> = 500_000..=200_000_000;
/// A piece joins what is buffered at least so far ahead, ns.
const AHEAD_NS: u64 = 1_000_000;
/// Greatest share of the acceleration limit that joining a piece may take. Chosen; no experiment recorded.
const JOINING: f64 = 0.1;
/// Greatest difference where a piece joins, as the joint's way at its velocity limit, s: that of two cycles at 1 kHz.
const APART_S: f64 = 2e-3;
/// For rounding of values that are meant to be the limit: four written digits err by 0.05 %, single precision by less.
const ROUNDING: f64 = 1.001;
/// Velocity and acceleration, as shares of their limits, below which a last point is at rest.
/// Chosen; no experiment recorded.
const REST: f64 = 1e-4;

/// Limits of a joint's points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrajectoryLimits {
    /// Least q_d, rad.
    pub position_min: f64,
    /// Greatest q_d, rad.
    pub position_max: f64,
    /// Greatest |dq_d|, rad/s.
    pub velocity: f64,
    /// Greatest |ddq_d|, rad/s².
    pub acceleration: f64,
    /// Limits of the motion that brings the joint to rest where the points end in motion.
    pub stop: MotionLimits,
}

impl TrajectoryLimits {
    fn admit(&self, point: &PlannedMotion) -> bool {
        (self.position_min..=self.position_max).contains(&point.q)
            && point.dq.abs() <= self.velocity * ROUNDING
            && point.ddq.abs() <= self.acceleration * ROUNDING
    }

    /// A joint whose velocity and acceleration stay within the limits can get from one point to the
    /// other in `time`, s. A constant acceleration and its reverse lead furthest off the way that
    /// the mean of both velocities makes.
    fn can_connect(&self, from: &PlannedMotion, to: &PlannedMotion, time: f64) -> bool {
        let way = to.q - from.q;
        let mean = 0.5 * time * (from.dq + to.dq);
        way.abs() <= self.velocity * time * ROUNDING + 1e-12
            && (to.dq - from.dq).abs() <= self.acceleration * time * ROUNDING
            && (way - mean).abs() <= 0.25 * self.acceleration * time * time * ROUNDING + 1e-12
    }

    fn is_at_rest(&self, point: &PlannedMotion) -> bool {
        point.dq.abs() <= REST * self.velocity && point.ddq.abs() <= REST * self.acceleration
    }

    /// A piece that begins with `new` may join what is at `old` there, `time` (s) ahead. The quintic
    /// that makes up for a difference of position d, velocity v and acceleration a has an
    /// acceleration of at most `6 |d| / time² + 4 |v| / time + |a|`.
    fn join(&self, old: &PlannedMotion, new: &PlannedMotion, time: f64) -> bool {
        let (d, v) = (new.q - old.q, new.dq - old.dq);
        let needed = 6.0 * d.abs() / (time * time) + 4.0 * v.abs() / time;
        let difference = needed + (new.ddq - old.ddq).abs();
        difference <= JOINING * self.acceleration && d.abs() <= APART_S * self.velocity
    }
}

/// The quintic polynomial from `from` to `to` within `duration`, s, at the share `s` of it, 0 to 1.
#[must_use]
pub fn interpolate(
    from: &PlannedMotion,
    to: &PlannedMotion,
    duration: f64,
    s: f64,
) -> PlannedMotion {
    let h = duration;
    let (c1, c2) = (h * from.dq, 0.5 * h * h * from.ddq);
    // The way left at the end, in position, velocity and acceleration.
    let d = to.q - from.q - c1 - c2;
    let e = h * to.dq - c1 - 2.0 * c2;
    let f = h * h * to.ddq - 2.0 * c2;
    let c3 = 10.0 * d - 4.0 * e + 0.5 * f;
    let c4 = -15.0 * d + 7.0 * e - f;
    let c5 = 6.0 * d - 3.0 * e + 0.5 * f;
    let q = from.q + s * (c1 + s * (c2 + s * (c3 + s * (c4 + s * c5))));
    let dq = c1 + s * (2.0 * c2 + s * (3.0 * c3 + s * (4.0 * c4 + s * 5.0 * c5)));
    let ddq = 2.0 * c2 + s * (6.0 * c3 + s * (12.0 * c4 + s * 20.0 * c5));
    PlannedMotion {
        q,
        dq: dq / h,
        ddq: ddq / (h * h),
    }
}

/// Motion of a trajectory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Progress {
    /// Buffered, not followed yet.
    Waiting,
    /// On the way between its points.
    Going,
    /// Being brought to rest after points that ended in motion.
    Stopping,
    /// The trajectory is over: at rest after its last point.
    Over,
}

/// The buffered points of one trajectory, and the place on it. Allocates at construction alone.
#[derive(Debug)]
pub struct BufferedTrajectory {
    limits: Vec<TrajectoryLimits>,
    /// Instants of the points since the trajectory's begin, ns.
    times: VecDeque<u64>,
    /// The points: all joints of the first one, then those of the next.
    points: VecDeque<PlannedMotion>,
    progress: Progress,
    /// Time since the trajectory's begin, ns.
    now_ns: u64,
    joined: Vec<PlannedMotion>,
    now: Vec<PlannedMotion>,
    stop: PointToPoint,
    /// Trajectories that ended in motion.
    ended: u32,
}

impl BufferedTrajectory {
    /// Empty, for joints with these limits.
    #[must_use]
    pub fn new(limits: impl IntoIterator<Item = TrajectoryLimits>) -> Self {
        let limits: Vec<_> = limits.into_iter().collect();
        let joints = limits.len();
        // Filled once, so that no page is touched for the first time in the loop.
        let mut times: VecDeque<u64> = std::iter::repeat_n(1, MOST_KNOTS).collect();
        let rest = PlannedMotion::default();
        let mut points: VecDeque<_> = std::iter::repeat_n(rest, MOST_KNOTS * joints).collect();
        times.clear();
        points.clear();
        Self {
            times,
            points,
            progress: Progress::Waiting,
            now_ns: 0,
            joined: vec![PlannedMotion::default(); joints],
            now: vec![PlannedMotion::default(); joints],
            stop: PointToPoint::new(joints),
            ended: 0,
            limits,
        }
    }

    /// Forgets everything but the count of [`Self::ended`].
    pub fn clear(&mut self) {
        self.times.clear();
        self.points.clear();
        self.progress = Progress::Waiting;
        self.now_ns = 0;
    }

    /// Nothing is buffered.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.times.is_empty()
    }

    /// Whether the trajectory has begun.
    #[must_use]
    pub fn has_begun(&self) -> bool {
        self.progress != Progress::Waiting
    }

    /// Whether the trajectory moves a joint, or will without another piece.
    #[must_use]
    pub fn is_moving(&self) -> bool {
        matches!(self.progress, Progress::Going | Progress::Stopping)
    }

    /// Trajectories that ended in motion.
    #[must_use]
    pub fn ended(&self) -> u32 {
        self.ended
    }

    /// Time since its begin, s; 0 before.
    #[must_use]
    pub fn time_s(&self) -> f64 {
        self.now_ns as f64 * 1e-9
    }

    /// Time until its last point, s.
    #[must_use]
    pub fn left_s(&self) -> f64 {
        let end = self.times.back().copied().unwrap_or(0);
        end.saturating_sub(self.now_ns) as f64 * 1e-9
    }

    /// Takes a piece in place of what is buffered after its first point.
    ///
    /// # Errors
    /// One of [`piece_refusal`]; nothing has changed then.
    pub fn take(&mut self, piece: &TrajectoryPiece) -> Result<(), u32> {
        let (begin, spacing) = (piece.begins_ns, piece.spacing_ns);
        let count = piece.point_count as usize;
        let joints = self.limits.len();
        let is_piece = (2..=MAX_POINTS).contains(&count)
            && SPACINGS_NS.contains(&spacing)
            && piece.joint_count as usize == joints
            && piece.trajectory != 0;
        let Some(points) = piece.points.get(..count).filter(|_| is_piece) else {
            return Err(piece_refusal::INVALID);
        };
        let end = spacing
            .checked_mul(count as u64 - 1)
            .and_then(|length| begin.checked_add(length));
        let end = end.ok_or(piece_refusal::INVALID)?;
        for point in points {
            self.admit(point)?;
        }
        for ends in points.windows(2) {
            self.connect(ends, spacing)?;
        }
        if end.saturating_sub(self.now_ns) > FURTHEST_NS {
            return Err(piece_refusal::TOO_FAR);
        }
        let kept = match self.progress {
            Progress::Waiting if begin == 0 => 0,
            Progress::Going if begin < self.now_ns.saturating_add(AHEAD_NS) => {
                return Err(piece_refusal::LATE);
            }
            Progress::Waiting | Progress::Going => self.kept_before(begin)?,
            Progress::Stopping | Progress::Over => return Err(piece_refusal::LATE),
        };
        if kept > 0 {
            self.join(kept, begin, points.first())?;
        }
        // One more knot is the place where old and new points join.
        if kept + 1 + count > MOST_KNOTS {
            return Err(piece_refusal::TOO_FAR);
        }
        self.times.truncate(kept);
        self.points.truncate(kept * joints);
        if self.progress == Progress::Going && self.times.back().is_some_and(|&t| t < self.now_ns) {
            // The way from here leads to the new point, whatever way led here.
            self.times.push_back(self.now_ns);
            self.points.extend(&self.now);
        }
        for (k, point) in points.iter().enumerate() {
            self.times.push_back(begin + k as u64 * spacing);
            let joints = point.joints.iter().take(joints);
            self.points.extend(joints.map(planned));
        }
        Ok(())
    }

    fn admit(&self, point: &TrajectoryPoint) -> Result<(), u32> {
        for (limits, joint) in self.limits.iter().zip(&point.joints) {
            let numbers = [joint.q_d, joint.dq_d, joint.ddq_d];
            if !numbers.iter().all(|x| x.is_finite()) {
                return Err(piece_refusal::INVALID);
            }
            if !limits.admit(&planned(joint)) {
                return Err(piece_refusal::LIMIT);
            }
        }
        Ok(())
    }

    fn connect(&self, ends: &[TrajectoryPoint], spacing: u64) -> Result<(), u32> {
        let [from, to] = ends else {
            return Ok(());
        };
        let mut joints = self.limits.iter().zip(from.joints.iter().zip(&to.joints));
        let time = spacing as f64 * 1e-9;
        if joints.all(|(limits, (a, b))| limits.can_connect(&planned(a), &planned(b), time)) {
            Ok(())
        } else {
            Err(piece_refusal::LIMIT)
        }
    }

    /// How many points stay before a piece that begins at this instant, ns.
    fn kept_before(&self, begin: u64) -> Result<usize, u32> {
        match self.times.back() {
            Some(&end) if begin <= end => Ok(self.times.partition_point(|&time| time < begin)),
            _ => Err(piece_refusal::GAP),
        }
    }

    /// Whether a piece may join at its first point, of which `kept` points lie before.
    fn join(
        &mut self,
        kept: usize,
        begin: u64,
        first: Option<&TrajectoryPoint>,
    ) -> Result<(), u32> {
        let before = self.times.get(kept - 1).copied().unwrap_or(0);
        let time = begin.saturating_sub(before.max(self.now_ns)) as f64 * 1e-9;
        let Self {
            times,
            points,
            joined,
            ..
        } = self;
        evaluate(times, points, kept - 1, begin, joined);
        let joints = self.joined.iter().zip(first.iter().flat_map(|p| &p.joints));
        let mut joints = joints.zip(&self.limits);
        if joints.all(|((old, new), limits)| limits.join(old, &planned(new), time)) {
            Ok(())
        } else {
            Err(piece_refusal::APART)
        }
    }

    /// The joints `elapsed` (ns) after the last call; the first call begins the trajectory. After the
    /// last point they stay, or are brought to rest.
    pub fn advance(&mut self, elapsed: u64) -> &[PlannedMotion] {
        let Some(&end) = self.times.back() else {
            return &self.now;
        };
        match self.progress {
            Progress::Waiting => self.progress = Progress::Going,
            _ => self.now_ns = self.now_ns.saturating_add(elapsed),
        }
        let joints = self.limits.len();
        while self.times.get(1).is_some_and(|&next| next <= self.now_ns) {
            self.times.pop_front();
            self.points.drain(..joints.min(self.points.len()));
        }
        match self.progress {
            Progress::Going if self.now_ns < end => {
                evaluate(&self.times, &self.points, 0, self.now_ns, &mut self.now);
            }
            Progress::Going => self.end(self.now_ns - end),
            Progress::Stopping => self.go_on_stopping(elapsed),
            Progress::Waiting | Progress::Over => {}
        }
        &self.now
    }

    /// The last point was passed `since` ns ago.
    fn end(&mut self, since: u64) {
        for (now, last) in self.now.iter_mut().zip(&self.points) {
            *now = *last;
        }
        let mut joints = self.now.iter().zip(&self.limits);
        if joints.all(|(now, limits)| limits.is_at_rest(now)) {
            self.rest();
            return;
        }
        self.ended = self.ended.wrapping_add(1);
        self.stop.start(self.now.iter().copied());
        if self.stop.stop(self.limits.iter().map(|limits| limits.stop)) {
            self.progress = Progress::Stopping;
            self.go_on_stopping(since);
        } else {
            // A motion to rest exists for all finite numbers.
            self.rest()
        }
    }

    fn go_on_stopping(&mut self, elapsed: u64) {
        let planned = self.stop.advance(elapsed as f64 * 1e-9);
        self.now.copy_from_slice(planned);
        if self.stop.left_s() <= 0.0 {
            self.rest();
        }
    }

    fn rest(&mut self) {
        self.progress = Progress::Over;
        for now in &mut self.now {
            (now.dq, now.ddq) = (0.0, 0.0);
        }
    }
}

fn planned(joint: &JointPoint) -> PlannedMotion {
    PlannedMotion {
        q: joint.q_d,
        dq: joint.dq_d,
        ddq: joint.ddq_d,
    }
}

/// All joints at an instant after the point `index`: on the way to the next one, or at it.
fn evaluate(
    times: &VecDeque<u64>,
    points: &VecDeque<PlannedMotion>,
    index: usize,
    instant: u64,
    out: &mut [PlannedMotion],
) {
    let joints = out.len();
    let (Some(&from), to) = (times.get(index), times.get(index + 1)) else {
        return;
    };
    let first = index * joints;
    let next = to.copied().filter(|to| *to > from);
    for (j, out) in out.iter_mut().enumerate() {
        let (a, b) = (points.get(first + j), points.get(first + joints + j));
        *out = match (a, b, next) {
            (Some(a), Some(b), Some(to)) if instant > from => {
                let (h, way) = ((to - from) as f64 * 1e-9, (instant - from) as f64 * 1e-9);
                if instant < to {
                    interpolate(a, b, h, way / h)
                } else {
                    *b
                }
            }
            (Some(a), ..) => *a,
            _ => *out,
        };
    }
}
