//! A tare under way.

use std::time::{Duration, Instant};

use dynamics::{ImuMotion, Model};
use jiff::Timestamp;
use problem::Problem;
use robot_config::{FilterGains, Parameters, contact_names, whole_body_parameters};
use robot_state::{Settings, SharedRecord, Wrench};
use whole_body::{Tare, TareError, WholeBodyInput};

use super::fitness;
use crate::offsets::{Offsets, SensorOffset};

/// Records of a robot at rest, averaged as they come.
pub(super) struct TareJob {
    parameters: Parameters,
    tare: Tare,
    contacts: String,
    /// Offset of each reading while nothing changes: configuration and last tare.
    offsets: Vec<[f64; 6]>,
    time_limit: Duration,
    since: Instant,
    seen: usize,
    q: Vec<f64>,
    dq: Vec<f64>,
    still: Vec<f64>,
    ft: Vec<Wrench>,
}

impl TareJob {
    pub(super) fn new(
        parameters: &Parameters,
        model: &Model,
        contacts: usize,
        settings: &Settings,
        now: Instant,
    ) -> Result<Self, Problem> {
        // Unfiltered samples.
        let gains = FilterGains {
            sensor: [1.0; 2],
            sigma_ddq: vec![0.0; parameters.joints.len()],
        };
        let whole_body = whole_body_parameters(parameters, model, &gains);
        let mut whole_body =
            whole_body.ok_or_else(|| Problem::new("a floating base needs an IMU", ""))?;
        whole_body.hypotheses = vec![whole_body.hypotheses.swap_remove(contacts)];
        let tare = Tare::new(model, &whole_body, parameters.tare.clone()).map_err(refusal)?;
        let configured = parameters
            .ft_sensors
            .iter()
            .map(|ft| ft.conditioning.offset);
        let sums = configured.zip(settings.ft_offset.iter().map(Wrench::to_array));
        let seconds = parameters.tare.samples as f64 * parameters.timing.sample_period;
        Ok(Self {
            tare,
            contacts: contact_names(parameters)[contacts].to_owned(),
            offsets: sums
                .map(|(c, t)| std::array::from_fn(|k| c[k] + t[k]))
                .collect(),
            time_limit: Duration::from_secs_f64(2.0 * seconds + 1.0),
            since: now,
            seen: 0,
            q: vec![0.0; parameters.joints.len()],
            dq: vec![0.0; parameters.joints.len()],
            still: vec![0.0; parameters.joints.len()],
            ft: vec![Wrench::default(); parameters.ft_sensors.len()],
            parameters: parameters.clone(),
        })
    }

    /// Takes a record.
    pub(super) fn observe(&mut self, record: &SharedRecord) -> Result<(), Problem> {
        if self.complete() {
            return Ok(());
        }
        fitness::judge(&self.parameters, record)?;
        self.seen += 1;
        if !fitness::whole(&self.parameters, record) {
            return Ok(());
        }
        let measured = &record.cycle.measured;
        let angles = self.q.iter_mut().zip(&mut self.dq);
        for ((q, dq), joint) in angles.zip(&measured.joints) {
            (*q, *dq) = (joint.q_hat, joint.dq_hat);
        }
        for ((ft, sensor), offset) in self.ft.iter_mut().zip(&measured.ft).zip(&self.offsets) {
            // An earlier change may still be settling: its final offset counts.
            let (reading, subtracted) = (sensor.wrench.to_array(), sensor.offset.to_array());
            *ft = Wrench::from_array(std::array::from_fn(|k| {
                reading[k] + subtracted[k] - offset[k]
            }));
        }
        let input = WholeBodyInput {
            q: &self.q,
            dq: &self.dq,
            ddq: &self.still,
            ft: &self.ft,
            imu: ImuMotion {
                angular_velocity: measured.imu.gyro.into(),
                angular_acceleration: [0.0; 3].into(),
                proper_acceleration: measured.imu.accelerometer.into(),
            },
        };
        self.tare.add(&input).map_err(refusal)
    }

    pub(super) fn complete(&self) -> bool {
        self.tare.samples() >= self.parameters.tare.samples
    }

    pub(super) fn progress(&self) -> f64 {
        self.tare.samples() as f64 / self.parameters.tare.samples.max(1) as f64
    }

    /// The refusal of a tare that does not complete in time.
    pub(super) fn too_slow(&self, now: Instant) -> Option<Problem> {
        let late = now.duration_since(self.since) > self.time_limit;
        late.then(|| {
            let reason = format!(
                "within {:?} only {} of {} records arrived in which every joint and sensor had \
                 answered, of {} in all; look at `torquectl watch` for missed samples",
                self.time_limit,
                self.tare.samples(),
                self.parameters.tare.samples,
                self.seen
            );
            Problem::new(reason, "")
        })
    }

    /// The new offsets: the last ones with the tare's corrections.
    pub(super) fn finish(&self, last: &[[f64; 6]], now: Timestamp) -> Result<Offsets, Problem> {
        let results = self.tare.finish().map_err(refusal)?;
        if results.len() != self.offsets.len() {
            let reason = "no offsets follow from the model: is a mass or an inertia wrong?";
            return Err(Problem::new(reason, ""));
        }
        let sensors = results.iter().zip(last);
        let sensors = sensors.map(|(result, last)| SensorOffset {
            name: result.sensor.clone(),
            offset: std::array::from_fn(|k| last[k] + result.correction[k]),
            sigma: result.sigma,
            known: result.known,
        });
        // Whole seconds: no year that a clock can show is out of range.
        let date = Timestamp::from_second(now.as_second()).unwrap_or(now);
        Ok(Offsets {
            date,
            contacts: self.contacts.clone(),
            sensors: sensors.collect(),
        })
    }
}

fn refusal(error: TareError) -> Problem {
    error.problem()
}
