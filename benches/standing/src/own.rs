//! The humanoid on the project's own plant, with drawn joints.

use crate::stand::{Body, World, read};
use can_codec::Frames;
use plant::{CanRobot, SimParameters};
use robot_config::Robot;
use test_support::Random;

/// Numbers of the drives in the file of the simulation, and the range of the factor by which each is drawn to be another.
const DRAWN: [(&str, [f64; 2]); 4] = [
    ("coulomb_Nm = ", [0.5, 2.0]),
    ("presliding_rad = ", [0.5, 2.0]),
    ("K_4_A_per_rad = ", [0.9, 1.1]),
    ("K_5_As_per_rad = ", [0.9, 1.1]),
];

/// See the module.
pub(crate) struct Own {
    plant: CanRobot,
    sync: Frames,
    now: u64,
}

impl Own {
    /// The robot whose chest a force (N, world axes) pushes for 0.3 s from `start` (s) on.
    ///
    /// # Errors
    /// Files that cannot be read.
    pub(crate) fn new(
        robot: &Robot,
        seed: u64,
        force: [f64; 2],
        start: f64,
    ) -> Result<Self, String> {
        let path = "config/humanoid/sim.toml";
        let text = read(path).map_err(|e| format!("{path}: {e}"))?;
        let [x, y] = force;
        let push = format!(
            "\n[[push]]\nlink = \"chest_pitch_link\"\nstart_s = {start}\nduration_s = 0.3\n\
             force_N = [{x:.1}, {y:.1}, 0.0]\n"
        );
        let sim = SimParameters::parse(&(drawn(&text, seed) + &push), path);
        let sim = sim.map_err(|e| e.to_string())?;
        let urdf = read(&robot.parameters.urdf_path).map_err(|e| e.to_string())?;
        let plant = CanRobot::new(robot, &urdf, &sim).map_err(|e| e.to_string())?;
        let mut sync = Frames::default();
        for frame in &robot.sync {
            sync.push(*frame);
        }
        Ok(Self {
            plant,
            sync,
            now: 0,
        })
    }
}

/// A text of a simulation with other joints: every such number times a factor, of which each decade is as likely.
fn drawn(text: &str, seed: u64) -> String {
    let mut random = Random::new(seed);
    let line = |line: &str| {
        let number = DRAWN.iter().find_map(|(key, range)| {
            let rest = line.strip_prefix(key)?;
            let (number, comment) = rest.split_once(' ').unwrap_or((rest, ""));
            Some((key, range, number.parse::<f64>().ok()?, comment))
        });
        let Some((key, [least, most], number, comment)) = number else {
            return format!("{line}\n");
        };
        let factor = least * (most / least).powf(random.unit());
        format!("{key}{:?} {comment}\n", number * factor)
    };
    text.lines().map(line).collect()
}

impl World for Own {
    fn answer(&mut self, now: u64, rx: &mut Frames) -> Result<(), String> {
        self.now = now;
        self.plant.exchange(&self.sync, now, rx);
        Ok(())
    }

    fn take(&mut self, tx: &Frames) {
        self.plant.exchange(tx, self.now, &mut Frames::default());
    }

    fn body(&self) -> Body {
        let truth = self.plant.truth();
        let [_, _, _, x, y, z] = truth.base_velocity;
        Body {
            orientation: truth.base_orientation,
            turns: (x * x + y * y + z * z).sqrt(),
            height: truth.base_position[2],
        }
    }
}
