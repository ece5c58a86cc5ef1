//! Cartesian impedance and force at one frame (D 5.4), as torques of the joints that move it.
//!
//! In: the frame's placement in its base, its Jacobian and mobility `J M^-1 J^T`, velocities of the joints,
//! the desired pose, stiffness, force. Out: the wrench that the frame is to apply, and its torques `J^T w`.
//!
//! ```text
//! w = within(K e(x_d, x) + D v_d - f_d - within'(K_f e_f + d_f)) - D v
//! e = (p_d - p, log(R_d R^T))                    e_f = r * f_d - f_hat                d_f' = w_f e_f
//! D = 2 zeta K^1/2 (K^1/2 J M^-1 J^T K^1/2 + w_0² I)^-1/2 K^1/2
//! ```
//!
//! `D` is the geometric mean of stiffness and the inertia felt at the frame, times `2 zeta`: every mode of
//! spring and inertia gets the same damping ratio (what a double diagonalisation gives). Written with the
//! mobility, which a singular pose makes singular, no inverse of a matrix of the Jacobian is needed: in
//! a direction in which the limb cannot move, the mobility is zero and `w_0` bounds the damping.
//!
//! `r` is the lag of the force that is felt behind the desired one, so that a step which is followed makes
//! no error. `d_f` makes up for what the joints' torques are wrong by while they stand: hysteresis and windup of
//! their gears. A force follows as fast as the frame, with its damping, gives way into what it presses on: `r` has
//! that lag besides, `D / K_o`, with the object's stiffness `K_o` as force and way have shown it. The feedback is
//! limited to a share of the greatest force: a failed F/T sensor or a lost object must not lead to more.
//!
//! `M` contains what the joints' torque laws make a limb feel besides its own inertia, the drives' damping in
//! fast motion; on a stiff object that is most of it. Axes on which a force is fed back are damped as
//! if they had the stiffness of a stiff object.
//!
//! No torque loop bears any stiffness. What each joint may have, `K_s` and `K_d`, was judged by the margins
//! of its loop; the matrices of springs and dampers in joint space, `J^T K J` and `J^T D J`, stay below
//! `diag(K_s)` and `diag(K_d)`: all springs are scaled down alike, as a client chose their ratios, dampers only
//! in the directions that exceed.

mod object;

use crate::six::six;
use dynamics::Se3;
use nalgebra::{Matrix3, Matrix6, Rotation3, SymmetricEigen, UnitQuaternion, Vector3, Vector6};
use object::Object;

/// Natural frequency below which damping grows no more with the inertia, rad/s: far below that of any frame.
/// Chosen; no experiment recorded.
const SLOWEST: f64 = 1.0;
/// Stiffness for which an axis without one and without feedback of its force is damped, over its greatest.
/// Chosen; no experiment recorded.
const DAMPED: f64 = 0.02;
/// Stiffness for which an axis with feedback of its force is damped, over the frame's greatest. Chosen on the simulated
/// leg: its object's, 75 kN/m over 5 kN/m (docs/cartesian.md).
const OBJECT: f64 = 15.0;
/// Steps after which an eigenvalue's iteration is given up; a handful are usual.
const MOST_STEPS: usize = 60;
/// Time in which stiffness, damping ratio and force feedback change from nothing to the greatest, s: as `RAMP_S` of
/// crates/cycle/src/mode/impedance.rs.
const RAMP_S: f64 = 0.5;
/// Share of the greatest wrench that the feedback of the force may have: a sensor that errs presses by no more.
/// Chosen; no experiment recorded.
const FEEDBACK: f64 = 0.2;
/// Shares of the desired force by which the felt one may be short before its feedback fades, and where it ends. Where
/// nothing is to press on it would only push harder, and wind up. Chosen on the simulated leg (docs/cartesian.md,
/// Approach).
const SHORT: [f64; 2] = [0.2, 0.5];
/// Share of the greatest force by which the felt one may always be short. Chosen as [`SHORT`].
const ALWAYS: f64 = 0.05;
/// Time by which a force follows the desired one where it is felt at once, s. The joints' reference model has
/// `1.6 / (2 pi 60 Hz)` = 4.2 ms, the way to the drive 1.9 ms; the rest is margin.
const FOLLOWS_S: f64 = 0.008;
/// w_f times the lag of r, 1: an integrator behind that lag keeps 90 - atan(0.4) = 68 degrees of phase.
const CORRECTS: f64 = 0.4;
/// Greatest damping ratio that a client may ask for, and the least. Chosen; no experiment recorded.
pub const DAMPING_RATIOS: core::ops::RangeInclusive<f64> = 0.3..=2.0;

/// Limits of one frame. Pairs: linear, angular.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CartesianLimits {
    /// Greatest force, N, and torque, N·m, of springs, desired force and its feedback.
    pub wrench: [f64; 2],
    /// Shortest time in which these rise from nothing to their greatest, s.
    pub rise_s: f64,
    /// Greatest stiffness, N/m and N·m/rad.
    pub stiffness: [f64; 2],
    /// Greatest desired velocity, m/s and rad/s.
    pub velocity: [f64; 2],
    /// K_f: gain on the force's error, 1.
    pub k_f: f64,
}

/// Reference of a client for the frame, in its base's axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CartesianTarget {
    /// x_d, R_d.
    pub pose: Se3,
    /// v_d, linear and angular, along `axes`.
    pub velocity: Vector6<f64>,
    /// K, along `axes`.
    pub stiffness: Vector6<f64>,
    /// f_d: wrench of the environment on the frame, along `axes`.
    pub force: Vector6<f64>,
    /// zeta.
    pub damping_ratio: f64,
    /// Axes with feedback of the force.
    pub feedback: [bool; 6],
    /// Axes in which the vectors above are, as columns.
    pub axes: Matrix3<f64>,
}

/// The limb in this cycle. Columns: linear and angular part, in the base's axes, at the frame's origin.
#[derive(Debug, Clone, Copy)]
pub struct Limb<'a> {
    /// x, R.
    pub pose: Se3,
    /// A column of the Jacobian for each joint of the limb.
    pub jacobian: &'a [Vector6<f64>],
    /// J M^-1 J^T.
    pub mobility: Matrix6<f64>,
    /// Velocity of each of these joints, rad/s.
    pub dq: &'a [f64],
    /// Greatest stiffness and damping of each, N·m/rad and N·m·s/rad.
    pub bounds: &'a [[f64; 2]],
    /// f_hat: wrench of the environment on the frame, in the base's axes; none: not known.
    pub force: Option<Vector6<f64>>,
    /// Delay of `force`, s.
    pub late: f64,
}

/// The wrench that the frame is to apply to its surroundings, by its reasons, in the base's axes.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CartesianWrench {
    /// -f_d.
    pub feedforward: Vector6<f64>,
    /// -K_f e_f.
    pub force: Vector6<f64>,
    /// K e.
    pub position: Vector6<f64>,
    /// D (v_d - v).
    pub velocity: Vector6<f64>,
    /// The limit of the wrench has acted.
    pub limited: bool,
    /// Shares of stiffness and of damping that the joints bear, up to 1.
    pub shares: [f64; 2],
    /// x_d is still being approached.
    pub led: bool,
}

impl CartesianWrench {
    /// The sum of all parts.
    #[must_use]
    pub fn sum(&self) -> Vector6<f64> {
        self.feedforward + self.force + self.position + self.velocity
    }
}

/// The law of one frame: what it has been led to.
#[derive(Debug, Clone)]
pub struct CartesianLaw {
    limits: CartesianLimits,
    place: Vector3<f64>,
    orientation: UnitQuaternion<f64>,
    /// Force on the frame, in the base's axes.
    force: Vector6<f64>,
    stiffness: Vector6<f64>,
    feedback: Vector6<f64>,
    /// r * f_d, in the base's axes.
    shown: Vector6<f64>,
    /// d_f, in the base's axes.
    correction: Vector6<f64>,
    object: Object,
    damping_ratio: f64,
    /// Damping, and the least share of it that the joints bear, as of the last cycle that found them.
    damping: Option<(Matrix6<f64>, f64)>,
}

/// `e`: from a pose to the desired one, m and rad, in the base's axes. Beyond a quarter turn the angle
/// falls again, and vanishes at half a turn, where both ways back are equally long.
#[must_use]
pub fn pose_error(desired: &Se3, present: &Se3) -> Vector6<f64> {
    let linear = desired.translation - present.translation;
    let between = desired.rotation * present.rotation.transpose();
    let turn = unit_quaternion(&between).scaled_axis();
    let angle = turn.norm();
    let quarter = core::f64::consts::FRAC_PI_2;
    let share = if angle > quarter {
        (2.0 * quarter - angle).max(0.0) / angle
    } else {
        1.0
    };
    six(&linear, &(turn * share))
}

/// The rotation as a unit quaternion.
#[must_use]
pub fn unit_quaternion(rotation: &Matrix3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(*rotation))
}

/// Linear and angular part.
fn parts(x: &Vector6<f64>) -> [Vector3<f64>; 2] {
    [0, 3].map(|k| x.fixed_rows::<3>(k).into_owned())
}

/// Force and torque of `x`, each turned by the rotation.
fn turned(rotation: &Matrix3<f64>, x: &Vector6<f64>) -> Vector6<f64> {
    let [linear, angular] = parts(x);
    six(&(rotation * linear), &(rotation * angular))
}

/// Share by which each part has to be scaled so that its length is at most `most`.
fn within(x: &Vector6<f64>, most: [f64; 2]) -> [f64; 2] {
    let norms = parts(x).map(|part| part.norm());
    core::array::from_fn(|k| {
        if norms[k] > most[k] {
            most[k] / norms[k]
        } else {
            1.0
        }
    })
}

/// The part of a motion that leads along a way, and no further.
fn ahead(motion: &Vector3<f64>, way: &Vector3<f64>) -> Vector3<f64> {
    let square = motion.norm_squared();
    if square > 0.0 {
        motion * (motion.dot(way) / square).clamp(0.0, 1.0)
    } else {
        Vector3::zeros()
    }
}

fn scaled(x: &Vector6<f64>, shares: [f64; 2]) -> Vector6<f64> {
    let [linear, angular] = parts(x);
    six(&(linear * shares[0]), &(angular * shares[1]))
}

impl CartesianLaw {
    /// The law before its first cycle.
    #[must_use]
    pub fn new(limits: CartesianLimits) -> Self {
        Self {
            limits,
            place: Vector3::zeros(),
            orientation: UnitQuaternion::identity(),
            force: Vector6::zeros(),
            stiffness: Vector6::zeros(),
            feedback: Vector6::zeros(),
            shown: Vector6::zeros(),
            correction: Vector6::zeros(),
            object: Object::default(),
            damping_ratio: 1.0,
            damping: None,
        }
    }

    /// The frame's limits.
    #[must_use]
    pub fn limits(&self) -> &CartesianLimits {
        &self.limits
    }

    /// A mode begins: at the pose where the limb is, with the force that it bears.
    pub fn start(&mut self, pose: &Se3, force: Option<Vector6<f64>>, target: &CartesianTarget) {
        self.place = pose.translation;
        self.orientation = unit_quaternion(&pose.rotation);
        let force = force.filter(|force| force.iter().all(|x| x.is_finite()));
        let force = force.unwrap_or_default();
        self.force = scaled(&force, within(&force, self.limits.wrench));
        self.stiffness = target.stiffness;
        self.feedback = Vector6::zeros();
        self.shown = self.force;
        (self.correction, self.object) = Default::default();
        self.damping_ratio = target.damping_ratio;
    }

    /// Share of K_f that the axis with most of it has been led to, 0 to 1.
    #[must_use]
    pub fn force_share(&self) -> f64 {
        self.feedback.max() / self.limits.k_f.max(f64::MIN_POSITIVE)
    }

    /// f_d as it is followed at present, in the base's axes.
    #[must_use]
    pub fn led_force(&self) -> Vector6<f64> {
        self.force
    }

    /// The wrench of this cycle.
    pub fn wrench(
        &mut self,
        target: &CartesianTarget,
        limb: &Limb<'_>,
        dt: f64,
    ) -> CartesianWrench {
        let (axes, to_axes) = (target.axes, target.axes.transpose());
        self.lead_gains(target, dt);
        let led = self.lead_pose(target, dt);
        self.lead_force(&turned(&axes, &target.force), dt);

        let mobility = in_axes(&to_axes, &limb.mobility);
        let (damping, share) = self.gains(&to_axes, &mobility, limb);
        let stiffness = self.stiffness * share[0];
        let mut v = Vector6::zeros();
        for (column, dq) in limb.jacobian.iter().zip(limb.dq) {
            v += column * *dq;
        }
        let present = turned(&to_axes, &v);
        let error = turned(&to_axes, &pose_error(&self.pose(), &limb.pose));
        let position = stiffness.component_mul(&error);
        let wanted = damping * target.velocity;
        //= D12: f* = f_d + K_f (f_d - f_hat)
        let feedforward = -turned(&to_axes, &self.force);
        let force = -self.force_feedback(&to_axes, &damping, limb, dt);
        let active = position + wanted + feedforward + force;
        let shares = within(&active, self.limits.wrench);
        // Forces that only take energy away are not limited.
        let out = |x: &Vector6<f64>| turned(&axes, &scaled(x, shares));
        CartesianWrench {
            feedforward: out(&feedforward),
            force: out(&force),
            position: out(&position),
            velocity: out(&wanted) - turned(&axes, &(damping * present)),
            limited: shares != [1.0; 2],
            shares: share,
            led,
        }
    }

    /// The pose that is followed.
    fn pose(&self) -> Se3 {
        let rotation = self.orientation.to_rotation_matrix();
        Se3::new(rotation.into_inner(), self.place)
    }

    fn lead_gains(&mut self, target: &CartesianTarget, dt: f64) {
        let share = dt / RAMP_S;
        for (i, now) in self.stiffness.iter_mut().enumerate() {
            let most = share * self.limits.stiffness[i / 3];
            *now += (target.stiffness[i] - *now).clamp(-most, most);
        }
        for (now, on) in self.feedback.iter_mut().zip(target.feedback) {
            let (most, k_f) = (share * self.limits.k_f, self.limits.k_f);
            *now += (if on { k_f } else { 0.0 } - *now).clamp(-most, most);
        }
        let most = share * DAMPING_RATIOS.end();
        self.damping_ratio += (target.damping_ratio - self.damping_ratio).clamp(-most, most);
    }

    /// Leads the pose that is followed towards the desired one, as fast as the spring's force may rise.
    /// True if it is not there yet.
    fn lead_pose(&mut self, target: &CartesianTarget, dt: f64) -> bool {
        let linear = target.pose.translation - self.place;
        let between = target.pose.rotation * self.orientation.inverse().to_rotation_matrix();
        let turn = unit_quaternion(&between).scaled_axis();
        // A target that moves as it says is followed; only the rest is led.
        let moves = turned(&target.axes, &target.velocity) * dt;
        let [dp, dr] = parts(&moves);
        let (dp, dr) = (ahead(&dp, &linear), ahead(&dr, &turn));
        let rest = turned(&target.axes.transpose(), &six(&(linear - dp), &(turn - dr)));
        // Damping counts with the stiffness to come, too: a spring that is moved far away while it is soft would pull
        // when it becomes stiff.
        let stiffness = self.stiffness.sup(&target.stiffness);
        let by_force = within(&stiffness.component_mul(&rest), self.rise(dt));
        let by_velocity = within(&rest, self.limits.velocity.map(|most| most * dt));
        let share: [f64; 2] = core::array::from_fn(|k| by_force[k].min(by_velocity[k]));
        self.place += dp + (linear - dp) * share[0];
        let step = UnitQuaternion::from_scaled_axis(dr + (turn - dr) * share[1]);
        self.orientation = UnitQuaternion::new_normalize((step * self.orientation).into_inner());
        share != [1.0; 2]
    }

    fn lead_force(&mut self, force: &Vector6<f64>, dt: f64) {
        let way = force - self.force;
        self.force += scaled(&way, within(&way, self.rise(dt)));
    }

    /// By how much force and torque may rise within `dt`.
    fn rise(&self, dt: f64) -> [f64; 2] {
        let limits = &self.limits;
        limits.wrench.map(|most| most * dt / limits.rise_s)
    }

    /// Feedback of the force, along the axes.
    fn force_feedback(
        &mut self,
        to_axes: &Matrix3<f64>,
        damping: &Matrix6<f64>,
        limb: &Limb<'_>,
        dt: f64,
    ) -> Vector6<f64> {
        let lag = Vector6::from_fn(|i, _| {
            let soft = OBJECT * self.limits.stiffness[i / 3];
            FOLLOWS_S + limb.late + damping[(i, i)] / self.object.stiffness(i, soft)
        });
        let shown = turned(to_axes, &self.shown);
        let way = turned(to_axes, &self.force) - shown;
        let shown = shown + Vector6::from_fn(|i, _| way[i] * (dt / (dt + lag[i])));
        self.shown = turned(&to_axes.transpose(), &shown);
        let Some(f_hat) = limb.force.map(|f| turned(to_axes, &f)) else {
            self.correction = Vector6::zeros();
            return Vector6::zeros();
        };
        let place = six(&limb.pose.translation, &Vector3::zeros());
        self.object.update(turned(to_axes, &place), f_hat, dt);
        let error = shown - f_hat;
        let most = self.limits.wrench.map(|most| FEEDBACK * most);
        let in_contact = Vector6::from_fn(|i, _| {
            let always = ALWAYS * self.limits.wrench[i / 3];
            let [from, to] = SHORT.map(|share| share * shown[i].abs() + always);
            let beyond = error[i].abs() - from;
            1.0 - (beyond / (to - from).max(always)).clamp(0.0, 1.0)
        });
        let error = error.component_mul(&in_contact);
        let correction = turned(to_axes, &self.correction);
        let correction = Vector6::from_fn(|i, _| {
            let on = in_contact[i] * self.feedback[i] / self.limits.k_f.max(f64::MIN_POSITIVE);
            on * (correction[i] + error[i] * (CORRECTS * dt / lag[i]).min(1.0))
        });
        let correction = scaled(&correction, within(&correction, most));
        self.correction = turned(&to_axes.transpose(), &correction);
        let feedback = self.feedback.component_mul(&error) + correction;
        scaled(&feedback, within(&feedback, most))
    }

    /// Damping matrix, by how much the stiffness has to be scaled, and the least share of the damping that is
    /// left.
    fn gains(
        &mut self,
        to_axes: &Matrix3<f64>,
        mobility: &Matrix6<f64>,
        limb: &Limb<'_>,
    ) -> (Matrix6<f64>, [f64; 2]) {
        let damped = Vector6::from_fn(|i, _| {
            let fed_back = self.feedback[i] / self.limits.k_f.max(f64::MIN_POSITIVE);
            let least = (OBJECT * fed_back).max(DAMPED) * self.limits.stiffness[i / 3];
            self.stiffness[i].max(least).sqrt()
        });
        let frequencies = Matrix6::from_fn(|i, j| damped[i] * mobility[(i, j)] * damped[j]);
        // D = F F^T.
        let quarter = |x: f64| (x.max(0.0) + SLOWEST * SLOWEST).powf(-0.25);
        let factor = function_of(&frequencies, quarter).map(|(root, _)| {
            let size = (2.0 * self.damping_ratio).sqrt();
            Matrix6::from_fn(|i, j| size * damped[i] * root[(i, j)])
        });
        let [mut stiff, mut damp] = [Matrix6::zeros(); 2];
        for (column, [k_s, k_d]) in limb.jacobian.iter().zip(limb.bounds) {
            let column = turned(to_axes, column);
            let square = column * column.transpose();
            stiff += square / k_s.max(f64::MIN_POSITIVE);
            damp += square / k_d.max(f64::MIN_POSITIVE);
        }
        //= D 5.4 (damping): D = 2 zeta K^1/2 (K^1/2 J M^-1 J^T K^1/2 + w_0² I)^-1/2 K^1/2
        let bounded = factor.and_then(|factor| {
            let most = |x: f64| x.max(1.0).recip();
            let (shares, least) = function_of(&(factor.transpose() * damp * factor), most)?;
            Some((factor * shares * factor.transpose(), least))
        });
        let (damping, damped) = *self.damping.insert(match (bounded, self.damping) {
            (Some(found), _) | (None, Some(found)) => found,
            (None, None) => (Matrix6::zeros(), 0.0),
        });
        let stiff = bound(&(Matrix6::from_diagonal(&self.stiffness) * stiff));
        (damping, [stiff.max(1.0).recip(), damped])
    }
}

/// Six-by-six matrix of base axes, in other axes.
fn in_axes(to_axes: &Matrix3<f64>, m: &Matrix6<f64>) -> Matrix6<f64> {
    let mut wide = Matrix6::zeros();
    for k in [0, 3] {
        wide.fixed_view_mut::<3, 3>(k, k).copy_from(to_axes);
    }
    wide * m * wide.transpose()
}

/// A falling function of a symmetric matrix, and its least value; none where the matrix is no number.
fn function_of(m: &Matrix6<f64>, f: impl Fn(f64) -> f64) -> Option<(Matrix6<f64>, f64)> {
    if !m.iter().all(|x| x.is_finite()) {
        return None;
    }
    let eigen = SymmetricEigen::try_new(*m, 1e-12, MOST_STEPS)?;
    let (vectors, values) = (eigen.eigenvectors, eigen.eigenvalues.map(&f));
    let matrix = vectors * Matrix6::from_diagonal(&values) * vectors.transpose();
    Some((matrix, values.min()))
}

/// Upper bound of the largest eigenvalue of a product of two positive semidefinite matrices, at most a
/// quarter above it: `trace(m^8)^(1/8)`.
fn bound(m: &Matrix6<f64>) -> f64 {
    let size = m.trace();
    if !(size.is_finite() && size > 0.0) {
        return 0.0;
    }
    let mut power = m / size;
    for _ in 0..3 {
        power *= power;
    }
    size * power.trace().max(0.0).powf(0.125)
}
