//! A configuration as text.

use super::drives::Kind;
use super::urdf::Joint;
use ::drives::scan::Found;
use problem::Problem;
use robot_config::{BusParameters, Carrier};

/// Gains that are tried: N·m/rad and N·m·s/rad, the stiffest first.
const GAINS: [(f64, f64); 14] = [
    (20.0, 4.0),
    (8.0, 2.0),
    (8.0, 1.0),
    (4.0, 1.0),
    (4.0, 0.5),
    (2.0, 0.5),
    (2.0, 0.25),
    (1.0, 0.4),
    (1.0, 0.2),
    (0.5, 0.2),
    (0.5, 0.1),
    (0.25, 0.1),
    (0.1, 0.04),
    (0.1, 0.02),
];
/// Rates of the loop, Hz, the highest first.
const RATES: [f64; 5] = [500.0, 250.0, 200.0, 125.0, 100.0];
/// Time that the frames of a drive take on a bus of 1 Mbit/s in a cycle, at worst, s: the longest of all families of
/// actuators (RobStride's), and of CiA 402's.
const ON_WIRE: [f64; 2] = [0.64e-3, 0.44e-3];
const GUESSED: &str = " # guessed";

/// A configuration to be written.
pub(super) struct Draft {
    pub(super) name: String,
    pub(super) urdf: String,
    pub(super) bus: BusParameters,
    pub(super) kinds: Vec<Kind>,
    /// Joints with their drives, and the index of the drive's kind.
    pub(super) joints: Vec<(Joint, Found, usize)>,
    /// Index of each joint's gains in `GAINS`.
    pub(super) gains: Vec<usize>,
}

impl Draft {
    /// Gives joints that were refused their next gains; false: there are none left.
    pub(super) fn soften(&mut self, refused: &[Problem]) -> bool {
        let mut changed = false;
        for ((joint, ..), gains) in self.joints.iter().zip(&mut self.gains) {
            let own = format!("joint {}:", joint.name);
            if refused.iter().any(|problem| problem.reason.contains(&own)) {
                *gains += 1;
                changed = *gains < GAINS.len();
                if !changed {
                    return false;
                }
            }
        }
        changed
    }

    pub(super) fn text(&self) -> String {
        let mut text = self.head();
        for (index, kind) in self.kinds.iter().enumerate() {
            text += &self.drive(index, kind);
        }
        for ((joint, device, kind), gains) in self.joints.iter().zip(&self.gains) {
            let (stiffness, damping) = GAINS[*gains];
            let (name, bus, drive) = (&joint.name, &self.bus.name, self.drive_name(*kind));
            text += &format!(
                "\n[[joint]]\nname = {name:?}\nbus = {bus:?}\ndrive = {drive:?}\nnode = {}{GUESSED}\n",
                device.node
            );
            if let Some(reply) = device.reply {
                text += &format!("reply_id = {reply}\n");
            }
            text += "motor_angle = { direction = 1, offset_deg = 0.0 } # guessed\n";
            text += &format!(
                "torque_limit_Nm = {:?} # effort of the URDF\n",
                joint.effort
            );
            text += &format!(
                "gains = {{ K_p = 0.0, K_i_per_s = 0.0, K_s_Nm_per_rad = {stiffness:?}, K_d_Nms_per_rad = {damping:?} }}{GUESSED}\n"
            );
        }
        text
    }

    fn head(&self) -> String {
        let (name, urdf, bus) = (&self.name, &self.urdf, &self.bus.name);
        let carrier = match &self.bus.carrier {
            Carrier::SocketCan(interface) => format!("interface = {interface:?}"),
            Carrier::UdpMulticast(group) => format!(
                "kind = \"udp_multicast\"\ngroup = \"{}\"\nport = {}",
                group.group, group.port
            ),
        };
        let rate = self.rate();
        let window = (0.04 * rate).round();
        let fd = self.bus.fd;
        format!(
            "# {name}: made from its URDF and the drives that answered. Measure or look up what ends with\n\
             # `# guessed`, and remove these marks; docs/configuration.md describes every key.\n\n\
             [robot]\nname = {name:?}\nurdf = {urdf:?}\nbase = \"fixed\"{GUESSED}\n\n\
             [loop]\nrate_hz = {rate:?}{GUESSED}\ngather_deadline_us = 800.0\nstale_after_ms = 20.0\nreal_time = \"try\"\n\n\
             [safety]\nenable = \"operator\"\n\n\
             [[bus]]\nname = {bus:?}\n{carrier}\nfd = {fd}\n\n\
             [filters]\nencoder = {{ window = {window}, order = 2 }}\nsensor = {{ window = {window}, order = 1 }}\n\n\
             [whole_body]\nangular_acceleration = \"neglect\"\n\n\
             [control]\nlaw = \"proportional_integral\"\ntorque_feedback = \"whole_body\"\nK_f = 0.0\n"
        )
    }

    /// The highest rate at which the bus carries all drives; the lowest where none is.
    fn rate(&self) -> f64 {
        let of = |&(.., kind): &(Joint, Found, usize)| {
            let by_cia402 = self.kinds[kind].model.is_none();
            ON_WIRE[usize::from(by_cia402)]
        };
        let takes: f64 = self.joints.iter().map(of).sum();
        let fits = RATES.into_iter().find(|rate| takes * rate <= 1.0);
        fits.unwrap_or(RATES[RATES.len() - 1])
    }

    fn drive_name(&self, index: usize) -> String {
        let family = self.kinds[index].family;
        let same = self
            .kinds
            .iter()
            .filter(|kind| kind.family == family)
            .count();
        if same == 1 {
            family.to_owned()
        } else {
            format!("{family}_{}", index + 1)
        }
    }

    fn drive(&self, index: usize, kind: &Kind) -> String {
        let name = self.drive_name(index);
        let family = kind.family;
        let sampled = if family == "odrive" {
            format!(
                "sampled = \"when_sent\"\nperiod_us = {:?}{GUESSED}\n",
                1e6 / self.rate()
            )
        } else {
            String::new()
        };
        // CiA 402 counts positions.
        let sampled = match &kind.model {
            None => format!("motor_counts_per_turn = 65536{GUESSED}\n"),
            Some(_) => sampled,
        };
        let own = match &kind.model {
            Some((model, reported)) => {
                let mark = if *reported { "" } else { GUESSED };
                format!(
                    "[drive.{name}.actuator]\nmodel = {:?}{mark}\nkp_Nm_per_rad = 100.0{GUESSED}\nkd_Nms_per_rad = 3.0{GUESSED}\n",
                    model.name
                )
            }
            None => canopen(&name, kind),
        };
        format!(
            "\n[drive.{name}]\nprofile = {family:?}\ncommand = \"position\"\n\
             gear_ratio = {:?}{GUESSED}\ntorque_constant_Nm_per_A = 0.1{GUESSED}\n\
             rotor_inertia_kg_m2 = {:?}{GUESSED}\nmax_velocity_rad_per_s = {:?}{GUESSED}\n\
             current_sigma_A = 0.05{GUESSED}\n{sampled}{own}\
             [drive.{name}.compliance]\nK_fs0_Nm_per_rad = 5000.0{GUESSED}\nC_fs_per_Nm = 0.0\n\
             K_wg0_Nm_per_rad = 5.0{GUESSED}\nC_wg_per_Nm = 0.0\n\
             [drive.{name}.friction]\ncoulomb_Nm = 0.01{GUESSED}\nviscous_Nms_per_rad = 1e-05{GUESSED}\nepsilon_rad_per_s = 0.5\n\
             [drive.{name}.motor]\nK_tau_rad_per_Nm = 0.01{GUESSED}\nK_v_s = 0.0\nK_c_rad = 0.0\nsign_smoothing_rad_per_s = 0.05\n",
            kind.gear_ratio,
            1e-2 / (kind.gear_ratio * kind.gear_ratio),
            kind.velocity,
        )
    }
}

fn canopen(name: &str, kind: &Kind) -> String {
    let rated = match kind.rated_current {
        Some(rated) => format!("rated_current_A = {rated:?}\n"),
        None => format!("rated_current_A = 5.0{GUESSED}\n"),
    };
    let identity = kind.identity.as_ref();
    let identity =
        identity.map(|(vendor, product)| format!("vendor = {vendor}\nproduct = {product}\n"));
    let identity = identity.unwrap_or_default();
    format!("[drive.{name}.canopen]\nposition = \"motor\"{GUESSED}\n{rated}{identity}")
}
