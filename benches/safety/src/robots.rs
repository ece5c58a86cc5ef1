//! The robots: leg and humanoid of the project, with drives that follow positions or currents, with
//! states by CiA 402 or always on. The project has no robot with current drives: theirs are the
//! same robots with another `robot.toml`, DBC and `sim.toml`, made here in memory.

use dynamics::{Data, crba};
use plant::parameters::HarnessParameters;
use plant::{CanRobot, SimParameters};
use problem::{Problem, Problems};
use robot_config::Robot;
use std::f64::consts::TAU;
use toml::{Table, Value};

use crate::learned::{LEARNED_FILE, learn};

/// Quantity that the drives follow.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Drives {
    /// Positions, by a position loop of the drive's own.
    Position,
    /// Motor currents.
    Current,
}

/// One robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Variant {
    /// `leg`, `hrp2-like` (encoders on the motors alone), `lift-gripper` (prismatic joints, one of which
    /// another follows) or `humanoid`.
    pub robot: &'static str,
    /// Quantity that its drives follow.
    pub drives: Drives,
    /// Its drives have states by CiA 402, and brakes; else they are always on.
    pub states: bool,
    /// It has two IMUs more, in its pelvis and head.
    pub further_imus: bool,
}

const fn variant(robot: &'static str, drives: Drives, states: bool) -> Variant {
    Variant {
        robot,
        drives,
        states,
        further_imus: false,
    }
}

/// Time without a set-point after which a drive faults, s: that of `rt-tests/second-robot`.
const COMMAND_TIMEOUT_S: f64 = 0.04;

/// Places of the humanoid's IMUs beside the first one, which is in the chest.
const FURTHER_IMUS: [&str; 2] = ["base_link", "head_pitch_link"];

impl Variant {
    /// Every robot.
    pub const ALL: [Self; 11] = [
        variant("leg", Drives::Position, true),
        variant("humanoid", Drives::Position, true),
        variant("hrp2-like", Drives::Position, true),
        variant("lift-gripper", Drives::Position, true),
        variant("leg", Drives::Current, true),
        variant("humanoid", Drives::Current, true),
        variant("leg", Drives::Position, false),
        variant("humanoid", Drives::Position, false),
        variant("leg", Drives::Current, false),
        variant("humanoid", Drives::Current, false),
        Self {
            further_imus: true,
            ..variant("humanoid", Drives::Position, true)
        },
    ];

    /// Its name on the page.
    #[must_use]
    pub fn name(&self) -> String {
        let drives = match self.drives {
            Drives::Position => "position",
            Drives::Current => "current",
        };
        let states = if self.states { "" } else { ", always on" };
        let imus = if self.further_imus {
            " with three IMUs"
        } else {
            ""
        };
        format!("{}{imus}, {drives}{states}", self.robot)
    }
}

/// Natural frequency of a current-commanded joint under its position feedback, rad/s, and its damping
/// ratio. The measured velocity is 8 ms late, which takes 0.15 rad of phase at this frequency.
const NATURAL_FREQUENCY: f64 = TAU * 3.0;
const DAMPING_RATIO: f64 = 1.0;
/// Share of the motor's Coulomb friction that is compensated: all of it would make a limit cycle.
const COMPENSATED_FRICTION: f64 = 0.5;

/// Reads a file of the project, or says why not.
type Read<'a> = &'a dyn Fn(&str) -> std::io::Result<String>;

/// A robot's configuration, and the simulated robot as it is switched on.
#[derive(Debug, Clone)]
pub struct Prepared {
    /// Which robot it is.
    pub variant: Variant,
    /// The configuration.
    pub robot: Robot,
    /// The simulated robot.
    pub plant: CanRobot,
    /// The same, its first frame held by something stiff; none: it has no frame to be led.
    pub clamped: Option<CanRobot>,
}

impl Prepared {
    /// Loads a robot from the project's files, which `read` gives by their paths in it.
    ///
    /// # Errors
    /// A file that cannot be read or does not fit.
    pub fn new(variant: Variant, read: Read<'_>) -> Result<Self, Problems> {
        let path = format!("config/{}/robot.toml", variant.robot);
        let sim_path = format!("config/{}/sim.toml", variant.robot);
        let read_file =
            |path: &str| read(path).map_err(|e| Problems::from(Problem::unreadable(path, &e)));
        let mut sim = SimParameters::parse(&read_file(&sim_path)?, &sim_path)?;
        // Nothing but the fault pushes.
        sim.pushes.clear();
        for drive in sim.drives.values_mut() {
            drive.states.command_timeout = Some(COMMAND_TIMEOUT_S);
        }
        let mut table = parse(&read_file(&path)?);
        if !variant.states {
            always_on(&mut table);
        }
        if variant.further_imus {
            add_imus(&mut table);
        }
        let dbc_with_imus = |file: &str| {
            let dbc = read(file)?;
            Ok(if variant.further_imus {
                with_imu_frames(&dbc)
            } else {
                dbc
            })
        };
        let joint = match variant.robot {
            "leg" => "knee",
            "humanoid" => "left_elbow",
            "lift-gripper" => "boom",
            _ => "",
        };
        let start = sim.start.joints.get(joint).copied().unwrap_or(0.0);
        let learned = learn(each(&mut table, "joint"), joint, start)?.unwrap_or_default();
        let text = table.to_string();
        let robot = robot_config::load(&path, &|file| match file {
            file if file == path => Ok(text.clone()),
            file if file.ends_with(LEARNED_FILE) => Ok(learned.clone()),
            file if file.ends_with(".dbc") => dbc_with_imus(file),
            file => read(file),
        })?;
        let robot = match variant.drives {
            Drives::Position => robot,
            Drives::Current => {
                if variant.robot == "humanoid" {
                    hang(&mut sim);
                }
                let inertias = inertias(&robot, &sim);
                take_currents(&mut table, &robot, &inertias);
                let text = table.to_string();
                robot_config::load(&path, &|file| match file {
                    file if file == path => Ok(text.clone()),
                    file if file.ends_with(LEARNED_FILE) => Ok(learned.clone()),
                    file if file.ends_with(".dbc") => Ok(in_milliamperes(&read(file)?)),
                    file => read(file),
                })?
            }
        };
        let urdf = read_file(&robot.parameters.urdf_path)?;
        let plant = CanRobot::new(&robot, &urdf, &sim)?;
        let clamped = match robot.parameters.frames.first() {
            Some(frame) => {
                clamp(&mut sim, &frame.name);
                Some(CanRobot::new(&robot, &urdf, &sim)?)
            }
            None => None,
        };
        Ok(Self {
            variant,
            robot,
            plant,
            clamped,
        })
    }
}

/// The configuration's table; a text that is no TOML gives an empty one, which the loader refuses.
fn parse(text: &str) -> Table {
    text.parse().unwrap_or_default()
}

/// The tables in an array, or in a table of tables.
fn each<'t>(table: &'t mut Table, key: &str) -> Vec<(String, &'t mut Table)> {
    match table.get_mut(key) {
        Some(Value::Array(array)) => (array.iter_mut())
            .filter_map(Value::as_table_mut)
            .map(|t| (String::new(), t))
            .collect(),
        Some(Value::Table(tables)) => (tables.iter_mut())
            .filter_map(|(name, value)| Some((name.clone(), value.as_table_mut()?)))
            .collect(),
        _ => Vec::new(),
    }
}

/// The configuration's IMU as the first of a list.
fn add_imus(table: &mut Table) {
    let Some(Value::Table(first)) = table.remove("imu") else {
        return;
    };
    let text = first.to_string();
    let further = FURTHER_IMUS.iter().zip(2..).map(|(frame, id)| {
        let mut imu = parse(&text.replace("IMU.", &format!("IMU_{id}.")));
        imu.insert("frame".into(), (*frame).into());
        Value::Table(imu)
    });
    let further: Vec<Value> = further.collect();
    let mut all = vec![Value::Table(first)];
    all.extend(further);
    table.insert("imu".into(), Value::Array(all));
}

/// Frames of their own for the further ones.
fn with_imu_frames(dbc: &str) -> String {
    let Some(from) = dbc.find("BO_ 401 IMU") else {
        return dbc.to_owned();
    };
    let end = dbc[from..]
        .find("\n\n")
        .map_or(dbc.len(), |end| from + end + 2);
    let copies = (2..)
        .take(FURTHER_IMUS.len())
        .map(|id| dbc[from..end].replace("BO_ 401 IMU", &format!("BO_ {} IMU_{id}", 400 + id)));
    let copies: String = copies.collect();
    format!("{}{copies}{}", &dbc[..end], &dbc[end..])
}

/// Drives without states: no status words, no control words.
fn always_on(table: &mut Table) {
    for (_, drive) in each(table, "drive") {
        drive.remove("state");
    }
    for (_, joint) in each(table, "joint") {
        joint.remove("status");
        joint.remove("control");
    }
}

/// The humanoid hangs in its harness, feet in the air: standing on current drives without a balance
/// controller is no state to judge faults in.
fn hang(sim: &mut SimParameters) {
    (sim.start.on_ground, sim.start.base_position) = (false, [0.0, 0.0, 1.2]);
    sim.harness = Some(HarnessParameters {
        link: "chest_pitch_link".into(),
        stiffness: 50_000.0,
        damping: 2_000.0,
        angular_stiffness: 5_000.0,
        angular_damping: 200.0,
        slack: 0.0,
        angular_slack: 0.0,
    });
}

/// A link is held by something as stiff as a floor.
fn clamp(sim: &mut SimParameters, link: &str) {
    sim.harness = Some(HarnessParameters {
        link: link.into(),
        stiffness: 600_000.0,
        damping: 2_000.0,
        angular_stiffness: 5_000.0,
        angular_damping: 15.0,
        slack: 0.0,
        angular_slack: 0.0,
    });
}

/// M_jj at the start pose with the rotor's share, kg·m²: config order.
fn inertias(robot: &Robot, sim: &SimParameters) -> Vec<f64> {
    let model = &robot.model;
    let (velocities, positions) = model.base_size();
    let mut q = vec![0.0; model.nq()];
    if positions > 0 {
        q[positions - 1] = 1.0;
    }
    let joints = &robot.parameters.joints;
    for joint in joints {
        let start = sim.start.joints.get(&joint.name).copied().unwrap_or(0.0);
        q[positions + joint.model_index] = start;
    }
    let mut data = Data::new(model);
    let m = crba(model, &mut data, &q);
    (joints.iter())
        .map(|joint| {
            let rotor = joint.rotor_inertia * joint.encoders.gear_ratio.powi(2);
            let place = velocities + joint.model_index;
            m[(place, place)] + rotor
        })
        .collect()
}

/// Drives that take currents: motor constants from torque constant, friction and gear ratio (D3), and
/// a current limit that reaches the greatest torque limit of the drive's joints.
fn take_currents(table: &mut Table, robot: &Robot, inertias: &[f64]) {
    let joints = &robot.parameters.joints;
    for (name, drive) in each(table, "drive") {
        let number = |table: &Table, key: &str| match table.get(key) {
            Some(Value::Float(x)) => *x,
            Some(Value::Integer(x)) => *x as f64,
            _ => 0.0,
        };
        let friction = drive.get("friction").and_then(Value::as_table);
        let friction = friction.cloned().unwrap_or_default();
        let n = number(drive, "gear_ratio");
        let k_1 = n * number(drive, "torque_constant_Nm_per_A");
        let used = joints.iter().filter(|joint| joint.drive == name);
        let torque = used.fold(0.0_f64, |most, joint| most.max(joint.limits.torque));
        let mut motor = Table::new();
        motor.insert("K_1_Nm_per_A".into(), k_1.into());
        let viscous = n * n * number(&friction, "viscous_Nms_per_rad");
        motor.insert("K_2_Nms_per_rad".into(), viscous.into());
        let coulomb = COMPENSATED_FRICTION * n * number(&friction, "coulomb_Nm");
        motor.insert("K_3_Nm".into(), coulomb.into());
        motor.insert("sign_smoothing_rad_per_s".into(), 0.05.into());
        drive.insert("motor".into(), motor.into());
        drive.insert("command".into(), "current".into());
        drive.insert("current_limit_A".into(), (torque / k_1).into());
        // The simulated drives have one.
        if let Some(Value::Table(state)) = drive.get_mut("state") {
            state.insert("brake".into(), "while_off".into());
        }
    }
    for ((_, joint), inertia) in each(table, "joint").into_iter().zip(inertias) {
        let stiffness = inertia * NATURAL_FREQUENCY.powi(2);
        let damping = 2.0 * DAMPING_RATIO * NATURAL_FREQUENCY * inertia;
        let mut gains = Table::new();
        // Torque feedback beside it would need a gear that is much stiffer than the delay allows.
        gains.insert("K_p".into(), 0.0.into());
        gains.insert("K_i_per_s".into(), 0.0.into());
        gains.insert("K_s_Nm_per_rad".into(), stiffness.into());
        gains.insert("K_d_Nms_per_rad".into(), damping.into());
        joint.insert("gains".into(), gains.into());
    }
    if let Some(Value::Table(control)) = table.get_mut("control") {
        control.insert("law".into(), "proportional_integral".into());
        control.insert("torque_feedback".into(), "encoder".into());
    }
}

/// The DBC with currents where the set-points were positions.
fn in_milliamperes(dbc: &str) -> String {
    let lines = dbc.split_inclusive('\n').map(|line| {
        if !(line.contains("_position :") && line.contains("\"rad\"")) {
            return line.to_owned();
        }
        let (layout, _) = line.split_once('(').unwrap_or((line, ""));
        // 21 bits reach 105 A, 32 bits more.
        format!("{layout}(0.1,0) [0|0] \"mA\" DRIVES\n")
    });
    lines.collect()
}
