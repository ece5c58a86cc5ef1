//! The robots of the study, with what is changed of them, and the client that moves them.

use plant::{CanRobot, SimParameters};
use robot_config::Robot;
use robot_state::{JointReference, Mode, Reference, SharedRecord};
use safety_bench::{At, Drives, Fault, Prepared, Rig, Variant};
use std::f64::consts::{PI, TAU};
use torqued::demo::{DemoClient, Motion};

/// Changes made to a robot's files.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Changes {
    pub(crate) seed: u64,
    /// Reaction to event 209; none: warn.
    pub(crate) reaction: Option<&'static str>,
    /// Masses, inertias, gear stiffness and torque constants that the loop believes are off by up to
    /// this share.
    pub(crate) error: f64,
    /// Mass on the shin or on one forearm that no sensor measures and no model has, kg.
    pub(crate) payload: f64,
    /// A surface below the limb that comes down ([`Limb`]); a humanoid hangs in its harness.
    pub(crate) surface: bool,
    /// The chest in a harness, the soles just on the ground.
    pub(crate) harness: bool,
    /// Height of the base at which the harness hangs, m; 0: no harness.
    pub(crate) hangs_at: f64,
}

/// One robot of the study.
pub(crate) struct Study {
    pub(crate) prepared: Prepared,
    /// Rated torque of each joint's gear, N·m.
    pub(crate) rated: Vec<f64>,
}

/// Stiffness of the surface, N/m, and the limb's angle where it meets it, rad.
pub(crate) const SURFACE: f64 = 75_000.0;
const MEETS: f64 = -80.0 * PI / 180.0;

/// The limb that comes down on a surface.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Limb {
    /// The joint that moves it, and the link of whose end the surface is met.
    pub(crate) joint: &'static str,
    link: &'static str,
    /// Height of the joint's axis, and distance of the link's end from it, m.
    axis: f64,
    pub(crate) length: f64,
    /// Text in the files at the start, and its replacement.
    start: &'static [(&'static str, &'static str)],
}

/// The leg's thigh; the humanoid's left upper arm.
pub(crate) fn limb(robot: &str) -> Limb {
    match robot {
        "humanoid" => Limb {
            joint: "left_shoulder_pitch",
            link: "left_shoulder_yaw_link",
            axis: 1.73,
            length: 0.25,
            start: &[
                ("on_ground = true", "base_position_m = [0, 0, 1.2]"),
                ("left_shoulder_pitch = 15", "left_shoulder_pitch = -95"),
                ("left_shoulder_roll = 10", "left_shoulder_roll = 0"),
                ("left_elbow = -45", "left_elbow = -90"),
            ],
        },
        // Its hip is the world's origin.
        _ => Limb {
            joint: "hip_pitch",
            link: "hip_pitch_link",
            axis: 0.0,
            length: 0.3,
            start: &[(
                "joints_deg = { hip_pitch = -25, knee = 50, ankle_pitch = -25 }",
                "joints_deg = { hip_pitch = -95, knee = 90, ankle_pitch = 0 }",
            )],
        },
    }
}

fn read_file(path: &str) -> std::io::Result<String> {
    std::fs::read_to_string(path)
}

impl Study {
    /// Loads a robot from the project's files, changed.
    ///
    /// # Errors
    /// A file that cannot be read or does not fit.
    pub(crate) fn new(
        robot: &'static str,
        drives: Drives,
        changes: &Changes,
    ) -> Result<Self, String> {
        let sim_path = format!("config/{robot}/sim.toml");
        let robot_path = format!("config/{robot}/robot.toml");
        let read = |path: &str| {
            let text = read_file(path)?;
            Ok(if path == sim_path {
                simulation(&text, robot, changes)
            } else if path == robot_path {
                configuration(&text, changes)
            } else {
                text
            })
        };
        let variant = Variant {
            robot,
            drives,
            states: true,
            further_imus: false,
        };
        let mut prepared = Prepared::new(variant, &read).map_err(|e| e.to_string())?;
        if changes.harness {
            // Once more, with the base where it stands on the floor: there the harness hangs.
            let z = prepared.plant.truth().base_position[2];
            let changes = Changes {
                harness: false,
                hangs_at: z,
                ..*changes
            };
            return Self::new(robot, drives, &changes);
        }
        if changes.payload > 0.0 {
            let path = prepared.robot.parameters.urdf_path.clone();
            let urdf = with_payload(
                &read_file(&path).map_err(|e| e.to_string())?,
                changes.payload,
            );
            let text = read(&sim_path).map_err(|e| e.to_string())?;
            let sim = SimParameters::parse(&text, &sim_path).map_err(|e| e.to_string())?;
            prepared.plant =
                CanRobot::new(&prepared.robot, &urdf, &sim).map_err(|e| e.to_string())?;
        }
        believe_wrongly(&mut prepared.robot, changes);
        let text = read_file(&sim_path).map_err(|e| e.to_string())?;
        let joints = &prepared.robot.parameters.joints;
        let rated = joints.iter().map(|joint| rated(&text, &joint.drive));
        let rated = rated.collect::<Option<Vec<_>>>();
        Ok(Self {
            rated: rated.ok_or_else(|| format!("{sim_path}: a drive without rated torque"))?,
            prepared,
        })
    }
}

/// `[drive.NAME]  # SHD-20-100, rated 28 N·m`
fn rated(simulation: &str, drive: &str) -> Option<f64> {
    let head = format!("[drive.{drive}]");
    let line = simulation.lines().find(|line| line.starts_with(&head))?;
    let (_, rest) = line.split_once("rated ")?;
    rest.split_whitespace().next()?.parse().ok()
}

fn configuration(text: &str, changes: &Changes) -> String {
    let mut text = text.to_owned();
    if !text.contains("[external_torque]") {
        text += "\n[external_torque]\n";
    }
    if let Some(reaction) = changes.reaction {
        text += &format!("\n[safety.reactions]\nexternal_contact = \"{reaction}\"\n");
    }
    text
}

/// `[harness]` of a humanoid.
const HARNESS: &str = "\n[harness]\nlink = \"chest_pitch_link\"\nstiffness_N_per_m = 50000\n\
    damping_Ns_per_m = 2000\nstiffness_Nm_per_rad = 5000\ndamping_Nms_per_rad = 200\n";

fn simulation(text: &str, robot: &str, changes: &Changes) -> String {
    let mut text = text.replace("seed = 1\n", &format!("seed = {}\n", changes.seed));
    if changes.error > 0.0 {
        let error = format!("inertia_error_per_cent = {}", 100.0 * changes.error);
        text = text.replace("inertia_error_per_cent = 1", &error);
    }
    if changes.surface {
        let limb = limb(robot);
        if let (Some(from), Some(to)) = (text.find("[ground]"), text.find("[ft_sensor]"))
            && from < to
        {
            // The floor, and the feet that stand on it.
            text.replace_range(from..to, "");
            text += HARNESS;
        }
        for (said, says) in limb.start {
            text = text.replace(said, says);
        }
        let height = limb.axis - limb.length * MEETS.cos();
        text += &format!(
            "\n[ground]\nheight_m = {height}\nstiffness_N_per_m = {SURFACE}\n\
             damping_Ns_per_m = 50\ntangential_stiffness_N_per_m = 1000\n\
             tangential_damping_Ns_per_m = 10\nfriction = 0\n\n\
             [[foot]]\nlink = \"{}\"\ncorners_m = [[0, 0, -{}]]\n",
            limb.link, limb.length
        );
    }
    if changes.hangs_at > 0.0 {
        let at = format!(
            "on_ground = true\nbase_position_m = [0, 0, {}]",
            changes.hangs_at
        );
        text = text.replace("on_ground = true", &at);
        text += HARNESS;
    }
    text
}

/// More mass on the shin, or on one forearm.
fn with_payload(urdf: &str, payload: f64) -> String {
    let link = [
        "<link name=\"left_elbow_link\">",
        "<link name=\"knee_link\">",
    ]
    .into_iter()
    .find_map(|link| urdf.find(link));
    let Some(value) = link.and_then(|at| Some(at + urdf[at..].find("<mass value=\"")? + 13)) else {
        return urdf.to_owned();
    };
    let end = value + urdf[value..].find('"').unwrap_or(0);
    let mass: f64 = urdf[value..end].parse().unwrap_or(0.0);
    format!("{}{}{}", &urdf[..value], mass + payload, &urdf[end..])
}

/// Gears and torque constants that are not what the configuration says.
fn believe_wrongly(robot: &mut Robot, changes: &Changes) {
    let mut random = changes.seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    let mut wrong = || {
        random = random
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        let unit = (random >> 33) as f64 / f64::from(1_u32 << 31);
        1.0 + changes.error * (2.0 * unit - 1.0)
    };
    for joint in &mut robot.parameters.joints {
        joint.estimator.compliance.k_fs0 *= wrong();
        joint.estimator.wave_generator.torque_constant *= wrong();
    }
}

/// Motion that the client asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Doing {
    /// Nothing: the robot holds.
    Hold,
    /// Holds a pose by inverse dynamics.
    Stand,
    /// The motion of `torqued demo`.
    Demo,
    /// Arms, or the leg, to and fro, up to half of the velocity limits.
    Quick,
    /// Both legs in turn lift their feet and put them down, in the harness.
    Step,
    /// Hangs in the harness, or stands on nothing, and waits for what the run asks for.
    Hang,
}

impl Doing {
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Hold => "hold",
            Self::Stand => "standing, inverse dynamics",
            Self::Demo => "demo's motion",
            Self::Quick => "quick motion",
            Self::Step => "stepping in a harness",
            Self::Hang => "hanging",
        }
    }
}

/// A robot that does something, ready.
pub(crate) struct Busy {
    pub(crate) rig: Rig,
    demo: Option<DemoClient>,
    shared: Box<SharedRecord>,
    doing: Doing,
    begin: Reference,
    /// Cycles in the client's mode.
    cycles: usize,
}

/// Cycles until a robot that is switched on holds with full filters, and until it is in the mode.
const SETTLING: usize = 600;

impl Busy {
    pub(crate) fn new(study: &Study, doing: Doing) -> Result<Self, String> {
        let mut rig = Rig::new(&study.prepared).map_err(|e| e.to_string())?;
        rig.run(SETTLING);
        let name = study.prepared.variant.robot;
        // On its feet only the demo's client keeps the robot in balance; it may do no more than that.
        let balances = rig.robot.parameters.joints.len() > 6
            && study.prepared.variant.drives == Drives::Position
            && matches!(doing, Doing::Stand | Doing::Quick);
        let demo = match doing {
            Doing::Demo | Doing::Stand | Doing::Quick if balances || doing == Doing::Demo => {
                let path = test_support::judged_motion(name);
                let mut text = read_file(&path).map_err(|e| e.to_string())?;
                if balances {
                    text = text.replace("settle_s = 1.0", "settle_s = 1e9");
                }
                let joints = rig.robot.parameters.joints.iter();
                let names: Vec<_> = joints.map(|j| (j.name.clone(), j.kind)).collect();
                let motion = Motion::parse(&text, &path, &names).map_err(|e| e.to_string())?;
                Some(DemoClient::new(&rig.robot, motion))
            }
            Doing::Hold => None,
            _ => {
                rig.follow(Mode::Hold);
                rig.run(10);
                rig.follow(Mode::InverseDynamics);
                // A desired force of zero: the harness carries, and the legs are springs. The estimated
                // one instead would let the load wander between feet and harness.
                rig.client.reference.contact_wrench_given = u32::from(doing == Doing::Step);
                None
            }
        };
        let mut busy = Self {
            begin: match &demo {
                Some(demo) => *demo.reference(),
                None => rig.client.reference,
            },
            rig,
            demo,
            shared: Box::default(),
            doing,
            cycles: 0,
        };
        (0..1000).for_each(|_| busy.step(|_, _, _| {}));
        let mode = busy.rig.cycle.record().mode;
        if doing != Doing::Hold && mode != Mode::InverseDynamics.number() {
            let fault = busy.rig.cycle.record().fault;
            return Err(format!(
                "{name}, {}: fault {fault}, mode {mode}",
                doing.name()
            ));
        }
        Ok(busy)
    }

    /// One cycle; `also` acts as the rig's faults do.
    pub(crate) fn step(&mut self, mut also: impl FnMut(At, &mut Rig, usize) + 'static) {
        let k = self.cycles;
        let next = match &self.demo {
            Some(demo) => Some(self.moved(*demo.reference(), k)),
            None if self.doing == Doing::Hold => None,
            None => Some(self.moved(self.begin, k)),
        };
        let mut fault: Fault = Box::new(move |at, rig: &mut Rig, k| {
            if let (At::Client, Some(next)) = (at, next) {
                let sequence = rig.client.reference.sequence;
                rig.client.reference = next;
                rig.client.reference.sequence = sequence;
                rig.client.speaks = true;
            }
            also(at, rig, k);
        });
        self.rig.step(Some((&mut fault, k)));
        if let Some(demo) = &mut self.demo {
            self.shared.cycle = *self.rig.cycle.record();
            demo.observe(&self.shared);
        }
        self.cycles += 1;
    }

    /// The reference with the motion beside what it asks for.
    fn moved(&self, mut reference: Reference, k: usize) -> Reference {
        if reference.mode == Mode::Hold.number() {
            return reference;
        }
        let t = 1e-3 * k as f64;
        let parameters = &self.rig.robot.parameters;
        for (j, (asked, joint)) in reference
            .joints
            .iter_mut()
            .zip(&parameters.joints)
            .enumerate()
        {
            let [q, dq, ddq] = match self.doing {
                Doing::Quick if is_free(&joint.name, parameters.joints.len()) => {
                    let room = (joint.limits.position_max - asked.q_d)
                        .min(asked.q_d - joint.limits.position_min);
                    swing(j, room, joint.limits.velocity, t)
                }
                Doing::Step => lift(&joint.name, t),
                _ => [0.0; 3],
            };
            *asked = JointReference {
                q_d: asked.q_d + q,
                dq_d: asked.dq_d + dq,
                ddq_d: asked.ddq_d + ddq,
                ..*asked
            };
        }
        reference
    }
}

/// The whole leg; the arms of a robot on its feet.
fn is_free(name: &str, joints: usize) -> bool {
    joints <= 6
        || ["shoulder", "elbow", "wrist"]
            .iter()
            .any(|part| name.contains(part))
}

/// To and fro within `room`, each joint at a frequency of its own, up to half of the velocity limit.
fn swing(joint: usize, room: f64, velocity: f64, t: f64) -> [f64; 3] {
    let w = TAU * (0.31 + 0.07 * (joint % 6) as f64);
    let amplitude = (0.4 * room.max(0.0)).min(0.5 * velocity / w).min(0.6);
    // It swells within two seconds.
    let (s, ds, dds) = swell(t / 2.0);
    let (sin, cos) = (w * t).sin_cos();
    [
        amplitude * s * sin,
        amplitude * (ds / 2.0 * sin + s * w * cos),
        amplitude * (dds / 4.0 * sin + ds * w * cos - s * w * w * sin),
    ]
}

/// From 0 to 1 with its two derivatives, by (1 - cos) / 2.
pub(crate) fn swell(x: f64) -> (f64, f64, f64) {
    if x <= 0.0 || x >= 1.0 {
        return (x.clamp(0.0, 1.0).round(), 0.0, 0.0);
    }
    let (s, c) = (PI * x).sin_cos();
    (0.5 * (1.0 - c), 0.5 * PI * s, 0.5 * PI * PI * c)
}

/// One foot up and down in 0.6 s, then the other: the leg shortens by some centimetres.
fn lift(joint: &str, t: f64) -> [f64; 3] {
    let share = match joint {
        name if name.contains("hip_pitch") => -0.25,
        name if name.contains("knee") => 0.5,
        name if name.contains("ankle_pitch") => -0.25,
        _ => return [0.0; 3],
    };
    let shift = if joint.starts_with("left") { 0.0 } else { 0.8 };
    let phase = (t - 1.0 - shift).rem_euclid(1.6) / 0.6;
    if t < 1.0 + shift || phase >= 1.0 {
        return [0.0; 3];
    }
    // sin^4 has no step in its acceleration.
    let (s, c) = (PI * phase).sin_cos();
    let rate = PI / 0.6;
    [
        share * s.powi(4),
        share * 4.0 * s.powi(3) * c * rate,
        share * (12.0 * s * s * c * c - 4.0 * s.powi(4)) * rate * rate,
    ]
}
