//! The joints on the bench: data sheet and simulated drive.

use joint_file::{JointFile, no_files};
use plant::parameters::DriveParameters;
use plant::random::Random;
use plant::{RigLoad, SimParameters};

/// Largest relative deviation of a redrawn parameter from the nominal joint's.
const SPREAD: f64 = 0.3;

/// A kind of joint.
#[derive(Debug, Clone)]
pub struct BenchJoint {
    /// Data sheet: JOINT.toml with nothing but `[joint]`.
    pub file: JointFile,
    /// Simulated drive.
    pub drive: DriveParameters,
    /// Seed of this specimen's own errors and noise.
    pub seed: u64,
    /// Noise of the torque sensor, N·m.
    pub sensor_noise: f64,
}

impl BenchJoint {
    /// Z's joint (16 N·m, 100:1), which G has too, or S's (400 N·m, 160:1).
    ///
    /// # Errors
    /// A name that is not one of these.
    pub fn named(name: &str) -> Result<Self, String> {
        let (joint, sim) = match name {
            "z" => (
                include_str!("../joints/z.toml"),
                include_str!("../joints/z-sim.toml"),
            ),
            "s" => (
                include_str!("../joints/s.toml"),
                include_str!("../joints/s-sim.toml"),
            ),
            other => return Err(format!("joint `{other}` is unknown; allowed: z, s")),
        };
        let file = JointFile::parse(joint, name, &no_files).map_err(|e| e.to_string())?;
        let mut sim = SimParameters::parse(sim, name).map_err(|e| e.to_string())?;
        let drive = sim.drives.remove("joint");
        let drive = drive.ok_or("the simulated drive `joint` is missing")?;
        let sensor_noise = 5e-4 * file.joint.rated_torque;
        Ok(Self {
            file,
            drive,
            seed: 1,
            sensor_noise,
        })
    }

    /// Another specimen: every physical parameter redrawn within ±30 %.
    #[must_use]
    pub fn redrawn(&self, seed: u64) -> Self {
        let mut random = Random::new(seed, 77);
        let mut other = self.clone();
        other.seed = seed;
        let d = &mut other.drive;
        let t = &mut d.transmission;
        let (f, b, s) = (&mut d.friction, &mut d.bearing, &mut d.sensors);
        let numbers = [
            &mut t.stiffness,
            &mut t.stiffening,
            &mut t.windup_stiffness_ratio,
            &mut t.windup,
            &mut t.damping,
            &mut t.hysteresis,
            &mut t.hysteresis_span,
            &mut f.coulomb,
            &mut f.stribeck,
            &mut f.viscous,
            &mut f.presliding,
            &mut f.meshing,
            &mut f.ripple,
            &mut b.coulomb,
            &mut b.viscous,
            &mut s.motor_lead,
            &mut s.current_noise,
            &mut s.current_offset,
            &mut s.current_gain,
            &mut s.torque_constant,
        ];
        for number in numbers {
            *number *= 1.0 + SPREAD * random.symmetric();
        }
        f.static_ratio = 1.0 + (f.static_ratio - 1.0) * (1.0 + SPREAD * random.symmetric());
        let e = &mut d.kinematic_error;
        for [cos, sin] in e.link.iter_mut().chain(&mut e.motor) {
            *cos *= 1.0 + SPREAD * random.symmetric();
            *sin *= 1.0 + SPREAD * random.symmetric();
        }
        other
    }

    /// Load of the output flange alone.
    #[must_use]
    pub fn bare(&self) -> RigLoad {
        RigLoad {
            inertia: 2e-3 * self.file.joint.rated_torque / 16.0,
            mass: 0.0,
            arm: 0.0,
        }
    }

    /// A pendulum that weighs as much as `part` of the rated torque when level.
    #[must_use]
    pub fn pendulum(&self, part: f64) -> RigLoad {
        let arm = 0.4;
        let mass = part * self.file.joint.rated_torque / (9.81 * arm);
        RigLoad {
            inertia: 1.1 * mass * arm * arm,
            mass,
            arm,
        }
    }
}
