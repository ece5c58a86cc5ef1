//! Channels that contradict one another: a reference that is late, drifts, saturates or is computed from
//! what it shall judge; a log that runs backwards.
//!
//! Every claim needs two things: that the log cannot be explained without it (by samples that count as
//! independent), and that it changes a torque by more than an ordinary joint's own effects do.

use super::LogKind;
use super::copies;
use super::probes::{BENT, DRIFT, Lag, Probed, Probes, SIGN, Side, TORQUE, Terms};
use super::signals::Signals;
use super::signs;
use inspection::{Defect, Finding, Severity};
use joint_file::JointFile;

/// Logarithm of likelihoods, and share of the torque's deviation, from which a lag is named and refused.
pub(super) const UNLIKELY: f64 = 8.0;
pub(super) const LATE_NAMED: f64 = 0.03;
pub(super) const LATE_REFUSED: f64 = 0.08;
/// Difference of two lags, as a share, up to which they are one.
const SAME_LAG: f64 = 0.3;
/// Ratio of two lags, either way, up to which one filter makes both.
const FILTERED: f64 = 2.5;
/// Smallest lag, s.
pub(super) const MIN_LAG_S: f64 = 0.003;
/// Standard deviations of coefficients.
pub(super) const SIGNIFICANT: f64 = 4.0;
/// Drift of the reference over a log, as a share of its deviation.
const DRIFT_NAMED: f64 = 0.1;
/// Slope of the current at the largest torque over that at none, less one, of a reference that saturates; and of the
/// torsion: gears stiffen under load (catalogues: up to twice), none softens.
const SATURATED: f64 = 0.6;
const SOFTENS: f64 = 0.2;
/// Friction below zero, as a share of the rated torque, of a log that runs backwards.
const BACKWARDS: f64 = 0.005;

/// Signs that change within a log, or are missing.
pub(super) fn signs(s: &Signals, joint: &JointFile, kind: LogKind) -> Vec<Finding> {
    let found = Probes::new(s, joint).map(|probes| signs::found(s, &probes, joint, kind));
    weighed(found.unwrap_or_default(), kind)
}

/// Other contradictions of a log.
pub(super) fn check(s: &Signals, joint: &JointFile, kind: LogKind) -> Vec<Finding> {
    weighed(contradictions(s, joint, kind), kind)
}

/// Findings by what a log is used for: an estimate is wrong by a wrong current, not by the reference that it is compared
/// with.
fn weighed(mut found: Vec<Finding>, kind: LogKind) -> Vec<Finding> {
    let compared = |f: &&mut Finding| kind == LogKind::Run && f.channel != kind.name("i");
    found
        .iter_mut()
        .filter(compared)
        .for_each(|f| f.severity = f.severity.min(Severity::Warning));
    found
}

fn contradictions(s: &Signals, joint: &JointFile, kind: LogKind) -> Vec<Finding> {
    let Some(probes) = Probes::new(s, joint) else {
        return Vec::new();
    };
    let judge = Judge {
        s,
        probes,
        joint,
        kind,
    };
    let copied = copies::found(s, &judge.probes, joint, kind);
    if !copied.is_empty() {
        return copied;
    }
    let mut found: Vec<Finding> = judge.backwards().into_iter().collect();
    found.extend(judge.lag());
    found.extend(judge.bends());
    found.extend(judge.drift());
    found
}

struct Judge<'a> {
    s: &'a Signals,
    probes: Probes,
    joint: &'a JointFile,
    kind: LogKind,
}

/// A coefficient and its value over its standard deviation, by independent samples.
fn coefficient(probed: &Probed, place: usize) -> (f64, f64) {
    let independent = Probes::independent(&probed.residual).max(1.0);
    let sigma = probed.fit.sigma[place] * (probed.residual.len() as f64 / independent).sqrt();
    (probed.fit.x[place], probed.fit.x[place] / sigma.max(1e-300))
}

impl Judge<'_> {
    fn finding(
        &self,
        defect: Defect,
        severity: Severity,
        channel: &str,
        text: String,
        cure: &str,
    ) -> Finding {
        Finding {
            defect,
            severity,
            channel: channel.to_owned(),
            row: None,
            t: self.s.t[0],
            rows: self.s.t.len(),
            text,
            cure: cure.to_owned(),
        }
    }

    fn lag(&self) -> Option<Finding> {
        let [torsion, current] = [Side::Torsion, Side::Current].map(|side| self.probes.lag(side));
        let claims = |lag: &Lag| {
            lag.unlikely_without > UNLIKELY
                && lag.late.abs() > MIN_LAG_S
                && self.probes.effect(lag.late) > LATE_NAMED
        };
        // The gear's hysteresis makes a small lag of its own: the current has to show one, too.
        let by_current = current.filter(claims)?;
        let agrees = |by_torsion: &Lag| {
            let (low, high) = by_torsion.interval;
            let margin = SAME_LAG * by_current.late.abs() + MIN_LAG_S;
            let (least, most) = by_current.interval;
            low - margin < most && least < high + margin && by_torsion.late * by_current.late > 0.0
        };
        // A filter is no delay: each side has a best time of its own then.
        let alike = |by_torsion: &Lag| {
            by_torsion.unlikely_without > UNLIKELY
                && (1.0 / FILTERED..FILTERED).contains(&(by_torsion.late / by_current.late))
        };
        let by_both = torsion.filter(|lag| agrees(lag) || alike(lag));
        let (name, against, late, (low, high)) = match by_both {
            Some(lag) => (
                "tau_sensor",
                "both encoders and current",
                lag.late,
                lag.interval,
            ),
            None => {
                let (low, high) = by_current.interval;
                ("i", "torque and encoders", -by_current.late, (-high, -low))
            }
        };
        let name = self.kind.name(name);
        let way = if late > 0.0 { "late" } else { "early" };
        let [late, low, high] = [late, low, high].map(|x| 1e3 * x);
        let effect = self.probes.effect(1e-3 * late);
        let text = format!(
            "{name} is {way} by {:.0} ms ({:.0} to {:.0}) against {against}, or filtered: {:.0} % of the torque",
            late.abs(),
            low.abs().min(high.abs()),
            low.abs().max(high.abs()),
            100.0 * effect
        );
        // What the current alone shows may be a friction that no model here has.
        let severity = if by_both.is_some() && effect > LATE_REFUSED {
            Severity::Refused
        } else {
            Severity::Warning
        };
        let cure =
            "channels of one instant; `delay_ms` in the map of `torquectl import` shifts one";
        Some(self.finding(Defect::Late, severity, name, text, cure))
    }

    /// Friction that drives: only a log that runs backwards has it.
    fn backwards(&self) -> Option<Finding> {
        let probed = self.probes.probe(Side::Current, 0.0, Terms::default())?;
        let (gain, significance) = coefficient(&probed, TORQUE);
        let (friction, certain) = coefficient(&probed, SIGN);
        let (compliance, _) = coefficient(
            &self.probes.probe(Side::Torsion, 0.0, Terms::default())?,
            TORQUE,
        );
        let drives = compliance > 0.0
            && friction < -BACKWARDS * self.joint.joint.rated_torque
            && certain < -SIGNIFICANT;
        (gain > 0.0 && significance > SIGNIFICANT && drives).then(|| {
            let text = format!(
                "friction drives the joint ({friction:.3} N·m): the log runs backwards in time"
            );
            self.finding(
                Defect::Reversed,
                Severity::Refused,
                "t",
                text,
                "rows in the order of time",
            )
        })
    }

    /// A reference that grows less than torsion and current where it is large.
    fn bends(&self) -> Option<Finding> {
        let terms = Terms {
            bent: true,
            drift: true,
            lasting: false,
        };
        let bend = |side| {
            let probed = self.probes.probe(side, 0.0, terms)?;
            let ((slope, _), (bent, certain)) =
                (coefficient(&probed, TORQUE), coefficient(&probed, BENT));
            Some((3.0 * bent / slope.abs().max(1e-12), certain))
        };
        let ((torsion, by_torsion), (current, by_current)) =
            (bend(Side::Torsion)?, bend(Side::Current)?);
        if current < SATURATED || by_current < SIGNIFICANT {
            return None;
        }
        let name = self.kind.name("tau_sensor");
        let at = format!("at {:.1} N·m", self.probes.size());
        let as_fast = format!("{:.1} times as fast with it as near zero", 1.0 + current);
        let cure = "torques within the sensor's range";
        if torsion > SOFTENS && by_torsion > SIGNIFICANT {
            let torsion = 1.0 + torsion;
            let text = format!(
                "{name} saturates: {at} the torsion grows {torsion:.1} times, the current {as_fast}"
            );
            return Some(self.finding(Defect::Saturated, Severity::Refused, name, text, cure));
        }
        // A gear that stiffens hides what the torsion would show.
        let i = self.kind.name("i");
        let text = format!("{name} saturates, or the motor does: {at} {i} grows {as_fast}");
        Some(self.finding(Defect::Saturated, Severity::Warning, name, text, cure))
    }

    /// A zero that torsion and current see change alike.
    fn drift(&self) -> Option<Finding> {
        let terms = Terms {
            bent: false,
            drift: true,
            lasting: false,
        };
        let drift = |side| {
            let probed = self.probes.probe(side, 0.0, terms)?;
            let ((slope, _), (line, certain)) =
                (coefficient(&probed, TORQUE), coefficient(&probed, DRIFT));
            Some((-2.0 * line / slope, certain.abs()))
        };
        let (torsion, current) = (drift(Side::Torsion)?, drift(Side::Current)?);
        let whole = self.probes.deviation();
        let alike = torsion.0 * current.0 > 0.0 && (0.4..2.5).contains(&(torsion.0 / current.0));
        // Each side shows it, and both together as certainly as one alone would have to.
        let certain = torsion.1.min(current.1) > 0.5 * SIGNIFICANT
            && torsion.1.hypot(current.1) > SIGNIFICANT * 2f64.sqrt();
        let size = 0.5 * (torsion.0 + current.0);
        (alike && certain && size.abs() > DRIFT_NAMED * whole).then(|| {
            let name = self.kind.name("tau_sensor");
            let text = format!(
                "{name} drifts by {size:.2} N·m over the log, by torsion and current alike: {:.0} % of its deviation",
                100.0 * size.abs() / whole
            );
            self.finding(Defect::Drifts, Severity::Refused, name, text, "a reference whose zero stays, or shorter logs, each with a zero of its own")
        })
    }
}
