//! The demo's result: each joint's true torque against the three estimates of it: from encoders and
//! current, from F/T sensors and IMU, delay-compensated.

use std::fmt;
use std::path::Path;

use plant::{CanRobot, Truth};
use problem::Problem;
use robot_config::Robot;
use robot_state::{SharedRecord, TorqueEstimate, torque_flags};
use serde::Serialize;

use super::accuracy::{DelayedComparison, ErrorStatistics};
use super::plot::{self, Trace};
use crate::summary::{PageFaults, Summary, Timing};

/// Longest delay of an estimate that can be removed, cycles.
const LONGEST_DELAY: usize = 1000;
/// Columns of a curve of which the extremes are kept for the picture.
const COLUMNS: u64 = 500;

/// One joint's comparison.
#[derive(Debug, Clone, Serialize)]
pub(super) struct JointReport {
    /// The joint's name.
    pub(super) name: String,
    /// Unit of the joint's torques: N·m, or N of a prismatic joint.
    pub(super) unit: String,
    /// Largest |true torque|, N·m.
    pub(super) largest_torque: f64,
    /// Error of the torque from encoders and current; none if it was never valid.
    pub(super) encoder: Option<ErrorStatistics>,
    /// Error of the torque from F/T sensors and IMU; none if it was never valid.
    pub(super) whole_body: Option<ErrorStatistics>,
    /// Error of the delay-compensated torque; none if it was never valid.
    pub(super) delay_compensated: Option<ErrorStatistics>,
}

/// The result of a demo.
#[derive(Serialize)]
pub(super) struct Report {
    /// The joints, in config order.
    pub(super) joints: Vec<JointReport>,
    /// Timing, frames, events.
    #[serde(flatten)]
    pub(super) summary: Summary,
    /// Least and largest of the joints' known delays, which are removed before comparing, s: encoders, F/T,
    /// delay-compensated.
    pub(super) delays_s: [[f64; 2]; 3],
    /// Frames that the simulated robot could not decode.
    pub(super) frames_undecoded_by_robot: u64,
    #[serde(skip)]
    collected: Collected,
}

struct Collected {
    comparisons: Vec<[DelayedComparison; 3]>,
    traces: Vec<Trace>,
    timing: Timing,
    last: SharedRecord,
    every: u64,
    period: f64,
}

impl Report {
    pub(crate) fn new(robot: &Robot, cycles: u64) -> Self {
        let parameters = &robot.parameters;
        let units = parameters.joints.iter().map(|j| j.kind.units("N·m"));
        let names = parameters.joints.iter().map(|j| j.name.clone()).zip(units);
        let last = SharedRecord::default();
        let timing = Timing::new();
        Self {
            joints: names
                .clone()
                .map(|(name, unit)| JointReport {
                    name,
                    unit: unit.into_owned(),
                    largest_torque: 0.0,
                    encoder: None,
                    whole_body: None,
                    delay_compensated: None,
                })
                .collect(),
            summary: Summary::new(&parameters.name, &last, &timing, PageFaults::default(), 0),
            delays_s: [NO_DELAY; 3],
            frames_undecoded_by_robot: 0,
            collected: Collected {
                comparisons: names
                    .clone()
                    .map(|_| std::array::from_fn(|_| DelayedComparison::new(LONGEST_DELAY)))
                    .collect(),
                traces: names
                    .map(|(name, unit)| Trace {
                        name,
                        unit: unit.into_owned(),
                        ..Trace::default()
                    })
                    .collect(),
                timing,
                last,
                every: cycles.div_ceil(COLUMNS).max(1),
                period: parameters.timing.sample_period,
            },
        }
    }

    pub(crate) fn take(&mut self, record: &SharedRecord) {
        self.collected.timing.take(&record.timing);
        self.collected.last = *record;
    }

    /// Compares the last record with the truth at the instant of its samples.
    pub(crate) fn compare(&mut self, truth: &Truth) {
        let Collected {
            comparisons,
            traces,
            last,
            every,
            period,
            ..
        } = &mut self.collected;
        let (t, column) = (
            last.cycle.sequence as f64 * *period,
            last.cycle.sequence / *every,
        );
        let joints = last.cycle.estimated.joints.iter().zip(&truth.joints);
        for ((joint, truth), (comparison, trace)) in joints.zip(comparisons.iter_mut().zip(traces))
        {
            let estimates = [&joint.tau_encoder, &joint.tau_whole_body, &joint.tau_hat];
            // The compensated torque has no delay left.
            let delays = [joint.tau_encoder.delay_s, joint.tau_whole_body.delay_s, 0.0];
            for (comparison, (estimate, delay)) in
                (comparison.iter_mut()).zip(estimates.into_iter().zip(delays))
            {
                comparison.push(truth.tau, usable(estimate), delay / *period);
            }
            for (shown, (estimate, delay)) in
                (self.delays_s.iter_mut()).zip(estimates.into_iter().zip(delays))
            {
                if usable(estimate).is_some() {
                    *shown = [shown[0].min(delay), shown[1].max(delay)];
                }
            }
            trace.truth.push(column, (t, truth.tau));
            for (curve, estimate) in trace.estimates.iter_mut().zip(estimates) {
                let tau = usable(estimate).map_or(f64::NAN, |(tau, _)| tau);
                curve.push(column, (t, tau));
            }
        }
    }

    pub(crate) fn finish(&mut self, robot: &CanRobot) {
        let Collected {
            comparisons,
            timing,
            last,
            ..
        } = &self.collected;
        for (joint, [encoder, whole_body, compensated]) in self.joints.iter_mut().zip(comparisons) {
            joint.largest_torque = encoder.largest_truth();
            joint.encoder = encoder.statistics();
            joint.whole_body = whole_body.statistics();
            joint.delay_compensated = compensated.statistics();
        }
        let name = self.summary.robot.clone();
        self.summary = Summary::new(&name, last, timing, PageFaults::default(), 0);
        self.frames_undecoded_by_robot = robot.unknown_frames();
    }

    /// Draws the torques of some joints, by their places in config order, into a file.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub(super) fn draw(&self, path: &Path, joints: &[usize]) -> Result<(), Problem> {
        let title = format!("torqued demo, {}: joint torque", self.summary.robot);
        let traces: Vec<&Trace> = (joints.iter())
            .map(|&j| &self.collected.traces[j])
            .collect();
        plot::draw(path, &title, &traces)
    }
}

/// Of an estimate that was never there.
const NO_DELAY: [f64; 2] = [f64::INFINITY, f64::NEG_INFINITY];

/// Joints with and without a joint file differ: its estimators track the torsion by a prediction, without a
/// constant delay.
fn shown_delay([least, largest]: [f64; 2]) -> String {
    let ms = [least, largest].map(|s| format!("{:.1}", 1e3 * s));
    match ms {
        _ if least > largest => "-".to_owned(),
        [_, largest] if largest == "0.0" => "none (joint files)".to_owned(),
        [least, largest] if least == largest => format!("{largest} ms"),
        [least, largest] => format!("{least} to {largest} ms, by joint"),
    }
}

/// The torque and its sigma, if it is valid and not bridged.
fn usable(estimate: &TorqueEstimate) -> Option<(f64, f64)> {
    (estimate.flags & torque_flags::VALID != 0).then_some((estimate.tau, estimate.sigma))
}

/// Largest torque that is shown as zero, N·m or N.
const LEAST_SHOWN: f64 = 5e-4;

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{}: joint torque, N·m; errors against the simulated robot's true torque, after removing\n\
             the known delay: encoders + current {}, F/T + IMU {}, delay-compensated none;\n\
             % of the largest torque\n",
            self.summary.robot,
            shown_delay(self.delays_s[0]),
            shown_delay(self.delays_s[1])
        )?;
        writeln!(
            f,
            "{:22} {:>8}   {:>24}   {:>24}   {:>24}",
            "", "true", "encoders + current", "F/T + IMU", "delay-compensated"
        )?;
        writeln!(
            f,
            "{:22} {:>8}{}",
            "joint",
            "largest",
            format!("   {:>8} {:>7} {:>7}", "max", "RMS", "RMS %").repeat(3)
        )?;
        for joint in &self.joints {
            let name = match joint.unit.as_str() {
                "N·m" => joint.name.clone(),
                unit => format!("{} ({unit})", joint.name),
            };
            write!(f, "{name:22} {:>8.3}", joint.largest_torque)?;
            for error in [joint.encoder, joint.whole_body, joint.delay_compensated] {
                match error {
                    Some(error) => {
                        // Of a joint that carries nothing no share means anything.
                        let percent = if joint.largest_torque > LEAST_SHOWN {
                            format!("{:.2}%", 100.0 * error.rms / joint.largest_torque)
                        } else {
                            "-".to_owned()
                        };
                        write!(f, "   {:>8.3} {:>7.3} {percent:>7}", error.max, error.rms)?;
                    }
                    None => write!(f, "   {:>8} {:>7} {:>7}", "-", "-", "-")?,
                }
            }
            writeln!(f)?;
        }
        writeln!(f, "\n{}", self.summary)
    }
}
