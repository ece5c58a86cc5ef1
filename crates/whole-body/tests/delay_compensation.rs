//! The torque now, from made-up signals whose truth is known.

use estimators::filter_bank::FilterBank;
use estimators::matched_filter::MatchedFilterParameters;
use robot_state::{TorqueEstimate, torque_flags};
use std::f64::consts::TAU;
use test_support::Random;
use whole_body::{DelayCompensator, DelayCompensatorParameters, DelayedTorque};

const PERIOD: f64 = 1e-3;
const WINDOW: usize = 16;
const LIMIT: f64 = 100.0;

/// A joint with both sources: encoders of a certain gain and noise that drift; F/T sensors of a
/// certain noise, filtered.
struct Joint {
    compensator: DelayCompensator,
    filter: FilterBank,
    random: Random,
    fast: [f64; 2],
    delayed: f64,
    sigma: f64,
    /// Time in motion, s: encoders drift by it.
    time: f64,
}

impl Joint {
    fn new(gain: f64, fast_noise: f64, late_noise: f64) -> Self {
        Self::knowing(1.0, gain, fast_noise, late_noise)
    }

    /// The same with a gain that is known before any change has shown it.
    fn knowing(known: f64, gain: f64, fast_noise: f64, late_noise: f64) -> Self {
        let p = MatchedFilterParameters {
            window: WINDOW,
            derivatives: 1,
            sample_period: PERIOD,
        };
        let filter = FilterBank::new(1, p).unwrap();
        Self {
            compensator: DelayCompensator::new(DelayCompensatorParameters {
                sample_period: PERIOD,
                kernel: filter.kernel(),
                fast_sigma: 0.7 * fast_noise,
                torque_limit: LIMIT,
                stands_within: 0.0087,
                gain: known,
                error_per_angle: 600.0,
            }),
            sigma: late_noise * filter.noise_gain(0),
            filter,
            random: Random::new(7),
            fast: [gain, fast_noise],
            delayed: late_noise,
            time: 0.0,
        }
    }

    fn sources(&mut self, truth: f64) -> (f64, DelayedTorque) {
        let [gain, noise] = self.fast;
        let drift = 3.0 + 2.0 * (TAU * 0.3 * self.time).sin();
        let fast = gain * truth + drift + noise * self.random.normal();
        self.filter
            .update(&[truth + self.delayed * self.random.normal()]);
        let tau = self.filter.values()[0];
        let sigma = self.sigma;
        (fast, DelayedTorque { tau, sigma })
    }

    fn advance(&mut self, truth: f64) -> TorqueEstimate {
        let (fast, delayed) = self.sources(truth);
        self.compensator.update(Some(fast), Some(delayed))
    }

    fn moving(&mut self, truth: f64) -> (f64, DelayedTorque) {
        self.time += PERIOD;
        self.sources(truth)
    }

    fn rest(&mut self, truth: f64, seconds: f64) -> TorqueEstimate {
        let cycles = (seconds / PERIOD) as usize;
        (0..cycles).fold(TorqueEstimate::default(), |_, _| self.advance(truth))
    }
}

fn rms(x: &[f64]) -> f64 {
    (x.iter().map(|x| x * x).sum::<f64>() / x.len() as f64).sqrt()
}

/// Slow and fast swings; times in s.
fn swing(t: f64) -> f64 {
    20.0 * (TAU * 0.7 * t).sin() + 3.0 * (TAU * 9.0 * t).sin() + 1.5 * (TAU * 21.0 * t).cos()
}

/// Root mean squares of the errors of the estimate and of the delayed torque, and of the former over
/// the estimated standard deviation; in the last of several seconds of swinging.
fn swinging(mut joint: Joint) -> (f64, f64, f64, Joint) {
    joint.rest(swing(0.0), 1.0);
    let (mut errors, mut delayed, mut normed) = (Vec::new(), Vec::new(), Vec::new());
    for k in 0..8000 {
        let truth = swing(PERIOD * f64::from(k));
        let (fast, late_now) = joint.moving(truth);
        let e = joint.compensator.update(Some(fast), Some(late_now));
        assert!(e.flags == torque_flags::VALID && e.sigma > 0.0);
        if k > 3000 {
            errors.push(e.tau - truth);
            delayed.push(joint.filter.values()[0] - truth);
            normed.push((e.tau - truth) / e.sigma);
        }
    }
    (rms(&errors), rms(&delayed), rms(&normed), joint)
}

#[test]
fn encoders_that_show_too_little_are_scaled() {
    let (now, delayed, normed, joint) = swinging(Joint::new(0.75, 0.1, 0.1));
    let gain = joint.compensator.gain();
    assert!((gain * 0.75 - 1.0).abs() < 0.05, "{gain}");
    assert!(now < 0.3 && now < 0.2 * delayed, "{now} after {delayed}");
    assert!((0.5..2.0).contains(&normed), "{normed}");
}

#[test]
fn what_a_filter_holds_back_reaches_the_torque_that_is_fed_back_at_once() {
    let (_, _, _, mut joint) = swinging(Joint::new(0.75, 0.1, 0.1));
    let c = &joint.compensator;
    let more = c.levelled(0.3).unwrap() - c.levelled(0.0).unwrap();
    assert!((more - 0.3 * c.gain()).abs() < 1e-12, "{more}");
    // Both sources at one instant.
    assert!(c.difference().is_some());
    let _ = joint.compensator.update(Some(1.0), None);
    assert_eq!(joint.compensator.difference(), None);
}

/// The first change of a joint that has rested: where the gain is known, the torque for feedback shows all of
/// it at once; where it is not, what the encoders show of it.
#[test]
fn a_known_gain_counts_from_the_first_change() {
    let first = |known: f64| {
        let mut joint = Joint::knowing(known, 0.8, 0.02, 0.02);
        joint.rest(10.0, 4.0);
        assert!((joint.compensator.gain() - known).abs() < 0.1 * known);
        let before = joint.compensator.levelled(0.0).unwrap();
        joint.advance(30.0);
        joint.compensator.levelled(0.0).unwrap() - before
    };
    let (known, unknown) = (first(1.0 / 0.8), first(1.0));
    assert!((known - 20.0).abs() < 0.6, "{known}");
    assert!((unknown - 16.0).abs() < 0.6, "{unknown}");
    // A wrong one is corrected by what changes show.
    let (_, _, _, joint) = swinging(Joint::knowing(0.6, 0.75, 0.1, 0.1));
    let gain = joint.compensator.gain();
    assert!((gain * 0.75 - 1.0).abs() < 0.05, "{gain}");
}

#[test]
fn noisy_encoders_are_not_believed() {
    let (now, delayed, normed, joint) = swinging(Joint::new(1.0, 8.0, 0.1));
    let gain = joint.compensator.gain();
    assert!(gain < 0.75, "{gain}");
    // Samples averaged over 3 ms would have noise of 4.6 N·m.
    assert!(now < 2.0 * delayed && now < 2.8, "{now} after {delayed}");
    assert!((0.3..2.5).contains(&normed), "{normed}");
}

#[test]
fn rest_is_quieter_than_both_sources() {
    let mut joint = Joint::new(0.8, 1.0, 0.3);
    joint.rest(10.0, 3.0);
    let errors: Vec<f64> = (0..2000).map(|_| joint.advance(10.0).tau - 10.0).collect();
    // White noise through 80 samples would be 0.3/sqrt(80).
    let limit = 0.3 / 80f64.sqrt();
    assert!(rms(&errors) < 1.1 * limit, "{} of {limit}", rms(&errors));
}

#[test]
fn a_step_is_seen_at_once() {
    let mut joint = Joint::new(1.0, 0.1, 0.1);
    joint.rest(0.0, 2.0);
    let estimates: Vec<f64> = (0..60).map(|_| joint.advance(20.0).tau).collect();
    // Three samples are averaged; the delayed torque needs fifteen.
    assert!((estimates[2] - 20.0).abs() < 1.0, "{estimates:?}");
    assert!(
        estimates.iter().skip(2).all(|t| (t - 20.0).abs() < 2.5),
        "{estimates:?}"
    );
    let delay = joint.compensator.update(None, None).delay_s;
    assert!(delay < 2e-3, "{delay}");
}

#[test]
fn a_slow_ramp_is_followed_by_weak_encoders_too() {
    let mut joint = Joint::new(1.0, 5.0, 0.1);
    joint.rest(0.0, 2.0);
    for k in 0..3000 {
        let truth = 5.0 * PERIOD * f64::from(k);
        let tau = joint.advance(truth).tau;
        // Change of the ramp in the averaging time of a joint at rest.
        assert!((tau - truth).abs() < 1.0, "{tau} at {truth}");
    }
}

#[test]
fn lost_samples_do_not_step_the_torque() {
    let mut joint = Joint::new(1.0, 0.1, 0.05);
    let mut last = joint.rest(0.0, 1.0).tau;
    for k in 0..4000 {
        let truth = 10.0 * (TAU * 0.5 * PERIOD * f64::from(k)).sin();
        let (fast, delayed) = joint.moving(truth);
        // Single losses, then a second without encoders, then encoders that have slipped.
        let lost = k % 50 == 7 || (1000..2000).contains(&k);
        let slipped = if k >= 2000 { fast - 30.0 } else { fast };
        let delayed = (k % 70 != 8).then_some(delayed);
        let e = joint
            .compensator
            .update((!lost).then_some(slipped), delayed);
        let complete = !lost && delayed.is_some();
        assert_eq!(e.flags & torque_flags::DEGRADED == 0, complete);
        assert!(e.flags & torque_flags::VALID != 0);
        assert!(
            (e.tau - last).abs() < 0.5,
            "from {last} to {} at {k}",
            e.tau
        );
        assert!((e.tau - truth).abs() < 0.7, "{} for {truth} at {k}", e.tau);
        last = e.tau;
    }
}

#[test]
fn without_the_delayed_torque_changes_go_on_and_sigma_grows() {
    let mut joint = Joint::new(1.0, 0.1, 0.1);
    joint.rest(5.0, 2.0);
    let before = joint.compensator.update(None, None).sigma;
    let mut last = TorqueEstimate::default();
    for k in 0..300 {
        let truth = 5.0 + 0.05 * f64::from(k);
        let (fast, _) = joint.sources(truth);
        last = joint.compensator.update(Some(fast), None);
        assert!((last.tau - truth).abs() < 1.5, "{} for {truth}", last.tau);
    }
    assert!(last.sigma > 1.5 * before, "{} after {before}", last.sigma);
    let nan = DelayedTorque {
        tau: f64::NAN,
        sigma: 1.0,
    };
    let e = joint.compensator.update(Some(f64::INFINITY), Some(nan));
    assert!(e.tau.is_finite() && e.flags & torque_flags::DEGRADED != 0);
}

#[test]
fn nothing_is_valid_before_the_delayed_torque_and_limits_hold() {
    let mut joint = Joint::new(1.0, 0.1, 0.1);
    for _ in 0..10 {
        let (fast, _) = joint.sources(3.0);
        let e = joint.compensator.update(Some(fast), None);
        assert_eq!(e, TorqueEstimate::default());
    }
    let e = joint.advance(3.0);
    assert!(e.flags & torque_flags::VALID != 0);
    let e = joint.rest(LIMIT + 5.0, 0.5);
    assert_eq!(e.tau, LIMIT);
    assert!(e.flags & torque_flags::SATURATED != 0);
    joint.compensator.reset();
    let e = joint.compensator.update(Some(1.0), None);
    assert_eq!(e, TorqueEstimate::default());
}
