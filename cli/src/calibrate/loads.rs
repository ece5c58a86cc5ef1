//! Samples of loads from recorded runs: what F/T sensors or joints showed, beside the model.

use super::runs::RecordedRun;
use super::stretch::Stretch;
use crate::spool::Column;
use dynamics::{ImuMotion, Model};
use identification::load::Sample;
use identification::load::motion::{Cut, Moving, Source};
use identification::record::smooth;
use nalgebra::Vector3;
use problem::{Problem, listed};
use robot_config::{FilterGains, Robot, contact_names, whole_body_parameters};
use whole_body::{ContactKind, Hypothesis, MotionSource};

/// Window of the centred filters, s: loads change slowly, and accelerations are noisy.
const WINDOW_S: f64 = 0.1;
/// Time between samples that are used, s.
const STEP_S: f64 = 0.02;
/// Error of an F/T sensor's gain and of its cross-talk, share of the load: the class of usual sensors.
const GAIN: f64 = 0.005;

/// Wrench that passes a cut.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Reading {
    /// The wrench at an F/T sensor, by its index.
    Sensor(usize),
    /// The torque of a joint from encoders and current, by its index.
    Joint(usize),
}

/// Samples of all runs, in their order.
pub(super) struct Samples {
    pub(super) samples: Vec<Sample>,
    /// Time that they cover, s.
    pub(super) seconds: f64,
}

/// Loads beyond the cuts of a sample, and the load's pose.
pub(super) struct Cuts<'a> {
    pub(super) cuts: Vec<(Cut, Reading)>,
    /// The link whose inertia is in question.
    pub(super) carrier: usize,
    /// Runs in which it carries nothing.
    pub(super) empty: &'a [RecordedRun],
    /// Nothing touched what is beyond, whatever the contact sets say.
    pub(super) untouched: bool,
}

impl Cuts<'_> {
    /// Samples of runs of one robot, the empty ones last.
    ///
    /// # Errors
    /// Runs in which something may have touched what is beyond; no source of motion.
    pub(super) fn samples(&self, runs: &[RecordedRun]) -> Result<Samples, Problem> {
        let mut all = Samples {
            samples: Vec::new(),
            seconds: 0.0,
        };
        let mut touched = Vec::new();
        let first = runs.iter().flat_map(|run| &run.stretches).next();
        let tare = first.map_or(&[][..], |stretch| &stretch.offsets);
        let loaded = runs.iter().map(|run| (run, Some(self.carrier)));
        for (run, carrier) in loaded.chain(self.empty.iter().map(|run| (run, None))) {
            let (source, sets) = motion(&run.robot)?;
            let mut moving = Moving::new(&run.robot.model, source);
            for stretch in &run.stretches {
                let set = sets.get(stretch.contact_set);
                if !self.untouched && set.is_some_and(|set| self.touches(&run.robot.model, set)) {
                    let names = contact_names(&run.robot.parameters);
                    touched.extend(names.get(stretch.contact_set).map(|n| (*n).to_owned()));
                    continue;
                }
                self.of_stretch(run, (stretch, tare), &mut moving, carrier, &mut all)?;
            }
        }
        if all.samples.is_empty() {
            touched.sort();
            touched.dedup();
            let sets = listed(touched.iter().map(String::as_str));
            let reason = format!(
                "by the contact sets of the recordings ({sets}) something may have touched what is beyond"
            );
            let allowed =
                "a contact set in which it is untouched (torquectl contacts), or --untouched";
            return Err(Problem::new(reason, allowed));
        }
        Ok(all)
    }

    /// Whether a contact set has an unknown wrench beyond a cut.
    fn touches(&self, model: &Model, set: &Hypothesis) -> bool {
        let unknown = set
            .contacts
            .iter()
            .filter(|c| c.kind != ContactKind::Nothing);
        let mut links = unknown.filter_map(|c| model.frame_index(&c.link));
        links.any(|link| self.cuts.iter().any(|(cut, _)| cut.has_beyond(link)))
    }

    fn of_stretch(
        &self,
        run: &RecordedRun,
        (stretch, tare): (&Stretch, &[[f64; 6]]),
        moving: &mut Moving<'_>,
        carrier: Option<usize>,
        into: &mut Samples,
    ) -> Result<(), Problem> {
        let signals = &stretch.signals;
        let (count, period) = (signals.t.len(), signals.period);
        let half = (0.5 * WINDOW_S / period).round().max(2.0) as usize;
        let step = (STEP_S / period).round().max(1.0) as usize;
        if count <= 2 * half + step {
            return Ok(());
        }
        // Only what is used: all filtered signals of a long run are more than a memory holds.
        let instants = (half..count - half).step_by(step);
        let thinned = |signal: &[f64]| instants.clone().map(|i| signal[i]).collect::<Vec<_>>();
        let filtered = |signal: &Column, derivative| {
            Ok::<_, Problem>(thinned(&smooth(&signal.read()?, derivative, half, period)))
        };
        let n = run.robot.model.joint_count();
        let mut motion = [0, 1, 2].map(|_| vec![Vec::new(); n]);
        for (joint, angle) in run.robot.parameters.joints.iter().zip(&signals.angles) {
            for (derivative, of) in motion.iter_mut().enumerate() {
                of[joint.model_index] = filtered(angle, derivative)?;
            }
        }
        let imu = (signals.imu.as_ref()).map(|axes| {
            let values = axes.iter().map(|axis| filtered(axis, 0));
            let rates = axes[..3].iter().map(|axis| filtered(axis, 1));
            values.chain(rates).collect::<Result<Vec<_>, _>>()
        });
        let imu = imu.transpose()?;
        let readings = (self.cuts.iter()).map(|(_, reading)| match *reading {
            Reading::Sensor(s) => {
                let axes = signals.ft[s].iter();
                axes.map(|axis| filtered(axis, 0))
                    .collect::<Result<Vec<_>, _>>()
            }
            // Published torques are filtered already.
            Reading::Joint(j) => {
                let both = stretch.drives[j].torque.iter();
                both.map(|x| Ok(thinned(&x.read()?))).collect()
            }
        });
        let readings = readings.collect::<Result<Vec<_>, Problem>>()?;
        for i in 0..instants.len() {
            let at = |of: &Vec<Vec<f64>>| -> Vec<f64> {
                let joints = of.iter();
                joints.map(|x| x.get(i).copied().unwrap_or(0.0)).collect()
            };
            let three = |axes: &[Vec<f64>]| Vector3::new(axes[0][i], axes[1][i], axes[2][i]);
            let imu = imu.as_ref().map(|axes| ImuMotion {
                angular_velocity: three(&axes[..3]),
                angular_acceleration: three(&axes[6..]),
                proper_acceleration: three(&axes[3..6]),
            });
            let [q, dq, ddq] = motion.each_ref().map(at);
            moving.update(&q, &dq, &ddq, imu.as_ref());
            let mut sample = Sample {
                up: carrier.map_or_else(Vector3::zeros, |link| moving.up(link)),
                ..Sample::default()
            };
            for ((cut, reading), values) in self.cuts.iter().zip(&readings) {
                cut.predict(moving, carrier, &mut sample);
                match *reading {
                    // The published wrench is that which the part beyond applies to the part before.
                    Reading::Sensor(s) => {
                        let retared = |k: usize| stretch.offsets[s][k] - tare[s][k];
                        let axes = values.iter().enumerate();
                        sample
                            .measured
                            .extend(axes.map(|(k, x)| -x[i] - retared(k)));
                    }
                    Reading::Joint(_) => sample.measured.push(values[0][i]),
                }
                let modelled = sample.modelled.get(sample.common.len()..).unwrap_or(&[]);
                let errors: Vec<f64> = modelled
                    .iter()
                    .map(|x| match *reading {
                        Reading::Sensor(_) => GAIN * x,
                        Reading::Joint(_) => values[1][i].copysign(*x),
                    })
                    .collect();
                sample.common.extend(errors);
            }
            if sample.measured.iter().all(|x| x.is_finite()) {
                into.samples.push(sample);
                into.seconds += step as f64 * period;
            }
        }
        Ok(())
    }
}

/// A robot's motion as far as it is known, and its contact sets.
fn motion(robot: &Robot) -> Result<(Source, Vec<Hypothesis>), Problem> {
    let gains = FilterGains {
        sensor: [1.0; 2],
        sigma_ddq: vec![0.0; robot.parameters.joints.len()],
    };
    let known = whole_body_parameters(&robot.parameters, &robot.model, &gains);
    let known = known.ok_or_else(|| {
        let reason = "the robot's floating base has neither an IMU nor a stand";
        Problem::new(reason, "[imu], or [fixed_base]")
    })?;
    let frame = |link: &str| robot.model.frame_index(link).unwrap_or(0);
    let source = match &known.source {
        MotionSource::Fixed { link, gravity } => Source::Still {
            frame: frame(link),
            gravity: *gravity,
        },
        MotionSource::Imu(imu) => Source::Imu {
            frame: frame(&imu.frame.link),
        },
    };
    Ok((source, known.hypotheses))
}
