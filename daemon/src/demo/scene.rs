//! Scene of the demo: a robot, its simulation, its motion; and the recording of it.

use std::cell::RefCell;
use std::io;
use std::path::Path;
use std::time::Instant;

use plant::parameters::HarnessParameters;
use plant::{CanRobot, SimParameters};
use problem::Problem;
use recording::{AttachedFile, Header, Start};
use robot_config::Robot;

use super::motion::MotionMode;
use super::{DemoOptions, Motion, robots};
use crate::bus::Bus;
use crate::control_loop::ControlLoop;
use crate::failure::Failure;
use crate::recorder::{self, Contents, Recorder, RecorderHandle, RecordingRequest};
use crate::run::unix_offset_ns;

/// A robot, simulated, with its motion.
pub(super) struct Scene {
    pub(super) robot: Robot,
    pub(super) plant: CanRobot,
    pub(super) motion: Motion,
    /// The configuration's files.
    pub(super) files: Vec<AttachedFile>,
}

/// The robot of the options' name or with that configuration, simulated, and its motion.
pub(super) fn load(options: &DemoOptions) -> Result<Scene, Failure> {
    let name = &options.robot;
    let own = Path::new(name).extension().is_some();
    if !own && !robots::NAMES.contains(&name.as_str()) {
        let allowed = format!("{}, or the path of a robot.toml", robots::NAMES.join(", "));
        let problem = Problem::new(format!("--robot: there is no robot {name:?}"), allowed);
        return Err(Failure::bad_input(problem));
    }
    if own && options.uncalibrated {
        let allowed = format!("with one of {}", robots::NAMES.join(", "));
        let problem = Problem::new("--uncalibrated: with the path of a configuration", allowed);
        return Err(Failure::bad_input(problem));
    }
    let (config, read): (String, fn(&str) -> io::Result<String>) = if own {
        (name.to_owned(), |path| terminal::read_text(path))
    } else {
        (
            robots::configuration(name, options.uncalibrated),
            robots::read,
        )
    };
    let beside = |file: &str| {
        Path::new(&config)
            .with_file_name(file)
            .to_string_lossy()
            .into_owned()
    };
    let refuse = |path: &str, e: io::Error| Failure::bad_input(Problem::unreadable(path, &e));
    let files = RefCell::new(Vec::new());
    let kept = |path: &str| {
        let text = read(path)?;
        let path = path.to_owned();
        let mut files = files.borrow_mut();
        if !files.iter().any(|file: &AttachedFile| file.path == path) {
            let text = text.clone();
            files.push(AttachedFile { path, text });
        }
        Ok(text)
    };
    let robot = robot_config::load(&config, &kept).map_err(Failure::bad_input)?;
    let path = beside("sim.toml");
    let text = read(&path).map_err(|e| refuse(&path, e))?;
    let mut sim = SimParameters::parse(&text, &path).map_err(Failure::bad_input)?;
    sim.seed = options.seed.unwrap_or(sim.seed);
    if let Some(link) = &options.harness {
        hang(&mut sim, link);
    }
    let urdf = sim.urdf_or(&robot.parameters.urdf_path);
    let urdf = read(urdf).map_err(|e| refuse(urdf, e))?;
    let plant = CanRobot::new(&robot, &urdf, &sim)
        .map_err(|problem| Failure::bad_input(problem.or_at(&path, 0)))?;
    let names = robot.parameters.joints.iter();
    let names: Vec<_> = names.map(|j| (j.name.clone(), j.kind)).collect();
    let path = match &options.motion {
        Some(path) => path.display().to_string(),
        None => beside("motion.toml"),
    };
    let text = match &options.motion {
        Some(path) => terminal::read_text(path),
        None => read(&path),
    };
    let motion = match text {
        Ok(text) => Motion::parse(&text, &path, &names).map_err(Failure::bad_input)?,
        Err(e) if e.kind() == io::ErrorKind::NotFound && options.motion.is_none() => {
            Motion::of_every_joint(&robot)
        }
        Err(e) => return Err(refuse(&path, e)),
    };
    if motion.mode == MotionMode::Stand {
        if let Some(problem) = robot.cannot_stand() {
            return Err(Failure::bad_input(problem.or_at(&path, 0)));
        }
        if options.harness.is_some() {
            let reason = "--harness: the motion is in mode \"stand\", which needs a floor";
            let allowed = "--motion with a file in mode \"inverse_dynamics\"";
            return Err(Failure::bad_input(
                Problem::new(reason, allowed).at(&path, 0),
            ));
        }
    }
    Ok(Scene {
        robot,
        plant,
        motion,
        files: files.into_inner(),
    })
}

/// A stiff harness instead of the floor.
fn hang(sim: &mut SimParameters, link: &str) {
    (sim.ground, sim.start.on_ground) = (None, false);
    sim.harness = Some(HarnessParameters {
        link: link.to_owned(),
        stiffness: 2e5,
        damping: 3e3,
        angular_stiffness: 2e4,
        angular_damping: 3e2,
        slack: 0.0,
        angular_slack: 0.0,
    });
}

/// The recorder of the demo's loop, on the demo's thread.
pub(super) struct Recording {
    recorder: Recorder,
    handle: RecorderHandle,
}

impl Recording {
    /// From the first cycle of this loop on.
    ///
    /// # Errors
    /// A file that is there already, or cannot be written.
    pub(super) fn begin<B: Bus>(
        robot: &Robot,
        files: Vec<AttachedFile>,
        path: &Path,
        control_loop: &mut ControlLoop<B>,
    ) -> Result<Self, Failure> {
        let start = Start {
            unix_offset_ns: unix_offset_ns(control_loop.bus().now_ns()),
            ..Start::default()
        };
        let ends = recorder::create(robot, Header::new(robot, files, start), None);
        control_loop.record_to(ends.tap);
        ends.handle.ask(RecordingRequest::Begin {
            path: path.to_path_buf(),
            seconds: None,
            last_s: 0.0,
            contents: Contents::default(),
            overwrite: false,
            unattended: true,
        });
        let mut this = Self {
            recorder: ends.recorder,
            handle: ends.handle,
        };
        this.poll();
        match this.handle.status_from_start().refused {
            Some(why) => Err(Failure::environment(why)),
            None => Ok(this),
        }
    }

    /// Takes the cycles so far.
    pub(super) fn poll(&mut self) {
        while self.recorder.poll(Instant::now()) {}
    }

    /// Writes what is left, once the loop is gone.
    ///
    /// # Errors
    /// A recording that is not whole.
    pub(super) fn end(mut self) -> Result<(), Failure> {
        while !self.recorder.is_over() {
            self.poll();
        }
        match self.handle.status_from_start().failed {
            Some(why) => Err(Failure::environment(why)),
            None => Ok(()),
        }
    }
}
