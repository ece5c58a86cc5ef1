//! Legs of other proportions than those on which the law's numbers were chosen.

use crate::common;

use common::{Bench, client_input, read};
use robot_state::Mode;

/// Factors of the gears, drives, rotors and frictions, in the configuration and in the simulation.
#[derive(Debug, Clone, Copy)]
struct Proportions {
    gear: f64,
    drive: f64,
    rotor: f64,
    friction: f64,
    /// Of K_s and K_d, where `torquectl check` asks for less.
    gains: f64,
}

const AS_IT_IS: Proportions = Proportions {
    gear: 1.0,
    drive: 1.0,
    rotor: 1.0,
    friction: 1.0,
    gains: 1.0,
};

/// The number of a line `key = number`, if it has this key.
fn number(line: &str, key: &str) -> Option<f64> {
    let rest = line.strip_prefix(key)?.trim_start().strip_prefix('=')?;
    rest.split('#').next()?.trim().parse().ok()
}

/// The line with its number times the factor of its key, if it has one.
fn scaled(line: &str, factors: &[(&str, f64)]) -> String {
    let mut found = factors.iter().filter_map(|(key, factor)| {
        number(line, key).map(|number| format!("{key} = {}", number * factor))
    });
    found.next().unwrap_or_else(|| line.to_owned())
}

impl Proportions {
    /// The configuration of such a robot.
    fn configuration(self, text: &str) -> String {
        let factors = [
            ("K_fs0_Nm_per_rad", self.gear),
            ("K_wg0_Nm_per_rad", self.gear),
            // The drive's own damping ratio stays.
            ("K_v_s", (self.rotor / self.drive).sqrt()),
            ("rotor_inertia_kg_m2", self.rotor),
            ("coulomb_Nm", self.friction),
        ];
        let mut gear = 0.0;
        let lines = text.lines().map(|line| {
            gear = number(line, "K_fs0_Nm_per_rad").unwrap_or(gear);
            if let Some(k_tau) = number(line, "K_tau_rad_per_Nm") {
                let drive = 1.0 / (k_tau - 1.0 / gear);
                let both = 1.0 / (self.drive * drive) + 1.0 / (self.gear * gear);
                return format!("K_tau_rad_per_Nm = {both}");
            }
            if let Some((before, gains)) = line.split_once("K_s_Nm_per_rad = ") {
                let (k_s, rest) = gains.split_once(", K_d_Nms_per_rad = ").unwrap();
                let (k_d, end) = rest.split_once(" }").unwrap();
                let [k_s, k_d] = [k_s, k_d].map(|it| it.parse::<f64>().unwrap() * self.gains);
                return format!("{before}K_s_Nm_per_rad = {k_s}, K_d_Nms_per_rad = {k_d} }}{end}");
            }
            scaled(line, &factors)
        });
        lines.map(|line| line + "\n").collect()
    }

    /// The simulation of such a robot; its rotors are those of the configuration.
    fn simulation(self, text: &str) -> String {
        // A torque winds this gear up by another angle than the shipped one.
        let transmission = [
            ("stiffness_Nm_per_rad", self.gear),
            ("stiffening_per_rad2", self.gear * self.gear),
            ("windup_rad", 1.0 / self.gear),
            ("damping_Nms_per_rad", (self.gear * self.rotor).sqrt()),
            ("hysteresis_rad", 1.0 / self.gear),
        ];
        let controller = [
            ("K_4_A_per_rad", self.drive),
            ("K_5_As_per_rad", (self.drive * self.rotor).sqrt()),
        ];
        let friction = [("coulomb_Nm", self.friction)];
        let mut factors: &[(&str, f64)] = &[];
        let lines = text.lines().map(|line| {
            if line.starts_with('[') {
                let table = line.split(']').next().unwrap_or_default();
                factors = match table.rsplit('.').next() {
                    Some("transmission") => &transmission,
                    Some("controller") => &controller,
                    Some("friction") => &friction,
                    _ => &[],
                };
            }
            scaled(line, factors)
        });
        lines.map(|line| line + "\n").collect()
    }
}

/// Follows a motion of all joints for two seconds, then stands.
fn moves_and_stands(proportions: Proportions, mode: Mode) {
    let mut bench = Bench::reading("leg", &|path| {
        let text = read(path)?;
        Ok(match path.rsplit('/').next() {
            Some("robot.toml") => proportions.configuration(&text),
            Some("sim.toml") => proportions.simulation(&text),
            _ => text,
        })
    });
    bench.follow();
    let start = bench.reference(mode.number(), 0);
    let mut reference = start;
    reference.sequence = 1;
    let (mut swung, mut fastest) = (0.0_f64, 0.0_f64);
    for cycle in 0..4000 {
        reference.sequence += 1;
        let t = f64::from(cycle) * 1e-3;
        let moving = t < 2.0;
        let w = std::f64::consts::TAU;
        let amplitude = if moving { 0.04 } else { 0.0 };
        for (desired, from) in reference.joints.iter_mut().zip(&start.joints) {
            desired.q_d = from.q_d + amplitude * (1.0 - (w * t).cos());
            desired.dq_d = amplitude * w * (w * t).sin();
            desired.ddq_d = amplitude * w * w * (w * t).cos();
        }
        let record = bench.step(&client_input(&reference));
        assert_eq!(
            (record.fault, record.mode),
            (0, mode.number()),
            "{proportions:?} at {t} s"
        );
        let joints = &bench.plant.truth().joints;
        let now = joints
            .iter()
            .map(|joint| joint.dq.abs())
            .fold(0.0, f64::max);
        if moving {
            swung = swung.max(now);
        } else if t > 3.0 {
            fastest = fastest.max(now);
        }
    }
    assert!(swung > 0.1, "{proportions:?}: {swung} rad/s");
    assert!(fastest < 0.01, "{proportions:?}: {fastest} rad/s");
}

const OTHERS: [Proportions; 3] = [
    Proportions {
        gear: 0.4,
        friction: 2.0,
        gains: 0.4,
        ..AS_IT_IS
    },
    Proportions {
        gear: 3.0,
        rotor: 2.0,
        friction: 2.0,
        ..AS_IT_IS
    },
    Proportions {
        drive: 2.0,
        ..AS_IT_IS
    },
];

/// Every factor changes the robot's two descriptions alike: one alone would be a robot that is not as configured.
#[test]
fn proportions_reach_configuration_and_simulation() {
    let other = Proportions {
        gear: 2.0,
        drive: 4.0,
        rotor: 4.0,
        friction: 3.0,
        gains: 0.5,
    };
    let [configuration, simulation] =
        ["robot", "sim"].map(|it| read(&format!("config/leg/{it}.toml")).unwrap());
    let configuration = other.configuration(&configuration);
    let simulation = other.simulation(&simulation);
    for line in [
        "K_fs0_Nm_per_rad = 26000",
        "rotor_inertia_kg_m2 = 0.00008",
        "K_v_s = 0.013",
        "coulomb_Nm = 0.075",
    ] {
        assert!(configuration.contains(line), "{line}");
    }
    for line in [
        "stiffness_Nm_per_rad = 24000",
        "windup_rad = 0.0000525",
        "K_4_A_per_rad = 4920",
        "K_5_As_per_rad = 64",
        "coulomb_Nm = 0.075",
        // Of the output bearing.
        "coulomb_Nm = 0.14\n",
    ] {
        assert!(simulation.contains(line), "{line}");
    }
}

#[test]
fn legs_of_other_proportions_follow_inverse_dynamics_and_stand() {
    for proportions in OTHERS {
        moves_and_stands(proportions, Mode::InverseDynamics);
    }
}

#[test]
fn legs_of_other_proportions_follow_with_torque_feedback_and_stand() {
    for proportions in OTHERS {
        moves_and_stands(proportions, Mode::TorqueFeedbackMotion);
    }
}
