//! The drive's stiffness and damping, corrected while the joint works.
//!
//! The current that a drive reports shows what its loop makes of a command, whatever friction and load
//! do. Means over a block of samples, `e` beyond the dead zone, `m = K_t N i`:
//!
//! ```text
//! m - (k_d e - d_d omega) = a k_d e - b d_d omega + o + noise
//! ```
//!
//! `a` and `b`, shares by which stiffness and damping are wrong, and the current's offset `o` walk
//! around zero (Ornstein-Uhlenbeck): a Kalman filter finds what commands and motion show, and what they
//! do not show any more fades to the configured values.
//!
//! Angles carry the noise of their encoder. Of a joint at rest `omega` is nothing else, and the current shows no
//! damping of it: a fit that took it for motion would find none (errors in variables). So damping is sought where the
//! motor moves beyond the noise, which second differences of its angles show, and a spring that changes by no more than
//! its noise is taken to make what it made before.
//!
//! Of a velocity loop with an integral that is configured, `m` is what its current shows besides that integral. One
//! that is not configured shows itself by a torque that no lead makes: such a loop moves until there is none, whatever
//! it bears.

use super::parameters::{DriveLoop, LawParameters};
use nalgebra::{Matrix3, Vector3};

/// Samples of a block.
const BLOCK: u32 = 16;
/// Standard deviation of `a` and `b` before anything is known. Chosen; no experiment recorded.
const PRIOR: f64 = 0.15;
/// Standard deviation of the current's offset, share of the torque limit. Chosen; no experiment recorded.
const OFFSET: f64 = 0.02;
/// Standard deviation of a block's residual, share of the torque limit. Chosen; no experiment recorded.
const NOISE: f64 = 0.006;
/// Time in which what is not shown any more fades, s. Chosen; no experiment recorded.
const FADES_S: f64 = 600.0;
/// Largest |a| and |b| that act: margins bear drives that are wrong by as much. Chosen; no experiment recorded.
const MOST: f64 = 0.3;
/// Largest rate of `a` and `b`, 1/s: less than 0.1 % in the 4 ms of the disturbance observer (40 Hz).
const RATE: f64 = 0.2;
/// Smaller changes are not worth the computation of the observer's steps. Chosen; no experiment recorded.
const LEAST: f64 = 0.003;
/// Residuals beyond this many standard deviations are none of this model: a current at its limit, a drive that does not
/// follow. By chance one block of 16,000 is beyond four.
const OUTLIER: f64 = 4.0;
/// Mean square of the residuals over their variance from which on the fit is not believed.
/// Chosen; no experiment recorded.
const INCONSISTENT: f64 = 6.0;
/// Time of the mean square of the residuals, s. Chosen; no experiment recorded.
const CONSISTENCY_S: f64 = 2.0;
/// Torque, share of the limit, that a drive makes without a lead: more than the offset of a current. It is twice the
/// standard deviation [`OFFSET`].
const WITHOUT_LEAD: f64 = 0.04;
/// Share of that torque that the lead may explain, as a drive of four times the configured stiffness would.
const BY_LEAD: f64 = 0.25;
/// Time for which a torque without a lead must last, s: longer than a set-point that turns round takes.
/// Chosen; no experiment recorded.
const WITHOUT_LEAD_S: f64 = 0.1;
/// Motion, and changes of the torque asked for, count beyond this many standard deviations of their noise: at rest one
/// block in five minutes does. Less lets noise teach: at 3, 1 block in 400.
const BEYOND_NOISE: f64 = 4.0;
/// Time of the mean of the encoder's noise, s: some hundred samples.
const NOISE_MEAN_S: f64 = 0.5;
/// Time for which a drive must be unlike the configured one to be called so, s. Chosen; no experiment recorded.
const UNLIKE_S: f64 = 3.0;

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct DriveFit {
    /// k_d and d_d of the configuration.
    nominal: [f64; 2],
    dead_zone: f64,
    /// 1/T_i of the configuration, 1/s.
    integral: f64,
    sample_period: f64,
    torque_limit: f64,
    /// a, b and o, N·m.
    mean: Vector3<f64>,
    covariance: Matrix3<f64>,
    /// Mean square of the residuals over their variance.
    surprise: f64,
    /// a and b as they act.
    applied: [f64; 2],
    /// Time for which the drive has been unlike the configured one, s.
    unlike_s: f64,
    /// Time for which it has made a torque without a lead, s.
    without_lead_s: f64,
    /// Variance of the motor angle's noise, rad^2, from the first block on.
    angle_noise: Option<f64>,
    /// Torque that the spring has made since it last changed by more than noise, N·m.
    held: f64,
    /// Samples that are left out before the first block.
    phase: u32,
    waits: u32,
    block: Block,
}

/// Sums over the samples of a block.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Block {
    samples: u32,
    /// theta before the first and at the last, rad.
    from: f64,
    to: f64,
    /// theta before the last, rad, and the sum of the squares of its second differences, rad^2.
    before: f64,
    bends: f64,
    /// e, rad, and m, N·m.
    error: f64,
    torque: f64,
}

impl DriveFit {
    /// Makes the fit; none for a drive that takes currents, whose relation is its torque constant.
    pub(super) fn new(p: &LawParameters) -> Option<Self> {
        let DriveLoop::Position {
            stiffness,
            damping,
            dead_zone,
            integral,
        } = p.drive
        else {
            return None;
        };
        Some(Self {
            nominal: [stiffness, damping],
            dead_zone,
            integral,
            sample_period: p.sample_period,
            torque_limit: p.torque_limit,
            mean: Vector3::zeros(),
            covariance: Matrix3::from_diagonal(&prior(p.torque_limit)),
            surprise: 1.0,
            applied: [0.0; 2],
            unlike_s: 0.0,
            without_lead_s: 0.0,
            angle_noise: None,
            held: 0.0,
            phase: 0,
            waits: 0,
            block: Block::default(),
        })
    }

    /// Blocks of the joint with this index end apart from those of its neighbours: the work of many joints
    /// is not done in one cycle.
    pub(super) fn stagger(&mut self, index: usize) {
        self.phase = (index % BLOCK as usize) as u32;
        self.interrupt();
    }

    /// Drops the block: its samples are not of one motion.
    pub(super) fn interrupt(&mut self) {
        (self.block, self.waits) = (Block::default(), self.phase);
    }

    /// A sample: motor's angle and torque of its current (N·m), and the command that acts, rad.
    /// Returns the drive where it is another one from now on.
    pub(super) fn update(&mut self, theta: f64, torque: f64, command: f64) -> Option<DriveLoop> {
        let error = command - theta;
        let usable = [theta, torque, command].iter().all(|x| x.is_finite());
        let asked = self.nominal[0] * error;
        if !usable || asked.abs().max(torque.abs()) > self.torque_limit {
            self.interrupt();
            return None;
        }
        if self.waits > 0 {
            self.waits -= 1;
            return None;
        }
        let block = &mut self.block;
        if block.samples > 0 {
            block.error += error - error.max(-self.dead_zone).min(self.dead_zone);
            block.torque += torque;
        } else {
            block.from = theta;
        }
        if block.samples > 1 {
            block.bends += (theta - 2.0 * block.to + block.before).powi(2);
        }
        block.before = block.to;
        block.to = theta;
        block.samples += 1;
        if block.samples <= BLOCK {
            return None;
        }
        let done = *block;
        // The last sample begins the next block.
        self.block = Block {
            samples: 1,
            from: theta,
            to: theta,
            ..Block::default()
        };
        self.take(&done);
        self.compare();
        self.apply()
    }

    /// Kalman filter: a block as one measurement.
    fn take(&mut self, block: &Block) {
        let n = f64::from(BLOCK);
        let time = n * self.sample_period;
        let keep = (-time / FADES_S).exp();
        self.mean *= keep;
        let prior = Matrix3::from_diagonal(&prior(self.torque_limit));
        self.covariance = self.covariance * (keep * keep) + prior * (1.0 - keep * keep);
        let spring = self.nominal[0] * block.error / n;
        let damper = self.nominal[1] * (block.to - block.from) / time;
        self.seek_lead(block.torque / n, [spring, damper], time);
        let [of_spring, of_damper] = self.noise(block);
        let beyond = |change: f64, variance: f64| change * change > BEYOND_NOISE.powi(2) * variance;
        if beyond(spring - self.held, 2.0 * of_spring) {
            self.held = spring;
        }
        let shown = if beyond(damper, of_damper) {
            damper
        } else {
            0.0
        };
        let by = Vector3::new(self.held, -shown, 1.0);
        let residual = block.torque / n - (spring - damper) - by.dot(&self.mean);
        let column = self.covariance * by;
        let variance =
            by.dot(&column) + (NOISE * self.torque_limit).powi(2) + of_spring + of_damper;
        let squared = residual * residual / variance;
        let most = OUTLIER * OUTLIER;
        self.surprise +=
            (time / CONSISTENCY_S).min(1.0) * (squared.min(2.0 * most) - self.surprise);
        if squared > most {
            return;
        }
        let gain = column / variance;
        self.mean += gain * residual;
        self.covariance -= gain * column.transpose();
        // Rounding must not make it lopsided.
        self.covariance = 0.5 * (self.covariance + self.covariance.transpose());
    }

    /// Variances, N^2·m^2, that the noise of the motor's angles gives the torques of spring and damper.
    fn noise(&mut self, block: &Block) -> [f64; 2] {
        let n = f64::from(BLOCK);
        let time = n * self.sample_period;
        // White noise of variance v: second differences of variance 6 v.
        let seen = block.bends / (n - 1.0) / 6.0;
        let known = self.angle_noise.unwrap_or(seen);
        let angle = known + (time / NOISE_MEAN_S).min(1.0) * (seen - known);
        self.angle_noise = Some(angle);
        let [stiffness, damping] = self.nominal;
        [
            stiffness.powi(2) * angle / n,
            (damping / time).powi(2) * 2.0 * angle,
        ]
    }

    /// Looks whether a lead, or motion, explains the motor's torque `made`, N·m, for `time`, s. In quick motion both
    /// are far greater than that torque, and show nothing of it.
    fn seek_lead(&mut self, made: f64, by_loop: [f64; 2], time: f64) {
        let without = made.abs() > WITHOUT_LEAD * self.torque_limit
            && by_loop.iter().all(|part| part.abs() < BY_LEAD * made.abs())
            && self.integral == 0.0;
        self.without_lead_s = if without {
            self.without_lead_s + time
        } else {
            0.0
        };
    }

    /// The drive makes torque without a lead: its velocity loop has an integral that is not configured.
    pub(super) fn integrates(&self) -> bool {
        self.without_lead_s > WITHOUT_LEAD_S
    }

    /// Model mismatch: whether no correction makes the shown drive of the configured one.
    fn compare(&mut self) {
        let time = f64::from(BLOCK) * self.sample_period;
        let beyond = |k: usize| self.mean[k].abs() - 3.0 * self.covariance[(k, k)].max(0.0).sqrt();
        let unlike = self.surprise >= INCONSISTENT || beyond(0) > MOST || beyond(1) > MOST;
        self.unlike_s = if unlike { self.unlike_s + time } else { 0.0 };
    }

    /// The drive's currents show another stiffness or damping than is corrected, or none.
    pub(super) fn is_unlike(&self) -> bool {
        self.unlike_s > UNLIKE_S
    }

    /// Leads what acts to what was found, or back where it is not believed.
    fn apply(&mut self) -> Option<DriveLoop> {
        let most = RATE * f64::from(BLOCK) * self.sample_period;
        let mut changed = false;
        for (applied, found) in self.applied.iter_mut().zip(self.mean.iter()) {
            let goal = if self.surprise < INCONSISTENT {
                found.clamp(-MOST, MOST)
            } else {
                0.0
            };
            let step = (goal - *applied).max(-most).min(most);
            if step.abs() > LEAST {
                *applied += step;
                changed = true;
            }
        }
        changed.then(|| DriveLoop::Position {
            stiffness: self.nominal[0] * (1.0 + self.applied[0]),
            damping: self.nominal[1] * (1.0 + self.applied[1]),
            dead_zone: self.dead_zone,
            integral: self.integral,
        })
    }

    /// Shares by which stiffness and damping are corrected.
    pub(super) fn applied(&self) -> [f64; 2] {
        self.applied
    }
}

/// Variances before anything is known.
fn prior(torque_limit: f64) -> Vector3<f64> {
    Vector3::new(PRIOR, PRIOR, OFFSET * torque_limit).map(|sigma| sigma * sigma)
}

#[cfg(test)]
mod tests {
    use super::*;
    use test_support::Random;

    const STIFFNESS: f64 = 28_900.0;
    const DAMPING: f64 = 189.0;

    fn fit() -> DriveFit {
        DriveFit::new(&LawParameters {
            drive: DriveLoop::Position {
                stiffness: STIFFNESS,
                damping: DAMPING,
                dead_zone: 1e-4,
                integral: 0.0,
            },
            torque_limit: 230.0,
            ..LawParameters::example()
        })
        .unwrap()
    }

    /// Seconds of a drive whose stiffness and damping are these shares of what is configured: 30 N·m and
    /// a swing of 11 N·m at 4 Hz, the motor moving with 0.08 rad/s to and fro. `current` of its torque.
    fn run(
        fit: &mut DriveFit,
        shares: [f64; 2],
        seconds: f64,
        current: impl Fn(usize, f64) -> f64,
    ) {
        for k in 0..(seconds * 1e3) as usize {
            let w = std::f64::consts::TAU;
            let t = k as f64 * 1e-3;
            let theta = 0.08 / w * (w * t).sin();
            let omega = 0.08 * (w * t).cos();
            let wanted = 30.0 + 11.0 * (4.0 * w * t).sin();
            let lead = (wanted + DAMPING * omega) / STIFFNESS + 1e-4;
            let made = shares[0] * STIFFNESS * (lead - 1e-4) - shares[1] * DAMPING * omega;
            let noise = 1.5 * (7.9 * k as f64).sin();
            let _ = fit.update(theta, current(k, made + noise), theta + lead);
        }
    }

    fn assert_near(fit: &DriveFit, shares: [f64; 2], within: f64) {
        for (applied, share) in fit.applied().iter().zip(shares) {
            assert!(
                (1.0 + applied - share).abs() < within,
                "{shares:?}: {fit:?}"
            );
        }
    }

    /// The fit bears an offset of the current of 1 % of the limit, too.
    #[test]
    fn stiffness_and_damping_are_found_within_two_seconds() {
        for stiffness in [0.8, 1.0, 1.2] {
            for damping in [0.8, 1.0, 1.2] {
                let mut fit = fit();
                fit.stagger(29);
                run(&mut fit, [stiffness, damping], 2.0, |_, torque| {
                    torque + 2.3
                });
                assert_near(&fit, [stiffness, damping], 0.04);
            }
        }
    }

    /// Corrections of at most three tenths act, however wrong the drive or its current is.
    #[test]
    fn what_acts_is_bounded() {
        for share in [0.0, 0.4, 2.0, -1.0] {
            let mut fit = fit();
            run(&mut fit, [share; 2], 20.0, |_, torque| torque);
            assert!(fit.applied().iter().all(|a| a.abs() <= MOST), "{fit:?}");
        }
    }

    /// A current that stands, is none, or swings at random after the drive was known.
    #[test]
    fn a_current_that_contradicts_leads_back_to_the_configured_drive() {
        let currents: [fn(usize, f64) -> f64; 3] = [
            |_, _| 70.0,
            |_, _| 0.0,
            |k, torque| torque + 60.0 * (0.01 * k as f64).sin(),
        ];
        for current in currents {
            let mut fit = fit();
            run(&mut fit, [0.85, 1.1], 3.0, |_, torque| torque);
            assert_near(&fit, [0.85, 1.1], 0.04);
            run(&mut fit, [0.85, 1.1], 0.3, current);
            // A moment of it changes little.
            assert_near(&fit, [0.85, 1.1], 0.08);
            run(&mut fit, [0.85, 1.1], 10.0, current);
            assert_near(&fit, [1.0, 1.0], 0.02);
            // The fit finds the configured drive again.
            run(&mut fit, [0.85, 1.1], 15.0, |_, torque| torque);
            assert_near(&fit, [0.85, 1.1], 0.04);
        }
    }

    /// Nothing follows from samples beyond the torque limit, from those that are no numbers, and from standstill.
    #[test]
    fn nothing_is_learned_from_limits_and_standstill() {
        for torque in [f64::NAN, f64::INFINITY, 231.0, -500.0] {
            let mut fit = fit();
            fit.stagger(19);
            run(&mut fit, [0.8, 0.8], 3.0, |_, _| torque);
            assert_eq!(fit.applied(), [0.0; 2]);
        }
        let mut fit = fit();
        for _ in 0..10_000 {
            assert_eq!(fit.update(0.4, 0.0, 0.4), None);
        }
        assert_eq!(fit.applied(), [0.0; 2]);
    }

    /// Five minutes at rest, an angle that flickers between counts of an encoder behind the gear's ratio, and a drive
    /// of this share of the configured stiffness: time until it is called unlike, s.
    fn at_rest(load: f64, count: f64, share: f64, seed: u64) -> (DriveFit, Option<f64>) {
        let mut fit = fit();
        let mut unlike = None;
        let mut random = Random::new(seed);
        for k in 0..300_000 {
            let theta = (0.37 + 0.3 * random.normal()).round() * count;
            let lead = load / STIFFNESS + 1e-4;
            let made = share * load + 0.3 * random.normal();
            // The drive's own encoder is a finer one: its angle is the mean of these.
            let _ = fit.update(theta, made, 0.331 * count + lead);
            if fit.is_unlike() && unlike.is_none() {
                unlike = Some(f64::from(k) * 1e-3);
            }
        }
        (fit, unlike)
    }

    /// Noise of an encoder is no motion without damping.
    #[test]
    fn a_drive_as_configured_is_not_unlike_at_rest() {
        for (seed, (load, count)) in [(30.0, 1.5e-5), (-80.0, 4e-6), (0.0, 6e-5)]
            .into_iter()
            .enumerate()
        {
            let (fit, unlike) = at_rest(load, count, 1.0, seed as u64);
            assert_eq!(unlike, None, "{load} N·m, {count} rad: {fit:?}");
            assert_near(&fit, [1.0, 1.0], 0.1);
        }
    }

    #[test]
    fn a_drive_twice_as_stiff_is_unlike_at_rest() {
        for load in [30.0, -30.0] {
            let (fit, unlike) = at_rest(load, 1.5e-5, 2.0, 5);
            assert!(unlike.is_some_and(|s| s < 5.0), "{unlike:?}: {fit:?}");
        }
    }

    /// The torque of a drive that is led changes by less than 1 % within a block.
    #[test]
    fn the_drive_is_led_slowly() {
        let mut fit = fit();
        let mut last = STIFFNESS;
        for k in 0..4000 {
            let lead = 1e-3 + 5e-4 * (0.02 * f64::from(k)).sin();
            let torque = 0.7 * STIFFNESS * (lead - 1e-4);
            if let Some(DriveLoop::Position { stiffness, .. }) = fit.update(0.0, torque, lead) {
                assert!((stiffness / last - 1.0).abs() < 0.01);
                last = stiffness;
            }
        }
        assert!((last / STIFFNESS - 0.7).abs() < 0.03, "{last}");
    }
}
