//! Recorded runs as what fits take: raw samples of every joint, and the signals that its torque follows
//! from.

use super::inspected;
use super::stretch::Stretch;
use crate::recorded;
use crate::reference::robot::{Payload, with_payloads};
use crate::reference::torques::Estimated;
use crate::spool::{Column, Spool};
use dynamics::Model;
use identification::drive::recorded::at_sync;
use problem::{Problem, Problems};
use recording::{CycleMessage, Ending, Header};
use robot_config::{FilterGains, Robot, Sampled, Sampling, whole_body_parameters};
use robot_state::{CycleRecord, DriveState, measured_flags};
use sha2::{Digest, Sha256};
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;
use std::sync::Arc;
use whole_body::WholeBodyParameters;

/// Standard deviation of the model's masses where the configuration says that there is none: its default.
const MODEL_SIGMA: f64 = 0.01;
/// Time after a change of the contact set, and before one, that is left out, s.
const CHANGE_S: f64 = 0.5;
/// Time without which a stretch is too short for filters, s.
const SHORTEST_S: f64 = 1.0;
/// A step longer than this many periods is a gap.
const GAP: f64 = 1.5;
/// Time after enabling within which brakes let go, s.
const BRAKES_S: f64 = 0.5;
/// Readings with one of these interrupt what torques are computed from.
const LOST: u32 = measured_flags::NEVER
    | measured_flags::STALE
    | measured_flags::IMPLAUSIBLE
    | measured_flags::STANDS_IN;

/// A recorded run.
pub(crate) struct RecordedRun {
    pub(crate) file: String,
    pub(crate) sha256: String,
    pub(crate) header: Header,
    pub(crate) robot: Robot,
    /// Remarks: how the file ended, what was left out.
    pub(crate) notes: Vec<String>,
    /// When it began.
    pub(crate) date: String,
    /// Duration of what is used, s.
    pub(crate) seconds: f64,
    pub(crate) stretches: Vec<Stretch>,
}

impl RecordedRun {
    /// Reads a run; `payloads` were on the robot meanwhile.
    ///
    /// # Errors
    /// A file that is none; a configuration that cannot be loaded; no stretch that is long enough.
    pub(crate) fn read(path: &Path, payloads: &[Payload]) -> Result<Self, Problems> {
        let file = path.display().to_string();
        let sha256 = hash(path).map_err(|e| Problem::unreadable(&file, &e))?;
        let mut run = recorded::open_with_inputs(path)?;
        let header = run.header().clone();
        let robot = robot(&header, payloads, None)?;
        let mut reader = Reader::new(&robot, &header)?;
        let ending = recorded::read_all(path, &mut run, |_, message| reader.take(message))?;
        let date = recorded::date(&header, reader.begin_ns.unwrap_or(0));
        let mut notes = Vec::new();
        if ending != Ending::Complete {
            let why = recorded::describe_ending(&ending);
            notes.push(why.trim_end().to_owned());
        }
        let (cycles, mut stretches) = reader.end(&file)?;
        for stretch in &mut stretches {
            inspected::mend(&robot, stretch, &mut notes)?;
        }
        let seconds: f64 = stretches.iter().map(Stretch::seconds).sum();
        if stretches.is_empty() {
            let reason = format!(
                "no {SHORTEST_S} s of its {cycles} cycles have all joints and sensors and one contact set"
            );
            let allowed = "a recording of a robot whose joints and sensors all answer";
            return Err(Problem::new(reason, allowed).at(file, 0).into());
        }
        let left_out = cycles as f64 * header.period_s - seconds;
        if left_out > SHORTEST_S {
            notes.push(format!(
                "{left_out:.1} s are left out: gaps, missing samples, changes of the contact set"
            ));
        }
        Ok(Self {
            file,
            sha256,
            header,
            robot,
            notes,
            date,
            seconds,
            stretches,
        })
    }
}

/// A robot with the contact set of a stretch.
pub(crate) struct InContact<'a> {
    pub(crate) robot: &'a Robot,
    pub(crate) contact_set: usize,
}

impl Estimated for InContact<'_> {
    fn model(&self) -> &Model {
        &self.robot.model
    }

    fn parameters(&self, gains: &FilterGains) -> Result<WholeBodyParameters, Problem> {
        let parameters = whole_body_parameters(&self.robot.parameters, &self.robot.model, gains);
        let mut parameters = parameters.ok_or_else(|| {
            let reason = "the robot's floating base has neither an IMU nor a stand";
            Problem::new(reason, "[imu], or [fixed_base]")
        })?;
        parameters.sigma_model = model_sigma(self.robot);
        Ok(parameters)
    }

    fn contact_set(&self) -> usize {
        self.contact_set
    }
}

/// Relative standard deviation of the model's masses.
pub(crate) fn model_sigma(robot: &Robot) -> f64 {
    match robot.parameters.whole_body.sigma_model {
        stated if stated > 0.0 => stated,
        _ => MODEL_SIGMA,
    }
}

/// The text of the URDF in a recording.
pub(crate) fn urdf<'a>(header: &'a Header, robot: &Robot) -> &'a str {
    header.text(&robot.parameters.urdf_path).unwrap_or("")
}

/// The robot of a recording, with payloads, by its own URDF or another one.
pub(crate) fn robot(
    header: &Header,
    payloads: &[Payload],
    urdf: Option<&str>,
) -> Result<Robot, Problems> {
    let Some(first) = header.files.first() else {
        let reason = "the recording has no configuration";
        return Err(Problem::new(reason, "a recording by torqued").into());
    };
    let read = |path: &str| {
        let text = header.text(path).map(str::to_owned);
        text.ok_or_else(|| io::Error::new(io::ErrorKind::NotFound, "not in the recording"))
    };
    let robot = robot_config::load(&first.path, &read)?;
    if payloads.is_empty() && urdf.is_none() {
        return Ok(robot);
    }
    let unknown = payloads
        .iter()
        .find(|p| robot.model.frame_index(p.link()).is_none());
    if let Some(payload) = unknown {
        let reason = format!("payload: no link \"{}\"", payload.link());
        return Err(Problem::new(reason, "a link of the URDF").into());
    }
    let own = robot.parameters.urdf_path.clone();
    robot_config::load(&first.path, &|path| {
        if path == own {
            let text = urdf.map_or_else(|| read(path), |text| Ok(text.to_owned()))?;
            Ok(with_payloads(&text, payloads))
        } else {
            read(path)
        }
    })
}

/// SHA-256 of a file, hexadecimal.
pub(crate) fn hash(path: &Path) -> io::Result<String> {
    let (mut file, mut digest) = (File::open(path)?, Sha256::new());
    let mut part = vec![0; 1 << 16];
    loop {
        let read = file.read(&mut part)?;
        if read == 0 {
            break;
        }
        digest.update(&part[..read]);
    }
    let bytes = digest.finalize();
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// Gathers stretches while a run is read.
struct Reader<'a> {
    robot: &'a Robot,
    spool: Arc<Spool>,
    period: f64,
    begin_ns: Option<u64>,
    cycles: u64,
    last_t: f64,
    stretches: Vec<Stretch>,
    /// Ages of the samples of joints, sensors, IMU in the present stretch, where they have some.
    ages: Vec<(Source, Sampling, Column)>,
    interrupted: bool,
    /// Cycles until each joint's current counts.
    off: Vec<u32>,
}

/// A source whose samples have an age.
#[derive(Clone, Copy)]
enum Source {
    Joint(usize),
    Ft(usize),
    Imu,
}

impl<'a> Reader<'a> {
    fn new(robot: &'a Robot, header: &Header) -> Result<Self, Problem> {
        let spool = Spool::new()?;
        let p = &robot.parameters;
        let joints = p.joints.iter().enumerate();
        let fts = p.ft_sensors.iter().enumerate();
        let sources = joints
            .map(|(j, joint)| (Source::Joint(j), joint.sampling))
            .chain(fts.map(|(s, ft)| (Source::Ft(s), ft.sampling)))
            .chain(p.imus.first().map(|imu| (Source::Imu, imu.sampling)));
        Ok(Self {
            robot,
            period: header.period_s,
            begin_ns: None,
            cycles: 0,
            last_t: 0.0,
            stretches: Vec::new(),
            ages: sources
                .filter(|(_, sampling)| !sampling.is_at_sync())
                .map(|(source, sampling)| (source, sampling, Column::new(&spool)))
                .collect(),
            interrupted: true,
            off: vec![0; p.joints.len()],
            spool,
        })
    }

    /// Follows whether the drives are on, and have been for as long as brakes take to let go.
    fn follow_drives(&mut self, record: &CycleRecord) {
        let powered = [DriveState::Enabled, DriveState::Stopping].map(DriveState::number);
        let letting_go = (BRAKES_S / self.period).ceil() as u32;
        let joints = self.robot.parameters.joints.iter();
        let commanded = joints.zip(&record.commanded.joints);
        for (left, (joint, commanded)) in self.off.iter_mut().zip(commanded) {
            let on = joint.drive_profile.is_none() || powered.contains(&commanded.drive_state);
            *left = if on {
                left.saturating_sub(1)
            } else {
                letting_go
            };
        }
    }

    fn take(&mut self, message: &CycleMessage) -> Result<(), Problem> {
        let record = &message.record.cycle;
        let begin_ns = *self.begin_ns.get_or_insert(message.at.sync.0);
        let t = recorded::ms_between(begin_ns, message.at.sync.0) * 1e-3;
        let step = t - std::mem::replace(&mut self.last_t, t);
        self.cycles += 1;
        self.follow_drives(record);
        if self.is_lost(record) {
            self.interrupted = true;
            return Ok(());
        }
        let contact_set = record.estimated.contact_set as usize;
        let same_tare = |s: &Stretch| {
            let mut offsets = s.offsets.iter().zip(&record.measured.ft);
            offsets.all(|(offset, ft)| *offset == ft.offset.to_array())
        };
        let goes_on = (self.stretches.last()).is_some_and(|s| {
            let gap = step >= GAP * self.period;
            !self.interrupted && !gap && s.contact_set == contact_set && same_tare(s)
        });
        if !goes_on {
            self.finish_stretch()?;
            let next = Stretch::new(&self.spool, self.robot, self.period, record);
            self.stretches.push(next);
            self.interrupted = false;
        }
        let Some(stretch) = self.stretches.last_mut() else {
            return Ok(());
        };
        stretch.push(t, record, &self.off)?;
        let since_sync = recorded::ms_between(message.at.sync.0, message.at.now.0) * 1e-3;
        for (source, sampling, ages) in &mut self.ages {
            let of_stamp = match source {
                Source::Joint(j) => record.measured.joints[*j].age_s,
                Source::Ft(s) => record.measured.ft[*s].age_s,
                Source::Imu => record.measured.imu.age_s,
            };
            ages.push(match sampling.sampled {
                Sampled::AtSync => sampling.latency,
                Sampled::WhenSent { .. } => of_stamp - since_sync + sampling.latency,
            })?;
        }
        Ok(())
    }

    /// A joint or a sensor has no reading that torques can be computed from.
    fn is_lost(&self, record: &CycleRecord) -> bool {
        let p = &self.robot.parameters;
        let joints = record.measured.joints.iter().take(p.joints.len());
        let sensors = record.measured.ft.iter().take(p.ft_sensors.len());
        let mut flags = joints.fold(0, |all, joint| all | joint.flags);
        flags |= sensors.fold(0, |all, sensor| all | sensor.flags);
        if !p.imus.is_empty() {
            flags |= record.measured.imu.flags;
        }
        flags & LOST != 0
    }

    /// Brings samples of an age to the instants of SYNC.
    fn finish_stretch(&mut self) -> Result<(), Problem> {
        let Some(stretch) = self.stretches.last_mut() else {
            return Ok(());
        };
        let (signals, drives) = (&mut stretch.signals, &mut stretch.drives);
        let t = match self.ages.is_empty() {
            true => Vec::new(),
            false => signals.t.read()?,
        };
        for (source, _, ages) in &mut self.ages {
            let ages = std::mem::replace(ages, Column::new(&self.spool)).read()?;
            let columns: Vec<&mut Column> = match *source {
                Source::Joint(j) => {
                    let drive = &mut drives[j];
                    vec![&mut signals.angles[j], &mut drive.theta, &mut drive.current]
                }
                Source::Ft(s) => signals.ft[s].iter_mut().collect(),
                Source::Imu => signals.imu.iter_mut().flatten().collect(),
            };
            for column in columns {
                column.change(|values| {
                    at_sync(&t, &ages, values);
                    Ok(())
                })?;
            }
        }
        Ok(())
    }

    fn end(mut self, file: &str) -> Result<(u64, Vec<Stretch>), Problem> {
        self.finish_stretch()?;
        let margin = (CHANGE_S / self.period) as usize;
        let shortest = SHORTEST_S / self.period;
        let sets = (self.stretches.iter()).any(|s| s.contact_set != self.stretches[0].contact_set);
        for stretch in &mut self.stretches {
            file.clone_into(&mut stretch.signals.file);
            if sets {
                stretch.cut(margin)?;
            }
        }
        self.stretches
            .retain(|stretch| stretch.signals.t.len() as f64 >= shortest);
        Ok((self.cycles, self.stretches))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_joint_is_not_fitted_to_while_its_drive_is_off_and_a_brake_may_carry_it() {
        let read = test_support::read_project_file;
        let robot = robot_config::load("config/leg/robot.toml", &read).unwrap();
        let header = Header::new(&robot, Vec::new(), recording::Start::default());
        let mut reader = Reader::new(&robot, &header).unwrap();
        let mut message = CycleMessage::default();
        for cycle in 0..3000u64 {
            message.at.sync.0 = cycle * 1_000_000;
            let state = match cycle {
                0..1000 => DriveState::SwitchedOn,
                _ => DriveState::Enabled,
            };
            for joint in &mut message.record.cycle.commanded.joints {
                joint.drive_state = state.number();
            }
            reader.take(&message).unwrap();
        }
        let (_, stretches) = reader.end("").unwrap();
        let [stretch] = &stretches[..] else {
            panic!("{} stretches", stretches.len())
        };
        for drive in &stretch.drives {
            let used = drive.used.read().unwrap();
            let first = used.iter().position(|used| *used == 1.0);
            assert_eq!(first, Some(1499), "half a second after enabling");
            assert!(used[1499..].iter().all(|used| *used == 1.0));
        }
    }
}
